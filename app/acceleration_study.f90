!> What `beamid reproduce acceleration` computes: CVODE against the exact response of the same mesh
!> by each formula, so that nothing but the integrator's error is left; for the motion of the tip
!> and for each mode's share in it.
module beamid_acceleration_study
   use beamid
   use beamid_amplification, only: deviation_t, equation_row, formula_times, measure, mode_observers
   use beamid_fields, only: field_t, find_field
   use beamid_paths, only: join_path
   implicit none
   private

   public :: study_t, compute_study, deviation_of, share, tolerances, closer

   real(wp), parameter :: tolerances(*) = [1e-3_wp, 1e-4_wp, 1e-5_wp, 1e-6_wp, 1e-7_wp, 1e-8_wp, &
      1e-9_wp, 1e-10_wp]

   !> What is looked at mode by mode: with c_D (1) or without (2), and the place of the tolerance.
   integer, parameter :: closer(2, 3) = reshape([1, 2, 1, 5, 2, 2], [2, 3])

   !> The structure, with or without damping of the beam.
   type :: setting_t
      type(equations_t) :: equations
      type(field_t) :: exact
      real(wp), allocatable :: omega(:)            !< undamped, of the mesh [1/time]
      real(wp), allocatable :: observers(:, :)     !< of each mode's share in the tip's motion
      real(wp), allocatable :: row(:)              !< what (3.13) does to the displacements
   end type setting_t

   !> One integration and what it was compared with.
   type :: job_t
      integer :: setting = 0, tolerance = 0
      integer :: mode = 0                          !< 0: the tip itself
      type(deviation_t) :: deviation
      type(error_t), allocatable :: error
   end type job_t

   type :: study_t
      type(case_t) :: truth
      real(wp), allocatable :: samples(:)
      real(wp) :: delta = 0
      type(setting_t) :: settings(2)
      real(wp), allocatable :: beam(:)             !< frequencies of the beam itself [1/time]
      type(job_t), allocatable :: jobs(:)
   end type study_t

contains

   !> Reads the structure and integrates.
   !>
   !> data  folder of the case files
   subroutine compute_study(data, study, error)
      character(len=*), intent(in) :: data
      type(study_t), intent(out) :: study
      type(error_t), allocatable, intent(out) :: error
      type(galerkin_t), target :: galerkin, fine
      integer :: k

      call read_case(join_path(data, 'table_4_1_truth.nml'), needs_response, study%truth, error)
      if (.not. allocated(error)) call sample_times(study%truth, study%samples, error)
      if (allocated(error)) return
      study%delta = study%truth%model%observation%delta
      associate (length => study%truth%model%structure%length, meshes => study%truth%meshes)
         galerkin = new_galerkin(mesh_t(degree=3, elements=4), length)
         fine = new_galerkin(meshes(size(meshes)), length)
      end associate
      call prepare(study, galerkin, fine, error)
      if (.not. allocated(error)) call integrate(study, error)
      ! Their mesh ends here.
      do k = 1, size(study%settings)
         nullify (study%settings(k)%equations%galerkin)
      end do
   end subroutine compute_study

   !> Equations, exact motion and modes, with c_D and without.
   subroutine prepare(study, galerkin, fine, error)
      type(study_t), intent(inout) :: study
      type(galerkin_t), intent(in), target :: galerkin, fine
      type(error_t), allocatable, intent(out) :: error
      type(structure_t) :: structure
      type(equations_t) :: beam
      real(wp), allocatable :: shapes(:, :)
      integer :: k

      structure = study%truth%model%structure
      associate (excitation => study%truth%model%excitation)
         beam = new_equations(fine, structure, excitation)
         call undamped_modes(beam, study%beam, shapes, error)
         do k = 1, size(study%settings)
            if (allocated(error)) return
            if (k == 2) structure%c_D = 0
            associate (setting => study%settings(k))
               setting%equations = new_equations(galerkin, structure, excitation)
               call find_field(setting%equations, excitation, formula_times(study%samples, &
                  study%delta), setting%exact, error)
               if (.not. allocated(error)) call mode_observers(setting%equations, setting%omega, &
                  setting%observers, error)
               if (.not. allocated(error)) call equation_row(setting%equations, setting%row, error)
            end associate
         end do
      end associate
   end subroutine prepare

   !> Every integration, as many at a time as there are threads; the long ones come first.
   subroutine integrate(study, error)
      type(study_t), intent(inout) :: study
      type(error_t), allocatable, intent(out) :: error
      integer :: setting, tolerance, mode, k

      allocate (study%jobs(0))
      do tolerance = size(tolerances), 1, -1
         do setting = size(study%settings), 1, -1
            study%jobs = [study%jobs, job_t(setting=setting, tolerance=tolerance)]
         end do
      end do
      do k = 1, size(closer, 2)
         do mode = 1, size(study%settings(1)%omega)
            study%jobs = [study%jobs, job_t(setting=closer(1, k), tolerance=closer(2, k), &
               mode=mode)]
         end do
      end do
      !$omp parallel do schedule(dynamic, 1)
      do k = 1, size(study%jobs)
         associate (job => study%jobs(k))
            call run_job(study%settings(job%setting), study%truth%model%excitation, &
               study%samples, study%delta, job)
         end associate
      end do
      !$omp end parallel do
      do k = 1, size(study%jobs)
         if (.not. allocated(study%jobs(k)%error)) cycle
         call move_alloc(study%jobs(k)%error, error)
         return
      end do
   end subroutine integrate

   !> One integration, compared with the exact motion.
   subroutine run_job(setting, excitation, samples, delta, job)
      type(setting_t), intent(in) :: setting
      type(excitation_t), intent(in) :: excitation
      real(wp), intent(in) :: samples(:), delta
      type(job_t), intent(inout) :: job
      type(equations_t), target :: equations
      type(cvode_t) :: solver
      type(response_t) :: computed
      type(work_t) :: work

      equations = setting%equations
      equations%observer = equations%tip
      if (job%mode > 0) equations%observer = setting%observers(:, job%mode)
      solver%rtol = tolerances(job%tolerance)
      call solver%respond(equations, excitation, setting%exact%t, computed, work, job%error)
      if (allocated(job%error)) return
      job%deviation = measure(computed, setting%exact%seen_by(equations%observer), samples, delta)
   end subroutine run_job

   !> The comparison of one integration.
   pure function deviation_of(study, setting, tolerance, mode) result(deviation)
      type(study_t), intent(in) :: study
      integer, intent(in) :: setting, tolerance, mode
      type(deviation_t) :: deviation
      integer :: k

      do k = 1, size(study%jobs)
         associate (job => study%jobs(k))
            if (all([job%setting, job%tolerance, job%mode] == [setting, tolerance, mode])) &
               deviation = job%deviation
         end associate
      end do
   end function deviation_of

   !> Share of a mode in the squared error of (3.13).
   pure real(wp) function share(study, setting, tolerance, mode)
      type(study_t), intent(in) :: study
      integer, intent(in) :: setting, tolerance, mode
      type(deviation_t) :: part
      real(wp) :: squares
      integer :: k

      squares = 0
      do k = 1, size(study%settings(setting)%omega)
         part = deviation_of(study, setting, tolerance, k)
         squares = squares + part%rms(3)**2
      end do
      part = deviation_of(study, setting, tolerance, mode)
      share = part%rms(3)**2/squares
   end function share

end module beamid_acceleration_study
