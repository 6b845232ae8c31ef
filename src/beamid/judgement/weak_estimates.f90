!> Intervals of weak estimates: those with a large relative error.
!>
!> The residuals are linear in a parameter only near the estimate. A decay rate, for example, that a
!> faint mode determines to 40 % may be three times as large without a significant rise of J,
!> although the interval of linear theory ends before twice the estimate. The profile of J along a
!> weak parameter is therefore followed. Where it, or another parameter on the way, leaves the
!> interval of linear theory, the total interval is extended.
module beamid_weak_estimates
   use beamid_errors, only: error_t
   use beamid_experiments, only: experiment_t
   use beamid_galerkin, only: mesh_t
   use beamid_identification, only: model_t, stage_fit_t
   use beamid_interrupts, only: interrupted
   use beamid_kinds, only: wp
   use beamid_least_squares, only: monitor_t
   use beamid_parameters, only: on_beam, parameters
   use beamid_profile_likelihood, only: at_bound, follow_profile, is_lost, is_open, side_t
   use beamid_residuals, only: residual_t
   use beamid_statistics, only: unlimited
   use beamid_structure, only: is_coefficient
   use beamid_unknowns, only: quantity_t, variables_of
   use beamid_variables, only: variable_t
   use beamid_verification, only: exact_counterpart
   implicit none
   private

   public :: widen_weak_estimates

   !> Relative standard error above which an estimate is weak: at the end of its interval, the
   !> logarithm of the parameter and its tangent at the estimate differ by a fifth.
   real(wp), parameter :: weak = 0.2_wp
   !> Relative extension of an interval that is worth a note.
   real(wp), parameter :: noted = 0.2_wp
   !> Relative error of the ends of profiles.
   real(wp), parameter :: end_error = 0.02_wp
   !> Evaluations after which a search for one point of a profile gives up. The start is near the
   !> minimum; a search that needs more creeps along a bound.
   integer, parameter :: patience = 300

contains

   !> Extends the total intervals of a fit to the profiles of its weak estimates. Positions have no
   !> relative error, and the coefficients of E(x) and c_D(x) have intervals of their own.
   !>
   !> model, mesh, experiments  of the fit
   !> found                     the fit, with a known mesh shift and its fixed parameters
   !> monitor                   receives a report of each point of a profile
   subroutine widen_weak_estimates(model, mesh, experiments, found, monitor)
      type(model_t), intent(in) :: model
      type(mesh_t), intent(in) :: mesh
      type(experiment_t), intent(in) :: experiments(:)
      type(stage_fit_t), intent(inout) :: found
      class(monitor_t), intent(inout), optional :: monitor
      type(residual_t) :: problem
      type(variable_t), allocatable :: variables(:)
      type(quantity_t), allocatable :: quantities(:)
      type(error_t), allocatable :: error
      logical, dimension(size(found%free)) :: extended, is_endless, ends_early
      integer :: k, direction

      if (.not. any([(is_weak(found, k), k=1, size(found%free))])) return
      call exact_counterpart(model, mesh, experiments, found%free, problem)
      if (.not. allocated(problem%parts)) return
      call found%restore(problem)
      call variables_of(found%again(), problem%scenario, variables, quantities, error)
      if (allocated(error)) return
      extended = .false.
      is_endless = .false.
      ends_early = .false.
      do k = 1, size(found%free)
         if (.not. is_weak(found, k)) cycle
         do direction = -1, 1, 2
            call widen(k, direction)
            if (interrupted()) return
         end do
      end do
      extended = extended .and. .not. is_endless
      if (any(extended)) call add_note('the records determine'//names_of(extended)// &
         ' only roughly: linear theory does not hold so far from the estimate, and the total '// &
         'intervals follow the profile of J')
      if (any(is_endless)) call add_note('not determined, because J never rises to its 95 % '// &
         'level:'//names_of(is_endless))
      if (any(ends_early)) call add_note('the profile of J ends early for'//names_of(ends_early)// &
         ', so that the interval may be too narrow')

   contains

      !> Extends the intervals to one side of the profile of parameter k: its own to the end, those
      !> of the others as far as J rises no further than at the ends of their intervals.
      subroutine widen(k, direction)
         integer, intent(in) :: k, direction
         type(side_t) :: side
         real(wp), dimension(size(found%free)) :: shift, covered, level
         integer :: i, j

         associate (s => found%statistics)
            covered = [(s%corrected_half_width(j), j=1, size(covered))]
            level = covered/max(s%std_error(:size(level)), tiny(1.0_wp))
            call follow_profile(problem, problem%rows(), variables, found%fit%estimate, &
               sum(found%fit%residual**2), k, direction, s%variance*level(k)**2, covered(k), side, &
               monitor, patience)
            if (side%state == is_open) then
               is_endless = is_endless .or. abs(side%parameters(:, size(side%J)) &
                  - found%fit%estimate) > covered
               do j = 1, size(covered)
                  if (is_endless(j)) call s%withdraw(j)
               end do
               return
            end if
         end associate
         if (side%state == is_lost) then
            ends_early(k) = .true.
            found%statistics%determined(k) = .false.
         end if
         do i = 1, size(side%J)
            shift = side%parameters(:, i) - found%fit%estimate
            if (i == size(side%J) .and. side%state == at_bound) shift(k) = side%end &
               - found%fit%estimate(k)
            where (side%distance(i)*level(k) > (1 + end_error)*level) shift = 0
            extended = extended .or. abs(shift) > (1 + noted)*covered
            call found%extend(shift, covered)
         end do
      end subroutine widen

      !> Returns the names of some parameters, as a list that begins with a blank.
      function names_of(chosen) result(text)
         logical, intent(in) :: chosen(:)
         character(len=:), allocatable :: text
         integer :: j

         text = ''
         do j = 1, size(chosen)
            if (chosen(j)) text = text//', '//trim(found%quantities(j)%name)
         end do
         text = text(2:)
      end function names_of

      !> Adds a sentence to those on other explanations.
      subroutine add_note(text)
         character(len=*), intent(in) :: text

         if (found%other /= '') found%other = found%other//'; '
         found%other = found%other//text
      end subroutine add_note

   end subroutine widen_weak_estimates

   !> Tells whether the estimate of parameter k is weak, and linear theory gives it an interval that
   !> J determines. The interval of a parameter on which records disagree comes from their scatter.
   pure logical function is_weak(found, k)
      type(stage_fit_t), intent(in) :: found
      integer, intent(in) :: k

      is_weak = .false.
      associate (s => found%statistics)
         if (s%samples == 0 .or. .not. s%variance > 0) return
         if (s%is_withdrawn(k) .or. s%disputed(k) .or. is_coefficient(found%free(k)) .or. &
            parameters(found%free(k))%range == on_beam) return
         is_weak = s%std_error(k) > 0 .and. s%corrected_half_width(k) < unlimited .and. &
            s%corrected_error(k) > weak*abs(found%fit%estimate(k))
      end associate
   end function is_weak

end module beamid_weak_estimates
