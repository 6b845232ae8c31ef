!> The command `frf`: the frequency response of a structure, or of a fitted one with its 95 % band.
module beamid_frequency_runs
   use beamid_case_checks, only: can_be_fitted, check_needs, needs_modes, place_experiment
   use beamid_case_files, only: case_t
   use beamid_case_fits, only: case_fit_t, fail_if_rejected, fit_case, judge_case, load_case
   use beamid_errors, only: error_t, locate
   use beamid_experiments, only: experiment_t
   use beamid_frequency_data, only: line_frequencies
   use beamid_frequency_responses, only: frequency_response_t, predict_response
   use beamid_galerkin, only: galerkin_of, mesh_t
   use beamid_identification, only: stage_fit_t
   use beamid_kinds, only: wp
   use beamid_least_squares, only: monitor_t
   use beamid_modal, only: modal_t
   use beamid_observed_data, only: meshed_model_t
   use beamid_records, only: recording_t
   use beamid_refusals, only: refuse
   use beamid_responses, only: prepare_for, work_t
   use beamid_simulation, only: lowest_modes, refine_for_modes
   use beamid_statistics, only: unlimited
   use beamid_structure, only: structure_t
   implicit none
   private

   public :: band_of_magnitude, case_response_t, compute_responses, prepare_responses

   !> The frequency response of a case.
   type :: case_response_t
      real(wp), allocatable :: frequency(:)    !< (n) [1/time]
      complex(wp), allocatable :: h(:, :)      !< (n, meshes)
      !> (n, 2, meshes) ends of the 95 % interval of the magnitude; not allocated: nothing was
      !> fitted
      real(wp), allocatable :: band(:, :, :)
      integer :: power = 2                     !< 0: receptance, 1: mobility, 2: accelerance
      logical :: is_fitted = .false.           !< the structure is that of a fit
      type(experiment_t) :: experiment         !< where the force acts, and which sensor responds
      real(wp) :: rate = 0                     !< decay rate of an exponential window [1/time]
      type(case_t) :: fitted                   !< the case with only those records that have a file
      type(case_fit_t) :: fit                  !< its records, fit and verdict
      !> largest relative change of a natural frequency in the last refinement of the mesh; 0: the
      !> mesh was not refined
      real(wp) :: remaining = 0
      integer :: record = 1   !< number of the fit's record whose structure responds
   end type case_response_t

contains

   !> Checks a case for `frf`, takes the frequencies of the first record of the kind 'frf' without a
   !> file or, if there is none, of the first with a file, and loads the records if the case can be
   !> fitted.
   !>
   !> error  no such record, or no frequencies
   subroutine prepare_responses(case, found, error)
      type(case_t), intent(in) :: case
      type(case_response_t), intent(inout) :: found
      type(error_t), allocatable, intent(out) :: error
      type(recording_t) :: recording
      logical, allocatable :: is_response(:), has_file(:)
      integer :: k, place

      call check_needs(case, needs_modes, error)
      if (allocated(error)) return
      is_response = [(case%recordings(k)%kind == 'frf', k=1, size(case%recordings))]
      has_file = [(allocated(case%recordings(k)%path), k=1, size(case%recordings))]
      place = findloc(is_response .and. .not. has_file, .true., dim=1)
      if (place == 0) place = findloc(is_response, .true., dim=1)
      if (place == 0) then
         call refuse(case%path, 0, 'record', 'no group with kind=''frf''', 'one, with f_first, '// &
            'f_last and f_step, or with the file of a measured response', error)
         return
      end if
      recording = case%recordings(place)
      found%power = recording%lines%power
      found%rate = recording%lines%rate
      call place_experiment(case, place, found%experiment, error)
      if (allocated(error)) return
      call find_fit(case, found, error)
      if (allocated(error)) return
      if (has_file(place)) found%record = count(has_file(:place))
      if (.not. allocated(recording%path) .or. allocated(recording%lines%step)) then
         call line_frequencies(case%path, recording, found%frequency, error)
         return
      end if
      if (.not. found%is_fitted) then
         call refuse(case%path, recording%line, 'record', 'a measured response and no fit', &
            'f_first, f_last and f_step, or a &stage', error)
         return
      end if
      select type (observed => found%fit%experiments(found%record)%observed)
      type is (frequency_response_t)
         found%frequency = observed%frequency
      end select
   end subroutine prepare_responses

   !> Loads the records of the fit that a case describes, if it describes one.
   subroutine find_fit(case, found, error)
      type(case_t), intent(in) :: case
      type(case_response_t), intent(inout) :: found
      type(error_t), allocatable, intent(out) :: error
      logical :: has_file(size(case%recordings))
      integer :: k

      if (size(case%stages) == 0) return
      has_file = [(allocated(case%recordings(k)%path), k=1, size(has_file))]
      call case%copy_to(found%fitted)
      found%fitted%recordings = pack(case%recordings, has_file)
      found%is_fitted = can_be_fitted(found%fitted)
      if (found%is_fitted) call check_order(case, has_file, error)
      if (allocated(error)) return
      if (found%is_fitted) call load_case(found%fitted, found%fit, error)
   end subroutine find_fit

   !> Refuses a record without a file before one with a file if other groups refer to records by
   !> their numbers: the fit leaves it out, and the numbers would change.
   !>
   !> has_file  (records)
   subroutine check_order(case, has_file, error)
      type(case_t), intent(in) :: case
      logical, intent(in) :: has_file(:)
      type(error_t), allocatable, intent(inout) :: error
      logical :: refers
      integer :: k

      if (all(has_file(:count(has_file)))) return
      refers = size(case%excitations) > 1 .or. any(case%model%priors%record > 0)
      do k = 1, size(case%stages)
         if (allocated(case%stages(k)%record)) refers = refers .or. any(case%stages(k)%record > 0)
      end do
      if (refers) call refuse(case%path, case%recordings(findloc(has_file, .false., dim=1))%line, &
         'record', 'a record without file before one with file', &
         'records without file after all others', error)
   end subroutine check_order

   !> Fits the case if it can be fitted, and computes the frequency response on each mesh. Without
   !> `elements`, the mesh is refined: for the estimates, or without a fit for the lowest natural
   !> frequencies.
   !>
   !> case   on return with the refined mesh
   !> error  a fit that fails or that the verdict rejects, a response that cannot be computed
   subroutine compute_responses(case, found, error, monitor)
      type(case_t), intent(inout) :: case
      type(case_response_t), intent(inout) :: found
      type(error_t), allocatable, intent(out) :: error
      class(monitor_t), intent(inout), optional :: monitor
      integer :: k

      if (case%refines .and. .not. found%is_fitted) call refine_for_modes( &
         found%experiment%structure_of(case%model%structure), lowest_modes, case%meshes(1), &
         found%remaining, error)
      call locate(error, case%path)
      if (allocated(error)) return
      if (found%is_fitted) then
         call fit_case(found%fitted, found%fit, error, monitor)
         if (.not. allocated(error)) call judge_case(found%fitted, found%fit, error, monitor)
         call fail_if_rejected(found%fitted, found%fit, error)
         if (allocated(error)) return
         case%meshes = found%fitted%meshes
         allocate (found%band(size(found%frequency), 2, size(case%meshes)))
      end if
      allocate (found%h(size(found%frequency), size(case%meshes)))
      do k = 1, size(case%meshes)
         if (found%is_fitted) then
            associate (last => found%fit%fits(size(found%fit%fits, 1), k))
               call compute_one(found, case%meshes(k), last%scenario%structures(found%record), &
                  found%h(:, k), error, last, found%band(:, :, k))
            end associate
         else
            call compute_one(found, case%meshes(k), case%model%structure, found%h(:, k), error)
         end if
         call locate(error, case%path)
         if (allocated(error)) return
      end do
   end subroutine compute_responses

   !> Computes the frequency response of one structure on one mesh.
   !>
   !> h     (n)
   !> fit   fit whose estimates the structure has; absent: none
   !> band  (n, 2) as in `case_response_t`
   subroutine compute_one(found, mesh, structure, h, error, fit, band)
      type(case_response_t), intent(in) :: found
      type(mesh_t), intent(in) :: mesh
      type(structure_t), intent(in) :: structure
      complex(wp), intent(out) :: h(:)
      type(error_t), allocatable, intent(out) :: error
      type(stage_fit_t), intent(in), optional :: fit
      real(wp), intent(out), optional :: band(:, :)
      type(meshed_model_t), target :: model
      type(structure_t) :: placed
      type(work_t) :: work
      integer, allocatable :: free(:)
      complex(wp), allocatable :: response(:, :)
      integer :: k

      placed = found%experiment%structure_of(structure)
      free = [integer ::]
      if (present(fit)) free = fit%free
      model%galerkin = galerkin_of(mesh, placed, moving=free)
      allocate (modal_t :: model%solver)
      call prepare_for(model%galerkin, model%solver, error)
      if (allocated(error)) return
      allocate (response(size(h), 0:size(free)))
      call predict_response(model, placed, found%experiment%excitation, found%power, found%rate, &
         found%frequency, free, response, work, error)
      if (allocated(error)) return
      h = response(:, 0)
      ! Parameters of other records do not act on this structure.
      do k = 1, size(free)
         if (all(fit%quantities(k)%record /= [0, found%record])) response(:, k) = 0
      end do
      if (present(fit)) band = band_of_magnitude(fit, h, response(:, 1:))
   end subroutine compute_one

   !> Returns the ends of the 95 % interval of the magnitude of a frequency response, from the
   !> intervals of the estimates and their correlations; 0 and a huge number if an estimate is not
   !> determined. The shifts of the estimates on finer meshes do not count, because they leave the
   !> fitted response nearly as it is.
   !>
   !> h   (n) response
   !> dh  (n, parameters) its derivatives with respect to the searched variables
   pure function band_of_magnitude(fit, h, dh) result(band)
      type(stage_fit_t), intent(in) :: fit
      complex(wp), intent(in) :: h(:), dh(:, :)
      real(wp) :: band(size(h), 2)
      real(wp) :: half(size(dh, 2)), slope(size(dh, 2)), width
      integer :: i, k, n

      n = size(dh, 2)
      band(:, 1) = 0
      band(:, 2) = unlimited
      if (fit%statistics%samples == 0) return
      half = [(fit%half_width(k), k=1, n)]
      if (any(half >= sqrt(unlimited))) return
      do i = 1, size(h)
         slope = real(conjg(h(i))*dh(i, :))/max(abs(h(i)), tiny(width))*half
         width = sqrt(max(0.0_wp, dot_product(slope, matmul(fit%statistics%correlation(:n, :n), &
            slope))))
         band(i, :) = [max(0.0_wp, abs(h(i)) - width), abs(h(i)) + width]
      end do
   end function band_of_magnitude

end module beamid_frequency_runs
