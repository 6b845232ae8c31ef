!> What `beamid reproduce acceleration` computes: CVODE against the exact response of the same mesh
!> by each formula, so that nothing but the integrator's error is left; for the motion of the tip
!> and for each mode's share in it.
module beamid_acceleration_study
   use beamid
   use beamid_amplification, only: deviation_t, equation_row, formula_times, measure, mode_observers
   use beamid_beam_motions, only: beam_motion_t, find_motion
   use beamid_interrupts, only: stop_flag
   use beamid_paths, only: join_path
   implicit none
   private

   public :: study_t, compute_study, share, tolerances, closer

   real(wp), parameter :: tolerances(*) = [1e-3_wp, 1e-4_wp, 1e-5_wp, 1e-6_wp, 1e-7_wp, 1e-8_wp, &
      1e-9_wp, 1e-10_wp]

   !> What is looked at mode by mode: with c_D (1) or without (2), and the place of the tolerance.
   integer, parameter :: closer(2, 3) = reshape([1, 2, 1, 5, 2, 2], [2, 3])

   !> The structure, with or without damping of the beam.
   type :: setting_t
      real(wp) :: c_D = 0
      type(equations_t) :: equations
      type(beam_motion_t) :: exact
      real(wp), allocatable :: omega(:)            !< undamped, of the mesh [1/time]
      real(wp), allocatable :: observers(:, :)     !< of each mode's share in the tip's motion
      real(wp), allocatable :: row(:)              !< what (3.13) does to the displacements
   end type setting_t

   !> What kept an integration from its end.
   type :: outcome_t
      type(error_t), allocatable :: error
   end type outcome_t

   type :: study_t
      type(case_t) :: truth
      real(wp), allocatable :: samples(:)
      real(wp) :: delta = 0
      type(setting_t) :: settings(2)
      real(wp), allocatable :: beam(:)             !< frequencies of the beam itself [1/time]
      !> From the exact motion, (0:modes, tolerances, settings); mode 0 is the tip itself.
      type(deviation_t), allocatable :: deviations(:, :, :)
   end type study_t

contains

   !> Reads the structure; equations, exact motion and modes, with c_D and without; integrates.
   !>
   !> data  folder of the case files
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
      ! Their mesh ends here.
      do k = 1, size(study%settings)
         nullify (study%settings(k)%equations%galerkin)
      end do
   end subroutine compute_study

   !> Every integration, as many at a time as there are threads; the long ones come first.
   subroutine integrate(study, error)
      type(study_t), intent(inout) :: study
      type(error_t), allocatable, intent(out) :: error
      type(outcome_t), allocatable :: outcomes(:)
      integer, allocatable :: places(:, :)   ! in `deviations`
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

   !> One integration, compared with the exact motion.
   !>
   !> place  mode, tolerance and setting
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

   !> Share of a mode in the squared error of (3.13).
   pure real(wp) function share(study, mode, tolerance, setting)
      type(study_t), intent(in) :: study
      integer, intent(in) :: mode, tolerance, setting

      associate (part => study%deviations(1:, tolerance, setting)%rms(3))
         share = part(mode)**2/sum(part**2)
      end associate
   end function share

end module beamid_acceleration_study
