!> The command `reproduce`: repeats the paper's computations and shows the results beside the
!> published numbers. Also computes published benchmarks, and compares damping mechanisms. The
!> studies themselves are in app/paper.
module beamid_reproduction
   use beamid
   use beamid_acceleration, only: reproduce_acceleration
   use beamid_benchmarks, only: reproduce_benchmarks
   use beamid_commands, only: deliver, settings_t
   use beamid_convergence, only: reproduce_convergence
   use beamid_damping_study, only: reproduce_damping
   use beamid_errors, only: bad_input
   use beamid_outputs, only: output_t
   use beamid_paths, only: directory_of, join_path
   use beamid_section_4, only: reproduce_section_4
   use beamid_table_4_1, only: reproduce_table_4_1, table_t
   use beamid_tables, only: add_fit_tables
   use beamid_terminal, only: new_progress, print_text, progress_t
   use beamid_texts, only: text_t
   use beamid_varying, only: reproduce_varying
   implicit none
   private

   public :: run_reproduce, reproducible, parts

   !> Words that may follow the command, for messages.
   character(len=*), parameter :: reproducible = 'table-4.1, section-4, table-4.2, table-4.3, '// &
      'table-4.4, table-4.5, table-4.6, acceleration, convergence, varying, benchmarks, '// &
      'damping or all'

   !> The same words as a list; `all` stands for the first `in_all` of them.
   character(len=*), parameter :: parts(*) = [character(len=12) :: 'table-4.1', 'section-4', &
      'acceleration', 'convergence', 'varying', 'benchmarks', 'damping', 'table-4.2', &
      'table-4.3', 'table-4.4', 'table-4.5', 'table-4.6']
   integer, parameter :: in_all = 7

contains

   !> Runs `beamid reproduce WHAT`. With `all`, each part has a folder of its own, out/<part> or
   !> DIR/<part>, and Table 4.1 uses the exact solver, because CVODE would take longer than all
   !> other parts together.
   subroutine run_reproduce(settings, error)
      type(settings_t), intent(in) :: settings
      type(error_t), allocatable, intent(out) :: error
      type(settings_t) :: part
      integer :: k

      if (settings%subject /= 'all') then
         call run_part(settings, .false., error)
         return
      end if
      do k = 1, in_all
         part = settings
         part%subject = trim(parts(k))
         if (allocated(settings%out)) part%out = join_path(settings%out, part%subject)
         if (k > 1) call print_text(new_line('a'), error)
         if (.not. allocated(error)) call run_part(part, .true., error)
         if (allocated(error)) return
      end do
   end subroutine run_reproduce

   !> Runs one part.
   !>
   !> exact  Table 4.1 uses the exact solver, whatever solver its cases name
   subroutine run_part(settings, exact, error)
      type(settings_t), intent(in) :: settings
      logical, intent(in) :: exact
      type(error_t), allocatable, intent(out) :: error
      type(table_t) :: table
      type(text_t) :: summary
      type(output_t) :: output
      type(progress_t) :: progress
      character(len=:), allocatable :: data

      if (.not. any(parts == settings%subject)) then
         call bad_input(error, 'command line: reproduce: found '//settings%subject// &
            ', expected '//reproducible)
         return
      end if
      call find_data(data, error)
      if (allocated(error)) return
      progress = new_progress(settings%quiet)
      select case (settings%subject)
      case ('table-4.1')
         call reproduce_table_4_1(data, exact, table, output, summary, error, progress)
         if (.not. allocated(error)) call add_fit_tables(output, table%case%units, table%fits, &
            table%record)
      case ('acceleration')
         call reproduce_acceleration(data, output, summary, error)
      case ('convergence')
         call reproduce_convergence(data, output, summary, error)
      case ('varying')
         call reproduce_varying(output, summary, error)
      case ('benchmarks')
         call reproduce_benchmarks(data, output, summary, error)
      case ('damping')
         call reproduce_damping(output, summary, error, progress)
      case default
         call reproduce_section_4(data, settings%subject, output, summary, error, progress)
      end select
      call progress%finish()
      if (.not. allocated(error)) call deliver(output, summary%content(), settings, &
         settings%subject, error)
   end subroutine run_part

   !> Finds the project's folder `data`: in the current folder, or else in the folder above the
   !> program that contains fpm.toml.
   subroutine find_data(data, error)
      character(len=:), allocatable, intent(out) :: data
      type(error_t), allocatable, intent(out) :: error
      character(len=:), allocatable :: folder
      integer :: length
      logical :: found

      data = 'data'
      inquire (file='data/table_4_1_fit.nml', exist=found)
      if (found) return
      call get_command_argument(0, length=length)
      allocate (character(len=length) :: folder)
      call get_command_argument(0, folder)
      do while (index(folder, '/') > 0)
         folder = directory_of(folder)
         inquire (file=join_path(folder, 'fpm.toml'), exist=found)
         data = join_path(folder, 'data')
         if (found) return
         if (folder == '/' .or. folder == '.') exit
      end do
      call bad_input(error, &
         'reproduce: found no folder data/ here or above the program, expected to run '// &
         'in the project''s folder')
   end subroutine find_data

end module beamid_reproduction
