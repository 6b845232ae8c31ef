!> The computation of responses for C, with derivatives.
module beamid_c_responses
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use, intrinsic :: iso_c_binding, only: c_char, c_double, c_int, c_int64_t
   use beamid_c_calls, only: told
   use beamid_c_handles, only: borrow_problem, give_back, problem_t
   use beamid_case_files, only: case_t
   use beamid_case_runs, only: place_response
   use beamid_errors, only: bad_input, error_t
   use beamid_experiments, only: experiment_t
   use beamid_identification, only: simulate, simulation_t
   use beamid_interrupts, only: check_interrupt
   use beamid_kinds, only: wp
   use beamid_parameters, only: get_free, parameters
   use beamid_residuals, only: new_residuals, residual_t
   use beamid_responses, only: is_exact
   use beamid_strings, only: to_text
   implicit none
   private

   public :: beamid_respond, check_times

contains

   !> Computes the response of the structure of a case on the case's last mesh, and its derivatives
   !> with respect to the free parameters of the first stage. A derivative with respect to a
   !> stiffness is that with respect to the stiffness itself, although a search would use its
   !> reciprocal.
   !>
   !> of           handle of a case
   !> t            (n) times, ascending [time]
   !> motion       (n, 3) acceleration by the observation formula; displacement and velocity of the
   !>              sensor
   !> derivatives  (n, k) derivatives of the acceleration; k is the number of free parameters, or 0:
   !>              none
   integer(c_int) function beamid_respond(of, n, t, k, motion, derivatives, message, room) &
      result(status) bind(c)
      integer(c_int64_t), value, intent(in) :: of
      integer(c_int), value, intent(in) :: n, k, room
      real(c_double), intent(in) :: t(n)
      real(c_double), intent(inout) :: motion(n, 3), derivatives(n, k)
      character(kind=c_char), intent(inout) :: message(room)
      type(problem_t), pointer :: problem
      type(case_t) :: case
      type(simulation_t) :: simulation
      type(error_t), allocatable :: error

      call borrow_problem(of, problem, error)
      if (.not. allocated(error)) then
         case = problem%case
         call give_back(of)
         !$omp critical (texts_of_beamid)
         call prepare_response()
         !$omp end critical (texts_of_beamid)
      end if
      if (.not. allocated(error)) call simulate(case%model, case%meshes(size(case%meshes)), t, &
         simulation, error)
      call check_interrupt(error)
      if (.not. allocated(error)) then
         motion(:, 1) = simulation%acceleration
         motion(:, 2) = simulation%response%displacement
         motion(:, 3) = simulation%response%velocity
         if (k > 0) call differentiate()
         call check_interrupt(error)
      end if
      status = told(error, message)

   contains

      !> Checks that a case has everything that a response at given times needs, and puts the
      !> record's own beam into its structure.
      subroutine prepare_response()
         integer :: columns

         columns = 0
         if (size(case%stages) > 0) columns = size(case%stages(1)%free)
         call check_times(case, t, error)
         if (.not. allocated(error) .and. k /= 0 .and. k /= columns) then
            call bad_input(error, case%path//': derivatives: found '//to_text(k)//' names for '// &
               to_text(columns)//' parameters, expected names of single parameters (E(x) '// &
               'stands for several, offset for none)')
         end if
         if (.not. allocated(error)) call place_response(case, error, t)
         if (allocated(error)) return
         if (k > 0 .and. .not. is_exact(case%model%solver)) call bad_input(error, case%path// &
            ': &integrator method: found ''cvode'', expected ''modal'' for exact derivatives')
      end subroutine prepare_response

      !> Computes the derivatives of the observed acceleration.
      subroutine differentiate()
         type(residual_t) :: problem
         type(experiment_t) :: experiment
         real(wp), allocatable :: p(:), y(:)
         integer :: k

         experiment%samples = t
         experiment%measured = 0*t
         experiment%excitation = case%model%excitation
         associate (free => case%stages(1)%free)
            call new_residuals(case%model, case%meshes(size(case%meshes)), [experiment], problem, &
               error, free)
            if (allocated(error)) return
            problem%free = free
            problem%record = 0*free
            p = [(get_free(problem%scenario%structures(1), problem%scenario%excitations(1), &
               free(k)), k=1, size(free))]
            allocate (y(size(t)))
            call problem%jacobian(p, y, derivatives, error)
            if (allocated(error)) return
            do k = 1, size(free)
               if (parameters(free(k))%is_reciprocal) derivatives(:, k) = -p(k)**2*derivatives(:, k)
            end do
         end associate
      end subroutine differentiate

   end function beamid_respond

   !> Refuses times at which no response can be computed.
   subroutine check_times(case, t, error)
      type(case_t), intent(in) :: case
      real(wp), intent(in) :: t(:)
      type(error_t), allocatable, intent(out) :: error

      if (size(t) == 0) then
         call bad_input(error, case%path//': found no time, expected one or more')
      else if (.not. all(ieee_is_finite(t)) .or. any(t(2:) <= t(:size(t) - 1))) then
         call bad_input(error, case%path//': found times that are not ascending, expected '// &
            'finite ascending ones')
      end if
   end subroutine check_times

end module beamid_c_responses
