!> The three formulas for the acceleration, on motions known in closed form.
program test_observation
   use beamid_kinds, only: wp
   use beamid_method_groups, only: formula_names
   use beamid_observation, only: new_sampling, observation_t, sampling_t
   use beamid_responses, only: response_t
   use beamid_strings, only: to_text
   use checks, only: check, check_close, finish
   implicit none

   real(wp), parameter :: eps = epsilon(1.0_wp), omega = 2.59063789_wp
   integer :: formula, k
   !> Samples on the grid of Table 4.1, and at times without pattern.
   real(wp), parameter :: regular(49) = [(0.2_wp + 0.1_wp*k, k=0, 48)], &
      irregular(7) = [0.0_wp, 0.013_wp, 0.5_wp, 0.5001_wp, 0.77_wp, 2.0_wp, 3.1_wp]

   do formula = 1, size(formula_names)
      call test_times(formula, 'regular', regular, 0.1_wp)
      call test_times(formula, 'irregular', irregular, 0.07_wp)
      call test_times(formula, 'one sample', [1.0_wp], 0.3_wp)
      call test_formula(formula, 'regular', regular, 0.1_wp)
      call test_formula(formula, 'irregular', irregular, 0.07_wp)
      call test_middle(formula)
   end do
   call test_merged()
   call test_names()
   call test_rest()
   call finish('observation')

contains

   !> u = sin(omega t) with its derivatives; the rest state before t = 0 when asked for.
   function motion(times, from_rest) result(response)
      real(wp), intent(in) :: times(:)
      logical, intent(in) :: from_rest
      type(response_t) :: response

      response%t = times
      response%displacement = sin(omega*times)
      response%velocity = omega*cos(omega*times)
      response%acceleration = -omega**2*sin(omega*times)
      if (from_rest) then
         where (times < 0)
            response%displacement = 0
            response%velocity = 0
            response%acceleration = 0
         end where
      end if
   end function motion

   !> Ascending, no two alike, and each time that the formula needs is there.
   subroutine test_times(formula, name, samples, delta)
      integer, intent(in) :: formula
      character(len=*), intent(in) :: name
      real(wp), intent(in) :: samples(:), delta
      type(sampling_t) :: sampling
      real(wp), parameter :: reaches(3) = [1.0_wp, 0.5_wp, 0.0_wp]
      real(wp) :: reach, worst
      integer :: i

      sampling = new_sampling(observation_t(formula, delta), samples)
      reach = delta*reaches(formula)
      associate (t => sampling%times)
         ! Distinct means more apart than round-off would leave two names of one time.
         call check(title(formula)//name//': ascending, distinct', &
            all(t(2:) - t(:size(t) - 1) > 1e-10_wp), to_text(size(t))//' times')
         worst = 0
         do i = 1, size(samples)
            worst = max(worst, minval(abs(t - samples(i))), minval(abs(t - samples(i) - reach)), &
               minval(abs(t - samples(i) + reach)))
         end do
         ! Merged times differ by round-off of t + Delta: 64 eps of the largest time is the margin.
         call check_close(title(formula)//name//': nothing missing', worst, 0.0_wp, &
            64*eps*(samples(size(samples)) + delta))
         call check(title(formula)//name//': nothing more', &
            all([(minval(abs(t(i) - [samples, samples - reach, samples + reach])) < 1e-12_wp, &
            i=1, size(t))]))
      end associate
   end subroutine test_times

   function title(formula) result(text)
      integer, intent(in) :: formula
      character(len=:), allocatable :: text

      text = trim(formula_names(formula))//', '
   end function title

   !> (4.1) makes -(2 - 2 cos(omega D))/D^2 sin(omega t), (4.2) -(2/D) omega sin(omega D/2)
   !> sin(omega t).
   subroutine test_formula(formula, name, samples, delta)
      integer, intent(in) :: formula
      character(len=*), intent(in) :: name
      real(wp), intent(in) :: samples(:), delta
      type(sampling_t) :: sampling
      real(wp) :: factor, allowed

      sampling = new_sampling(observation_t(formula, delta), samples)
      ! Round-off of the values (1, omega, omega^2), and of the merged times (64 eps t, times the
      ! slope), through the division.
      select case (formula)
      case (1)
         factor = -(2 - 2*cos(omega*delta))/delta**2
         allowed = 4*(1 + omega*maxval(samples))*eps/delta**2
      case (2)
         factor = -2*omega*sin(omega*delta/2)/delta
         allowed = 2*omega*(1 + omega*maxval(samples))*eps/delta
      case default
         factor = -omega**2
         allowed = omega**2*(1 + omega*maxval(samples))*eps
      end select
      call check_close(title(formula)//name//': in closed form', &
         maxval(abs(sampling%acceleration(motion(sampling%times, .false.)) &
         - factor*sin(omega*samples))), 0.0_wp, allowed)
   end subroutine test_formula

   !> `at_samples` returns the motion at the samples themselves.
   subroutine test_middle(formula)
      integer, intent(in) :: formula
      type(sampling_t) :: sampling
      type(response_t) :: narrow

      sampling = new_sampling(observation_t(formula, 0.1_wp), regular)
      narrow = sampling%at_samples(motion(sampling%times, .false.))
      ! The merged time may be off by round-off of t.
      call check_close(title(formula)//'displacement at the samples', &
         maxval(abs(narrow%displacement - sin(omega*regular))), 0.0_wp, 64*eps*omega)
      call check_close(title(formula)//'velocity at the samples', &
         maxval(abs(narrow%velocity - omega*cos(omega*regular))), 0.0_wp, 64*eps*omega**2)
      call check_close(title(formula)//'acceleration at the samples', &
         maxval(abs(narrow%acceleration + omega**2*sin(omega*regular))), 0.0_wp, 64*eps*omega**3)
      call check_close(title(formula)//'times of the samples', maxval(abs(narrow%t - regular)), &
         0.0_wp, 0.0_wp)
   end subroutine test_middle

   !> On the grid of Table 4.1 with Delta = .1 the copies fall onto each other: .1, .2 .. 5.1.
   subroutine test_merged()
      type(sampling_t) :: sampling

      sampling = new_sampling(observation_t(1, 0.1_wp), regular)
      call check('(4.1): 51 times, not 147', size(sampling%times) == 51, &
         to_text(size(sampling%times)))
      sampling = new_sampling(observation_t(2, 0.1_wp), regular)
      call check('(4.2): 99 times', size(sampling%times) == 99, to_text(size(sampling%times)))
      sampling = new_sampling(observation_t(3, 0.0_wp), regular)
      call check('(3.13): 49 times', size(sampling%times) == 49, to_text(size(sampling%times)))
      ! Times that are close but not the same stay apart.
      sampling = new_sampling(observation_t(3, 0.0_wp), [1.0_wp, 1 + 1e-9_wp])
      call check('1e-9 apart is not the same time', size(sampling%times) == 2)
   end subroutine test_merged

   subroutine test_names()
      call check('the formulas'' names', formula_names(1) == 'displacement_difference' .and. &
         formula_names(2) == 'velocity_difference' .and. formula_names(3) == 'equation')
   end subroutine test_names

   !> A sample nearer than Delta to t = 0 is differenced against the rest state: u(-D/2) = 0.
   subroutine test_rest()
      real(wp), parameter :: delta = 0.1_wp
      type(sampling_t) :: sampling

      sampling = new_sampling(observation_t(1, delta), [delta/2])
      call check('a time before 0 is asked for', sampling%times(1) < 0)
      ! As above: 4 eps/D^2 with times below 1.
      call check_close('(4.1) across t = 0', sum(sampling%acceleration(motion(sampling%times, &
         .true.))), (sin(omega*3*delta/2) - 2*sin(omega*delta/2))/delta**2, 8*eps/delta**2)
      sampling = new_sampling(observation_t(2, delta), [delta/4])
      call check_close('(4.2) across t = 0', sum(sampling%acceleration(motion(sampling%times, &
         .true.))), omega*cos(omega*3*delta/4)/delta, 8*omega*eps/delta)
   end subroutine test_rest

end program test_observation
