!> `beamid design`: predicted errors against those of a fit, of simulated fits and of a calculation
!> by hand; information adds up; bad input is refused.
program test_design
   use bad_cases, only: group, nl, refused
   use beamid_boxes, only: box_t
   use beamid_designs, only: compare_designs, design_t, designs_t, needed
   use beamid_equations, only: equations_t, new_equations
   use beamid_errors, only: error_t
   use beamid_excitation, only: new_free, new_pulse
   use beamid_experiments, only: experiment_t
   use beamid_galerkin, only: galerkin_t, mesh_t, new_galerkin
   use beamid_identification, only: identify, model_t, simulate, simulation_t, stage_fit_t, stage_t
   use beamid_information, only: eliminate, predict, prediction_t
   use beamid_kinds, only: wp
   use beamid_modes, only: undamped_modes
   use beamid_noise, only: gaussian_noise
   use beamid_observation, only: observation_t
   use beamid_parameters, only: free_index
   use beamid_priors, only: prior_t
   use beamid_statistics, only: unlimited
   use beamid_strings, only: to_text
   use beamid_structure, only: structure_t
   use checks, only: check, check_close, finish, in_long_run, skip
   use models, only: model_of, stage_of
   use shell, only: beamid, close_shell, exists, has_all, line_count, open_shell, outcome_t, &
      read_file, replaced, write_file
   use single_responses, only: truth => table_4_1
   use tables, only: line, longest, number
   implicit none

   type(mesh_t), parameter :: mesh = mesh_t(3, 4, 4, 1)
   character(len=3), parameter :: names(4) = ['c_D', 'm_H', 'c_H', 'k_H']
   real(wp), parameter :: values(4) = [truth%c_D, truth%hose(1)%m_H, truth%hose(1)%c_H, &
      truth%hose(1)%k_H]
   integer, parameter :: samples = 49
   real(wp), parameter :: noise = 0.01_wp
   integer :: k
   real(wp), parameter :: times(samples) = [(0.1_wp*k, k=2, samples + 1)]
   character(len=:), allocatable :: reason

   call test_algebra()
   call test_fit()
   call test_sums()
   call test_node()
   call test_unknown_start()
   call test_prior()
   call test_simulated_fits()
   call open_shell(reason)
   if (reason /= '') then
      call skip('beamid design', reason)
   else
      call test_command()
      call test_refusals()
      call close_shell()
   end if
   call finish('design')

contains

   !> Two parameters of interest and a nuisance, by hand; tolerances are some rounding errors.
   subroutine test_algebra()
      !> With the third free: [[4, 2], [2, 5]] - [2, 0]'[2, 0]/2 = [[2, 2], [2, 5]], determinant 6.
      real(wp), parameter :: whole(3, 3) = reshape([real(wp) :: 4, 2, 2, 2, 5, 0, 2, 0, 2], [3, 3])
      type(prediction_t) :: p
      real(wp) :: singular(2, 2)

      call predict(whole, [.true., .true., .false.], p)
      call check('by hand: finite', p%finite .and. .not. p%determined)
      call check_close('by hand: D', p%D, log(6.0_wp), 1e-14_wp)
      call check_close('by hand: A', p%A, 7/6.0_wp, 1e-14_wp)
      ! (7 -+ 5)/2
      call check_close('by hand: E', p%E, 1.0_wp, 1e-14_wp)
      call check_close('by hand: the other eigenvalue', p%eigenvalue(2), 6.0_wp, 1e-14_wp)
      call check_close('by hand: direction', p%direction(1, 1)/p%direction(2, 1), -2.0_wp, 1e-14_wp)
      call check_close('by hand: sd', p%sd(2), sqrt(1/3.0_wp), 1e-14_wp)
      ! The nuisance: 2 - [2, 0] inv([[4, 2], [2, 5]]) [2, 0]' = 2 - 4 5/16
      call check_close('by hand: sd of the nuisance', p%sd(3), sqrt(1/0.75_wp), 1e-14_wp)
      call check('by hand: Schur complement', all(abs(eliminate(whole, 2) - reshape([real(wp) :: &
         2, 2, 2, 5], [2, 2])) < 1e-14_wp))
      singular = 1
      call predict(singular, [.true., .false.], p)
      call check('parallel: not known', .not. p%finite .and. all(p%sd >= unlimited) .and. &
         p%D <= -unlimited .and. p%A >= unlimited .and. .not. p%E > 0)
      singular = reshape([real(wp) :: 400, 0, 0, 0], [2, 2])
      call predict(singular, [.true., .false.], p)
      call check('a nuisance of which nothing is known does no harm', p%determined .and. &
         p%sd(2) >= unlimited)
      call check_close('and the rest keeps its error', p%sd(1), 0.05_wp, 1e-15_wp)
      ! Scales 1e9 apart: correlations are decomposed, so that no digit is lost.
      singular = reshape([1e18_wp, 0.5_wp, 0.5_wp, 1e-18_wp], [2, 2])
      call predict(singular, [.true., .true.], p)
      call check_close('scales: D', p%D, log(0.75_wp), 1e-12_wp)
      call check_close('scales: E', p%E*1e18_wp, 0.75_wp, 1e-12_wp)
   end subroutine test_algebra

   !> Everything that the lists offer, at the parameters of a structure.
   subroutine designed(structure, stage, box, designs, observation)
      type(structure_t), intent(in) :: structure
      type(stage_t), intent(in) :: stage
      type(box_t), intent(in) :: box
      type(designs_t), intent(out) :: designs
      type(observation_t), intent(in), optional :: observation
      type(box_t) :: whole
      type(error_t), allocatable :: error

      whole = box
      whole%noise_sd = noise
      if (.not. allocated(whole%interest)) whole%interest = stage%free
      call compare_designs(model_of(structure, new_pulse(1.0_wp, 0.05_wp), observation), mesh, &
         stage, [planned(structure, times)], whole, designs, error)
      call check('designs are computed', .not. allocated(error))
      if (allocated(error)) print '(a)', error%message
   end subroutine designed

   !> The pulse of Table 4.1, nothing measured.
   function planned(structure, at) result(experiment)
      type(structure_t), intent(in) :: structure
      real(wp), intent(in) :: at(:)
      type(experiment_t) :: experiment

      experiment%samples = at
      experiment%measured = 0*at
      experiment%excitation = new_pulse(1.0_wp, 0.05_wp)
      experiment%sensor = structure%observer
      experiment%sd = noise
   end function planned

   !> Predicted errors at the estimates of a fit are its standard errors, noise for noise: the same
   !> derivatives, squared here. The condition number of these columns, some 10, costs no digits:
   !> 1e-9 is left for another order of sums.
   subroutine test_fit()
      type(simulation_t) :: clean
      type(stage_fit_t), allocatable :: fits(:)
      type(error_t), allocatable :: error
      type(designs_t) :: designs
      type(structure_t) :: found
      type(model_t) :: model
      type(stage_t) :: stage
      type(box_t) :: box
      integer :: offset

      model = model_of(truth, new_pulse(1.0_wp, 0.05_wp))
      call simulate(model, mesh, times, clean, error)
      do offset = 0, 1
         stage = stage_of(names, values, offset == 1)
         if (.not. allocated(error)) call identify(model, mesh, [stage], times, &
            clean%acceleration + gaussian_noise(samples, noise, 12), fits, error)
         call check('a fit to compare with', .not. allocated(error))
         if (allocated(error)) return
         found = truth
         do k = 1, 4
            call found%set(fits(1)%free(k), fits(1)%fit%estimate(k))
         end do
         call designed(found, stage, box, designs)
         associate (s => fits(1)%statistics)
            do k = 1, 4
               call check_close('as the fit has it, '//names(k)//', offsets '//to_text(offset), &
                  designs%present%prediction%sd(k)*designs%quantities(k)%scale/noise, &
                  s%std_error(k)/sqrt(s%variance), 1e-9_wp*s%std_error(k)/sqrt(s%variance))
            end do
         end associate
         call check('empty lists: the present experiment alone', size(designs%list) == 1)
         call check('which is a design too', all(abs(designs%list(1)%information - &
            designs%present%information) <= 1e-9_wp*maxval(abs(designs%present%information))))
      end do
   end subroutine test_fit

   !> The information of two windows is that of both together, of two sensors the sum of theirs,
   !> and that of two channels of one motion, each with its own offset.
   subroutine test_sums()
      type(designs_t) :: designs, pairs
      type(experiment_t) :: two(2)
      type(structure_t) :: both
      type(error_t), allocatable :: error
      type(stage_t) :: stage
      type(box_t) :: box
      integer :: first, second

      stage = stage_of(names, values)
      ! From .2 by .1 up to 2.5 or 5, and from 2.6 on; times in no particular order.
      box%first = [2.6_wp, 0.2_wp]
      box%last = [5.0_wp, 2.5_wp]
      call designed(truth, stage, box, designs)
      call check('windows: one that ends before it begins is none', size(designs%list) == 3)
      if (size(designs%list) /= 3) return
      call check('windows: samples', all(designs%list%samples == [24, 49, 25]))
      call same('windows add up', designs%list(1)%information + designs%list(3)%information, &
         designs%list(2)%information)
      box = box_t(x_S=[1.5_wp, 4.0_wp, 3.0_wp], x_F=[4.0_wp, 2.0_wp], duration=[0.05_wp, 0.02_wp], &
         step=[0.1_wp, 0.05_wp])
      stage = stage_of(names, values, .true.)
      call designed(truth, stage, box, designs)
      box%sensors = 2
      call designed(truth, stage, box, pairs)
      call check('24 designs, and 24 with pairs', size(designs%list) == 24 .and. &
         size(pairs%list) == 24)
      if (size(pairs%list) /= 24) return
      do k = 1, size(pairs%list)
         associate (pair => pairs%list(k))
            first = single(designs, pair, 1)
            second = single(designs, pair, 2)
            if (first*second == 0) call check('pair '//to_text(k), .false.)
            if (first*second == 0) cycle
            call same('pair '//to_text(k), designs%list(first)%information + &
               designs%list(second)%information, pair%information)
         end associate
      end do
      both = truth
      both%sensors = 2
      both%sensor(:2)%x_S = [1.5_wp, 4.0_wp]
      do k = 1, 2
         both%observer = k
         two(k) = planned(both, times)
         two(k)%motion = 1
      end do
      box = box_t(noise_sd=noise, interest=stage%free)
      call compare_designs(model_of(both, new_pulse(1.0_wp, 0.05_wp)), mesh, stage, two, box, &
         designs, error)
      call check('channels are computed', .not. allocated(error))
      if (allocated(error)) return
      do k = 1, size(pairs%list)
         associate (pair => pairs%list(k))
            if (any(abs([pair%x_S - [1.5_wp, 4.0_wp], pair%x_F - 4, pair%duration - 0.05_wp, &
               pair%step - 0.1_wp]) > 1e-9_wp)) cycle
            call same('channels of one motion', pair%information, designs%present%information)
         end associate
      end do
   end subroutine test_sums

   !> The design with one sensor of a pair, all else alike; 0: none.
   integer function single(designs, pair, which) result(place)
      type(designs_t), intent(in) :: designs
      type(design_t), intent(in) :: pair
      integer, intent(in) :: which

      do place = size(designs%list), 1, -1
         associate (one => designs%list(place))
            if (all(abs([one%x_S(1) - pair%x_S(which), one%x_F - pair%x_F, one%duration &
               - pair%duration, one%step - pair%step]) <= 0)) return
         end associate
      end do
   end function single

   !> Sums in another order.
   subroutine same(what, a, b)
      character(len=*), intent(in) :: what
      real(wp), intent(in) :: a(:, :), b(:, :)

      call check(what, all(abs(a - b) <= 1e-11_wp*maxval(abs(b))))
   end subroutine same

   !> A beam that a single cubic holds has two modes, which c_D and gamma damp without mixing them.
   !> At the node of the second a sensor sees the first alone, of which both make the one decay
   !> rate: nothing tells them apart. Beside it something does.
   subroutine test_node()
      type(mesh_t), parameter :: coarse = mesh_t(3, 1, 4, 1)
      type(structure_t) :: beam
      type(galerkin_t), target :: galerkin
      type(equations_t) :: equations
      type(designs_t) :: designs
      type(stage_t) :: stage
      type(box_t) :: box
      type(error_t), allocatable :: error
      real(wp), allocatable :: omega(:), shapes(:, :)
      real(wp) :: low, high, x

      beam = structure_t(length=4, rho=0.03_wp, E=80, I=1, c_D=0.005_wp, gamma=0.01_wp)
      galerkin = new_galerkin(coarse, beam%length)
      equations = new_equations(galerkin, beam, new_pulse(1.0_wp, 0.05_wp))
      call undamped_modes(equations, omega, shapes, error)
      call check('two modes', .not. allocated(error) .and. size(omega) == 2)
      if (allocated(error)) return
      low = 2
      high = 4
      do k = 1, 60
         x = (low + high)/2
         if (dot_product(galerkin%space%at(x, 0), shapes(:, 2)) &
            *dot_product(galerkin%space%at(4.0_wp, 0), shapes(:, 2)) > 0) then
            high = x
         else
            low = x
         end if
      end do
      stage = stage_of(['c_D  ', 'gamma'])
      box = box_t(x_S=[x, x + 0.05_wp], noise_sd=noise, interest=stage%free)
      call compare_designs(model_of(beam, new_pulse(1.0_wp, 0.05_wp)), coarse, stage, &
         [planned(beam, times)], box, designs, error)
      call check('node: computed', .not. allocated(error))
      if (allocated(error)) return
      associate (at_node => designs%list(1)%prediction, beside => designs%list(2)%prediction)
         call check('node: nothing tells c_D from gamma', .not. at_node%finite, &
            to_text(at_node%sd(1)))
         call check('beside the node: something does', beside%finite)
      end associate

   end subroutine test_node

   !> Where the start counts as unknown, the errors are those of such a fit, here of a record
   !> without noise and of all three modes that the mesh has: the fit leaves round-off, of which
   !> errors in its own unit are known to the digits of its estimates, 1e-6. A known start tells
   !> more.
   subroutine test_unknown_start()
      type(mesh_t), parameter :: coarse = mesh_t(3, 1, 4, 1)
      integer, parameter :: modes = 3
      type(model_t) :: model, loose
      type(simulation_t) :: clean
      type(stage_fit_t), allocatable :: fits(:)
      type(designs_t) :: designs, known
      type(stage_t) :: stage
      type(box_t) :: box
      type(error_t), allocatable :: error

      model = model_of(truth, new_pulse(1.0_wp, 0.05_wp))
      loose = model_of(truth, new_free(modes))
      stage = stage_of(names, values*[0.95_wp, 1.02_wp, 0.98_wp, 1.01_wp], .true.)
      box = box_t(noise_sd=noise, interest=stage%free, modes=modes, duration=[0.05_wp, 0.1_wp])
      call simulate(model, coarse, times, clean, error)
      if (.not. allocated(error)) call identify(loose, coarse, [stage], times, clean%acceleration, &
         fits, error)
      if (.not. allocated(error)) call compare_designs(model, coarse, stage, [planned(truth, &
         times)], box, designs, error)
      box%modes = 0
      if (.not. allocated(error)) call compare_designs(model, coarse, stage, [planned(truth, &
         times)], box, known, error)
      call check('unknown start: computed', .not. allocated(error))
      if (allocated(error)) return
      associate (s => fits(1)%statistics, p => designs%list(1)%prediction)
         do k = 1, 4
            call check_close('unknown start: '//names(k), &
               p%sd(k)*designs%quantities(k)%scale/noise, s%std_error(k)/sqrt(s%variance), &
               1e-6_wp*s%std_error(k)/sqrt(s%variance))
         end do
         call check('a known start tells more', all(known%list(1)%prediction%sd < p%sd))
      end associate
      box%modes = modes
      box%duration = [0.05_wp, 0.3_wp]
      call compare_designs(model, coarse, stage, [planned(truth, times)], box, designs, error)
      call check('samples while the force acts', allocated(error))
   end subroutine test_unknown_start

   !> A prior is information (value/sd)**2 at its place; how often a record has to be repeated is
   !> 1/ratio**2 without one, and more with it; of what nothing is known no number is enough.
   subroutine test_prior()
      type(designs_t) :: designs
      type(design_t) :: nothing
      type(model_t) :: model
      type(stage_t) :: stage
      type(box_t) :: box
      type(error_t), allocatable :: error
      real(wp) :: sd

      model = model_of(truth, new_pulse(1.0_wp, 0.05_wp))
      stage = stage_of(names, values)
      box = box_t(noise_sd=noise, interest=[free_index('m_H')])
      call compare_designs(model, mesh, stage, [planned(truth, times)], box, designs, error)
      call check('prior: none', .not. allocated(error))
      if (allocated(error)) return
      sd = designs%present%prediction%sd(2)
      call check_close('repetitions for half the error', needed(designs, designs%present, sd/2), &
         4.0_wp, 1e-6_wp)
      model%priors = [prior_t(name='m_H', parameter=[free_index('m_H')], slope=[1.0_wp], &
         sd=sd*truth%hose(1)%m_H)]
      call compare_designs(model, mesh, stage, [planned(truth, times)], box, designs, error)
      call check('prior: one', .not. allocated(error))
      if (allocated(error)) return
      call check_close('a prior as good as the record', designs%present%prediction%sd(2), &
         sd/sqrt(2.0_wp), 1e-9_wp*sd)
      ! 1/sd**2 of the prior and 3/sd**2 of the record.
      call check_close('repetitions beside a prior', needed(designs, designs%present, sd/2), &
         3.0_wp, 1e-6_wp)
      nothing = designs%present
      nothing%information = 0
      call check('of nothing no number is enough', needed(designs, nothing, sd/2) < 0)
   end subroutine test_prior

   !> Standard deviations of the estimates of many fits against the predicted ones, for ten designs.
   !> Noise is so small (.5 % and less) that linear theory holds; the deviation of 2,000 estimates
   !> has itself an error of 1/sqrt(2*2000) = 1.6 %, so that 5 % are three of these. Every day 200
   !> fits of the first two designs, and 15 %.
   subroutine test_simulated_fits()
      real(wp), parameter :: tip = 4
      integer, parameter :: most = 10
      type(observation_t), parameter :: formulas(2) = [observation_t(), &
         observation_t(1, 0.1_wp)]
      real(wp), parameter :: x_S(most) = [tip, 2.0_wp, 3.0_wp, tip, 2.5_wp, tip, 3.5_wp, 1.5_wp, &
         tip, 3.0_wp]
      real(wp), parameter :: x_F(most) = [tip, tip, 2.0_wp, 3.0_wp, 2.5_wp, tip, tip, 3.5_wp, &
         1.0_wp, tip]
      real(wp), parameter :: duration(most) = 0.01_wp*[5, 20, 10, 50, 5, 100, 5, 20, 50, 10]
      real(wp), parameter :: t_last(most) = 0.1_wp*[50, 50, 80, 60, 100, 50, 75, 100, 80, 120]
      real(wp), parameter :: t_step(most) = 0.01_wp*[10, 5, 10, 15, 20, 10, 5, 10, 10, 30]
      type(experiment_t) :: experiment
      type(structure_t) :: beam
      type(model_t) :: model
      type(stage_t) :: stage
      type(stage_fit_t), allocatable :: fits(:)
      type(simulation_t) :: clean
      type(designs_t) :: designs
      type(error_t), allocatable :: error
      real(wp), allocatable :: estimates(:, :), drawn(:)
      real(wp) :: ratio(4), tolerance
      integer :: d, n, p, r

      n = merge(2000, 200, in_long_run())
      tolerance = merge(0.05_wp, 0.15_wp, in_long_run())
      do d = 1, merge(most, 2, in_long_run())
         stage = stage_of(names, values, mod(d, 3) == 0)
         call designed(truth, stage, box_t(x_S=[x_S(d)], x_F=[x_F(d)], duration=[duration(d)], &
            last=[t_last(d)], step=[t_step(d)]), designs, formulas(1 + mod(d, 2)))
         beam = truth
         beam%sensors = 1
         beam%sensor(1)%x_S = x_S(d)
         beam%x_F = x_F(d)
         model = model_of(beam, new_pulse(1.0_wp, duration(d)), formulas(1 + mod(d, 2)))
         experiment%samples = [(0.2_wp + r*t_step(d), r=0, designs%list(1)%samples - 1)]
         experiment%excitation = model%excitation
         call simulate(model, mesh, experiment%samples, clean, error)
         call check('simulated', .not. allocated(error) .and. &
            abs(experiment%samples(size(experiment%samples)) - t_last(d)) < t_step(d))
         if (allocated(error)) return
         if (allocated(estimates)) deallocate (estimates)
         allocate (estimates(4, n))
         drawn = gaussian_noise(n*size(experiment%samples), noise/4, 100 + d)
         do r = 1, n
            experiment%measured = clean%acceleration &
               + drawn((r - 1)*size(experiment%samples) + 1:r*size(experiment%samples))
            call identify(model, mesh, [stage], [experiment], fits, error, check=.false.)
            if (allocated(error)) exit
            estimates(:, r) = fits(1)%fit%estimate
         end do
         call check('design '//to_text(d)//': every fit converges', .not. allocated(error))
         if (allocated(error)) cycle
         do p = 1, 4
            associate (e => estimates(p, :))
               ratio(p) = designs%list(1)%prediction%sd(p)*designs%quantities(p)%scale/4 &
                  /sqrt(sum((e - sum(e)/n)**2)/(n - 1))
            end associate
            call check_close('design '//to_text(d)//': predicted over simulated error of '// &
               names(p), ratio(p), 1.0_wp, tolerance)
         end do
         print '(a,i0,a,4f8.4,a,4f8.4)', '      design ', d, ': predicted over simulated', ratio, &
            '; relative', designs%list(1)%prediction%sd/4
      end do
   end subroutine test_simulated_fits

   !> Tables and summary of a small case; a target that is reached, and one that is not.
   subroutine test_command()
      character(len=*), parameter :: case_text = &
         '&beam length=4.0, rho=0.03, E=80.0, I=1.0, c_D=0.005 /'//nl// &
         '&tip m_T=0.15 /'//nl//'&hose m_H=0.04, c_H=0.004, k_H=0.3 /'//nl// &
         '&excitation kind=''pulse'', amplitude=1.0, duration=0.05 /'//nl// &
         '&record t_first=0.2, t_last=5.0, t_step=0.1 /'//nl//'&noise sd=0.02 /'//nl// &
         '&stage free=''c_D'',''m_H'',''offset'' /'//nl// &
         '&design x_S=''auto'', x_F=2,4, t_last=5,2'
      type(outcome_t) :: outcome
      character(len=:), allocatable :: table

      call write_file('case.nml', case_text//', target=0.05 /'//nl)
      outcome = beamid('design case.nml')
      call check('design: status 0', outcome%status == 0 .and. outcome%err == '', outcome%err)
      call check('design: summary', has_all(outcome%out, '80 experiments|of interest: c_D, m_H|'// &
         'present|best by D|least known combination|is at the end of t_last|'// &
         'experiments reach it') .and. longest(outcome%out) <= 100, outcome%out)
      table = read_file('out/case/design.csv')
      call check('design.csv: a row for each, and the present one', line_count(table) == 82)
      call check('design.csv: header', index(table, 'design,x_S,x_S_2,x_F,duration,t_first,'// &
         't_last,t_step,samples,determined,D,A,E,sd_c_D,sd_m_H,relative_c_D,relative_m_H'//nl) == 1)
      call check_close('design.csv: sd is relative times value', number(line(table, 2), 14), &
         0.005_wp*number(line(table, 2), 16), 1e-15_wp)
      ! The tip with the pulse at the tip is the last place twice over: rows 81 and 82, t_last 2, 5.
      call check_close('design.csv: the present one is among them', number(line(table, 82), 14), &
         number(line(table, 2), 14), 1e-9_wp*number(line(table, 2), 14))
      call write_file('case.nml', case_text//', target=1e-6, parameters=''c_D'' /'//nl)
      outcome = beamid('design case.nml --out far')
      call check('design: a target out of reach', has_all(outcome%out, 'none of the '// &
         'experiments reaches it|repeated|amplitude') .and. exists('far/design.csv') .and. &
         longest(outcome%out) <= 100, outcome%out)
      call write_file('case.nml', replaced(case_text, '&noise', '&record t_first=0.2, '// &
         't_last=5.0, t_step=0.1 /'//nl//'&noise')//' /'//nl)
      outcome = beamid('design case.nml --out two')
      call check('design: two records, designs of one', has_all(outcome%out, '''present'' has '// &
         'the 2 records of the case, a design has 1'), outcome%err//outcome%out)
   end subroutine test_command

   subroutine test_refusals()
      character(len=*), parameter :: box = 'noise_sd=1'

      call refuse('no group', '', '&design|no such group')
      call refuse('no noise', group('design', 'x_S=1'), '&design noise_sd|nothing')
      call refuse('off the beam', group('design', 'x_S=1,4.5, '//box), '&design x_S|4.5|4')
      call refuse('at the clamp', group('design', 'x_F=0, '//box), '&design x_F|found 0|above 0')
      call refuse('a word', group('design', 'x_S=''all'', '//box), '&design x_S|''auto''')
      call refuse('twice', group('design', 'duration=1,2,1, '//box), '&design duration|1 twice')
      call refuse('no step', group('design', 't_step=0, '//box), '&design t_step|above 0')
      call refuse('three sensors', group('design', 'sensors=3, x_S=1,2,3, '//box), &
         '&design sensors|1 to 2')
      call refuse('two sensors of an unknown start', group('design', 'sensors=2, x_S=1,2, '// &
         'modes=2, '//box), '&design sensors|2 beside modes')
      call refuse('samples while the force acts', group('design', 'duration=0.05,0.2, modes=2, '// &
         box), '&design|samples from 0.1|ended at 0.2')
      call refuse('two sensors at one place', group('design', 'sensors=2, x_S=1, '//box), &
         '&design sensors|two or more')
      call refuse('a parameter that is held', group('design', 'parameters=''E'', '//box), &
         '&design parameters|''E''|free in the last stage')
      call refuse('no parameter', group('design', 'parameters=''x'', '//box), &
         '&design parameters|''x''')
      call refuse('no target', group('design', 'target=0, '//box), '&design target|above 0')
      call refuse('no noise at all', group('design', 'noise_sd=0'), '&design noise_sd|above 0')
      call refuse('an unknown key', group('design', 'x=1'), '&design x|unknown key')
      call refuse('windows that end before they begin', group('design', 't_first=2, t_last=1, '// &
         box), '&design|found 0 experiments')
      call refuse('steps without end', group('design', 't_step=1e-9, '//box), &
         '&design|sample times')
      call refused('a start that is not known', 'kind=''pulse'', amplitude=1.0, '// &
         'duration=0.05,'//nl//'                load=''point'', power=2.0', 'kind=''free''', &
         '&design|no such group', 'design')
      call refused('lengths of no pulse', 'kind=''pulse'', amplitude=1.0, '// &
         'duration=0.05,'//nl//'                load=''point'', power=2.0 /', &
         'kind=''release'', force=1 /'//group('design', 'duration=1,2, '//box), &
         '&design duration|pulse', 'design', lines=1)
   end subroutine test_refusals

   !> The good case with a group &design.
   subroutine refuse(what, design, words)
      character(len=*), intent(in) :: what, design, words

      call refused(what, 'upper=1,10 /', 'upper=1,10 /'//design, words, 'design', &
         lines=1)
   end subroutine refuse

end program test_design
