!> Compares the columns of a record's file with the units of the case and with the scale of the
!> record: what the names of the columns say, and times that look like dates.
module beamid_column_checks
   use beamid_case_files, only: case_t
   use beamid_column_units, only: bare_name, column_unit_t, length_in_m, no_unit, other_unit, &
      time_in_s, unit_of_acceleration, unit_of_column, unit_of_raw_values, unit_of_time
   use beamid_errors, only: bad_input, error_t
   use beamid_kinds, only: wp
   use beamid_numbers, only: shown
   use beamid_records, only: add_note, columns_t, note_length
   use beamid_refusals, only: refuse
   use beamid_sorting, only: median
   use beamid_strings, only: lower, rounded, to_text
   implicit none
   private

   public :: check_columns

contains

   !> Checks the columns that a record was read from.
   !>
   !> k        number of the record
   !> columns  of its file
   !> t        (m) sample times, as in the file [time]
   !> notes    on return with a note on a unit that differs without harm
   !> error    columns in other units than those of the case, or times that look like dates
   subroutine check_columns(case, k, columns, t, notes, error)
      type(case_t), intent(in) :: case
      integer, intent(in) :: k
      type(columns_t), intent(in) :: columns
      real(wp), intent(in) :: t(:)
      character(len=note_length), allocatable, intent(inout) :: notes(:)
      type(error_t), allocatable, intent(inout) :: error
      type(column_unit_t) :: unit
      character(len=:), allocatable :: found, expected

      found = ''
      unit = unit_of_column(trim(columns%names(1)))
      if (allocated(columns%clock)) then
         call judge_stamps()
      else if (unit%kind /= no_unit) then
         call judge_times()
      else
         call judge_size()
      end if
      if (found /= '') then
         call bad_input(error, place(1)//'found '//found//', expected '//expected)
         return
      end if
      call judge_values()
      if (found == '') then
         call check_scale()
      else
         call bad_input(error, place(2)//'found '//found//', expected '//expected)
      end if

   contains

      !> Returns "file: column n ('name'): " of the time column (1) or the value column (2).
      function place(which)
         integer, intent(in) :: which
         character(len=:), allocatable :: place

         place = case%recordings(k)%path//': '
         if (columns%names(which) /= '') place = place//'column '// &
            to_text(columns%places(which))//' ('//shown(trim(columns%names(which)))//'): '
      end function place

      !> Judges time stamps, which become seconds since the first of a file.
      subroutine judge_stamps()
         integer :: j

         if (case%units%time /= '' .and. abs(time_in_s(case%units%time) - 1) > 0) then
            found = 'time stamps, which become seconds'
            expected = 'time=''s'' in &units'
         end if
         associate (record => case%recordings(k))
            if (record%experiment == 0) return
            do j = 1, k - 1
               if (case%recordings(j)%experiment /= record%experiment) cycle
               if (case%recordings(j)%path == record%path) cycle
               found = 'time stamps, which count from the first row of each file'
               expected = 'all channels of experiment '//to_text(record%experiment)// &
                  ' in one file, or times on one clock'
            end do
         end associate
      end subroutine judge_stamps

      !> Judges the unit of the times against that of the case. Without a label, the case is taken
      !> to be in seconds.
      subroutine judge_times()
         real(wp) :: case_unit

         if (unit%kind /= unit_of_time) then
            found = 'a column in '//trim(unit%text)
            expected = 'times; time_column names another column'
            return
         end if
         case_unit = 1
         if (case%units%time /= '') case_unit = time_in_s(case%units%time)
         if (.not. case_unit > 0 .or. is_like(unit%factor, case_unit, 1.001_wp)) return
         found = 'times in '//trim(unit%text)
         if (case%units%time == '') then
            expected = 's, or time='//shown(trim(unit%text))//' in &units'
         else
            expected = trim(case%units%time)//', as &units says'
         end if
         expected = expected//' (scripts/to_csv.py converts times to s)'
      end subroutine judge_times

      !> Judges times without a unit by their size: numbers of days, as spreadsheets and MATLAB
      !> count them, and the time since 1970.
      subroutine judge_size()
         character(len=12), parameter :: names(3) = [character(len=12) :: 'milliseconds', &
            'microseconds', 'nanoseconds']
         integer :: k, n

         n = size(t)
         if (n < 3) return
         if (t(1) >= 2e4_wp .and. t(1) < 8e4_wp .or. t(1) >= 7e5_wp .and. t(1) < 8e5_wp) then
            if (t(n) - t(1) >= 1 .or. median(t(2:) - t(:n - 1)) > 1e-4_wp) return
            found = 'times of '//rounded(t(1), 6)//' with steps of '// &
               rounded(median(t(2:) - t(:n - 1)), 2)//', which look like days of a spreadsheet'
            expected = 'seconds (scripts/to_csv.py --time-unit d converts days; ''(s)'' behind '// &
               'the name of the column says that they are seconds)'
            return
         end if
         do k = 1, size(names)
            if (t(1) < 0.9_wp*10.0_wp**(9 + 3*k) .or. t(1) > 3*10.0_wp**(9 + 3*k)) cycle
            found = 'times of '//rounded(t(1), 3)//', which look like '//trim(names(k))// &
               ' since 1970'
            expected = 'seconds (scripts/to_csv.py --time-unit converts them)'
         end do
      end subroutine judge_size

      !> Judges whether the value column can be an acceleration.
      subroutine judge_values()
         character(len=*), parameter :: times(5) = [character(len=9) :: 't', 'time', 'timestamp', &
            'date', 'zeit']
         type(column_unit_t) :: unit

         expected = 'accelerations; value_column names another column'
         unit = unit_of_column(trim(columns%names(2)))
         if (unit%kind == other_unit) then
            found = 'a column in '//trim(unit%text)
         else if (any(lower(trim(bare_name(columns%names(2)))) == times) .or. &
            unit%kind == unit_of_time .and. unit%text /= 'min') then
            found = 'a column of times'
         end if
      end subroutine judge_values

      !> Compares the unit of the value column and the scale with the unit of acceleration of the
      !> case. Where the scale changes no parameter, as in a free decay with its own motion, a
      !> difference is noted; elsewhere it is an error.
      subroutine check_scale()
         type(column_unit_t) :: unit
         real(wp) :: scale, case_unit
         character(len=:), allocatable :: expected, target

         unit = unit_of_column(trim(columns%names(2)))
         scale = abs(case%recordings(k)%scale)
         case_unit = 0
         target = case%units%acceleration()
         if (target /= '') case_unit = length_in_m(case%units%length)/ &
            max(time_in_s(case%units%time), 1e-9_wp)**2
         if (target == '') target = 'the unit of the case'
         select case (unit%kind)
         case (unit_of_raw_values)
            if (abs(scale - 1) > 0) return
            expected = 'the factor from '//trim(unit%text)//' to '//target
         case (unit_of_acceleration)
            if (case_unit > 0) then
               if (is_like(scale, unit%factor/case_unit, 2.5_wp)) return
               expected = rounded(unit%factor/case_unit, 6)
            else
               ! In no consistent set of units is g the unit of acceleration.
               if (abs(scale - 1) > 0 .or. .not. unit%is_multiple_of_g) return
               expected = 'the factor from '//trim(unit%text)//' to '//target
            end if
         case default
            return
         end select
         if (has_free_amplitude()) then
            call add_note(notes, 'warning: the column is in '//trim(unit%text)//', but scale = '// &
               to_text(case%recordings(k)%scale)//' (expected '//expected// &
               '): check scale; only amplitudes, the offset and J depend on it')
         else
            call refuse(case%path, case%recordings(k)%line, 'record scale', &
               to_text(case%recordings(k)%scale)//' for a column in '//trim(unit%text)//' ('// &
               shown(trim(columns%names(2)))//')', expected, error)
         end if
      end subroutine check_scale

      !> Returns whether the amplitude of a record is unknown anyway, so that its scale changes
      !> neither the parameters nor their intervals.
      pure logical function has_free_amplitude()
         has_free_amplitude = .false.
         if (size(case%excitations) == 0) return
         associate (record => case%recordings(k), &
            excitation => case%excitations(min(k, size(case%excitations))))
            has_free_amplitude = excitation%modes > 0 .and. record%experiment == 0 .and. &
               .not. allocated(record%sd)
         end associate
      end function has_free_amplitude

   end subroutine check_columns

   !> Returns whether two positive numbers differ by less than a factor.
   pure logical function is_like(a, b, factor)
      real(wp), intent(in) :: a, b, factor

      is_like = a < factor*b .and. b < factor*a
   end function is_like

end module beamid_column_checks
