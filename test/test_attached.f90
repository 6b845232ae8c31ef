!> Masses, absorbers and supports anywhere on a beam, as case files describe them: natural
!> frequencies, a fit with its parameters' names, and what is refused.
program test_attached
   use beamid_kinds, only: wp
   use beamid_strings, only: to_text
   use checks, only: check, check_close, finish, skip
   use shell, only: beamid, close_shell, open_shell, outcome_t, read_file, write_file
   use tables, only: field, number
   implicit none

   character(len=*), parameter :: nl = new_line('a'), pinned = '&beam length=10, E=7.8e5, I=1, '// &
      'rho=78 /'//nl//'&end at=''root'', kind=''pinned'' /'//nl//'&end at=''tip'', '// &
      'kind=''pinned'' /'//nl//'&discretization degree=5, elements=32 /'//nl
   character(len=:), allocatable :: reason

   call open_shell(reason)
   if (reason == '') then
      call test_frequencies()
      call test_fit()
      call test_refusals()
      call close_shell()
   else
      call skip('attached', reason)
   end if
   call finish('attached')

contains

   !> Natural frequencies of a case, compared with exact values [Hz].
   !>
   !> error  allowed error, relative
   subroutine compare(name, groups, exact, error)
      character(len=*), intent(in) :: name, groups
      real(wp), intent(in) :: exact(:), error
      type(outcome_t) :: outcome
      character(len=:), allocatable :: table
      integer :: k

      call write_file('case.nml', groups)
      outcome = beamid('modes case.nml --out out --quiet')
      call check(name//': modes', outcome%status == 0, outcome%err)
      table = read_file('out/modes.csv')
      do k = 1, size(exact)
         call check_close(name//': mode '//to_text(k), number(field(table, k, 3))/exact(k), &
            1.0_wp, error)
      end do
   end subroutine compare

   !> SDLL04 of the guide VPCS, a pinned beam with a sprung mass, from the characteristic equation
   !> in 40 digits (mpmath). The shear jumps at the spring, which quintic splines follow up to
   !> 1.4e-8 on 32 elements. A clamp in the middle of a cantilever leaves one of half the length,
   !> and a span that is clamped at both ends, with beta l = 1.8751, 4.6941 and 4.7300; quintic
   !> splines with knots at the clamp have these three up to 1e-10.
   subroutine test_frequencies()
      real(wp), parameter :: pi = acos(-1.0_wp), &
         half(3) = [1.875104068711961_wp, 4.694091132974175_wp, 4.730040744862704_wp]

      call compare('light absorber', pinned//'&hose m_H=0.78, k_H=75.9791, x_H=7.5 /'//nl, &
         [1.5460992166_wp, 1.5957683503_wp], 1e-7_wp)
      call compare('heavy absorber', pinned//'&hose m_H=7.8, k_H=759.791, x_H=7.5 /'//nl, &
         [1.4936879239_wp, 1.6506471410_wp, 6.2873744279_wp], 1e-7_wp)
      call compare('clamp in the middle', '&beam length=1, E=1, I=1, rho=1 /'//nl// &
         '&support x_P=0.5, k_R=inf /'//nl//'&discretization degree=5, elements=32 /'//nl, &
         half**2/(0.25_wp*2*pi), 1e-9_wp)
      call compare('80 attachments', many_attachments(20), [7.542390_wp, 22.176113_wp, &
         38.976592_wp, 40.222888_wp, 41.401381_wp, 42.537587_wp], 1e-6_wp)
   end subroutine test_frequencies

   !> A cantilever with n masses, supports, hoses and sensors side by side. The frequencies of 80
   !> attachments are those of 162 cubic elements between their points (NumPy), whose round-off is
   !> 3e-7.
   function many_attachments(n) result(groups)
      integer, intent(in) :: n
      character(len=:), allocatable :: groups
      character(len=400) :: buffer
      integer :: i

      groups = '&beam length=1, E=2e11, I=2e-10, rho=0.78 /'//nl// &
         '&discretization degree=5, elements=64 /'//nl
      do i = 0, n - 1
         write (buffer, '(*(g0))') '&mass name=''m', i, ''', x=', &
            0.04_wp + 0.045_wp*i, ', m=0.01, J=1e-6 /&sensor name=''s', i, ''', x_S=', &
            0.07_wp + 0.045_wp*i, ', m_S=0.002 /&hose name=''h', i, ''', x_H=', &
            0.06_wp + 0.045_wp*i, ', m_H=0.005, c_H=0.02, k_H=', 300 + 20*i, &
            ' /&support name=''p', i, ''', x_P=', 0.05_wp + 0.045_wp*i, ', c_P=0.1, k_P=', &
            100 + i, ' /'
         groups = groups//trim(buffer)//nl
      end do
   end function many_attachments

   !> A strip with an absorber and a mass whose positions are unknown: a fit from values that are
   !> 10 % off returns to the true ones. The noise of this seed may move an estimate by 4 standard
   !> errors, which happens once in 16,000.
   subroutine test_fit()
      character(len=*), &
         parameter :: beam = '&beam length=0.6, width=0.03, height=0.002, E=7e10, '// &
         'density=2700, c_D=5e6, gamma=0.05 /'//nl//'&sensor x_S=0.55 /'//nl// &
         '&excitation kind=''pulse'', amplitude=1, duration=0.01, x_F=0.4 /'//nl// &
         '&observation formula=''equation'' /'//nl//'&discretization elements=16 /'//nl, &
         names(4) = [character(len=3) :: 'm_M', 'x_M', 'm_H', 'x_H']
      real(wp), parameter :: truth(4) = [0.02_wp, 0.25_wp, 0.01_wp, 0.4_wp]
      character(len=:), allocatable :: table
      type(outcome_t) :: outcome
      integer :: k

      call write_file('true.nml', beam//'&mass name=''clip'', m=0.02, x=0.25 /'//nl// &
         '&mass name=''nut'', m=0.004, x=0.5 /'//nl// &
         '&hose m_H=0.01, c_H=0.1, k_H=60, x_H=0.4 /'//nl//'&noise sd=0.2, seed=4 /'//nl// &
         '&record t_first=0.001, t_last=1.5, t_step=0.001 /'//nl)
      outcome = beamid('simulate true.nml --out out --quiet')
      call check('simulate', outcome%status == 0, outcome%err)
      call write_file('fit.nml', beam//'&mass name=''clip'', m=0.018, x=0.26 /'//nl// &
         '&mass name=''nut'', m=0.004, x=0.5 /'//nl// &
         '&hose m_H=0.011, c_H=0.1, k_H=60, x_H=0.41 /'//nl//'&record file=''out/record.csv'' /' &
         //nl//'&stage free=''m_M.clip'', ''x_M.clip'', ''m_H'', ''x_H'' /'//nl)
      outcome = beamid('identify fit.nml --out fit --quiet')
      call check('fit', outcome%status == 0, outcome%err//outcome%out)
      table = read_file('fit/estimates.csv')
      do k = 1, size(names)
         call check('name of '//names(k), index(field(table, k, 3), names(k)) == 1 .and. &
            (index(field(table, k, 3), '.clip') > 0 .eqv. k < 3), field(table, k, 3))
         call check('estimate of '//names(k), abs(number(field(table, k, 6)) - truth(k)) <= &
            4*number(field(table, k, 7)), field(table, k, 6)//' +- '//field(table, k, 7))
      end do
   end subroutine test_fit

   subroutine test_refusals()
      call refused('off the beam', '&mass m=1, x=2 /', '&mass x: found 2')
      call refused('hose off the beam', '&hose m_H=1, k_H=1, x_H=2 /', '&hose x_H: found 2')
      call refused('two without names', '&mass m=1 /'//nl//'&mass m=2 /', 'a name for each')
      call refused('name of an end', '&mass name=''tip'', m=1 /', 'the ends')
      call refused('one name twice', '&hose name=''a'', m_H=1, k_H=1 /'//nl// &
         '&hose name=''a'', m_H=1, k_H=1 /', 'twice')
      call refused('held by nothing', '&support x_P=0.5, k_P=0 /', '&support k_P: found 0')
      call refused('rotation held twice', '&end at=''tip'', kind=''guided'' /'//nl// &
         '&support x_P=1, k_P=0, k_R=3 /', 'support at the tip')
      call refused('damper without spring', '&support x_P=0.5, k_R=inf, c_R=1 /', &
         'c_R: found a value without k_R')
      call refused('no mass', '&mass x=0.5 /', '&mass m: found nothing')
   end subroutine test_refusals

   !> Checks that a case with these groups is refused in one line that contains a word.
   subroutine refused(name, groups, word)
      character(len=*), intent(in) :: name, groups, word
      type(outcome_t) :: outcome

      call write_file('bad.nml', '&beam length=1, rho=1, E=1, I=1 /'//nl//groups//nl)
      outcome = beamid('modes bad.nml --out bad')
      call check('refused: '//name, outcome%status == 2 .and. index(outcome%err, word) > 0 .and. &
         index(outcome%err, nl) >= len_trim(outcome%err), outcome%err)
   end subroutine refused

end program test_attached
