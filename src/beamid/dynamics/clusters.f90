!> Roots that come together: which ones, and the disc that holds them.
!>
!> Where two roots nearly meet, each residue and each derivative grows without bound and only their
!> sum has a meaning: the part of the sensor's transfer function with poles in a disc about them,
!>
!>     N(z)/(R P(z)),    s = c + R z,
!>
!> P the polynomial of the m roots in the disc, N of lower degree, both by moments over its circle
!> (`beamid_contours`). Everything depends smoothly on the parameters, however near the roots are;
!> the disc itself stays where it is. Of a disc on the real axis the lower half is the mirror image
!> of the upper, and all is real; of another one the mirror image counts by a factor of two.
module beamid_clusters
   use beamid_assembly, only: assembly_t
   use beamid_kinds, only: wp
   use beamid_vectors, only: nearest_pole, root_t
   implicit none
   private

   public :: cluster_t, find_clusters, base_cluster

   type :: cluster_t
      integer :: m = 0                         !< roots
      integer :: points = 0                    !< on the circle, or on its upper half
      type(root_t) :: centre                   !< c
      real(wp) :: radius = 0                   !< R
      logical :: on_axis = .false.             !< c is real
      !> No roots of the structure, but the double pole at 0 by which velocity and displacement of
      !> the base follow from its acceleration.
      logical :: is_base = .false.
      complex(wp) :: counted = 0               !< S_0
      complex(wp), allocatable :: a(:)         !< (m + 1) coefficients of P, ascending
      complex(wp), allocatable :: da(:, :)     !< (m + 1, parameters)
      complex(wp) :: moments(2) = 0            !< of the sensor: sums of r and of r s
      integer, allocatable :: parameters(:)    !< with respect to which derivatives are
      !> of the sensor, see `rows_of`; twice that where there is a mirror image
      complex(wp), allocatable :: row(:, :), drow(:, :, :)
   contains
      procedure :: holds
      procedure :: knows
      procedure :: is_complete
      procedure :: weight
      procedure :: dmean
      procedure :: modes
   end type cluster_t

   !> Roots in one cluster at most, the ratio of their radius to the distance of the next that is
   !> asked for, and the one that has to do.
   integer, parameter :: most_roots = 12
   real(wp), parameter :: well_apart = 0.3_wp, barely_apart = 0.9_wp

contains

   !> Discs about the flagged roots, each with at least one more.
   !>
   !> all      every root, 2 n of them
   !> flagged  those, Im s >= 0, that another one is near
   !> alone    which of them may be taken by themselves where no compact disc holds them: a wide one
   !>          costs more digits
   subroutine find_clusters(assembly, all, flagged, alone, clusters)
      type(assembly_t), intent(in) :: assembly
      type(root_t), intent(in) :: all(:), flagged(:)
      logical, intent(in) :: alone(:)
      type(cluster_t), allocatable, intent(out) :: clusters(:)
      type(cluster_t) :: cluster
      integer :: k

      allocate (clusters(0))
      do k = 1, size(flagged)
         if (any(clusters%holds(flagged(k)%s))) cycle
         call gather(assembly, all, flagged(k), clusters, alone(k), cluster)
         if (cluster%m == 0) cycle
         clusters = [clusters(places(.not. cluster%holds(clusters%centre%s))), cluster]
      end do
   end subroutine find_clusters

   !> The disc about 0 for a base that moves.
   !>
   !> s  the structure's roots
   function base_cluster(assembly, s) result(cluster)
      type(assembly_t), intent(in) :: assembly
      complex(wp), intent(in) :: s(:)
      type(cluster_t) :: cluster

      cluster%is_base = .true.
      cluster%m = 2
      cluster%on_axis = .true.
      cluster%radius = minval(abs(s))/4
      ! 4**(-2 points) < 1e-17, and some for the powers of z.
      cluster%points = 20
      call nearest_pole(assembly, cluster%centre)
   end function base_cluster

   !> Where a mask is true.
   pure function places(mask)
      logical, intent(in) :: mask(:)
      integer :: places(count(mask)), k

      places = pack([(k, k=1, size(mask))], mask)
   end function places

   !> The fewest roots about a flagged one that stand well apart from all others. A disc that
   !> touches the real axis is moved onto it.
   !>
   !> others   found before: each is inside or outside as a whole
   !> compact  whether no other disc will do than one well apart, and small against its distance
   !>          from 0
   !> cluster  m = 0: there is no such disc
   subroutine gather(assembly, all, flagged, others, compact, cluster)
      type(assembly_t), intent(in) :: assembly
      type(root_t), intent(in) :: all(:), flagged
      type(cluster_t), intent(in) :: others(:)
      logical, intent(in) :: compact
      type(cluster_t), intent(out) :: cluster
      complex(wp) :: from(size(all)), centre
      logical :: inside(size(all)), on_axis
      real(wp) :: g, o, least, radius
      integer :: i, m

      do i = 1, size(all)
         from(i) = (assembly%pole(all(i)%origin, all(i)%side) &
            - assembly%pole(flagged%origin, flagged%side)) + (all(i)%offset - flagged%offset)
      end do
      centre = 0
      on_axis = .false.
      least = merge(well_apart, barely_apart, compact)
      m = 1
      do while (m < min(most_roots, size(all) - 1))
         m = m + 1
         inside = nearest(from, centre, m)
         centre = sum(from, mask=inside)/m
         if (on_axis) centre = cmplx(real(centre), -aimag(flagged%s), wp)
         inside = nearest(from, centre, m)
         g = maxval(abs(from - centre), mask=inside)
         o = minval(abs(from - centre), mask=.not. inside)
         ! The double pole at 0 of a base that moves is outside too.
         if (assembly%feels_base) o = min(o, abs(flagged%s + centre))
         radius = max(sqrt(g*o), 0.4_wp*o)
         if (.not. on_axis .and. abs(aimag(flagged%s + centre)) <= radius) then
            on_axis = .true.
            least = merge(well_apart, barely_apart, compact)
            m = 1
            cycle
         end if
         if (.not. g < least*o .or. splits(others)) cycle
         if (compact .and. .not. g < well_apart*abs(flagged%s + centre)) cycle
         least = g/o
         cluster%m = m
         cluster%centre = flagged
         cluster%centre%offset = flagged%offset + centre
         cluster%centre%s = flagged%s + centre
         cluster%on_axis = on_axis
         cluster%radius = radius
         ! The error is (R/o)**points + (g/R)**points, but for the powers of z.
         cluster%points = m + 2 + max(32, ceiling(40/log(o/radius)))
         if (least < well_apart) exit
      end do
      if (cluster%on_axis) then
         cluster%centre%s = real(cluster%centre%s)
         cluster%points = (cluster%points + 1)/2
      end if

   contains

      !> Whether the disc holds a part of another cluster only.
      pure logical function splits(others)
         type(cluster_t), intent(in) :: others(:)
         integer :: k, shared

         splits = .false.
         do k = 1, size(others)
            shared = count(others(k)%holds(all%s) .and. inside)
            splits = splits .or. (shared > 0 .and. shared < others(k)%m)
         end do
      end function splits

   end subroutine gather

   !> The m points nearest to a centre.
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

   !> Whether a root is one of these.
   elemental logical function holds(self, s)
      class(cluster_t), intent(in) :: self
      complex(wp), intent(in) :: s

      holds = abs(s - self%centre%s) <= self%radius
   end function holds

   !> Whether its derivatives are those with respect to these parameters.
   pure logical function knows(self, parameters)
      class(cluster_t), intent(in) :: self
      integer, intent(in) :: parameters(:)

      knows = size(self%parameters) == size(parameters)
      if (knows) knows = all(self%parameters == parameters)
   end function knows

   !> Whether the contour holds as many roots as were found in it.
   elemental logical function is_complete(self)
      class(cluster_t), intent(in) :: self

      is_complete = abs(self%counted - merge(0, self%m, self%is_base)) < 1e-3_wp
   end function is_complete

   !> What counts for the mirror image too.
   pure real(wp) function weight(self)
      class(cluster_t), intent(in) :: self

      weight = merge(1.0_wp, 2.0_wp, self%on_axis)
   end function weight

   !> How many modes: pairs of roots.
   elemental integer function modes(self)
      class(cluster_t), intent(in) :: self

      modes = self%m
      if (self%on_axis) modes = self%m/2
   end function modes

   !> d c/d parameter of the mean of the roots.
   pure complex(wp) function dmean(self, parameter)
      class(cluster_t), intent(in) :: self
      integer, intent(in) :: parameter

      dmean = -self%radius*self%da(self%m, parameter)/self%m
   end function dmean

end module beamid_clusters
