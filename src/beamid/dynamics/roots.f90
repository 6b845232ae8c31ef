!> Roots of the characteristic equation of the damped structure.
!>
!> Newton's method follows each root from its own starting point. The roots that it does not find
!> are computed simultaneously by the Ehrlich-Aberth iteration (Aberth, Math. Comp. 27, 1973, 339).
!> If the iteration does not converge, the starting points are eigenvalues from LAPACK instead. They
!> always are for an assembly with dense matrices.
module beamid_roots
   use beamid_assembly, only: assembly_t, new_assembly, root_t
   use beamid_characteristic, only: logarithmic_derivative
   use beamid_continuation, only: coincides, conjugate_of, follow, follow_loss, &
      with_conjugates
   use beamid_eigenvalues, only: roots_of_matrix
   use beamid_equations, only: equations_t
   use beamid_errors, only: error_t, failure
   use beamid_interrupts, only: check_interrupt, interrupted
   use beamid_kinds, only: wp
   use beamid_modes, only: bare_beam_modes, beam_modes_t
   use beamid_relaxation_roots, only: find_relaxation_roots
   use beamid_sorting, only: sort_by
   use beamid_starting_roots, only: leave_axis, nudge, starting_points
   use beamid_strings, only: to_text
   use beamid_structure, only: structure_t
   use beamid_systems, only: improve_root
   use beamid_vectors, only: nearest_pole, vector_t
   implicit none
   private

   public :: find_roots, find_others, damped_roots

   !> Largest number of sweeps, and number of sweeps after which the corrections of a root that has
   !> not converged must have halved.
   integer, parameter :: max_sweeps = 1000, patience = 20
   !> A root that is smaller than this, relative to the largest root, counts as 0, like the root of
   !> a hose that is held only by its dashpot. There the relative corrections do not decrease, and
   !> the squares of smaller numbers would underflow.
   real(wp), parameter :: negligible = 1e-60_wp

contains

   !> Computes the roots s of (s**2 M + s C + K + i L) x = 0, without relaxation roots.
   !>
   !> roots  one of each complex pair, Im s > 0, and all real roots, by ascending |s| [1/time]
   !> error  the roots were not found
   subroutine damped_roots(equations, roots, error)
      type(equations_t), intent(in) :: equations
      complex(wp), allocatable, intent(out) :: roots(:)
      type(error_t), allocatable, intent(out) :: error
      type(beam_modes_t) :: modes
      type(assembly_t) :: assembly
      type(root_t), allocatable :: all(:), half(:), relaxed(:)
      type(structure_t) :: elastic
      logical, allocatable :: has_hose(:)
      integer :: h

      call bare_beam_modes(equations%galerkin, modes, error)
      if (allocated(error)) return
      associate (structure => equations%structure)
         elastic = structure
         elastic%eta = 0
         assembly = new_assembly(elastic, modes, [integer ::])
         call find_relaxation_roots(assembly, relaxed, error)
         if (.not. allocated(error)) call find_roots(assembly, relaxed, all, half, error)
         if (structure%eta > 0 .and. .not. allocated(error)) call add_loss( &
            new_assembly(structure, modes, [integer ::]), half, error)
         if (allocated(error)) return
         roots = half%s
         ! A hose without spring and dashpot drifts freely: a root 0 that does not move the beam.
         has_hose = structure%has_hose()
         do h = 1, size(has_hose)
            associate (hose => structure%hose(h))
               if (has_hose(h) .and. .not. (hose%k_H > 0 .or. hose%c_H > 0)) &
                  roots = [roots, (0.0_wp, 0.0_wp)]
            end associate
         end do
         call sort_by(abs(roots), roots)
         ! A motion as a rigid body has one root 0 or two; it is one mode.
         roots = roots(1 + structure%zero_roots() - structure%rigid_body_modes():)
      end associate
   end subroutine damped_roots

   !> Follows all modes that oscillate to those of the structure with structural damping.
   !>
   !> assembly  with structural damping
   !> half      in: roots without it; out: with it
   !> error     a root was not found
   subroutine add_loss(assembly, half, error)
      type(assembly_t), intent(in) :: assembly
      type(root_t), intent(inout) :: half(:)
      type(error_t), allocatable, intent(out) :: error
      type(vector_t) :: vector
      integer :: k

      do k = 1, size(half)
         if (aimag(half(k)%s) > 0) call follow_loss(assembly, half(k), vector, error)
         if (allocated(error)) return
      end do
   end subroutine add_loss

   !> Computes all roots of an assembly but the relaxation roots.
   !>
   !> relaxed      the relaxation roots; one that is no eigenvalue is computed again
   !> all          all roots: one of each complex pair and of every two real roots in the first
   !>              half, the other one half the size further
   !> half         one of each complex pair, Im s > 0, and all real roots
   !> error        the iteration does not converge
   !> from_matrix  whether the starting points are eigenvalues from LAPACK; default .false., but
   !>              always .true. for an assembly with dense matrices
   subroutine find_roots(assembly, relaxed, all, half, error, from_matrix)
      type(assembly_t), intent(in) :: assembly
      type(root_t), intent(inout) :: relaxed(:)
      type(root_t), allocatable, intent(out) :: all(:), half(:)
      type(error_t), allocatable, intent(out) :: error
      logical, intent(in), optional :: from_matrix
      logical, allocatable :: done(:)
      logical :: by_matrix, doubtful

      by_matrix = assembly%is_dense()
      if (present(from_matrix)) by_matrix = by_matrix .or. from_matrix
      if (by_matrix) then
         call roots_of_matrix(assembly, relaxed, all, error)
      else
         call starting_points(assembly, all, error)
      end if
      if (allocated(error)) return
      call set_zero_roots(assembly, all)
      if (assembly%is_dense()) then
         call improve(assembly, all)
      else
         do
            call approach(assembly, all, done)
            call iterate(assembly, relaxed, all, done, doubtful, error)
            if (by_matrix .or. .not. doubtful) exit
            call roots_of_matrix(assembly, relaxed, all, error)
            if (allocated(error)) return
            call set_zero_roots(assembly, all)
            by_matrix = .true.
         end do
      end if
      if (.not. allocated(error)) call check_interrupt(error)
      if (allocated(error)) return
      half = all
      call select_half(assembly, half)
   end subroutine find_roots

   !> Sets the smallest roots to 0, as many as the motion as a rigid body has. No search approaches
   !> them: they are exact.
   subroutine set_zero_roots(assembly, roots)
      type(assembly_t), intent(in) :: assembly
      type(root_t), intent(inout) :: roots(:)
      logical :: taken(size(roots))
      integer :: i, k

      taken = .false.
      do i = 1, assembly%zeros
         k = minloc(abs(roots%s), dim=1, mask=.not. taken)
         taken(k) = .true.
         roots(k)%s = 0
         roots(k)%origin = 0
         call nearest_pole(assembly, roots(k))
      end do
   end subroutine set_zero_roots

   !> Computes all roots if most of them are known, as after a small change of the structure.
   !>
   !> relaxed  the relaxation roots
   !> some     one of each complex pair and all real roots, exact or approximate
   !> known    which of `some` are exact
   !> all      all roots, in the order of `find_roots`
   !> half     one of each complex pair, Im s > 0, and all real roots
   !> found    .false.: the iteration does not converge, or its result is doubtful
   subroutine find_others(assembly, relaxed, some, known, all, half, found)
      type(assembly_t), intent(in) :: assembly
      type(root_t), intent(in) :: relaxed(:), some(:)
      logical, intent(in) :: known(:)
      type(root_t), allocatable, intent(out) :: all(:), half(:)
      logical, intent(out) :: found
      type(error_t), allocatable :: error
      logical, allocatable :: done(:)
      logical :: doubtful
      integer :: k

      call with_conjugates(assembly, some, all)
      allocate (done(size(all)))
      do k = 1, size(all)
         done(k) = any(known .and. abs(real(some%s - all(k)%s)) &
            + abs(abs(aimag(some%s)) - abs(aimag(all(k)%s))) <= 0)
         if (.not. done(k)) call leave_axis(assembly, merge(1, 2, 2*k <= size(all)), all(k))
      end do
      call iterate(assembly, relaxed, all, done, doubtful, error)
      found = .not. (doubtful .or. allocated(error))
      half = all
      if (found) call select_half(assembly, half)
   end subroutine find_others

   !> Improves each root of an assembly with dense matrices; the second root of a complex pair is
   !> the conjugate of the first.
   subroutine improve(assembly, roots)
      type(assembly_t), intent(in) :: assembly
      type(root_t), intent(inout) :: roots(:)
      integer :: half, k

      half = size(roots)/2
      do k = 1, half
         if (interrupted()) return
         if (abs(roots(k)%s) > 0) call improve_root(assembly, roots(k))
         if (abs(aimag(roots(k)%s)) > 0) then
            roots(k + half) = conjugate_of(assembly, roots(k))
         else if (abs(roots(k + half)%s) > 0) then
            call improve_root(assembly, roots(k + half))
         end if
      end do
   end subroutine improve

   !> Applies Newton's method to each root from its starting point. A point near the real axis is
   !> taken as a real root. A root that does not converge, or converges to a root found before,
   !> keeps its starting point.
   !>
   !> done  (roots) which of them have converged
   subroutine approach(assembly, roots, done)
      type(assembly_t), intent(in) :: assembly
      type(root_t), intent(inout) :: roots(:)
      logical, allocatable, intent(out) :: done(:)
      type(root_t) :: root
      type(vector_t) :: vector
      logical :: arrived, is_real
      integer :: half, k

      allocate (done(size(roots)))
      done = abs(roots%s) <= 0 .and. assembly%zeros > 0
      if (assembly%couplings%vanish()) return
      half = size(roots)/2
      do k = 1, size(roots)
         if (interrupted()) return
         if (done(k)) cycle
         root = roots(k)
         is_real = abs(aimag(root%s)) <= nudge*abs(root%s)
         if (is_real) root%s = real(root%s)
         if (.not. is_real .and. k > half) cycle
         call follow(assembly, root, vector, arrived)
         if (arrived) arrived = .not. coincides(root, roots, done)
         if (.not. arrived) cycle
         roots(k) = root
         done(k) = .true.
         if (is_real) cycle
         roots(k + half) = conjugate_of(assembly, root)
         done(k + half) = .true.
      end do
   end subroutine approach

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

   !> Reduces all roots to one of each complex pair, Im s > 0, and all real roots. Imaginary parts
   !> that are round-off are removed, and so are real parts if the structure is undamped.
   subroutine select_half(assembly, roots)
      type(assembly_t), intent(in) :: assembly
      type(root_t), allocatable, intent(inout) :: roots(:)
      integer :: k

      if (assembly%is_undamped()) then
         do k = 1, size(roots)
            roots(k)%s = cmplx(0.0_wp, aimag(roots(k)%s), wp)
            roots(k)%offset = cmplx(0.0_wp, aimag(roots(k)%offset), wp)
         end do
      end if
      do k = 1, size(roots)
         if (abs(aimag(roots(k)%s)) > 1e-3_wp*abs(roots(k)%s)) cycle
         ! A complex root has a conjugate. On the real axis, most of all at a multiple root, the
         ! imaginary part is round-off.
         if (minval(abs(real(roots%s - roots(k)%s)) + abs(aimag(roots%s + roots(k)%s))) &
            <= 1e-2_wp*abs(aimag(roots(k)%s))) cycle
         roots(k)%s = real(roots(k)%s)
         associate (pole => assembly%oscillators%pole(roots(k)%origin, roots(k)%side))
            if (abs(aimag(pole)) > 0) then
               roots(k)%offset = roots(k)%s - pole
            else
               roots(k)%offset = real(roots(k)%offset)
            end if
         end associate
      end do
      roots = pack(roots, aimag(roots%s) >= 0)
   end subroutine select_half

end module beamid_roots
