!> What is known of parameters beside the records: values with standard deviations. One of a free
!> parameter is one more residual, one of a held parameter a source of error.
module beamid_priors
   use beamid_kinds, only: wp
   use beamid_parameters, only: as_named, get_free, name_length, parameters
   use beamid_unknowns, only: scenario_t
   implicit none
   private

   public :: prior_t, priors_of

   type :: prior_t
      character(len=name_length) :: name = ''
      !> Places of the parameters that go with it, and by how much each changes for a unit: one by
      !> 1, or of a height I and rho.
      integer, allocatable :: parameter(:)
      real(wp), allocatable :: slope(:)
      integer :: record = 0                !< that it is about; 0: all, with one error in common
      real(wp), allocatable :: value       !< not allocated: the one that the case has
      real(wp) :: sd = 0                   !< standard deviation, in the unit of the parameter
      real(wp), allocatable :: centre(:)   !< (records) of what a search looks for, by `refer_to`
   contains
      procedure :: is_about
      procedure :: refer_to
      procedure :: centre_in
      procedure :: width
   end type prior_t

contains

   !> The priors of free parameters: for each of them the place of its prior, 0: none.
   !>
   !> free, records  (n) parameters and the record of each, or 0
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

   !> Whether it is about a parameter by itself, of one record or of all (0).
   pure logical function is_about(self, parameter, record)
      class(prior_t), intent(in) :: self
      integer, intent(in) :: parameter, record

      is_about = .false.
      if (size(self%parameter) /= 1) return
      is_about = self%parameter(1) == parameter .and. &
         (self%record == 0 .or. record == 0 .or. self%record == record)
   end function is_about

   !> Notes where the parameter is believed to be in each record: what a search looks for, which may
   !> be the reciprocal.
   !>
   !> scenario  with the values that the case has
   pure subroutine refer_to(self, scenario)
      class(prior_t), intent(inout) :: self
      type(scenario_t), intent(in) :: scenario
      integer :: r

      if (allocated(self%centre)) deallocate (self%centre)
      allocate (self%centre(size(scenario%structures)))
      associate (p => self%parameter(1))
         do r = 1, size(self%centre)
            self%centre(r) = get_free(scenario%structures(r), scenario%excitations(r), p)
         end do
         if (allocated(self%value)) self%centre = as_named(p, self%value)
      end associate
   end subroutine refer_to

   !> Where the parameter of a record (0: of all) is believed to be, once `refer_to` was called.
   pure real(wp) function centre_in(self, record)
      class(prior_t), intent(in) :: self
      integer, intent(in) :: record

      centre_in = self%centre(max(1, record, self%record))
   end function centre_in

   !> The standard deviation of what a search looks for, that of 1/k being sd/k**2.
   pure real(wp) function width(self, centre)
      class(prior_t), intent(in) :: self
      real(wp), intent(in) :: centre

      width = self%sd*abs(self%slope(1))
      if (parameters(self%parameter(1))%is_reciprocal) width = width*centre**2
   end function width

end module beamid_priors
