!> Derivatives of poles and residues with respect to the parameters.
!>
!> Notation: Q(s) = s**2 M + s C + K + i L; x is the eigenvector of the root s,
!> A = x'(2 s M + C) x; o is the sensor's row. The index p is the derivative with respect to a
!> parameter at constant s.
!>
!>     ds/dp = -x'Q_p x/A
!>
!> The residue r = (o'x)(x'F)/A depends on p through s, x, o, F and M, C. The derivative of x
!> itself is not needed: one adjoint vector per root serves all parameters (`differentiate_roots`).
module beamid_pole_derivatives
   use beamid_assembly, only: assembly_t, changes, root_t
   use beamid_contours, only: measure
   use beamid_kinds, only: wp
   use beamid_poles, only: is_unresolved, load_on, pair_weight, parameter_values, poles_t
   use beamid_systems, only: solve_adjoint
   use beamid_vectors, only: add_response, solve_coupled, vector_t
   implicit none
   private

   public :: differentiate_poles, differentiate_roots

contains

   !> Computes the derivatives of poles, residues and clusters with respect to the parameters of the
   !> assembly.
   !>
   !> poles  in: the result of `find_poles`; out: `ds`, `dr`, `dimpulse`, `parameters`, `values`
   subroutine differentiate_poles(assembly, poles)
      type(assembly_t), intent(in) :: assembly
      type(poles_t), intent(inout) :: poles
      logical :: wanted(size(poles%s))
      integer :: k, p, n

      n = size(assembly%given%parameters)
      ! The three may have different shapes: `start_from` restores `ds` alone.
      if (allocated(poles%ds)) deallocate (poles%ds)
      if (allocated(poles%dr)) deallocate (poles%dr)
      if (allocated(poles%dimpulse)) deallocate (poles%dimpulse)
      allocate (poles%ds(size(poles%s), n), poles%dr(size(poles%s), n), poles%dimpulse(n))
      do k = 1, size(poles%cluster)
         if (.not. poles%cluster(k)%knows(assembly%given%parameters)) &
            call measure(assembly, poles%cluster(k))
      end do
      poles%parameters = assembly%given%parameters
      poles%values = parameter_values(assembly, assembly%given%parameters)
      if (n == 0) return
      do k = 1, size(poles%s)
         wanted(k) = .not. is_unresolved(assembly, poles%vector(k), poles%s(k))
      end do
      poles%ds = 0
      poles%dr = 0
      do k = 1, size(poles%cluster)
         where (poles%cluster(k)%holds(poles%s)) wanted = .false.
      end do
      call differentiate_roots(assembly, poles%root, poles%vector, wanted, poles%ds, poles%dr)
      do p = 1, n
         do k = 1, size(poles%s)
            poles%dr(k, p) = pair_weight(poles%s(k))*poles%dr(k, p)
         end do
      end do
      do k = 1, size(poles%cluster)
         associate (cluster => poles%cluster(k))
            do p = 1, n
               where (cluster%holds(poles%s))
                  poles%ds(:, p) = cluster%dmean(p)
                  poles%dr(:, p) = 0
               end where
            end do
         end associate
      end do
      call differentiate_impulse(assembly, poles%accelerations, poles%dimpulse)
   end subroutine differentiate_poles

   !> Computes the derivatives of roots and of their residues, each by an adjoint vector.
   !>
   !> With the total derivative Q' = Q_p + (2 s M + C) ds/dp, the eigenvector changes by
   !> x' = -Q**-1 Q'x with x_j' = 0. The change of the residue due to x' is g'x' with a vector g. If
   !> Q z = g with z_j = 0, then g'x' = -z'Q'x. The adjoint vector z consists, like x and y, of the
   !> oscillators z and the rows w, and does not depend on the parameter.
   !>
   !> wanted  (roots) whether the derivatives of a root are computed; others do not change
   !> ds, dr  (roots, parameters) derivatives of the roots and of their residues (not doubled for a
   !>         pair)
   subroutine differentiate_roots(assembly, root, vector, wanted, ds, dr)
      type(assembly_t), intent(in) :: assembly
      type(root_t), intent(in) :: root(:)
      type(vector_t), intent(in) :: vector(:)
      logical, intent(in) :: wanted(:)
      complex(wp), intent(inout) :: ds(:, :), dr(:, :)
      ! Space for one root, allocated once.
      complex(wp), dimension(assembly%layout%n) :: z, dQx, xz
      complex(wp), dimension(assembly%layout%r) :: w, mu, dHy
      complex(wp), dimension(size(assembly%sensitivities%operator)) :: of_xx, of_xz
      complex(wp) :: T(assembly%layout%r, assembly%layout%r)
      real(wp) :: load_rows(assembly%layout%r)
      integer :: k

      do k = 1, size(wanted)
         if (wanted(k)) call differentiate_root()
      end do

   contains

      !> Differentiates root k.
      subroutine differentiate_root()
         complex(wp) :: observed, driven, r, dr_ds, x_Q_x, z_Q_x, factor(changes, 0:2)
         integer :: p

         associate (s => root(k)%s, x => vector(k)%x, y => vector(k)%y, A => vector(k)%A, &
            form => vector(k)%form)
            driven = load_on(assembly, vector(k), s)
            observed = y(assembly%layout%sensor)/A
            r = observed*driven/A
            factor = assembly%oscillators%factors(root(k))
            dQx = vector(k)%dD*x
            if (assembly%is_dense()) dQx(:assembly%layout%beam) = dQx(:assembly%layout%beam) &
               + matmul(assembly%dense%at(factor(:, 1), 0), x(:assembly%layout%beam))
            call find_adjoint(assembly, root(k), vector(k), dQx, observed, driven/A, load_rows, z, &
               w, mu)
            call assembly%products(form, x, y, x, y, xz, T, of_xx)
            call assembly%products(form, x, y, z, w, xz, T, of_xz)
            call differentiate_by_root(assembly, root(k), vector(k), factor(:, 2), dQx, observed, &
               r, z, w, dr_ds, dHy)
            do p = 1, size(ds, 2)
               x_Q_x = assembly%sensitivities%derivative(factor(:, 0), of_xx, p)
               z_Q_x = assembly%sensitivities%derivative(factor(:, 0), of_xz, p) &
                  + r*assembly%sensitivities%derivative(factor(:, 1), of_xx, p)
               if (assembly%is_dense()) then
                  x_Q_x = x_Q_x + assembly%dense%bilinear(factor(:, 0), x, x, p)
                  z_Q_x = z_Q_x + assembly%dense%bilinear(factor(:, 0), x, z, p) &
                     + r*assembly%dense%bilinear(factor(:, 1), x, x, p)
               end if
               call add_changes(p, r, x_Q_x, z_Q_x)
               ds(k, p) = -x_Q_x/A
               dr(k, p) = dr_ds*ds(k, p) - z_Q_x
               if (assembly%load%changes(p)) dr(k, p) = dr(k, p) &
                  + observed*assembly%load%power(form, x, y, s, p)
            end do
         end associate
      end subroutine differentiate_root

      !> Adds what a parameter that changes a compliance or moves points contributes to x'Q_p x and
      !> z'Q_p x.
      !>
      !> r  residue
      subroutine add_changes(p, r, x_Q_x, z_Q_x)
         integer, intent(in) :: p
         complex(wp), intent(in) :: r
         complex(wp), intent(inout) :: x_Q_x, z_Q_x
         complex(wp) :: shift
         integer :: l

         associate (A_p => assembly%couplings%compliance_slope(:, p), &
            moves => assembly%layout%moves(:, p), f => vector(k)%f, y => vector(k)%y)
            if (any(abs(A_p) > 0)) then
               x_Q_x = x_Q_x - sum(A_p*f*y)
               z_Q_x = z_Q_x - sum(A_p*f*w) - r*sum(A_p*y*dHy)
            end if
            do l = 1, size(moves)
               if (.not. abs(moves(l)) > 0) cycle
               ! Change of V'x because the point of the row moves.
               shift = moves(l)*sum(assembly%layout%v_slope(l, :)*vector(k)%x)
               x_Q_x = x_Q_x + 2*shift*f(l)
               z_Q_x = z_Q_x + shift*mu(l) + moves(l)*sum(assembly%layout%v_slope(l, :)*z)*f(l)
            end do
         end associate
      end subroutine add_changes

   end subroutine differentiate_roots

   !> Computes the derivative of a residue with respect to its root: through Q, and through A and F,
   !> which depend on s explicitly.
   !>
   !> factor    (changes) second derivatives of `factors` of the oscillators
   !> dQx       (n) (2 s M + C) x of the oscillators, without the rows
   !> observed  o'x/A
   !> r         residue
   !> z, w      (n), (r) adjoint vector
   !> dr_ds     the derivative
   !> dHy       (r) H'(s) y
   pure subroutine differentiate_by_root(assembly, root, vector, factor, dQx, observed, r, z, w, &
      dr_ds, dHy)
      type(assembly_t), intent(in) :: assembly
      type(root_t), intent(in) :: root
      type(vector_t), intent(in) :: vector
      complex(wp), intent(in) :: factor(changes), dQx(:), observed, r, z(:), w(:)
      complex(wp), intent(out) :: dr_ds, dHy(:)
      complex(wp) :: half_d2H_y
      integer :: i, l, rows

      rows = size(w)
      associate (x => vector%x, y => vector%y, s => root%s, dH => vector%dH, &
         A => assembly%couplings%compliance)
         dr_ds = -sum(dQx*z) - r*(assembly%oscillators%second_derivative(root, x) &
            + assembly%dense%bilinear(factor, x, x, 0))
         do i = 1, rows
            dHy(i) = 0
            half_d2H_y = 0
            do l = 1, rows
               dHy(i) = dHy(i) + dH(i, l)*y(l)
               half_d2H_y = half_d2H_y + vector%half_d2H(i, l)*y(l)
            end do
            dr_ds = dr_ds - A(i)*(w(i)*dHy(i) + 2*r*y(i)*half_d2H_y)
         end do
         if (assembly%load%feels_base) dr_ds = dr_ds &
            - observed*(sum(assembly%load%velocity(:, 0)*x) &
            - 2*sum(assembly%load%base_coupling*vector%f)/s)/s**2
      end associate
   end subroutine differentiate_by_root

   !> Computes the adjoint vector of a root, the solution of Q z = g with z_j = 0. g is the gradient
   !> of the residue with respect to the eigenvector, through o'x, x'F and A.
   !>
   !> dQx               (n) as in `differentiate_by_root`
   !> observed, driven  o'x/A and x'F/A
   !> load_rows         (r) space for the load on the rows
   !> z                 (n) oscillators
   !> w                 (r) rows, as y of an eigenvector
   !> mu                (r) forces along the rows, as f of an eigenvector
   subroutine find_adjoint(assembly, root, vector, dQx, observed, driven, load_rows, z, w, mu)
      type(assembly_t), intent(in) :: assembly
      type(root_t), intent(in) :: root
      type(vector_t), intent(in) :: vector
      complex(wp), intent(in) :: dQx(:), observed, driven
      real(wp), intent(out) :: load_rows(:)
      complex(wp), intent(out) :: z(:), w(:), mu(:)
      integer :: l

      associate (y => vector%y, G => vector%G, H => vector%H, dH => vector%dH)
         w = 0
         if (assembly%load%feels_base) w = observed*assembly%load%base_coupling/root%s**2
         call assembly%load%rows(vector%form, load_rows, 0)
         do l = 1, size(w)
            mu(l) = observed*(load_rows(l) - 2*driven*sum(dH(:, l)*y))
         end do
         mu(assembly%layout%sensor) = mu(assembly%layout%sensor) + driven
         ! z first holds the force on the oscillators.
         z = observed*assembly%load%remainder(:, 0) - 2*observed*driven*dQx
         if (assembly%load%feels_base) z = z + observed*assembly%load%velocity(:, 0)/root%s
         if (assembly%is_dense()) then
            call solve_adjoint(assembly, root, (z), mu, (w), z, w)
            mu = matmul(H, w) - mu
            return
         end if
         z = z*vector%inverse
         do l = 1, size(w)
            w(l) = w(l) + sum(assembly%layout%vt(:, l)*z) + sum(G(:, l)*mu)
         end do
         call solve_coupled(vector, w)
         do l = 1, size(w)
            mu(l) = sum(H(:, l)*w) - mu(l)
         end do
         call add_response(assembly%layout%n, size(w), assembly%layout%vt, mu, vector%inverse, z)
      end associate
   end subroutine find_adjoint

   !> Computes the derivatives of o'M**-1 F: -(M**-1 o)'M_p (M**-1 F), plus the contributions of
   !> points that move and of a load that depends on the parameter.
   !>
   !> accelerations  (n + r, 2) M**-1 F and M**-1 o, as in `poles_t`
   !> slopes  (parameters)
   subroutine differentiate_impulse(assembly, accelerations, slopes)
      type(assembly_t), intent(in) :: assembly
      real(wp), intent(in) :: accelerations(:, :)
      real(wp), intent(out) :: slopes(:)
      real(wp) :: load(assembly%layout%r)
      complex(wp) :: products(size(assembly%sensitivities%operator)), xo(assembly%layout%n), &
         T(assembly%layout%r, assembly%layout%r)
      integer :: n, p

      n = assembly%layout%n
      associate (x => accelerations(:n, 1), yx => accelerations(n + 1:, 1), &
         o => accelerations(:n, 2), yo => accelerations(n + 1:, 2))
         call assembly%products(0, cmplx(x, kind=wp), cmplx(yx, kind=wp), cmplx(o, kind=wp), &
            cmplx(yo, kind=wp), xo, T, products)
         do p = 1, size(slopes)
            call assembly%load%rows(0, load, p)
            slopes(p) = -sum(assembly%sensitivities%change(1, :, p)*real(products)) &
               + sum(assembly%load%remainder(:, p)*o) &
               + sum(load*yo)
            if (any(abs(assembly%layout%moves(:, p)) > 0)) slopes(p) = slopes(p) &
               + change_by_moves(assembly, assembly%layout%moves(:, p), x, yx, o, yo)
         end do
      end associate
   end subroutine differentiate_impulse

   !> Returns the contribution of points that move to the derivative of o'M**-1 F.
   !>
   !> moves  (r) derivatives of the positions of the rows with respect to the parameter
   !> x, yx  (n), (r) M**-1 F, and its motion of the rows
   !> o, yo  (n), (r) M**-1 o, and its motion of the rows
   pure real(wp) function change_by_moves(assembly, moves, x, yx, o, yo) result(change)
      type(assembly_t), intent(in) :: assembly
      real(wp), intent(in) :: moves(:), x(:), yx(:), o(:), yo(:)
      real(wp), dimension(size(moves)) :: load, row_force, shift
      real(wp) :: mass(size(moves), size(moves))

      mass = assembly%couplings%masses()
      call assembly%load%rows(0, load, 0)
      row_force = matmul(mass, yx) - load
      associate (d => assembly%layout%v_slope)
         shift = moves*matmul(d, x)
         change = shift(assembly%layout%sensor) - dot_product(yo, matmul(mass, shift)) &
            - dot_product(moves*matmul(d, o), row_force)
      end associate
   end function change_by_moves

end module beamid_pole_derivatives
