!> The results of an ensemble: merges the shards of members.csv and computes statistics of each
!> parameter over all members, for ensemble.csv and the summary. The rows are processed one by one,
!> so that the memory needed does not grow with the number of members.
module beamid_ensemble_reports
   use, intrinsic :: iso_c_binding, only: c_int, c_null_char
   use beamid_case_files, only: case_t
   use beamid_ensemble_rows, only: row_t
   use beamid_errors, only: error_t, failure
   use beamid_kinds, only: ip, wp
   use beamid_lines, only: known
   use beamid_member_rows, only: members_header, read_row, whole_number
   use beamid_outputs, only: output_t
   use beamid_posix, only: c_close, c_creat, c_fsync, c_unlink, errno_of, last_errno, reason, &
      write_bytes
   use beamid_shards, only: range_of_members_t, read_shard, shard_path
   use beamid_statistics, only: unlimited
   use beamid_strings, only: to_text
   use beamid_texts, only: left, right, text_t
   use beamid_unknowns, only: name_length
   implicit none
   private

   public :: tally_t, merge_shards, report_ensemble

   !> Header of ensemble.csv.
   character(len=*), parameter :: ensemble_header = 'elements,parameter,members,mean,'// &
      'sd,mean_std_error,bias,bias_error,covered,covered_error'
   character(len=*), parameter :: line_feed = achar(10)

   !> Statistics of one parameter on one mesh over the members so far.
   type :: sums_t
      integer :: elements = 0                   !< elements of the mesh
      character(len=name_length) :: parameter = ''     !< name of the parameter
      integer :: members = 0                    !< members that have a row
      integer :: finite = 0, errors = 0         !< rows with a finite estimate, a standard error
      integer :: compared = 0                   !< rows with an estimate and a true value
      integer :: judged = 0, inside = 0         !< intervals; intervals with the true value inside
      !> Means, and sums of squares about the means (Welford's recurrence).
      real(wp) :: mean = 0, squares = 0, std_error = 0, bias = 0, bias_squares = 0
   end type sums_t

   !> Statistics of all parameters over the members so far.
   type :: tally_t
      integer :: members = 0, failures = 0             !< members; those that failed
      character(len=:), allocatable :: first_failure   !< member and message; not allocated: none
      type(sums_t), allocatable :: sums(:)             !< one for each parameter and mesh
      !> Member of the row before, and place in `sums` that the next row most likely belongs to.
      integer, private :: last = 0, next = 1
   contains
      procedure :: take
      procedure :: add_to
      procedure :: table
   end type tally_t

contains

   !> Adds one row of members.csv to the statistics.
   subroutine take(self, line)
      class(tally_t), intent(inout) :: self
      character(len=*), intent(in) :: line
      type(row_t) :: row
      integer :: member
      logical :: failed, sound

      call read_row(line, member, row, failed, sound)
      if (member /= self%last) then
         self%members = self%members + 1
         self%next = 1
      end if
      self%last = member
      if (failed) then
         self%failures = self%failures + 1
         if (.not. allocated(self%first_failure)) self%first_failure = 'member '// &
            to_text(member)//': '//line(index(line, '"') + 1:index(line, '"', back=.true.) - 1)
         return
      end if
      call find_sums()
      associate (sums => self%sums(self%next))
         self%next = self%next + 1
         sums%members = sums%members + 1
         if (row%estimate < unlimited) then
            sums%finite = sums%finite + 1
            call add_to_mean(row%estimate, sums%finite, sums%mean, sums%squares)
         end if
         if (row%std_error < unlimited) then
            sums%errors = sums%errors + 1
            sums%std_error = sums%std_error + (row%std_error - sums%std_error)/sums%errors
         end if
         if (.not. row%truth < unlimited) return
         if (row%estimate < unlimited) then
            sums%compared = sums%compared + 1
            call add_to_mean(row%estimate - row%truth, sums%compared, sums%bias, sums%bias_squares)
         end if
         ! An infinite upper end includes all larger values. Without an interval there is nothing to
         ! judge.
         if (abs(row%interval(1)) >= unlimited) return
         sums%judged = sums%judged + 1
         if (row%interval(1) <= row%truth .and. row%truth <= row%interval(2)) sums%inside = &
            sums%inside + 1
      end associate

   contains

      !> Sets `self%next` to the sums of the row's parameter; usually it is right already.
      subroutine find_sums()
         integer :: k

         if (.not. allocated(self%sums)) allocate (self%sums(0))
         if (self%next <= size(self%sums)) then
            if (matches(self%sums(self%next))) return
         end if
         do k = 1, size(self%sums)
            self%next = k
            if (matches(self%sums(k))) return
         end do
         self%sums = [self%sums, sums_t(row%elements, row%parameter)]
         self%next = size(self%sums)
      end subroutine find_sums

      !> Returns whether the row belongs to these sums.
      pure logical function matches(sums)
         type(sums_t), intent(in) :: sums

         matches = sums%elements == row%elements .and. sums%parameter == row%parameter
      end function matches

   end subroutine take

   !> Adds the n-th value to a mean and to the sum of squares about it (Welford's recurrence).
   pure subroutine add_to_mean(value, n, mean, squares)
      real(wp), intent(in) :: value
      integer, intent(in) :: n
      real(wp), intent(inout) :: mean, squares
      real(wp) :: step

      step = value - mean
      mean = mean + step/n
      squares = squares + step*(value - mean)
   end subroutine add_to_mean

   !> Returns the standard deviation of n values; `unlimited` if n < 2.
   !>
   !> squares  sum of squares about the mean
   pure real(wp) function deviation(squares, n)
      real(wp), intent(in) :: squares
      integer, intent(in) :: n

      deviation = unlimited
      if (n > 1) deviation = sqrt(squares/(n - 1))
   end function deviation

   !> Returns the share of intervals that contain the true value, and its standard error. If all or
   !> none do, the standard error is that of a share one interval away from the end.
   pure function covered(sums) result(share)
      type(sums_t), intent(in) :: sums
      real(wp) :: share(2), p

      share = unlimited
      if (sums%judged == 0) return
      share(1) = real(sums%inside, wp)/sums%judged
      p = min(max(share(1), 1/(sums%judged + 1.0_wp)), 1 - 1/(sums%judged + 1.0_wp))
      share(2) = sqrt(p*(1 - p)/sums%judged)
   end function covered

   !> Returns the statistics of one parameter in the order of `ensemble_header`: mean, standard
   !> deviation, mean standard error, bias, its error, coverage, its error; `unlimited`: not known.
   pure function results(sums)
      type(sums_t), intent(in) :: sums
      real(wp) :: results(7)

      results = unlimited
      if (sums%finite > 0) results(1:2) = [sums%mean, deviation(sums%squares, sums%finite)]
      if (sums%errors > 0) results(3) = sums%std_error
      if (sums%compared > 0) results(4) = sums%bias
      if (sums%compared > 1) results(5) = deviation(sums%bias_squares, sums%compared) &
         /sqrt(real(sums%compared, wp))
      results(6:7) = covered(sums)
   end function results

   !> Returns the table ensemble.csv.
   function table(self) result(content)
      class(tally_t), intent(in) :: self
      character(len=:), allocatable :: content, row
      type(text_t) :: text
      real(wp) :: values(7)
      integer :: j, k

      call text%line(ensemble_header)
      do k = 1, size(self%sums)
         associate (sums => self%sums(k))
            row = to_text(sums%elements)//','//trim(sums%parameter)//','//to_text(sums%members)
            values = results(sums)
            do j = 1, size(values)
               row = row//','//known(values(j))
            end do
            call text%line(row)
         end associate
      end do
      content = text%content()
   end function table

   !> Adds the statistics of all parameters to the summary.
   subroutine add_to(self, summary)
      class(tally_t), intent(in) :: self
      type(text_t), intent(inout) :: summary
      character(len=:), allocatable :: line
      real(wp) :: values(7)
      integer :: j, k

      if (self%failures > 0) then
         call summary%line('  '//to_text(self%failures)//' of '//to_text(self%members)// &
            ' members failed; the first is '//self%first_failure)
      else
         call summary%line('  '//to_text(self%members)//' members, none failed')
      end if
      call summary%line()
      call summary%line('elements  parameter  members         mean           sd    std_error'// &
         '         bias  truth inside')
      do k = 1, size(self%sums)
         associate (sums => self%sums(k))
            line = right(to_text(sums%elements), 8)//'  '//left(trim(sums%parameter), 9)// &
               right(to_text(sums%members), 9)
            values = results(sums)
            do j = 1, 4
               if (values(j) < unlimited) then
                  line = line//right(to_text(values(j)), 13)
               else
                  line = line//right('-', 13)
               end if
            end do
            if (values(6) < unlimited) line = line//'  '//to_text(0.01_wp*nint(1e4_wp*values(6))) &
               //' +- '//to_text(0.01_wp*nint(1e4_wp*values(7)))//' %'
            call summary%line(line)
         end associate
      end do
      if (.not. any(self%sums%compared > 0)) return
      call summary%line()
      call summary%line('bias: mean of estimate - truth; truth inside: number of 95 % '// &
         'intervals that contain the truth')
   end subroutine add_to

   !> Reports an ensemble: ensemble.csv and the summary.
   !>
   !> tally  the statistics of all members
   !> error  every member has failed
   subroutine report_ensemble(case, tally, output, summary, error)
      type(case_t), intent(in) :: case
      type(tally_t), intent(in) :: tally
      type(output_t), intent(inout) :: output
      type(text_t), intent(inout) :: summary
      type(error_t), allocatable, intent(out) :: error

      if (tally%failures == tally%members) then
         call failure(error, case%path//': every member failed; '//tally%first_failure)
         return
      end if
      call summary%line(case%name//': ensemble of '//to_text(tally%members)//' members, '// &
         case%ensemble%command)
      call summary%line()
      call tally%add_to(summary)
      call output%add('ensemble.csv', tally%table())
   end subroutine report_ensemble

   !> Merges shards to one file with the rows of each member once, and adds up the statistics.
   !>
   !> folder, fingerprint  of the shards
   !> shards   in the order of their first members; together they contain all members
   !> members  number of members
   !> path     of the new file; it is removed if there is an error
   !> tally    the statistics
   subroutine merge_shards(folder, fingerprint, shards, members, path, tally, error)
      character(len=*), intent(in) :: folder, fingerprint, path
      type(range_of_members_t), intent(in) :: shards(:)
      integer, intent(in) :: members
      type(tally_t), intent(out) :: tally
      type(error_t), allocatable, intent(out) :: error
      character(len=:), allocatable :: rows
      integer(c_int) :: code, fd, ignored
      logical :: sound
      integer :: k, next

      next = 1
      allocate (tally%sums(0))
      fd = c_creat(path//c_null_char, int(o'666', c_int))
      code = merge(last_errno(), 0_c_int, fd < 0)
      if (code == 0) code = write_bytes(fd, members_header//line_feed)
      do k = 1, size(shards)
         if (code /= 0 .or. next > members) exit
         if (shards(k)%last < next) cycle
         call read_shard(folder, fingerprint, shards(k), rows, sound, error)
         if (.not. (sound .or. allocated(error))) call failure(error, shard_path(folder, &
            fingerprint, shards(k))//': has been damaged just now; run the ensemble again')
         if (allocated(error)) exit
         call add_rows(rows)
         next = shards(k)%last + 1
      end do
      if (fd >= 0) then
         if (code == 0) code = errno_of(c_fsync(fd))
         ignored = c_close(fd)
      end if
      if (code /= 0) call failure(error, path//': cannot be written: '//reason(code))
      if (allocated(error)) ignored = c_unlink(path//c_null_char)

   contains

      !> Writes and counts the rows of a shard from member `next` on; shards may overlap.
      subroutine add_rows(rows)
         character(len=*), intent(in) :: rows
         integer(ip) :: begin, first, length

         begin = len(rows, ip) + 1
         first = 1
         do while (first <= len(rows, ip))
            length = index(rows(first:), line_feed, kind=ip) - 1
            if (begin > len(rows, ip)) then
               if (whole_number(rows(first:first + index(rows(first:), ',') - 2)) >= next) &
                  begin = first
            end if
            if (first >= begin) call tally%take(rows(first:first + length - 1))
            first = first + length + 1
         end do
         code = write_bytes(fd, rows(begin:))
      end subroutine add_rows

   end subroutine merge_shards

end module beamid_ensemble_reports
