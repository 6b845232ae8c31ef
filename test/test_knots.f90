!> Knots at attachments: against the closed form of the dynamic stiffness, by the order of
!> convergence, and by the solver `cvode`.
!>
!> The numbers were computed with mpmath in 50 digits. A transfer matrix of Krylov's functions leads
!> from each point to the next, where shear force and moment jump; two conditions at the tip
!> determine shear force and moment at the root. The derivatives are central differences over
!> 1e-15.
program test_knots
   use beamid_cvode, only: cvode_t
   use beamid_errors, only: error_t
   use beamid_excitation, only: new_pulse
   use beamid_frequency_responses, only: predict_response
   use beamid_galerkin, only: galerkin_of, galerkin_t, mesh_t
   use beamid_kinds, only: wp
   use beamid_modal, only: modal_t
   use beamid_modes, only: natural_frequencies
   use beamid_observed_data, only: meshed_model_t
   use beamid_responses, only: work_t
   use beamid_simulation, only: model_t, simulate, simulation_t
   use beamid_strings, only: to_text
   use beamid_structure, only: hose_t, mass_t, no_spring, of_length, of_x_F, sensor_t, &
      structure_t, support_t, x_M_at
   use checks, only: check, check_close, finish, skip
   use known_transfers, only: frequencies => known_frequencies, known_inside, with_parts_inside
   use shell, only: beamid, close_shell, open_shell, outcome_t, read_file, write_file
   use tables, only: field, number
   implicit none

   real(wp), parameter :: two_pi = 2*acos(-1.0_wp)
   type(mesh_t), parameter :: fine = mesh_t(5, 64, 6, 1, .true.)
   !> Frequency responses of `structure_with`.
   complex(wp), parameter :: known(4, 3) = reshape([ &
      (0.031130494405896822_wp, -5.2501995045367767e-5_wp), &
      (-0.01904188734776857_wp, -7.9030625374389784e-5_wp), &
      (-0.0023450609550711066_wp, -3.1359249737562701e-5_wp), &
      (-0.00014360464207013713_wp, 1.2843350840967144e-5_wp), &
      (0.031578187954307405_wp, -0.00017497687454161102_wp), &
      (-0.017256976411435316_wp, -0.00011726327519642511_wp), &
      (-0.0037265135445946906_wp, -0.0001807363250628154_wp), &
      (8.0332167205476467e-5_wp, 5.198085814938352e-5_wp), &
      (0.015450588255022946_wp, -5.7753265526944415e-5_wp), &
      (-0.013108048456903444_wp, -0.00017725404175785951_wp), &
      (-0.0066384491877171826_wp, -0.00075931964752555777_wp), &
      (0.00037091412320489642_wp, 0.00027722943816576113_wp)], [4, 3])
   !> Derivatives of the first with respect to the position of the mass.
   complex(wp), parameter :: by_position(4) = [ &
      (0.0032061243751926142_wp, -1.0754934100883544e-5_wp), &
      (0.00795597507602368_wp, 7.1715220368232272e-5_wp), &
      (0.0036815114516099902_wp, 0.00015272504110015684_wp), &
      (0.00074575319209948916_wp, 1.3822700344238788e-5_wp)]
   !> First natural frequencies of the first two.
   real(wp), parameter :: natural(3, 2) = reshape([0.77446527758475462_wp, &
      4.382778000273195_wp, 12.679282334833617_wp, 0.75797610593083368_wp, &
      4.9029084756566984_wp, 14.546607051539576_wp], [3, 2])
   integer :: k

   do k = 1, size(known, 2)
      call test_closed_form(k)
   end do
   call test_order()
   call test_estimated_positions()
   call test_short_elements()
   call test_solvers()
   call test_program()
   call finish('knots')

contains

   !> Returns a beam with a force inside and: a mass with rotary inertia; a sensor with rotary
   !> inertia and a damper to the ground; a sensor with mass, a support with springs and dampers for
   !> deflection and rotation, and a hose.
   function structure_with(number) result(beam)
      integer, intent(in) :: number
      type(structure_t) :: beam

      beam = structure_t(length=1.25_wp, rho=0.5_wp, E=200, I=0.02_wp, c_D=0.1_wp, m_T=0.1_wp, &
         x_F=0.55_wp)
      beam%sensors = 1
      beam%sensor(1)%x_S = 0.8_wp
      if (number == 1) then
         beam%masses = 1
         beam%mass(1) = mass_t(m_M=0.2_wp, J_M=0.003_wp, x_M=0.47_wp)
         return
      end if
      beam%sensor(1) = sensor_t(m_S=0.08_wp, J_S=0.001_wp, x_S=0.8_wp)
      beam%supports = 1
      beam%support(1) = support_t(x_P=0.3_wp, kappa_P=no_spring, c_P=0.7_wp)
      if (number == 2) return
      beam%sensor(1)%J_S = 0
      beam%support(1) = support_t(x_P=0.3_wp, kappa_P=0.002_wp, c_P=0.7_wp, kappa_RP=0.25_wp, &
         c_RP=0.02_wp)
      beam%hoses = 1
      beam%hose(1) = hose_t(m_H=0.1_wp, c_H=0.1_wp, k_H=20, x_H=1.01_wp)
   end function structure_with

   !> Computes a displacement per unit force.
   !>
   !> h  (frequencies, 0:parameters) as of `predict_response`
   subroutine respond(mesh, structure, parameters, h)
      type(mesh_t), intent(in) :: mesh
      type(structure_t), intent(in) :: structure
      integer, intent(in) :: parameters(:)
      complex(wp), intent(out) :: h(:, 0:)
      type(error_t), allocatable :: error
      type(meshed_model_t), target :: model
      type(modal_t), allocatable :: solver
      type(work_t) :: work

      h = huge(1.0_wp)
      allocate (solver)
      model%galerkin = galerkin_of(mesh, structure)
      call solver%prepare(model%galerkin, error)
      call move_alloc(solver, model%solver)
      if (.not. allocated(error)) call predict_response(model, structure, &
         new_pulse(0.0_wp, 1.0_wp), 0, 0.0_wp, frequencies, parameters, h, work, error)
      call check('a response', .not. allocated(error))
   end subroutine respond

   !> Returns the error of a response, relative to the largest value.
   real(wp) function error_of(h, exact)
      complex(wp), intent(in) :: h(:), exact(:)

      error_of = maxval(abs(h - exact))/maxval(abs(exact))
   end function error_of

   !> The required accuracy is 1e-8 of the largest value. Modes of 64 quintics are exact to 1e-10 or
   !> so. Without the knots the error is above 1e-7. The derivative by the position of a rotary
   !> inertia contains the curvature, which jumps there. Its mean of both sides converges more
   !> slowly than the response; the curvature of one side would be wrong by half of the jump.
   subroutine test_closed_form(number)
      integer, intent(in) :: number
      complex(wp) :: h(4, 0:1), without(4, 0:1)
      real(wp), allocatable :: omega(:)
      type(error_t), allocatable :: error
      integer, allocatable :: parameters(:)

      parameters = [integer :: of_x_F]
      if (number == 1) parameters = [x_M_at(1)]
      call respond(fine, structure_with(number), parameters, h)
      call respond(mesh_t(5, 64, 6, 1), structure_with(number), parameters, without)
      call check_close('structure '//to_text(number)//': response', error_of(h(:, 0), &
         known(:, number)), 0.0_wp, 1e-8_wp)
      call check('  without the knots', error_of(without(:, 0), known(:, number)) > 1e-7_wp)
      if (number == 1) call check_close('  by x_M', error_of(h(:, 1), by_position), 0.0_wp, 1e-7_wp)
      if (number > size(natural, 2)) return
      call natural_frequencies(structure_with(number), fine, omega, error)
      call check('  natural frequencies', .not. allocated(error))
      if (allocated(error)) return
      call check_close('  their error', maxval(abs(omega(:3)/(two_pi*natural(:, number)) - 1)), &
         0.0_wp, 1e-9_wp)
   end subroutine test_closed_form

   !> With the knots, the response of quintics converges with order 2 (degree - 1) = 8, or a little
   !> more on coarse meshes; without them, with order 3. The places are at the same fractions of an
   !> element, up to reflection, on 6 and 24 elements.
   subroutine test_order()
      complex(wp) :: h(4, 0:0)
      real(wp) :: wrong(2, 2)
      integer, parameter :: elements(2) = [6, 24]
      integer :: i, j

      do j = 1, 2
         do i = 1, 2
            call respond(mesh_t(5, elements(i), 6, 1, j == 2), with_parts_inside(), [integer ::], h)
            wrong(i, j) = error_of(h(:, 0), known_inside)
         end do
         print '(a,2es10.2)', '      errors ', wrong(:, j)
      end do
      call check_close('order of the error without knots', log(wrong(1, 1)/wrong(2, 1)) &
         /log(4.0_wp), 3.0_wp, 1.0_wp)
      call check('order of the error with knots', log(wrong(1, 2)/wrong(2, 2))/log(4.0_wp) > 6, &
         to_text(log(wrong(1, 2)/wrong(2, 2))/log(4.0_wp)))
   end subroutine test_order

   !> A position that a fit estimates has no knots, and no position has if the length is estimated.
   subroutine test_estimated_positions()
      type(galerkin_t) :: all_of_them, some, none, uniform
      type(structure_t) :: beam

      beam = structure_with(1)
      all_of_them = galerkin_of(fine, beam)
      some = galerkin_of(fine, beam, moving=[x_M_at(1)])
      none = galerkin_of(fine, beam, moving=[of_length])
      uniform = galerkin_of(mesh_t(5, 64, 6, 1), beam)
      ! 0.55/1.25*64 = 28.16 moves a knot, which then has the multiplicity 3. 0.47/1.25*64 = 24.064
      ! moves one of the multiplicity 4. The sensor has no mass.
      call check('knots of force and mass', all_of_them%space%n == uniform%space%n + 2 + 3)
      call check('knots of the force alone', some%space%n == uniform%space%n + 2)
      call check('no knots with a free length', none%space%n == uniform%space%n)
      beam%mass(1)%J_M = 0
      all_of_them = galerkin_of(fine, beam)
      call check('knots without rotary inertia', all_of_them%space%n == uniform%space%n + 2 + 2)
   end subroutine test_estimated_positions

   !> No position makes an element shorter than a twentieth of the interval, and the response stays
   !> accurate: a force beside a mass, and beside both ends, compared with the same beam on another
   !> mesh. A shared knot, or none, leaves an error of third order in the small distance; beside the
   !> clamp it is compared with a response that is small itself.
   subroutine test_short_elements()
      type(galerkin_t) :: galerkin
      type(structure_t) :: beam
      complex(wp) :: h(4, 0:0), finer(4, 0:0)
      real(wp), parameter :: places(4) = [0.4700001_wp, 0.4705_wp, 1e-4_wp, 1.2499999_wp]
      integer :: i

      beam = structure_with(1)
      do i = 1, size(places)
         beam%x_F = places(i)
         galerkin = galerkin_of(fine, beam)
         associate (space => galerkin%space)
            call check('shortest element at '//to_text(places(i)), minval(space%ends(1:) &
               - space%ends(:space%elements - 1)) > 0.0499_wp*beam%length/64)
         end associate
         call respond(fine, beam, [integer ::], h)
         call respond(mesh_t(7, 90, 8, 1, .true.), beam, [integer ::], finer)
         call check_close('  response', error_of(h(:, 0), finer(:, 0)), 0.0_wp, 1e-7_wp)
      end do
   end subroutine test_short_elements

   !> Both solvers on the same mesh with knots. The tolerance of `cvode` is 1e-10 per step, and its
   !> error adds up over some thousand steps.
   subroutine test_solvers()
      type(model_t) :: model
      type(simulation_t) :: by_modal, by_cvode
      type(error_t), allocatable :: error
      real(wp), parameter :: times(5) = [0.05_wp, 0.1_wp, 0.2_wp, 0.3_wp, 0.5_wp]
      type(mesh_t), parameter :: mesh = mesh_t(3, 8, 4, 1, .true.)

      model%structure = structure_with(3)
      model%excitation = new_pulse(1.0_wp, 0.1_wp)
      allocate (modal_t :: model%solver)
      call simulate(model, mesh, times, by_modal, error)
      call check('a motion by modal', .not. allocated(error))
      if (allocated(error)) return
      deallocate (model%solver)
      allocate (model%solver, source=cvode_t(rtol=1e-10_wp))
      call simulate(model, mesh, times, by_cvode, error)
      call check('a motion by cvode', .not. allocated(error))
      if (allocated(error)) return
      call check_close('modal against cvode', &
         maxval(abs(by_modal%response%displacement - by_cvode%response%displacement)) &
         /maxval(abs(by_modal%response%displacement)), 0.0_wp, 1e-6_wp)
   end subroutine test_solvers

   !> The key of the case file reaches the mesh of `frf`.
   subroutine test_program()
      character(len=*), parameter :: nl = achar(10), beam = '&beam length=1.25, rho=0.5, '// &
         'E=200, I=0.02, c_D=0.1 /'//nl//'&tip m_T=0.1 /'//nl//'&sensor x_S=0.8 /'//nl// &
         '&mass m=0.2, J=0.003, x=0.47 /'//nl//'&record kind=''frf'', quantity=''receptance'', '// &
         'x_F=0.55, f_first=0.4, f_last=6.3, f_step=5.9 /'//nl// &
         '&discretization degree=5, elements=64, '
      character(len=:), allocatable :: table
      type(outcome_t) :: outcome
      character(len=:), allocatable :: reason

      call open_shell(reason)
      if (reason /= '') then
         call skip('frf with the key', reason)
         return
      end if
      call write_file('case.nml', beam//'knots=''attachments'' /'//nl)
      outcome = beamid('frf case.nml --out out --quiet')
      call check('frf with the key', outcome%status == 0, outcome%err)
      if (outcome%status /= 0) return
      table = read_file('out/frf.csv')
      call check_close('  response', abs(cmplx(number(field(table, 2, 3)), &
         number(field(table, 2, 4)), wp)/known(3, 1) - 1), 0.0_wp, 1e-7_wp)
      call close_shell()
   end subroutine test_program

end program test_knots
