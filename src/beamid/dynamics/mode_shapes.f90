!> Shapes of the damped modes along the beam. They are complex if damping or attached masses make
!> the points of the beam move out of phase.
module beamid_mode_shapes
   use beamid_equations, only: equations_t
   use beamid_errors, only: error_t, failure
   use beamid_kinds, only: wp
   use beamid_strings, only: to_text
   implicit none
   private

   public :: mode_shapes

contains

   !> Computes mode shapes: the vectors of (s**2 M + s C + K) u = 0, by inverse iteration close to
   !> the roots, as displacements. Each shape is normalised to 1 at the point where it is largest.
   !>
   !> roots   (modes) roots s [1/time]
   !> x       (points) positions, 0 .. length [length]
   !> shapes  (points, modes) displacements
   !> error   the equations cannot be solved, or a mode does not move the beam
   subroutine mode_shapes(equations, roots, x, shapes, error)
      type(equations_t), intent(in) :: equations
      complex(wp), intent(in) :: roots(:)
      real(wp), intent(in) :: x(:)
      complex(wp), allocatable, intent(out) :: shapes(:, :)
      type(error_t), allocatable, intent(out) :: error
      real(wp), parameter :: beside = 1e-7_wp
      complex(wp) :: matrix(equations%n, equations%n), u(equations%n), s, largest
      real(wp) :: basis(size(x), equations%galerkin%space%n)
      real(wp), allocatable :: re(:), im(:)
      integer :: order(equations%n), i, j, k, sweep
      logical :: regular

      associate (space => equations%galerkin%space, length => equations%structure%length)
         do i = 1, size(x)
            basis(i, :) = space%at(x(i)*space%length/length, 0)
         end do
         allocate (shapes(size(x), size(roots)))
         do k = 1, size(roots)
            s = roots(k)*(1 + beside)
            do j = 1, equations%n
               do i = 1, equations%n
                  matrix(i, j) = s**2*equations%mass%element(i, j) &
                     + s*equations%damping%element(i, j) + equations%stiffness%element(i, j)
               end do
            end do
            call factor(matrix, order, regular)
            if (.not. regular) then
               call failure(error, 'shape of mode '//to_text(k)//': no solution')
               return
            end if
            u = 1
            do sweep = 1, 3
               u = u(order)
               call solve(matrix, u)
               u = u/maxval(abs(u))
            end do
            re = equations%constraints%expanded(real(u))
            im = equations%constraints%expanded(aimag(u))
            shapes(:, k) = cmplx(matmul(basis, re(:space%n)), matmul(basis, im(:space%n)), wp)
            largest = shapes(maxloc(abs(shapes(:, k)), dim=1), k)
            if (.not. abs(largest) > 0) then
               call failure(error, 'mode '//to_text(k)//' does not move the beam')
               return
            end if
            shapes(:, k) = shapes(:, k)/largest
         end do
      end associate
   end subroutine mode_shapes

   !> Computes the LU factors of a matrix, by elimination with row pivoting. LAPACK does not serve:
   !> the last bits of the results of a threaded LAPACK differ from run to run, and those of a table
   !> must not.
   !>
   !> a        (n, n) in: the matrix; out: its factors, L with ones on the diagonal
   !> order    (n) rows of the matrix in the order of the factors
   !> regular  .false.: a pivot is zero or not a number
   pure subroutine factor(a, order, regular)
      complex(wp), intent(inout) :: a(:, :)
      integer, intent(out) :: order(:)
      logical, intent(out) :: regular
      integer :: i, j, n, pivot

      n = size(order)
      order = [(i, i=1, n)]
      regular = .false.
      do j = 1, n
         pivot = j - 1 + maxloc(abs(a(j:, j)), dim=1)
         if (.not. abs(a(pivot, j)) > 0) return
         if (pivot /= j) then
            order([j, pivot]) = order([pivot, j])
            a([j, pivot], :) = a([pivot, j], :)
         end if
         a(j + 1:, j) = a(j + 1:, j)/a(j, j)
         do i = j + 1, n
            a(j + 1:, i) = a(j + 1:, i) - a(j, i)*a(j + 1:, j)
         end do
      end do
      regular = .true.
   end subroutine factor

   !> Solves A x = b in place with the factors of `factor`.
   !>
   !> b  (n) in: right-hand side, its rows in the order of the factors; out: solution
   pure subroutine solve(a, b)
      complex(wp), intent(in) :: a(:, :)
      complex(wp), intent(inout) :: b(:)
      integer :: j

      do j = 1, size(b)
         b(j + 1:) = b(j + 1:) - b(j)*a(j + 1:, j)
      end do
      do j = size(b), 1, -1
         b(j) = b(j)/a(j, j)
         b(:j - 1) = b(:j - 1) - b(j)*a(:j - 1, j)
      end do
   end subroutine solve

end module beamid_mode_shapes
