!> The coefficients of the operators of a structure (`beamid_terms`), and their slopes: the
!> derivatives with respect to chosen parameters.
module beamid_coefficients
   use beamid_kinds, only: wp
   use beamid_structure, only: of_length, structure_t
   use beamid_terms, only: bending, force_value, of_compliance, of_relaxation, operators, &
      operators_of, place_on_mesh, strengths_and_slopes, terms
   implicit none
   private

   public :: coefficients_t

   !> A structure and the coefficients of its operators.
   type :: coefficients_t
      type(structure_t) :: structure
      integer, allocatable :: parameters(:)    !< numbers of the parameters of the slopes
      real(wp) :: mesh_length = 0              !< length of the beam of the mesh
      !> (operators, matrices, 0:parameters) coefficients for index 0, and their slopes
      real(wp), allocatable :: c(:, :, :)
   contains
      procedure :: set, renew, place, place_slopes, stays_at_tip
   end type coefficients_t

contains

   !> Sets the coefficients and their slopes.
   subroutine set(self, structure, mesh_length, parameters)
      class(coefficients_t), intent(out) :: self
      type(structure_t), intent(in) :: structure
      real(wp), intent(in) :: mesh_length
      integer, intent(in) :: parameters(:)

      self%structure = structure
      self%mesh_length = mesh_length
      self%parameters = parameters
      allocate (self%c(operators_of(structure), of_compliance, 0:size(parameters)))
      call strengths_and_slopes(structure, mesh_length, parameters, self%c(:, :, 0), &
         self%c(:, :, 1:))
   end subroutine set

   !> Changes to another structure and its coefficients, if they differ in values alone: the same
   !> coefficients and slopes are 0, all points are where they were, and nothing relaxes or varies
   !> along the beam.
   !>
   !> in_use  (operators) whether the operator has a point that matters
   !> done    .false.: something else differs; nothing is changed
   subroutine renew(self, structure, parameters, in_use, done)
      class(coefficients_t), intent(inout) :: self
      type(structure_t), intent(in) :: structure
      integer, intent(in) :: parameters(:)
      logical, intent(in) :: in_use(:)
      logical, intent(out) :: done
      real(wp) :: c(size(self%c, 1), size(self%c, 2), 0:size(parameters))
      integer :: t

      done = size(parameters) == size(self%parameters)
      if (done) done = all(parameters == self%parameters) .and. &
         .not. any(self%c(bending, of_relaxation, 0) > 0)
      if (done) done = has_same_places(self%structure, structure, in_use)
      if (.not. done) return
      call strengths_and_slopes(structure, self%mesh_length, parameters, c(:, :, 0), c(:, :, 1:))
      do t = 1, size(terms)
         associate (k => terms(t)%operator, matrix => terms(t)%matrix)
            if (k > size(c, 1)) exit
            done = all((abs(c(k, matrix, :)) > 0) .eqv. (abs(self%c(k, matrix, :)) > 0))
            if (.not. done) return
         end associate
      end do
      self%structure = structure
      self%c = c
   end subroutine renew

   !> Returns whether two structures have the same attachments and springs at the same places, and
   !> nothing varies along the beam of the second one.
   !>
   !> in_use  as of `renew`
   pure logical function has_same_places(old, new, in_use) result(same)
      type(structure_t), intent(in) :: old, new
      logical, intent(in) :: in_use(:)
      integer :: condition, k

      same = .false.
      if (new%has_fields() .or. abs(new%length - old%length) > 0 .or. any([new%sensors, &
         new%supports, new%masses, new%hoses, new%observer] /= [old%sensors, old%supports, &
         old%masses, old%hoses, old%observer])) return
      if (any(new%yields .neqv. old%yields)) return
      do condition = 1, 2
         do k = 1, 2
            if (new%has_end_spring(condition, k) .neqv. old%has_end_spring(condition, k)) return
         end do
         do k = 1, new%supports
            if (new%has_spring(k, condition) .neqv. old%has_spring(k, condition)) return
         end do
      end do
      do k = 1, size(in_use)
         if (operators(k)%place == 0 .or. .not. (in_use(k) .or. k == force_value)) cycle
         if (abs(new%get(operators(k)%place) - old%get(operators(k)%place)) > 0) return
      end do
      same = .true.
   end function has_same_places

   !> Returns the position of an operator on the beam of the mesh [length].
   pure real(wp) function place(self, operator)
      class(coefficients_t), intent(in) :: self
      integer, intent(in) :: operator

      place = place_on_mesh(operator, self%structure, self%mesh_length)
   end function place

   !> Returns the derivatives of an operator's position on the beam of the mesh with respect to the
   !> parameters, (parameters) [length per unit of the parameter].
   pure function place_slopes(self, operator) result(slopes)
      class(coefficients_t), intent(in) :: self
      integer, intent(in) :: operator
      real(wp) :: slopes(size(self%parameters))

      slopes = 0
      associate (s => self%structure, place => operators(operator)%place, l => self%mesh_length)
         if (place == 0) return
         where (self%parameters == place) slopes = l/s%length
         if (s%follows_tip(place)) return
         where (self%parameters == of_length) slopes = -s%place(place)*l/s%length**2
      end associate
   end function place_slopes

   !> Returns whether the point of an operator is the tip and no parameter moves it away.
   pure logical function stays_at_tip(self, operator)
      class(coefficients_t), intent(in) :: self
      integer, intent(in) :: operator

      associate (place => operators(operator)%place)
         stays_at_tip = place == 0
         if (place > 0) stays_at_tip = self%structure%follows_tip(place) .and. &
            .not. any(self%parameters == place)
      end associate
   end function stays_at_tip

end module beamid_coefficients
