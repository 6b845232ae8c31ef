!> Score tests of parameters that the model leaves out: rarely significant where the model is right,
!> and significant for the parameter that was left out where the record shows three modes.
program test_score_tests
   use beamid_errors, only: error_t
   use beamid_excitation, only: new_free, new_release
   use beamid_experiments, only: experiment_t
   use beamid_galerkin, only: mesh_t
   use beamid_identification, only: identify, model_t, stage_fit_t, stage_t
   use beamid_kinds, only: wp
   use beamid_noise, only: gaussian_noise
   use beamid_parameters, only: free_index
   use beamid_priors, only: prior_t
   use beamid_score_tests, only: score_test_t, test_candidates
   use beamid_strings, only: to_text
   use beamid_structure, only: structure_t
   use checks, only: check, finish, limit_false_alarms
   use free_decays, only: formulas, made, mesh, noise_of, noisy, stage_for, truth
   use models, only: model_of
   implicit none

   !> The strip with so little damping that its third mode lasts.
   type(structure_t) :: strip
   character(len=5), parameter :: names(4) = [character(len=5) :: 'E', 'm_S', 'c_D', 'gamma']

   strip = truth
   strip%c_D = 3e5_wp
   call test_right_models()
   call test_left_out('k_R')
   call test_left_out('J_S')
   call test_left_out('gamma')
   call test_left_out('offset')
   call test_two_modes()
   call test_prior()
   call test_free_prior()
   call finish('score_tests')

contains

   !> Records of the model itself with white noise. At most 1 % of them may ask for a parameter.
   subroutine test_right_models()
      type(score_test_t), allocatable :: tests(:)
      integer :: records, allowed, false_alarms, k

      call limit_false_alarms(records, allowed)
      false_alarms = 0
      do k = 1, records
         call test_record(strip, 3, 1000 + k, .true., tests)
         if (any(tests%matters)) false_alarms = false_alarms + 1
      end do
      call check('the model is right: hardly any record asks for more', false_alarms <= allowed, &
         to_text(false_alarms)//' of '//to_text(records))
   end subroutine test_right_models

   !> Records of a structure with a property that the model lacks: the test of this property is
   !> significant, and it matters. In at least 9 of 10 records it has the smallest p-value but for
   !> properties that do the same to three modes.
   subroutine test_left_out(name)
      character(len=*), intent(in) :: name
      type(structure_t) :: structure
      type(score_test_t), allocatable :: tests(:)
      integer, parameter :: records = 10
      integer :: found, k, place

      structure = strip
      select case (name)
      case ('k_R')
         structure%end(1)%kappa_R = 0.2_wp*strip%length/(strip%E*strip%I)
      case ('J_S')
         structure%sensor(1)%J_S = 4e-6_wp
      case ('gamma')
         structure%gamma = 0.14_wp
      end select
      found = 0
      do k = 1, records
         call test_record(structure, 3, 2000 + k, name /= 'offset', tests, without=name)
         place = place_of(tests, name)
         call check(name//' is a candidate', place > 0)
         if (place == 0) return
         if (tests(place)%matters .and. tests(place)%p_value < 1e-6_wp) found = found + 1
      end do
      call check(name//' left out: the record asks for it', found >= 9, to_text(found)//' of 10')

   end subroutine test_left_out

   !> The index of a candidate, 0 if it was not tested.
   integer function place_of(tests, name)
      type(score_test_t), intent(in) :: tests(:)
      character(len=*), intent(in) :: name

      do place_of = size(tests), 1, -1
         if (tests(place_of)%name == name) return
      end do
   end function place_of

   !> Two modes have two frequencies, which E and m_S can give them whatever the clamp does.
   subroutine test_two_modes()
      type(structure_t) :: structure
      type(score_test_t), allocatable :: tests(:)

      structure = strip
      structure%end(1)%kappa_R = 0.2_wp*strip%length/(strip%E*strip%I)
      call test_record(structure, 2, 31, .true., tests)
      call check('two modes do not show the clamp', .not. any(tests%name == 'k_R' .and. &
         tests%matters))
   end subroutine test_two_modes

   !> A candidate that is wrong by one standard deviation of its prior is not named, and one that is
   !> wrong by ten is.
   subroutine test_prior()
      type(structure_t) :: structure
      type(score_test_t), allocatable :: tests(:)

      structure = strip
      structure%gamma = 0.14_wp
      call test_record(structure, 3, 41, .true., tests, without='gamma', &
         sd=abs(structure%gamma - strip%gamma))
      call check('a change that the prior allows is not named', .not. any(tests%name == 'gamma' &
         .and. tests%matters))
      call test_record(structure, 3, 41, .true., tests, without='gamma', &
         sd=0.1_wp*abs(structure%gamma - strip%gamma))
      call check('a change beyond the prior is named', any(tests%name == 'gamma' .and. &
         tests%matters))
   end subroutine test_prior

   !> A mass with a prior that is wrong by one standard deviation, in records that show the mass
   !> less precisely than the prior does: the pull of the prior is no sign that the model lacks
   !> something. Of 20 records, at most 1 % may ask for more, and two or more do in 2 of 100 such
   !> suites.
   subroutine test_free_prior()
      type(structure_t) :: structure
      type(score_test_t), allocatable :: tests(:)
      integer :: false_alarms, k

      structure = strip
      structure%sensor(1)%m_S = 1.1_wp*strip%sensor(1)%m_S
      false_alarms = 0
      do k = 1, 20
         call test_record(structure, 2, 2000 + k, .true., tests, of='m_S', &
            sd=0.1_wp*strip%sensor(1)%m_S)
         if (any(tests%matters)) false_alarms = false_alarms + 1
      end do
      call check('a prior that pulls: at most 1 of 20 records asks for more', false_alarms <= 1, &
         to_text(false_alarms))
   end subroutine test_free_prior

   !> Fits a record of a structure by the model without the property, and tests the candidates.
   !>
   !> modes    of the record that the fit takes
   !> offset   whether the fit has an offset
   !> without  a parameter that the fit must not estimate
   !> sd       standard deviation of a prior about the value of `strip`
   !> of       parameter of this prior; default gamma
   subroutine test_record(structure, modes, seed, offset, tests, without, sd, of)
      type(structure_t), intent(in) :: structure
      integer, intent(in) :: modes, seed
      logical, intent(in) :: offset
      type(score_test_t), allocatable, intent(out) :: tests(:)
      character(len=*), intent(in), optional :: without
      real(wp), intent(in), optional :: sd
      character(len=*), intent(in), optional :: of
      type(experiment_t) :: experiment
      type(model_t) :: model
      type(prior_t) :: prior
      type(stage_t) :: stage
      type(stage_fit_t), allocatable :: fits(:)
      type(error_t), allocatable :: error
      integer :: k

      ! Three modes are left after three seconds, two after fifteen.
      experiment = made(structure, new_release(0.02_wp, 0.0_wp, .true.), formulas(3), &
         merge(3.0_wp, 15.0_wp, modes == 3) + 0.002_wp*[(k, k=1, 400)])
      experiment%excitation = new_free(modes)
      experiment = noisy(experiment, gaussian_noise(400, 0.1_wp*noise_of(experiment), seed))
      model = model_of(strip, new_free(modes), formulas(3))
      if (present(sd)) then
         allocate (prior%parameter(1), prior%slope(1))
         prior%name = 'gamma'
         if (present(of)) prior%name = of
         prior%parameter = free_index(prior%name)
         prior%slope = 1
         prior%sd = sd
         model%priors = [prior]
      end if
      stage = stage_for(names, 1)
      stage%start(3) = strip%c_D
      stage%automatic = .true.
      if (present(without)) then
         if (without == 'gamma') stage = stage%without(stage%free == stage%free(4))
      end if
      if (.not. offset) then
         stage%offset = .false.
         stage = stage%without(stage%free == stage%free(size(stage%free)))
      end if
      call identify(model, mesh, [stage], [experiment], fits, error)
      call check('the record is fitted', .not. allocated(error))
      if (.not. allocated(error)) call test_candidates(model, mesh, [experiment], fits(1), tests, &
         error)
      call check('the candidates are tested', .not. allocated(error))
      if (allocated(error)) allocate (tests(0))
   end subroutine test_record

end program test_score_tests
