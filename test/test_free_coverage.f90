!> Do 95 % intervals of fits from a start of which nothing is known hold the truth in 95 of 100
!> records of the model itself?
program test_free_coverage
   use beamid_errors, only: error_t
   use beamid_excitation, only: new_free, new_release
   use beamid_experiments, only: experiment_t
   use beamid_identification, only: identify, model_t, stage_fit_t, stage_t
   use beamid_kinds, only: wp
   use beamid_noise, only: gaussian_noise
   use beamid_parameters, only: offset
   use beamid_strings, only: to_text
   use checks, only: check, check_close, finish
   use free_decays, only: formulas, made, make_two, mesh, names, noise_of, noisy, stage_for, &
      stamps, true_offset, truth
   use models, only: model_of
   implicit none

   call test_one()
   call test_two()
   call finish('free_coverage')

contains

   !> 400 records of the model itself, 1 % of noise each: 95 % intervals of every quantity, what
   !> was eliminated included.
   subroutine test_one()
      type(experiment_t) :: clean

      clean = made(truth, new_release(0.02_wp, 0.0_wp, .true.), formulas(3), stamps(200, 0.5_wp, &
         21))
      call count_inside('one record', [clean], stage_for(names, 1), &
         [truth%E, truth%sensor(1)%m_S, truth%c_D, truth%gamma], 400)
   end subroutine test_one

   !> The same over two records with E, c_D and gamma in common.
   subroutine test_two()
      type(experiment_t) :: two(2)

      call make_two(two)
      two(1)%sd = 1
      two(2)%sd = 1
      call count_inside('two records', two, stage_for([character(len=5) :: 'E', 'c_D', &
         'gamma'], 2), [truth%E, 0.004_wp, 0.005_wp, truth%c_D, truth%gamma], 400)
   end subroutine test_two

   !> exact  (n) true values of what is searched for
   subroutine count_inside(what, clean, stage, exact, records)
      character(len=*), intent(in) :: what
      type(experiment_t), intent(in) :: clean(:)
      type(stage_t), intent(in) :: stage
      real(wp), intent(in) :: exact(:)
      integer, intent(in) :: records
      type(model_t) :: model
      type(experiment_t), allocatable :: worse(:)
      type(stage_fit_t), allocatable :: fits(:)
      type(error_t), allocatable :: error
      real(wp), allocatable :: noise(:), true_values(:), spread_of(:), stated(:)
      integer, allocatable :: inside(:)
      real(wp) :: sd, variance, band
      integer :: i, k, r, n, m, last, failed, white

      model = model_of(truth, new_free(2), formulas(3))
      n = size(exact)
      sd = noise_of(clean(1))
      ! Without noise the truth itself, but for what is left of the third mode, 1e-5 of it at first.
      call identify(model, mesh, [stage], clean, fits, error)
      call check(what//', without noise: the fit converges', .not. allocated(error))
      if (allocated(error)) return
      true_values = fits(1)%quantities%value
      call check_close(what//', without noise: largest relative error', maxval(abs(true_values(:n) &
         /exact - 1)), 0.0_wp, 1e-3_wp)
      true_values(:n) = exact
      do k = 1, size(true_values)
         if (fits(1)%quantities(k)%parameter /= offset) cycle
         call check_close(what//', without noise: '//trim(fits(1)%quantities(k)%name), &
            true_values(k), true_offset, 1e-4_wp*true_offset)
         true_values(k) = true_offset
      end do
      m = sum([(size(clean(i)%samples), i=1, size(clean))])
      noise = gaussian_noise(records*m, sd, 4711)
      allocate (inside(size(true_values)), source=0)
      allocate (spread_of(size(true_values)), stated(size(true_values)), source=0.0_wp)
      variance = 0
      failed = 0
      white = 0
      worse = clean
      last = 0
      do r = 1, records
         do i = 1, size(clean)
            worse(i) = noisy(clean(i), noise(last + 1:last + size(clean(i)%samples)))
            last = last + size(clean(i)%samples)
         end do
         call identify(model, mesh, [stage], worse, fits, error)
         if (allocated(error)) then
            failed = failed + 1
            print '(a,i0,2a)', '      record ', r, ': ', error%message
            cycle
         end if
         associate (s => fits(1)%statistics, q => fits(1)%quantities%value)
            where (abs(q - true_values) <= s%half_width) inside = inside + 1
            spread_of = spread_of + (q - true_values)**2/records
            stated = stated + s%std_error**2/records
            variance = variance + s%variance/records
            if (fits(1)%check%white) white = white + 1
         end associate
      end do
      call check(what//': all searches converge', failed == 0, to_text(failed)//' failed')
      ! Three deviations of a binomial law, sqrt(.95 .05/400) = 1.1 %.
      band = 3*sqrt(0.95_wp*0.05_wp/records)
      do k = 1, size(inside)
         call check_close(what//': rate of coverage of '//trim(fits(1)%quantities(k)%name), &
            real(inside(k), wp)/records, 0.95_wp, band)
         ! A deviation of 400 values is known to 3.5 %: four of these, and curvature.
         call check_close(what//': deviation of '//trim(fits(1)%quantities(k)%name)// &
            ' over the one stated', sqrt(spread_of(k)/stated(k)), &
            1.0_wp, 4/sqrt(2.0_wp*records) + 0.01_wp)
      end do
      ! The mean of 400 variances with nu degrees of freedom: sqrt(2/nu/400), four of these.
      call check_close(what//': variance over the true one', variance/sd**2, 1.0_wp, &
         4*sqrt(2.0_wp/(m - size(inside))/records))
      ! The fit takes from the noise what looks like its modes: some four cosines for each mode and
      ! a constant, which leaves correlations of (4 cos + 4 cos + 1)/m at every lag and adds two to
      ! a sum of 20 lags on the average. Of 4000 records 90 % were found white.
      call check_close(what//': records found white', real(white, wp)/records, 0.90_wp, 0.05_wp)
   end subroutine count_inside

end program test_free_coverage
