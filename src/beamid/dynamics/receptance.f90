!> The structure as one scalar equation in s.
!>
!> In the modes of the bare beam (B phi = mu G phi, phi' G phi = 1, of the mesh alone) the beam is
!> diagonal, D_i(s) = rho s**2 + (E + c_D s) I mu_i, and tip mass and hose hang on its tip: with
!>
!>     g(s) = sum_i phi_i(l)**2/D_i(s)                                      receptance of the bare
!>     tip
!>     h(s) = m_T s**2 + m_H s**2 (k_H + c_H s)/(m_H s**2 + c_H s + k_H)     dynamic stiffness on it
!>
!> the tip answers a load F by b'(s**2 M + s C + K)^{-1} F = g_F/(1 + g h). Its poles are the roots
!> of the damped structure. Near a pole p_j of the beam all sums are taken times e = D_j(s), with
!> q_i = D_j/D_i, so that nothing grows without bound when an attachment is light.
module beamid_receptance
   use beamid_kinds, only: wp
   use beamid_structure, only: structure_t
   implicit none
   private

   public :: receptance_t, new_receptance, root_t, sums_t, root_sums

   type :: receptance_t
      type(structure_t) :: structure
      real(wp), allocatable :: mu(:)          !< (n) of the bare beam [1/length**4]
      real(wp), allocatable :: tip(:)         !< (n) phi_i(l)
      real(wp), allocatable :: load(:)        !< (n) phi_i' F
      complex(wp), allocatable :: pole(:, :)  !< (n, 2) roots of D_i [1/time]
      complex(wp), allocatable :: hose(:)     !< (0 .. 2) roots of the hose's own equation [1/time]
   contains
      procedure :: beam
      procedure :: attachment
      procedure :: attachment_slopes
      procedure :: secular
      procedure :: pair
      procedure :: with_tip_mass
   end type receptance_t

   !> A point s given relative to a pole, so that D_j keeps its digits however near they are.
   type :: root_t
      integer :: j = 0                !< s = pole(j, side) + offset; 0: no pole of the beam is near
      integer :: side = 1
      complex(wp) :: offset = 0
      complex(wp) :: hose(2) = 0      !< s - hose(k), for the same reason
      complex(wp) :: s = 0
   end type root_t

   !> What residues and derivatives at a root are made of.
   type :: sums_t
      complex(wp), allocatable, dimension(:) :: D, q   !< (n)
      complex(wp) :: G = 0, G_F = 0, A = 0
      complex(wp) :: h(0:2) = 0                        !< h, h', h''
      real(wp) :: size_A = 0                           !< A with every term made positive
      !> A root of the hose alone, where h has its pole: the tip does not see it.
      logical :: hidden = .false.
   end type sums_t

contains

   !> mu, tip, load  (n) of the bare beam and of the load
   function new_receptance(structure, mu, tip, load) result(self)
      type(structure_t), intent(in) :: structure
      real(wp), intent(in) :: mu(:), tip(:), load(:)
      type(receptance_t) :: self
      integer :: i

      self%structure = structure
      self%mu = mu
      self%tip = tip
      self%load = load
      allocate (self%pole(size(mu), 2))
      associate (s => structure)
         do i = 1, size(mu)
            self%pole(i, :) = self%pair(mu(i))
         end do
         if (.not. s%has_hose() .or. .not. (s%k_H > 0 .or. s%c_H > 0)) then
            allocate (self%hose(0))
         else if (.not. s%k_H > 0) then
            self%hose = [cmplx(-s%c_H/s%m_H, 0.0_wp, wp)]
         else
            self%hose = quadratic(s%m_H, s%c_H, s%k_H)
         end if
      end associate
   end function new_receptance

   !> Roots of rho s**2 + (E + c_D s) I mu.
   pure function pair(self, mu) result(roots)
      class(receptance_t), intent(in) :: self
      real(wp), intent(in) :: mu
      complex(wp) :: roots(2)

      associate (s => self%structure)
         roots = quadratic(s%rho, s%c_D*s%I*mu, s%E*s%I*mu)
      end associate
   end function pair

   !> mu of mode k with the tip mass on the beam. With it alone D_i = (E + c_D s) I (mu_i - nu) and
   !> h = -(m_T/rho) (E + c_D s) I nu turn 1 + g h = 0 into a real equation for nu, with one root
   !> between each two of the bare beam's, found by Newton's method within brackets.
   pure real(wp) function with_tip_mass(self, k)
      class(receptance_t), intent(in) :: self
      integer, intent(in) :: k
      real(wp) :: ratio, below, above, delta, nu, f, slope, step
      real(wp) :: term(size(self%mu)), gap(size(self%mu))
      integer :: iteration

      with_tip_mass = self%mu(k)
      ratio = self%structure%m_T/self%structure%rho
      if (.not. ratio > 0) return
      below = 0
      above = self%mu(k)
      if (k > 1) above = self%mu(k) - self%mu(k - 1)
      delta = above/2
      do iteration = 1, 60
         ! delta (1 - ratio nu sum phi_i**2/(mu_i - nu)), nu = mu_k - delta: rises from below zero.
         nu = self%mu(k) - delta
         gap = self%mu - nu
         gap(k) = 1
         term = self%tip**2/gap
         term(k) = 0
         f = delta*(1 - ratio*nu*sum(term)) - ratio*nu*self%tip(k)**2
         slope = 1 - ratio*nu*sum(term) + delta*ratio*(sum(term) + nu*sum(term/gap)) &
            + ratio*self%tip(k)**2
         if (f > 0) then
            above = delta
         else
            below = delta
         end if
         step = -f/slope
         if (delta + step <= below .or. delta + step >= above .or. .not. slope > 0) &
            step = (below + above)/2 - delta
         delta = delta + step
         if (abs(step) <= 1e-12_wp*delta) exit
      end do
      with_tip_mass = self%mu(k) - delta
   end function with_tip_mass

   !> Both roots of a s**2 + b s + c, a, c > 0, b >= 0, without cancellation.
   pure function quadratic(a, b, c) result(roots)
      real(wp), intent(in) :: a, b, c
      complex(wp) :: roots(2)
      real(wp) :: half, discriminant

      half = b/(2*a)
      discriminant = half**2 - c/a
      if (discriminant < 0) then
         roots(1) = cmplx(-half, sqrt(-discriminant), wp)
         roots(2) = conjg(roots(1))
      else
         roots(2) = -(half + sqrt(discriminant))
         roots(1) = c/(a*roots(2))
      end if
   end function quadratic

   !> D_i(s) of every mode, and q_i = e/D_i with e = D_j (1 where no pole is near; q_j = 1).
   pure subroutine beam(self, root, D, q, e)
      class(receptance_t), intent(in) :: self
      type(root_t), intent(in) :: root
      complex(wp), intent(out) :: D(:), q(:), e

      associate (j => root%j, rho => self%structure%rho)
         D = rho*(root%s - self%pole(:, 1))*(root%s - self%pole(:, 2))
         if (j > 0) then
            D(j) = rho*root%offset*(root%offset + self%pole(j, root%side) - self%pole(j, &
               3 - root%side))
            e = D(j)
            D(j) = 1
            q = e/D
            q(j) = 1
            D(j) = e
         else
            e = 1
            q = 1/D
         end if
      end associate
   end subroutine beam

   !> h = numerator/denominator with both derivatives: polynomials in s, (0:2) each.
   pure subroutine attachment(self, root, numerator, denominator)
      class(receptance_t), intent(in) :: self
      type(root_t), intent(in) :: root
      complex(wp), intent(out) :: numerator(0:2), denominator(0:2)
      complex(wp) :: mass(0:2)

      associate (st => self%structure, s => root%s)
         mass = st%m_T*[s**2, 2*s, (2.0_wp, 0.0_wp)]
         select case (size(self%hose))
         case (0)
            denominator = [1, 0, 0]
            numerator = mass
         case (1)
            denominator = [st%m_H*root%hose(1), cmplx(st%m_H, 0.0_wp, wp), (0.0_wp, 0.0_wp)]
            numerator = product_rule(mass, denominator) + st%m_H*st%c_H*[s**2, 2*s, (2.0_wp, &
               0.0_wp)]
         case default
            denominator = [st%m_H*root%hose(1)*root%hose(2), 2*st%m_H*s + st%c_H, &
                           cmplx(2*st%m_H, 0.0_wp, wp)]
            numerator = product_rule(mass, denominator) + st%m_H*[s**2*(st%k_H + st%c_H*s), &
                        2*s*st%k_H + 3*st%c_H*s**2, 2*st%k_H + 6*st%c_H*s]
         end select
      end associate
   end subroutine attachment

   !> (x y, (x y)', (x y)'').
   pure function product_rule(x, y) result(z)
      complex(wp), intent(in) :: x(0:2), y(0:2)
      complex(wp) :: z(0:2)

      z = [x(0)*y(0), x(1)*y(0) + x(0)*y(1), x(2)*y(0) + 2*x(1)*y(1) + x(0)*y(2)]
   end function product_rule

   !> Derivatives of h and of h' with respect to m_T, m_H, c_H, k_H, each (4).
   !> With u = m_H s**2, a = k_H + c_H s, the hose is u a/(u + a).
   pure subroutine attachment_slopes(self, root, h_q, dh_q)
      class(receptance_t), intent(in) :: self
      type(root_t), intent(in) :: root
      complex(wp), intent(out) :: h_q(4), dh_q(4)
      complex(wp) :: a, u, d, alpha, beta, dalpha, s

      s = root%s
      h_q = 0
      dh_q = 0
      h_q(1) = s**2
      dh_q(1) = 2*s
      associate (st => self%structure)
         if (.not. st%has_hose()) then
            ! What the first grain of hose would do: it moves with the tip, held by c_H and k_H.
            if (st%k_H > 0 .or. st%c_H > 0) h_q(2) = s**2
            if (st%k_H > 0 .or. st%c_H > 0) dh_q(2) = 2*s
            return
         end if
         a = st%k_H + st%c_H*s
         u = st%m_H*s**2
         select case (size(self%hose))
         case (0); d = u + a
         case (1); d = st%m_H*s*root%hose(1)
         case default; d = st%m_H*root%hose(1)*root%hose(2)
         end select
         alpha = a/d
         beta = u/d
         dalpha = (st%c_H*u - a*2*st%m_H*s)/d**2
      end associate
      h_q(2:) = [s**2*alpha**2, s*beta**2, beta**2]
      dh_q(2:) = [2*s*alpha**2 + 2*s**2*alpha*dalpha, beta**2 - 2*s*beta*dalpha, -2*beta*dalpha]
   end subroutine attachment_slopes

   !> Logarithmic derivative of the characteristic polynomial, W'/W + sum 1/(s - p) over the poles
   !> of the beam other than those of mode j, with W = e denominator + (sum_i phi_i**2 q_i)
   !> numerator.
   pure complex(wp) function secular(self, root) result(value)
      class(receptance_t), intent(in) :: self
      type(root_t), intent(in) :: root
      complex(wp), dimension(size(self%mu)) :: D, q, dD, terms
      complex(wp) :: e, de, G, dG, w, dw, num(0:2), den(0:2)

      call self%beam(root, D, q, e)
      call self%attachment(root, num, den)
      dD = self%structure%rho*(2*root%s - self%pole(:, 1) - self%pole(:, 2))
      terms = self%tip**2*q
      G = sum(terms)
      de = 0
      if (root%j > 0) then
         de = dD(root%j)
         D(root%j) = 1
         dD(root%j) = 0
         dG = sum(terms*(-dD/D))
         terms = self%tip**2/D
         terms(root%j) = 0
         dG = dG + de*sum(terms)
      else
         dG = sum(terms*(-dD/D))
      end if
      w = e*den(0) + G*num(0)
      dw = de*den(0) + e*den(1) + dG*num(0) + G*num(1)
      if (.not. abs(w) > 0) then
         value = huge(1.0_wp)
         return
      end if
      value = dw/w + sum(dD/D)
   end function secular

   !> G = sum phi**2 q, G_F = sum phi F q and A = sum phi**2 D' q**2 + G**2 h' at a root.
   pure function root_sums(receptance, root) result(sums)
      type(receptance_t), intent(in) :: receptance
      type(root_t), intent(in) :: root
      type(sums_t) :: sums
      complex(wp) :: e, num(0:2), den(0:2), terms(size(receptance%mu))

      allocate (sums%D(size(receptance%mu)), sums%q(size(receptance%mu)))
      call receptance%beam(root, sums%D, sums%q, e)
      call receptance%attachment(root, num, den)
      ! The residue is of the order of den**2: below the square of this it is nothing.
      associate (st => receptance%structure, s => abs(root%s))
         sums%hidden = size(receptance%hose) > 0 .and. &
            abs(den(0)) <= 1e-60_wp*(st%m_H*s**2 + st%c_H*s + st%k_H)
      end associate
      if (sums%hidden) return
      sums%h(0) = num(0)/den(0)
      sums%h(1) = (num(1) - sums%h(0)*den(1))/den(0)
      sums%h(2) = (num(2) - 2*sums%h(1)*den(1) - sums%h(0)*den(2))/den(0)
      associate (st => receptance%structure, tip => receptance%tip)
         sums%G = sum(tip**2*sums%q)
         sums%G_F = sum(tip*receptance%load*sums%q)
         terms = tip**2*(2*st%rho*root%s + st%c_D*st%I*receptance%mu)*sums%q**2
      end associate
      sums%A = sum(terms) + sums%G**2*sums%h(1)
      sums%size_A = sum(abs(terms)) + abs(sums%G**2*sums%h(1))
   end function root_sums

end module beamid_receptance
