!> The case file: one namelist group for each part of the experiment, every key with a documented
!> default or required, every value checked where it is read.
module beamid_case_files
   use beamid_errors, only: error_t, bad_input
   use beamid_excitation, only: excitation_t
   use beamid_experiments, only: experiment_t
   use beamid_files, only: read_text
   use beamid_galerkin, only: mesh_t
   use beamid_identification, only: model_t, stage_t
   use beamid_kinds, only: wp
   use beamid_method_groups, only: read_discretization, read_integrator, read_multistart, &
      read_observation, read_stage
   use beamid_modal, only: modal_t
   use beamid_multistart, only: multistart_t
   use beamid_model_groups, only: read_excitation, read_noise, read_structure, read_units
   use beamid_namelist, only: block_t, scan_namelist
   use beamid_record_groups, only: read_recording, read_score
   use beamid_parameters, only: check_structure
   use beamid_records, only: append_recording, everything, recording_t, window_t
   use beamid_refusals, only: refuse
   use beamid_vocabulary, only: case_vocabulary
   use beamid_strings, only: to_text
   use beamid_structure, only: structure_t
   use beamid_units, only: units_t
   implicit none
   private

   public :: case_t, read_case, check_place
   public :: needs_nothing, needs_response, needs_fit

   !> What a command needs of a case: the structure alone, a response at given times, a fit.
   integer, parameter :: needs_nothing = 0, needs_response = 1, needs_fit = 2

   type :: case_t
      character(len=:), allocatable :: path     !< as given
      character(len=:), allocatable :: name     !< file name without folder and ending
      type(model_t) :: model
      type(mesh_t), allocatable :: meshes(:)    !< one for each entry of `elements`
      type(recording_t), allocatable :: recordings(:)
      !> one for each recording, or one for all
      type(excitation_t), allocatable :: excitations(:)
      !> over which `identify` adds up squared residuals once the fit is done
      type(window_t) :: score
      integer :: score_line = 0                 !< of the group &score; 0: there is none
      type(stage_t), allocatable :: stages(:)
      type(multistart_t) :: multistart
      type(units_t) :: units
      !> of the noise that `simulate` adds to a record [acceleration]
      real(wp) :: noise_sd = 0
      integer :: noise_seed = 1
      integer, allocatable :: stage_lines(:)    !< of the groups &stage
   contains
      procedure :: can_be_fitted
   end type case_t

contains

   !> Reads and checks a case file.
   !>
   !> path   of the case file; paths inside it are relative to it
   !> needs  needs_nothing, needs_response or needs_fit
   !> error  one line per problem: file, line, group, key, what was found, what was expected
   subroutine read_case(path, needs, case, error)
      character(len=*), intent(in) :: path
      integer, intent(in) :: needs
      type(case_t), intent(out) :: case
      type(error_t), allocatable, intent(out) :: error
      type(block_t), allocatable :: blocks(:)
      character(len=:), allocatable :: text
      integer :: k

      call read_text(path, text, error)
      if (allocated(error)) return
      call scan_namelist(path, text, case_vocabulary(), blocks, error)
      if (allocated(error)) return
      case%path = path
      case%name = name_of(path)
      case%meshes = [mesh_t()]
      allocate (modal_t :: case%model%solver)
      allocate (case%stages(0), case%stage_lines(0), case%recordings(0), case%excitations(0))

      call read_groups(blocks, case, error)
      if (.not. allocated(error)) call check_needs(case, needs, error)
      if (.not. allocated(error) .and. needs == needs_response) call settle(case, error)
   end subroutine read_case

   !> The one experiment whose response is wanted: the beam as its record has it.
   subroutine settle(case, error)
      type(case_t), intent(inout) :: case
      type(error_t), allocatable, intent(out) :: error
      type(experiment_t) :: experiment

      associate (recording => case%recordings(1), model => case%model)
         experiment%length = recording%length
         experiment%x_S = recording%x_S
         model%structure = experiment%structure_of(model%structure)
         call check_place(case, recording, model%structure, error)
      end associate
   end subroutine settle

   !> Every group in turn; the structure first and the stages last, whatever the order in the file,
   !> because others are checked against it, and they against others.
   subroutine read_groups(blocks, case, error)
      type(block_t), intent(in) :: blocks(:)
      type(case_t), intent(inout) :: case
      type(error_t), allocatable, intent(out) :: error
      type(stage_t) :: stage
      type(recording_t) :: recording
      type(excitation_t) :: excitation
      integer :: pass, k

      do pass = 1, 4
         do k = 1, size(blocks)
            associate (block => blocks(k), path => case%path, model => case%model)
               select case (trim(block%name)//achar(48 + pass))
               case ('beam1', 'tip2', 'sensor2', 'hose2')
                  call read_structure(path, block, model%structure, error)
               case ('discretization3'); call read_discretization(path, block, case%meshes, error)
               case ('integrator3'); call read_integrator(path, block, model%solver, error)
               case ('observation3'); call read_observation(path, block, model%observation, error)
               case ('multistart3'); call read_multistart(path, block, case%multistart, error)
               case ('score3'); call read_score(path, block, case%score, case%score_line, error)
               case ('noise3'); call read_noise(path, block, case%noise_sd, case%noise_seed, error)
               case ('units3'); call read_units(path, block, case%units, error)
               case ('excitation3')
                  call read_excitation(path, block, excitation, error)
                  case%excitations = [case%excitations, excitation]
               case ('record3')
                  call read_recording(path, block, recording, error)
                  call append_recording(case%recordings, recording)
               case ('stage4')
                  call read_stage(path, block, model%structure, size(case%recordings), &
                     case%excitations, stage, error)
                  case%stages = [case%stages, stage]
                  case%stage_lines = [case%stage_lines, block%line]
               end select
            end associate
            if (allocated(error)) return
         end do
      end do
      if (size(case%excitations) > 0) case%model%excitation = case%excitations(1)
      if (size(case%excitations) > 1 .and. size(case%excitations) /= size(case%recordings)) &
         call bad_input(error, case%path//': &excitation: found '// &
         to_text(size(case%excitations))//' such groups for '//to_text(size(case%recordings))// &
         ' of &record, expected one, or one for each record')
   end subroutine read_groups

   !> Refuses a case that lacks what the command needs.
   subroutine check_needs(case, needs, error)
      type(case_t), intent(in) :: case
      integer, intent(in) :: needs
      type(error_t), allocatable, intent(out) :: error

      integer :: k

      if (needs == needs_nothing) return
      if (size(case%excitations) == 0) then
         call bad_input(error, case%path//': &excitation: found no such group, expected one')
      else if (size(case%recordings) == 0) then
         call bad_input(error, case%path//': &record: found no such group, expected one')
      else if (needs == needs_fit) then
         do k = 1, size(case%recordings)
            if (.not. allocated(case%recordings(k)%path)) call refuse(case%path, &
               case%recordings(k)%line, 'record', 'file', 'nothing', 'the path of a record', error)
         end do
         if (.not. allocated(error) .and. size(case%stages) == 0) call bad_input(error, &
            case%path//': &stage: found no such group, expected one or more')
         if (.not. allocated(error) .and. case%score_line > 0 .and. &
            (size(case%recordings) > 1 .or. any(case%excitations%modes > 0) .or. &
            any(case%stages%offset))) call bad_input(error, case%path//':'// &
            to_text(case%score_line)//': &score: found it beside several records, a free start '// &
            'or a free offset, expected one record with a known start')
      else if (size(case%recordings) > 1) then
         call bad_input(error, case%path//':'//to_text(case%recordings(2)%line)// &
            ': &record: found a second one, expected one for a response')
      else if (case%excitations(1)%modes > 0) then
         call bad_input(error, case%path// &
            ': &excitation kind: found ''free'', expected a start that is known for a response')
      else if (case%recordings(1)%window%t_step <= 0 .or. &
               case%recordings(1)%window%t_first <= -everything .or. &
               case%recordings(1)%window%t_last >= everything) then
         call bad_input(error, case%path//':'//to_text(case%recordings(1)%line)// &
            ': &record: found no grid of sample times, expected t_first, t_last and t_step')
      end if
   end subroutine check_needs

   !> Whether the case has all that a fit needs.
   logical function can_be_fitted(self)
      class(case_t), intent(in) :: self
      type(error_t), allocatable :: error

      call check_needs(self, needs_fit, error)
      can_be_fitted = .not. allocated(error)
   end function can_be_fitted

   !> A record's own length and sensor must go together.
   subroutine check_place(case, recording, structure, error)
      type(case_t), intent(in) :: case
      type(recording_t), intent(in) :: recording
      type(structure_t), intent(in) :: structure
      type(error_t), allocatable, intent(out) :: error

      call check_structure(structure, error)
      if (allocated(error)) error%message = case%path//':'//to_text(recording%line)// &
         ': &record '//error%message
   end subroutine check_place

   !> File name without folder and ending.
   pure function name_of(path) result(name)
      character(len=*), intent(in) :: path
      character(len=:), allocatable :: name
      integer :: dot

      name = path(index(path, '/', back=.true.) + 1:)
      dot = index(name, '.', back=.true.)
      if (dot > 1) name = name(:dot - 1)
   end function name_of

end module beamid_case_files
