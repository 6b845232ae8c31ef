!> Start values from frequency responses and tables of modes.
!>
!> The resonances of a frequency response make a table of modes. A fit to the tables alone converges
!> from far away, because frequencies are smooth functions of the parameters, while the residuals of
!> a sharp resonance are not. Parameters that the tables do not determine stay near the values that
!> a default prior expects.
module beamid_peak_starts
   use beamid_errors, only: error_t
   use beamid_frequency_responses, only: frequency_response_t
   use beamid_kinds, only: two_pi, wp
   use beamid_least_squares, only: fit, fit_t, options_t
   use beamid_modal_tables, only: assign_modes, modal_table_t
   use beamid_model_roots, only: belief_t, beliefs_about, model_roots
   use beamid_parameters, only: parameters
   use beamid_priors, only: prior_t
   use beamid_residuals, only: residual_t
   use beamid_response_peaks, only: find_peaks, peak_t
   use beamid_unknowns, only: quantity_t, stage_t, variables_of
   use beamid_variables, only: variable_t
   implicit none
   private

   public :: fit_to_modes, start_from_peaks

contains

   !> Finds start values for a stage, and puts them into the scenario of the fit. First it fits the
   !> natural frequencies and damping ratios that the records show. If there are records in time, it
   !> then fits all other records. At last it compares the result with a fit from the values of the
   !> case, and takes that if it ends with a lower J. A step that fails changes nothing.
   !>
   !> problem  the fit, with the free parameters of the stage
   !> stage    on return without start values, because the scenario has them
   !> error    start values that are not allowed
   subroutine start_from_peaks(problem, stage, options, error)
      type(residual_t), intent(inout) :: problem
      type(stage_t), intent(inout) :: stage
      type(options_t), intent(in) :: options
      type(error_t), allocatable, intent(out) :: error
      type(residual_t) :: reduced, from_case
      logical, allocatable :: is_in_time(:)
      integer :: r

      call place_starts(problem, stage, error)
      if (allocated(error)) return
      call problem%copy_to(from_case)
      call fit_to_modes(problem, stage, options, error)
      if (allocated(error)) return
      is_in_time = [(problem%parts(r)%observed%kind() == 'time', r=1, size(problem%parts))]
      if (any(is_in_time)) then
         call problem%copy_to(reduced)
         do r = 1, size(problem%parts)
            if (is_in_time(r)) call leave_out(reduced, r)
         end do
         call improve(problem, reduced, stage, options)
      end if
      call reconsider(problem, from_case, stage, options)
   end subroutine start_from_peaks

   !> Fits the modes that the records show, and puts the estimates into the scenario of a fit. Signs
   !> and units of frequency responses do not matter for that.
   !>
   !> problem, stage, error  as of `start_from_peaks`
   subroutine fit_to_modes(problem, stage, options, error)
      type(residual_t), intent(inout) :: problem
      type(stage_t), intent(inout) :: stage
      type(options_t), intent(in) :: options
      type(error_t), allocatable, intent(out) :: error
      type(residual_t) :: reduced
      integer :: r

      call place_starts(problem, stage, error)
      if (allocated(error)) return
      call problem%copy_to(reduced)
      do r = 1, size(problem%parts)
         call use_modes(reduced, r)
      end do
      call improve(problem, reduced, stage, options)
   end subroutine fit_to_modes

   !> Moves the start values of a stage, if it has any, into the scenario of the fit.
   subroutine place_starts(problem, stage, error)
      type(residual_t), intent(inout) :: problem
      type(stage_t), intent(inout) :: stage
      type(error_t), allocatable, intent(out) :: error
      type(variable_t), allocatable :: variables(:)
      type(quantity_t), allocatable :: quantities(:)

      call variables_of(stage, problem%scenario, variables, quantities, error)
      if (allocated(error)) return
      problem%scenario = problem%with([variables%start])
      if (allocated(stage%start)) deallocate (stage%start)
   end subroutine place_starts

   !> Replaces the start values of a fit by the estimates of a reduced fit, with the expected values
   !> of the parameters, if that fit converges.
   subroutine improve(problem, reduced, stage, options)
      type(residual_t), intent(inout) :: problem, reduced
      type(stage_t), intent(in) :: stage
      type(options_t), intent(in) :: options
      real(wp) :: J

      call add_beliefs(reduced)
      call reduced%guess_noise()
      call search(reduced, stage, options, J)
      if (J < huge(J)) problem%scenario = problem%with(values_of(reduced))
   end subroutine improve

   !> Compares the values of the case with the start values from the peaks, because peaks mislead if
   !> the lines do not resolve them. If the values of the case explain the records better, all
   !> records are fitted from both, and the start values become the estimates of the first fit if it
   !> ends with the lower J.
   !>
   !> problem    with the start values from the peaks
   !> from_case  the same fit with the values of the case
   subroutine reconsider(problem, from_case, stage, options)
      type(residual_t), intent(inout) :: problem, from_case
      type(stage_t), intent(in) :: stage
      type(options_t), intent(in) :: options
      type(residual_t) :: from_peaks
      real(wp) :: J_case, J_peaks

      call problem%copy_to(from_peaks)
      call from_case%guess_noise()
      call from_peaks%guess_noise()
      call find_misfit(from_case, J_case)
      call find_misfit(from_peaks, J_peaks)
      if (.not. J_case < J_peaks) return
      call search(from_case, stage, options, J_case)
      call search(from_peaks, stage, options, J_peaks)
      if (J_case < J_peaks) problem%scenario = from_case%scenario
   end subroutine reconsider

   !> Computes the sum of squares at the values of the scenario; huge if that fails.
   subroutine find_misfit(problem, J)
      type(residual_t), intent(inout) :: problem
      real(wp), intent(out) :: J
      type(error_t), allocatable :: failed
      real(wp) :: r(problem%rows())

      J = huge(J)
      call problem%residuals(values_of(problem), r, failed)
      if (.not. allocated(failed)) J = sum(r**2)
   end subroutine find_misfit

   !> Fits from the values of the scenario, and puts the estimates into it.
   !>
   !> J  sum of squares; huge if the fit fails
   subroutine search(problem, stage, options, J)
      type(residual_t), intent(inout) :: problem
      type(stage_t), intent(in) :: stage
      type(options_t), intent(in) :: options
      real(wp), intent(out) :: J
      type(variable_t), allocatable :: variables(:)
      type(quantity_t), allocatable :: quantities(:)
      type(error_t), allocatable :: failed
      type(options_t) :: quick
      type(fit_t) :: found

      J = huge(J)
      call variables_of(stage, problem%scenario, variables, quantities, failed)
      if (allocated(failed)) return
      quick = options
      quick%check = .false.
      quick%max_evaluations = 200
      call fit(problem, problem%rows(), variables, quick, found, failed)
      if (allocated(failed)) return
      J = found%J
      problem%scenario = problem%with(found%estimate)
   end subroutine search

   !> Returns the values of the free parameters (n) in the scenario of a fit.
   function values_of(problem) result(values)
      type(residual_t), intent(in) :: problem
      real(wp) :: values(size(problem%free))
      integer :: k

      values = [(problem%scenario%get(problem%free(k), problem%record(k)), k=1, size(values))]
   end function values_of

   !> Replaces record r by a table of the modes that it shows; leaves a time record out.
   subroutine use_modes(problem, r)
      type(residual_t), intent(inout) :: problem
      integer, intent(in) :: r
      type(modal_table_t), allocatable :: table

      select type (observed => problem%parts(r)%observed)
      type is (modal_table_t)
         return
      type is (frequency_response_t)
         allocate (table)
         call make_table(problem, r, observed, table)
      end select
      if (.not. allocated(table)) then
         call leave_out(problem, r)
         return
      end if
      call set_data(problem, r, table)
   end subroutine use_modes

   !> Replaces record r by an empty table.
   subroutine leave_out(problem, r)
      type(residual_t), intent(inout) :: problem
      integer, intent(in) :: r
      type(modal_table_t), allocatable :: table

      allocate (table)
      allocate (table%mode(0), table%frequency(0), table%sd_frequency(0))
      call set_data(problem, r, table)
   end subroutine leave_out

   !> Makes a table the data of record r.
   subroutine set_data(problem, r, table)
      type(residual_t), intent(inout) :: problem
      integer, intent(in) :: r
      type(modal_table_t), allocatable, intent(inout) :: table

      table%measured = table%values()
      table%sd = 1
      table%noise_is_known = .true.
      problem%scenario%excitations(r)%modes = 0
      deallocate (problem%parts(r)%observed)
      call move_alloc(table, problem%parts(r)%observed)
   end subroutine set_data

   !> Makes a table of the resonances of a frequency response. Peaks that cannot be assigned to
   !> modes are left out, the lowest first.
   !>
   !> r  number of the record
   subroutine make_table(problem, r, response, table)
      type(residual_t), intent(inout) :: problem
      integer, intent(in) :: r
      type(frequency_response_t), intent(in) :: response
      type(modal_table_t), intent(inout) :: table
      !> Largest numbers of peaks and of modes that are computed.
      integer, parameter :: most_peaks = 6, most_modes = 12
      !> Standard deviations: of a frequency as a share of itself, of a damping ratio likewise.
      real(wp), parameter :: of_frequency = 1e-3_wp, of_damping = 0.3_wp
      !> Standard deviation of a frequency as a share of the distance between lines.
      real(wp), parameter :: of_spacing = 0.2_wp
      !> Height of a peak in standard deviations from which its width shows the damping.
      real(wp), parameter :: clear = 30
      type(peak_t), allocatable :: peaks(:)
      complex(wp), allocatable :: s(:), ds(:, :)
      type(error_t), allocatable :: failed
      real(wp) :: spacing
      integer :: n

      peaks = find_peaks(response%frequency, response%h, response%noise, response%noise_is_known, &
         most_peaks)
      allocate (table%mode(0))
      do n = min(most_modes, problem%parts(r)%galerkin%space%n/2), 1, -1
         s = spread((0.0_wp, 0.0_wp), 1, n)
         if (allocated(ds)) deallocate (ds)
         allocate (ds(n, size(problem%free)))
         call model_roots(problem, problem%scenario, r, s, ds, failed)
         if (.not. allocated(failed)) exit
      end do
      do n = min(size(peaks), size(s)), 1, -1
         if (allocated(failed)) exit
         table%mode = spread(0, 1, n)
         call assign_modes([peaks(:n)%frequency], abs(s)/two_pi, table%mode)
         if (all(table%mode > 0)) exit
      end do
      if (any(table%mode == 0)) table%mode = [integer ::]
      n = size(table%mode)
      table%frequency = peaks(:n)%frequency
      spacing = (maxval(response%frequency) - minval(response%frequency)) &
         /max(1, size(response%frequency) - 1)
      table%sd_frequency = of_frequency*table%frequency + of_spacing*spacing
      table%damping = peaks(:n)%damping - response%rate/(two_pi*table%frequency)
      table%sd_damping = of_damping*abs(table%damping)
      ! Without a damping ratio the row has no weight.
      where (.not. table%damping > 0 .or. peaks(:n)%size < clear*peaks(:n)%noise)
         table%damping = 0
         table%sd_damping = 1e3_wp
      end where
   end subroutine make_table

   !> Adds the expectation of each free parameter that has no prior of the user.
   subroutine add_beliefs(problem)
      type(residual_t), intent(inout) :: problem
      type(belief_t) :: beliefs(size(problem%free))
      type(prior_t), allocatable :: priors(:)
      real(wp) :: sd(size(problem%free)), values(size(problem%free))
      logical :: needed(size(problem%free))
      integer :: j, k, n

      values = values_of(problem)
      beliefs = beliefs_about(problem%scenario, problem%free, problem%record, values, &
         problem%priors)
      sd = beliefs%width
      where (beliefs%logarithmic) sd = sd*abs(values)
      do k = 1, size(sd)
         if (parameters(problem%free(k))%is_reciprocal) sd(k) = sd(k)/max(values(k)**2, &
            tiny(1.0_wp))
      end do
      needed = .not. beliefs%stated .and. sd > 0 .and. sd < huge(sd)
      n = size(problem%priors)
      allocate (priors(n + count(needed)))
      priors(:n) = problem%priors
      j = n
      do k = 1, size(needed)
         if (.not. needed(k)) cycle
         j = j + 1
         priors(j)%parameter = [problem%free(k)]
         priors(j)%slope = [1.0_wp]
         priors(j)%record = problem%record(k)
         priors(j)%sd = sd(k)
         priors(j)%centre = spread(values(k), 1, size(problem%parts))
      end do
      call move_alloc(priors, problem%priors)
   end subroutine add_beliefs

end module beamid_peak_starts
