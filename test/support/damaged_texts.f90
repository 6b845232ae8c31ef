!> Small accidents to a text.
module damaged_texts
   use random_numbers, only: pick
   implicit none
   private

   public :: damage, dropped, doubled, any_byte, likely_byte, exchanged, other

   integer, parameter :: dropped = 1, doubled = 2, any_byte = 3, likely_byte = 4, exchanged = 5, &
      other = 6

contains

   !> One of several accidents to one byte but the last; an `other` one is left to the caller.
   !>
   !> likely  bytes that mean something in such a text
   subroutine damage(text, ways, likely, at, way)
      character(len=:), allocatable, intent(inout) :: text
      integer, intent(in) :: ways(:)
      character(len=*), intent(in) :: likely
      integer, intent(out) :: at, way
      character(len=1) :: letter

      at = pick(len(text) - 1)
      way = ways(pick(size(ways)))
      letter = text(at:at)
      select case (way)
      case (dropped)
         text = text(:at - 1)//text(at + 1:)
      case (doubled)
         text = text(:at)//text(at:)
      case (any_byte)
         text(at:at) = char(pick(256) - 1)
      case (likely_byte)
         text(at:at) = likely(pick(len(likely)):)
      case (exchanged)
         text(at:at) = text(at + 1:at + 1)
         text(at + 1:at + 1) = letter
      end select
   end subroutine damage

end module damaged_texts
