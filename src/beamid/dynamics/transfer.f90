!> The transfer function of the structure at a point s that is not a root, for contour integrals.
!>
!> With Q = s**2 M + s C + K, `transfer_at` computes the motion q = Q**-1 F, the sensor's motion
!> h = o'q, the logarithmic derivative of the characteristic function W = det Q,
!> W'/W = tr(Q**-1 Q'), and the derivatives of h and log W with respect to the parameters.
!>
!> With the oscillator j and the quantities of `beamid_vectors`, w = D_j + v_j'f, and Q_rest, which
!> is Q without oscillator j,
!>
!>     Q**-1 = Q_rest**-1 + x x'/w,    V'Q_rest**-1 V = A (A + G H)**-1 G.
!>
!> These quantities stay bounded near a root of D_j and near a root of the structure.
module beamid_transfer
   use beamid_assembly, only: assembly_t
   use beamid_kinds, only: wp
   use beamid_systems, only: factor, solve_system => solve, system_at
   use beamid_vectors, only: find_vector, most, nearest_pole, root_t, solve_coupled, vector_t
   implicit none
   private

   public :: transfer_t, transfer_at

   !> The transfer function at one point, and its derivatives.
   type :: transfer_t
      complex(wp), allocatable :: q(:)         !< (n) motion of the oscillators per unit force
      !> motion of the rows, V'q; for the row of a spring the force, as y in `beamid_vectors`
      complex(wp) :: u(most) = 0
      complex(wp) :: h = 0                     !< motion of the sensor per unit force, o'q
      complex(wp) :: dlog = 0                  !< W'/W [time]
      complex(wp), allocatable :: dh(:)        !< (parameters) derivatives of h
      complex(wp), allocatable :: dlog_p(:)    !< (parameters) derivatives of log W
      integer :: form = 1                      !< form of the pencil that `q` refers to, 1 or 2
   end type transfer_t

contains

   !> Computes the transfer function at one point.
   !>
   !> point        the point s; its origin is kept, a pole near s, which keeps the digits of the
   !>              distances from the poles
   !> with_slopes  whether the derivatives with respect to the parameters are computed
   subroutine transfer_at(assembly, point, with_slopes, value)
      type(assembly_t), intent(in) :: assembly
      type(root_t), intent(in) :: point
      logical, intent(in) :: with_slopes
      type(transfer_t), intent(inout) :: value
      type(root_t) :: place
      type(vector_t) :: vector
      complex(wp), dimension(size(assembly%v, 1), size(assembly%v, 1)) :: E, T, HE
      complex(wp), dimension(assembly%n) :: diagonal, load
      complex(wp) :: w
      integer :: i, r

      if (assembly%is_dense()) then
         call dense_transfer(assembly, point, with_slopes, value)
         return
      end if
      r = size(assembly%v, 1)
      place = point
      call nearest_pole(assembly, place)
      place = root_t(place%j, point%origin, point%side, point%offset, point%s)
      call find_vector(assembly, place, vector)
      w = vector%D(place%j) + sum(assembly%v(:, place%j)*vector%f(:r))
      E = 0
      do i = 1, r
         E(i, i) = 1
         call solve_coupled(assembly, vector, E(:, i))
      end do
      value%form = vector%form
      if (.not. allocated(value%q)) allocate (value%q(assembly%n))
      load = assembly%load_at(place%s, vector%form)
      call solve(assembly, place%j, vector, E, w, load, assembly%base_coupling/place%s**2, &
         value%q, value%u(:r))
      value%h = value%u(assembly%sensor)

      ! A**-1 V'Q**-1 V and the diagonal of Q**-1.
      T = matmul(E, vector%G(:r, :r))
      HE = matmul(vector%H(:r, :r), E)
      do i = 1, r
         T(:, i) = T(:, i) + vector%y(:r)*vector%y(i)*assembly%compliance(i)/w
      end do
      do i = 1, assembly%n
         diagonal(i) = vector%x(i)**2/w
         if (i /= place%j) diagonal(i) = diagonal(i) + (1 - sum(assembly%v(:, i) &
            *matmul(HE, assembly%v(:, i)))/vector%D(i))/vector%D(i)
      end do
      value%dlog = sum(vector%dD*diagonal) + sum(vector%dH(:r, :r)*T)
      if (with_slopes) call differentiate(assembly, place, vector, E, w, diagonal, T, value)
   end subroutine transfer_at

   !> Computes the transfer function (arguments of `transfer_at`) of an assembly with dense
   !> matrices, from P(s) of `beamid_systems` and its inverse.
   subroutine dense_transfer(assembly, point, with_slopes, value)
      type(assembly_t), intent(in) :: assembly
      type(root_t), intent(in) :: point
      logical, intent(in) :: with_slopes
      type(transfer_t), intent(inout) :: value
      complex(wp), dimension(assembly%n + size(assembly%v, 1), assembly%n &
         + size(assembly%v, 1)) :: P, dP, inverse, P_p
      complex(wp) :: load(size(P, 1))
      integer :: pivots(size(P, 1)), i, k, n

      n = assembly%n
      associate (s => point%s, v => assembly%v, v_p => assembly%v_slope)
         value%form = assembly%form_at(s)
         call system_at(assembly, point, P, dP)
         call factor(P, pivots)
         inverse = 0
         do i = 1, size(P, 1)
            inverse(i, i) = 1
         end do
         call solve_system(P, pivots, inverse, 'N')
         load(:n) = assembly%load_at(s, value%form)
         load(n + 1:) = -assembly%base_coupling/s**2
         load = matmul(inverse, load)
         value%q = load(:n)
         value%u(:size(v, 1)) = load(n + 1:)
         value%h = value%u(assembly%sensor)
         value%dlog = sum(transpose(inverse)*dP)
         if (.not. with_slopes) return
         if (.not. allocated(value%dh)) allocate (value%dh(size(assembly%parameters)), &
            value%dlog_p(size(assembly%parameters)))
         associate (o => inverse(n + assembly%sensor, :), pencil => assembly%pencil(value%form), &
            b => assembly%beam)
            do k = 1, size(assembly%parameters)
               associate (slope => assembly%slope(value%form, k), moves => assembly%moves(:, k))
                  P_p = 0
                  P_p(:b, :b) = assembly%dense_slope(:, :, 1, k)*s &
                     + assembly%dense_slope(:, :, 2, k)
                  do i = 1, n
                     P_p(i, i) = P_p(i, i) + (slope%m(i)*s + slope%c(i))*s + slope%k(i)
                  end do
                  P_p(n + 1:, :n) = spread(moves, 2, n)*v_p
                  P_p(:n, n + 1:) = matmul(transpose(v), (slope%hm*s + slope%hc)*s + slope%hk) &
                     + matmul(transpose(real(P_p(n + 1:, :n))), (pencil%hm*s + pencil%hc)*s &
                     + pencil%hk)
                  do i = 1, size(v, 1)
                     P_p(n + i, n + i) = -assembly%compliance_slope(i, k)
                  end do
                  value%dlog_p(k) = sum(transpose(inverse)*P_p)
                  value%dh(k) = -sum(o*matmul(P_p, load)) &
                     + assembly%load_change(value%form, o(:n), matmul(v, o(:n)), s, k) &
                     + sum(assembly%push(:, value%form)*moves*matmul(v_p, o(:n)))
               end associate
            end do
         end associate
      end associate
   end subroutine dense_transfer

   !> Computes the derivatives with respect to the parameters: -o'Q**-1 Q_p Q**-1 F of h and
   !> tr(Q**-1 Q_p) of log W, with the contributions of positions and loads that depend on a
   !> parameter.
   !>
   !> place     the point, with the oscillator j of `vector`
   !> vector    x, y, f, G and H at the point
   !> E, w      (r, r) (A + G H)**-1, and D_j + v_j'f
   !> diagonal  (n) diagonal of Q**-1
   !> T         (r, r) A**-1 V'Q**-1 V
   !> value     in: q, u and form; out: dh and dlog_p, too
   subroutine differentiate(assembly, place, vector, E, w, diagonal, T, value)
      type(assembly_t), intent(in) :: assembly
      type(root_t), intent(in) :: place
      type(vector_t), intent(in) :: vector
      complex(wp), intent(in) :: E(:, :), w, diagonal(:), T(:, :)
      type(transfer_t), intent(inout) :: value
      complex(wp) :: o(assembly%n)
      complex(wp), dimension(size(E, 1)) :: u_o, position_trace, compliance_trace, none, row_change
      complex(wp), dimension(size(assembly%changing)) :: products, traces
      integer :: i, p

      none = 0
      call solve(assembly, place%j, vector, E, w, cmplx(assembly%v(assembly%sensor, :), kind=wp), &
         none, o, u_o)
      call trace_positions(assembly, place, vector, E, w, position_trace)
      compliance_trace = [(E(i, i) - vector%f(i)*vector%y(i)/w, i=1, size(E, 1))]
      if (.not. allocated(value%dh)) allocate (value%dh(size(assembly%parameters)), &
         value%dlog_p(size(assembly%parameters)))
      associate (u => value%u(:size(E, 1)), H => vector%H, s => place%s, &
         v_x => assembly%v_slope, form => value%form)
         call assembly%products(form, value%q, u, o, u_o, products)
         traces = assembly%traces(form, diagonal, T)
         do p = 1, size(assembly%parameters)
            associate (moves => assembly%moves(:, p), A_p => assembly%compliance_slope(:, p))
               value%dh(p) = -assembly%varied(products, s, p) + sum(A_p*u_o*matmul(H, u)) &
                  + assembly%load_change(form, o, u_o, s, p)
               value%dlog_p(p) = assembly%varied(traces, s, p) + sum(A_p*compliance_trace)
               if (.not. any(abs(moves) > 0)) cycle
               row_change = moves*matmul(v_x, value%q)
               value%dh(p) = value%dh(p) + row_change(assembly%sensor) &
                  - sum(u_o*matmul(H, row_change)) &
                  - sum(moves*matmul(v_x, o)*(matmul(H, u) - assembly%push(:, form)))
               value%dlog_p(p) = value%dlog_p(p) + sum(moves*position_trace)
            end associate
         end do
      end associate
   end subroutine differentiate

   !> Computes the derivatives of log W with respect to the positions of the rows of V,
   !> 2 (dv_i/dx)'Q**-1 times the coupling of row i.
   !>
   !> traces  (r) derivatives with respect to the position on the mesh; 0 for rows that no parameter
   !>         moves [1/length]
   subroutine trace_positions(assembly, place, vector, E, w, traces)
      type(assembly_t), intent(in) :: assembly
      type(root_t), intent(in) :: place
      type(vector_t), intent(in) :: vector
      complex(wp), intent(in) :: E(:, :), w
      complex(wp), intent(out) :: traces(:)
      complex(wp), dimension(assembly%n) :: x, no_load
      complex(wp), dimension(size(traces)) :: u_x, extended
      integer :: i

      traces = 0
      no_load = 0
      do i = 1, size(traces)
         if (.not. any(abs(assembly%moves(i, :)) > 0)) cycle
         extended = 0
         extended(i) = 1
         call solve(assembly, place%j, vector, E, w, no_load, extended, x, u_x)
         traces(i) = -2*sum(assembly%v_slope(i, :)*x)
      end do
   end subroutine trace_positions

   !> Solves Q q = F, with u = V'q; for the row of a spring u is the force, as y in
   !> `beamid_vectors`.
   !>
   !> j         oscillator of the vector
   !> E, w      (r, r) (A + G H)**-1, and D_j + v_j'f
   !> load      (n) F
   !> extended  (r) prescribed motion of the rows, in addition to that of the oscillators
   !> q, u      (n), (r) the solution
   subroutine solve(assembly, j, vector, E, w, load, extended, q, u)
      type(assembly_t), intent(in) :: assembly
      integer, intent(in) :: j
      type(vector_t), intent(in) :: vector
      complex(wp), intent(in) :: E(:, :), w, load(:), extended(:)
      complex(wp), intent(out) :: q(:), u(:)
      complex(wp) :: f(size(u)), modal_force
      integer :: i, r

      r = size(u)
      u = extended
      do i = 1, assembly%n
         if (i /= j) u = u + assembly%v(:, i)*load(i)/vector%D(i)
      end do
      u = matmul(E, u)
      f = matmul(vector%H(:r, :r), u)
      modal_force = (sum(vector%x*load) - sum(vector%f(:r)*extended))/w
      do i = 1, assembly%n
         q(i) = vector%x(i)*modal_force
         if (i /= j) q(i) = q(i) + (load(i) - sum(assembly%v(:, i)*f))/vector%D(i)
      end do
      u = u + vector%y(:r)*modal_force
   end subroutine solve

end module beamid_transfer
