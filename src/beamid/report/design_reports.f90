!> Experiments to choose from: a table of all, and for the reader the best of them.
module beamid_design_reports
   use beamid_boxes, only: is_pulse
   use beamid_case_files, only: case_t
   use beamid_designs, only: design_t, designs_t, needed
   use beamid_kinds, only: wp
   use beamid_lines, only: columns, csv_row
   use beamid_statistics, only: unlimited
   use beamid_strings, only: fixed, full, rounded, to_text
   use beamid_texts, only: left, right, text_t
   use beamid_unknowns, only: name_length
   use beamid_values, only: listed
   implicit none
   private

   public :: design_table, design_summary

   character(len=*), parameter :: list_names(6) = [character(len=8) :: 'x_S', 'x_F', 'duration', &
      't_first', 't_last', 't_step']

   !> A design that is best in some respect.
   type :: winner_t
      integer :: place = 0
      character(len=:), allocatable :: why
   end type winner_t

contains

   !> design.csv: a row for each, 0 the present one. `sd` are standard errors, `relative` those of
   !> relative changes; empty: nothing is known.
   function design_table(designs) result(table)
      type(designs_t), intent(in) :: designs
      character(len=:), allocatable :: table
      character(len=name_length), allocatable :: names(:)
      type(text_t) :: text
      integer :: k

      names = designs%quantities%name
      call text%line('design,x_S,x_S_2,x_F,duration,t_first,t_last,t_step,samples,'// &
         'determined,D,A,E,'//listed('sd_'//names, ',')//','//listed('relative_'//names, ','))
      call add_row(text, designs, 0, designs%present)
      do k = 1, size(designs%list)
         call add_row(text, designs, k, designs%list(k))
      end do
      table = text%content()
   end function design_table

   subroutine add_row(text, designs, number, design)
      type(text_t), intent(inout) :: text
      type(designs_t), intent(in) :: designs
      integer, intent(in) :: number
      type(design_t), intent(in) :: design
      character(len=:), allocatable :: row
      real(wp) :: limits(3)
      integer :: k

      row = to_text(number)//','//full(design%x_S(1))//','
      if (design%x_S(2) > 0) row = row//full(design%x_S(2))
      row = row//','//full(design%x_F)//','
      if (design%duration > 0) row = row//full(design%duration)
      associate (p => design%prediction)
         row = csv_row(row, [design%t_first, design%t_last, design%t_step])//','// &
            to_text(design%samples)//','//trim(merge('yes', 'no ', p%determined))
         if (p%finite) then
            row = csv_row(row, [p%D, p%A, p%E])
         else
            row = row//',,,'
         end if
         do k = 1, size(p%sd)
            limits = unlimited
            if (p%sd(k) < unlimited) limits = designs%quantities(k)%limits( &
               p%sd(k)*designs%quantities(k)%scale, 0.0_wp)
            row = row//','
            if (limits(1) < unlimited) row = row//full(limits(1))
         end do
         do k = 1, size(p%sd)
            row = row//','
            if (p%sd(k) < unlimited) row = row//full(p%sd(k))
         end do
      end associate
      call text%line(row)
   end subroutine add_row

   !> elements  of the mesh
   function design_summary(case, elements, designs) result(summary)
      type(case_t), intent(in) :: case
      integer, intent(in) :: elements
      type(designs_t), intent(in) :: designs
      character(len=:), allocatable :: summary
      type(text_t) :: text
      type(winner_t), allocatable :: winners(:)
      character(len=name_length), allocatable :: names(:)
      integer :: k, known

      names = designs%quantities%name
      known = count([(designs%list(k)%prediction%determined, k=1, size(designs%list))])
      call text%line(case%name//': '//to_text(size(designs%list))//' experiments, N = '// &
         to_text(elements)//', noise of standard deviation '//trim(to_text(designs%box%noise_sd)// &
         ' '//case%units%acceleration()))
      call text%line('free: '//listed(names, ', ')//'; of interest: '//listed(pack(names, &
         designs%interest), ', ')//', which '//to_text(known)//' of the experiments determine')
      if (designs%box%modes > 0) call text%line('the start of the lowest '// &
         to_text(designs%box%modes)//' modes counts as unknown')
      do k = 1, size(designs%quantities)
         associate (q => designs%quantities(k))
            if (abs(q%searched) < q%scale) call text%line(trim(q%searched_name())//' is '// &
               to_text(q%searched)//' here: its errors are relative to '//to_text(q%scale))
         end associate
      end do
      call find_winners(designs, winners)
      call add_settings(text, designs, winners)
      call add_errors(text, designs, winners)
      call add_eigenvalues(text, designs, winners)
      call add_edges(text, case, designs, winners)
      if (designs%box%target > 0) call add_target(text, case, designs)
      summary = text%content()
   end function design_summary

   !> The best by each criterion and for each parameter of interest, each design once.
   subroutine find_winners(designs, winners)
      type(designs_t), intent(in) :: designs
      type(winner_t), allocatable, intent(out) :: winners(:)
      integer :: j, k

      allocate (winners(0))
      associate (list => designs%list)
         if (count(designs%interest) > 1) then
            call add([(list(k)%prediction%D, k=1, size(list))], 'by D')
            call add([(-list(k)%prediction%A, k=1, size(list))], 'by A')
            call add([(list(k)%prediction%E, k=1, size(list))], 'by E', 0.0_wp)
         end if
         do j = 1, size(designs%interest)
            if (designs%interest(j)) call add([(-list(k)%prediction%sd(j), k=1, size(list))], &
               'for '//trim(designs%quantities(j)%name))
         end do
      end associate

   contains

      !> The largest value wins; not one at `worst`.
      subroutine add(values, why, worst)
         real(wp), intent(in) :: values(:)
         character(len=*), intent(in) :: why
         real(wp), intent(in), optional :: worst
         type(winner_t) :: winner
         real(wp) :: least
         integer :: best, i

         least = -unlimited
         if (present(worst)) least = worst
         best = maxloc(values, dim=1)
         if (.not. values(best) > least) return
         do i = 1, size(winners)
            if (winners(i)%place /= best) cycle
            winners(i)%why = winners(i)%why//', '//why
            return
         end do
         winner%place = best
         winner%why = why
         winners = [winners, winner]
      end subroutine add

   end subroutine find_winners

   !> What the present experiment and the best ones are.
   subroutine add_settings(text, designs, winners)
      type(text_t), intent(inout) :: text
      type(designs_t), intent(in) :: designs
      type(winner_t), intent(in) :: winners(:)
      character(len=:), allocatable :: line
      integer :: k

      call text%line()
      line = left('', 12)//right(trim(list_names(1)))
      do k = 2, size(list_names)
         line = line//right(trim(list_names(k)), 11)
      end do
      call text%line(line//right('samples', 9))
      call add('present', designs%present)
      do k = 1, size(winners)
         call add('design '//to_text(winners(k)%place), designs%list(winners(k)%place))
      end do
      do k = 1, size(winners)
         call text%line('design '//to_text(winners(k)%place)//' is best '//winners(k)%why)
      end do
      if (size(winners) == 0) call text%line('no experiment tells anything of what is of interest')

   contains

      subroutine add(label, design)
         character(len=*), intent(in) :: label
         type(design_t), intent(in) :: design
         character(len=:), allocatable :: place, duration

         place = to_text(design%x_S(1))
         if (design%x_S(2) > 0) place = place//' + '//to_text(design%x_S(2))
         duration = '-'
         if (design%duration > 0) duration = to_text(design%duration)
         call text%line(left(label, 12)//right(place)//columns([design%x_F], 11)// &
            right(duration, 11)//columns([design%t_first, design%t_last, design%t_step], 11)// &
            right(to_text(design%samples), 9))
      end subroutine add

   end subroutine add_settings

   !> Standard errors relative to the values, and the criteria.
   subroutine add_errors(text, designs, winners)
      type(text_t), intent(inout) :: text
      type(designs_t), intent(in) :: designs
      type(winner_t), intent(in) :: winners(:)
      integer, parameter :: most = 6
      character(len=:), allocatable :: line
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
            call add('present', designs%present)
            do k = 1, size(winners)
               call add('design '//to_text(winners(k)%place), designs%list(winners(k)%place))
            end do
         end do
      end associate

   contains

      subroutine add(label, design)
         character(len=*), intent(in) :: label
         type(design_t), intent(in) :: design
         character(len=:), allocatable :: value

         line = left(label, 12)
         do j = first, last
            value = 'not known'
            if (design%prediction%sd(j) < unlimited) value = percent(design%prediction%sd(j))
            line = line//right(value)
         end do
         call text%line(line)
      end subroutine add

   end subroutine add_errors

   !> Eigenvalues of the information, and the combination of parameters that is known least.
   subroutine add_eigenvalues(text, designs, winners)
      type(text_t), intent(inout) :: text
      type(designs_t), intent(in) :: designs
      type(winner_t), intent(in) :: winners(:)
      integer :: k

      if (count(designs%interest) < 2) return
      call text%line()
      call text%line('D, A, E, and the eigenvalues of the information of relative changes, the '// &
         'nuisance free')
      call add('present', designs%present)
      do k = 1, size(winners)
         call add('design '//to_text(winners(k)%place), designs%list(winners(k)%place))
      end do

   contains

      subroutine add(label, design)
         character(len=*), intent(in) :: label
         type(design_t), intent(in) :: design
         character(len=:), allocatable :: words
         integer :: i, largest

         associate (p => design%prediction, names => pack(designs%quantities%searched_name(), &
            designs%interest))
            if (.not. p%finite) then
               call text%line(left(label, 12)//'not determined: columns of the derivatives are '// &
                  'parallel, or nothing')
               return
            end if
            words = ''
            do i = 1, size(p%eigenvalue)
               words = words//' '//rounded(p%eigenvalue(i), 3)
            end do
            call text%line(left(label, 12)//'D = '//rounded(p%D, 4)//', A = '//rounded(p%A, 3)// &
               ', E = '//rounded(p%E, 3)//';'//words)
            largest = maxloc(abs(p%direction(:, 1)), dim=1)
            associate (v => p%direction(:, 1)/p%direction(largest, 1))
               words = ''
               do i = 1, size(v)
                  if (abs(v(i)) < 0.1_wp) cycle
                  if (words /= '') words = words//', '
                  words = words//trim(names(i))//' by '//merge('+', '-', v(i) > 0)// &
                     to_text(nint(100*abs(v(i))))//' %'
               end do
               call text%line(left('', 12)//'known least: '//words//', to within '// &
                  percent(1/sqrt(p%E)*abs(p%direction(largest, 1)))//' of that')
            end associate
         end associate
      end subroutine add

   end subroutine add_eigenvalues

   !> Where the best lie at an end of a list that could be longer.
   subroutine add_edges(text, case, designs, winners)
      type(text_t), intent(inout) :: text
      type(case_t), intent(in) :: case
      type(designs_t), intent(in) :: designs
      type(winner_t), intent(in) :: winners(:)
      character(len=:), allocatable :: lists
      integer :: k

      if (size(winners) == 0) return
      call text%line()
      do k = 1, size(winners)
         lists = ''
         associate (box => designs%box, design => designs%list(winners(k)%place), &
            length => case%model%structure%length)
            call look('x_S', box%x_S, design%x_S(1), length)
            if (lists == '') call look('x_S', box%x_S, design%x_S(box%sensors), length)
            call look('x_F', box%x_F, design%x_F, length)
            call look('duration', box%duration, design%duration, unlimited)
            call look('t_first', box%t_first, design%t_first, unlimited)
            call look('t_last', box%t_last, design%t_last, unlimited)
            call look('t_step', box%t_step, design%t_step, unlimited)
         end associate
         if (lists /= '') call text%line('design '//to_text(winners(k)%place)// &
            ' is at the end of '//lists//': beyond it there may be better ones')
      end do

   contains

      !> highest  no value can be more
      subroutine look(name, list, value, highest)
         character(len=*), intent(in) :: name
         real(wp), intent(in) :: list(:), value, highest

         if (size(list) < 2) return
         if (value > list(1) .and. value < list(size(list)) .or. value >= highest) return
         if (lists /= '') lists = lists//', '
         lists = lists//name
      end subroutine look

   end subroutine add_edges

   !> Whether any experiment is good enough, and what would make the best one so.
   subroutine add_target(text, case, designs)
      type(text_t), intent(inout) :: text
      type(case_t), intent(in) :: case
      type(designs_t), intent(in) :: designs
      real(wp) :: worst(size(designs%list)), times
      character(len=:), allocatable :: what
      integer :: best, enough, k

      associate (box => designs%box, list => designs%list)
         worst = [(maxval(pack(list(k)%prediction%sd, designs%interest)), k=1, size(list))]
         enough = count(worst <= box%target)
         what = 'a standard error of '//percent(box%target)
         if (count(designs%interest) > 1) what = what//' of each parameter of interest'
         if (enough > 0) then
            ! The one with the fewest samples, and of these the best.
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
         what = 'the nearest, design '//to_text(best)//' ('//percent(worst(best))// &
            '), would with its record repeated '//whole(times)//' times'
         if (is_pulse(case%excitations(1)) .or. case%excitations(1)%is_release) then
            what = what//', or with an amplitude of '//trim(to_text(sqrt(times) &
               *case%excitations(1)%amplitude)//' '//merge(case%units%length, case%units%force, &
               case%excitations(1)%by_displacement))//' instead of '// &
               to_text(case%excitations(1)%amplitude)
         else
            what = what//', or with an excitation '//to_text(sqrt(times))//' times as strong'
         end if
         call text%line(what)
      end associate
   end subroutine add_target

   !> The next whole number, all its digits as far as they are shown.
   function whole(value) result(text)
      real(wp), intent(in) :: value
      character(len=:), allocatable :: text

      text = to_text(real(ceiling(min(value, 1e9_wp)), wp))
      if (value > 1e9_wp) text = to_text(value)
   end function whole

   !> Three digits.
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
