!> Polynomials in place of a density: exact for polynomials, compared often where they are wrong,
!> and without influence on the distribution of draws.
program test_surrogates
   use beamid_densities, only: impossible
   use beamid_errors, only: error_t
   use beamid_kinds, only: wp
   use beamid_noise, only: gaussian_noise
   use beamid_sampling, only: draws_t, plan_t, sample
   use beamid_strings, only: to_text
   use beamid_surrogates, only: new_surrogate, surrogate_t
   use beamid_variables, only: new_variable, unbounded
   use checks, only: check, check_close, finish
   use densities_with_answers, only: comb_t, normal_t, wave_t
   implicit none

   !> Number of draws that a polynomial is fitted to and tested by.
   integer, parameter :: draws = 2000
   !> Power of the sum of squares in `test_power`.
   real(wp), parameter :: power = 8

   call test_polynomial()
   call test_power()
   call test_kink()
   call test_impossible()
   call test_effort()
   call test_wave()
   call test_comb()
   call finish('surrogates')

contains

   !> Draws of n coordinates, more scattered than the density.
   function scattered(n, seed) result(y)
      integer, intent(in) :: n, seed
      real(wp) :: y(n, draws)

      y = reshape(gaussian_noise(n*draws, 1.5_wp, seed), [n, draws])
   end function scattered

   !> A polynomial of degree 5 of four coordinates is found to round-off, and compared as rarely as
   !> possible.
   subroutine test_polynomial()
      type(surrogate_t) :: surrogate
      real(wp) :: y(4, draws), value(draws), far(4)
      integer :: i

      y = scattered(4, 1)
      value = [(polynomial(y(:, i)), i=1, draws)]
      call new_surrogate(y, value, spread([1.0_wp, 1.0_wp, 1.0_wp, 1.0_wp], 2, 2), 0.0_wp, &
         surrogate)
      far = [0.3_wp, -1.0_wp, 0.7_wp, 0.4_wp]
      ! The condition of the terms is about 1e3, the values reach 1e3.
      call check_close('polynomial: value', surrogate%at(far), polynomial(far), 1e-9_wp)
      call check_close('polynomial: share', surrogate%share(far), 0.02_wp, 1e-15_wp)
      call check_close('polynomial: share far away', surrogate%share(10*far), 1.0_wp, 0.0_wp)
   end subroutine test_polynomial

   !> A power of a sum of squares, whose logarithm no polynomial of degree 4 follows so closely.
   subroutine test_power()
      type(surrogate_t) :: surrogate
      real(wp) :: y(3, draws), value(draws), far(3)
      integer :: i

      y = scattered(3, 5)
      value = [(log_power(y(:, i)), i=1, draws)]
      far = [0.3_wp, -1.0_wp, 0.7_wp]
      call new_surrogate(y, value, spread([1.0_wp, 1.0_wp, 1.0_wp], 2, 2), power, surrogate)
      ! As in `test_polynomial`, and the logarithm is multiplied by the power.
      call check_close('power: value', surrogate%at(far), log_power(far), 1e-8_wp)
      call check_close('power: share', surrogate%share(far), 0.02_wp, 1e-15_wp)
      call surrogate%distrust()
      call check_close('power: larger share', surrogate%share(far), 0.08_wp, 1e-15_wp)
      call new_surrogate(y, value, spread([1.0_wp, 1.0_wp, 1.0_wp], 2, 2), 0.0_wp, surrogate)
      call check('logarithm: less exact', abs(surrogate%at(far) - log_power(far)) > 1e-6_wp)
   end subroutine test_power

   pure real(wp) function log_power(y)
      real(wp), intent(in) :: y(3)

      log_power = 5 - power*log((2 + y(1) - y(2)**2)**2 + (y(1)*y(3) + y(2))**2 + 1)
   end function log_power

   pure real(wp) function polynomial(y)
      real(wp), intent(in) :: y(4)

      polynomial = 7 - 3*y(1)**2 + y(1)*y(2)*y(3) - y(4)**4 + 0.2_wp*y(2)**5 - y(2)**2*y(3)**2*y(4)
   end function polynomial

   !> A kink is no polynomial: the errors of other draws are below the share nearly always, because
   !> the share is three times the largest error of the test.
   subroutine test_kink()
      type(surrogate_t) :: surrogate
      real(wp) :: y(2, draws)
      integer :: covered, i, wrong

      y = scattered(2, 2)
      call new_surrogate(y, -abs(y(1, :)), spread([1.0_wp, 1.0_wp], 2, 2), 0.0_wp, surrogate)
      y = scattered(2, 3)
      covered = 0
      wrong = 0
      do i = 1, draws
         if (.not. surrogate%share(y(:, i)) < 1) cycle
         covered = covered + 1
         if (abs(surrogate%at(y(:, i)) + abs(y(1, i))) > surrogate%share(y(:, i))) wrong = wrong + 1
      end do
      call check('kink: compared more often', surrogate%share([0.0_wp, 0.0_wp]) > 0.1_wp, &
         to_text(surrogate%share([0.0_wp, 0.0_wp])))
      call check('kink: shares above the errors', covered > 100 .and. wrong == 0, &
         to_text(wrong)//' of '//to_text(covered))
   end subroutine test_kink

   !> Where the density cannot be computed near the mode, no polynomial holds.
   subroutine test_impossible()
      type(surrogate_t) :: surrogate
      real(wp) :: y(2, draws), value(draws)

      y = scattered(2, 4)
      value = -sum(y**2, dim=1)
      call new_surrogate(y, value, spread([1.0_wp, 1.0_wp], 2, 2), 0.0_wp, surrogate)
      call check('possible: covered', surrogate%share([0.5_wp, 0.5_wp]) < 1)
      where (y(1, :) > 1) value = impossible
      call new_surrogate(y, value, spread([1.0_wp, 1.0_wp], 2, 2), 0.0_wp, surrogate)
      call check('impossible: not covered', .not. surrogate%share([0.5_wp, 0.5_wp]) < 1)
   end subroutine test_impossible

   !> Of a normal density, fewer evaluations than draws suffice.
   subroutine test_effort()
      type(normal_t) :: density
      type(draws_t) :: found
      type(error_t), allocatable :: error

      density%mean = [1.0_wp, -2.0_wp]
      density%precision = reshape([2.0_wp, 0.5_wp, 0.5_wp, 1.0_wp], [2, 2])
      call sample(density, [new_variable(1.0_wp, -unbounded, unbounded, 1.0_wp), &
         new_variable(1.0_wp, -unbounded, unbounded, 1.0_wp)], [0.0_wp, 0.0_wp], plan_t(), found, &
         error)
      call check('effort: done', .not. allocated(error))
      if (allocated(error)) return
      call check('effort: evaluations', found%effective >= 10000 .and. found%evaluations < 5000, &
         to_text(found%evaluations))
   end subroutine test_effort

   !> A normal density with short waves, which no polynomial follows: the mean of the waves is that
   !> of a numerical integral. Without the comparisons, it would be 0.
   subroutine test_wave()
      type(wave_t) :: density
      type(draws_t) :: found
      type(error_t), allocatable :: error
      real(wp), parameter :: step = 1e-3_wp
      real(wp) :: expected, q, total, wave, weight
      integer :: i

      density%height = 0.3_wp
      density%number = 9
      expected = 0
      total = 0
      do i = -10000, 10000
         q = i*step
         wave = sin(density%number*q)
         weight = exp(density%height*wave - q**2/2)
         expected = expected + weight*wave
         total = total + weight
      end do
      expected = expected/total
      call sample(density, [new_variable(1.0_wp, -unbounded, unbounded, 1.0_wp)], [0.0_wp], &
         plan_t(), found, error)
      call check('wave: done', .not. allocated(error))
      if (allocated(error)) return
      ! The deviation of a sine is 0.7; five of the mean's.
      call check_close('wave: mean', sum(sin(density%number*found%q))/size(found%q), expected, &
         5*0.7_wp/sqrt(min(found%effective, 10000.0_wp)))
      call check('wave: far from 0', expected > 0.1_wp, to_text(expected))
   end subroutine test_wave

   !> Narrow gaps that a test may miss: where a comparison finds one, the draws are repeated with
   !> more comparisons.
   subroutine test_comb()
      type(comb_t) :: density
      type(plan_t) :: plan
      type(draws_t) :: found
      type(error_t), allocatable :: error
      integer :: k, repeated

      repeated = 0
      do k = 1, 20
         plan%seed = k
         call sample(density, [new_variable(1.0_wp, -unbounded, unbounded, 1.0_wp)], [0.0_wp], &
            plan, found, error)
         if (allocated(error)) exit
         ! Without a repetition, the density is computed at the first 800 draws, at those of the
         ! others that are far away (5 %), and at a fiftieth of the rest.
         if (found%evaluations > 800 + 0.15_wp*found%effective) repeated = repeated + 1
         call check_close('comb '//to_text(k)//': mean', sum(found%q)/size(found%q), 0.0_wp, &
            5/sqrt(min(found%effective, 10000.0_wp)))
      end do
      call check('comb: done', .not. allocated(error))
      call check('comb: repeated', repeated > 0 .and. repeated < 20, to_text(repeated))
   end subroutine test_comb

end program test_surrogates
