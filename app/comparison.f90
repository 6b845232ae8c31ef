!> `beamid compare`: several models of one record, by information criteria and nested-model tests.
module beamid_comparison
   use beamid
   use beamid_errors, only: bad_input
   use beamid_galerkin, only: same_mesh
   use beamid_outputs, only: output_t
   use beamid_statistics, only: akaike => aicc, bayes => bic, nested_test
   use beamid_strings, only: to_text
   use beamid_texts, only: left, right, text_t
   use beamid_commands, only: deliver, settings_t
   use beamid_report_lines, only: columns, csv_row, filled
   use beamid_terminal, only: new_progress, progress_t
   implicit none
   private

   public :: run_compare

   !> One model, fitted on the last mesh of its case.
   type :: candidate_t
      type(case_t) :: case
      type(stage_fit_t) :: fit             !< of the last stage
      integer, allocatable :: free(:)      !< parameters that any stage fitted to the record
      type(experiment_t), allocatable :: experiments(:)
   contains
      procedure :: parameters
   end type candidate_t

contains

   !> beamid compare a.nml b.nml ...
   subroutine run_compare(settings, error)
      type(settings_t), intent(in) :: settings
      type(error_t), allocatable, intent(out) :: error
      type(candidate_t), allocatable :: candidates(:)
      type(progress_t) :: progress
      type(text_t) :: summary, models, nested
      type(output_t) :: output
      character(len=note_length), allocatable :: notes(:)
      integer :: k

      allocate (candidates(size(settings%subjects)))
      do k = 1, size(candidates)
         associate (candidate => candidates(k))
            call read_case(settings%subjects(k)%text, needs_fit, candidate%case, error)
            if (.not. allocated(error)) call load_experiments(candidate%case, &
               candidate%experiments, notes, error)
            if (.not. allocated(error)) call same_record(candidates(1), candidate, error)
            if (allocated(error)) return
         end associate
      end do
      progress = new_progress(settings%quiet)
      do k = 1, size(candidates)
         call fit_candidate(candidates(k), progress, error)
         call progress%finish()
         if (allocated(error)) return
      end do
      call add_models(summary, models, candidates)
      call add_nested(summary, nested, candidates)
      call output%add('models.csv', models%content())
      call output%add('nested.csv', nested%content())
      call deliver(output, summary%content(), settings, 'compare', error)
   end subroutine run_compare

   !> How many parameters were fitted: by any stage, and what was eliminated.
   pure integer function parameters(self)
      class(candidate_t), intent(in) :: self

      parameters = size(self%free) + size(self%fit%quantities) - size(self%fit%free)
   end function parameters

   !> Criteria compare models of the same samples only.
   subroutine same_record(first, other, error)
      type(candidate_t), intent(in) :: first, other
      type(error_t), allocatable, intent(out) :: error
      logical :: same
      integer :: k

      same = size(first%experiments) == size(other%experiments)
      do k = 1, size(first%experiments)
         if (.not. same) exit
         associate (a => first%experiments(k), b => other%experiments(k))
            same = size(a%samples) == size(b%samples)
            if (same) same = all(abs(a%samples - b%samples) <= 0) .and. &
               all(abs(a%measured - b%measured) <= 0)
         end associate
      end do
      if (.not. same) call bad_input(error, other%case%path// &
         ': &record: found other samples than in '// &
         first%case%path//', expected the same ones')
   end subroutine same_record

   subroutine fit_candidate(candidate, progress, error)
      type(candidate_t), intent(inout) :: candidate
      type(progress_t), intent(inout) :: progress
      type(error_t), allocatable, intent(out) :: error
      type(stage_fit_t), allocatable :: fits(:)
      integer :: j, k

      associate (case => candidate%case)
         call identify(case%model, case%meshes(size(case%meshes)), case%stages, &
            candidate%experiments, fits, error, progress)
         if (allocated(error)) then
            error%message = case%path//': '//error%message
            return
         end if
      end associate
      candidate%fit = fits(size(fits))
      allocate (candidate%free(0))
      do k = 1, size(free_names)
         if (any([(any(fits(j)%free == k), j=1, size(fits))])) candidate%free = [candidate%free, k]
      end do
      if (.not. candidate%fit%fit%J > 0) call failure(error, candidate%case%path// &
         ': J = 0: the criteria are not defined for a model that leaves no residual')
   end subroutine fit_candidate

   !> J, number of parameters and criteria of each model.
   subroutine add_models(summary, table, candidates)
      type(text_t), intent(inout) :: summary, table
      type(candidate_t), intent(in) :: candidates(:)
      real(wp) :: aicc(size(candidates)), bic(size(candidates))
      character(len=:), allocatable :: name, elements, free
      integer :: k, m

      m = size(candidates(1)%fit%fit%residual)
      do k = 1, size(candidates)
         associate (J => candidates(k)%fit%fit%J)
            aicc(k) = akaike(J, m, candidates(k)%parameters())
            bic(k) = bayes(J, m, candidates(k)%parameters())
         end associate
      end do
      call summary%line('Models of one record, m = '//to_text(m)//' samples')
      call summary%line( &
         'AICc = m ln(J/m) + 2 k + 2 k (k + 1)/(m - k - 1), BIC = m ln(J/m) + k ln m,')
      call summary%line('k = number of free parameters + 1 for the noise; the smaller the better.')
      call summary%line()
      call summary%line(left('model', 28)//right('N', 5)//right('free', 6)//right('J')// &
         right('AICc')//right('- best')//right('BIC')//right('- best'))
      call table%line('model,elements,parameters,J,aicc,bic')
      do k = 1, size(candidates)
         name = label(candidates, k)
         elements = to_text(candidates(k)%fit%elements)
         free = to_text(candidates(k)%parameters())
         associate (J => candidates(k)%fit%fit%J)
            call summary%line(left(name, 28)//right(elements, 5)//right(free, 6)// &
               right(to_text(J))//columns([aicc(k), aicc(k) - minval(aicc), bic(k), &
               bic(k) - minval(bic)], 14, '#.2'))
            call table%line(csv_row(name//','//elements//','//free, [J, aicc(k), bic(k)]))
         end associate
      end do
   end subroutine add_models

   !> Banks and Fitzpatrick's test for every pair of which one is a special case of the other.
   subroutine add_nested(summary, table, candidates)
      type(text_t), intent(inout) :: summary, table
      type(candidate_t), intent(in) :: candidates(:)
      real(wp) :: U, probability
      integer :: i, j, restrictions

      call table%line('restricted,full,restrictions,U,probability')
      call summary%line()
      call summary%line('Nested pairs: U = m (J_restricted - J_full)/J_full against chi-square')
      do i = 1, size(candidates)
         do j = 1, size(candidates)
            if (.not. is_nested(candidates(i), candidates(j))) cycle
            restrictions = candidates(j)%parameters() - candidates(i)%parameters()
            call nested_test(candidates(i)%fit%fit%J, candidates(j)%fit%fit%J, &
               size(candidates(i)%fit%fit%residual), restrictions, U, probability)
            call summary%line('  '//label(candidates, i)//' within '//label(candidates, j)// &
               filled(': U = #, # '//merge('restriction, ', 'restrictions,', &
               restrictions == 1)//' probability #', [U, real(restrictions, wp), probability])// &
               verdict(U, probability))
            call table%line(csv_row(label(candidates, i)//','//label(candidates, j)//','// &
               to_text(restrictions), [U, probability]))
         end do
      end do
   end subroutine add_nested

   !> The name of a model's case, or where another has the same its path.
   function label(candidates, k) result(text)
      type(candidate_t), intent(in) :: candidates(:)
      integer, intent(in) :: k
      character(len=:), allocatable :: text
      integer :: j

      text = candidates(k)%case%name
      do j = 1, size(candidates)
         if (j /= k .and. candidates(j)%case%name == text) then
            text = candidates(k)%case%path
            return
         end if
      end do
   end function label

   !> The test in words.
   function verdict(U, probability) result(words)
      real(wp), intent(in) :: U, probability
      character(len=:), allocatable :: words

      words = ': no reason to prefer the full model'
      if (probability < 0.05_wp) words = ': the full model is better'
      if (U < 0) words = ': the fit of the full model did not reach its minimum'
   end function verdict

   !> Whether `small` is `large` with some of its free parameters held: what `large` holds fixed is
   !> the same in both, and everything that `small` frees is free in `large`.
   logical function is_nested(small, large)
      type(candidate_t), intent(in) :: small, large
      integer :: k

      is_nested = .false.
      if (small%parameters() >= large%parameters()) return
      if (.not. same_method(small%case, large%case)) return
      if (any(small%case%stages%offset) .and. .not. any(large%case%stages%offset)) return
      if (.not. all([(any(large%free == small%free(k)), k=1, size(small%free))])) return
      do k = 1, size(free_names)
         if (any(large%free == k)) cycle
         associate (a => get_free(small%fit%structure, small%fit%excitation, k), &
            b => get_free(large%fit%structure, large%fit%excitation, k))
            if (abs(a - b) > 1e-12_wp*max(abs(a), abs(b))) return
         end associate
      end do
      is_nested = .true.
   end function is_nested

   !> Whether two cases differ in nothing but their parameters.
   logical function same_method(a, b)
      type(case_t), intent(in) :: a, b

      same_method = same_mesh(a%meshes(size(a%meshes)), b%meshes(size(b%meshes))) .and. &
         a%model%observation%formula == b%model%observation%formula .and. &
         abs(a%model%observation%delta - b%model%observation%delta) <= 0 .and. &
         a%model%excitation%modes == b%model%excitation%modes .and. &
         (a%model%excitation%distributed .eqv. b%model%excitation%distributed) .and. &
         abs(a%model%excitation%power - b%model%excitation%power) <= 0 .and. &
         abs(a%model%structure%length - b%model%structure%length) <= 0 .and. &
         abs(a%model%structure%I - b%model%structure%I) <= 0 .and. &
         size(a%model%excitation%t) == size(b%model%excitation%t)
      if (same_method) same_method = all(abs(a%model%excitation%t - b%model%excitation%t) <= 0)
   end function same_method

end module beamid_comparison
