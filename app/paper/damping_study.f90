!> `beamid reproduce damping`: the comparison of damping mechanisms by Banks and Inman ("On damping
!> mechanisms in beams", Journal of Applied Mechanics 58, 1991, 716) on simulated records.
!>
!> As in their experiment, a composite cantilever with a tip mass is struck, and the acceleration is
!> recorded. Each mechanism in turn is the true one, and all of them are fitted to its record. The
!> beam and the strengths are ours: about 1 % of critical damping in the second mode.
module beamid_damping_study
   use beamid
   use beamid_candidates, only: candidate_t, compute_criteria, criteria_t
   use beamid_damping_models, only: damping_models_t, fit_damping_models
   use beamid_errors, only: locate
   use beamid_kinds, only: pi
   use beamid_least_squares, only: monitor_t
   use beamid_lines, only: add_lines, csv_row
   use beamid_mechanisms, only: mechanisms
   use beamid_noise, only: gaussian_noise
   use beamid_outputs, only: output_t
   use beamid_parameters, only: set_free
   use beamid_strings, only: rounded, to_text
   use beamid_structure, only: of_a_h, of_b, of_b_h, of_c_D, of_d, of_E, of_gamma
   use beamid_texts, only: left, right, text_t
   implicit none
   private

   public :: reproduce_damping

   !> The true beam without damping [m, N, s, kg]: 1 m of glass fibre composite, and a tip mass.
   type(structure_t), parameter :: undamped = structure_t(length=1.0_wp, rho=1.0_wp, E=2.7e10_wp, &
      I=5e-10_wp, m_T=0.2_wp)

   !> A true combination: its name, its parameters and their values.
   type :: truth_t
      character(len=24) :: name
      integer :: parameter(3)   !< 0: none
      real(wp) :: value(3)
   end type truth_t
   type(truth_t), parameter :: truths(*) = [ &
      truth_t('air', [of_gamma, 0, 0], [0.9_wp, 0.0_wp, 0.0_wp]), &
      truth_t('Kelvin-Voigt', [of_c_D, 0, 0], [6e6_wp, 0.0_wp, 0.0_wp]), &
      truth_t('time hysteresis', [of_d(1), of_b(1), 0], [0.04_wp, 150.0_wp, 0.0_wp]), &
      truth_t('spatial hysteresis', [of_a_h, of_b_h, 0], [0.3_wp, 0.15_wp, 0.0_wp]), &
      truth_t('air + Kelvin-Voigt', [of_gamma, of_c_D, 0], [0.3_wp, 4e6_wp, 0.0_wp]), &
      truth_t('air + time hysteresis', [of_gamma, of_d(1), of_b(1)], [0.3_wp, 0.04_wp, 150.0_wp]), &
      truth_t('air + spatial hysteresis', [of_gamma, of_a_h, of_b_h], [0.3_wp, 0.3_wp, 0.15_wp])]

   !> Numbers of quintic elements of the true beam and of the fits.
   integer, parameter :: of_truth = 24, of_fits = 12
   !> Noise as a share of the root mean square of the record.
   real(wp), parameter :: noise_share = 0.02_wp

contains

   !> Runs the study.
   !>
   !> output   on return with damping_study.csv
   !> summary  on return with the report
   !> error    a computation that fails
   subroutine reproduce_damping(output, summary, error, monitor)
      type(output_t), intent(inout) :: output
      type(text_t), intent(inout) :: summary
      type(error_t), allocatable, intent(out) :: error
      class(monitor_t), intent(inout), optional :: monitor
      type(candidate_t) :: reference
      type(damping_models_t) :: found
      type(criteria_t) :: criteria
      type(text_t) :: table
      integer :: k, best

      call add_head(summary)
      call table%line('truth,model,parameters,J,aicc,difference')
      do k = 1, size(truths)
         call new_reference(k, reference, error)
         if (.not. allocated(error)) call fit_damping_models(reference, .false., found, error, &
            monitor)
         call locate(error, trim(truths(k)%name))
         if (allocated(error)) return
         criteria = compute_criteria(found%models)
         best = criteria%best()
         if (k == 1) call summary%line(left('truth', 24)//titles(found))
         call summary%line(left(truths(k)%name, 24)//differences(criteria)// &
            '  '//short_name(found, best))
         call add_rows(table, trim(truths(k)%name), found, criteria)
      end do
      call add_lines(summary, [character(len=98) :: '', &
         'Within 6 of the best, the record does not tell models apart. A mechanism counts as '// &
         'found', &
         'if the best model has it, or has it as a limit: time and spatial hysteresis have '// &
         'Kelvin-Voigt', &
         'damping as a limit.'])
      call output%add('damping_study.csv', table%content())
   end subroutine reproduce_damping

   !> Adds the description of the study.
   subroutine add_head(text)
      type(text_t), intent(inout) :: text

      call add_lines(text, [character(len=98) :: &
         'Damping mechanisms after Banks and Inman (1991), on simulated records of a composite', &
         'cantilever with a tip mass that is struck at .4 m: acceleration of the tip, #.1 s at #', &
         'samples per second, noise of #% of its rms.', &
         'AICc of each model above that of the best one; last column: the best model', ''], &
         [1.5_wp, 1000.0_wp, noise_share])
   end subroutine add_head

   !> Simulates the record of a truth and sets up the fit, which starts from E 0.5 % too
   !> low, as a natural frequency would give it.
   !>
   !> k  number of the truth
   subroutine new_reference(k, reference, error)
      integer, intent(in) :: k
      type(candidate_t), intent(out) :: reference
      type(error_t), allocatable, intent(out) :: error
      integer, parameter :: samples = 1500
      real(wp), parameter :: step = 1e-3_wp, duration = 0.02_wp, place = 0.4_wp, too_low = 0.995_wp
      !> The blow is smooth, so that it does not excite modes beyond the meshes.
      integer, parameter :: nodes = 40
      real(wp), parameter :: strength = 30
      real(wp) :: shape(0:nodes)
      type(model_t) :: truth
      type(simulation_t) :: simulation
      type(stage_t) :: stage
      real(wp) :: t(samples)
      integer :: i

      truth%structure = undamped
      truth%structure%x_F = place
      shape = [(sin(pi*i/nodes)**2, i=0, nodes)]
      call new_force_table([(duration*i/nodes, i=0, nodes)], strength*shape, truth%excitation, &
         error)
      if (allocated(error)) return
      do i = 1, size(truths(k)%parameter)
         if (truths(k)%parameter(i) > 0) call set_free(truth%structure, truth%excitation, &
            truths(k)%parameter(i), truths(k)%value(i))
      end do
      allocate (modal_t :: truth%solver)
      t = [(i*step, i=1, samples)]
      call simulate(truth, mesh_t(degree=5, elements=of_truth, gauss_points=6), t, simulation, &
         error)
      if (allocated(error)) return
      reference%model = truth
      reference%model%structure = undamped
      reference%model%structure%x_F = place
      reference%model%structure%E = too_low*undamped%E
      reference%mesh = mesh_t(degree=5, elements=of_fits, gauss_points=6)
      stage%free = [of_E, of_gamma, of_c_D]
      stage%start = [reference%model%structure%E, 0.1_wp, 1e6_wp]
      reference%stages = [stage]
      associate (a => simulation%acceleration)
         reference%experiments = [experiment_t(t, a + gaussian_noise(samples, &
            noise_share*norm2(a)/sqrt(real(samples, wp)), seed=k), truth%excitation)]
      end associate
   end subroutine new_reference

   !> Returns short names of the models as titles of columns.
   function titles(found) result(line)
      type(damping_models_t), intent(in) :: found
      character(len=:), allocatable :: line
      integer :: k

      line = ''
      do k = 1, size(found%models)
         line = line//right(short_name(found, k), 9)
      end do
   end function titles

   !> Returns a short name of model k.
   function short_name(found, k) result(name)
      type(damping_models_t), intent(in) :: found
      integer, intent(in) :: k
      character(len=:), allocatable :: name

      associate (parts => found%combinations(k)%parts)
         name = trim(mechanisms(parts(1))%short)
         if (size(parts) > 1) name = name//'+'//trim(mechanisms(parts(2))%short)
      end associate
   end function short_name

   !> Returns the differences of AICc from the best model as columns.
   pure function differences(criteria) result(line)
      type(criteria_t), intent(in) :: criteria
      character(len=:), allocatable :: line
      integer :: k

      line = ''
      do k = 1, size(criteria%aicc)
         line = line//right(rounded(criteria%aicc(k) - minval(criteria%aicc), 3), 9)
      end do
   end function differences

   !> Adds a row for each model to the table.
   subroutine add_rows(table, truth, found, criteria)
      type(text_t), intent(inout) :: table
      character(len=*), intent(in) :: truth
      type(damping_models_t), intent(in) :: found
      type(criteria_t), intent(in) :: criteria
      integer :: k

      do k = 1, size(found%models)
         call table%line(csv_row(truth//','//found%combinations(k)%name()//','// &
            to_text(found%models(k)%unknowns()), [criteria%J(k), criteria%aicc(k), &
            criteria%aicc(k) - minval(criteria%aicc)]))
      end do
   end subroutine add_rows

end module beamid_damping_study
