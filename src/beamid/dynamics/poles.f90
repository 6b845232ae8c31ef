!> Poles and residues of the sensor's response, and their derivatives with respect to the
!> parameters.
!>
!> With the vector x of a root s and A = x'(2 s M + C) x the residue is (o'x)(x'F)/A, o the observer,
!> and ds/dp = -x'(s**2 M_p + s C_p + K_p) x/A. The vector's own derivative follows from the
!> equations of `beamid_vectors` with the root as a function of p.
module beamid_poles
   use beamid_assembly, only: assembly_t
   use beamid_errors, only: error_t, failure
   use beamid_kinds, only: wp
   use beamid_modes, only: beam_modes_t
   use beamid_roots, only: find_roots
   use beamid_strings, only: to_text
   use beamid_structure, only: of_x_S
   use beamid_vectors, only: couplings, find_vector, root_t, solve_coupled, solve_mass, vector_t
   implicit none
   private

   public :: poles_t, find_poles, differentiate_poles

   type :: poles_t
      !> one of each complex pair, Im s > 0, and the real ones
      type(root_t), allocatable :: root(:)
      type(root_t), allocatable :: all(:)         !< every root, to start the next search from
      complex(wp), allocatable :: s(:)            !< positions of `root` [1/time]
      !> r, doubled for the pairs: Re(sum r e**(s t)) is the answer
      complex(wp), allocatable :: residue(:)
      !> sum r s = o' M**-1 F: the acceleration at unit force
      real(wp) :: impulse = 0
      complex(wp), allocatable :: ds(:, :)        !< (poles, parameters) d s/d parameter
      complex(wp), allocatable :: dr(:, :)        !< (poles, parameters) d residue/d parameter
      real(wp), allocatable :: dimpulse(:)        !< (parameters)
      real(wp) :: ordinary = 0                    !< size of an ordinary residue
      type(vector_t), allocatable :: vector(:)    !< of each root
   end type poles_t

   !> The residues of all poles add up to nothing. Where two roots come together each residue grows
   !> without bound, and what their sum leaves is the error of the response, relative to the size of
   !> an ordinary residue: so much is allowed, of a response and of a derivative.
   real(wp), parameter :: max_rest = 1e-8_wp, max_rest_of_derivatives = 1e-6_wp

contains

   !> poles  in: `all` of a structure much like this one, or nothing
   !> error  the iteration does not converge, two roots coincide, or a root was missed
   subroutine find_poles(assembly, modes, poles, error)
      type(assembly_t), intent(in) :: assembly
      type(beam_modes_t), intent(in) :: modes
      type(poles_t), intent(inout) :: poles
      type(error_t), allocatable, intent(out) :: error
      logical :: warm

      warm = allocated(poles%all)
      call find_roots(assembly, modes, poles%all, poles%root, error)
      if (.not. allocated(error)) call residues(assembly, poles, error)
      if (.not. (allocated(error) .and. warm)) return
      ! The roots of the other structure led astray.
      deallocate (poles%all, error)
      call find_roots(assembly, modes, poles%all, poles%root, error)
      if (.not. allocated(error)) call residues(assembly, poles, error)
      if (allocated(error) .and. allocated(poles%all)) deallocate (poles%all)
   end subroutine find_poles

   !> Residues, and the checks that no root is double or missing: the residues add up to zero, and
   !> r s to the acceleration that a unit force causes at once.
   subroutine residues(assembly, poles, error)
      type(assembly_t), intent(in) :: assembly
      type(poles_t), intent(inout) :: poles
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: condition, worst, x(assembly%n), y(size(assembly%v, 1))
      integer :: k, worst_k

      worst = 0
      worst_k = 1
      poles%s = poles%root%s
      if (allocated(poles%residue)) then
         if (size(poles%residue) /= size(poles%s)) deallocate (poles%vector, poles%residue)
      end if
      if (.not. allocated(poles%residue)) allocate (poles%vector(size(poles%s)), &
         poles%residue(size(poles%s)))
      do k = 1, size(poles%s)
         call find_vector(assembly, poles%root(k), poles%vector(k))
         associate (vector => poles%vector(k))
            condition = vector%size_A/max(abs(vector%A), tiny(1.0_wp))
            if (condition > worst) then
               worst = condition
               worst_k = k
            end if
            poles%residue(k) = weight(poles%s(k))*vector%y(assembly%sensor) &
               *sum(assembly%load*vector%x)/vector%A
         end associate
      end do
      call solve_mass(assembly, assembly%load, x, y)
      poles%impulse = y(assembly%sensor)
      poles%ordinary = dot_product(assembly%load, x)
      call solve_mass(assembly, assembly%v(assembly%sensor, :), x, y)
      poles%ordinary = sqrt(poles%ordinary*y(assembly%sensor)) &
         /minval(abs(poles%s), mask=abs(poles%s) > 0)
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

   !> Derivatives of poles and residues with respect to the parameters of the assembly.
   !>
   !> error  two roots nearly coincide: derivatives lose more digits than the response does
   subroutine differentiate_poles(assembly, poles, error)
      type(assembly_t), intent(in) :: assembly
      type(poles_t), intent(inout) :: poles
      type(error_t), allocatable, intent(out) :: error
      integer :: k, p, n

      n = size(assembly%parameters)
      if (allocated(poles%ds)) deallocate (poles%ds, poles%dr, poles%dimpulse)
      allocate (poles%ds(size(poles%s), n), poles%dr(size(poles%s), n), poles%dimpulse(n))
      if (n == 0) return
      do k = 1, size(poles%s)
         do p = 1, n
            call differentiate_root(assembly, poles%root(k), poles%vector(k), p, poles%ds(k, p), &
               poles%dr(k, p))
         end do
         poles%dr(k, :) = weight(poles%s(k))*poles%dr(k, :)
      end do
      call differentiate_impulse(assembly, poles%dimpulse)
      do p = 1, n
         if (abs(sum(real(poles%dr(:, p))))*assembly%structure%get(assembly%parameters(p)) <= &
            max_rest_of_derivatives*poles%ordinary) cycle
         call failure(error, &
            'modal: two roots nearly coincide, too near for exact derivatives; '// &
            'method = ''cvode'' has no such limit')
      end do
   end subroutine differentiate_poles

   !> ds/dp and dr/dp of one root: every quantity of `beamid_vectors` differentiated in turn, with
   !> the root as a function of p.
   subroutine differentiate_root(assembly, root, vector, p, ds, dr)
      type(assembly_t), intent(in) :: assembly
      type(root_t), intent(in) :: root
      type(vector_t), intent(in) :: vector
      integer, intent(in) :: p
      complex(wp), intent(out) :: ds, dr
      complex(wp), dimension(assembly%n) :: D_p, D_sp, D_all, D_s_all, x_all
      complex(wp), dimension(size(assembly%v, 1), size(assembly%v, 1)) :: H_p, H_sp, H_all
      complex(wp) :: y_all(size(assembly%v, 1), 1), f_all(size(assembly%v, 1)), A_all
      complex(wp) :: driven
      logical :: moves
      integer :: r

      r = size(assembly%v, 1)
      associate (pencil => assembly%pencil(vector%form), &
         slope => assembly%slope(vector%form, p), x => vector%x, &
         y => vector%y(:r), f => vector%f(:r), D => vector%D, v => assembly%v, j => root%j, &
         G => vector%G(:r, :r), H => vector%H(:r, :r), dH => vector%dH(:r, :r))
         moves = assembly%parameters(p) == of_x_S
         D_p = (slope%m*root%s + slope%c)*root%s + slope%k
         D_sp = 2*slope%m*root%s + slope%c
         call couplings(slope, root%s, H_p, H_sp)
         ds = sum(D_p*x**2) + sum(y*matmul(H_p, y))
         if (moves) ds = ds &
            + 2*sum(assembly%sensor_slope*x)*f(assembly%sensor)
         ds = -ds/vector%A

         D_all = vector%dD*ds + D_p
         D_s_all = 2*pencil%m*ds + D_sp
         H_all = dH*ds + H_p
         x_all = x*D_all
         x_all(j) = 0
         x_all(:j - 1) = x_all(:j - 1)/D(:j - 1)
         x_all(j + 1:) = x_all(j + 1:)/D(j + 1:)
         y_all(:, 1) = -matmul(v, x_all) - matmul(G, matmul(H_all, y))
         if (moves) call move_sensor(y_all(:, 1))
         call solve_coupled(G, H, y_all)
         f_all = matmul(H_all, y) + matmul(H, y_all(:, 1))
         x_all = -x*D_all - matmul(f_all, v)
         if (moves) x_all = x_all &
            - assembly%sensor_slope*f(assembly%sensor)
         x_all(j) = 0
         x_all(:j - 1) = x_all(:j - 1)/D(:j - 1)
         x_all(j + 1:) = x_all(j + 1:)/D(j + 1:)
         A_all = sum(D_s_all*x**2 + 2*vector%dD*x*x_all) &
            + 2*sum(y_all(:, 1)*matmul(dH, y)) &
            + sum(y*matmul(2*pencil%hm*ds + H_sp, y))

         driven = sum(assembly%load*x)
         associate (seen => y(assembly%sensor), dseen => y_all(assembly%sensor, 1))
            dr = (dseen*driven + seen*sum(assembly%load*x_all) - seen*driven/vector%A*A_all) &
               /vector%A
         end associate
      end associate

   contains

      !> What the columns of V that change add to the right-hand side of y.
      subroutine move_sensor(right)
         complex(wp), intent(inout) :: right(:)
         complex(wp) :: term(assembly%n)

         associate (sensor => assembly%sensor, slope => assembly%sensor_slope, j => root%j)
            term = slope*vector%f(sensor)
            term(j) = 0
            term(:j - 1) = term(:j - 1)/vector%D(:j - 1)
            term(j + 1:) = term(j + 1:)/vector%D(j + 1:)
            right = right - matmul(assembly%v, term)
            ! x_j = 1 is the term of dv_j.
            right(sensor) = right(sensor) + sum(slope*vector%x)
         end associate
      end subroutine move_sensor

   end subroutine differentiate_root

   !> Derivatives of o' M**-1 F: -(M**-1 o)' M_p (M**-1 F), and what a moving sensor adds.
   subroutine differentiate_impulse(assembly, slopes)
      type(assembly_t), intent(in) :: assembly
      real(wp), intent(out) :: slopes(:)
      real(wp), dimension(assembly%n) :: o, x
      real(wp), dimension(size(assembly%v, 1)) :: yo, yx
      integer :: p

      call solve_mass(assembly, assembly%v(assembly%sensor, :), o, yo)
      call solve_mass(assembly, assembly%load, x, yx)
      do p = 1, size(slopes)
         associate (slope => assembly%slope(1, p), m_S => assembly%structure%m_S)
            slopes(p) = -sum(o*slope%m*x) - dot_product(yo, matmul(slope%hm, yx))
            if (assembly%parameters(p) /= of_x_S) cycle
            associate (d => assembly%sensor_slope, s => assembly%sensor)
               slopes(p) = slopes(p) + dot_product(d, x) &
                  - m_S*(dot_product(d, o)*yx(s) + yo(s)*dot_product(d, x))
            end associate
         end associate
      end do
   end subroutine differentiate_impulse

   !> 2 for one of a pair, 1 for a real root.
   pure real(wp) function weight(s)
      complex(wp), intent(in) :: s

      weight = merge(2.0_wp, 1.0_wp, abs(aimag(s)) > 0)
   end function weight

end module beamid_poles
