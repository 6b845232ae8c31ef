!> The response in quadruple precision, as a function of the parameters: poles of the structure by
!> Newton's method from those of double precision, residues and time functions as the formulas have
!> them, undifferentiated. Differences over 1e-16 of a parameter are its derivatives to 1e-15 or so.
module quadruple
   use beamid_excitation, only: excitation_t
   use beamid_kinds, only: wp
   use exact_motions, only: march
   use full_matrices, only: qp
   implicit none
   private

   public :: quadruple_t

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
      real(qp) :: motions(size(times), 3), impulse
      complex(qp) :: value, slope, g_F, r, z(size(times))
      integer :: i, k

      motions = 0
      impulse = 0
      do k = 1, size(self%s)
         associate (s => self%s(k))
            call self%equation(s, value, slope, g_F)
            r = g_F/slope
            if (aimag(s) > 0) r = 2*r
            impulse = impulse + real(r*s, qp)
            z = march(s, excitation, times)
            do i = 1, 3
               motions(:, i) = motions(:, i) + real(r*s**(i - 1)*z, qp)
            end do
         end associate
      end do
      motions(:, 3) = motions(:, 3) + impulse*excitation%force(times)
   end function respond

end module quadruple

!> Exact derivatives of the modal response against differences in quadruple precision, for a
!> thousand random structures.
program test_derivatives
   use beamid_assembly, only: assembly_t
   use beamid_equations, only: equations_t, new_equations
   use beamid_errors, only: error_t
   use beamid_excitation, only: excitation_t, new_pulse
   use beamid_galerkin, only: mesh_t
   use beamid_kinds, only: wp
   use beamid_modes, only: bare_beam_modes, beam_modes_t
   use beamid_observation, only: observation_t, new_sampling
   use beamid_parameters, only: amplitude, free_names, get_free, magnitude, parameters
   use beamid_pole_search, only: find_poles
   use beamid_poles, only: poles_t
   use beamid_responses, only: response_t, work_t
   use beamid_strings, only: to_text
   use beamid_structure, only: hose_t, of_c_D, of_c_H, of_E, of_k_H, of_m_H, of_m_T, of_rho, &
      structure_t
   use beamid_tracked_poles, only: assemble
   use checks, only: check, check_close, finish
   use exact_motions, only: as_columns, exact, galerkin, kinds, motion_columns, prepare, solver
   use full_matrices, only: qp
   use quadruple, only: quadruple_t
   use random_experiments, only: experiment_t, random_beam, random_experiment, samples
   use random_numbers, only: decades, random_state, start_random, uniform
   implicit none

   integer, parameter :: structures = 1000
   !> The seven parameters, in the order of `quadruple_t`.
   integer, parameter :: all_of_them(7) = [of_m_T, of_E, of_c_D, of_m_H, of_c_H, of_k_H, of_rho]
   !> Relative, in the 2-norm over the samples.
   real(wp), parameter :: tolerance = 1e-8_wp

   !> What the thousand showed of one parameter and one motion.
   type :: tally_t
      integer :: compared = 0, beyond = 0, worst_at = 0
      real(wp) :: worst = 0
      type(structure_t) :: structure          !< the worst
      real(wp) :: counts = 0                  !< p |du/dp|/|u| there
   end type tally_t

   type(tally_t) :: tallies(size(parameters), size(kinds))

   call start_random(20240229)
   call test_many()
   call test_known()
   call finish('derivatives')

contains

   !> Beams of .1 to 30 in length, 10^-2 to 10^2 in density, stiffness over eight decades; tip
   !> masses of .001 to 100 beams; damping of mode 1 from 10^-5 to critical, so that the higher
   !> modes may be overdamped; hoses of .001 to 10 beams, at a tenth to thirty times the beam's
   !> frequency, damped from 10^-3 to 30 times critically. One in seven has no hose, one in twenty
   !> no c_D, one in twenty no c_H.
   function random_case() result(e)
      type(experiment_t) :: e
      type(structure_t) :: s
      real(wp) :: mass

      s = random_beam()
      mass = s%rho*s%length
      s%m_T = mass*decades(-3.0_wp, 2.0_wp)
      s%c_D = 2*s%E/s%omega()*decades(-5.0_wp, 0.0_wp)
      if (uniform() < 0.05_wp) s%c_D = 0
      if (uniform() > 1/7.0_wp) then
         s%hose(1)%m_H = mass*decades(-3.0_wp, 1.0_wp)
         s%hose(1)%k_H = s%hose(1)%m_H*(s%omega()*decades(-1.0_wp, 1.5_wp))**2
         s%hose(1)%c_H = 2*sqrt(s%hose(1)%k_H*s%hose(1)%m_H)*decades(-3.0_wp, 1.5_wp)
         if (uniform() < 0.05_wp) s%hose(1)%c_H = 0
      end if
      e = random_experiment(s, 0.2_wp, 2, 3)
   end function random_case

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
      integer :: j, k, m

      lost = .true.
      estimate = 0
      call bare_beam_modes(galerkin, modes, error)
      if (allocated(error)) return
      equations = new_equations(galerkin, e%structure, e%excitation)
      call assemble(modes, equations, e%excitation, [integer ::], assembly)
      call find_poles(assembly, poles, error)
      if (allocated(error)) return
      base%mu = modes%mu
      base%tip = modes%tip
      ! The hose, where there is one, comes last and bears no load.
      base%load = assembly%load%total(:assembly%layout%beam)
      base%I = e%structure%I
      base%q = [(real(e%structure%get(all_of_them(k)), qp), k=1, 7)]
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
         j = findloc(all_of_them, free(k), dim=1)
         moved%q(j) = base%q(j) + step
         call moved%polish(6, lost)
         if (lost) return
         there = moved%respond(e%excitation, e%sampling%times)
         derivatives(:, :, k) = as_columns(e%sampling, (there - here)/step)
         if (modulo(int(random_state), 20) /= 0) cycle
         moved%q(j) = base%q(j) + 100*step
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
            ', zeta_1', s%c_D*s%omega()/(2*s%E), ', m_H/beam', s%hose(1)%m_H/(s%rho*s%length), &
            ', omega_H/omega_1', sqrt(s%hose(1)%k_H/max(s%hose(1)%m_H, tiny(1.0_wp)))/s%omega(), &
            ', zeta_H', &
            s%hose(1)%c_H/(2*sqrt(max(s%hose(1)%k_H*s%hose(1)%m_H, tiny(1.0_wp))))
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
         e = random_case()
         call prepare(e)
         free = all_of_them
         if (.not. any(e%structure%has_hose())) free = all_of_them([1, 2, 3, 7])
         call exact(e, free, columns, derivatives, error)
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
      do k = 1, size(parameters)
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
      call check('hoses, and beams without one', tallies(of_m_H, 1)%compared > 800 .and. &
         tallies(of_m_H, 1)%compared < 900, to_text(tallies(of_m_H, 1)%compared))
   end subroutine test_many

   !> Scaling laws, free of any difference formula. A static deflection under a step that has long
   !> been on: u = l**3/(3 E I), so that E du/dE = -u; and for any force and structure u(E, c_D,
   !> k_H, c_H, all masses) is unchanged when all of them grow together with the force: Euler's
   !> sum of q du/dq is -u.
   subroutine test_known()
      integer, parameter :: moved(4) = [of_E, of_m_T, of_c_D, of_rho]
      type(experiment_t) :: e
      type(error_t), allocatable :: error
      real(wp), allocatable :: columns(:, :), derivatives(:, :, :)
      real(wp) :: total(samples*3, size(kinds)), worst(size(kinds))
      integer :: number, k, m, n

      worst = 0
      do number = 1, 200
         e = random_case()
         call prepare(e)
         call exact(e, all_of_them, columns, derivatives, error)
         if (allocated(error)) cycle
         n = size(columns, 1)
         total(:n, :) = columns
         do k = 1, 7
            if (k > 3 .and. k < 7 .and. .not. any(e%structure%has_hose())) cycle
            total(:n, :) = total(:n, :) + e%structure%get(all_of_them(k))*derivatives(:, :, k)
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

      e%structure = structure_t(length=2, rho=1, E=7, I=0.5_wp, c_D=1, m_T=1, &
         hose=hose_t(m_H=0.3_wp, c_H=3, &
         k_H=2))
      e%mesh = mesh_t(3, 3, 4, 1)
      e%excitation = new_pulse(1.0_wp, 2000.0_wp)
      e%sampling = new_sampling(observation_t(3, 0.0_wp), [(1000.0_wp + k, k=1, samples)])
      call prepare(e)
      call exact(e, moved, columns, derivatives, error)
      ! Cubics hold the static deflection without error; the transient has died, exp(-100) or less.
      call check_close('static deflection', columns(1, 1)/(8/(3*3.5_wp)), 1.0_wp, 1e-12_wp)
      call check_close('static deflection, d/dE', derivatives(1, 1, 1)/(-8/(3*3.5_wp)/7), &
         1.0_wp, 1e-11_wp)
      do k = 2, 4
         call check_close('static deflection, d/dq of '//free_names(moved(k)), &
            derivatives(1, 1, k), 0.0_wp, 1e-11_wp)
      end do
   end subroutine test_known

end program test_derivatives
