!> Do 95 % intervals hold the truth in 95 of 100 records? Two thousand noisy records of Table 4.1's
!> structure, fitted with the model that made them.
program test_coverage
   use beamid_errors, only: error_t
   use beamid_excitation, only: new_pulse
   use beamid_galerkin, only: mesh_t
   use beamid_identification, only: identify, model_t, simulate, simulation_t, stage_fit_t, stage_t
   use beamid_kinds, only: wp
   use beamid_noise, only: gaussian_noise
   use beamid_observation, only: observation_t
   use beamid_strings, only: to_text
   use checks, only: check, check_close, finish
   use models, only: model_of, stage_of
   use single_responses, only: truth => table_4_1
   implicit none

   type(mesh_t), parameter :: mesh = mesh_t(3, 4, 4, 1)
   character(len=3), parameter :: names(4) = ['c_D', 'm_H', 'c_H', 'k_H']
   real(wp), parameter :: exact(4) = [truth%c_D, truth%hose(1)%m_H, truth%hose(1)%c_H, &
      truth%hose(1)%k_H]
   integer, parameter :: records = 2000, samples = 49
   integer :: k
   real(wp), parameter :: times(samples) = [(0.1_wp*k, k=2, samples + 1)]

   call test_intervals()
   call finish('coverage')

contains

   !> Bounds for the rate: 1900 of 2000 are expected with a deviation of 9.7; 93.5 to 96.5 % are
   !> three deviations either way, with almost nothing for what is not linear. The records are
   !> pieces of one stream of noise: independent.
   subroutine test_intervals()
      type(model_t) :: model
      type(stage_t) :: stage
      type(simulation_t) :: clean
      type(stage_fit_t), allocatable :: fits(:)
      type(error_t), allocatable :: error
      real(wp), allocatable :: noise(:)
      real(wp) :: sd, below(4), mean(4), spread_of(4), stated(4), variance
      integer :: i, r, inside(4), corrected(4), failed, white, on_bound, free_of_bound, inside_free

      model = model_of(truth, new_pulse(1.0_wp, 0.05_wp), observation_t(1, 0.1_wp))
      call simulate(model, mesh, times, clean, error)
      call check('record made', .not. allocated(error))
      if (allocated(error)) return
      sd = 0.02_wp*norm2(clean%acceleration)/sqrt(real(samples, wp))
      noise = gaussian_noise(records*samples, sd, 4711)
      stage = stage_of(names, exact*[0.8_wp, 1.1_wp, 0.9_wp, 1.1_wp])
      inside = 0
      corrected = 0
      below = 0
      mean = 0
      spread_of = 0
      stated = 0
      variance = 0
      failed = 0
      white = 0
      on_bound = 0
      inside_free = 0
      do r = 1, records
         call identify(model, mesh, [stage], times, clean%acceleration &
            + noise((r - 1)*samples + 1:r*samples), fits, error)
         if (allocated(error)) then
            failed = failed + 1
            print '(a,i0,2a)', '      record ', r, ': ', error%message
            cycle
         end if
         associate (s => fits(1)%statistics, q => fits(1)%fit%estimate)
            where (abs(q - exact) <= s%half_width) inside = inside + 1
            where (abs(q - exact) <= s%corrected_half_width) corrected = corrected + 1
            where (q < exact) below = below + 1
            mean = mean + q/records
            spread_of = spread_of + (q - exact)**2/records
            stated = stated + s%std_error**2/records
            variance = variance + s%variance/records
            if (fits(1)%check%white) white = white + 1
            if (.not. q(1) > 0) then
               on_bound = on_bound + 1
            else if (abs(q(1) - exact(1)) <= s%half_width(1)) then
               inside_free = inside_free + 1
            end if
         end associate
      end do
      free_of_bound = records - on_bound
      call check('all searches converge', failed == 0, to_text(failed)//' failed')
      ! 45 degrees of freedom each: sqrt(2/45/2000) = .5 %, four of these.
      call check_close('noise variance, mean over the true one', variance/sd**2, 1.0_wp, 0.02_wp)
      do i = 1, 4
         print '(a,a,f7.2,a,f7.2,3(a,es10.3))', '      ', names(i)//': inside', &
            100.0_wp*inside(i)/records, ' %, corrected', 100.0_wp*corrected(i)/records, &
            ' %, mean/truth', mean(i)/exact(i), ', deviation/truth', sqrt(spread_of(i))/exact(i), &
            ', stated', sqrt(stated(i))/exact(i)
      end do
      do i = 2, 4
         call check_close(names(i)//', rate of coverage', real(inside(i), wp)/records, 0.95_wp, &
            0.015_wp)
         ! Intervals that allow for coloured residuals are never narrower.
         call check(names(i)//', corrected intervals hold it no less often', corrected(i) &
            >= inside(i), to_text(corrected(i)))
         ! A deviation of 2000 values is known to 1.6 %; four of these.
         call check_close(names(i)//', deviation over the one stated', &
            sqrt(spread_of(i)/stated(i)), 1.0_wp, 0.065_wp)
         ! Without bias the mean is within deviation/sqrt(2000); four of these, and what curvature
         ! does, a deviation squared.
         call check_close(names(i)//', bias over the truth', mean(i)/exact(i), 1.0_wp, &
            4*sqrt(spread_of(i)/records)/exact(i) + spread_of(i)/exact(i)**2)
         call check_close(names(i)//', below the truth as often as above', below(i)/records, &
            0.5_wp, 4*sqrt(0.25_wp/records))
      end do
      ! c_D is known to half of itself, too badly for linear theory: its stated error falls with the
      ! estimate, so that low estimates miss the truth more often than high ones, and those on the
      ! bound, two deviations away, nearly all do. The bound itself costs nothing: what would lie
      ! below it would miss as well. A deviation of one half, squared, times 10 % or so is what
      ! the rate of 95 % may be wrong by.
      print '(a,i0,a,f7.2,a)', '      c_D on its bound: ', on_bound, &
         ' records; inside where not: ', 100.0_wp*inside_free/free_of_bound, ' %'
      call check_close('c_D, rate of coverage', real(inside(1), wp)/records, 0.95_wp, 0.03_wp)
      ! Two deviations from the bound: 2.3 % of the records, 4 deviations of 1.3 %/4 each way.
      call check('c_D, records on the bound', on_bound > 10 .and. on_bound < 80, to_text(on_bound))
      ! White noise: 95 of 100 records pass, deviation .5 %; as test_whiteness has it, for 49
      ! samples the law of the test is right to a few per cent.
      call check_close('records found white', real(white, wp)/records, 0.95_wp, 0.05_wp)
   end subroutine test_intervals

end program test_coverage
