!> Members of an ensemble: each makes a record, with parameters and noise of its own, and runs a
!> command on it. What a member finds depends on its number alone, on no thread and no other member.
module beamid_ensembles
   use beamid_case_checks, only: check_needs, has_grid, needs_fit
   use beamid_case_files, only: case_t
   use beamid_case_fits, only: find_fits, minima_t
   use beamid_case_inferences, only: case_inference_t, infer_on_mesh
   use beamid_cases, only: grid_times, load_experiments
   use beamid_chains, only: mean_and_deviation
   use beamid_equations, only: equations_t, new_equations
   use beamid_errors, only: error_t
   use beamid_excitation, only: new_pulse
   use beamid_experiments, only: prepared_experiment_t, experiment_t, prepare_experiment, &
      seen_modes_t
   use beamid_galerkin, only: galerkin_of, galerkin_t, mesh_t
   use beamid_identification, only: stage_fit_t
   use beamid_kinds, only: ip, wp
   use beamid_linear_unknowns, only: linear_t
   use beamid_modal, only: modal_t
   use beamid_noise, only: gaussian_noise, uniform_noise
   use beamid_parameters, only: as_named, get_free, offset
   use beamid_profile_likelihood, only: is_lost
   use beamid_records, only: note_length
   use beamid_refusals, only: refuse
   use beamid_resampling, only: percentile_interval
   use beamid_responses, only: work_t
   use beamid_roots, only: damped_roots
   use beamid_statistics, only: unlimited
   use beamid_strings, only: to_text
   use beamid_structure, only: of_kappa_R
   use beamid_structure_checks, only: check_structure
   use beamid_unknowns, only: name_length, scenario_t
   implicit none
   private

   public :: ensemble_maker_t, member_t, row_t, new_ensemble, add_fit_rows

   !> What a command says of one parameter; `unlimited`: nothing.
   type :: row_t
      integer :: elements = 0
      character(len=name_length) :: parameter = ''
      real(wp) :: estimate = unlimited, std_error = unlimited
      real(wp) :: interval(2) = unlimited      !< of 95 %, by the noise of the record
      real(wp) :: total(2) = unlimited         !< with every source of error
      real(wp) :: truth = unlimited            !< what made the record
   end type row_t

   !> What became of a member.
   type :: member_t
      character(len=:), allocatable :: message   !< why it failed; not allocated: it did not
      type(row_t), allocatable :: rows(:)
   end type member_t

   !> What all members have in common.
   type :: ensemble_maker_t
      type(case_t) :: case
      type(experiment_t), allocatable :: experiments(:)    !< of which the samples are replaced
      type(scenario_t) :: scenario                         !< of the beam as the case has it
      !> Of the records, as yet unused.
      type(prepared_experiment_t), allocatable, private :: makers(:)
      real(wp), allocatable, private :: clean(:)           !< where nothing is drawn: all records
   contains
      procedure :: run_member
      procedure, private :: make_records
      procedure, private :: respond
   end type ensemble_maker_t

   !> Modes that `modes` tells of.
   integer, parameter :: most_modes = 5

contains

   !> Reads what the members need: sample times, from records or from their grid.
   subroutine new_ensemble(case, maker, error)
      type(case_t), intent(in) :: case
      type(ensemble_maker_t), intent(out) :: maker
      type(error_t), allocatable, intent(out) :: error
      character(len=note_length), allocatable :: notes(:)
      type(mesh_t) :: mesh
      integer :: i

      maker%case = case
      call sample_grids(maker%case, error)
      if (allocated(error)) return
      if (.not. needs_records(case)) then
         allocate (maker%experiments(1))
         maker%experiments(1)%excitation = new_pulse(0.0_wp, 1.0_wp)
      else
         call check_needs(maker%case, needs_fit, error)
         if (.not. allocated(error) .and. any(case%excitations%modes > 0)) call refuse(case%path, &
            0, 'excitation kind', '''free''', 'a start that is known, to make records', error)
         if (.not. allocated(error) .and. size(case%draws) == 0 .and. .not. case%noise_sd > 0) &
            call refuse(case%path, case%ensemble%line, 'ensemble', 'neither &draw nor &noise', &
            'something that differs between members', error)
         if (.not. allocated(error)) call load_experiments(maker%case, maker%experiments, notes, &
            error)
         if (allocated(error)) return
      end if
      i = size(maker%experiments)
      allocate (maker%scenario%structures(i), maker%scenario%excitations(i), maker%makers(i))
      associate (experiments => maker%experiments, structures => maker%scenario%structures)
         mesh = case%meshes(size(case%meshes))
         if (case%ensemble%elements > 0) mesh%elements = case%ensemble%elements
         do i = 1, size(experiments)
            structures(i) = experiments(i)%structure_of(case%model%structure)
            maker%scenario%excitations(i) = experiments(i)%excitation
            structures(i)%root_is_free = any(case%draws%parameter == of_kappa_R)
            if (.not. needs_records(case)) cycle
            experiments(i)%measured = 0*experiments(i)%samples
            call prepare_experiment(experiments(i), structures(i), mesh, case%model%observation, &
               modal_t(), maker%makers(i), error)
            if (allocated(error)) return
         end do
      end associate
      if (size(case%draws) == 0 .and. needs_records(case)) call maker%respond(maker%scenario, &
         maker%clean, error)
   end subroutine new_ensemble

   !> Records without a file are at the times of their grids.
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

   !> Makes the records of member k and runs the command on them, from the declared start. In
   !> threads.
   subroutine run_member(self, k, member)
      class(ensemble_maker_t), intent(in) :: self
      integer, intent(in) :: k
      type(member_t), intent(out) :: member
      type(experiment_t), allocatable :: experiments(:)
      type(error_t), allocatable :: error
      type(scenario_t) :: scenario

      allocate (member%rows(0))
      scenario = self%scenario
      call draw_world(self%case, k, scenario, error)
      if (.not. allocated(error) .and. needs_records(self%case)) then
         experiments = self%experiments
         call self%make_records(k, scenario, experiments, error)
      end if
      if (.not. allocated(error)) then
         select case (self%case%ensemble%command)
         case ('modes'); call modes_of_member(self%case, scenario, member%rows, error)
         case default; call fit_member(self%case, experiments, scenario, member%rows, error)
         end select
      end if
      if (allocated(error)) call move_alloc(error%message, member%message)
   end subroutine run_member

   !> Whether the command is about records, or about the beam alone.
   pure logical function needs_records(case)
      type(case_t), intent(in) :: case

      needs_records = case%ensemble%command /= 'modes'
   end function needs_records

   !> The beam of member k.
   subroutine draw_world(case, k, scenario, error)
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
   end subroutine draw_world

   !> A seed for each number, far apart for neighbouring seeds.
   pure integer function seed_of(seed, number)
      integer, intent(in) :: seed
      integer(ip), intent(in) :: number
      integer(ip), parameter :: golden = 2654435769_ip, all = 2_ip**32

      seed_of = int(modulo(seed*golden + number, all) - all/2)
   end function seed_of

   !> Records of a beam, with the noise of member k.
   subroutine make_records(self, k, scenario, experiments, error)
      class(ensemble_maker_t), intent(in) :: self
      integer, intent(in) :: k
      type(scenario_t), intent(in) :: scenario
      type(experiment_t), intent(inout) :: experiments(:)
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: z(:)
      integer :: first, i, m

      if (allocated(self%clean)) then
         z = self%clean
      else
         call self%respond(scenario, z, error)
         if (allocated(error)) return
      end if
      if (self%case%noise_sd > 0) z = z + gaussian_noise(size(z), self%case%noise_sd, &
         seed_of(self%case%ensemble%seed, 2_ip*k + 1))
      first = 0
      do i = 1, size(experiments)
         m = size(experiments(i)%samples)
         experiments(i)%measured = z(first + 1:first + m)
         first = first + m
      end do
   end subroutine make_records

   !> What the sensors see of a beam, all records one behind the other, by the exact response.
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
      allocate (z(sum([(size(self%experiments(i)%samples), i=1, size(self%experiments))])))
      do i = 1, size(self%experiments)
         ! Poles that are kept from another beam would show in the last digits.
         fresh = self%makers(i)
         m = size(self%experiments(i)%samples)
         call evaluate(z(n + 1:n + m))
         if (allocated(error)) return
         n = n + m
      end do

   contains

      subroutine evaluate(y)
         real(wp), intent(out) :: y(:)
         real(wp) :: dy(size(y), 0)

         call fresh%evaluate(scenario%structures(i), scenario%excitations(i), .false., none, y, &
            dy, &
            linear, work, error, first)
      end subroutine evaluate

   end subroutine respond

   !> All stages on every mesh; rows are of the last stage.
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
      ! One mesh is done with before the next, so that the first thing that fails is what is told.
      do k = 1, size(case%meshes)
         meshes(1) = case%meshes(k)
         call find_fits(case, meshes, experiments, fits, minima, error, check=.false.)
         if (allocated(error)) return
         first = size(rows) + 1
         call add_fit_rows(fits(n, 1), experiments, rows, scenario)
         call infer(case, meshes(1), experiments, fits(n, 1), rows(first:), error)
         if (allocated(error)) return
      end do
   end subroutine fit_member

   !> In the place of linear theory's what the command has for an interval; of the posterior also
   !> for estimate and standard error, its mean and standard deviation.
   !>
   !> rows  of the fit
   subroutine infer(case, mesh, experiments, fit, rows, error)
      type(case_t), intent(in) :: case
      type(mesh_t), intent(in) :: mesh
      type(experiment_t), intent(in) :: experiments(:)
      type(stage_fit_t), intent(in) :: fit
      type(row_t), intent(inout) :: rows(:)
      type(error_t), allocatable, intent(out) :: error
      type(case_inference_t) :: found
      real(wp) :: ends(2)
      real(wp), allocatable :: x(:)
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
                  x = found%posterior%draws%q(k, :)
                  ends = percentile_interval(x)
                  if (q%is_reciprocal()) x = as_named(q%parameter, x)
                  call mean_and_deviation(x, row%estimate, row%std_error)
               end if
               row%interval = ends
               if (q%is_reciprocal()) row%interval = as_named(q%parameter, ends(2:1:-1))
            end associate
         end do
      end associate
   end subroutine infer

   !> Estimates and their intervals.
   !>
   !> scenario  that made the records; left out: they are measured, and every source of error counts
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

   !> Frequencies and damping ratios of a beam.
   subroutine modes_of_member(case, scenario, rows, error)
      type(case_t), intent(in) :: case
      type(scenario_t), intent(in) :: scenario
      type(row_t), allocatable, intent(inout) :: rows(:)
      type(error_t), allocatable, intent(out) :: error
      type(galerkin_t), target :: galerkin
      type(equations_t) :: equations
      complex(wp), allocatable :: roots(:)
      integer :: j, k
      real(wp), parameter :: two_pi = 2*acos(-1.0_wp)

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
   end subroutine modes_of_member

end module beamid_ensembles
