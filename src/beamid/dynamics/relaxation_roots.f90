!> The real roots of a structure that its relaxations add, one for each mode of the beam and each
!> relaxation: motions that creep, like e**(s t) with s between -b and the point a where the modulus
!> E phi(s) vanishes (`beamid_relaxations`). Those of the higher modes accumulate at a.
!>
!> At a itself, Q is a matrix R of inertia, air and attachments alone. Near a, Q = R + phi B, where
!> B is the bending stiffness, so that -phi is an eigenvalue of R x = -phi B x. Its reciprocals are
!> the eigenvalues of B**(1/2) R**-1 B**(1/2), the largest of which belong to the roots next to a.
!> Newton's method removes what R depends on s.
module beamid_relaxation_roots
   use beamid_assembly, only: assembly_t, root_t
   use beamid_errors, only: error_t, failure
   use beamid_kinds, only: wp
   use beamid_oscillators, only: oscillators_t
   use beamid_relaxations, only: relaxation_t
   use beamid_starting_roots, only: solve_symmetric
   use beamid_systems, only: factor_balanced, improve_root, solve_balanced, system_at
   use beamid_vectors, only: find_vector, vector_t
   implicit none
   private

   public :: continue_relaxation_roots, find_relaxation_roots, restart_root, shares_of

contains

   !> Finds all relaxation roots.
   !>
   !> roots  relative to poles of the relaxation, by relaxations; size 0: nothing relaxes
   !> error  LAPACK fails
   subroutine find_relaxation_roots(assembly, roots, error)
      type(assembly_t), intent(in) :: assembly
      type(root_t), allocatable, intent(out) :: roots(:)
      type(error_t), allocatable, intent(out) :: error
      type(root_t) :: root
      integer :: i, l, m

      allocate (roots(0))
      do l = 1, assembly%oscillators%relaxation%n
         if (assembly%couplings%vanish() .and. .not. assembly%is_dense()) then
            do i = 1, assembly%layout%n
               if (.not. assembly%oscillators%relaxes(i)) cycle
               root = root_t(i, i, 2 + l, s=assembly%oscillators%pole(i, 2 + l))
               roots = [roots, root]
            end do
         else
            m = size(roots)
            call add_starting_points(assembly, l, roots, error)
            if (allocated(error)) return
            do i = m + 1, size(roots)
               call polish(assembly, roots(:i - 1), roots(i))
            end do
         end if
      end do
   end subroutine find_relaxation_roots

   !> Returns where relaxation roots lie relative to their poles: (a - s)/(s + b) of the root,
   !> divided by the same quotient of its pole `origin`. The shares of similar structures are
   !> nearly equal, however closely their roots accumulate at a.
   pure function shares_of(oscillators, roots) result(shares)
      type(oscillators_t), intent(in) :: oscillators
      type(root_t), intent(in) :: roots(:)   !< any; those of no relaxation are ignored
      real(wp) :: shares(count(roots%side > 2))
      integer :: i, k

      k = 0
      do i = 1, size(roots)
         if (roots(i)%side <= 2) cycle
         k = k + 1
         associate (origin => roots(i)%origin, l => roots(i)%side - 2, &
            offset => real(roots(i)%offset))
            associate (creep => oscillators%creep(origin, l), rise => oscillators%rise(origin, l))
               shares(k) = (1 + offset/creep)/(1 + offset/rise)
            end associate
         end associate
      end do
   end function shares_of

   !> Follows the relaxation roots of a similar structure to those of this one.
   !>
   !> known   roots of the similar structure; those of no relaxation are ignored
   !> shares  from `shares_of` for that structure
   !> roots   of this structure, if found
   !> vector  (roots) in: arrays to be reused; out: eigenvectors, if found
   !> found   whether as many different roots as the structure has were found
   subroutine continue_relaxation_roots(assembly, known, shares, roots, vector, found)
      type(assembly_t), intent(in) :: assembly
      type(root_t), intent(in) :: known(:)
      real(wp), intent(in) :: shares(:)
      type(root_t), allocatable, intent(out) :: roots(:)
      type(vector_t), intent(inout) :: vector(:)
      logical, intent(out) :: found
      real(wp) :: odds
      integer :: k, number

      roots = pack(known, known%side > 2)
      number = min(relaxing_modes(assembly), count(assembly%oscillators%relaxes))
      found = .not. (assembly%is_dense() .or. assembly%couplings%vanish()) .and. &
         size(roots) == number*assembly%oscillators%relaxation%n .and. size(roots) == size(shares)
      if (found) found = all(roots%j <= assembly%layout%n .and. roots%origin <= assembly%layout%n)
      do k = 1, size(roots)
         if (.not. found) return
         associate (of => assembly%oscillators, root => roots(k))
            associate (l => root%side - 2, i => root%origin)
               found = l == 1 + (k - 1)/number .and. of%relaxes(i)
               if (.not. found) return
               odds = -of%creep(i, l)/of%rise(i, l)*shares(k)
               found = odds > -1
               if (.not. found) return
               call anchor(of, l, -of%relaxation%lag(l)*odds/(1 + odds), &
                  of%relaxation%lag(l)/(1 + odds), root)
               call follow_newton(assembly, root, vector(k), found)
               if (found) found = is_inside(of%relaxation, l, real(root%s)) .and. .not. &
                  is_among(of, roots(:k - 1), root)
            end associate
         end associate
      end do
   end subroutine continue_relaxation_roots

   !> Returns the number of roots of each relaxation: the dimension of the motions that bend the
   !> beam and that rigid springs allow.
   pure integer function relaxing_modes(assembly) result(number)
      type(assembly_t), intent(in) :: assembly
      integer :: free, k

      associate (beam => assembly%layout%beam, rigid => assembly%couplings%rigid)
         number = count(assembly%oscillators%relaxes)
         free = beam - number
         associate (rows => assembly%layout%v(pack([(k, k=1, size(rigid))], rigid), :free))
            ! A rigid spring holds a motion as a rigid body if it can.
            number = number - size(rows, 1) + rank_of(rows)
         end associate
      end associate
   end function relaxing_modes

   !> Returns the rank of a matrix of at most two columns.
   pure integer function rank_of(a) result(rank)
      real(wp), intent(in) :: a(:, :)
      real(wp), parameter :: negligible = 1e-10_wp
      integer :: i, j

      rank = 0
      if (size(a) == 0) return
      if (any(abs(a) > 0)) rank = 1
      if (size(a, 2) < 2) return
      do i = 1, size(a, 1)
         do j = 1, i - 1
            if (abs(a(i, 1)*a(j, 2) - a(i, 2)*a(j, 1)) > negligible*norm2(a(i, :))*norm2(a(j, :))) &
               rank = 2
         end do
      end do
   end function rank_of

   !> Adds a starting point for each root of a relaxation.
   !>
   !> l      number of the relaxation
   !> roots  in and out
   !> error  LAPACK fails
   subroutine add_starting_points(assembly, l, roots, error)
      type(assembly_t), intent(in) :: assembly
      integer, intent(in) :: l
      type(root_t), allocatable, intent(inout) :: roots(:)
      type(error_t), allocatable, intent(out) :: error
      complex(wp), dimension(assembly%layout%n + assembly%layout%r, &
         assembly%layout%n + assembly%layout%r) :: P, dP
      complex(wp) :: x(size(P, 1), count(assembly%oscillators%relaxed(:, l) > 0))
      real(wp), dimension(size(P, 1)) :: rows, columns
      real(wp), dimension(size(x, 2), size(x, 2)) :: T, unit
      real(wp) :: theta(size(x, 2)), creep, rise
      integer :: pivots(size(P, 1)), modes(size(x, 2)), i, k, m
      type(root_t) :: root
      logical :: waiting(size(x, 2))

      modes = pack([(i, i=1, assembly%layout%n)], assembly%oscillators%relaxed(:, l) > 0)
      associate (of => assembly%oscillators, k_at => assembly%oscillators%k(modes), &
         point => assembly%oscillators%relaxation%point(l))
         ! The pole next to a keeps the digits of the others.
         i = modes(minloc(abs(of%creep(modes, l)), dim=1))
         root = root_t(i, i, 2 + l, cmplx(-of%creep(i, l), kind=wp), cmplx(point, kind=wp))
         call system_at(assembly, root, P, dP)
         call factor_balanced(P, pivots, rows, columns)
         x = 0
         unit = 0
         do i = 1, size(modes)
            x(modes(i), i) = 1
            unit(i, i) = 1
         end do
         call solve_balanced(P, pivots, rows, columns, x)
         do i = 1, size(modes)
            T(:, i) = sqrt(k_at)*real(x(modes, i))*sqrt(k_at(i))
         end do
         T = (T + transpose(T))/2
         call solve_symmetric(T, unit, theta, error)
         if (allocated(error)) then
            deallocate (error)
            call failure(error, 'modal: LAPACK finds no relaxation roots')
            return
         end if
         waiting = .true.
         do m = 1, min(relaxing_modes(assembly), size(modes))
            k = maxloc(abs(theta), dim=1, mask=waiting)
            waiting(k) = .false.
            ! Where the inertia outweighs the rest, R grows like s**2.
            call of%relaxation%find_root(l, [0.0_wp, 1/(theta(k)*point**2)], creep, rise)
            root%j = modes(maxloc(abs(T(:, k)), dim=1))
            call anchor(of, l, creep, rise, root)
            roots = [roots, root]
         end do
      end associate
   end subroutine add_starting_points

   !> Stores a point relative to the nearest pole of a relaxation.
   !>
   !> creep, rise  distances of the point from a and from -b [1/time]
   !> root         in: j; out: all other components
   pure subroutine anchor(oscillators, l, creep, rise, root)
      type(oscillators_t), intent(in) :: oscillators
      integer, intent(in) :: l
      real(wp), intent(in) :: creep, rise
      type(root_t), intent(inout) :: root
      integer :: i

      i = minloc(abs(oscillators%creep(:, l) - creep), dim=1, mask=oscillators%relaxed(:, l) > 0)
      root%origin = i
      root%side = 2 + l
      root%s = oscillators%relaxation%point(l) + creep
      if (abs(creep) < rise) then
         root%offset = creep - oscillators%creep(i, l)
      else
         root%offset = rise - oscillators%rise(i, l)
      end if
   end subroutine anchor

   !> Improves a relaxation root by Newton's method. If this ends elsewhere or the assembly is
   !> dense, by inverse iteration. A root that does not converge keeps its starting point.
   !>
   !> others  roots that were found before
   subroutine polish(assembly, others, root)
      type(assembly_t), intent(in) :: assembly
      type(root_t), intent(in) :: others(:)
      type(root_t), intent(inout) :: root
      type(root_t) :: start
      type(vector_t) :: vector
      logical :: converged

      start = root
      converged = .false.
      if (.not. assembly%is_dense()) call follow_newton(assembly, root, vector, converged)
      if (converged) converged = .not. is_among(assembly%oscillators, others, root)
      if (converged) return
      root = start
      call improve_root(assembly, root)
      if (.not. assembly%oscillators%relaxes(root%j)) root%j = start%j
      if (.not. is_inside(assembly%oscillators%relaxation, root%side - 2, real(root%s))) &
         root = start
   end subroutine polish

   !> Improves a relaxation root from another starting point, by inverse iteration.
   !>
   !> s     the starting point [1/time]
   !> root  in: of the same relaxation; out: the root near s
   subroutine restart_root(assembly, s, root)
      type(assembly_t), intent(in) :: assembly
      real(wp), intent(in) :: s
      type(root_t), intent(inout) :: root

      associate (of => assembly%oscillators%relaxation, l => root%side - 2)
         call anchor(assembly%oscillators, l, s - of%point(l), s + of%rate(l), root)
      end associate
      call improve_root(assembly, root)
      if (.not. assembly%oscillators%relaxes(root%j)) root%j = root%origin
   end subroutine restart_root

   !> Returns whether a root coincides with one of others of its relaxation.
   pure logical function is_among(oscillators, others, root)
      type(oscillators_t), intent(in) :: oscillators
      type(root_t), intent(in) :: others(:), root
      real(wp), parameter :: apart = 1e-9_wp
      integer :: k

      is_among = .true.
      do k = 1, size(others)
         if (others(k)%side /= root%side) cycle
         if (abs(oscillators%distance_between(others(k), root)) <= apart*abs( &
            oscillators%creep(root%origin, root%side - 2) + root%offset)) return
      end do
      is_among = .false.
   end function is_among

   !> Applies Newton's method to a relaxation root.
   !>
   !> vector  in: arrays to be reused; out: the eigenvector, if converged
   subroutine follow_newton(assembly, root, vector, converged)
      type(assembly_t), intent(in) :: assembly
      type(root_t), intent(inout) :: root
      type(vector_t), intent(inout) :: vector
      logical, intent(out) :: converged
      integer, parameter :: most_steps = 40
      complex(wp) :: step
      real(wp) :: past, before
      integer :: k, l

      l = root%side - 2
      before = huge(before)
      do k = 1, most_steps
         call find_vector(assembly, root, vector)
         step = vector%D(root%j) + sum(assembly%layout%v(:, root%j)*vector%f)
         converged = .false.
         if (.not. abs(vector%A) > 0) return
         step = -real(step/vector%A)
         past = assembly%oscillators%rise(root%origin, l) + real(root%offset)
         ! The root stays to the right of -b.
         if (past + real(step) <= 0) step = -past/2
         converged = .not. abs(step) < before .and. before <= 1e-9_wp*abs(root%offset)
         if (converged) return
         before = abs(step)
         root%offset = root%offset + step
         root%s = root%s + step
         converged = before <= 1e-15_wp*abs(root%offset)
         if (converged) return
         associate (of => assembly%oscillators)
            if (before > 1e-2_wp*abs(root%offset)) call anchor(of, l, of%creep(root%origin, l) &
               + real(root%offset), of%rise(root%origin, l) + real(root%offset), root)
         end associate
      end do
   end subroutine follow_newton

   !> Returns whether a point is in the interval of relaxation l, from -b to -b of the next
   !> slower relaxation, or to 0.
   pure logical function is_inside(relaxation, l, s)
      type(relaxation_t), intent(in) :: relaxation
      integer, intent(in) :: l
      real(wp), intent(in) :: s

      is_inside = s > -relaxation%rate(l) .and. s < 0
      if (l > 1) is_inside = is_inside .and. s < -relaxation%rate(l - 1)
   end function is_inside

end module beamid_relaxation_roots
