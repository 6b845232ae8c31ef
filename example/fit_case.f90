!> The fit of a case file: what `beamid identify` finds, as numbers; from the project's root.
program fit_case_file
   use beamid, only: case_fit_t, case_t, error_t, fit_case, judge_case, load_case, needs_fit, &
      read_case, wp
   implicit none
   type(case_t) :: case
   type(case_fit_t) :: found
   type(error_t), allocatable :: error
   character(len=1000) :: path
   real(wp) :: ends(2)
   integer :: k

   path = 'data/bench_fit.nml'
   if (command_argument_count() > 0) call get_command_argument(1, path)
   call read_case(trim(path), needs_fit, case, error)
   if (.not. allocated(error)) call load_case(case, found, error)
   if (.not. allocated(error)) call fit_case(case, found, error)
   if (.not. allocated(error)) call judge_case(case, found, error)
   if (allocated(error)) error stop error%message
   if (found%verdict%no_fit /= '') error stop found%verdict%no_fit

   print '(a,f0.1,a)', 'the model explains ', found%verdict%qualities(1)%fit_percent, &
      ' % of the first record'
   associate (last => found%fits(size(found%fits, 1), size(found%fits, 2)))
      do k = 1, size(last%free)
         ! By noise, by the mesh and by the errors of what is held.
         ends = last%quantities(k)%ends(last%total(k))
         print '(a,es13.5,a,es12.5,a,es12.5)', last%quantities(k)%name(:8), &
            last%quantities(k)%value, '  from', ends(1), ' to', ends(2)
      end do
   end associate
end program fit_case_file
