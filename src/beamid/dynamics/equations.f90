!> The semidiscrete equations (3.13), M w'' + C w' + K w = f(t) F, of one structure on one mesh.
!>
!> The unknowns are the spline coefficients and the displacements y of the hoses. A hose couples
!> only with the splines that do not vanish at its position, and y is the unknown next to these:
!> after all splines, if the hose hangs at the tip. M, C and K then keep the half-bandwidth of the
!> splines (3 for cubics), or exceed it by one for each hose elsewhere.
module beamid_equations
   use beamid_bands, only: band_t, new_band
   use beamid_constraints, only: constraints_t
   use beamid_errors, only: bad_input, error_t
   use beamid_excitation, only: excitation_t, new_pulse
   use beamid_galerkin, only: alone, galerkin_t, slope_band, with_air, with_mass
   use beamid_kinds, only: wp
   use beamid_mesh_unknowns, only: order_unknowns, points_of
   use beamid_static_shapes, only: find_static_shape
   use beamid_structure, only: structure_t
   use beamid_terms, only: bending, end_condition, force_value, hose, inertia, is_axial_force, &
      is_spring, load_shape, of_compliance, of_damping, of_load, of_mass, of_relaxation, &
      of_stiffness, operators, place_on_mesh, sensor_slope, sensor_value, strengths, stretch, &
      tilting, tip_value, weight
   implicit none
   private

   public :: equations_t, new_equations

   !> The equations of one structure. Sizes: n unknowns; `operators` and `matrices` as in
   !> `beamid_terms`. If supports are rigid, all vectors and matrices are those after the
   !> elimination of the constraints.
   type :: equations_t
      integer :: n = 0                       !< number of unknowns
      !> (splines) and (hoses) indices of the unknowns, before an elimination; 0: the hose has no
      !> mass
      integer, allocatable :: spline(:), hose(:)
      type(band_t) :: mass                   !< M
      type(band_t) :: damping                !< C
      type(band_t) :: stiffness              !< K
      !> (relaxations) relaxing stiffnesses K_l and their rates b_l [1/time]: the force K_l z acts,
      !> where z' = w' - b_l z
      type(band_t), allocatable :: relaxing(:)
      real(wp), allocatable :: rate(:)
      !> (n) F, per unit force or per unit acceleration of the base
      real(wp), allocatable :: load(:)
      !> (n, 2) loads per unit velocity and displacement of the base; not allocated: no base motion
      real(wp), allocatable :: base_loads(:, :)
      !> displacement of the sensor, per unit displacement of the base, that the unknowns do not
      !> contain
      real(wp) :: base_coupling = 0
      !> reading of the sensor due to gravity [1/time**2] that belongs to `base_coupling`
      real(wp) :: base_tilt = 0
      !> (splines) <theta, b> of a distributed load (3.10); not allocated: no distributed load
      real(wp), allocatable :: shape(:)
      real(wp), allocatable :: tip(:)        !< (n) displacement of the tip = tip . w
      real(wp), allocatable :: observer(:)   !< (n) displacement of the sensor = observer . w
      !> (n) reading of a tilted sensor due to gravity = tilt . w; not allocated: no gravity
      real(wp), allocatable :: tilt(:)
      !> (splines) stiffness due to axial force and weight; empty: neither acts
      type(band_t) :: geometric_stiffness
      !> (n, operators) row vector of each operator at a point (value or slope = point . w); 0 for
      !> the others
      real(wp), allocatable :: point(:, :)
      !> (n) displacement per unit of each unknown [length]
      real(wp), allocatable :: unit(:)
      type(constraints_t) :: constraints     !< constraints of the rigid supports
      !> the integrals of the mesh from which the matrices are assembled
      type(galerkin_t), pointer :: galerkin => null()
      type(structure_t) :: structure   !< the structure assembled
      !> (operators, matrices) coefficients, from `beamid_terms`
      real(wp), allocatable :: strength(:, :)
      !> (bending points, 2) E(x)/E and c_D(x)/c_D at the quadrature points
      real(wp), allocatable :: factor(:, :)
      real(wp) :: omega = 0                  !< estimate of the first angular frequency [1/time]
      real(wp) :: displacement = 0           !< estimate of the size of the displacement [length]
   contains
      procedure :: buckles, check_ends
   end type equations_t

contains

   !> Assembles the equations (3.11) with a force at a point, the distributed load (3.10), or a base
   !> that moves.
   !>
   !> galerkin    integrals of the mesh, from `galerkin_of`. The result points to them, so they must
   !>             outlive it. Its space must not satisfy conditions at the ends that are not
   !>             `essential` for the structure: `check_ends` refuses this. Its length may differ
   !>             from the structure's.
   !> structure   beam and attachments
   !> excitation  force or base motion; absent: none, as for natural modes
   !> matrices    .false.: leave out M, C and K, for a solver that works in modes; default .true.
   recursive function new_equations(galerkin, structure, excitation, matrices) result(self)
      type(galerkin_t), intent(in), target :: galerkin
      type(structure_t), intent(in) :: structure
      type(excitation_t), intent(in), optional :: excitation
      logical, intent(in), optional :: matrices
      type(equations_t) :: self
      integer :: k, kd, n

      if (.not. present(excitation)) then
         self = new_equations(galerkin, structure, new_pulse(0.0_wp, 1.0_wp), matrices)
         return
      end if
      self%galerkin => galerkin
      self%structure = structure
      n = galerkin%space%n + count(structure%has_hose())
      self%n = n
      if (excitation%distributed) self%shape = galerkin%moments(excitation%power, alone)
      if (present(matrices)) then
         if (.not. matrices) return
      end if
      self%strength = strengths(structure, galerkin%space%length)
      call order_unknowns(galerkin%space, structure, self%spline, self%hose)
      self%factor = galerkin%known
      if (structure%has_fields()) then
         do k = 1, size(self%factor, 1)
            self%factor(k, :) = self%factor(k, :)*structure%factors(galerkin%bent(k)%xi)
         end do
      end if
      self%point = points_of(galerkin%space, structure, self%spline, self%hose, n, &
         size(self%strength, 1))
      ! The B-splines add up to degree!. The unknown of the hose is its displacement.
      allocate (self%unit(n), source=1.0_wp)
      self%unit(self%spline) = gamma(galerkin%mesh%degree + 1.0_wp)
      if (any(is_axial_force([(k, k=1, size(self%strength, 1))]) .and. &
         abs(self%strength(:, of_stiffness)) > 0)) call find_geometric_stiffness(self)
      kd = half_bandwidth(self)
      self%mass = sum_of_terms(self, of_mass, kd)
      self%damping = sum_of_terms(self, of_damping, kd)
      self%stiffness = sum_of_terms(self, of_stiffness, kd)
      call set_relaxations(self, kd)
      self%observer = self%point(:, sensor_value(structure%observer))
      if (structure%g > 0) self%tilt = tilting(structure)*galerkin%space%length/structure%length &
         *self%point(:, sensor_slope(structure%observer))
      if (excitation%is_base) then
         call set_base_loads(self)
      else
         self%load = self%strength(force_value, of_load)*self%point(:, force_value)
         if (excitation%distributed) self%load(self%spline) = self%load(self%spline) &
            + self%strength(load_shape, of_load)*self%shape
      end if
      call constrain(self)
      self%n = self%mass%n
      self%tip = self%point(:, tip_value)
      self%omega = structure%omega()
      ! Limited because a force at a support moves other points by more than the support itself, and
      ! because a beam that little or nothing holds does not reach its static deflection.
      associate (scale => structure%tip_stiffness())
         self%displacement = excitation%size_scale(max(1e-2_wp*scale, &
            min(abs(structure%stiffness()), 1e4_wp*scale)), self%omega)
      end associate
      if (excitation%is_base) self%displacement = self%displacement*(structure%m_T &
         + structure%rho*structure%length)
   end function new_equations

   !> Returns the half-bandwidth of the matrices.
   pure integer function half_bandwidth(self) result(width)
      type(equations_t), intent(in) :: self
      integer :: h, k

      associate (kd => self%galerkin%inertia%kd, n => size(self%spline))
         width = maxval([kd, (self%spline(min(n, k + kd)) - self%spline(k), k=1, n)])
         do h = 1, size(self%hose)
            if (self%hose(h) > 0) width = max(width, self%hose(h) - findloc(abs(self%point(:, &
               stretch(h))) > 0, .true., dim=1))
         end do
      end associate
   end function half_bandwidth

   !> Adds a matrix of the splines to a matrix of all unknowns.
   subroutine add_splines(self, factor, part, band)
      type(equations_t), intent(in) :: self
      real(wp), intent(in) :: factor
      type(band_t), intent(in) :: part
      type(band_t), intent(inout) :: band
      integer :: i, j

      ! No hose stands between two splines.
      if (self%spline(part%n) == part%n) then
         band%a(:part%kd + 1, :part%n) = band%a(:part%kd + 1, :part%n) + factor*part%a
         return
      end if
      do j = 1, part%n
         do i = j, min(part%n, j + part%kd)
            call band%add(self%spline(i), self%spline(j), factor*part%a(1 + i - j, j))
         end do
      end do
   end subroutine add_splines

   !> Returns M, C or K, the sum of its terms.
   !>
   !> matrix  `of_mass`, `of_damping`, `of_stiffness` or a relaxing stiffness
   !> kd      half-bandwidth
   function sum_of_terms(self, matrix, kd) result(band)
      type(equations_t), intent(in) :: self
      integer, intent(in) :: matrix, kd
      type(band_t) :: band, bent, inert
      integer :: k

      associate (g => self%galerkin, s => self%strength(:, matrix))
         band = new_band(size(self%point, 1), kd)
         bent = g%bending
         inert = g%inertia
         if (matrix == of_damping .and. g%varies) then
            bent = g%viscous
            inert = g%air
         end if
         if (self%structure%has_fields() .and. matrix /= of_mass) &
            bent = g%bending_band(self%factor(:, merge(2, 1, matrix == of_damping)))
         call add_splines(self, s(bending), bent, band)
         call add_splines(self, s(inertia), inert, band)
         if (matrix == of_stiffness .and. allocated(self%geometric_stiffness%a)) &
            call add_splines(self, 1.0_wp, self%geometric_stiffness, band)
         do k = 1, size(s)
            if (abs(s(k)) > 0) call band%add_rank_one(s(k), self%point(:, k))
         end do
      end associate
   end function sum_of_terms

   !> Sets the relaxing stiffnesses.
   !>
   !> kd  half-bandwidth
   subroutine set_relaxations(self, kd)
      type(equations_t), intent(inout) :: self
      integer, intent(in) :: kd
      real(wp) :: rates(2)
      integer, allocatable :: acting(:)
      integer :: l

      rates = [self%structure%b_1, self%structure%b_2]
      acting = pack([1, 2], self%strength(bending, of_relaxation) > 0)
      self%rate = rates(acting)
      allocate (self%relaxing(size(acting)))
      do l = 1, size(acting)
         self%relaxing(l) = sum_of_terms(self, of_relaxation(acting(l)), kd)
      end do
   end subroutine set_relaxations

   !> Sets the stiffness due to axial force and weight.
   subroutine find_geometric_stiffness(self)
      type(equations_t), intent(inout) :: self
      type(band_t) :: part
      integer :: k

      associate (g => self%galerkin, s => self%strength(:, of_stiffness))
         self%geometric_stiffness = new_band(g%space%n, g%inertia%kd)
         do k = 1, size(s)
            if (.not. (is_axial_force(k) .and. abs(s(k)) > 0)) cycle
            part = slope_band(g%space, g%variations, &
               place_on_mesh(k, self%structure, g%space%length), &
               merge(0.0_wp, s(k), k == weight), merge(s(k), 0.0_wp, k == weight))
            self%geometric_stiffness%a = self%geometric_stiffness%a + part%a
         end do
      end associate
   end subroutine find_geometric_stiffness

   !> Returns whether axial force and weight make K lose its positive definiteness, i.e. buckle the
   !> beam.
   logical function buckles(self)
      class(equations_t), intent(in) :: self
      type(band_t) :: factor
      logical :: positive

      buckles = .false.
      if (.not. allocated(self%geometric_stiffness%a)) return
      factor = self%stiffness
      call hold_hoses(self, factor)
      call factor%factor(positive)
      buckles = .not. positive
   end function buckles

   !> Refuses a mesh whose splines hold an end that the structure does not hold: its response would
   !> be that of another beam.
   subroutine check_ends(self, error)
      class(equations_t), intent(in) :: self
      type(error_t), allocatable, intent(out) :: error

      if (any(self%galerkin%space%essential .and. .not. self%structure%essential())) &
         call bad_input(error, 'found a mesh that holds an end of the beam which the structure '// &
         'does not hold, expected the mesh of galerkin_of(mesh, structure)')
   end subroutine check_ends

   !> Adds a spring to each hose that has none: its mass takes no part in static shapes and does not
   !> buckle, but without stiffness K would be singular.
   !>
   !> stiffness  K, before or after the elimination as `point` is
   subroutine hold_hoses(self, stiffness)
      type(equations_t), intent(in) :: self
      type(band_t), intent(inout) :: stiffness
      integer :: h

      do h = 1, size(self%hose)
         if (self%hose(h) == 0 .or. self%structure%hose(h)%k_H > 0) cycle
         call stiffness%add_rank_one(self%structure%tip_stiffness(), self%point(:, hose(h)))
      end do
   end subroutine hold_hoses

   !> Sets the loads of a base that moves: -M r, -C r and -K r, where r is the rigid displacement of
   !> the whole structure by one. Rigid supports stay on the ground, so the base also bends the beam
   !> into the static shape of `bend_at_supports`.
   subroutine set_base_loads(self)
      type(equations_t), intent(inout) :: self
      real(wp) :: loads(size(self%point, 1), 3)
      real(wp), allocatable :: bent(:)
      integer :: k

      loads = 0
      associate (s => self%strength(:, :of_stiffness))
         loads(self%spline, 1) = -s(inertia, of_mass)*self%galerkin%moments(0.0_wp, with_mass)
         loads(self%spline, 2) = -s(inertia, of_damping)*self%galerkin%moments(0.0_wp, with_air)
         do k = bending + 1, size(s, 1)
            if (operators(k)%moves_with_base) loads = loads - spread(self%point(:, k), 2, 3) &
               *spread(s(k, :), 1, size(loads, 1))
         end do
      end associate
      call bend_at_supports(self, bent)
      self%base_coupling = dot_product(self%observer, bent)
      if (allocated(self%tilt)) self%base_tilt = dot_product(self%tilt, bent)
      self%load = loads(:, 1) - self%mass%times(bent)
      ! K times this shape is a force at the supports, which do not move.
      self%base_loads = loads(:, 2:)
      self%base_loads(:, 1) = self%base_loads(:, 1) - self%damping%times(bent)
   end subroutine set_base_loads

   !> Computes the static shape of the beam with displacement -1 at every rigid support. What holds
   !> the ends moves with the base, so a rigid end has displacement or slope 0.
   !>
   !> shape  (n before the elimination) 0 if no support is rigid
   subroutine bend_at_supports(self, shape)
      type(equations_t), intent(in) :: self
      real(wp), allocatable, intent(out) :: shape(:)
      type(band_t) :: stiffness
      real(wp), allocatable :: rows(:, :), springs(:), values(:)
      integer, allocatable :: rigid(:)

      allocate (shape(size(self%point, 1)), source=0.0_wp)
      rigid = rigid_operators(self)
      if (size(rigid) == 0) return
      stiffness = self%stiffness
      call hold_hoses(self, stiffness)
      springs = self%structure%tip_stiffness()*self%galerkin%space%length &
         **(2*operators(rigid)%derivative)
      rows = self%point(:, rigid)
      values = merge(-1.0_wp, 0.0_wp, operators(rigid)%moves_with_base)
      call find_static_shape(stiffness, springs, rows, values, shape)
   end subroutine bend_at_supports

   !> Returns the operators of the rigid springs (compliance 0), without those conditions at the
   !> ends which the spline space itself satisfies.
   pure function rigid_operators(self) result(rigid)
      type(equations_t), intent(in) :: self
      integer, allocatable :: rigid(:)
      integer :: k

      associate (n => size(self%strength, 1))
         rigid = pack([(k, k=1, n)], [(is_spring(k, self%structure), k=1, n)] .and. &
            .not. self%strength(:, of_compliance) > 0)
      end associate
      rigid = pack(rigid, [(.not. any(end_condition == rigid(k) .and. &
         self%galerkin%space%essential), k=1, size(rigid))])
   end function rigid_operators

   !> Eliminates the constraints of the rigid supports from matrices and vectors.
   subroutine constrain(self)
      type(equations_t), intent(inout) :: self
      integer, allocatable :: rigid(:)
      integer :: k

      rigid = rigid_operators(self)
      do k = 1, size(rigid)
         call self%constraints%add(self%point(:, rigid(k)))
      end do
      if (self%constraints%number() == 0) return
      self%mass = self%constraints%of_matrix(self%mass)
      self%damping = self%constraints%of_matrix(self%damping)
      self%stiffness = self%constraints%of_matrix(self%stiffness)
      do k = 1, size(self%relaxing)
         self%relaxing(k) = self%constraints%of_matrix(self%relaxing(k))
      end do
      self%load = self%constraints%of_vector(self%load)
      self%observer = self%constraints%of_vector(self%observer)
      if (allocated(self%tilt)) self%tilt = self%constraints%of_vector(self%tilt)
      self%unit = self%constraints%kept(self%unit)
      self%point = self%constraints%of_vectors(self%point)
      if (allocated(self%base_loads)) &
         self%base_loads = self%constraints%of_vectors(self%base_loads)
   end subroutine constrain

end module beamid_equations

