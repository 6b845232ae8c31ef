!> The semidiscrete equations (3.13), M w'' + C w' + K w = f(t) F, of one structure on one mesh.
!>
!> The unknowns are the spline coefficients followed by the displacement y of the hose. The hose
!> couples only with the splines that do not vanish at the tip, so that placed last it costs
!> nothing: M, C and K keep the half-bandwidth of the splines, 3 for cubics.
module beamid_equations
   use beamid_bands, only: band_t, new_band
   use beamid_excitation, only: excitation_t
   use beamid_galerkin, only: galerkin_t
   use beamid_kinds, only: wp
   use beamid_structure, only: structure_t
   use beamid_terms, only: bending, hose, inertia, load_shape, of_damping, of_load, of_mass, &
      of_stiffness, root_slope, sensor_value, strengths, stretch, tip_slope, tip_value
   implicit none
   private

   public :: equations_t, new_equations

   type :: equations_t
      integer :: n = 0                       !< number of unknowns
      type(band_t) :: mass                   !< M
      type(band_t) :: damping                !< C
      type(band_t) :: stiffness              !< K
      real(wp), allocatable :: load(:)       !< (n) F, per unit force
      real(wp), allocatable :: shape(:)      !< (n) of a distributed load; not allocated: none
      real(wp), allocatable :: tip(:)        !< (n) tip displacement = tip . w
      real(wp), allocatable :: observer(:)   !< (n) displacement of the sensor = observer . w
      !> (n, operators) vectors whose squares the operators at points are; 0: the others
      real(wp), allocatable :: point(:, :)
      !> (n) displacement that one unit of each unknown stands for
      real(wp), allocatable :: unit(:)
      type(galerkin_t), pointer :: galerkin => null()   !< the integrals it was assembled from
      type(structure_t) :: structure
      real(wp), allocatable :: strength(:, :)   !< (operators, matrices) of `beamid_terms`
      real(wp) :: omega = 0                  !< estimate of the first angular frequency [1/time]
      real(wp) :: displacement = 0           !< estimate of the size of the displacement [length]
   contains
      procedure :: subtract_internal_force
      procedure :: strain_energy
   end type equations_t

contains

   !> Assembles (3.11) with the point load, or with the distributed load of (3.10).
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
      integer :: n

      self%galerkin => galerkin
      self%structure = structure
      self%strength = strengths(structure, galerkin%space%length)
      n = galerkin%space%n
      self%n = n
      if (structure%has_hose()) self%n = n + 1
      allocate (self%load(self%n), source=0.0_wp)
      self%load(:n) = self%strength(tip_value, of_load)*galerkin%tip
      if (excitation%distributed) then
         self%shape = galerkin%moments(excitation%power)
         self%load(:n) = self%load(:n) + self%strength(load_shape, of_load)*self%shape
      end if
      if (present(matrices)) then
         if (.not. matrices) return
      end if
      ! The B-splines add up to degree!, the hose moves by y itself.
      allocate (self%unit(self%n), source=1.0_wp)
      self%unit(:n) = gamma(galerkin%mesh%degree + 1.0_wp)
      call find_points(self)
      self%tip = self%point(:, tip_value)
      self%observer = self%point(:, sensor_value)
      self%mass = sum_of_terms(self, of_mass)
      self%damping = sum_of_terms(self, of_damping)
      self%stiffness = sum_of_terms(self, of_stiffness)
      self%omega = structure%omega()
      self%displacement = excitation%size_scale(structure%stiffness(), self%omega)
   end function new_equations

   !> The vectors of the operators at points.
   subroutine find_points(self)
      type(equations_t), intent(inout) :: self

      associate (space => self%galerkin%space, s => self%structure)
         associate (n => space%n, l => space%length)
            allocate (self%point(self%n, size(self%strength, 1)), source=0.0_wp)
            self%point(:n, tip_value) = self%galerkin%tip
            self%point(:n, tip_slope) = space%at(l, 1)
            self%point(:n, sensor_value) = space%at(s%sensor_place()*(l/s%length), 0)
            self%point(:n, root_slope) = space%at(0.0_wp, 1)
            if (self%n == n) return
            self%point(self%n, hose) = 1
            self%point(:, stretch) = self%point(:, hose) - self%point(:, tip_value)
         end associate
      end associate
   end subroutine find_points

   !> M, C or K, term by term.
   function sum_of_terms(self, matrix) result(band)
      type(equations_t), intent(in) :: self
      integer, intent(in) :: matrix
      type(band_t) :: band
      integer :: k

      associate (g => self%galerkin, s => self%strength(:, matrix))
         band = new_band(self%n, g%inertia%kd)
         band%a(:, :g%space%n) = s(inertia)*g%inertia%a + s(bending)*g%bending%a
         do k = 1, size(s)
            if (abs(s(k)) > 0) call band%add_rank_one(s(k), self%point(:, k))
         end do
      end associate
   end function sum_of_terms

   !> force := force - C v - K w without the cancellation that the band matrices suffer on fine
   !> meshes.
   !>
   !> w, v, force  (n)
   subroutine subtract_internal_force(self, w, v, force)
      class(equations_t), intent(in) :: self
      real(wp), intent(in) :: w(:), v(:)
      real(wp), intent(inout) :: force(:)
      real(wp) :: pull
      integer :: k

      associate (n => self%galerkin%space%n, c => self%strength(:, of_damping), &
         s => self%strength(:, of_stiffness))
         call self%galerkin%add_bending_force(-1.0_wp, s(bending)*w(:n) + c(bending)*v(:n), &
            force(:n))
         if (c(inertia) > 0) call self%galerkin%inertia%add_product(-c(inertia), v(:n), force(:n))
         do k = bending + 1, size(s)
            if (.not. abs(s(k)) + abs(c(k)) > 0) cycle
            pull = s(k)*dot_product(self%point(:, k), w) + c(k)*dot_product(self%point(:, k), v)
            force = force - pull*self%point(:, k)
         end do
      end associate
   end subroutine subtract_internal_force

   !> x' K x without the cancellation that the band matrix K suffers on fine meshes.
   !>
   !> x  (n)
   pure real(wp) function strain_energy(self, x)
      class(equations_t), intent(in) :: self
      real(wp), intent(in) :: x(:)
      integer :: k

      associate (n => self%galerkin%space%n, s => self%strength(:, of_stiffness))
         strain_energy = s(bending)*self%galerkin%bending_energy(x(:n))
         do k = bending + 1, size(s)
            if (abs(s(k)) > 0) strain_energy = strain_energy &
               + s(k)*dot_product(self%point(:, k), x)**2
         end do
      end associate
   end function strain_energy

end module beamid_equations
