!> The problems found in a case file. Each becomes one line of a message:
!> `file:line: &group key: found ..., expected ...`.
module beamid_refusals
   use beamid_errors, only: error_t, bad_input
   use beamid_strings, only: to_text
   implicit none
   private

   public :: refusals_t, refuse

   !> Largest number of problems that are reported.
   integer, parameter :: most = 20
   character(len=*), parameter :: line_feed = achar(10)

   !> One problem: its line in the case file, and the message behind `file:line: `.
   type :: refusal_t
      integer :: line = 0
      character(len=:), allocatable :: text
   end type refusal_t

   !> The first problems, sorted by line; problems of one line are in the order of their discovery.
   type :: refusals_t
      integer :: n = 0                          !< number of problems kept
      type(refusal_t), private :: kept(most)
   contains
      procedure :: add
      procedure :: join
      procedure :: tell
   end type refusals_t

contains

   !> Adds a problem.
   subroutine add(self, line, text)
      class(refusals_t), intent(inout) :: self
      integer, intent(in) :: line
      !> Group and key, what was found and what was expected.
      character(len=*), intent(in) :: text
      integer :: k

      if (self%n < most) then
         self%n = self%n + 1
      else if (line >= self%kept(most)%line) then
         return
      end if
      do k = self%n, 2, -1
         if (self%kept(k - 1)%line <= line) exit
         self%kept(k) = self%kept(k - 1)
      end do
      self%kept(k)%line = line
      self%kept(k)%text = text
   end subroutine add

   !> Adds all problems of another list.
   subroutine join(self, others)
      class(refusals_t), intent(inout) :: self
      type(refusals_t), intent(in) :: others
      integer :: k

      do k = 1, others%n
         call self%add(others%kept(k)%line, others%kept(k)%text)
      end do
   end subroutine join

   !> Converts the problems to one error with a line for each; `error` stays if there are none.
   !>
   !> path  path of the case file
   subroutine tell(self, path, error)
      class(refusals_t), intent(in) :: self
      character(len=*), intent(in) :: path
      type(error_t), allocatable, intent(inout) :: error
      character(len=:), allocatable :: lines
      integer :: k

      if (self%n == 0) return
      lines = ''
      do k = 1, self%n
         lines = lines//path//':'//to_text(self%kept(k)%line)//': '//self%kept(k)%text//line_feed
      end do
      call bad_input(error, lines(:len(lines) - 1))
   end subroutine tell

   !> Returns an error for a problem that is found after the file has been read; keeps an earlier
   !> error.
   !>
   !> path   path of the case file
   !> line   line of the problem; 0: unknown
   !> place  name of the group and, if there is one, of the key
   subroutine refuse(path, line, place, found, expected, error)
      character(len=*), intent(in) :: path, place, found, expected
      integer, intent(in) :: line
      type(error_t), allocatable, intent(inout) :: error
      character(len=:), allocatable :: at

      if (allocated(error)) return
      at = path
      if (line > 0) at = path//':'//to_text(line)
      call bad_input(error, at//': &'//place//': found '//found//', expected '//expected)
   end subroutine refuse

end module beamid_refusals
