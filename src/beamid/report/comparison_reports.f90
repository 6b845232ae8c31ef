!> The report of the command compare: the information criteria of each model, and the tests of
!> nested models.
module beamid_comparison_reports
   use beamid_candidates, only: candidate_t, compute_criteria, criteria_t, is_nested
   use beamid_criteria, only: nested_test
   use beamid_damping_models, only: damping_models_t
   use beamid_damping_reports, only: add_damping
   use beamid_kinds, only: wp
   use beamid_lines, only: columns, csv_row, filled
   use beamid_outputs, only: output_t
   use beamid_strings, only: string_t, to_text
   use beamid_texts, only: left, right, text_t
   implicit none
   private

   public :: report_comparison

contains

   !> Reports a comparison: models.csv, nested.csv and the summary.
   !>
   !> models   with their fits
   !> labels   (size of models) names of the models in the tables
   !> damping  the models, if they differ in their damping mechanisms: adds damping.csv
   subroutine report_comparison(models, labels, output, summary, damping)
      type(candidate_t), intent(in) :: models(:)
      type(string_t), intent(in) :: labels(:)
      type(output_t), intent(inout) :: output
      character(len=:), allocatable, intent(out) :: summary
      type(damping_models_t), intent(in), optional :: damping
      type(criteria_t) :: criteria
      type(text_t) :: text

      criteria = compute_criteria(models)
      if (present(damping)) call add_damping(damping, criteria, labels, output, text)
      call add_models()
      call add_nested()
      summary = text%content()

   contains

      !> Adds a table of J, number of parameters and criteria of each model to the summary, and
      !> models.csv.
      subroutine add_models()
         type(text_t) :: table
         character(len=:), allocatable :: elements, free
         integer :: k

         call text%line('Models of the same data, m = '//to_text(criteria%samples)//' values')
         if (criteria%noise_is_known) then
            call text%line('AICc = J + 2 k, BIC = J + k ln m, because the noise is known,')
            call text%line('k = number of free parameters; the smaller the better.')
         else
            call text%line( &
               'AICc = m ln(J/m) + 2 k + 2 k (k + 1)/(m - k - 1), BIC = m ln(J/m) + k ln m,')
            call text%line('k = number of free parameters + 1 for the noise; the smaller the '// &
               'better.')
         end if
         if (criteria%inflation > 1) call text%line(filled('No model leaves residuals as small '// &
            'as the stated noise: J is divided by #.2, the chi-square per degree of freedom of '// &
            'the best model.', [criteria%inflation]))
         call text%line()
         call text%line(left('model', 26)//right('N', 5)//right('free', 6)//right('J')// &
            right('AICc', 13)//right('- best', 11)//right('BIC', 13)//right('- best', 11))
         call table%line('model,elements,parameters,J,aicc,bic')
         do k = 1, size(models)
            elements = to_text(models(k)%fit%elements)
            free = to_text(models(k)%unknowns())
            associate (J => criteria%J(k), aicc => criteria%aicc, bic => criteria%bic)
               call text%line(left(labels(k)%text, 26)//right(elements, 5)//right(free, 6)// &
                  right(to_text(J))//columns([aicc(k)], 13, '#.2')// &
                  columns([aicc(k) - minval(aicc)], 11, '#.2')//columns([bic(k)], 13, '#.2')// &
                  columns([bic(k) - minval(bic)], 11, '#.2'))
               call table%line(csv_row(labels(k)%text//','//elements//','//free, &
                  [J, aicc(k), bic(k)]))
            end associate
         end do
         call output%add('models.csv', table%content())
      end subroutine add_models

      !> Adds the test of Banks and Fitzpatrick for every pair of models of which one is a special
      !> case of the other, and nested.csv.
      subroutine add_nested()
         type(text_t) :: table
         real(wp) :: U, probability
         character(len=:), allocatable :: verdict
         integer :: i, j, restrictions
         logical :: any_nested

         any_nested = .false.
         call table%line('restricted,full,restrictions,U,probability')
         do i = 1, size(models)
            do j = 1, size(models)
               if (.not. is_nested(models(i), models(j))) cycle
               if (.not. any_nested) call add_heading()
               any_nested = .true.
               restrictions = models(j)%unknowns() - models(i)%unknowns()
               call nested_test(criteria%J(i), criteria%J(j), criteria%samples, restrictions, U, &
                  probability, criteria%noise_is_known)
               verdict = ': no reason to prefer the full model'
               if (probability < 0.05_wp) verdict = ': the full model is better'
               ! The searches end close to the minima: equal sums of squares differ slightly.
               if (U < -1e-6_wp*criteria%samples) verdict = &
                  ': the fit of the full model did not reach its minimum'
               call text%line('  '//labels(i)%text//' within '//labels(j)%text// &
                  filled(': U = #, # '//merge('restriction, ', 'restrictions,', &
                  restrictions == 1)//' probability #', [U, real(restrictions, wp), &
                  probability])//verdict)
               call table%line(csv_row(labels(i)%text//','//labels(j)%text//','// &
                  to_text(restrictions), [U, probability]))
            end do
         end do
         call output%add('nested.csv', table%content())
      end subroutine add_nested

      subroutine add_heading()
         call text%line()
         call text%line('Nested pairs: U = '//trim(merge('J_restricted - J_full           ', &
            'm (J_restricted - J_full)/J_full', criteria%noise_is_known))//' against chi-square')
      end subroutine add_heading

   end subroutine report_comparison

end module beamid_comparison_reports
