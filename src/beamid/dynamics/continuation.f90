!> Continuation of the roots of one structure to those of a slightly different one, by Newton's
!> method from the positions that the derivatives of the roots predict.
!>
!> If x_j = 1 and all equations but that of oscillator j hold, the residual of the latter is
!> w = x'(s**2 M + s C + K) x, and dw/ds = x'(2 s M + C) x. The vector of a root, which its residue
!> requires anyway, therefore gives the Newton step.
module beamid_continuation
   use beamid_assembly, only: assembly_t, changes, root_t
   use beamid_errors, only: error_t, failure
   use beamid_kinds, only: two_pi, wp
   use beamid_matrices, only: size_of
   use beamid_strings, only: to_text
   use beamid_systems, only: find_eigenvector, improve_root
   use beamid_terms, only: of_loss
   use beamid_vectors, only: find_vector, nearest_pole, vector_t
   implicit none
   private

   public :: follow_roots, follow, follow_loss, coincides, with_conjugates, conjugate_of

   !> Largest number of steps; from a fair prediction, quadratic convergence takes three or four.
   integer, parameter :: most_steps = 8
   !> Relative to the distance from the nearest pole of an oscillator: a step of this size or less
   !> ends the iteration; a step of the second size is round-off if the next is not shorter.
   real(wp), parameter :: converged = 1e-14_wp, noise = 1e-11_wp
   !> Relative distance below which two roots count as one; and |A| of a vector, relative to that of
   !> an undamped mode, below which another root is near.
   real(wp), parameter :: apart = 1e-6_wp, least_A = 1e-3_wp

contains

   !> Follows all roots. Stops early if more than a quarter of them are lost, or one of an assembly
   !> with dense matrices.
   !>
   !> root      in: one of each complex pair and all real roots, at their predicted positions; out:
   !>           the exact positions of the roots that were followed
   !> vector    (roots) vectors of the roots that were followed
   !> followed  (roots) .false.: the root was not found, coincides with another root, left the real
   !>           axis or reached it, or was not searched for after the early stop
   subroutine follow_roots(assembly, root, vector, followed)
      type(assembly_t), intent(in) :: assembly
      type(root_t), intent(inout) :: root(:)
      type(vector_t), intent(inout) :: vector(:)
      logical, intent(out) :: followed(:)
      type(root_t) :: expected
      integer :: k

      followed = .false.
      if (2*size(root) - count(.not. abs(aimag(root%s)) > 0) /= assembly%roots() .or. &
         assembly%couplings%vanish()) return
      do k = 1, size(root)
         if (.not. abs(root(k)%s) > 0 .and. assembly%zeros > 0) then
            ! A root 0 of the motion as a rigid body stays there.
            root(k)%origin = 0
            call nearest_pole(assembly, root(k))
            followed(k) = .true.
            cycle
         end if
         expected = root(k)
         call follow(assembly, root(k), vector(k), followed(k))
         if (followed(k)) followed(k) = .not. coincides(root(k), root(:k - 1), followed(:k - 1))
         if (followed(k)) cycle
         root(k) = expected
         if (assembly%is_dense() .or. 4*count(.not. followed(:k)) > size(root)) return
      end do
   end subroutine follow_roots

   !> Returns whether a root coincides with one of others.
   !>
   !> known  (others) which of them are compared
   pure logical function coincides(root, others, known)
      type(root_t), intent(in) :: root, others(:)
      logical, intent(in) :: known(:)
      integer :: i

      coincides = .true.
      do i = 1, size(others)
         if (.not. known(i)) cycle
         associate (gap => root%s - others(i)%s, s => root%s)
            if (real(gap)**2 + aimag(gap)**2 <= apart**2*(real(s)**2 + aimag(s)**2)) return
         end associate
      end do
      coincides = .false.
   end function coincides

   !> Follows one root by Newton's method. A root that starts on the real axis stays there.
   !>
   !> root      in: the predicted position; out: the root
   !> vector    vector of the root
   !> followed  .false.: no convergence, a double root, or a complex root that reached the real axis
   subroutine follow(assembly, root, vector, followed)
      type(assembly_t), intent(in) :: assembly
      type(root_t), intent(inout) :: root
      type(vector_t), intent(inout) :: vector
      logical, intent(out) :: followed
      complex(wp) :: step
      real(wp) :: length, before
      logical :: is_real, is_undamped
      integer :: pass

      followed = .false.
      is_real = .not. abs(aimag(root%s)) > 0
      is_undamped = assembly%is_undamped()
      if (is_undamped) root%s = cmplx(0.0_wp, aimag(root%s), wp)
      root%origin = 0
      ! An oscillator that took part in the motion of a similar structure still does.
      call nearest_pole(assembly, root, keep_j=root%j > 0 .and. root%j <= assembly%layout%n .and. &
         .not. assembly%is_dense() .and. assembly%oscillators%relaxation%n == 0)
      if (assembly%is_dense()) then
         call improve_root(assembly, root)
         call find_eigenvector(assembly, root, vector)
         followed = is_real .or. aimag(root%s) > 1e-3_wp*abs(root%s)
         return
      end if
      before = huge(before)
      do pass = 1, most_steps
         call find_vector(assembly, root, vector)
         step = vector%D(root%j) + sum(assembly%layout%v(:, root%j)*vector%f)
         if (.not. size_of(vector%A) > 0) return
         step = -step/vector%A
         if (is_real) step = real(step)
         if (is_undamped) step = cmplx(0.0_wp, aimag(step), wp)
         length = size_of(step)
         if (.not. length < before/2) then
            followed = before <= noise*size_of(root%offset)
            exit
         end if
         before = length
         root%offset = root%offset + step
         root%s = root%s + step
         followed = length <= converged*size_of(root%offset)
         if (followed) exit
      end do
      followed = followed .and. abs(vector%A) > 2*least_A*abs(root%s)*vector%inertia
      if (.not. is_real) followed = followed .and. aimag(root%s) > 1e-3_wp*abs(root%s)
   end subroutine follow

   !> Follows a root of the structure without structural damping to that of the structure with it.
   !> The damping increases in steps. A step is halved if Newton's method does not converge, or ends
   !> far from where the derivative of the root predicts it, for example at another root.
   !>
   !> assembly  of the structure with structural damping
   !> root      in: without it, Im s > 0; out: with it
   !> vector    out: vector of the root
   !> error     the root was not found, or the modulus has relaxations as well
   subroutine follow_loss(assembly, root, vector, error)
      type(assembly_t), intent(in) :: assembly
      type(root_t), intent(inout) :: root
      type(vector_t), intent(inout) :: vector
      type(error_t), allocatable, intent(out) :: error
      !> Shortest step, and greatest difference from a prediction as a share of the change.
      real(wp), parameter :: shortest = 1e-3_wp, greatest = 0.2_wp
      type(assembly_t) :: partial
      type(root_t) :: next
      complex(wp) :: change
      real(wp) :: share, step
      logical :: followed

      if (assembly%oscillators%relaxation%n > 0) then
         call failure(error, 'modal: found eta beside time hysteresis (d_1, d_2), expected one '// &
            'of the two for modes: both are the loss of the modulus')
         return
      end if
      if (assembly%couplings%vanish() .and. .not. assembly%is_dense()) then
         ! The roots are the poles of the oscillators, which Newton's method reaches only nearly.
         root = root_t(root%origin, root%origin, s=assembly%oscillators%pole(root%origin, 1))
         call find_vector(assembly, root, vector)
         return
      end if
      partial = assembly
      call partial%set_loss(assembly, 0.0_wp)
      call find_eigenvector(partial, root, vector)
      share = 0
      step = 1
      do while (share < 1 .and. step >= shortest)
         change = -step*loss_product(assembly, vector)/vector%A
         next = root_t(s=root%s + change)
         call partial%set_loss(assembly, share + step)
         call follow(partial, next, vector, followed)
         if (followed) followed = abs(next%s - root%s - change) <= greatest*abs(change)
         if (followed) then
            root = next
            share = share + step
            step = min(2*step, 1 - share)
         else
            step = step/2
            call partial%set_loss(assembly, share)
            call find_eigenvector(partial, root, vector)
         end if
      end do
      if (share < 1) call failure(error, 'modal: with eta = '// &
         to_text(assembly%given%structure%eta)//', the mode near the frequency '// &
         to_text(abs(root%s)/two_pi)//' was not found; try a smaller eta or more elements')
   end subroutine follow_loss

   !> Returns i x'L x.
   pure complex(wp) function loss_product(assembly, vector) result(value)
      type(assembly_t), intent(in) :: assembly
      type(vector_t), intent(in) :: vector

      complex(wp) :: f(changes)

      f = 0
      f(of_loss) = (0, 1)
      value = f(of_loss)*sum(assembly%oscillators%l*vector%x**2) &
         + assembly%dense%bilinear(f, vector%x, vector%x, 0)
   end function loss_product

   !> Returns the conjugate root, stored relative to the conjugate pole.
   pure type(root_t) function conjugate_of(assembly, root)
      type(assembly_t), intent(in) :: assembly
      type(root_t), intent(in) :: root

      conjugate_of = root_t(root%j, root%origin, root%side, conjg(root%offset), conjg(root%s))
      if (abs(aimag(assembly%oscillators%pole(root%origin, root%side))) > 0) &
         conjugate_of%side = 3 - root%side
   end function conjugate_of

   !> Makes the list of all roots, in the order of `find_roots`: one of each complex pair and of
   !> every two real roots in the first half, the other one in the second half.
   !>
   !> half  one of each complex pair and all real roots
   !> all   in: an array to be reused; out: all roots
   pure subroutine with_conjugates(assembly, half, all)
      type(assembly_t), intent(in) :: assembly
      type(root_t), intent(in) :: half(:)
      type(root_t), allocatable, intent(inout) :: all(:)
      integer :: k, n, pairs, reals

      n = assembly%roots()/2
      if (allocated(all)) then
         if (size(all) /= 2*n) deallocate (all)
      end if
      if (.not. allocated(all)) allocate (all(2*n))
      pairs = 0
      reals = 2*n - size(half)       ! number of complex pairs; the real roots follow them
      do k = 1, size(half)
         if (abs(aimag(half(k)%s)) > 0) then
            pairs = pairs + 1
            all(pairs) = half(k)
            all(n + pairs) = conjugate_of(assembly, half(k))
         else
            reals = reals + 1
            all(reals + merge(0, 2*n - size(half), reals <= n)) = half(k)
         end if
      end do
   end subroutine with_conjugates

end module beamid_continuation
