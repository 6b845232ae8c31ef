!> Judges how well a fit explains each of its records, and whether that is enough.
module beamid_qualities
   use beamid_distributions, only: chi_square_tail
   use beamid_experiments, only: experiment_t
   use beamid_kinds, only: wp
   use beamid_spectra, only: noise_floor
   use beamid_stage_fits, only: stage_fit_t
   use beamid_strings, only: to_text
   use beamid_whiteness, only: effective_samples
   implicit none
   private

   public :: quality_t, quality_of, quality_of_lines, describe_misfit, describe_silence

   !> How well a fit explains one record.
   type :: quality_t
      integer :: samples = 0          !< number of samples, lines or modes
      character(len=5) :: kind = 'time'   !< kind of the record, as in the case file
      real(wp) :: rms_signal = 0      !< rms of the record about its mean [length/time**2]
      real(wp) :: mean = 0            !< of the record [length/time**2]
      real(wp) :: rms_residual = 0    !< rms of the residuals [length/time**2]
      real(wp) :: fit_percent = 0     !< 100 (1 - rms_residual/rms_signal)
      real(wp) :: noise_sd = 0        !< noise level, corrected for the degrees of freedom
      real(wp) :: effective = 0       !< effective number of samples, < samples if not white
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
         quality%mean = sum(measured)/m
         quality%rms_signal = sqrt(sum((measured - quality%mean)**2)/m)
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
   subroutine describe_misfit(qualities, fit, text)
      type(quality_t), intent(in) :: qualities(:)
      type(stage_fit_t), intent(in) :: fit
      character(len=:), allocatable, intent(out) :: text
      !> How far the sum of squares of white residuals may exceed that of a record of noise, in
      !> variances of the noise: the right motion and a constant, added to noise, change the sum by
      !> at most a chi-squared variable of two degrees of freedom. Its quantile of 1 - 5e-5.
      real(wp), parameter :: chance = 20
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
      else
         return
      end if
      text = text//': check the start values, the units, and the parameters that are free'
   end subroutine describe_misfit

   !> Says that the records may be nothing but noise; '' otherwise. A fit to white noise reduces the
   !> sum of squares by a chi-squared variable, in variances of the noise, and it may choose among
   !> as many frequencies as there are samples. Only time records are judged, with white residuals,
   !> and with enough samples to tell the noise.
   !>
   !> means  whether the fit has estimated the means of the records
   subroutine describe_silence(qualities, fit, means, text)
      type(quality_t), intent(in) :: qualities(:)
      type(stage_fit_t), intent(in) :: fit
      logical, intent(in) :: means
      character(len=:), allocatable, intent(out) :: text
      !> Fewest samples, and probability with which noise alone reaches the gain.
      integer, parameter :: enough = 50
      real(wp), parameter :: rare = 1e-3_wp
      real(wp) :: gain, samples

      text = ''
      samples = real(sum(qualities%samples), wp)
      if (.not. fit%check%white .or. .not. all(qualities%kind == 'time') .or. &
         samples < enough .or. any(qualities%fit_percent >= least_percent)) return
      associate (signal => qualities%rms_signal**2 + merge(0.0_wp, qualities%mean**2, means))
         gain = sum(qualities%samples*(signal/max(qualities%rms_residual**2, tiny(1.0_wp)) - 1))
      end associate
      if (samples*chi_square_tail(gain, real(size(fit%quantities), wp)) < rare) return
      text = 'no record shows the motion of the model above its noise: check value_column, and '// &
         'the kind and size of the excitation'
   end subroutine describe_silence

end module beamid_qualities
