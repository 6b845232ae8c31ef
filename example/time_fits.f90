!> How long a fit takes, and one evaluation of its residuals and their Jacobian, without start-up
!> and reading: `time_fits CASE FITS EVALUATIONS [SET_UPS]` does as many of each on the last mesh of
!> a case and prints medians of the processor's time in seconds. Without words: one of each of the
!> bench.
program time_fits
   use beamid, only: case_t, error_t, experiment_t, load_experiments, needs_fit, note_length, &
      read_case, stage_fit_t, variable_t, wp
   use beamid_identification, only: run_stages
   use beamid_residuals, only: new_residuals, residual_t
   use beamid_sorting, only: median
   use beamid_unknowns, only: quantity_t, variables_of
   implicit none
   type(case_t) :: case
   type(experiment_t), allocatable :: experiments(:)
   type(error_t), allocatable :: error
   character(len=note_length), allocatable :: notes(:)
   character(len=1000) :: path, word
   integer :: fits, evaluations, set_ups, failed

   path = 'data/bench_fit.nml'
   fits = 1
   evaluations = 1
   set_ups = 1
   failed = 0
   if (command_argument_count() > 0) then
      call get_command_argument(1, path)
      call get_command_argument(2, word)
      read (word, *, iostat=failed) fits
      call get_command_argument(3, word)
      if (failed == 0) read (word, *, iostat=failed) evaluations
      set_ups = 0
      call get_command_argument(4, word)
      if (failed == 0 .and. word /= '') read (word, *, iostat=failed) set_ups
   end if
   if (failed /= 0) error stop 'found no numbers, expected time_fits CASE FITS EVALUATIONS'
   call read_case(trim(path), needs_fit, case, error)
   if (.not. allocated(error)) call load_experiments(case, experiments, notes, error)
   if (allocated(error)) error stop error%message
   call repeat_fits()
   call repeat_set_ups()
   call repeat_evaluations()
   call print_memory()

contains

   !> Whole fits, with the mesh and the statistics.
   subroutine repeat_fits()
      type(stage_fit_t), allocatable :: found(:)
      real(wp) :: whole(fits)
      integer :: k

      do k = 1, fits
         whole(k) = now()
         call run_stages(case%model, case%meshes(size(case%meshes)), case%stages, experiments, &
            found, error, check=.false.)
         whole(k) = now() - whole(k)
         if (allocated(error)) error stop error%message
      end do
      if (fits == 0) return
      print '(a,es12.4)', 'fit', median(whole)
      print '(a,i0)', 'evaluations_of_fit ', found(1)%fit%evaluations
   end subroutine repeat_fits

   !> The share of a fit that the mesh takes.
   subroutine repeat_set_ups()
      type(residual_t) :: problem
      real(wp) :: set_up(set_ups)
      integer :: k

      do k = 1, set_ups
         set_up(k) = now()
         call new_residuals(case%model, case%meshes(size(case%meshes)), experiments, problem, error)
         set_up(k) = now() - set_up(k)
         if (allocated(error)) error stop error%message
      end do
      if (set_ups > 0) print '(a,es12.4)', 'set_up', median(set_up)
   end subroutine repeat_set_ups

   !> Residuals and Jacobian (by an integrator: residuals) near the start of the first stage: those
   !> of a search, in condensed rows, are `evaluation`, all rows are `all_rows`. The parameters move
   !> a little each time, as in a search: the poles of a structure are kept.
   subroutine repeat_evaluations()
      type(residual_t) :: problem
      type(variable_t), allocatable :: variables(:)
      type(quantity_t), allocatable :: quantities(:)
      real(wp), allocatable :: p(:), r(:), jac(:, :), all_r(:), all_jac(:, :)
      real(wp), dimension(evaluations) :: seconds, of_all_rows
      integer :: k, m, n, rows

      call new_residuals(case%model, case%meshes(size(case%meshes)), experiments, problem, error)
      if (allocated(error)) error stop error%message
      problem%free = case%stages(1)%free
      problem%record = case%stages(1)%owners()
      problem%offset = case%stages(1)%offset
      call variables_of(case%stages(1), problem%scenario, variables, quantities, error)
      if (allocated(error)) error stop error%message
      m = problem%samples()
      n = size(variables)
      rows = m
      if (problem%exact) rows = problem%condensed_rows(m, n)
      print '(a,i0)', 'samples ', m
      allocate (r(rows), jac(rows, n), all_r(m), all_jac(m, n))
      do k = 1, evaluations
         p = variables%start*(1 + 1e-3_wp*sin(real(k, wp)))
         seconds(k) = now()
         if (problem%exact) then
            call problem%condensed(p, r, jac, error)
         else
            call problem%residuals(p, r, error)
         end if
         seconds(k) = now() - seconds(k)
         if (allocated(error)) error stop error%message
         if (.not. problem%exact) cycle
         p = variables%start*(1 + 1e-3_wp*cos(real(k, wp)))
         of_all_rows(k) = now()
         call problem%jacobian(p, all_r, all_jac, error)
         of_all_rows(k) = now() - of_all_rows(k)
         if (allocated(error)) error stop error%message
      end do
      if (evaluations == 0) return
      print '(a,es12.4)', 'evaluation', median(seconds)
      if (problem%exact) print '(a,es12.4)', 'all_rows', median(of_all_rows)
   end subroutine repeat_evaluations

   !> The most that the process has held, where the system tells (Linux).
   subroutine print_memory()
      character(len=80) :: line
      integer :: unit, status

      open (newunit=unit, file='/proc/self/status', action='read', iostat=status)
      do while (status == 0)
         read (unit, '(a)', iostat=status) line
         if (status == 0 .and. line(:6) == 'VmHWM:') print '(2a)', 'peak_kB', &
            line(7:index(line, 'kB') - 1)
      end do
   end subroutine print_memory

   real(wp) function now()
      call cpu_time(now)
   end function now

end program time_fits
