!> Knots of the spline mesh in addition to the uniform ones: at points inside the beam where a
!> derivative of the deflection jumps.
module beamid_knots
   use beamid_kinds, only: wp
   use beamid_structure, only: no_spring, of_length, structure_t
   use beamid_terms, only: hose_value, is_spring, of_compliance, operators, operators_of, &
      strengths_and_slopes
   use beamid_variations, only: add_break
   implicit none
   private

   public :: kink_t, kinks_at_attachments, kinks_at_supports, add_kinks, mesh_knots

   !> Distance within which a uniform knot is replaced by a knot at an attachment, or at a break of
   !> a property [mesh intervals]. The replacement of a farther knot saves a short element.
   real(wp), parameter, public :: widely = 0.25_wp, closely = 0.05_wp
   !> Least distance of knots at attachments from each other and from the ends [mesh intervals]. The
   !> largest eigenvalue of the mesh grows with the fourth power of the reciprocal of the shortest
   !> element, and the eigenvalues near it drown in round-off.
   real(wp), parameter, public :: shortest = 0.05_wp

   !> A point at which a derivative of the deflection may jump.
   type :: kink_t
      real(wp) :: xi = 0      !< position x/l
      integer :: order = 3    !< order of the lowest derivative that may jump: 2 or 3
   end type kink_t

contains

   !> Returns the points inside the beam at which something acts on the beam: a force lets the third
   !> derivative jump, a moment the second. Positions that may change are left out, so that the mesh
   !> does not depend on the parameters.
   !>
   !> moving  numbers of the parameters that may change
   pure function kinks_at_attachments(structure, moving) result(kinks)
      type(structure_t), intent(in) :: structure
      integer, intent(in) :: moving(:)
      type(kink_t), allocatable :: kinks(:)
      real(wp), allocatable :: s(:, :), slopes(:, :, :)
      logical :: acts
      integer :: k

      allocate (kinks(0), s(operators_of(structure), of_compliance), &
         slopes(operators_of(structure), of_compliance, size(moving)))
      call strengths_and_slopes(structure, structure%length, moving, s, slopes)
      do k = 1, size(s, 1)
         associate (place => operators(k)%place, order => operators(k)%derivative)
            if (place == 0 .or. order < 0) cycle
            if (structure%follows_tip(place) .or. any(moving == place) .or. &
               any(moving == of_length)) cycle
            ! The coefficients of a hose belong to an operator that has no position.
            acts = any(abs(s(k, :)) > 0) .or. any(abs(slopes(k, :, :)) > 0) .or. &
               is_spring(k, structure) .or. any(k == hose_value)
            if (acts) kinks = [kinks, kink_t(structure%place(place)/structure%length, 3 - order)]
         end associate
      end do
      ! The jump of a lower derivative causes the larger error and is placed first.
      kinks = [pack(kinks, kinks%order == 2), pack(kinks, kinks%order == 3)]
   end function kinks_at_attachments

   !> Returns the supports that resist the rotation, at which the second derivative jumps.
   pure function kinks_at_supports(structure) result(kinks)
      type(structure_t), intent(in) :: structure
      type(kink_t), allocatable :: kinks(:)
      integer :: i

      associate (support => structure%support(:structure%supports))
         kinks = pack([(kink_t(support(i)%x_P/structure%length, 2), i=1, size(support))], &
            support%kappa_RP < no_spring .or. support%c_RP > 0)
      end associate
   end function kinks_at_supports

   !> Adds the knots of kinks. A kink that is too close to an end gets none. A kink that is too
   !> close to other knots shares them, and there a derivative of one order less may jump.
   !>
   !> degree         degree of the splines
   !> least          least distance x/l
   !> breaks, knots  positions x/l and numbers of knots so far
   pure subroutine add_kinks(kinks, degree, least, breaks, knots)
      type(kink_t), intent(in) :: kinks(:)
      integer, intent(in) :: degree
      real(wp), intent(in) :: least
      real(wp), allocatable, intent(inout) :: breaks(:)
      integer, allocatable, intent(inout) :: knots(:)
      real(wp), parameter :: same = 1e-9_wp
      integer :: i, k, times

      do i = 1, size(kinks)
         associate (xi => kinks(i)%xi)
            if (min(xi, 1 - xi) < least) cycle
            times = degree + 1 - kinks(i)%order
            k = minloc(abs(breaks - xi), dim=1, mask=knots > 0)
            if (k > 0) then
               if (abs(breaks(k) - xi) < least .and. abs(breaks(k) - xi) > same) then
                  knots(k) = min(max(knots(k), times) + 1, degree - 1)
                  cycle
               end if
            end if
            call add_break(xi, times, breaks, knots)
         end associate
      end do
   end subroutine add_kinks

   !> Computes the ends of the elements, in mesh intervals from the root. A break replaces the
   !> nearest node of the mesh if it is within `near`; otherwise it is an additional node.
   !>
   !> near   distance in mesh intervals, < 0.5; default: `closely`
   !> nodes  (:) ends of elements, ascending from 0 to `elements`
   !> times  (:) multiplicity of the knot at each node
   pure subroutine mesh_knots(elements, nodes, times, breaks, multiplicity, near)
      integer, intent(in) :: elements
      real(wp), allocatable, intent(out) :: nodes(:)
      integer, allocatable, intent(out) :: times(:)
      real(wp), intent(in), optional :: breaks(:)
      integer, intent(in), optional :: multiplicity(:)
      real(wp), intent(in), optional :: near
      real(wp), parameter :: same = 1e-9_wp
      logical :: taken(0:elements)
      real(wp) :: reach, x
      integer :: i, j, k

      nodes = [(real(i, wp), i=0, elements)]
      times = [(1, i=0, elements)]
      if (.not. present(breaks)) return
      reach = closely
      if (present(near)) reach = near
      taken = .false.
      taken([0, elements]) = .true.
      do k = 1, size(breaks)
         x = breaks(k)*elements
         if (.not. (x > same .and. x < elements - same)) cycle
         j = nint(x)
         if (abs(x - j) <= reach .and. .not. taken(j)) then
            taken(j) = .true.
            i = minloc(abs(nodes - j), dim=1)
            nodes(i) = x
            times(i) = multiplicity(k)
         else
            i = count(nodes < x)
            nodes = [nodes(:i), x, nodes(i + 1:)]
            times = [times(:i), multiplicity(k), times(i + 1:)]
         end if
      end do
   end subroutine mesh_knots

end module beamid_knots
