!> Start values for fits with given damping mechanisms: fits to the natural frequencies and damping
!> ratios that the records show, from a grid of rates or ranges.
module beamid_damping_starts
   use beamid_errors, only: bad_input, error_t, failure
   use beamid_experiments, only: experiment_t
   use beamid_fit_setups, only: set_free
   use beamid_fitted_modes, only: fitted_mode_t, fitted_modes
   use beamid_galerkin, only: coarsest, mesh_t
   use beamid_identification, only: model_t, stage_fit_t, stage_t
   use beamid_kinds, only: two_pi, wp
   use beamid_least_squares, only: options_t
   use beamid_measured_modes, only: measured_mode_t
   use beamid_mechanisms, only: combination_t, mechanism_t, mechanisms
   use beamid_modal_tables, only: modal_table_t
   use beamid_parameters, only: as_named
   use beamid_peak_starts, only: fit_to_modes
   use beamid_residuals, only: new_residuals, residual_t
   use beamid_structure, only: of_b, of_E
   implicit none
   private

   public :: check_data, find_starts, frequency_range, tables_of

contains

   !> Refuses records that show no damping, or for `by_ratios` none by themselves.
   subroutine check_data(experiments, by_ratios, error)
      type(experiment_t), intent(in) :: experiments(:)
      logical, intent(in) :: by_ratios
      type(error_t), allocatable, intent(out) :: error
      logical :: shows
      integer :: k

      do k = 1, size(experiments)
         shows = .not. by_ratios .or. experiments(k)%excitation%modes > 0
         if (allocated(experiments(k)%observed)) then
            shows = .true.
            select type (observed => experiments(k)%observed)
            type is (modal_table_t)
               shows = allocated(observed%damping)
            end select
         end if
         if (shows) return
      end do
      call bad_input(error, 'found no record whose modes show their damping by themselves, '// &
         'expected a free decay, a frequency response or a table of modes with damping ratios')
   end subroutine check_data

   !> Returns the measured modes of each record as a table; an empty one for a record without. If no
   !> record shows modes by itself, the modes of the fit stand in, as rough start values.
   !>
   !> experiments  (records) that were fitted
   !> mesh, fit    their fit
   !> tables       (records)
   function tables_of(experiments, mesh, fit, measured) result(tables)
      type(experiment_t), intent(in) :: experiments(:)
      type(mesh_t), intent(in) :: mesh
      type(stage_fit_t), intent(in) :: fit
      type(measured_mode_t), intent(in) :: measured(:)
      type(experiment_t), allocatable :: tables(:)
      !> Errors of the modes of the fit, as shares of frequency and damping ratio.
      real(wp), parameter :: of_frequency = 1e-3_wp, of_damping = 0.1_wp
      type(measured_mode_t), allocatable :: here(:), listed(:)
      type(modal_table_t), allocatable :: table
      type(fitted_mode_t), allocatable :: fitted(:)
      type(error_t), allocatable :: error
      integer, parameter :: assumed = 3
      integer :: k, r

      listed = measured
      if (size(listed) == 0) then
         call fitted_modes(mesh, fit, assumed, fitted, error)
         if (.not. allocated(error)) listed = [(measured_mode_t(fitted(k)%record, 0, &
            fitted(k)%frequency, of_frequency*fitted(k)%frequency, fitted(k)%damping_ratio, &
            of_damping*fitted(k)%damping_ratio), k=1, size(fitted))]
         do k = 1, size(listed)
            listed(k)%mode = count(listed(:k)%record == listed(k)%record)
         end do
      end if
      tables = experiments
      do r = 1, size(tables)
         allocate (table)
         here = pack(listed, listed%record == r)
         table%mode = here%mode
         table%frequency = here%frequency
         table%sd_frequency = here%sd_frequency
         table%damping = here%damping
         table%sd_damping = here%sd_damping
         table%noise_is_known = .true.
         tables(r)%samples = [real(wp) ::]
         tables(r)%measured = table%values()
         tables(r)%sd = 1
         tables(r)%motion = 0
         tables(r)%excitation%modes = 0
         if (allocated(tables(r)%observed)) deallocate (tables(r)%observed)
         call move_alloc(table, tables(r)%observed)
      end do
   end function tables_of

   !> Returns the lowest and the highest frequency of all tables [1/time].
   pure function frequency_range(tables) result(ends)
      type(experiment_t), intent(in) :: tables(:)
      real(wp) :: ends(2)
      integer :: r

      ends = [huge(1.0_wp), 0.0_wp]
      do r = 1, size(tables)
         select type (table => tables(r)%observed)
         type is (modal_table_t)
            ends = [min(ends(1), minval(table%frequency)), max(ends(2), maxval(table%frequency))]
         end select
      end do
   end function frequency_range

   !> Finds start values by fits to the tables, which start from a grid of rates or ranges.
   !>
   !> model, mesh  as in `new_residuals`
   !> given        free parameters with start values and bounds
   !> starts       (free, 1 to 3) start values, the best first
   !> error        the model cannot be computed from any start
   subroutine find_starts(model, mesh, given, combination, tables, starts, error)
      type(model_t), intent(in) :: model
      type(mesh_t), intent(in) :: mesh
      type(stage_t), intent(in) :: given
      type(combination_t), intent(in) :: combination
      type(experiment_t), intent(in) :: tables(:)
      real(wp), allocatable, intent(out) :: starts(:, :)
      type(error_t), allocatable, intent(out) :: error
      integer, parameter :: most = 3
      type(residual_t) :: problem, trial
      type(stage_t) :: stage
      type(options_t) :: options
      type(error_t), allocatable :: refusal
      !> Relative difference up to which two start values count as the same.
      real(wp), parameter :: same = 0.01_wp
      real(wp), allocatable :: grid(:), misfit(:), values(:)
      logical, allocatable :: is_least(:)
      integer :: i, j, k, n, range

      stage = given
      stage%offset = .false.
      call prepare_fit(model, mesh, tables, stage, problem, error)
      if (allocated(error)) return
      deallocate (stage%start)
      range = maxval(mechanisms(combination%parts)%range)
      grid = [0.0_wp]
      if (range > 0) grid = grid_of(range, problem, tables)
      n = size(stage%free)
      allocate (misfit(0:size(grid) + 1), source=huge(1.0_wp))
      do k = 1, size(grid)
         if (allocated(refusal)) deallocate (refusal)
         call guess(k, trial, misfit(k), refusal)
         if (allocated(refusal)) misfit(k) = huge(misfit)
      end do
      is_least = [(misfit(k) < huge(misfit) .and. misfit(k) <= misfit(k - 1) .and. &
         misfit(k) < misfit(k + 1), k=1, size(grid))]
      ! The end of the grid at the limit of Kelvin-Voigt damping serves as well, because a fit of
      ! the wider model must not end above the fit of its limit.
      k = merge(size(grid), 1, any(range == of_b))
      is_least(k) = misfit(k) < huge(misfit)
      allocate (starts(n, 0))
      do j = 1, min(most, count(is_least))
         k = minloc(misfit(1:size(grid)), dim=1, mask=is_least)
         is_least(k) = .false.
         call guess(k, trial, misfit(k), refusal)
         call match_frequencies(trial)
         ! A step that fails changes nothing.
         call fit_to_modes(trial, stage, options, refusal)
         values = [(as_named(stage%free(i), trial%scenario%get(stage%free(i), stage%record(i))), &
            i=1, n)]
         if (any([(all(abs(values - starts(:, i)) <= same*abs(values)), &
            i=1, size(starts, 2))])) cycle
         starts = reshape([starts, values], [n, size(starts, 2) + 1])
      end do
      if (size(starts, 2) == 0) then
         call move_alloc(refusal, error)
         if (.not. allocated(error)) call failure(error, 'no start value leads to a least misfit')
      end if

   contains

      !> Sets a value of the grid, and the strengths that suit it; arguments as of
      !> `guess_strengths`.
      subroutine guess(k, trial, misfit, error)
         integer, intent(in) :: k
         type(residual_t), intent(out) :: trial
         real(wp), intent(out) :: misfit
         type(error_t), allocatable, intent(out) :: error

         call problem%copy_to(trial)
         if (range > 0) call trial%scenario%set(range, 0, grid(k))
         call guess_strengths(trial, combination, misfit, error)
      end subroutine guess

   end subroutine find_starts

   !> Prepares the fit of a stage to the tables, from the start values of the stage, on a coarse
   !> mesh. Arguments as of `find_starts`.
   subroutine prepare_fit(model, mesh, tables, stage, problem, error)
      type(model_t), intent(in) :: model
      type(mesh_t), intent(in) :: mesh
      type(experiment_t), intent(in) :: tables(:)
      type(stage_t), intent(in) :: stage
      type(residual_t), intent(out) :: problem
      type(error_t), allocatable, intent(out) :: error
      type(mesh_t) :: rough
      integer :: k

      rough = mesh
      rough%elements = min(mesh%elements, coarsest)
      call new_residuals(model, rough, tables, problem, error, stage%free)
      if (allocated(error)) return
      call set_free(problem, stage)
      do k = 1, size(stage%free)
         call problem%scenario%set(stage%free(k), stage%record(k), as_named(stage%free(k), &
            stage%start(k)))
      end do
   end subroutine prepare_fit

   !> Returns values of a rate or range from which fits start.
   pure function grid_of(parameter, problem, tables) result(grid)
      integer, intent(in) :: parameter
      type(residual_t), intent(in) :: problem
      type(experiment_t), intent(in) :: tables(:)
      real(wp), allocatable :: grid(:)
      integer, parameter :: points = 21
      real(wp) :: ends(2)
      integer :: k

      if (any(parameter == of_b)) then
         ends = two_pi*frequency_range(tables)*[0.03_wp, 30.0_wp]
      else
         ends = problem%scenario%structures(1)%length*[0.01_wp, 3.0_wp]
      end if
      grid = [(ends(1)*(ends(2)/ends(1))**(real(k, wp)/(points - 1)), k=0, points - 1)]
   end function grid_of

   !> Sets the strengths of a combination so that its damping ratios agree with those of the tables,
   !> as far as the damping ratios are linear in the strengths and no strength is negative.
   !>
   !> misfit  sum of squares of the remaining differences in standard errors
   !> error   the roots of the model cannot be computed
   subroutine guess_strengths(problem, combination, misfit, error)
      type(residual_t), intent(inout) :: problem
      type(combination_t), intent(in) :: combination
      real(wp), intent(out) :: misfit
      type(error_t), allocatable, intent(out) :: error
      !> Strength at which damping ratios are computed, and least start value, as shares of a
      !> moderate strength.
      real(wp), parameter :: of_moderate = 0.1_wp, least = 1e-3_wp
      real(wp) :: a(2, 2), b(2), strength(2), moderate(2), at(size(combination%parts))
      !> rows of the damping ratios: derivatives by the strengths, and what strengths of 0 leave
      real(wp) :: rows(problem%samples()/2, size(combination%parts)), rest(problem%samples()/2)
      real(wp), allocatable :: jac(:, :), r(:)
      logical, allocatable :: of_damping(:)
      type(mechanism_t) :: m
      integer :: column(2), k, n

      n = size(combination%parts)
      do k = 1, n
         m = mechanisms(combination%parts(k))
         column(k) = findloc(problem%free, m%strength, dim=1)
         moderate(k) = problem%scenario%magnitude_of(m%strength, 0)
         call problem%scenario%set(m%strength, 0, of_moderate*moderate(k))
      end do
      call evaluate_rows(problem, r, jac, error)
      if (allocated(error)) return
      of_damping = .not. are_frequencies(problem)
      at = of_moderate*moderate(:n)
      do k = 1, n
         rows(:, k) = pack(jac(:, column(k)), of_damping)
      end do
      rest = matmul(rows, at) - pack(r, of_damping)
      a(:n, :n) = matmul(transpose(rows), rows)
      b(:n) = matmul(rest, rows)
      strength(:n) = solution(n)
      misfit = sum((rest - matmul(rows, strength(:n)))**2)
      do k = 1, n
         m = mechanisms(combination%parts(k))
         call problem%scenario%set(m%strength, 0, max(strength(k), least*moderate(k)))
      end do

   contains

      !> Returns the least-squares solution with no negative element.
      pure function solution(n) result(x)
         integer, intent(in) :: n
         real(wp) :: x(n), det
         integer :: keep

         if (n == 1) then
            x = b(1)/max(a(1, 1), tiny(1.0_wp))
            return
         end if
         det = a(1, 1)*a(2, 2) - a(1, 2)**2
         x = [a(2, 2)*b(1) - a(1, 2)*b(2), a(1, 1)*b(2) - a(1, 2)*b(1)]
         if (det > epsilon(det)*a(1, 1)*a(2, 2) .and. all(x > 0)) then
            x = x/det
            return
         end if
         ! The mechanism that explains more by itself remains.
         keep = 1
         if (b(2)**2*a(1, 1) > b(1)**2*a(2, 2)) keep = 2
         x = 0
         x(keep) = b(keep)/max(a(keep, keep), tiny(1.0_wp))
      end function solution

   end subroutine guess_strengths

   !> Multiplies E, if it is free, by the factor that brings the frequencies of the model to those
   !> of the tables: time hysteresis stiffens the beam.
   subroutine match_frequencies(problem)
      type(residual_t), intent(inout) :: problem
      real(wp), allocatable :: jac(:, :), measured(:), r(:)
      type(error_t), allocatable :: error
      integer :: i

      if (.not. any(problem%free == of_E .and. problem%record == 0)) return
      call evaluate_rows(problem, r, jac, error)
      if (allocated(error)) return
      measured = [(problem%parts(i)%observed%measured, i=1, size(problem%parts))]
      associate (are => are_frequencies(problem))
         call problem%scenario%set(of_E, 0, problem%scenario%get(of_E, 0) &
            *exp(-2*sum(log(1 + pack(r/measured, are)))/count(are)))
      end associate
   end subroutine match_frequencies

   !> Computes the rows of the tables and their derivatives at the values of the scenario.
   !>
   !> r    (samples) prediction minus measured value, in standard errors
   !> jac  (samples, free)
   subroutine evaluate_rows(problem, r, jac, error)
      type(residual_t), intent(inout) :: problem
      real(wp), allocatable, intent(out) :: r(:), jac(:, :)
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: values(size(problem%free))
      integer :: k, m

      values = [(problem%scenario%get(problem%free(k), problem%record(k)), k=1, size(values))]
      allocate (r(problem%rows()), jac(problem%rows(), size(values)))
      call problem%evaluate(values, r, jac, error)
      m = problem%samples()
      r = r(:m)
      jac = jac(:m, :)
   end subroutine evaluate_rows

   !> Returns for each row of the tables (samples) whether it is a frequency: in each table they
   !> come before the damping ratios.
   function are_frequencies(problem) result(are)
      type(residual_t), intent(in) :: problem
      logical, allocatable :: are(:)
      integer :: i

      allocate (are(0))
      do i = 1, size(problem%parts)
         associate (n => size(problem%parts(i)%observed%measured)/2)
            are = [are, spread(.true., 1, n), spread(.false., 1, n)]
         end associate
      end do
   end function are_frequencies

end module beamid_damping_starts
