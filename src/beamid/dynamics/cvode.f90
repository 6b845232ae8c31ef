!> The solver `cvode`: the response by SUNDIALS CVODE, variable-order BDF, in place of IMSL's DGEAR.
!>
!> CVODE solves its Newton systems through a SUNLinearSolver that calls `beamid_newton`
!> ("matrix-embedded": CVODE holds no matrix). The integrator stops at every node of the force. At a
!> kink it restarts, because CVODE judges the error of a step by a prediction from earlier steps;
!> after a kink it may take a large error for a small one. Stability-limit detection is on, because
!> lightly damped modes lie where BDF of orders 3 to 5 is unstable.
module beamid_cvode
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use, intrinsic :: iso_c_binding, only: c_associated, c_double, c_f_pointer, c_funloc, &
      c_int, c_loc, c_null_ptr, c_ptr
   use beamid_equations, only: equations_t
   use beamid_errors, only: error_t, failure
   use beamid_excitation, only: excitation_t, same_time
   use beamid_interrupts, only: check_interrupt
   use beamid_kinds, only: wp, ip
   use beamid_modes, only: buckled
   use beamid_newton, only: motion_t, new_motion
   use beamid_responses, only: response_t, solver_t, work_t
   use beamid_strings, only: to_text
   use beamid_structure_checks, only: check_axial_load, check_causal, check_local
   use sundials, only: complaint_t, create_cvode, CV_ONE_STEP, FCVode, FCVodeFree, &
      FCVodeGetCurrentGamma, FCVodeGetDky, FCVodeInit, FCVodeReInit, FCVodeSetMaxOrd, &
      FCVodeSetStabLimDet, FCVodeSetStopTime, FCVodeSetUserData, FCVodeSVtolerances, FN_VDestroy, &
      FSUNContext_Free, FSUNLinSolFreeEmpty, FSUNLinSolNewEmpty, N_Vector, new_vector, &
      SUNLinearSolver, SUNLinearSolver_Ops, SUNLINEARSOLVER_MATRIX_EMBEDDED
   implicit none
   private

   public :: cvode_t

   !> The solver and its settings.
   type, extends(solver_t) :: cvode_t
      real(wp) :: rtol = 1e-8_wp             !< relative tolerance
      !> absolute tolerance of the displacement [length]; 0: rtol x its estimated size
      real(wp) :: atol = 0
      integer :: max_order = 5               !< largest order of the BDF, 1 .. 5
      integer(ip) :: max_steps = 1000000     !< largest number of steps per response
   contains
      procedure :: respond, relative_error
   end type cvode_t

   !> One integration: the owner of all SUNDIALS handles and of the arrays behind their vectors.
   !> With n unknowns, the state is (w, w'), 2 n numbers, and n numbers for each relaxation.
   type :: session_t
      type(c_ptr) :: context = c_null_ptr   !< SUNContext
      type(c_ptr) :: memory = c_null_ptr   !< CVODE's memory
      !> vectors on y, out and atol
      type(N_Vector), pointer :: state => null(), output => null(), tolerance => null()
      !> solver of the Newton systems
      type(SUNLinearSolver), pointer :: linear => null()
      !> state, state at a sample time, and absolute tolerances
      real(c_double), allocatable :: y(:), out(:), atol(:)
      type(motion_t) :: motion   !< right-hand side and Newton systems
      type(complaint_t) :: complaint   !< last message of CVODE
   contains
      final :: close_session
   end type session_t

   interface
      !> Returns the address of a vector's data (SUNDIALS, sundials_nvector.h).
      function vector_data(vector) bind(c, name='N_VGetArrayPointer') result(data)
         import :: c_ptr
         type(c_ptr), value :: vector
         type(c_ptr) :: data
      end function vector_data
      !> Attaches the linear solver (CVodeSetLinearSolver, cvode_ls.h). The Fortran module of
      !> SUNDIALS does not accept a null matrix.
      integer(c_int) function set_linear_solver(memory, solver, matrix) &
         bind(c, name='CVodeSetLinearSolver')
         import :: c_int, c_ptr
         type(c_ptr), value :: memory, solver, matrix
      end function set_linear_solver
   end interface

contains

   !> Computes the response from rest; arguments as in `beamid_responses`.
   subroutine respond(self, equations, excitation, times, response, work, error)
      class(cvode_t), intent(inout) :: self
      type(equations_t), intent(in), target :: equations
      type(excitation_t), intent(in) :: excitation
      real(wp), intent(in) :: times(:)
      type(response_t), intent(out) :: response
      type(work_t), intent(inout) :: work
      type(error_t), allocatable, intent(out) :: error
      type(session_t), target :: session
      integer(ip) :: steps
      integer :: k, nodes, next
      real(wp) :: finish
      logical :: has_kink(size(excitation%t))

      response%t = times
      allocate (response%displacement(size(times)), response%velocity(size(times)), &
         response%acceleration(size(times)), source=0.0_wp)
      if (allocated(equations%tilt)) allocate (response%tilt(size(times)), source=0.0_wp)
      work%solves = work%solves + 1
      if (size(times) == 0) return
      call open_session(self, equations, excitation, session, error)
      if (allocated(error)) return

      next = 1
      steps = 0
      nodes = size(excitation%t)
      has_kink = excitation%kinks()
      do k = 1, nodes
         ! Samples at the node, or beside it by round-off, are taken here: the step to them would
         ! vanish. Up to the first node the structure is at rest; at this node, the acceleration
         ! already includes the force.
         do while (next <= size(times))
            if (times(next) > excitation%t(k) + same_time*spacing(excitation%t(k))) exit
            call observe(session, excitation, times(next), session%y, next, response)
            next = next + 1
         end do
         if (next > size(times)) exit
         call begin_segment(session%motion, excitation, k)
         finish = times(size(times))
         if (k < nodes) finish = min(excitation%t(k + 1), finish)
         if (has_kink(k)) then
            call check(session, FCVodeReInit(session%memory, excitation%t(k), session%state), &
               'CVodeReInit', error)
            if (allocated(error)) exit
         end if
         call integrate(self, session, excitation, finish, steps, next, response, error)
         if (allocated(error)) exit
      end do
      work%steps = work%steps + steps
      work%evaluations = work%evaluations + session%motion%evaluations
      work%factorizations = work%factorizations + session%motion%factorizations
   end subroutine respond

   !> Sets the excitation from node k of the force to the next node; the force is 0 after the last.
   subroutine begin_segment(motion, excitation, k)
      type(motion_t), intent(inout) :: motion
      type(excitation_t), intent(in) :: excitation
      integer, intent(in) :: k
      real(wp) :: base(1, 3)

      associate (t => excitation%t, f => excitation%f)
         base = excitation%base([t(k)])
         motion%begin = t(k)
         motion%base = [base(1, 2), base(1, 1)]
         motion%intercept = 0
         motion%slope = 0
         if (k == size(t)) return
         motion%slope = (f(k + 1) - f(k))/(t(k + 1) - t(k))
         motion%intercept = f(k) - motion%slope*t(k)
      end associate
   end subroutine begin_segment

   !> Returns the relative tolerance.
   pure real(wp) function relative_error(self)
      class(cvode_t), intent(in) :: self

      relative_error = self%rtol
   end function relative_error

   !> Advances to a time and fills the response at every sample time on the way.
   !>
   !> finish    where to stop [time]
   !> steps     in and out: number of steps so far
   !> next      in and out: index of the next sample time
   !> response  in and out
   !> error     CVODE fails, max_steps is exceeded, or the response is not finite
   subroutine integrate(self, session, excitation, finish, steps, next, response, error)
      class(cvode_t), intent(in) :: self
      type(session_t), intent(inout), target :: session
      type(excitation_t), intent(in) :: excitation
      real(wp), intent(in) :: finish
      integer(ip), intent(inout) :: steps
      integer, intent(inout) :: next
      type(response_t), intent(inout) :: response
      type(error_t), allocatable, intent(out) :: error
      real(c_double) :: t(1)

      call check(session, FCVodeSetStopTime(session%memory, finish), 'CVodeSetStopTime', error)
      if (allocated(error)) return
      t = -huge(t)
      do while (t(1) < finish .and. next <= size(response%t))
         call check_interrupt(error)
         if (allocated(error)) return
         if (steps >= self%max_steps) then
            call failure(error, 'CVODE: max_steps = '//to_text(self%max_steps)// &
               ' steps used up at t = '//to_text(t(1))//' of '// &
               to_text(response%t(size(response%t))))
            return
         end if
         call check(session, FCVode(session%memory, finish, session%state, t, CV_ONE_STEP), &
            'CVode', error)
         if (allocated(error)) return
         steps = steps + 1
         do while (next <= size(response%t))
            if (response%t(next) > t(1)) exit
            call check(session, FCVodeGetDky(session%memory, response%t(next), 0_c_int, &
               session%output), 'CVodeGetDky', error)
            if (allocated(error)) return
            if (.not. all(ieee_is_finite(session%out))) then
               call failure(error, 'CVODE: the response is not finite at t = '// &
                  to_text(response%t(next)))
               return
            end if
            call observe(session, excitation, response%t(next), session%out, next, response)
            next = next + 1
         end do
      end do
   end subroutine integrate

   !> Stores the motion of the sensor at one time.
   !>
   !> t         [time]
   !> y         state at this time
   !> k         index of the sample time
   !> response  in and out
   subroutine observe(session, excitation, t, y, k, response)
      type(session_t), intent(in) :: session
      type(excitation_t), intent(in) :: excitation
      real(wp), intent(in) :: t, y(:)
      integer, intent(in) :: k
      type(response_t), intent(inout) :: response
      real(wp) :: a(session%motion%equations%n), base(1, 3)

      base = excitation%base([t])
      associate (n => size(a), equations => session%motion%equations)
         call session%motion%acceleration([excitation%force(t), base(1, 2), base(1, 1)], y, a)
         response%displacement(k) = dot_product(equations%observer, y(:n)) &
            + equations%base_coupling*base(1, 1)
         response%velocity(k) = dot_product(equations%observer, y(n + 1:2*n)) &
            + equations%base_coupling*base(1, 2)
         response%acceleration(k) = dot_product(equations%observer, a) &
            + equations%base_coupling*base(1, 3)
         if (allocated(equations%tilt)) response%tilt(k) = dot_product(equations%tilt, y(:n)) &
            + equations%base_tilt*base(1, 1)
      end associate
   end subroutine observe

   !> Creates all handles, with the structure at rest at the first node of the force.
   !>
   !> error  the equations cannot be integrated (no unknowns left, buckling, M not positive
   !>        definite), or a call of SUNDIALS fails
   subroutine open_session(self, equations, excitation, session, error)
      class(cvode_t), intent(in) :: self
      type(equations_t), intent(in), target :: equations
      type(excitation_t), intent(in) :: excitation
      type(session_t), intent(inout), target :: session
      type(error_t), allocatable, intent(out) :: error
      type(SUNLinearSolver_Ops), pointer :: operations
      real(wp) :: atol
      integer(c_int) :: flag
      integer :: l

      call check_equations(equations, excitation, error)
      if (allocated(error)) return
      call new_motion(equations, session%motion, error)
      if (allocated(error)) return
      atol = self%atol
      if (.not. atol > 0) atol = self%rtol*equations%displacement
      if (.not. atol > 0) atol = self%rtol
      allocate (session%y((2 + size(equations%rate))*equations%n), source=0.0_c_double)
      session%out = session%y
      session%atol = atol*[1/equations%unit, equations%omega/equations%unit, &
         [(1/equations%unit, l=1, size(equations%rate))]]

      call create_cvode(session%complaint, session%context, session%memory, flag)
      call check(session, flag, 'CVodeCreate', error)
      if (allocated(error)) return
      session%state => new_vector(session%y, session%context)
      session%output => new_vector(session%out, session%context)
      session%tolerance => new_vector(session%atol, session%context)
      session%linear => FSUNLinSolNewEmpty(session%context)
      session%linear%content = c_loc(session)
      call c_f_pointer(session%linear%ops, operations)
      operations%gettype = c_funloc(linear_type)
      operations%solve = c_funloc(linear_solve)

      call then_check(FCVodeInit(session%memory, c_funloc(right_hand_side), excitation%t(1), &
         session%state), 'CVodeInit')
      call then_check(FCVodeSetUserData(session%memory, c_loc(session)), 'CVodeSetUserData')
      call then_check(FCVodeSVtolerances(session%memory, self%rtol, session%tolerance), &
         'CVodeSVtolerances')
      call then_check(FCVodeSetMaxOrd(session%memory, int(self%max_order, c_int)), 'CVodeSetMaxOrd')
      call then_check(FCVodeSetStabLimDet(session%memory, 1_c_int), 'CVodeSetStabLimDet')
      call then_check(set_linear_solver(session%memory, c_loc(session%linear), c_null_ptr), &
         'CVodeSetLinearSolver')

   contains

      !> Checks the flag of a call, unless an earlier call has failed.
      subroutine then_check(flag, call_name)
         integer(c_int), intent(in) :: flag
         character(len=*), intent(in) :: call_name

         if (.not. allocated(error)) call check(session, flag, call_name, error)
      end subroutine then_check

   end subroutine open_session

   !> Refuses equations that cannot be integrated, or that need another method.
   subroutine check_equations(equations, excitation, error)
      type(equations_t), intent(in) :: equations
      type(excitation_t), intent(in) :: excitation
      type(error_t), allocatable, intent(out) :: error

      if (equations%constraints%too_many) then
         call failure(error, 'the rigid supports are so close together that the mesh '// &
            'allows no motion between them, expected more elements')
         return
      end if
      call equations%check_ends(error)
      if (.not. allocated(error)) call check_axial_load(equations%structure, error)
      if (.not. allocated(error)) call check_causal(equations%structure, [integer ::], &
         error)
      if (.not. allocated(error)) call check_local(equations%structure, error)
      if (allocated(error)) return
      if (equations%buckles()) then
         call failure(error, 'CVODE: '//buckled)
         return
      end if
      if (excitation%is_base .and. equations%constraints%number() > 0 .and. &
         size(equations%rate) > 0) then
         call failure(error, 'd_1: found time hysteresis beside a rigid support and a base '// &
            'that moves with cvode, expected modal')
      end if
   end subroutine check_equations

   !> Frees all handles that `open_session` has created.
   subroutine close_session(session)
      type(session_t), intent(inout) :: session
      integer(c_int) :: flag

      if (c_associated(session%memory)) call FCVodeFree(session%memory)
      if (associated(session%linear)) call FSUNLinSolFreeEmpty(session%linear)
      if (associated(session%state)) call FN_VDestroy(session%state)
      if (associated(session%output)) call FN_VDestroy(session%output)
      if (associated(session%tolerance)) call FN_VDestroy(session%tolerance)
      if (c_associated(session%context)) flag = FSUNContext_Free(session%context)
   end subroutine close_session

   !> Turns a negative flag into an error with the name of the call and CVODE's message.
   subroutine check(session, flag, call_name, error)
      type(session_t), intent(in) :: session
      integer(c_int), intent(in) :: flag
      character(len=*), intent(in) :: call_name
      type(error_t), allocatable, intent(out) :: error

      if (flag >= 0) return
      if (allocated(session%complaint%text)) then
         call failure(error, call_name//': '//session%complaint%text)
      else
         call failure(error, call_name//' failed with flag '//to_text(int(flag)))
      end if
   end subroutine check

   !> Computes y' for CVODE by `motion_t` (adapter, CVRhsFn); requests a shorter step if y' is not
   !> finite.
   integer(c_int) function right_hand_side(t, y, dy, user_data) bind(c)
      real(c_double), value :: t
      type(c_ptr), value :: y, dy, user_data
      type(session_t), pointer :: session
      real(c_double), pointer :: state(:), derivative(:)

      call c_f_pointer(user_data, session)
      call c_f_pointer(vector_data(y), state, [size(session%y)])
      call c_f_pointer(vector_data(dy), derivative, [size(session%y)])
      call session%motion%derivative(t, state, derivative)
      right_hand_side = merge(0_c_int, 1_c_int, all(ieee_is_finite(derivative)))
   end function right_hand_side

   !> Returns the type of the linear solver (adapter, SUNLinSolGetType): CVODE holds no matrix for
   !> it.
   integer(c_int) function linear_type(solver) bind(c)
      type(c_ptr), value :: solver

      linear_type = merge(SUNLINEARSOLVER_MATRIX_EMBEDDED, -1, c_associated(solver))
   end function linear_type

   !> Solves the Newton system of the current step by `motion_t` (adapter, SUNLinSolSolve).
   integer(c_int) function linear_solve(solver, matrix, x, b, tolerance) bind(c)
      type(SUNLinearSolver), intent(in) :: solver
      type(c_ptr), value :: matrix, x, b
      real(c_double), value :: tolerance
      type(session_t), pointer :: session
      real(c_double), pointer :: solution(:), residual(:)
      real(c_double) :: gamma(1)
      logical :: positive

      call c_f_pointer(solver%content, session)
      call c_f_pointer(vector_data(x), solution, [size(session%y)])
      call c_f_pointer(vector_data(b), residual, [size(session%y)])
      linear_solve = FCVodeGetCurrentGamma(session%memory, gamma)
      if (linear_solve < 0 .or. c_associated(matrix) .or. tolerance < 0) return
      call session%motion%newton_step(gamma(1), residual, solution, positive)
      linear_solve = merge(0_c_int, 1_c_int, positive)
   end function linear_solve

end module beamid_cvode
