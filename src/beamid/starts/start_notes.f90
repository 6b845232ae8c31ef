!> Says which parameters a search for start values has fixed, and why.
module beamid_start_notes
   use beamid_parameters, only: as_named
   use beamid_residuals, only: residual_t
   use beamid_start_choices, only: choice_t
   use beamid_strings, only: to_text
   use beamid_unknowns, only: quantity_t
   implicit none
   private

   public :: describe_fixed, describe_unknowable

contains

   !> Describes why a mode does not count, which parameters are therefore fixed, and at which
   !> values.
   !>
   !> asked     (free) parameters of the stage in the case
   !> choice    trial fits with the mode
   !> fewer     trial fits without it
   !> needed    number of the mode
   !> rejected  number of the mode that an earlier fit has rejected; 0: none
   subroutine describe_fixed(problem, asked, choice, fewer, needed, rejected, text)
      type(residual_t), intent(in) :: problem
      type(quantity_t), intent(in) :: asked(:)
      type(choice_t), intent(in) :: choice, fewer
      integer, intent(in) :: needed, rejected
      character(len=:), allocatable, intent(out) :: text
      character(len=:), allocatable :: absent
      integer :: k

      absent = 'fits no spectral line of '//trim(merge('this record  ', 'these records', &
         size(problem%parts) == 1))
      text = 'mode '//to_text(needed)//' '
      if (rejected > 0) then
         text = text//'cannot be told from a multiple of mode 1 or of the mains'
      else if (size(choice%trials) == 0) then
         text = text//absent
      else
         k = minloc([(choice%trials(k)%fit%J, k=1, size(choice%trials))], dim=1)
         associate (objection => choice%trials(k)%objection)
            if (choice%trials(k)%is_absent) then
               text = text//absent
            else if (index(objection, text) == 1) then
               text = objection
            else
               text = text//'is uncertain ('//objection//')'
            end if
         end associate
      end if
      call add_fixed(problem, asked, fewer, text)
   end subroutine describe_fixed

   !> Describes which parameters are fixed because no mode determines them; '': none.
   !>
   !> asked   (free) parameters of the stage in the case
   !> choice  trial fits without these parameters
   subroutine describe_unknowable(problem, asked, choice, text)
      type(residual_t), intent(in) :: problem
      type(quantity_t), intent(in) :: asked(:)
      type(choice_t), intent(in) :: choice
      character(len=:), allocatable, intent(out) :: text

      text = ''
      if (size(choice%quantities) == size(asked)) return
      text = 'the modes do not determine every free parameter'
      call add_fixed(problem, asked, choice, text)
   end subroutine describe_unknowable

   !> Adds the fixed parameters and their values to a sentence.
   !>
   !> asked   (free) parameters of the stage in the case
   !> choice  trial fits with the others
   subroutine add_fixed(problem, asked, choice, text)
      type(residual_t), intent(in) :: problem
      type(quantity_t), intent(in) :: asked(:)
      type(choice_t), intent(in) :: choice
      character(len=:), allocatable, intent(inout) :: text
      character(len=:), allocatable :: link
      integer :: k

      link = ' is held at '
      text = text//':'
      do k = 1, size(asked)
         associate (q => asked(k))
            if (any(choice%quantities%parameter == q%parameter .and. &
               choice%quantities%record == q%record)) cycle
            text = text//' '//trim(q%name)//link//to_text(as_named(q%parameter, &
               problem%scenario%get(q%parameter, q%record)))//','
            link = ' at '
         end associate
      end do
      text = text(:len(text) - 1)
   end subroutine add_fixed

end module beamid_start_notes
