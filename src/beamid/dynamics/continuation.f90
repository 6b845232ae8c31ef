!> Roots of a structure that differs little from the last one: each by Newton's method from where
!> its derivatives say that it has gone.
!>
!> With x_j = 1 and all equations but that of oscillator j met, what is left of that one is
!> w = x'(s**2 M + s C + K) x, and dw/ds = x'(2 s M + C) x: the vector that a residue needs anyway
!> gives the step.
module beamid_continuation
   use beamid_assembly, only: assembly_t
   use beamid_kinds, only: wp
   use beamid_systems, only: find_whole_vector, improve_root
   use beamid_vectors, only: find_vector, nearest_pole, root_t, vector_t
   implicit none
   private

   public :: follow_roots, follow, meets, all_of, mirrored

   !> Steps at most; quadratic convergence from a fair prediction takes three or four.
   integer, parameter :: most_steps = 8
   !> The last step, relative to the distance from the nearest pole of an oscillator; and one that
   !> is round-off where the next is no shorter.
   real(wp), parameter :: arrived = 1e-14_wp, noise = 1e-11_wp
   !> Roots that are nearer to each other, relatively, are not told apart in this way; and what A of
   !> a vector is at least, relative to that of an undamped mode, where no other root is near.
   real(wp), parameter :: apart = 1e-6_wp, least_A = 1e-3_wp

contains

   !> Gives up when more than a quarter has been lost, or one where something acts between all
   !> oscillators.
   !>
   !> root      in: one of each pair and the real ones, where they are expected; out: where those
   !>           that were followed are
   !> vector    of each that was followed
   !> followed  .false.: one that was not found, or met another, or left the axis or came to it, or
   !>           that was not looked for any more
   subroutine follow_roots(assembly, root, vector, followed)
      type(assembly_t), intent(in) :: assembly
      type(root_t), intent(inout) :: root(:)
      type(vector_t), intent(inout) :: vector(:)
      logical, intent(out) :: followed(:)
      type(root_t) :: expected
      integer :: k

      followed = .false.
      if (2*size(root) - count(.not. abs(aimag(root%s)) > 0) /= assembly%roots() .or. &
         assembly%is_bare()) return
      do k = 1, size(root)
         expected = root(k)
         call follow(assembly, root(k), vector(k), followed(k))
         if (followed(k)) followed(k) = .not. meets(root(k), root(:k - 1), followed(:k - 1))
         if (followed(k)) cycle
         root(k) = expected
         if (assembly%is_dense() .or. 4*count(.not. followed(:k)) > size(root)) return
      end do
   end subroutine follow_roots

   !> Whether a root is one of others.
   !>
   !> known  which of them count
   pure logical function meets(root, others, known)
      type(root_t), intent(in) :: root, others(:)
      logical, intent(in) :: known(:)
      integer :: i

      meets = .true.
      do i = 1, size(others)
         if (.not. known(i)) cycle
         associate (gap => root%s - others(i)%s, s => root%s)
            if (real(gap)**2 + aimag(gap)**2 <= apart**2*(real(s)**2 + aimag(s)**2)) return
         end associate
      end do
      meets = .false.
   end function meets

   !> One root, on the axis where it starts there.
   !>
   !> followed  .false.: it does not converge, or comes to the axis
   subroutine follow(assembly, root, vector, followed)
      type(assembly_t), intent(in) :: assembly
      type(root_t), intent(inout) :: root
      type(vector_t), intent(inout) :: vector
      logical, intent(out) :: followed
      complex(wp) :: step
      real(wp) :: length, before
      logical :: is_real
      integer :: k, pass

      followed = .false.
      is_real = .not. abs(aimag(root%s)) > 0
      if (assembly%is_undamped()) root%s = cmplx(0.0_wp, aimag(root%s), wp)
      root%origin = 0
      call nearest_pole(assembly, root)
      if (assembly%is_dense()) then
         call improve_root(assembly, root)
         call find_whole_vector(assembly, root, vector)
         followed = is_real .or. aimag(root%s) > 1e-3_wp*abs(root%s)
         return
      end if
      before = huge(before)
      do pass = 1, most_steps
         call find_vector(assembly, root, vector)
         step = vector%D(root%j)
         do k = 1, size(assembly%v, 1)
            step = step + assembly%v(k, root%j)*vector%f(k)
         end do
         if (.not. abs(vector%A) > 0) return
         step = -step/vector%A
         if (is_real) step = real(step)
         if (assembly%is_undamped()) step = cmplx(0.0_wp, aimag(step), wp)
         length = abs(step)
         if (.not. length < before/2) then
            followed = before <= noise*abs(root%offset)
            exit
         end if
         before = length
         root%offset = root%offset + step
         root%s = root%s + step
         followed = length <= arrived*abs(root%offset)
         if (followed) exit
      end do
      followed = followed .and. abs(vector%A) > 2*least_A*abs(root%s)*vector%inertia
      if (.not. is_real) followed = followed .and. aimag(root%s) > 1e-3_wp*abs(root%s)
   end subroutine follow

   !> The conjugate root, from the conjugate pole.
   pure type(root_t) function mirrored(assembly, root)
      type(assembly_t), intent(in) :: assembly
      type(root_t), intent(in) :: root

      mirrored = root_t(root%j, root%origin, root%side, conjg(root%offset), conjg(root%s))
      if (abs(aimag(assembly%pole(root%origin, root%side))) > 0) mirrored%side = 3 - root%side
   end function mirrored

   !> All roots, those of one half and then the others: conjugates, and every second real one.
   pure function all_of(assembly, half) result(all)
      type(assembly_t), intent(in) :: assembly
      type(root_t), intent(in) :: half(:)
      type(root_t), allocatable :: all(:)
      integer :: k, n, pairs, reals

      n = assembly%roots()/2
      allocate (all(2*n))
      pairs = 0
      reals = 2*n - size(half)       ! pairs, until the real ones are counted after them
      do k = 1, size(half)
         if (abs(aimag(half(k)%s)) > 0) then
            pairs = pairs + 1
            all(pairs) = half(k)
            all(n + pairs) = mirrored(assembly, half(k))
         else
            reals = reals + 1
            all(reals + merge(0, 2*n - size(half), reals <= n)) = half(k)
         end if
      end do
   end function all_of

end module beamid_continuation
