!> What stands on a beam or under it, and a base that moves: sensors and masses with rotary inertia,
!> hoses anywhere, supports that give way or not, a force anywhere, the length, axial force and
!> weight. Against full matrices in quadruple precision, CVODE, and finite elements of another kind.
program test_benches
   use beamid_cvode, only: cvode_t
   use beamid_equations, only: equations_t, new_equations
   use beamid_errors, only: error_t
   use beamid_excitation, only: excitation_t, new_base_motion, new_force_table
   use beamid_galerkin, only: galerkin_of, galerkin_t, mesh_t, new_galerkin
   use beamid_kinds, only: wp, ip
   use beamid_modal, only: modal_t
   use beamid_modes, only: undamped_modes
   use beamid_parameter_names, only: is_there, name_of_parameter
   use beamid_parameters, only: parameters
   use beamid_responses, only: response_t, work_t
   use beamid_roots, only: damped_roots
   use beamid_strings, only: to_text
   use beamid_structure, only: n_parameters, no_spring, of_gamma, structure_t
   use checks, only: check, check_close, finish, held_root, in_long_run
   use full_benches, only: bench_motion
   use full_matrices, only: qp
   use hermite_beams, only: hermite_frequencies
   use integration_errors, only: accumulated_error
   use random_benches, only: bench, load_axially
   use random_numbers, only: between, decades, start_random
   implicit none

   integer, parameter :: samples = 24, nodes = 9
   character(len=*), parameter :: motions(4) = [character(len=12) :: 'displacement', 'velocity', &
      'acceleration', 'tilt']
   type(galerkin_t), target :: galerkin
   integer :: number

   call start_random(20260211)
   do number = 1, 24
      call test_motions(number, heavy=.false.)
   end do
   do number = 1, 24
      call test_motions(number, heavy=.true.)
   end do
   do number = 41, 45
      call test_motions(number, heavy=.false.)
      call test_motions(number, heavy=.true.)
   end do
   do number = 51, merge(110, 56, in_long_run())
      call test_motions(number, heavy=.false.)
      call test_motions(number, heavy=.true.)
   end do
   do number = 25, 30
      call test_motions(number, heavy=modulo(number, 3) == 0, hysteretic=.true.)
   end do
   do number = 31, 40
      call test_motions(number, heavy=modulo(number, 3) == 0, relaxations=1 + modulo(number, 2))
   end do
   do number = 13, 18
      call test_still_air(number)
   end do
   call test_frequencies()
   call finish('benches')

contains

   !> A force, or a base, of random nodes on the grid of the samples.
   subroutine drive(number, step, f, excitation)
      integer, intent(in) :: number
      real(wp), intent(in) :: step
      real(wp), intent(out) :: f(nodes)
      type(excitation_t), intent(out) :: excitation
      type(error_t), allocatable :: error
      integer :: i

      f = [(between(-1.0_wp, 1.0_wp), i=1, nodes)]
      if (number > 12 .and. (number <= 50 .or. modulo(number, 2) == 0)) then
         call new_base_motion([((i - 1)*step, i=1, nodes)], f, excitation, error)
      else
         call new_force_table([((i - 1)*step, i=1, nodes)], f, excitation, error)
      end if
   end subroutine drive

   !> Compares the motions, and their derivatives with respect to every parameter, with a matrix
   !> exponential in quadruple precision, on three cubics. The reference for a derivative is a
   !> central difference over 1e-8 of the parameter. Its truncation error grows with the square of
   !> the step, from 1e-10 here, because the highest modes turn through 1e4 radians.
   !>
   !> heavy        with weight and axial force
   !> hysteretic   with spatial hysteresis, which cvode lacks; default .false.
   !> relaxations  number of relaxations of time hysteresis; default 0
   subroutine test_motions(number, heavy, hysteretic, relaxations)
      integer, intent(in) :: number
      logical, intent(in) :: heavy
      logical, intent(in), optional :: hysteretic
      integer, intent(in), optional :: relaxations
      type(structure_t) :: s, above, below
      type(excitation_t) :: excitation
      type(equations_t), target :: equations
      type(modal_t) :: solver
      type(cvode_t) :: integrator
      type(response_t) :: response, integrated
      type(response_t), allocatable :: slopes(:)
      type(work_t) :: work
      type(error_t), allocatable :: error
      real(wp) :: f(nodes), times(samples), step, h, wrong(4), size_of(4)
      real(qp), dimension(samples, 4) :: known, plus, minus
      real(wp), parameter :: rtol = 1e-11_wp
      integer, allocatable :: places(:)
      character(len=:), allocatable :: name
      integer :: k, p

      s = bench(number)
      name = 'bench '//to_text(number)//', '
      if (heavy) call load_axially(number, s)
      if (heavy) name = 'heavy '//name
      if (present(hysteretic)) then
         s%a_h = decades(-1.5_wp, -0.5_wp)*sqrt(s%rho*s%E*s%I)
         s%b_h = between(0.2_wp, 2.0_wp)*s%length
         name = 'hysteretic '//name
      end if
      if (present(relaxations)) then
         s%d_1 = decades(-2.0_wp, -0.3_wp)
         s%b_1 = decades(-1.0_wp, 2.0_wp)*s%omega()
         if (relaxations > 1) s%d_2 = decades(-2.0_wp, -0.3_wp)
         if (relaxations > 1) s%b_2 = decades(-1.0_wp, 2.0_wp)*s%omega()
         name = 'relaxing '//name
      end if
      step = 0.25_wp/s%omega()
      times = [(k*step, k=1, samples)]
      call drive(number, step, f, excitation)
      places = pack(parameters(:n_parameters)%place, is_there(s, parameters(:n_parameters)%place))
      places = pack(places, [(abs(s%get(places(k))) > 0 .and. s%get(places(k)) < no_spring, &
         k=1, size(places))])
      ! On a mesh of another length: the structure's changes, the mesh stays.
      galerkin = new_galerkin(mesh_t(3, 3, 4, 1), 1.3_wp*s%length, &
         held_root(s%end(1)%kappa_R > 0))
      call solver%prepare(galerkin, error)
      equations = new_equations(galerkin, s, excitation)
      call solver%differentiate(equations, excitation, times, places, response, slopes, work, error)
      call check(name//'a response', .not. allocated(error))
      if (allocated(error)) then
         print '(2a)', '      ', error%message
         return
      end if
      call bench_motion(galerkin, s, s, excitation%is_base, step, f, known)
      size_of = real(maxval(abs(known), dim=1), wp)
      call differ(response, known, wrong)
      if (.not. heavy) size_of(4) = 1
      do k = 1, 4
         call check_close(name//trim(motions(k)), wrong(k)/size_of(k), 0.0_wp, 1e-9_wp)
      end do
      do p = 1, size(places)
         h = 1e-8_wp*s%get(places(p))
         above = s
         call above%set(places(p), s%get(places(p)) + h)
         below = s
         call below%set(places(p), s%get(places(p)) - h)
         call bench_motion(galerkin, above, s, excitation%is_base, step, f, plus)
         call bench_motion(galerkin, below, s, excitation%is_base, step, f, minus)
         call differ(slopes(p), (plus - minus)/(real(above%get(places(p)), qp) &
            - below%get(places(p))), wrong)
         ! Of what the motion becomes when the parameter doubles.
         call check_close(name//'by '//trim(name_of_parameter(s, places(p))), &
            maxval(wrong*abs(s%get(places(p)))/size_of), 0.0_wp, 1e-8_wp)
      end do
      integrator = cvode_t(rtol=rtol, max_steps=1000000_ip)
      call integrator%respond(equations, excitation, times, integrated, work, error)
      if (present(hysteretic) .or. present(relaxations) .and. excitation%is_base .and. &
         s%rigid_supports() > 0) then
         call check(name//'refused by cvode', allocated(error))
         return
      end if
      call check(name//'integrated', .not. allocated(error))
      if (allocated(error)) return
      call differ(integrated, known, wrong)
      call check_close(name//'by cvode', wrong(1)/size_of(1), 0.0_wp, &
         accumulated_error(rtol, work%steps))
      if (heavy) call check_close(name//'tilt by cvode', wrong(4)/size_of(4), 0.0_wp, &
         accumulated_error(rtol, work%steps))
   end subroutine test_motions

   !> Derivatives with respect to air damping where there is none and the base moves. The base then
   !> loads the beam by its velocity as soon as gamma differs from 0. Reference and bound are those
   !> of `test_motions`; gamma of the bench is the scale.
   subroutine test_still_air(number)
      integer, intent(in) :: number
      type(structure_t) :: s, above, below
      type(excitation_t) :: excitation
      type(equations_t), target :: equations
      type(modal_t) :: solver
      type(response_t) :: response
      type(response_t), allocatable :: slopes(:)
      type(work_t) :: work
      type(error_t), allocatable :: error
      real(wp) :: f(nodes), step, h, scale, wrong(4), size_of(4)
      real(qp), dimension(samples, 4) :: known, plus, minus
      character(len=:), allocatable :: name
      integer :: k

      s = bench(number)
      name = 'bench '//to_text(number)//', still air: '
      scale = max(s%gamma, 0.01_wp*s%rho*s%omega())
      s%gamma = 0
      step = 0.25_wp/s%omega()
      call drive(number, step, f, excitation)
      galerkin = new_galerkin(mesh_t(3, 3, 4, 1), s%length, held_root(s%end(1)%kappa_R > 0))
      call solver%prepare(galerkin, error)
      equations = new_equations(galerkin, s, excitation)
      call solver%differentiate(equations, excitation, [(k*step, k=1, samples)], [of_gamma], &
         response, slopes, work, error)
      call check(name//'a response', .not. allocated(error))
      if (allocated(error)) return
      call bench_motion(galerkin, s, s, excitation%is_base, step, f, known)
      size_of = real(maxval(abs(known), dim=1), wp)
      size_of(4) = 1
      h = 1e-8_wp*scale
      above = s
      above%gamma = h
      below = s
      below%gamma = -h
      call bench_motion(galerkin, above, s, excitation%is_base, step, f, plus)
      call bench_motion(galerkin, below, s, excitation%is_base, step, f, minus)
      call differ(slopes(1), (plus - minus)/(2*real(h, qp)), wrong)
      wrong(4) = 0
      call check_close(name//'by gamma', maxval(wrong*scale/size_of), 0.0_wp, 1e-8_wp)
   end subroutine test_still_air

   !> The largest difference of each motion.
   subroutine differ(response, known, wrong)
      type(response_t), intent(in) :: response
      real(qp), intent(in) :: known(:, :)
      real(wp), intent(out) :: wrong(4)

      wrong(1) = real(maxval(abs(response%displacement - known(:, 1))), wp)
      wrong(2) = real(maxval(abs(response%velocity - known(:, 2))), wp)
      wrong(3) = real(maxval(abs(response%acceleration - known(:, 3))), wp)
      wrong(4) = real(maxval(abs(known(:, 4))), wp)
      if (allocated(response%tilt)) wrong(4) = real(maxval(abs(response%tilt - known(:, 4))), wp)
   end subroutine differ

   !> The lowest three frequencies of undamped beams by splines, from M and K and from the roots,
   !> and by 160 Hermite elements with nodes at all places, which err by (beta h)**4/720 or so,
   !> 1e-8. A roller makes the third derivative jump and rotary inertia the second: splines that are
   !> smoother inside an element follow slowly, like h**3 and h, so that the places are put where
   !> elements meet, and cubics taken, whose third derivative may jump there; J_S is as small as
   !> that of an accelerometer.
   subroutine test_frequencies()
      type(structure_t) :: s
      type(equations_t), target :: equations
      type(error_t), allocatable :: error
      real(wp), allocatable :: omega(:), shapes(:, :)
      complex(wp), allocatable :: roots(:)
      real(wp) :: known(3)
      character(len=:), allocatable :: name
      integer :: i, k

      do i = 0, 11
         s = bench(6*4 + i)
         if (i > 5) call load_axially(i, s)
         name = 'frequencies '//achar(iachar('a') + i)//', '
         s%hose(1)%m_H = 0
         s%c_D = 0
         s%gamma = 0
         s%end(1)%c_R = 0
         s%sensor%J_S = 1e-7_wp*s%rho*s%length**3
         s%support%c_P = 0
         do k = 1, 2
            s%sensor(k)%x_S = nint(40*s%sensor(k)%x_S/s%length)*s%length/40
            if (k <= s%supports) s%support(k)%x_P = nint(40*s%support(k)%x_P/s%length)*s%length/40
         end do
         galerkin = galerkin_of(mesh_t(3, 80, 4, 1), s)
         equations = new_equations(galerkin, s, excitation_of_nothing())
         call undamped_modes(equations, omega, shapes, error)
         call check(name//'modes', .not. allocated(error))
         if (allocated(error)) cycle
         known = hermite_frequencies(s, 160, 3)
         do k = 1, 3
            call check_close(name//'mode '//achar(iachar('0') + k), omega(k)/known(k), 1.0_wp, &
               1e-5_wp)
         end do
         ! k_R on a mesh this fine costs the exact method too many digits.
         galerkin = galerkin_of(mesh_t(3, 16, 4, 1), s)
         equations = new_equations(galerkin, s, excitation_of_nothing())
         call undamped_modes(equations, omega, shapes, error)
         call damped_roots(equations, roots, error)
         call check(name//'roots', .not. allocated(error))
         if (allocated(error)) cycle
         do k = 1, 3
            call check_close(name//'root '//achar(iachar('0') + k), aimag(roots(k))/omega(k), &
               1.0_wp, 1e-9_wp)
         end do
      end do
   end subroutine test_frequencies

   function excitation_of_nothing() result(excitation)
      type(excitation_t) :: excitation
      type(error_t), allocatable :: error

      call new_force_table([0.0_wp, 1.0_wp], [0.0_wp, 0.0_wp], excitation, error)
   end function excitation_of_nothing

end program test_benches
