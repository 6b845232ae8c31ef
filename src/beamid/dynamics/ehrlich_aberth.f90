!> The Ehrlich-Aberth iteration, which corrects all roots of the characteristic equation
!> simultaneously (Aberth, Math. Comp. 27, 1973, 339).
module beamid_ehrlich_aberth
   use beamid_assembly, only: assembly_t, root_t
   use beamid_characteristic, only: logarithmic_derivative
   use beamid_continuation, only: conjugate_of
   use beamid_errors, only: error_t, failure
   use beamid_interrupts, only: check_interrupt
   use beamid_kinds, only: wp
   use beamid_strings, only: to_text
   use beamid_vectors, only: nearest_pole
   implicit none
   private

   public :: iterate

   !> Largest number of sweeps, and number of sweeps after which the corrections of a root that has
   !> not converged must have halved.
   integer, parameter :: max_sweeps = 1000, patience = 20
   !> A root that is smaller than this, relative to the largest root, counts as 0, like the root of
   !> a hose that is held only by its dashpot. There the relative corrections do not decrease, and
   !> the squares of smaller numbers would underflow.
   real(wp), parameter :: negligible = 1e-60_wp

contains

   !> Performs the Ehrlich-Aberth iteration: corrects the roots in turn until all have converged. At
   !> a multiple root the corrections decrease only to a root of the round-off, and then stagnate.
   !>
   !> relaxed   the relaxation roots
   !> done      (roots) in: which roots are exact already
   !> doubtful  some roots stagnated at corrections larger than round-off at a double root explains,
   !>           as happens from poor starting points in a dense row of real roots, or some did not
   !>           converge
   !> error     some roots did not converge
   subroutine iterate(assembly, relaxed, roots, done, doubtful, error)
      type(assembly_t), intent(in) :: assembly
      type(root_t), intent(in) :: relaxed(:)
      type(root_t), intent(inout) :: roots(:)
      logical, allocatable, intent(inout) :: done(:)
      logical, intent(out) :: doubtful
      type(error_t), allocatable, intent(out) :: error
      logical :: settled(size(roots)), given(size(roots))
      real(wp) :: moved(size(roots)), before(size(roots)), least
      integer :: half, k, sweep

      half = size(roots)/2
      doubtful = .false.
      if (assembly%couplings%vanish()) then
         call take_poles(assembly, roots)
         return
      end if
      settled = done
      given = done
      moved = 0
      before = huge(before)
      least = negligible*maxval(abs(roots%s))
      do sweep = 1, max_sweeps
         call check_interrupt(error)
         if (allocated(error)) return
         do k = 1, size(roots)
            if (done(k)) cycle
            call correct(assembly, relaxed, roots, k, moved(k))
            ! Convergence is at least quadratic, except at multiple roots.
            settled(k) = moved(k) <= 1e-10_wp*abs(roots(k)%offset)
            done(k) = moved(k) <= 1e-6_wp*max(abs(roots(k)%offset), 1e-14_wp*abs(roots(k)%s)) &
               .or. abs(roots(k)%s) <= least
            ! The conjugate of a complex root converges together with it.
            if (k <= half .and. .not. done(k)) done(k + half) = given(k + half)
         end do
         if (modulo(sweep, patience) == 0) then
            doubtful = doubtful .or. any(.not. done .and. moved > before/2 .and. &
               moved <= 1e-3_wp*abs(roots%s) .and. moved > &
               max(1e-4_wp*abs(roots%offset), 1e-13_wp*abs(roots%s)))
            done = done .or. moved > before/2 .and. moved <= 1e-3_wp*abs(roots%s)
            before = moved
         end if
         if (.not. all(done)) cycle
         ! With all other roots exact, one more correction leaves only round-off.
         do k = 1, size(roots)
            if (.not. settled(k)) call correct(assembly, relaxed, roots, k, moved(k))
         end do
         return
      end do
      doubtful = .true.
      call failure(error, 'modal: '//to_text(count(.not. done))//' of '//to_text(size(roots))// &
         ' roots of the characteristic equation did not converge')
   end subroutine iterate

   !> Sets the roots to the poles of the oscillators, which are the roots of a bare beam.
   subroutine take_poles(assembly, roots)
      type(assembly_t), intent(in) :: assembly
      type(root_t), intent(inout) :: roots(:)
      integer :: k

      do k = 1, size(roots)
         roots(k)%j = modulo(k - 1, assembly%layout%n) + 1
         roots(k)%origin = roots(k)%j
         roots(k)%side = 1 + (k - 1)/assembly%layout%n
         roots(k)%offset = 0
         roots(k)%s = assembly%oscillators%pole(roots(k)%origin, roots(k)%side)
      end do
   end subroutine take_poles

   !> Applies to root k Newton's correction for the characteristic polynomial divided by the factors
   !> of all other roots. Once a complex root has almost converged, its partner is set to its
   !> conjugate. Before that the partner is corrected by itself, because a pair may have to separate
   !> into two real roots, which two conjugate points cannot do.
   !>
   !> relaxed  the relaxation roots, for each of which W has a pole at -b
   !> moved    modulus of the correction [1/time]; `huge` if there is none but a small shift
   subroutine correct(assembly, relaxed, roots, k, moved)
      type(assembly_t), intent(in) :: assembly
      type(root_t), intent(in) :: relaxed(:)
      type(root_t), intent(inout) :: roots(:)
      integer, intent(in) :: k
      real(wp), intent(out) :: moved
      complex(wp) :: slope, step, gap
      real(wp) :: near
      integer :: half, i, partner
      logical :: known, settled

      half = size(roots)/2
      partner = modulo(k - 1 + half, size(roots)) + 1
      if (k > half) then
         if (is_pair(roots(partner), roots(k))) then
            moved = 0
            return
         end if
      end if
      slope = logarithmic_derivative(assembly, roots(k))
      known = abs(slope) > 0
      near = 1e-6_wp*abs(roots(k)%s)
      do i = 1, size(roots)
         if (i == k) cycle
         gap = roots(k)%s - roots(i)%s
         if (abs(real(gap)) + abs(aimag(gap)) <= near) gap = &
            assembly%oscillators%distance_between(roots(k), roots(i))
         known = known .and. abs(gap) > 0
         if (known) slope = slope - conjg(gap)/(real(gap)**2 + aimag(gap)**2)
      end do
      do i = 1, size(relaxed)
         gap = assembly%oscillators%distance_between(roots(k), relaxed(i))
         known = known .and. abs(gap) > 0
         if (known) slope = slope - 1/gap + 1/(roots(k)%s &
            + assembly%oscillators%relaxation%rate(relaxed(i)%side - 2))
      end do
      if (known .and. abs(slope) > 0) then
         step = -1/slope
         moved = abs(step)
      else
         ! W'/W is unknown, or two points coincide: shift the point slightly; it has not converged.
         step = max(1e-8_wp*abs(roots(k)%offset), epsilon(near)*abs(roots(k)%s))
         moved = huge(moved)
         ! Where several poles are equal to all digits, the point cannot come closer to the root.
         if (assembly%oscillators%distance_from_accumulation(roots(k)%s) <= &
            100*epsilon(near)) moved = 0
         if (.not. moved > 0) step = 0
      end if
      settled = moved <= 1e-2_wp*abs(aimag(roots(k)%s)) .and. k <= half .and. &
         abs(roots(partner)%s - conjg(roots(k)%s)) <= 1e-1_wp*abs(aimag(roots(k)%s))
      roots(k)%s = roots(k)%s + step
      roots(k)%offset = roots(k)%offset + step
      if (abs(step) > 1e-2_wp*abs(roots(k)%offset)) call nearest_pole(assembly, roots(k))
      if (settled) roots(partner) = conjugate_of(assembly, roots(k))
   end subroutine correct

   !> Returns whether two roots are exact conjugates of each other and clearly not real.
   pure logical function is_pair(a, b)
      type(root_t), intent(in) :: a, b

      is_pair = abs(real(a%s) - real(b%s)) <= 0 .and. abs(aimag(a%s) + aimag(b%s)) <= 0 .and. &
         abs(aimag(a%s)) > 1e-3_wp*abs(a%s)
   end function is_pair

end module beamid_ehrlich_aberth
