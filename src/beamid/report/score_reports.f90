!> Reports the score tests of parameters that the model leaves out.
module beamid_score_reports
   use beamid_case_files, only: case_t
   use beamid_identification, only: stage_fit_t
   use beamid_lines, only: csv_row
   use beamid_outputs, only: output_t
   use beamid_score_tests, only: score_test_t
   use beamid_strings, only: rounded, to_text
   use beamid_texts, only: text_t
   implicit none
   private

   public :: add_score_lines, add_score_table

contains

   !> Adds a sentence for each parameter that matters, the largest decrease of J first.
   !>
   !> fit  that was tested
   subroutine add_score_lines(text, case, fit, tests)
      type(text_t), intent(inout) :: text
      type(case_t), intent(in) :: case
      type(stage_fit_t), intent(in) :: fit
      type(score_test_t), intent(in) :: tests(:)
      character(len=:), allocatable :: line
      logical :: told(size(tests))
      integer :: k

      told = .not. tests%matters
      do while (.not. all(told))
         k = maxloc(tests%decrease, dim=1, mask=.not. told)
         told(k) = .true.
         associate (one => tests(k))
            if (one%name == 'offset') then
               line = 'the mean of the residuals is not 0'
               if (size(fit%weight) > 1) line = line//' in record '//to_text(one%record)
               call text%line(line//': add ''offset'' to free')
               cycle
            end if
            select case (one%name)
            case ('scale')
               line = contradicts(one)//' the scale of record '//to_text(one%record)// &
                  ': if it is multiplied by '//rounded(one%value, 3)//','
            case ('delay')
               line = contradicts(one)//' the times of record '//to_text(one%record)// &
                  ': with a delay of '//trim(rounded(one%value, 3)//' '//case%units%time)//','
            case ('harmonic')
               line = 'the residuals near mode '//to_text(one%mode)//' of record '// &
                  to_text(one%record)//' look like a harmonic of mode 1 ('//to_text(one%order)// &
                  ' times its frequency, '//trim(rounded(one%value, 4)//' '// &
                  case%units%frequency())//'): with it,'
            case default
               line = trim(one%name)//trim(merge(', which is fixed,            ', &
                  ', which the model leaves out,', abs(fit%scenario%structures(1)%get( &
                  one%parameter)) > 0))//' '//trim(merge('is significant     ', &
                  'may matter as well ', one%rejects))//': with '// &
                  trim(one%name)//' = '//trim(rounded(one%value, 3)//' '// &
                  case%units%of_quantity(one%parameter, fit%scenario%excitations(1)))//','
            end select
            line = line// &
               trim(merge(' J                          ', ' the weighted sum of squares', &
               size(fit%weight) == 1))//' falls by '//rounded(100*one%decrease, 3)//' %'
            if (one%by > 0) line = line//', and '//trim(fit%quantities(one%by)%name)// &
               ' moves by '//rounded(one%moves, 2)// &
               ' times the half width of its interval'
            if (fit%shifted()) line = line//'; first try a finer mesh, elements=''auto'''
            call text%line(line//'; '//one%remedy())
         end associate
      end do
   end subroutine add_score_lines

   !> Returns the beginning of the sentence on an error of a record.
   pure function contradicts(one) result(text)
      type(score_test_t), intent(in) :: one
      character(len=:), allocatable :: text

      text = 'the model contradicts'
      if (.not. one%rejects) text = 'the model may also contradict'
   end function contradicts

   !> Adds score_tests.csv: each candidate with its p-value, the largest shift of an estimate in
   !> half widths of its interval, and that estimate.
   subroutine add_score_table(output, fit, tests)
      type(output_t), intent(inout) :: output
      type(stage_fit_t), intent(in) :: fit
      type(score_test_t), intent(in) :: tests(:)
      character(len=:), allocatable :: by
      type(text_t) :: table
      integer :: k

      call table%line('parameter,record,p_value,moves,by,value,decrease,matters')
      do k = 1, size(tests)
         associate (one => tests(k))
            by = ''
            if (one%by > 0) by = trim(fit%quantities(one%by)%name)
            call table%line(trim(one%name)//','//csv_row(csv_row(to_text(one%record), &
               [one%p_value, one%moves])//','//by, [one%value, one%decrease])//','// &
               trim(merge('yes', 'no ', one%matters)))
         end associate
      end do
      call output%add('score_tests.csv', table%content())
   end subroutine add_score_table

end module beamid_score_reports
