!> The response in quadruple precision, as a function of the parameters: poles of the structure by
!> Newton's method from those of double precision, residues and time functions as the formulas have
!> them, undifferentiated. Differences over 1e-16 of a parameter are its derivatives to 1e-15 or so.
module quadruple
   use, intrinsic :: iso_fortran_env, only: real128
   use beamid_excitation, only: excitation_t
   use beamid_kinds, only: wp
   use beamid_structure, only: structure_t
   implicit none
   private

   public :: qp, quadruple_t

   integer, parameter :: qp = real128

   !> Modes of the bare beam, taken as exact, and parameters m_T, E, c_D, m_H, c_H, k_H, rho.
   type :: quadruple_t
      real(qp), allocatable :: mu(:), tip(:), load(:)
      real(qp) :: q(7) = 0, I = 0
      complex(qp), allocatable :: s(:)        !< poles, one of each pair
   contains
      procedure :: equation
      procedure :: polish
      procedure :: respond
   end type quadruple_t

contains

   !> 1 + g h and its derivative, g_F, and what the slope consists of without cancellation.
   pure subroutine equation(self, s, value, slope, g_F)
      class(quadruple_t), intent(in) :: self
      complex(qp), intent(in) :: s
      complex(qp), intent(out) :: value, slope, g_F
      complex(qp) :: D(size(self%mu)), dD(size(self%mu)), g, dg, h, dh, a, b

      associate (m_T => self%q(1), E => self%q(2), c_D => self%q(3), m_H => self%q(4), &
         c_H => self%q(5), k_H => self%q(6), rho => self%q(7))
         D = rho*s**2 + (E + c_D*s)*self%I*self%mu
         dD = 2*rho*s + c_D*self%I*self%mu
         g = sum(self%tip**2/D)
         dg = -sum(self%tip**2*dD/D**2)
         g_F = sum(self%tip*self%load/D)
         h = m_T*s**2
         dh = 2*m_T*s
         if (m_H > 0) then
            a = m_H*s**2*(k_H + c_H*s)
            b = m_H*s**2 + c_H*s + k_H
            h = h + a/b
            dh = dh + (2*m_H*s*k_H + 3*m_H*c_H*s**2)/b - a*(2*m_H*s + c_H)/b**2
         end if
      end associate
      value = 1 + g*h
      slope = dg*h + g*dh
   end subroutine equation

   !> Newton's method for every pole, until the step is nothing.
   !>
   !> lost  a pole wanders or does not settle
   pure subroutine polish(self, steps, lost)
      class(quadruple_t), intent(inout) :: self
      integer, intent(in) :: steps
      logical, intent(out) :: lost
      complex(qp) :: value, slope, g_F, change, s
      integer :: k, i

      lost = .false.
      do k = 1, size(self%s)
         s = self%s(k)
         do i = 1, steps
            call self%equation(s, value, slope, g_F)
            change = -value/slope
            s = s + change
            if (abs(change) <= 1e-24_qp*abs(s)) exit
         end do
         if (.not. abs(change) <= 1e-24_qp*abs(s)) lost = .true.
         if (.not. abs(s - self%s(k)) <= 1e-5_qp*abs(s)) lost = .true.
         self%s(k) = s
      end do
   end subroutine polish

   !> Displacement, velocity, acceleration (size(times), 3).
   pure function respond(self, excitation, times) result(motions)
      class(quadruple_t), intent(in) :: self
      type(excitation_t), intent(in) :: excitation
      real(wp), intent(in) :: times(:)
      real(qp) :: motions(size(times), 3)
      complex(qp) :: value, slope, g_F, r, z
      real(qp) :: t, finish, impulse
      integer :: i, k, node

      motions = 0
      impulse = 0
      do k = 1, size(self%s)
         associate (s => self%s(k))
            call self%equation(s, value, slope, g_F)
            r = g_F/slope
            if (aimag(s) > 0) r = 2*r
            impulse = impulse + real(r*s, qp)
            z = 0
            node = 1
            t = excitation%t(1)
            do i = 1, size(times)
               do while (t < times(i))
                  finish = times(i)
                  if (node < size(excitation%t)) finish = min(finish, real(excitation%t(node &
                     + 1), qp))
                  call advance(s, excitation, node, t, finish, z)
                  t = finish
                  if (node < size(excitation%t)) then
                     if (t >= excitation%t(node + 1)) node = node + 1
                  end if
               end do
               motions(i, :) = motions(i, :) + real([r*z, r*s*z, r*s**2*z], qp)
            end do
         end associate
      end do
      motions(:, 3) = motions(:, 3) + impulse*excitation%force(times)
   end function respond

   !> z' = s z + f from t to `finish`, within the segment of the force that begins at `node`.
   pure subroutine advance(s, excitation, node, t, finish, z)
      complex(qp), intent(in) :: s
      type(excitation_t), intent(in) :: excitation
      integer, intent(in) :: node
      real(qp), intent(in) :: t, finish
      complex(qp), intent(inout) :: z
      complex(qp) :: growth
      real(qp) :: step, force, slope

      step = finish - t
      growth = exp(s*step)
      z = growth*z
      if (node >= size(excitation%t)) return
      associate (nodes => excitation%t, f => excitation%f)
         slope = (real(f(node + 1), qp) - f(node))/(real(nodes(node + 1), qp) - nodes(node))
         force = f(node) + slope*(t - nodes(node))
      end associate
      z = z + force*(growth - 1)/s + slope*(growth - 1 - s*step)/s**2
   end subroutine advance

end module quadruple

!> Exact derivatives of the modal response against differences in quadruple precision, for a
!> thousand random structures.
program test_derivatives
   use, intrinsic :: iso_fortran_env, only: int64
   use beamid_equations, only: equations_t, new_equations
   use beamid_errors, only: error_t
   use beamid_excitation, only: excitation_t, new_force_table, new_pulse
   use beamid_galerkin, only: galerkin_t, mesh_t, new_galerkin
   use beamid_kinds, only: wp
   use beamid_modal, only: assemble, modal_t
   use beamid_modes, only: bare_beam_modes, beam_modes_t
   use beamid_observation, only: observation_t, new_sampling, sampling_t
   use beamid_parameters, only: amplitude, free_names, get_free, magnitude
   use beamid_poles, only: find_poles, poles_t
   use beamid_assembly, only: assembly_t
   use beamid_responses, only: response_t, work_t
   use beamid_strings, only: to_text
   use beamid_structure, only: structure_t
   use checks, only: check, check_close, finish
   use quadruple, only: qp, quadruple_t
   implicit none

   integer, parameter :: structures = 1000, samples = 12
   character(len=*), parameter :: kinds(4) = [character(len=12) :: 'displacement', 'velocity', &
      'acceleration', 'observation']
   !> Relative, in the 2-norm over the samples.
   real(wp), parameter :: tolerance = 1e-8_wp

   !> One experiment.
   type :: experiment_t
      type(structure_t) :: structure
      type(excitation_t) :: excitation
      type(mesh_t) :: mesh
      type(sampling_t) :: sampling
      integer :: formula = 3
   end type experiment_t

   !> What the thousand showed of one parameter and one motion.
   type :: tally_t
      integer :: compared = 0, beyond = 0, worst_at = 0
      real(wp) :: worst = 0
      type(structure_t) :: structure          !< the worst
      real(wp) :: counts = 0                  !< p |du/dp|/|u| there
   end type tally_t

   integer(int64) :: state = 20240229
   type(tally_t) :: tallies(size(free_names), size(kinds))
   type(galerkin_t), target :: galerkin
   type(modal_t) :: solver

   call test_many()
   call test_known()
   call finish('derivatives')

contains

   !> Uniform in (0, 1): Lehmer's generator with the multiplier 48271.
   real(wp) function uniform()
      state = modulo(48271_int64*state, 2147483647_int64)
      uniform = real(state, wp)/2147483647
   end function uniform

   !> Between two values.
   real(wp) function between(low, high)
      real(wp), intent(in) :: low, high

      between = low + (high - low)*uniform()
   end function between

   !> Evenly distributed in decades, between two powers of ten.
   real(wp) function decades(low, high)
      real(wp), intent(in) :: low, high

      decades = 10**between(low, high)
   end function decades

   !> Beams of .1 to 30 in length, 10^-2 to 10^2 in density, stiffness over eight decades; tip
   !> masses of .001 to 100 beams; damping of mode 1 from 10^-5 to critical, so that the higher
   !> modes may be overdamped; hoses of .001 to 10 beams, at a tenth to thirty times the beam's
   !> frequency, damped from 10^-3 to 30 times critically. One in seven has no hose, one in twenty
   !> no c_D, one in twenty no c_H.
   function random_experiment() result(e)
      type(experiment_t) :: e
      type(error_t), allocatable :: error
      real(wp) :: period, mass, times(samples), t
      integer :: k

      associate (s => e%structure)
         s%length = decades(-1.0_wp, 1.5_wp)
         s%rho = decades(-2.0_wp, 2.0_wp)
         s%E = decades(-2.0_wp, 4.0_wp)
         s%I = decades(-1.0_wp, 1.0_wp)
         mass = s%rho*s%length
         s%m_T = mass*decades(-3.0_wp, 2.0_wp)
         s%c_D = 2*s%E/s%omega()*decades(-5.0_wp, 0.0_wp)
         if (uniform() < 0.05_wp) s%c_D = 0
         if (uniform() > 1/7.0_wp) then
            s%m_H = mass*decades(-3.0_wp, 1.0_wp)
            s%k_H = s%m_H*(s%omega()*decades(-1.0_wp, 1.5_wp))**2
            s%c_H = 2*sqrt(s%k_H*s%m_H)*decades(-3.0_wp, 1.5_wp)
            if (uniform() < 0.05_wp) s%c_H = 0
         end if
         period = 2*acos(-1.0_wp)/s%omega()
      end associate
      e%mesh = mesh_t(3, 2 + int(5*uniform()), 4, 1)
      if (uniform() < 0.2_wp) e%mesh = mesh_t(5, 2 + int(2*uniform()), 6, 1)
      if (uniform() < 0.5_wp) then
         e%excitation = new_pulse(decades(-1.0_wp, 1.0_wp), period*decades(-2.0_wp, 0.0_wp))
      else
         call new_force_table(period*[0.0_wp, between(0.01_wp, 0.1_wp), between(0.11_wp, 0.5_wp)], &
            [between(0.0_wp, 1.0_wp), between(-1.0_wp, 1.0_wp), between(0.0_wp, 1.0_wp)], &
            e%excitation, error)
      end if
      e%excitation%distributed = uniform() < 0.2_wp
      t = 0
      do k = 1, samples
         t = t + period*between(0.02_wp, 0.4_wp)
         times(k) = t
      end do
      e%formula = 1 + int(3*uniform())
      e%sampling = new_sampling(observation_t(e%formula, period*between(0.01_wp, 0.1_wp)), times)
   end function random_experiment

   !> Displacement, velocity and acceleration at the times, and what is observed at the samples.
   pure function motion_columns(sampling, response) result(columns)
      type(sampling_t), intent(in) :: sampling
      type(response_t), intent(in) :: response
      real(wp) :: columns(size(sampling%times), size(kinds))

      columns(:, 1) = response%displacement
      columns(:, 2) = response%velocity
      columns(:, 3) = response%acceleration
      columns(:, 4) = 0
      columns(:samples, 4) = sampling%acceleration(response)
   end function motion_columns

   !> The same of motions in quadruple precision: (4.1) and (4.2) cancel digits that are there.
   function as_columns(sampling, motions) result(columns)
      type(sampling_t), intent(in) :: sampling
      real(qp), intent(in) :: motions(:, :)
      real(wp) :: columns(size(motions, 1), size(kinds))
      type(response_t) :: high, low

      ! The formulas are linear: high and low halves of each number, one after the other.
      high%t = sampling%times
      high%displacement = real(motions(:, 1), wp)
      high%velocity = real(motions(:, 2), wp)
      high%acceleration = real(motions(:, 3), wp)
      low%t = sampling%times
      low%displacement = real(motions(:, 1) - high%displacement, wp)
      low%velocity = real(motions(:, 2) - high%velocity, wp)
      low%acceleration = real(motions(:, 3) - high%acceleration, wp)
      columns = motion_columns(sampling, high) + motion_columns(sampling, low)
   end function as_columns

   !> Exact derivatives with respect to all parameters, and the motions themselves.
   subroutine exact_derivatives(e, free, columns, derivatives, error)
      type(experiment_t), intent(in) :: e
      integer, intent(in) :: free(:)
      real(wp), allocatable, intent(out) :: columns(:, :), derivatives(:, :, :)
      type(error_t), allocatable, intent(out) :: error
      type(equations_t), target :: equations
      type(response_t) :: response
      type(response_t), allocatable :: slopes(:)
      type(work_t) :: work
      integer :: k

      equations = new_equations(galerkin, e%structure, e%excitation)
      call solver%differentiate(equations, e%excitation, e%sampling%times, free, response, slopes, &
         work, error)
      if (allocated(error)) return
      columns = motion_columns(e%sampling, response)
      allocate (derivatives(size(columns, 1), size(kinds), size(free)))
      do k = 1, size(free)
         derivatives(:, :, k) = motion_columns(e%sampling, slopes(k))
      end do
   end subroutine exact_derivatives

   !> The motions, and their derivatives with respect to the seven parameters of the structure, from
   !> differences in quadruple precision, rounded.
   !>
   !> estimate  what a step a hundred times as long changes, relative, the worst of all: the first
   !>           term that the differences leave out, a hundred times too large
   !> lost      no pole may be lost, nor two become one
   subroutine references(e, free, columns, derivatives, estimate, lost)
      type(experiment_t), intent(in) :: e
      integer, intent(in) :: free(:)
      real(wp), allocatable, intent(out) :: columns(:, :), derivatives(:, :, :)
      real(wp), intent(out) :: estimate
      logical, intent(out) :: lost
      type(quadruple_t) :: base, moved
      type(equations_t) :: equations
      type(poles_t) :: poles
      type(error_t), allocatable :: error
      type(beam_modes_t) :: modes
      real(wp), allocatable :: again(:, :)
      type(assembly_t) :: assembly
      real(qp), allocatable :: here(:, :), there(:, :)
      real(qp) :: step
      integer :: k, m

      lost = .true.
      estimate = 0
      call bare_beam_modes(galerkin, modes, error)
      if (allocated(error)) return
      equations = new_equations(galerkin, e%structure, e%excitation)
      call assemble(modes, equations, e%excitation, [integer ::], assembly)
      call find_poles(assembly, modes, poles, error)
      if (allocated(error)) return
      base%mu = modes%mu
      base%tip = modes%tip
      base%load = assembly%load(:, 1, 1)
      base%I = e%structure%I
      base%q = [(real(e%structure%get(k), qp), k=1, 7)]
      base%s = poles%s
      call base%polish(30, lost)
      do k = 1, size(base%s)
         if (any(abs(base%s(k + 1:) - base%s(k)) <= 1e-12_qp*abs(base%s(k)))) lost = .true.
      end do
      if (lost) return
      here = base%respond(e%excitation, e%sampling%times)
      columns = as_columns(e%sampling, here)
      allocate (derivatives(size(columns, 1), size(kinds), size(free)))
      do k = 1, size(free)
         step = 1e-16_qp*e%structure%get(free(k))
         if (.not. step > 0) step = 1e-16_qp*magnitude(e%structure, free(k))
         moved = base
         moved%q(free(k)) = base%q(free(k)) + step
         call moved%polish(6, lost)
         if (lost) return
         there = moved%respond(e%excitation, e%sampling%times)
         derivatives(:, :, k) = as_columns(e%sampling, (there - here)/step)
         if (modulo(int(state), 20) /= 0) cycle
         moved%q(free(k)) = base%q(free(k)) + 100*step
         call moved%polish(6, lost)
         there = moved%respond(e%excitation, e%sampling%times)
         again = as_columns(e%sampling, (there - here)/(100*step))
         do m = 1, size(kinds)
            estimate = max(estimate, norm2(again(:, m) - derivatives(:, m, k)) &
               /norm2(derivatives(:, m, k)))
         end do
      end do
   end subroutine references

   !> One parameter: the four motions.
   !>
   !> columns  the motions themselves, for what the parameter counts
   subroutine compare(e, number, k, derivative, reference, columns)
      type(experiment_t), intent(in) :: e
      integer, intent(in) :: number, k
      real(wp), intent(in) :: derivative(:, :), reference(:, :), columns(:, :)
      real(wp) :: wrong
      integer :: m

      do m = 1, size(kinds)
         associate (tally => tallies(k, m))
            tally%compared = tally%compared + 1
            wrong = norm2(derivative(:, m) - reference(:, m))/norm2(reference(:, m))
            if (.not. wrong <= tolerance) tally%beyond = tally%beyond + 1
            if (wrong <= tally%worst) cycle
            tally%worst = wrong
            tally%worst_at = number
            tally%structure = e%structure
            tally%counts = get_free(e%structure, e%excitation, k)*norm2(reference(:, m)) &
               /norm2(columns(:, m))
         end associate
      end do
   end subroutine compare

   !> What the worst case looks like.
   subroutine tell(tally)
      type(tally_t), intent(in) :: tally

      associate (s => tally%structure)
         print '(a,i0,a,es8.1,6(a,es8.1))', '      structure ', tally%worst_at, &
            ': a change by 100 % counts', tally%counts, ', m_T/beam', s%m_T/(s%rho*s%length), &
            ', zeta_1', s%c_D*s%omega()/(2*s%E), ', m_H/beam', s%m_H/(s%rho*s%length), &
            ', omega_H/omega_1', sqrt(s%k_H/max(s%m_H, tiny(1.0_wp)))/s%omega(), ', zeta_H', &
            s%c_H/(2*sqrt(max(s%k_H*s%m_H, tiny(1.0_wp))))
      end associate
   end subroutine tell

   subroutine test_many()
      type(experiment_t) :: e
      type(excitation_t) :: unit_force
      type(error_t), allocatable :: error
      type(equations_t), target :: equations
      type(response_t) :: response
      type(work_t) :: work
      real(wp), allocatable :: columns(:, :), derivatives(:, :, :), known(:, :), reference(:, :, :)
      integer, allocatable :: free(:)
      real(wp) :: estimate, worst_estimate
      integer :: number, k, m, refused, unknown
      logical :: lost

      refused = 0
      unknown = 0
      worst_estimate = 0
      do number = 1, structures
         e = random_experiment()
         galerkin = new_galerkin(e%mesh, e%structure%length)
         call solver%prepare(galerkin, error)
         free = [1, 2, 3, 4, 5, 6, 7]
         if (.not. e%structure%has_hose()) free = [1, 2, 3, 7]
         if (.not. allocated(error)) call exact_derivatives(e, free, columns, derivatives, error)
         if (allocated(error)) then
            refused = refused + 1
            print '(a,i0,2a)', '      structure ', number, ': ', error%message
            cycle
         end if
         call references(e, free, known, reference, estimate, lost)
         if (lost) then
            unknown = unknown + 1
            print '(a,i0,a)', '      structure ', number, ': no reference'
            cycle
         end if
         worst_estimate = max(worst_estimate, estimate)
         do k = 1, size(free)
            call compare(e, number, free(k), derivatives(:, :, k), reference(:, :, k), known)
         end do
         ! The amplitude, as a fit has it: the response to a force of amplitude one.
         unit_force = e%excitation
         call unit_force%set_amplitude(1.0_wp)
         equations = new_equations(galerkin, e%structure, unit_force)
         call solver%respond(equations, unit_force, e%sampling%times, response, work, error)
         call compare(e, number, amplitude, motion_columns(e%sampling, response), &
            known/e%excitation%amplitude, known)
      end do
      ! No random structure has two roots that are alike in eight digits, or next to none.
      call check('structures refused', refused <= 1, to_text(refused))
      call check('structures without a reference', unknown <= 10, to_text(unknown))
      ! The step itself is a hundred times shorter than that of the estimate, and so is the error.
      call check('references, worst estimate of their error', worst_estimate/100 < tolerance/100, &
         to_text(worst_estimate/100))
      do k = 1, size(free_names)
         do m = 1, size(kinds)
            associate (tally => tallies(k, m))
               ! 1e-8 but for a handful: a structure with a beam damped to half of critical and two
               ! like it lose up to two digits. The sum rule of the residues, which bounds what is
               ! lost, refuses what would be worse than 1e-6 of an ordinary residue. A derivative
               ! that hardly counts (a motion changes by 1e-3 when the parameter doubles) may be
               ! worse by itself, but not in what it says of the motion: there 1e-8 holds for all.
               call check(trim(kinds(m))//' by '//trim(free_names(k))//': 3 of 1000 beyond 1e-8', &
                  tally%beyond <= 3, to_text(tally%beyond))
               call check_close(trim(kinds(m))//' by '//trim(free_names(k))//', worst of '// &
                  to_text(tally%compared)//' (structure '//to_text(tally%worst_at)//', '// &
                  to_text(tally%beyond)//' beyond)', tally%worst, 0.0_wp, &
                  max(1e-6_wp, tolerance/max(tally%counts, tiny(1.0_wp))))
               if (.not. tally%worst <= tolerance) call tell(tally)
            end associate
         end do
      end do
      call check('hoses, and beams without one', tallies(4, 1)%compared > 800 .and. &
         tallies(4, 1)%compared < 900, to_text(tallies(4, 1)%compared))
   end subroutine test_many

   !> Scaling laws, free of any difference formula. A static deflection under a step that has long
   !> been on: u = l**3/(3 E I), so that E du/dE = -u; and for any force and structure u(E, c_D,
   !> k_H, c_H, all masses) is unchanged when all of them grow together with the force: Euler's
   !> sum of q du/dq is -u.
   subroutine test_known()
      type(experiment_t) :: e
      type(error_t), allocatable :: error
      real(wp), allocatable :: columns(:, :), derivatives(:, :, :)
      real(wp) :: total(samples*3, size(kinds)), worst(size(kinds))
      integer :: number, k, m, n

      worst = 0
      do number = 1, 200
         e = random_experiment()
         galerkin = new_galerkin(e%mesh, e%structure%length)
         call solver%prepare(galerkin, error)
         if (.not. allocated(error)) call exact_derivatives(e, [1, 2, 3, 4, 5, 6, 7], columns, &
            derivatives, error)
         if (allocated(error)) cycle
         n = size(columns, 1)
         total(:n, :) = columns
         do k = 1, 7
            if (k > 3 .and. k < 7 .and. .not. e%structure%has_hose()) cycle
            total(:n, :) = total(:n, :) + e%structure%get(k)*derivatives(:, :, k)
         end do
         do m = 1, size(kinds)
            worst(m) = max(worst(m), norm2(total(:n, m))/norm2(columns(:, m)))
         end do
      end do
      do m = 1, size(kinds)
         ! Sums of numbers that are as large as the phase, 1e3, times the motion.
         call check_close('Euler''s sum of q du/dq, '//trim(kinds(m))//', worst of 200', worst(m), &
            0.0_wp, 1e-8_wp)
      end do

      e%structure = structure_t(length=2, rho=1, E=7, I=0.5_wp, c_D=1, m_T=1, m_H=0.3_wp, c_H=3, &
         k_H=2)
      e%mesh = mesh_t(3, 3, 4, 1)
      e%excitation = new_pulse(1.0_wp, 2000.0_wp)
      e%sampling = new_sampling(observation_t(3, 0.0_wp), [(1000.0_wp + k, k=1, samples)])
      galerkin = new_galerkin(e%mesh, e%structure%length)
      call solver%prepare(galerkin, error)
      call exact_derivatives(e, [2, 1, 3, 7], columns, derivatives, error)
      ! Cubics hold the static deflection without error; the transient has died, exp(-100) or less.
      call check_close('static deflection', columns(1, 1)/(8/(3*3.5_wp)), 1.0_wp, 1e-12_wp)
      call check_close('static deflection, d/dE', derivatives(1, 1, 1)/(-8/(3*3.5_wp)/7), &
         1.0_wp, 1e-11_wp)
      do k = 2, 4
         call check_close('static deflection, d/dq of '//free_names(merge(7, 2*k - 3, k == 4)), &
            derivatives(1, 1, k), 0.0_wp, 1e-11_wp)
      end do
   end subroutine test_known

end program test_derivatives
