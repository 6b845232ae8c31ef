!> beamid: physical parameters of a flexible beam from an accelerometer record.
!>
!> The facade: everything that a program needs. See README.md for the command-line program.
module beamid
   use beamid_amplification, only: deviation_t, equation_row, formula_times, gains, measure, &
      mode_observers
   use beamid_bands, only: band_t
   use beamid_cases, only: case_t, measured_samples, needs_fit, needs_nothing, needs_response, &
      read_case, sample_times, scored_samples, load_experiments
   use beamid_cvode, only: cvode_t
   use beamid_equations, only: equations_t, new_equations
   use beamid_errors, only: bad_input, error_t, failure, status_bad_input, status_failed
   use beamid_excitation, only: excitation_t, new_force_table, new_free, new_pulse, new_release
   use beamid_experiments, only: experiment_t
   use beamid_fields, only: field_t, find_field, graded_times, motion_size, norm_H, norm_V
   use beamid_fitted_modes, only: fitted_mode_t, fitted_modes
   use beamid_galerkin, only: galerkin_t, mesh_t, new_galerkin, same_mesh
   use beamid_identification, only: identify, identify_meshes, model_t, score_fits, simulate, &
      simulation_t, stage_fit_t, stage_t
   use beamid_kinds, only: wp
   use beamid_least_squares, only: fit, fit_t, monitor_t, options_t
   use beamid_modal, only: modal_t
   use beamid_mode_summaries, only: fitted_modes_summary, minima_summary, modes_summary
   use beamid_modes, only: undamped_modes
   use beamid_multistart, only: identify_from_many, minimum_t, multistart_t
   use beamid_noise, only: gaussian_noise
   use beamid_observation, only: formula_names, new_sampling, observation_t, sampling_t
   use beamid_outputs, only: output_t
   use beamid_paths, only: directory_of, join_path
   use beamid_problems, only: problem_t
   use beamid_profiles, only: difference_bound, lowest_places, profile, squared_distance, &
      sum_of_squares
   use beamid_records, only: load_recording, note_length, read_record, recording_t, take_samples, &
      window_t
   use beamid_responses, only: response_t, solver_t, work_t
   use beamid_roots, only: damped_roots
   use beamid_sorting, only: middle
   use beamid_statistics, only: akaike, bayes, nested_test, new_statistics, statistics_t, &
      undetermined
   use beamid_strings, only: fixed, full, to_text
   use beamid_parameters, only: free_index, free_names, get_free
   use beamid_structure, only: structure_t
   use beamid_summaries, only: fit_summary, response_summary
   use beamid_tables, only: add_autocorrelation, add_correlations, add_fitted_modes, &
      add_minima, autocorrelation_header, fitted_modes_header, minima_header, &
      correlations_header, add_estimates, add_fit, add_modes, add_response, estimates_header, &
      fit_header, labels_table, modes_header, record_table, response_header
   use beamid_texts, only: left, right, text_t
   use beamid_units, only: units_t
   use beamid_variables, only: new_variable, unbounded, variable_t
   use beamid_whiteness, only: check_residuals, residual_check_t
   implicit none
   public

   !> Version of the library and of the program.
   character(len=*), parameter :: version = '0.1.0'

end module beamid
