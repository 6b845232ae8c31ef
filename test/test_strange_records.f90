!> Automatic start values on records as strangers have them, made with seeds: right, or declared.
!> No rule was tuned on the seeds that are used here.
program test_strange_records
   use beamid_errors, only: error_t
   use beamid_identification, only: stage_fit_t
   use beamid_kinds, only: wp
   use beamid_strings, only: to_text
   use checks, only: check, finish, in_long_run
   use strange_records, only: declared, failed, new_strange_record, right, strange_t, vague, &
      verdict_on, wrong
   implicit none

   integer, parameter :: plain = 1, gone = 2, gone_and_long = 3

   call test_family('hard records', plain, merge(200, 24, in_long_run()))
   call test_family('a multiple beside a mode that is gone', gone, merge(100, 8, in_long_run()))
   call test_family('and a length that is 2.5 mm off', gone_and_long, merge(100, 8, in_long_run()))
   call finish('strange_records')

contains

   !> Of 200 records at most one may be wrong with an interval that does not hold the truth; those
   !> whose second mode cannot be told from noise must be declared.
   subroutine test_family(name, family, n)
      character(len=*), intent(in) :: name
      integer, intent(in) :: family, n
      integer, parameter :: first_seed = 40000
      type(strange_t) :: strange
      type(stage_fit_t), allocatable :: found(:)
      type(error_t), allocatable :: error
      integer :: outcomes(wrong), strong(wrong), allowed, k, verdict

      outcomes = 0
      strong = 0
      do k = 1, n
         select case (family)
         case (plain)
            call new_strange_record(first_seed + k, strange)
         case (gone)
            call new_strange_record(first_seed + k, strange, 0.3_wp + 0.1_wp*modulo(k, 4), &
               .true., .true.)
         case (gone_and_long)
            call new_strange_record(first_seed + k, strange, 0.3_wp + 0.1_wp*modulo(k, 4), &
               .true., .true., merge(2.5e-3_wp, -2.5e-3_wp, modulo(k/4, 2) == 0))
         end select
         call verdict_on(strange, verdict, found, error)
         outcomes(verdict) = outcomes(verdict) + 1
         if (strange%gain > 50) strong(verdict) = strong(verdict) + 1
      end do
      allowed = merge(0, 1 + n/100, n < 50)
      ! A length that is wrong without a word moves E without one: one in twenty, and two standard
      ! deviations.
      if (family == gone_and_long) allowed = int(0.05_wp*n + 2*sqrt(0.05_wp*n))
      call check(name//': next to none wrong', outcomes(wrong) <= allowed, &
         told(outcomes))
      call check(name//': none fails', outcomes(failed) <= n/50, told(outcomes))
      if (family == plain) then
         call check(name//': three of five right', 10*outcomes(right) >= 6*n, told(outcomes))
         ! 95 in 100; of 14 or so one.
         call check(name//': where there is a second mode nearly all right', &
            sum(strong) - strong(right) <= max(1, sum(strong)/20), told(strong))
      end if
   end subroutine test_family

   function told(outcomes) result(text)
      integer, intent(in) :: outcomes(:)
      character(len=:), allocatable :: text

      text = to_text(outcomes(right))//' right, '//to_text(outcomes(declared))//' declared, '// &
         to_text(outcomes(failed))//' failed, '//to_text(outcomes(vague))//' vague, '// &
         to_text(outcomes(wrong))//' wrong'
   end function told

end program test_strange_records
