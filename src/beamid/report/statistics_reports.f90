!> The part of the summary of a fit that states the statistics of one stage: errors, correlations,
!> determination and residuals. `beamid_summaries` adds it to the summary.
module beamid_statistics_reports
   use beamid_case_files, only: case_t
   use beamid_identification, only: stage_fit_t
   use beamid_kinds, only: wp
   use beamid_lines, only: columns, unit_suffix
   use beamid_statistics, only: unlimited
   use beamid_strings, only: to_text
   use beamid_structure, only: is_coefficient
   use beamid_texts, only: left, right, text_t
   use beamid_undetermined_directions, only: undetermined
   use beamid_unknowns, only: name_length
   use beamid_values, only: listed
   use beamid_verdict_reports, only: determination
   use beamid_verdicts, only: verdict_t
   implicit none
   private

   public :: add_statistics, scalar_parameters

contains

   !> Adds the statistics of one stage on one mesh: errors, correlations, parameters that the record
   !> does not determine, and the whiteness of the residuals.
   !>
   !> verdict  on the last stage on the finest mesh
   !> is_last  whether the fit is that of the last stage, which the verdict is about
   subroutine add_statistics(text, case, fit, verdict, is_last)
      type(text_t), intent(inout) :: text
      type(case_t), intent(in) :: case
      type(stage_fit_t), intent(in) :: fit
      type(verdict_t), intent(in) :: verdict
      logical, intent(in) :: is_last
      character(len=:), allocatable :: line
      character(len=name_length) :: names(size(fit%quantities))
      logical :: corrects
      integer :: k

      if (fit%statistics%samples == 0) then
         call text%line('there are no standard errors: the record has no more samples than the '// &
            'fit has unknowns')
         return
      end if
      names = fit%quantities%name
      call text%line()
      line = unit_suffix(case%units%acceleration())
      if (fit%weighted) line = ' of that of each record'
      call text%line('Statistics for N = '//to_text(fit%elements)//': noise sd '// &
         to_text(sqrt(fit%statistics%variance))//line//', '// &
         to_text(fit%statistics%freedom)//' degrees of freedom')
      line = '              estimate   std error      lower95      upper95'
      corrects = .not. fit%check%white .or. any(fit%statistics%disputed)
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
      end associate
      call add_correlations(text, fit, names)
      call add_determination(text, fit, names, verdict, is_last)
      if (allocated(fit%fit%derivative_check)) call text%line( &
         'relative difference of exact derivatives and central differences: '// &
         to_text(fit%fit%derivative_check(1))//' at the start, '// &
         to_text(fit%fit%derivative_check(2))//' at the end')
      line = 'the records disagree'
      if (all(fit%quantities%record > 0 .or. .not. fit%statistics%disputed)) &
         line = 'the resonances of a record disagree'
      if (size(fit%scenario%structures) == 1) line = 'the resonances of the record disagree'
      if (any(fit%statistics%disputed)) call text%line(line//' about '// &
         listed(pack(names, fit%statistics%disputed), ', ')//' by more than their residuals '// &
         'explain; the corrected errors include this disagreement')
      call add_residual_check(text, fit)
   end subroutine add_statistics

   !> Adds the singular values of the Jacobian, and which parameters or combinations of parameters
   !> the record does not determine.
   subroutine add_determination(text, fit, names, verdict, is_last)
      type(text_t), intent(inout) :: text
      type(stage_fit_t), intent(in) :: fit
      character(len=*), intent(in) :: names(:)
      type(verdict_t), intent(in) :: verdict
      logical, intent(in) :: is_last
      character(len=:), allocatable :: condition, line
      character(len=512), allocatable :: sentences(:)
      logical, allocatable :: is_wide(:), is_left(:)
      integer :: k, n

      associate (s => fit%statistics)
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
            line = ''
            if (is_last) line = determination(fit, verdict)
            if (line /= '') call text%line(line)
         else if (size(sentences) == 0 .and. verdict%caution == '') then
            is_wide = .not. s%determined .and. s%half_width >= abs([fit%quantities%searched])
            if (any(is_wide)) call text%line('not determined, because the interval is wider '// &
               'than the value: '//listed(pack(names, is_wide), ', '))
            n = size(fit%free)
            is_left = .not. s%determined(:n) .and. .not. is_wide(:n)
            if (allocated(fit%reach)) is_left = is_left .and. any(fit%reach > 0, dim=1)
            if (allocated(fit%reach) .and. any(is_left)) call text%line('not determined, '// &
               'because with what the model may lack, named above, the estimate moves out of '// &
               'its interval: '//listed(pack(names(:n), is_left), ', '))
         end if
      end associate
   end subroutine add_determination

   !> Adds the lower triangle of the correlation matrix of the searched quantities. Coefficients of
   !> E(x) and c_D(x), amplitudes of a free start and offsets are only in correlations.csv.
   subroutine add_correlations(text, fit, names)
      type(text_t), intent(inout) :: text
      type(stage_fit_t), intent(in) :: fit
      character(len=*), intent(in) :: names(:)
      !> Number of columns side by side.
      integer, parameter :: most = 8
      character(len=:), allocatable :: line
      integer, allocatable :: list(:)
      integer :: first, j, k, n

      list = scalar_parameters(fit)
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

   !> Returns the places of the free parameters that are not coefficients of E(x) or c_D(x).
   pure function scalar_parameters(fit) result(list)
      type(stage_fit_t), intent(in) :: fit
      integer, allocatable :: list(:)
      integer :: k, n

      n = size(fit%free)
      list = pack([(k, k=1, n)], .not. is_coefficient(fit%quantities(:n)%parameter))
   end function scalar_parameters

   !> Adds the tests of the residuals for whiteness.
   subroutine add_residual_check(text, fit)
      type(text_t), intent(inout) :: text
      type(stage_fit_t), intent(in) :: fit

      associate (check => fit%check)
         if (check%lags == 0) then
            call text%line('the residuals have no order: there is no test for white noise')
            return
         end if
         call text%line('residuals: autocorrelation at lag 1 '// &
            to_text(check%autocorrelation(1))//' (white: within '//to_text(check%band)// &
            '), Ljung-Box '//to_text(check%ljung_box)//' over '//to_text(check%lags)// &
            ' lags, probability '//to_text(check%probability))
         if (check%white) then
            call text%line('residuals pass for white noise')
         else if (any(fit%statistics%std_error >= unlimited)) then
            call text%line('residuals are NOT white; some standard errors are unlimited and '// &
               'cannot be corrected')
         else if (.not. fit%statistics%effective < fit%statistics%samples) then
            call text%line('residuals are NOT white: the model leaves something unexplained, '// &
               'which does not widen the intervals')
         else
            call text%line('residuals are NOT white: the samples are worth '// &
               to_text(nint(fit%statistics%effective))// &
               ' independent ones; the corrected errors allow for that')
         end if
      end associate
   end subroutine add_residual_check

   !> Returns standard error and 95 % interval of parameter k in columns; the interval lies within
   !> the bounds of the search.
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

end module beamid_statistics_reports
