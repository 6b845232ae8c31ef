!> Text for a terminal of a given width: paragraphs, and entries with a label on the left.
module beamid_help_pages
   use beamid_texts, only: left, text_t, wrapped
   implicit none
   private

   public :: help_page_t

   !> Terminals narrower than this get each label in a line of its own [characters].
   integer, parameter :: narrow = 60

   !> A growing text whose lines are no longer than the terminal is wide.
   type, extends(text_t) :: help_page_t
      integer :: width = 80     !< width of the terminal [characters]
   contains
      procedure :: paragraph
      procedure :: labelled
   end type help_page_t

contains

   !> Appends a paragraph.
   !>
   !> indent   indentation of all its lines [characters]
   !> hanging  further indentation of all lines but the first; default 0
   subroutine paragraph(self, indent, sentences, hanging)
      class(help_page_t), intent(inout) :: self
      integer, intent(in) :: indent
      character(len=*), intent(in) :: sentences
      integer, intent(in), optional :: hanging
      integer :: margin

      margin = indent
      if (present(hanging)) margin = indent + hanging
      call self%add(wrapped(repeat(' ', indent)//trim(sentences)//new_line('a'), margin, &
         self%width))
   end subroutine paragraph

   !> Appends an entry: a label, and beside it, in a narrow terminal below it, its explanation.
   !>
   !> indent  indentation of the label [characters]
   !> column  column before which the explanation begins
   subroutine labelled(self, indent, label, column, sentences)
      class(help_page_t), intent(inout) :: self
      integer, intent(in) :: indent, column
      character(len=*), intent(in) :: label, sentences

      if (self%width >= narrow .and. indent + len_trim(label) < column) then
         call self%add(wrapped(left(repeat(' ', indent)//trim(label), column)// &
            trim(sentences)//new_line('a'), column, self%width))
      else
         if (label /= '') call self%paragraph(indent, label, 2)
         call self%paragraph(min(column, indent + 2), sentences)
      end if
   end subroutine labelled

end module beamid_help_pages
