!> The free decay of beams as one search for everything: parameters, motions of the modes, offsets.
!>
!> An implementation of its own: roots of the dense first-order system by LAPACK, their derivatives
!> by differences, and the three formulas of the observation in closed form, which multiply e**(s t)
!> by 1, S or S**2 with S = sinh(s Delta/2)/(s Delta/2).
module whole_problem
   use beamid_equations, only: equations_t, new_equations
   use beamid_errors, only: error_t, failure
   use beamid_excitation, only: new_pulse
   use beamid_experiments, only: experiment_t
   use beamid_galerkin, only: galerkin_t, mesh_t, new_galerkin
   use beamid_kinds, only: wp
   use beamid_lapack, only: dgeev, dgesv
   use beamid_observation, only: observation_t
   use beamid_problems, only: smooth_problem_t
   use beamid_structure, only: structure_t
   use dense_matrices, only: dense_of
   implicit none
   private

   public :: whole_t, new_whole

   type, extends(smooth_problem_t) :: whole_t
      type(experiment_t), allocatable :: experiments(:)
      type(structure_t), allocatable :: structures(:)   !< of each experiment
      type(galerkin_t), allocatable :: galerkins(:)
      type(observation_t) :: observation
      integer, allocatable :: free(:), record(:)        !< (n)
      integer :: modes = 0
   contains
      procedure :: residuals
      procedure :: jacobian
      procedure, private :: roots
   end type whole_t

contains

   !> The same free parameters and records as a fit has.
   function new_whole(experiments, structure, mesh, observation, free, record) result(self)
      type(experiment_t), intent(in) :: experiments(:)
      type(structure_t), intent(in) :: structure
      type(mesh_t), intent(in) :: mesh
      type(observation_t), intent(in) :: observation
      integer, intent(in) :: free(:), record(:)
      type(whole_t) :: self
      integer :: i

      self%experiments = experiments
      self%observation = observation
      self%free = free
      self%record = record
      self%modes = experiments(1)%excitation%modes
      allocate (self%structures(size(experiments)), self%galerkins(size(experiments)))
      do i = 1, size(experiments)
         self%structures(i) = structure
         if (allocated(experiments(i)%length)) self%structures(i)%length = experiments(i)%length
         if (allocated(experiments(i)%x_S)) self%structures(i)%sensor(1)%x_S = experiments(i)%x_S
         self%galerkins(i) = new_galerkin(mesh, self%structures(i)%length)
      end do
   end function new_whole

   !> The lowest roots of a record's structure that oscillate.
   subroutine roots(self, i, parameters, s, error)
      class(whole_t), intent(inout), target :: self
      integer, intent(in) :: i
      real(wp), intent(in) :: parameters(:)
      complex(wp), intent(out) :: s(:)
      type(error_t), allocatable, intent(out) :: error
      type(equations_t) :: equations
      type(structure_t) :: structure
      real(wp), allocatable :: a(:, :), m(:, :), b(:, :), re(:), im(:), work(:)
      real(wp) :: unused(1, 1)
      integer, allocatable :: pivot(:)
      logical, allocatable :: waiting(:)
      integer :: k, n, info, next

      structure = self%structures(i)
      do k = 1, size(self%free)
         if (self%record(k) == 0 .or. self%record(k) == i) call structure%set(self%free(k), &
            parameters(k))
      end do
      equations = new_equations(self%galerkins(i), structure, new_pulse(0.0_wp, 1.0_wp))
      n = equations%n
      m = dense_of(equations%mass)
      b = reshape([dense_of(equations%stiffness), dense_of(equations%damping)], [n, 2*n])
      allocate (a(2*n, 2*n), source=0.0_wp)
      allocate (re(2*n), im(2*n), work(40*n), pivot(n))
      call dgesv(n, 2*n, m, n, pivot, b, n, info)
      if (info == 0) then
         do k = 1, n
            a(k, n + k) = 1
         end do
         a(n + 1:, :) = -b
         call dgeev('N', 'N', 2*n, a, 2*n, re, im, unused, 1, unused, 1, work, size(work), info)
      end if
      if (info /= 0) then
         call failure(error, 'no eigenvalues')
         return
      end if
      waiting = im > 0
      do k = 1, size(s)
         next = minloc(hypot(re, im), dim=1, mask=waiting)
         waiting(next) = .false.
         s(k) = cmplx(re(next), im(next), wp)
      end do
   end subroutine roots

   !> What the formula makes of e**(s t), and its derivative by s.
   pure subroutine seen(observation, s, factor, slope)
      type(observation_t), intent(in) :: observation
      complex(wp), intent(in) :: s
      complex(wp), intent(out) :: factor, slope
      complex(wp) :: x, ratio, dratio

      factor = 1
      slope = 0
      if (observation%formula == 3) return
      x = s*observation%delta/2
      ratio = (exp(x) - exp(-x))/(2*x)
      dratio = ((exp(x) + exp(-x))/2 - ratio)/s
      factor = ratio
      slope = dratio
      if (observation%formula == 2) return
      factor = ratio**2
      slope = 2*ratio*dratio
   end subroutine seen

   subroutine residuals(self, parameters, r, error)
      class(whole_t), intent(inout) :: self
      real(wp), intent(in) :: parameters(:)
      real(wp), intent(out) :: r(:)
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: jac(size(r), size(parameters))

      call evaluate(self, parameters, .false., r, jac, error)
   end subroutine residuals

   subroutine jacobian(self, parameters, r, jac, error)
      class(whole_t), intent(inout) :: self
      real(wp), intent(in) :: parameters(:)
      real(wp), intent(out) :: r(:), jac(:, :)
      type(error_t), allocatable, intent(out) :: error

      call evaluate(self, parameters, .true., r, jac, error)
   end subroutine jacobian

   !> parameters  (n + k) those of the structures, then for each record cosine and sine of each mode
   !>             and the offset
   subroutine evaluate(self, parameters, slopes, r, jac, error)
      type(whole_t), intent(inout) :: self
      real(wp), intent(in) :: parameters(:)
      logical, intent(in) :: slopes
      real(wp), intent(out) :: r(:), jac(:, :)
      type(error_t), allocatable, intent(out) :: error
      complex(wp) :: s(self%modes), ds(self%modes, size(self%free)), factor, slope, c
      complex(wp), allocatable :: wave(:)
      real(wp), allocatable :: tau(:)
      integer :: i, k, first, last, column

      jac = 0
      last = 0
      column = size(self%free)
      do i = 1, size(self%experiments)
         associate (x => self%experiments(i))
            first = last + 1
            last = last + size(x%samples)
            call self%roots(i, parameters, s, error)
            if (.not. allocated(error) .and. slopes) call root_slopes(self, i, parameters, ds, &
               error)
            if (allocated(error)) return
            tau = x%samples - x%samples(1)
            r(first:last) = -x%measured
            do k = 1, self%modes
               call seen(self%observation, s(k), factor, slope)
               c = cmplx(parameters(column + 1), parameters(column + 2), wp)
               wave = exp(s(k)*tau)
               jac(first:last, column + 1) = real(factor*wave)
               jac(first:last, column + 2) = -aimag(factor*wave)
               r(first:last) = r(first:last) + real(c*factor*wave)
               if (slopes) jac(first:last, :size(self%free)) = jac(first:last, :size(self%free)) &
                  + real(spread(c*(factor*tau + slope)*wave, 2, size(self%free)) &
                  *spread(ds(k, :), 1, size(tau)))
               column = column + 2
            end do
            column = column + 1
            jac(first:last, column) = x%scale
            r(first:last) = r(first:last) + x%scale*parameters(column)
         end associate
      end do
   end subroutine evaluate

   !> Five-point differences of the roots: good to 1e-9 or so.
   subroutine root_slopes(self, i, parameters, ds, error)
      type(whole_t), intent(inout) :: self
      integer, intent(in) :: i
      real(wp), intent(in) :: parameters(:)
      complex(wp), intent(out) :: ds(:, :)
      type(error_t), allocatable, intent(out) :: error
      real(wp), parameter :: weights(4) = [1, -8, 8, -1]/12.0_wp
      integer, parameter :: steps(4) = [-2, -1, 1, 2]
      complex(wp) :: s(size(ds, 1))
      real(wp) :: moved(size(parameters)), h
      integer :: j, k

      ds = 0
      do k = 1, size(self%free)
         if (all(self%record(k) /= [0, i])) cycle
         h = 1e-3_wp*parameters(k)
         do j = 1, 4
            moved = parameters
            moved(k) = moved(k) + steps(j)*h
            call self%roots(i, moved, s, error)
            if (allocated(error)) return
            ds(:, k) = ds(:, k) + weights(j)/h*s
         end do
      end do
   end subroutine root_slopes

end module whole_problem
