!> The equations of motion in modal coordinates: the structure as oscillators that are coupled at a
!> few points.
!>
!> The coordinates are the modes of the bare beam (pinned at the root if the root can rotate) and
!> each hose as one more oscillator. In these coordinates M, C and K are diagonal except for the
!> attachments and for terms that couple all oscillators of the beam:
!>
!>     Q(s) = s**2 M + s C + K = D(s) + E(s) + V H(s) A**-1 V',    Q(s) x = F.
!>
!> Each part is a component with a module of its own: the coefficients of all terms
!> (`beamid_coefficients`), V (`beamid_layout`), D (`beamid_oscillators`), H and A
!> (`beamid_couplings`), E (`beamid_dense_terms`), F (`beamid_loads`), and the derivatives of Q with
!> respect to the parameters (`beamid_sensitivities`).
module beamid_assembly
   use beamid_coefficients, only: coefficients_t
   use beamid_couplings, only: couplings_t
   use beamid_dense_terms, only: dense_terms_t
   use beamid_kinds, only: wp
   use beamid_layout, only: layout_t
   use beamid_loads, only: load_t, modal_load_t
   use beamid_matrices, only: add_diagonal
   use beamid_modes, only: beam_modes_t
   use beamid_oscillators, only: changes, oscillators_t, root_t
   use beamid_sensitivities, only: sensitivities_t
   use beamid_structure, only: structure_t
   use beamid_terms, only: of_damping, of_mass, of_stiffness
   implicit none
   private

   public :: assembly_t, changes, load_t, new_assembly, root_t

   !> The equations of one structure and their derivatives with respect to chosen parameters.
   !>
   !> Sizes: n oscillators, r rows, `parameters` the chosen parameters, `operators` those of
   !> `beamid_terms`. A slope is a derivative with respect to a parameter.
   type :: assembly_t
      type(coefficients_t) :: given            !< the structure, its coefficients and their slopes
      integer :: zeros = 0   !< number of roots 0, those of the motion as a rigid body
      type(layout_t) :: layout                 !< oscillators, rows and V
      type(oscillators_t) :: oscillators       !< D
      type(couplings_t) :: couplings           !< H and A
      type(dense_terms_t) :: dense             !< E
      type(modal_load_t) :: load               !< F
      type(sensitivities_t) :: sensitivities   !< slopes of Q without E
   contains
      procedure :: renew, is_dense, is_undamped, roots, set_loss, products, full_matrices
      procedure, private :: set_values
   end type assembly_t

contains

   !> Returns the equations of a structure in modal coordinates.
   !>
   !> structure   beam and attachments
   !> modes       modes of the bare beam
   !> parameters  numbers of the parameters of the slopes
   !> load        kind of load; default: a force at a point
   !> whole       .true.: full matrices even if no term couples all oscillators; default .false.
   function new_assembly(structure, modes, parameters, load, whole) result(self)
      type(structure_t), intent(in) :: structure
      type(beam_modes_t), intent(in) :: modes
      integer, intent(in) :: parameters(:)
      type(load_t), intent(in), optional :: load
      logical, intent(in), optional :: whole
      type(assembly_t) :: self
      type(load_t) :: applied
      logical :: in_full

      if (present(load)) applied = load
      in_full = .false.
      if (present(whole)) in_full = whole
      self%zeros = structure%zero_roots()
      call self%given%set(structure, modes%space%length, parameters)
      call self%layout%set(self%given, modes)
      call self%set_values()
      call self%dense%set(self%given, modes, in_full)
      call self%load%set(applied, self%given, modes, self%layout)
   end function new_assembly

   !> Changes an assembly to that of another structure, if they differ in the values of coefficients
   !> alone: the oscillators, V and the load are the same. The load must not be that of a base.
   !>
   !> structure   beam and attachments
   !> parameters  numbers of the parameters of the slopes
   !> done        .false.: something else differs; the assembly is unchanged
   subroutine renew(self, structure, parameters, done)
      class(assembly_t), intent(inout) :: self
      type(structure_t), intent(in) :: structure
      integer, intent(in) :: parameters(:)
      logical, intent(out) :: done

      done = .not. self%is_dense()
      if (done) call self%given%renew(structure, parameters, self%layout%row > 0, done)
      if (done) call self%set_values()
   end subroutine renew

   !> Sets what the coefficients determine beside the load and E: D and its poles, H and A, and the
   !> slopes.
   subroutine set_values(self)
      class(assembly_t), intent(inout) :: self

      call self%oscillators%set(self%given, self%layout)
      call self%couplings%set(self%given, self%layout, self%oscillators)
      call self%sensitivities%set(self%given, self%layout, self%couplings)
   end subroutine set_values

   !> Returns whether a term couples all oscillators of the beam.
   pure logical function is_dense(self)
      class(assembly_t), intent(in) :: self

      is_dense = allocated(self%dense%matrix)
   end function is_dense

   !> Returns whether C and L are 0 and nothing relaxes.
   pure logical function is_undamped(self)
      class(assembly_t), intent(in) :: self

      associate (of => self%oscillators)
         is_undamped = .not. (any(abs(of%c) > 0) .or. any(of%l > 0) .or. of%relaxation%n > 0 &
            .or. any(abs(self%couplings%h(of_damping, :, :)) > 0))
      end associate
      if (self%is_dense()) is_undamped = is_undamped .and. &
         .not. self%dense%is_present(of_damping, 0)
   end function is_undamped

   !> Returns the number of roots: two for each oscillator, less two for each row that is held.
   pure integer function roots(self)
      class(assembly_t), intent(in) :: self

      roots = 2*(self%layout%n - count(self%couplings%rigid))
   end function roots

   !> Sets the structural damping to a share of that of another assembly of the same beam.
   pure subroutine set_loss(self, whole, share)
      class(assembly_t), intent(inout) :: self
      type(assembly_t), intent(in) :: whole
      real(wp), intent(in) :: share

      self%oscillators%l = share*whole%oscillators%l
      if (self%is_dense()) call self%dense%set_loss(whole%dense, share)
      call self%oscillators%set_poles()
   end subroutine set_loss

   !> Computes z'Op x for each operator that depends on a parameter, where x and z are two motions.
   !> For a spring to the ground the product is A y w.
   !>
   !> form  in which the motions are given, from `form_at`
   !> x, y  (n), (r) first motion: oscillators and rows A**-1 V'x
   !> z, w  (n), (r) second motion
   !> xz    (n) space for the products of both motions of the oscillators
   !> T     (r, r) space for A y w', those of the rows
   !> q     (operators that depend on a parameter) the products
   pure subroutine products(self, form, x, y, z, w, xz, T, q)
      class(assembly_t), intent(in) :: self
      integer, intent(in) :: form
      complex(wp), intent(in) :: x(:), y(:), z(:), w(:)
      complex(wp), intent(out) :: xz(:), T(:, :), q(:)
      integer :: k

      do k = 1, size(w)
         T(:, k) = self%couplings%compliance*y*w(k)
      end do
      xz = x*z
      call self%sensitivities%traces(self%layout, form, xz, T, q)
   end subroutine products

   !> Computes M, C and K of the oscillators as full matrices.
   !>
   !> compliance  (r) diagonal of A, with a value above 0 in place of a rigid spring
   !> M, C, K     (n, n)
   pure subroutine full_matrices(self, compliance, M, C, K)
      class(assembly_t), intent(in) :: self
      real(wp), intent(in) :: compliance(:)
      real(wp), dimension(:, :), intent(out) :: M, C, K
      real(wp) :: scaled(size(M, 1), size(compliance)), h(size(compliance), size(compliance))

      associate (d => self%oscillators, v => self%layout%v, b => self%layout%beam)
         scaled = self%layout%vt/spread(compliance, 1, size(M, 1))
         call self%couplings%coefficient(of_mass, 0, h)
         M = matmul(self%layout%vt, matmul(h, v))
         call self%couplings%coefficient(of_damping, 0, h)
         C = matmul(scaled, matmul(h, v))
         call self%couplings%coefficient(of_stiffness, 0, h)
         K = matmul(scaled, matmul(h, v))
         call add_diagonal(M, d%m)
         call add_diagonal(C, d%c)
         call add_diagonal(K, d%k)
         if (.not. self%is_dense()) return
         C(:b, :b) = C(:b, :b) + self%dense%matrix(:, :, of_damping, 0)
         K(:b, :b) = K(:b, :b) + self%dense%matrix(:, :, of_stiffness, 0)
      end associate
   end subroutine full_matrices

end module beamid_assembly
