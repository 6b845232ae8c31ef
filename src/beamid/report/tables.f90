!> Tables for other programs: comma-separated, one header line, numbers to full precision.
module beamid_tables
   use beamid_experiments, only: experiment_t
   use beamid_fitted_modes, only: fitted_mode_t
   use beamid_identification, only: simulation_t, stage_fit_t
   use beamid_kinds, only: wp
   use beamid_multistart, only: minimum_t
   use beamid_strings, only: full, to_text
   use beamid_statistics, only: unlimited
   use beamid_texts, only: text_t
   use beamid_units, only: units_t
   implicit none
   private

   public :: add_autocorrelation, add_correlations, add_estimates, add_fit, add_response, add_modes
   public :: add_fitted_modes, fitted_modes_header, add_minima, minima_header
   public :: correlations_header, autocorrelation_header
   public :: estimates_header, fit_header, response_header, modes_header, record_table, labels_table

   character(len=*), parameter :: estimates_header = &
      'stage,elements,parameter,unit,start,estimate,std_error,lower95,upper95,determined,'// &
      'std_error_corrected,lower95_corrected,upper95_corrected'
   character(len=*), parameter :: fit_header = 'elements,t,measured,model,residual,record'
   character(len=*), &
      parameter :: response_header = 'elements,t,force,displacement,velocity,acceleration'
   character(len=*), parameter :: correlations_header = 'stage,elements,parameter,other,correlation'
   character(len=*), parameter :: autocorrelation_header = 'elements,lag,autocorrelation,band95'
   character(len=*), &
      parameter :: modes_header = 'elements,mode,frequency_hz,damping_ratio,real,imag'

   character(len=*), parameter :: fitted_modes_header = modes_header//',record,'// &
      'frequency_lower95,frequency_upper95,damping_lower95,damping_upper95'
   character(len=*), parameter :: minima_header = 'elements,minimum,count,J,parameter,estimate'

contains

   !> One row per free parameter, and one for J.
   subroutine add_estimates(text, fit, units)
      type(text_t), intent(inout) :: text
      type(stage_fit_t), intent(in) :: fit
      type(units_t), intent(in) :: units
      character(len=:), allocatable :: first, line
      integer :: k

      first = to_text(fit%stage)//','//to_text(fit%elements)//','
      do k = 1, size(fit%quantities)
         associate (q => fit%quantities(k))
            line = first//trim(q%name)//','//units%of_quantity(q%parameter, fit%excitation)// &
               ','//full(q%start)//','//full(q%value)
         end associate
         if (fit%statistics%samples > 0) then
            line = line//','//interval(fit, k, fit%statistics%std_error(k), &
               fit%statistics%half_width(k))//','//trim(merge('yes', 'no ', &
               fit%statistics%determined(k)))//','//interval(fit, k, &
               fit%statistics%corrected_error(k), fit%statistics%corrected_half_width(k))
         else
            line = line//repeat(',', 7)
         end if
         call text%line(line)
      end do
      call text%line(first//'J,'//units%sum_of_squares()//',,'//full(fit%fit%J)//repeat(',', 7))
      if (fit%score >= 0) call text%line(first//'J_score,'//units%sum_of_squares()//',,'// &
         full(fit%score)//repeat(',', 7))
   end subroutine add_estimates

   !> Standard error, lower and upper end of an interval, the ends within the bounds of the search.
   function interval(fit, k, std_error, half_width) result(fields)
      type(stage_fit_t), intent(in) :: fit
      integer, intent(in) :: k
      real(wp), intent(in) :: std_error, half_width
      character(len=:), allocatable :: fields

      associate (q => fit%quantities(k))
         fields = ',,'
         if (std_error < unlimited .and. half_width < unlimited) fields = full(std_error)//','// &
            full(max(q%value - half_width, q%lower))//','//full(min(q%value + half_width, q%upper))
      end associate
   end function interval

   !> Correlations between the estimates of one stage.
   subroutine add_correlations(text, fit)
      type(text_t), intent(inout) :: text
      type(stage_fit_t), intent(in) :: fit
      integer :: j, k

      if (fit%statistics%samples == 0) return
      do j = 1, size(fit%quantities)
         do k = 1, size(fit%quantities)
            call text%line(to_text(fit%stage)//','//to_text(fit%elements)//','// &
               trim(fit%quantities(j)%name)//','//trim(fit%quantities(k)%name)//','// &
               full(fit%statistics%correlation(j, k)))
         end do
      end do
   end subroutine add_correlations

   !> Autocorrelation of the residuals.
   subroutine add_autocorrelation(text, fit)
      type(text_t), intent(inout) :: text
      type(stage_fit_t), intent(in) :: fit
      integer :: k

      do k = 1, size(fit%check%autocorrelation)
         call text%line(to_text(fit%elements)//','//row(k, [fit%check%autocorrelation(k), &
            fit%check%band]))
      end do
   end subroutine add_autocorrelation

   !> residual = measured - model, as in the paper
   subroutine add_fit(text, fit, experiments)
      type(text_t), intent(inout) :: text
      type(stage_fit_t), intent(in) :: fit
      type(experiment_t), intent(in) :: experiments(:)
      integer :: i, k, first

      first = 0
      do i = 1, size(experiments)
         associate (e => experiments(i))
            do k = 1, size(e%samples)
               associate (r => fit%fit%residual(first + k))
                  call text%line(row(fit%elements, [e%samples(k), e%measured(k), &
                     e%measured(k) + r, -r])//','//to_text(i))
               end associate
            end do
            first = first + size(e%samples)
         end associate
      end do
   end subroutine add_fit

   subroutine add_response(text, elements, simulation)
      type(text_t), intent(inout) :: text
      integer, intent(in) :: elements
      type(simulation_t), intent(in) :: simulation
      integer :: k

      associate (r => simulation%response)
         do k = 1, size(r%t)
            call text%line(row(elements, [r%t(k), simulation%force(k), r%displacement(k), &
               r%velocity(k), simulation%acceleration(k)]))
         end do
      end associate
   end subroutine add_response

   !> roots  [1/time]; frequency_hz is |s|/(2 pi), damping_ratio -Re(s)/|s|
   subroutine add_modes(text, elements, roots)
      type(text_t), intent(inout) :: text
      integer, intent(in) :: elements
      complex(wp), intent(in) :: roots(:)
      real(wp) :: ratio
      integer :: k

      do k = 1, size(roots)
         ratio = 0
         if (abs(roots(k)) > 0) ratio = -real(roots(k))/abs(roots(k))
         call text%line(to_text(elements)//','//row(k, [abs(roots(k))/(2*acos(-1.0_wp)), &
            ratio + 0.0_wp, real(roots(k)), aimag(roots(k))]))
      end do
   end subroutine add_modes

   !> Modes of a fitted structure with their intervals.
   subroutine add_fitted_modes(text, elements, modes)
      type(text_t), intent(inout) :: text
      integer, intent(in) :: elements
      type(fitted_mode_t), intent(in) :: modes(:)
      integer :: k, number

      do k = 1, size(modes)
         number = count(modes(:k)%record == modes(k)%record)
         associate (mode => modes(k))
            call text%line(to_text(elements)//','//row(number, [mode%frequency, &
               mode%damping_ratio, real(mode%s), aimag(mode%s)])//','//to_text(mode%record)//','// &
               interval(mode%frequency, mode%frequency_half_width)//','// &
               interval(mode%damping_ratio, mode%damping_half_width))
         end associate
      end do

   contains

      !> Its ends, or two empty fields. Neither a frequency nor a damping ratio is negative.
      function interval(value, half_width) result(ends)
         real(wp), intent(in) :: value, half_width
         character(len=:), allocatable :: ends

         ends = ','
         if (half_width < unlimited) ends = full(max(0.0_wp, value - half_width))//ends// &
            full(value + half_width)
      end function interval

   end subroutine add_fitted_modes

   !> The minima that several starts have found.
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
                  full(fit%quantities(j)%value))
            end do
         end associate
      end do
   end subroutine add_minima

   !> A record as `identify` reads it.
   function record_table(t, acceleration) result(content)
      real(wp), intent(in) :: t(:), acceleration(:)
      character(len=:), allocatable :: content
      type(text_t) :: text
      integer :: k

      call text%line('t,acceleration')
      do k = 1, size(t)
         call text%line(full(t(k))//','//full(acceleration(k)))
      end do
      content = text%content()
   end function record_table

   !> Units of the columns, for the plots.
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

   !> An integer and numbers, separated by commas.
   function row(first, values) result(line)
      integer, intent(in) :: first
      real(wp), intent(in) :: values(:)
      character(len=:), allocatable :: line
      integer :: k

      line = to_text(first)
      do k = 1, size(values)
         line = line//','//full(values(k))
      end do
   end function row

end module beamid_tables
