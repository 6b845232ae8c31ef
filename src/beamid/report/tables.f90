!> Tables of fits, modes, responses and records for other programs: comma-separated fields, one
!> header line, numbers to full precision.
module beamid_tables
   use beamid_experiments, only: experiment_t
   use beamid_fit_curves, only: fit_header, new_fit_curves
   use beamid_fitted_modes, only: fitted_mode_t
   use beamid_identification, only: simulation_t, stage_fit_t
   use beamid_kinds, only: two_pi, wp
   use beamid_lines, only: csv_row, limit
   use beamid_multistart, only: minimum_t
   use beamid_number_tables, only: add_number_table, number_table_t
   use beamid_outputs, only: output_t
   use beamid_row_tables, only: row_table_t
   use beamid_statistics, only: unlimited
   use beamid_strings, only: full, to_text
   use beamid_texts, only: text_t
   use beamid_units, only: units_t
   implicit none
   private

   public :: add_fit_tables, add_fitted_modes, add_minima, add_modes
   public :: add_record_table, add_response_table, labels_table

   !> Headers of modes.csv (of `modes` and of fits) and minima.csv.
   character(len=*), parameter, public :: &
      modes_header = 'elements,mode,frequency_hz,damping_ratio,real,imag', &
      fitted_modes_header = modes_header//',record,'// &
      'frequency_lower95,frequency_upper95,damping_lower95,damping_upper95', &
      minima_header = 'elements,minimum,count,J,parameter,estimate'

contains

   !> Adds estimates.csv, fit.csv, correlations.csv, autocorrelation.csv and labels.csv.
   !>
   !> fits  (stages, meshes)
   subroutine add_fit_tables(output, units, fits, experiments)
      type(output_t), intent(inout) :: output
      type(units_t), intent(in) :: units
      type(stage_fit_t), intent(in) :: fits(:, :)
      type(experiment_t), intent(in) :: experiments(:)
      type(text_t) :: estimates, correlations, autocorrelation
      class(row_table_t), allocatable :: curves
      integer :: j, k, mesh, stage

      call estimates%line('stage,elements,parameter,unit,start,estimate,std_error,lower95,'// &
         'upper95,determined,std_error_corrected,lower95_corrected,upper95_corrected,'// &
         'mesh_shift,from_held,total_lower95,total_upper95')
      call correlations%line('stage,elements,parameter,other,correlation')
      call autocorrelation%line('elements,lag,autocorrelation,band95')
      do mesh = 1, size(fits, 2)
         do stage = 1, size(fits, 1)
            call add_estimates(estimates, fits(stage, mesh), units)
            associate (fit => fits(stage, mesh), names => fits(stage, mesh)%quantities%name)
               if (fit%statistics%samples == 0) cycle
               do j = 1, size(names)
                  do k = 1, size(names)
                     call correlations%line(csv_row(to_text(fit%stage)//','// &
                        to_text(fit%elements)//','//trim(names(j))//','//trim(names(k)), &
                        [fit%correlation(j, k)]))
                  end do
               end do
            end associate
         end do
         associate (fit => fits(size(fits, 1), mesh))
            do k = 1, size(fit%check%autocorrelation)
               call autocorrelation%line(csv_row(to_text(fit%elements)//','//to_text(k), &
                  [fit%check%autocorrelation(k), fit%check%band]))
            end do
         end associate
      end do
      call output%add('estimates.csv', estimates%content())
      call new_fit_curves(fits(size(fits, 1), :), experiments, curves)
      call output%add_table('fit.csv', fit_header//new_line('a'), curves)
      call output%add('correlations.csv', correlations%content())
      call output%add('autocorrelation.csv', autocorrelation%content())
      call output%add('labels.csv', labels_table(units))
   end subroutine add_fit_tables

   !> Adds a row of estimates.csv for each free parameter, and a row for J.
   subroutine add_estimates(text, fit, units)
      type(text_t), intent(inout) :: text
      type(stage_fit_t), intent(in) :: fit
      type(units_t), intent(in) :: units
      character(len=:), allocatable :: first, errors, unit
      integer :: k

      first = to_text(fit%stage)//','//to_text(fit%elements)//','
      do k = 1, size(fit%quantities)
         errors = repeat(',', 11)
         associate (q => fit%quantities(k), s => fit%statistics)
            if (s%samples > 0) errors = ','//interval(fit, k, s%std_error(k), s%half_width(k))// &
               ','//trim(merge('yes', 'no ', s%determined(k)))//','//interval(fit, k, &
               s%corrected_error(k), s%corrected_half_width(k))//error_sources(fit, k)
            call text%line(first//trim(q%name)//','//units%of_quantity(q%parameter, &
               fit%scenario%excitations(1))//','//limit(q%start)//','//limit(q%value)//errors)
         end associate
      end do
      unit = units%sum_of_squares()
      if (fit%weighted) unit = ''
      call text%line(first//'J,'//unit//',,'//full(fit%fit%J)//repeat(',', 11))
      if (fit%score >= 0) call text%line(first//'J_score,'//units%sum_of_squares()//',,'// &
         full(fit%score)//repeat(',', 11))
   end subroutine add_estimates

   !> Returns standard error and interval as three fields; the interval lies within the bounds of
   !> the search. The fields are empty if the parameter is not determined.
   function interval(fit, k, std_error, half_width) result(fields)
      type(stage_fit_t), intent(in) :: fit
      integer, intent(in) :: k
      real(wp), intent(in) :: std_error, half_width
      character(len=:), allocatable :: fields
      real(wp) :: ends(3)

      associate (q => fit%quantities(k))
         fields = ',,'
         if (.not. (std_error < unlimited .and. half_width < unlimited)) return
         if (fit%statistics%is_withdrawn(k)) return
         ends = q%limits(std_error, half_width)
         fields = ''
         if (abs(ends(1)) <= unlimited) fields = full(ends(1))
         fields = fields//','//limit(ends(2))//','//limit(ends(3))
      end associate
   end function interval

   !> Returns, as four fields, the shift of an estimate by the mesh, its error from fixed
   !> parameters, and the interval with every source of error.
   function error_sources(fit, k) result(fields)
      type(stage_fit_t), intent(in) :: fit
      integer, intent(in) :: k
      character(len=:), allocatable :: fields
      real(wp) :: shift, from_fixed(3), ends(2)
      fields = ','
      associate (q => fit%quantities(k))
         if (allocated(fit%mesh_shift) .and. k <= size(fit%free)) then
            shift = q%moved(fit%mesh_shift(k))
            if (abs(shift) <= unlimited) fields = ','//full(shift)
         end if
         if (.not. fit%half_width(k) < unlimited) then
            fields = fields//',,,'
            return
         end if
         from_fixed = q%limits(fit%from_held(k), 0.0_wp)
         fields = fields//','
         if (from_fixed(1) <= unlimited) fields = fields//full(from_fixed(1))
         ends = q%ends(fit%total(k))
         fields = fields//','//limit(ends(1))//','//limit(ends(2))
      end associate
   end function error_sources

   !> Adds response.csv.
   !>
   !> elements, simulations  (meshes)
   subroutine add_response_table(output, elements, simulations)
      type(output_t), intent(inout) :: output
      integer, intent(in) :: elements(:)
      type(simulation_t), intent(in) :: simulations(:)
      type(number_table_t), allocatable :: table
      integer :: j, k

      allocate (table)
      do j = 1, size(simulations)
         associate (s => simulations(j), r => simulations(j)%response)
            call table%append(spread([elements(j)], 2, size(r%t)), reshape([(r%t(k), s%force(k), &
               r%displacement(k), r%velocity(k), s%acceleration(k), k=1, size(r%t))], &
               [5, size(r%t)]))
         end associate
      end do
      call add_number_table(output, 'response.csv', &
         'elements,t,force,displacement,velocity,acceleration', table)
   end subroutine add_response_table

   !> Adds rows of modes.csv: frequency_hz is |s|/(2 pi), damping_ratio is -Re(s)/|s|.
   !>
   !> elements  of the mesh
   !> roots     [1/time]
   subroutine add_modes(text, elements, roots)
      type(text_t), intent(inout) :: text
      integer, intent(in) :: elements
      complex(wp), intent(in) :: roots(:)
      real(wp) :: ratio
      integer :: k

      do k = 1, size(roots)
         ratio = 0
         if (abs(roots(k)) > 0) ratio = -real(roots(k))/abs(roots(k))
         call text%line(csv_row(to_text(elements)//','//to_text(k), [abs(roots(k))/two_pi, &
            ratio + 0.0_wp, real(roots(k)), aimag(roots(k))]))
      end do
   end subroutine add_modes

   !> Adds rows of modes.csv for a fitted structure, with 95 % intervals.
   subroutine add_fitted_modes(text, elements, modes)
      type(text_t), intent(inout) :: text
      integer, intent(in) :: elements
      type(fitted_mode_t), intent(in) :: modes(:)
      integer :: k

      do k = 1, size(modes)
         associate (mode => modes(k))
            call text%line(csv_row(to_text(elements)//','// &
               to_text(count(modes(:k)%record == mode%record)), [mode%frequency, &
               mode%damping_ratio, real(mode%s), aimag(mode%s)])//','//to_text(mode%record)// &
               ends(mode%frequency, mode%frequency_half_width)// &
               ends(mode%damping_ratio, mode%damping_half_width))
         end associate
      end do

   contains

      !> Returns the ends of an interval as fields; empty if it is unlimited. Neither a frequency
      !> nor a damping ratio is negative.
      function ends(value, half_width) result(fields)
         real(wp), intent(in) :: value, half_width
         character(len=:), allocatable :: fields

         fields = ',,'
         if (half_width < unlimited) fields = csv_row('', [max(0.0_wp, value - half_width), &
            value + half_width])
      end function ends

   end subroutine add_fitted_modes

   !> Adds rows of minima.csv: the distinct minima found from several starts.
   subroutine add_minima(text, elements, minima)
      type(text_t), intent(inout) :: text
      integer, intent(in) :: elements
      type(minimum_t), intent(in) :: minima(:)
      integer :: j, k

      do k = 1, size(minima)
         associate (fit => minima(k)%fits(size(minima(k)%fits)))
            do j = 1, size(fit%free)
               call text%line(to_text(elements)//','//to_text(k)//','//to_text(minima(k)%count)// &
                  ','//full(fit%fit%J)//','//trim(fit%quantities(j)%name)//','// &
                  limit(fit%quantities(j)%value))
            end do
         end associate
      end do
   end subroutine add_minima

   !> Adds record.csv, which `identify` can read.
   !>
   !> t, acceleration  (samples) [time], [length/time**2]
   subroutine add_record_table(output, t, acceleration)
      type(output_t), intent(inout) :: output
      real(wp), intent(in) :: t(:), acceleration(:)
      type(number_table_t), allocatable :: table
      integer :: k

      allocate (table)
      call table%append(reshape([integer ::], [0, size(t)]), reshape([(t(k), acceleration(k), &
         k=1, size(t))], [2, size(t)]))
      call add_number_table(output, 'record.csv', 't,acceleration', table)
   end subroutine add_record_table

   !> Returns the table labels.csv with the units, for the plots.
   function labels_table(units) result(content)
      type(units_t), intent(in) :: units
      character(len=:), allocatable :: content
      type(text_t) :: text

      call text%line('quantity,unit')
      call text%line('time,'//units%time)
      call text%line('length,'//units%length)
      call text%line('force,'//units%force)
      call text%line('mass,'//units%mass)
      call text%line('velocity,'//units%velocity())
      call text%line('acceleration,'//units%acceleration())
      content = text%content()
   end function labels_table

end module beamid_tables
