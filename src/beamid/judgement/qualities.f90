!> Judges how well a fit explains each of its records, and whether that is enough.
module beamid_qualities
   use beamid_experiments, only: experiment_t
   use beamid_kinds, only: wp
   use beamid_spectra, only: noise_floor
   use beamid_stage_fits, only: stage_fit_t
   use beamid_strings, only: to_text
   use beamid_whiteness, only: effective_samples
   implicit none
   private

   public :: quality_t, quality_of, quality_of_lines, describe_misfit

   !> How well a fit explains one record.
   type :: quality_t
      integer :: samples = 0          !< number of samples, lines or modes
      character(len=5) :: kind = 'time'   !< kind of the record, as in the case file
      real(wp) :: rms_signal = 0      !< rms of the record about its mean [length/time**2]
      real(wp) :: rms_residual = 0    !< rms of the residuals [length/time**2]
      real(wp) :: fit_percent = 0     !< 100 (1 - rms_residual/rms_signal)
      real(wp) :: noise_sd = 0        !< noise level, corrected for the degrees of freedom
      real(wp) :: effective = 0       !< effective number of samples, < samples if not white
      !> by how much the fit reduces the sum of squares of the effective samples about their mean,
      !> in variances of the residuals
      real(wp) :: gain = 0
      !> white noise that the spectrum of the residuals shows between the motions; equal to
      !> `rms_residual` if the residuals are white or the samples are few
      real(wp) :: floor = 0
      !> root-mean-square of the residuals without spectral lines that are multiples of the first
      !> mode's frequency or of the mains
      real(wp) :: rms_rest = 0
      !> whether the record has no noise, and its residuals are errors of computation
      logical :: is_exact = .false.
   end type quality_t

   !> A fit that explains less of a record, in percent, is rejected if its residuals are not white.
   real(wp), parameter :: least_percent = 50

contains

   !> Returns how well a fit explains one record.
   !>
   !> experiment  the record
   !> residual    (m) its residuals [length/time**2]
   !> rest        (m) the residuals without lines that have a name
   function quality_of(experiment, residual, rest, fit) result(quality)
      type(experiment_t), intent(in) :: experiment
      real(wp), intent(in) :: residual(:), rest(:)
      type(stage_fit_t), intent(in) :: fit
      type(quality_t) :: quality
      !> Smallest number of samples whose spectrum shows a level of noise.
      integer, parameter :: enough = 200
      !> Share of the signal below which white noise is round-off: a converter of 24 bits has more.
      !> Share of it that errors of computation may reach.
      real(wp), parameter :: round_off = 1e-7_wp, computation = 1e-4_wp
      integer :: m

      m = size(residual)
      quality%samples = m
      associate (measured => experiment%measured)
         quality%rms_signal = sqrt(sum((measured - sum(measured)/m)**2)/m)
      end associate
      quality%rms_residual = sqrt(sum(residual**2)/m)
      if (quality%rms_signal > 0) quality%fit_percent = 100*(1 - quality%rms_residual &
         /quality%rms_signal)
      quality%noise_sd = quality%rms_residual
      associate (statistics => fit%statistics)
         if (statistics%freedom > 0) quality%noise_sd = quality%rms_residual &
            *sqrt(max(1.0_wp, statistics%samples/real(statistics%freedom, wp)))
      end associate
      quality%effective = effective_samples(residual)
      quality%gain = quality%effective*(quality%rms_signal**2 - quality%rms_residual**2) &
         /max(quality%rms_residual**2, tiny(1.0_wp))
      quality%rms_rest = sqrt(sum(rest**2)/m)
      quality%floor = quality%rms_residual
      if (m >= enough .and. .not. fit%check%white) quality%floor = min(quality%floor, &
         noise_floor(experiment%samples, residual))
      quality%is_exact = quality%floor <= round_off*quality%rms_signal .and. &
         quality%rms_residual <= computation*quality%rms_signal
   end function quality_of

   !> Returns how well a fit explains a record that is not a function of time. Each root mean square
   !> is weighted by 1/noise**2, so that lines without information do not count.
   !>
   !> residual  (m) its residuals [unit of the rows]
   function quality_of_lines(experiment, residual) result(quality)
      type(experiment_t), intent(in) :: experiment
      real(wp), intent(in) :: residual(:)
      type(quality_t) :: quality
      real(wp) :: total_weight
      integer :: m

      associate (observed => experiment%observed)
         quality%kind = observed%kind()
         m = size(observed%plain(experiment%measured))
         quality%samples = m
         if (quality%kind == 'frf') quality%samples = m/2   ! a line has two rows
         ! `plain` multiplies each row by its noise, so that rows of 1 become the noise.
         total_weight = norm2(1/observed%plain(spread(1.0_wp, 1, size(residual))))
         quality%rms_signal = norm2(experiment%measured(:m))/total_weight
         quality%rms_residual = norm2(residual(:m))/total_weight
         quality%effective = m
         if (quality%rms_signal > 0) quality%fit_percent = 100*(1 - quality%rms_residual &
            /quality%rms_signal)
         quality%noise_sd = quality%rms_residual
         quality%rms_rest = quality%rms_residual
         quality%floor = quality%rms_residual
         if (observed%noise_is_known) quality%floor = quality%rms_residual &
            /max(1.0_wp, norm2(residual)/sqrt(real(size(residual), wp)))
      end associate
   end function quality_of_lines

   !> Describes the record that the fit explains least, if that is too little; '' otherwise. Too
   !> little is less than `least_percent` if the residuals are not white. If they are, the record
   !> may be nothing but noise: 0 % is enough, but the residuals may not be larger than the record.
   !> If all records are functions of time, with 50 samples or more, the fit must reduce the sum of
   !> squares of all together by more than noise would allow.
   subroutine describe_misfit(qualities, fit, text)
      type(quality_t), intent(in) :: qualities(:)
      type(stage_fit_t), intent(in) :: fit
      character(len=:), allocatable, intent(out) :: text
      !> How far the sum of squares of white residuals may exceed that of a record of noise, in
      !> variances of the noise: the right motion and a constant, added to noise, change the sum by
      !> at most a chi-squared variable of two degrees of freedom. Its quantile of 1 - 5e-5.
      real(wp), parameter :: chance = 20
      !> With fewer samples, the residuals do not tell the noise.
      integer, parameter :: enough = 50
      real(wp) :: excess(size(qualities))
      integer :: r

      text = ''
      r = minloc(qualities%fit_percent, dim=1)
      excess = qualities%rms_residual**2 - qualities%rms_signal**2*(1 + chance/qualities%samples)
      if (.not. fit%check%white .and. qualities(r)%fit_percent < least_percent) then
         text = 'the model explains '//to_text(nint(qualities(r)%fit_percent))//' % of record '// &
            to_text(r)//', and the residuals are not noise'
      else if (any(excess > 0)) then
         text = 'the residuals are larger than record '//to_text(findloc(excess > 0, .true., dim=1))
      else if (all(qualities%kind == 'time') .and. sum(qualities%samples) >= enough .and. &
         sum(qualities%gain) < gain_from_noise(sum(qualities%samples), size(fit%free))) then
         text = 'no record shows the motion of the model above its noise'
      else
         return
      end if
      text = text//': check the start values, the units, and the parameters that are free'
   end subroutine describe_misfit

   !> Returns the largest reduction of the sum of squares, in variances of the noise, that a fit
   !> finds in records of white noise with a probability of 0.999. A fit to noise reduces the sum by
   !> a chi-squared variable, and it may choose among as many frequencies as there are samples. The
   !> quantile is bounded by Laurent and Massart, Ann. Statist. 28, 2000, 1302, Lemma 1.
   !>
   !> samples     number of samples
   !> parameters  number of free parameters
   pure real(wp) function gain_from_noise(samples, parameters)
      integer, intent(in) :: samples, parameters
      real(wp), parameter :: probability = 1e-3_wp
      real(wp) :: x

      x = log(samples/probability)
      gain_from_noise = parameters + 2*sqrt(parameters*x) + 2*x
   end function gain_from_noise

end module beamid_qualities
