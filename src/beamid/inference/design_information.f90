!> Information matrices of experiments from the derivatives of their responses: of the present
!> experiments, of every window of a planned one, and of priors. `beamid_designs` adds them up.
module beamid_design_information
   use beamid_boxes, only: samples_until, window_times_t
   use beamid_design_setups, only: differentiate, setup_t
   use beamid_errors, only: error_t
   use beamid_information, only: eliminate
   use beamid_kinds, only: wp
   use beamid_priors, only: priors_of
   use beamid_residuals, only: residual_t
   implicit none
   private

   public :: present_information, prior_information, window_information

contains

   !> Computes the information of the present experiments about n parameters.
   !>
   !> Parameters that another record has for itself are nuisance parameters, with their own priors.
   !>
   !> setup        of the present experiments
   !> column       (free parameters of all records) index of each among the n parameters
   !> scale        (n) values that relative changes refer to
   !> information  (n, n) of relative changes, nuisance parameters eliminated
   !> error        a response that cannot be computed
   subroutine present_information(setup, column, scale, information, error)
      type(setup_t), intent(inout) :: setup
      integer, intent(in) :: column(:)
      real(wp), intent(in) :: scale(:)
      real(wp), allocatable, intent(out) :: information(:, :)
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: whole(:, :), jacobian(:, :)
      real(wp) :: own_scale(size(column)), prior(size(column))
      integer, allocatable :: first(:), others(:)
      integer :: k, m, n

      own_scale = scale(column)
      call differentiate(setup, own_scale, jacobian, error)
      if (allocated(error)) return
      whole = matmul(transpose(jacobian), jacobian)
      prior = prior_information(setup%problem, own_scale)
      n = size(scale)
      first = [(findloc(column, k, dim=1), k=1, n)]
      others = pack([(k, k=1, size(whole, 1))], [(.not. any(first == k), k=1, size(whole, 1))])
      do k = 1, size(others)
         m = others(k)
         if (m <= size(prior)) whole(m, m) = whole(m, m) + prior(m)
      end do
      information = eliminate(whole([first, others], [first, others]), n)
   end subroutine present_information

   !> Returns the information that the priors of the free parameters contribute.
   !>
   !> scale  (n) values that relative changes refer to
   pure function prior_information(problem, scale) result(information)
      type(residual_t), intent(in) :: problem
      real(wp), intent(in) :: scale(:)
      real(wp) :: information(size(scale))   ! diagonal of the matrix
      integer :: which(size(scale)), k

      information = 0
      which = priors_of(problem%priors, problem%free, problem%record)
      do k = 1, size(scale)
         if (which(k) == 0) cycle
         associate (prior => problem%priors(which(k)))
            information(k) = (scale(k)/prior%width(prior%centre_in(problem%record(k))))**2
         end associate
      end do
   end function prior_information

   !> Computes the information about the first n parameters in every window up to every end.
   !>
   !> jacobian     (times of all windows, n + nuisance) derivatives in units of the noise
   !> windows      (windows) their sample times
   !> ends         (ends) ascending last times [time]
   !> information  (n, n, ends*windows), the ends fastest; nuisance parameters are eliminated
   subroutine window_information(jacobian, n, windows, ends, information)
      real(wp), intent(in) :: jacobian(:, :), ends(:)
      integer, intent(in) :: n
      type(window_times_t), intent(in) :: windows(:)
      real(wp), allocatable, intent(out) :: information(:, :, :)
      real(wp) :: whole(size(jacobian, 2), size(jacobian, 2))
      real(wp), allocatable :: rows(:, :)
      real(wp) :: part(n, n)
      integer :: first, i, j, l, last, place, w

      allocate (information(n, n, size(ends)*size(windows)))
      do w = 1, size(windows)
         whole = 0
         first = 1
         do l = 1, size(ends)
            last = samples_until(windows(w), ends(l))
            allocate (rows(max(0, last - first + 1), size(jacobian, 2)))
            do i = 1, size(rows, 1)
               rows(i, :) = jacobian(windows(w)%place(first + i - 1), :)
            end do
            do j = 1, size(whole, 2)
               do i = 1, j
                  whole(i, j) = whole(i, j) + dot_product(rows(:, i), rows(:, j))
                  whole(j, i) = whole(i, j)
               end do
            end do
            deallocate (rows)
            ! In two steps: gfortran 14 checks the bounds before it knows where a result goes.
            part = eliminate(whole, n)
            place = (w - 1)*size(ends) + l
            information(:, :, place) = part
            first = max(first, last + 1)
         end do
      end do
   end subroutine window_information

end module beamid_design_information
