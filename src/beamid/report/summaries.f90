!> The summaries of a fit and of a simulation, which are printed on standard output and written to
!> summary.txt.
module beamid_summaries
   use beamid_along_reports, only: add_along, add_smoothing
   use beamid_case_files, only: case_t
   use beamid_error_sources, only: add_error_sources, add_mesh_warning
   use beamid_experiments, only: experiment_t
   use beamid_identification, only: simulation_t, stage_fit_t
   use beamid_kinds, only: wp
   use beamid_lines, only: columns, unit_suffix
   use beamid_method_groups, only: formula_names
   use beamid_parameter_names, only: name_length
   use beamid_responses, only: work_t
   use beamid_splines, only: clamped_root
   use beamid_statistics, only: unlimited
   use beamid_statistics_reports, only: add_statistics, scalar_parameters
   use beamid_strings, only: rounded, to_text
   use beamid_structure, only: is_coefficient, of_E
   use beamid_texts, only: left, right, text_t
   use beamid_values, only: listed
   use beamid_verdict_reports, only: verdict_summary
   use beamid_verdicts, only: verdict_t
   implicit none
   private

   public :: fit_summary, response_summary

contains

   !> Returns the summary of a fit: warnings of the input, the verdict, warnings of the mesh,
   !> estimates, then a table for each stage with a row for each mesh.
   !>
   !> fits     (stages, meshes)
   !> notes    remarks on the records
   !> verdict  on the last stage on the finest mesh
   function fit_summary(case, experiments, fits, notes, verdict) result(content)
      type(case_t), intent(in) :: case
      type(experiment_t), intent(in) :: experiments(:)
      type(stage_fit_t), intent(in) :: fits(:, :)
      character(len=*), intent(in) :: notes(:)
      type(verdict_t), intent(in) :: verdict
      character(len=:), allocatable :: content, line
      type(text_t) :: text, causes, warnings
      integer :: k

      associate (last => fits(size(fits, 1), size(fits, 2)))
         if (verdict%no_fit == '') call add_estimates(text, case, last)
         if (verdict%no_fit == '') call add_along(text, case, last)
      end associate
      call text%line()
      do k = 1, size(experiments)
         associate (t => experiments(k)%samples)
            line = case%name
            if (size(experiments) > 1) line = line//', record '//to_text(k)
            if (size(t) == 0) then
               call text%line(line//': identification from '//experiments(k)%observed%description())
               cycle
            end if
            call text%line(line//': identification from '//to_text(size(t))// &
               ' samples, t = '//to_text(t(1))//' to '//to_text(t(size(t)))// &
               unit_suffix(case%units%time))
         end associate
      end do
      do k = 1, size(notes)
         if (index(notes(k), 'warning: ') == 1) then
            call causes%line(notes(k))
         else
            call text%line(notes(k))
         end if
      end do
      if (any([(size(experiments(k)%samples) > 0, k=1, size(experiments))])) &
         call text%line('observed: '//observed(case))
      do k = 1, size(fits, 1)
         call text%line()
         call add_stage(text, case, fits(k, :))
         call add_statistics(text, case, fits(k, size(fits, 2)), verdict, &
            is_last=k == size(fits, 1))
         if (k == size(fits, 1)) call add_error_sources(text, case%units, &
            fits(k, size(fits, 2)))
         if (k == size(fits, 1)) call add_smoothing(text, fits(k, size(fits, 2)))
      end do
      do k = 1, size(fits, 2)
         call add_mesh_warning(warnings, fits(size(fits, 1), k))
      end do
      ! A mistake in the input explains what else is found. A rejection names it itself.
      content = verdict_summary(case, fits(size(fits, 1), size(fits, 2)), verdict)
      if (verdict%no_fit == '') content = causes%content()//content
      content = content//warnings%content()//text%content()
   end function fit_summary

   !> Adds the estimates with their total intervals, which include every source of error, with as
   !> many digits as the intervals justify.
   subroutine add_estimates(text, case, fit)
      type(text_t), intent(inout) :: text
      type(case_t), intent(in) :: case
      type(stage_fit_t), intent(in) :: fit
      character(len=:), allocatable :: line
      character(len=name_length) :: names(size(fit%free))
      logical :: widened(size(fit%free))
      real(wp) :: ends(2)
      integer :: digits, k

      call text%line()
      call text%line('              estimate    95 % interval with every source of error that '// &
         'the case states')
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
      do k = 1, size(fit%free)
         names(k) = fit%quantities(k)%name
         widened(k) = fit%is_widened(k) .and. .not. is_coefficient(fit%free(k)) .and. &
            fit%half_width(k) < unlimited
      end do
      if (any(widened)) call text%line('not determined: the errors of fixed parameters, or a '// &
         'drift, make the interval wider than the value: '//listed(pack(names, widened), ', ')// &
         '. Linear theory may exaggerate it: if the length or a position has a &prior, add it '// &
         'to free, keep the prior, and run `beamid profile`')
      ! Free decays, natural frequencies and motions by a moved base have no force as a scale, so
      ! that E follows the mass.
      associate (drives => fit%scenario%excitations)
         if (.not. all(drives%modes > 0 .or. drives%is_base .or. case%recordings%kind == 'modes') &
            .or. any(fit%scenario%structures(1)%essential() .neqv. clamped_root)) return
      end associate
      if (any(fit%free == of_E)) call text%line( &
         'not in these intervals: a clamp that yields, and mass that the model lacks. To find '// &
         'them, record the beam at a second free length or sensor position, and weigh it')
   end subroutine add_estimates

   !> Returns the number of significant digits that shows two digits of an interval's width.
   pure integer function needed_digits(ends) result(digits)
      real(wp), intent(in) :: ends(2)
      integer, parameter :: least = 3, most = 6

      digits = least
      if (ends(2) > unlimited) return
      digits = most
      if (ends(2) > ends(1)) digits = min(most, max(least, 2 + ceiling(log10(maxval(abs(ends)) &
         /(ends(2) - ends(1))))))
   end function needed_digits

   !> Adds one stage: start values, then estimates, J and effort for each mesh. Many parameters are
   !> shown in several blocks; coefficients of E(x) and c_D(x) are left out.
   subroutine add_stage(text, case, fits)
      type(text_t), intent(inout) :: text
      type(case_t), intent(in) :: case
      type(stage_fit_t), intent(in) :: fits(:)
      !> Number of columns of a block.
      integer, parameter :: most = 6
      integer :: first, k, n
      integer, allocatable :: list(:)

      list = scalar_parameters(fits(1))
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
         if (fits(k)%moved >= 0) call text%line('    the error of the integrator has moved '// &
            'the estimates by at most '//to_text(fits(k)%moved)//' standard errors, compared '// &
            'with '//fits(k)%reference)
         if (fits(k)%rejections /= '') call text%add(fits(k)%rejections)
         if (fits(k)%score >= 0) call text%line('    sum of squares over the window of '// &
            '&score: '//to_text(fits(k)%score))
      end do

   contains

      !> Adds the columns first to last: parameters, and J after the last of them.
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

   !> Returns the work of a solver in words.
   function effort(work) result(line)
      type(work_t), intent(in) :: work
      character(len=:), allocatable :: line

      line = to_text(work%solves)//' responses'
      if (work%steps > 0) line = line//', '//to_text(work%steps)//' steps, '// &
         to_text(work%evaluations)//' right-hand sides, '//to_text(work%factorizations)// &
            ' factorizations'
   end function effort

   !> Returns the formula that converts responses to accelerations in words.
   function observed(case) result(line)
      type(case_t), intent(in) :: case
      character(len=:), allocatable :: line

      associate (observation => case%model%observation)
         line = 'acceleration by '//trim(formula_names(observation%formula))
         if (observation%delta > 0) line = line//', Delta = '//to_text(observation%delta)// &
            unit_suffix(case%units%time)
      end associate
   end function observed

   !> Returns the summary of a simulation: the extremes of the response on each mesh.
   !>
   !> simulations  (meshes)
   function response_summary(case, simulations) result(content)
      type(case_t), intent(in) :: case
      type(simulation_t), intent(in) :: simulations(:)
      character(len=:), allocatable :: content
      type(text_t) :: text
      integer :: k

      associate (t => simulations(1)%response%t)
         call text%line(case%name//': response at '//to_text(size(t))//' times, t = '// &
            to_text(t(1))//' to '//to_text(t(size(t)))//unit_suffix(case%units%time))
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

end module beamid_summaries
