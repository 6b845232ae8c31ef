!> The report of the command compare: the information criteria of each model, and the tests of
!> nested models.
module beamid_comparison_reports
   use beamid_candidates, only: candidate_t, is_nested
   use beamid_criteria, only: akaike => aicc, bayes => bic, nested_test
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
   !> models  with their fits
   !> labels  (size of models) names of the models in the tables
   subroutine report_comparison(models, labels, output, summary)
      type(candidate_t), intent(in) :: models(:)
      type(string_t), intent(in) :: labels(:)
      type(output_t), intent(inout) :: output
      character(len=:), allocatable, intent(out) :: summary
      type(text_t) :: text

      call add_models()
      call add_nested()
      summary = text%content()

   contains

      !> Adds a table of J, number of parameters and criteria of each model to the summary, and
      !> models.csv.
      subroutine add_models()
         type(text_t) :: table
         real(wp) :: aicc(size(models)), bic(size(models))
         character(len=:), allocatable :: elements, free
         integer :: k, m

         m = size(models(1)%fit%residual)
         do k = 1, size(models)
            aicc(k) = akaike(models(k)%sum_of_squares(), m, models(k)%unknowns())
            bic(k) = bayes(models(k)%sum_of_squares(), m, models(k)%unknowns())
         end do
         call text%line('Models of one record, m = '//to_text(m)//' samples')
         call text%line( &
            'AICc = m ln(J/m) + 2 k + 2 k (k + 1)/(m - k - 1), BIC = m ln(J/m) + k ln m,')
         call text%line('k = number of free parameters + 1 for the noise; the smaller the better.')
         call text%line()
         call text%line(left('model', 26)//right('N', 5)//right('free', 6)//right('J')// &
            right('AICc', 13)//right('- best', 11)//right('BIC', 13)//right('- best', 11))
         call table%line('model,elements,parameters,J,aicc,bic')
         do k = 1, size(models)
            elements = to_text(models(k)%fit%elements)
            free = to_text(models(k)%unknowns())
            associate (J => models(k)%sum_of_squares())
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

         call table%line('restricted,full,restrictions,U,probability')
         call text%line()
         call text%line('Nested pairs: U = m (J_restricted - J_full)/J_full against chi-square')
         do i = 1, size(models)
            do j = 1, size(models)
               if (.not. is_nested(models(i), models(j))) cycle
               restrictions = models(j)%unknowns() - models(i)%unknowns()
               call nested_test(models(i)%sum_of_squares(), models(j)%sum_of_squares(), &
                  size(models(i)%fit%residual), restrictions, U, probability)
               verdict = ': no reason to prefer the full model'
               if (probability < 0.05_wp) verdict = ': the full model is better'
               ! The searches end close to the minima: equal sums of squares differ slightly.
               if (U < -1e-6_wp*size(models(i)%fit%residual)) verdict = &
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

   end subroutine report_comparison

end module beamid_comparison_reports
