!> Poles and residues of the tip's response, and their derivatives with respect to the parameters.
!>
!> With the sums of `beamid_receptance` (G = sum phi**2 q, G_F = sum phi F q) and
!> A = sum phi**2 D' q**2 + G**2 h', the residue is r = G G_F/A, and
!> ds/dp = -(sum phi**2 D_p q**2 + G**2 h_p)/A: in terms of the eigenvector x, normalised so that
!> x'(2 s M + C) x = 1, these are (b'x)(x'F) and -x'(s**2 M_p + s C_p + K_p) x.
module beamid_poles
   use beamid_errors, only: error_t, failure
   use beamid_kinds, only: wp
   use beamid_receptance, only: receptance_t, root_sums, root_t, sums_t
   use beamid_roots, only: find_roots
   use beamid_strings, only: to_text
   implicit none
   private

   public :: poles_t, find_poles, differentiate_poles

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
      real(wp) :: ordinary = 0                    !< size of an ordinary residue
   end type poles_t

   !> The residues of all poles add up to nothing. Where two roots come together each residue grows
   !> without bound, and what their sum leaves is the error of the response, relative to the size of
   !> an ordinary residue: so much is allowed, of a response and of a derivative.
   real(wp), parameter :: max_rest = 1e-8_wp, max_rest_of_derivatives = 1e-6_wp

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
      poles%impulse = impulse(receptance)
      poles%ordinary = abs(poles%impulse)/minval(abs(poles%s))
      if (abs(sum(real(poles%residue*poles%s)) - poles%impulse) <= &
         1e-8_wp*sum(abs(poles%residue*poles%s)) .and. &
         abs(sum(real(poles%residue))) <= max_rest*poles%ordinary) return
      if (worst > 5) then
         call failure(error, 'modal: two roots coincide near s = '// &
            to_text(real(poles%s(worst_k)))//' + '//to_text(aimag(poles%s(worst_k)))// &
            ' i; method = ''cvode'' has no such limit')
      else
         call failure(error, 'modal: a root of the characteristic equation was missed')
      end if
   end subroutine residues

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
      call receptance%attachment_slopes(root, h_q, dh_q)
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
   !> error       two roots nearly coincide: derivatives lose more digits than the response does
   subroutine differentiate_poles(receptance, parameters, poles, error)
      type(receptance_t), intent(in) :: receptance
      integer, intent(in) :: parameters(:)
      type(poles_t), intent(inout) :: poles
      type(error_t), allocatable, intent(out) :: error
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
      do p = 1, size(parameters)
         if (abs(sum(real(poles%dr(:, p))))*receptance%structure%get(parameters(p)) <= &
            max_rest_of_derivatives*poles%ordinary) cycle
         call failure(error, &
            'modal: two roots nearly coincide, too near for exact derivatives; '// &
            'method = ''cvode'' has no such limit')
      end do
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
