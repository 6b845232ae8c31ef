!> Computations of `beamid reproduce acceleration`: compares CVODE with the exact response of the
!> same mesh by each acceleration formula, so that only the error of the integrator remains, for the
!> motion of the tip and for the share of each mode in it.
module beamid_acceleration_study
   use beamid
   use beamid_amplification, only: deviation_t, equation_row, formula_times, measure, mode_observers
   use beamid_beam_motions, only: beam_motion_t, find_motion
   use beamid_interrupts, only: stop_flag
   use beamid_paths, only: join_path
   implicit none
   private

   public :: study_t, compute_study, share, tolerances, closer

   !> Relative tolerances of the integrator.
   real(wp), parameter :: tolerances(*) = [1e-3_wp, 1e-4_wp, 1e-5_wp, 1e-6_wp, 1e-7_wp, 1e-8_wp, &
      1e-9_wp, 1e-10_wp]

   !> Integrations that are examined mode by mode: setting (1: with c_D, 2: without) and index of
   !> the tolerance.
   integer, parameter :: closer(2, 3) = reshape([1, 2, 1, 5, 2, 2], [2, 3])

   !> The structure on the mesh of the study, with or without damping of the beam.
   type :: setting_t
      real(wp) :: c_D = 0                          !< Kelvin-Voigt damping
      type(equations_t) :: equations
      type(beam_motion_t) :: exact                 !< motion, exact in time
      !> (n) undamped circular frequencies of the mesh, ascending [1/time]
      real(wp), allocatable :: omega(:)
      real(wp), allocatable :: observers(:, :)     !< (n, n) as `mode_observers` returns them
      real(wp), allocatable :: row(:)              !< (n) as `equation_row` returns it
   end type setting_t

   !> Outcome of one integration.
   type :: outcome_t
      type(error_t), allocatable :: error          !< why it failed
   end type outcome_t

   !> Results of the study.
   type :: study_t
      type(case_t) :: truth                        !< the structure of Table 4.1
      real(wp), allocatable :: samples(:)          !< (m) ascending sample times [time]
      real(wp) :: delta = 0                        !< time step of (4.1) and (4.2) [time]
      type(setting_t) :: settings(2)               !< with c_D, without
      !> undamped circular frequencies of the beam, on the finest mesh of the case [1/time]
      real(wp), allocatable :: beam(:)
      !> (0:modes, tolerances, settings) deviations from the exact motion; mode 0 is the tip itself
      type(deviation_t), allocatable :: deviations(:, :, :)
   end type study_t

contains

   !> Reads the structure, computes exact motion and modes with c_D and without, and runs every
   !> integration.
   !>
   !> data   folder of the case files
   !> error  a case that cannot be read, or a response that cannot be computed
   subroutine compute_study(data, study, error)
      character(len=*), intent(in) :: data
      type(study_t), intent(out) :: study
      type(error_t), allocatable, intent(out) :: error
      type(galerkin_t), target :: galerkin, fine
      type(structure_t) :: structure
      type(equations_t) :: beam
      real(wp), allocatable :: shapes(:, :)
      integer :: k

      call read_case(join_path(data, 'table_4_1_truth.nml'), needs_response, study%truth, error)
      if (.not. allocated(error)) call sample_times(study%truth, study%samples, error)
      if (allocated(error)) return
      study%delta = study%truth%model%observation%delta
      structure = study%truth%model%structure
      galerkin = new_galerkin(mesh_t(degree=3, elements=4), structure%length)
      associate (excitation => study%truth%model%excitation, meshes => study%truth%meshes)
         fine = new_galerkin(meshes(size(meshes)), structure%length)
         beam = new_equations(fine, structure, excitation)
         call undamped_modes(beam, study%beam, shapes, error)
         do k = 1, size(study%settings)
            if (allocated(error)) exit
            if (k == 2) structure%c_D = 0
            associate (setting => study%settings(k))
               setting%c_D = structure%c_D
               setting%equations = new_equations(galerkin, structure, excitation)
               call find_motion(setting%equations, excitation, formula_times(study%samples, &
                  study%delta), setting%exact, error)
               if (.not. allocated(error)) call mode_observers(setting%equations, setting%omega, &
                  setting%observers, error)
               if (.not. allocated(error)) call equation_row(setting%equations, setting%row, error)
            end associate
         end do
      end associate
      if (.not. allocated(error)) call integrate(study, error)
      ! The mesh that the equations point to is local to this procedure.
      do k = 1, size(study%settings)
         nullify (study%settings(k)%equations%galerkin)
      end do
   end subroutine compute_study

   !> Runs every integration, in parallel; the long ones come first.
   !>
   !> study  on return with `deviations`
   !> error  of the first integration that fails
   subroutine integrate(study, error)
      type(study_t), intent(inout) :: study
      type(error_t), allocatable, intent(out) :: error
      type(outcome_t), allocatable :: outcomes(:)
      integer, allocatable :: places(:, :)   ! (3, integrations) indices in `deviations`
      integer :: setting, tolerance, mode, modes, k

      modes = size(study%settings(1)%omega)
      allocate (study%deviations(0:modes, size(tolerances), size(study%settings)))
      allocate (outcomes(size(study%settings)*size(tolerances) + modes*size(closer, 2)))
      places = reshape([((0, tolerance, setting, setting=size(study%settings), 1, -1), &
         tolerance=size(tolerances), 1, -1), ((mode, closer(2, k), closer(1, k), mode=1, modes), &
         k=1, size(closer, 2))], [3, size(outcomes)])
      !$omp parallel do schedule(dynamic, 1) copyin(stop_flag)
      do k = 1, size(outcomes)
         call compare(study, places(:, k), study%deviations(places(1, k), places(2, k), &
            places(3, k)), outcomes(k)%error)
      end do
      !$omp end parallel do
      do k = 1, size(outcomes)
         if (allocated(error)) return
         if (allocated(outcomes(k)%error)) call move_alloc(outcomes(k)%error, error)
      end do
   end subroutine integrate

   !> Integrates once and compares the response with the exact motion.
   !>
   !> place  mode, index of the tolerance, setting
   !> error  an integration that fails
   subroutine compare(study, place, deviation, error)
      type(study_t), intent(in) :: study
      integer, intent(in) :: place(3)
      type(deviation_t), intent(out) :: deviation
      type(error_t), allocatable, intent(out) :: error
      type(equations_t), target :: equations
      type(cvode_t) :: solver
      type(response_t) :: computed
      type(work_t) :: work

      associate (setting => study%settings(place(3)))
         equations = setting%equations
         equations%observer = equations%tip
         if (place(1) > 0) equations%observer = setting%observers(:, place(1))
         solver%rtol = tolerances(place(2))
         call solver%respond(equations, study%truth%model%excitation, setting%exact%t, computed, &
            work, error)
         if (allocated(error)) return
         deviation = measure(computed, setting%exact%seen_by(equations%observer), study%samples, &
            study%delta)
      end associate
   end subroutine compare

   !> Returns the share of a mode in the squared acceleration error of (3.13).
   !>
   !> tolerance  index in `tolerances`
   !> setting    1: with c_D, 2: without
   pure real(wp) function share(study, mode, tolerance, setting)
      type(study_t), intent(in) :: study
      integer, intent(in) :: mode, tolerance, setting

      associate (part => study%deviations(1:, tolerance, setting)%rms(3))
         share = part(mode)**2/sum(part**2)
      end associate
   end function share

end module beamid_acceleration_study
