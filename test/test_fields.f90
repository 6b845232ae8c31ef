!> Motion of the whole beam: against the response of its tip, the equations, CVODE, closed forms.
program test_fields
   use beamid_beam_motions, only: beam_motion_t, find_motion, graded_times, motion_size, norm_H, &
      norm_V
   use beamid_cvode, only: cvode_t
   use beamid_equations, only: equations_t, new_equations
   use beamid_errors, only: error_t
   use beamid_excitation, only: excitation_t, new_force_table, new_pulse
   use beamid_galerkin, only: galerkin_t, mesh_t, new_galerkin
   use beamid_internal_forces, only: subtract_internal_force
   use beamid_kinds, only: wp
   use beamid_modal, only: modal_t
   use beamid_responses, only: response_t, work_t
   use beamid_strings, only: to_text
   use beamid_structure, only: hose_t, sensor_t, structure_t
   use checks, only: check, check_close, finish, held_root
   implicit none

   !> Table 4.1's; the same without a hose; one with all that a bench may add, and a hose so light
   !> and so stiff that most roots use the second form of the pencil.
   type(structure_t), parameter :: structures(3) = [ &
      structure_t(length=4, rho=0.03_wp, E=80, I=1, c_D=0.005_wp, m_T=0.15_wp, &
      hose=hose_t(m_H=0.04_wp, &
                  c_H=0.004_wp, k_H=0.3_wp)), &
      structure_t(length=4, rho=0.03_wp, E=80, I=1, c_D=0.005_wp, m_T=0.15_wp), &
      structure_t(length=4, rho=0.03_wp, E=80, I=1, c_D=0.005_wp, m_T=0.15_wp, &
      hose=hose_t(m_H=0.001_wp, &
                  c_H=0.01_wp, k_H=40), gamma=0.01_wp, J_T=0.002_wp, &
                  sensor=sensor_t(m_S=0.01_wp, x_S=3))]
   type(error_t), allocatable :: error

   call test_tip()
   call test_equations()
   call test_hose()
   call test_static()
   call test_norms()
   call test_times()
   call test_refused()
   call finish('fields')

contains

   !> The hat of half a base, or the pulse; with the point load or the distributed one.
   function force(is_hat, distributed) result(excitation)
      logical, intent(in) :: is_hat, distributed
      type(excitation_t) :: excitation

      excitation = new_pulse(1.0_wp, 0.05_wp)
      if (is_hat) call new_force_table([0.01_wp, 0.025_wp, 0.06_wp], [0.0_wp, 2.0_wp, 0.5_wp], &
         excitation, error)
      excitation%distributed = distributed
      excitation%power = 2
   end function force

   !> Times before, in and behind the force; none where it jumps, for there the acceleration does.
   function times() result(t)
      real(wp), allocatable :: t(:)
      integer :: k

      t = [0.0_wp, 0.003_wp, 0.02_wp, 0.04_wp, (0.1_wp + 0.037_wp*k, k=1, 60)]
   end function times

   !> What the sensor sees of the field is what the exact response says. Both are the same sum over
   !> the roots, one of them with the tip's share found without cancellation: 1e-11 of the largest.
   subroutine test_tip()
      type(galerkin_t), target :: galerkin
      type(equations_t), target :: equations
      type(excitation_t) :: excitation
      type(beam_motion_t) :: field
      type(modal_t) :: modal
      type(response_t) :: exact, seen
      type(structure_t) :: structure
      type(work_t) :: work
      character(len=:), allocatable :: name
      integer :: s, k

      do s = 1, size(structures)
         structure = structures(s)
         do k = 1, 4
            name = 'structure '//to_text(s)//', force '//to_text(k)//': '
            excitation = force(k > 2, mod(k, 2) == 0)
            galerkin = new_galerkin(mesh_t(3, 8, 4, 1), structures(s)%length)
            equations = new_equations(galerkin, structures(s), excitation)
            call find_motion(equations, excitation, times(), field, error)
            call check(name//'a field', .not. allocated(error))
            if (allocated(error)) return
            call modal%prepare(galerkin, error)
            call modal%respond(equations, excitation, times(), exact, work, error)
            seen = field%seen_by(equations%observer)
            call same(name//'displacement', seen%displacement, exact%displacement, 1e-11_wp)
            call same(name//'velocity', seen%velocity, exact%velocity, 1e-11_wp)
            call same(name//'acceleration', seen%acceleration, exact%acceleration, 1e-11_wp)
            call same(name//'the same by its place', field%at(structure%sensor_place(), 0, 0), &
               exact%displacement, 1e-11_wp)
         end do
      end do
   end subroutine test_tip

   !> Two arrays of the same size, to a part of the largest entry.
   subroutine same(name, values, expected, part)
      character(len=*), intent(in) :: name
      real(wp), intent(in) :: values(:), expected(:), part

      call check_close(name, maxval(abs(values - expected))/maxval(abs(expected)), 0.0_wp, part)
   end subroutine same

   !> M w'' + C w' + K w = f F in every row, that of the hose among them. K w is a sum of terms
   !> N**4 times larger than itself, 4096 units of round-off, and the roots are known to 1e-13 or
   !> so: 1e-10 of the sum of the terms' sizes.
   subroutine test_equations()
      type(galerkin_t), target :: galerkin
      type(equations_t) :: equations
      type(excitation_t) :: excitation
      type(beam_motion_t) :: field
      real(wp), allocatable :: t(:), rest(:), w(:), v(:), a(:)
      real(wp) :: worst
      integer :: s, k, j

      t = times()
      do s = 1, size(structures)
         do k = 1, 4
            excitation = force(k > 2, mod(k, 2) == 0)
            galerkin = new_galerkin(mesh_t(3, 8, 4, 1), structures(s)%length)
            equations = new_equations(galerkin, structures(s), excitation)
            call find_motion(equations, excitation, t, field, error)
            if (allocated(error)) return
            worst = 0
            do j = 2, size(t)
               w = field%w(j, :, 0)
               v = field%w(j, :, 1)
               a = field%w(j, :, 2)
               rest = excitation%force(t(j))*equations%load
               call subtract_internal_force(equations, w, v, rest)
               rest = abs(rest - equations%mass%times(a))
               worst = max(worst, maxval(rest)/(maxval(abs(equations%mass%times(a))) + &
                  maxval(abs(equations%stiffness%times(w)))))
            end do
            call check_close('structure '//to_text(s)//', force '//to_text(k)//': the equations', &
               worst, 0.0_wp, 1e-10_wp)
         end do
      end do
   end subroutine test_equations

   !> The hose against CVODE at rtol = 1e-11, whose errors are some hundred times that: 1e-8.
   subroutine test_hose()
      type(galerkin_t), target :: galerkin
      type(equations_t), target :: equations
      type(excitation_t) :: excitation
      type(beam_motion_t) :: field
      type(cvode_t) :: cvode
      type(response_t) :: computed
      type(work_t) :: work
      integer :: s

      excitation = force(.false., .false.)
      cvode%rtol = 1e-11_wp
      do s = 1, 3, 2
         galerkin = new_galerkin(mesh_t(3, 4, 4, 1), structures(s)%length)
         equations = new_equations(galerkin, structures(s), excitation)
         call find_motion(equations, excitation, times(), field, error)
         if (allocated(error)) return
         equations%observer = 0
         equations%observer(equations%n) = 1
         call cvode%respond(equations, excitation, times(), computed, work, error)
         call check('hose '//to_text(s)//': CVODE', .not. allocated(error))
         if (allocated(error)) return
         call same('hose '//to_text(s)//': displacement', field%hose(0), computed%displacement, &
            1e-8_wp)
         call same('hose '//to_text(s)//': velocity', field%hose(1), computed%velocity, 1e-7_wp)
      end do
   end subroutine test_hose

   !> A force F that stays, seen when all motion has died: F x**2 (3 l - x)/(6 E I), a cubic, which
   !> every mesh holds; the hose where the tip is; |.|_V**2 = F**2 l**3/(3 (E I)**2), and
   !> |.|_H**2 = 2 (F l**3/(3 E I))**2 + 33 F**2 l**7/(1260 (E I)**2). The slowest root falls by
   !> e**-40 in 200. 1e-10: a part in 1e13 of the roots' sum, and its curvature's N**2.
   subroutine test_static()
      type(structure_t) :: structure
      type(galerkin_t), target :: galerkin
      type(equations_t) :: equations
      type(excitation_t) :: excitation
      type(beam_motion_t) :: field
      real(wp), parameter :: f = 0.7_wp
      real(wp) :: x, norm(1)
      integer :: degree, k

      structure = structures(1)
      structure%gamma = 0.2_wp
      structure%hose(1)%c_H = 0.1_wp
      excitation = new_pulse(f, 1000.0_wp)
      do degree = 3, 7, 2
         galerkin = new_galerkin(mesh_t(degree, 5, degree + 1, 1), structure%length)
         equations = new_equations(galerkin, structure, excitation)
         call find_motion(equations, excitation, [200.0_wp], field, error)
         call check('static: a field', .not. allocated(error))
         if (allocated(error)) return
         associate (l => structure%length, EI => structure%E*structure%I)
            do k = 1, 4
               x = l*k/4
               norm = field%at(x, 0, 0)
               call check_close('static, degree '//to_text(degree)//': x = '//to_text(x), norm(1), &
                  f*x**2*(3*l - x)/(6*EI), 1e-10_wp*f*l**3/(3*EI))
               norm = field%at(x, 2, 0)
               call check_close('static, degree '//to_text(degree)//': curvature, x = '// &
                  to_text(x), norm(1), f*(l - x)/EI, 1e-9_wp*f*l/EI)
            end do
            norm = field%hose(0)
            call check_close('static: hose', norm(1), f*l**3/(3*EI), 1e-10_wp*f*l**3/(3*EI))
            norm = norm_V(field, 0)
            call check_close('static: |.|_V', norm(1)**2/(f**2*l**3/(3*EI**2)), 1.0_wp, 1e-10_wp)
            norm = norm_H(field, 0)
            call check_close('static: |.|_H', norm(1)**2/(2*(f*l**3/(3*EI))**2 &
               + 33*f**2*l**7/(1260*EI**2)), 1.0_wp, 1e-10_wp)
         end associate
      end do
   end subroutine test_static

   !> Differences of fields: none from itself; the same from both sides; against another mesh that
   !> of the values, by a sum over 20000 midpoints, whose error is like 1e-8.
   subroutine test_norms()
      integer, parameter :: points = 20000
      type(galerkin_t), target :: coarse, fine
      type(equations_t) :: equations
      type(excitation_t) :: excitation
      type(beam_motion_t) :: a, b
      real(wp), allocatable :: t(:), expected(:), difference(:), gap(:)
      real(wp) :: x, size_of(3)
      integer :: k, order

      excitation = force(.true., .true.)
      t = [0.02_wp, 0.4_wp, 1.3_wp]
      coarse = new_galerkin(mesh_t(3, 4, 4, 1), structures(1)%length)
      fine = new_galerkin(mesh_t(5, 8, 6, 1), structures(1)%length)
      equations = new_equations(coarse, structures(1), excitation)
      call find_motion(equations, excitation, t, a, error)
      equations = new_equations(fine, structures(1), excitation)
      call find_motion(equations, excitation, t, b, error)
      call check('norms: two fields', .not. allocated(error))
      if (allocated(error)) return
      call check('norms: nothing from itself', &
         maxval(norm_V(a, 1, a)) <= 0 .and. maxval(norm_H(a, 2, a)) <= 0)
      call same('norms: from both sides, V', norm_V(a, 1, b), norm_V(b, 1, a), 1e-12_wp)
      call same('norms: from both sides, H', norm_H(a, 2, b), norm_H(b, 2, a), 1e-12_wp)
      do order = 0, 2
         associate (l => structures(1)%length)
            gap = a%hose(order) - b%hose(order) - a%at(l, 0, order) + b%at(l, 0, order)
            expected = gap**2
            do k = 1, points
               x = (k - 0.5_wp)*l/points
               difference = a%at(x, 2, order) - b%at(x, 2, order)
               expected = expected + difference**2*l/points
            end do
            call same('norms: V, order '//to_text(order), norm_V(a, order, b), sqrt(expected), &
               1e-6_wp)
            difference = a%hose(order) - b%hose(order)
            gap = a%at(l, 0, order) - b%at(l, 0, order)
            expected = difference**2 + gap**2
            do k = 1, points
               x = (k - 0.5_wp)*l/points
               difference = a%at(x, 0, order) - b%at(x, 0, order)
               expected = expected + difference**2*l/points
            end do
            call same('norms: H, order '//to_text(order), norm_H(a, order, b), sqrt(expected), &
               1e-6_wp)
         end associate
      end do
      size_of = motion_size(a, [0.5_wp, 1.0_wp, 2.0_wp], b)
      call check_close('size: the largest displacement', size_of(1), maxval(norm_V(a, 0, b)), &
         1e-14_wp)
      call check_close('size: the largest velocity', size_of(2), maxval(norm_V(a, 1, b)), 1e-14_wp)
      expected = norm_H(a, 2, b)**2
      call check_close('size: the integral over the accelerations', size_of(3)**2, &
         0.5_wp*expected(1) + expected(2) + 2*expected(3), 1e-13_wp*size_of(3)**2)
   end subroutine test_norms

   !> Times ascend and avoid the corners; the weights integrate polynomials up to the seventh degree
   !> exactly, and what rises like a root behind a corner to 1e-6.
   subroutine test_times()
      type(excitation_t) :: excitation
      real(wp), allocatable :: t(:), w(:)
      integer :: k

      excitation = force(.true., .false.)
      call graded_times(excitation, 2.0_wp, 40, t, w)
      call check('times: ascending', all(t(2:) > t(:size(t) - 1)))
      call check('times: between first node and finish', t(1) > 0.01_wp .and. t(size(t)) < 2)
      do k = 1, size(excitation%t)
         call check('times: node '//to_text(k)//' avoided', &
            minval(abs(t - excitation%t(k))) > 0)
      end do
      do k = 0, 7
         call check_close('times: degree '//to_text(k), sum(w*t**k), &
            (2.0_wp**(k + 1) - 0.01_wp**(k + 1))/(k + 1), 1e-12_wp*2.0_wp**(k + 1))
      end do
      call check_close('times: root behind the last corner', &
         sum(w*sqrt(max(t - 0.06_wp, 0.0_wp))), 2*1.94_wp**1.5_wp/3, 1e-6_wp)
   end subroutine test_times

   !> A root that turns has no such field yet.
   subroutine test_refused()
      type(structure_t) :: structure
      type(galerkin_t), target :: galerkin
      type(equations_t) :: equations
      type(beam_motion_t) :: field

      structure = structures(1)
      structure%end(1)%kappa_R = 0.01_wp
      galerkin = new_galerkin(mesh_t(3, 4, 4, 1), structure%length, held_root(.true.))
      equations = new_equations(galerkin, structure, force(.false., .false.))
      call find_motion(equations, force(.false., .false.), times(), field, error)
      call check('refused: a root that turns', allocated(error))
      if (allocated(error)) call check('refused: says so', index(error%message, 'rigid') > 0, &
         error%message)
   end subroutine test_refused

end program test_fields
