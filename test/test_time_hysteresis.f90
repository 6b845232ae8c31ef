!> Time hysteresis, relaxations of the modulus: damping ratios and relaxation roots of a cantilever,
!> its motion in time, limits, fits of the parameters, and cases that are refused. `test_benches`
!> and `test_frequency_responses` test the responses of other structures and their derivatives.
program test_time_hysteresis
   use beamid_assembly, only: assembly_t, new_assembly, root_t
   use beamid_equations, only: equations_t, new_equations
   use beamid_errors, only: error_t
   use beamid_excitation, only: excitation_t, new_force_table, new_pulse
   use beamid_galerkin, only: galerkin_of, galerkin_t, mesh_t
   use beamid_kinds, only: wp
   use beamid_modal, only: modal_t
   use beamid_modes, only: bare_beam_modes, beam_modes_t
   use beamid_relaxation_roots, only: continue_relaxation_roots, find_relaxation_roots, shares_of
   use beamid_responses, only: response_t, work_t
   use beamid_roots, only: damped_roots
   use beamid_strings, only: to_text
   use beamid_structure, only: structure_t
   use beamid_vectors, only: find_vector, vector_t
   use case_answers, only: check_estimates, check_refused, modal_record, nl
   use checks, only: check, check_close, finish, skip
   use random_numbers, only: between, decades, start_random
   use shell, only: beamid, close_shell, open_shell, outcome_t, read_file, write_file
   implicit none

   type(mesh_t), parameter :: fine = mesh_t(7, 40, 8, 1)
   character(len=:), allocatable :: reason
   integer :: i

   do i = 1, 2
      call test_cantilever(i)
      call test_accumulation(i)
      call test_step(i)
   end do
   call test_continuation()
   call test_limits()
   call open_shell(reason)
   if (reason /= '') then
      call skip('fits', reason)
   else
      call test_fit()
      call test_refusals()
      call close_shell()
   end if
   call finish('time_hysteresis')

contains

   !> A cantilever with one relaxation, or with two.
   type(structure_t) function cantilever(relaxations) result(s)
      integer, intent(in) :: relaxations

      s = structure_t(length=1.1_wp, rho=0.7_wp, E=1.3_wp, I=1, gamma=0.1_wp, c_D=1e-4_wp, &
         d_1=0.2_wp, b_1=30)
      if (relaxations < 2) return
      s%d_1 = 0.1_wp
      s%b_1 = 5
      s%d_2 = 0.3_wp
      s%b_2 = 400
   end function cantilever

   !> Damping ratios of the modes 1 to 6, and their relaxation roots. The known values come from
   !> mpmath with 40 digits: the roots s of
   !> rho s**2 + gamma s + (E + c_D s + sum of E d s/(s + b)) I k**4 = 0 for the wave numbers k of
   !> cos k l cosh k l = -1. 40 elements of degree 7 have the wave numbers to 1e-12.
   subroutine test_cantilever(relaxations)
      integer, intent(in) :: relaxations
      real(wp), parameter :: ratios(6, 2) = reshape([ &
         0.031215167704027344756_wp, 0.051488687305533482796_wp, 0.033293655727956648667_wp, &
         0.021641363828158332123_wp, 0.018260294307165366183_wp, 0.018772341917242936206_wp, &
         0.043806341431557714934_wp, 0.021027781102534256593_wp, 0.030786127028029232029_wp, &
         0.050674328391367040805_wp, 0.069076258682991513247_wp, 0.077006395427015232206_wp], &
         [6, 2])
      real(wp), parameter :: real_roots(6, 3) = reshape([ &
         -29.896415409118629802_wp, -27.522133217063836241_wp, -25.495173262744577834_wp, &
         -25.129602136726594211_wp, -25.042882536365178835_wp, -25.014866441204166588_wp, &
         -4.8017937648111660336_wp, -4.5570735080318153019_wp, -4.5455978057038212454_wp, &
         -4.5443285352773447192_wp, -4.544044392231177127_wp, -4.5439538290258051197_wp, &
         -399.98823587395313374_wp, -399.53931183175137976_wp, -396.46147615869124142_wp, &
         -387.31395996671705596_wp, -370.60735236427356779_wp, -351.33215069298621129_wp], [6, 3])
      type(structure_t) :: structure
      type(equations_t) :: equations
      type(galerkin_t), target :: galerkin
      type(error_t), allocatable :: error
      type(root_t), allocatable :: relaxed(:)
      complex(wp), allocatable :: s(:)
      character(len=:), allocatable :: name
      integer :: k, l

      structure = cantilever(relaxations)
      name = 'cantilever, relaxations '//to_text(relaxations)//': '
      galerkin = galerkin_of(fine, structure)
      equations = new_equations(galerkin, structure, new_pulse(1.0_wp, 1.0_wp))
      call damped_roots(equations, s, error)
      call check(name//'roots', .not. allocated(error))
      if (allocated(error)) return
      do k = 1, 6
         call check_close(name//'damping ratio '//to_text(k), -real(s(k))/abs(s(k)) &
            /ratios(k, relaxations), 1.0_wp, 1e-9_wp)
      end do
      call find_relaxation_roots(assembly_of(structure, fine), relaxed, error)
      call check(name//'relaxation roots', .not. allocated(error))
      if (allocated(error)) return
      do l = 1, relaxations
         do k = 1, 6
            call check_close(name//'relaxation root '//to_text(k), minval(abs(relaxed%s &
               - real_roots(k, relaxations + l - 1)))/abs(real_roots(k, relaxations + l - 1)), &
               0.0_wp, 1e-11_wp)
         end do
      end do
   end subroutine test_cantilever

   !> Assembles a structure in the modes of its own mesh.
   type(assembly_t) function assembly_of(structure, mesh) result(assembly)
      type(structure_t), intent(in) :: structure
      type(mesh_t), intent(in) :: mesh
      type(beam_modes_t) :: modes
      type(error_t), allocatable :: error

      call bare_beam_modes(galerkin_of(mesh, structure), modes, error)
      call check('modes', .not. allocated(error))
      assembly = new_assembly(structure, modes, [integer ::])
   end function assembly_of

   !> The relaxation roots of 40 random structures, followed from those of similar structures: every
   !> parameter changes by up to 20 %. They equal the roots of a new search, whose own error is the
   !> round-off of their distance from the point of accumulation; so do the eigenvectors.
   subroutine test_continuation()
      type(structure_t) :: structure
      type(assembly_t) :: assembly
      type(root_t), allocatable :: known(:), followed(:), fresh(:)
      type(vector_t), allocatable :: vector(:)
      type(vector_t) :: expected
      type(error_t), allocatable :: error
      real(wp), allocatable :: shares(:)
      real(wp) :: furthest, least_like
      logical :: found
      integer :: k, trial, followed_trials

      call start_random(5)
      followed_trials = 0
      furthest = 0
      least_like = 0
      do trial = 1, 40
         structure = cantilever(1 + mod(trial, 2))
         structure%m_T = decades(-2.0_wp, 0.0_wp)
         structure%supports = 1
         structure%support(1)%x_P = between(0.4_wp, 1.0_wp)
         structure%support(1)%kappa_P = decades(-3.0_wp, 0.0_wp)
         structure%d_1 = decades(-3.0_wp, 0.0_wp)
         structure%b_1 = decades(0.0_wp, 4.0_wp)
         assembly = assembly_of(structure, mesh_t(3, 16, 4, 1))
         call find_relaxation_roots(assembly, known, error)
         call check('roots before the change', .not. allocated(error))
         if (allocated(error)) return
         shares = shares_of(assembly%oscillators, known)
         structure%E = structure%E*between(0.8_wp, 1.2_wp)
         structure%m_T = structure%m_T*between(0.8_wp, 1.2_wp)
         structure%d_1 = structure%d_1*between(0.8_wp, 1.2_wp)
         structure%b_1 = structure%b_1*between(0.8_wp, 1.2_wp)
         structure%support(1)%kappa_P = structure%support(1)%kappa_P*between(0.8_wp, 1.2_wp)
         assembly = assembly_of(structure, mesh_t(3, 16, 4, 1))
         call find_relaxation_roots(assembly, fresh, error)
         if (allocated(vector)) deallocate (vector)
         allocate (vector(size(known)))
         call continue_relaxation_roots(assembly, known, shares, followed, vector, found)
         if (.not. found) cycle
         followed_trials = followed_trials + 1
         do k = 1, size(followed)
            associate (of => assembly%oscillators, creep => distances(assembly, fresh), &
               own => distances(assembly, followed(k:k)))
               furthest = max(furthest, minval(abs(creep - own(1)), mask=fresh%side == &
                  followed(k)%side)/abs(own(1)))
            end associate
            call find_vector(assembly, followed(k), expected)
            least_like = max(least_like, maxval(abs(vector(k)%x - expected%x)) &
               /maxval(abs(expected%x)))
         end do
      end do
      call check('most relaxation roots are followed: '//to_text(followed_trials), &
         followed_trials >= 36)
      call check_close('followed relaxation roots', furthest, 0.0_wp, 1e-12_wp)
      call check_close('their eigenvectors', least_like, 0.0_wp, 1e-9_wp)
   end subroutine test_continuation

   !> Distances of relaxation roots from the point of accumulation, to all digits.
   pure function distances(assembly, roots) result(creep)
      type(assembly_t), intent(in) :: assembly
      type(root_t), intent(in) :: roots(:)
      real(wp) :: creep(size(roots))
      integer :: k

      do k = 1, size(roots)
         creep(k) = assembly%oscillators%creep(roots(k)%origin, roots(k)%side - 2) &
            + real(roots(k)%offset)
      end do
   end function distances

   !> The relaxation roots of a beam with a tip mass and a support: as many as there are modes for
   !> each relaxation, all between -b and the point of accumulation, and all different, although the
   !> last ones agree with this point in three to seven digits.
   subroutine test_accumulation(relaxations)
      integer, intent(in) :: relaxations
      type(structure_t) :: structure
      type(assembly_t) :: assembly
      type(root_t), allocatable :: relaxed(:)
      type(error_t), allocatable :: error
      real(wp), allocatable :: creep(:)
      character(len=:), allocatable :: name
      integer :: j, k, l

      structure = cantilever(relaxations)
      structure%m_T = 0.3_wp
      structure%supports = 1
      structure%support(1)%x_P = 0.6_wp
      structure%support(1)%kappa_P = 0.01_wp
      assembly = assembly_of(structure, mesh_t(5, 48, 6, 1))
      call find_relaxation_roots(assembly, relaxed, error)
      name = 'accumulation, relaxations '//to_text(relaxations)//': '
      call check(name//'found', .not. allocated(error))
      if (allocated(error)) return
      call check(name//'number', size(relaxed) == relaxations*assembly%layout%n)
      do l = 1, relaxations
         creep = [real(wp) ::]
         do k = 1, size(relaxed)
            if (relaxed(k)%side /= 2 + l) cycle
            creep = [creep, distances(assembly, relaxed(k:k))]
         end do
         call check(name//'before the point', all(creep < 0) .and. all(creep > &
            -assembly%oscillators%relaxation%lag(l)))
         call check(name//'close to the point', minval(abs(creep)) < 1e-3_wp &
            *assembly%oscillators%relaxation%lag(l))
         call check(name//'all different', all([(all(abs(creep(:j - 1) - creep(j)) > 1e-3_wp &
            *abs(creep(j))), j=1, size(creep))]))
      end do
   end subroutine test_accumulation

   !> The displacement of the tip under a constant force that sets in there, c_D = .02. The known
   !> values are inverse Laplace transforms of h/s by mpmath, Talbot's method with 60 digits and
   !> 100 and 160 points, which agree in 16 digits. With z = k l, and E* the modulus at s,
   !> k**4 = -(rho s**2 + gamma s)/(E* I) and
   !> h = (sin z cosh z - cos z sinh z)/(E* I k**3 (1 + cos z cosh z)). The modes of the mesh leave
   !> 1e-10.
   subroutine test_step(relaxations)
      integer, intent(in) :: relaxations
      real(wp), parameter :: times(4) = [0.1_wp, 0.3_wp, 0.6_wp, 1.0_wp]
      real(wp), parameter :: known(4, 2) = reshape([ &
         0.03786328738067951_wp, 0.2078475290215306_wp, 0.5352749454037859_wp, &
         0.5304804382127046_wp, 0.03780348141993577_wp, 0.2070784638570093_wp, &
         0.5275999402524274_wp, 0.5107492822349478_wp], [4, 2])
      type(structure_t) :: structure
      type(excitation_t) :: excitation
      type(equations_t), target :: equations
      type(galerkin_t), target :: galerkin
      type(modal_t), allocatable :: solver
      type(response_t) :: response
      type(work_t) :: work
      type(error_t), allocatable :: error

      structure = cantilever(relaxations)
      structure%c_D = 0.02_wp
      galerkin = galerkin_of(fine, structure)
      call new_force_table([0.0_wp, 2.0_wp], [1.0_wp, 1.0_wp], excitation, error)
      equations = new_equations(galerkin, structure, excitation)
      allocate (solver)
      call solver%prepare(galerkin, error)
      if (.not. allocated(error)) call solver%respond(equations, excitation, times, response, &
         work, error)
      call check('step: a response', .not. allocated(error))
      if (allocated(error)) return
      call check_close('step, relaxations '//to_text(relaxations), &
         maxval(abs(response%displacement - known(:, relaxations))), 0.0_wp, 1e-9_wp)
   end subroutine test_step

   !> A fast relaxation is Kelvin-Voigt damping with c_D = E d/b, up to |s|/b of it; a slow one adds
   !> E d to the modulus, up to b/|s|.
   subroutine test_limits()
      real(wp), parameter :: far = 1e7_wp
      type(structure_t) :: structure
      complex(wp), allocatable :: s(:), limit(:)
      integer :: k

      structure = structure_t(length=1, rho=1, E=2, I=0.5_wp, m_T=0.2_wp, c_D=1e-3_wp)
      limit = roots_of(structure)
      structure%c_D = 0
      structure%b_1 = far
      structure%d_1 = 1e-3_wp*far/2
      s = roots_of(structure)
      do k = 1, 3
         call check_close('a fast relaxation is Kelvin-Voigt damping', abs(s(k) - limit(k)) &
            /abs(real(limit(k))), 0.0_wp, 3*abs(limit(k))/far)
      end do
      structure = structure_t(length=1, rho=1, E=2.5_wp, I=0.5_wp, m_T=0.2_wp)
      limit = roots_of(structure)
      structure%E = 2
      structure%d_1 = 0.25_wp
      structure%b_1 = 1/far
      s = roots_of(structure)
      do k = 1, 3
         call check_close('a slow relaxation adds to the modulus', abs(s(k) - limit(k)) &
            /abs(limit(k)), 0.0_wp, 1/(far*abs(limit(k))))
      end do
   end subroutine test_limits

   !> Returns the roots of a structure on eight elements.
   function roots_of(structure) result(s)
      type(structure_t), intent(in) :: structure
      complex(wp), allocatable :: s(:)
      type(equations_t) :: equations
      type(galerkin_t), target :: galerkin
      type(error_t), allocatable :: error

      galerkin = galerkin_of(mesh_t(5, 8, 6, 1), structure)
      equations = new_equations(galerkin, structure, new_pulse(1.0_wp, 1.0_wp))
      call damped_roots(equations, s, error)
      call check('limits: roots', .not. allocated(error))
      if (allocated(error)) s = [(0.0_wp, 0.0_wp), (0.0_wp, 0.0_wp), (0.0_wp, 0.0_wp)]
   end function roots_of

   !> Returns the groups of a beam with a relaxation and another E.
   function beam(E, d_1, b_1)
      real(wp), intent(in) :: E, d_1, b_1
      character(len=:), allocatable :: beam

      beam = '&beam length=0.5, width=0.03, height=0.003, density=2700, gamma=0.05, E='// &
         to_text(E)//', d_1='//to_text(d_1)//', b_1='//to_text(b_1)//' /'//nl// &
         '&tip m_T=0.01 /'//nl//'&discretization elements=8, degree=5 /'//nl
   end function beam

   !> Exact records give the parameters back: a frequency response, modes, and a pulse in time.
   subroutine test_fit()
      character(len=*), parameter :: free = '&stage free=''E'',''d_1'',''b_1'' /'//nl, &
         pulse = '&excitation kind=''pulse'', amplitude=1, duration=0.002 /'//nl, &
         response = '&record kind=''frf'', f_first=4, f_last=900, f_step=2 /'//nl
      type(outcome_t) :: outcome

      call write_file('true.nml', beam(7e10_wp, 0.03_wp, 400.0_wp)//response)
      outcome = beamid('frf true.nml --out true')
      call check('fit: a response', outcome%status == 0, outcome%err)
      call check_answer('response', beam(6.6e10_wp, 0.05_wp, 600.0_wp)// &
         '&record kind=''frf'', file=''true/frf.csv'' /'//nl//free)
      outcome = beamid('modes true.nml --out true_modes')
      call write_file('modes.csv', modal_record(read_file('true_modes/modes.csv')))
      call check_answer('modes', beam(6.6e10_wp, 0.05_wp, 600.0_wp)// &
         '&record kind=''modes'', file=''modes.csv'' /'//nl//free)
      call write_file('pulse.nml', beam(7e10_wp, 0.03_wp, 400.0_wp)//pulse// &
         '&record t_first=0, t_last=1, t_step=0.001 /'//nl)
      outcome = beamid('simulate pulse.nml --out pulse')
      call check('fit: a motion', outcome%status == 0, outcome%err)
      call check_answer('time', beam(6.99e10_wp, 0.032_wp, 420.0_wp)//pulse// &
         '&record file=''pulse/response.csv'', time_column=''t'', '// &
         'value_column=''acceleration'' /'//nl//free)
   end subroutine test_fit

   !> Checks the estimates of a case. The mesh is that of the record, and a search ends within 1e-6
   !> standard errors of the minimum: 1e-4 of the values leaves a wide margin.
   subroutine check_answer(name, text)
      character(len=*), intent(in) :: name, text

      call check_estimates(name, text, [character(len=3) :: 'E', 'd_1', 'b_1'], &
         [7e10_wp, 0.03_wp, 400.0_wp], 1e-4_wp)
   end subroutine check_answer

   !> One line and status 2: no rate, and parameters without effect at their start values; and
   !> status 1 for the modes of a modulus with two kinds of loss.
   subroutine test_refusals()
      character(len=*), parameter :: record = '&record kind=''frf'', file=''true/frf.csv'' /'//nl

      call check_refused('no rate', 2, 'modes', beam(7e10_wp, 0.03_wp, 0.0_wp), &
         '&beam d_1: found a value without b_1')
      call check_refused('d_1 from 0', 2, 'identify', beam(7e10_wp, 0.0_wp, 400.0_wp)//record// &
         '&stage free=''E'',''d_1'' /'//nl, 'found ''d_1'' from the start value 0')
      call check_refused('b_1 at d_1 = 0', 2, 'identify', beam(7e10_wp, 0.0_wp, 400.0_wp)// &
         record//'&stage free=''E'',''b_1'' /'//nl, 'found ''b_1'' beside d_1 = 0')
      call check_refused('d_1 without b_1', 2, 'identify', beam(7e10_wp, 0.0_wp, 0.0_wp)//record// &
         '&stage free=''E'',''d_1'' /'//nl, 'expected a value of b_1 in &beam')
      call check_refused('eta beside d_1', 1, 'modes', &
         '&beam length=0.5, width=0.03, height=0.003, density=2700, E=7e10, d_1=0.03, '// &
         'b_1=400, eta=0.01 /'//nl, 'found eta beside time')
   end subroutine test_refusals

end program test_time_hysteresis
