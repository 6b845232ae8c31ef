!> Derivatives of poles and residues with respect to the parameters.
!>
!> Notation: Q(s) = s**2 M + s C + K + i L; x is the eigenvector of the root s,
!> A = x'(2 s M + C) x; o is the sensor's row. The index p is the derivative with respect to a
!> parameter at constant s.
!>
!>     ds/dp = -x'Q_p x/A
!>
!> The residue r = (o'x)(x'F)/A depends on p through s, x, o, F and M, C. The derivative of x
!> itself is not needed: one adjoint vector per root serves all parameters (`differentiate_root`).
module beamid_pole_derivatives
   use beamid_assembly, only: assembly_t, changes, root_t
   use beamid_contours, only: measure
   use beamid_kinds, only: wp
   use beamid_poles, only: is_unresolved, load_on, pair_weight, parameter_values, poles_t
   use beamid_systems, only: solve_adjoint
   use beamid_vectors, only: add_response, solve_coupled, vector_t
   implicit none
   private

   public :: differentiate_poles, differentiate_root

contains

   !> Computes the derivatives of poles, residues and clusters with respect to the parameters of the
   !> assembly.
   !>
   !> poles  in: the result of `find_poles`; out: `ds`, `dr`, `dimpulse`, `parameters`, `values`
   subroutine differentiate_poles(assembly, poles)
      type(assembly_t), intent(in) :: assembly
      type(poles_t), intent(inout) :: poles
      complex(wp), dimension(size(assembly%given%parameters)) :: ds, dr
      integer :: k, p, n

      n = size(assembly%given%parameters)
      if (allocated(poles%ds)) deallocate (poles%ds, poles%dr, poles%dimpulse)
      allocate (poles%ds(size(poles%s), n), poles%dr(size(poles%s), n), poles%dimpulse(n))
      do k = 1, size(poles%cluster)
         if (.not. poles%cluster(k)%knows(assembly%given%parameters)) &
            call measure(assembly, poles%cluster(k))
      end do
      poles%parameters = assembly%given%parameters
      poles%values = parameter_values(assembly, assembly%given%parameters)
      if (n == 0) return
      do k = 1, size(poles%s)
         if (any(poles%cluster%holds(poles%s(k)))) cycle
         if (is_unresolved(assembly, poles%vector(k), poles%s(k))) then
            poles%ds(k, :) = 0
            poles%dr(k, :) = 0
         else
            call differentiate_root(assembly, poles%root(k), poles%vector(k), ds, dr)
            poles%ds(k, :) = ds
            poles%dr(k, :) = pair_weight(poles%s(k))*dr
         end if
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

   !> Computes the derivatives of one root and of its residue by an adjoint vector.
   !>
   !> With the total derivative Q' = Q_p + (2 s M + C) ds/dp, the eigenvector changes by
   !> x' = -Q**-1 Q'x with x_j' = 0. The change of the residue due to x' is g'x' with a vector g. If
   !> Q z = g with z_j = 0, then g'x' = -z'Q'x. The adjoint vector z consists, like x and y, of the
   !> oscillators z and the rows w, and does not depend on the parameter.
   !>
   !> ds, dr  (parameters) derivatives of the root and of its residue (not doubled for a pair)
   subroutine differentiate_root(assembly, root, vector, ds, dr)
      type(assembly_t), intent(in) :: assembly
      type(root_t), intent(in) :: root
      type(vector_t), intent(in) :: vector
      complex(wp), intent(out) :: ds(:), dr(:)
      complex(wp) :: of_oscillators(assembly%layout%n, 2), of_rows(assembly%layout%r, 4)
      complex(wp) :: of_operators(size(assembly%sensitivities%operator), 2)
      complex(wp) :: observed, driven, r, dr_ds, x_Q_x, z_Q_x, factor(changes, 0:2)
      integer :: p, l, rows

      rows = assembly%layout%r
      associate (x => vector%x, y => vector%y, f => vector%f, s => root%s, &
         form => vector%form, z => of_oscillators(:, 1), dQx => of_oscillators(:, 2), &
         xx => of_operators(:, 1), xz => of_operators(:, 2), w => of_rows(:, 1), &
         mu => of_rows(:, 2), dHy => of_rows(:, 3), shift => of_rows(:, 4))
         driven = load_on(assembly, vector, s)
         observed = y(assembly%layout%sensor)/vector%A
         r = observed*driven/vector%A
         factor = assembly%oscillators%factors(root)
         dQx = vector%dD*x
         if (assembly%is_dense()) dQx(:assembly%layout%beam) = dQx(:assembly%layout%beam) &
            + matmul(assembly%dense%at(factor(:, 1), 0), x(:assembly%layout%beam))
         call find_adjoint(assembly, root, vector, dQx, observed, driven/vector%A, z, w, mu)
         call assembly%products(form, x, y, x, y, xx)
         call assembly%products(form, x, y, z, w, xz)
         call differentiate_by_root(assembly, root, vector, factor(:, 2), dQx, observed, r, z, w, &
            dr_ds, dHy)
         do p = 1, size(ds)
            associate (A_p => assembly%couplings%compliance_slope(:, p), &
               moves => assembly%layout%moves(:, p))
               x_Q_x = assembly%sensitivities%derivative(factor(:, 0), xx, p)
               z_Q_x = assembly%sensitivities%derivative(factor(:, 0), xz, p) &
                  + r*assembly%sensitivities%derivative(factor(:, 1), xx, p)
               if (assembly%is_dense()) then
                  x_Q_x = x_Q_x + assembly%dense%bilinear(factor(:, 0), x, x, p)
                  z_Q_x = z_Q_x + assembly%dense%bilinear(factor(:, 0), x, z, p) &
                     + r*assembly%dense%bilinear(factor(:, 1), x, x, p)
               end if
               if (any(abs(A_p) > 0)) then
                  x_Q_x = x_Q_x - sum(A_p*f*y)
                  z_Q_x = z_Q_x - sum(A_p*f*w) - r*sum(A_p*y*dHy)
               end if
               if (any(abs(moves) > 0)) then
                  ! Change of V'x because the points of the rows move.
                  shift = 0
                  do l = 1, rows
                     if (abs(moves(l)) > 0) shift(l) = moves(l)*sum(assembly%layout%v_slope(l, :)*x)
                  end do
                  x_Q_x = x_Q_x + 2*sum(shift*f)
                  z_Q_x = z_Q_x + sum(shift*mu) + sum(moves*matmul(assembly%layout%v_slope, z)*f)
               end if
               ds(p) = -x_Q_x/vector%A
               dr(p) = dr_ds*ds(p) - z_Q_x
               if (assembly%load%changes(p)) dr(p) = dr(p) &
                  + observed*assembly%load%power(form, x, y, s, p)
            end associate
         end do
      end associate
   end subroutine differentiate_root

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
      complex(wp) :: hmy
      integer :: i, l, rows

      rows = size(w)
      associate (x => vector%x, y => vector%y, s => root%s, dH => vector%dH, &
         A => assembly%couplings%compliance)
         dr_ds = -sum(dQx*z) - r*(assembly%oscillators%second_derivative(root, x) &
            + assembly%dense%bilinear(factor, x, x, 0))
         do i = 1, rows
            dHy(i) = 0
            hmy = 0
            do l = 1, rows
               dHy(i) = dHy(i) + dH(i, l)*y(l)
               hmy = hmy + vector%hm(i, l)*y(l)
            end do
            dr_ds = dr_ds - A(i)*(w(i)*dHy(i) + 2*r*y(i)*hmy)
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
   !> z                 (n) oscillators
   !> w                 (r) rows, as y of an eigenvector
   !> mu                (r) forces along the rows, as f of an eigenvector
   subroutine find_adjoint(assembly, root, vector, dQx, observed, driven, z, w, mu)
      type(assembly_t), intent(in) :: assembly
      type(root_t), intent(in) :: root
      type(vector_t), intent(in) :: vector
      complex(wp), intent(in) :: dQx(:), observed, driven
      complex(wp), intent(out) :: z(:), w(:), mu(:)
      complex(wp) :: force(size(z))
      real(wp) :: load_rows(size(w))
      integer :: l

      associate (y => vector%y, G => vector%G, H => vector%H, dH => vector%dH)
         w = 0
         if (assembly%load%feels_base) w = observed*assembly%load%base_coupling/root%s**2
         call assembly%load%rows(vector%form, load_rows, 0)
         do l = 1, size(w)
            mu(l) = observed*(load_rows(l) - 2*driven*sum(dH(:, l)*y))
         end do
         mu(assembly%layout%sensor) = mu(assembly%layout%sensor) + driven
         force = observed*assembly%load%remainder(:, 0) - 2*observed*driven*dQx
         if (assembly%load%feels_base) force = force &
            + observed*assembly%load%velocity(:, 0)/root%s
         if (assembly%is_dense()) then
            call solve_adjoint(assembly, root, force, mu, (w), z, w)
            mu = matmul(H, w) - mu
            return
         end if
         z = force*vector%inverse
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
      real(wp), dimension(assembly%layout%r) :: load, row_force, shift
      real(wp) :: hm(assembly%layout%r, assembly%layout%r)
      complex(wp) :: products(size(assembly%sensitivities%operator))
      integer :: n, p

      n = assembly%layout%n
      associate (x => accelerations(:n, 1), yx => accelerations(n + 1:, 1), &
         o => accelerations(:n, 2), yo => accelerations(n + 1:, 2), d => assembly%layout%v_slope)
         call assembly%products(0, cmplx(x, kind=wp), cmplx(yx, kind=wp), cmplx(o, kind=wp), &
            cmplx(yo, kind=wp), products)
         do p = 1, size(slopes)
            call assembly%load%rows(0, load, p)
            associate (moves => assembly%layout%moves(:, p))
               slopes(p) = -sum(assembly%sensitivities%change(1, :, p)*real(products)) &
                  + sum(assembly%load%remainder(:, p)*o) &
                  + sum(load*yo)
               if (.not. any(abs(moves) > 0)) cycle
               hm = assembly%couplings%masses()
               call assembly%load%rows(0, load, 0)
               row_force = matmul(hm, yx) - load
               shift = moves*matmul(d, x)
               slopes(p) = slopes(p) + shift(assembly%layout%sensor) &
                  - dot_product(yo, matmul(hm, shift)) - dot_product(moves*matmul(d, o), row_force)
            end associate
         end do
      end associate
   end subroutine differentiate_impulse

end module beamid_pole_derivatives
