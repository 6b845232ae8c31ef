!> Spatial hysteresis: its integrals over all decades of the range, damping ratios of a cantilever,
!> fits of its parameters, and cases that are refused. `test_benches` and
!> `test_frequency_responses` test the responses and their derivatives.
program test_spatial_hysteresis
   use beamid_equations, only: equations_t, new_equations
   use beamid_errors, only: error_t
   use beamid_excitation, only: new_pulse
   use beamid_galerkin, only: galerkin_of, galerkin_t, mesh_t
   use beamid_hysteresis, only: hysteresis_products
   use beamid_kinds, only: wp
   use beamid_matrices, only: outer
   use beamid_modes, only: bare_beam_modes, beam_modes_t
   use beamid_quadrature, only: gauss_legendre, rule_t
   use beamid_roots, only: damped_roots
   use beamid_strings, only: to_text
   use beamid_structure, only: free_end, structure_t
   use case_answers, only: check_estimates, check_refused, modal_record, nl
   use checks, only: check, check_close, finish, skip
   use shell, only: beamid, close_shell, open_shell, outcome_t, read_file, write_file
   implicit none

   character(len=:), allocatable :: reason
   integer :: degree

   call test_cantilever()
   do degree = 3, 7, 2
      call test_integrals(degree)
      call test_limits(degree)
   end do
   call test_free_beam()
   call open_shell(reason)
   if (reason /= '') then
      call skip('fits', reason)
   else
      call test_fit()
      call test_refusals()
      call close_shell()
   end if
   call finish('spatial_hysteresis')

contains

   !> Damping ratios of the modes 1 to 6 of a cantilever, E I = 1.3, rho = .7, l = 1.1, gamma = .1,
   !> a_h = .05, for a wide and a narrow kernel. The known values come from mpmath with 40 digits:
   !> Galerkin's method with x**2 times the Legendre polynomials up to degree K - 1, the double
   !> integral as it is defined by n x n Gauss points, and Newton's method for the roots of
   !> s**2 M + s C + K. K = 26, n = 60 and K = 30, n = 72 (wide), and K = 36, n = 110 and K = 40,
   !> n = 124 (narrow) agree to the digits given. 40 elements of degree 7 have the modes to 1e-12.
   subroutine test_cantilever()
      real(wp), parameter :: range(2) = [0.33_wp, 0.055_wp]
      real(wp), parameter :: known(6, 2) = reshape([ &
         0.0195550768822287417_wp, 0.0144043863613063409_wp, 0.0201054737623629711_wp, &
         0.0214213289572298537_wp, 0.0214277493081507765_wp, 0.0212252703735144945_wp, &
         0.0181358373412430706_wp, 0.00350260618147334668_wp, 0.00277147766232687521_wp, &
         0.00387728452549319749_wp, 0.00567316548328000189_wp, 0.00783524400091304315_wp &
         ], [6, 2])
      type(structure_t) :: structure
      type(equations_t) :: equations
      type(galerkin_t), target :: galerkin
      type(error_t), allocatable :: error
      complex(wp), allocatable :: s(:)
      integer :: i, k

      do i = 1, 2
         structure = structure_t(length=1.1_wp, rho=0.7_wp, E=1.3_wp, I=1, gamma=0.1_wp, &
            a_h=0.05_wp, b_h=range(i))
         galerkin = galerkin_of(mesh_t(7, 40, 8, 1), structure)
         equations = new_equations(galerkin, structure, new_pulse(1.0_wp, 1.0_wp))
         call damped_roots(equations, s, error)
         call check('cantilever, b_h = '//to_text(range(i))//': roots', .not. allocated(error))
         if (allocated(error)) return
         do k = 1, 6
            call check_close('  damping ratio '//to_text(k), -real(s(k))/abs(s(k))/known(k, i), &
               1.0_wp, 1e-9_wp)
         end do
      end do
   end subroutine test_cantilever

   !> Modes of a cantilever on five elements.
   function modes_of(degree) result(modes)
      integer, intent(in) :: degree
      type(beam_modes_t) :: modes
      type(structure_t) :: structure
      type(error_t), allocatable :: error

      structure = structure_t(length=2, rho=1, E=1, I=1)
      call bare_beam_modes(galerkin_of(mesh_t(degree, 5, degree + 1, 1), structure), modes, error)
      call check('degree '//to_text(degree)//': modes', .not. allocated(error))
   end function modes_of

   !> The integrals as they are defined, by Gauss points on panels of the length of b or less. Their
   !> differences of slopes lose l/b of 16 digits, so that ranges from 1e-3 l on are compared; the
   !> sum over 1e7 points leaves 1e-12. The derivative by b is a central difference of fourth order
   !> over 4e-3, which leaves 1e-11.
   subroutine test_integrals(degree)
      integer, intent(in) :: degree
      real(wp), parameter :: ranges(6) = [2e-3_wp, 3e-2_wp, 0.3_wp, 1.7_wp, 2.3_wp, 60.0_wp]
      real(wp), parameter :: step = 1e-3_wp
      type(beam_modes_t) :: modes
      real(wp), allocatable, dimension(:, :) :: values, slopes, known, other, none
      character(len=:), allocatable :: name
      integer :: i, k

      modes = modes_of(degree)
      allocate (values(size(modes%mu), size(modes%mu)))
      allocate (slopes, known, other, none, mold=values)
      do i = 1, size(ranges)
         name = 'degree '//to_text(degree)//', b = '//to_text(ranges(i))
         call hysteresis_products(modes, ranges(i), values, slopes)
         call integrate_directly(modes, ranges(i), known)
         call check_close(name//': integrals', maxval(abs(values - known))/maxval(abs(known)), &
            0.0_wp, 3e-12_wp)
         known = 0
         do k = -2, 2
            if (k == 0) cycle
            call hysteresis_products(modes, ranges(i)*(1 + k*step), other, none)
            known = known + merge(8, -1, abs(k) == 1)*sign(1, k)*other/(12*step*ranges(i))
         end do
         call check_close(name//': by b', maxval(abs(slopes - known))/maxval(abs(known)), 0.0_wp, &
            1e-9_wp)
      end do
   end subroutine test_integrals

   !> Half the double integral of the kernel times the differences of slopes.
   subroutine integrate_directly(modes, b, values)
      type(beam_modes_t), intent(in) :: modes
      real(wp), intent(in) :: b
      real(wp), intent(out) :: values(:, :)
      type(rule_t) :: rule
      real(wp), allocatable :: x(:), weight(:), slope(:, :), flow(:, :)
      real(wp) :: length, h
      integer :: i, j, panels, n

      length = modes%space%length
      n = modes%space%elements
      panels = max(1, ceiling(length/(n*b)))*n
      rule = gauss_legendre(14)
      x = [((i - 1 + rule%points)*length/panels, i=1, panels)]
      weight = [(rule%weights*length/panels, i=1, panels)]
      allocate (slope(size(x), size(modes%mu)))
      do i = 1, size(x)
         slope(i, :) = modes%at(x(i), 1)
      end do
      flow = 0*slope
      do i = 1, size(x)
         do j = i + 1, size(x)
            if (x(j) - x(i) > 9*b) exit
            h = weight(i)*weight(j)*exp(-((x(j) - x(i))/b)**2/2)/(b*sqrt(2*acos(-1.0_wp)))
            flow(i, :) = flow(i, :) + h*(slope(i, :) - slope(j, :))
            flow(j, :) = flow(j, :) + h*(slope(j, :) - slope(i, :))
         end do
      end do
      values = matmul(transpose(slope), flow)
   end subroutine integrate_directly

   !> Short ranges are Kelvin-Voigt damping with c_D I = a b**2/2. The difference is due to layers
   !> of the width b at the ends of the beam, of degree one in b: a hundredth of b leaves a
   !> hundredth of it. A constant of 100 covers the highest modes of five elements, whose curvature
   !> is large at the free end. So short a range that the difference is round-off leaves 1e-13, the
   !> accuracy of the integrals. Of long ranges only the kernel at 0 counts, up to (l/b)**2.
   subroutine test_limits(degree)
      integer, intent(in) :: degree
      type(beam_modes_t) :: modes
      real(wp), allocatable, dimension(:, :) :: values, slopes, known
      real(wp) :: b, wrong, before
      integer :: k

      modes = modes_of(degree)
      allocate (values(size(modes%mu), size(modes%mu)))
      allocate (slopes, known, mold=values)
      before = 0
      known = 0
      do k = 1, size(modes%mu)
         known(k, k) = modes%mu(k)
      end do
      do k = 4, 16, 2
         b = 10.0_wp**(-k)*modes%space%length
         call hysteresis_products(modes, b, values, slopes)
         wrong = maxval(abs(values/(b**2/2) - known))/maxval(known)
         call check_close('degree '//to_text(degree)//', b = '//to_text(b)//': Kelvin-Voigt', &
            wrong, 0.0_wp, 100*10.0_wp**(-k) + 1e-12_wp)
         call check_close('  by b', maxval(abs(slopes/b - known))/maxval(known), 0.0_wp, &
            100*10.0_wp**(-k) + 1e-12_wp)
         if (k > 4 .and. k < 10) call check_close('  order in b', before/wrong, 100.0_wp, 1.0_wp)
         before = wrong
      end do
      associate (l => modes%space%length, turn => modes%at(modes%space%length, 0) &
         - modes%at(0.0_wp, 0))
         known = l*modes%tension(l, 1.0_wp, 0.0_wp) - outer(turn, turn)
         do k = 3, 9, 2
            b = 10.0_wp**k*l
            call hysteresis_products(modes, b, values, slopes)
            values = values*b*sqrt(2*acos(-1.0_wp))
            call check_close('degree '//to_text(degree)//', b = '//to_text(b)//': a/b alone', &
               maxval(abs(values - known))/maxval(abs(known)), 0.0_wp, 10.0_wp**(-2*k) + 1e-12_wp)
         end do
      end associate
   end subroutine test_limits

   !> A beam that nothing holds: its motions as a rigid body are not damped.
   subroutine test_free_beam()
      type(structure_t) :: structure
      type(beam_modes_t) :: modes
      type(error_t), allocatable :: error
      real(wp), allocatable :: values(:, :), slopes(:, :)

      structure = structure_t(length=1, rho=1, E=1, I=1, end=free_end)
      call bare_beam_modes(galerkin_of(mesh_t(5, 6, 6, 1), structure), modes, error)
      allocate (values(size(modes%mu), size(modes%mu)))
      slopes = values
      call hysteresis_products(modes, 0.2_wp, values, slopes)
      call check('free beam: no damping of rigid motions', all(abs(values(:2, :)) <= 0) .and. &
         all(abs(slopes(:, :2)) <= 0) .and. values(3, 3) > 0)
   end subroutine test_free_beam

   !> Returns the groups of a beam with spatial hysteresis and another E.
   function beam(E, a_h, b_h)
      real(wp), intent(in) :: E, a_h, b_h
      character(len=:), allocatable :: beam

      beam = '&beam length=0.5, width=0.03, height=0.003, density=2700, gamma=0.05, E='// &
         to_text(E)//', a_h='//to_text(a_h)//', b_h='//to_text(b_h)//' /'//nl// &
         '&discretization elements=8, degree=5 /'//nl
   end function beam

   !> Exact records give the parameters back: a frequency response, modes, and a pulse in time.
   subroutine test_fit()
      character(len=*), parameter :: free = '&stage free=''E'',''a_h'',''b_h'' /'//nl, &
         pulse = '&excitation kind=''pulse'', amplitude=1, duration=0.002 /'//nl, &
         response = '&record kind=''frf'', f_first=4, f_last=900, f_step=2 /'//nl
      type(outcome_t) :: outcome

      call write_file('true.nml', beam(7e10_wp, 0.06_wp, 0.1_wp)//response)
      outcome = beamid('frf true.nml --out true')
      call check('fit: a response', outcome%status == 0, outcome%err)
      call check_answer('response', beam(6.6e10_wp, 0.03_wp, 0.15_wp)// &
         '&record kind=''frf'', file=''true/frf.csv'' /'//nl//free)
      outcome = beamid('modes true.nml --out true_modes')
      call write_file('modes.csv', modal_record(read_file('true_modes/modes.csv')))
      call check_answer('modes', beam(6.6e10_wp, 0.03_wp, 0.15_wp)// &
         '&record kind=''modes'', file=''modes.csv'' /'//nl//free)
      call write_file('pulse.nml', beam(7e10_wp, 0.06_wp, 0.1_wp)//pulse// &
         '&record t_first=0, t_last=1, t_step=0.001 /'//nl)
      outcome = beamid('simulate pulse.nml --out pulse')
      call check('fit: a motion', outcome%status == 0, outcome%err)
      call check_answer('time', beam(6.9e10_wp, 0.04_wp, 0.12_wp)//pulse// &
         '&record file=''pulse/response.csv'', time_column=''t'', '// &
         'value_column=''acceleration'' /'//nl//free)
   end subroutine test_fit

   !> Checks the estimates of a case. The mesh is that of the record, and a search ends within 1e-6
   !> standard errors of the minimum: 1e-4 of the values leaves a wide margin.
   subroutine check_answer(name, text)
      character(len=*), intent(in) :: name, text

      call check_estimates(name, text, [character(len=3) :: 'E', 'a_h', 'b_h'], &
         [7e10_wp, 0.06_wp, 0.1_wp], 1e-4_wp)
   end subroutine check_answer

   !> One line and status 2: no range, cvode, and parameters without effect at their start values.
   subroutine test_refusals()
      character(len=*), parameter :: record = '&record kind=''frf'', file=''true/frf.csv'' /'//nl, &
         pulse = '&excitation kind=''pulse'', amplitude=1, duration=0.002 /'//nl// &
         '&record t_first=0, t_last=1, t_step=0.01 /'//nl

      call check_refused('no range', 2, 'modes', beam(7e10_wp, 0.06_wp, 0.0_wp), &
         '&beam a_h: found a value without b_h')
      call check_refused('cvode', 2, 'simulate', beam(7e10_wp, 0.06_wp, 0.1_wp)//pulse// &
         '&integrator method=''cvode'' /'//nl, '&integrator method: found ''cvode'' beside a_h')
      call check_refused('b_h at a_h = 0', 2, 'identify', beam(7e10_wp, 0.0_wp, 0.1_wp)//record// &
         '&stage free=''E'',''a_h'',''b_h'' /'//nl, 'found ''b_h'' beside a_h = 0')
      call check_refused('a_h at b_h = 0', 2, 'identify', beam(7e10_wp, 0.0_wp, 0.0_wp)//record// &
         '&stage free=''E'',''a_h'' /'//nl, 'found ''a_h'', expected a value of b_h in &beam')
      call check_refused('b_h = 0 at the start', 2, 'identify', beam(7e10_wp, 0.01_wp, 0.1_wp)// &
         record//'&stage free=''E'',''a_h'',''b_h'', start=7e10,0.01,0 /'//nl, &
         'found ''a_h'' beside b_h = 0')
   end subroutine test_refusals

end program test_spatial_hysteresis
