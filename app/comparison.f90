!> The command `compare`: compares several models of one record by information criteria and tests of
!> nested models.
module beamid_comparison
   use beamid
   use beamid_candidates, only: candidate_t, fit_candidate, is_nested, same_samples
   use beamid_commands, only: deliver, settings_t
   use beamid_criteria, only: akaike => aicc, bayes => bic, nested_test
   use beamid_errors, only: bad_input, locate
   use beamid_lines, only: columns, csv_row, filled
   use beamid_outputs, only: output_t
   use beamid_responses, only: is_exact
   use beamid_strings, only: string_t, to_text
   use beamid_terminal, only: new_progress, progress_t
   use beamid_texts, only: left, right, text_t
   implicit none
   private

   public :: run_compare

contains

   !> Runs `beamid compare a.nml b.nml ...` on the last mesh of each case.
   subroutine run_compare(settings, error)
      type(settings_t), intent(in) :: settings
      type(error_t), allocatable, intent(out) :: error
      type(candidate_t), allocatable :: models(:)
      type(string_t), allocatable :: labels(:)
      type(progress_t) :: progress
      type(text_t) :: summary
      type(output_t) :: output
      integer :: finest, k

      call read_models(settings%subjects, models, labels, error)
      if (allocated(error)) return
      progress = new_progress(settings%quiet)
      do k = 1, size(models)
         call fit_model(k)
         if (allocated(error)) return
      end do
      ! Models that refine their meshes are compared on the finest mesh that any of them needs.
      finest = 0
      do k = 1, size(models)
         if (models(k)%refines) finest = max(finest, models(k)%mesh%elements)
      end do
      do k = 1, size(models)
         if (.not. models(k)%refines .or. models(k)%mesh%elements == finest) cycle
         models(k)%refines = .false.
         models(k)%mesh%elements = finest
         call fit_model(k)
         if (allocated(error)) return
      end do
      call add_models(summary, output, models, labels)
      call add_nested(summary, output, models, labels)
      call deliver(output, summary%content(), settings, 'compare', error)

   contains

      !> Fits model k.
      subroutine fit_model(k)
         integer, intent(in) :: k

         call fit_candidate(models(k), error, progress)
         call progress%finish()
         call locate(error, settings%subjects(k)%text)
      end subroutine fit_model

   end subroutine run_compare

   !> Reads the cases and their records, which must all have the same samples.
   !>
   !> models, labels  (size of paths) the models and how they are called in the tables
   subroutine read_models(paths, models, labels, error)
      type(string_t), intent(in) :: paths(:)
      type(candidate_t), allocatable, intent(out) :: models(:)
      type(string_t), allocatable, intent(out) :: labels(:)
      type(error_t), allocatable, intent(out) :: error
      type(case_t) :: case
      character(len=note_length), allocatable :: notes(:)
      logical, allocatable :: ambiguous(:)
      integer :: j, k

      allocate (models(size(paths)), labels(size(paths)))
      do k = 1, size(paths)
         call read_case(paths(k)%text, needs_fit, case, error)
         if (.not. allocated(error)) call load_experiments(case, models(k)%experiments, notes, &
            error)
         if (allocated(error)) return
         if (.not. same_samples(models(1), models(k))) then
            call bad_input(error, case%path//': &record: found other samples than in '// &
               paths(1)%text//', expected the same ones')
            return
         end if
         models(k)%model = case%model
         models(k)%mesh = case%meshes(size(case%meshes))
         models(k)%refines = case%refines .and. is_exact(case%model%solver)
         models(k)%stages = case%stages
         labels(k)%text = case%name
      end do
      ! Cases of the same name are called by their paths.
      ambiguous = [(count([(labels(j)%text == labels(k)%text, j=1, size(labels))]) > 1, &
         k=1, size(labels))]
      do k = 1, size(labels)
         if (ambiguous(k)) labels(k) = paths(k)
      end do
   end subroutine read_models

   !> Adds a table of J, number of parameters and criteria of each model to the summary, and
   !> models.csv.
   subroutine add_models(summary, output, models, labels)
      type(text_t), intent(inout) :: summary
      type(output_t), intent(inout) :: output
      type(candidate_t), intent(in) :: models(:)
      type(string_t), intent(in) :: labels(:)
      type(text_t) :: table
      real(wp) :: aicc(size(models)), bic(size(models))
      character(len=:), allocatable :: elements, free
      integer :: k, m

      m = size(models(1)%fit%residual)
      do k = 1, size(models)
         aicc(k) = akaike(models(k)%sum_of_squares(), m, models(k)%unknowns())
         bic(k) = bayes(models(k)%sum_of_squares(), m, models(k)%unknowns())
      end do
      call summary%line('Models of one record, m = '//to_text(m)//' samples')
      call summary%line( &
         'AICc = m ln(J/m) + 2 k + 2 k (k + 1)/(m - k - 1), BIC = m ln(J/m) + k ln m,')
      call summary%line('k = number of free parameters + 1 for the noise; the smaller the better.')
      call summary%line()
      call summary%line(left('model', 26)//right('N', 5)//right('free', 6)//right('J')// &
         right('AICc', 13)//right('- best', 11)//right('BIC', 13)//right('- best', 11))
      call table%line('model,elements,parameters,J,aicc,bic')
      do k = 1, size(models)
         elements = to_text(models(k)%fit%elements)
         free = to_text(models(k)%unknowns())
         associate (J => models(k)%sum_of_squares())
            call summary%line(left(labels(k)%text, 26)//right(elements, 5)//right(free, 6)// &
               right(to_text(J))//columns([aicc(k)], 13, '#.2')// &
               columns([aicc(k) - minval(aicc)], 11, '#.2')//columns([bic(k)], 13, '#.2')// &
               columns([bic(k) - minval(bic)], 11, '#.2'))
            call table%line(csv_row(labels(k)%text//','//elements//','//free, [J, aicc(k), bic(k)]))
         end associate
      end do
      call output%add('models.csv', table%content())
   end subroutine add_models

   !> Adds the test of Banks and Fitzpatrick for every pair of models of which one is a special case
   !> of the other, and nested.csv.
   subroutine add_nested(summary, output, models, labels)
      type(text_t), intent(inout) :: summary
      type(output_t), intent(inout) :: output
      type(candidate_t), intent(in) :: models(:)
      type(string_t), intent(in) :: labels(:)
      type(text_t) :: table
      real(wp) :: U, probability
      character(len=:), allocatable :: verdict
      integer :: i, j, restrictions

      call table%line('restricted,full,restrictions,U,probability')
      call summary%line()
      call summary%line('Nested pairs: U = m (J_restricted - J_full)/J_full against chi-square')
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
            call summary%line('  '//labels(i)%text//' within '//labels(j)%text// &
               filled(': U = #, # '//merge('restriction, ', 'restrictions,', &
               restrictions == 1)//' probability #', [U, real(restrictions, wp), probability])// &
               verdict)
            call table%line(csv_row(labels(i)%text//','//labels(j)%text//','// &
               to_text(restrictions), [U, probability]))
         end do
      end do
      call output%add('nested.csv', table%content())
   end subroutine add_nested

end module beamid_comparison
