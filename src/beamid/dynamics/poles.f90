!> Poles and residues of the tip's response, and their derivatives with respect to the parameters.
!>
!> All roots of the characteristic equation are found at once by the Ehrlich-Aberth iteration from
!> those of the parts (beam, hose). Then, with the sums of `beamid_receptance` (G = sum phi**2 q,
!> G_F = sum phi F q) and A = sum phi**2 D' q**2 + G**2 h', the residue is r = G G_F/A, and
!> ds/dp = -(sum phi**2 D_p q**2 + G**2 h_p)/A: in terms of the eigenvector x, normalised so that
!> x'(2 s M + C) x = 1, these are (b'x)(x'F) and -x'(s**2 M_p + s C_p + K_p) x.
module beamid_poles
   use beamid_equations, only: equations_t
   use beamid_errors, only: error_t, failure
   use beamid_kinds, only: wp
   use beamid_modes, only: bare_beam_modes
   use beamid_receptance, only: new_receptance, receptance_t, root_t
   use beamid_strings, only: to_text
   implicit none
   private

   public :: poles_t, find_poles, differentiate_poles, damped_roots

   type :: poles_t
      !> one of each complex pair, Im s > 0, and the real ones
      type(root_t), allocatable :: root(:)
      complex(wp), allocatable :: s(:)            !< their positions [1/time]
      !> r, doubled for the pairs: Re(sum r e**(s t)) is the answer
      complex(wp), allocatable :: residue(:)
      !> sum r s = b' M**-1 F: the acceleration at unit force
      real(wp) :: impulse = 0
      complex(wp), allocatable :: ds(:, :)        !< (poles, parameters) d s/d parameter
      complex(wp), allocatable :: dr(:, :)        !< (poles, parameters) d residue/d parameter
      real(wp), allocatable :: dimpulse(:)        !< (parameters)
   end type poles_t

   !> The sums of the module's heading at one root.
   type :: sums_t
      complex(wp), allocatable, dimension(:) :: D, q   !< (n)
      complex(wp) :: G = 0, G_F = 0, A = 0
      complex(wp) :: h(0:2) = 0                        !< h, h', h''
      real(wp) :: size_A = 0                           !< A with every term made positive
      !> A root of the hose alone, where h has its pole: the tip does not see it.
      logical :: hidden = .false.
   end type sums_t

   integer, parameter :: max_sweeps = 200
   !> Sensitivity of a root, relative to that of a simple mode, beyond which two roots count as
   !> equal: round-off of 1e-16 would leave less than seven digits of the response.
   real(wp), parameter :: max_condition = 1e9_wp

contains

   !> error  the iteration does not converge, two roots coincide, or a root was missed
   subroutine find_poles(receptance, poles, error)
      type(receptance_t), intent(in) :: receptance
      type(poles_t), intent(out) :: poles
      type(error_t), allocatable, intent(out) :: error

      call find_roots(receptance, poles%root, error)
      if (allocated(error)) return
      poles%s = poles%root%s
      call residues(receptance, poles, error)
   end subroutine find_poles

   !> Roots s of (s**2 M + s C + K) x = 0.
   !>
   !> roots  complex pairs once, with positive imaginary part; real roots each; ascending |s| [1/time]
   subroutine damped_roots(equations, roots, error)
      type(equations_t), intent(in) :: equations
      complex(wp), allocatable, intent(out) :: roots(:)
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: mu(:), shapes(:, :), tip(:)
      type(root_t), allocatable :: half(:)

      call bare_beam_modes(equations%galerkin, mu, shapes, error)
      if (allocated(error)) return
      tip = matmul(equations%galerkin%tip, shapes)
      associate (structure => equations%structure)
         call find_roots(new_receptance(structure, mu, tip, tip), half, error)
         if (allocated(error)) return
         roots = half%s
         ! A hose without a spring is free to drift: a root that the tip does not see.
         if (structure%has_hose() .and. .not. structure%k_H > 0) roots = [roots, (0.0_wp, 0.0_wp)]
      end associate
      call sort_by_modulus(roots)
   end subroutine damped_roots

   !> Ascending |s|, by insertion.
   pure subroutine sort_by_modulus(roots)
      complex(wp), intent(inout) :: roots(:)
      complex(wp) :: root
      integer :: i, j

      do i = 2, size(roots)
         root = roots(i)
         do j = i - 1, 1, -1
            if (abs(roots(j)) <= abs(root)) exit
            roots(j + 1) = roots(j)
         end do
         roots(j + 1) = root
      end do
   end subroutine sort_by_modulus

   !> One root of each complex pair, and the real ones.
   subroutine find_roots(receptance, half, error)
      type(receptance_t), intent(in) :: receptance
      type(root_t), allocatable, intent(out) :: half(:)
      type(error_t), allocatable, intent(out) :: error
      type(root_t), allocatable :: roots(:)

      call starting_points(receptance, roots)
      call iterate(receptance, roots, error)
      if (.not. allocated(error)) call select_half(receptance, roots, half)
   end subroutine find_roots

   !> Roots of the beam with its tip mass, and of the hose alone, each moved by what the other part
   !> does to it at first order, and off the real axis: two real roots may have to become a pair.
   subroutine starting_points(receptance, roots)
      type(receptance_t), intent(in) :: receptance
      type(root_t), allocatable, intent(out) :: roots(:)
      type(receptance_t) :: without_hose
      type(sums_t) :: sums
      complex(wp) :: num(0:2), den(0:2), shift, turn
      integer :: n, k

      n = size(receptance%mu)
      without_hose = receptance
      without_hose%structure%m_H = 0
      deallocate (without_hose%hose)
      allocate (without_hose%hose(0), roots(2*n + size(receptance%hose)))
      do k = 1, n
         roots([k, n + k])%s = receptance%pair(receptance%with_tip_mass(k))
      end do
      do k = 1, 2*n
         roots(k)%j = 0
         call attach(receptance, roots(k))
         if (size(receptance%hose) == 0) cycle
         sums = root_sums(without_hose, roots(k))
         call receptance%attachment(roots(k)%s, num, den)
         turn = cmplx(1.0_wp, merge(0.2_wp, -0.2_wp, k <= n), wp)
         shift = -(num(0)/den(0) - sums%h(0))*sums%G**2/sums%A*turn
         shift = shift*min(1.0_wp, 0.2_wp*abs(roots(k)%s)/max(abs(shift), tiny(1.0_wp)))
         roots(k)%s = roots(k)%s + shift
         roots(k)%offset = roots(k)%offset + shift
      end do
      do k = 1, size(receptance%hose)
         roots(2*n + k)%s = receptance%hose(k)*cmplx(1.02_wp, merge(0.05_wp, -0.05_wp, k == 1), wp)
      end do
   end subroutine starting_points

   !> Ehrlich-Aberth: Newton's correction for the polynomial without the other roots.
   subroutine iterate(receptance, roots, error)
      type(receptance_t), intent(in) :: receptance
      type(root_t), intent(inout) :: roots(:)
      type(error_t), allocatable, intent(out) :: error
      logical :: done(size(roots))
      complex(wp) :: slope, step
      integer :: k, sweep

      if (bare(receptance)) then
         roots%offset = 0
         do k = 1, size(roots)
            roots(k)%s = receptance%pole(roots(k)%j, roots(k)%side)
         end do
         return
      end if
      done = .false.
      do sweep = 1, max_sweeps
         do k = 1, size(roots)
            if (done(k)) cycle
            slope = receptance%secular(roots(k)) - sum(1/(roots(k)%s - roots(:k - 1)%s)) &
               - sum(1/(roots(k)%s - roots(k + 1:)%s))
            step = -1/slope
            roots(k)%s = roots(k)%s + step
            roots(k)%offset = roots(k)%offset + step
            call attach(receptance, roots(k))
            ! Convergence is at least quadratic: after such a step the error is round-off. Only
            ! double roots take longer, and never reach it.
            done(k) = abs(step) <= 1e-9_wp*max(abs(roots(k)%offset), 1e-14_wp*abs(roots(k)%s)) &
               .or. sweep > max_sweeps/2 .and. abs(step) <= 1e-6_wp*abs(roots(k)%s)
         end do
         if (all(done)) return
      end do
      call failure(error, 'modal: '//to_text(count(.not. done))//' of '//to_text(size(roots))// &
         ' roots of the characteristic equation did not converge')
   end subroutine iterate

   !> Whether nothing hangs on the beam.
   pure logical function bare(receptance)
      type(receptance_t), intent(in) :: receptance

      bare = .not. receptance%structure%m_T > 0 .and. size(receptance%hose) == 0
   end function bare

   !> Gives the root the nearest pole of the beam as its origin.
   pure subroutine attach(receptance, root)
      type(receptance_t), intent(in) :: receptance
      type(root_t), intent(inout) :: root
      real(wp) :: distance(2)
      integer :: j, side

      do side = 1, 2
         distance(side) = minval(abs(root%s - receptance%pole(:, side)))
      end do
      side = minloc(distance, dim=1)
      j = minloc(abs(root%s - receptance%pole(:, side)), dim=1)
      if (j == root%j .and. side == root%side) return
      root%j = j
      root%side = side
      root%offset = root%s - receptance%pole(j, side)
   end subroutine attach

   !> Keeps one root of each complex pair and the real ones.
   subroutine select_half(receptance, roots, half)
      type(receptance_t), intent(in) :: receptance
      type(root_t), intent(inout) :: roots(:)
      type(root_t), allocatable, intent(out) :: half(:)
      integer :: k

      associate (st => receptance%structure)
         if (.not. (st%c_D > 0 .or. st%has_hose() .and. st%c_H > 0)) then
            ! Without damping the real parts are round-off.
            roots%s = cmplx(0.0_wp, aimag(roots%s), wp)
            roots%offset = cmplx(0.0_wp, aimag(roots%offset), wp)
         end if
      end associate
      do k = 1, size(roots)
         if (abs(aimag(roots(k)%s)) > 1e-11_wp*abs(roots(k)%s)) cycle
         roots(k)%s = real(roots(k)%s)
         if (roots(k)%j > 0) then
            if (abs(aimag(receptance%pole(roots(k)%j, roots(k)%side))) > 0) then
               roots(k)%offset = roots(k)%s - receptance%pole(roots(k)%j, roots(k)%side)
            else
               roots(k)%offset = real(roots(k)%offset)
            end if
         end if
      end do
      half = pack(roots, aimag(roots%s) >= 0)
   end subroutine select_half

   !> Residues, and the checks that no root is double or missing: the residues add up to zero, and
   !> r s to the acceleration that a unit force causes at once.
   subroutine residues(receptance, poles, error)
      type(receptance_t), intent(in) :: receptance
      type(poles_t), intent(inout) :: poles
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: condition, worst
      integer :: k, worst_k
      type(sums_t) :: sums

      worst = 0
      worst_k = 1
      allocate (poles%residue(size(poles%s)))
      do k = 1, size(poles%s)
         sums = root_sums(receptance, poles%root(k))
         if (sums%hidden) then
            poles%residue(k) = 0
            cycle
         end if
         condition = sums%size_A/max(abs(sums%A), tiny(1.0_wp))
         if (condition > worst) then
            worst = condition
            worst_k = k
         end if
         poles%residue(k) = weight(poles%s(k))*sums%G*sums%G_F/sums%A
      end do
      if (worst > max_condition) then
         call failure(error, 'modal: two roots coincide near s = '// &
            to_text(real(poles%s(worst_k)))// &
            ' + '//to_text(aimag(poles%s(worst_k)))//' i; method = ''cvode'' has no such limit')
         return
      end if
      poles%impulse = impulse(receptance)
      associate (scale => sum(abs(poles%residue*poles%s)))
         if (abs(sum(real(poles%residue*poles%s)) - poles%impulse) > 1e-8_wp*scale .or. &
            abs(sum(real(poles%residue))) > 1e-8_wp*sum(abs(poles%residue))) call failure(error, &
            'modal: a root of the characteristic equation was missed')
      end associate
   end subroutine residues

   pure function root_sums(receptance, root) result(sums)
      type(receptance_t), intent(in) :: receptance
      type(root_t), intent(in) :: root
      type(sums_t) :: sums
      complex(wp) :: e, num(0:2), den(0:2), terms(size(receptance%mu))

      allocate (sums%D(size(receptance%mu)), sums%q(size(receptance%mu)))
      call receptance%beam(root, sums%D, sums%q, e)
      call receptance%attachment(root%s, num, den)
      ! The residue is of the order of den**2: below the square of this, 1e-20, it is nothing.
      associate (st => receptance%structure, s => abs(root%s))
         sums%hidden = size(receptance%hose) > 0 .and. &
            abs(den(0)) <= 1e-10_wp*(st%m_H*s**2 + st%c_H*s + st%k_H)
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

   !> ds/dp and dr/dp of one root. With the root as a function of p, D_i changes by
   !> D_i' ds + D_ip, and q_i = D_j/D_i with it; r = G G_F/A follows by the chain rule.
   pure subroutine differentiate_root(receptance, root, parameters, ds, dr)
      type(receptance_t), intent(in) :: receptance
      type(root_t), intent(in) :: root
      integer, intent(in) :: parameters(:)
      complex(wp), intent(out) :: ds(:), dr(:)
      complex(wp), dimension(size(receptance%mu)) :: D_s, D_p, D_sp, D_all, q_all
      complex(wp) :: h_q(4), dh_q(4), h_p, dh_p, G_all, G_F_all, A_all
      type(sums_t) :: sums
      integer :: p, place

      sums = root_sums(receptance, root)
      ds = 0
      dr = 0
      if (sums%hidden) return
      call receptance%attachment_slopes(root%s, h_q, dh_q)
      associate (st => receptance%structure, mu => receptance%mu, tip => receptance%tip, &
         q => sums%q)
         D_s = 2*st%rho*root%s + st%c_D*st%I*mu
         do p = 1, size(parameters)
            D_p = 0
            D_sp = 0
            h_p = 0
            dh_p = 0
            select case (parameters(p))
            case (2); D_p = st%I*mu
            case (3); D_p = root%s*st%I*mu
                      D_sp = st%I*mu
            case (7); D_p = root%s**2
                      D_sp = 2*root%s
            case (1, 4, 5, 6)
               place = merge(1, parameters(p) - 2, parameters(p) == 1)
               h_p = h_q(place)
               dh_p = dh_q(place)
            end select
            ds(p) = -(sum(tip**2*D_p*q**2) + sums%G**2*h_p)/sums%A
            D_all = D_s*ds(p) + D_p
            if (root%j > 0) then
               q_all = D_all(root%j)
               D_all(root%j) = 0
            else
               q_all = 0
            end if
            q_all = quotient(q_all - q*D_all, sums%D, root%j)
            G_all = sum(tip**2*q_all)
            G_F_all = sum(tip*receptance%load*q_all)
            A_all = sum(tip**2*((2*st%rho*ds(p) + D_sp)*q**2 + 2*D_s*q*q_all)) &
               + 2*sums%G*G_all*sums%h(1) + sums%G**2*(sums%h(2)*ds(p) + dh_p)
            dr(p) = (G_all*sums%G_F + sums%G*G_F_all - sums%G*sums%G_F/sums%A*A_all)/sums%A
         end do
      end associate
   end subroutine differentiate_root

   !> x/D, and 0 at place j, where q stays 1.
   pure function quotient(x, D, j) result(ratio)
      complex(wp), intent(in) :: x(:), D(:)
      integer, intent(in) :: j
      complex(wp) :: ratio(size(x)), divisor(size(x))

      divisor = D
      if (j > 0) divisor(j) = 1
      ratio = x/divisor
      if (j > 0) ratio(j) = 0
   end function quotient

   !> Derivatives of poles and residues.
   !>
   !> parameters  places among m_T, E, c_D, m_H, c_H, k_H, rho
   subroutine differentiate_poles(receptance, parameters, poles)
      type(receptance_t), intent(in) :: receptance
      integer, intent(in) :: parameters(:)
      type(poles_t), intent(inout) :: poles
      real(wp) :: mass
      integer :: k, p

      allocate (poles%ds(size(poles%s), size(parameters)), poles%dr(size(poles%s), &
         size(parameters)))
      allocate (poles%dimpulse(size(parameters)), source=0.0_wp)
      do k = 1, size(poles%s)
         call differentiate_root(receptance, poles%root(k), parameters, poles%ds(k, :), &
            poles%dr(k, :))
         poles%dr(k, :) = weight(poles%s(k))*poles%dr(k, :)
      end do
      associate (st => receptance%structure, tip => receptance%tip)
         mass = st%rho + st%m_T*sum(tip**2)
         do p = 1, size(parameters)
            if (parameters(p) == 1) poles%dimpulse(p) = -poles%impulse*sum(tip**2)/mass
            if (parameters(p) == 7) poles%dimpulse(p) = -poles%impulse/mass
         end do
      end associate
   end subroutine differentiate_poles

   !> 2 for one of a pair, 1 for a real root.
   pure real(wp) function weight(s)
      complex(wp), intent(in) :: s

      weight = merge(2.0_wp, 1.0_wp, abs(aimag(s)) > 0)
   end function weight

   !> b' M**-1 F with M = rho + m_T phi phi' in the modes of the bare beam.
   pure real(wp) function impulse(receptance)
      type(receptance_t), intent(in) :: receptance

      associate (st => receptance%structure, tip => receptance%tip)
         impulse = dot_product(tip, receptance%load)/(st%rho + st%m_T*sum(tip**2))
      end associate
   end function impulse

end module beamid_poles
