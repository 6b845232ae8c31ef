!> Poles and residues of the sensor's response, and their derivatives with respect to the
!> parameters.
!>
!> With the vector x of a root s and A = x'(2 s M + C) x the residue is (o'x)(x'F)/A, o the sensor's
!> row, and ds/dp = -x'(s**2 M_p + s C_p + K_p) x/A. The vector's own derivative follows from the
!> equations of `beamid_vectors` with the root as a function of p.
!>
!> A vanishes at a double root. A root with a small A is left out, and with it those near by: they
!> are taken together, as `beamid_clusters` has it.
module beamid_poles
   use beamid_assembly, only: assembly_t
   use beamid_clusters, only: base_cluster, cluster_t, find_clusters
   use beamid_contours, only: measure
   use beamid_errors, only: error_t, failure
   use beamid_kinds, only: wp
   use beamid_roots, only: find_roots
   use beamid_strings, only: to_text
   use beamid_systems, only: differentiate_vector, find_whole_vector, vector_slope_t
   use beamid_vectors, only: find_vector, most, root_t, solve_coupled, solve_mass, vector_t
   implicit none
   private

   public :: poles_t, find_poles, residues, observe_also, differentiate_poles

   type :: poles_t
      !> one of each complex pair, Im s > 0, and the real ones
      type(root_t), allocatable :: root(:)
      type(root_t), allocatable :: all(:)         !< every root, to start the next search from
      complex(wp), allocatable :: s(:)            !< positions of `root` [1/time]
      !> r, doubled for the pairs: Re(sum r e**(s t)) is the answer, but for the clusters; 0: the
      !> root is in one of them
      complex(wp), allocatable :: residue(:)
      type(cluster_t), allocatable :: cluster(:)
      !> sum r s = o' M**-1 F: the acceleration at unit force
      real(wp) :: impulse = 0
      !> (poles, parameters) d s/d parameter; in a cluster that of the mean of its roots
      complex(wp), allocatable :: ds(:, :)
      complex(wp), allocatable :: dr(:, :)        !< (poles, parameters) d residue/d parameter
      real(wp), allocatable :: dimpulse(:)        !< (parameters)
      type(vector_t), allocatable :: vector(:)    !< of each root
      !> (parameters, poles) their derivatives, where something acts between all oscillators
      type(vector_slope_t), allocatable :: slope(:, :)
   end type poles_t

   !> Residues add up to nothing, and r s to o' M**-1 F: what is left over is the error of the
   !> response, of its displacement relative to the size of an ordinary residue, of the acceleration
   !> at once relative to the sum of |r s|. The latter is known to the condition of M only, 1e9 with
   !> a heavy tip on a root that turns; the roots it rests on die at once. A root that is missing
   !> leaves its whole share.
   real(wp), parameter :: max_rest = 1e-8_wp, max_rest_at_once = 1e-6_wp

   !> |A| relative to that of an undamped mode, below which a root is not taken by itself: its
   !> residue has lost two digits there, and its derivative four.
   real(wp), parameter :: small_A = 5e-2_wp
   !> And below which it is rather taken with others in a wide disc than by itself: a derivative
   !> would keep ten digits; below which it must not be: six.
   real(wp), parameter :: smaller_A = 1e-3_wp, tiny_A = 1e-5_wp

contains

   !> poles  in: `all` of a structure much like this one, or nothing
   !> error  the iteration does not converge, or a root was missed
   subroutine find_poles(assembly, poles, error)
      type(assembly_t), intent(in) :: assembly
      type(poles_t), intent(inout) :: poles
      type(error_t), allocatable, intent(out) :: error
      integer :: way

      ! From the roots of the other structure, anew, or from eigenvalues of the matrices.
      do way = merge(1, 2, allocated(poles%all)), 3
         call find_roots(assembly, poles%all, poles%root, error, from_matrix=way == 3)
         if (.not. allocated(error)) call residues(assembly, poles, error)
         if (.not. allocated(error)) return
         if (allocated(poles%all)) deallocate (poles%all)
      end do
   end subroutine find_poles

   !> The same poles as another sensor sees them, where something acts between all oscillators.
   !>
   !> assembly  with that sensor
   subroutine observe_also(assembly, seen, poles, error)
      type(assembly_t), intent(in) :: assembly
      type(poles_t), intent(in) :: seen
      type(poles_t), intent(inout) :: poles
      type(error_t), allocatable, intent(out) :: error

      poles%root = seen%root
      poles%all = seen%all
      poles%vector = seen%vector
      if (allocated(poles%residue)) deallocate (poles%residue)
      allocate (poles%residue(size(poles%root)))
      call residues(assembly, poles, error, known=.true.)
   end subroutine observe_also

   !> Residues of the roots that stand by themselves, and the clusters.
   !>
   !> known  whether the vectors are; default .false.
   subroutine residues(assembly, poles, error, known)
      type(assembly_t), intent(in) :: assembly
      type(poles_t), intent(inout) :: poles
      type(error_t), allocatable, intent(out) :: error
      logical, intent(in), optional :: known
      real(wp) :: undamped(size(poles%root))
      logical, dimension(size(poles%root)) :: near, alone
      integer :: k

      poles%s = poles%root%s
      if (allocated(poles%residue)) then
         if (size(poles%residue) /= size(poles%s)) deallocate (poles%vector, poles%residue)
      end if
      if (.not. allocated(poles%residue)) allocate (poles%vector(size(poles%s)), &
         poles%residue(size(poles%s)))
      do k = 1, size(poles%s)
         if (present(known)) then
            continue
         else if (assembly%is_dense()) then
            call find_whole_vector(assembly, poles%root(k), poles%vector(k))
         else
            call find_vector(assembly, poles%root(k), poles%vector(k))
            call take_part(assembly, poles%root(k), poles%vector(k))
         end if
         associate (vector => poles%vector(k))
            ! |A| of an undamped mode.
            undamped(k) = 2*abs(poles%s(k))*vector%inertia
            near(k) = abs(vector%A) < small_A*undamped(k) .and. &
               .not. is_lost(assembly, vector, poles%s(k))
            alone(k) = abs(vector%A) > smaller_A*undamped(k)
            poles%residue(k) = 0
            if (.not. is_lost(assembly, vector, poles%s(k))) poles%residue(k) = &
               weight(poles%s(k))*vector%y(assembly%sensor) &
               *driven_by(assembly, vector, poles%s(k))/vector%A
         end associate
      end do
      call find_clusters(assembly, poles%all, pack(poles%root, near), pack(alone, near), &
         poles%cluster)
      if (assembly%is_carried .and. minval(abs(poles%s)) <= 1e-12_wp*maxval(abs(poles%s))) then
         call failure(error, 'modal: a hose that drifts on a base that moves; expected k_H > 0')
         return
      end if
      if (assembly%is_carried) poles%cluster = [poles%cluster, base_cluster(assembly, poles%s)]
      do k = 1, size(poles%s)
         if (abs(poles%vector(k)%A) > tiny_A*undamped(k)) cycle
         if (any(poles%cluster%holds(poles%s(k)))) cycle
         if (is_lost(assembly, poles%vector(k), poles%s(k))) cycle
         call failure(error, 'modal: too many roots of the characteristic equation come '// &
            'together near s = '//to_text(real(poles%s(k)))//' + i '//to_text(aimag(poles%s(k))))
         return
      end do
      do k = 1, size(poles%cluster)
         where (poles%cluster(k)%holds(poles%s)) poles%residue = 0
         call measure(assembly, poles%cluster(k))
      end do
      call check_sums(assembly, poles, error)
   end subroutine residues

   !> Whether a root is one of those slow ones that round-off no longer keeps apart, at -E/c_D: of a
   !> mode so overdamped that its residue is 1e-10 of what it would be without.
   pure logical function is_lost(assembly, vector, s)
      type(assembly_t), intent(in) :: assembly
      type(vector_t), intent(in) :: vector
      complex(wp), intent(in) :: s

      ! Its vector may not even be a number.
      is_lost = .not. abs(vector%A) > 2*tiny_A*abs(s)*vector%inertia
      if (is_lost) is_lost = .not. abs(vector%A) > 0 .or. assembly%from_pile(s) <= 1e-10_wp
   end function is_lost

   !> Makes the oscillator with x_j = 1 one that has its share of the motion, after all.
   pure subroutine take_part(assembly, root, vector)
      type(assembly_t), intent(in) :: assembly
      type(root_t), intent(inout) :: root
      type(vector_t), intent(inout) :: vector
      real(wp) :: share(assembly%n)

      share = assembly%pencil(1)%m*(real(vector%x)**2 + aimag(vector%x)**2)
      if (.not. maxval(share) > 16*share(root%j)) return
      root%j = maxloc(share, dim=1)
      call find_vector(assembly, root, vector)
   end subroutine take_part

   !> Whether all roots have been found: the residues add up to zero, and r s to the acceleration
   !> that a unit force causes at once.
   subroutine check_sums(assembly, poles, error)
      type(assembly_t), intent(in) :: assembly
      type(poles_t), intent(inout) :: poles
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: x(assembly%n), y(size(assembly%v, 1)), rest(2), ordinary, at_once
      integer :: k

      call solve_mass(assembly, assembly%load(:, 1, 1), x, y, -assembly%lift)
      poles%impulse = y(assembly%sensor)
      ordinary = abs(dot_product(assembly%load(:, 1, 1), x))
      call solve_mass(assembly, assembly%v(assembly%sensor, :), x, y)
      ! At a rigid support there is no answer: what the beam by itself would do is the measure then.
      associate (mass => assembly%pencil(1)%m, o => assembly%v(assembly%sensor, :), &
         load => assembly%load(:, 1, 1))
         at_once = 1e-6_wp*sqrt(sum(load**2/mass)*sum(o**2/mass))
      end associate
      ordinary = max(sqrt(ordinary*abs(y(assembly%sensor))), at_once) &
         /minval(abs(poles%s), mask=abs(poles%s) > 0)
      associate (r => poles%residue, s => poles%s, cluster => poles%cluster)
         rest(1) = sum(real(r)) + sum([(real(cluster(k)%moments(1)), k=1, size(cluster))])
         rest(2) = sum(real(r*s)) + sum([(real(cluster(k)%moments(2)), k=1, size(cluster))])
         rest(1) = abs(rest(1))/ordinary
         rest(2) = abs(rest(2) - poles%impulse)/(at_once + sum(abs(r*s)) &
            + sum([(abs(cluster(k)%moments(2)), k=1, size(cluster))]))
         if (rest(1) <= max_rest .and. rest(2) <= max_rest_at_once .and. &
            all(cluster%is_complete())) return
      end associate
      call failure(error, 'modal: the roots found leave '//to_text(maxval(rest))// &
         ' of the response open: one was missed')
   end subroutine check_sums

   !> x'F at a root.
   pure complex(wp) function driven_by(assembly, vector, s) result(driven)
      type(assembly_t), intent(in) :: assembly
      type(vector_t), intent(in) :: vector
      complex(wp), intent(in) :: s

      ! Nothing is pushed along the row of a spring: y is the motion where it counts.
      driven = sum(assembly%rest*vector%x) &
         + sum(assembly%push(:, vector%form)*vector%y(:size(assembly%push, 1)))
      if (assembly%is_carried) driven = driven + (sum(assembly%load(:, 2, vector%form)*vector%x) &
         - sum(assembly%lift*vector%f(:size(assembly%lift)))/s)/s
   end function driven_by

   !> Derivatives of poles and residues with respect to the parameters of the assembly.
   !>
   !> also  of the same roots, differentiated before; left out: none
   subroutine differentiate_poles(assembly, poles, also)
      type(assembly_t), intent(in) :: assembly
      type(poles_t), intent(inout) :: poles
      type(poles_t), intent(in), optional :: also
      complex(wp) :: D_all(assembly%n), x_all(assembly%n)
      integer :: k, p, n

      n = size(assembly%parameters)
      if (allocated(poles%ds)) deallocate (poles%ds, poles%dr, poles%dimpulse)
      allocate (poles%ds(size(poles%s), n), poles%dr(size(poles%s), n), poles%dimpulse(n))
      do k = 1, size(poles%cluster)
         if (.not. poles%cluster(k)%knows(assembly%parameters)) &
            call measure(assembly, poles%cluster(k))
      end do
      if (n == 0) return
      if (assembly%is_dense() .and. .not. present(also)) then
         if (allocated(poles%slope)) deallocate (poles%slope)
         allocate (poles%slope(n, size(poles%s)))
      end if
      do k = 1, size(poles%s)
         if (any(poles%cluster%holds(poles%s(k)))) cycle
         if (is_lost(assembly, poles%vector(k), poles%s(k))) then
            poles%ds(k, :) = 0
            poles%dr(k, :) = 0
            cycle
         end if
         if (assembly%is_dense()) then
            if (present(also)) then
               call differentiate_residue(assembly, poles, k, also%slope(:, k))
            else
               call differentiate_vector(assembly, poles%root(k), poles%vector(k), &
                  poles%slope(:, k))
               call differentiate_residue(assembly, poles, k, poles%slope(:, k))
            end if
            cycle
         end if
         do p = 1, n
            call differentiate_root(assembly, poles%root(k), poles%vector(k), p, D_all, x_all, &
               poles%ds(k, p), poles%dr(k, p))
            poles%dr(k, p) = weight(poles%s(k))*poles%dr(k, p)
         end do
      end do
      do k = 1, size(poles%cluster)
         associate (cluster => poles%cluster(k))
            do p = 1, n
               where (cluster%holds(poles%s))
                  poles%ds(:, p) = cluster%dmean(p)
                  poles%dr(:, p) = 0
               end where
            end do
         end associate
      end do
      call differentiate_impulse(assembly, poles%dimpulse)
   end subroutine differentiate_poles

   !> ds/dp and dr/dp of one root: every quantity of `beamid_vectors` differentiated in turn, with
   !> the root as a function of p. Loops rather than matrix products: the matrices are tiny, and a
   !> search comes here hundreds of times.
   !>
   !> D_all, x_all  (n) room to work in
   pure subroutine differentiate_root(assembly, root, vector, p, D_all, x_all, ds, dr)
      type(assembly_t), intent(in) :: assembly
      type(root_t), intent(in) :: root
      type(vector_t), intent(in) :: vector
      integer, intent(in) :: p
      complex(wp), intent(out) :: D_all(:), x_all(:), ds, dr
      complex(wp), dimension(most, most) :: H_p, H_sp, H_all
      complex(wp) :: y_all(most, 1), f_all(most), A_all, force, driven, turned(most)
      integer :: i, k, l, r

      r = size(assembly%v, 1)
      associate (pencil => assembly%pencil(vector%form), x => vector%x, y => vector%y, &
         slope => assembly%slope(vector%form, p), f => vector%f, D => vector%D, &
         v => assembly%v, j => root%j, s => root%s, sensor => assembly%sensor, &
         moves => assembly%moves(:, p), A => assembly%compliance, &
         A_p => assembly%compliance_slope(:, p))
         ds = 0
         do i = 1, assembly%n
            D_all(i) = (slope%m(i)*s + slope%c(i))*s + slope%k(i)
            ds = ds + D_all(i)*x(i)**2
         end do
         do l = 1, r
            do k = 1, r
               H_p(k, l) = (slope%hm(k, l)*s + slope%hc(k, l))*s + slope%hk(k, l)
               H_sp(k, l) = 2*slope%hm(k, l)*s + slope%hc(k, l)
               ds = ds + A(k)*y(k)*H_p(k, l)*y(l)
            end do
            ds = ds - A_p(l)*f(l)*y(l)
         end do
         turned = 0
         do l = 1, r
            if (.not. abs(moves(l)) > 0) cycle
            turned(l) = moves(l)*sum(assembly%v_slope(l, :)*x)
            ds = ds + 2*turned(l)*f(l)
         end do
         ds = -ds/vector%A

         do l = 1, r
            H_all(:r, l) = vector%dH(:r, l)*ds + H_p(:r, l)
         end do
         do k = 1, r
            f_all(k) = sum(H_all(k, :r)*y(:r))
         end do
         do k = 1, r
            y_all(k, 1) = -sum(vector%G(k, :r)*f_all(:r)) - A_p(k)*y(k)
         end do
         do i = 1, assembly%n
            D_all(i) = vector%dD(i)*ds + D_all(i)
            x_all(i) = 0
            if (i == j) cycle
            x_all(i) = x(i)*D_all(i)
            do l = 1, r
               if (abs(moves(l)) > 0) x_all(i) = x_all(i) + moves(l)*assembly%v_slope(l, i)*f(l)
            end do
            x_all(i) = -x_all(i)/D(i)
            y_all(:r, 1) = y_all(:r, 1) + v(:, i)*x_all(i)
         end do
         y_all(:r, 1) = y_all(:r, 1) + turned(:r)
         call solve_coupled(assembly, vector, y_all(:r, :))
         do k = 1, r
            f_all(k) = f_all(k) + sum(vector%H(k, :r)*y_all(:r, 1))
         end do
         A_all = 0
         driven = driven_by(assembly, vector, s)
         do i = 1, assembly%n
            force = sum(v(:, i)*f_all(:r))
            if (i /= j) x_all(i) = x_all(i) - force/D(i)
            A_all = A_all + (2*(pencil%m(i)*ds + slope%m(i)*s) + slope%c(i))*x(i)**2 &
               + 2*vector%dD(i)*x(i)*x_all(i)
         end do
         dr = sum(assembly%rest*x_all) + sum(assembly%rest_slope(:, p)*x) &
            + sum(assembly%push(:, vector%form)*y_all(:r, 1)) &
            + sum(assembly%push_slope(:, vector%form, p)*y(:r))
         do l = 1, r
            do k = 1, r
               A_all = A_all + A(k)*y(k)*((2*pencil%hm(k, l)*ds + H_sp(k, l))*y(l) &
                  + 2*vector%dH(k, l)*y_all(l, 1))
            end do
            A_all = A_all + A_p(l)*y(l)**2*vector%dH(l, l)
         end do
         if (assembly%is_carried) dr = dr + carried(assembly, vector, p, s, ds, x_all, f_all)
         dr = (y_all(sensor, 1)*driven + y(sensor)*dr - y(sensor)*driven/vector%A*A_all)/vector%A
      end associate
   end subroutine differentiate_root

   !> dr/dp of root k from the derivatives of its vector.
   subroutine differentiate_residue(assembly, poles, k, slopes)
      type(assembly_t), intent(in) :: assembly
      type(poles_t), intent(inout) :: poles
      integer, intent(in) :: k
      type(vector_slope_t), intent(in) :: slopes(:)
      complex(wp) :: driven, driven_p
      integer :: p, r

      r = size(assembly%v, 1)
      associate (vector => poles%vector(k), s => poles%s(k))
         driven = driven_by(assembly, vector, s)
         do p = 1, size(slopes)
            associate (by => slopes(p))
               driven_p = sum(assembly%rest*by%x) + sum(assembly%rest_slope(:, p)*vector%x) &
                  + sum(assembly%push(:, vector%form)*by%y) &
                  + sum(assembly%push_slope(:, vector%form, p)*vector%y(:r))
               if (assembly%is_carried) driven_p = driven_p + carried(assembly, vector, p, s, &
                  by%s, by%x, by%f)
               poles%ds(k, p) = by%s
               poles%dr(k, p) = weight(s)*(by%y(assembly%sensor)*driven &
                  + vector%y(assembly%sensor)*(driven_p - driven*by%A/vector%A))/vector%A
            end associate
         end do
      end associate
   end subroutine differentiate_residue

   !> The derivative of x'F that velocity and displacement of the base add.
   pure complex(wp) function carried(assembly, vector, p, s, ds, x_all, f_all)
      type(assembly_t), intent(in) :: assembly
      type(vector_t), intent(in) :: vector
      integer, intent(in) :: p
      complex(wp), intent(in) :: s, ds, x_all(:), f_all(:)

      associate (load => assembly%load(:, 2, vector%form), r => size(assembly%lift), &
         load_p => assembly%load_slope(:, 2, vector%form, p))
         carried = (sum(load_p*vector%x) + sum(load*(x_all - vector%x*ds/s)) &
            - sum(assembly%lift*(f_all(:r) - 2*vector%f(:r)*ds/s))/s)/s
      end associate
   end function carried

   !> Derivatives of o' M**-1 F: -(M**-1 o)' M_p (M**-1 F), with what moves and a load that changes.
   subroutine differentiate_impulse(assembly, slopes)
      type(assembly_t), intent(in) :: assembly
      real(wp), intent(out) :: slopes(:)
      real(wp), dimension(assembly%n) :: o, x
      real(wp), dimension(size(assembly%v, 1)) :: yo, yx, seen
      real(wp) :: hm(size(assembly%v, 1), size(assembly%v, 1))
      integer :: p

      hm = assembly%mass_couplings()
      call solve_mass(assembly, assembly%v(assembly%sensor, :), o, yo)
      call solve_mass(assembly, assembly%load(:, 1, 1), x, yx, -assembly%lift)
      do p = 1, size(slopes)
         associate (slope => assembly%slope(1, p), moves => assembly%moves(:, p), &
            d => assembly%v_slope)
            slopes(p) = -sum(o*slope%m*x) - dot_product(yo, matmul(slope%hm, yx)) &
               + dot_product(o, assembly%load_slope(:, 1, 1, p))
            if (.not. any(abs(moves) > 0)) cycle
            seen = moves*matmul(d, x)
            slopes(p) = slopes(p) + seen(assembly%sensor) - dot_product(yo, matmul(hm, seen)) &
               - dot_product(moves*matmul(d, o), matmul(hm, yx))
         end associate
      end do
   end subroutine differentiate_impulse

   !> 2 for one of a pair, 1 for a real root.
   pure real(wp) function weight(s)
      complex(wp), intent(in) :: s

      weight = merge(2.0_wp, 1.0_wp, abs(aimag(s)) > 0)
   end function weight

end module beamid_poles
