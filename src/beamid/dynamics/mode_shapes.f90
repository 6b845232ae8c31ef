!> Shapes of the damped modes along the beam. They are complex if damping or attached masses make
!> the points of the beam move out of phase.
module beamid_mode_shapes
   use beamid_equations, only: equations_t
   use beamid_errors, only: error_t, failure
   use beamid_kinds, only: wp
   use beamid_matrices, only: eliminate
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
      complex(wp), dimension(equations%n, equations%n) :: matrix, factors
      complex(wp) :: u(equations%n, 1), s, largest
      real(wp) :: basis(size(x), equations%galerkin%space%n)
      real(wp), allocatable :: re(:), im(:)
      complex(wp) :: first(equations%n, 1)
      integer :: i, j, k, sweep
      logical :: regular

      ! A start with a share of each mode. Equal or linear values would be a rigid-body motion,
      ! which is orthogonal to all other modes of a free beam.
      first(:, 1) = [(modulo(0.618034_wp*j, 1.0_wp) - 0.5_wp, j=1, equations%n)]
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
            u = first
            do sweep = 1, 3
               factors = matrix
               call eliminate(equations%n, 1, factors, u, regular)
               if (.not. regular) then
                  call failure(error, 'shape of mode '//to_text(k)//': no solution')
                  return
               end if
               u = u/maxval(abs(u))
            end do
            re = equations%constraints%expanded(real(u(:, 1)))
            im = equations%constraints%expanded(aimag(u(:, 1)))
            shapes(:, k) = cmplx(matmul(basis, re(equations%spline)), &
               matmul(basis, im(equations%spline)), wp)
            largest = shapes(maxloc(abs(shapes(:, k)), dim=1), k)
            if (.not. abs(largest) > 0) then
               call failure(error, 'mode '//to_text(k)//' does not move the beam')
               return
            end if
            shapes(:, k) = shapes(:, k)/largest
         end do
      end associate
   end subroutine mode_shapes

end module beamid_mode_shapes
