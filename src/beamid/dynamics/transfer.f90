!> What the structure answers at a point s that is no root: with Q = s**2 M + s C + K the motion
!> q = Q**-1 F, the sensor's share h = o'q of it, W'/W = tr Q**-1 Q', and the derivatives of h and
!> of log W with respect to the parameters.
!>
!> With the oscillator j and the vectors of `beamid_vectors`, w = D_j + v_j'f and the rest without
!> oscillator j,
!>
!>     Q**-1 = Q_rest**-1 + x x'/w,    V'Q_rest**-1 V = A (A + G H)**-1 G:
!>
!> near a pole of D_j, as at a root, nothing in it grows without bound.
module beamid_transfer
   use beamid_assembly, only: assembly_t
   use beamid_kinds, only: wp
   use beamid_systems, only: factor, solve_system => solve, system_at
   use beamid_vectors, only: find_vector, most, nearest_pole, root_t, solve_coupled, vector_t
   implicit none
   private

   public :: transfer_t, transfer_at

   type :: transfer_t
      complex(wp), allocatable :: q(:)         !< (n) motion per unit force
      complex(wp) :: u(most) = 0               !< V'q
      complex(wp) :: h = 0                     !< of the sensor
      complex(wp) :: dlog = 0                  !< W'/W [time]
      complex(wp), allocatable :: dh(:)        !< (parameters)
      complex(wp), allocatable :: dlog_p(:)    !< (parameters) d log W/d parameter
      integer :: form = 1                      !< of the pencil, that of `q`
   end type transfer_t

contains

   !> point        its origin is kept: a pole near by, which leaves the distances their digits
   !> with_slopes  whether derivatives are wanted
   subroutine transfer_at(assembly, point, with_slopes, value)
      type(assembly_t), intent(in) :: assembly
      type(root_t), intent(in) :: point
      logical, intent(in) :: with_slopes
      type(transfer_t), intent(inout) :: value
      type(root_t) :: place
      type(vector_t) :: vector
      complex(wp), dimension(size(assembly%v, 1), size(assembly%v, 1)) :: E, T, HE
      complex(wp), dimension(assembly%n) :: o, x, diagonal, load
      complex(wp), dimension(size(assembly%v, 1)) :: u_o, u_x, turned, given, longer, none
      complex(wp) :: w
      integer :: i, r

      if (assembly%is_dense()) then
         call whole_transfer(assembly, point, with_slopes, value)
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
      if (.not. with_slopes) return
      none = 0
      load = assembly%v(assembly%sensor, :)
      call solve(assembly, place%j, vector, E, w, load, none, o, u_o)
      turned = 0
      load = 0
      do i = 1, r
         if (.not. any(abs(assembly%moves(i, :)) > 0)) cycle
         longer = none
         longer(i) = 1
         call solve(assembly, place%j, vector, E, w, load, longer, x, u_x)
         turned(i) = -2*sum(assembly%v_slope(i, :)*x)
      end do
      ! How log W changes with the compliance of a row.
      given = [(E(i, i) - vector%f(i)*vector%y(i)/w, i=1, r)]
      call differentiate(assembly, place%s, o, u_o, diagonal, T, vector%H(:r, :r), turned, given, &
         value)
   end subroutine transfer_at

   !> The same from P(s) of `beamid_systems` and its inverse.
   subroutine whole_transfer(assembly, point, with_slopes, value)
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
   end subroutine whole_transfer

   !> Derivatives with respect to the parameters: -o'Q**-1 Q_p Q**-1 F, tr Q**-1 Q_p, and what a
   !> place that moves or a load that changes adds to them.
   !>
   !> o, u_o       Q**-1 of the sensor's row, and V' of it
   !> diagonal, T  of Q**-1, and A**-1 V'Q**-1 V
   !> turned       (r) tr Q**-1 Q_p as the place of a row moves
   !> given        (r) the same as its compliance grows
   subroutine differentiate(assembly, s, o, u_o, diagonal, T, H, turned, given, value)
      type(assembly_t), intent(in) :: assembly
      complex(wp), intent(in) :: s, o(:), u_o(:), diagonal(:), T(:, :), H(:, :), turned(:), given(:)
      type(transfer_t), intent(inout) :: value
      complex(wp), dimension(size(assembly%changing)) :: moved, trace
      complex(wp) :: seen(size(u_o))
      integer :: p

      if (.not. allocated(value%dh)) allocate (value%dh(size(assembly%parameters)), &
         value%dlog_p(size(assembly%parameters)))
      associate (u => value%u(:size(u_o)), d => assembly%v_slope, form => value%form)
         call assembly%products(form, value%q, u, o, u_o, moved)
         trace = assembly%traces(form, diagonal, T)
         do p = 1, size(assembly%parameters)
            associate (moves => assembly%moves(:, p), A_p => assembly%compliance_slope(:, p))
               value%dh(p) = -assembly%varied(moved, s, p) + sum(A_p*u_o*matmul(H, u)) &
                  + assembly%load_change(form, o, u_o, s, p)
               value%dlog_p(p) = assembly%varied(trace, s, p) + sum(A_p*given)
               if (.not. any(abs(moves) > 0)) cycle
               seen = moves*matmul(d, value%q)
               value%dh(p) = value%dh(p) + seen(assembly%sensor) - sum(u_o*matmul(H, seen)) &
                  - sum(moves*matmul(d, o)*(matmul(H, u) - assembly%push(:, form)))
               value%dlog_p(p) = value%dlog_p(p) + sum(moves*turned)
            end associate
         end do
      end associate
   end subroutine differentiate

   !> q = Q**-1 F and u = V'q, of a row that is longer or held what `beamid_vectors` has it be.
   !>
   !> E       (A + G H)**-1
   !> load    (n)
   !> longer  (r) by which rows are longer than what the oscillators make of them
   subroutine solve(assembly, j, vector, E, w, load, longer, q, u)
      type(assembly_t), intent(in) :: assembly
      integer, intent(in) :: j
      type(vector_t), intent(in) :: vector
      complex(wp), intent(in) :: E(:, :), w, load(:), longer(:)
      complex(wp), intent(out) :: q(:), u(:)
      complex(wp) :: f(size(u)), driven
      integer :: i, r

      r = size(u)
      u = longer
      do i = 1, assembly%n
         if (i /= j) u = u + assembly%v(:, i)*load(i)/vector%D(i)
      end do
      u = matmul(E, u)
      f = matmul(vector%H(:r, :r), u)
      driven = (sum(vector%x*load) - sum(vector%f(:r)*longer))/w
      do i = 1, assembly%n
         q(i) = vector%x(i)*driven
         if (i /= j) q(i) = q(i) + (load(i) - sum(assembly%v(:, i)*f))/vector%D(i)
      end do
      u = u + vector%y(:r)*driven
   end subroutine solve

end module beamid_transfer
