!> Natural frequencies of a beam by Hermite's cubic elements with nodes wherever something is; axial
!> force and weight by Gauss points inside them.
module hermite_beams
   use beamid_kinds, only: wp
   use beamid_quadrature, only: gauss_legendre, rule_t
   use beamid_structure, only: structure_t
   implicit none
   private

   public :: hermite_frequencies, bending_of_element, mass_of_element, dsygv

   interface
      subroutine dsygv(itype, jobz, uplo, n, a, lda, b, ldb, w, work, lwork, info)
         import :: wp
         integer, intent(in) :: itype, n, lda, ldb, lwork
         character, intent(in) :: jobz, uplo
         real(wp), intent(inout) :: a(lda, *), b(ldb, *)
         real(wp), intent(out) :: w(*), work(*)
         integer, intent(out) :: info
      end subroutine dsygv
   end interface

contains

   !> Undamped and without a hose; places at multiples of length/elements.
   !>
   !> omega  the lowest [1/time]
   function hermite_frequencies(s, elements, wanted) result(omega)
      type(structure_t), intent(in) :: s
      integer, intent(in) :: elements, wanted
      real(wp) :: omega(wanted)
      real(wp), dimension(2*elements + 2, 2*elements + 2) :: K, M
      real(wp) :: h, w(2*elements + 2), work(40*elements)
      logical :: held(2*elements + 2)
      real(wp), allocatable :: a(:, :), b(:, :)
      integer, allocatable :: free(:)
      integer :: e, i, info, n

      h = s%length/elements
      K = 0
      M = 0
      do e = 0, elements - 1
         associate (l => [2*e + 1, 2*e + 2, 2*e + 3, 2*e + 4])
            K(l, l) = K(l, l) + s%E*s%I*bending_of_element(h)
            M(l, l) = M(l, l) + s%rho*mass_of_element(h)
         end associate
         call add_tension(s, e*h, h, K(2*e + 1:2*e + 4, 2*e + 1:2*e + 4))
      end do
      held = .false.
      held(1) = .true.
      held(2) = .not. (s%end(1)%kappa_R > 0)
      if ((s%end(1)%kappa_R > 0)) K(2, 2) = K(2, 2) + 1/s%end(1)%kappa_R
      n = 2*elements
      M(n + 1, n + 1) = M(n + 1, n + 1) + s%m_T
      M(n + 2, n + 2) = M(n + 2, n + 2) + s%J_T
      do i = 1, s%sensors
         n = 2*nint(s%sensor(i)%x_S/h)
         M(n + 1, n + 1) = M(n + 1, n + 1) + s%sensor(i)%m_S
         M(n + 2, n + 2) = M(n + 2, n + 2) + s%sensor(i)%J_S
      end do
      do i = 1, s%supports
         n = 2*nint(s%support(i)%x_P/h) + 1
         held(n) = held(n) .or. .not. s%support(i)%kappa_P > 0
         if (s%support(i)%kappa_P > 0) K(n, n) = K(n, n) + 1/s%support(i)%kappa_P
      end do
      free = pack([(i, i=1, size(held))], .not. held)
      a = K(free, free)
      b = M(free, free)
      call dsygv(1, 'N', 'L', size(free), a, size(free), b, size(free), w, work, size(work), info)
      omega = sqrt(w(:wanted))
   end function hermite_frequencies

   !> Returns the stiffness of an element of length h and bending stiffness 1, for displacement and
   !> slope of either end.
   pure function bending_of_element(h) result(K)
      real(wp), intent(in) :: h
      real(wp) :: K(4, 4)

      K = reshape([12.0_wp, 6*h, -12.0_wp, 6*h, 6*h, 4*h**2, -6*h, 2*h**2, &
         -12.0_wp, -6*h, 12.0_wp, -6*h, 6*h, 2*h**2, -6*h, 4*h**2], [4, 4])/h**3
   end function bending_of_element

   !> Returns the mass matrix of an element of length h and mass per length 1.
   pure function mass_of_element(h) result(M)
      real(wp), intent(in) :: h
      real(wp) :: M(4, 4)

      M = h/420*reshape([156.0_wp, 22*h, 54.0_wp, -13*h, 22*h, 4*h**2, 13*h, -3*h**2, &
         54.0_wp, 13*h, 156.0_wp, -22*h, -13*h, -3*h**2, -22*h, 4*h**2], [4, 4])
   end function mass_of_element

   !> What the tension in one element adds: N b_i' b_j', a polynomial of degree 5.
   !>
   !> x, h  where it begins, its length
   subroutine add_tension(s, x, h, K)
      type(structure_t), intent(in) :: s
      real(wp), intent(in) :: x, h
      real(wp), intent(inout) :: K(:, :)
      type(rule_t) :: rule
      real(wp) :: slope(4), carried, N
      integer :: q

      rule = gauss_legendre(3)
      do q = 1, 3
         associate (xi => rule%points(q))
            slope = [(6*xi**2 - 6*xi)/h, 3*xi**2 - 4*xi + 1, (6*xi - 6*xi**2)/h, 3*xi**2 - 2*xi]
            carried = s%m_T + s%rho*(s%length - x - xi*h) + sum(s%sensor%m_S, &
               mask=s%sensor%x_S > x + h/2 .or. s%sensor%x_S < 0)
         end associate
         N = s%T + merge(-1, 1, s%stands)*s%g*carried
         K = K + rule%weights(q)*h*N*spread(slope, 1, 4)*spread(slope, 2, 4)
      end do
   end subroutine add_tension

end module hermite_beams
