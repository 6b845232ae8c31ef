!> Computations of `beamid reproduce varying`: estimates the fields E(x) and c_D(x) from the exact
!> motion of a beam, with independent meshes for the state and for the fields.
module beamid_varying_study
   use beamid
   use beamid_fit_setups, only: set_unknowns => set_free
   use beamid_interrupts, only: stop_flag
   use beamid_kinds, only: pi
   use beamid_residuals, only: new_residuals, residual_t
   use beamid_structure, only: c_D_at, E_at
   use beamid_unknowns, only: quantity_t, variables_of
   use beamid_variations, only: as_spline, field_modulus, field_viscosity, in_steps, &
      known_c_D, known_E, new_variation, variation_t
   implicit none
   private

   public :: varying_t, minimiser_t, new_problems, record_truth, find_minimisers, minimise, &
      state_meshes, pieces, points, degree, strength, beside_step, step_place, step_factor, &
      reference, widest

   !> Numbers of elements of the cubic meshes of the state, and numbers of pieces of the cubic
   !> splines for the fields, which have three coefficients more.
   integer, parameter :: state_meshes(*) = [4, 8, 16, 32], pieces(*) = [2, 4, 8, 16]
   !> Degree of the splines for state and fields.
   integer, parameter :: degree = 3
   !> Number of quintic elements of the mesh that stands for the beam.
   integer, parameter :: reference = 48
   !> Number of points at which fields are compared, the midpoints of equal parts of the beam.
   integer, parameter :: points = 400
   !> Nominal values of E and c_D, from which searches start. The set Q of Theorem 3.1 contains the
   !> values within a factor of `widest` of these.
   real(wp), parameter :: E_0 = 80, c_D_0 = 2e-2_wp, widest = 3
   !> The step of E: its position x/l, which is a node of no mesh, and the factor of E behind it.
   !> Points further from the step than `beside_step` count as far from it.
   real(wp), parameter :: step_place = 0.4_wp, step_factor = 0.8_wp, beside_step = 0.1_wp
   !> Strength of the penalty |(log E)'|**2, and of the same for c_D, in units of J over the sum of
   !> squares of the record. It makes Q practically compact and is far below the noise of any
   !> record.
   real(wp), parameter :: strength = 1e-12_wp

   !> The minimiser on one pair of meshes.
   type :: minimiser_t
      integer :: N = 0, M = 0               !< elements of the state, coefficients of each field
      logical :: settled = .false.          !< whether the search has converged to a minimum
      real(wp) :: J = 0                     !< of the data, over the sum of squares of the record
      !> relative distances of E (1) and c_D (2) from the truth: the largest, the root mean square,
      !> and the largest far from the step
      real(wp), dimension(2) :: sup = 0, L2 = 0, far = 0
      !> root mean square distance of E (1) and c_D (2) from the minimiser with the same M on the
      !> finest mesh of the state
      real(wp), dimension(2) :: state = 0
      real(wp) :: found(points, 2) = 0      !< estimates of E and c_D at the points
      type(error_t), allocatable :: failure !< why there is no minimiser
   end type minimiser_t

   !> One problem: a true beam and the minimisers for its record.
   type :: varying_t
      character(len=:), allocatable :: name
      integer :: functions = 1              !< 1: E(x) is estimated; 2: c_D(x) as well
      logical :: has_step = .false.         !< whether the true E has a step
      type(model_t) :: model                !< the true beam
      type(experiment_t), allocatable :: record(:)
      real(wp) :: x(points) = 0             !< x/l of the points
      real(wp) :: truth(points, 2) = 0      !< E and c_D at the points
      type(minimiser_t), allocatable :: minimisers(:, :)   !< (state meshes, pieces)
   end type varying_t

contains

   !> Makes the three problems: a smooth E(x), a smooth E(x) and c_D(x), and an E(x) with a step.
   subroutine new_problems(problems)
      type(varying_t), allocatable, intent(out) :: problems(:)
      integer, parameter :: knots = 64
      real(wp) :: xi(0:knots)
      type(variation_t) :: smooth, viscous, step
      integer :: k

      xi = [(real(k, wp)/knots, k=0, knots)]
      smooth = new_variation(as_spline, xi, 1 - 0.2_wp*sin(pi*xi) + 0.1_wp*sin(2*pi*xi))
      viscous = new_variation(as_spline, xi, 1 + 0.3_wp*sin(pi*xi))
      step = new_variation(in_steps, [0.0_wp, step_place], [1.0_wp, step_factor])
      allocate (problems(3))
      problems(1)%name = 'smooth E'
      problems(2)%name = 'smooth E and c_D'
      problems(3)%name = 'step in E'
      do k = 1, size(problems)
         associate (problem => problems(k), structure => problems(k)%model%structure)
            structure = structure_t(length=4, rho=0.03_wp, E=E_0, I=1, c_D=c_D_0, m_T=0.06_wp, &
               J_T=0.03_wp)
            structure%variations%known(known_E) = smooth
            if (k == 2) structure%variations%known(known_c_D) = viscous
            if (k == 3) structure%variations%known(known_E) = step
            problem%functions = merge(2, 1, k == 2)
            problem%has_step = k == 3
            allocate (modal_t :: problem%model%solver)
         end associate
      end do
   end subroutine new_problems

   !> Computes record and true fields of a problem, on the quintic mesh.
   !>
   !> problem  on return with `record`, `x` and `truth`
   !> error    a response that cannot be computed
   subroutine record_truth(problem, error)
      type(varying_t), intent(inout) :: problem
      type(error_t), allocatable, intent(out) :: error
      real(wp), parameter :: duration = 0.1_wp, step = 5e-3_wp
      integer, parameter :: samples = 200
      type(simulation_t) :: simulation
      real(wp) :: t(samples)
      integer :: k

      call new_force_table([0.0_wp, duration/2, duration], [0.0_wp, 1.0_wp, 0.0_wp], &
         problem%model%excitation, error)
      if (allocated(error)) return
      t = [(k*step, k=1, samples)]
      call simulate(problem%model, mesh_t(degree=5, elements=reference, gauss_points=6), t, &
         simulation, error)
      if (allocated(error)) return
      problem%record = [experiment_t(t, simulation%acceleration, problem%model%excitation)]
      associate (structure => problem%model%structure)
         do k = 1, points
            problem%x(k) = (k - 0.5_wp)/points
            associate (known => structure%variations%known)
               problem%truth(k, :) = [structure%E*known(known_E)%at(problem%x(k)), &
                  structure%c_D*known(known_c_D)%at(problem%x(k))]
            end associate
         end do
      end associate
   end subroutine record_truth

   !> Finds the minimisers on every mesh of the state with every mesh of the fields.
   !>
   !> elements  numbers of elements of the state
   !> parts     numbers of pieces of the fields
   !> error     of the first minimisation that fails
   subroutine find_minimisers(problem, elements, parts, error)
      type(varying_t), intent(inout) :: problem
      integer, intent(in) :: elements(:), parts(:)
      type(error_t), allocatable, intent(out) :: error
      type(minimiser_t), allocatable :: found(:, :)
      integer :: a, i, j, k

      allocate (found(size(elements), size(parts)))
      !$omp parallel do schedule(dynamic, 1) private(i, j) copyin(stop_flag)
      do k = size(found), 1, -1
         i = 1 + mod(k - 1, size(elements))
         j = 1 + (k - 1)/size(elements)
         call minimise(problem, elements(i), parts(j), strength, found(i, j))
      end do
      !$omp end parallel do
      do j = 1, size(parts)
         do i = 1, size(elements)
            if (.not. allocated(found(i, j)%failure)) cycle
            call move_alloc(found(i, j)%failure, error)
            return
         end do
         associate (same => found(:, j), truth => problem%truth)
            do i = 1, size(elements)
               same(i)%state = [(norm2((same(i)%found(:, a) - same(size(elements))%found(:, a)) &
                  /truth(:, a))/sqrt(real(points, wp)), a=1, 2)]
            end do
         end associate
      end do
      call move_alloc(found, problem%minimisers)
   end subroutine find_minimisers

   !> Finds one minimiser, starting from constant fields.
   !>
   !> elements   number of elements of the state
   !> parts      number of pieces of each field
   !> alpha      strength of the penalty, in units of J over the sum of squares of the record
   !> minimiser  the minimiser, or its `failure`
   subroutine minimise(problem, elements, parts, alpha, minimiser)
      type(varying_t), intent(in) :: problem
      integer, intent(in) :: elements, parts
      real(wp), intent(in) :: alpha
      type(minimiser_t), intent(out) :: minimiser
      type(residual_t) :: whole
      type(stage_t) :: stage
      type(variable_t), allocatable :: variables(:)
      type(quantity_t), allocatable :: quantities(:)
      type(fit_t) :: found
      real(wp) :: unit

      minimiser%N = elements
      minimiser%M = parts + degree
      call pose(problem, elements, minimiser%M, whole, stage, minimiser%failure)
      if (allocated(minimiser%failure)) return
      call variables_of(stage, whole%scenario, variables, quantities, minimiser%failure)
      if (allocated(minimiser%failure)) return
      ! The penalty is a sum of squared differences of coefficients 1/parts apart. The factor makes
      ! it the integral of a squared derivative.
      unit = sum(problem%record(1)%measured**2)
      call search(whole, problem%functions, parts*unit, alpha, variables, found, &
         minimiser%settled, minimiser%failure)
      if (allocated(minimiser%failure)) return
      whole%scenario = whole%with(found%estimate)
      minimiser%J = sum(found%residual(:whole%samples())**2)/unit
      call compare(problem, whole%scenario%structures(1), minimiser)
   end subroutine minimise

   !> Makes the approximate problem with constant fields, and the stage with the free coefficients
   !> and their bounds Q.
   !>
   !> elements      number of elements of the state
   !> coefficients  number M of coefficients of each field
   !> error         an experiment that cannot be computed
   subroutine pose(problem, elements, coefficients, whole, stage, error)
      type(varying_t), intent(in) :: problem
      integer, intent(in) :: elements, coefficients
      type(residual_t), intent(out) :: whole
      type(stage_t), intent(out) :: stage
      type(error_t), allocatable, intent(out) :: error
      type(model_t) :: model
      real(wp), allocatable :: from(:)
      integer :: j

      model = problem%model
      model%structure%variations%known(known_E) = variation_t()
      model%structure%variations%along(field_modulus)%coefficients = coefficients
      model%structure%variations%along(field_modulus)%degree = degree
      stage%free = E_at(:coefficients)
      from = spread(E_0, 1, coefficients)
      if (problem%functions == 2) then
         model%structure%variations%known(known_c_D) = variation_t()
         model%structure%variations%along(field_viscosity)%coefficients = coefficients
         model%structure%variations%along(field_viscosity)%degree = degree
         stage%free = [stage%free, c_D_at(:coefficients)]
         from = [from, spread(c_D_0, 1, coefficients)]
      end if
      stage%lower = from/widest
      stage%upper = from*widest
      do j = 1, size(from)
         call model%structure%set(stage%free(j), from(j))
      end do
      call new_residuals(model, mesh_t(degree=3, elements=elements), problem%record, whole, error)
      if (.not. allocated(error)) call set_unknowns(whole, stage)
   end subroutine pose

   !> Searches for the minimum in steps.
   !>
   !> The first searches use the beginning of the record, where no mode is off by more than half a
   !> period, then more and more of it, with a penalty so strong that the fields hardly vary. The
   !> next use the whole record and weaken the penalty by a factor of 100 from one to the next.
   !>
   !> functions  number of fields
   !> unit       unit of the strength of a penalty
   !> alpha      last strength, in this unit
   !> variables  with the constant fields as start values
   !> found      result of the last search
   !> settled    whether the last search has converged to a minimum
   !> error      the last search could not even start
   subroutine search(whole, functions, unit, alpha, variables, found, settled, error)
      type(residual_t), intent(inout) :: whole
      integer, intent(in) :: functions
      real(wp), intent(in) :: unit, alpha
      type(variable_t), intent(inout) :: variables(:)
      type(fit_t), intent(out) :: found
      logical, intent(out) :: settled
      type(error_t), allocatable, intent(out) :: error
      integer, parameter :: halvings = 4
      real(wp), parameter :: weaker = 1e-2_wp
      type(residual_t) :: part
      type(options_t) :: options
      type(fit_t) :: near
      type(error_t), allocatable :: reason
      real(wp) :: now
      integer :: k

      settled = .false.
      options = options_t(check=.false., tolerance=1e-4_wp, max_evaluations=30)
      do k = halvings, 1, -1
         part = whole%beginning(0.5_wp**k)
         part%strength(:functions) = unit
         call fit(part, part%rows(), variables, options, near, reason)
         if (.not. allocated(reason)) variables = variables%from(near%estimate)
      end do
      now = 1
      do while (now > 1.5_wp*alpha)
         whole%strength(:functions) = now*unit
         call fit(whole, whole%rows(), variables, options, near, reason)
         if (allocated(near%estimate)) variables = variables%from(near%estimate)
         now = now*weaker
      end do
      whole%strength(:functions) = alpha*unit
      options%tolerance = 1e-6_wp
      options%max_evaluations = 100
      call fit(whole, whole%rows(), variables, options, found, error)
      settled = .not. allocated(error)
      if (allocated(found%estimate) .and. allocated(error)) deallocate (error)
   end subroutine search

   !> Computes the distances of a minimiser from the truth.
   !>
   !> structure  with the estimated fields
   subroutine compare(problem, structure, minimiser)
      type(varying_t), intent(in) :: problem
      type(structure_t), intent(in) :: structure
      type(minimiser_t), intent(inout) :: minimiser
      real(wp) :: distance(points)
      integer :: a, k

      do k = 1, points
         minimiser%found(k, :) = [E_0, c_D_0]*structure%factors(problem%x(k))
      end do
      do a = 1, problem%functions
         distance = abs(minimiser%found(:, a)/problem%truth(:, a) - 1)
         minimiser%sup(a) = maxval(distance)
         minimiser%L2(a) = norm2(distance)/sqrt(real(points, wp))
         minimiser%far(a) = maxval(distance, mask=.not. problem%has_step .or. &
            abs(problem%x - step_place) >= beside_step)
      end do
   end subroutine compare

end module beamid_varying_study
