!> The terms that couple all oscillators of the beam: axial force, weight, spatial hysteresis, and
!> properties that vary along the beam. Together they are a full matrix,
!>
!>     E(s) = s C + K + i L + sum over l of R_l s/(s + b_l),
!>
!> beside the diagonal D(s) of the oscillators.
module beamid_dense_terms
   use beamid_coefficients, only: coefficients_t
   use beamid_hysteresis, only: hysteresis_products
   use beamid_kinds, only: wp
   use beamid_matrices, only: outer
   use beamid_modes, only: beam_modes_t
   use beamid_oscillators, only: changes, of_rate
   use beamid_structure, only: is_coefficient, of_b
   use beamid_terms, only: bending, hysteresis, inertia, is_axial_force, of_damping, &
      of_loss, of_relaxation, of_stiffness, weight
   implicit none
   private

   public :: dense_terms_t

   !> E and its slopes.
   type :: dense_terms_t
      !> (beam, beam, of_damping:changes, 0:parameters) E in C, K, L and the relaxing stiffnesses,
      !> and the stiffness whose rate changes, for index 0; and the slopes; not allocated: no term
      !> couples all oscillators
      real(wp), allocatable :: matrix(:, :, :, :)
      !> (of_damping:changes, 0:parameters) which of these matrices may differ from 0
      logical, allocatable :: is_present(:, :)
   contains
      procedure :: set, set_loss, at, bilinear, trace
      procedure, private :: add
   end type dense_terms_t

contains

   !> Sets E and its slopes, if a term couples all oscillators.
   !>
   !> whole  .true.: in any case
   subroutine set(self, given, modes, whole)
      class(dense_terms_t), intent(out) :: self
      type(coefficients_t), intent(in) :: given
      type(beam_modes_t), intent(in) :: modes
      logical, intent(in) :: whole
      logical :: has_field, lags, pull(size(given%c, 1))
      integer :: k, l, n, p

      pull = [(is_axial_force(k) .and. any(abs(given%c(k, of_stiffness, :)) > 0), &
         k=1, size(pull))]
      lags = any(abs(given%c(hysteresis, of_damping, :)) > 0)
      has_field = given%structure%has_fields() .or. any(is_coefficient(given%parameters))
      if (.not. (whole .or. allocated(modes%damping_remainder) .or. has_field .or. lags .or. &
         any(pull))) return
      n = size(modes%mu)
      allocate (self%matrix(n, n, of_damping:changes, 0:size(given%parameters)), source=0.0_wp)
      if (allocated(modes%damping_remainder)) then
         call self%add(of_damping, modes%damping_remainder(:, :, 1), &
            given%c(inertia, of_damping, :))
         call self%add(of_damping, modes%damping_remainder(:, :, 2), &
            given%c(bending, of_damping, :))
      end if
      if (has_field) call add_field_bending(self, given, modes)
      if (lags) call add_hysteresis(self, given, modes)
      do k = 1, size(pull)
         if (pull(k)) call add_axial_force(self, k, given, modes)
      end do
      do p = 1, size(given%parameters)
         do l = 1, size(of_b)
            if (given%parameters(p) == of_b(l)) self%matrix(:, :, of_rate(l), p) = &
               self%matrix(:, :, of_relaxation(l), 0)
         end do
      end do
      allocate (self%is_present(of_damping:changes, 0:size(given%parameters)))
      do p = 0, size(given%parameters)
         do k = of_damping, changes
            self%is_present(k, p) = any(abs(self%matrix(:, :, k, p)) > 0)
         end do
      end do
   end subroutine set

   !> Sets the structural damping in E to a share of that of another E.
   pure subroutine set_loss(self, whole, share)
      class(dense_terms_t), intent(inout) :: self
      type(dense_terms_t), intent(in) :: whole
      real(wp), intent(in) :: share

      self%matrix(:, :, of_loss, 0) = share*whole%matrix(:, :, of_loss, 0)
      self%is_present(of_loss, 0) = whole%is_present(of_loss, 0)
   end subroutine set_loss

   !> Adds a matrix to E, and to the slopes of E.
   !>
   !> j       `of_damping` .. `of_relaxation(2)`
   !> matrix  (beam, beam)
   !> c       (0:parameters) coefficient of the matrix, and its slopes
   pure subroutine add(self, j, matrix, c)
      class(dense_terms_t), intent(inout) :: self
      integer, intent(in) :: j
      real(wp), intent(in) :: matrix(:, :), c(0:)
      integer :: p

      do p = 0, ubound(c, 1)
         if (abs(c(p)) > 0) self%matrix(:, :, j, p) = self%matrix(:, :, j, p) + c(p)*matrix
      end do
   end subroutine add

   !> Adds the axial force of an operator to E and its slopes.
   !>
   !> k  operator
   subroutine add_axial_force(self, k, given, modes)
      class(dense_terms_t), intent(inout) :: self
      integer, intent(in) :: k
      type(coefficients_t), intent(in) :: given
      type(beam_modes_t), intent(in) :: modes
      real(wp) :: slope(size(modes%mu))

      slope = modes%at(given%place(k), 1)
      associate (c => given%c(k, of_stiffness, :))
         call self%add(of_stiffness, modes%tension(given%place(k), merge(0.0_wp, 1.0_wp, &
            k == weight), merge(1.0_wp, 0.0_wp, k == weight)), c)
         call self%add(of_stiffness, outer(slope, slope), [0.0_wp, c(1)*given%place_slopes(k)])
      end associate
   end subroutine add_axial_force

   !> Adds spatial hysteresis to E and its slopes.
   subroutine add_hysteresis(self, given, modes)
      class(dense_terms_t), intent(inout) :: self
      type(coefficients_t), intent(in) :: given
      type(beam_modes_t), intent(in) :: modes
      real(wp), dimension(size(modes%mu), size(modes%mu)) :: products, by_range

      call hysteresis_products(modes, given%place(hysteresis), products, by_range)
      associate (c => given%c(hysteresis, of_damping, :))
         call self%add(of_damping, products, c)
         call self%add(of_damping, by_range, [0.0_wp, c(1)*given%place_slopes(hysteresis)])
      end associate
   end subroutine add_hysteresis

   !> Adds to E the bending that E(x) and c_D(x) cause beyond constant E and c_D and the known
   !> variation, and to its slopes their derivatives.
   subroutine add_field_bending(self, given, modes)
      class(dense_terms_t), intent(inout) :: self
      type(coefficients_t), intent(in) :: given
      type(beam_modes_t), intent(in) :: modes
      real(wp) :: factor(2, size(modes%bent), 0:size(given%parameters))
      real(wp) :: share(0:size(given%parameters))
      integer :: j, k, p, q

      ! The functions return stiffness first, which loss and relaxations follow, and viscosity
      ! second.
      do q = 1, size(modes%bent)
         factor(:, q, 0) = given%structure%factors(modes%bent(q)) - 1
         factor(:, q, 1:) = given%structure%factor_slopes(modes%bent(q), given%parameters)
      end do
      do j = of_damping, of_relaxation(2)
         k = merge(2, 1, j == of_damping)
         if (.not. any(abs(given%c(bending, j, :)) > 0)) cycle
         do p = 0, size(given%parameters)
            if (.not. any(abs(factor(k, :, p)) > 0)) cycle
            share = 0
            share(p) = given%c(bending, j, 0)
            if (p == 0) share = given%c(bending, j, :)
            call self%add(j, modes%bending_products(modes%known(:, k)*factor(k, :, p)), share)
         end do
      end do
   end subroutine add_field_bending

   !> Returns E at a point, or a derivative of it, (beam, beam).
   !>
   !> f  (changes) from `factors` of the oscillators, or a derivative of these with respect to s
   !> p  index among the parameters of the slopes; 0: E itself
   pure function at(self, f, p) result(E)
      class(dense_terms_t), intent(in) :: self
      complex(wp), intent(in) :: f(changes)
      integer, intent(in) :: p
      complex(wp) :: E(size(self%matrix, 1), size(self%matrix, 1))
      integer :: j

      E = 0
      do j = of_damping, changes
         if (abs(f(j)) > 0 .and. self%is_present(j, p)) E = E + f(j)*self%matrix(:, :, j, p)
      end do
   end function at

   !> Returns z'E x at a point, or z'E_p x; 0 if no term couples all oscillators.
   !>
   !> f, p  as of `at`
   !> x, z  (n) two motions of the oscillators
   pure complex(wp) function bilinear(self, f, x, z, p)
      class(dense_terms_t), intent(in) :: self
      complex(wp), intent(in) :: f(changes), x(:), z(:)
      integer, intent(in) :: p
      complex(wp) :: z_M_x
      integer :: b, i, j

      bilinear = 0
      if (.not. allocated(self%matrix)) return
      b = size(self%matrix, 1)
      do j = of_damping, changes
         if (.not. (abs(f(j)) > 0 .and. self%is_present(j, p))) cycle
         z_M_x = 0
         do i = 1, b
            z_M_x = z_M_x + x(i)*sum(self%matrix(:, i, j, p)*z(:b))
         end do
         bilinear = bilinear + f(j)*z_M_x
      end do
   end function bilinear

   !> Returns the trace of X E at a point, or of X E_p.
   !>
   !> f, p    as of `at`
   !> turned  (beam, beam) transpose of X
   pure complex(wp) function trace(self, f, turned, p)
      class(dense_terms_t), intent(in) :: self
      complex(wp), intent(in) :: f(changes), turned(:, :)
      integer, intent(in) :: p
      integer :: j

      trace = 0
      do j = of_damping, changes
         if (abs(f(j)) > 0 .and. self%is_present(j, p)) &
            trace = trace + f(j)*sum(self%matrix(:, :, j, p)*turned)
      end do
   end function trace

end module beamid_dense_terms
