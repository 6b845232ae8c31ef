!> `beamid ensemble`: a command on every member of an ensemble, by the threads of this machine, or a
!> part of them; parts of any number of programs make one table.
module beamid_ensemble
   use, intrinsic :: iso_c_binding, only: c_associated, c_int, c_ptr
   use, intrinsic :: iso_fortran_env, only: int32, int64
   use beamid, only: case_t, error_t, failure, needs_nothing, read_case, version, wp
   use beamid_commands, only: deliver, folder_of, settings_t
   use beamid_ensemble_reports, only: add_member, merge_shards, read_members, tally_t
   use beamid_ensembles, only: ensemble_maker_t, member_t, new_ensemble
   use beamid_errors, only: bad_input, locate
   use beamid_files, only: read_text
   use beamid_fleets, only: fit_fleet_case, fleet_case_t, judge_fleet_case, moved, &
      open_fleet_case, read_fleet
   use beamid_folders, only: lock_folder, make_folders, open_folder
   use beamid_interrupts, only: check_interrupt, stop_flag
   use beamid_lines, only: csv_row
   use beamid_manifests, only: crc32, hexadecimal
   use beamid_numbers, only: shown
   use beamid_outputs, only: output_t
   use beamid_paths, only: directory_of, join_path
   use beamid_posix, only: c_closedir, reason
   use beamid_refusals, only: refuse
   use beamid_shards, only: gaps, list_shards, range_of_members_t, remove_shards, shard_path, &
      temporary_path, write_shard
   use beamid_strings, only: to_text
   use beamid_terminal, only: new_progress, print_text, progress_t, tell
   use beamid_texts, only: text_t
   implicit none
   private

   public :: run_ensemble

   !> Seconds that a block of members takes, more or less: what is lost when the program is killed.
   real(wp), parameter :: block_seconds = 3
   integer, parameter :: first_block = 16, largest_block = 20000

   !> What is run, and where it goes.
   type :: ensemble_run_t
      type(ensemble_maker_t) :: maker
      type(fleet_case_t), allocatable :: fleet(:)   !< not allocated: records are made
      integer :: members = 0
      character(len=:), allocatable :: folder, shards
      character(len=8) :: fingerprint = ''
   end type ensemble_run_t

   !> Rows of one member.
   type :: rows_t
      character(len=:), allocatable :: text
   end type rows_t

contains

   !> beamid ensemble
   subroutine run_ensemble(settings, error)
      type(settings_t), intent(in) :: settings
      type(error_t), allocatable, intent(out) :: error
      type(case_t) :: case
      type(ensemble_run_t) :: run
      type(range_of_members_t) :: wanted
      type(range_of_members_t), allocatable :: shards(:)
      integer, allocatable :: created(:)
      type(c_ptr) :: folder
      integer(c_int) :: code, ignored
      integer :: others
      logical :: locked

      call read_case(settings%subject, needs_nothing, case, error)
      if (allocated(error)) return
      if (.not. allocated(case%ensemble%command)) call refuse(case%path, 0, 'ensemble', &
         'no such group', 'one', error)
      if (settings%only_new .and. .not. allocated(case%ensemble%cases)) call refuse(case%path, &
         case%ensemble%line, 'ensemble cases', 'nothing', 'a list of cases beside --only-new', &
         error)
      if (allocated(error)) return
      run%folder = folder_of(settings, case%name)
      run%shards = join_path(run%folder, 'shards')
      call prepare(case, settings%only_new, run, error)
      if (.not. allocated(error)) call read_part(settings, run%members, wanted, error)
      if (allocated(error)) return
      call make_folders(run%shards, created, code)
      if (code == 0) call list_shards(run%shards, run%fingerprint, shards, others, code)
      if (code /= 0) then
         call bad_input(error, run%shards//': the folder cannot be written: '//reason(code))
         return
      end if
      if (others > 0) call tell('beamid: '//run%shards//': found members of another case or '// &
         'record; they are not used, and removed when this ensemble is complete')
      call compute(run, gaps(shards, wanted), settings%quiet, error)
      if (allocated(error)) return
      ! Of several programs that end together one makes the tables before the next looks.
      code = open_folder(run%shards, folder)
      if (code == 0) locked = lock_folder(folder)
      call list_shards(run%shards, run%fingerprint, shards, others, code)
      if (size(gaps(shards, range_of_members_t(1, run%members))) > 0) then
         call print_text(case%name//': members '//to_text(wanted%first)//' to '// &
            to_text(wanted%last)//' of '//to_text(run%members)//' are done; the tables follow '// &
            'when all are'//new_line('a'), error)
      else
         call finish(case, run, shards, settings, error)
      end if
      if (c_associated(folder)) ignored = c_closedir(folder)
   end subroutine run_ensemble

   !> Members first to last, from `--only i:j`; all without it.
   subroutine read_part(settings, members, wanted, error)
      type(settings_t), intent(in) :: settings
      integer, intent(in) :: members
      type(range_of_members_t), intent(out) :: wanted
      type(error_t), allocatable, intent(out) :: error
      integer :: colon, status

      wanted = range_of_members_t(1, members)
      if (.not. allocated(settings%only)) return
      associate (text => settings%only)
         colon = index(text, ':')
         status = 1
         if (colon > 1 .and. colon < len(text) .and. verify(text, '0123456789:') == 0 .and. &
            index(text, ':', back=.true.) == colon) then
            read (text(:colon - 1), '(i12)', iostat=status) wanted%first
            if (status == 0) read (text(colon + 1:), '(i12)', iostat=status) wanted%last
         end if
         if (status /= 0 .or. wanted%first < 1 .or. wanted%first > min(wanted%last, members)) &
            call bad_input(error, 'command line: --only: found '//shown(text)// &
            ', expected i:j with i from 1 to '//to_text(members)//' and j no smaller')
      end associate
      wanted%last = min(wanted%last, members)
   end subroutine read_part

   !> Reads what all members need, and what the result depends on for the fingerprint.
   subroutine prepare(case, only_new, run, error)
      type(case_t), intent(in) :: case
      logical, intent(in) :: only_new
      type(ensemble_run_t), intent(inout) :: run
      type(error_t), allocatable, intent(out) :: error
      character(len=:), allocatable :: bytes, text
      integer :: k

      bytes = version//new_line('a')//case%text
      if (allocated(case%ensemble%cases)) then
         call read_fleet(join_path(directory_of(case%path), case%ensemble%cases), run%fleet, error)
         call locate(error, case%path//':'//to_text(case%ensemble%line)//': &ensemble cases')
         if (allocated(error)) return
         run%members = size(run%fleet)
         if (only_new) call recall(run%folder, run%fleet)
         do k = 1, size(run%fleet)
            bytes = bytes//run%fleet(k)%name//run%fleet(k)%fingerprint
         end do
         if (only_new) then
            call read_text(join_path(run%folder, 'members.csv'), text, error)
            bytes = bytes//text
            if (allocated(error)) deallocate (error)
         end if
      else
         call new_ensemble(case, run%maker, error)
         if (allocated(error)) return
         run%members = case%ensemble%members
         do k = 1, size(case%recordings)
            if (.not. allocated(case%recordings(k)%path)) cycle
            call read_text(case%recordings(k)%path, text, error)
            if (allocated(error)) return
            bytes = bytes//text
         end do
      end if
      run%fingerprint = hexadecimal(crc32(bytes, 0_int32))
   end subroutine prepare

   !> What an earlier run has found: its members by the names of their cases.
   subroutine recall(folder, fleet)
      character(len=*), intent(in) :: folder
      type(fleet_case_t), intent(inout) :: fleet(:)
      type(member_t), allocatable :: members(:)
      type(error_t), allocatable :: error
      character(len=:), allocatable :: cases, line, text
      integer :: first, j, k, length, status

      call read_text(join_path(folder, 'members.csv'), text, error)
      if (.not. allocated(error)) call read_text(join_path(folder, 'cases.csv'), cases, error)
      if (allocated(error)) return
      call read_members(text, members)
      first = index(cases, new_line('a')) + 1
      do while (first <= len(cases))
         length = index(cases(first:), new_line('a')) - 1
         if (length < 0) exit
         ! member,fingerprint,case
         line = cases(first:first + length - 1)
         first = first + length + 1
         read (line(:max(index(line, ',') - 1, 0)), *, iostat=status) j
         line = line(index(line, ',') + 1:)
         if (status /= 0 .or. index(line, ',') == 0) cycle
         if (j < 1 .or. j > size(members)) cycle
         do k = 1, size(fleet)
            if (fleet(k)%name /= line(index(line, ',') + 1:)) cycle
            fleet(k)%before = members(j)%rows
            fleet(k)%is_as_before = size(fleet(k)%before) > 0 .and. fleet(k)%fingerprint == &
               line(:index(line, ',') - 1) .and. fleet(k)%fingerprint /= ''
         end do
      end do
   end subroutine recall

   !> Runs the members that are missing, and writes a shard for each block of them.
   subroutine compute(run, missing, quiet, error)
      type(ensemble_run_t), intent(inout) :: run
      type(range_of_members_t), intent(in) :: missing(:)
      logical, intent(in) :: quiet
      type(error_t), allocatable, intent(out) :: error
      type(progress_t) :: progress
      type(range_of_members_t) :: block
      character(len=:), allocatable :: rows
      integer(int64) :: begin, now, rate
      integer(c_int) :: code
      integer :: done, k, whole

      progress = new_progress(quiet)
      whole = sum(missing%last - missing%first + 1)
      done = 0
      do k = 1, size(missing)
         block = range_of_members_t(missing(k)%first, missing(k)%first + first_block - 1)
         do while (block%first <= missing(k)%last)
            block%last = min(block%last, missing(k)%last)
            call system_clock(begin, rate)
            if (allocated(run%fleet)) then
               call run_fleet_block(run%fleet, block, rows)
            else
               call run_block(run%maker, block, rows)
            end if
            call check_interrupt(error)
            if (allocated(error)) return
            code = write_shard(shard_path(run%shards, run%fingerprint, block), rows)
            if (code /= 0) then
               call failure(error, run%shards//': cannot be written: '//reason(code))
               return
            end if
            call system_clock(now)
            done = done + block%last - block%first + 1
            call progress%advanced(done, whole, 'members')
            block = range_of_members_t(block%last + 1, block%last + next_size( &
               block%last - block%first + 1, real(now - begin, wp)/rate))
         end do
      end do
      call progress%finish()
   end subroutine compute

   !> Size of the next block from that of the last one and its seconds.
   pure integer function next_size(members, seconds)
      integer, intent(in) :: members
      real(wp), intent(in) :: seconds

      next_size = min(largest_block, 8*members)
      if (seconds*next_size > block_seconds*members) next_size = max(1, nint(block_seconds &
         *members/seconds))
   end function next_size

   !> Rows of made members, by all threads.
   subroutine run_block(maker, block, rows)
      type(ensemble_maker_t), intent(in) :: maker
      type(range_of_members_t), intent(in) :: block
      character(len=:), allocatable, intent(out) :: rows
      type(rows_t), allocatable :: parts(:)
      type(member_t) :: member
      integer :: k

      allocate (parts(block%first:block%last))
      !$omp parallel do schedule(dynamic, 1) private(member) copyin(stop_flag)
      do k = block%first, block%last
         call maker%run_member(k, member)
         parts(k)%text = ''
         call add_member(parts(k)%text, k, member)
      end do
      !$omp end parallel do
      call join(parts, rows)
   end subroutine run_block

   !> Rows of cases. What reads and judges them works with text, and runs in one thread.
   subroutine run_fleet_block(fleet, block, rows)
      type(fleet_case_t), intent(inout) :: fleet(:)
      type(range_of_members_t), intent(in) :: block
      character(len=:), allocatable, intent(out) :: rows
      type(rows_t), allocatable :: parts(:)
      integer :: k

      do k = block%first, block%last
         if (.not. fleet(k)%is_as_before) call open_fleet_case(fleet(k))
      end do
      !$omp parallel do schedule(dynamic, 1) copyin(stop_flag)
      do k = block%first, block%last
         if (.not. fleet(k)%is_as_before) call fit_fleet_case(fleet(k))
      end do
      !$omp end parallel do
      allocate (parts(block%first:block%last))
      do k = block%first, block%last
         if (fleet(k)%is_as_before) then
            fleet(k)%member%rows = fleet(k)%before
         else
            call judge_fleet_case(fleet(k))
         end if
         parts(k)%text = ''
         call add_member(parts(k)%text, k, fleet(k)%member)
      end do
      call join(parts, rows)
   end subroutine run_fleet_block

   !> All texts in one.
   subroutine join(parts, rows)
      type(rows_t), intent(in) :: parts(:)
      character(len=:), allocatable, intent(out) :: rows
      type(text_t) :: text
      integer :: k

      do k = 1, size(parts)
         call text%add(parts(k)%text)
      end do
      rows = text%content()
   end subroutine join

   !> Tables and summary of a whole ensemble.
   subroutine finish(case, run, shards, settings, error)
      type(case_t), intent(in) :: case
      type(ensemble_run_t), intent(in) :: run
      type(range_of_members_t), intent(in) :: shards(:)
      type(settings_t), intent(in) :: settings
      type(error_t), allocatable, intent(out) :: error
      type(output_t) :: output
      type(tally_t) :: tally
      type(text_t) :: summary
      character(len=:), allocatable :: path

      path = temporary_path(join_path(run%shards, 'members-all.csv'))
      call merge_shards(run%shards, run%fingerprint, shards, run%members, path, tally, error)
      if (allocated(error)) return
      if (tally%failures == tally%members) then
         call failure(error, case%path//': every member failed; '//tally%first_failure)
         return
      end if
      call summary%line(case%name//': ensemble of '//to_text(run%members)//' members, '// &
         case%ensemble%command)
      call summary%line()
      call tally%add_to(summary)
      call output%add_file('members.csv', path)
      call output%add('ensemble.csv', tally%table())
      if (allocated(run%fleet)) call add_fleet(run%fleet, path, settings%only_new, output, summary)
      call deliver(output, summary%content(), settings, case%name, error, case%recordings)
      if (allocated(error)) return
      if (allocated(run%fleet)) then
         call remove_shards(run%shards, but_of='')
      else
         call remove_shards(run%shards, but_of=run%fingerprint)
      end if
   end subroutine finish

   !> cases.csv, and changed.csv with what has moved since an earlier run.
   !>
   !> path  of the table of all members
   subroutine add_fleet(fleet, path, only_new, output, summary)
      type(fleet_case_t), intent(in) :: fleet(:)
      character(len=*), intent(in) :: path
      logical, intent(in) :: only_new
      type(output_t), intent(inout) :: output
      type(text_t), intent(inout) :: summary
      type(member_t), allocatable :: members(:)
      type(error_t), allocatable :: error
      type(text_t) :: cases, changed
      character(len=:), allocatable :: text
      integer :: i, j, k, moves

      call cases%line('member,fingerprint,case')
      do k = 1, size(fleet)
         call cases%line(to_text(k)//','//trim(fleet(k)%fingerprint)//','//fleet(k)%name)
      end do
      call output%add('cases.csv', cases%content())
      if (.not. only_new) return
      call read_text(path, text, error)
      if (allocated(error)) return
      call read_members(text, members)
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
      if (moves == 0) call summary%line('  no parameter has moved by more than its intervals')
      call output%add('changed.csv', changed%content())
   end subroutine add_fleet

end module beamid_ensemble
