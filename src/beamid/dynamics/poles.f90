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
   use beamid_continuation, only: all_of, follow_roots
   use beamid_contours, only: measure
   use beamid_errors, only: error_t, failure, status_failed
   use beamid_kinds, only: wp
   use beamid_parameters, only: as_named, parameters
   use beamid_roots, only: find_others, find_roots
   use beamid_strings, only: to_text
   use beamid_structure, only: is_coefficient, n_parameters, structure_t
   use beamid_structure_checks, only: furthest_parameter
   use beamid_systems, only: differentiate_vector, find_whole_vector, vector_slope_t
   use beamid_terms, only: operators
   use beamid_vectors, only: add_answer, find_vector, most, root_t, solve_coupled, solve_mass, &
      vector_t
   implicit none
   private

   public :: poles_t, find_poles, observe_also, differentiate_poles

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
      real(wp), allocatable :: pushed(:, :)   !< (n + r, 2) M**-1 F and M**-1 o, by x and y
      !> (poles, parameters) d s/d parameter; in a cluster that of the mean of its roots
      complex(wp), allocatable :: ds(:, :)
      complex(wp), allocatable :: dr(:, :)        !< (poles, parameters) d residue/d parameter
      real(wp), allocatable :: dimpulse(:)        !< (parameters)
      type(vector_t), allocatable :: vector(:)    !< of each root
      integer, allocatable :: parameters(:)       !< of the derivatives
      real(wp), allocatable :: values(:)          !< of these parameters
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
      type(root_t), allocatable :: moved(:)
      logical, allocatable :: followed(:)
      logical :: found
      integer :: way

      if (allocated(poles%all)) then
         moved = poles%root
         moved%s = predicted(assembly, poles)
         if (allocated(poles%values)) deallocate (poles%values)    ! of other roots, from here on
         allocate (followed(size(moved)))
         call follow_roots(assembly, moved, poles%vector, followed)
         found = all(followed)
         if (found) then
            poles%root = moved
            poles%all = all_of(assembly, moved)
         else if (4*count(.not. followed) <= size(moved) .and. .not. assembly%is_dense()) then
            ! Of many that went astray a start of their own is the shorter way.
            call find_others(assembly, moved, followed, poles%all, poles%root, found)
            if (found) call find_vectors(assembly, poles)
         end if
         if (found) then
            call residues(assembly, poles, error)
            if (.not. allocated(error)) return
            deallocate (error)
         end if
      end if
      ! By the characteristic equation, or from eigenvalues of the matrices.
      do way = 1, 2
         call find_roots(assembly, poles%all, poles%root, error, from_matrix=way == 2)
         if (.not. allocated(error)) call find_vectors(assembly, poles)
         if (.not. allocated(error)) call residues(assembly, poles, error)
         if (.not. allocated(error)) return
         if (allocated(poles%all)) deallocate (poles%all)
      end do
      call blame(assembly%structure, error)
   end subroutine find_poles

   !> Where the derivatives of the last structure's roots say that they are now, as if what makes
   !> them were powers of the parameters: the real roots of overdamped modes nearly are, and of a
   !> pair the square of its modulus and its real part.
   pure function predicted(assembly, poles) result(s)
      type(assembly_t), intent(in) :: assembly
      type(poles_t), intent(in) :: poles
      complex(wp), dimension(size(poles%root)) :: s, change, rest
      real(wp) :: new(size(assembly%parameters)), square, half
      integer :: k, p

      s = poles%root%s
      if (.not. allocated(poles%values)) return
      if (size(poles%values) /= size(assembly%parameters)) return
      if (any(poles%parameters /= assembly%parameters)) return
      new = values_of(assembly)
      change = 0
      rest = 0
      do p = 1, size(new)
         associate (old => poles%values(p))
            if (min(new(p), old) > 0) then
               change = change + poles%ds(:, p)*(old*log(new(p)/old))
            else
               rest = rest + poles%ds(:, p)*(new(p) - old)
            end if
         end associate
      end do
      do k = 1, size(s)
         if (abs(aimag(s(k))) > 0) then
            square = real(s(k))**2 + aimag(s(k))**2
            square = abs(power(square, 2*real(conjg(s(k))*change(k))) + 2*real(conjg(s(k))*rest(k)))
            half = power(real(s(k)), real(change(k))) + real(rest(k))
            ! What becomes overdamped is near the axis, a little above it.
            s(k) = cmplx(half, sqrt(max(square - half**2, 1e-4_wp*square)), wp)
         else
            s(k) = power(real(s(k)), real(change(k))) + real(rest(k))
         end if
      end do
   end function predicted

   !> x changed by `change` to first order, as a power: by a factor of twenty at most.
   pure real(wp) function power(x, change)
      real(wp), intent(in) :: x, change

      power = x + change
      if (abs(x) > 0) power = x*exp(max(-3.0_wp, min(change/x, 3.0_wp)))
   end function power

   !> Values of the parameters of an assembly; of one that is none of the structure 0.
   pure function values_of(assembly) result(values)
      type(assembly_t), intent(in) :: assembly
      real(wp) :: values(size(assembly%parameters))
      integer :: p

      values = 0
      do p = 1, size(values)
         associate (k => assembly%parameters(p))
            if (k <= n_parameters .or. is_coefficient(k)) values(p) = assembly%structure%get(k)
         end associate
      end do
   end function values_of

   subroutine find_vectors(assembly, poles)
      type(assembly_t), intent(in) :: assembly
      type(poles_t), intent(inout) :: poles
      integer :: k

      if (allocated(poles%vector)) then
         if (size(poles%vector) /= size(poles%root)) deallocate (poles%vector)
      end if
      if (.not. allocated(poles%vector)) allocate (poles%vector(size(poles%root)))
      do k = 1, size(poles%root)
         if (assembly%is_dense()) then
            call find_whole_vector(assembly, poles%root(k), poles%vector(k))
         else
            call find_vector(assembly, poles%root(k), poles%vector(k))
         end if
      end do
   end subroutine find_vectors

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
      call residues(assembly, poles, error)
   end subroutine observe_also

   !> Residues of the roots that stand by themselves, and the clusters.
   subroutine residues(assembly, poles, error)
      type(assembly_t), intent(in) :: assembly
      type(poles_t), intent(inout) :: poles
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: undamped(size(poles%root))
      logical, dimension(size(poles%root)) :: near, alone
      integer :: k

      poles%s = poles%root%s
      poles%residue = poles%s
      do k = 1, size(poles%s)
         if (.not. assembly%is_dense()) call take_part(assembly, poles%root(k), poles%vector(k))
         associate (vector => poles%vector(k))
            ! |A| of an undamped mode.
            undamped(k) = 2*abs(poles%s(k))*vector%inertia
            near(k) = .not. (abs(vector%A) >= small_A*undamped(k) .or. &
               is_lost(assembly, vector, poles%s(k)))
            alone(k) = abs(vector%A) > smaller_A*undamped(k)
            poles%residue(k) = 0
            ! Of an exact double root there is none, a cluster holds it.
            if (abs(vector%A) > 0 .and. .not. is_lost(assembly, vector, poles%s(k))) &
               poles%residue(k) = weight(poles%s(k))*vector%y(assembly%sensor) &
                  *driven_by(assembly, vector, poles%s(k))/vector%A
         end associate
      end do
      call find_clusters(assembly, poles%all, pack(poles%root, near), pack(alone, near), &
         poles%cluster)
      if (assembly%feels_base .and. minval(abs(poles%s)) <= 1e-12_wp*maxval(abs(poles%s))) then
         call failure(error, 'modal: a hose that drifts on a base that moves; expected k_H > 0')
         return
      end if
      if (assembly%feels_base) poles%cluster = [poles%cluster, base_cluster(assembly, poles%s)]
      do k = 1, size(poles%s)
         if (abs(poles%vector(k)%A) > tiny_A*undamped(k)) cycle
         if (any(poles%cluster%holds(poles%s(k)))) cycle
         if (is_lost(assembly, poles%vector(k), poles%s(k))) cycle
         call refuse_roots('more roots of the characteristic equation than can be '// &
            'told apart', poles%s(k), error)
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

      ! Its vector may not even be a number; A alone may vanish at an ordinary double root too.
      is_lost = .not. abs(vector%A) > 2*tiny_A*abs(s)*vector%inertia
      if (is_lost) is_lost = assembly%from_pile(s) <= 1e-10_wp
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
      real(wp) :: rest(2), ordinary, at_once
      integer :: k, n

      n = assembly%n
      if (allocated(poles%pushed)) deallocate (poles%pushed)
      allocate (poles%pushed(n + size(assembly%v, 1), 2))
      associate (x => poles%pushed(:n, :), y => poles%pushed(n + 1:, :))
         x(:, 1) = assembly%load(:, 1, 1)
         x(:, 2) = assembly%vt(:, assembly%sensor)
         call solve_mass(assembly, x, y, -assembly%base_coupling)
         poles%impulse = y(assembly%sensor, 1)
         ordinary = abs(dot_product(assembly%load(:, 1, 1), x(:, 1)))*abs(y(assembly%sensor, 2))
      end associate
      ! At a rigid support there is no answer: what the beam by itself would do is the measure then.
      associate (mass => assembly%pencil(1)%m, o => assembly%v(assembly%sensor, :), &
         load => assembly%load(:, 1, 1))
         at_once = 1e-6_wp*sqrt(sum(load**2/mass)*sum(o**2/mass))
      end associate
      ordinary = max(sqrt(ordinary), at_once) &
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
      k = minloc(abs(poles%s), dim=1)
      call refuse_roots('not all roots of the characteristic equation were found, the '// &
         'lowest', poles%s(k), error)
   end subroutine check_sums

   !> Reports that something is wrong with the roots.
   !>
   !> what  the first half of a sentence
   !> s     the root where that shows [1/time]
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

   !> Adds the parameter that is furthest out of proportion, if any is, to an error.
   subroutine blame(structure, error)
      type(structure_t), intent(in) :: structure
      type(error_t), intent(inout) :: error
      integer :: k

      k = furthest_parameter(structure)
      if (k > 0 .and. error%status == status_failed) error%message = error%message//'; '// &
         trim(parameters(k)%name)//' = '//to_text(as_named(k, structure%get(k)))// &
         ' is out of proportion to the beam'
   end subroutine blame

   !> x'F at a root.
   pure complex(wp) function driven_by(assembly, vector, s) result(driven)
      type(assembly_t), intent(in) :: assembly
      type(vector_t), intent(in) :: vector
      complex(wp), intent(in) :: s
      integer :: i

      ! Nothing is pushed along the row of a spring: y is the motion where it counts.
      driven = 0
      do i = 1, assembly%n
         driven = driven + assembly%rest(i)*vector%x(i)
      end do
      do i = 1, size(assembly%push, 1)
         driven = driven + assembly%push(i, vector%form)*vector%y(i)
      end do
      if (assembly%feels_base) driven = driven + (sum(assembly%load(:, 2, vector%form)*vector%x) &
         - sum(assembly%base_coupling*vector%f(:size(assembly%base_coupling)))/s)/s
   end function driven_by

   !> Derivatives of poles and residues with respect to the parameters of the assembly.
   !>
   !> also  of the same roots, differentiated before; left out: none
   subroutine differentiate_poles(assembly, poles, also)
      type(assembly_t), intent(in) :: assembly
      type(poles_t), intent(inout) :: poles
      type(poles_t), intent(in), optional :: also
      complex(wp), dimension(size(assembly%parameters)) :: ds, dr
      integer :: k, p, n

      n = size(assembly%parameters)
      if (allocated(poles%ds)) deallocate (poles%ds, poles%dr, poles%dimpulse)
      allocate (poles%ds(size(poles%s), n), poles%dr(size(poles%s), n), poles%dimpulse(n))
      do k = 1, size(poles%cluster)
         if (.not. poles%cluster(k)%knows(assembly%parameters)) &
            call measure(assembly, poles%cluster(k))
      end do
      poles%parameters = assembly%parameters
      poles%values = values_of(assembly)
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
         call differentiate_root(assembly, poles%root(k), poles%vector(k), ds, dr)
         poles%ds(k, :) = ds
         poles%dr(k, :) = weight(poles%s(k))*dr
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
      call differentiate_impulse(assembly, poles%pushed, poles%dimpulse)
   end subroutine differentiate_poles

   !> ds/dp and dr/dp of one root.
   !>
   !> With Q = s**2 M + s C + K and the total derivative Q' = Q_p + (2 s M + C) ds/dp the vector's
   !> own is x' = -Q**-1 Q'x with x_j' = 0. It is not needed by itself: the derivative of
   !> r = (o'x)(x'F)/A is g'x', and with Q z = g, z_j = 0, that is -z'Q'x. z is as many oscillators
   !> and rows w as x and y are, whatever the number of parameters.
   pure subroutine differentiate_root(assembly, root, vector, ds, dr)
      type(assembly_t), intent(in) :: assembly
      type(root_t), intent(in) :: root
      type(vector_t), intent(in) :: vector
      complex(wp), intent(out) :: ds(:), dr(:)
      complex(wp) :: z(assembly%n)
      complex(wp), dimension(most) :: w, mu, turned, dHy
      complex(wp), dimension(size(operators)) :: xx, xz
      complex(wp) :: seen, driven, r, along, x_x, x_z, hmy
      integer :: c, i, p, l, rows

      rows = size(assembly%v, 1)
      c = size(assembly%changing)
      associate (x => vector%x, y => vector%y(:rows), f => vector%f(:rows), s => root%s, &
         form => vector%form, hm => assembly%pencil(vector%form)%hm, A => assembly%compliance, &
         dH => vector%dH, m => assembly%pencil(1)%m)
         driven = driven_by(assembly, vector, s)
         seen = y(assembly%sensor)/vector%A
         r = seen*driven/vector%A
         call adjoint(assembly, root, vector, seen, driven/vector%A, z, w(:rows), mu(:rows))
         call assembly%products(form, x, y, x, y, xx(:c))
         call assembly%products(form, x, y, z, w(:rows), xz(:c))
         ! What goes with ds/dp, from Q' and from A and F, which know s by themselves.
         along = 0
         do i = 1, assembly%n
            along = along - x(i)*(vector%dD(i)*z(i) + 2*m(i)*(r*x(i)))
         end do
         do i = 1, rows
            dHy(i) = 0
            hmy = 0
            do l = 1, rows
               dHy(i) = dHy(i) + dH(i, l)*y(l)
               hmy = hmy + hm(i, l)*y(l)
            end do
            along = along - A(i)*(w(i)*dHy(i) + 2*r*y(i)*hmy)
         end do
         if (assembly%feels_base) along = along - seen*(sum(assembly%load(:, 2, form)*x) &
            - 2*sum(assembly%base_coupling*f)/s)/s**2
         do p = 1, size(ds)
            associate (A_p => assembly%compliance_slope(:, p), moves => assembly%moves(:, p))
               x_x = assembly%varied(xx(:c), s, p)
               x_z = assembly%varied(xz(:c), s, p) + r*assembly%grown(xx(:c), s, p)
               if (any(abs(A_p) > 0)) then
                  x_x = x_x - sum(A_p*f*y)
                  x_z = x_z - sum(A_p*f*w(:rows)) - r*sum(A_p*y*dHy(:rows))
               end if
               if (any(abs(moves) > 0)) then
                  turned = 0
                  do l = 1, rows
                     if (abs(moves(l)) > 0) turned(l) = moves(l)*sum(assembly%v_slope(l, :)*x)
                  end do
                  x_x = x_x + 2*sum(turned(:rows)*f)
                  x_z = x_z + sum(turned(:rows)*mu(:rows)) &
                     + sum(moves*matmul(assembly%v_slope, z)*f)
               end if
               ds(p) = -x_x/vector%A
               dr(p) = along*ds(p) - x_z + seen*assembly%load_change(form, x, y, s, p)
            end associate
         end do
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
               if (assembly%feels_base) driven_p = driven_p &
                  + base_load_change(assembly, vector, p, s, by%s, by%x, by%f)
               poles%ds(k, p) = by%s
               poles%dr(k, p) = weight(s)*(by%y(assembly%sensor)*driven &
                  + vector%y(assembly%sensor)*(driven_p - driven*by%A/vector%A))/vector%A
            end associate
         end do
      end associate
   end subroutine differentiate_residue

   !> The derivative of x'F that velocity and displacement of the base add.
   pure complex(wp) function base_load_change(assembly, vector, p, s, ds, x_all, f_all)
      type(assembly_t), intent(in) :: assembly
      type(vector_t), intent(in) :: vector
      integer, intent(in) :: p
      complex(wp), intent(in) :: s, ds, x_all(:), f_all(:)

      associate (load => assembly%load(:, 2, vector%form), r => size(assembly%base_coupling))
         base_load_change = (sum(assembly%velocity_load_slope(:, p)*vector%x) &
            + sum(load*(x_all - vector%x*ds/s)) &
            - sum(assembly%base_coupling*(f_all(:r) - 2*vector%f(:r)*ds/s))/s)/s
      end associate
   end function base_load_change

   !> What x'(2 s M + C) x, o'x and x'F make of a change of the vector, through Q**-1.
   !>
   !> seen, driven  o'x/A and x'F/A
   !> z, w          as x and y of a vector, z_j = 0
   !> mu            the force along the rows, as f of a vector
   pure subroutine adjoint(assembly, root, vector, seen, driven, z, w, mu)
      type(assembly_t), intent(in) :: assembly
      type(root_t), intent(in) :: root
      type(vector_t), intent(in) :: vector
      complex(wp), intent(in) :: seen, driven
      complex(wp), intent(out) :: z(:), w(:), mu(:)
      complex(wp) :: force
      integer :: i, l

      associate (v => assembly%v, y => vector%y, G => vector%G, H => vector%H, dH => vector%dH)
         w = 0
         if (assembly%feels_base) w = seen*assembly%base_coupling/root%s**2
         do l = 1, size(w)
            mu(l) = seen*(assembly%push(l, vector%form) - 2*driven*sum(dH(:, l)*y(:size(w))))
         end do
         mu(assembly%sensor) = mu(assembly%sensor) + driven
         call unloaded(assembly%n, size(w), seen, 2*seen*driven, assembly%rest, vector%dD, &
            vector%x, vector%inverse, assembly%v, z, w)
         if (assembly%feels_base) then
            do i = 1, assembly%n
               force = seen*assembly%load(i, 2, vector%form)/root%s*vector%inverse(i)
               z(i) = z(i) + force
               w = w + v(:, i)*force
            end do
         end if
         do l = 1, size(w)
            w(l) = w(l) + sum(G(:, l)*mu)
         end do
         call solve_coupled(assembly, vector, w)
         do l = 1, size(w)
            mu(l) = sum(H(:, l)*w) - mu(l)
         end do
         call add_answer(assembly%n, size(w), assembly%vt, mu, vector%inverse, z)
      end associate
   end subroutine adjoint

   !> z = D**-1 (a load - b D'x), and V'z added to w.
   pure subroutine unloaded(n, r, a, b, load, dD, x, inverse, v, z, w)
      integer, intent(in) :: n, r
      complex(wp), intent(in) :: a, b, dD(n), x(n), inverse(n)
      real(wp), intent(in) :: load(n), v(r, n)
      complex(wp), intent(out) :: z(n)
      complex(wp), intent(inout) :: w(r)
      integer :: i, l

      do i = 1, n
         z(i) = (a*load(i) - b*dD(i)*x(i))*inverse(i)
         do l = 1, r
            w(l) = w(l) + v(l, i)*z(i)
         end do
      end do
   end subroutine unloaded

   !> Derivatives of o' M**-1 F: -(M**-1 o)' M_p (M**-1 F), with what moves and a load that changes.
   !>
   !> pushed  (n + r, 2) M**-1 F and M**-1 o
   subroutine differentiate_impulse(assembly, pushed, slopes)
      type(assembly_t), intent(in) :: assembly
      real(wp), intent(in) :: pushed(:, :)
      real(wp), intent(out) :: slopes(:)
      real(wp), dimension(size(assembly%v, 1)) :: seen, loaded
      real(wp) :: hm(size(assembly%v, 1), size(assembly%v, 1))
      complex(wp) :: moved(size(assembly%changing))
      integer :: n, p

      n = assembly%n
      associate (x => pushed(:n, 1), yx => pushed(n + 1:, 1), o => pushed(:n, 2), &
         yo => pushed(n + 1:, 2), d => assembly%v_slope)
         call assembly%products(1, cmplx(x, kind=wp), cmplx(yx, kind=wp), cmplx(o, kind=wp), &
            cmplx(yo, kind=wp), moved)
         do p = 1, size(slopes)
            associate (moves => assembly%moves(:, p))
               slopes(p) = -sum(assembly%change(1, :, p)*real(moved)) &
                  + sum(assembly%rest_slope(:, p)*o) + sum(assembly%push_slope(:, 1, p)*yo)
               if (.not. any(abs(moves) > 0)) cycle
               hm = assembly%mass_couplings()
               loaded = matmul(hm, yx) - assembly%push(:, 1)
               seen = moves*matmul(d, x)
               slopes(p) = slopes(p) + seen(assembly%sensor) - dot_product(yo, matmul(hm, seen)) &
                  - dot_product(moves*matmul(d, o), loaded)
            end associate
         end do
      end associate
   end subroutine differentiate_impulse

   !> 2 for one of a pair, 1 for a real root.
   pure real(wp) function weight(s)
      complex(wp), intent(in) :: s

      weight = merge(2.0_wp, 1.0_wp, abs(aimag(s)) > 0)
   end function weight

end module beamid_poles
