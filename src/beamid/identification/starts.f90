!> Start values from the record: the lines of its spectrum are matched to the frequencies of the
!> model's lowest modes, how fast they die out to their damping, and a small search brings the
!> model's roots there. The fit proper then starts in the right cycle.
module beamid_starts
   use beamid_equations, only: equations_t, new_equations
   use beamid_errors, only: bad_input, error_t, failure
   use beamid_gauss_newton, only: scales_of
   use beamid_kinds, only: wp
   use beamid_least_squares, only: fit, fit_t, options_t
   use beamid_problems, only: smooth_problem_t
   use beamid_residuals, only: residual_t
   use beamid_responses, only: exact_solver_t
   use beamid_spectra, only: decay_of, find_lines, line_t
   use beamid_strings, only: to_text
   use beamid_structure, only: structure_t
   use beamid_unknowns, only: quantity_t, stage_t, variables_of, world_t
   use beamid_variables, only: variable_t
   implicit none
   private

   public :: automatic_start, check_frequencies

   real(wp), parameter :: two_pi = 2*acos(-1.0_wp)

   !> How well the model's roots must meet the record's, relatively, and how freely parameters move:
   !> frequencies are known well, damping hardly, and what neither tells stays where it is.
   real(wp), parameter :: frequency_error = 1e-3_wp, damping_error = 0.3_wp, freedom = 30

   !> Lines that are considered, and modes that are matched where the start is known.
   integer, parameter :: most_lines = 8, usual_modes = 2

   !> Roots of the model against those seen in the records.
   type, extends(smooth_problem_t) :: match_t
      type(residual_t) :: fits
      real(wp), allocatable :: initial(:), scale(:)     !< (n)
      complex(wp), allocatable :: seen(:, :)            !< (modes, records) 0: not seen
   contains
      procedure :: residuals => compare_roots
      procedure :: jacobian => differentiate_roots
   end type match_t

contains

   !> Puts start values for a stage into the problem's world.
   !>
   !> problem  with `free` and `record` of the stage in place
   !> error    no line stands out, or the model has too few modes
   subroutine automatic_start(problem, stage, error)
      type(residual_t), intent(inout) :: problem
      type(stage_t), intent(in) :: stage
      type(error_t), allocatable, intent(out) :: error
      type(match_t) :: match
      type(variable_t), allocatable :: variables(:)
      type(quantity_t), allocatable :: quantities(:)
      type(fit_t) :: found
      type(options_t) :: options
      integer :: k, r, modes

      if (.not. problem%exact) then
         call failure(error, 'start values: from a record only the modal response finds them')
         return
      end if
      modes = max(usual_modes, maxval(problem%world%excitations%modes))
      allocate (match%seen(modes, size(problem%parts)), source=(0.0_wp, 0.0_wp))
      do r = 1, size(problem%parts)
         call roots_of_record(problem, r, match%seen(:, r), error)
         if (allocated(error)) return
      end do
      call variables_of(stage, problem%world, variables, quantities, error)
      if (allocated(error)) return
      match%fits = problem
      match%initial = variables%start
      match%scale = scales_of(variables, variables%start)
      call fit(match, 2*size(match%seen) + size(variables), variables, options, found, error)
      if (allocated(error)) then
         error%message = 'start values: '//error%message
         return
      end if
      do k = 1, size(variables)
         call problem%world%set(problem%free(k), problem%record(k), found%estimate(k))
      end do
   end subroutine automatic_start

   !> The lowest oscillating roots of the model of record r.
   subroutine model_roots(problem, structure, r, parameters, s, ds, error)
      type(residual_t), intent(inout), target :: problem
      type(structure_t), intent(in) :: structure
      integer, intent(in) :: r, parameters(:)
      complex(wp), intent(out) :: s(:), ds(:, :)
      type(error_t), allocatable, intent(out) :: error
      type(equations_t), target :: equations

      equations = new_equations(problem%parts(r)%galerkin, structure, problem%world%excitations(r))
      select type (solver => problem%parts(r)%solver)
      class is (exact_solver_t)
         call solver%free_motion(equations, parameters, s, ds, problem%work, error)
      class default
         call failure(error, 'this method has no modes')
      end select
   end subroutine model_roots

   !> What record r shows of the model's modes.
   !>
   !> seen  (modes) roots; 0 where no line was found for a mode
   subroutine roots_of_record(problem, r, seen, error)
      type(residual_t), intent(inout) :: problem
      integer, intent(in) :: r
      complex(wp), intent(inout) :: seen(:)
      type(error_t), allocatable, intent(out) :: error
      complex(wp) :: s(size(seen)), none(size(seen), 0)
      type(line_t), allocatable :: lines(:)
      integer :: place(size(seen)), k
      real(wp) :: share, omega

      call model_roots(problem, problem%world%structures(r), r, [integer ::], s, none, error)
      if (allocated(error)) return
      associate (t => problem%parts(r)%experiment%samples, &
         measured => problem%parts(r)%experiment%measured, highest => 5*aimag(s(size(s)))/two_pi)
         call find_lines(t, measured, highest, most_lines, lines, share)
         if (.not. (t(size(t)) - t(1))*highest > 1) then
            call failure(error, 'start values: record '//to_text(r)//' holds no period of '// &
               to_text(highest)//', five times the frequency of the model''s mode '// &
               to_text(size(s))//': it lasts '//to_text(t(size(t)) - t(1))// &
               '; expected a longer one, or units that go together')
         else if (size(lines) == 0) then
            call failure(error, 'start values: found no line in the spectrum of record '// &
               to_text(r))
         end if
         if (allocated(error)) return
         place = assigned(lines, aimag(s)/two_pi)
         do k = 1, size(s)
            if (place(k) == 0) cycle
            associate (frequency => lines(place(k))%frequency)
               omega = two_pi*frequency
               seen(k) = cmplx(-max(decay_of(t, measured, frequency), 1e-5_wp*omega), omega, wp)
            end associate
         end do
      end associate
   end subroutine roots_of_record

   !> Which line belongs to which mode: of all ways that keep the order, the one against which least
   !> speaks. Ratios that are 10 % off count one, as does a line weaker than the strongest by a
   !> factor e, and all frequencies off by a factor e. 0: none.
   !>
   !> lines        ascending frequency
   !> frequencies  of the modes, ascending
   pure function assigned(lines, frequencies) result(place)
      type(line_t), intent(in) :: lines(:)
      real(wp), intent(in) :: frequencies(:)
      integer :: place(size(frequencies))
      integer, allocatable :: chosen(:)
      real(wp), allocatable :: ratio(:)
      integer :: choice, matched, j
      real(wp) :: mean, cost, least

      matched = min(size(place), size(lines))
      least = huge(least)
      place = 0
      ! Each set of lines is a number of as many bits.
      do choice = 1, 2**size(lines) - 1
         if (popcnt(choice) /= matched) cycle
         chosen = pack([(j, j=1, size(lines))], [(btest(choice, j - 1), j=1, size(lines))])
         ratio = log(lines(chosen)%frequency/frequencies(:matched))
         mean = sum(ratio)/size(ratio)
         cost = sum(((ratio - mean)/0.1_wp)**2) + mean**2 &
            - sum(log(lines(chosen)%amplitude/maxval(lines%amplitude)))
         if (cost >= least) cycle
         least = cost
         place(:matched) = chosen
      end do
   end function assigned

   !> Refuses a model whose frequencies have nothing to do with the record's: a slip in the units.
   subroutine check_frequencies(problem, error)
      type(residual_t), intent(inout) :: problem
      type(error_t), allocatable, intent(out) :: error
      real(wp), parameter :: too_far = 20
      complex(wp), allocatable :: s(:), none(:, :)
      type(line_t), allocatable :: lines(:)
      real(wp) :: share, strongest, low, high
      integer :: r

      do r = 1, size(problem%parts)
         associate (experiment => problem%parts(r)%experiment)
            if (experiment%excitation%modes == 0 .or. size(experiment%samples) < 50) cycle
            s = spread((0.0_wp, 0.0_wp), 1, experiment%excitation%modes)
            allocate (none(size(s), 0))
            call model_roots(problem, problem%world%structures(r), r, [integer ::], s, none, error)
            if (allocated(error)) return
            deallocate (none)
            low = aimag(s(1))/two_pi
            high = aimag(s(size(s)))/two_pi
            call find_lines(experiment%samples, experiment%measured, 5*high, 1, lines, share)
         end associate
         strongest = low
         if (size(lines) > 0) strongest = lines(1)%frequency
         if (share > 0.05_wp .and. strongest*too_far > low) cycle
         call bad_input(error, 'record '//to_text(r)//': found next to nothing of it '// &
            'near the model''s frequencies, '//to_text(low)//' to '//to_text(high)// &
            '; expected units that go together')
         return
      end do
   end subroutine check_frequencies

   !> Relative differences of frequencies and damping, then how far each parameter has moved.
   subroutine compare_roots(self, parameters, r, error)
      class(match_t), intent(inout) :: self
      real(wp), intent(in) :: parameters(:)
      real(wp), intent(out) :: r(:)
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: unused(size(r), size(parameters))

      call self%jacobian(parameters, r, unused, error)
   end subroutine compare_roots

   subroutine differentiate_roots(self, parameters, r, jac, error)
      class(match_t), intent(inout) :: self
      real(wp), intent(in) :: parameters(:)
      real(wp), intent(out) :: r(:), jac(:, :)
      type(error_t), allocatable, intent(out) :: error
      complex(wp) :: s(size(self%seen, 1)), ds(size(self%seen, 1), size(parameters))
      type(world_t) :: world
      integer :: i, k, p, row

      world = self%fits%with(parameters)
      r = 0
      jac = 0
      row = 0
      do i = 1, size(self%seen, 2)
         call model_roots(self%fits, world%structures(i), i, self%fits%free, s, ds, error)
         if (allocated(error)) return
         do p = 1, size(parameters)
            if (all(self%fits%record(p) /= [0, i])) ds(:, p) = 0
         end do
         do k = 1, size(s)
            row = row + 2
            if (.not. abs(self%seen(k, i)) > 0) cycle
            r(row - 1) = log(aimag(s(k))/aimag(self%seen(k, i)))/frequency_error
            jac(row - 1, :) = aimag(ds(k, :))/aimag(s(k))/frequency_error
            if (.not. real(s(k)) < 0) cycle
            r(row) = log(real(s(k))/real(self%seen(k, i)))/damping_error
            jac(row, :) = real(ds(k, :))/real(s(k))/damping_error
         end do
      end do
      do p = 1, size(parameters)
         r(row + p) = (parameters(p) - self%initial(p))/(freedom*self%scale(p))
         jac(row + p, p) = 1/(freedom*self%scale(p))
      end do
   end subroutine differentiate_roots

end module beamid_starts
