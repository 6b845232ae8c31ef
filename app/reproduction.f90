!> `beamid reproduce`: the paper's results computed again, beside the paper's own numbers.
module beamid_reproduction
   use beamid
   use beamid_acceleration, only: run_acceleration
   use beamid_commands, only: settings_t
   use beamid_convergence, only: run_convergence
   use beamid_errors, only: bad_input
   use beamid_paths, only: join_path
   use beamid_section_4, only: run_section_4
   use beamid_table_4_1, only: run_table_4_1
   use beamid_terminal, only: print_text
   implicit none
   private

   public :: run_reproduce, reproducible

   !> What the command line may ask for.
   character(len=*), parameter :: reproducible = 'table-4.1, section-4, table-4.2, table-4.3, '// &
      'table-4.4, table-4.5, table-4.6, acceleration, convergence or all'

   !> What `all` stands for.
   character(len=*), parameter :: parts(*) = [character(len=12) :: 'table-4.1', 'section-4', &
      'acceleration', 'convergence']

contains

   !> beamid reproduce <what>
   subroutine run_reproduce(settings, error)
      type(settings_t), intent(in) :: settings
      type(error_t), allocatable, intent(out) :: error

      select case (settings%subject)
      case ('all'); call run_all(settings, error)
      case ('table-4.1'); call run_table_4_1(settings, error)
      case default; call run_part(settings, error)
      end select
   end subroutine run_reproduce

   !> Everything but Table 4.1 as its case file has it.
   subroutine run_part(settings, error)
      type(settings_t), intent(in) :: settings
      type(error_t), allocatable, intent(out) :: error

      select case (settings%subject)
      case ('section-4', 'table-4.2', 'table-4.3', 'table-4.4', 'table-4.5', 'table-4.6')
         call run_section_4(settings, error)
      case ('acceleration'); call run_acceleration(settings, error)
      case ('convergence'); call run_convergence(settings, error)
      case default
         call bad_input(error, 'command line: reproduce: found '//settings%subject// &
            ', expected '//reproducible)
      end select
   end subroutine run_part

   !> Every part into a folder of its own, out/<part> or with --out DIR DIR/<part>; Table 4.1 by the
   !> exact response, because CVODE takes longer than all the rest.
   subroutine run_all(settings, error)
      type(settings_t), intent(in) :: settings
      type(error_t), allocatable, intent(out) :: error
      type(settings_t) :: part
      integer :: k

      do k = 1, size(parts)
         part = settings
         part%subject = trim(parts(k))
         if (allocated(settings%out)) part%out = join_path(settings%out, part%subject)
         if (k > 1) call print_text(new_line('a'), error)
         if (allocated(error)) return
         if (part%subject == 'table-4.1') then
            call run_table_4_1(part, error, exact=.true.)
         else
            call run_part(part, error)
         end if
         if (allocated(error)) return
      end do
   end subroutine run_all

end module beamid_reproduction
