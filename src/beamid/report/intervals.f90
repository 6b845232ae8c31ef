!> 95 % intervals of the same parameters by several methods: the table intervals.csv, which each of
!> the commands profile, sample and bootstrap completes, and a comparison in words.
module beamid_intervals
   use beamid_error_sources, only: add_left_out
   use beamid_identification, only: stage_fit_t
   use beamid_kinds, only: ip, wp
   use beamid_lines, only: limit, split
   use beamid_profile_likelihood, only: at_bound, is_closed, is_lost, is_open
   use beamid_statistics, only: unlimited
   use beamid_strings, only: full, rounded, to_text
   use beamid_texts, only: left, next_line, right, text_t
   use beamid_units, only: units_t
   use beamid_unknowns, only: name_length, quantity_t
   implicit none
   private

   public :: interval_t, append_interval, linear_intervals, read_intervals, interval_table, &
      interval_summary, end_words

   !> States of an end of an interval in words, in the order of the states of a profile.
   character(len=*), parameter :: end_words(4) = [character(len=9) :: 'closed', 'bound', &
      'unbounded', 'unknown']

   !> The 95 % interval of one parameter on one mesh by one method.
   type :: interval_t
      character(len=12) :: method = ''                !< 'linear', 'profile', 'posterior', ...
      integer :: elements = 0                         !< elements of the mesh
      character(len=name_length) :: parameter = ''    !< name of the parameter
      character(len=40) :: unit = ''                  !< unit of the three numbers below
      real(wp) :: estimate = 0, lower = 0, upper = 0  !< as named in the case file
      integer :: ends(2) = is_closed                  !< state of the lower and of the upper end
   end type interval_t

   !> Methods that the summary shows, and the headings of their columns.
   character(len=*), parameter :: methods(4) = [character(len=12) :: 'linear', 'profile', &
      'posterior', 'bca'], headings(4) = [character(len=16) :: 'linear theory', 'profile', &
      'posterior', 'bootstrap (BCa)']
   !> Header of intervals.csv.
   character(len=*), parameter :: header = &
      'method,elements,parameter,unit,estimate,lower95,upper95,lower_end,upper_end'

contains

   !> Appends the interval of one parameter to a list.
   !>
   !> q         the quantity that was searched
   !> estimate  estimate by this method, of the searched quantity (of a stiffness: its reciprocal)
   !> ends      lower and upper end, of the searched quantity
   !> states    states of the ends; default: closed
   subroutine append_interval(list, method, fit, q, units, estimate, ends, states)
      type(interval_t), allocatable, intent(inout) :: list(:)
      character(len=*), intent(in) :: method
      type(stage_fit_t), intent(in) :: fit
      type(quantity_t), intent(in) :: q
      type(units_t), intent(in) :: units
      real(wp), intent(in) :: estimate, ends(2)
      integer, intent(in), optional :: states(2)
      type(interval_t) :: new
      real(wp) :: limits(2)

      new%method = method
      new%elements = fit%elements
      new%parameter = q%name
      new%unit = units%of_quantity(q%parameter, fit%scenario%excitations(1))
      new%estimate = estimate
      limits = ends
      if (present(states)) new%ends = states
      if (q%is_reciprocal()) then
         new%estimate = reciprocal(estimate)
         limits = [reciprocal(ends(2)), reciprocal(ends(1))]
         new%ends = new%ends(2:1:-1)
         ! A compliance of 0 is a bound of the search, but not a bound of the stiffness.
         if (limits(2) > huge(limits)) new%ends(2) = is_open
      end if
      new%lower = limits(1)
      new%upper = limits(2)
      if (.not. allocated(list)) allocate (list(0))
      list = [list, new]

   contains

      !> Returns 1/x; twice `unlimited` for 0.
      pure real(wp) function reciprocal(x)
         real(wp), intent(in) :: x

         reciprocal = 2*unlimited
         if (abs(x) > tiny(x)) reciprocal = 1/x
      end function reciprocal

   end subroutine append_interval

   !> Appends the intervals of linear theory, corrected for the autocorrelation of the residuals.
   subroutine linear_intervals(fit, units, list)
      type(stage_fit_t), intent(in) :: fit
      type(units_t), intent(in) :: units
      type(interval_t), allocatable, intent(inout) :: list(:)
      real(wp) :: half, ends(2)
      integer :: states(2), k

      do k = 1, size(fit%free)
         associate (q => fit%quantities(k))
            half = fit%statistics%corrected_half_width(k)
            states = is_closed
            if (half < unlimited) then
               ends = q%searched + [-half, half]
               ! All methods give intervals within the bounds of the search.
               if (q%is_reciprocal()) then
                  ends(1) = max(ends(1), 0.0_wp)
               else
                  if (ends(1) < q%lower) states(1) = at_bound
                  if (ends(2) > q%upper) states(2) = at_bound
                  ends = min(max(ends, q%lower), q%upper)
               end if
            else
               states = is_open
               ends = [merge(0.0_wp, -2*unlimited, q%is_reciprocal()), 2*unlimited]
            end if
            call append_interval(list, 'linear', fit, q, units, q%searched, ends, states)
         end associate
      end do
   end subroutine linear_intervals

   !> Appends the intervals of other methods that an earlier command has written, provided that they
   !> belong to the same fit: the rows of linear theory must agree to the last digit.
   !>
   !> text  of intervals.csv; '': none
   !> list  on entry the intervals of this command, with those of linear theory
   subroutine read_intervals(text, list)
      character(len=*), intent(in) :: text
      type(interval_t), allocatable, intent(inout) :: list(:)
      type(interval_t), allocatable :: old(:)
      character(len=:), allocatable :: line
      integer(ip) :: first
      integer :: k, given

      allocate (old(0))
      given = size(list)
      first = 1
      do while (next_line(text, first, line))
         call parse(line)
      end do
      associate (ours => pack(list, list%method == 'linear'), &
         theirs => pack(old, old%method == 'linear'))
         if (size(ours) /= size(theirs)) return
         do k = 1, size(ours)
            if (row(ours(k)) /= row(theirs(k))) return
         end do
      end associate
      do k = 1, size(old)
         if (.not. any(list(:given)%method == old(k)%method)) list = [list, old(k)]
      end do

   contains

      !> Appends the interval in a line to `old`; ignores lines that are not rows of the table.
      subroutine parse(line)
         character(len=*), intent(in) :: line
         type(interval_t) :: new
         character(len=40) :: fields(9)
         integer :: status(4)

         call split(line, fields)
         new%method = fields(1)(:len(new%method))
         new%parameter = fields(3)(:len(new%parameter))
         new%unit = fields(4)
         read (fields(2), *, iostat=status(1)) new%elements
         read (fields(5), *, iostat=status(2)) new%estimate
         read (fields(6), *, iostat=status(3)) new%lower
         read (fields(7), *, iostat=status(4)) new%upper
         new%ends = [findloc(end_words == fields(8), .true., dim=1), &
            findloc(end_words == fields(9), .true., dim=1)]
         if (any(status /= 0) .or. any(new%ends == 0)) return
         old = [old, new]
      end subroutine parse

   end subroutine read_intervals

   !> Returns the table intervals.csv.
   function interval_table(list) result(content)
      type(interval_t), intent(in) :: list(:)
      character(len=:), allocatable :: content
      type(text_t) :: text
      integer :: k

      call text%line(header)
      do k = 1, size(list)
         call text%line(row(list(k)))
      end do
      content = text%content()
   end function interval_table

   !> Returns one row of intervals.csv.
   function row(interval) result(line)
      type(interval_t), intent(in) :: interval
      character(len=:), allocatable :: line

      associate (i => interval)
         line = trim(i%method)//','//to_text(i%elements)//','//trim(i%parameter)//','// &
            trim(i%unit)//','//limit(i%estimate)//','//low(i%lower)//','//limit(i%upper)//','// &
            trim(end_words(i%ends(1)))//','//trim(end_words(i%ends(2)))
      end associate

   contains

      !> Returns the lower end, which may be -infinity.
      function low(value) result(text)
         real(wp), intent(in) :: value
         character(len=:), allocatable :: text

         text = full(value)
         if (value < -huge(value)) text = '-inf'
      end function low

   end function row

   !> Adds a table with the intervals of all methods side by side, and remarks where they disagree.
   subroutine interval_summary(list, fit, text)
      type(interval_t), intent(in) :: list(:)
      type(stage_fit_t), intent(in) :: fit
      type(text_t), intent(inout) :: text
      !> Smallest width of a column, and width available for all columns [characters].
      integer, parameter :: least = 22, room = 90
      character(len=:), allocatable :: line
      integer, allocatable :: used(:)
      integer :: block, first, k, m, width

      used = pack([(m, m=1, size(methods))], [(any(list%method == methods(m) .and. &
         list%elements == fit%elements), m=1, size(methods))])
      width = least
      do k = 1, size(fit%free)
         do m = 1, size(used)
            width = max(width, 2 + len(ends_of(place(list, fit, k, trim(methods(used(m)))))))
         end do
      end do
      ! Methods for which a line has no room are shown in another table.
      block = max(1, min(size(used), room/width))
      do first = 1, size(used), block
         call text%line()
         line = left('95 %', 10)
         do m = first, min(first + block - 1, size(used))
            line = line//right(trim(headings(used(m))), width)
         end do
         call text%line(line)
         do k = 1, size(fit%free)
            line = left(trim(fit%quantities(k)%name), 10)
            do m = first, min(first + block - 1, size(used))
               line = line//right(ends_of(place(list, fit, k, trim(methods(used(m))))), width)
            end do
            m = place(list, fit, k, 'linear')
            if (10 + block*width + 2 + len_trim(list(m)%unit) <= 100) line = line//'  '// &
               list(m)%unit
            call text%line(line)
         end do
      end do
      do k = 1, size(fit%free)
         call compare_methods(list, fit, k, text)
      end do
      call add_left_out(text, fit)

   contains

      !> Returns "lower to upper" of one interval; '' if the method was not used.
      !>
      !> at  place in the list; 0: not used
      function ends_of(at) result(field)
         integer, intent(in) :: at
         character(len=:), allocatable :: field
         integer :: digits

         field = ''
         if (at == 0) return
         associate (i => list(at))
            digits = 3
            if (i%upper > i%lower .and. i%upper < unlimited .and. i%lower > -unlimited) &
               digits = min(6, max(3, 2 + ceiling(log10(max(abs(i%lower), abs(i%upper)) &
               /(i%upper - i%lower)))))
            field = shown(i%lower, i%ends(1), digits)//' to '//shown(i%upper, i%ends(2), digits)
         end associate
      end function ends_of

      !> Returns an end of an interval in words.
      function shown(value, state, digits) result(word)
         real(wp), intent(in) :: value
         integer, intent(in) :: state, digits
         character(len=:), allocatable :: word

         word = rounded(value, digits)
         if (value > unlimited) word = 'inf'
         if (value < -unlimited) word = '-inf'
         if (state == is_lost) word = '?'
      end function shown

   end subroutine interval_summary

   !> Returns the place in the list of a method's interval of parameter k; 0: none.
   pure integer function place(list, fit, k, method)
      type(interval_t), intent(in) :: list(:)
      type(stage_fit_t), intent(in) :: fit
      integer, intent(in) :: k
      character(len=*), intent(in) :: method

      place = findloc(list%method == method .and. list%elements == fit%elements .and. &
         list%parameter == fit%quantities(k)%name, .true., dim=1)
   end function place

   !> Adds a remark for each method whose interval of parameter k has an end that differs from that
   !> of linear theory (or of the profile) by more than a quarter of linear theory's half width.
   subroutine compare_methods(list, fit, k, text)
      type(interval_t), intent(in) :: list(:)
      type(stage_fit_t), intent(in) :: fit
      integer, intent(in) :: k
      type(text_t), intent(inout) :: text
      real(wp), parameter :: shows = 0.25_wp
      character(len=:), allocatable :: line, name, why
      real(wp) :: half, t
      integer :: linear, profile, posterior, bca

      linear = place(list, fit, k, 'linear')
      profile = place(list, fit, k, 'profile')
      posterior = place(list, fit, k, 'posterior')
      bca = place(list, fit, k, 'bca')
      name = trim(fit%quantities(k)%name)
      half = (list(linear)%upper - list(linear)%lower)/2
      if (profile > 0) then
         associate (p => list(profile), l => list(linear))
            if (any(p%ends == is_lost)) call text%line(name// &
               ': the profile could not be followed to its end')
            if (p%ends(1) == is_open .or. p%ends(2) == is_open) then
               call text%line(name//': the record sets no '//trim(merge('lower', 'upper', &
                  p%ends(1) == is_open))//' limit: J, minimised over the other parameters, '// &
                  'stays below the 95 % level')
            else if (any(p%ends == at_bound)) then
               call text%line(name//': the profile interval ends at a bound of the stage; '// &
                  'linear theory ignores bounds')
            else if (differ(p, l)) then
               t = (p%upper - p%estimate)/(p%estimate - p%lower)
               line = name//': J is not a parabola: the profile interval '
               if (t > 1.1_wp .or. t < 1/1.1_wp) then
                  line = line//'reaches '//rounded(t, 2)//' times as far up as down'
               else
                  line = line//'is '//rounded((p%upper - p%lower)/(l%upper - l%lower), 2)// &
                     ' times as wide'
               end if
               call text%line(line//'; use it instead of linear theory')
            end if
         end associate
      end if
      if (posterior > 0 .and. profile > 0) then
         if (differ(list(posterior), list(profile))) call text%line(name//': posterior '// &
            'and profile differ: the posterior averages over the other parameters, with flat '// &
            'priors between bounds; the profile takes their best values')
      end if
      if (bca > 0) then
         if (differ(list(bca), list(max(profile, linear)))) then
            if (fit%check%white) then
               why = 'the estimates scatter by another amount than the shape of J implies'
            else
               why = 'the other methods assume another correlation of the residuals in time'
            end if
            call text%line(name//': the bootstrap gives another interval: '//why)
         end if
      end if

   contains

      !> Returns whether an end differs by more than `shows` half widths.
      pure logical function differ(a, b)
         type(interval_t), intent(in) :: a, b

         differ = abs(a%lower - b%lower) > shows*half .or. abs(a%upper - b%upper) > shows*half
      end function differ

   end subroutine compare_methods

end module beamid_intervals
