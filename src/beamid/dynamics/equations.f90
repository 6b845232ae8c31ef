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
   implicit none
   private

   public :: equations_t, new_equations

   type :: equations_t
      integer :: n = 0                       !< number of unknowns
      type(band_t) :: mass                   !< M
      type(band_t) :: damping                !< C
      type(band_t) :: stiffness              !< K
      real(wp), allocatable :: load(:)       !< (n) F, per unit force
      real(wp), allocatable :: tip(:)        !< (n) tip displacement = tip . w
      real(wp), allocatable :: observer(:)   !< (n) displacement of the sensor = observer . w
      real(wp), allocatable :: root(:)       !< (n) slope at the root = root . w
      !> (n) displacement that one unit of each unknown stands for
      real(wp), allocatable :: unit(:)
      type(galerkin_t), pointer :: galerkin => null()   !< the integrals it was assembled from
      type(structure_t) :: structure
      real(wp) :: omega = 0                  !< estimate of the first angular frequency [1/time]
      real(wp) :: displacement = 0           !< estimate of the size of the displacement [length]
   contains
      procedure :: subtract_internal_force
      procedure :: strain_energy
   end type equations_t

contains

   !> Assembles (3.11) with the point load, or with the distributed load of (3.10).
   !>
   !> galerkin  must outlive the result, which points to it; `turning` for a root that is not rigid
   !> matrices  .false.: M, C and K stay away, for a solver that works in modes; default .true.
   function new_equations(galerkin, structure, excitation, matrices) result(self)
      type(galerkin_t), intent(in), target :: galerkin
      type(structure_t), intent(in) :: structure
      type(excitation_t), intent(in) :: excitation
      logical, intent(in), optional :: matrices
      type(equations_t) :: self
      real(wp), allocatable :: hose(:), slope(:)
      integer :: n

      self%galerkin => galerkin
      self%structure = structure
      n = galerkin%space%n
      self%n = n
      if (structure%has_hose()) self%n = n + 1
      allocate (self%load(self%n), source=0.0_wp)
      self%load(:n) = galerkin%tip
      if (excitation%distributed) self%load(:n) = galerkin%tip + galerkin%moments(excitation%power)
      if (present(matrices)) then
         if (.not. matrices) return
      end if
      allocate (self%tip(self%n), self%observer(self%n), self%root(self%n), hose(self%n), &
         slope(self%n), source=0.0_wp)

      ! The B-splines add up to degree!, the hose moves by y itself.
      allocate (self%unit(self%n), source=1.0_wp)
      self%unit(:n) = gamma(galerkin%mesh%degree + 1.0_wp)
      self%tip(:n) = galerkin%tip
      self%observer(:n) = galerkin%space%at(structure%sensor_place(), 0)
      self%root(:n) = galerkin%space%at(0.0_wp, 1)
      slope(:n) = galerkin%space%at(structure%length, 1)

      self%mass = scaled(structure%rho, galerkin%inertia, self%n)
      self%damping = scaled(structure%c_D*structure%I, galerkin%bending, self%n)
      self%stiffness = scaled(structure%E*structure%I, galerkin%bending, self%n)
      self%damping%a(:, :n) = self%damping%a(:, :n) + structure%gamma*galerkin%inertia%a
      call self%mass%add_rank_one(structure%m_T, self%tip)
      call self%mass%add_rank_one(structure%J_T, slope)
      call self%mass%add_rank_one(structure%m_S, self%observer)
      if (structure%has_soft_root()) call self%stiffness%add_rank_one(structure%k_R, self%root)
      if (structure%has_hose()) then
         hose = -self%tip
         hose(n + 1) = 1
         call self%mass%add(n + 1, n + 1, structure%m_H)
         call self%damping%add_rank_one(structure%c_H, hose)
         call self%stiffness%add_rank_one(structure%k_H, hose)
      end if

      self%omega = structure%omega()
      self%displacement = excitation%size_scale(structure%stiffness(), self%omega)
   end function new_equations

   !> force := force - C v - K w without the cancellation that the band matrices suffer on fine
   !> meshes.
   !>
   !> w, v, force  (n)
   subroutine subtract_internal_force(self, w, v, force)
      class(equations_t), intent(in) :: self
      real(wp), intent(in) :: w(:), v(:)
      real(wp), intent(inout) :: force(:)
      real(wp) :: pull

      associate (n => self%galerkin%space%n, s => self%structure, tip => self%galerkin%tip)
         call self%galerkin%add_bending_force(-s%I, s%E*w(:n) + s%c_D*v(:n), force(:n))
         if (s%gamma > 0) call self%galerkin%inertia%add_product(-s%gamma, v(:n), force(:n))
         if (s%has_soft_root()) force = force - s%k_R*dot_product(self%root, w)*self%root
         if (.not. s%has_hose()) return
         pull = s%k_H*(w(n + 1) - dot_product(tip, w(:n))) &
            + s%c_H*(v(n + 1) - dot_product(tip, v(:n)))
         force(:n) = force(:n) + pull*tip
         force(n + 1) = force(n + 1) - pull
      end associate
   end subroutine subtract_internal_force

   !> x' K x without the cancellation that the band matrix K suffers on fine meshes.
   !>
   !> x  (n)
   pure real(wp) function strain_energy(self, x)
      class(equations_t), intent(in) :: self
      real(wp), intent(in) :: x(:)

      associate (n => self%galerkin%space%n, s => self%structure)
         strain_energy = s%E*s%I*self%galerkin%bending_energy(x(:n))
         if (s%has_soft_root()) strain_energy = strain_energy &
            + s%k_R*dot_product(self%root, x)**2
         if (s%has_hose()) strain_energy = strain_energy &
            + s%k_H*(x(n + 1) - dot_product(self%galerkin%tip, x(:n)))**2
      end associate
   end function strain_energy

   !> factor * band, enlarged by zero rows to order n.
   pure function scaled(factor, band, n) result(matrix)
      real(wp), intent(in) :: factor
      type(band_t), intent(in) :: band
      integer, intent(in) :: n
      type(band_t) :: matrix

      matrix = new_band(n, band%kd)
      matrix%a(:, :band%n) = factor*band%a
   end function scaled

end module beamid_equations
