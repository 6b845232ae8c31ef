!> A fit's problem with a mistake in it.
module mistakes
   use beamid_errors, only: error_t
   use beamid_kinds, only: wp
   use beamid_problems, only: smooth_problem_t
   use beamid_residuals, only: residual_t
   implicit none
   private

   public :: mistaken_t

   !> A problem whose derivative by one parameter is wrong by a factor. It keeps all residuals that
   !> it has computed, because all checks of one structure ask for those at the same points.
   type, extends(smooth_problem_t) :: mistaken_t
      type(residual_t) :: right
      integer :: column = 0
      real(wp) :: factor = 1
      !> (n, points), (m, points) points and their residuals
      real(wp), allocatable :: points(:, :), known(:, :)
   contains
      procedure :: residuals
      procedure :: jacobian
   end type mistaken_t

contains

   subroutine residuals(self, parameters, r, error)
      class(mistaken_t), intent(inout) :: self
      real(wp), intent(in) :: parameters(:)
      real(wp), intent(out) :: r(:)
      type(error_t), allocatable, intent(out) :: error
      integer :: k, n, points

      n = size(parameters)
      points = 0
      if (allocated(self%points)) points = size(self%points, 2)
      do k = 1, points
         if (any(abs(self%points(:, k) - parameters) > 0)) cycle
         r = self%known(:, k)
         return
      end do
      call self%right%residuals(parameters, r, error)
      if (allocated(error)) return
      if (points == 0) allocate (self%points(n, 0), self%known(size(r), 0))
      self%points = reshape([self%points, parameters], [n, points + 1])
      self%known = reshape([self%known, r], [size(r), points + 1])
   end subroutine residuals

   subroutine jacobian(self, parameters, r, jac, error)
      class(mistaken_t), intent(inout) :: self
      real(wp), intent(in) :: parameters(:)
      real(wp), intent(out) :: r(:), jac(:, :)
      type(error_t), allocatable, intent(out) :: error

      call self%right%jacobian(parameters, r, jac, error)
      if (self%column > 0) jac(:, self%column) = self%factor*jac(:, self%column)
   end subroutine jacobian

end module mistakes

!> The tables of parameters and terms: every row is whole, and the check of derivatives that a fit
!> makes finds a derivative that is not that of the model, whichever parameter it belongs to.
program test_terms
   use beamid_assembly, only: assembly_t, new_assembly
   use beamid_blocks, only: block_t
   use beamid_case_files, only: list_keys
   use beamid_errors, only: error_t
   use beamid_excitation, only: excitation_t, new_base_motion, new_pulse, new_release
   use beamid_experiments, only: experiment_t
   use beamid_galerkin, only: galerkin_t, mesh_t, new_galerkin
   use beamid_kinds, only: wp
   use beamid_modes, only: bare_beam_modes, beam_modes_t
   use beamid_parameter_names, only: is_there, name_of_parameter
   use beamid_parameters, only: amplitude, any_value, key_of, magnitude, not_negative, on_beam, &
      parameters, positive
   use beamid_problems, only: compare_derivatives
   use beamid_residuals, only: new_residuals
   use beamid_strings, only: to_text
   use beamid_structure, only: at_tip, n_parameters, of_a_h, of_b, of_b_h, of_c_R, of_d, of_eta, &
      of_g, of_kappa_R, of_length, of_T, of_x_F, structure_t, x_H_at, x_M_at, x_S_at
   use beamid_structure_checks, only: check_structure
   use beamid_terms, only: end_condition, of_compliance, of_damping, of_mass, operators, &
      operators_of, strengths, strengths_and_slopes, terms
   use beamid_units, only: units_t
   use beamid_variables, only: new_variable, unbounded, variable_t
   use checks, only: check, check_close, finish, held_root, in_long_run
   use mistakes, only: mistaken_t
   use models, only: model_of
   use random_numbers, only: decades, start_random, uniform
   implicit none

   !> Places of the parameters of a structure with two attachments of each kind.
   integer, allocatable :: places(:)

   call start_random(20250707)
   call test_rows()
   call test_grounded()
   call test_derivatives()
   call test_mistakes(merge(1000, 3, in_long_run()))
   call finish('terms')

contains

   !> A beam whose parameters all have a value: the first frequency about 1, the others within
   !> decades of what is moderate.
   !>
   !> spread  decades to either side
   type(structure_t) function random_structure(spread) result(s)
      real(wp), intent(in) :: spread
      integer :: k

      s%length = decades(-0.5_wp, 0.5_wp)
      s%rho = decades(-1.0_wp, 1.0_wp)
      s%E = decades(-1.0_wp, 1.0_wp)
      s%I = s%length**3*decades(-0.5_wp, 0.5_wp)
      s%sensors = 2
      s%sensor_name(:2) = ['a', 'b']
      s%supports = 2
      s%support_name(:2) = ['p', 'q']
      s%support%kappa_RP = 0
      s%masses = 2
      s%mass_name(:2) = ['m', 'n']
      s%hoses = 2
      s%hose_name(:2) = ['h', 'k']
      do k = 1, n_parameters
         if (.not. is_there(s, k)) cycle
         if (parameters(k)%range == on_beam) then
            call s%set(k, s%length*(0.2_wp + 0.75_wp*uniform()))
         else if (any(k == [of_d, of_b])) then
            call s%set(k, magnitude(s, k))
         else if (.not. (s%get(k) > 0)) then
            call s%set(k, magnitude(s, k)*decades(-spread, spread))
         end if
      end do
   end function random_structure

   !> What a row says of itself, its key in the case file, and that it does something.
   subroutine test_rows()
      type(units_t) :: units
      type(block_t), allocatable :: groups(:)
      type(structure_t) :: s, wrong
      type(error_t), allocatable :: error
      type(galerkin_t) :: galerkin
      type(beam_modes_t) :: modes
      type(assembly_t) :: assembly
      type(excitation_t) :: base
      character(len=:), allocatable :: name
      integer :: g, j, k

      call list_keys(groups)
      s = random_structure(0.5_wp)
      galerkin = new_galerkin(mesh_t(3, 4, 4, 1), s%length, held_root(.true.))
      call bare_beam_modes(galerkin, modes, error)
      call check('a structure of everything', .not. allocated(error))
      assembly = new_assembly(s, modes, [(k, k=1, n_parameters)])
      units = units_t('ft', 'lb', 's', 'slug')
      call check('unit of c_R', units%of_parameter(of_c_R) == 'lb ft s')
      call check('unit of a pulse', units%of_quantity(amplitude, new_pulse(1.0_wp, 1.0_wp)) == 'lb')
      call check('unit of a release', units%of_quantity(amplitude, new_release(1.0_wp, 0.0_wp, &
         .true.)) == 'ft')
      call new_base_motion([0.0_wp, 1.0_wp], [0.0_wp, 1.0_wp], base, error)
      call check('unit of a base that moves', units%of_quantity(amplitude, base) == 'ft/s^2')
      do k = 1, n_parameters
         name = trim(name_of_parameter(s, k))
         if (.not. is_there(s, k)) cycle
         call check(name//': help', parameters(k)%help /= '')
         call check(name//': unit', (units%of_parameter(k) == '') .eqv. all(parameters(k)%unit &
            == 0), units%of_parameter(k))
         g = findloc([(groups(j)%name == parameters(k)%group, j=1, size(groups))], .true., dim=1)
         call check(name//': a group', g > 0)
         if (g > 0) call check(name//': a key', any(groups(g)%keys%name == &
            key_of(k)))
         call check(name//': one name', count(name_of_parameter(s, parameters%place) == name .and. &
            is_there(s, parameters%place)) == 1)
         call check(name//': does something', any(abs(strength_slopes(s, s%length, k)) > 0) &
            .or. any(abs(assembly%sensitivities%change(:, :, k)) > 0) &
            .or. any(abs(assembly%layout%moves(:, k)) > 0) &
            .or. any(abs(assembly%dense%matrix(:, :, :, k)) > 0) &
            .or. any(abs(assembly%load%remainder(:, k)) > 0))
         wrong = s
         call wrong%set(k, -1.5_wp)
         call check_structure(wrong, error)
         call check(name//': below 0 is refused', allocated(error) .or. &
            any(k == [x_S_at, x_M_at, x_H_at, of_x_F]) .or. parameters(k)%range == any_value)
         if (parameters(k)%range /= positive .and. parameters(k)%range /= not_negative) cycle
         call wrong%set(k, 0.0_wp)
         call check_structure(wrong, error)
         ! A rigid spring has no damper beside it, and a range of 0 no hysteresis.
         call check(name//': 0', allocated(error) .eqv. (parameters(k)%range == positive .or. &
            parameters(k)%is_reciprocal .or. all(parameters(k)%modifies /= [0, k])))
      end do
   end subroutine test_rows

   !> The operators that are connected to the ground: those that move with the base, at a point, and
   !> have a spring or a damper.
   subroutine test_grounded()
      integer :: k

      do k = 1, size(operators)
         call check('operator '//to_text(k)//': connected to the ground', &
            operators(k)%is_grounded .eqv. (operators(k)%moves_with_base .and. &
            operators(k)%derivative >= 0 .and. any(terms%operator == k .and. &
            terms%matrix >= of_damping)))
      end do
      call check('masses move with the base', all(operators(pack(terms%operator, &
         terms%matrix == of_mass .and. operators(terms%operator)%derivative /= 1)) &
         %moves_with_base))
   end subroutine test_grounded

   !> Strengths of the terms: the derivatives that follow from the powers against central
   !> differences, on a mesh of another length; truncation (1e-4)**2 times a few, round-off 1e-11.
   subroutine test_derivatives()
      type(structure_t) :: s, above, below
      real(wp), allocatable :: exact(:, :), approximate(:, :)
      real(wp) :: h
      integer :: k

      s = random_structure(0.5_wp)
      do k = 1, n_parameters
         if (.not. is_there(s, k)) cycle
         h = 1e-4_wp*s%get(k)
         above = s
         call above%set(k, s%get(k) + h)
         below = s
         call below%set(k, s%get(k) - h)
         exact = strength_slopes(s, 1.7_wp*s%length, k)
         approximate = (strengths(above, 1.7_wp*s%length) - strengths(below, 1.7_wp*s%length))/(2*h)
         ! It moves an operator or changes a rate, and the strength does not depend on it.
         if (any(operators%place == k) .or. any(of_b == k)) cycle
         call check_close('strengths, d/d '//trim(parameters(k)%name), maxval(abs(exact &
            - approximate))/maxval(abs(exact)), 0.0_wp, 3e-7_wp)
      end do
      s%end(1)%kappa_R = 0
      s%sensor(1)%x_S = at_tip
      exact = strength_slopes(s, s%length, of_kappa_R)
      call check('rigid root: a compliance of 0 may grow', exact(end_condition(2, 1), &
         of_compliance) > 0 .and. count(abs(exact) > 0) == 1)
      call check('length matters', any(abs(strength_slopes(s, s%length, of_length)) > 0))
   end subroutine test_derivatives

   !> Derivatives of the strengths by one parameter.
   function strength_slopes(s, mesh_length, k) result(slopes)
      type(structure_t), intent(in) :: s
      real(wp), intent(in) :: mesh_length
      integer, intent(in) :: k
      real(wp), dimension(operators_of(s), of_compliance) :: slopes, strength
      real(wp) :: all_slopes(size(slopes, 1), of_compliance, 1)

      call strengths_and_slopes(s, mesh_length, [k], strength, all_slopes)
      slopes = all_slopes(:, :, 1)
   end function strength_slopes

   !> Random structures, parameters over four decades, every one of them free: no right derivative
   !> is found to be mistaken, and every one that is 0, or off by 1 %, is, unless it hardly counts:
   !> a motion changes by less than 1e-5 when the parameter doubles. The first few have weight and
   !> an axial force, which takes ten times as long.
   subroutine test_mistakes(structures)
      integer, intent(in) :: structures
      type(mistaken_t) :: problem
      type(variable_t), allocatable :: variables(:)
      type(error_t), allocatable :: error
      real(wp) :: r(60)
      real(wp), allocatable :: p(:), jac(:, :), right(:, :)
      real(wp), allocatable :: worst
      real(wp), parameter :: factors(2) = [0.0_wp, 1.01_wp]
      integer :: alarms, missed(2), counted, stride, i, j, k, found

      ! The daily run makes mistakes in every third parameter only.
      stride = merge(1, 3, in_long_run())
      alarms = 0
      missed = 0
      counted = 0
      do i = 1, structures
         call pose(problem, i <= max(1, structures/50), p, error)
         if (allocated(error)) exit
         jac = spread(p, 1, size(r))
         variables = [(new_variable(p(k), 0.0_wp, unbounded, magnitude(problem%right%scenario &
            %structures(1), places(k))), k=1, size(p))]
         call problem%jacobian(p, r, jac, error)
         if (allocated(error)) exit
         right = jac
         call compare_derivatives(problem, p, variables, jac, worst, found)
         if (found > 0) alarms = alarms + 1
         if (found > 0) print '(3a,es9.2)', '      alarm: ', &
            parameters(places(found))%name, ' ', worst
         do k = 1 + modulo(i, stride), size(p), stride
            if (norm2(jac(:, k))*p(k) <= 1e-5_wp*norm2(r)) cycle
            counted = counted + 1
            do j = 1, size(factors)
               jac(:, k) = factors(j)*jac(:, k)
               call compare_derivatives(problem, p, variables, jac, worst, found)
               if (found /= k) missed(j) = missed(j) + 1
               if (found /= k) print '(2a,i0,2es9.2)', '      missed: ', &
                  parameters(places(k))%name, j, worst
               jac = right
            end do
         end do
      end do
      if (allocated(error)) print '(2a)', '      ', error%message
      call check('every structure has derivatives', .not. allocated(error))
      call check('right derivatives: no alarm in '//to_text(structures), alarms == 0, &
         to_text(alarms))
      call check('most derivatives count', counted > 10*structures, to_text(counted))
      call check('derivatives of 0: all found', missed(1) == 0, to_text(missed(1)))
      call check('derivatives wrong by 1 %: all found', missed(2) == 0, to_text(missed(2)))
   end subroutine test_mistakes

   !> A pulse on a random structure, some ten periods of its first mode, no record to speak of.
   subroutine pose(problem, heavy, p, error)
      type(mistaken_t), intent(inout) :: problem
      logical, intent(in) :: heavy
      real(wp), allocatable, intent(out) :: p(:)
      type(error_t), allocatable, intent(out) :: error
      type(experiment_t) :: experiment
      type(structure_t) :: s
      integer :: k

      s = random_structure(1.0_wp)
      if (allocated(problem%points)) deallocate (problem%points, problem%known)
      if (.not. heavy) s%g = 0
      if (.not. heavy) s%T = 0
      if (.not. heavy) s%a_h = 0
      if (.not. heavy) s%b_h = 0
      places = pack(parameters(:n_parameters)%place, is_there(s, parameters(:n_parameters)%place) &
         .and. (heavy .or. [(all([of_g, of_T, of_a_h, of_b_h] /= k), k=1, n_parameters)]))
      ! A loss factor is not defined in time.
      s%eta = 0
      places = pack(places, places /= of_eta)
      experiment%samples = [(k/s%omega(), k=1, 60)]
      experiment%excitation = new_pulse(1.0_wp, 0.5_wp/s%omega())
      allocate (experiment%measured(60), source=0.0_wp)
      call new_residuals(model_of(s, experiment%excitation), mesh_t(3, 4, 4, 1), [experiment], &
         problem%right, error)
      problem%right%free = places
      problem%right%record = 0*places
      p = [(s%get(places(k)), k=1, size(places))]
   end subroutine pose

end program test_terms
