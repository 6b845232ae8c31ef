!> Readers of the groups of a case file that choose numerical methods: mesh, solver, observation
!> formula, multiple starts, windows, sampling and bootstrap. `beamid_case_files` calls them.
module beamid_method_groups
   use beamid_blocks, only: block_t
   use beamid_bootstraps, only: blocks, bootstrap_plan_t, by_judgement, parametric
   use beamid_cvode, only: cvode_t
   use beamid_galerkin, only: mesh_t
   use beamid_kinds, only: wp, ip
   use beamid_modal, only: modal_t
   use beamid_multistart, only: multistart_t
   use beamid_observation, only: from_acceleration, observation_t
   use beamid_responses, only: solver_t
   use beamid_sampling, only: chains, plan_t
   use beamid_strings, only: to_text
   use beamid_values, only: positive, range_t
   implicit none
   private

   public :: read_bootstrap, read_discretization, read_integrator, read_multistart, &
      read_observation, read_sample, read_windows

   !> Names of the observation formulas, by their numbers: equations (4.1), (4.2) and (3.13).
   character(len=*), parameter, public :: formula_names(3) = &
      [character(len=23) :: 'displacement_difference', 'velocity_difference', 'equation']

contains

   !> Reads the group &discretization.
   !>
   !> meshes   one mesh for each number of elements
   !> refines  on return, whether elements='auto': a fit refines the mesh itself
   subroutine read_discretization(block, meshes, refines)
      type(block_t), intent(inout) :: block
      type(mesh_t), allocatable, intent(inout) :: meshes(:)
      logical, intent(inout) :: refines
      type(mesh_t) :: mesh
      character(len=4) :: word
      character(len=:), allocatable :: knots
      integer, allocatable :: elements(:)
      integer :: k

      call block%get('degree', mesh%degree, 'degree of the splines', &
         choices=['3', '5', '7'])
      call block%get('elements', elements, '''auto''', 'number of elements, or several '// &
         'numbers to compute with each; ''auto'': identify, compare, simulate, '// &
         'modes, frf and track refine the mesh until their results converge, and other '// &
         'commands use 8 elements', 50, &
         range_t(1, 10000), ['auto'], word)
      call block%get('gauss_points', mesh%gauss_points, 'number of Gauss points in each panel', &
         range_t(1, 64), default='degree + 1, which integrates exactly')
      call block%get('panels', mesh%panels, 'number of panels in each element', range_t(1, 1000))
      knots = 'attachments'
      call block%get('knots', knots, 'knots of the splines: ''attachments'', at equal '// &
         'distances and at every force, mass, hose and support inside the beam whose position '// &
         'is not estimated; ''uniform'', at equal distances alone', &
         [character(len=11) :: 'attachments', 'uniform'])
      if (all(mesh%degree /= [3, 5, 7])) call block%refuse('degree', to_text(mesh%degree), &
         '3, 5 or 7')
      call block%close()
      if (block%failed()) return
      if (.not. block%has('gauss_points')) mesh%gauss_points = mesh%degree + 1
      if (mesh%gauss_points*mesh%panels < mesh%degree - 1) call block%refuse('gauss_points', &
         to_text(mesh%gauss_points*mesh%panels)//' points per element', &
         'at least degree - 1 = '//to_text(mesh%degree - 1))
      refines = .not. allocated(elements)
      if (refines) elements = [mesh%elements]
      do k = 2, size(elements)
         if (.not. any(elements(:k - 1) == elements(k))) cycle
         call block%refuse('elements', to_text(elements(k))//' twice', 'each number once')
         return
      end do
      meshes = [(mesh_t(mesh%degree, elements(k), mesh%gauss_points, mesh%panels, &
         knots == 'attachments'), k=1, size(elements))]
   end subroutine read_discretization

   !> Reads the group &integrator.
   subroutine read_integrator(block, chosen)
      type(block_t), intent(inout) :: block
      class(solver_t), allocatable, intent(inout) :: chosen
      type(cvode_t) :: solver
      character(len=:), allocatable :: method
      real(wp), allocatable :: atol
      integer :: max_steps

      method = 'modal'
      max_steps = int(solver%max_steps)
      call block%get('method', method, 'method of the response in time: ''modal'', exact; '// &
         '''cvode'', integration step by step', ['modal', 'cvode'])
      call block%get('rtol', solver%rtol, 'relative tolerance of cvode', &
         range_t(1e-14_wp, 0.1_wp))
      call block%get('atol', atol, 'rtol times an estimate of the displacement', &
         'absolute tolerance of cvode for the displacement', positive)
      call block%get('max_order', solver%max_order, 'highest order of cvode', range_t(1, 5))
      call block%get('max_steps', max_steps, 'largest number of steps of cvode', &
         range_t(1, huge(max_steps)))
      call block%close()
      solver%max_steps = int(max_steps, ip)
      if (allocated(atol)) solver%atol = atol
      if (method == 'modal') then
         chosen = modal_t()
      else
         chosen = solver
      end if
   end subroutine read_integrator

   !> Reads the group &multistart.
   subroutine read_multistart(block, plan)
      type(block_t), intent(inout) :: block
      type(multistart_t), intent(inout) :: plan

      plan%n = 20
      call block%get('n', plan%n, 'number of starts', range_t(1, 100000))
      call block%get('seed', plan%seed, 'seed of the random numbers')
      call block%get('spread', plan%spread, 'factor s of the range of start values, from '// &
         'value/s to value*s around the declared start value', range_t(1, 1e6_wp, open=.true.))
      call block%close()
   end subroutine read_multistart

   !> Reads the group &windows.
   !>
   !> n  number of windows; remains 0 if the case has no such group
   subroutine read_windows(block, n)
      type(block_t), intent(inout) :: block
      integer, intent(inout) :: n

      n = 4
      call block%get('n', n, 'number of consecutive windows of equal duration', &
         range_t(2, 100))
      call block%close()
   end subroutine read_windows

   !> Reads the group &sample; rounds the number of draws up to a multiple of the number of chains.
   subroutine read_sample(block, plan)
      type(block_t), intent(inout) :: block
      type(plan_t), intent(inout) :: plan
      character(len=:), allocatable :: method, noise

      method = 'auto'
      noise = 'auto'
      call block%get('draws', plan%draws, 'number of draws from the posterior', &
         range_t(100*chains, 10000000))
      call block%get('seed', plan%seed, 'seed of the random numbers')
      call block%get('method', method, 'sampling method: ''auto'', importance sampling, or '// &
         'Markov chains if the weights degenerate; ''chains'', always Markov chains', &
         [character(len=6) :: 'auto', 'chains'])
      call block%get('noise', noise, 'model of the noise: ''auto'', autoregressive if the '// &
         'residuals are not white, else white; ''white'', always white', &
         [character(len=5) :: 'auto', 'white'])
      call block%close()
      plan%draws = chains*((plan%draws + chains - 1)/chains)
      plan%importance = method == 'auto'
      plan%coloured = noise == 'auto'
   end subroutine read_sample

   !> Reads the group &bootstrap.
   subroutine read_bootstrap(block, plan)
      type(block_t), intent(inout) :: block
      type(bootstrap_plan_t), intent(inout) :: plan
      character(len=:), allocatable :: kind

      kind = 'auto'
      call block%get('n', plan%n, 'number of resampled records', range_t(100, 1000000))
      call block%get('seed', plan%seed, 'seed of the random numbers')
      call block%get('kind', kind, 'resampling method: ''parametric'', normal noise; '// &
         '''blocks'', blocks of the residuals; ''auto'', blocks if the residuals are not white', &
         [character(len=10) :: 'auto', 'parametric', 'blocks'])
      call block%get('block', plan%block, 'number of samples in a block', range_t(1, huge(1)), &
         default='chosen from the residuals')
      call block%close()
      plan%kind = by_judgement
      if (kind == 'parametric') plan%kind = parametric
      if (kind == 'blocks') plan%kind = blocks
   end subroutine read_bootstrap

   !> Reads the group &observation.
   subroutine read_observation(block, observed)
      type(block_t), intent(inout) :: block
      type(observation_t), intent(inout) :: observed
      character(len=:), allocatable :: formula, frame
      real(wp), allocatable :: delta

      formula = trim(formula_names(observed%formula))
      call block%get('formula', formula, 'formula of the observed acceleration: by the '// &
         'differences (4.1) of the displacement or (4.2) of the velocity, or by equation '// &
         '(3.13) of the paper', formula_names)
      call block%get('delta', delta, 'required with both difference formulas', &
         'time step of the difference formulas', positive)
      frame = 'absolute'
      call block%get('frame', frame, 'frame of reference of the acceleration: ''absolute'', '// &
         'the ground; ''relative'', the base that moves', ['absolute', 'relative'])
      call block%close()
      if (block%failed()) return
      observed%relative = frame == 'relative'
      observed%formula = findloc(formula_names == formula, .true., dim=1)
      if (observed%formula == from_acceleration) then
         call block%exclude('delta', 'with formula = ''equation''')
      else
         call block%require('delta')
         if (allocated(delta)) observed%delta = delta
      end if
   end subroutine read_observation

end module beamid_method_groups
