!> Every key of a case file has a definition, a unit or 'none', a default or 'required', all its
!> words among the allowed values, and an example that the readers of case files accept. Every free
!> parameter has such an example too. Words in `see also` are words of the help.
program test_key_examples
   use beamid_blocks, only: block_t
   use beamid_case_files, only: list_keys
   use beamid_cases, only: case_t, needs_nothing, parse_case
   use beamid_errors, only: error_t
   use beamid_key_examples, only: key_examples
   use beamid_key_facts, only: allowed_of, default_of, example_of, is_listed, parameter_example, &
      unit_of
   use beamid_key_help, only: known_words, symbol_of
   use beamid_parameters, only: parameters
   use beamid_see_also, only: a_command, a_group, a_parameter, an_everyday_word, &
      related_words, see_also
   use beamid_strings, only: lower
   use beamid_values, only: key_t, kind_real
   use checks, only: check, finish, skip
   use shell, only: close_shell, in_scratch, open_shell, write_file
   implicit none

   character(len=*), parameter :: nl = achar(10)
   !> Groups of a small case. An example replaces the group of the same name.
   character(len=*), parameter :: small_case(*) = [character(len=86) :: &
      '&beam length=0.5, E=7e10, rho=0.27, I=3.3e-11, c_D=2e6, b_h=0.1, b_1=60, b_2=600 /', &
      '&hose m_H=0.004, k_H=5 /', '&sensor name=''tip'', x_S=0.44 /', &
      '&support x_P=0.3, k_P=200 /', &
      '&gravity g=9.81 /', '&axial force=-0.2 /', &
      '&excitation kind=''pulse'', amplitude=1, duration=0.01 /', &
      '&record file=''record.csv'' /', '&stage free=''E'',''c_D'' /', '&noise sd=0.1 /', &
      '&ensemble members=10 /']
   type(block_t), allocatable :: blocks(:)
   character(len=:), allocatable :: reason
   integer :: g, k

   call list_keys(blocks)
   call open_shell(reason)
   if (reason /= '') call skip('examples', reason)
   if (reason == '') then
      call write_file('record.csv', 't,acceleration'//nl//'0,1'//nl//'1,2'//nl//'2,3'//nl)
      call write_file('force.csv', 't,force'//nl//'0,1'//nl//'0.01,2'//nl//'0.02,0'//nl)
      call write_file('modulus.csv', 'x,value'//nl//'0,7e10'//nl//'0.5,6e10'//nl)
      call write_file('cases.txt', 'case.nml'//nl)
   end if
   do g = 1, size(blocks)
      do k = 1, size(blocks(g)%keys)
         call check_key(blocks(g)%name, blocks(g)%keys(k), reason == '')
      end do
   end do
   if (reason == '') call test_parameters()
   if (reason == '') call check('bad examples are noticed', problem_of('beam', &
      '&beam lenght=1 /') /= '')
   call close_shell()
   call check('as many rows as keys', size(key_examples) == sum([(size(blocks(g)%keys), &
      g=1, size(blocks))]))
   call check('no row is cut off', all(len_trim(key_examples%example) < &
      len(key_examples%example)) .and. all(len_trim(key_examples%allowed) < &
      len(key_examples%allowed)) .and. all(len_trim(see_also%words) < len(see_also%words)))
   call test_see_also()
   call finish('key examples')

contains

   !> Everything that the help says about a key.
   subroutine check_key(group, key, with_files)
      character(len=*), intent(in) :: group
      type(key_t), intent(in) :: key
      logical, intent(in) :: with_files
      character(len=:), allocatable :: label, example, allowed, problem
      integer :: n

      label = '&'//group//' '//trim(key%name)
      allowed = allowed_of(group, key)
      call check(label//': a definition', len_trim(key%help) > 5 .and. key%help(:1) /= '''', &
         key%help)
      call check(label//': a unit', (unit_of(group, key) == 'none') .eqv. .not. needs_unit(group, &
         key), unit_of(group, key))
      call check(label//': a default', default_of(key) /= '' .and. (key%required .eqv. &
         default_of(key) == 'required'), default_of(key))
      call check(label//': allowed values', allowed /= '' .and. allowed /= 'any text', allowed)
      if (allocated(key%choices)) then
         do n = 1, size(key%choices)
            call check(label//': '//trim(key%choices(n))//' is allowed', index(allowed, &
               trim(key%choices(n))) > 0, allowed)
         end do
      end if
      example = example_of(group, key)
      call check(label//': an example with the key', index(example, '&'//group//' ') == 1 .and. &
         (index(example, ' '//trim(key%name)//'=') > 0), example)
      if (.not. with_files) return
      problem = problem_of(group, example)
      call check(label//': its example is accepted', problem == '', example//' '//problem)
   end subroutine check_key

   !> Numbers have a unit, except for these, which are ratios, exponents or shares.
   pure logical function needs_unit(group, key)
      character(len=*), intent(in) :: group
      type(key_t), intent(in) :: key

      needs_unit = key%kind == kind_real .and. all(group//' '//trim(key%name) /= &
         [character(len=22) :: 'along depth', 'excitation power', 'integrator rtol', &
         'beam eta', 'beam d_1', 'beam d_2', 'multistart spread', 'design target', &
         'record coherence_least', 'track frequency_error'])
   end function needs_unit

   !> Every parameter that a fit may estimate; those of a dip or of a table need them in the case.
   subroutine test_parameters()
      character(len=:), allocatable :: example, problem
      integer :: p

      do p = 1, size(parameters)
         if (.not. is_listed(p)) cycle
         example = parameter_example(p)
         problem = ''
         if (parameters(p)%group == 'along') then
            problem = problem_of('stage', '&along kind=''dip'', place=0.2, width=0.05, '// &
               'depth=0.3 /'//nl//example)
         else if (parameters(p)%name == 'c_R') then
            problem = problem_of('stage', '&beam length=0.5, E=7e10, rho=0.27, I=3.3e-11, '// &
               'k_R=50 /'//nl//example)
         else if (parameters(p)%group == 'end') then
            problem = problem_of('stage', '&end at=''tip'', k_w=200, c_w=0.1 /'//nl//example)
         else if (index(parameters(p)%name, '_RP') > 0) then
            problem = problem_of('support', '&support x_P=0.3, k_R=50 /'//nl//example)
         else if (parameters(p)%group == 'mass') then
            problem = problem_of('mass', '&mass m=0.002, x=0.2 /'//nl//example)
         else
            problem = problem_of('stage', example)
         end if
         call check(symbol_of(p)//': its example is accepted', problem == '', example//' '//problem)
      end do
   end subroutine test_parameters

   !> Returns the message about a small case with an example in the place of its groups; '' if it is
   !> accepted.
   !>
   !> group    name of the example's group
   !> example  one group, or several in lines of their own
   function problem_of(group, example) result(message)
      character(len=*), intent(in) :: group, example
      character(len=:), allocatable :: message, text
      type(case_t) :: case
      type(error_t), allocatable :: error
      integer :: n

      text = ''
      do n = 1, size(small_case)
         associate (line => small_case(n), name => small_case(n)(:index(small_case(n), ' ')))
            if (index(nl//example, nl//name) > 0) cycle
            ! The lists of bands are those of a frequency response.
            if (index(example, '&design f_') > 0 .and. name == '&record ') then
               text = text//'&record kind=''frf'', f_first=4, f_last=300, f_step=1 /'//nl
               cycle
            end if
            ! Free parameters of a stage must not vary along the beam. A list of cases has no draws.
            if (group == 'along' .and. name == '&stage ') cycle
            text = text//trim(line)//nl
         end associate
      end do
      text = text//example//nl
      message = ''
      call parse_case(in_scratch('case.nml'), text, needs_nothing, case, error)
      if (allocated(error)) message = error%message
   end function problem_of

   !> Every command and group is a topic, and every related word is a topic of the help.
   subroutine test_see_also()
      character(len=20), allocatable :: words(:)
      character(len=:), allocatable :: left
      integer :: n, space

      call known_words(words)
      do n = 1, size(blocks)
         call check('see also: &'//blocks(n)%name, related_words(a_group, blocks(n)%name) /= '')
      end do
      call check('see also: the group of a key', related_words('record', 'thin') == &
         't_step record', related_words('record', 'thin'))
      call check('see also: parameters', related_words(a_parameter, 'E') == 'free prior')
      do n = 1, size(see_also)
         left = trim(see_also(n)%words)//' '
         if (all(see_also(n)%of /= [character(len=13) :: a_command, an_everyday_word])) &
            call check('see also: a topic, '//see_also(n)%topic, any(words == see_also(n)%topic))
         ! `help` asks for everyday words only if there is no topic of this name.
         if (see_also(n)%of == an_everyday_word) call check('everyday word: '//see_also(n)%topic, &
            all(words /= see_also(n)%topic))
         do while (left /= '')
            space = index(left, ' ')
            call check('see also: '//left(:space - 1), any([(lower(trim(words(k))) == &
               lower(left(:space - 1)), k=1, size(words))]) .or. any(see_also%of == a_command &
               .and. see_also%topic == left(:space - 1)))
            left = left(space + 1:)
         end do
      end do
   end subroutine test_see_also

end program test_key_examples
