!> The verdict on a fit: the beginning of the summary, and the tables quality.csv and
!> modes_seen.csv.
module beamid_verdict_reports
   use beamid_case_files, only: case_t
   use beamid_error_sources, only: add_assumptions, add_far_values, add_prior_conflicts
   use beamid_identification, only: stage_fit_t
   use beamid_kinds, only: wp
   use beamid_lines, only: csv_row, filled, unit_suffix
   use beamid_outputs, only: output_t
   use beamid_qualities, only: quality_t
   use beamid_strings, only: full, to_text
   use beamid_structure, only: is_coefficient
   use beamid_texts, only: text_t
   use beamid_verdicts, only: verdict_t
   implicit none
   private

   public :: verdict_summary, add_verdict_tables, determination

   !> A correlation beyond `too_close` is worth a sentence. A fit that explains less than
   !> `good_percent` of a record, with residuals that are not white, is a poor fit.
   real(wp), parameter :: too_close = 0.999_wp, good_percent = 90
   !> Ratio of variances from which residuals that exceed a known noise are worth a sentence: noise
   !> that was estimated from averages is itself uncertain by some per cent.
   real(wp), parameter :: clear_excess = 1.2_wp

contains

   !> Returns the beginning of the summary: that there is no fit, or which parameter is held fixed;
   !> the share of each record that the fit explains; the modes that are seen in the records.
   function verdict_summary(case, fit, verdict) result(content)
      type(case_t), intent(in) :: case
      type(stage_fit_t), intent(in) :: fit
      type(verdict_t), intent(in) :: verdict
      character(len=:), allocatable :: content, line
      type(text_t) :: text

      if (verdict%no_fit /= '') call text%line('no fit: '//verdict%no_fit)
      if (verdict%starts_again) call text%line('the fit from the values of the case was '// &
         'rejected; this fit starts from the spectral lines of the records')
      if (fit%note /= '') call text%line(fit%note)
      call add_prior_conflicts(text, fit)
      if (all(fit%scenario%excitations%modes > 0) .or. any(verdict%qualities%kind /= 'time')) &
         call add_far_values(text, case%model%structure, fit)
      call add_assumptions(text, case%units, fit)
      if (verdict%no_fit == '' .and. verdict%caution /= '') call text%line( &
         'no parameter counts as determined: '//verdict%caution)
      if (verdict%no_fit == '' .and. verdict%departures /= '') then
         line = ''
         if (.not. all(fit%scenario%excitations%modes > 0)) line = &
            ', the excitation may differ from that of the case, or the structure may have '// &
            'something that the case lacks, such as a mass'
         call text%line('the residuals exceed the noise around '//verdict%departures// &
            ': damping or stiffness may depend on the amplitude'//line)
      end if
      if (verdict%no_fit == '' .and. verdict%missed /= '') call text%line('the residuals '// &
         'exceed the noise around '//verdict%missed//': the record has another frequency or '// &
         'decay rate there than the model, so that a fixed value may be wrong')
      if (fit%statistics%is_exceeded .and. fit%statistics%variance > clear_excess) &
         call text%line('the residuals are larger than the stated noise explains, so '// &
         'the intervals are widened by a factor of '// &
         to_text(sqrt(fit%statistics%variance)))
      call add_qualities(text, unit_suffix(case%units%acceleration()), verdict)
      call add_sightings(text, verdict)
      if (fit%other /= '') call text%line(fit%other)
      content = text%content()
   end function verdict_summary

   !> Adds the share of each record that the fit explains.
   !>
   !> unit  of accelerations
   subroutine add_qualities(text, unit, verdict)
      type(text_t), intent(inout) :: text
      character(len=*), intent(in) :: unit
      type(verdict_t), intent(in) :: verdict
      character(len=:), allocatable :: line
      integer :: k

      do k = 1, size(verdict%qualities)
         associate (q => verdict%qualities(k))
            line = unit
            if (q%kind /= 'time') line = ''
            call text%line('record '//to_text(k)//': '//counted(q)//', signal '// &
               to_text(q%rms_signal)//' rms, residual '//to_text(q%rms_residual)//' rms'//line// &
               filled(': fit #.2 %', [q%fit_percent]))
            if (q%is_exact) call text%line('record '//to_text(k)//' has no noise: its '// &
               'residuals are errors of computation')
         end associate
      end do
   end subroutine add_qualities

   !> Adds the modes that are seen in the records, and the spectral lines of no mode.
   subroutine add_sightings(text, verdict)
      type(text_t), intent(inout) :: text
      type(verdict_t), intent(in) :: verdict
      character(len=:), allocatable :: line
      integer :: k

      do k = 1, size(verdict%sightings)
         associate (s => verdict%sightings(k))
            line = '  mode '//to_text(s%mode)
            if (s%mode == 0) line = '  spectral line, no mode'
            if (size(verdict%qualities) > 1) line = line//' in record '//to_text(s%record)
            line = line//': '
            if (s%mode > 0) line = line//filled('model #.4, ', [s%model])
            if (s%peak > 0) line = line//filled('peak #.4, ', [s%peak])
            if (.not. s%peak > 0) line = line//'no peak, '
            line = line//to_text(100*s%share)//' % of the energy: '//trim(s%verdict)
            if (s%mode == 0 .and. s%verdict /= 'unexplained') line = line// &
               ', unless it is a mode'
            call text%line(line)
         end associate
      end do
   end subroutine add_sightings

   !> Returns the number of samples, lines or modes of a record, with the noun.
   function counted(quality) result(text)
      type(quality_t), intent(in) :: quality
      character(len=:), allocatable :: text

      select case (quality%kind)
      case ('frf'); text = ' line'
      case ('modes'); text = ' mode'
      case default; text = ' sample'
      end select
      if (quality%samples /= 1 .or. quality%kind == 'time') text = text//'s'
      text = to_text(quality%samples)//text
   end function counted

   !> Adds quality.csv and modes_seen.csv.
   subroutine add_verdict_tables(output, verdict)
      type(output_t), intent(inout) :: output
      type(verdict_t), intent(in) :: verdict
      type(text_t) :: quality, seen
      character(len=:), allocatable :: peak
      integer :: k

      call quality%line('record,samples,rms_signal,rms_residual,fit_percent,noise_sd,'// &
         'effective_samples,kind')
      do k = 1, size(verdict%qualities)
         associate (q => verdict%qualities(k))
            call quality%line(csv_row(to_text(k)//','//to_text(q%samples), [q%rms_signal, &
               q%rms_residual, q%fit_percent, q%noise_sd, q%effective])//','//trim(q%kind))
         end associate
      end do
      call seen%line('record,mode,model_hz,peak_hz,energy_share,verdict')
      do k = 1, size(verdict%sightings)
         associate (s => verdict%sightings(k))
            peak = ''
            if (s%peak > 0) peak = full(s%peak)
            call seen%line(csv_row(to_text(s%record)//','//to_text(s%mode), [s%model])//','// &
               peak//','//full(s%share)//','//trim(s%verdict))
         end associate
      end do
      call output%add('quality.csv', quality%content())
      call output%add('modes_seen.csv', seen%content())
   end subroutine add_verdict_tables

   !> Returns a sentence on how well the record determines all parameters together; '' if none
   !> holds.
   function determination(fit, verdict) result(line)
      type(stage_fit_t), intent(in) :: fit
      type(verdict_t), intent(in) :: verdict
      character(len=:), allocatable :: line
      integer :: j, k, n

      n = size(fit%free)
      line = ''
      if (verdict%no_fit /= '' .or. verdict%caution /= '') return
      if (allocated(fit%reach)) then
         if (.not. all(fit%statistics%determined(:n))) return
      end if
      do j = 1, n
         do k = j + 1, n
            ! Correlated coefficients of a field are no problem, as its smoothing determines them.
            if (is_coefficient(fit%free(j)) .and. is_coefficient(fit%free(k))) cycle
            if (abs(fit%statistics%correlation(j, k)) > too_close) line = 'the errors of '// &
               trim(fit%quantities(j)%name)//' and '//trim(fit%quantities(k)%name)// &
               ' go together: their correlation is '//to_text(fit%correlation(j, k))
         end do
      end do
      if (line /= '') return
      if (any(fit%statistics%corrected_half_width(:n) > abs(fit%quantities(:n)%searched))) return
      if (.not. fit%check%white .and. any(verdict%qualities%fit_percent < good_percent)) then
         line = 'every interval is narrow, but the model explains less than '// &
            to_text(nint(good_percent))//' % of a record: do not rely on the intervals'
      else if (any(is_coefficient(fit%free))) then
         line = 'every parameter is determined by this record; a property that varies along '// &
            'the beam is determined under the assumption that it is smooth'
      else
         line = 'every parameter is determined by this record'
      end if
   end function determination

end module beamid_verdict_reports
