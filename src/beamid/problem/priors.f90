!> Prior information: parameter values with standard deviations that the user knows apart from the
!> records.
!>
!> A prior of a free parameter adds one residual to the fit. A prior of a fixed parameter is a
!> source of error of the estimates (module `beamid_held_errors`).
module beamid_priors
   use beamid_kinds, only: wp
   use beamid_parameter_names, only: name_length
   use beamid_parameters, only: as_named, parameters
   use beamid_unknowns, only: scenario_t
   implicit none
   private

   public :: prior_t, priors_of

   !> The prior of one quantity of the case file.
   type :: prior_t
      character(len=name_length) :: name = ''
      !> (k) numbers in `parameters` of the parameters that the quantity changes: one parameter, or
      !> I and rho if the quantity is the height of the beam
      integer, allocatable :: parameter(:)
      !> (k) derivative of each of these parameters with respect to the quantity; 1 for a parameter
      real(wp), allocatable :: slope(:)
      integer :: record = 0           !< record the prior applies to; 0: all, with one common error
      real(wp), allocatable :: value  !< prior mean; not allocated: the value in the case file
      real(wp) :: sd = 0              !< standard deviation, in the unit of the quantity
      !> (records) prior mean of the variable that the search uses, which may be the reciprocal of
      !> the parameter; set by `refer_to`
      real(wp), allocatable :: centre(:)
   contains
      procedure :: is_about
      procedure :: refer_to
      procedure :: centre_in
      procedure :: width => width_near
   end type prior_t

contains

   !> Returns the number of the prior of each free parameter; 0 if it has none.
   !>
   !> priors         all priors of the fit
   !> free, records  (n) numbers of the free parameters, and the record each belongs to (0: all)
   pure function priors_of(priors, free, records) result(which)
      type(prior_t), intent(in) :: priors(:)
      integer, intent(in) :: free(:), records(:)
      integer :: which(size(free)), j, k

      which = 0
      do k = 1, size(free)
         do j = 1, size(priors)
            if (priors(j)%is_about(free(k), records(k))) which(k) = j
         end do
      end do
   end function priors_of

   !> Tells whether the prior applies to one parameter alone, in a given record (0: in all records).
   pure logical function is_about(self, parameter, record)
      class(prior_t), intent(in) :: self
      integer, intent(in) :: parameter, record

      is_about = .false.
      if (size(self%parameter) /= 1) return
      is_about = self%parameter(1) == parameter .and. &
         (self%record == 0 .or. record == 0 .or. self%record == record)
   end function is_about

   !> Sets `centre`: the prior mean of the searched variable in each record.
   !>
   !> scenario  structures and excitations with the values of the case file
   pure subroutine refer_to(self, scenario)
      class(prior_t), intent(inout) :: self
      type(scenario_t), intent(in) :: scenario
      integer :: r

      if (allocated(self%centre)) deallocate (self%centre)
      allocate (self%centre(size(scenario%structures)))
      associate (p => self%parameter(1))
         do r = 1, size(self%centre)
            self%centre(r) = scenario%get(p, r)
         end do
         if (allocated(self%value)) self%centre = as_named(p, self%value)
      end associate
   end subroutine refer_to

   !> Returns the prior mean of the searched variable in one record (0: in all). Requires
   !> `refer_to`.
   pure real(wp) function centre_in(self, record)
      class(prior_t), intent(in) :: self
      integer, intent(in) :: record

      centre_in = self%centre(max(1, record, self%record))
   end function centre_in

   !> Returns the standard deviation of the searched variable, which is sd/k**2 for the reciprocal
   !> 1/k.
   !>
   !> centre  mean of the searched variable
   pure real(wp) function width_near(self, centre) result(width)
      class(prior_t), intent(in) :: self
      real(wp), intent(in) :: centre

      width = self%sd*abs(self%slope(1))
      if (parameters(self%parameter(1))%is_reciprocal) width = width*centre**2
   end function width_near

end module beamid_priors
