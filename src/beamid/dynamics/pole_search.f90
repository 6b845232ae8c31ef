!> Search for the poles of a structure: continuation from a similar structure if there is one,
!> otherwise the roots of the characteristic equation or the eigenvalues of the matrices.
module beamid_pole_search
   use beamid_assembly, only: assembly_t, root_t
   use beamid_continuation, only: with_conjugates, follow_roots
   use beamid_errors, only: error_t, failure, status_failed
   use beamid_kinds, only: wp
   use beamid_low_roots, only: find_low_roots
   use beamid_parameters, only: as_named, parameters
   use beamid_poles, only: find_residues, parameter_values, poles_t
   use beamid_relaxation_roots, only: continue_relaxation_roots, find_relaxation_roots, &
      shares_of
   use beamid_roots, only: find_others, find_roots
   use beamid_strings, only: to_text
   use beamid_structure_checks, only: furthest_parameter
   use beamid_systems, only: find_eigenvector
   use beamid_vectors, only: allocate_vectors
   implicit none
   private

   public :: find_poles

   !> Number of oscillators below which all roots are found.
   integer, parameter, public :: few_oscillators = 12

contains

   !> Finds the roots of a structure, their eigenvectors and residues: all of them, or all with
   !> Re s >= -rate and as many of the lowest that oscillate as wanted, if this is faster.
   !>
   !> assembly  the structure and its load
   !> poles     in: those of a similar structure, from which the roots are continued, or a new
   !>           variable; out: `root`, `all`, `vector` and the results of `find_residues`
   !> error     E is 0, the iteration does not converge, or a root was missed
   !> rate      [1/time]; default: all roots are wanted
   !> modes     number of modes that are wanted if `rate` is given
   subroutine find_poles(assembly, poles, error, rate, modes)
      type(assembly_t), intent(in) :: assembly
      type(poles_t), intent(inout) :: poles
      type(error_t), allocatable, intent(out) :: error
      real(wp), intent(in), optional :: rate
      integer, intent(in), optional :: modes
      type(root_t), allocatable :: relaxed(:)
      logical :: found, continued
      integer :: k, way

      if (.not. assembly%oscillators%E > tiny(1.0_wp)) then
         call failure(error, 'modal: found a beam without bending stiffness, expected E above 0')
         return
      end if
      found = .false.
      if (present(rate)) found = rate < huge(rate) .and. modes < assembly%layout%n .and. &
         assembly%layout%n >= few_oscillators
      if (found) then
         call find_low_poles(assembly, rate, modes, poles, found)
         if (found) return
      end if
      continued = .false.
      if (allocated(poles%root)) call allocate_vectors(size(poles%root), poles%vector)
      if (allocated(poles%shares)) call continue_relaxation_roots(assembly, poles%root, &
         poles%shares, relaxed, poles%vector(count(poles%root%side <= 2) + 1:), continued)
      if (.not. continued) call find_relaxation_roots(assembly, relaxed, error)
      if (allocated(error)) return
      if (.not. poles%has_all()) then
         deallocate (poles%all)
         poles%rate = huge(1.0_wp)
         poles%modes = huge(1)
      end if
      if (allocated(poles%all)) then
         call continue_roots(assembly, relaxed, continued, poles, found)
         if (found) then
            call find_residues(assembly, poles, error)
            if (.not. allocated(error)) return
            deallocate (error)
         end if
         if (continued) call find_relaxation_roots(assembly, relaxed, error)
         if (allocated(error)) return
      end if
      ! First the characteristic equation, then the eigenvalues of the matrices.
      do way = 1, 2
         call find_roots(assembly, relaxed, poles%all, poles%root, error, from_matrix=way == 2)
         if (.not. allocated(error)) then
            call add_relaxed(assembly, relaxed, poles)
            call find_eigenvectors(assembly, poles)
         end if
         if (.not. allocated(error)) call find_residues(assembly, poles, error)
         if (.not. allocated(error)) return
         if (allocated(poles%all)) deallocate (poles%all)
      end do
      ! Names the parameter that is furthest out of proportion to the beam, if there is one.
      k = furthest_parameter(assembly%given%structure)
      if (k > 0 .and. error%status == status_failed) error%message = error%message//'; '// &
         trim(parameters(k)%name)//' = '//to_text(as_named(k, assembly%given%structure%get(k)))// &
         ' is out of proportion to the beam'
   end subroutine find_poles

   !> Finds the lowest roots alone, their eigenvectors and residues. Arguments as of `find_poles`.
   !>
   !> found  .false.: all roots are needed, or a root was missed; `poles` then still serves as start
   subroutine find_low_poles(assembly, rate, modes, poles, found)
      type(assembly_t), intent(in) :: assembly
      real(wp), intent(in) :: rate
      integer, intent(in) :: modes
      type(poles_t), intent(inout) :: poles
      logical, intent(out) :: found
      type(root_t), allocatable :: guess(:), root(:)
      type(error_t), allocatable :: error
      real(wp) :: found_rate
      integer :: found_modes

      allocate (guess(0))
      if (allocated(poles%all)) then
         guess = poles%root
         guess%s = predicted_roots(assembly, poles)
      end if
      found_rate = rate
      found_modes = modes
      call find_low_roots(assembly, guess, found_rate, found_modes, root, poles%vector, found)
      if (.not. found) return
      ! From here on, the derivatives belong to other roots.
      if (allocated(poles%values)) deallocate (poles%values)
      poles%root = root
      poles%all = root
      poles%rate = found_rate
      poles%modes = found_modes
      call find_residues(assembly, poles, error)
      found = .not. allocated(error)
   end subroutine find_low_poles

   !> Adds the relaxation roots, which come last.
   pure subroutine add_relaxed(assembly, relaxed, poles)
      type(assembly_t), intent(in) :: assembly
      type(root_t), intent(in) :: relaxed(:)
      type(poles_t), intent(inout) :: poles   !< in and out: `root`, `all`; out: `shares`

      if (size(relaxed) == 0) return
      poles%root = [poles%root, relaxed]
      poles%all = [poles%all, relaxed]
      poles%shares = shares_of(assembly%oscillators, relaxed)
   end subroutine add_relaxed

   !> Follows the roots of a similar structure to those of this one.
   !>
   !> relaxed    relaxation roots of this structure
   !> continued  whether `poles` already holds the eigenvectors of these roots
   !> poles      in: of the similar structure; out: if found, `root`, `all` and `vector` of this one
   !> found      whether all roots have been found
   subroutine continue_roots(assembly, relaxed, continued, poles, found)
      type(assembly_t), intent(in) :: assembly
      type(root_t), intent(in) :: relaxed(:)
      logical, intent(in) :: continued
      type(poles_t), intent(inout) :: poles
      logical, intent(out) :: found
      type(root_t), allocatable :: moved(:)
      logical, allocatable :: followed(:)
      integer :: k, n

      n = count(poles%root%side <= 2)
      moved = poles%root
      moved%s = predicted_roots(assembly, poles)
      moved = moved(:n)
      ! From here on, the derivatives belong to other roots.
      if (allocated(poles%values)) deallocate (poles%values)
      allocate (followed(n))
      call follow_roots(assembly, moved, poles%vector(:n), followed)
      found = all(followed)
      if (found) then
         poles%root = moved
         call with_conjugates(assembly, moved, poles%all)
         call add_relaxed(assembly, relaxed, poles)
         if (size(poles%vector) /= size(poles%root)) then
            call find_eigenvectors(assembly, poles)
         else if (.not. continued) then
            do k = n + 1, size(poles%root)
               call find_eigenvector(assembly, poles%root(k), poles%vector(k))
            end do
         end if
      else if (4*count(.not. followed) <= size(moved) .and. .not. assembly%is_dense()) then
         ! If more than a quarter is lost, a new search is faster.
         call find_others(assembly, relaxed, moved, followed, poles%all, poles%root, found)
         if (.not. found) return
         call add_relaxed(assembly, relaxed, poles)
         call find_eigenvectors(assembly, poles)
      end if
   end subroutine continue_roots

   !> Returns the roots that the derivatives of the last structure's roots predict [1/time].
   !>
   !> Each quantity is extrapolated as a product of powers of the parameters, because this is nearly
   !> exact for the real roots of overdamped modes and, in a complex pair, for the real part and the
   !> squared modulus. A parameter that is not positive enters linearly.
   pure function predicted_roots(assembly, poles) result(s)
      type(assembly_t), intent(in) :: assembly
      type(poles_t), intent(in) :: poles   !< of the last structure
      complex(wp), dimension(size(poles%root)) :: s, change, linear_change
      real(wp), allocatable :: new(:)
      real(wp) :: square, half
      integer :: k, p

      s = poles%root%s
      if (.not. allocated(poles%values)) return
      allocate (new, source=parameter_values(assembly, poles%parameters))
      change = 0
      linear_change = 0
      do p = 1, size(new)
         associate (old => poles%values(p))
            if (min(new(p), old) > 0) then
               change = change + poles%ds(:, p)*(old*log(new(p)/old))
            else
               linear_change = linear_change + poles%ds(:, p)*(new(p) - old)
            end if
         end associate
      end do
      do k = 1, size(s)
         if (abs(aimag(s(k))) > 0) then
            square = real(s(k))**2 + aimag(s(k))**2
            square = abs(scaled(square, 2*real(conjg(s(k))*change(k))) &
               + 2*real(conjg(s(k))*linear_change(k)))
            half = scaled(real(s(k)), real(change(k))) + real(linear_change(k))
            ! A pair that becomes overdamped is placed near the real axis, a little above it.
            s(k) = cmplx(half, sqrt(max(square - half**2, 1e-4_wp*square)), wp)
         else
            s(k) = scaled(real(s(k)), real(change(k))) + real(linear_change(k))
         end if
      end do
   end function predicted_roots

   !> Returns x e**(change/x), which equals x + change to first order; by a factor between e**-3 and
   !> e**3 (about 20). For x = 0 the result is `change`.
   pure real(wp) function scaled(x, change)
      real(wp), intent(in) :: x, change

      scaled = x + change
      if (abs(x) > 0) scaled = x*exp(max(-3.0_wp, min(change/x, 3.0_wp)))
   end function scaled

   !> Computes the eigenvectors of all roots.
   subroutine find_eigenvectors(assembly, poles)
      type(assembly_t), intent(in) :: assembly
      type(poles_t), intent(inout) :: poles   !< in: `root`; out: `vector`
      integer :: k

      call allocate_vectors(size(poles%root), poles%vector)
      do k = 1, size(poles%root)
         call find_eigenvector(assembly, poles%root(k), poles%vector(k))
      end do
   end subroutine find_eigenvectors

end module beamid_pole_search
