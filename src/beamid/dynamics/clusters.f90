!> Clusters: groups of roots that nearly coincide, and the disc that contains each group.
!>
!> If two roots nearly coincide, each residue and each derivative is unbounded, but their sum is
!> not. A cluster therefore represents the part of the sensor's transfer function with poles in a
!> disc around the group,
!>
!>     N(z)/(R P(z)),    s = c + R z,
!>
!> where P is the polynomial of the m roots in the disc and N has a lower degree. Both follow from
!> moments over the circle (`beamid_contours`). All quantities are smooth functions of the
!> parameters, however close the roots are; the disc itself stays fixed. If c is real, the lower
!> half of the disc is the mirror image of the upper half and all results are real. Otherwise the
!> complex conjugate disc is included by a factor of two.
module beamid_clusters
   use beamid_assembly, only: assembly_t, root_t
   use beamid_kinds, only: wp
   use beamid_vectors, only: nearest_pole
   implicit none
   private

   public :: cluster_t, find_clusters, origin_cluster

   !> One cluster.
   type :: cluster_t
      integer :: m = 0                         !< number of roots
      integer :: points = 0   !< quadrature points on the circle, or on its upper half
      type(root_t) :: centre                   !< centre c [1/time]
      real(wp) :: radius = 0                   !< radius R [1/time]
      logical :: on_axis = .false.             !< c is real
      !> the poles at 0: the roots 0 of the motion as a rigid body, `zeros` of them, and the double
      !> pole through which velocity and displacement of the base follow from its acceleration
      logical :: is_origin = .false.
      integer :: zeros = 0                     !< number of roots 0 of the structure in it
      complex(wp) :: counted = 0   !< number of roots in the disc, by a contour integral (S_0)
      complex(wp), allocatable :: a(:)         !< (m + 1) coefficients of P, ascending powers
      complex(wp), allocatable :: da(:, :)     !< (m + 1, parameters) their derivatives
      !> at the sensor: the sums of r and of r s over the cluster, where r is a residue
      complex(wp) :: moments(2) = 0
      integer, allocatable :: parameters(:)    !< numbers of the parameters of the derivatives
      !> motions of the sensor by the states of the cluster, and their derivatives, see `rows_of` in
      !> `beamid_contours`; doubled if the mirror image is included
      complex(wp), allocatable :: row(:, :), drow(:, :, :)
   contains
      procedure :: holds, knows, is_complete, weight, dmean, modes
   end type cluster_t

   !> Largest number of roots in a cluster. Let g be the radius of the group and o the distance of
   !> the nearest other root from its centre: g/o should be below `well_apart` and must be below
   !> `barely_apart`.
   integer, parameter :: most_roots = 12
   real(wp), parameter :: well_apart = 0.3_wp, barely_apart = 0.9_wp

contains

   !> Finds the discs around the flagged roots, each with at least one more root.
   !>
   !> all       every root, conjugates included
   !> flagged   roots with Im s >= 0 that have another root nearby
   !> alone     (flagged) whether the root may be taken by itself if no compact disc contains its
   !>           group, because a wide disc costs more digits
   !> clusters  the discs; empty if there are none
   subroutine find_clusters(assembly, all, flagged, alone, clusters)
      type(assembly_t), intent(in) :: assembly
      type(root_t), intent(in) :: all(:), flagged(:)
      logical, intent(in) :: alone(:)
      type(cluster_t), allocatable, intent(out) :: clusters(:)
      type(cluster_t) :: cluster
      integer, allocatable :: kept(:)
      integer :: i, k

      allocate (clusters(0))
      do k = 1, size(flagged)
         if (any(clusters%holds(flagged(k)%s))) cycle
         call gather_roots(assembly, all, flagged(k), clusters, alone(k), cluster)
         if (cluster%m == 0) cycle
         ! The new disc contains any other that it touches.
         kept = pack([(i, i=1, size(clusters))], .not. cluster%holds(clusters%centre%s))
         clusters = [clusters(kept), cluster]
      end do
   end subroutine find_clusters

   !> Returns the disc around 0 for a base that moves and for the motion as a rigid body.
   !>
   !> s  roots of the structure [1/time]
   function origin_cluster(assembly, s) result(cluster)
      type(assembly_t), intent(in) :: assembly
      complex(wp), intent(in) :: s(:)
      type(cluster_t) :: cluster

      cluster%is_origin = .true.
      cluster%zeros = assembly%zeros
      cluster%m = cluster%zeros + merge(2, 0, assembly%load%feels_base)
      cluster%on_axis = .true.
      cluster%radius = minval(abs(s), mask=abs(s) > 0)/4
      ! The error is 4**(-2 points) < 1e-17, with a reserve for the powers of z.
      cluster%points = 20
      call nearest_pole(assembly, cluster%centre)
   end function origin_cluster

   !> Finds the smallest group of roots around a flagged root that is well apart from all others. A
   !> disc that touches the real axis is moved onto it.
   !>
   !> all      every root
   !> flagged  the root to start from
   !> others   clusters found before: each must be inside or outside as a whole
   !> compact  .true.: accept only a disc that is well apart from other roots and small compared
   !>          with its distance from 0
   !> cluster  the disc; m = 0: there is none
   subroutine gather_roots(assembly, all, flagged, others, compact, cluster)
      type(assembly_t), intent(in) :: assembly
      type(root_t), intent(in) :: all(:), flagged
      type(cluster_t), intent(in) :: others(:)
      logical, intent(in) :: compact
      type(cluster_t), intent(out) :: cluster
      complex(wp) :: position(size(all)), centre
      logical :: inside(size(all)), on_axis
      real(wp) :: g, o, limit, radius
      integer :: i, m

      ! Positions relative to the flagged root; the differences of offsets keep their digits.
      do i = 1, size(all)
         position(i) = assembly%oscillators%distance_between(all(i), flagged)
      end do
      centre = 0
      on_axis = .false.
      limit = merge(well_apart, barely_apart, compact)
      m = 1
      do while (m < min(most_roots, size(all) - 1))
         m = m + 1
         inside = nearest(position, centre, m)
         centre = sum(position, mask=inside)/m
         if (on_axis) centre = cmplx(real(centre), -aimag(flagged%s), wp)
         inside = nearest(position, centre, m)
         g = maxval(abs(position - centre), mask=inside)
         o = minval(abs(position - centre), mask=.not. inside)
         ! The double pole at 0 of a base that moves is outside, too.
         if (assembly%load%feels_base) o = min(o, abs(flagged%s + centre))
         radius = max(sqrt(g*o), 0.4_wp*o)
         if (.not. on_axis .and. abs(aimag(flagged%s + centre)) <= radius) then
            on_axis = .true.
            limit = merge(well_apart, barely_apart, compact)
            m = 1
            cycle
         end if
         if (.not. g < limit*o .or. splits(others)) cycle
         if (compact .and. .not. g < well_apart*abs(flagged%s + centre)) cycle
         limit = g/o
         cluster%m = m
         cluster%centre = flagged
         cluster%centre%offset = flagged%offset + centre
         cluster%centre%s = flagged%s + centre
         cluster%on_axis = on_axis
         cluster%radius = radius
         ! The error is (R/o)**points + (g/R)**points, except for the powers of z.
         cluster%points = m + 2 + max(32, ceiling(40/log(o/radius)))
         if (limit < well_apart) exit
      end do
      if (cluster%on_axis) then
         cluster%centre%s = real(cluster%centre%s)
         cluster%points = (cluster%points + 1)/2
      end if

   contains

      !> Returns whether the disc contains only a part of another cluster.
      pure logical function splits(others)
         type(cluster_t), intent(in) :: others(:)
         integer :: k, shared

         splits = .false.
         do k = 1, size(others)
            shared = count(others(k)%holds(all%s) .and. inside)
            splits = splits .or. (shared > 0 .and. shared < others(k)%m)
         end do
      end function splits

   end subroutine gather_roots

   !> Returns which points are the m nearest to a centre.
   pure function nearest(points, centre, m) result(chosen)
      complex(wp), intent(in) :: points(:), centre
      integer, intent(in) :: m
      logical :: chosen(size(points))
      real(wp) :: distance(size(points))
      integer :: k

      distance = abs(points - centre)
      chosen = .false.
      do k = 1, m
         chosen(minloc(distance, dim=1, mask=.not. chosen)) = .true.
      end do
   end function nearest

   !> Returns whether a root is in the disc.
   elemental logical function holds(self, s)
      class(cluster_t), intent(in) :: self
      complex(wp), intent(in) :: s

      holds = abs(s - self%centre%s) <= self%radius
   end function holds

   !> Returns whether the derivatives are those with respect to the given parameters.
   pure logical function knows(self, parameters)
      class(cluster_t), intent(in) :: self
      integer, intent(in) :: parameters(:)

      knows = size(self%parameters) == size(parameters)
      if (knows) knows = all(self%parameters == parameters)
   end function knows

   !> Returns whether the contour integral counts as many roots as were gathered; in the disc around
   !> 0, only those of the structure.
   elemental logical function is_complete(self)
      class(cluster_t), intent(in) :: self

      is_complete = abs(self%counted - merge(self%zeros, self%m, self%is_origin)) < 1e-3_wp
   end function is_complete

   !> Returns the factor that includes the mirror image: 1 on the real axis, otherwise 2.
   pure real(wp) function weight(self)
      class(cluster_t), intent(in) :: self

      weight = merge(1.0_wp, 2.0_wp, self%on_axis)
   end function weight

   !> Returns the number of modes: pairs of roots, none in the disc around 0.
   elemental integer function modes(self)
      class(cluster_t), intent(in) :: self

      modes = self%m
      if (self%on_axis) modes = self%m/2
      if (self%is_origin) modes = 0
   end function modes

   !> Returns the derivative of the mean of the roots with respect to a parameter [1/time per unit].
   !>
   !> parameter  index of the parameter
   pure complex(wp) function dmean(self, parameter)
      class(cluster_t), intent(in) :: self
      integer, intent(in) :: parameter

      dmean = -self%radius*self%da(self%m, parameter)/self%m
   end function dmean

end module beamid_clusters
