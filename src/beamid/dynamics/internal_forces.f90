!> Internal forces and strain energy of a deflected structure, computed from the curvature of the
!> beam. The band matrices C and K lose digits on fine meshes, because the products with them are
!> small differences of large numbers.
module beamid_internal_forces
   use beamid_equations, only: equations_t
   use beamid_kinds, only: wp
   use beamid_terms, only: bending, inertia, of_damping, of_stiffness
   implicit none
   private

   public :: subtract_internal_force, strain_energy

contains

   !> Subtracts C v + K w from a force.
   !>
   !> w, v   (n) unknowns and their velocity
   !> force  (n) in and out
   subroutine subtract_internal_force(self, w, v, force)
      type(equations_t), intent(in) :: self
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

   !> Subtracts the internal force of the beam itself, without attachments.
   !>
   !> w, v   (unknowns before the elimination) unknowns and their velocity
   !> force  (unknowns before the elimination) in and out
   subroutine subtract_beam_force(self, w, v, force)
      type(equations_t), intent(in) :: self
      real(wp), intent(in) :: w(:), v(:)
      real(wp), intent(inout) :: force(:)
      real(wp), dimension(size(self%spline)) :: on_splines, at, moving

      at = w(self%spline)
      moving = v(self%spline)
      on_splines = 0
      associate (c => self%strength(:, of_damping), s => self%strength(:, of_stiffness))
         call self%galerkin%subtract_bending_force(s(bending)*self%factor(:, 1), &
            c(bending)*self%factor(:, 2), at, moving, on_splines)
         if (self%galerkin%varies) then
            call self%galerkin%air%add_product(-c(inertia), moving, on_splines)
         else if (c(inertia) > 0) then
            call self%galerkin%inertia%add_product(-c(inertia), moving, on_splines)
         end if
         if (allocated(self%geometric_stiffness%a)) &
            call self%geometric_stiffness%add_product(-1.0_wp, at, on_splines)
      end associate
      force(self%spline) = force(self%spline) + on_splines
   end subroutine subtract_beam_force

   !> Returns x'K x, twice the strain energy.
   !>
   !> x  (n)
   real(wp) function strain_energy(self, x)
      type(equations_t), intent(in) :: self
      real(wp), intent(in) :: x(:)
      real(wp), allocatable :: bent(:)
      integer :: k

      bent = self%constraints%expanded(x)
      bent = bent(self%spline)
      associate (s => self%strength(:, of_stiffness))
         strain_energy = s(bending)*self%galerkin%bending_energy(bent, self%factor(:, 1))
         if (allocated(self%geometric_stiffness%a)) strain_energy = strain_energy &
            + dot_product(bent, self%geometric_stiffness%times(bent))
         do k = bending + 1, size(s)
            if (abs(s(k)) > 0) strain_energy = strain_energy &
               + s(k)*dot_product(self%point(:, k), x)**2
         end do
      end associate
   end function strain_energy

end module beamid_internal_forces
