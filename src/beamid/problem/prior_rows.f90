!> Residuals of a fit that come from prior knowledge: priors of parameters, and penalties on
!> E(x) and c_D(x).
module beamid_prior_rows
   use beamid_field_penalties, only: fields, penalty_order
   use beamid_kinds, only: wp
   use beamid_motion_rows, only: motion_rows_t
   use beamid_priors, only: priors_of
   use beamid_smoothing, only: difference_rows
   implicit none
   private

   public :: add_prior_rows

contains

   !> Computes the rows of the priors, and after them those of the penalties.
   !>
   !> r    (rows - samples)
   !> jac  (rows - samples, n or more), 0 on entry; or without columns
   pure subroutine add_prior_rows(self, parameters, r, jac)
      class(motion_rows_t), intent(in) :: self
      real(wp), intent(in) :: parameters(:)
      real(wp), intent(inout) :: r(:), jac(:, :)
      real(wp) :: centre, slope
      integer :: which(size(parameters)), k, row

      which = priors_of(self%priors, self%free, self%record)
      row = 0
      do k = 1, size(parameters)
         if (which(k) == 0) cycle
         row = row + 1
         associate (prior => self%priors(which(k)))
            centre = prior%centre_in(self%record(k))
            slope = self%noise/prior%width(centre)
            r(row) = slope*(parameters(k) - centre)
         end associate
         if (size(jac, 2) > 0) jac(row, k) = slope
      end do
      call add_penalties(self, parameters, r(row + 1:), jac(row + 1:, :))
   end subroutine add_prior_rows

   !> Computes the rows of the penalties on E(x) and c_D(x).
   pure subroutine add_penalties(self, parameters, r, jac)
      class(motion_rows_t), intent(in) :: self
      real(wp), intent(in) :: parameters(:)
      real(wp), intent(inout) :: r(:), jac(:, :)
      integer, allocatable :: columns(:)
      real(wp), allocatable :: differences(:, :)
      integer :: a, k, row

      row = 0
      do a = 1, fields
         if (.not. self%strength(a) > 0) cycle
         columns = self%field_columns(a)
         differences = sqrt(self%strength(a))*difference_rows(size(columns), penalty_order)
         associate (rows => size(differences, 1))
            r(row + 1:row + rows) = matmul(differences, log(parameters(columns)))
            if (size(jac, 2) > 0) then
               do k = 1, size(columns)
                  jac(row + 1:row + rows, columns(k)) = differences(:, k)/parameters(columns(k))
               end do
            end if
            row = row + rows
         end associate
      end do
   end subroutine add_penalties

end module beamid_prior_rows
