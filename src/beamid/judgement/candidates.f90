!> Candidate models of the same records, which `compare` ranks: fits each, counts its estimated
!> parameters, and tells which model is nested in which.
module beamid_candidates
   use beamid_criteria, only: aicc, bic
   use beamid_distributions, only: chi_square_tail
   use beamid_errors, only: error_t, failure
   use beamid_excitation, only: excitation_t
   use beamid_experiments, only: experiment_t
   use beamid_galerkin, only: mesh_t, same_mesh
   use beamid_identification, only: identify_meshes, misfit_of_fit, model_t, &
      stage_fit_t, stage_t
   use beamid_kinds, only: wp
   use beamid_least_squares, only: monitor_t
   use beamid_mechanisms, only: is_of_damping
   use beamid_parameter_names, only: is_there
   use beamid_parameters, only: get_free, offset, on_beam, parameters
   use beamid_refinement, only: identify_refining
   use beamid_structure, only: structure_t
   implicit none
   private

   public :: candidate_t, compute_criteria, criteria_t, fit_candidate, same_samples, is_nested

   !> Owners of a parameter in a record: none, because it is fixed, or all records together. A
   !> positive owner is the number of the record that has the parameter for itself.
   integer, parameter, public :: held = -1, shared = 0

   !> A model of the records, with its fit.
   type :: candidate_t
      type(model_t) :: model
      type(mesh_t) :: mesh
      logical :: refines = .false.             !< whether the mesh is refined automatically
      type(stage_t), allocatable :: stages(:)
      type(experiment_t), allocatable :: experiments(:)   !< (records)
      type(stage_fit_t) :: fit                 !< fit of the last stage
      !> number of values of the fit that have no weight, because the comparison ignores them
      integer :: ignored = 0
      !> (parameters, records) owner of each parameter; one that any stage has freed is estimated.
      !> Allocated by `fit_candidate`.
      integer, allocatable :: owner(:, :)
   contains
      procedure :: unknowns
      procedure :: sum_of_squares
      procedure :: samples
      procedure :: knows_noise
   end type candidate_t

   !> The criteria of several models of the same records.
   type :: criteria_t
      real(wp), allocatable :: J(:), aicc(:), bic(:)   !< (models)
      integer :: samples = 0             !< number of values that are compared
      logical :: noise_is_known = .false.
      !> Factor by which the residuals of the best model exceed the known noise in variance, if that
      !> is improbable; J is divided by it. Otherwise 1.
      real(wp) :: inflation = 1
   contains
      procedure :: best
   end type criteria_t

contains

   !> Computes J and the information criteria of fitted models.
   !>
   !> If the noise is known, but no model leaves residuals that are as small, the models lack
   !> something in common. Then J is divided by the chi-square per degree of freedom of the model
   !> with the smallest residuals (Burnham and Anderson, Model Selection and Multimodel Inference,
   !> 2nd edition, section 2.5), so that differences do not seem more certain than they are.
   function compute_criteria(models) result(criteria)
      type(candidate_t), intent(in) :: models(:)
      type(criteria_t) :: criteria
      real(wp), parameter :: improbable = 0.01_wp
      integer :: best, freedom(size(models)), k

      criteria%J = [(models(k)%sum_of_squares(), k=1, size(models))]
      criteria%samples = models(1)%samples()
      criteria%noise_is_known = all([(models(k)%knows_noise(), k=1, size(models))])
      if (criteria%noise_is_known) then
         freedom = [(max(1, criteria%samples - models(k)%unknowns()), k=1, size(models))]
         best = minloc(criteria%J/freedom, dim=1)
         if (chi_square_tail(criteria%J(best), real(freedom(best), wp)) < improbable) &
            criteria%inflation = criteria%J(best)/freedom(best)
         criteria%J = criteria%J/criteria%inflation
      end if
      criteria%aicc = [(aicc(criteria%J(k), criteria%samples, models(k)%unknowns(), &
         criteria%noise_is_known), k=1, size(models))]
      criteria%bic = [(bic(criteria%J(k), criteria%samples, models(k)%unknowns(), &
         criteria%noise_is_known), k=1, size(models))]
   end function compute_criteria

   !> Returns the number of the model with the lowest AICc. Of models that fit equally well, it is
   !> the first, so that round-off does not decide.
   pure integer function best(self)
      class(criteria_t), intent(in) :: self
      real(wp), parameter :: equal = 0.01_wp

      best = findloc(self%aicc <= minval(self%aicc) + equal, .true., dim=1)
   end function best

   !> Returns whether two models have the same records, sample by sample.
   pure logical function same_samples(a, b) result(same)
      type(candidate_t), intent(in) :: a, b
      integer :: k

      same = size(a%experiments) == size(b%experiments)
      if (same) same = all([(identical(a%experiments(k)%samples, b%experiments(k)%samples) .and. &
         identical(a%experiments(k)%measured, b%experiments(k)%measured), &
         k=1, size(a%experiments))])
   end function same_samples

   !> Fits one model with all its stages.
   !>
   !> candidate  on return with `fit` and `owner`
   !> error      a stage that fails, or J = 0, for which the criteria are not defined unless the
   !>            noise is known
   subroutine fit_candidate(candidate, error, monitor)
      type(candidate_t), intent(inout) :: candidate
      type(error_t), allocatable, intent(out) :: error
      class(monitor_t), intent(inout), optional :: monitor
      type(stage_fit_t), allocatable :: fits(:, :)
      integer :: j, k

      if (candidate%refines) then
         call identify_refining(candidate%model, candidate%mesh, candidate%stages, &
            candidate%experiments, fits, error, monitor)
      else
         call identify_meshes(candidate%model, [candidate%mesh], candidate%stages, &
            candidate%experiments, fits, error, monitor)
      end if
      if (allocated(error)) return
      call fits(size(fits, 1), 1)%copy_to(candidate%fit)
      candidate%owner = spread([(held, k=1, size(parameters))], 2, size(candidate%experiments))
      do j = 1, size(fits, 1)
         do k = 1, size(fits(j, 1)%free)
            associate (q => fits(j, 1)%quantities(k))
               if (q%record == 0) then
                  candidate%owner(q%parameter, :) = max(shared, candidate%owner(q%parameter, :))
               else
                  candidate%owner(q%parameter, q%record) = q%record
               end if
            end associate
         end do
      end do
      if (.not. (candidate%fit%fit%J > 0 .or. candidate%knows_noise())) call failure(error, &
         'J = 0: the criteria are not defined for a model that leaves no residual')
   end subroutine fit_candidate

   !> Returns the number of estimated parameters: those that any stage has freed, the linear
   !> unknowns, and for smooth fields E(x) and c_D(x) their effective degrees of freedom, rounded.
   pure integer function unknowns(self)
      class(candidate_t), intent(in) :: self
      integer :: a

      unknowns = count(any(self%owner == shared, dim=2)) + count(self%owner > 0) &
         + size(self%fit%quantities) - size(self%fit%free)
      do a = 1, size(self%fit%fields)
         if (.not. self%fit%strength(a) > 0) cycle
         associate (field => self%fit%fields(a))
            unknowns = unknowns - size(field%place) + nint(field%smoothing%freedom)
         end associate
      end do
   end function unknowns

   !> Returns the number of values that are compared.
   pure integer function samples(self)
      class(candidate_t), intent(in) :: self

      samples = size(self%fit%residual) - self%ignored
   end function samples

   !> Returns whether the noise of all data is known before the fit.
   pure logical function knows_noise(self)
      class(candidate_t), intent(in) :: self
      integer :: k

      knows_noise = all([(self%experiments(k)%has_known_noise(), k=1, size(self%experiments))])
   end function knows_noise

   !> Returns J or, for several records whose noise is not all stated, the misfit that replaces it.
   pure real(wp) function sum_of_squares(self) result(J)
      class(candidate_t), intent(in) :: self

      J = misfit_of_fit(self%fit, self%experiments)
   end function sum_of_squares

   !> Returns whether `small` is nested in `large`: it is `large` with some free parameters fixed.
   !>
   !> Every parameter that `large` fixes then has the same value in both models, in every record,
   !> and every parameter that `small` frees is free in `large`.
   logical function is_nested(small, large)
      type(candidate_t), intent(in) :: small, large
      integer :: k, r

      is_nested = .false.
      if (small%unknowns() >= large%unknowns() .or. .not. same_method(small, large)) return
      if (any(small%stages%offset) .and. .not. any(large%stages%offset)) return
      associate (a => small%fit%scenario, b => large%fit%scenario)
         do r = 1, size(small%experiments)
            do k = 1, size(parameters)
               if (k == offset .or. .not. (is_there(a%structures(r), k) .or. &
                  is_there(b%structures(r), k))) cycle
               ! Fits to damping ratios alone keep the other parameters of fits to all data, which
               ! differ slightly.
               if (small%ignored > 0 .and. .not. is_of_damping(k)) cycle
               if (large%owner(k, r) < small%owner(k, r)) return
               if (large%owner(k, r) == held) then
                  if (.not. same_value(k, a%structures(r), a%excitations(r), b%structures(r), &
                     b%excitations(r))) return
               else if (large%owner(k, r) == shared) then
                  if (.not. same_value(k, a%structures(r), a%excitations(r), a%structures(1), &
                     a%excitations(1))) return
               end if
            end do
         end do
      end associate
      is_nested = .true.
   end function is_nested

   !> Returns whether parameter k has the same value in two structures. Positions that follow the
   !> tip are the same even if the lengths differ.
   pure logical function same_value(k, a, force_a, b, force_b) result(same)
      integer, intent(in) :: k
      type(structure_t), intent(in) :: a, b
      type(excitation_t), intent(in) :: force_a, force_b
      real(wp) :: x(2)

      x = [get_free(a, force_a, k), get_free(b, force_b, k)]
      same = abs(x(1) - x(2)) <= 1e-12_wp*maxval(abs(x))
      if (parameters(k)%range == on_beam) same = same .or. a%follows_tip(k) .and. b%follows_tip(k)
   end function same_value

   !> Returns whether two models differ in their parameters alone: they have the same mesh,
   !> observation, attachments and kind of excitation.
   pure logical function same_method(a, b) result(same)
      type(candidate_t), intent(in) :: a, b
      integer :: r

      associate (observation => a%model%observation, other => b%model%observation)
         same = same_mesh(a%mesh, b%mesh) .and. observation%formula == other%formula .and. &
            abs(observation%delta - other%delta) <= 0 .and. &
            (observation%relative .eqv. other%relative)
      end associate
      associate (beam => a%model%structure, other => b%model%structure)
         same = same .and. beam%supports == other%supports .and. beam%masses == other%masses &
            .and. (beam%stands .eqv. other%stands) .and. max(1, beam%sensors) == max(1, &
            other%sensors) .and. max(1, beam%hoses) == max(1, other%hoses)
      end associate
      same = same .and. size(a%experiments) == size(b%experiments)
      do r = 1, size(a%experiments)
         if (same) same = a%experiments(r)%sensor == b%experiments(r)%sensor .and. &
            same_kind(a%experiments(r)%excitation, b%experiments(r)%excitation)
      end do
   end function same_method

   !> Returns whether two excitations differ in amplitude and position of the force alone.
   pure logical function same_kind(a, b) result(same)
      type(excitation_t), intent(in) :: a, b

      same = a%modes == b%modes .and. all([a%distributed, a%by_displacement, a%is_release, &
         a%is_base] .eqv. [b%distributed, b%by_displacement, b%is_release, b%is_base]) .and. &
         abs(a%power - b%power) <= 0 .and. identical(a%t, b%t)
      if (same) same = all(abs(a%f*b%amplitude - b%f*a%amplitude) <= &
         1e-12_wp*abs(a%f*b%amplitude))
   end function same_kind

   !> Returns whether two arrays have the same size and the same elements.
   pure logical function identical(a, b)
      real(wp), intent(in) :: a(:), b(:)

      identical = size(a) == size(b)
      if (identical) identical = all(abs(a - b) <= 0)
   end function identical

end module beamid_candidates
