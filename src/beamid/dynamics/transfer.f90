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
   use beamid_assembly, only: assembly_t, changes, root_t
   use beamid_kinds, only: wp
   use beamid_matrices, only: eliminate, identity
   use beamid_systems, only: factor, solve_system => solve, system_at
   use beamid_vectors, only: find_vector, nearest_pole, vector_t
   implicit none
   private

   public :: differentiate_motion, transfer_t, transfer_at

   !> The transfer function at one point, and its derivatives.
   type :: transfer_t
      complex(wp), allocatable :: q(:)         !< (n) motion of the oscillators per unit force
      !> motion of the rows, V'q; for the row of a spring the force, as y in `beamid_vectors`
      complex(wp), allocatable :: u(:)
      complex(wp) :: h = 0                     !< motion of the sensor per unit force, o'q
      complex(wp) :: dlog = 0                  !< W'/W [time]
      complex(wp), allocatable :: dh(:)        !< (parameters) derivatives of h
      complex(wp), allocatable :: dlog_p(:)    !< (parameters) derivatives of log W
      integer :: form = 0                      !< form that `q` refers to, from `form_at`
   end type transfer_t

   !> The parts of Q**-1 that the derivatives of h and log W need.
   type :: inverse_t
      complex(wp), allocatable :: o(:), u(:)     !< (n), (r) Q**-1 o, and its motion of the rows
      complex(wp), allocatable :: diagonal(:)    !< (n) diagonal of Q**-1
      complex(wp), allocatable :: T(:, :)        !< (r, r) A**-1 V'Q**-1 V
      !> (r) derivatives of log W with respect to the compliance of a row and to its position
      complex(wp), allocatable :: by_compliance(:), by_position(:)
      !> (beam, beam) Q**-1 of the beam's oscillators; only if the assembly is dense
      complex(wp), allocatable :: dense(:, :)
   end type inverse_t

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
      type(inverse_t) :: inverse

      value%form = assembly%couplings%form_at(point%s)
      if (.not. allocated(value%q)) allocate (value%q(assembly%layout%n), &
         value%u(assembly%layout%r))
      if (assembly%is_dense()) then
         call invert_dense(assembly, point, value, inverse)
      else
         call invert(assembly, point, with_slopes, value, inverse)
      end if
      value%h = value%u(assembly%layout%sensor)
      if (with_slopes) call differentiate(assembly, point, inverse, value)
   end subroutine transfer_at

   !> Computes the motion, W'/W and Q**-1 of an assembly without dense matrices.
   !>
   !> with_slopes  whether all components of `inverse` are set
   !> value        in: form; out: q, u and dlog
   subroutine invert(assembly, point, with_slopes, value, inverse)
      type(assembly_t), intent(in) :: assembly
      type(root_t), intent(in) :: point
      logical, intent(in) :: with_slopes
      type(transfer_t), intent(inout) :: value
      type(inverse_t), intent(inout) :: inverse
      type(root_t) :: place
      type(vector_t) :: vector
      complex(wp), dimension(assembly%layout%r, assembly%layout%r) :: coupled, E, HE
      complex(wp) :: load(assembly%layout%n), none(assembly%layout%r), w
      integer :: i, r
      logical :: regular

      r = assembly%layout%r
      place = point
      call nearest_pole(assembly, place)
      place = root_t(place%j, point%origin, point%side, point%offset, point%s)
      call find_vector(assembly, place, vector)
      w = vector%D(place%j) + sum(assembly%layout%v(:, place%j)*vector%f)
      E = identity(r)
      coupled = vector%coupled
      call eliminate(r, r, coupled, E, regular)
      if (.not. regular) E = 0
      load = assembly%load%at(place%s, vector%form, assembly%layout%v)
      call solve(assembly, place%j, vector, E, w, load, assembly%load%base_coupling/place%s**2, &
         value%q, value%u)
      HE = matmul(vector%H, E)
      allocate (inverse%o(assembly%layout%n), inverse%u(r), inverse%diagonal(assembly%layout%n), &
         inverse%by_position(r))
      inverse%T = matmul(E, vector%G)
      do i = 1, r
         inverse%T(:, i) = inverse%T(:, i) + vector%y*vector%y(i)*assembly%couplings%compliance(i)/w
      end do
      do i = 1, assembly%layout%n
         inverse%diagonal(i) = vector%x(i)**2/w
         if (i /= place%j) inverse%diagonal(i) = inverse%diagonal(i) + (1 - sum( &
            assembly%layout%v(:, i)*matmul(HE, assembly%layout%v(:, i)))/vector%D(i))/vector%D(i)
      end do
      value%dlog = sum(vector%dD*inverse%diagonal) + sum(vector%dH*inverse%T)
      if (.not. with_slopes) return
      none = 0
      load = assembly%layout%v(assembly%layout%sensor, :)
      call solve(assembly, place%j, vector, E, w, load, none, inverse%o, inverse%u)
      call trace_positions(assembly, place, vector, E, w, inverse%by_position)
      inverse%by_compliance = [(E(i, i) - vector%f(i)*vector%y(i)/w, i=1, r)]
   end subroutine invert

   !> Computes the motion, W'/W and Q**-1 of an assembly with dense matrices, from P(s) of
   !> `beamid_systems` and its inverse.
   !>
   !> value  in: form; out: q, u and dlog
   subroutine invert_dense(assembly, point, value, inverse)
      type(assembly_t), intent(in) :: assembly
      type(root_t), intent(in) :: point
      type(transfer_t), intent(inout) :: value
      type(inverse_t), intent(inout) :: inverse
      complex(wp), dimension(assembly%layout%n + assembly%layout%r, &
         assembly%layout%n + assembly%layout%r) :: P, dP, full
      complex(wp) :: solution(size(P, 1))
      integer :: pivots(size(P, 1)), i, n, r

      n = assembly%layout%n
      r = assembly%layout%r
      call system_at(assembly, point, P, dP)
      call factor(P, pivots)
      full = identity(n + r)
      call solve_system(P, pivots, full, 'N')
      solution = matmul(full, [assembly%load%at(point%s, value%form, assembly%layout%v), &
         -assembly%load%base_coupling/point%s**2])
      value%q = solution(:n)
      value%u = solution(n + 1:)
      value%dlog = sum(transpose(full)*dP)
      solution = matmul(full(:, :n), assembly%layout%v(assembly%layout%sensor, :))
      inverse%o = solution(:n)
      inverse%u = solution(n + 1:)
      inverse%diagonal = [(full(i, i), i=1, n)]
      inverse%T = matmul(full(n + 1:, :n), assembly%layout%vt)
      inverse%by_compliance = [(-full(n + i, n + i), i=1, r)]
      inverse%by_position = [(2*sum(assembly%layout%v_slope(i, :)*full(:n, n + i)), i=1, r)]
      inverse%dense = full(:assembly%layout%beam, :assembly%layout%beam)
   end subroutine invert_dense

   !> Computes the derivatives with respect to the parameters: those of h, and tr(Q**-1 Q_p) of
   !> log W with the contributions of positions.
   !>
   !> value  in: q, u and form; out: dh and dlog_p, too
   subroutine differentiate(assembly, point, inverse, value)
      type(assembly_t), intent(in) :: assembly
      type(root_t), intent(in) :: point
      type(inverse_t), intent(in) :: inverse
      type(transfer_t), intent(inout) :: value
      complex(wp), dimension(size(inverse%T, 1), size(inverse%T, 1)) :: H, dH
      complex(wp) :: traces(size(assembly%sensitivities%operator)), factor(changes, 0:2)
      complex(wp), allocatable :: turned(:, :)
      integer :: p

      if (.not. allocated(value%dh)) allocate (value%dh(size(assembly%given%parameters)), &
         value%dlog_p(size(assembly%given%parameters)))
      call assembly%couplings%evaluate(value%form, point%s, H, dH)
      call differentiate_motion(assembly, point, value%form, H, value%q, value%u, inverse%o, &
         inverse%u, value%dh)
      call assembly%sensitivities%traces(assembly%layout, value%form, inverse%diagonal, inverse%T, &
         traces)
      factor = assembly%oscillators%factors(point)
      if (assembly%is_dense()) turned = transpose(inverse%dense)
      do p = 1, size(assembly%given%parameters)
         value%dlog_p(p) = assembly%sensitivities%derivative(factor(:, 0), traces, p) &
            + sum(assembly%couplings%compliance_slope(:, p)*inverse%by_compliance) &
            + sum(assembly%layout%moves(:, p)*inverse%by_position)
         if (assembly%is_dense()) value%dlog_p(p) = value%dlog_p(p) &
            + assembly%dense%trace(factor(:, 0), turned, p)
      end do
   end subroutine differentiate

   !> Computes the derivatives of h = o'Q**-1 F, -o'Q**-1 Q_p Q**-1 F, with the contributions of
   !> positions and of loads that depend on a parameter.
   !>
   !> form    in which the motions are given, from `form_at`
   !> H       (r, r) couplings at s
   !> q, u    (n), (r) Q**-1 F, and its motion of the rows
   !> o, u_o  (n), (r) Q**-1 o, and its motion of the rows
   !> dh      (parameters)
   subroutine differentiate_motion(assembly, point, form, H, q, u, o, u_o, dh)
      type(assembly_t), intent(in) :: assembly
      type(root_t), intent(in) :: point
      complex(wp), intent(in) :: H(:, :), q(:), u(:), o(:), u_o(:)
      integer, intent(in) :: form
      complex(wp), intent(out) :: dh(:)
      complex(wp) :: products(size(assembly%sensitivities%operator)), row_change(size(u)), &
         factor(changes, 0:2), qo(size(q)), T(size(u), size(u))
      real(wp) :: load_rows(size(u))
      integer :: p

      call assembly%load%rows(form, load_rows, 0)
      call assembly%products(form, q, u, o, u_o, qo, T, products)
      factor = assembly%oscillators%factors(point)
      do p = 1, size(dh)
         associate (moves => assembly%layout%moves(:, p), &
            A_p => assembly%couplings%compliance_slope(:, p))
            dh(p) = -assembly%sensitivities%derivative(factor(:, 0), products, p) &
               - assembly%dense%bilinear(factor(:, 0), q, o, p)
            if (any(abs(A_p) > 0)) dh(p) = dh(p) + sum(A_p*u_o*matmul(H, u))
            if (assembly%load%changes(p)) dh(p) = dh(p) &
               + assembly%load%power(form, o, u_o, point%s, p)
            if (.not. any(abs(moves) > 0)) cycle
            row_change = moves*matmul(assembly%layout%v_slope, q)
            dh(p) = dh(p) + row_change(assembly%layout%sensor) - sum(u_o*matmul(H, row_change)) &
               - sum(moves*matmul(assembly%layout%v_slope, o)*(matmul(H, u) - load_rows))
         end associate
      end do
   end subroutine differentiate_motion

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
      complex(wp), dimension(assembly%layout%n) :: x, no_load
      complex(wp), dimension(size(traces)) :: u_x, extended
      integer :: i

      traces = 0
      no_load = 0
      do i = 1, size(traces)
         if (.not. any(abs(assembly%layout%moves(i, :)) > 0)) cycle
         extended = 0
         extended(i) = 1
         call solve(assembly, place%j, vector, E, w, no_load, extended, x, u_x)
         traces(i) = -2*sum(assembly%layout%v_slope(i, :)*x)
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
      do i = 1, assembly%layout%n
         if (i /= j) u = u + assembly%layout%v(:, i)*load(i)/vector%D(i)
      end do
      u = matmul(E, u)
      f = matmul(vector%H, u)
      modal_force = (sum(vector%x*load) - sum(vector%f*extended))/w
      do i = 1, assembly%layout%n
         q(i) = vector%x(i)*modal_force
         if (i /= j) q(i) = q(i) + (load(i) - sum(assembly%layout%v(:, i)*f))/vector%D(i)
      end do
      u = u + vector%y*modal_force
   end subroutine solve

end module beamid_transfer
