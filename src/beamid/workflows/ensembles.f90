!> Members of an ensemble: each simulates records with parameters and noise of its own and runs a
!> command on them. The result of a member depends on its number alone, not on threads or on other
!> members.
module beamid_ensembles
   use beamid_case_checks, only: check_needs, has_grid, needs_fit
   use beamid_case_files, only: case_t
   use beamid_case_fits, only: find_fits
   use beamid_cases, only: grid_times, load_experiments
   use beamid_ensemble_rows, only: add_fit_rows, add_mode_rows, most_modes, replace_intervals, row_t
   use beamid_errors, only: error_t
   use beamid_excitation, only: new_pulse
   use beamid_experiments, only: experiment_t, prepare_experiment, prepared_experiment_t
   use beamid_galerkin, only: mesh_t
   use beamid_identification, only: stage_fit_t
   use beamid_interrupts, only: stop_flag
   use beamid_kinds, only: ip, wp
   use beamid_linear_unknowns, only: linear_t
   use beamid_modal, only: modal_t
   use beamid_multistart, only: minima_t
   use beamid_noise, only: gaussian_noise, uniform_noise
   use beamid_observed_data, only: seen_modes_t
   use beamid_parameters, only: as_named
   use beamid_records, only: are_in_time, note_length
   use beamid_refusals, only: refuse
   use beamid_responses, only: work_t
   use beamid_simulation, only: refine_for_modes
   use beamid_structure, only: yielding
   use beamid_structure_checks, only: check_structure
   use beamid_unknowns, only: scenario_t
   implicit none
   private

   public :: ensemble_maker_t, member_t, new_ensemble, run_members

   !> Result of one member.
   type :: member_t
      character(len=:), allocatable :: message   !< why it failed; not allocated: it succeeded
      type(row_t), allocatable :: rows(:)        !< its results; of size 0 if it failed
   end type member_t

   !> Everything that the members of an ensemble have in common.
   type :: ensemble_maker_t
      type(case_t) :: case                                 !< with the command and its settings
      !> (records) times and sensors of the records; each member replaces the measured values
      type(experiment_t), allocatable :: experiments(:)
      type(scenario_t) :: scenario                         !< values of the case, before any draw
      !> (records) that simulate the records; unused copies, so that no poles are kept in them
      type(prepared_experiment_t), allocatable, private :: prepared(:)
      !> all records without noise, one after the other [length/time**2]; allocated if no parameter
      !> is drawn, because then all members share them
      real(wp), allocatable, private :: noise_free(:)
   contains
      procedure :: run_member
      procedure, private :: make_records
      procedure, private :: respond
   end type ensemble_maker_t

contains

   !> Prepares an ensemble: loads the sample times, from record files or from their grids, and
   !> checks the case.
   !>
   !> case   with &ensemble, and for every command but `modes` with what a fit needs
   !> error  a case that cannot be simulated or fitted, or members that would all be the same
   subroutine new_ensemble(case, maker, error)
      type(case_t), intent(in) :: case
      type(ensemble_maker_t), intent(out) :: maker
      type(error_t), allocatable, intent(out) :: error
      character(len=note_length), allocatable :: notes(:)
      type(mesh_t) :: mesh
      real(wp) :: remaining
      integer :: i

      call case%copy_to(maker%case)
      call sample_grids(maker%case, error)
      if (allocated(error)) return
      if (.not. needs_records(case)) then
         allocate (maker%experiments(1))
         maker%experiments(1)%excitation = new_pulse(0.0_wp, 1.0_wp)
         if (case%refines) call refine_for_modes(case%model%structure, most_modes, &
            maker%case%meshes(1), remaining, error)
         if (allocated(error)) return
      else
         call check_needs(maker%case, needs_fit, error)
         if (.not. allocated(error) .and. any(case%excitations%modes > 0)) call refuse(case%path, &
            0, 'excitation kind', '''free''', 'a known excitation, to simulate records', error)
         if (.not. allocated(error) .and. size(case%draws) == 0 .and. .not. case%noise_sd > 0 &
            .and. are_in_time(case%recordings)) &
            call refuse(case%path, case%ensemble%line, 'ensemble', 'neither &draw nor &noise', &
            'one of them, so that the members differ', error)
         if (.not. allocated(error)) call load_experiments(maker%case, maker%experiments, notes, &
            error)
         if (allocated(error)) return
      end if
      i = size(maker%experiments)
      allocate (maker%scenario%structures(i), maker%scenario%excitations(i), maker%prepared(i))
      associate (experiments => maker%experiments, structures => maker%scenario%structures)
         mesh = case%meshes(size(case%meshes))
         if (case%ensemble%elements > 0) mesh%elements = case%ensemble%elements
         do i = 1, size(experiments)
            structures(i) = experiments(i)%structure_of(case%model%structure)
            maker%scenario%excitations(i) = experiments(i)%excitation
            structures(i)%yields = yielding([case%draws%parameter])
            if (.not. needs_records(case)) cycle
            experiments(i)%measured = 0*experiments(i)%measured
            call prepare_experiment(experiments(i), structures(i), mesh, case%model%observation, &
               modal_t(), maker%prepared(i), error)
            if (allocated(error)) return
         end do
      end associate
      if (size(case%draws) == 0 .and. needs_records(case)) call maker%respond(maker%scenario, &
         maker%noise_free, error)
   end subroutine new_ensemble

   !> Gives each record without a file the sample times of its grid.
   !>
   !> error  a record with neither a file nor a grid
   subroutine sample_grids(case, error)
      type(case_t), intent(inout) :: case
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: t(:)
      integer :: i

      do i = 1, size(case%recordings)
         associate (recording => case%recordings(i))
            if (allocated(recording%path)) cycle
            if (.not. has_grid(recording%window)) call refuse(case%path, recording%line, &
               'record', 'neither a file nor a grid of sample times', &
               'file, or t_first, t_last and t_step', error)
            if (.not. allocated(error)) call grid_times(case, recording, t, error)
            if (allocated(error)) return
            recording%path = case%path
            recording%t = t
            recording%z = t
         end associate
      end do
   end subroutine sample_grids

   !> Simulates the records of member k and runs the command on them, from the start values of the
   !> case. May run beside other threads.
   !>
   !> k       number of the member
   !> member  rows of results, or the message of the error
   subroutine run_member(self, k, member)
      class(ensemble_maker_t), intent(in) :: self
      integer, intent(in) :: k
      type(member_t), intent(out) :: member
      type(experiment_t), allocatable :: experiments(:)
      type(error_t), allocatable :: error
      type(scenario_t) :: scenario

      allocate (member%rows(0))
      scenario = self%scenario
      call draw_scenario(self%case, k, scenario, error)
      if (.not. allocated(error) .and. needs_records(self%case)) then
         experiments = self%experiments
         call self%make_records(k, scenario, experiments, error)
      end if
      if (.not. allocated(error)) then
         select case (self%case%ensemble%command)
         case ('modes'); call add_mode_rows(self%case, scenario, member%rows, error)
         case default; call fit_member(self%case, experiments, scenario, member%rows, error)
         end select
      end if
      if (allocated(error)) call move_alloc(error%message, member%message)
   end subroutine run_member

   !> Runs a block of members with all threads.
   !>
   !> first    number of the first member
   !> members  the members, from `first` on
   subroutine run_members(maker, first, members)
      class(ensemble_maker_t), intent(in) :: maker
      integer, intent(in) :: first
      type(member_t), intent(inout) :: members(:)
      integer :: k

      !$omp parallel do schedule(dynamic, 1) copyin(stop_flag)
      do k = 1, size(members)
         call maker%run_member(first + k - 1, members(k))
      end do
      !$omp end parallel do
   end subroutine run_members

   !> Returns whether the command needs records; `modes` needs the beam alone.
   pure logical function needs_records(case)
      type(case_t), intent(in) :: case

      needs_records = case%ensemble%command /= 'modes'
   end function needs_records

   !> Draws the parameters of member k, each uniformly between the bounds of its &draw.
   !>
   !> scenario  on return with the drawn values
   !> error     values that make no valid structure
   subroutine draw_scenario(case, k, scenario, error)
      type(case_t), intent(in) :: case
      integer, intent(in) :: k
      type(scenario_t), intent(inout) :: scenario
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: u(size(case%draws))
      integer :: i

      if (size(u) == 0) return
      u = uniform_noise(size(u), seed_of(case%ensemble%seed, 2_ip*k))
      do i = 1, size(u)
         associate (draw => case%draws(i))
            call scenario%set(draw%parameter, 0, as_named(draw%parameter, &
               draw%low + u(i)*(draw%high - draw%low)))
         end associate
      end do
      do i = 1, size(scenario%structures)
         call check_structure(scenario%structures(i), error)
         if (allocated(error)) return
      end do
   end subroutine draw_scenario

   !> Returns a seed for each number of an ensemble. Ensembles with neighbouring seeds get seeds far
   !> apart.
   !>
   !> seed    seed of the ensemble
   !> number  2 k for the draws of member k, 2 k + 1 for its noise
   pure integer function seed_of(seed, number)
      integer, intent(in) :: seed
      integer(ip), intent(in) :: number
      !> 2**32 over the golden ratio, and the number of seeds
      integer(ip), parameter :: golden = 2654435769_ip, seeds = 2_ip**32

      seed_of = int(modulo(seed*golden + number, seeds) - seeds/2)
   end function seed_of

   !> Simulates the records of a beam and adds the noise of member k: that of &noise, or the noise
   !> that a record of another kind than 'time' states.
   !>
   !> experiments  (records) on return with the simulated values
   !> error        a response that cannot be computed
   subroutine make_records(self, k, scenario, experiments, error)
      class(ensemble_maker_t), intent(in) :: self
      integer, intent(in) :: k
      type(scenario_t), intent(in) :: scenario
      type(experiment_t), intent(inout) :: experiments(:)
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: noise(:), unit(:), z(:)
      integer :: first, i, m, seed

      if (allocated(self%noise_free)) then
         z = self%noise_free
      else
         call self%respond(scenario, z, error)
         if (allocated(error)) return
      end if
      seed = seed_of(self%case%ensemble%seed, 2_ip*k + 1)
      noise = 0*z
      if (self%case%noise_sd > 0) noise = gaussian_noise(size(z), self%case%noise_sd, seed)
      if (any([(experiments(i)%has_known_noise(), i=1, size(experiments))])) &
         unit = gaussian_noise(size(z), 1.0_wp, seed)
      first = 0
      do i = 1, size(experiments)
         m = size(experiments(i)%measured)
         associate (values => z(first + 1:first + m))
            if (experiments(i)%has_known_noise()) then
               values = values + unit(first + 1:first + m)
            else
               values = values + noise(first + 1:first + m)
            end if
            experiments(i)%measured = values
            if (allocated(experiments(i)%observed)) call experiments(i)%observed%take(values)
         end associate
         first = first + m
      end do
   end subroutine make_records

   !> Computes the noise-free records of a beam by the exact response.
   !>
   !> z      all records, one after the other [length/time**2]
   !> error  a response that cannot be computed
   subroutine respond(self, scenario, z, error)
      class(ensemble_maker_t), intent(in) :: self
      type(scenario_t), intent(in) :: scenario
      real(wp), allocatable, intent(out) :: z(:)
      type(error_t), allocatable, intent(out) :: error
      type(prepared_experiment_t) :: fresh
      type(seen_modes_t) :: first
      type(linear_t) :: linear
      type(work_t) :: work
      integer :: i, m, n
      integer, parameter :: none(0) = 0

      n = 0
      allocate (z(sum([(size(self%experiments(i)%measured), i=1, size(self%experiments))])))
      do i = 1, size(self%experiments)
         ! A copy for each beam: poles kept from another beam would change the last digits.
         fresh = self%prepared(i)
         m = size(self%experiments(i)%measured)
         call evaluate(z(n + 1:n + m))
         if (allocated(error)) return
         n = n + m
      end do

   contains

      !> Computes record i.
      subroutine evaluate(y)
         real(wp), intent(out) :: y(:)
         real(wp) :: dy(size(y), 0)

         call fresh%evaluate(scenario%structures(i), scenario%excitations(i), .false., none, y, &
            dy, linear, work, error, first)
      end subroutine evaluate

   end subroutine respond

   !> Fits the records of a member with all stages on every mesh and runs the command on the last
   !> stage.
   !>
   !> scenario  the true values
   !> rows      rows so far; those of the last stage follow, mesh by mesh
   !> error     of the first mesh that fails
   subroutine fit_member(case, experiments, scenario, rows, error)
      type(case_t), intent(in) :: case
      type(experiment_t), intent(in) :: experiments(:)
      type(scenario_t), intent(in) :: scenario
      type(row_t), allocatable, intent(inout) :: rows(:)
      type(error_t), allocatable, intent(out) :: error
      type(stage_fit_t), allocatable :: fits(:, :)
      type(minima_t), allocatable :: minima(:)
      type(mesh_t) :: meshes(1)
      integer :: first, k, n

      n = size(case%stages)
      ! Each mesh is completed before the next, so that the message is that of the first failure.
      do k = 1, size(case%meshes)
         meshes(1) = case%meshes(k)
         call find_fits(case, meshes, experiments, fits, minima, error, check=.false.)
         if (allocated(error)) return
         first = size(rows) + 1
         call add_fit_rows(fits(n, 1), experiments, rows, scenario)
         call replace_intervals(case, meshes(1), experiments, fits(n, 1), rows(first:), error)
         if (allocated(error)) return
      end do
   end subroutine fit_member

end module beamid_ensembles
