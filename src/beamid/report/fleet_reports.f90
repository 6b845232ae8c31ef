!> The tables of a fleet (an ensemble given as a list of cases): cases.csv and changed.csv, and the
!> results of an earlier run for comparison.
module beamid_fleet_reports
   use beamid_ensembles, only: member_t
   use beamid_errors, only: error_t
   use beamid_files, only: read_text
   use beamid_fleets, only: fleet_case_t, moved
   use beamid_kinds, only: ip
   use beamid_lines, only: csv_row, split
   use beamid_manifests, only: read_listed
   use beamid_member_rows, only: read_members
   use beamid_outputs, only: output_t
   use beamid_paths, only: join_path
   use beamid_strings, only: to_text
   use beamid_texts, only: next_line, text_t
   implicit none
   private

   public :: add_fleet, recall_fleet

   character(len=*), parameter :: cases_header = 'member,fingerprint,case', line_feed = achar(10)

contains

   !> Gives each case the estimates of an earlier run, found by the case's name in the list.
   !>
   !> folder  output folder
   !> tables  text of both tables of the earlier run, on which the new results depend; '': none
   !> error   one of the tables is damaged; in this case no case gets earlier estimates
   subroutine recall_fleet(folder, fleet, tables, error)
      character(len=*), intent(in) :: folder
      type(fleet_case_t), intent(inout) :: fleet(:)
      character(len=:), allocatable, intent(out) :: tables
      type(error_t), allocatable, intent(out) :: error
      type(member_t), allocatable :: members(:)
      character(len=:), allocatable :: cases, line, text
      character(len=32) :: fields(2)   ! member, fingerprint
      integer(ip) :: first
      integer :: j, k, n

      tables = ''
      call read_listed(folder, 'members.csv', text, error)
      if (.not. allocated(error)) call read_listed(folder, 'cases.csv', cases, error)
      if (allocated(error)) return
      if (text == '' .or. cases == '') return
      n = count([(cases(k:k) == line_feed, k=1, len(cases))]) - 1
      call read_members(text, join_path(folder, 'members.csv'), n, members, error)
      if (allocated(error)) return
      first = index(cases, line_feed) + 1
      do j = 1, n
         if (.not. next_line(cases, first, line)) exit
         call split(line, fields)
         do k = 1, size(fleet)
            ! The name of the case follows; it may contain commas.
            if (line /= trim(fields(1))//','//trim(fields(2))//','//fleet(k)%name) cycle
            fleet(k)%before = members(j)%rows
            fleet(k)%is_as_before = size(members(j)%rows) > 0 .and. &
               fleet(k)%fingerprint == fields(2)
         end do
      end do
      tables = text//cases
   end subroutine recall_fleet

   !> Adds cases.csv and, if there may be an earlier run, changed.csv with all parameters that have
   !> moved since then.
   !>
   !> path      of members.csv
   !> only_new  whether the run fits only cases without earlier results
   subroutine add_fleet(fleet, path, only_new, output, summary, error)
      type(fleet_case_t), intent(in) :: fleet(:)
      character(len=*), intent(in) :: path
      logical, intent(in) :: only_new
      type(output_t), intent(inout) :: output
      type(text_t), intent(inout) :: summary
      type(error_t), allocatable, intent(out) :: error
      type(member_t), allocatable :: members(:)
      type(text_t) :: cases, changed
      character(len=:), allocatable :: text
      integer :: i, j, k, moves

      call cases%line(cases_header)
      do k = 1, size(fleet)
         call cases%line(to_text(k)//','//fleet(k)%fingerprint//','//fleet(k)%name)
      end do
      call output%add('cases.csv', cases%content())
      if (.not. only_new) return
      call read_text(path, text, error)
      if (.not. allocated(error)) call read_members(text, path, size(fleet), members, error)
      if (allocated(error)) return
      call changed%line('member,case,elements,parameter,before,before_lower95,before_upper95,'// &
         'estimate,total_lower95,total_upper95')
      moves = 0
      call summary%line()
      call summary%line('  '//to_text(count(.not. fleet%is_as_before))//' of '// &
         to_text(size(fleet))//' cases are new, have changed or had no result, and were fitted')
      do k = 1, size(fleet)
         do i = 1, size(members(k)%rows)
            do j = 1, size(fleet(k)%before)
               associate (old => fleet(k)%before(j), row => members(k)%rows(i))
                  if (old%parameter /= row%parameter .or. old%elements /= row%elements) cycle
                  if (.not. moved(old, row)) cycle
                  moves = moves + 1
                  call changed%line(csv_row(to_text(k)//','//fleet(k)%name//','// &
                     to_text(row%elements)//','//trim(row%parameter), [old%estimate, old%total, &
                     row%estimate, row%total]))
                  call summary%line('  moved: '//fleet(k)%name//': '//trim(row%parameter)// &
                     ' from '//to_text(old%estimate)//' to '//to_text(row%estimate)// &
                     ', 95 % interval '//to_text(row%total(1))//' to '//to_text(row%total(2)))
               end associate
            end do
         end do
      end do
      if (moves == 0) call summary%line( &
         '  no estimate has moved by more than its intervals explain')
      call output%add('changed.csv', changed%content())
   end subroutine add_fleet

end module beamid_fleet_reports
