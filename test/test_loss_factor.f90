!> Structural damping, a modulus E (1 + i eta): its modes and their derivatives, frequency responses
!> of a beam that varies, and fits by the program.
program test_loss_factor
   use beamid_equations, only: equations_t, new_equations
   use beamid_errors, only: error_t
   use beamid_excitation, only: new_pulse
   use beamid_frequency_responses, only: predict_response
   use beamid_galerkin, only: galerkin_of, galerkin_t, mesh_t
   use beamid_kinds, only: wp
   use beamid_modal, only: modal_t
   use beamid_observed_data, only: meshed_model_t
   use beamid_parameter_names, only: is_there, name_of_parameter
   use beamid_parameters, only: parameters
   use beamid_responses, only: work_t
   use beamid_roots, only: damped_roots
   use beamid_strings, only: to_text
   use beamid_structure, only: E_at, n_parameters, no_spring, of_E, of_eta, structure_t
   use beamid_variations, only: field_modulus
   use case_answers, only: check_estimates, modal_record, nl
   use checks, only: check, check_close, finish, skip
   use random_benches, only: bench, load_axially
   use random_numbers, only: start_random
   use shell, only: beamid, close_shell, open_shell, outcome_t, read_file, write_file
   use tables, only: field, number
   implicit none

   type(mesh_t), parameter :: mesh = mesh_t(5, 8, 6, 1)
   integer, parameter :: wanted = 4
   character(len=:), allocatable :: reason
   integer :: k

   call test_cantilever()
   call start_random(20261127)
   do k = 1, 12
      call test_bench(k, heavy=.false.)
   end do
   do k = 51, 54
      call test_bench(k, heavy=modulo(k, 2) == 0)
   end do
   call test_field()
   call open_shell(reason)
   if (reason /= '') then
      call skip('fits', reason)
   else
      call test_fit()
      call test_comparison()
      call test_refusals()
      call close_shell()
   end if
   call finish('loss_factor')

contains

   !> A cantilever without attachments: a mode with the wave number b obeys
   !> rho s**2 + (gamma + c_D I b**4) s + E (1 + i eta) I b**4 = 0. 24 quintic elements have the
   !> wave numbers to 1e-10 or so.
   subroutine test_cantilever()
      real(wp), parameter :: b(3) = [1.8751040687119612_wp, 4.6940911329741746_wp, &
         7.8547574382376126_wp]
      type(structure_t) :: structure
      type(equations_t) :: equations
      type(galerkin_t), target :: galerkin
      type(error_t), allocatable :: error
      complex(wp), allocatable :: s(:)
      complex(wp) :: exact
      integer :: n

      structure = structure_t(length=1, rho=1, E=2, I=0.5_wp, c_D=1e-3_wp, gamma=0.05_wp, &
         eta=0.1_wp)
      galerkin = galerkin_of(mesh_t(5, 24, 6, 1), structure)
      equations = new_equations(galerkin, structure, new_pulse(1.0_wp, 1.0_wp))
      call damped_roots(equations, s, error)
      call check('cantilever: roots', .not. allocated(error))
      if (allocated(error)) return
      do n = 1, 3
         associate (half => (0.05_wp + 5e-4_wp*b(n)**4)/2)
            exact = -half - sqrt(half**2 - cmplx(1, 0.1_wp, wp)*b(n)**4)
         end associate
         call check_close('cantilever: mode '//to_text(n), abs(s(n) - exact)/abs(exact), 0.0_wp, &
            1e-9_wp)
      end do
   end subroutine test_cantilever

   !> At one root s, the modulus E (1 + i eta) equals E' + s c_D' with the real numbers
   !> c_D' = eta E/Im s and E' = E (1 - eta Re s/Im s): s is also a root of the structure with these
   !> and without a loss factor. Roots are good to 1e-13 or so; next to others, as those of the
   !> hoses may be, they lose some digits. Derivatives by central differences of the parameter;
   !> what remains are the square of their width, and round-off over it. Full matrices have more of
   !> the latter.
   !>
   !> heavy  with weight and axial force: full matrices
   subroutine test_bench(number, heavy)
      integer, intent(in) :: number
      logical, intent(in) :: heavy
      type(structure_t) :: structure, other
      complex(wp) :: s(wanted), ds(wanted, n_parameters), plain(wanted), none(wanted, 0)
      complex(wp), dimension(wanted) :: above, below, change
      complex(wp), allocatable :: all(:)
      integer, allocatable :: places(:)
      character(len=:), allocatable :: name
      real(wp), parameter :: step = 1e-4_wp
      real(wp) :: part
      logical :: failed
      integer :: p, r

      part = merge(1e-4_wp, 1e-5_wp, heavy)
      structure = bench(number)
      if (heavy) call load_axially(number, structure)
      structure%eta = 0.02_wp*(1 + modulo(number, 5))
      name = 'bench '//to_text(number)//': '
      places = pack(parameters(:n_parameters)%place, is_there(structure, &
         parameters(:n_parameters)%place))
      places = pack(places, [(abs(structure%get(places(p))) > 0 .and. &
         structure%get(places(p)) < no_spring, p=1, size(places))])
      call lowest(structure, places, s, ds(:, :size(places)), failed)
      call check(name//'modes', .not. failed)
      if (failed) return
      do r = 1, wanted
         other = structure
         other%eta = 0
         other%E = structure%E*(1 - structure%eta*real(s(r))/aimag(s(r)))
         other%c_D = structure%c_D + structure%eta*structure%E/aimag(s(r))
         call all_roots(other, all)
         call check_close(name//'root '//to_text(r), minval(abs(all - s(r)))/abs(s(r)), 0.0_wp, &
            1e-10_wp)
      end do
      do p = 1, size(places)
         associate (value => structure%get(places(p)))
            other = structure
            call other%set(places(p), (1 + part)*value)
            call lowest(other, [integer ::], above, none, failed)
            call other%set(places(p), (1 - part)*value)
            if (.not. failed) call lowest(other, [integer ::], below, none, failed)
            change = (above - below)/(2*part)
            call check_close(name//'by '//trim(name_of_parameter(structure, places(p))), &
               maxval(abs(change - value*ds(:, p))/abs(s)), 0.0_wp, merge(1e-6_wp, 1e-7_wp, heavy))
         end associate
      end do
      ! Without a loss factor, its derivative is one-sided. The difference formula of second order
      ! multiplies errors of the roots, up to 1e-10 (above), by 4/step.
      other = structure
      other%eta = 0
      call lowest(other, [of_eta], plain, ds(:, :1), failed)
      other%eta = step
      if (.not. failed) call lowest(other, [integer ::], above, none, failed)
      other%eta = 2*step
      if (.not. failed) call lowest(other, [integer ::], below, none, failed)
      change = (4*above - 3*plain - below)/(2*step)
      call check_close(name//'by eta = 0', maxval(abs(change - ds(:, 1))/abs(s)), 0.0_wp, 1e-5_wp)
   end subroutine test_bench

   !> Computes the lowest modes that oscillate.
   subroutine lowest(structure, free, s, ds, failed)
      type(structure_t), intent(in) :: structure
      integer, intent(in) :: free(:)
      complex(wp), intent(out) :: s(:), ds(:, :)
      logical, intent(out) :: failed
      type(equations_t), target :: equations
      type(galerkin_t), target :: galerkin
      type(modal_t), allocatable :: solver
      type(error_t), allocatable :: error
      type(work_t) :: work

      allocate (solver)
      galerkin = galerkin_of(mesh, structure)
      call solver%prepare(galerkin, error)
      equations = new_equations(galerkin, structure, new_pulse(0.0_wp, 1.0_wp), matrices=.false.)
      call solver%free_motion(equations, free, s, ds, work, error)
      failed = allocated(error)
      if (failed) print '(2a)', '      ', error%message
   end subroutine lowest

   !> Computes all roots of a structure.
   subroutine all_roots(structure, roots)
      type(structure_t), intent(in) :: structure
      complex(wp), allocatable, intent(out) :: roots(:)
      type(equations_t) :: equations
      type(galerkin_t), target :: galerkin
      type(error_t), allocatable :: error

      galerkin = galerkin_of(mesh, structure)
      equations = new_equations(galerkin, structure, new_pulse(1.0_wp, 1.0_wp))
      call damped_roots(equations, roots, error)
      if (allocated(error)) roots = [(0.0_wp, 0.0_wp)]
   end subroutine all_roots

   !> Coefficients of E(x) that are all equal make the beam with this E: response, and the
   !> derivative by E as the sum of those by the coefficients; to round-off.
   subroutine test_field()
      real(wp), parameter :: frequencies(3) = [0.3_wp, 1.9_wp, 6.1_wp]
      type(structure_t) :: structure, varying
      complex(wp) :: plain(3, 0:2), h(3, 0:9)
      integer :: k

      structure = structure_t(length=1, rho=1, E=2, I=0.5_wp, c_D=1e-3_wp, gamma=0.05_wp, &
         m_T=0.2_wp, eta=0.1_wp)
      varying = structure
      varying%variations%along(field_modulus)%coefficients = 8
      do k = 1, 8
         call varying%set(E_at(k), structure%E)
      end do
      call respond(varying, structure, frequencies, [of_E, of_eta], plain)
      call respond(varying, varying, frequencies, [E_at(:8), of_eta], h)
      call check_close('E(x): response', maxval(abs(h(:, 0)/plain(:, 0) - 1)), 0.0_wp, 1e-10_wp)
      call check_close('E(x): by E', maxval(abs(sum(h(:, 1:8), dim=2)/plain(:, 1) - 1)), 0.0_wp, &
         1e-9_wp)
      call check_close('E(x): by eta', maxval(abs(h(:, 9)/plain(:, 2) - 1)), 0.0_wp, 1e-9_wp)
   end subroutine test_field

   !> Computes the receptance on the mesh of a beam that may vary, `like`.
   subroutine respond(like, structure, frequencies, free, h)
      type(structure_t), intent(in) :: like, structure
      real(wp), intent(in) :: frequencies(:)
      integer, intent(in) :: free(:)
      complex(wp), intent(out) :: h(:, 0:)
      type(meshed_model_t), target :: model
      type(modal_t), allocatable :: solver
      type(error_t), allocatable :: error
      type(work_t) :: work

      allocate (solver)
      model%galerkin = galerkin_of(mesh, like)
      call solver%prepare(model%galerkin, error)
      call move_alloc(solver, model%solver)
      call predict_response(model, structure, new_pulse(0.0_wp, 1.0_wp), 0, 0.0_wp, &
         frequencies, free, h, work, error)
      call check('E(x): computed', .not. allocated(error))
   end subroutine respond

   !> Returns the group of the true beam, with another E and loss factor, and its mesh.
   function beam(E, eta, more)
      real(wp), intent(in) :: E, eta
      character(len=*), intent(in) :: more
      character(len=:), allocatable :: beam

      beam = '&beam length=0.5, width=0.03, height=0.003, density=2700, gamma=0.05, E='// &
         to_text(E)//', eta='//to_text(eta)//more//' /'//nl//'&tip m_T=0.01 /'//nl// &
         '&discretization elements=8, degree=5 /'//nl
   end function beam

   !> Exact records of each kind give the loss factor back: the response, and the modes.
   subroutine test_fit()
      character(len=*), parameter :: free = '&stage free=''E'',''c_D'',''eta'' /'//nl
      type(outcome_t) :: outcome

      call write_file('true.nml', beam(7e10_wp, 0.015_wp, ', c_D=1e6')// &
         '&record kind=''frf'', f_first=4, f_last=400, f_step=1 /'//nl)
      outcome = beamid('frf true.nml --out true')
      call check('fit: a response', outcome%status == 0)
      call check_answer('response', beam(6.3e10_wp, 0.0_wp, '')// &
         '&record kind=''frf'', file=''true/frf.csv'' /'//nl//free)
      outcome = beamid('modes true.nml --out true_modes')
      call write_file('modes.csv', modal_record(read_file('true_modes/modes.csv')))
      call check_answer('modes', beam(6.3e10_wp, 0.0_wp, '')// &
         '&record kind=''modes'', file=''modes.csv'' /'//nl//free)
   end subroutine test_fit

   !> Checks the estimates of a case. The mesh is that of the record, and a search ends within
   !> 1e-6 standard errors of the minimum: 1e-5 of the values leaves a wide margin.
   subroutine check_answer(name, text)
      character(len=*), intent(in) :: name, text

      call check_estimates(name, text, [character(len=3) :: 'E', 'c_D', 'eta'], &
         [7e10_wp, 1e6_wp, 0.015_wp], 1e-5_wp)
   end subroutine check_answer

   !> A response with a loss factor rejects Kelvin-Voigt damping, by AICc.
   subroutine test_comparison()
      type(outcome_t) :: outcome

      call write_file('true.nml', beam(7e10_wp, 0.015_wp, '')// &
         '&record kind=''frf'', f_first=4, f_last=400, f_step=1 /'//nl)
      outcome = beamid('frf true.nml --out true')
      call write_file('structural.nml', case_of('eta'))
      call write_file('viscous.nml', case_of('c_D'))
      outcome = beamid('compare viscous.nml structural.nml --out compared')
      call check('compare: status', outcome%status == 0)
      call check('compare: the order of the table', field(read_file('compared/models.csv'), 2, 1) &
         == 'structural')
      call check('compare: the other model is worse', worse() > 100)
   end subroutine test_comparison

   !> Returns the case that fits E and one damping parameter.
   function case_of(damping) result(text)
      character(len=*), intent(in) :: damping
      character(len=:), allocatable :: text

      text = beam(6.8e10_wp, 0.0_wp, '')//'&record kind=''frf'', file=''true/frf.csv'' '// &
         '/'//nl//'&stage free=''E'','''//damping//''' /'//nl
   end function case_of

   !> Returns how much larger the AICc of the viscous model is.
   real(wp) function worse()
      integer :: column
      character(len=:), allocatable :: table

      table = read_file('compared/models.csv')
      do column = 1, 12
         if (field(table, 0, column) == 'aicc') exit
      end do
      worse = number(field(table, 1, column)) - number(field(table, 2, column))
   end function worse

   !> A loss factor has no response in time: one line, status 2.
   subroutine test_refusals()
      type(outcome_t) :: outcome
      character(len=*), parameter :: pulse = '&excitation kind=''pulse'', amplitude=1, '// &
         'duration=0.01 /'//nl//'&record t_first=0, t_last=1, t_step=0.01 /'//nl

      call write_file('time.nml', beam(7e10_wp, 0.015_wp, '')//pulse)
      outcome = beamid('simulate time.nml')
      call check('refused: simulate', outcome%status == 2 .and. &
         index(outcome%err, '&beam eta: found') > 0)
      call write_file('drawn.nml', beam(7e10_wp, 0.0_wp, '')//pulse//'&noise sd=0.1 /'//nl// &
         '&stage free=''E'' /'//nl//'&draw parameter=''eta'', low=0.01, high=0.02 /'//nl// &
         '&ensemble members=3 /'//nl)
      outcome = beamid('ensemble drawn.nml')
      call check('refused: a loss factor is drawn for a response in time', outcome%status == 2 &
         .and. index(outcome%err, '&draw parameter: found ''eta''') > 0, outcome%err)
      call write_file('r.csv', 't,a'//nl//'0,0'//nl//'0.01,1'//nl//'0.02,2'//nl//'0.03,1'//nl)
      call write_file('both.nml', beam(7e10_wp, 0.0_wp, '')//'&excitation kind=''free'', '// &
         'modes=1 /'//nl//'&record file=''r.csv'' /'//nl//'&record kind=''frf'', '// &
         'file=''true/frf.csv'' /'//nl//'&stage free=''E'',''eta'' /'//nl)
      outcome = beamid('identify both.nml')
      call check('refused: eta beside a record in time', outcome%status == 2 .and. &
         index(outcome%err, '&stage free: found ''eta''') > 0)
      call write_file('alone.nml', beam(7e10_wp, 0.0_wp, '')//'&record kind=''frf'', '// &
         'file=''true/frf.csv'' /'//nl//'&stage free=''E'',''amplitude'' /'//nl)
      outcome = beamid('identify alone.nml')
      call check('refused: amplitude without a record in time', outcome%status == 2 .and. &
         index(outcome%err, '&stage free: found ''amplitude''') > 0)
      call write_file('offset.nml', beam(7e10_wp, 0.0_wp, '')//'&record kind=''frf'', '// &
         'file=''true/frf.csv'' /'//nl//'&stage free=''E'',''offset'' /'//nl)
      outcome = beamid('identify offset.nml')
      call check('refused: offset without a record in time', outcome%status == 2 .and. &
         index(outcome%err, '&stage free: found ''offset''') > 0)
   end subroutine test_refusals

end program test_loss_factor
