!> The command `ensemble`: runs a command on every member of an ensemble, with all threads of this
!> machine. Several programs, also on several machines, may each compute a part of the members; the
!> program that finds no member missing merges all parts to one table.
module beamid_ensemble
   use, intrinsic :: iso_c_binding, only: c_associated, c_int, c_ptr
   use, intrinsic :: iso_fortran_env, only: int64
   use beamid, only: case_t, error_t, failure, needs_nothing, read_case, version, wp
   use beamid_case_files, only: add_case
   use beamid_commands, only: deliver, folder_of, settings_t
   use beamid_ensemble_reports, only: merge_shards, report_ensemble, tally_t
   use beamid_ensembles, only: ensemble_maker_t, member_t, new_ensemble, run_members
   use beamid_errors, only: bad_input, locate
   use beamid_fingerprints, only: fingerprint_length, fingerprint_t
   use beamid_fleet_reports, only: add_fleet, recall_fleet
   use beamid_fleets, only: fleet_case_t, read_fleet, run_fleet
   use beamid_folders, only: lock_folder, make_folders, open_folder
   use beamid_interrupts, only: check_interrupt
   use beamid_member_rows, only: rows_of
   use beamid_numbers, only: shown
   use beamid_outputs, only: output_t
   use beamid_paths, only: join_path
   use beamid_posix, only: c_closedir, reason
   use beamid_refusals, only: refuse
   use beamid_shards, only: gaps, list_shards, range_of_members_t, remove_damaged, remove_shards, &
      shard_path, temporary_path, write_shard
   use beamid_strings, only: to_text
   use beamid_terminal, only: new_progress, print_text, progress_t, tell
   use beamid_texts, only: text_t
   implicit none
   private

   public :: run_ensemble

   !> Approximate time that a block of members takes [s]. If the program is killed, the block that
   !> it computes is lost.
   real(wp), parameter :: block_seconds = 3
   !> Number of members of the first block, and largest number.
   integer, parameter :: first_block = 16, largest_block = 20000

contains

   !> Runs `beamid ensemble`.
   subroutine run_ensemble(settings, error)
      type(settings_t), intent(in) :: settings
      type(error_t), allocatable, intent(out) :: error
      type(case_t) :: case
      type(ensemble_maker_t) :: maker                  ! makes the members of random records
      type(fleet_case_t), allocatable :: fleet(:)      ! listed cases, instead of random records
      integer :: n_members
      character(len=:), allocatable :: output_folder, shard_folder
      character(len=fingerprint_length) :: fingerprint   ! of everything that the results depend on
      type(range_of_members_t) :: missing, wanted
      type(range_of_members_t), allocatable :: shards(:)
      integer, allocatable :: created(:)
      integer(c_int) :: code
      integer :: others, round
      logical :: is_done
      !> How often damaged shards are computed again.
      integer, parameter :: most_rounds = 3

      call read_case(settings%subject, needs_nothing, case, error)
      if (allocated(error)) return
      if (.not. allocated(case%ensemble%command)) call refuse(case%path, 0, 'ensemble', &
         'no such group', 'one', error)
      if (settings%only_new .and. .not. allocated(case%ensemble%cases)) call refuse(case%path, &
         case%ensemble%line, 'ensemble cases', 'nothing', 'a list of cases beside --only-new', &
         error)
      if (allocated(error)) return
      output_folder = folder_of(settings, case%name)
      shard_folder = join_path(output_folder, 'shards')
      call prepare()
      if (.not. allocated(error)) call read_part()
      if (allocated(error)) return
      call make_folders(shard_folder, created, code)
      if (code /= 0) then
         call bad_input(error, shard_folder//': the folder cannot be written: '//reason(code))
         return
      end if
      call list_shards(shard_folder, fingerprint, shards, others, error)
      if (allocated(error)) return
      if (others > 0) call tell('beamid: '//shard_folder//': found members of another case or '// &
         'of other files; they are ignored, and will be removed when this ensemble is complete')
      missing = wanted
      call drop_damaged(missing)
      if (allocated(error)) return
      do round = 1, most_rounds
         call compute(gaps(shards, missing))
         if (.not. allocated(error)) call complete()
         if (allocated(error) .or. is_done) return
         missing = range_of_members_t(1, n_members)
      end do
      call failure(error, shard_folder//': found damaged shards again after their members had '// &
         'been computed '//to_text(most_rounds)//' times; check the disk')

   contains

      !> Merges the shards and writes the tables if no member is missing; otherwise prints a
      !> message.
      subroutine complete()
         type(range_of_members_t) :: members
         type(c_ptr) :: folder
         integer(c_int) :: code, ignored
         integer :: others
         logical :: locked

         is_done = .true.
         members = range_of_members_t(1, n_members)
         ! The lock serves programs that end at the same time: one of them makes the tables, the
         ! next one then finds them complete.
         code = open_folder(shard_folder, folder)
         if (code == 0) locked = lock_folder(folder)
         call list_shards(shard_folder, fingerprint, shards, others, error)
         if (.not. allocated(error) .and. size(gaps(shards, members)) > 0) then
            call print_text(case%name//': members '//to_text(wanted%first)//' to '// &
               to_text(wanted%last)//' of '//to_text(n_members)//' are done; the tables '// &
               'follow when all are'//new_line('a'), error)
         else if (.not. allocated(error)) then
            call drop_damaged(members)
            is_done = size(gaps(shards, members)) == 0
            if (is_done .and. .not. allocated(error)) call finish()
         end if
         if (c_associated(folder)) ignored = c_closedir(folder)
      end subroutine complete

      !> Removes damaged shards that hold members of a range, and says so on standard error.
      !>
      !> range  on return it includes all members of the removed shards
      subroutine drop_damaged(range)
         type(range_of_members_t), intent(inout) :: range
         character(len=:), allocatable :: first
         integer :: removed

         call remove_damaged(shard_folder, fingerprint, range, shards, removed, first, error)
         range%last = min(range%last, n_members)
         if (removed == 1) call tell('beamid: '//first//': found a damaged shard; it has been '// &
            'removed, and its members are computed again')
         if (removed > 1) call tell('beamid: '//first//': found a damaged shard, and '// &
            to_text(removed - 1)//' more; they have been removed, and their members are '// &
            'computed again')
      end subroutine drop_damaged

      !> Reads the members that this program computes from `--only i:j`; without it, all members.
      subroutine read_part()
         integer :: colon, status

         wanted = range_of_members_t(1, n_members)
         if (.not. allocated(settings%only)) return
         associate (text => settings%only)
            colon = index(text, ':')
            status = 1
            if (colon > 1 .and. colon < len(text) .and. verify(text, '0123456789:') == 0 .and. &
               index(text, ':', back=.true.) == colon) then
               read (text(:colon - 1), '(i12)', iostat=status) wanted%first
               if (status == 0) read (text(colon + 1:), '(i12)', iostat=status) wanted%last
            end if
            if (status /= 0 .or. wanted%first < 1 .or. wanted%first > min(wanted%last, n_members)) &
               call bad_input(error, 'command line: --only: found '//shown(text)// &
               ', expected i:j with i from 1 to '//to_text(n_members)//' and j no smaller')
         end associate
         wanted%last = min(wanted%last, n_members)
      end subroutine read_part

      !> Reads the input that all members need, and computes the fingerprint of the ensemble.
      subroutine prepare()
         type(fingerprint_t) :: input
         character(len=:), allocatable :: tables
         integer :: k

         call input%add(version)
         if (allocated(case%ensemble%cases)) then
            call read_fleet(case%ensemble%cases, version, fleet, error)
            call locate(error, case%path//':'//to_text(case%ensemble%line)//': &ensemble cases')
            if (allocated(error)) return
            n_members = size(fleet)
            do k = 1, size(fleet)
               call input%add(fleet(k)%name)
               call input%add(fleet(k)%fingerprint)
            end do
            if (settings%only_new) then
               call recall_fleet(output_folder, fleet, tables, error)
               if (allocated(error)) then
                  call tell('beamid: '//error%message//'; all cases are fitted as if they were new')
                  deallocate (error)
               end if
               call input%add(tables)
            end if
         else
            call new_ensemble(case, maker, error)
            if (allocated(error)) return
            n_members = case%ensemble%members
         end if
         call add_case(input, case)
         fingerprint = input%digits()
      end subroutine prepare

      !> Computes the missing members, and writes a shard for each block of them.
      subroutine compute(missing)
         type(range_of_members_t), intent(in) :: missing(:)
         type(progress_t) :: progress
         type(range_of_members_t) :: block
         character(len=:), allocatable :: rows
         integer(int64) :: begin, now, rate
         integer(c_int) :: code
         integer :: done, k, total

         progress = new_progress(settings%quiet)
         total = sum(missing%last - missing%first + 1)
         done = 0
         do k = 1, size(missing)
            block = range_of_members_t(missing(k)%first, missing(k)%first + first_block - 1)
            do while (block%first <= missing(k)%last .and. .not. allocated(error))
               block%last = min(block%last, missing(k)%last)
               call system_clock(begin, rate)
               call run_block(block, rows)
               call check_interrupt(error)
               if (.not. allocated(error)) then
                  code = write_shard(shard_folder, fingerprint, block, rows)
                  if (code /= 0) call failure(error, shard_path(shard_folder, fingerprint, &
                     block)//': cannot be written: '//reason(code))
               end if
               if (allocated(error)) exit
               call system_clock(now)
               done = done + block%last - block%first + 1
               call progress%advanced(done, total, 'members')
               block = range_of_members_t(block%last + 1, block%last + next_size( &
                  block%last - block%first + 1, real(now - begin, wp)/rate))
            end do
         end do
         call progress%finish()
      end subroutine compute

      !> Computes the members of a block, and returns their rows.
      subroutine run_block(block, rows)
         type(range_of_members_t), intent(in) :: block
         character(len=:), allocatable, intent(out) :: rows
         type(member_t), allocatable :: members(:)

         allocate (members(block%last - block%first + 1))
         if (allocated(fleet)) then
            call run_fleet(fleet(block%first:block%last), members, error)
         else
            call run_members(maker, block%first, members)
         end if
         rows = rows_of(members, block%first)
      end subroutine run_block

      !> Writes the tables and the summary of a complete ensemble, and removes its shards.
      subroutine finish()
         type(output_t) :: output
         type(tally_t) :: tally
         type(text_t) :: summary
         character(len=:), allocatable :: path

         path = temporary_path(join_path(shard_folder, 'members-all.csv'))
         call merge_shards(shard_folder, fingerprint, shards, n_members, path, tally, error)
         if (allocated(error)) return
         call report_ensemble(case, tally, output, summary, error)
         if (allocated(error)) return
         call output%add_file('members.csv', path)
         if (allocated(fleet)) call add_fleet(fleet, path, settings%only_new, output, &
            summary, error)
         if (allocated(error)) return
         call deliver(output, summary%content(), settings, case%name, error, case)
         if (allocated(error)) return
         if (allocated(fleet)) then
            call remove_shards(shard_folder, but_of='')
         else
            call remove_shards(shard_folder, but_of=fingerprint)
         end if
      end subroutine finish

   end subroutine run_ensemble

   !> Returns the size of the next block, given the size and the time [s] of the last one.
   pure integer function next_size(members, seconds)
      integer, intent(in) :: members
      real(wp), intent(in) :: seconds

      next_size = min(largest_block, 8*members)
      if (seconds*next_size > block_seconds*members) next_size = max(1, nint(block_seconds &
         *members/seconds))
   end function next_size

end module beamid_ensemble
