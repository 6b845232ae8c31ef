!> beamid: physical parameters of a flexible beam from an accelerometer record.
!>
!> The facade: all that a program needs which describes a structure, computes its response or fits
!> a record. A fit from beginning to end; example/ holds more, README.md the command line:
!>
!>     use beamid, only: error_t, free_index, identify, mesh_t, modal_t, model_t, new_pulse, &
!>        read_record, recording_t, stage_fit_t, stage_t, structure_t, wp
!>     type(model_t) :: model
!>     type(stage_t) :: stage
!>     type(recording_t) :: recording
!>     type(stage_fit_t), allocatable :: fits(:)
!>     type(error_t), allocatable :: error
!>     real(wp), allocatable :: t(:), acceleration(:)
!>
!>     model%structure = structure_t(length=4, rho=0.03_wp, E=80, I=1, c_D=5e-3_wp, m_T=0.15_wp)
!>     model%excitation = new_pulse(amplitude=1.0_wp, duration=0.05_wp)
!>     model%solver = modal_t()
!>     recording%path = 'record.csv'
!>     call read_record(recording, t, acceleration, error)
!>     if (allocated(error)) error stop error%message
!>     stage%free = [free_index('E'), free_index('c_D')]
!>     call identify(model, mesh_t(elements=16), [stage], t, acceleration, fits, error)
!>     if (allocated(error)) error stop error%message
!>     print *, fits(1)%quantities%value
!>
!> `identify` only searches; `new_verdict` tells whether the model explains the record.
module beamid
   use beamid_boxes, only: box_t
   use beamid_case_fits, only: case_fit_t, fit_case, judge_case, load_case
   use beamid_cases, only: case_t, load_experiments, measured_samples, needs_fit, &
      needs_modes, needs_nothing, needs_response, read_case, sample_times
   use beamid_cvode, only: cvode_t
   use beamid_designs, only: compare_designs, design_t, designs_t
   use beamid_equations, only: equations_t, new_equations
   use beamid_errors, only: error_t, failure
   use beamid_excitation, only: excitation_t, new_base_motion, new_force_table, new_free, &
      new_pulse, new_release
   use beamid_experiments, only: experiment_t
   use beamid_fitted_modes, only: fitted_mode_t, fitted_modes
   use beamid_galerkin, only: galerkin_of, galerkin_t, mesh_t
   use beamid_identification, only: identify, identify_meshes, model_t, simulate, simulation_t, &
      stage_fit_t, stage_t
   use beamid_kinds, only: wp
   use beamid_least_squares, only: fit, fit_t, monitor_t, options_t
   use beamid_modal, only: modal_t
   use beamid_mode_shapes, only: mode_shapes
   use beamid_modes, only: natural_frequencies, undamped_modes
   use beamid_multistart, only: identify_from_many, minimum_t, multistart_t
   use beamid_noise, only: gaussian_noise
   use beamid_observation, only: observation_t
   use beamid_parameters, only: free_index, free_names, get_free, set_free
   use beamid_priors, only: prior_t
   use beamid_problems, only: problem_t, smooth_problem_t
   use beamid_records, only: load_recording, note_length, read_record, recording_t, &
      window_t
   use beamid_refinement, only: add_mesh_shift, identify_refining
   use beamid_responses, only: response_t, solver_t, work_t
   use beamid_roots, only: damped_roots
   use beamid_statistics, only: new_statistics, statistics_t
   use beamid_structure, only: end_t, free_end, hose_t, mass_t, sensor_t, structure_t, support_t
   use beamid_structure_checks, only: check_structure
   use beamid_units, only: units_t
   use beamid_variables, only: new_variable, unbounded, variable_t
   use beamid_verdicts, only: new_verdict, verdict_t
   use beamid_whiteness, only: check_residuals, residual_check_t
   implicit none
   public

   !> Version of the library and of the program.
   character(len=*), parameter :: version = '0.2.0'

end module beamid
