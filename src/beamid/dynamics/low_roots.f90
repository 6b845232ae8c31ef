!> The lowest roots of a structure without the others, for a motion in which the others are not
!> seen: they decay before the first sample, or belong to modes that a free motion does not have.
!>
!> Let m, c and k be the products x^H M x, x^H C x and x^H K x of a root's vector, so that
!> m s**2 + c s + k = 0. With viscosity, c is at least c_D/E times the bending part of k, and the
!> rest of k, that of the springs, is at most m B, where B is the trace of M**-1 K without bending.
!> A root with Re s >= -a is real and |s| <= a, or it is complex, c/m <= 2 a, and
!>
!>     |s|**2 = k/m <= 2 a E/c_D + B.
!>
!> All of these roots therefore lie in a disc around 0. How many the disc contains is an integral
!> of W'/W over its circle. The roots that were found are taken out of W before, with the first one
!> outside, so that a few points serve: what remains is the number of roots that were missed.
module beamid_low_roots
   use beamid_assembly, only: assembly_t, root_t
   use beamid_characteristic, only: logarithmic_derivative
   use beamid_continuation, only: coincides, follow
   use beamid_errors, only: error_t
   use beamid_kinds, only: pi, wp
   use beamid_starting_roots, only: nudge, starting_points
   use beamid_terms, only: of_stiffness
   use beamid_vectors, only: allocate_vectors, nearest_pole, solve_mass, vector_t
   implicit none
   private

   public :: find_low_roots

   !> The disc reaches at most so far towards -E/c_D, where roots accumulate.
   real(wp), parameter :: largest_reach = 0.5_wp
   !> Share of the oscillators above which it is not worth while to leave roots out.
   real(wp), parameter :: largest_share = 0.7_wp
   !> How far above the least radius the first root outside is looked for, so that a small change of
   !> the structure leaves the same roots in the disc.
   real(wp), parameter :: reserve = 1.1_wp

contains

   !> Finds all roots in a disc around 0, and the first outside.
   !>
   !> guess   where the lowest roots are expected, in any order; size 0: nowhere
   !> rate    in: all roots with Re s >= -rate are wanted [1/time]; out: all of these were found
   !> modes   in: least number of modes that oscillate in the disc; out: their number
   !> root    one of each complex pair and all real roots, by ascending |s|
   !> vector  in: arrays to be reused; out: (root) vectors of the roots
   !> found   .false.: there is no such disc, it would contain most of the roots, or a root was
   !>         missed
   subroutine find_low_roots(assembly, guess, rate, modes, root, vector, found)
      type(assembly_t), intent(in) :: assembly
      type(root_t), intent(in) :: guess(:)
      real(wp), intent(inout) :: rate
      integer, intent(inout) :: modes
      type(root_t), allocatable, intent(out) :: root(:)
      type(vector_t), allocatable, intent(inout) :: vector(:)
      logical, intent(out) :: found
      real(wp) :: ratio, springs, least, radius
      logical, allocatable :: known(:)
      integer :: k, n

      found = .false.
      if (assembly%is_dense() .or. assembly%couplings%vanish() .or. assembly%load%feels_base .or. &
         assembly%oscillators%relaxation%n > 0 .or. assembly%zeros > 0) return
      if (any(assembly%oscillators%l > 0)) return
      associate (hose => assembly%couplings%hose)
         ! A hose that is held by its dashpot alone has a root 0.
         if (any(hose%row > 0 .and. .not. hose%strength(of_stiffness) > 0)) return
      end associate
      ! ratio: c_D/E
      ratio = assembly%oscillators%c_D/assembly%oscillators%E
      if (rate > 0 .and. .not. ratio > 0) return
      least = 0
      springs = 0
      if (rate > 0) then
         springs = spring_bound(assembly)
         least = max(rate, sqrt(2*rate/ratio + springs))
      end if
      if (.not. reserve*least*ratio <= largest_reach) return
      root = guess
      call cut(least, modes, root)
      if (size(root) == 0) then
         call low_points(assembly, reserve*least, modes, root)
         call cut(least, modes, root)
      end if
      n = size(root)
      if (n == 0 .or. n > largest_share*assembly%layout%n) return
      call allocate_vectors(n, vector)
      allocate (known(n), source=.true.)
      do k = 1, n
         call follow(assembly, root(k), vector(k), found)
         if (found) found = .not. coincides(root(k), root(:k - 1), known(:k - 1))
         if (.not. found) return
      end do
      associate (size_of_s => abs(root%s))
         found = all(size_of_s(:n - 1) < (1 - 1e-3_wp)*size_of_s(n))
         if (.not. found) return
         radius = max(least, sqrt(maxval(size_of_s(:n - 1))*size_of_s(n)))
         found = radius < size_of_s(n) .and. radius*ratio <= largest_reach .and. &
            count(aimag(root(:n - 1)%s) > 0) >= modes
      end associate
      modes = count(aimag(root(:n - 1)%s) > 0)
      if (found) found = abs(missed(assembly, root, radius)) < 0.2_wp
      if (rate > 0) rate = max(rate, min(radius, (radius**2 - springs)*ratio/2))
   end subroutine find_low_roots

   !> Sorts roots by |s| and removes those above the first one that is outside of every disc that is
   !> wanted; all, if there is no such root.
   !>
   !> least  least radius [1/time]
   !> modes  least number of modes in the disc
   subroutine cut(least, modes, root)
      real(wp), intent(in) :: least
      integer, intent(in) :: modes
      type(root_t), allocatable, intent(inout) :: root(:)
      integer :: k, last, oscillating

      ! A loop, because gfortran would pass `root%s` as an array temporary.
      root = root(by_size([(root(k)%s, k=1, size(root))]))
      last = 0
      oscillating = 0
      do k = 1, size(root)
         if (k > 1 .and. oscillating >= modes .and. abs(root(k)%s) > least) last = k
         if (last > 0 .and. abs(root(k)%s) > reserve*least) exit
         if (aimag(root(k)%s) > 0) oscillating = oscillating + 1
      end do
      root = root(:last)
   end subroutine cut

   !> Returns the order of numbers by their moduli.
   function by_size(s) result(order)
      complex(wp), intent(in) :: s(:)
      integer :: order(size(s))
      integer :: i, k, number

      ! Most are in order already.
      do k = 1, size(s)
         number = k
         do i = k - 1, 1, -1
            if (abs(s(order(i))) <= abs(s(k))) exit
            order(i + 1) = order(i)
            number = i
         end do
         order(number) = k
      end do
   end function by_size

   !> Returns B, the trace of M**-1 K without bending [1/time**2].
   real(wp) function spring_bound(assembly) result(bound)
      type(assembly_t), intent(in) :: assembly
      real(wp) :: x(assembly%layout%n, assembly%layout%r + size(assembly%layout%hose))
      real(wp) :: y(assembly%layout%r, size(x, 2))
      integer :: h, k, r

      r = size(y, 1)
      bound = 0
      x(:, :r) = assembly%layout%vt
      do h = 1, size(assembly%layout%hose)
         associate (hose => assembly%layout%hose(h), vt => assembly%layout%vt)
            x(:, r + h) = 0
            if (hose%row > 0) x(:, r + h) = vt(:, hose%row) - vt(:, hose%point)
         end associate
      end do
      call solve_mass(assembly, x, y)
      do k = 1, r
         if (.not. assembly%couplings%rigid(k)) bound = bound &
            + assembly%couplings%h(of_stiffness, k, k)/assembly%couplings%compliance(k)*y(k, k)
      end do
      do h = 1, size(assembly%couplings%hose)
         associate (hose => assembly%couplings%hose(h))
            if (hose%row > 0) bound = bound + hose%strength(of_stiffness) &
               *(y(hose%row, r + h) - y(hose%point, r + h))
         end associate
      end do
   end function spring_bound

   !> Computes starting points of the lowest roots, in the space of the lowest oscillators.
   !>
   !> radius  of a disc around 0 that the roots should fill [1/time]
   !> modes   number of modes that should be among them
   !> root    one of each complex pair and all real roots; size 0: most oscillators are needed
   subroutine low_points(assembly, radius, modes, root)
      type(assembly_t), intent(in) :: assembly
      real(wp), intent(in) :: radius
      integer, intent(in) :: modes
      type(root_t), allocatable, intent(out) :: root(:)
      type(error_t), allocatable :: error
      integer, allocatable :: kept(:)
      type(assembly_t) :: few
      integer :: k, m

      allocate (root(0))
      associate (n => assembly%layout%n, beam => assembly%layout%beam)
         m = max(count(abs(assembly%oscillators%pole(:beam, 1)) < radius), min(modes, n))
         if (m > largest_share*beam) return
         m = min(beam, m + m/2 + 2*assembly%layout%r + 4)
         kept = [(k, k=1, m), (k, k=beam + 1, n)]
      end associate
      few%layout = assembly%layout%select_oscillators(kept)
      few%oscillators = assembly%oscillators%select_oscillators(kept)
      few%couplings = assembly%couplings
      call starting_points(few, root, error)
      if (allocated(error)) then
         root = [root_t ::]
         return
      end if
      where (abs(aimag(root%s)) <= nudge*abs(root%s)) root%s = real(root%s)
      root%j = 0
      root = pack(root, aimag(root%s) >= 0)
   end subroutine low_points

   !> Returns the number of roots in a disc around 0 that are not among those that are known.
   !>
   !> known   one of each complex pair and all real roots
   !> radius  [1/time]
   real(wp) function missed(assembly, known, radius)
      type(assembly_t), intent(in) :: assembly
      type(root_t), intent(in) :: known(:)
      real(wp), intent(in) :: radius
      type(root_t) :: point
      complex(wp) :: slope
      integer :: i, k, points

      ! The roots further outside contribute (radius/|s|)**(2 points), and follow one another by a
      ! factor of 1 + 2/k at least, k their number.
      points = max(12, size(known) + 2)
      missed = 0
      do k = 1, points
         point%s = radius*exp(cmplx(0.0_wp, pi*(k - 0.5_wp)/points, wp))
         point%origin = 0
         call nearest_pole(assembly, point, keep_j=k > 1)
         slope = logarithmic_derivative(assembly, point)
         do i = 1, size(known)
            associate (s => known(i)%s)
               slope = slope - 1/(point%s - s)
               if (aimag(s) > 0) slope = slope - 1/(point%s - conjg(s))
            end associate
         end do
         missed = missed + real(point%s*slope)/points
      end do
   end function missed

end module beamid_low_roots
