!> Motions of beams that vary along their length: the exact solver against CVODE, its derivatives
!> against differences, and what varies by nothing against the plain beam.
program test_varying_motions
   use attached_beams, only: compare
   use beamid_equations, only: equations_t, new_equations
   use beamid_errors, only: error_t
   use beamid_excitation, only: new_base_motion, new_pulse
   use beamid_galerkin, only: mesh_t
   use beamid_kinds, only: wp
   use beamid_observation, only: new_sampling, observation_t
   use beamid_parameter_names, only: name_of_parameter
   use beamid_responses, only: response_t, work_t
   use beamid_strings, only: to_text
   use beamid_structure, only: c_D_at, E_at, of_c_D, of_c_H, of_d_D, of_E, of_g, of_gamma, &
      of_kappa_R, of_k_H, of_length, of_m_T, of_rho, of_w_D, of_x_D, of_x_S, sensor_t, structure_t
   use beamid_variations, only: as_spline, field_modulus, field_viscosity, in_lines, in_steps, &
      known_c_D, known_E, known_gamma, known_height, known_rho, known_width, new_variation
   use checks, only: check, check_close, finish
   use exact_motions, only: exact, galerkin, kinds, motion_columns, prepare, relative, solver
   use random_experiments, only: experiment_t
   use random_numbers, only: between, decades, pick, start_random, uniform
   implicit none

   !> How a beam varies.
   integer, parameter :: plain = 0, known = 1, dip = 2, cubic = 3, linear = 4
   character(len=*), parameter :: ways(0:4) = [character(len=16) :: 'plain', 'known', 'a dip', &
      'cubic E and c_D', 'linear E and c_D']
   integer :: way

   call start_random(20260607)
   do way = known, linear
      call test_against_cvode(way)
   end do
   do way = known, linear
      call test_memory(way)
   end do
   call test_derivatives()
   call test_air()
   call test_nothing()
   call test_flat_dips()
   call finish('varying_motions')

contains

   !> A beam of length, E I and mass one, that varies.
   function beam(way) result(s)
      integer, intent(in) :: way
      type(structure_t) :: s
      integer :: j

      s = structure_t(length=1, rho=1, E=1, I=1, c_D=2e-3_wp, gamma=0.1_wp, m_T=0.2_wp, &
         sensor=sensor_t(m_S=0.05_wp, x_S=0.7_wp))
      associate (v => s%variations)
         if (way == known) then
            v%known(known_E) = new_variation(in_steps, [0.0_wp, 0.41_wp], [1.0_wp, 0.6_wp])
            v%known(known_c_D) = &
               new_variation(as_spline, [0.0_wp, 0.3_wp, 0.7_wp, 1.0_wp], [1.0_wp, 0.6_wp, &
               1.4_wp, 0.8_wp])
            v%known(known_gamma) = &
               new_variation(in_lines, [0.0_wp, 0.6_wp, 1.0_wp], [1.0_wp, 2.0_wp, 0.5_wp])
            v%known(known_height) = new_variation(in_lines, [0.0_wp, 1.0_wp], [1.0_wp, 0.7_wp])
            v%known(known_width) = &
               new_variation(as_spline, [0.0_wp, 0.5_wp, 1.0_wp], [1.0_wp, 1.2_wp, 0.9_wp])
            v%by_density = .true.
         else if (way == dip) then
            call s%set(of_x_D, 0.35_wp)
            call s%set(of_w_D, 0.06_wp)
            call s%set(of_d_D, 0.5_wp)
         else if (way >= cubic) then
            v%along(field_modulus)%coefficients = 6
            v%along(field_viscosity)%coefficients = 6
            v%along(field_modulus)%degree = merge(3, 1, way == cubic)
            v%along(field_viscosity)%degree = v%along(field_modulus)%degree
            do j = 1, 6
               call s%set(E_at(j), 1 + 0.4_wp*sin(1.7_wp*j))
               call s%set(c_D_at(j), 2e-3_wp*(1 + 0.5_wp*cos(2.3_wp*j)))
            end do
         end if
      end associate
   end function beam

   !> One experiment after the other: clamped, on a root spring, on a rigid support, on a base that
   !> moves, with a hose, hanging with a mass that varies.
   subroutine test_against_cvode(way)
      integer, intent(in) :: way
      type(experiment_t) :: e
      type(error_t), allocatable :: error
      character(len=*), parameter :: names(6) = [character(len=13) :: 'clamped', 'root spring', &
         'support', 'moved base', 'hose', 'hanging']
      integer :: i, k

      do i = 1, size(names)
         e%structure = beam(way)
         e%mesh = mesh_t(3, 5, 6, 1)
         e%excitation = new_pulse(1.0_wp, 0.5_wp)
         e%sampling = new_sampling(observation_t(), [(0.4_wp*k, k=1, 12)])
         associate (s => e%structure)
            select case (i)
            case (2)
               s%end(1)%kappa_R = 0.2_wp
               s%end(1)%c_R = 0.05_wp
            case (3)
               s%supports = 1
               s%support(1)%x_P = 0.3_wp
            case (4)
               call new_base_motion([0.0_wp, 0.5_wp, 1.0_wp, 1.5_wp], [0.0_wp, 1.0_wp, -1.0_wp, &
                  0.0_wp], e%excitation, error)
            case (5)
               s%hose(1)%m_H = 0.3_wp
               s%hose(1)%c_H = 0.2_wp
               s%hose(1)%k_H = 2
            case (6)
               s%g = 3
               s%variations%known(known_rho) = &
                  new_variation(in_steps, [0.0_wp, 0.47_wp], [1.0_wp, 1.6_wp])
            end select
         end associate
         call compare(trim(ways(way))//', '//trim(names(i)), e)
      end do
   end subroutine test_against_cvode

   !> A base that moves at a constant speed v through air, whose damping falls linearly from 2 gamma
   !> at the root to 0 at the tip: the air bends the cantilever by 2 gamma v l**4/(30 E I) at the
   !> tip, and the derivative with respect to gamma is this deflection over gamma. At t = 100 the
   !> transient has decayed by exp(-50), and quintic splines contain the static deflection.
   subroutine test_air()
      type(experiment_t) :: e
      type(error_t), allocatable :: error
      real(wp), allocatable :: columns(:, :), derivatives(:, :, :)
      real(wp) :: bent
      integer :: k

      e%structure = structure_t(length=1, rho=1, E=1, I=1, c_D=0.05_wp, gamma=1)
      e%structure%variations%known(known_gamma) = &
         new_variation(in_lines, [0.0_wp, 1.0_wp], [2.0_wp, 0.0_wp])
      e%mesh = mesh_t(5, 4, 6, 1)
      e%sampling = new_sampling(observation_t(), [(100 + 0.1_wp*k, k=1, 12)])
      call new_base_motion([0.0_wp, 1.0_wp, 1.5_wp, 200.0_wp], [1.0_wp, 1.0_wp, 0.0_wp, 0.0_wp], &
         e%excitation, error)
      call prepare(e)
      call exact(e, [of_gamma], columns, derivatives, error)
      call check('air on a moving base: a response', .not. allocated(error))
      if (allocated(error)) return
      ! The speed is 1.25.
      bent = -2*1.25_wp/30
      call check_close('air on a moving base: deflection', columns(1, 1)/bent, 1.0_wp, 1e-9_wp)
      call check_close('air on a moving base: by gamma', derivatives(1, 1, 1)/bent, 1.0_wp, &
         1e-9_wp)
   end subroutine test_air

   !> A structure gives the same motion whatever was solved before: roots are followed from those of
   !> one that is nearly alike, and found to 1e-15, times phases of ten and more.
   subroutine test_memory(way)
      integer, intent(in) :: way
      type(experiment_t) :: e
      real(wp), parameter :: away(5) = [1e-7_wp, 1e-6_wp, 1e-5_wp, 1e-4_wp, 1e-3_wp]
      real(wp), allocatable :: fresh(:), later(:)
      integer :: i, k

      e%structure = beam(way)
      e%mesh = mesh_t(3, 5, 6, 1)
      e%excitation = new_pulse(1.0_wp, 0.5_wp)
      e%sampling = new_sampling(observation_t(), [(0.4_wp*k, k=1, 12)])
      call prepare(e)
      fresh = displacements(e, of_rho, e%structure%rho)
      do i = 1, size(away)
         later = displacements(e, of_rho, e%structure%rho*(1 + away(i)))
         call check(trim(ways(way))//': another motion', any(abs(later - fresh) > 0))
         later = displacements(e, of_rho, e%structure%rho)
         call check_close(trim(ways(way))//': the same motion from '//to_text(away(i))//' away', &
            relative(later, fresh), 0.0_wp, 2e-14_wp)
      end do
   end subroutine test_memory

   !> A beam with this and that, some of it at random. The viscosity damps the first mode by .6 to 6
   !> per cent of critical, and the higher ones so that they are gone before the first sample.
   function random_beam() result(s)
      type(structure_t) :: s
      real(wp) :: omega, unit
      integer :: j, way

      way = pick(4)
      s = structure_t(length=decades(-0.5_wp, 1.0_wp), rho=decades(-1.0_wp, 1.0_wp), &
         E=decades(-1.0_wp, 2.0_wp), I=decades(-1.0_wp, 1.0_wp))
      associate (v => s%variations)
         if (uniform() < 0.5_wp) v%known(known_rho) = random_variation()
         if (uniform() < 0.5_wp) v%known(known_gamma) = random_variation()
         if (uniform() < 0.5_wp) then
            v%known(known_height) = random_variation()
            v%by_density = uniform() < 0.5_wp
         end if
         if (way < cubic) then
            if (uniform() < 0.7_wp) v%known(known_E) = random_variation()
            if (uniform() < 0.7_wp) v%known(known_c_D) = random_variation()
         else
            v%along(field_modulus)%coefficients = 3 + pick(4)
            v%along(field_modulus)%degree = merge(3, 1, way == cubic)
            v%along(field_viscosity)%coefficients = 3 + pick(4)
            v%along(field_viscosity)%degree = merge(3, 1, uniform() < 0.5_wp)
         end if
      end associate
      if (way == dip) then
         call s%set(of_x_D, s%length*between(0.1_wp, 1.0_wp))
         call s%set(of_w_D, s%length*between(0.03_wp, 0.3_wp))
         call s%set(of_d_D, between(0.0_wp, 0.7_wp))
      end if
      omega = s%omega()
      s%c_D = 2*s%E/omega*decades(-2.2_wp, -1.2_wp)
      s%gamma = 2*s%rho*omega*decades(-3.0_wp, -1.0_wp)
      s%m_T = s%rho*s%length*decades(-1.0_wp, 0.5_wp)
      s%sensor(1)%m_S = s%rho*s%length*decades(-2.0_wp, -0.5_wp)
      s%sensor(1)%x_S = s%length*between(0.3_wp, 0.95_wp)
      unit = s%length/(s%E*s%I)
      if (uniform() < 0.5_wp) s%end(1)%kappa_R = unit*decades(-2.0_wp, 0.0_wp)
      if (uniform() < 0.3_wp) s%g = 0.5_wp*omega**2*s%length*uniform()
      if (uniform() < 0.3_wp) then
         s%hose(1)%m_H = s%rho*s%length*decades(-1.0_wp, 0.0_wp)
         s%hose(1)%k_H = s%hose(1)%m_H*(omega*between(0.5_wp, 3.0_wp))**2
         s%hose(1)%c_H = 0.2_wp*sqrt(s%hose(1)%k_H*s%hose(1)%m_H)
      end if
      if (way < cubic) return
      do j = 1, s%variations%along(field_modulus)%coefficients
         call s%set(E_at(j), s%E*between(0.4_wp, 1.6_wp))
      end do
      do j = 1, s%variations%along(field_viscosity)%coefficients
         call s%set(c_D_at(j), s%c_D*between(0.4_wp, 1.6_wp))
      end do
   end function random_beam

   !> Between .5 and 1.5, at four places; steps, lines or a spline.
   function random_variation() result(v)
      use beamid_variations, only: variation_t
      type(variation_t) :: v
      integer :: k

      v = new_variation(pick(3), [0.0_wp, between(0.1_wp, 0.4_wp), between(0.5_wp, 0.9_wp), &
         1.0_wp], [(between(0.5_wp, 1.5_wp), k=1, 4)])
   end function random_variation

   !> Every parameter that such a beam may have free.
   function free_of(s) result(free)
      type(structure_t), intent(in) :: s
      integer, allocatable :: free(:)

      associate (v => s%variations)
         free = [of_E, of_c_D, of_length, of_rho, of_gamma, of_m_T, of_x_S, &
            pack([of_kappa_R], [s%end(1)%kappa_R > 0]), pack([of_g], [s%g > 0]), &
            pack([of_k_H, of_c_H], spread(s%hose(1)%m_H > 0, 1, 2)), &
            pack([of_x_D, of_w_D, of_d_D], spread(s%has_dip(), 1, 3)), &
            E_at(:v%along(field_modulus)%coefficients), &
            c_D_at(:v%along(field_viscosity)%coefficients)]
      end associate
   end function free_of

   !> Displacements of a moved structure on the mesh of the first.
   function displacements(e, k, value) result(u)
      type(experiment_t), intent(in) :: e
      integer, intent(in) :: k
      real(wp), intent(in) :: value
      real(wp), allocatable :: u(:), columns(:, :)
      type(equations_t), target :: equations
      type(structure_t) :: moved
      type(response_t) :: response
      type(work_t) :: work
      type(error_t), allocatable :: error

      moved = e%structure
      call moved%set(k, value)
      equations = new_equations(galerkin, moved, e%excitation)
      call solver%respond(equations, e%excitation, e%sampling%times, response, work, error)
      if (allocated(error)) call check('a moved structure', .false., error%message)
      allocate (columns(size(e%sampling%times), size(kinds)), source=0.0_wp)
      if (.not. allocated(error)) columns = motion_columns(e%sampling, response)
      u = columns(:, 1)
   end function displacements

   !> Forty structures at random, over two or three periods after a pulse of half a one. Central
   !> differences of steps from h to h/8, extrapolated, that change the motion by three parts in ten
   !> thousand, or the parameter by a tenth: what they leave is that to the eighth power, times
   !> phases of higher modes, and round-off of the motion over h/8. 1e-8 of the largest derivative,
   !> and what the round-off, which is measured, makes of the reference; of a parameter of which all
   !> is less than 1e-3 of the motion, 1e-11 of that.
   subroutine test_derivatives()
      integer, parameter :: structures = 40
      real(wp), parameter :: change = 3e-4_wp, least = 1e-3_wp
      type(experiment_t) :: e
      type(error_t), allocatable :: error
      real(wp), allocatable :: columns(:, :), slopes(:, :, :), d(:, :)
      integer, allocatable :: free(:)
      real(wp) :: allowed, counts, noise, off, period, unit, value, worst
      integer :: compared, i, k, number, turning, with_E
      character(len=:), allocatable :: worst_of

      worst = 0
      worst_of = ''
      compared = 0
      turning = 0
      with_E = 0
      do number = 1, structures
         e%structure = random_beam()
         e%mesh = mesh_t(3, 2 + pick(3), 6, 1)
         if (uniform() < 0.3_wp) e%mesh = mesh_t(5, 1 + pick(2), 8, 1)
         period = 2*acos(-1.0_wp)/e%structure%omega()
         e%excitation = new_pulse(1.0_wp, 0.5_wp*period)
         e%sampling = new_sampling(observation_t(), [(period*(0.8_wp + 0.17_wp*k), &
            k=1, 12)])
         free = free_of(e%structure)
         call prepare(e)
         call exact(e, free, columns, slopes, error)
         if (allocated(error)) then
            call check('derivatives of number '//to_text(number), .false., error%message)
            cycle
         end if
         if (e%structure%end(1)%kappa_R > 0) turning = turning + 1
         do k = 1, size(free)
            value = e%structure%get(free(k))
            unit = abs(value)
            counts = unit*maxval(abs(slopes(:, 1, k)))/maxval(abs(columns(:, 1)))
            ! Where all of E(x) is coefficients E does nothing.
            if (free(k) == of_E .and. &
               allocated(e%structure%variations%along(field_modulus)%value) .or. &
               free(k) == of_c_D .and. &
               allocated(e%structure%variations%along(field_viscosity)%value)) then
               with_E = with_E + 1
               ! The modes are orthogonal to round-off of the highest stiffness, 1e5 of the lowest.
               call check_close('nothing by '//trim(name_of_parameter(e%structure, free(k))), &
                  counts, 0.0_wp, 1e-10_wp)
               cycle
            end if
            if (allocated(d)) deallocate (d)
            allocate (d(size(e%sampling%times), 4))
            do i = 1, 4
               associate (h => unit*min(0.1_wp, change/counts)/2**(i - 1))
                  d(:, i) = (displacements(e, free(k), value + h) - displacements(e, free(k), &
                     value - h))/(2*h)
               end associate
            end do
            do i = 1, 3
               d(:, :4 - i) = (4**i*d(:, 2:5 - i) - d(:, :4 - i))/(4**i - 1)
            end do
            off = maxval(abs(slopes(:, 1, k) - d(:, 1)))/maxval(abs(d(:, 1))) &
               *min(1.0_wp, counts/least)
            noise = round_off(e, free(k), slopes(:, 1, k))
            ! The last of the four differences enters with 4/3 16/15 64/63 = 1.44, the others with
            ! .5 at most. The noise of four pairs may be half of the largest.
            allowed = 1e-8_wp + 4*noise/(2*unit*min(0.1_wp, change/counts)/8)/maxval(abs(d(:, 1))) &
               *min(1.0_wp, counts/least)
            compared = compared + 1
            if (.not. off <= allowed) call check_close('number '//to_text(number)//', by '// &
               trim(name_of_parameter(e%structure, free(k)))//', which counts '//to_text(counts), &
               off, 0.0_wp, allowed)
            if (off/allowed <= worst) cycle
            worst = off/allowed
            worst_of = 'number '//to_text(number)//', '//name_of_parameter(e%structure, free(k))
         end do
      end do
      call check_close('derivatives, the worst share of what is allowed: '//trim(worst_of), worst, &
         0.0_wp, 1.0_wp)
      call check('derivatives: as many as meant', compared > 400 .and. turning > 10 .and. &
         turning < 30 .and. with_E > 10, to_text(compared)//', '//to_text(turning)//', '// &
         to_text(with_E))
   end subroutine test_derivatives

   !> Returns the round-off of the difference of two displacements: the largest difference between
   !> neighbouring values of a parameter, less what the slope makes of it.
   !>
   !> k      the parameter
   !> slope  (times) of the displacement by the parameter
   real(wp) function round_off(e, k, slope) result(noise)
      type(experiment_t), intent(in) :: e
      integer, intent(in) :: k
      real(wp), intent(in) :: slope(:)
      real(wp) :: high, low
      integer :: i

      noise = 0
      associate (value => e%structure%get(k))
         do i = 1, 4
            high = value*(1 + i*2.0_wp**(-44))
            low = value*(1 - i*2.0_wp**(-44))
            noise = max(noise, maxval(abs(displacements(e, k, high) - displacements(e, k, low) &
               - (high - low)*slope)))
         end do
      end associate
   end function round_off

   !> A dip of no depth, cubic coefficients that are all alike, told or not: the motions of the
   !> plain beam, its derivatives, and by all coefficients together that by E or c_D. Both ways
   !> through the equations end at roots and residues of 1e-13 or so.
   subroutine test_nothing()
      type(experiment_t) :: e
      integer, parameter :: others(8) = [of_E, of_c_D, of_length, of_rho, of_gamma, of_m_T, &
         of_x_S, of_kappa_R], n = 6
      type(error_t), allocatable :: error
      real(wp), allocatable :: columns(:, :), slopes(:, :, :), u(:, :), d(:, :, :)
      integer, allocatable :: free(:)
      character(len=*), parameter :: names(3) = [character(len=20) :: 'a dip of no depth', &
         'equal coefficients', 'coefficients untold']
      integer :: i, j, k, m, turning

      do turning = 0, 1
         e%structure = beam(plain)
         if (turning == 1) e%structure%end(1)%kappa_R = 0.2_wp
         e%mesh = mesh_t(3, 5, 6, 1)
         e%excitation = new_pulse(1.0_wp, 0.5_wp)
         e%sampling = new_sampling(observation_t(), [(0.4_wp*k, k=1, 12)])
         call prepare(e)
         call exact(e, others(:7 + turning), columns, slopes, error)
         call check('the plain beam', .not. allocated(error))
         do i = 1, 3
            e%structure = beam(plain)
            if (turning == 1) e%structure%end(1)%kappa_R = 0.2_wp
            free = others(:7 + turning)
            if (i == 1) then
               call e%structure%set(of_x_D, 0.4_wp)
               call e%structure%set(of_w_D, 0.1_wp)
            else
               e%structure%variations%along(field_modulus)%coefficients = n
               e%structure%variations%along(field_viscosity)%coefficients = n
               do j = 1, merge(n, 0, i == 2)
                  call e%structure%set(E_at(j), e%structure%E)
                  call e%structure%set(c_D_at(j), e%structure%c_D)
               end do
               free = [free, E_at(:n), c_D_at(:n)]
            end if
            call prepare(e)
            call exact(e, free, u, d, error)
            call check(trim(names(i)), .not. allocated(error))
            if (allocated(error)) cycle
            do m = 1, 3
               call check_close(trim(names(i))//': '//trim(kinds(m)), relative(u(:, m), &
                  columns(:, m)), 0.0_wp, 1e-11_wp)
               do k = 1, 7 + turning
                  ! Of coefficients that are given E and c_D move nothing.
                  if (i == 2 .and. k <= 2) cycle
                  call check_close(trim(names(i))//': '//trim(kinds(m))//' by '// &
                     trim(name_of_parameter(e%structure, free(k))), relative(d(:, m, k), &
                     slopes(:, m, k)), 0.0_wp, 1e-11_wp)
               end do
               if (i == 1) cycle
               k = 7 + turning
               call check_close(trim(names(i))//': '//trim(kinds(m))//' by all of E(x)', &
                  relative(sum(d(:, m, k + 1:k + n), dim=2), slopes(:, m, 1)), 0.0_wp, 1e-11_wp)
               call check_close(trim(names(i))//': '//trim(kinds(m))//' by all of c_D(x)', &
                  relative(sum(d(:, m, k + n + 1:), dim=2), slopes(:, m, 2)), 0.0_wp, 1e-11_wp)
            end do
         end do
      end do
   end subroutine test_nothing

   !> Dips so flat that E is a constant again, next to nothing and then nothing acts between the
   !> modes, of which from none to nearly all are overdamped. The motion is that of the plain beam
   !> with what the dip leaves of E: a dip of width l/delta lacks delta**2 d/2, 1e-11 of E and less,
   !> times phases of a hundred; derivatives of residues lose some digits beside it.
   subroutine test_flat_dips()
      type(experiment_t) :: e
      type(error_t), allocatable :: error
      real(wp), parameter :: depths(5) = [0.0_wp, 1e-14_wp, 1e-9_wp, 1e-3_wp, 0.13_wp], &
         viscosities(5) = [1e-6_wp, 2e-5_wp, 1e-4_wp, 1e-3_wp, 0.1_wp]
      real(wp), allocatable :: columns(:, :), slopes(:, :, :), u(:, :), d(:, :, :)
      character(len=:), allocatable :: name
      integer :: i, j, k, m, width

      do j = 1, size(viscosities)
         do i = 1, size(depths)
            do width = 5, 9, 2
               name = 'a dip of depth '//to_text(depths(i))//', width 1E'//to_text(width)// &
                  ', c_D = '//to_text(viscosities(j))
               e%structure = structure_t(length=1, rho=1, E=1, I=1, c_D=viscosities(j), &
                  gamma=0.1_wp)
               e%mesh = mesh_t(5, 16, 6, 1)
               e%excitation = new_pulse(1.0_wp, 0.5_wp)
               e%sampling = new_sampling(observation_t(), [(0.4_wp*k, k=1, 12)])
               e%structure%E = 1 - depths(i)
               call prepare(e)
               call exact(e, [of_rho, of_gamma], columns, slopes, error)
               call check(name//': plain', .not. allocated(error))
               e%structure%E = 1
               call e%structure%set(of_x_D, 0.4_wp)
               call e%structure%set(of_w_D, 10.0_wp**width)
               call e%structure%set(of_d_D, depths(i))
               call prepare(e)
               call exact(e, [of_rho, of_gamma], u, d, error)
               if (allocated(error)) then
                  call check(name, .false., error%message)
                  cycle
               end if
               do m = 1, 3
                  call check_close(name//': '//trim(kinds(m)), relative(u(:, m), &
                     columns(:, m)), 0.0_wp, 1e-9_wp)
                  call check_close(name//': '//trim(kinds(m))//' by rho', relative(d(:, m, 1), &
                     slopes(:, m, 1)), 0.0_wp, 1e-8_wp)
               end do
            end do
         end do
      end do
   end subroutine test_flat_dips

end program test_varying_motions
