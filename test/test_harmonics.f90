!> Harmonics of the first mode beside the second mode of a free decay: rarely found where there are
!> none, and found where one shifts the estimates.
program test_harmonics_beside_modes
   use beamid_errors, only: error_t
   use beamid_excitation, only: new_free, new_release
   use beamid_experiments, only: experiment_t
   use beamid_harmonics, only: test_harmonics
   use beamid_identification, only: identify, model_t, stage_fit_t, stage_t
   use beamid_kinds, only: wp
   use beamid_noise, only: gaussian_noise
   use beamid_parameters, only: free_index
   use beamid_priors, only: prior_t
   use beamid_scores, only: score_test_t
   use beamid_strings, only: to_text
   use beamid_verdicts, only: new_verdict, verdict_t
   use checks, only: check, check_close, finish, limit_false_alarms
   use free_decays, only: formulas, made, mesh, noise_of, noisy, stage_for, truth
   use models, only: model_of
   implicit none

   character(len=5), parameter :: names(4) = [character(len=5) :: 'E', 'm_S', 'c_D', 'gamma']

   call test_right_models()
   call test_short_records()
   call test_one_record()
   call test_many_records()
   call test_prior()
   call finish('harmonics')

contains

   !> Records of the model itself with white noise. At most 1 % of them may be suspected.
   subroutine test_right_models()
      type(score_test_t), allocatable :: tests(:)
      integer :: records, allowed, false_alarms, k

      call limit_false_alarms(records, allowed)
      false_alarms = 0
      do k = 1, records
         call test_records([0.0_wp], 400, 1000 + k, tests)
         if (any(tests%matters)) false_alarms = false_alarms + 1
      end do
      call check('no harmonic: hardly any record is suspected', false_alarms <= allowed, &
         to_text(false_alarms)//' of '//to_text(records))
   end subroutine test_right_models

   !> Few samples: the p-value is not too small. Of 60 records three are expected to have one below
   !> 5 %, and more than eight have it in 4 of 1000 such suites.
   subroutine test_short_records()
      type(score_test_t), allocatable :: tests(:)
      integer :: k, small

      small = 0
      do k = 1, 60
         call test_records([0.0_wp], 24, 2000 + k, tests)
         if (any(tests%p_value < 0.05_wp)) small = small + 1
      end do
      call check('24 samples: p-values are no smaller than chance makes them', small <= 8, &
         to_text(small)//' of 60')
   end subroutine test_short_records

   !> A harmonic that begins with six standard deviations of the noise: the test finds it, and the
   !> change that it predicts brings E closer to the true value. The harmonic shifts E by about one
   !> standard error, so that one record in ten may not show it.
   subroutine test_one_record()
      type(score_test_t), allocatable :: tests(:)
      type(stage_fit_t) :: fit
      integer, parameter :: records = 10
      integer :: closer, found, k

      found = 0
      closer = 0
      do k = 1, records
         call test_records([6.0_wp], 400, 3000 + k, tests, fit)
         call check('one mode has a harmonic beside it', size(tests) == 1)
         if (size(tests) /= 1) return
         associate (one => tests(1), E => fit%quantities(1)%value)
            if (one%matters .and. one%record == 1 .and. one%mode == 2) found = found + 1
            if (abs(E + one%shift(1) - truth%E) < abs(E - truth%E)) closer = closer + 1
            if (one%matters) call check('the interval reaches to the estimate with the harmonic', &
               fit%reach(1, 1) >= -one%shift(1) .and. fit%reach(2, 1) >= one%shift(1))
         end associate
      end do
      call check('a harmonic is found', found >= 9, to_text(found)//' of 10')
      call check('its shift moves E to the true value', closer >= 9, to_text(closer)//' of 10')
   end subroutine test_one_record

   !> Harmonics that begin with .9 standard deviations of the noise: hardly one record shows its
   !> own, but eight records together do. Of two records, the one with a harmonic is named.
   subroutine test_many_records()
      type(score_test_t), allocatable :: tests(:)
      integer, parameter :: sets = 10
      integer :: alone, found, k

      alone = 0
      found = 0
      do k = 1, sets
         call test_records([0.9_wp], 400, 4000 + k, tests)
         if (all(tests%matters)) alone = alone + 1
         call test_records(spread(0.9_wp, 1, 8), 400, 4000 + k, tests)
         if (all(tests%matters)) found = found + 1
      end do
      call check('small harmonics in eight records are found', found >= 9, to_text(found)// &
         ' of 10')
      call check('one of them alone is not', alone <= 5, to_text(alone)//' of 10')
      call test_records([0.0_wp, 6.0_wp], 400, 4101, tests)
      call check('the record with the harmonic is named', tests(1)%record == 2)
   end subroutine test_many_records

   !> The row of a prior follows those of the records. A prior that says nothing changes nothing.
   subroutine test_prior()
      type(score_test_t), allocatable :: tests(:), with(:)

      call test_records([6.0_wp, 6.0_wp], 400, 5001, tests)
      call test_records([6.0_wp, 6.0_wp], 400, 5001, with, sd=1e6_wp*truth%sensor(1)%m_S)
      ! Two fits end at the same place to the tolerance of the search, 1e-6 of a standard error.
      call check_close('a weak prior: shift of E', with(1)%shift(1)/tests(1)%shift(1), 1.0_wp, &
         1e-4_wp)
      call check_close('a weak prior: decrease of J', with(1)%decrease/tests(1)%decrease, 1.0_wp, &
         1e-4_wp)
   end subroutine test_prior

   !> Fits records of the strip and tests their harmonics.
   !>
   !> amplitudes  (records) amplitude of a harmonic at the first sample, in standard deviations of
   !>             the noise. The harmonic is the one next to mode 2; it decays as this power of mode
   !>             1 does
   !> samples     of each record
   !> sd          of a prior of m_S; absent: none
   subroutine test_records(amplitudes, samples, seed, tests, fit, sd)
      real(wp), intent(in) :: amplitudes(:)
      integer, intent(in) :: samples, seed
      type(score_test_t), allocatable, intent(out) :: tests(:)
      type(stage_fit_t), intent(out), optional :: fit
      real(wp), intent(in), optional :: sd
      type(experiment_t) :: clean, experiments(size(amplitudes))
      type(model_t) :: model
      type(prior_t) :: prior
      type(stage_t) :: stage
      type(stage_fit_t), allocatable :: fits(:)
      type(verdict_t) :: verdict
      type(error_t), allocatable :: error
      complex(wp), allocatable :: s(:)
      integer :: k, order

      ! Two modes are left after half a second.
      clean = made(truth, new_release(0.02_wp, 0.0_wp, .true.), formulas(3), 0.5_wp + 0.01_wp &
         *[(k, k=1, samples)])
      clean%excitation = new_free(2)
      model = model_of(truth, new_free(2), formulas(3))
      if (present(sd)) then
         prior%name = 'm_S'
         prior%parameter = [free_index('m_S')]
         prior%slope = [1.0_wp]
         prior%sd = sd
         model%priors = [prior]
      end if
      stage = stage_for(names, 1)
      call identify(model, mesh, [stage], [clean], fits, error)
      if (.not. allocated(error)) call new_verdict([clean], mesh, fits(1), verdict, error)
      call check('the record without noise is fitted', .not. allocated(error))
      allocate (tests(0))
      if (allocated(error)) return
      s = verdict%s(:, 1)
      order = nint(aimag(s(2))/aimag(s(1)))
      do k = 1, size(experiments)
         experiments(k) = noisy(clean, gaussian_noise(samples, 0.1_wp*noise_of(clean), &
            seed + 100*k))
         associate (one => experiments(k))
            one%measured = one%measured + amplitudes(k)*0.1_wp*noise_of(clean)*real(exp(order*s(1) &
               *(one%samples - one%samples(1))))
         end associate
      end do
      stage = stage_for(names, size(amplitudes))
      call identify(model, mesh, [stage], experiments, fits, error)
      if (.not. allocated(error)) call new_verdict(experiments, mesh, fits(1), verdict, error)
      call check('the records are fitted', .not. allocated(error))
      if (allocated(error)) return
      call test_harmonics(experiments, verdict%s, fits(1), tests)
      if (present(fit)) fit = fits(1)
   end subroutine test_records

end program test_harmonics_beside_modes
