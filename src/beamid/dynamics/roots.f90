!> Roots of the characteristic equation of the damped structure.
!>
!> Newton's method follows each root from its own starting point. The roots that it does not find
!> are computed simultaneously by the Ehrlich-Aberth iteration (`ehrlich_aberth`).
!> If the iteration does not converge, the starting points are eigenvalues from LAPACK instead. They
!> always are for an assembly with dense matrices.
module beamid_roots
   use beamid_assembly, only: assembly_t, new_assembly, root_t
   use beamid_continuation, only: coincides, conjugate_of, follow, follow_loss, &
      with_conjugates
   use beamid_ehrlich_aberth, only: iterate
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

contains

   !> Computes the roots s of (s**2 M + s C + K + i L) x = 0, without relaxation roots.
   !>
   !> roots  one of each complex pair, Im s > 0, and all real roots, by ascending |s| [1/time]
   !> error  the roots were not found; the mesh holds an end that the structure does not hold
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

      call equations%check_ends(error)
      if (.not. allocated(error)) call bare_beam_modes(equations%galerkin, modes, error)
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
         call check_distinct(roots, error)
         ! A motion as a rigid body has one root 0 or two; it is one mode.
         roots = roots(1 + structure%zero_roots() - structure%rigid_body_modes():)
      end associate
   end subroutine damped_roots

   !> Reports an error if a root that oscillates is listed twice, so that another one is missing.
   !> The upper half does not count: the highest modes of a mesh come in pairs, one at each end.
   subroutine check_distinct(roots, error)
      complex(wp), intent(in) :: roots(:)   !< by ascending |s| [1/time]
      type(error_t), allocatable, intent(out) :: error
      !> Relative distance of two roots below which they are one. A root has ten digits or more.
      real(wp), parameter :: same = 1e-9_wp
      integer :: k

      do k = 1, size(roots)/2
         if (.not. aimag(roots(k)) > 1e-3_wp*abs(roots(k))) cycle
         if (count(abs(roots - roots(k)) <= same*abs(roots(k))) == 1) cycle
         call failure(error, 'modal: not all roots of the characteristic equation were found: '// &
            'that at s = '//to_text(real(roots(k)))//' + i '//to_text(aimag(roots(k)))// &
            ' was found twice; try other elements')
         return
      end do
   end subroutine check_distinct

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
