!> The unknowns of the equations on a mesh: their number, their order, and the row vectors that
!> give values and slopes at points of the beam.
module beamid_mesh_unknowns
   use beamid_galerkin, only: mesh_t
   use beamid_kinds, only: wp
   use beamid_splines, only: spline_space_t
   use beamid_structure, only: structure_t
   use beamid_terms, only: hose, hose_value, operators, place_on_mesh, stretch
   implicit none
   private

   public :: unknowns_of, order_unknowns, points_of

contains

   !> Returns the number of unknowns on a mesh, after the elimination of rigid supports.
   pure integer function unknowns_of(mesh, structure)
      type(mesh_t), intent(in) :: mesh
      type(structure_t), intent(in) :: structure

      unknowns_of = mesh%elements + mesh%degree - count(structure%essential()) &
         + count(structure%has_hose()) - structure%rigid_supports()
   end function unknowns_of

   !> Orders the unknowns: the splines from root to tip, and each hose next to the last spline that
   !> does not vanish at its position.
   !>
   !> spline, hoses  (splines) and (hoses) indices of the unknowns; 0: the hose has no mass
   subroutine order_unknowns(space, structure, spline, hoses)
      type(spline_space_t), intent(in) :: space
      type(structure_t), intent(in) :: structure
      integer, allocatable, intent(out) :: spline(:), hoses(:)
      logical, allocatable :: has_mass(:)
      integer, allocatable :: last(:)
      integer :: h, i, j

      has_mass = structure%has_hose()
      last = [(findloc(abs(space%at(place_on_mesh(hose_value(h), structure, space%length), 0)) &
         > 0, .true., dim=1, back=.true.), h=1, size(has_mass))]
      spline = [(i + count(has_mass .and. last < i), i=1, space%n)]
      hoses = 0*last
      do h = 1, size(last)
         ! Hoses at the same spline keep their order.
         j = count(has_mass .and. (last < last(h) .or. last == last(h) .and. &
            [(i, i=1, size(last))] <= h))
         if (has_mass(h)) hoses(h) = last(h) + j
      end do
   end subroutine order_unknowns

   !> Returns the row vectors of the operators at points: value or slope = row vector . unknowns.
   !>
   !> spline, hoses  as of `order_unknowns`
   !> n              number of unknowns before the elimination of rigid supports
   !> number         of operators
   !> points         (n, number); 0 for the operators that do not act at a point
   function points_of(space, structure, spline, hoses, n, number) result(points)
      type(spline_space_t), intent(in) :: space
      type(structure_t), intent(in) :: structure
      integer, intent(in) :: spline(:), hoses(:), n, number
      real(wp), allocatable :: points(:, :)
      integer :: h, k

      allocate (points(n, number), source=0.0_wp)
      do k = 1, number
         if (operators(k)%derivative < 0) cycle
         points(spline, k) = space%at(place_on_mesh(k, structure, space%length), &
            operators(k)%derivative)
      end do
      do h = 1, size(hoses)
         if (hoses(h) == 0) cycle
         points(hoses(h), hose(h)) = 1
         points(:, stretch(h)) = points(:, hose(h)) - points(:, hose_value(h))
      end do
   end function points_of

end module beamid_mesh_unknowns
