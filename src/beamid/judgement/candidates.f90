!> Several models of the same records: how many parameters each of them has fitted, and which is a
!> special case of which.
module beamid_candidates
   use beamid_errors, only: error_t, failure
   use beamid_excitation, only: excitation_t
   use beamid_experiments, only: experiment_t
   use beamid_galerkin, only: mesh_t, same_mesh
   use beamid_identification, only: identify_meshes, model_t, stage_fit_t, stage_t
   use beamid_kinds, only: wp
   use beamid_least_squares, only: monitor_t
   use beamid_parameters, only: get_free, is_there, offset, on_beam, parameters
   use beamid_refinement, only: identify_refining
   use beamid_statistics, only: misfit_of_records
   use beamid_structure, only: structure_t
   implicit none
   private

   public :: candidate_t, fit_candidate, same_samples, is_nested

   !> Whose a parameter is in a record: nobody's, as it is held fixed, that of all records together,
   !> or, by the number of the record, its own.
   integer, parameter, public :: held = -1, shared = 0

   type :: candidate_t
      type(model_t) :: model
      type(mesh_t) :: mesh
      logical :: refines = .false.             !< the elements are to be found
      type(stage_t), allocatable :: stages(:)
      type(experiment_t), allocatable :: experiments(:)
      type(stage_fit_t) :: fit                 !< of the last stage
      !> (parameters, records) once it is fitted; what any stage has freed counts
      integer, allocatable :: owner(:, :)
   contains
      procedure :: unknowns
      procedure :: sum_of_squares
   end type candidate_t

contains

   !> Whether two models have the same records, sample by sample.
   pure logical function same_samples(a, b) result(same)
      type(candidate_t), intent(in) :: a, b
      integer :: k

      same = size(a%experiments) == size(b%experiments)
      if (same) same = all([(equal(a%experiments(k)%samples, b%experiments(k)%samples) .and. &
         equal(a%experiments(k)%measured, b%experiments(k)%measured), k=1, size(a%experiments))])
   end function same_samples

   !> Runs all stages of one model.
   !>
   !> error  also where no residual is left, for which criteria are not defined
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
      candidate%fit = fits(size(fits, 1), 1)
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
      if (.not. candidate%fit%fit%J > 0) call failure(error, &
         'J = 0: the criteria are not defined for a model that leaves no residual')
   end subroutine fit_candidate

   !> How many numbers were fitted, by any stage, and what was eliminated; of E(x) and c_D(x) the
   !> effective degrees of freedom, to the nearest whole number.
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

   !> J, or what takes its place for several records whose noise is not stated.
   pure real(wp) function sum_of_squares(self) result(J)
      class(candidate_t), intent(in) :: self
      integer :: k

      J = self%fit%fit%J
      if (size(self%experiments) == 1 .or. &
         all([(allocated(self%experiments(k)%sd), k=1, size(self%experiments))])) return
      J = misfit_of_records(self%fit%residual, [(size(self%experiments(k)%samples), &
         k=1, size(self%experiments))])
   end function sum_of_squares

   !> Whether `small` is `large` with some of its free parameters held: what `large` holds fixed is
   !> the same in both, in every record, and everything that `small` frees is free in `large`.
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
               if (large%owner(k, r) < small%owner(k, r)) return
               if (large%owner(k, r) == held) then
                  if (.not. alike(k, a%structures(r), a%excitations(r), b%structures(r), &
                     b%excitations(r))) return
               else if (large%owner(k, r) == shared) then
                  if (.not. alike(k, a%structures(r), a%excitations(r), a%structures(1), &
                     a%excitations(1))) return
               end if
            end do
         end do
      end associate
      is_nested = .true.
   end function is_nested

   !> Whether parameter k is the same in two structures: a place at the tip is where the tip is.
   pure logical function alike(k, a, force_a, b, force_b)
      integer, intent(in) :: k
      type(structure_t), intent(in) :: a, b
      type(excitation_t), intent(in) :: force_a, force_b
      real(wp) :: x(2)

      x = [get_free(a, force_a, k), get_free(b, force_b, k)]
      alike = abs(x(1) - x(2)) <= 1e-12_wp*maxval(abs(x))
      if (parameters(k)%range == on_beam) alike = alike .or. &
         a%follows_tip(k) .and. b%follows_tip(k)
   end function alike

   !> Whether two models differ in nothing but their parameters: in how the response is computed,
   !> what is observed, what there is on the beam, and what kind of force acts.
   pure logical function same_method(a, b) result(same)
      type(candidate_t), intent(in) :: a, b
      integer :: r

      associate (seen => a%model%observation, other => b%model%observation)
         same = same_mesh(a%mesh, b%mesh) .and. seen%formula == other%formula .and. &
            abs(seen%delta - other%delta) <= 0 .and. (seen%relative .eqv. other%relative)
      end associate
      associate (beam => a%model%structure, other => b%model%structure)
         same = same .and. beam%supports == other%supports .and. &
            (beam%stands .eqv. other%stands) .and. max(1, beam%sensors) == max(1, other%sensors)
      end associate
      same = same .and. size(a%experiments) == size(b%experiments)
      do r = 1, size(a%experiments)
         if (same) same = a%experiments(r)%sensor == b%experiments(r)%sensor .and. &
            same_kind(a%experiments(r)%excitation, b%experiments(r)%excitation)
      end do
   end function same_method

   !> Whether two excitations are the same but for their amplitude and the place of the force.
   pure logical function same_kind(a, b) result(same)
      type(excitation_t), intent(in) :: a, b

      same = a%modes == b%modes .and. all([a%distributed, a%by_displacement, a%is_release, &
         a%is_base] .eqv. [b%distributed, b%by_displacement, b%is_release, b%is_base]) .and. &
         abs(a%power - b%power) <= 0 .and. equal(a%t, b%t)
      if (same) same = all(abs(a%f*b%amplitude - b%f*a%amplitude) <= &
         1e-12_wp*abs(a%f*b%amplitude))
   end function same_kind

   pure logical function equal(a, b)
      real(wp), intent(in) :: a(:), b(:)

      equal = size(a) == size(b)
      if (equal) equal = all(abs(a - b) <= 0)
   end function equal

end module beamid_candidates
