!> Rows of results of an ensemble: one for each parameter that a fit or a command tells of, or for
!> each frequency and damping ratio. `beamid_ensembles` and `beamid_fleets` collect them.
module beamid_ensemble_rows
   use beamid_case_files, only: case_t
   use beamid_case_inferences, only: case_inference_t, infer_on_mesh
   use beamid_chains, only: mean_and_deviation
   use beamid_equations, only: equations_t, new_equations
   use beamid_errors, only: error_t
   use beamid_experiments, only: experiment_t
   use beamid_galerkin, only: galerkin_of, galerkin_t, mesh_t
   use beamid_identification, only: stage_fit_t
   use beamid_kinds, only: two_pi, wp
   use beamid_parameters, only: as_named, get_free, offset
   use beamid_profile_likelihood, only: is_lost
   use beamid_resampling, only: percentile_interval
   use beamid_roots, only: damped_roots
   use beamid_statistics, only: unlimited
   use beamid_strings, only: to_text
   use beamid_unknowns, only: name_length, scenario_t
   implicit none
   private

   public :: row_t, add_fit_rows, add_mode_rows, most_modes, replace_intervals

   !> Result of a command for one parameter, in the parameter's unit. `unlimited` stands for a
   !> number that the command does not give, and for the end of an interval without limit.
   type :: row_t
      integer :: elements = 0                      !< number of elements of the mesh
      character(len=name_length) :: parameter = '' !< name, with the record if not shared
      real(wp) :: estimate = unlimited             !< estimate, or mean of the posterior
      real(wp) :: std_error = unlimited            !< its standard error
      real(wp) :: interval(2) = unlimited          !< 95 % interval, by noise alone
      real(wp) :: total(2) = unlimited             !< 95 % interval, with every source of error
      real(wp) :: truth = unlimited                !< value that the record was simulated with
   end type row_t

   !> Number of modes that the command `modes` reports.
   integer, parameter :: most_modes = 5

contains

   !> Adds a row for each estimate of a fit, with its standard error and intervals.
   !>
   !> fit          last stage of the fit on one mesh
   !> experiments  (records) that were fitted
   !> rows         rows so far; those of this fit follow
   !> scenario     the true values, if the records are simulated. Without it the records are
   !>              measured: there is no truth, and `total` holds the intervals with every source
   !>              of error.
   subroutine add_fit_rows(fit, experiments, rows, scenario)
      type(stage_fit_t), intent(in) :: fit
      type(experiment_t), intent(in) :: experiments(:)
      type(row_t), allocatable, intent(inout) :: rows(:)
      type(scenario_t), intent(in), optional :: scenario
      type(row_t) :: new(size(fit%quantities))
      real(wp) :: limits(3)
      integer :: k, r

      do k = 1, size(new)
         associate (row => new(k), q => fit%quantities(k), s => fit%statistics)
            row%elements = fit%elements
            row%parameter = q%name
            row%estimate = q%value
            r = max(q%record, 1)
            if (present(scenario) .and. q%parameter == offset) then
               row%truth = experiments(r)%offset
            else if (present(scenario) .and. q%parameter > 0) then
               row%truth = as_named(q%parameter, get_free(scenario%structures(r), &
                  scenario%excitations(r), q%parameter))
            end if
            if (s%samples == 0) cycle
            if (s%std_error(k) < unlimited .and. s%half_width(k) < unlimited .and. &
               .not. s%is_withdrawn(k)) then
               limits = q%limits(s%std_error(k), s%half_width(k))
               if (limits(1) <= unlimited) row%std_error = limits(1)
               row%interval = limits(2:)
            end if
            if (.not. present(scenario)) then
               if (fit%half_width(k) < unlimited) row%total = q%ends(fit%total(k))
            end if
         end associate
      end do
      rows = [rows, new]
   end subroutine add_fit_rows

   !> Replaces the intervals of linear theory by those of the ensemble's command: profile, bootstrap
   !> or sample. With `sample`, mean and standard deviation of the posterior also replace estimate
   !> and standard error. With `identify` the rows remain as they are.
   !>
   !> mesh         mesh of the fit
   !> experiments  (records) that were fitted
   !> fit          last stage of the fit
   !> rows         rows that `add_fit_rows` has made of the fit
   !> error        a profile, bootstrap or posterior that cannot be computed
   subroutine replace_intervals(case, mesh, experiments, fit, rows, error)
      type(case_t), intent(in) :: case
      type(mesh_t), intent(in) :: mesh
      type(experiment_t), intent(in) :: experiments(:)
      type(stage_fit_t), intent(in) :: fit
      type(row_t), intent(inout) :: rows(:)
      type(error_t), allocatable, intent(out) :: error
      type(case_inference_t) :: found
      real(wp) :: ends(2)
      real(wp), allocatable :: draws(:)
      integer :: k

      associate (command => case%ensemble%command)
         if (command == 'identify') return
         call infer_on_mesh(command, case, mesh, experiments, fit, found, error)
         if (allocated(error)) return
         do k = 1, size(fit%free)
            associate (q => fit%quantities(k), row => rows(k))
               if (command == 'profile') then
                  ends = found%sides(:, k)%end
                  where (found%sides(:, k)%state == is_lost) ends = unlimited
               else if (command == 'bootstrap') then
                  ends = found%resampled%corrected(:, k)
               else
                  draws = found%posterior%draws%q(k, :)
                  ends = percentile_interval(draws)
                  if (q%is_reciprocal()) draws = as_named(q%parameter, draws)
                  call mean_and_deviation(draws, row%estimate, row%std_error)
               end if
               row%interval = ends
               if (q%is_reciprocal()) row%interval = as_named(q%parameter, ends(2:1:-1))
            end associate
         end do
      end associate
   end subroutine replace_intervals

   !> Adds a row for the natural frequency [1/time] and a row for the damping ratio of each of the
   !> lowest modes of a beam, on every mesh of the case.
   !>
   !> scenario  whose first structure is the beam
   !> rows      rows so far; those of the modes follow
   !> error     roots that cannot be found
   subroutine add_mode_rows(case, scenario, rows, error)
      type(case_t), intent(in) :: case
      type(scenario_t), intent(in) :: scenario
      type(row_t), allocatable, intent(inout) :: rows(:)
      type(error_t), allocatable, intent(out) :: error
      type(galerkin_t), target :: galerkin
      type(equations_t) :: equations
      complex(wp), allocatable :: roots(:)
      integer :: j, k

      associate (structure => scenario%structures(1))
         do k = 1, size(case%meshes)
            galerkin = galerkin_of(case%meshes(k), structure)
            equations = new_equations(galerkin, structure, scenario%excitations(1))
            call damped_roots(equations, roots, error)
            if (allocated(error)) return
            do j = 1, min(most_modes, size(roots))
               rows = [rows, row_t(case%meshes(k)%elements, 'frequency_'//to_text(j), &
                  abs(roots(j))/two_pi), row_t(case%meshes(k)%elements, 'damping_'//to_text(j), &
                  -real(roots(j))/max(abs(roots(j)), tiny(1.0_wp)))]
            end do
         end do
      end associate
   end subroutine add_mode_rows

end module beamid_ensemble_rows
