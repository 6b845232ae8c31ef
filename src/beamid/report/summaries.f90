!> Results for the reader: what is printed on standard output and kept in summary.txt.
module beamid_summaries
   use beamid_along_reports, only: add_along, add_smoothing
   use beamid_case_files, only: case_t
   use beamid_error_sources, only: add_error_sources, add_mesh_warning
   use beamid_experiments, only: experiment_t
   use beamid_identification, only: simulation_t, stage_fit_t
   use beamid_kinds, only: wp
   use beamid_lines, only: columns
   use beamid_method_groups, only: formula_names
   use beamid_responses, only: work_t
   use beamid_statistics, only: undetermined, unlimited
   use beamid_strings, only: rounded, to_text
   use beamid_structure, only: is_coefficient
   use beamid_texts, only: left, right, text_t
   use beamid_unknowns, only: name_length
   use beamid_values, only: listed
   use beamid_verdict_reports, only: determination, verdict_summary
   use beamid_verdicts, only: verdict_t
   implicit none
   private

   public :: fit_summary, response_summary

contains

   !> The estimates, a table for each stage with a row for each mesh.
   !>
   !> fits  (stages, meshes)
   function fit_summary(case, experiments, fits, notes, verdict) result(content)
      type(case_t), intent(in) :: case
      type(experiment_t), intent(in) :: experiments(:)
      type(stage_fit_t), intent(in) :: fits(:, :)
      character(len=*), intent(in) :: notes(:)   !< on the records
      type(verdict_t), intent(in) :: verdict     !< on the last stage on the finest mesh
      character(len=:), allocatable :: content
      type(text_t) :: text, warnings
      integer :: k

      associate (last => fits(size(fits, 1), size(fits, 2)))
         if (verdict%no_fit == '') call add_estimates(text, case, last)
         if (verdict%no_fit == '') call add_along(text, case, last)
      end associate
      call text%line()
      do k = 1, size(experiments)
         associate (t => experiments(k)%samples)
            call text%line(case%name//': identification from '//to_text(size(t))// &
               ' samples, t = '//to_text(t(1))//' to '//to_text(t(size(t)))//label(case%units%time))
         end associate
      end do
      do k = 1, size(notes)
         call text%line(notes(k))
      end do
      call text%line('observed: '//observed(case))
      do k = 1, size(fits, 1)
         call text%line()
         call add_stage(text, case, fits(k, :))
         call add_statistics(text, case, fits(k, size(fits, 2)), verdict)
         if (k == size(fits, 1)) call add_error_sources(text, fits(k, size(fits, 2)))
         if (k == size(fits, 1)) call add_smoothing(text, fits(k, size(fits, 2)))
      end do
      do k = 1, size(fits, 2)
         call add_mesh_warning(warnings, fits(size(fits, 1), k))
      end do
      content = verdict_summary(case, fits(size(fits, 1), size(fits, 2)), verdict)// &
         warnings%content()//text%content()
   end function fit_summary

   !> The estimates with every source of error, as many digits as the interval leaves.
   subroutine add_estimates(text, case, fit)
      type(text_t), intent(inout) :: text
      type(case_t), intent(in) :: case
      type(stage_fit_t), intent(in) :: fit
      character(len=:), allocatable :: line
      real(wp) :: ends(2)
      integer :: digits, k

      call text%line()
      call text%line('              estimate    95 % interval, every source of error')
      do k = 1, size(fit%free)
         if (is_coefficient(fit%free(k))) cycle
         associate (q => fit%quantities(k))
            line = left(trim(q%name), 10)
            if (fit%statistics%samples == 0) then
               line = line//right(to_text(q%value), 12)//'    not known'
            else if (.not. fit%half_width(k) < unlimited) then
               line = line//right(rounded(q%value, 3), 12)//'    not determined'
            else
               ends = q%ends(fit%total(k))
               digits = needed_digits(ends)
               line = line//right(rounded(q%value, digits), 12)//'    '// &
                  right(rounded(ends(1), digits), 10)//' to '//rounded(ends(2), digits)
            end if
            call text%line(line//'  '//case%units%of_quantity(q%parameter, &
               fit%scenario%excitations(1)))
         end associate
      end do
   end subroutine add_estimates

   !> As many significant digits as show two of an interval's width.
   pure integer function needed_digits(ends) result(digits)
      real(wp), intent(in) :: ends(2)
      integer, parameter :: least = 3, most = 6

      digits = least
      if (ends(2) > unlimited) return
      digits = most
      if (ends(2) > ends(1)) digits = min(most, max(least, 2 + ceiling(log10(maxval(abs(ends)) &
         /(ends(2) - ends(1))))))
   end function needed_digits

   !> One stage: starts, then estimates, J and effort for each mesh; many parameters in several
   !> blocks, coefficients of E(x) and c_D(x) left out.
   subroutine add_stage(text, case, fits)
      type(text_t), intent(inout) :: text
      type(case_t), intent(in) :: case
      type(stage_fit_t), intent(in) :: fits(:)
      integer, parameter :: most = 6
      integer :: first, k, n
      integer, allocatable :: list(:)

      list = scalars(fits(1), size(fits(1)%free))
      n = size(list)
      call text%line('Stage '//to_text(fits(1)%stage))
      do first = 1, n + 1, most
         call add_block(first, min(first + most - 1, n + 1))
      end do
      do k = 1, size(fits)
         associate (fit => fits(k)%fit)
            call text%line('N = '//to_text(fits(k)%elements)//': '//to_text(fit%iterations)// &
               ' iterations, '//to_text(fit%evaluations)//' evaluations, '// &
               effort(fits(k)%work)//'; '//fit%reason)
            if (fit%shortened > 0) call text%line('    '//to_text(fit%shortened)// &
               ' steps shortened because the response could not be computed')
         end associate
         if (fits(k)%moved >= 0) call text%line('    the integrator''s error has moved the '// &
            'estimates by '//to_text(fits(k)%moved)//' of their standard errors at most, seen '// &
            'from '//fits(k)%reference)
         if (fits(k)%score >= 0) call text%line('    sum of squares over the window of '// &
            '&score: '//to_text(fits(k)%score))
      end do

   contains

      !> Columns first to last: parameters, and behind the last of them J.
      subroutine add_block(first, last)
         integer, intent(in) :: first, last
         character(len=:), allocatable :: names, units, start, line
         integer :: k

         names = '    N'
         units = '     '
         start = 'start'
         do k = first, min(last, n)
            associate (q => fits(1)%quantities(list(k)))
               names = names//right(trim(q%name))
               units = units//right(case%units%of_quantity(q%parameter, &
                  fits(1)%scenario%excitations(1)))
               start = start//right(to_text(q%start))
            end associate
         end do
         if (last > n) then
            names = names//right('J')
            if (.not. fits(1)%weighted) units = units//right(case%units%sum_of_squares())
         end if
         call text%line(names)
         call text%line(units)
         if (first <= n) call text%line(start)
         do k = 1, size(fits)
            line = right(to_text(fits(k)%elements), 5)//columns([fits(k)%quantities( &
               list(first:min(last, n)))%value], 14)
            if (last > n) line = line//columns([fits(k)%fit%J], 14)
            call text%line(line)
         end do
      end subroutine add_block

   end subroutine add_stage

   !> Errors, correlations, what is not determined and what the residuals say, on one mesh.
   subroutine add_statistics(text, case, fit, verdict)
      type(text_t), intent(inout) :: text
      type(case_t), intent(in) :: case
      type(stage_fit_t), intent(in) :: fit
      type(verdict_t), intent(in) :: verdict
      character(len=:), allocatable :: condition, line
      character(len=name_length) :: names(size(fit%quantities))
      character(len=512), allocatable :: sentences(:)
      logical :: corrects
      integer :: k

      if (fit%statistics%samples == 0) then
         call text%line('No degree of freedom is left for standard errors.')
         return
      end if
      names = fit%quantities%name
      call text%line()
      line = label(case%units%acceleration())
      if (fit%weighted) line = ' of that of each record'
      call text%line('Statistics for N = '//to_text(fit%elements)//': noise sd '// &
         to_text(sqrt(fit%statistics%variance))//line//', '// &
         to_text(fit%statistics%freedom)//' degrees of freedom')
      line = '              estimate   std error      lower95      upper95'
      corrects = .not. fit%check%white
      if (allocated(fit%statistics%disputed)) corrects = corrects .or. &
         any(fit%statistics%disputed)
      if (corrects) line = line//'   corrected      lower95      upper95'
      call text%line(line)
      associate (s => fit%statistics, p => fit%quantities%value)
         do k = 1, size(p)
            if (is_coefficient(fit%quantities(k)%parameter)) cycle
            line = left(trim(names(k)), 10)//right(to_text(p(k)), 12)//interval(fit, k, &
               s%std_error(k), s%half_width(k))
            if (corrects) line = line//interval(fit, k, &
               s%corrected_error(k), s%corrected_half_width(k))
            call text%line(line)
         end do
         call add_correlations(text, fit, names)
         condition = 'unlimited'
         if (s%condition < unlimited) condition = to_text(s%condition)
         call text%line('singular values of the Jacobian per relative change:'// &
            columns(s%singular, 1)//'; condition number '//condition)
         sentences = undetermined(s, [fit%quantities%searched_name()], &
            [fit%quantities%scale], fit%jacobian)
         do k = 1, size(sentences)
            call text%line(sentences(k))
         end do
         if (all(s%determined)) then
            line = determination(fit, verdict)
            if (line /= '') call text%line(line)
         else if (size(sentences) == 0) then
            call text%line('the interval is wider than the value of: '// &
               listed(pack(names, .not. s%determined), ' '))
         end if
      end associate
      if (allocated(fit%fit%derivative_check)) call text%line( &
         'derivatives, exact against central differences: '// &
         to_text(fit%fit%derivative_check(1))//' at the start, '// &
         to_text(fit%fit%derivative_check(2))//' at the end')
      if (corrects .and. any(fit%statistics%disputed)) call text%line('the records disagree '// &
         'by more than their residuals explain about: '//listed(pack(names, &
         fit%statistics%disputed), ' ')//'; the corrected errors are from that')
      call add_residual_check(text, fit)
   end subroutine add_statistics

   !> The lower triangle of what was searched for, under headings; coefficients of E(x) and c_D(x),
   !> amplitudes of a start and offsets are in correlations.csv.
   subroutine add_correlations(text, fit, names)
      type(text_t), intent(inout) :: text
      type(stage_fit_t), intent(in) :: fit
      character(len=*), intent(in) :: names(:)
      integer, parameter :: most = 8
      character(len=:), allocatable :: line
      integer, allocatable :: list(:)
      integer :: first, j, k, n

      list = scalars(fit, size(fit%free))
      n = size(list)
      if (n < 2) return
      call text%line('correlations')
      do first = 1, n - 1, most
         line = repeat(' ', 10)
         do j = first, min(first + most - 1, n - 1)
            line = line//right(trim(names(list(j))), 11)
         end do
         call text%line(line)
         do k = first + 1, n
            call text%line(left(trim(names(list(k))), 10)//columns([(fit%correlation( &
               list(k), list(j)), j=first, min(first + most - 1, k - 1))], 11, '#.4'))
         end do
      end do
   end subroutine add_correlations

   !> Which of the first n quantities are no coefficients of E(x) or c_D(x).
   pure function scalars(fit, n) result(list)
      type(stage_fit_t), intent(in) :: fit
      integer, intent(in) :: n
      integer, allocatable :: list(:)
      integer :: k

      list = pack([(k, k=1, n)], .not. is_coefficient(fit%quantities(:n)%parameter))
   end function scalars

   !> Whiteness of the residuals.
   subroutine add_residual_check(text, fit)
      type(text_t), intent(inout) :: text
      type(stage_fit_t), intent(in) :: fit

      associate (check => fit%check)
         call text%line('residuals: autocorrelation at lag 1 '// &
            to_text(check%autocorrelation(1))//' (white: within '//to_text(check%band)// &
            '), Ljung-Box '//to_text(check%ljung_box)//' over '//to_text(check%lags)// &
            ' lags, probability '//to_text(check%probability))
         if (check%white) then
            call text%line('residuals pass for white noise')
         else if (any(fit%statistics%std_error >= unlimited)) then
            call text%line('residuals are NOT white; errors without limits cannot be corrected')
         else
            call text%line('residuals are NOT white: as good as '// &
               to_text(fit%statistics%effective)// &
               ' independent samples; the corrected errors allow for that')
         end if
      end associate
   end subroutine add_residual_check

   !> Standard error and interval in columns, within the bounds of the search.
   function interval(fit, k, std_error, half_width) result(line)
      type(stage_fit_t), intent(in) :: fit
      integer, intent(in) :: k
      real(wp), intent(in) :: std_error, half_width
      character(len=:), allocatable :: line
      real(wp) :: ends(3)

      associate (q => fit%quantities(k))
         line = right('unlimited', 12)//right('-', 13)//right('-', 13)
         if (.not. (std_error < unlimited .and. half_width < unlimited)) return
         if (fit%statistics%is_withdrawn(k)) return
         ends = q%limits(std_error, half_width)
         line = right('-', 12)
         if (abs(ends(1)) <= unlimited) line = columns(ends(:1), 12)
         line = line//columns(ends(2:), 13)
      end associate
   end function interval

   !> What a solver did.
   function effort(work) result(line)
      type(work_t), intent(in) :: work
      character(len=:), allocatable :: line

      line = to_text(work%solves)//' responses'
      if (work%steps > 0) line = line//', '//to_text(work%steps)//' steps, '// &
         to_text(work%evaluations)//' right-hand sides, '//to_text(work%factorizations)// &
            ' factorizations'
   end function effort

   !> Which formula turns the response into accelerations.
   function observed(case) result(line)
      type(case_t), intent(in) :: case
      character(len=:), allocatable :: line

      associate (observation => case%model%observation)
         line = 'acceleration by '//trim(formula_names(observation%formula))
         if (observation%delta > 0) line = line//', Delta = '//to_text(observation%delta)// &
            label(case%units%time)
      end associate
   end function observed

   !> Extremes of a computed response on each mesh.
   function response_summary(case, simulations) result(content)
      type(case_t), intent(in) :: case
      type(simulation_t), intent(in) :: simulations(:)
      character(len=:), allocatable :: content
      type(text_t) :: text
      integer :: k

      associate (t => simulations(1)%response%t)
         call text%line(case%name//': response at '//to_text(size(t))//' times, t = '// &
            to_text(t(1))//' to '//to_text(t(size(t)))//label(case%units%time))
      end associate
      call text%line('observed: '//observed(case))
      call text%line()
      call text%line('    N'//right('max |u|')//right('max |u_t|')//right('max |u_tt|'))
      call text%line('     '//right(case%units%length)//right(case%units%velocity())// &
         right(case%units%acceleration()))
      do k = 1, size(simulations)
         associate (s => simulations(k))
            call text%line(right(to_text(case%meshes(k)%elements), 5)//columns([ &
               maxval(abs(s%response%displacement)), maxval(abs(s%response%velocity)), &
               maxval(abs(s%acceleration))], 14))
            call text%line('       '//effort(s%work))
         end associate
      end do
      content = text%content()
   end function response_summary

   !> A unit behind a number, or nothing.
   pure function label(unit) result(text)
      character(len=*), intent(in) :: unit
      character(len=:), allocatable :: text

      text = ''
      if (unit /= '') text = ' '//trim(unit)
   end function label

end module beamid_summaries
