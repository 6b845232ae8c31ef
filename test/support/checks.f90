!> Checks shared by the test programs: each prints one line and counts; a NaN never passes.
module checks
   use, intrinsic :: iso_fortran_env, only: output_unit
   use beamid_kinds, only: wp
   use beamid_strings, only: to_text
   implicit none
   private

   public :: check, check_close, skip, finish, in_long_run, limit_false_alarms, of_mesh, &
      held_root

   integer :: passed = 0, failed = 0, skipped = 0

contains

   !> Passes when `condition` holds; `detail` is printed either way.
   subroutine check(name, condition, detail)
      character(len=*), intent(in) :: name
      logical, intent(in) :: condition
      character(len=*), intent(in), optional :: detail

      if (condition) then
         passed = passed + 1
         write (output_unit, '(2a)', advance='no') 'ok    ', name
      else
         failed = failed + 1
         write (output_unit, '(2a)', advance='no') 'FAIL  ', name
      end if
      if (present(detail)) write (output_unit, '(2a)', advance='no') ' | ', detail
      write (output_unit, '()')
   end subroutine check

   !> Passes when |value - reference| <= tolerance; prints value, reference and difference.
   subroutine check_close(name, value, reference, tolerance)
      character(len=*), intent(in) :: name
      real(wp), intent(in) :: value, reference, tolerance
      character(len=120) :: detail

      write (detail, '(a,es22.14,a,es22.14,a,es9.2,a,es9.2)') 'got', value, ' expected', &
         reference, ' difference', value - reference, ' allowed', tolerance
      call check(name, abs(value - reference) <= tolerance, trim(detail))
   end subroutine check_close

   !> Says that something was not tested, and why.
   subroutine skip(name, reason)
      character(len=*), intent(in) :: name, reason

      skipped = skipped + 1
      write (output_unit, '(4a)') 'skip  ', name, ' | ', reason
   end subroutine skip

   !> Returns the conditions of a beam whose root does not move and whose tip is free, (condition,
   !> end).
   pure function held_root(may_rotate) result(essential)
      logical, intent(in) :: may_rotate
      logical :: essential(2, 2)

      essential = .false.
      essential(:, 1) = [.true., .not. may_rotate]
   end function held_root

   !> "degree 3, N = 5: ", for the names of checks.
   function of_mesh(degree, elements, turning) result(text)
      integer, intent(in) :: degree, elements
      logical, intent(in), optional :: turning
      character(len=:), allocatable :: text

      text = 'degree '//to_text(degree)//', N = '//to_text(elements)//': '
      if (.not. present(turning)) return
      if (turning) text = text//'turning root, '
   end function of_mesh

   !> Whether $BEAMID_LONG_TESTS asks for what takes too long for every day.
   logical function in_long_run()
      integer :: length

      call get_environment_variable('BEAMID_LONG_TESTS', length=length)
      in_long_run = length > 0
   end function in_long_run

   !> The number of records without a fault, and how many of them a test at a level of 1 % may name.
   !> Of 100, in a long run, more than 4 are named in 3 of 1000 such suites, and of 40 more than 2
   !> in 8 of 1000. The seeds of the records are fixed.
   subroutine limit_false_alarms(records, allowed)
      integer, intent(out) :: records, allowed

      records = merge(100, 40, in_long_run())
      allowed = merge(4, 2, in_long_run())
   end subroutine limit_false_alarms

   !> Prints the counts in the form that scripts/test.sh adds up; exit status 1 if anything failed.
   subroutine finish(suite)
      character(len=*), intent(in) :: suite

      write (output_unit, '(2a,i0,a,i0,a,i0,a)') suite, ': ', passed, ' passed, ', failed, &
         ' failed, ', skipped, ' skipped'
      if (failed > 0 .or. passed + skipped == 0) stop 1, quiet=.true.
   end subroutine finish

end module checks
