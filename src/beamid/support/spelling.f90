!> Suggestions for misspelt words: the known word that a user may have meant.
module beamid_spelling
   use beamid_strings, only: lower
   implicit none
   private

   public :: or_nearest

contains

   !> Returns the place of the word with the smallest distance from the misspelt one: the number of
   !> letters that are changed, added, left out or exchanged with their neighbour, in upper or lower
   !> case. 0: the distance is more than a third of the letters for every word.
   pure integer function nearest(word, words)
      character(len=*), intent(in) :: word, words(:)
      integer :: d, least, k

      nearest = 0
      least = max(1, len_trim(word)/3) + 1
      do k = 1, size(words)
         d = distance(lower(trim(word)), lower(trim(words(k))))
         if (d >= least) cycle
         least = d
         nearest = k
      end do
   end function nearest

   !> Returns `, perhaps length`, to follow a list of the expected words; '' if no word is similar.
   pure subroutine or_nearest(word, words, text)
      character(len=*), intent(in) :: word, words(:)
      character(len=:), allocatable, intent(out) :: text
      integer :: k

      text = ''
      k = nearest(word, words)
      if (k > 0) text = ', perhaps '//trim(words(k))
   end subroutine or_nearest

   !> Returns Damerau's distance with each pair of neighbours exchanged at most once (optimal string
   !> alignment).
   pure integer function distance(a, b)
      character(len=*), intent(in) :: a, b
      integer :: d(0:len(a), 0:len(b)), i, j

      d(:, 0) = [(i, i=0, len(a))]
      d(0, :) = [(j, j=0, len(b))]
      do j = 1, len(b)
         do i = 1, len(a)
            d(i, j) = min(d(i - 1, j) + 1, d(i, j - 1) + 1, &
               d(i - 1, j - 1) + merge(0, 1, a(i:i) == b(j:j)))
            if (i == 1 .or. j == 1) cycle
            if (a(i:i) == b(j - 1:j - 1) .and. a(i - 1:i - 1) == b(j:j)) &
               d(i, j) = min(d(i, j), d(i - 2, j - 2) + 1)
         end do
      end do
      distance = d(len(a), len(b))
   end function distance

end module beamid_spelling
