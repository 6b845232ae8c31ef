!> The tables frf.csv and modal_fit.csv, and the summary of the command `frf`.
module beamid_response_reports
   use beamid_case_files, only: case_t
   use beamid_experiments, only: experiment_t
   use beamid_frequency_responses, only: frequency_response_t, quantities
   use beamid_frequency_runs, only: band_of_magnitude, case_response_t
   use beamid_identification, only: stage_fit_t
   use beamid_kinds, only: pi, wp
   use beamid_lines, only: csv_row
   use beamid_modal_tables, only: modal_table_t
   use beamid_mode_summaries, only: add_refinement_warning
   use beamid_outputs, only: output_t
   use beamid_statistics, only: unlimited
   use beamid_strings, only: full, rounded, to_text
   use beamid_tables, only: labels_table
   use beamid_texts, only: right, text_t
   implicit none
   private

   public :: add_fitted_responses, add_measured_modes, report_responses

   character(len=*), parameter :: header = 'elements,frequency_hz,real,imag,magnitude,phase_deg', &
      band_header = ',magnitude_lower95,magnitude_upper95'

contains

   !> Reports the frequency response of a case: frf.csv on every mesh.
   subroutine report_responses(case, found, output, summary)
      type(case_t), intent(in) :: case
      type(case_response_t), intent(in) :: found
      type(output_t), intent(inout) :: output
      character(len=:), allocatable, intent(out) :: summary
      type(text_t) :: table, text
      character(len=:), allocatable :: line
      integer :: j, k, peak

      line = header
      if (found%is_fitted) line = line//band_header
      call table%line(line)
      do k = 1, size(case%meshes)
         do j = 1, size(found%frequency)
            line = response_row(case%meshes(k)%elements, found%frequency(j), found%h(j, k))
            if (found%is_fitted) line = line//ends([found%band(j, :, k)])
            call table%line(line)
         end do
      end do
      call output%add('frf.csv', table%content())
      call output%add('labels.csv', labels_table(case%units))
      call add_refinement_warning(text, found%remaining)
      line = case%name//': '//trim(quantities(found%power))//' at '// &
         to_text(size(found%frequency))//' frequencies, '//to_text(found%frequency(1))//' to '// &
         to_text(found%frequency(size(found%frequency)))
      if (found%is_fitted) line = line//', of the fitted structure with its 95 % band'
      call text%line(line)
      call text%line()
      call text%line('elements   peak at      magnitude')
      do k = 1, size(case%meshes)
         peak = maxloc(abs(found%h(:, k)), dim=1)
         call text%line(right(to_text(case%meshes(k)%elements), 8)//right(rounded( &
            found%frequency(peak), 5), 11)//right(rounded(abs(found%h(peak, k)), 5), 15))
      end do
      summary = text%content()
   end subroutine report_responses

   !> Adds frf.csv to the tables of a fit: measured and fitted frequency responses. The residual is
   !> measured - model. There is no such table without frequency responses, and no column `sd` or
   !> `coherence` without a value, so that the table can be read back. `sd` does not allow for the
   !> correlation of lines by a window, which a fit to the table adds again.
   !>
   !> fits  (meshes) of the last stage
   subroutine add_fitted_responses(output, fits, experiments)
      type(output_t), intent(inout) :: output
      type(stage_fit_t), intent(in) :: fits(:)
      type(experiment_t), intent(in) :: experiments(:)
      type(text_t) :: table
      integer :: i, mesh, row
      logical :: any_response, has_coherence, has_sd

      any_response = .false.
      has_sd = .false.
      has_coherence = .false.
      do i = 1, size(experiments)
         if (.not. allocated(experiments(i)%observed)) cycle
         select type (observed => experiments(i)%observed)
         type is (frequency_response_t)
            has_sd = has_sd .or. observed%noise_is_known
            has_coherence = has_coherence .or. allocated(observed%coherence)
         end select
      end do
      call table%line(header//',measured_real,measured_imag,residual_real,residual_imag'// &
         band_header//',record'//trim(merge(',sd', '   ', has_sd))// &
         trim(merge(',coherence', '          ', has_coherence)))
      do mesh = 1, size(fits)
         row = 0
         do i = 1, size(experiments)
            associate (m => size(experiments(i)%measured))
               if (allocated(experiments(i)%observed)) then
                  select type (observed => experiments(i)%observed)
                  type is (frequency_response_t)
                     any_response = .true.
                     call add_rows(table, observed, i, fits(mesh), row, has_sd, &
                        has_coherence)
                  end select
               end if
               row = row + m
            end associate
         end do
      end do
      if (any_response) call output%add('frf.csv', table%content())
   end subroutine add_fitted_responses

   !> Adds the rows of one measured response.
   !>
   !> record                 number of its record
   !> first                  number of residuals before its own
   !> has_sd, has_coherence  whether the table has these columns
   subroutine add_rows(table, observed, record, fit, first, has_sd, has_coherence)
      type(text_t), intent(inout) :: table
      type(frequency_response_t), intent(in) :: observed
      integer, intent(in) :: record, first
      type(stage_fit_t), intent(in) :: fit
      logical, intent(in) :: has_sd, has_coherence
      complex(wp) :: residual(size(observed%h)), slopes(size(observed%h), size(fit%free))
      real(wp) :: band(size(observed%h), 2)
      character(len=:), allocatable :: line
      integer :: j, k, n

      n = size(observed%h)
      residual = -observed%lines_of(fit%residual(first + 1:first + 2*n))
      do k = 1, size(fit%free)
         slopes(:, k) = observed%lines_of(fit%jacobian(first + 1:first + 2*n, k)) &
            /fit%weight(record)
      end do
      band = band_of_magnitude(fit, observed%h - residual, slopes)
      do j = 1, n
         line = response_row(fit%elements, observed%frequency(j), observed%h(j) - residual(j))
         line = line//csv_row('', [real(observed%h(j)), aimag(observed%h(j)), real(residual(j)), &
            aimag(residual(j))])//ends([band(j, :)])//','//to_text(record)
         if (has_sd) line = line//','
         if (observed%noise_is_known) line = line//full(observed%noise(j) &
            /observed%correlation)
         if (has_coherence) line = line//','
         if (allocated(observed%coherence)) line = line//full(observed%coherence(j))
         call table%line(line)
      end do
   end subroutine add_rows

   !> Adds modal_fit.csv to the tables of a fit: measured and fitted modes. The residual is
   !> measured - model. There is no such table without tables of modes.
   !>
   !> fits  (meshes) of the last stage
   subroutine add_measured_modes(output, fits, experiments)
      type(output_t), intent(inout) :: output
      type(stage_fit_t), intent(in) :: fits(:)
      type(experiment_t), intent(in) :: experiments(:)
      type(text_t) :: table
      integer :: i, mesh, row
      logical :: any_mode

      any_mode = .false.
      call table%line('elements,record,mode,measured_hz,sd_hz,model_hz,residual_hz,'// &
         'measured_damping,sd_damping,model_damping,residual_damping')
      do mesh = 1, size(fits)
         row = 0
         do i = 1, size(experiments)
            if (allocated(experiments(i)%observed)) then
               select type (observed => experiments(i)%observed)
               type is (modal_table_t)
                  any_mode = .true.
                  call add_mode_rows(table, observed, i, fits(mesh), row)
               end select
            end if
            row = row + size(experiments(i)%measured)
         end do
      end do
      if (any_mode) call output%add('modal_fit.csv', table%content())
   end subroutine add_measured_modes

   !> Adds the rows of one table of modes; arguments as of `add_rows`.
   subroutine add_mode_rows(table, observed, record, fit, first)
      type(text_t), intent(inout) :: table
      type(modal_table_t), intent(in) :: observed
      integer, intent(in) :: record, first
      type(stage_fit_t), intent(in) :: fit
      character(len=:), allocatable :: line
      real(wp) :: residual
      integer :: j, n

      n = size(observed%mode)
      do j = 1, n
         residual = -fit%residual(first + j)*observed%sd_frequency(j)
         line = to_text(fit%elements)//','//to_text(record)//','//to_text(observed%mode(j))// &
            csv_row('', [observed%frequency(j), observed%sd_frequency(j), &
            observed%frequency(j) - residual, residual])
         if (allocated(observed%damping)) then
            residual = -fit%residual(first + n + j)*observed%sd_damping(j)
            line = line//csv_row('', [observed%damping(j), observed%sd_damping(j), &
               observed%damping(j) - residual, residual])
         else
            line = line//',,,,'
         end if
         call table%line(line)
      end do
   end subroutine add_mode_rows

   !> Returns the fields of one line of a response: elements, frequency, real and imaginary part,
   !> magnitude and phase.
   function response_row(elements, frequency, h) result(line)
      integer, intent(in) :: elements
      real(wp), intent(in) :: frequency
      complex(wp), intent(in) :: h
      character(len=:), allocatable :: line
      real(wp), parameter :: degree = pi/180

      line = csv_row(to_text(elements), [frequency, real(h), aimag(h), abs(h), &
         atan2(aimag(h), real(h))/degree])
   end function response_row

   !> Returns the ends of a band as two fields, with a comma before each; empty if not determined.
   function ends(band) result(fields)
      real(wp), intent(in) :: band(2)
      character(len=:), allocatable :: fields

      fields = ',,'
      if (band(2) < unlimited) fields = csv_row('', band)
   end function ends

end module beamid_response_reports
