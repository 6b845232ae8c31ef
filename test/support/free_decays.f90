!> Records of an aluminium strip, made by the model itself, and stages that fit their free decay.
module free_decays
   use beamid_errors, only: error_t
   use beamid_excitation, only: excitation_t, new_free, new_release
   use beamid_experiments, only: experiment_t
   use beamid_galerkin, only: mesh_t
   use beamid_identification, only: model_t, simulate, simulation_t, stage_t
   use beamid_kinds, only: wp
   use beamid_noise, only: gaussian_noise, uniform_noise
   use beamid_observation, only: observation_t
   use beamid_parameters, only: free_index, offset
   use beamid_priors, only: prior_t
   use beamid_residuals, only: new_residuals, residual_t
   use beamid_structure, only: sensor_t, structure_t
   use beamid_variables, only: unbounded
   use checks, only: check
   use models, only: model_of
   implicit none
   private

   public :: truth, mesh, names, formulas, true_offset, first_offset, stamps, made, stage_for, &
      noise_of, noisy, make_two, make_channels, long_record, problem_of

   !> An aluminium strip, with more damping than it has: after half a second two modes are left, the
   !> third to e**-11.
   type(structure_t), parameter :: truth = structure_t(length=0.5_wp, rho=0.27_wp, E=6.4e10_wp, &
      I=0.05_wp*0.002_wp**3/12, c_D=6e6_wp, gamma=0.07_wp, &
      sensor=sensor_t(m_S=0.004_wp, x_S=0.44_wp))
   type(mesh_t), parameter :: mesh = mesh_t(3, 4, 4, 1)
   character(len=5), parameter :: names(4) = [character(len=5) :: 'E', 'm_S', 'c_D', 'gamma']
   type(observation_t), parameter :: formulas(3) = [observation_t(1, 0.008_wp), &
      observation_t(2, 0.01_wp), observation_t(3, 0.0_wp)]
   !> The sensor's: acceleration = scale (value - offset).
   real(wp), parameter :: scale = 9.80665_wp, true_offset = 0.045_wp, first_offset = 0.02_wp
   real(wp), parameter :: noise_share = 0.01_wp

contains

   !> Stamps some .01 apart that are not uniform, from `first` on [s].
   function stamps(m, first, seed) result(t)
      integer, intent(in) :: m, seed
      real(wp), intent(in) :: first
      real(wp) :: t(m)
      integer :: k

      t = first + 0.01_wp*([(k, k=0, m - 1)] + 0.6_wp*(uniform_noise(m, seed) - 0.5_wp))
   end function stamps

   !> What a sensor would have recorded of the true structure, without noise.
   function made(structure, cause, formula, times) result(experiment)
      type(structure_t), intent(in) :: structure
      type(excitation_t), intent(in) :: cause
      type(observation_t), intent(in) :: formula
      real(wp), intent(in) :: times(:)
      type(experiment_t) :: experiment
      type(simulation_t) :: clean
      type(error_t), allocatable :: error

      call simulate(model_of(structure, cause, formula), mesh, times, clean, error)
      call check('a record is made', .not. allocated(error))
      experiment%samples = times
      experiment%measured = clean%acceleration + scale*(true_offset - first_offset)
      experiment%excitation = new_free(2)
      experiment%scale = scale
      experiment%offset = first_offset
   end function made

   !> A stage that starts near the truth: within a quarter of a cycle at the end of the record.
   !>
   !> shared   those that all records have in common
   function stage_for(shared, records) result(stage)
      character(len=*), intent(in) :: shared(:)
      integer, intent(in) :: records
      type(stage_t) :: stage
      integer :: k

      stage%free = [(free_index(names(k)), k=1, size(names)), offset]
      stage%lower = spread(0.0_wp, 1, size(stage%free))
      stage%upper = spread(unbounded, 1, size(stage%free))
      stage%start = [truth%E*1.002_wp, truth%sensor(1)%m_S*0.9_wp, truth%c_D*1.3_wp, &
         truth%gamma*0.7_wp, &
                     0.0_wp]
      stage%offset = .true.
      call stage%distribute([(free_index(shared(k)), k=1, size(shared))], records)
   end function stage_for

   !> Standard deviation of the noise of a record.
   pure real(wp) function noise_of(experiment)
      type(experiment_t), intent(in) :: experiment

      associate (z => experiment%measured)
         noise_of = noise_share*norm2(z - sum(z)/size(z))/sqrt(real(size(z), wp))
      end associate
   end function noise_of

   !> The same record with noise.
   function noisy(experiment, noise) result(worse)
      type(experiment_t), intent(in) :: experiment
      real(wp), intent(in) :: noise(:)
      type(experiment_t) :: worse

      worse = experiment
      worse%measured = worse%measured + noise
   end function noisy

   !> A long and a short channel of one motion, with weights.
   !>
   !> m     number of samples of the long one
   !> beam  the strip with two sensors
   subroutine make_channels(m, beam, two)
      integer, intent(in) :: m
      type(structure_t), intent(out) :: beam
      type(experiment_t), intent(out) :: two(2)
      integer :: k

      beam = truth
      beam%sensors = 2
      beam%sensor_name(:2) = ['tip ', 'root']
      beam%sensor(2) = sensor_t(m_S=0.006_wp, x_S=0.2_wp)
      do k = 1, 2
         beam%observer = k
         two(k) = made(beam, new_release(0.02_wp, 0.0_wp, .true.), formulas(3), 0.5_wp &
            + 0.3_wp*stamps(merge(m, 200, k == 1), 0.0_wp, 20 + k) + 0.1_wp*k)
         two(k) = noisy(two(k), gaussian_noise(size(two(k)%samples), noise_of(two(k)), k))
         two(k)%sensor = k
         two(k)%motion = 7
         two(k)%sd = 0.1_wp*k
      end do
   end subroutine make_channels

   !> The record of a strip with many samples, which are not uniform.
   function long_record(m, formula, seed) result(experiment)
      integer, intent(in) :: m, formula, seed
      type(experiment_t) :: experiment

      experiment = made(truth, new_release(0.02_wp, 0.0_wp, .true.), formulas(formula), &
         0.5_wp + 0.3_wp*(stamps(m, 0.0_wp, seed) + 0.01_wp))
      if (seed > 0) experiment = noisy(experiment, gaussian_noise(m, noise_of(experiment), seed))
   end function long_record

   !> A fit of four parameters of a strip and of the offset of each record.
   !>
   !> structure  with the number of sensors
   !> formula    of the observation
   !> priors     knowledge of parameters; without any, the record has no weight
   function problem_of(experiments, structure, formula, priors) result(problem)
      type(experiment_t), intent(in) :: experiments(:)
      type(structure_t), intent(in) :: structure
      integer, intent(in) :: formula
      type(prior_t), intent(in) :: priors(:)
      type(residual_t) :: problem
      type(model_t) :: model
      type(error_t), allocatable :: error
      integer :: k

      model = model_of(structure, new_free(2), formulas(formula))
      model%priors = priors
      call new_residuals(model, mesh, experiments, problem, error)
      call check('a fit is prepared', .not. allocated(error))
      problem%free = [(free_index(names(k)), k=1, size(names))]
      problem%record = spread(0, 1, size(names))
      problem%offset = .true.
   end function problem_of

   !> Records of .5 and .4 m, of different length and clock, 4 and 5 g of sensor at .44 and .35 m.
   subroutine make_two(two)
      type(experiment_t), intent(out) :: two(2)
      type(structure_t) :: shorter

      shorter = truth
      shorter%length = 0.4_wp
      shorter%sensor(1)%x_S = 0.35_wp
      shorter%sensor(1)%m_S = 0.005_wp
      two(1) = made(truth, new_release(0.02_wp, 0.0_wp, .true.), formulas(3), stamps(170, 0.5_wp, &
         11))
      two(2) = made(shorter, new_release(0.01_wp, 6.7_wp, .true.), formulas(3), stamps(130, &
         7.1_wp, 12))
      two(2)%length = shorter%length
      two(2)%x_S = shorter%sensor(1)%x_S
   end subroutine make_two

end module free_decays
