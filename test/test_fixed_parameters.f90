!> Parameters that the user asks for and the program keeps fixed: their assumed range counts as a
!> source of error, and nothing is called determined.
program test_fixed_parameters
   use beamid_errors, only: error_t
   use beamid_excitation, only: new_free, new_release
   use beamid_experiments, only: experiment_t
   use beamid_fixed_parameters, only: add_fixed_parameters
   use beamid_identification, only: identify, model_t, stage_fit_t, stage_t
   use beamid_kinds, only: wp
   use beamid_noise, only: gaussian_noise, uniform_noise
   use beamid_strings, only: to_text
   use checks, only: check, finish
   use free_decays, only: formulas, made, mesh, noise_of, noisy, stage_for, truth
   use models, only: model_of
   implicit none

   character(len=5), parameter :: names(4) = [character(len=5) :: 'E', 'm_S', 'c_D', 'gamma']

   call test_one_mode()
   call test_two_modes()
   call finish('fixed_parameters')

contains

   !> 20 records that show mode 1 alone. The case has a mass of the sensor that is wrong by up to a
   !> factor of 3. The interval of E must hold the truth in at least 18: the range is one of 95 %,
   !> and the masses are drawn from all of it. By noise alone it holds the truth in hardly any.
   subroutine test_one_mode()
      integer, parameter :: records = 20
      type(stage_fit_t) :: fit
      type(stage_t) :: stage
      real(wp) :: exponent(records), half
      integer :: by_noise, k, held

      exponent = 2*uniform_noise(records, 5) - 1
      held = 0
      by_noise = 0
      do k = 1, records
         call fit_record(8.0_wp, 3.0_wp**exponent(k), 100 + k, stage, fit)
         if (.not. allocated(fit%free)) return
         if (k == 1) then
            call check('one mode: a parameter is kept fixed', size(fit%free) < size(stage%free))
            call check('one mode: its error is a source of error', allocated(fit%held))
            if (.not. allocated(fit%held)) return
            call check('one mode: assumed', all(fit%held%is_assumed))
            call check('one mode: nothing is determined', .not. any(fit%statistics%determined))
         end if
         associate (E => fit%fit%estimate(1), s => fit%statistics)
            half = fit%half_width(1)
            if (abs(E - truth%E) <= half) held = held + 1
            if (abs(E - truth%E) <= s%corrected_half_width(1)) by_noise = by_noise + 1
            call check('one mode: the interval of E is finite', half < truth%E, &
               to_text(half/truth%E))
         end associate
      end do
      call check('one mode: the interval of E holds the truth', held >= 18, to_text(held)//' of 20')
      call check('one mode: by noise alone it does not', by_noise <= 4, to_text(by_noise)//' of 20')
   end subroutine test_one_mode

   !> With two modes every parameter is estimated, and nothing is added.
   subroutine test_two_modes()
      type(stage_fit_t) :: fit
      type(stage_t) :: stage

      call fit_record(0.5_wp, 1.5_wp, 7, stage, fit)
      if (.not. allocated(fit%free)) return
      call check('two modes: every parameter is estimated', size(fit%free) == size(stage%free))
      call check('two modes: no assumption', .not. allocated(fit%held))
      call check('two modes: E is determined', fit%statistics%determined(1))
   end subroutine test_two_modes

   !> Fits a record that begins some time after the release, from the lines of the record.
   !>
   !> factor  of the mass of the sensor in the model
   !> fit     `free` is not allocated if the fit fails
   subroutine fit_record(begin, factor, seed, stage, fit)
      real(wp), intent(in) :: begin, factor
      integer, intent(in) :: seed
      type(stage_t), intent(out) :: stage
      type(stage_fit_t), intent(out) :: fit
      type(experiment_t) :: experiment
      type(model_t) :: model
      type(stage_fit_t), allocatable :: fits(:)
      type(error_t), allocatable :: error
      integer :: k

      experiment = made(truth, new_release(0.02_wp, 0.0_wp, .true.), formulas(3), &
         begin + 0.005_wp*[(k, k=1, 600)])
      experiment%excitation = new_free(2)
      experiment = noisy(experiment, gaussian_noise(600, noise_of(experiment), seed))
      model = model_of(truth, new_free(2), formulas(3))
      model%structure%sensor(1)%m_S = factor*truth%sensor(1)%m_S
      stage = stage_for(names, 1)
      deallocate (stage%start)
      stage%automatic = .true.
      call identify(model, mesh, [stage], [experiment], fits, error)
      call check('the record is fitted', .not. allocated(error))
      if (allocated(error)) return
      fit = fits(1)
      call add_fixed_parameters(model, mesh, [experiment], stage, fit)
   end subroutine fit_record

end program test_fixed_parameters
