!> Texts of records, which are written to a file and loaded as the program loads them.
module loaded_records
   use beamid_errors, only: error_t
   use beamid_kinds, only: wp
   use beamid_outputs, only: output_t
   use beamid_records, only: load_recording, note_length, recording_t
   use checks, only: check
   implicit none
   private

   public :: load, check_loaded

   !> The record loaded last: its samples and notes, and the message of the error; '': none.
   real(wp), allocatable, protected, public :: t(:), z(:)
   character(len=note_length), allocatable, protected, public :: notes(:)
   character(len=:), allocatable, protected, public :: message

contains

   !> Loads a text as the file record.csv in a scratch folder.
   !>
   !> time_column, value_column  as in &record; '' or not present: by default
   subroutine load(text, scratch, time_column, value_column)
      character(len=*), intent(in) :: text, scratch
      character(len=*), intent(in), optional :: time_column, value_column
      type(recording_t) :: recording
      type(output_t) :: output
      type(error_t), allocatable :: error

      call output%add('record.csv', text)
      call output%commit(scratch, error)
      if (allocated(error)) error stop 'scratch folder'
      recording%path = scratch//'/record.csv'
      if (present(time_column)) recording%time_column = time_column
      if (present(value_column)) recording%value_column = value_column
      call load_recording(recording, t, z, notes, error)
      message = ''
      if (allocated(error)) message = error%message
   end subroutine load

   !> Checks that exactly these samples have been loaded.
   subroutine check_loaded(what, times, values)
      character(len=*), intent(in) :: what
      real(wp), intent(in) :: times(:), values(:)
      logical :: ok

      ok = message == ''
      if (ok) ok = size(t) == size(times) .and. size(z) == size(times)
      if (ok) ok = maxval(abs(t - times)) <= 0 .and. maxval(abs(z - values)) <= 0
      call check(what, ok, message)
   end subroutine check_loaded

end module loaded_records
