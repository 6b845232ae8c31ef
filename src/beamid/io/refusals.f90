!> The one form of a complaint about a case file, `file:line: &group key: found ..., expected ...`,
!> and the checks that every group shares. Each leaves an earlier error alone, so that calls can
!> follow one another.
module beamid_refusals
   use beamid_errors, only: error_t, bad_input
   use beamid_kinds, only: wp
   use beamid_namelist, only: block_t
   use beamid_strings, only: to_text
   implicit none
   private

   public :: accept, exclude, in_range, positive, quoted, refuse, require

contains

   !> The scanner let the text pass; should the namelist reader not take it, say so.
   subroutine accept(path, block, status, error)
      character(len=*), intent(in) :: path
      type(block_t), intent(in) :: block
      integer, intent(in) :: status
      type(error_t), allocatable, intent(inout) :: error

      if (status /= 0) call bad_input(error, path//':'//to_text(block%line)//': &'// &
         trim(block%name)//': found a group that cannot be read, expected key = value, ... /')
   end subroutine accept

   !> Refuses a group without one of the keys.
   subroutine require(path, block, keys, error)
      character(len=*), intent(in) :: path
      type(block_t), intent(in) :: block
      character(len=*), intent(in) :: keys(:)
      type(error_t), allocatable, intent(inout) :: error
      integer :: k

      do k = 1, size(keys)
         if (allocated(error)) return
         if (.not. block%has(trim(keys(k)))) call refuse(path, block%line, trim(block%name), &
            trim(keys(k)), 'nothing', 'a value', error)
      end do
   end subroutine require

   !> Refuses keys that have no meaning beside another.
   subroutine exclude(path, block, keys, beside, error)
      character(len=*), intent(in) :: path
      type(block_t), intent(in) :: block
      character(len=*), intent(in) :: keys(:), beside
      type(error_t), allocatable, intent(inout) :: error
      integer :: k

      do k = 1, size(keys)
         if (allocated(error)) return
         if (block%has(trim(keys(k)))) call refuse(path, block%line_of(trim(keys(k))), &
            trim(block%name), trim(keys(k)), 'a value', 'none '//beside, error)
      end do
   end subroutine exclude

   subroutine positive(path, block, key, value, error)
      character(len=*), intent(in) :: path
      type(block_t), intent(in) :: block
      character(len=*), intent(in) :: key
      real(wp), intent(in) :: value
      type(error_t), allocatable, intent(inout) :: error

      if (allocated(error) .or. value > 0) return
      call refuse(path, block%line_of(key), trim(block%name), key, to_text(value), &
         'a value above 0', error)
   end subroutine positive

   subroutine in_range(path, block, key, value, smallest, largest, error)
      character(len=*), intent(in) :: path
      type(block_t), intent(in) :: block
      character(len=*), intent(in) :: key
      integer, intent(in) :: value, smallest, largest
      type(error_t), allocatable, intent(inout) :: error

      if (allocated(error) .or. value >= smallest .and. value <= largest) return
      call refuse(path, block%line_of(key), trim(block%name), key, to_text(value), &
         to_text(smallest)//' to '//to_text(largest), error)
   end subroutine in_range

   !> `file:line: &group key: found ..., expected ...`
   subroutine refuse(path, line, group_name, key, found, expected, error)
      character(len=*), intent(in) :: path
      integer, intent(in) :: line
      character(len=*), intent(in) :: group_name, key, found, expected
      type(error_t), allocatable, intent(inout) :: error

      if (allocated(error)) return
      call bad_input(error, path//':'//to_text(line)//': &'//group_name//' '//key//': found '// &
         trim(found)//', expected '//expected)
   end subroutine refuse

   !> Text in quotes, cut where it grows long.
   pure function quoted(text)
      character(len=*), intent(in) :: text
      character(len=:), allocatable :: quoted

      quoted = ''''//trim(text(:min(40, len(text))))//''''
   end function quoted

end module beamid_refusals
