!> The free decay of beams as one search for everything: parameters, motions of the modes, offsets.
!>
!> An implementation of its own: roots of the dense first-order system by LAPACK, their derivatives
!> by differences, and the three formulas of the observation in closed form, which multiply e**(s t)
!> by 1, S or S**2 with S = sinh(s Delta/2)/(s Delta/2).
module whole_problem
   use beamid_bands, only: band_t
   use beamid_equations, only: equations_t, new_equations
   use beamid_errors, only: error_t, failure
   use beamid_excitation, only: new_pulse
   use beamid_experiments, only: experiment_t
   use beamid_galerkin, only: galerkin_t, mesh_t, new_galerkin
   use beamid_kinds, only: wp
   use beamid_observation, only: observation_t
   use beamid_problems, only: smooth_problem_t
   use beamid_structure, only: structure_t
   implicit none
   private

   public :: whole_t, new_whole

   type, extends(smooth_problem_t) :: whole_t
      type(experiment_t), allocatable :: experiments(:)
      type(structure_t), allocatable :: structures(:)   !< of each experiment
      type(galerkin_t), allocatable :: galerkins(:)
      type(observation_t) :: observation
      integer, allocatable :: free(:), record(:)        !< (n)
      integer :: modes = 0
   contains
      procedure :: residuals
      procedure :: jacobian
      procedure, private :: roots
   end type whole_t

   interface
      subroutine dgesv(n, nrhs, a, lda, ipiv, b, ldb, info)
         import :: wp
         integer, intent(in) :: n, nrhs, lda, ldb
         real(wp), intent(inout) :: a(lda, *), b(ldb, *)
         integer, intent(out) :: ipiv(*), info
      end subroutine dgesv
      subroutine dgeev(jobvl, jobvr, n, a, lda, wr, wi, vl, ldvl, vr, ldvr, work, lwork, info)
         import :: wp
         character, intent(in) :: jobvl, jobvr
         integer, intent(in) :: n, lda, ldvl, ldvr, lwork
         real(wp), intent(inout) :: a(lda, *)
         real(wp), intent(out) :: wr(*), wi(*), vl(ldvl, *), vr(ldvr, *), work(*)
         integer, intent(out) :: info
      end subroutine dgeev
   end interface

contains

   !> The same free parameters and records as a fit has.
   function new_whole(experiments, structure, mesh, observation, free, record) result(self)
      type(experiment_t), intent(in) :: experiments(:)
      type(structure_t), intent(in) :: structure
      type(mesh_t), intent(in) :: mesh
      type(observation_t), intent(in) :: observation
      integer, intent(in) :: free(:), record(:)
      type(whole_t) :: self
      integer :: i

      self%experiments = experiments
      self%observation = observation
      self%free = free
      self%record = record
      self%modes = experiments(1)%excitation%modes
      allocate (self%structures(size(experiments)), self%galerkins(size(experiments)))
      do i = 1, size(experiments)
         self%structures(i) = structure
         if (experiments(i)%length > 0) self%structures(i)%length = experiments(i)%length
         if (experiments(i)%x_S > 0) self%structures(i)%x_S = experiments(i)%x_S
         self%galerkins(i) = new_galerkin(mesh, self%structures(i)%length)
      end do
   end function new_whole

   !> The lowest roots of a record's structure that oscillate.
   subroutine roots(self, i, parameters, s, error)
      class(whole_t), intent(inout), target :: self
      integer, intent(in) :: i
      real(wp), intent(in) :: parameters(:)
      complex(wp), intent(out) :: s(:)
      type(error_t), allocatable, intent(out) :: error
      type(equations_t) :: equations
      type(structure_t) :: structure
      real(wp), allocatable :: a(:, :), m(:, :), b(:, :), re(:), im(:), work(:)
      real(wp) :: unused(1, 1)
      integer, allocatable :: pivot(:)
      logical, allocatable :: waiting(:)
      integer :: k, n, info, next

      structure = self%structures(i)
      do k = 1, size(self%free)
         if (self%record(k) == 0 .or. self%record(k) == i) call structure%set(self%free(k), &
            parameters(k))
      end do
      equations = new_equations(self%galerkins(i), structure, new_pulse(0.0_wp, 1.0_wp))
      n = equations%n
      m = dense(equations%mass)
      b = reshape([dense(equations%stiffness), dense(equations%damping)], [n, 2*n])
      allocate (a(2*n, 2*n), source=0.0_wp)
      allocate (re(2*n), im(2*n), work(40*n), pivot(n))
      call dgesv(n, 2*n, m, n, pivot, b, n, info)
      if (info == 0) then
         do k = 1, n
            a(k, n + k) = 1
         end do
         a(n + 1:, :) = -b
         call dgeev('N', 'N', 2*n, a, 2*n, re, im, unused, 1, unused, 1, work, size(work), info)
      end if
      if (info /= 0) then
         call failure(error, 'no eigenvalues')
         return
      end if
      waiting = im > 0
      do k = 1, size(s)
         next = minloc(hypot(re, im), dim=1, mask=waiting)
         waiting(next) = .false.
         s(k) = cmplx(re(next), im(next), wp)
      end do
   end subroutine roots

   function dense(band) result(full)
      type(band_t), intent(in) :: band
      real(wp) :: full(band%n, band%n)
      integer :: i, j

      do j = 1, band%n
         do i = 1, band%n
            full(i, j) = band%element(i, j)
         end do
      end do
   end function dense

   !> What the formula makes of e**(s t), and its derivative by s.
   pure subroutine seen(observation, s, factor, slope)
      type(observation_t), intent(in) :: observation
      complex(wp), intent(in) :: s
      complex(wp), intent(out) :: factor, slope
      complex(wp) :: x, ratio, dratio

      factor = 1
      slope = 0
      if (observation%formula == 3) return
      x = s*observation%delta/2
      ratio = (exp(x) - exp(-x))/(2*x)
      dratio = ((exp(x) + exp(-x))/2 - ratio)/s
      factor = ratio
      slope = dratio
      if (observation%formula == 2) return
      factor = ratio**2
      slope = 2*ratio*dratio
   end subroutine seen

   subroutine residuals(self, parameters, r, error)
      class(whole_t), intent(inout) :: self
      real(wp), intent(in) :: parameters(:)
      real(wp), intent(out) :: r(:)
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: jac(size(r), size(parameters))

      call evaluate(self, parameters, .false., r, jac, error)
   end subroutine residuals

   subroutine jacobian(self, parameters, r, jac, error)
      class(whole_t), intent(inout) :: self
      real(wp), intent(in) :: parameters(:)
      real(wp), intent(out) :: r(:), jac(:, :)
      type(error_t), allocatable, intent(out) :: error

      call evaluate(self, parameters, .true., r, jac, error)
   end subroutine jacobian

   !> parameters  (n + k) those of the structures, then for each record cosine and sine of each mode
   !>             and the offset
   subroutine evaluate(self, parameters, slopes, r, jac, error)
      type(whole_t), intent(inout) :: self
      real(wp), intent(in) :: parameters(:)
      logical, intent(in) :: slopes
      real(wp), intent(out) :: r(:), jac(:, :)
      type(error_t), allocatable, intent(out) :: error
      complex(wp) :: s(self%modes), ds(self%modes, size(self%free)), factor, slope, c
      complex(wp), allocatable :: wave(:)
      real(wp), allocatable :: tau(:)
      integer :: i, k, first, last, column

      jac = 0
      last = 0
      column = size(self%free)
      do i = 1, size(self%experiments)
         associate (x => self%experiments(i))
            first = last + 1
            last = last + size(x%samples)
            call self%roots(i, parameters, s, error)
            if (.not. allocated(error) .and. slopes) call root_slopes(self, i, parameters, ds, &
               error)
            if (allocated(error)) return
            tau = x%samples - x%samples(1)
            r(first:last) = -x%measured
            do k = 1, self%modes
               call seen(self%observation, s(k), factor, slope)
               c = cmplx(parameters(column + 1), parameters(column + 2), wp)
               wave = exp(s(k)*tau)
               jac(first:last, column + 1) = real(factor*wave)
               jac(first:last, column + 2) = -aimag(factor*wave)
               r(first:last) = r(first:last) + real(c*factor*wave)
               if (slopes) jac(first:last, :size(self%free)) = jac(first:last, :size(self%free)) &
                  + real(spread(c*(factor*tau + slope)*wave, 2, size(self%free)) &
                  *spread(ds(k, :), 1, size(tau)))
               column = column + 2
            end do
            column = column + 1
            jac(first:last, column) = x%scale
            r(first:last) = r(first:last) + x%scale*parameters(column)
         end associate
      end do
   end subroutine evaluate

   !> Five-point differences of the roots: good to 1e-9 or so.
   subroutine root_slopes(self, i, parameters, ds, error)
      type(whole_t), intent(inout) :: self
      integer, intent(in) :: i
      real(wp), intent(in) :: parameters(:)
      complex(wp), intent(out) :: ds(:, :)
      type(error_t), allocatable, intent(out) :: error
      real(wp), parameter :: weights(4) = [1, -8, 8, -1]/12.0_wp
      integer, parameter :: steps(4) = [-2, -1, 1, 2]
      complex(wp) :: s(size(ds, 1))
      real(wp) :: moved(size(parameters)), h
      integer :: j, k

      ds = 0
      do k = 1, size(self%free)
         if (all(self%record(k) /= [0, i])) cycle
         h = 1e-3_wp*parameters(k)
         do j = 1, 4
            moved = parameters
            moved(k) = moved(k) + steps(j)*h
            call self%roots(i, moved, s, error)
            if (allocated(error)) return
            ds(:, k) = ds(:, k) + weights(j)/h*s
         end do
      end do
   end subroutine root_slopes

end module whole_problem

!> Fits from a start of which nothing is known: against one search for everything, by their rate of
!> coverage on records of the model itself, and over several records.
program test_free_start
   use beamid_cvode, only: cvode_t
   use beamid_equations, only: equations_t, new_equations
   use beamid_errors, only: error_t, status_bad_input, status_failed
   use beamid_excitation, only: excitation_t, new_free, new_pulse, new_release
   use beamid_experiments, only: experiment_t, new_apparatus
   use beamid_galerkin, only: galerkin_t, mesh_t, new_galerkin
   use beamid_identification, only: identify, model_t, simulate, simulation_t, stage_fit_t, stage_t
   use beamid_kinds, only: wp
   use beamid_least_squares, only: fit, fit_t, options_t
   use beamid_modal, only: modal_t
   use beamid_noise, only: gaussian_noise, uniform_noise
   use beamid_observation, only: observation_t
   use beamid_parameters, only: free_index, offset, parameter_names
   use beamid_residuals, only: residual_t
   use beamid_responses, only: work_t
   use beamid_statistics, only: new_statistics, statistics_t
   use beamid_strings, only: to_text
   use beamid_structure, only: of_length, structure_t
   use beamid_unknowns, only: name_of
   use beamid_variables, only: new_variable, unbounded, variable_t
   use checks, only: check, check_close, finish
   use whole_problem, only: new_whole, whole_t
   implicit none

   !> An aluminium strip, with more damping than it has: after half a second two modes are left, the
   !> third to e**-11.
   type(structure_t), parameter :: truth = structure_t(length=0.5_wp, rho=0.27_wp, E=6.4e10_wp, &
      I=0.05_wp*0.002_wp**3/12, c_D=6e6_wp, gamma=0.07_wp, m_S=0.004_wp, x_S=0.44_wp)
   type(mesh_t), parameter :: mesh = mesh_t(3, 4, 4, 1)
   character(len=5), parameter :: names(4) = [character(len=5) :: 'E', 'm_S', 'c_D', 'gamma']
   type(observation_t), parameter :: formulas(3) = [observation_t(1, 0.008_wp), &
      observation_t(2, 0.01_wp), observation_t(3, 0.0_wp)]
   !> The sensor's: acceleration = scale (value - offset).
   real(wp), parameter :: scale = 9.80665_wp, true_offset = 0.045_wp, first_offset = 0.02_wp
   real(wp), parameter :: noise_share = 0.01_wp

   call test_formulas()
   call test_iterations()
   call test_two_records()
   call test_nothing_shared()
   call test_coverage()
   call test_coverage_of_two()
   call test_later_clock()
   call test_other_structures()
   call test_sensor_at_tip()
   call test_offset_alone()
   call test_refusals()
   call finish('free_start')

contains

   !> Stamps some .01 apart that are not uniform, from `first` on [s].
   function stamps(m, first, seed) result(t)
      integer, intent(in) :: m, seed
      real(wp), intent(in) :: first
      real(wp) :: t(m)
      integer :: k

      t = first + 0.01_wp*([(k, k=0, m - 1)] + 0.6_wp*(uniform_noise(m, seed) - 0.5_wp))
   end function stamps

   !> What a sensor would have recorded of the true structure, without noise.
   function made(structure, cause, formula, times) result(experiment)
      type(structure_t), intent(in) :: structure
      type(excitation_t), intent(in) :: cause
      type(observation_t), intent(in) :: formula
      real(wp), intent(in) :: times(:)
      type(experiment_t) :: experiment
      type(simulation_t) :: clean
      type(error_t), allocatable :: error

      call simulate(model_of(structure, cause, formula), mesh, times, clean, error)
      call check('a record is made', .not. allocated(error))
      experiment%samples = times
      experiment%measured = clean%acceleration + scale*(true_offset - first_offset)
      experiment%excitation = new_free(2)
      experiment%scale = scale
      experiment%offset = first_offset
   end function made

   function model_of(structure, cause, formula) result(model)
      type(structure_t), intent(in) :: structure
      type(excitation_t), intent(in) :: cause
      type(observation_t), intent(in) :: formula
      type(model_t) :: model

      model%structure = structure
      model%excitation = cause
      model%observation = formula
      allocate (modal_t :: model%solver)
   end function model_of

   !> A stage that starts near the truth: within a quarter of a cycle at the end of the record.
   !>
   !> shared   those that all records have in common
   function stage_of(shared, records) result(stage)
      character(len=*), intent(in) :: shared(:)
      integer, intent(in) :: records
      type(stage_t) :: stage
      integer :: k

      stage%free = [(free_index(names(k)), k=1, size(names)), offset]
      stage%lower = spread(0.0_wp, 1, size(stage%free))
      stage%upper = spread(unbounded, 1, size(stage%free))
      stage%start = [truth%E*1.002_wp, truth%m_S*0.9_wp, truth%c_D*1.3_wp, truth%gamma*0.7_wp, &
                     0.0_wp]
      stage%offset = .true.
      call stage%distribute([(free_index(shared(k)), k=1, size(shared))], records)
   end function stage_of

   !> Standard deviation of the noise of a record.
   pure real(wp) function noise_of(experiment)
      type(experiment_t), intent(in) :: experiment

      associate (z => experiment%measured)
         noise_of = noise_share*norm2(z - sum(z)/size(z))/sqrt(real(size(z), wp))
      end associate
   end function noise_of

   !> The same record with noise.
   function noisy(experiment, noise) result(worse)
      type(experiment_t), intent(in) :: experiment
      real(wp), intent(in) :: noise(:)
      type(experiment_t) :: worse

      worse = experiment
      worse%measured = worse%measured + noise
   end function noisy

   !> One record by each of the three formulas, after a release, a pulse, a release by force.
   subroutine test_formulas()
      type(experiment_t) :: experiment
      type(excitation_t) :: causes(3)
      integer :: k

      causes = [new_release(0.02_wp, 0.0_wp, .true.), new_pulse(20.0_wp, 0.004_wp), &
                new_release(1.0_wp, -0.1_wp, .false.)]
      do k = 1, 3
         experiment = made(truth, causes(k), formulas(k), stamps(200, 0.5_wp, k))
         experiment = noisy(experiment, gaussian_noise(200, noise_of(experiment), 50 + k))
         call compare_with_whole('formula '//to_text(k), [experiment], formulas(k), &
            stage_of(names, 1))
      end do
   end subroutine test_formulas

   !> Two beams cut from one strip, the sensors not quite alike: E, c_D and gamma in common.
   subroutine test_two_records()
      type(experiment_t) :: two(2)

      call make_two(two)
      two(1) = noisy(two(1), gaussian_noise(size(two(1)%samples), noise_of(two(1)), 61))
      two(2) = noisy(two(2), gaussian_noise(size(two(2)%samples), noise_of(two(2)), 62))
      call compare_with_whole('two records', two, formulas(3), stage_of([character(len=5) :: 'E', &
         'c_D', 'gamma'], 2))
   end subroutine test_two_records

   !> Records of .5 and .4 m, of different length and clock, 4 and 5 g of sensor at .44 and .35 m.
   subroutine make_two(two)
      type(experiment_t), intent(out) :: two(2)
      type(structure_t) :: shorter

      shorter = truth
      shorter%length = 0.4_wp
      shorter%x_S = 0.35_wp
      shorter%m_S = 0.005_wp
      two(1) = made(truth, new_release(0.02_wp, 0.0_wp, .true.), formulas(3), stamps(170, 0.5_wp, &
         11))
      two(2) = made(shorter, new_release(0.01_wp, 6.7_wp, .true.), formulas(3), stamps(130, &
         7.1_wp, 12))
      two(2)%length = shorter%length
      two(2)%x_S = shorter%x_S
   end subroutine make_two

   !> One search for everything has the same minimum and the same standard errors.
   subroutine compare_with_whole(what, experiments, formula, stage)
      character(len=*), intent(in) :: what
      type(experiment_t), intent(in) :: experiments(:)
      type(observation_t), intent(in) :: formula
      type(stage_t), intent(in) :: stage
      type(fit_t) :: long
      type(stage_fit_t), allocatable :: fits(:)
      type(statistics_t) :: statistics
      type(error_t), allocatable :: error
      real(wp), allocatable :: expected(:), found(:)
      real(wp) :: worst
      integer :: k, n, m, linear

      call identify(model_of(truth, new_free(2), formula), mesh, [stage], experiments, fits, error)
      call check(what//': the fit converges', .not. allocated(error))
      if (allocated(error)) return
      n = size(stage%free)
      linear = 5*size(experiments)
      m = sum([(size(experiments(k)%samples), k=1, size(experiments))])
      call search_for_everything(experiments, formula, stage, long, error)
      call check(what//': the search for everything converges', .not. allocated(error))
      if (allocated(error)) return
      associate (short => fits(1)%fit, stated => fits(1)%statistics, q => fits(1)%quantities)
         call check(what//': unknowns', size(q) == n + linear .and. &
            stated%parameters == n + linear .and. stated%samples == m, to_text(size(q)))
         if (size(q) /= n + linear) return
         call new_statistics(long%jacobian, long%residual, long%estimate, q%scale, statistics, &
            error)
         call check_close(what//': J', short%J/long%J, 1.0_wp, 1e-10_wp)
         expected = long%estimate
         found = q%value
         do k = n + 5, n + linear, 5
            expected(k) = expected(k) + first_offset
         end do
         ! J is flat to 1e-14 of itself where a search stops: 1e-7 sqrt(m) standard errors, some
         ! 1e-6.
         worst = maxval(abs(found - expected)/stated%std_error)
         call check_close(what//': estimates, largest difference over standard error', worst, &
            0.0_wp, 1e-5_wp)
         worst = maxval(abs(stated%std_error/statistics%std_error - 1))
         call check_close(what//': standard errors, largest relative difference', worst, 0.0_wp, &
            1e-6_wp)
         worst = maxval(abs(stated%correlation - statistics%correlation))
         call check_close(what//': correlations', worst, 0.0_wp, 1e-6_wp)
         call check_close(what//': variance is J by m - n - k', stated%variance*(m - n - linear) &
            /short%J, 1.0_wp, 1e-12_wp)
         call check(what//': exact derivatives', maxval(short%derivative_check) < 1e-6_wp .and. &
            minval(short%derivative_check) >= 0, to_text(maxval(short%derivative_check)))
      end associate
   end subroutine compare_with_whole

   !> The same start, and no motion at all.
   subroutine search_for_everything(experiments, formula, stage, found, error)
      type(experiment_t), intent(in) :: experiments(:)
      type(observation_t), intent(in) :: formula
      type(stage_t), intent(in) :: stage
      type(fit_t), intent(out) :: found
      type(error_t), allocatable, intent(out) :: error
      type(whole_t) :: whole
      type(variable_t), allocatable :: variables(:)
      integer :: k, m

      whole = new_whole(experiments, truth, mesh, formula, stage%free, stage%owners())
      m = sum([(size(experiments(k)%samples), k=1, size(experiments))])
      variables = [(new_variable(stage%start(k), 0.0_wp, unbounded, stage%start(k)), &
                    k=1, size(stage%free)), &
                   (new_variable(0.0_wp, -unbounded, unbounded, 1.0_wp), k=1, 5*size(experiments))]
      call fit(whole, m, variables, options_t(), found, error)
   end subroutine search_for_everything

   !> From 21 starts, E up to 2 % off, c_D by factors up to 3: one minimum, and fewer iterations
   !> than for everything at once.
   subroutine test_iterations()
      type(experiment_t) :: experiment
      type(stage_t) :: stage
      type(fit_t) :: long
      type(stage_fit_t), allocatable :: fits(:)
      type(error_t), allocatable :: error
      real(wp), parameter :: factors_E(7) = [0.98_wp, 0.99_wp, 0.995_wp, 1.002_wp, 1.005_wp, &
                             1.01_wp, 1.02_wp], factors_c(3) = [0.4_wp, 1.3_wp, 3.0_wp]
      integer :: i, j, few, many, same
      real(wp) :: least

      experiment = made(truth, new_release(0.02_wp, 0.0_wp, .true.), formulas(3), stamps(200, &
         0.5_wp, 3))
      experiment = noisy(experiment, gaussian_noise(200, noise_of(experiment), 53))
      few = 0
      many = 0
      same = 0
      least = -1
      do i = 1, size(factors_E)
         do j = 1, size(factors_c)
            stage = stage_of(names, 1)
            stage%start = stage%start*[factors_E(i), 1.0_wp, factors_c(j), 1.0_wp]
            call identify(model_of(truth, new_free(2), formulas(3)), mesh, [stage], [experiment], &
               fits, error)
            if (.not. allocated(error)) call search_for_everything([experiment], formulas(3), &
               stage, long, error)
            if (allocated(error)) cycle
            if (least < 0) least = fits(1)%fit%J
            if (abs(fits(1)%fit%J/least - 1) < 1e-10_wp .and. abs(long%J/least - 1) < 1e-10_wp) &
               same = same + 1
            few = few + fits(1)%fit%iterations
            many = many + long%iterations
         end do
      end do
      call check('one minimum from 21 starts by either search', same == 21, to_text(same))
      call check('fewer iterations than for everything', few < many, to_text(few)//' against '// &
         to_text(many))
   end subroutine test_iterations

   !> Two records that share nothing are two fits.
   subroutine test_nothing_shared()
      type(experiment_t) :: two(2)
      type(stage_fit_t), allocatable :: both(:), one(:)
      type(error_t), allocatable :: error
      type(model_t) :: model
      real(wp) :: worst, worst_error, J
      integer :: r, k, p, found

      call make_two(two)
      do r = 1, 2
         two(r) = noisy(two(r), gaussian_noise(size(two(r)%samples), noise_of(two(r)), 70 + r))
      end do
      model = model_of(truth, new_free(2), formulas(3))
      call identify(model, mesh, [stage_of([character(len=5) ::], 2)], two, both, error)
      call check('nothing shared: the fit converges', .not. allocated(error))
      if (allocated(error)) return
      worst = 0
      worst_error = 0
      found = 0
      J = 0
      do r = 1, 2
         call identify(model, mesh, [stage_of(names, 1)], [two(r)], one, error)
         call check('record '//to_text(r)//' alone: the fit converges', .not. allocated(error))
         if (allocated(error)) return
         J = J + one(1)%fit%J
         do k = 1, size(one(1)%quantities)
            do p = 1, size(both(1)%quantities)
               if (both(1)%quantities(p)%name /= name_of(one(1)%quantities(k)%name, r)) cycle
               found = found + 1
               worst = max(worst, abs(both(1)%quantities(p)%value - one(1)%quantities(k)%value) &
                  /one(1)%statistics%std_error(k))
               ! In units of the noise, which the two have in common now.
               worst_error = max(worst_error, abs(both(1)%statistics%std_error(p) &
                  /sqrt(both(1)%statistics%variance)/(one(1)%statistics%std_error(k) &
                  /sqrt(one(1)%statistics%variance)) - 1))
            end do
         end do
      end do
      call check('nothing shared: 2 (4 + 5) quantities by name', found == 18, to_text(found))
      ! As above: where the searches stop, in standard errors.
      call check_close('nothing shared: estimates', worst, 0.0_wp, 1e-5_wp)
      call check_close('nothing shared: errors', worst_error, 0.0_wp, 1e-5_wp)
      call check_close('nothing shared: J', both(1)%fit%J/J, 1.0_wp, 1e-10_wp)
   end subroutine test_nothing_shared

   !> 400 records of the model itself, 1 % of noise each: 95 % intervals of every quantity, what
   !> was eliminated included.
   subroutine test_coverage()
      type(experiment_t) :: clean

      clean = made(truth, new_release(0.02_wp, 0.0_wp, .true.), formulas(3), stamps(200, 0.5_wp, &
         21))
      call count_inside('one record', [clean], stage_of(names, 1), [truth%E, truth%m_S, truth%c_D, &
         truth%gamma], 400)
   end subroutine test_coverage

   !> The same over two records with E, c_D and gamma in common.
   subroutine test_coverage_of_two()
      type(experiment_t) :: two(2)

      call make_two(two)
      call count_inside('two records', two, stage_of([character(len=5) :: 'E', 'c_D', &
         'gamma'], 2), [truth%E, 0.004_wp, 0.005_wp, truth%c_D, truth%gamma], 400)
   end subroutine test_coverage_of_two

   !> exact  (n) true values of what is searched for
   subroutine count_inside(what, clean, stage, exact, records)
      character(len=*), intent(in) :: what
      type(experiment_t), intent(in) :: clean(:)
      type(stage_t), intent(in) :: stage
      real(wp), intent(in) :: exact(:)
      integer, intent(in) :: records
      type(model_t) :: model
      type(experiment_t), allocatable :: worse(:)
      type(stage_fit_t), allocatable :: fits(:)
      type(error_t), allocatable :: error
      real(wp), allocatable :: noise(:), true_values(:), spread_of(:), stated(:)
      integer, allocatable :: inside(:)
      real(wp) :: sd, variance, band
      integer :: i, k, r, n, m, last, failed, white

      model = model_of(truth, new_free(2), formulas(3))
      n = size(exact)
      sd = noise_of(clean(1))
      ! Without noise the truth itself, but for what is left of the third mode, 1e-5 of it at first.
      call identify(model, mesh, [stage], clean, fits, error)
      call check(what//', without noise: the fit converges', .not. allocated(error))
      if (allocated(error)) return
      true_values = fits(1)%quantities%value
      call check_close(what//', without noise: largest relative error', maxval(abs(true_values(:n) &
         /exact - 1)), 0.0_wp, 1e-3_wp)
      true_values(:n) = exact
      do k = 1, size(true_values)
         if (fits(1)%quantities(k)%parameter /= offset) cycle
         call check_close(what//', without noise: '//trim(fits(1)%quantities(k)%name), &
            true_values(k), true_offset, 1e-4_wp*true_offset)
         true_values(k) = true_offset
      end do
      m = sum([(size(clean(i)%samples), i=1, size(clean))])
      noise = gaussian_noise(records*m, sd, 4711)
      allocate (inside(size(true_values)), source=0)
      allocate (spread_of(size(true_values)), stated(size(true_values)), source=0.0_wp)
      variance = 0
      failed = 0
      white = 0
      worse = clean
      last = 0
      do r = 1, records
         do i = 1, size(clean)
            worse(i) = noisy(clean(i), noise(last + 1:last + size(clean(i)%samples)))
            last = last + size(clean(i)%samples)
         end do
         call identify(model, mesh, [stage], worse, fits, error)
         if (allocated(error)) then
            failed = failed + 1
            print '(a,i0,2a)', '      record ', r, ': ', error%message
            cycle
         end if
         associate (s => fits(1)%statistics, q => fits(1)%quantities%value)
            where (abs(q - true_values) <= s%half_width) inside = inside + 1
            spread_of = spread_of + (q - true_values)**2/records
            stated = stated + s%std_error**2/records
            variance = variance + s%variance/records
            if (fits(1)%check%white) white = white + 1
         end associate
      end do
      call check(what//': all searches converge', failed == 0, to_text(failed)//' failed')
      ! Three deviations of a binomial law, sqrt(.95 .05/400) = 1.1 %.
      band = 3*sqrt(0.95_wp*0.05_wp/records)
      do k = 1, size(inside)
         call check_close(what//': rate of coverage of '//trim(fits(1)%quantities(k)%name), &
            real(inside(k), wp)/records, 0.95_wp, band)
         ! A deviation of 400 values is known to 3.5 %: four of these, and curvature.
         call check_close(what//': deviation of '//trim(fits(1)%quantities(k)%name)// &
            ' over the one stated', sqrt(spread_of(k)/stated(k)), &
            1.0_wp, 4/sqrt(2.0_wp*records) + 0.01_wp)
      end do
      ! The mean of 400 variances with nu degrees of freedom: sqrt(2/nu/400), four of these.
      call check_close(what//': variance over the true one', variance/sd**2, 1.0_wp, &
         4*sqrt(2.0_wp/(m - size(inside))/records))
      ! The fit takes from the noise what looks like its modes: some four cosines for each mode and
      ! a constant, which leaves correlations of (4 cos + 4 cos + 1)/m at every lag and adds two to
      ! a sum of 20 lags on the average. Of 4000 records 90 % were found white.
      call check_close(what//': records found white', real(white, wp)/records, 0.90_wp, 0.05_wp)
   end subroutine count_inside

   !> A clock that began long ago changes nothing but the last digits of the times: 1e-16 of 1e4 s
   !> are 1e-12 s, 4e-11 of the shorter period, and 1e-8 of the noise.
   subroutine test_later_clock()
      type(experiment_t) :: early, late
      type(stage_fit_t), allocatable :: before(:), after(:)
      type(error_t), allocatable :: error
      type(model_t) :: model

      early = made(truth, new_release(0.02_wp, 0.0_wp, .true.), formulas(3), stamps(200, 0.5_wp, &
         31))
      early = noisy(early, gaussian_noise(200, noise_of(early), 81))
      late = early
      late%samples = late%samples + 10000
      model = model_of(truth, new_free(2), formulas(3))
      call identify(model, mesh, [stage_of(names, 1)], [early], before, error)
      if (.not. allocated(error)) call identify(model, mesh, [stage_of(names, 1)], [late], after, &
         error)
      call check('a later clock: both converge', .not. allocated(error))
      if (allocated(error)) return
      call check_close('a later clock: estimates, in standard errors', maxval(abs( &
         after(1)%quantities%value - before(1)%quantities%value)/before(1)%statistics%std_error), &
         0.0_wp, 1e-5_wp)
   end subroutine test_later_clock

   !> Hose, soft root, inertia of the tip, a moving sensor: the derivative of what is left with
   !> respect to every parameter, one to four modes, every formula, against five-point differences.
   subroutine test_other_structures()
      type(structure_t) :: structure
      type(residual_t) :: problem
      type(experiment_t) :: experiment
      type(error_t), allocatable :: error
      real(wp), allocatable :: exact(:, :), difference(:), r(:), p(:), moved(:)
      real(wp), parameter :: weights(4) = [1, -8, 8, -1]/12.0_wp
      integer, parameter :: steps(4) = [-2, -1, 1, 2]
      real(wp) :: h, worst
      integer :: formula, modes, j, k

      structure = structure_t(length=4.0_wp, rho=0.03_wp, E=80.0_wp, I=1.0_wp, c_D=0.3_wp, &
         m_T=0.15_wp, m_H=0.04_wp, c_H=0.01_wp, k_H=0.3_wp, gamma=0.02_wp, J_T=0.01_wp, &
         k_R=50.0_wp, c_R=0.3_wp, m_S=0.02_wp, x_S=3.1_wp)
      experiment%samples = 10*stamps(60, 0.05_wp, 41)
      experiment%measured = gaussian_noise(60, 1.0_wp, 91)
      problem%free = [(k, k=1, size(parameter_names))]
      problem%record = spread(0, 1, size(problem%free))
      problem%offset = .true.
      p = [(structure%get(k), k=1, size(parameter_names))]
      do modes = 1, 4
         do formula = 1, 3
            experiment%excitation = new_free(modes)
            problem%world%structures = [structure]
            problem%world%excitations = [experiment%excitation]
            if (allocated(problem%parts)) deallocate (problem%parts)
            allocate (problem%parts(1))
            call new_apparatus(experiment, structure, mesh, observation_t(formula, merge(0.0_wp, &
               0.02_wp, formula == 3)), modal_t(), problem%parts(1), error)
            if (allocated(error)) exit
            exact = spread(experiment%samples, 2, size(p))
            r = experiment%samples
            call problem%jacobian(p, r, exact, error)
            if (allocated(error)) exit
            worst = 0
            do k = 1, size(p)
               ! Frequencies go with l**-2, with the others' roots at most.
               h = merge(2.5e-4_wp, 1e-3_wp, k == of_length)*p(k)
               difference = 0*r
               do j = 1, 4
                  moved = p
                  moved(k) = p(k) + steps(j)*h
                  call problem%residuals(moved, r, error)
                  if (allocated(error)) exit
                  difference = difference + weights(j)/h*r
               end do
               worst = max(worst, norm2(exact(:, k) - difference)/norm2(difference))
            end do
            ! Truncation (1e-3)**4 times a power of phase, some tens of radians; round-off 1e-13
            ! of the residuals where a parameter hardly matters.
            call check_close('derivatives, '//to_text(modes)//' modes, formula '// &
               to_text(formula), worst, 0.0_wp, 1e-6_wp)
         end do
      end do
      call check('a model of everything', .not. allocated(error))
   end subroutine test_other_structures

   !> A sensor at the tip, with noise and with the same noise turned round: in one of the two the
   !> sum of squares is least with the sensor in the air; neither puts it there.
   subroutine test_sensor_at_tip()
      type(structure_t) :: at_the_tip
      type(experiment_t) :: experiment
      type(model_t) :: model
      type(stage_t) :: stage
      type(stage_fit_t), allocatable :: fits(:)
      type(error_t), allocatable :: error
      integer :: k, at_bound

      at_the_tip = truth
      at_the_tip%x_S = truth%length
      model = model_of(at_the_tip, new_pulse(20.0_wp, 0.004_wp), formulas(3))
      experiment = made(at_the_tip, model%excitation, formulas(3), stamps(200, 0.02_wp, 61))
      experiment%excitation = model%excitation
      stage%free = [free_index('x_S'), offset]
      stage%start = [0.49_wp, 0.0_wp]
      stage%lower = [0.0_wp, 0.0_wp]
      stage%upper = [unbounded, unbounded]
      stage%offset = .true.
      call stage%distribute([integer ::], 1)
      at_bound = 0
      do k = -1, 1, 2
         call identify(model, mesh, [stage], [noisy(experiment, k*gaussian_noise(200, &
            noise_of(experiment), 63))], fits, error)
         call check('place of a sensor at the tip: the fit converges', .not. allocated(error))
         if (allocated(error)) return
         associate (x => fits(1)%fit%estimate(1), l => truth%length)
            call check('the sensor is on the beam', x <= l .and. x > 0.9_wp*l, to_text(x))
            if (.not. x < l) at_bound = at_bound + 1
         end associate
      end do
      call check('once at its end', at_bound == 1, to_text(at_bound))
   end subroutine test_sensor_at_tip

   !> Nothing to search for: what enters linearly is known all the same.
   subroutine test_offset_alone()
      type(experiment_t) :: experiment
      type(stage_t) :: stage
      type(stage_fit_t), allocatable :: fits(:)
      type(error_t), allocatable :: error

      experiment = made(truth, new_release(0.02_wp, 0.0_wp, .true.), formulas(3), stamps(200, &
         0.5_wp, 71))
      experiment = noisy(experiment, gaussian_noise(200, noise_of(experiment), 73))
      allocate (stage%free(0), stage%lower(0), stage%upper(0))
      stage%offset = .true.
      call identify(model_of(truth, new_free(2), formulas(3)), mesh, [stage], [experiment], fits, &
         error)
      call check('offset alone: the fit converges', .not. allocated(error))
      if (allocated(error)) return
      associate (q => fits(1)%quantities, s => fits(1)%statistics)
         call check('offset alone: five unknowns', size(q) == 5 .and. s%parameters == 5 .and. &
            s%samples == 200)
         call check('offset alone: within four standard errors', abs(q(5)%value - true_offset) &
            < 4*s%std_error(5), to_text(abs(q(5)%value - true_offset)/s%std_error(5)))
         ! 195 degrees of freedom: a deviation of 5 %, four of these.
         call check_close('offset alone: sd of the noise', sqrt(s%variance), noise_of(experiment), &
            0.2_wp*noise_of(experiment))
      end associate
   end subroutine test_offset_alone

   !> What cannot be done ends with a message, never with numbers.
   subroutine test_refusals()
      type(experiment_t) :: experiment, few
      type(structure_t) :: undamped
      type(model_t) :: model
      type(stage_t) :: stage
      real(wp) :: period
      type(stage_fit_t), allocatable :: fits(:)
      type(error_t), allocatable :: error
      integer :: k

      experiment = made(truth, new_release(0.02_wp, 0.0_wp, .true.), formulas(3), stamps(200, &
         0.5_wp, 51))
      stage = stage_of(names, 1)
      model = model_of(truth, new_free(2), formulas(3))

      few = experiment
      few%samples = few%samples(:4)
      few%measured = few%measured(:4)
      call refused('4 samples for 5 linear unknowns', model, stage_of(names, 2), &
         [experiment, few], status_failed, '4 samples for 5 linear unknowns')

      experiment%excitation = new_free(6)
      call refused('more modes than the mesh has', model, stage, [experiment], status_bad_input, &
         'found 6, expected at most 5')
      experiment%excitation = new_free(2)

      deallocate (model%solver)
      allocate (cvode_t :: model%solver)
      call refused('a free start by cvode', model, stage, [experiment], status_bad_input, &
         'expected method = ''modal''')

      ! Samples a whole period of the first mode apart, undamped: it looks like an offset.
      undamped = truth
      undamped%c_D = 0
      undamped%gamma = 0
      model = model_of(undamped, new_free(1), formulas(3))
      stage%free = [free_index('gamma')]
      stage%record = [0]
      stage%start = [0.07_wp]
      stage%lower = [0.0_wp]
      stage%upper = [unbounded]
      experiment%excitation = new_free(1)
      call identify(model, mesh, [stage], [experiment], fits, error)
      call check('one mode of an undamped beam can be fitted', .not. allocated(error))
      if (allocated(error)) return
      period = period_of(undamped)
      experiment%samples = [(k*period, k=0, 29)]
      experiment%measured = experiment%measured(:30)
      stage%free = [free_index('m_T')]
      stage%start = [1e-9_wp]
      stage%lower = [0.0_wp]
      stage%upper = [1e-8_wp]
      call refused('samples a period apart', model, stage, [experiment], status_failed, &
         'cannot tell the motions of the modes and the offset apart')
   end subroutine test_refusals

   !> Of the first mode of the mesh [s].
   real(wp) function period_of(structure) result(period)
      type(structure_t), intent(in) :: structure
      type(modal_t) :: solver
      type(galerkin_t), target :: galerkin
      type(equations_t), target :: equations
      type(work_t) :: work
      type(error_t), allocatable :: error
      complex(wp) :: s(1), ds(1, 0)

      galerkin = new_galerkin(mesh, structure%length)
      equations = new_equations(galerkin, structure, new_free(1))
      call solver%prepare(galerkin, error)
      call solver%free_motion(equations, [integer ::], s, ds, work, error)
      period = 2*acos(-1.0_wp)/aimag(s(1))
   end function period_of

   subroutine refused(what, model, stage, experiments, status, words)
      character(len=*), intent(in) :: what, words
      type(model_t), intent(in) :: model
      type(stage_t), intent(in) :: stage
      type(experiment_t), intent(in) :: experiments(:)
      integer, intent(in) :: status
      type(stage_fit_t), allocatable :: fits(:)
      type(error_t), allocatable :: error

      call identify(model, mesh, [stage], experiments, fits, error)
      if (.not. allocated(error)) then
         call check(what//' is refused', .false., 'accepted')
      else
         call check(what//' is refused', error%status == status .and. index(error%message, words) &
            > 0, error%message)
      end if
   end subroutine refused

end program test_free_start
