!> Case files: what is accepted has the values that are written there, and one mistake gives exactly
!> one line.
program test_namelist
   use beamid_blocks, only: block_t
   use beamid_errors, only: error_t
   use beamid_kinds, only: wp
   use beamid_namelist, only: group_t, scan_namelist
   use beamid_refusals, only: refusals_t
   use checks, only: check, check_close, finish
   use damaged_texts, only: any_byte, damage, doubled, dropped, exchanged, likely_byte, other
   use random_numbers, only: pick, start_random
   implicit none

   character(len=*), parameter :: lf = achar(10), cr = achar(13), tab = achar(9), &
      bom = char(239)//char(187)//char(191)
   !> A text with every group and every kind of value.
   character(len=*), parameter :: valid = &
      '! a beam with a hose'//lf// &
      '&beam length=4.0, rho = .03d0, E=80 /  ! comment / &tip'//lf// &
      '&TIP M_t=0.15 /'//lf// &
      '&mesh degree=3, elements=2,3 4'//lf// &
      '   5,'//lf//'   6, /'//lf// &
      '&record file=''it''''s/a, "b" ! = &.csv'' t_last=+5.e0/'//lf// &
      '&stage free=''c_D'',"m_H", start=-1.5,2.5 /'//lf// &
      '&stage/'//lf

   type :: case_t
      real(wp) :: length = 0, rho = 0, e = 0, m_T = 0
      real(wp), allocatable :: t_last, start(:)
      integer :: degree = 0, stages = 0
      integer, allocatable :: elements(:)
      character(len=:), allocatable :: file, free(:)
      character(len=4) :: word = ''
   end type case_t

   type(group_t), parameter :: groups(*) = [group_t('beam', required=.true.), group_t('tip'), &
      group_t('mesh'), group_t('record'), group_t('stage', may_repeat=.true.)]

   call start_random(20240607, 16807)
   call test_valid()
   call test_forms()
   call test_extremes()
   call test_group_mistakes()
   call test_key_mistakes()
   call test_value_mistakes()
   call test_files_that_are_no_text()
   call test_several()
   call test_mutations()
   call finish('namelist')

contains

   !> The text above gives these values. Decimal numbers are rounded to the nearest by the compiler
   !> and by the reader alike, hence tolerances of 0.
   subroutine test_valid()
      type(block_t), allocatable :: blocks(:)
      type(error_t), allocatable :: error
      type(case_t) :: got

      call read_text('case.nml', valid, blocks, got, error)
      call check('valid: no error', .not. allocated(error))
      if (allocated(error)) return
      call check('valid: six blocks', size(blocks) == 6)
      call check('valid: names', blocks(2)%name == 'tip' .and. blocks(3)%name == 'mesh')
      call check('valid: lines', all(blocks%line == [2, 3, 4, 7, 8, 9]))
      call check('has, any case', blocks(1)%has('e') .and. blocks(2)%has('M_T') .and. &
         .not. blocks(6)%has('free') .and. .not. blocks(1)%has('none'))
      call check('counts', size(got%elements) == 5 .and. size(got%free) == 2)
      call check('line of a key', blocks(4)%line_of('t_last') == 7 .and. &
         blocks(6)%line_of('start') == 9)
      call check_close('length', got%length, 4.0_wp, 0.0_wp)
      call check_close('rho', got%rho, 0.03_wp, 0.0_wp)
      call check_close('E', got%e, 80.0_wp, 0.0_wp)
      call check_close('m_T', got%m_T, 0.15_wp, 0.0_wp)
      call check_close('t_last', got%t_last, 5.0_wp, 0.0_wp)
      call check('integers', got%degree == 3 .and. all(got%elements == [2, 3, 4, 5, 6]))
      call check('text', got%file == 'it''s/a, "b" ! = &.csv')
      call check('texts', got%free(1) == 'c_D' .and. got%free(2) == 'm_H')
      call check_close('start', sum(abs(got%start - [-1.5_wp, 2.5_wp])), 0.0_wp, 0.0_wp)
      call check('two stages', got%stages == 2)
   end subroutine test_valid

   !> Other ways to write the same: each is accepted and length is 4.
   subroutine test_forms()
      call good('&beam length=4/')
      call good('&beam length=4.0 /'//lf)
      call good('&BEAM Length = 4.0'//lf//'/')
      call good(bom//'&beam length=4.0 /'//lf)
      call good('&beam'//cr//lf//' length=4.0,'//cr//lf//'/'//cr//lf)
      call good('  &beam'//tab//'length'//lf//'='//lf//'4.0 /')
      call good('&beam! x'//lf//'length=! '' y'//lf//'4.0! /'//lf//'/! z')
      call good('&beam length=4.0, / &tip m_T=1/&stage/'//lf)
      call good('! '//char(195)//char(164)//lf//'&beam length=4.D0 /')
      call good('&beam length=4.0 /'//lf//'&stage free='''' ''"'' "''" /'//lf)
      call good('&beam length=4.0 /'//lf//'&record file="'//repeat('''', 256)//'" /'//lf)
      call good(repeat('! comment'//lf, 2000)//'&beam length=4.0 /')
      call good('&beam length=4.0 /'//lf//'&record t_last=inf /')
      call good('&beam length=4.0 /'//lf//'&stage start="auto" /')
      call good('&beam length=0004.'//repeat('0', 10000)//' /')
   end subroutine test_forms

   subroutine good(text)
      character(len=*), intent(in) :: text
      type(block_t), allocatable :: blocks(:)
      type(error_t), allocatable :: error
      type(case_t) :: got
      character(len=:), allocatable :: name

      call read_text('case.nml', text, blocks, got, error)
      name = 'form: '//text(:min(40, scan(text//lf, lf//cr) - 1))
      if (allocated(error)) call check(name, .false., error%message)
      if (.not. allocated(error)) call check(name, abs(got%length - 4) <= 0)
   end subroutine good

   !> The ends of the ranges are read bit by bit.
   subroutine test_extremes()
      type(block_t), allocatable :: blocks(:)
      type(error_t), allocatable :: error
      type(case_t) :: got

      call read_text('case.nml', '&beam length=1.7976931348623157e308 rho=4.9e-324 '// &
         'E=1e-400 /&mesh elements=2147483647,-2147483647 /', blocks, got, error)
      call check('extremes: accepted', .not. allocated(error))
      if (allocated(error)) return
      call check('largest real', got%length >= huge(1.0_wp))
      call check('smallest real', got%rho > 0 .and. got%rho < 1e-323_wp)
      call check('underflow is zero', abs(got%e) <= 0)
      call check('integers', all(got%elements == [huge(1), -huge(1)]))
      call read_text('case.nml', '&beam /&record t_last=Inf /&stage start=''auto'' /', blocks, &
         got, error)
      call check('infinity', got%t_last > huge(1.0_wp))
      call check('a word for numbers', got%word == 'auto' .and. .not. allocated(got%start), &
         got%word)
   end subroutine test_extremes

   subroutine test_group_mistakes()
      call bad('', 1, 'no group|&beam, &tip')
      call bad(lf//' ! nothing'//lf, 3, 'no group')
      call bad('&baem length=4.0 /', 1, '''&baem''|&beam, &tip,')
      call bad('&beam /'//lf//'&hose k_H=''x'', 3 "a" /'//lf//'&tip m_T=1 /', 2, 'unknown group')
      call bad('&tip m_T=1 /'//lf, 2, 'no group &beam')
      call bad('&beam length=4 /'//lf//'&Beam length=x y=2 /', 2, 'again|first in line 1')
      call bad('&beam'//lf//' length=4'//lf//'&tip m_T=1 /', 1, '''&tip'' in line 3|expected ''/''')
      call bad('&beam length=4', 1, 'end of the file|''/''')
      call bad('&beam length=4'//lf//'&end'//lf//'&tip m_T=1 /', 2, '''&end''|expected ''/''')
      call bad('&beam length=4 &end /', 1, '''&end''|expected ''/''')
      call bad('$beam length=4 $end', 1, '''$beam'' outside a group')
      call bad('beam length=4.0 file=''x'//lf//' rho=3 /'//lf//'&tip m_T=1 /', 1, 'outside a group')
      call bad('# &beam'//lf//'&beam length=4 /', 1, '''#'' outside a group')
      call bad('&beam length=4 / rho=3'//lf//'/'//lf//'&tip m_T=1 /', 1, '''rho'' outside a group')
      call bad('&beam length=4 /'//lf//'the beam''s length'//lf, 2, '''the'' outside a group')
      call bad('&beam length=4 /'//lf//'''text'//lf, 2, 'closing quote')
      call bad('& beam length=4 /', 1, '''&'' outside a group')
      call bad('&'//repeat('b', 64)//' length=4 /', 1, 'unknown group')
      call bad('&beam length=4 //', 1, '''/'' outside a group')
      call bad('&beam length=4 & '//lf//'rho=3 /', 1, 'found ''&'', expected a number')
      call bad('&beam & length=4 /', 1, '''&'' alone')
   end subroutine test_group_mistakes

   subroutine test_key_mistakes()
      call bad('&beam lenght=4.0, rho=3 /', 1, '&beam lenght:|length, rho, E')
      call bad('&beam length=4.0'//lf//'rho=1'//lf//'LENGTH=3 /', 3, &
         '&beam LENGTH:|first in line 1')
      call bad('&beam length= /', 1, '&beam length:|no value, expected a nu')
      call bad('&beam length=, rho=3 /', 1, 'no value, expected a number')
      call bad('&beam length='//lf//'rho=3 /', 1, 'no value, expected a number')
      call bad('&record file= /'//lf//'&beam /', 1, 'no value, expected text in quotes')
      call bad('&beam length=4.0'//lf//'heavy /', 2, 'found ''heavy''')
      call bad('&beam heavy length=4.0 /', 1, '''heavy'', expected key = value')
      call bad('&beam length 4.0, rho=3 /', 1, '''length'', expected key = value')
      call bad('&beam , length=4.0 /', 1, 'found '',''|expected key =')
      call bad('&beam =4.0 rho=3 /', 1, 'found ''='', expected key')
      call bad('&beam "length"=4.0 rho=3 /', 1, '''length'', expected key')
      call bad('&beam length==4.0, rho=3 /', 1, 'found ''=''')
      call bad('&beam length=4.0=5.0 rho=3 /', 1, 'found ''=''')
      call bad('&beam length=4.0'//lf//'rho(/', 2, '''rho(''|not supported')
      call bad('&beam length=4.0'//lf//'rho('//lf//'E=3 /', 2, '''rho(''|not supported')
      call bad('&beam length=4.0'//lf//'rho('//lf//'=3 /', 2, 'not supported')
      call bad('&stage start(2)=3.0 /'//lf//'&beam /', 1, '&stage start(2):|not supported')
      call bad('&stage start ( 1 , 2 ) = 3.0 /'//lf//'&beam /', 1, '''start''')
      call bad('&stage start(1, 2) = 3.0 /'//lf//'&beam /', 1, 'not supported')
      call bad('&beam tip%mass=3.0 /', 1, '&beam tip%mass:|unknown key')
      call bad('&beam '//repeat('n', 64)//'=3.0 /', 1, 'unknown key|length, rho, E')
   end subroutine test_key_mistakes

   subroutine test_value_mistakes()
      call bad('&beam length=long /', 1, '''long'', expected a number')
      call bad('&beam length=''4.0'' rho=3 /', 1, 'the text ''4.0'' in quotes, expected a number')
      call bad('&mesh degree=1.5 /'//lf//'&beam /', 1, '''1.5'', expected an integer')
      call bad('&mesh degree=2147483648 /'//lf//'&beam /', 1, 'integer between -2147483647')
      call bad('&mesh degree='//repeat('9', 500)//' /'//lf//'&beam /', 1, 'integer between')
      call bad('&record file=7 /'//lf//'&beam /', 1, '''7'', expected text in quotes')
      call bad('&record file=a.csv, t_last=3 /'//lf//'&beam /', 1, '''a.csv'', expected text in qu')
      call bad('&record file=/data/a.csv /'//lf//'&beam /', 1, '''/data/a.csv'', expected text')
      call bad('&record file=../a.csv /'//lf//'&beam /', 1, '''../a.csv'', expected text')
      call bad('&record file=T /'//lf//'&beam /', 1, '''T'', expected text in quotes')
      call bad('&beam length=4.0 ft, rho=3 /', 1, '''ft'' after a number|units')
      call bad('&beam length=4.0ft, rho=3 /', 1, '''4.0ft'', expected a number')
      call bad('&beam length=4,0, rho=3 /', 1, '2 values, expected 1; a decimal point is ''.''')
      call bad('&beam length=4 0 /', 1, '2 values, expected 1')
      call bad('&mesh elements=1,2,3,4,5,6 /'//lf//'&beam /', 1, '6 values, expected at most 5')
      call bad('&record file="a" "b" /'//lf//'&beam /', 1, '2 values, expected 1')
      call bad('&beam length=nan /', 1, '''nan'', expected a number')
      call bad('&beam length=-Infinity /', 1, '''-Infinity'', expected a number')
      call bad('&beam length=inf /', 1, '''inf'', expected a number')
      call bad('&record t_last=-inf /'//lf//'&beam /', 1, '''-inf'', expected a number or inf')
      call bad('&record t_last=''inf'' /'//lf//'&beam /', 1, 'in quotes, expected a number or inf')
      call bad('&beam length=1e999 /', 1, 'at most 1.79e308')
      call bad('&stage start=auto /'//lf//'&beam /', 1, '''auto'', expected a number or ''auto''')
      call bad('&stage start=''any'' /'//lf//'&beam /', 1, '''any'' in quotes, expected a number')
      call bad('&stage start=''auto'', 1 /'//lf//'&beam /', 1, 'the text ''auto'' in quotes')
      call bad('&stage start=1,,2 /'//lf//'&beam /', 1, 'an empty value')
      call bad('&stage start=1,, /'//lf//'&beam /', 1, 'an empty value')
      call bad('&stage start=,2 /'//lf//'&beam /', 1, 'an empty value')
      call bad('&stage start=3*1.0 /'//lf//'&beam /', 1, '''3*1.0''|values written out')
      call bad('&stage start=3* /'//lf//'&beam /', 1, 'values written out')
      call bad('&stage free=2*''a b/c'' /'//lf//'&beam /', 1, 'values written out')
      call bad('&beam length=1/2, rho=3 /', 1, '''1/2'', expected a number')
      call bad('&beam length=(1,2) /', 1, '''(1,2)'', expected a number')
      call bad('&beam length=.true. /', 1, '''.true.'', expected a number')
      call bad('&record file=''a.csv, t_last=3 /'//lf//'&beam /', 1, 'without a closing quote')
      call bad('&record file=''a.csv, t_last=3'//lf//'/'//lf//'&beam /', 1, 'closing quote')
      call bad('&record file=''a'''//lf//'t_last=3'' /'//lf//'&beam /', 2, '''3''''')
      call bad('&record file=''it''s'', t_last=3 /'//lf//'&beam /', 1, 'behind the closing quote')
      call bad('&record file="a.csv'' /'//lf//'&beam /', 1, 'without a closing quote')
      call bad('&record file='//repeat('x', 600)//' /'//lf//'&beam /', 1, 'xxx...'', expected text')
      call bad('&record file='''//repeat('x', 600)//''' /'//lf//'&beam /', 1, '600 characters')
   end subroutine test_value_mistakes

   subroutine test_files_that_are_no_text()
      call bad('&beam length=4.0 /'//lf//achar(0), 2, 'not text')
      call bad('&beam length='//achar(7)//'4.0 /'//achar(1), 1, 'not text')
      call bad(char(255)//char(254)//'&'//achar(0)//'b'//achar(0), 1, 'not text')
      call bad('! '//char(228)//lf//'&beam /', 1, 'not UTF-8')
      call bad('&beam /'//lf//'! '//char(195), 2, 'not UTF-8')
      call bad('&beam /'//cr//'&tip /'//lf, 1, 'control character')
      call bad(repeat(' ', 300000), 1, 'a file of more than')
   end subroutine test_files_that_are_no_text

   !> One mistake: one line with the file, the line and all these words, separated by '|'.
   subroutine bad(text, line, words)
      character(len=*), intent(in) :: text, words
      integer, intent(in) :: line
      type(block_t), allocatable :: blocks(:)
      type(error_t), allocatable :: error
      type(case_t) :: got
      character(len=30) :: place
      logical :: ok
      integer :: first, length

      call read_text('case.nml', text, blocks, got, error)
      call check('refused: '//words, allocated(error))
      if (.not. allocated(error)) return
      write (place, '(a,i0,a)') 'case.nml:', line, ': '
      ok = index(error%message, trim(place)//' ') == 1 .and. scan(error%message, lf//cr) == 0
      first = 1
      do while (first <= len(words))
         length = scan(words(first:)//'|', '|') - 1
         ok = ok .and. index(error%message, words(first:first + length - 1)) > 0
         first = first + length + 1
      end do
      call check('  one line, place and words', ok .and. error%status == 2 .and. &
         len(error%message) < 250, error%message)
   end subroutine bad

   !> Several mistakes give as many lines; 20 at most. The nine: an unknown key, a decimal comma, no
   !> value, an unknown group, 1.5 and a for integers, no '/', an open quote, a number for a text.
   subroutine test_several()
      type(block_t), allocatable :: blocks(:)
      type(error_t), allocatable :: error
      type(case_t) :: got

      call read_text('case.nml', '&beam lenght=4.0, rho=3,5'//lf//' E= / '//lf//'&tpi /'//lf// &
         '&mesh degree=1.5 elements=a'//lf//'&record file=''a /'//lf//'&stage free=1 /', &
         blocks, got, error)
      call check('several: refused', allocated(error))
      if (.not. allocated(error)) return
      call check('several: nine lines', lines_of(error%message) == 9, error%message)
      call read_text('case.nml', '&beam '//repeat('x=1 ', 50)//'/', blocks, got, error)
      call check('fifty: twenty are told', lines_of(error%message) == 20)
   end subroutine test_several

   integer function lines_of(message)
      character(len=*), intent(in) :: message
      integer :: i

      lines_of = 1 + count([(message(i:i) == lf, i=1, len(message))])
   end function lines_of

   !> Damaged texts end in messages or in a case; 20000 of them, the same ones
   !> in every run.
   subroutine test_mutations()
      type(block_t), allocatable :: blocks(:)
      type(error_t), allocatable :: error
      type(case_t) :: got
      character(len=:), allocatable :: text
      integer :: trial, n_read, i
      logical :: ok

      ok = .true.
      n_read = 0
      do trial = 1, 20000
         text = valid
         do i = 1, pick(3)
            call mutate(text)
         end do
         call read_text('case.nml', text, blocks, got, error)
         if (allocated(error)) then
            ok = lines_of(error%message) <= 20 .and. index(error%message, 'case.nml:') == 1
         else
            n_read = n_read + 1
         end if
         if (.not. ok) exit
      end do
      call check('mutations: messages or a readable case', ok)
      if (.not. ok) call check('  the text', .false., text)
      ! Neither everything nor nothing passes, or the test would show little.
      call check('mutations: some pass, some do not', n_read > 1000 .and. n_read < 19000)
   end subroutine test_mutations

   !> A byte dropped, doubled, replaced, exchanged with its neighbour, or a stretch cut out.
   subroutine mutate(text)
      character(len=:), allocatable, intent(inout) :: text
      integer :: at, way

      if (len(text) < 20) return
      call damage(text, [dropped, doubled, any_byte, likely_byte, likely_byte, exchanged, other], &
         '&/=,''"!().*%+-eE0 $#'//lf//cr//tab, at, way)
      if (way == other) text = text(:at)//text(min(at + pick(20), len(text)):)
   end subroutine mutate

   !> Reads a text with groups and keys of its own.
   subroutine read_text(path, text, blocks, got, error)
      character(len=*), intent(in) :: path, text
      type(block_t), allocatable, intent(out) :: blocks(:)
      type(case_t), intent(out) :: got
      type(error_t), allocatable, intent(out) :: error
      type(refusals_t) :: refusals
      integer :: i

      call scan_namelist(text, groups, blocks, refusals)
      do i = 1, size(blocks)
         associate (block => blocks(i))
            select case (block%name)
            case ('beam')
               call block%get('length', got%length, 'of the beam')
               call block%get('rho', got%rho, 'mass per length')
               call block%get('E', got%e, 'modulus')
            case ('tip')
               call block%get('m_T', got%m_T, 'tip mass')
            case ('mesh')
               call block%get('degree', got%degree, 'of the splines')
               call block%get('elements', got%elements, '8', 'their number', 5)
            case ('record')
               call block%get('file', got%file, 'columns')
               call block%get('t_last', got%t_last, 'the last', 'time of the last sample', &
                  infinite=.true.)
            case ('stage')
               call block%get('free', got%free, 'none', 'parameters', 3)
               call block%get('start', got%start, 'none', 'values', 3, ['auto'], got%word)
               got%stages = got%stages + 1
            end select
            call block%close()
         end associate
         call refusals%join(blocks(i)%refusals)
      end do
      call refusals%tell(path, error)
   end subroutine read_text

end program test_namelist
