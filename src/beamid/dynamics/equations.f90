!> The semidiscrete equations (3.13), M w'' + C w' + K w = f(t) F, of one structure on one mesh.
!>
!> The unknowns are the spline coefficients followed by the displacement y of the hose. The hose
!> couples only with the splines that do not vanish at the tip, so that placed last it costs
!> nothing: M, C and K keep the half-bandwidth of the splines, 3 for cubics.
module beamid_equations
   use beamid_bands, only: band_t, new_band
   use beamid_constraints, only: constraints_t
   use beamid_excitation, only: excitation_t
   use beamid_galerkin, only: galerkin_t, mesh_t
   use beamid_kinds, only: wp
   use beamid_structure, only: structure_t
   use beamid_terms, only: bending, force_value, hose, inertia, is_spring, load_shape, &
      of_compliance, of_damping, of_load, of_mass, of_stiffness, operators, place_on_mesh, pulls, &
      root_slope, sensor_slope, sensor_value, strengths, stretch, tilting, tip_value, weight
   implicit none
   private

   public :: equations_t, new_equations, unknowns_of

   type :: equations_t
      integer :: n = 0                       !< number of unknowns
      type(band_t) :: mass                   !< M
      type(band_t) :: damping                !< C
      type(band_t) :: stiffness              !< K
      !> (n) F, per unit force, or per unit acceleration of the base
      real(wp), allocatable :: load(:)
      !> (n, 2) per unit velocity and displacement of the base; not allocated: none
      real(wp), allocatable :: base_loads(:, :)
      real(wp) :: lifted = 0                 !< displacement of the sensor that goes with the base's
      real(wp) :: tilted = 0                 !< what it reads of gravity thereby
      real(wp), allocatable :: shape(:)      !< of a distributed load; not allocated: none
      real(wp), allocatable :: tip(:)        !< (n) tip displacement = tip . w
      real(wp), allocatable :: observer(:)   !< (n) displacement of the sensor = observer . w
      !> (n) what a sensor that turns reads of gravity = tilt . w; not allocated: none
      real(wp), allocatable :: tilt(:)
      type(band_t) :: pull                   !< of axial force and weight; not allocated: none
      !> (n, operators) vectors whose squares the operators at points are; 0: the others
      real(wp), allocatable :: point(:, :)
      !> (n) displacement that one unit of each unknown stands for
      real(wp), allocatable :: unit(:)
      type(constraints_t) :: constraints     !< of rigid supports
      type(galerkin_t), pointer :: galerkin => null()   !< the integrals it was assembled from
      type(structure_t) :: structure
      real(wp), allocatable :: strength(:, :)   !< (operators, matrices) of `beamid_terms`
      !> (bending points of the mesh, 2) factors of stiffness and viscosity
      real(wp), allocatable :: factor(:, :)
      real(wp) :: omega = 0                  !< estimate of the first angular frequency [1/time]
      real(wp) :: displacement = 0           !< estimate of the size of the displacement [length]
   contains
      procedure :: subtract_internal_force
      procedure :: strain_energy
      procedure :: buckles
   end type equations_t

contains

   !> Assembles (3.11) with the point load, or with the distributed load of (3.10), or for a base
   !> that moves.
   !>
   !> galerkin  must outlive the result, which points to it; `turning` for a root that is not rigid;
   !>           its length need not be the structure's
   !> matrices  .false.: M, C and K stay away, for a solver that works in modes; default .true.
   function new_equations(galerkin, structure, excitation, matrices) result(self)
      type(galerkin_t), intent(in), target :: galerkin
      type(structure_t), intent(in) :: structure
      type(excitation_t), intent(in) :: excitation
      logical, intent(in), optional :: matrices
      type(equations_t) :: self
      integer :: k, n

      self%galerkin => galerkin
      self%structure = structure
      self%strength = strengths(structure, galerkin%space%length)
      n = galerkin%space%n
      if (structure%has_hose()) n = n + 1
      self%n = n
      if (excitation%distributed) self%shape = galerkin%moments(excitation%power)
      if (present(matrices)) then
         if (.not. matrices) return
      end if
      self%factor = galerkin%known
      if (structure%varies_further()) then
         do k = 1, size(self%factor, 1)
            self%factor(k, :) = self%factor(k, :)*structure%factors(galerkin%bent%xi(k))
         end do
      end if
      call find_points(self, n)
      ! The B-splines add up to degree!, the hose moves by y itself.
      allocate (self%unit(n), source=1.0_wp)
      self%unit(:galerkin%space%n) = gamma(galerkin%mesh%degree + 1.0_wp)
      if (any(pulls([(k, k=1, size(operators))]) .and. abs(self%strength(:, of_stiffness)) > 0)) &
         call find_pull(self)
      self%mass = sum_of_terms(self, of_mass)
      self%damping = sum_of_terms(self, of_damping)
      self%stiffness = sum_of_terms(self, of_stiffness)
      self%observer = self%point(:, sensor_value(structure%observer))
      if (structure%g > 0) self%tilt = tilting(structure)*galerkin%space%length/structure%length &
         *self%point(:, sensor_slope(structure%observer))
      if (excitation%is_base) then
         call set_base_loads(self)
      else
         self%load = self%strength(force_value, of_load)*self%point(:, force_value)
         if (excitation%distributed) self%load(:galerkin%space%n) = self%load(:galerkin%space%n) &
            + self%strength(load_shape, of_load)*self%shape
      end if
      call constrain(self)
      self%n = self%mass%n
      self%tip = self%point(:, tip_value)
      self%omega = structure%omega()
      ! A force on a support moves nothing there; what it moves elsewhere is not that small.
      self%displacement = excitation%size_scale(min(abs(structure%stiffness()), &
         1e4_wp*structure%tip_stiffness()), self%omega)
      if (excitation%is_base) self%displacement = self%displacement*(structure%m_T &
         + structure%rho*structure%length)
   end function new_equations

   !> How many unknowns there are on a mesh, less those that rigid supports take away.
   pure integer function unknowns_of(mesh, structure)
      type(mesh_t), intent(in) :: mesh
      type(structure_t), intent(in) :: structure

      unknowns_of = mesh%elements + mesh%degree - 2 + count([structure%has_root_spring(), &
         structure%has_hose()]) - structure%rigid_supports()
   end function unknowns_of

   !> The vectors of the operators at points.
   !>
   !> n  unknowns
   subroutine find_points(self, n)
      type(equations_t), intent(inout) :: self
      integer, intent(in) :: n
      integer :: k

      associate (space => self%galerkin%space)
         allocate (self%point(n, size(operators)), source=0.0_wp)
         do k = 1, size(operators)
            if (operators(k)%derivative < 0) cycle
            self%point(:space%n, k) = space%at(place_on_mesh(k, self%structure, space%length), &
               operators(k)%derivative)
         end do
         if (n == space%n) return
         self%point(n, hose) = 1
         self%point(:, stretch) = self%point(:, hose) - self%point(:, tip_value)
      end associate
   end subroutine find_points

   !> M, C or K, term by term.
   function sum_of_terms(self, matrix) result(band)
      type(equations_t), intent(in) :: self
      integer, intent(in) :: matrix
      type(band_t) :: band, bent
      integer :: k

      associate (g => self%galerkin, s => self%strength(:, matrix))
         band = new_band(size(self%point, 1), g%inertia%kd)
         bent = g%bending
         if (matrix == of_damping .and. g%varies) bent = g%viscous
         if (self%structure%varies_further() .and. matrix /= of_mass) &
            bent = g%bending_band(self%factor(:, merge(1, 2, matrix == of_stiffness)))
         band%a(:, :g%space%n) = s(bending)*bent%a
         if (matrix == of_damping .and. g%varies) then
            band%a(:, :g%space%n) = band%a(:, :g%space%n) + s(inertia)*g%air%a
         else
            band%a(:, :g%space%n) = band%a(:, :g%space%n) + s(inertia)*g%inertia%a
         end if
         if (matrix == of_stiffness .and. allocated(self%pull%a)) &
            band%a(:, :g%space%n) = band%a(:, :g%space%n) + self%pull%a
         do k = 1, size(s)
            if (abs(s(k)) > 0) call band%add_rank_one(s(k), self%point(:, k))
         end do
      end associate
   end function sum_of_terms

   !> Axial force and weight.
   subroutine find_pull(self)
      type(equations_t), intent(inout) :: self
      type(band_t) :: part
      integer :: k

      associate (g => self%galerkin, s => self%strength(:, of_stiffness))
         self%pull = new_band(g%space%n, g%inertia%kd)
         do k = 1, size(operators)
            if (.not. (pulls(k) .and. abs(s(k)) > 0)) cycle
            part = g%slope_band(place_on_mesh(k, self%structure, g%space%length), &
               merge(0.0_wp, s(k), k == weight), merge(s(k), 0.0_wp, k == weight))
            self%pull%a = self%pull%a + part%a
         end do
      end associate
   end subroutine find_pull

   !> Whether axial force or weight take the last stiffness away.
   logical function buckles(self)
      class(equations_t), intent(in) :: self
      type(band_t) :: factor
      logical :: positive

      buckles = .false.
      if (.not. allocated(self%pull%a)) return
      factor = self%stiffness
      ! A hose that no spring holds is no matter of stiffness.
      if (self%structure%has_hose() .and. .not. self%structure%k_H > 0) &
         call factor%add(self%n, self%n, self%structure%tip_stiffness())
      call factor%factor(positive)
      buckles = .not. positive
   end function buckles

   !> The loads of a base that moves: -M r, -C r and -K r, r the displacement of the whole by one.
   !> Where rigid supports stay behind, the beam is bent by the static shape that they leave.
   subroutine set_base_loads(self)
      type(equations_t), intent(inout) :: self
      real(wp) :: loads(size(self%point, 1), 3)
      real(wp), allocatable :: bent(:)
      integer :: k

      loads = 0
      associate (n => self%galerkin%space%n, s => self%strength(:, :of_stiffness))
         loads(:n, 1) = -s(inertia, of_mass)*self%galerkin%moments(0.0_wp, mass=.true.)
         loads(:n, 2) = -s(inertia, of_damping)*self%galerkin%moments(0.0_wp)
         do k = bending + 1, size(operators)
            if (operators(k)%moves_with_base) loads = loads - spread(self%point(:, k), 2, 3) &
               *spread(s(k, :), 1, size(loads, 1))
         end do
      end associate
      call bend(self, bent)
      self%lifted = dot_product(self%observer, bent)
      if (allocated(self%tilt)) self%tilted = dot_product(self%tilt, bent)
      self%load = loads(:, 1) - self%mass%times(bent)
      ! K times that shape is a force at the supports, which move nothing there.
      self%base_loads = loads(:, 2:)
      self%base_loads(:, 1) = self%base_loads(:, 1) - self%damping%times(bent)
   end subroutine set_base_loads

   !> The static shape with a displacement of -1 at every rigid support; 0 where there is none.
   subroutine bend(self, shape)
      type(equations_t), intent(in) :: self
      real(wp), allocatable, intent(out) :: shape(:)
      type(band_t) :: factor
      real(wp), allocatable :: answers(:, :)
      integer, allocatable :: held(:)
      logical :: positive
      integer :: i, k

      allocate (shape(size(self%point, 1)), source=0.0_wp)
      held = held_operators(self)
      if (size(held) == 0) return
      factor = self%stiffness
      ! Springs where nothing moves change nothing, and hold a beam that only its supports hold.
      do k = 1, size(held)
         call factor%add_rank_one(self%structure%tip_stiffness()*self%galerkin%space%length &
            **(2*operators(held(k))%derivative), self%point(:, held(k)))
      end do
      ! A hose that no spring holds takes no part in the static shape.
      if (self%structure%has_hose() .and. .not. self%structure%k_H > 0) call factor%add( &
         size(shape), size(shape), self%structure%tip_stiffness())
      call factor%factor(positive)
      if (.not. positive) return
      answers = self%point(:, held)
      do k = 1, size(held)
         call factor%solve(answers(:, k))
         do i = 1, k - 1
            answers(:, k) = answers(:, k) - answers(:, i)*dot_product(self%point(:, held(i)), &
               answers(:, k))
         end do
         answers(:, k) = answers(:, k)/dot_product(self%point(:, held(k)), answers(:, k))
      end do
      ! Column k moves support k by one and those before it not at all; the clamp turns with the
      ! base.
      do k = 1, size(held)
         shape = shape - answers(:, k)*(merge(0, 1, held(k) == root_slope) &
            + dot_product(self%point(:, held(k)), shape))
      end do
   end subroutine bend

   !> Operators of springs that do not give way at all.
   pure function held_operators(self) result(held)
      type(equations_t), intent(in) :: self
      integer, allocatable :: held(:)
      integer :: k

      held = pack([(k, k=1, size(operators))], [(is_spring(k, self%structure), &
         k=1, size(operators))] .and. .not. self%strength(:, of_compliance) > 0)
      if (self%galerkin%space%turning == 0) held = pack(held, held /= root_slope)
   end function held_operators

   !> Eliminates what rigid supports hold.
   subroutine constrain(self)
      type(equations_t), intent(inout) :: self
      real(wp), allocatable :: reduced(:, :)
      integer, allocatable :: held(:)
      integer :: k

      held = held_operators(self)
      do k = 1, size(held)
         call self%constraints%add(self%point(:, held(k)))
      end do
      if (self%constraints%number() == 0) return
      self%mass = self%constraints%of_matrix(self%mass)
      self%damping = self%constraints%of_matrix(self%damping)
      self%stiffness = self%constraints%of_matrix(self%stiffness)
      self%load = self%constraints%of_vector(self%load)
      self%observer = self%constraints%of_vector(self%observer)
      if (allocated(self%tilt)) self%tilt = self%constraints%of_vector(self%tilt)
      self%unit = self%unit(1 + self%constraints%number():)
      allocate (reduced(self%mass%n, size(operators)))
      do k = 1, size(operators)
         reduced(:, k) = self%constraints%of_vector(self%point(:, k))
      end do
      call move_alloc(reduced, self%point)
      if (.not. allocated(self%base_loads)) return
      allocate (reduced(self%mass%n, 2))
      do k = 1, 2
         reduced(:, k) = self%constraints%of_vector(self%base_loads(:, k))
      end do
      call move_alloc(reduced, self%base_loads)
   end subroutine constrain

   !> force := force - C v - K w without the cancellation that the band matrices suffer on fine
   !> meshes.
   !>
   !> w, v, force  (n)
   subroutine subtract_internal_force(self, w, v, force)
      class(equations_t), intent(in) :: self
      real(wp), intent(in) :: w(:), v(:)
      real(wp), intent(inout) :: force(:)
      real(wp), allocatable :: internal(:)
      real(wp) :: pull
      integer :: k

      if (self%constraints%number() > 0) then
         allocate (internal(size(w) + self%constraints%number()), source=0.0_wp)
         call subtract_beam_force(self, self%constraints%expanded(w), &
            self%constraints%expanded(v), internal)
         force = force + self%constraints%of_vector(internal)
      else
         call subtract_beam_force(self, w, v, force)
      end if
      associate (c => self%strength(:, of_damping), s => self%strength(:, of_stiffness))
         do k = bending + 1, size(s)
            if (.not. abs(s(k)) + abs(c(k)) > 0) cycle
            pull = s(k)*dot_product(self%point(:, k), w) + c(k)*dot_product(self%point(:, k), v)
            force = force - pull*self%point(:, k)
         end do
      end associate
   end subroutine subtract_internal_force

   !> The part of the beam itself.
   subroutine subtract_beam_force(self, w, v, force)
      type(equations_t), intent(in) :: self
      real(wp), intent(in) :: w(:), v(:)
      real(wp), intent(inout) :: force(:)

      associate (n => self%galerkin%space%n, c => self%strength(:, of_damping), &
         s => self%strength(:, of_stiffness))
         call self%galerkin%subtract_bending_force(s(bending)*self%factor(:, 1), &
            c(bending)*self%factor(:, 2), w(:n), v(:n), force(:n))
         if (self%galerkin%varies) then
            call self%galerkin%air%add_product(-c(inertia), v(:n), force(:n))
         else if (c(inertia) > 0) then
            call self%galerkin%inertia%add_product(-c(inertia), v(:n), force(:n))
         end if
         if (allocated(self%pull%a)) call self%pull%add_product(-1.0_wp, w(:n), force(:n))
      end associate
   end subroutine subtract_beam_force

   !> x' K x without the cancellation that the band matrix K suffers on fine meshes.
   !>
   !> x  (n)
   real(wp) function strain_energy(self, x)
      class(equations_t), intent(in) :: self
      real(wp), intent(in) :: x(:)
      real(wp), allocatable :: bent(:)
      integer :: k

      bent = self%constraints%expanded(x)
      associate (n => self%galerkin%space%n, s => self%strength(:, of_stiffness))
         strain_energy = s(bending)*self%galerkin%bending_energy(bent(:n), self%factor(:, 1))
         if (allocated(self%pull%a)) strain_energy = strain_energy &
            + dot_product(bent(:n), self%pull%times(bent(:n)))
         do k = bending + 1, size(s)
            if (abs(s(k)) > 0) strain_energy = strain_energy &
               + s(k)*dot_product(self%point(:, k), x)**2
         end do
      end associate
   end function strain_energy

end module beamid_equations
