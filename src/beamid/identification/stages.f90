!> One stage of a fit: a search, and what it says of the parameters.
module beamid_stages
   use beamid_distributions, only: chi_square_tail, normal_quantile
   use beamid_errors, only: error_t
   use beamid_field_penalties, only: fields
   use beamid_held_errors, only: held_errors, held_t
   use beamid_kinds, only: wp
   use beamid_least_squares, only: fit_t, monitor_t, options_t
   use beamid_line_matches, only: dip_places
   use beamid_parameters, only: as_named, free_magnitude, offset
   use beamid_priors, only: prior_t
   use beamid_residuals, only: residual_t
   use beamid_responses, only: work_t
   use beamid_smooth_fits, only: fit_smoothly, misfit_of, new_field_fit, field_fit_t, trial_t
   use beamid_starts, only: automatic_start, set_free
   use beamid_statistics, only: new_statistics, statistics_t, unlimited
   use beamid_strings, only: to_text
   use beamid_structure, only: is_coefficient, of_d_D, of_w_D, of_x_D
   use beamid_unknowns, only: name_length, name_of, quantity_t, stage_t, variables_of, scenario_t
   use beamid_variables, only: unbounded, variable_t
   use beamid_verification, only: verify_integrator
   use beamid_whiteness, only: check_residuals, residual_check_t
   implicit none
   private

   public :: stage_fit_t, run_stage

   !> The outcome of one stage on one mesh.
   type :: stage_fit_t
      integer :: stage = 0
      integer :: elements = 0
      integer, allocatable :: free(:)    !< (n) of the parameters that were searched for
      type(fit_t) :: fit                 !< of these alone
      real(wp), allocatable :: residual(:)      !< (m) model - record [length/time**2]
      !> (n + k) the parameters, then what was eliminated; statistics are of all of them
      type(quantity_t), allocatable :: quantities(:)
      real(wp), allocatable :: jacobian(:, :)   !< (rows, n + k) by what was searched for
      type(scenario_t) :: scenario       !< of every record, with the estimates in place
      type(prior_t), allocatable :: priors(:)   !< what else was known
      real(wp), allocatable :: weight(:) !< (records) of the residuals of `fit`
      logical :: weighted = .false.      !< it is 1/noise
      real(wp) :: noise = 1              !< that stands against what else was known
      real(wp) :: strength(fields) = 0 !< of the penalties on E(x) and c_D(x); 0: none
      type(field_fit_t) :: fields(fields)   !< what became of these
      type(held_t), allocatable :: held(:)      !< errors of parameters that are held
      !> (n) how far finer meshes shift the estimates, of what was searched for, and how well that
      !> is known; not allocated: not asked for, or not found
      real(wp), allocatable :: mesh_shift(:), mesh_error(:)
      type(statistics_t) :: statistics   !< `samples` is 0 where no degree of freedom was left
      type(residual_check_t) :: check
      !> How far an integrator's error has moved an estimate, in standard errors; -1: no integrator
      real(wp) :: moved = -1
      character(len=:), allocatable :: reference   !< seen from where
      real(wp) :: score = -1             !< squared residuals over another window; -1: not asked for
      type(work_t) :: work
      !> Which parameters are held because a mode is not in the record, '';
      !> why no fit is to be trusted, ''; another minimum of nearly the same J, or a dip that may be
      !> none or elsewhere, ''
      character(len=:), allocatable :: note, doubt, other
   contains
      procedure :: correlation
      procedure :: again
      procedure :: from_held
      procedure :: half_width
      procedure :: total
      procedure :: shifts
      procedure :: shifted
      procedure :: is_too_coarse
   end type stage_fit_t

   !> A mesh shows where it shifts an estimate by more than this of its half width.
   real(wp), parameter :: shows = 0.25_wp

contains

   !> Correlation of two quantities by their names: a stiffness grows as its reciprocal falls.
   pure real(wp) function correlation(self, j, k)
      class(stage_fit_t), intent(in) :: self
      integer, intent(in) :: j, k

      correlation = self%statistics%correlation(j, k)
      if (self%quantities(j)%is_reciprocal() .neqv. self%quantities(k)%is_reciprocal()) &
         correlation = -correlation
   end function correlation

   !> The stage that goes on from its estimates.
   pure type(stage_t) function again(self)
      class(stage_fit_t), intent(in) :: self

      associate (q => self%quantities, n => size(self%free))
         again%free = self%free
         again%record = q(:n)%record
         again%lower = q(:n)%lower
         again%upper = q(:n)%upper
         again%offset = any(q(n + 1:)%parameter == offset)
      end associate
   end function again

   !> Standard deviation of quantity k by the errors of what is held.
   pure real(wp) function from_held(self, k)
      class(stage_fit_t), intent(in) :: self
      integer, intent(in) :: k
      integer :: j

      from_held = 0
      if (.not. allocated(self%held)) return
      do j = 1, size(self%held)
         if (k <= size(self%held(j)%effect)) from_held = hypot(from_held, self%held(j)%effect(k))
      end do
   end function from_held

   !> Half width of the 95 % interval of quantity k by noise and what is held together.
   pure real(wp) function half_width(self, k)
      class(stage_fit_t), intent(in) :: self
      integer, intent(in) :: k

      associate (s => self%statistics)
         half_width = unlimited
         if (s%is_withdrawn(k)) return
         half_width = s%corrected_half_width(k)
         if (s%corrected_error(k) > 0) half_width = half_width*hypot(1.0_wp, &
            self%from_held(k)/s%corrected_error(k))
      end associate
   end function half_width

   !> How far below and above its estimate quantity k may be by every source of error: noise and
   !> what is held about the estimate, and about where a finer mesh would put it.
   pure function total(self, k) result(distance)
      class(stage_fit_t), intent(in) :: self
      integer, intent(in) :: k
      real(wp) :: distance(2), half, shift, unsure

      half = self%half_width(k)
      shift = 0
      unsure = 0
      if (allocated(self%mesh_shift) .and. k <= size(self%free)) then
         shift = self%mesh_shift(k)
         unsure = self%mesh_error(k)
      end if
      distance = [max(half, half + unsure - shift), max(half, half + unsure + shift)]
   end function total

   !> Whether the mesh shows in the estimate of quantity k.
   pure logical function shifts(self, k)
      class(stage_fit_t), intent(in) :: self
      integer, intent(in) :: k

      shifts = abs(self%mesh_shift(k))/shows > self%half_width(k)
   end function shifts

   !> Whether the mesh shows in any estimate.
   pure logical function shifted(self)
      class(stage_fit_t), intent(in) :: self
      integer :: k

      shifted = .false.
      if (.not. allocated(self%mesh_shift) .or. self%statistics%samples == 0) return
      shifted = any([(self%shifts(k), k=1, size(self%mesh_shift))])
   end function shifted

   !> One search and what it says; the estimates stay in the problem's scenario.
   !>
   !> exact  what an integrator's results are checked against
   subroutine run_stage(problem, exact, stage, options, label, found, error, monitor)
      type(residual_t), intent(inout) :: problem, exact
      type(stage_t), intent(in) :: stage
      type(options_t), intent(in) :: options
      character(len=*), intent(in) :: label
      type(stage_fit_t), intent(out) :: found
      type(error_t), allocatable, intent(out) :: error
      class(monitor_t), intent(inout), optional :: monitor
      type(variable_t), allocatable :: variables(:)
      character(len=name_length), allocatable :: names(:)
      type(stage_t) :: tried
      type(trial_t), allocatable :: trials(:)
      real(wp), allocatable :: scales(:)
      real(wp) :: moderate
      integer :: k, n, r

      found%note = ''
      found%doubt = ''
      found%other = ''
      tried = stage
      call set_free(problem, stage)
      problem%work = work_t()
      ! What varies along the beam is started from the lines of the record in any case.
      if (stage%automatic .and. size(stage%free) > 0 .and. .not. any(is_coefficient(stage%free))) &
         call automatic_start(problem, tried, options, found%note, found%doubt, found%other, error)
      if (allocated(error)) return
      n = size(tried%free)
      call variables_of(tried, problem%scenario, variables, found%quantities, error)
      if (allocated(error)) return
      names = found%quantities%searched_name()
      call fit_smoothly(problem, variables, options, found%fit, trials, error, monitor, label, &
         names)
      if (allocated(error)) return
      if (.not. problem%exact) call verify_integrator(problem, exact, variables, names, &
         found%fit, found%moved, found%reference, error)
      if (allocated(error)) return
      found%free = tried%free
      do k = 1, n
         associate (q => found%quantities(k))
            q%searched = found%fit%estimate(k)
            q%value = as_named(q%parameter, q%searched)
            call problem%scenario%set(q%parameter, q%record, q%searched)
            ! What a search leaves beside a bound at 0 is no yardstick.
            r = max(q%record, 1)
            moderate = free_magnitude(problem%scenario%structures(r), &
               problem%scenario%excitations(r), &
               q%parameter)
            q%scale = merge(abs(q%searched), moderate, abs(q%searched) > 1e-9_wp*moderate)
         end associate
      end do
      found%residual = problem%without_weights(found%fit%residual)
      found%weight = problem%weight
      found%weighted = problem%is_weighted()
      found%noise = problem%noise
      found%strength = problem%strength
      found%priors = problem%priors
      found%scenario = problem%scenario
      call add_linear(problem, found, error)
      if (allocated(error)) return
      do k = 1, fields
         if (.not. found%strength(k) > 0) cycle
         call new_field_fit(problem, found%fit%estimate, found%fit%residual, found%jacobian, k, &
            found%fields(k), error, as_used=.true.)
         if (allocated(error)) return
      end do
      found%work = problem%work
      associate (m => problem%samples())
         found%check = check_residuals(found%fit%residual(:m), found%jacobian(:m, :))
      end associate
      ! What was eliminated counts, but no one asks whether an offset of nothing differs from it.
      associate (q => found%quantities)
         scales = q%scale
         if (problem%samples() > size(q)) call new_statistics(found%jacobian, found%fit%residual, &
            [q(:n)%searched, q(n + 1:)%scale], scales, found%statistics, error, &
            problem%samples(), merge(problem%noise, 0.0_wp, problem%prior_rows() > 0), &
            problem%first_rows(), q%record == 0)
         if (allocated(error)) return
         call judge_dip(found, trials, misfit_of(problem, found%fit))
         call judge_functions(found)
         if (size(found%priors) == 0) return
         n = merge(size(q), n, problem%exact)
         call held_errors(problem, found%fit%estimate, found%jacobian(:, :n), scales(:n), &
            found%held, error)
      end associate
   end subroutine run_stage

   !> Without a depth a dip has no place and no width, and a search along the beam finds one in
   !> mere noise: linear theory then says that both are known. A dip is there where its depth is
   !> more than the best of all places that noise offers, each with a depth, a place and a width to
   !> choose, would reach in one record of twenty; and it is where it is found if none that a search
   !> has found elsewhere is as likely, to the same chance.
   !>
   !> misfit  what the trials' are compared with
   subroutine judge_dip(found, trials, misfit)
      type(stage_fit_t), intent(inout) :: found
      type(trial_t), intent(in) :: trials(:)
      real(wp), intent(in) :: misfit
      real(wp), parameter :: choices = 3, chance = 0.05_wp/dip_places
      integer :: j, k, place
      character(len=:), allocatable :: doubt
      real(wp) :: beyond, inflation

      if (found%statistics%samples == 0) return
      do place = 1, size(found%free)
         if (found%free(place) /= of_x_D) cycle
         doubt = ''
         associate (s => found%statistics, record => found%quantities(place)%record)
            do k = 1, size(found%free)
               if (found%free(k) /= of_d_D .or. found%quantities(k)%record /= record) cycle
               ! Beyond a thousand standard errors no chance is left; of none there is no ratio.
               beyond = 1e3_wp
               if (s%corrected_error(k) > 0) beyond = min(beyond, &
                  found%fit%estimate(k)/s%corrected_error(k))
               if (.not. chi_square_tail(beyond**2, choices) < chance) doubt = 'this record '// &
                  'does not tell that there is a dip: its depth is no more than noise would '// &
                  'give one somewhere along the beam'
            end do
            ! As much as the residuals count, if they are not white.
            inflation = 1
            if (s%std_error(place) > 0) inflation = (s%corrected_error(place)/s%std_error(place))**2
            do k = 1, size(trials)
               if (doubt /= '' .or. .not. misfit > 0) exit
               if (abs(trials(k)%estimate(place) - found%fit%estimate(place))/2 &
                  <= s%corrected_half_width(place)) cycle
               if (s%samples*log(trials(k)%misfit/misfit) < inflation &
                  *normal_quantile(1 - chance/2)**2) doubt = 'a dip at '// &
                  to_text(trials(k)%estimate(place))//' does nearly as well'
            end do
            if (doubt == '') cycle
            if (found%other /= '') doubt = found%other//'; '//doubt
            found%other = doubt
            do j = 1, size(found%free)
               if (any(found%free(j) == [of_x_D, of_w_D, of_d_D]) .and. &
                  found%quantities(j)%record == record) call found%statistics%withdraw(j)
            end do
         end associate
      end do
   end subroutine judge_dip

   !> Linear theory knows nothing of what a function cannot do that has used up its coefficients and
   !> leaves something of the record.
   subroutine judge_functions(found)
      type(stage_fit_t), intent(inout) :: found
      integer :: a, k

      if (found%statistics%samples == 0) return
      do a = 1, fields
         if (.not. found%is_too_coarse(a)) cycle
         do k = 1, size(found%fields(a)%place)
            call found%statistics%withdraw(found%fields(a)%place(k))
         end do
      end do
   end subroutine judge_functions

   !> Whether E(x) or c_D(x) would bend further than its coefficients let it, to follow residuals
   !> that are not noise.
   pure logical function is_too_coarse(self, a)
      class(stage_fit_t), intent(in) :: self
      integer, intent(in) :: a
      real(wp), parameter :: nearly_all = 0.9_wp

      is_too_coarse = allocated(self%fields(a)%place) .and. .not. self%check%white
      if (is_too_coarse) is_too_coarse = self%fields(a)%smoothing%bounded .or. &
         self%fields(a)%smoothing%at_end < 0 .or. self%fields(a)%smoothing%freedom &
         > nearly_all*size(self%fields(a)%place)
   end function is_too_coarse

   !> The quantities that were eliminated, and derivatives with respect to all.
   subroutine add_linear(problem, found, error)
      type(residual_t), intent(inout) :: problem
      type(stage_fit_t), intent(inout) :: found
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: c(:)
      real(wp) :: r(problem%rows())
      integer :: first, i, k, n, modes(size(problem%parts))

      modes = problem%scenario%excitations%modes
      n = problem%linear_unknowns()
      if (n == 0) then
         found%jacobian = found%fit%jacobian
         return
      end if
      allocate (c(n), found%jacobian(size(r), size(found%free) + n))
      call problem%evaluate(found%fit%estimate, r, found%jacobian, error, c)
      if (allocated(error)) return
      n = 0
      first = 1
      do while (first <= size(modes))
         i = first
         do k = 1, modes(i)
            call add('cos_'//to_text(k), 0)
            call add('sin_'//to_text(k), 0)
         end do
         do i = first, problem%last_channel(first)
            if (problem%offset) call add('offset', offset)
         end do
         first = i
      end do

   contains

      !> The next quantity, of record i.
      subroutine add(name, parameter)
         character(len=*), intent(in) :: name
         integer, intent(in) :: parameter
         type(quantity_t) :: q

         n = n + 1
         q%record = merge(i, 0, size(modes) > 1)
         q%name = name_of(name, q%record)
         q%parameter = parameter
         q%lower = -unbounded
         q%upper = unbounded
         q%value = c(n)
         associate (experiment => problem%parts(i)%experiment)
            q%scale = max(norm2(experiment%measured)/sqrt(real(size(experiment%measured), wp)), &
               tiny(1.0_wp))
            if (parameter == offset) then
               q%start = experiment%offset
               q%value = experiment%offset + c(n)
               q%scale = q%scale/abs(experiment%scale)
            end if
         end associate
         found%quantities = [found%quantities, q]
      end subroutine add

   end subroutine add_linear

end module beamid_stages
