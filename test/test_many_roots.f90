!> All roots of 2000 random structures with everything that may hang on a beam: their number, their
!> sums, and each against inverse iteration in quadruple precision.
program test_many_roots
   use attached_beams, only: poles_of, starting_vector
   use beamid_bands, only: band_t
   use beamid_equations, only: equations_t, new_equations
   use beamid_errors, only: error_t
   use beamid_excitation, only: new_pulse
   use beamid_galerkin, only: galerkin_of, mesh_t
   use beamid_kinds, only: wp
   use beamid_poles, only: poles_t
   use beamid_strings, only: to_text
   use beamid_structure, only: structure_t
   use checks, only: check, check_close, finish
   use exact_motions, only: galerkin
   use full_matrices, only: full_t, new_full, qp
   use random_experiments, only: wide_structure
   use random_numbers, only: start_random, uniform
   implicit none

   call start_random(745739799)
   call test_roots()
   call finish('many_roots')

contains

   !> 2000 structures: 2 n roots each, sum log |s| = log det K - log det M, sum s =
   !> -trace(M**-1 C), sum 1/s = -trace(K**-1 C), the last two relative to the sums of moduli. In
   !> every fifth, inverse iteration in quadruple precision leads from each root to one of its own.
   subroutine test_roots()
      type(structure_t) :: structure
      type(equations_t), target :: equations
      type(poles_t) :: poles
      type(error_t), allocatable :: error
      type(mesh_t) :: mesh
      real(wp) :: worst(3)
      integer :: number, refused, miscounted, lost

      refused = 0
      miscounted = 0
      lost = 0
      worst = 0
      do number = 1, 2000
         structure = wide_structure()
         mesh = mesh_t(3, 2 + int(5*uniform()), 4, 1)
         if (uniform() < 0.3_wp) mesh = mesh_t(5, 2 + int(5*uniform()), 6, 1)
         galerkin = galerkin_of(mesh, structure)
         call poles_of(structure, poles, error)
         if (allocated(error)) then
            refused = refused + 1
            print '(a,i0,2a)', '      structure ', number, ': ', error%message
            cycle
         end if
         equations = new_equations(galerkin, structure, new_pulse(1.0_wp, 1.0_wp))
         associate (pairs => count(aimag(poles%s) > 0))
            if (size(poles%s) + pairs /= 2*equations%n) miscounted = miscounted + 1
         end associate
         worst = max(worst, sum_rules(equations, poles%s))
         if (modulo(number, 5) == 0) lost = lost + lost_roots(structure, poles)
      end do
      call check('roots: none of 2000 structures refused', refused == 0, to_text(refused))
      call check('roots: 2 n of each', miscounted == 0, to_text(miscounted))
      call check('roots: each its own in quadruple precision', lost == 0, to_text(lost))
      ! The references lose digits to the condition of M and K, 1e9 with masses and springs that are
      ! a thousand times the beam's. A root that is taken twice for another would show as the
      ! logarithm of their ratio.
      call check_close('roots: sum of logarithms', worst(1), 0.0_wp, 1e-7_wp)
      call check_close('roots: sum', worst(2), 0.0_wp, 1e-7_wp)
      call check_close('roots: sum of inverses', worst(3), 0.0_wp, 1e-7_wp)
   end subroutine test_roots

   !> By how much the three rules are missed.
   function sum_rules(equations, s) result(off)
      type(equations_t), intent(in) :: equations
      complex(wp), intent(in) :: s(:)
      real(wp) :: off(3), weight(size(s))

      weight = merge(2.0_wp, 1.0_wp, aimag(s) > 0)
      off(1) = abs(sum(weight*log(abs(s))) - log_determinant(equations%stiffness) &
         + log_determinant(equations%mass))
      off(2) = abs(sum(weight*real(s)) + trace(equations%mass, equations%damping)) &
         /sum(weight*abs(s))
      off(3) = abs(sum(weight*real(1/s)) + trace(equations%stiffness, equations%damping)) &
         /sum(weight/abs(s))
      ! max() would lose a NaN.
      where (.not. off >= 0) off = huge(off)
   end function sum_rules

   !> Logarithm of the determinant.
   real(wp) function log_determinant(band)
      type(band_t), intent(in) :: band
      type(band_t) :: factor
      logical :: positive

      factor = band
      call factor%factor(positive)
      log_determinant = huge(1.0_wp)
      if (positive) log_determinant = 2*sum(log(factor%a(1, :)))
   end function log_determinant

   !> trace(A**-1 B)
   real(wp) function trace(a, b)
      type(band_t), intent(in) :: a, b
      type(band_t) :: factor
      real(wp) :: x(a%n)
      logical :: positive
      integer :: i, j

      factor = a
      call factor%factor(positive)
      trace = 0
      do j = 1, a%n
         x = [(b%element(i, j), i=1, a%n)]
         call factor%solve(x)
         trace = trace + x(j)
      end do
      if (.not. positive) trace = huge(1.0_wp)
   end function trace

   !> How many roots are not one of their own in quadruple precision.
   integer function lost_roots(structure, poles) result(lost)
      type(structure_t), intent(in) :: structure
      type(poles_t), intent(in) :: poles
      type(full_t) :: full
      complex(qp) :: s(size(poles%s))
      complex(qp), allocatable :: x(:)
      real(qp) :: last
      integer :: k

      full = new_full(galerkin, structure, new_pulse(1.0_wp, 1.0_wp))
      s = poles%s
      lost = 0
      do k = 1, size(s)
         x = starting_vector(full%n)
         call full%improve(12, s(k), x, last)
         if (.not. last <= 1e-20_qp*abs(s(k)) .or. .not. abs(s(k) - poles%s(k)) &
            <= 1e-8_qp*abs(s(k)) .or. any(abs(s(:k - 1) - s(k)) <= 1e-18_qp*abs(s(k)))) &
            lost = lost + 1
      end do
   end function lost_roots

end program test_many_roots
