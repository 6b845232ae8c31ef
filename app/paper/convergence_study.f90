!> What `beamid reproduce convergence` computes: exact motions on cubic meshes against one of a fine
!> quintic mesh, and fits of the cubic meshes to it.
module beamid_convergence_study
   use beamid
   use beamid_beam_motions, only: beam_motion_t, find_motion, graded_times, motion_size
   use beamid_interrupts, only: stop_flag
   use beamid_paths, only: join_path
   implicit none
   private

   public :: motion_t, compute_motions, forces, loads, motions, fitted, reference, coarser

   character(len=*), parameter :: forces(2) = [character(len=9) :: 'hat', 'rectangle']
   character(len=*), parameter :: loads(2) = [character(len=11) :: 'point', 'distributed']

   !> Cubic meshes: of the motions, of the fits.
   integer, parameter :: motions(*) = [2, 4, 8, 16, 32, 64], fitted(*) = [2, 3, 4, 6, 8, 12, 16]
   !> Quintic meshes: what stands for the beam, and what its own error is measured by.
   integer, parameter :: reference = 128, coarser = 64
   !> Panels of the time integral; twice as many move no error by more than 3 %.
   integer, parameter :: panels = 400

   !> One force with one load.
   type :: motion_t
      integer :: force = 0, load = 0
      type(excitation_t) :: excitation
      real(wp) :: exact(3) = 0                 !< size of the motion, as `motion_size` has it
      real(wp) :: error(3, size(motions)) = 0  !< of the cubic meshes, relative to it
      real(wp) :: order(3, size(motions)) = 0  !< at which they fall from the mesh before
      real(wp) :: rest(3) = 0                  !< of the coarser quintic mesh, relative
      type(stage_fit_t), allocatable :: fits(:, :)
      !> Of the estimates from the true values, relative, and in the last row of all together.
      real(wp), allocatable :: distance(:, :)
      real(wp), allocatable :: approach(:, :)  !< orders at which they fall
      type(error_t), allocatable :: failure
   end type motion_t

contains

   !> Reads the structure; every force with every load.
   !>
   !> data     folder of the case files
   !> samples  of the fits
   subroutine compute_motions(data, truth, samples, studies, error)
      character(len=*), intent(in) :: data
      type(case_t), intent(out) :: truth
      real(wp), allocatable, intent(out) :: samples(:)
      type(motion_t), allocatable, intent(out) :: studies(:)
      type(error_t), allocatable, intent(out) :: error
      type(case_t) :: case
      integer :: k

      call read_case(join_path(data, 'table_4_1_truth.nml'), needs_response, truth, error)
      if (.not. allocated(error)) call read_case(join_path(data, 'table_4_1_fit.nml'), needs_fit, &
         case, error)
      if (.not. allocated(error)) call sample_times(truth, samples, error)
      if (.not. allocated(error)) call make_forces(truth%model%excitation, studies, error)
      if (allocated(error)) return
      !$omp parallel do schedule(dynamic, 1) copyin(stop_flag)
      do k = 1, size(studies)
         call find_motions(studies(k), truth%model%structure, samples(size(samples)))
      end do
      !$omp end parallel do
      do k = 1, size(studies)
         if (allocated(studies(k)%failure)) call move_alloc(studies(k)%failure, error)
         if (.not. allocated(error)) call find_minimisers(studies(k), truth%model, case%stages, &
            samples, error)
         if (allocated(error)) return
      end do
   end subroutine compute_motions

   !> The pulse of the paper and a hat of the same length and impulse, each with both loads.
   subroutine make_forces(pulse, studies, error)
      type(excitation_t), intent(in) :: pulse
      type(motion_t), allocatable, intent(out) :: studies(:)
      type(error_t), allocatable, intent(out) :: error
      integer :: force, load, k

      allocate (studies(size(forces)*size(loads)))
      k = 0
      do force = 1, size(forces)
         do load = 1, size(loads)
            k = k + 1
            studies(k)%force = force
            studies(k)%load = load
            associate (excitation => studies(k)%excitation, last => pulse%t(size(pulse%t)))
               excitation = pulse
               if (force == 1) call new_force_table([0.0_wp, last/2, last], &
                  [0.0_wp, 2*pulse%amplitude, 0.0_wp], excitation, error)
               if (allocated(error)) return
               excitation%distributed = load == 2
               excitation%power = 2
            end associate
         end do
      end do
   end subroutine make_forces

   !> Exact motions of all meshes, against that of the reference; `failure` is set where one fails.
   subroutine find_motions(study, structure, finish)
      type(motion_t), intent(inout) :: study
      type(structure_t), intent(in) :: structure
      real(wp), intent(in) :: finish
      type(beam_motion_t) :: exact, field
      real(wp), allocatable :: times(:), weights(:)
      integer :: k

      call graded_times(study%excitation, finish, panels, times, weights)
      call solve(mesh_t(degree=5, elements=reference, gauss_points=6), exact)
      if (allocated(study%failure)) return
      study%exact = motion_size(exact, weights)
      call solve(mesh_t(degree=5, elements=coarser, gauss_points=6), field)
      if (allocated(study%failure)) return
      study%rest = motion_size(exact, weights, field)/study%exact
      do k = 1, size(motions)
         call solve(mesh_t(degree=3, elements=motions(k)), field)
         if (allocated(study%failure)) return
         study%error(:, k) = motion_size(exact, weights, field)/study%exact
      end do
      study%order = orders(study%error, motions)

   contains

      subroutine solve(mesh, field)
         type(mesh_t), intent(in) :: mesh
         type(beam_motion_t), intent(out) :: field
         type(galerkin_t), target :: galerkin
         type(equations_t) :: equations

         galerkin = new_galerkin(mesh, structure%length)
         equations = new_equations(galerkin, structure, study%excitation)
         call find_motion(equations, study%excitation, times, field, study%failure)
      end subroutine solve

   end subroutine find_motions

   !> Fits of the cubic meshes to the accelerations of a quintic one, all responses exact in time.
   subroutine find_minimisers(study, truth, stages, samples, error)
      type(motion_t), intent(inout) :: study
      type(model_t), intent(in) :: truth
      type(stage_t), intent(in) :: stages(:)
      real(wp), intent(in) :: samples(:)
      type(error_t), allocatable, intent(out) :: error
      type(model_t) :: model
      type(simulation_t) :: simulation
      real(wp), allocatable :: distance(:)
      integer :: j, k

      model = truth
      deallocate (model%solver)
      allocate (modal_t :: model%solver)
      model%excitation = study%excitation
      call simulate(model, mesh_t(degree=5, elements=coarser, gauss_points=6), samples, &
         simulation, error)
      if (allocated(error)) return
      call identify_meshes(model, [(mesh_t(degree=3, elements=fitted(k)), k=1, size(fitted))], &
         stages, samples, simulation%acceleration, study%fits, error)
      if (allocated(error)) return
      allocate (study%distance(size(study%fits(1, 1)%free) + 1, size(fitted)))
      do k = 1, size(fitted)
         associate (fit => study%fits(1, k))
            distance = [(fit%fit%estimate(j)/truth%structure%get(fit%free(j)) - 1, &
               j=1, size(fit%free))]
         end associate
         study%distance(:, k) = [distance, norm2(distance)]
      end do
      study%approach = orders(study%distance, fitted)
   end subroutine find_minimisers

   !> Orders at which errors fall from one mesh to the next; 0 for the first.
   !>
   !> errors    (k, meshes)
   !> elements  (meshes)
   pure function orders(errors, elements)
      real(wp), intent(in) :: errors(:, :)
      integer, intent(in) :: elements(:)
      real(wp) :: orders(size(errors, 1), size(elements))
      integer :: k

      orders(:, 1) = 0
      do k = 2, size(elements)
         orders(:, k) = log(abs(errors(:, k - 1)/errors(:, k)))/ &
            log(real(elements(k), wp)/elements(k - 1))
      end do
   end function orders

end module beamid_convergence_study
