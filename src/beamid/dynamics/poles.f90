!> Poles and residues of the transfer function from the load to the sensor.
!>
!> With the eigenvector x of a root s and A = x'(2 s M + C) x, the residue is (o'x)(x'F)/A, where o
!> is the sensor's row: displacement of the sensor = o'x. A vanishes at a double root. A root with a
!> small |A| is therefore grouped with its neighbours into a cluster (`beamid_clusters`), which has
!> a residue for the group as a whole.
!>
!> `beamid_pole_search` finds the roots, `beamid_pole_derivatives` differentiates, and
!> `beamid_synthesis` computes the motion.
module beamid_poles
   use beamid_assembly, only: assembly_t, root_t
   use beamid_clusters, only: cluster_t, find_clusters, origin_cluster
   use beamid_contours, only: measure
   use beamid_errors, only: error_t, failure
   use beamid_kinds, only: wp
   use beamid_strings, only: to_text
   use beamid_structure, only: is_coefficient, n_parameters
   use beamid_vectors, only: find_vector, solve_mass, vector_t
   implicit none
   private

   public :: poles_t, find_residues, is_unresolved, load_on, parameter_values, pair_weight

   !> Poles, residues and clusters of one structure, and their derivatives.
   type :: poles_t
      !> (poles) the root with Im s > 0 of each complex pair, and all real roots
      type(root_t), allocatable :: root(:)
      !> every root, conjugates included: the start of the next search
      type(root_t), allocatable :: all(:)
      !> (relaxation roots) their relative positions, from `shares_of`
      real(wp), allocatable :: shares(:)
      complex(wp), allocatable :: s(:)            !< (poles) values of `root` [1/time]
      !> (poles) residues r, doubled for pairs. Without the clusters, the response to a unit impulse
      !> is Re(sum r e**(s t)). 0 if the root belongs to a cluster.
      complex(wp), allocatable :: residue(:)
      type(cluster_t), allocatable :: cluster(:)  !< groups of roots that nearly coincide
      !> All roots with Re s >= -rate are there, and so many of the lowest that oscillate; others
      !> may be missing.
      real(wp) :: rate = huge(1.0_wp)
      integer :: modes = huge(1)
      !> (2, 0:parameters) transfer function and its derivative with respect to s, at s = 0
      real(wp), allocatable :: static(:, :)
      !> o'M**-1 F = sum of r s: acceleration of the sensor at the instant at which a unit force
      !> acts
      real(wp) :: impulse = 0
      !> (n + r, 2) M**-1 F and M**-1 o: the n oscillators x, then the r rows y
      real(wp), allocatable :: accelerations(:, :)
      !> (poles, parameters) ds/dp [1/time per unit of p]; in a cluster, the derivative of the mean
      !> of its roots
      complex(wp), allocatable :: ds(:, :)
      complex(wp), allocatable :: dr(:, :)        !< (poles, parameters) derivatives of `residue`
      real(wp), allocatable :: dimpulse(:)        !< (parameters) derivatives of `impulse`
      type(vector_t), allocatable :: vector(:)    !< (poles) eigenvectors
      integer, allocatable :: parameters(:)       !< numbers of the parameters of the derivatives
      !> (parameters) their values; not allocated: `ds` belongs to other roots
      real(wp), allocatable :: values(:)
   contains
      procedure :: has_all, start_from
   end type poles_t

   !> Largest accepted errors of two sum rules. The residues add up to 0, and the products r s to
   !> o'M**-1 F. A remainder is an error of the response: of the displacement, relative to the size
   !> of an ordinary residue (`max_rest`), and of the initial acceleration, relative to the sum of
   !> |r s| (`max_rest_at_once`). The acceleration is known only to the condition of M, which is 1e9
   !> for a heavy tip on a root that rotates; the roots that carry it decay at once. A missing root
   !> leaves its whole share.
   real(wp), parameter :: max_rest = 1e-8_wp, max_rest_at_once = 1e-6_wp

   !> |A| relative to that of an undamped mode, below which a root is grouped with its neighbours:
   !> its residue has lost two digits there, and the derivative of the residue four.
   real(wp), parameter :: small_A = 5e-2_wp
   !> Two limits where only a wide disc holds the group. Below `smaller_A` the root is taken with
   !> the group; above it, by itself (its derivative keeps ten digits). Below `tiny_A`, a root that
   !> no cluster holds is an error (its derivative would keep six digits).
   real(wp), parameter :: smaller_A = 1e-3_wp, tiny_A = 1e-5_wp

contains

   !> Computes the residues of the isolated roots and the clusters of the others, and checks the
   !> sum rules if all roots are there.
   !>
   !> poles  in: `root`, `all` and `vector`; out: `s`, `residue`, `cluster`, `impulse` and
   !>        `accelerations`
   !> error  roots are missing, or are too close together for a cluster, or close together at all
   !>        if not all are there
   subroutine find_residues(assembly, poles, error)
      type(assembly_t), intent(in) :: assembly
      type(poles_t), intent(inout) :: poles
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: undamped(size(poles%root)), size_of_A
      logical, dimension(size(poles%root)) :: near, alone
      integer :: k

      poles%s = poles%root%s
      poles%residue = poles%s
      do k = 1, size(poles%s)
         if (.not. assembly%is_dense()) call renormalize(assembly, poles%root(k), poles%vector(k))
         associate (vector => poles%vector(k))
            ! |A| of an undamped mode, and |A|.
            undamped(k) = 2*abs(poles%s(k))*vector%inertia
            size_of_A = abs(vector%A)
            near(k) = .not. size_of_A >= small_A*undamped(k)
            alone(k) = size_of_A > smaller_A*undamped(k)
            poles%residue(k) = 0
            if (near(k)) then
               if (is_unresolved(assembly, vector, poles%s(k))) then
                  near(k) = .false.
                  cycle
               end if
            end if
            ! An exact double root has no residue of its own; a cluster holds it.
            if (size_of_A > 0) poles%residue(k) = pair_weight(poles%s(k)) &
               *vector%y(assembly%layout%sensor)*load_on(assembly, vector, poles%s(k))/vector%A
         end associate
      end do
      if (.not. poles%has_all()) then
         if (any(near)) call failure(error, 'modal: roots are close together')
         poles%cluster = [cluster_t ::]
         call set_accelerations(assembly, poles)
         return
      end if
      call gather_clusters(assembly, near, alone, poles, error)
      if (allocated(error)) return
      do k = 1, size(poles%s)
         if (.not. near(k)) cycle
         if (abs(poles%vector(k)%A) > tiny_A*undamped(k)) cycle
         if (any(poles%cluster%holds(poles%s(k)))) cycle
         if (is_unresolved(assembly, poles%vector(k), poles%s(k))) cycle
         call refuse_roots('more roots of the characteristic equation than can be '// &
            'told apart', poles%s(k), error)
         return
      end do
      do k = 1, size(poles%cluster)
         where (poles%cluster(k)%holds(poles%s)) poles%residue = 0
         call measure(assembly, poles%cluster(k))
      end do
      call check_sum_rules(assembly, poles, error)
   end subroutine find_residues

   !> Finds the clusters of all roots that are close together, and that of the roots 0.
   !>
   !> near   (roots) whether another root is close
   !> alone  (roots) whether such a root may still be isolated
   !> poles  out: `cluster`
   !> error  the moving base leaves a motion free
   subroutine gather_clusters(assembly, near, alone, poles, error)
      type(assembly_t), intent(in) :: assembly
      logical, intent(in) :: near(:), alone(:)
      type(poles_t), intent(inout) :: poles
      type(error_t), allocatable, intent(out) :: error

      poles%cluster = [cluster_t ::]
      if (any(near)) call find_clusters(assembly, poles%all, pack(poles%root, near), &
         pack(alone, near), poles%cluster)
      if (assembly%load%feels_base .and. minval(abs(poles%s)) <= 1e-12_wp*maxval(abs(poles%s))) then
         call failure(error, 'modal: found a hose or a beam that is not held by the '// &
            'moving base, expected k_H > 0, or &end and supports that hold the beam')
         return
      end if
      if (assembly%load%feels_base .or. assembly%zeros > 0) &
         poles%cluster = [poles%cluster, origin_cluster(assembly, poles%s)]
   end subroutine gather_clusters

   !> Returns whether a root is the slow root of an overdamped mode and equals -E/c_D to round-off.
   !> The residue of such a root is 1e-10 of the residue that the mode has without damping.
   pure logical function is_unresolved(assembly, vector, s)
      type(assembly_t), intent(in) :: assembly
      type(vector_t), intent(in) :: vector
      complex(wp), intent(in) :: s   !< the root [1/time]

      ! The eigenvector may contain NaN. A small A is not sufficient: A also vanishes at an ordinary
      ! double root.
      is_unresolved = .not. abs(vector%A) > 2*tiny_A*abs(s)*vector%inertia
      if (is_unresolved) is_unresolved = assembly%oscillators%distance_from_accumulation(s) <= &
         1e-10_wp
   end function is_unresolved

   !> Normalises an eigenvector to x_j = 1 at another oscillator j, if the modal mass of the present
   !> one is less than 1/16 of the largest.
   pure subroutine renormalize(assembly, root, vector)
      type(assembly_t), intent(in) :: assembly
      type(root_t), intent(inout) :: root
      type(vector_t), intent(inout) :: vector
      real(wp) :: share, largest
      integer :: i, j

      largest = -1
      do i = 1, assembly%layout%n
         share = assembly%oscillators%m(i)*(real(vector%x(i))**2 + aimag(vector%x(i))**2)
         if (share > largest) j = i
         largest = max(largest, share)
      end do
      if (.not. largest > 16*assembly%oscillators%m(root%j)) return
      root%j = j
      call find_vector(assembly, root, vector)
   end subroutine renormalize

   !> Takes over the roots of other poles, from which a search starts, and their derivatives.
   subroutine start_from(self, other)
      class(poles_t), intent(inout) :: self
      type(poles_t), intent(in) :: other

      self%root = other%root
      self%all = other%all
      self%rate = other%rate
      self%modes = other%modes
      if (allocated(self%shares)) deallocate (self%shares)
      if (allocated(other%shares)) self%shares = other%shares
      if (.not. allocated(other%values)) return
      self%ds = other%ds
      self%parameters = other%parameters
      self%values = other%values
   end subroutine start_from

   !> Returns whether all roots of the structure are there.
   pure logical function has_all(self)
      class(poles_t), intent(in) :: self

      has_all = self%modes == huge(1)
   end function has_all

   !> Computes the accelerations at the instant at which a unit force acts.
   !>
   !> poles  out: `impulse` and `accelerations`
   subroutine set_accelerations(assembly, poles)
      type(assembly_t), intent(in) :: assembly
      type(poles_t), intent(inout) :: poles
      integer :: n

      n = assembly%layout%n
      if (allocated(poles%accelerations)) deallocate (poles%accelerations)
      allocate (poles%accelerations(n + assembly%layout%r, 2))
      associate (x => poles%accelerations(:n, :), y => poles%accelerations(n + 1:, :))
         x(:, 1) = assembly%load%total
         x(:, 2) = assembly%layout%vt(:, assembly%layout%sensor)
         call solve_mass(assembly, x, y, -assembly%load%base_coupling)
         poles%impulse = y(assembly%layout%sensor, 1)
      end associate
   end subroutine set_accelerations

   !> Checks that no root is missing, by two sum rules: the residues r add up to 0, and the products
   !> r s to the acceleration at the instant at which a unit force acts.
   !>
   !> poles  out: `impulse` and `accelerations`
   !> error  a sum rule is violated, or a contour holds another number of roots than its cluster
   subroutine check_sum_rules(assembly, poles, error)
      type(assembly_t), intent(in) :: assembly
      type(poles_t), intent(inout) :: poles
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: rest(2), ordinary, at_once
      integer :: k, n

      n = assembly%layout%n
      call set_accelerations(assembly, poles)
      associate (a => poles%accelerations)
         ordinary = abs(dot_product(assembly%load%total, a(:n, 1)))*abs(a(n &
            + assembly%layout%sensor, 2))
      end associate
      ! A sensor at a rigid support does not move. The reference is then the acceleration of the
      ! beam without attachments.
      associate (mass => assembly%oscillators%m, o => assembly%layout%v(assembly%layout%sensor, &
         :), load => assembly%load%total)
         at_once = 1e-6_wp*sqrt(sum(load**2/mass)*sum(o**2/mass))
      end associate
      ! A base that moves slowly loads the structure by its displacement, which a slow relaxation
      ! follows; otherwise relaxation roots have small residues.
      ordinary = max(sqrt(ordinary), at_once) &
         /minval(abs(poles%s), mask=abs(poles%s) > 0 .and. (poles%root%side <= 2 .or. &
         assembly%load%feels_base))
      associate (r => poles%residue, s => poles%s, cluster => poles%cluster)
         rest(1) = sum(real(r)) + sum([(real(cluster(k)%moments(1)), k=1, size(cluster))])
         rest(2) = sum(real(r*s)) + sum([(real(cluster(k)%moments(2)), k=1, size(cluster))])
         rest(1) = abs(rest(1))/ordinary
         rest(2) = abs(rest(2) - poles%impulse)/(at_once + sum(abs(r*s)) &
            + sum([(abs(cluster(k)%moments(2)), k=1, size(cluster))]))
         if (rest(1) <= max_rest .and. rest(2) <= max_rest_at_once .and. &
            all(cluster%is_complete())) return
      end associate
      k = minloc(abs(poles%s), dim=1)
      call refuse_roots('not all roots of the characteristic equation were found, the '// &
         'lowest', poles%s(k), error)
   end subroutine check_sum_rules

   !> Makes the error about wrong or missing roots.
   !>
   !> what  first half of the message, which ends with "near s = ..."
   !> s     the root to name [1/time]
   pure subroutine refuse_roots(what, s, error)
      character(len=*), intent(in) :: what
      complex(wp), intent(in) :: s
      type(error_t), allocatable, intent(out) :: error

      if (abs(s) <= huge(1.0_wp)) then
         call failure(error, 'modal: '//what//' near s = '//to_text(real(s))//' + i '// &
            to_text(aimag(s)))
      else
         call failure(error, 'modal: the roots of the characteristic equation are beyond the '// &
            'range of numbers')
      end if
   end subroutine refuse_roots

   !> Returns x'F, the load on the mode of a root.
   !>
   !> vector  eigenvector of the root
   !> s       the root [1/time]; velocity and displacement of the base load the mode by 1/s and
   !>         1/s**2
   pure complex(wp) function load_on(assembly, vector, s)
      type(assembly_t), intent(in) :: assembly
      type(vector_t), intent(in) :: vector
      complex(wp), intent(in) :: s

      ! The load along the row of a spring is 0. In every other row, y is the motion.
      load_on = assembly%load%power(vector%form, vector%x, vector%y, s, 0)
      if (assembly%load%feels_base) load_on = load_on &
         - sum(assembly%load%base_coupling*vector%f)/s**2
   end function load_on

   !> Returns the values of parameters in an assembly; 0 for a parameter that is not one of the
   !> structure's.
   !>
   !> parameters  their numbers
   pure function parameter_values(assembly, parameters) result(values)
      type(assembly_t), intent(in) :: assembly
      integer, intent(in) :: parameters(:)
      real(wp) :: values(size(parameters))
      integer :: p

      values = 0
      do p = 1, size(values)
         associate (k => parameters(p))
            if (k <= n_parameters .or. is_coefficient(k)) &
               values(p) = assembly%given%structure%get(k)
         end associate
      end do
   end function parameter_values

   !> Returns the number of roots that a root stands for: 2 for a complex pair, 1 for a real root.
   pure real(wp) function pair_weight(s)
      complex(wp), intent(in) :: s

      pair_weight = merge(2.0_wp, 1.0_wp, abs(aimag(s)) > 0)
   end function pair_weight

end module beamid_poles
