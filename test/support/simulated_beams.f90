!> Simulates the acceleration of a clamped beam by Hermite's cubic elements, as a model that is
!> independent of the program. The clamp may yield, and the beam may have a cut or a crack.
module simulated_beams
   use beamid_kinds, only: wp
   use beamid_lapack, only: dgeev
   use hermite_beams, only: bending_of_element, dsygv, mass_of_element
   implicit none
   private

   public :: beam_t, decay, after_pulse, frequencies

   !> A beam of rectangular cross section with a sensor, in SI units.
   type :: beam_t
      real(wp) :: length = 0, width = 0.03_wp, height = 0   !< dimensions [m]
      real(wp) :: density = 2700           !< density [kg/m^3]
      real(wp) :: E = 7e10_wp              !< modulus [N/m^2]
      real(wp) :: c_D = 2e6_wp             !< viscosity of the material [N s/m^2]
      real(wp) :: gamma = 0.05_wp          !< damping by the air [N s/m^2]
      real(wp) :: m_S = 0                  !< mass of the sensor [kg]
      real(wp) :: x_S = 0                  !< position of the sensor [m]; 0: at the tip
      real(wp) :: k_R = 0                  !< stiffness of the clamp [N m]; 0: rigid
      real(wp) :: cut(2) = 0               !< both ends of a cut [m]; equal: none
      real(wp) :: stiffness_left = 1       !< share of the bending stiffness that is left in the cut
      real(wp) :: crack = 0                !< position of a crack [m]; 0: none
      real(wp) :: k_crack = 0              !< stiffness of the crack as a rotational spring [N m]
   end type beam_t

   !> Number of elements of equal length before nodes are added, and largest number of modes.
   integer, parameter :: elements = 40, most_modes = 20
   real(wp), parameter :: two_pi = 2*acos(-1.0_wp)

   interface
      subroutine zgesv(n, nrhs, a, lda, ipiv, b, ldb, info)
         import :: wp
         integer, intent(in) :: n, nrhs, lda, ldb
         complex(wp), intent(inout) :: a(lda, *), b(ldb, *)
         integer, intent(out) :: ipiv(*), info
      end subroutine zgesv
   end interface

   !> A beam in the coordinates of its lowest undamped modes.
   type :: modal_t
      real(wp), allocatable :: lambda(:)       !< (modes) squared natural frequencies [1/s^2]
      real(wp), allocatable :: damping(:, :)   !< (modes, modes) damping matrix [1/s]
      real(wp), allocatable :: sensor(:)       !< (modes) displacement of the sensor
      real(wp), allocatable :: tip(:)          !< (modes) displacement of the tip
      complex(wp), allocatable :: s(:)         !< (2 modes) roots [1/s]
      complex(wp), allocatable :: state(:, :)  !< (2 modes, 2 modes) eigenvectors of the state
   end type modal_t

contains

   !> Returns the lowest damped natural frequencies [Hz].
   function frequencies(beam, wanted) result(f)
      type(beam_t), intent(in) :: beam
      integer, intent(in) :: wanted
      real(wp) :: f(wanted)

      f = aimag(lowest_roots(beam, wanted))/two_pi
   end function frequencies

   !> Returns the acceleration of a free decay at the sensor [m/s^2].
   !>
   !> t          (m) times [s]
   !> amplitude  (modes) amplitudes of the lowest modes at the first time [m/s^2]
   !> phase      (modes) their phases at the first time [rad]
   function decay(beam, t, amplitude, phase) result(a)
      type(beam_t), intent(in) :: beam
      real(wp), intent(in) :: t(:), amplitude(:), phase(:)
      real(wp) :: a(size(t))
      complex(wp) :: s(size(amplitude))
      integer :: k

      s = lowest_roots(beam, size(amplitude))
      a = 0
      do k = 1, size(s)
         a = a + amplitude(k)*real(exp(s(k)*(t - t(1)) + cmplx(0, phase(k), wp)))
      end do
   end function decay

   !> Returns the acceleration at the sensor after a constant force on the tip for 0 < t < duration.
   !>
   !> force     [N]
   !> duration  [s]
   !> t         (m) times > duration [s]
   function after_pulse(beam, force, duration, t) result(a)
      type(beam_t), intent(in) :: beam
      real(wp), intent(in) :: force, duration, t(:)
      real(wp) :: a(size(t))
      type(modal_t) :: modal
      complex(wp), allocatable :: load(:), parts(:)
      integer :: n

      call new_modal(beam, modal)
      n = size(modal%lambda)
      allocate (load(2*n), source=(0.0_wp, 0.0_wp))
      load(n + 1:) = force*modal%tip
      parts = components(modal, load)*(exp(modal%s*duration) - 1)/modal%s
      a = motion(modal, matmul(modal%state, parts), t - duration)
   end function after_pulse

   !> Returns the acceleration of a free motion at the sensor [m/s^2].
   !>
   !> state  (2 modes) displacements and velocities at t = 0
   function motion(modal, state, t) result(a)
      type(modal_t), intent(in) :: modal
      complex(wp), intent(in) :: state(:)
      real(wp), intent(in) :: t(:)
      real(wp) :: a(size(t))
      complex(wp) :: residues(size(modal%s))
      integer :: k, n

      n = size(modal%lambda)
      residues = components(modal, state)*modal%s**2* &
         matmul(modal%sensor, modal%state(:n, :))
      a = 0
      do k = 1, size(residues)
         a = a + real(residues(k)*exp(modal%s(k)*t))
      end do
   end function motion

   !> Returns the components of a state along the eigenvectors.
   function components(modal, state) result(c)
      type(modal_t), intent(in) :: modal
      complex(wp), intent(in) :: state(:)
      complex(wp) :: c(size(state)), vectors(size(state), size(state)), right(size(state), 1)
      integer :: info, pivots(size(state))

      vectors = modal%state
      right(:, 1) = state
      call zgesv(size(state), 1, vectors, size(state), pivots, right, size(state), info)
      if (info /= 0) error stop 'simulated_beams: the eigenvectors are linearly dependent'
      c = right(:, 1)
   end function components

   !> Returns the roots of the lowest damped modes, those with a positive imaginary part [1/s].
   function lowest_roots(beam, wanted) result(s)
      type(beam_t), intent(in) :: beam
      integer, intent(in) :: wanted
      complex(wp) :: s(wanted)
      type(modal_t) :: modal
      logical, allocatable :: left(:)
      integer :: k, lowest

      call new_modal(beam, modal)
      left = aimag(modal%s) > 0
      do k = 1, wanted
         lowest = minloc(aimag(modal%s), dim=1, mask=left)
         s(k) = modal%s(lowest)
         left(lowest) = .false.
      end do
   end function lowest_roots

   !> Transforms a beam to its lowest undamped modes and finds the roots of the damped motion.
   subroutine new_modal(beam, modal)
      type(beam_t), intent(in) :: beam
      type(modal_t), intent(out) :: modal
      real(wp), allocatable, dimension(:, :) :: C, K, M, a, right, left
      real(wp), allocatable :: w(:), work(:), real_part(:), imaginary(:)
      integer :: info, j, n, sensor, size_of

      call assemble(beam, M, C, K, sensor)
      size_of = size(M, 1)
      allocate (w(size_of), work(40*size_of))
      call dsygv(1, 'V', 'L', size_of, K, size_of, M, size_of, w, work, size(work), info)
      if (info /= 0) error stop 'simulated_beams: the mass matrix is not positive definite'
      n = min(most_modes, size_of)
      modal%lambda = w(:n)
      modal%sensor = K(sensor, :n)
      modal%tip = K(size_of - 1, :n)
      modal%damping = matmul(transpose(K(:, :n)), matmul(C, K(:, :n)))
      allocate (a(2*n, 2*n), source=0.0_wp)
      do j = 1, n
         a(j, n + j) = 1
         a(n + j, j) = -modal%lambda(j)
      end do
      a(n + 1:, n + 1:) = -modal%damping
      allocate (right(2*n, 2*n), left(1, 1), real_part(2*n), imaginary(2*n))
      call dgeev('N', 'V', 2*n, a, 2*n, real_part, imaginary, left, 1, right, 2*n, work, &
         size(work), info)
      if (info /= 0) error stop 'simulated_beams: the roots cannot be found'
      modal%s = cmplx(real_part, imaginary, wp)
      modal%state = cmplx(right, 0, wp)
      do j = 1, 2*n - 1
         if (.not. imaginary(j) > 0) cycle
         modal%state(:, j) = cmplx(right(:, j), right(:, j + 1), wp)
         modal%state(:, j + 1) = conjg(modal%state(:, j))
      end do
   end subroutine new_modal

   !> Assembles the matrices of the free degrees of freedom. Node i has the displacement 2 i - 1 and
   !> the slope 2 i. Behind a crack the slope is a further degree of freedom. The last two are those
   !> of the tip.
   !>
   !> sensor  degree of freedom of the sensor's displacement
   subroutine assemble(beam, M, C, K, sensor)
      type(beam_t), intent(in) :: beam
      real(wp), allocatable, intent(out) :: M(:, :), C(:, :), K(:, :)
      integer, intent(out) :: sensor
      real(wp), allocatable :: all_M(:, :), all_C(:, :), all_K(:, :), x(:)
      integer, allocatable :: behind(:), free(:)
      integer :: dof(4), e, i, nodes

      call place_nodes(beam, x)
      nodes = size(x)
      ! (nodes) degree of freedom of the slope behind each node.
      behind = [(2*i, i=1, nodes)]
      i = node_at(x, beam%crack)
      if (beam%crack > 0) behind(i) = 2*nodes + 1
      allocate (all_M(2*nodes + 1, 2*nodes + 1), source=0.0_wp)
      allocate (all_C, all_K, source=all_M)
      do e = 1, nodes - 1
         dof = [2*e - 1, behind(e), 2*e + 1, 2*e + 2]
         call add_element(beam, x(e), x(e + 1), dof, all_M, all_C, all_K)
      end do
      if (beam%crack > 0) call add_spring(beam%k_crack, [2*i, 2*nodes + 1], all_K)
      sensor = 2*nodes - 1
      if (beam%x_S > 0) sensor = 2*node_at(x, beam%x_S) - 1
      all_M(sensor, sensor) = all_M(sensor, sensor) + beam%m_S
      all_K(2, 2) = all_K(2, 2) + beam%k_R
      free = [(i, i=3, 2*nodes)]
      if (beam%k_R > 0) free = [2, free]
      if (beam%crack > 0) free = [2*nodes + 1, free]
      M = all_M(free, free)
      C = all_C(free, free)
      K = all_K(free, free)
      sensor = findloc(free, sensor, dim=1)
   end subroutine assemble

   !> Adds the matrices of one element to those of the beam.
   !>
   !> first, last  both ends of the element [m]
   !> dof          (4) degrees of freedom: displacement and slope of either end
   subroutine add_element(beam, first, last, dof, M, C, K)
      type(beam_t), intent(in) :: beam
      real(wp), intent(in) :: first, last
      integer, intent(in) :: dof(4)
      real(wp), intent(inout) :: M(:, :), C(:, :), K(:, :)
      real(wp) :: bending(4, 4), h, mass(4, 4), middle, stiffness

      h = last - first
      middle = (first + last)/2
      stiffness = beam%width*beam%height**3/12
      if (middle > beam%cut(1) .and. middle < beam%cut(2)) stiffness = &
         stiffness*beam%stiffness_left
      bending = stiffness*bending_of_element(h)
      mass = mass_of_element(h)
      M(dof, dof) = M(dof, dof) + beam%density*beam%width*beam%height*mass
      C(dof, dof) = C(dof, dof) + beam%gamma*mass + beam%c_D*bending
      K(dof, dof) = K(dof, dof) + beam%E*bending
   end subroutine add_element

   !> Connects two slopes by a rotational spring.
   pure subroutine add_spring(stiffness, dof, K)
      real(wp), intent(in) :: stiffness
      integer, intent(in) :: dof(2)
      real(wp), intent(inout) :: K(:, :)

      K(dof, dof) = K(dof, dof) + stiffness*reshape([1, -1, -1, 1], [2, 2])
   end subroutine add_spring

   !> Places nodes at equal distances and at the sensor, at both ends of the cut and at the crack.
   !>
   !> x  (nodes) positions, strictly ascending [m]
   subroutine place_nodes(beam, x)
      type(beam_t), intent(in) :: beam
      real(wp), allocatable, intent(out) :: x(:)
      real(wp) :: further(4)
      integer :: k

      x = beam%length/elements*[(k, k=0, elements)]
      further = [beam%x_S, beam%cut, beam%crack]
      do k = 1, size(further)
         ! A node closer than this serves for both.
         if (minval(abs(x - further(k))) < 1e-6_wp*beam%length) cycle
         x = [pack(x, x < further(k)), further(k), pack(x, x > further(k))]
      end do
   end subroutine place_nodes

   !> Returns the number of the node nearest to a position.
   pure integer function node_at(x, position)
      real(wp), intent(in) :: x(:), position

      node_at = minloc(abs(x - position), dim=1)
   end function node_at

end module simulated_beams
