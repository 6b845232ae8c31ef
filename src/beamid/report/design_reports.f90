!> The summary of `design`: the present experiment, the best candidate experiments and the standard
!> errors that they would give.
module beamid_design_reports
   use beamid_boxes, only: is_pulse
   use beamid_case_files, only: case_t
   use beamid_design_tables, only: names_of_lists, settings
   use beamid_designs, only: design_t, designs_t, needed
   use beamid_kinds, only: wp
   use beamid_lines, only: columns
   use beamid_statistics, only: unlimited
   use beamid_strings, only: fixed, rounded, to_text
   use beamid_texts, only: left, right, text_t
   use beamid_unknowns, only: name_length
   use beamid_values, only: listed
   implicit none
   private

   public :: design_summary

   !> An experiment of the summary: the present one, or a candidate that is best by at least one
   !> criterion.
   type :: shown_t
      integer :: place = 0                   !< number of the candidate; 0: the present one
      character(len=:), allocatable :: why   !< criteria by which it is best, in words
      type(design_t) :: design               !< its settings and errors
   contains
      procedure :: label
   end type shown_t

contains

   !> Returns the summary of all candidate experiments.
   !>
   !> elements  of the mesh with which they were computed
   function design_summary(case, elements, designs) result(summary)
      type(case_t), intent(in) :: case
      integer, intent(in) :: elements
      type(designs_t), intent(in) :: designs
      character(len=:), allocatable :: summary
      type(text_t) :: text
      type(shown_t), allocatable :: shown(:)
      character(len=name_length), allocatable :: names(:)
      character(len=:), allocatable :: unit
      integer :: k, number

      names = designs%quantities%name
      number = count([(designs%list(k)%prediction%determined, k=1, size(designs%list))])
      unit = case%units%acceleration()
      if (designs%box%of_lines) unit = ''
      call text%line(case%name//': '//to_text(size(designs%list))//' experiments, N = '// &
         to_text(elements)//', noise of standard deviation '//trim(to_text(designs%box%noise_sd)// &
         ' '//unit))
      call text%line('free: '//listed(names, ', ')//'; of interest: '//listed(pack(names, &
         designs%interest), ', ')//', which '//to_text(number)//' of the experiments determine')
      if (designs%box%modes > 0) call text%line('the initial amplitudes and phases of the '// &
         'lowest '//to_text(designs%box%modes)//' modes are treated as unknown')
      call add_fixed()
      associate (records => size(case%recordings), sensors => merge(2, 1, &
         any([(designs%list(k)%x_S(2) > 0, k=1, size(designs%list))])))
         if (records > sensors) call text%line('''present'' has the '//to_text(records)// &
            ' records of the case, a design has '//to_text(sensors)//': compare designs only '// &
            'with each other')
      end associate
      do k = 1, size(designs%quantities)
         associate (q => designs%quantities(k))
            if (abs(q%searched) < q%scale) call text%line(trim(q%searched_name())//' is '// &
               to_text(q%searched)//' in the case: its errors are relative to '//to_text(q%scale))
         end associate
      end do
      call find_shown(designs, shown)
      call add_settings(text, names_of_lists(designs), shown)
      call add_errors(text, designs, shown)
      call add_eigenvalues(text, designs, shown)
      call add_edges(text, case, designs, shown)
      if (designs%box%target > 0) call add_target(text, case, designs)
      summary = text%content()

   contains

      !> Adds a line that names the fixed parameters with a prior, because designs ignore their
      !> errors.
      subroutine add_fixed()
         character(len=name_length), allocatable :: fixed(:)

         if (.not. allocated(case%model%priors)) return
         associate (priors => case%model%priors)
            fixed = [character(len=name_length) ::]
            do k = 1, size(priors)
               if (all(priors(k)%parameter(1) /= designs%quantities%parameter)) &
                  fixed = [character(len=name_length) :: fixed, priors(k)%name]
            end do
         end associate
         if (size(fixed) > 0) call text%line('these predictions do not include the errors of '// &
            'fixed parameters ('//listed(fixed, ', ')//')')
      end subroutine add_fixed

   end function design_summary

   !> Returns the name of an experiment in the summary, in the first column of the tables.
   pure function label(self)
      class(shown_t), intent(in) :: self
      character(len=:), allocatable :: label

      label = 'present'
      if (self%place > 0) label = 'design '//to_text(self%place)
      label = left(label, 12)
   end function label

   !> Lists the present experiment, in place 0, and the best candidates by the criteria D, A and E
   !> and for each parameter of interest. A candidate that is best by several criteria is listed
   !> once.
   subroutine find_shown(designs, shown)
      type(designs_t), intent(in) :: designs
      type(shown_t), allocatable, intent(out) :: shown(:)
      integer :: j, k

      allocate (shown(0:0))
      shown(0)%design = designs%present
      associate (list => designs%list)
         if (count(designs%interest) > 1) then
            call add([(list(k)%prediction%D, k=1, size(list))], 'by D', -unlimited)
            call add([(-list(k)%prediction%A, k=1, size(list))], 'by A', -unlimited)
            call add([(list(k)%prediction%E, k=1, size(list))], 'by E', 0.0_wp)
         end if
         do j = 1, size(designs%interest)
            if (designs%interest(j)) call add([(-list(k)%prediction%sd(j), k=1, size(list))], &
               'for '//trim(designs%quantities(j)%name), -unlimited)
         end do
      end associate

   contains

      !> Adds the candidate with the largest value, unless this value is not above `worst`.
      !>
      !> worst  value of candidates that leave a parameter undetermined
      subroutine add(values, why, worst)
         real(wp), intent(in) :: values(:), worst
         character(len=*), intent(in) :: why
         type(shown_t), allocatable :: longer(:)
         integer :: best, i

         best = maxloc(values, dim=1)
         if (.not. values(best) > worst) return
         do i = 1, ubound(shown, 1)
            if (shown(i)%place /= best) cycle
            shown(i)%why = shown(i)%why//', '//why
            return
         end do
         allocate (longer(0:size(shown)))
         longer(:ubound(shown, 1)) = shown
         longer(size(shown)) = shown_t(best, why, designs%list(best))
         call move_alloc(longer, shown)
      end subroutine add

   end subroutine find_shown

   !> Adds the settings of the present experiment and of the best candidates.
   !>
   !> names  of the settings
   subroutine add_settings(text, names, shown)
      type(text_t), intent(inout) :: text
      character(len=*), intent(in) :: names(:)
      type(shown_t), intent(in) :: shown(0:)
      character(len=:), allocatable :: duration, line, place
      integer :: k

      call text%line()
      line = left('', 12)//right(trim(names(1)))
      do k = 2, size(names)
         line = line//right(trim(names(k)), 11)
      end do
      call text%line(line//right('samples', 9))
      do k = 0, ubound(shown, 1)
         associate (design => shown(k)%design)
            place = to_text(design%x_S(1))
            if (design%x_S(2) > 0) place = place//' + '//to_text(design%x_S(2))
            duration = '-'
            if (design%duration > 0) duration = to_text(design%duration)
            call text%line(shown(k)%label()//right(place)//columns([design%x_F], 11)// &
               right(duration, 11)//columns([design%first, design%last, design%step], 11)// &
               right(to_text(design%samples), 9))
         end associate
      end do
      do k = 1, ubound(shown, 1)
         call text%line(trim(shown(k)%label())//' is best '//shown(k)%why)
      end do
      if (size(shown) == 1) call text%line('no experiment determines any parameter of interest')
   end subroutine add_settings

   !> Adds the standard errors relative to the values, for the present and the best experiments.
   subroutine add_errors(text, designs, shown)
      type(text_t), intent(inout) :: text
      type(designs_t), intent(in) :: designs
      type(shown_t), intent(in) :: shown(0:)
      !> Number of parameters side by side.
      integer, parameter :: most = 6
      character(len=:), allocatable :: line, value
      integer :: first, j, k, last

      associate (q => designs%quantities)
         do first = 1, size(q), most
            last = min(first + most - 1, size(q))
            call text%line()
            call text%line('standard errors relative to the values')
            line = left('', 12)
            do j = first, last
               line = line//right(trim(q(j)%searched_name()))
            end do
            call text%line(line)
            do k = 0, ubound(shown, 1)
               line = shown(k)%label()
               do j = first, last
                  value = 'not known'
                  associate (sd => shown(k)%design%prediction%sd(j))
                     if (sd < unlimited) value = percent(sd)
                  end associate
                  line = line//right(value)
               end do
               call text%line(line)
            end do
         end do
      end associate
   end subroutine add_errors

   !> Adds the criteria D, A and E, the eigenvalues of the information matrix of the parameters of
   !> interest, and the combination of them that is determined worst.
   subroutine add_eigenvalues(text, designs, shown)
      type(text_t), intent(inout) :: text
      type(designs_t), intent(in) :: designs
      type(shown_t), intent(in) :: shown(0:)
      character(len=name_length), allocatable :: names(:)
      character(len=:), allocatable :: words
      integer :: i, k, largest

      if (count(designs%interest) < 2) return
      names = pack(designs%quantities%searched_name(), designs%interest)
      call text%line()
      call text%line('criteria D, A and E; eigenvalues of the information matrix for relative '// &
         'changes of the parameters of interest')
      do k = 0, ubound(shown, 1)
         associate (p => shown(k)%design%prediction)
            if (.not. p%finite) then
               call text%line(shown(k)%label()//'not determined: columns of the derivatives '// &
                  'are parallel or zero')
               cycle
            end if
            words = ''
            do i = 1, size(p%eigenvalue)
               words = words//' '//rounded(p%eigenvalue(i), 3)
            end do
            call text%line(shown(k)%label()//'D = '//rounded(p%D, 4)//', A = '// &
               rounded(p%A, 3)//', E = '//rounded(p%E, 3)//';'//words)
            largest = maxloc(abs(p%direction(:, 1)), dim=1)
            words = ''
            do i = 1, size(names)
               associate (v => p%direction(i, 1)/p%direction(largest, 1))
                  if (abs(v) < 0.1_wp) cycle
                  if (words /= '') words = words//', '
                  words = words//trim(names(i))//' by '//merge('+', '-', v > 0)// &
                     to_text(nint(100*abs(v)))//' %'
               end associate
            end do
            call text%line(left('', 12)//'least known combination: '//words//'; its standard '// &
               'error is '//percent(1/sqrt(p%E)*abs(p%direction(largest, 1)))//' of this change')
         end associate
      end do
   end subroutine add_eigenvalues

   !> Adds a remark for each of the best candidates that lies at the end of a list of settings,
   !> where an extension of the list might contain a better one.
   subroutine add_edges(text, case, designs, shown)
      type(text_t), intent(inout) :: text
      type(case_t), intent(in) :: case
      type(designs_t), intent(in) :: designs
      type(shown_t), intent(in) :: shown(0:)
      character(len=:), allocatable :: lists
      character(len=8) :: names(settings)
      integer :: k

      if (size(shown) == 1) return
      names = names_of_lists(designs)
      call text%line()
      do k = 1, ubound(shown, 1)
         lists = ''
         associate (box => designs%box, design => shown(k)%design, &
            length => case%model%structure%length)
            call check_end('x_S', box%x_S, design%x_S(1), length)
            if (lists == '') call check_end('x_S', box%x_S, design%x_S(box%sensors), length)
            call check_end('x_F', box%x_F, design%x_F, length)
            call check_end('duration', box%duration, design%duration, unlimited)
            call check_end(trim(names(4)), box%first, design%first, unlimited)
            call check_end(trim(names(5)), box%last, design%last, unlimited)
            call check_end(trim(names(6)), box%step, design%step, unlimited)
         end associate
         if (lists /= '') call text%line(trim(shown(k)%label())//' is at the end of '//lists// &
            ': beyond it there may be better experiments')
      end do

   contains

      !> Appends the name of a list to `lists` if the value is at an end of the list.
      !>
      !> highest  largest possible value, beyond which the list cannot be extended
      subroutine check_end(name, list, value, highest)
         character(len=*), intent(in) :: name
         real(wp), intent(in) :: list(:), value, highest

         if (size(list) < 2) return
         if (value > list(1) .and. value < list(size(list)) .or. value >= highest) return
         if (lists /= '') lists = lists//', '
         lists = lists//name
      end subroutine check_end

   end subroutine add_edges

   !> Adds whether any candidate reaches the wanted standard error; if none does, how often the
   !> record would have to be repeated, or how strong the excitation would have to be.
   subroutine add_target(text, case, designs)
      type(text_t), intent(inout) :: text
      type(case_t), intent(in) :: case
      type(designs_t), intent(in) :: designs
      real(wp) :: worst(size(designs%list)), repeats, times
      character(len=:), allocatable :: what
      integer :: best, enough, k

      associate (box => designs%box, list => designs%list)
         worst = [(maxval(pack(list(k)%prediction%sd, designs%interest)), k=1, size(list))]
         enough = count(worst <= box%target)
         what = 'a standard error of '//percent(box%target)
         if (count(designs%interest) > 1) what = what//' of each parameter of interest'
         if (enough > 0) then
            ! Of the candidates with the fewest samples take the most accurate.
            best = minval(list%samples, mask=worst <= box%target)
            best = minloc(worst, dim=1, mask=list%samples == best)
            call text%line(what//': '//to_text(enough)//' experiments reach it; with the '// &
               'fewest samples, '//to_text(list(best)%samples)//', design '//to_text(best)// &
               ' ('//percent(worst(best))//')')
            return
         end if
         best = minloc(worst, dim=1)
         call text%line(what//': none of the experiments reaches it')
         if (.not. worst(best) < unlimited) return
         times = needed(designs, list(best), box%target)
         if (times < 0) return
         repeats = times
         if (times <= 1e9_wp) repeats = ceiling(times)
         what = 'the nearest, design '//to_text(best)//' ('//percent(worst(best))// &
            '), reaches it if its record is repeated '//to_text(repeats)//' times'
         if (is_pulse(case%excitations(1)) .or. case%excitations(1)%is_release) then
            what = what//', or with an amplitude of '//trim(to_text(sqrt(times) &
               *case%excitations(1)%amplitude)//' '//merge(case%units%length, case%units%force, &
               case%excitations(1)%by_displacement))//' instead of '// &
               to_text(case%excitations(1)%amplitude)
         else
            what = what//', or with an excitation that is '//to_text(sqrt(times))// &
               ' times as strong'
         end if
         call text%line(what)
      end associate
   end subroutine add_target

   !> Returns a ratio in per cent with three significant digits.
   function percent(ratio) result(text)
      real(wp), intent(in) :: ratio
      character(len=:), allocatable :: text
      character(len=12) :: digits

      if (ratio >= 1e4_wp .or. ratio < 1e-6_wp) then
         text = to_text(100*ratio)//' %'
         return
      end if
      write (digits, '(f12.4)') 100*ratio
      if (ratio >= 1e-3_wp) digits = fixed(100*ratio, 12, merge(1, 2, ratio >= 0.1_wp))
      text = trim(adjustl(digits))//' %'
   end function percent

end module beamid_design_reports
