!> Tables for other programs: comma-separated, one header line, numbers to full precision.
module beamid_tables
   use beamid_excitation, only: excitation_t
   use beamid_identification, only: simulation_t, stage_fit_t
   use beamid_kinds, only: wp
   use beamid_strings, only: full, to_text
   use beamid_structure, only: parameter_names
   use beamid_texts, only: text_t
   use beamid_units, only: units_t
   implicit none
   private

   public :: add_estimates, add_fit, add_response, add_modes
   public :: estimates_header, fit_header, response_header, modes_header, record_table, labels_table

   character(len=*), parameter :: estimates_header = &
      'stage,elements,parameter,unit,start,estimate,std_error,lower95,upper95,determined'
   character(len=*), parameter :: fit_header = 'elements,t,measured,model,residual'
   character(len=*), parameter :: response_header = 'elements,t,force,displacement,velocity,acceleration'
   character(len=*), parameter :: modes_header = 'elements,mode,frequency_hz,damping_ratio,real,imag'

contains

   !> One row per free parameter, and one for J.
   subroutine add_estimates(text, fit, units)
      type(text_t), intent(inout) :: text
      type(stage_fit_t), intent(in) :: fit
      type(units_t), intent(in) :: units
      character(len=:), allocatable :: first
      integer :: k

      first = to_text(fit%stage)//','//to_text(fit%elements)//','
      do k = 1, size(fit%free)
         call text%line(first//trim(parameter_names(fit%free(k)))//','//units%of_parameter(fit%free(k))// &
            ','//full(fit%fit%start(k))//','//full(fit%fit%estimate(k))//',,,,')
      end do
      call text%line(first//'J,'//units%sum_of_squares()//',,'//full(fit%fit%J)//',,,,')
   end subroutine add_estimates

   !> t, measured  (m); residual = measured - model, as in the paper
   subroutine add_fit(text, fit, t, measured)
      type(text_t), intent(inout) :: text
      type(stage_fit_t), intent(in) :: fit
      real(wp), intent(in) :: t(:), measured(:)
      integer :: k

      associate (r => fit%fit%residual)
         do k = 1, size(t)
            call text%line(row(fit%elements, [t(k), measured(k), measured(k) + r(k), -r(k)]))
         end do
      end associate
   end subroutine add_fit

   subroutine add_response(text, elements, excitation, simulation)
      type(text_t), intent(inout) :: text
      integer, intent(in) :: elements
      type(excitation_t), intent(in) :: excitation
      type(simulation_t), intent(in) :: simulation
      integer :: k

      associate (r => simulation%response)
         do k = 1, size(r%t)
            call text%line(row(elements, [r%t(k), excitation%force(r%t(k)), r%displacement(k), &
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
      if (allocated(units%length)) then
         call text%line('time,'//units%time)
         call text%line('length,'//units%length)
         call text%line('force,'//units%force)
         call text%line('mass,'//units%mass)
         call text%line('velocity,'//units%velocity())
         call text%line('acceleration,'//units%acceleration())
      end if
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
