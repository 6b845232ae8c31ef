!> Frequency responses and their derivatives: against the closed form of the dynamic stiffness, and
!> against full matrices in quadruple precision.
program test_frequency_responses
   use beamid_errors, only: error_t
   use beamid_excitation, only: new_pulse
   use beamid_frequency_responses, only: predict_response, quantities
   use beamid_galerkin, only: galerkin_of, mesh_t
   use beamid_kinds, only: wp
   use beamid_modal, only: modal_t
   use beamid_observed_data, only: meshed_model_t
   use beamid_parameter_names, only: is_there, name_of_parameter
   use beamid_parameters, only: parameters
   use beamid_responses, only: work_t
   use beamid_strings, only: to_text
   use beamid_structure, only: n_parameters, no_spring, of_g, of_length, structure_t
   use checks, only: check, check_close, finish, in_long_run
   use full_benches, only: bench_transfer
   use full_matrices, only: qp
   use known_transfers, only: beams, known_frequencies, known_inside, known_rate, known_t, &
      known_transfer, with_parts_inside
   use random_benches, only: bench, load_axially
   use random_experiments, only: wide_structure
   use random_numbers, only: decades, start_random
   implicit none

   real(wp), parameter :: two_pi = 2*acos(-1.0_wp)
   type(mesh_t), parameter :: fine = mesh_t(5, 64, 6, 1), cubics = mesh_t(3, 3, 4, 1)
   integer :: k

   do k = 1, beams
      call test_closed_form(known_transfer(k))
   end do
   call test_order()
   call start_random(20261126)
   do k = 1, 12
      call test_bench(k, heavy=modulo(k, 2) == 0)
   end do
   do k = 51, 58
      call test_bench(k, heavy=modulo(k, 2) == 0)
   end do
   call test_wide(merge(1000, 40, in_long_run()))
   call test_pendulum()
   call finish('frequency_responses')

contains

   !> Computes a frequency response.
   !>
   !> h  (frequencies, 0:parameters) as of `predict_response`
   subroutine respond(mesh, structure, power, rate, frequencies, parameters, h, error)
      type(mesh_t), intent(in) :: mesh
      type(structure_t), intent(in) :: structure
      integer, intent(in) :: power, parameters(:)
      real(wp), intent(in) :: rate, frequencies(:)
      complex(wp), intent(out) :: h(:, 0:)
      type(error_t), allocatable, intent(out) :: error
      type(meshed_model_t), target :: model
      type(modal_t), allocatable :: solver
      type(work_t) :: work

      allocate (solver)
      model%galerkin = galerkin_of(mesh, structure)
      call solver%prepare(model%galerkin, error)
      if (allocated(error)) return
      call move_alloc(solver, model%solver)
      call predict_response(model, structure, new_pulse(0.0_wp, 1.0_wp), power, rate, frequencies, &
         parameters, h, work, error)
   end subroutine respond

   !> All quantities, without and with an exponential window, and derivatives. The modes of the mesh
   !> up to the highest frequency, less than one turn in three elements, are exact to 1e-10 or so;
   !> beside a resonance of damping ratio z their error grows by 1/(2 z). The requirement is 1e-8 of
   !> the largest value.
   subroutine test_closed_form(known)
      type(known_t), intent(in) :: known
      real(wp), parameter :: allowed = 1e-8_wp
      complex(wp) :: h(size(known_frequencies), 0:size(known%parameters)), s(size(h, 1)), &
         exact(size(h, 1))
      type(error_t), allocatable :: error
      character(len=:), allocatable :: name
      integer :: p, power, window

      do power = 0, 2
         do window = 1, 2
            name = trim(known%name)//', '//trim(quantities(power))//merge('           ', &
               ' and window', window == 1)
            s = cmplx(merge(0.0_wp, known_rate, window == 1), two_pi*known_frequencies, wp)
            call respond(fine, known%structure, power, real(s(1)), known_frequencies, &
               known%parameters, h, error)
            call check(trim(name), .not. allocated(error))
            if (allocated(error)) return
            exact = s**power*known%h(:, window)
            call check_close('  values', maxval(abs(h(:, 0) - exact))/maxval(abs(exact)), 0.0_wp, &
               allowed)
            if (window == 1) cycle
            do p = 1, size(known%parameters)
               exact = s**power*known%dh(:, p)
               call check_close('  by '//trim(parameters(known%parameters(p))%name), &
                  maxval(abs(h(:, p) - exact))/maxval(abs(exact)), 0.0_wp, allowed)
            end do
         end do
      end do
   end subroutine test_closed_form

   !> The shear force jumps at a force, a mass and a support between the ends, which splines follow
   !> with an error of third order: a quarter of the element, a 64th of the error. All places are at
   !> a fifth of an element of the coarse mesh and at four fifths of one of the fine mesh, its
   !> mirror image, so that the constant is the same up to the next order of the error.
   subroutine test_order()
      complex(wp) :: h(size(known_frequencies), 0:0)
      type(error_t), allocatable :: error
      integer, parameter :: elements(2) = [30, 120]
      real(wp) :: wrong(2)
      integer :: i

      do i = 1, size(wrong)
         call respond(mesh_t(5, elements(i), 6, 1), with_parts_inside(), 0, 0.0_wp, &
            known_frequencies, [integer ::], h, error)
         call check('parts between the ends, N = '//to_text(elements(i)), .not. allocated(error))
         if (allocated(error)) return
         wrong(i) = maxval(abs(h(:, 0) - known_inside))/maxval(abs(known_inside))
      end do
      call check_close('  order of the error', log(wrong(1)/wrong(2))/log(4.0_wp), 3.0_wp, 0.25_wp)
      call check('  error of 120 elements', wrong(2) < 1e-6_wp, to_text(wrong(2)))
   end subroutine test_order

   !> Random beams with everything on them, against full matrices in quadruple precision on the same
   !> mesh: three cubics. The poles of the mesh are good to 1e-13 or so, and the largest value is
   !> that of a frequency near no pole. Derivatives by central differences over 1e-8 of the
   !> parameter, whose truncation error is below 1e-10.
   !>
   !> heavy  with weight and axial force, so that gravity tilts the sensor
   subroutine test_bench(number, heavy)
      integer, intent(in) :: number
      logical, intent(in) :: heavy
      integer, parameter :: n = 6
      type(structure_t) :: structure, above, below
      type(error_t), allocatable :: error
      integer, allocatable :: places(:)
      complex(wp), allocatable :: h(:, :)
      complex(wp) :: s(n)
      complex(qp), dimension(n) :: known, plus, minus
      real(wp) :: frequencies(n), change, scale
      character(len=:), allocatable :: name
      integer :: p

      structure = bench(number)
      if (heavy) call load_axially(number, structure)
      if (modulo(number, 4) < 2) structure%eta = 0.02_wp*number
      if (modulo(number, 5) < 2) then
         structure%a_h = 0.1_wp*sqrt(structure%rho*structure%E*structure%I)
         structure%b_h = 0.2_wp*(1 + modulo(number, 7))*structure%length
      end if
      if (modulo(number, 3) < 2) then
         structure%d_1 = 0.05_wp*(1 + modulo(number, 7))
         structure%b_1 = structure%omega()*modulo(number + 1, 4)
         if (.not. structure%b_1 > 0) structure%d_1 = 0
         structure%d_2 = 0.1_wp
         structure%b_2 = 20*structure%omega()
      end if
      frequencies = structure%omega()/two_pi*[0.3_wp, 0.9_wp, 1.7_wp, 4.3_wp, 11.0_wp, 25.0_wp]
      s = cmplx(0.02_wp*structure%omega(), two_pi*frequencies, wp)
      places = pack(parameters(:n_parameters)%place, is_there(structure, &
         parameters(:n_parameters)%place))
      places = pack(places, [(abs(structure%get(places(p))) > 0 .and. &
         structure%get(places(p)) < no_spring, p=1, size(places))])
      allocate (h(n, 0:size(places)))
      name = 'bench '//to_text(number)//', '
      call respond(cubics, structure, 2, real(s(1)), frequencies, places, h, error)
      call check(name//'a response', .not. allocated(error))
      if (allocated(error)) return
      known = of_bench(structure, structure, s)
      scale = real(maxval(abs(known)), wp)
      call check_close(name//'values', real(maxval(abs(h(:, 0) - known)), wp)/scale, 0.0_wp, &
         1e-9_wp)
      do p = 1, size(places)
         change = 1e-8_wp*structure%get(places(p))
         above = structure
         call above%set(places(p), structure%get(places(p)) + change)
         below = structure
         call below%set(places(p), structure%get(places(p)) - change)
         plus = of_bench(above, structure, s)
         minus = of_bench(below, structure, s)
         known = (plus - minus)/(real(above%get(places(p)), qp) &
            - below%get(places(p)))
         ! Of what the response becomes when the parameter doubles.
         call check_close(name//'by '//trim(name_of_parameter(structure, places(p))), &
            real(maxval(abs(h(:, p) - known)), wp)*abs(structure%get(places(p)))/scale, &
            0.0_wp, 1e-8_wp)
      end do
   end subroutine test_bench

   !> Accelerance of a bench, with the reading of gravity, in quadruple precision.
   !>
   !> near  as of `bench_transfer`
   !> s     (points) [1/time]
   function of_bench(structure, near, s) result(values)
      type(structure_t), intent(in) :: structure, near
      complex(wp), intent(in) :: s(:)
      complex(qp) :: values(size(s)), h(size(s), 2)

      call bench_transfer(galerkin_of(cubics, near), structure, near, s, h)
      values = cmplx(s, kind=qp)**2*h(:, 1) + h(:, 2)
   end function of_bench

   !> Beams whose parameters spread over six decades, on 4 to 16 elements: none is refused, and the
   !> displacement agrees with full matrices. These lose up to 15 of 34 digits beside a root that is
   !> next to rigid. The poles of the mesh lose up to 4 of 16 digits by the condition of M and K,
   !> and a frequency beside a pole loses as many as its damping is small: 1e-8, or 1e-7 for one in
   !> a thousand.
   subroutine test_wide(structures)
      integer, intent(in) :: structures
      integer, parameter :: n = 8
      type(structure_t) :: structure
      type(error_t), allocatable :: error
      type(mesh_t) :: mesh
      complex(wp) :: h(n, 0:0)
      complex(qp) :: known(n, 2)
      real(wp) :: allowed, frequencies(n), off, worst
      integer :: i, number, refused

      allowed = merge(1e-8_wp, 1e-7_wp, structures < 100)
      refused = 0
      worst = 0
      do number = 1, structures
         structure = wide_structure()
         ! `bench_transfer` attaches the sensors that have been counted.
         structure%sensors = 1
         mesh = mesh_t(merge(5, 3, modulo(number, 2) == 0), 4 + 2*modulo(number, 7), 6, 1)
         frequencies = [(structure%omega()/two_pi*decades(-1.0_wp, 2.0_wp), i=1, n)]
         call respond(mesh, structure, 0, 0.0_wp, frequencies, [integer ::], h, error)
         if (allocated(error)) then
            refused = refused + 1
            print '(a,i0,2a)', '      structure ', number, ': ', error%message
            cycle
         end if
         call bench_transfer(galerkin_of(mesh, structure), structure, structure, &
            cmplx(0.0_wp, two_pi*frequencies, wp), known)
         off = real(maxval(abs(h(:, 0) - known(:, 1)))/maxval(abs(known(:, 1))), wp)
         if (.not. off < allowed) print '(a,i0,a,es9.1)', '      structure ', number, ':', off
         worst = max(worst, merge(off, huge(off), off >= 0))
      end do
      call check('of '//to_text(structures)//' structures none is refused', refused == 0)
      call check_close('full matrices of structures over six decades', worst, 0.0_wp, allowed)
   end subroutine test_wide

   !> A hanging beam that is next to rigid on a soft root spring is a pendulum: J phi'' = -(k_R +
   !> g m l/2) phi + F l. Its tip reads the acceleration l phi'' plus g phi. Bending of the beam,
   !> E I/l = 1e9 k_R, shares 1e-9 of the motion, or 3e-8 with the inertia of a clamped beam.
   subroutine test_pendulum()
      real(wp), parameter :: rho = 0.7_wp, l = 1.3_wp, g = 9.81_wp, k_R = 2, allowed = 1e-7_wp, &
         frequencies(3) = [0.2_wp, 0.9_wp, 3.0_wp], rate = 0.5_wp
      type(structure_t) :: pendulum
      complex(wp) :: h(size(frequencies), 0:2), s(size(frequencies)), stiff(size(frequencies)), &
         exact(size(frequencies))
      type(error_t), allocatable :: error
      integer :: power

      pendulum = structure_t(length=l, rho=rho, E=1e9_wp*k_R*l, I=1, g=g)
      pendulum%end(1)%kappa_R = 1/k_R
      s = cmplx(rate, two_pi*frequencies, wp)
      stiff = rho*l**3/3*s**2 + k_R + g*rho*l**2/2
      do power = 0, 2
         call respond(mesh_t(5, 4, 6, 1), pendulum, power, rate, frequencies, [of_g, of_length], &
            h, error)
         call check('pendulum, '//quantities(power), .not. allocated(error))
         if (allocated(error)) return
         exact = (s**power*l + merge(g, 0.0_wp, power == 2))*l/stiff
         call check_close('  values', maxval(abs(h(:, 0) - exact))/maxval(abs(exact)), 0.0_wp, &
            allowed)
         exact = merge(l, 0.0_wp, power == 2)/stiff - exact*rho*l**2/2/stiff
         call check_close('  by g', maxval(abs(h(:, 1) - exact))/maxval(abs(exact)), 0.0_wp, &
            allowed)
         exact = (2*s**power*l + merge(g, 0.0_wp, power == 2))/stiff - (s**power*l + merge(g, &
            0.0_wp, power == 2))*l*(rho*l**2*s**2 + g*rho*l)/stiff**2
         call check_close('  by length', maxval(abs(h(:, 2) - exact))/maxval(abs(exact)), 0.0_wp, &
            allowed)
      end do
   end subroutine test_pendulum

end program test_frequency_responses
