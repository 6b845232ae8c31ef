!> The sum of squares J around a fit, for the studies of the paper: at given parameters, and along
!> one parameter with others fitted again; and a bound on the difference of two models' sums.
module beamid_profiles
   use beamid_errors, only: error_t
   use beamid_galerkin, only: mesh_t
   use beamid_identification, only: identify, model_t, simulate, simulation_t, stage_fit_t, stage_t
   use beamid_kinds, only: wp
   use beamid_parameters, only: set_free
   use beamid_strings, only: to_text
   implicit none
   private

   public :: sum_of_squares, profile, lowest_places, squared_distance, difference_bound

contains

   !> Computes the sum of squared residuals of a model without fitting it.
   !>
   !> samples   (m) ascending sample times [time]
   !> measured  (m) the record [length/time**2]
   !> J         sum of squared residuals; -1 if the response cannot be computed
   !> error     a response that cannot be computed
   subroutine sum_of_squares(model, mesh, samples, measured, J, error)
      type(model_t), intent(in) :: model
      type(mesh_t), intent(in) :: mesh
      real(wp), intent(in) :: samples(:), measured(:)
      real(wp), intent(out) :: J
      type(error_t), allocatable, intent(out) :: error
      type(simulation_t) :: simulation

      J = -1
      call simulate(model, mesh, samples, simulation, error)
      if (.not. allocated(error)) J = squared_distance(simulation%acceleration, measured)
   end subroutine sum_of_squares

   !> Computes the least sum of squares along one parameter: at each of its values the parameters of
   !> a stage are fitted, starting from the previous fit, at first from the values of the model.
   !>
   !> parameter  index in `parameters` of a parameter that is not free in the stage
   !> values     (k) values of this parameter
   !> stage      with the free parameters; its start values are not used
   !> samples    (m) ascending sample times [time]
   !> measured   (m) the record [length/time**2]
   !> fits       (k) fits; allocated on success
   !> error      a fit that fails, with the value of the parameter
   subroutine profile(model, mesh, parameter, values, stage, samples, measured, fits, error)
      type(model_t), intent(in) :: model
      type(mesh_t), intent(in) :: mesh
      integer, intent(in) :: parameter
      real(wp), intent(in) :: values(:)
      type(stage_t), intent(in) :: stage
      real(wp), intent(in) :: samples(:), measured(:)
      type(stage_fit_t), allocatable, intent(out) :: fits(:)
      type(error_t), allocatable, intent(out) :: error
      type(model_t) :: moving
      type(stage_t) :: stages(1)
      type(stage_fit_t), allocatable :: found(:)
      integer :: k

      moving = model
      stages(1) = stage
      if (allocated(stages(1)%start)) deallocate (stages(1)%start)
      allocate (fits(size(values)))
      do k = 1, size(values)
         call set_free(moving%structure, moving%excitation, parameter, values(k))
         call identify(moving, mesh, stages, samples, measured, found, error)
         if (allocated(error)) then
            error%message = 'profile at '//to_text(values(k))//': '//error%message
            deallocate (fits)
            return
         end if
         call found(1)%copy_to(fits(k))
         moving%structure = found(1)%scenario%structures(1)
         moving%excitation = found(1)%scenario%excitations(1)
      end do
   end subroutine profile

   !> Returns the indices of the local minima: values lower than both neighbours, the ends excluded.
   pure function lowest_places(values) result(places)
      real(wp), intent(in) :: values(:)
      integer, allocatable :: places(:)
      integer :: k

      places = pack([(k, k=2, size(values) - 1)], [(values(k) < values(k - 1) .and. &
         values(k) < values(k + 1), k=2, size(values) - 1)])
   end function lowest_places

   !> Returns |a - b|**2.
   pure real(wp) function squared_distance(a, b)
      real(wp), intent(in) :: a(:), b(:)

      squared_distance = sum((a - b)**2)
   end function squared_distance

   !> Returns a bound on the part of the difference of two sums of squares that depends on the
   !> record.
   !>
   !> For responses Y_1 and Y_2 and a record Z, |Y_1 - Z|**2 - |Y_2 - Z|**2 equals |Y_1 - Y_2|**2
   !> plus 2 (Y_1 - Y_2)'(Y_2 - Z). By Schwarz's inequality the last term is no larger than this
   !> bound.
   !>
   !> J          |Y_2 - Z|**2
   !> distance2  |Y_1 - Y_2|**2
   pure real(wp) function difference_bound(J, distance2)
      real(wp), intent(in) :: J, distance2

      difference_bound = 2*sqrt(J*distance2)
   end function difference_bound

end module beamid_profiles
