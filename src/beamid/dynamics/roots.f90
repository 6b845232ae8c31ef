!> Roots of the characteristic equation of the damped structure, all at once by the Ehrlich-Aberth
!> iteration from those of its parts (Aberth, Math. Comp. 27, 1973, 339).
module beamid_roots
   use beamid_equations, only: equations_t
   use beamid_errors, only: error_t, failure
   use beamid_kinds, only: wp
   use beamid_modes, only: bare_beam_modes
   use beamid_receptance, only: new_receptance, receptance_t, root_sums, root_t, sums_t
   use beamid_strings, only: to_text
   implicit none
   private

   public :: find_roots, damped_roots

   integer, parameter :: max_sweeps = 200

contains

   !> Roots s of (s**2 M + s C + K) x = 0.
   !>
   !> roots  complex pairs once, Im s > 0; real roots each; ascending |s| [1/time]
   subroutine damped_roots(equations, roots, error)
      type(equations_t), intent(in) :: equations
      complex(wp), allocatable, intent(out) :: roots(:)
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: mu(:), shapes(:, :), tip(:)
      type(root_t), allocatable :: half(:)

      call bare_beam_modes(equations%galerkin, mu, shapes, error)
      if (allocated(error)) return
      tip = matmul(equations%galerkin%tip, shapes)
      associate (structure => equations%structure)
         call find_roots(new_receptance(structure, mu, tip, tip), half, error)
         if (allocated(error)) return
         roots = half%s
         ! A hose without a spring is free to drift: a root that the tip does not see.
         if (structure%has_hose() .and. .not. structure%k_H > 0) roots = [roots, (0.0_wp, 0.0_wp)]
      end associate
      call sort_by_modulus(roots)
   end subroutine damped_roots

   !> Ascending |s|, by insertion.
   pure subroutine sort_by_modulus(roots)
      complex(wp), intent(inout) :: roots(:)
      complex(wp) :: root
      integer :: i, j

      do i = 2, size(roots)
         root = roots(i)
         do j = i - 1, 1, -1
            if (abs(roots(j)) <= abs(root)) exit
            roots(j + 1) = roots(j)
         end do
         roots(j + 1) = root
      end do
   end subroutine sort_by_modulus

   !> One root of each complex pair, and the real ones.
   subroutine find_roots(receptance, half, error)
      type(receptance_t), intent(in) :: receptance
      type(root_t), allocatable, intent(out) :: half(:)
      type(error_t), allocatable, intent(out) :: error
      type(root_t), allocatable :: roots(:)

      call starting_points(receptance, roots)
      call iterate(receptance, roots, error)
      if (.not. allocated(error)) call select_half(receptance, roots, half)
   end subroutine find_roots

   !> Roots of the beam with its tip mass, and of the hose alone, each moved by what the other part
   !> does to it at first order, and off the real axis: two real roots may have to become a pair.
   subroutine starting_points(receptance, roots)
      type(receptance_t), intent(in) :: receptance
      type(root_t), allocatable, intent(out) :: roots(:)
      type(receptance_t) :: without_hose
      type(sums_t) :: sums
      complex(wp) :: num(0:2), den(0:2), shift, turn
      integer :: n, k

      n = size(receptance%mu)
      without_hose = receptance
      without_hose%structure%m_H = 0
      deallocate (without_hose%hose)
      allocate (without_hose%hose(0), roots(2*n + size(receptance%hose)))
      do k = 1, n
         roots([k, n + k])%s = receptance%pair(receptance%with_tip_mass(k))
      end do
      do k = 1, 2*n
         roots(k)%j = 0
         call attach(receptance, roots(k))
         call from_hose(receptance, roots(k))
         if (size(receptance%hose) == 0) cycle
         sums = root_sums(without_hose, roots(k))
         call receptance%attachment(roots(k), num, den)
         turn = cmplx(1.0_wp, merge(0.2_wp, -0.2_wp, k <= n), wp)
         shift = -(num(0)/den(0) - sums%h(0))*sums%G**2/sums%A*turn
         shift = shift*min(1.0_wp, 0.2_wp*abs(roots(k)%s)/max(abs(shift), tiny(1.0_wp)))
         roots(k)%s = roots(k)%s + shift
         roots(k)%offset = roots(k)%offset + shift
         roots(k)%hose = roots(k)%hose + shift
      end do
      do k = 1, size(receptance%hose)
         roots(2*n + k)%s = receptance%hose(k)*cmplx(1.02_wp, merge(0.05_wp, -0.05_wp, k == 1), wp)
         call from_hose(receptance, roots(2*n + k))
      end do
   end subroutine starting_points

   !> Ehrlich-Aberth: corrections in turn until none moves.
   subroutine iterate(receptance, roots, error)
      type(receptance_t), intent(in) :: receptance
      type(root_t), intent(inout) :: roots(:)
      type(error_t), allocatable, intent(out) :: error
      logical :: done(size(roots))
      real(wp) :: moved
      integer :: k, sweep

      if (bare(receptance)) then
         roots%offset = 0
         do k = 1, size(roots)
            roots(k)%s = receptance%pole(roots(k)%j, roots(k)%side)
         end do
         return
      end if
      done = .false.
      do sweep = 1, max_sweeps
         do k = 1, size(roots)
            if (done(k)) cycle
            call correct(receptance, roots, k, moved)
            ! Only double roots never come so far.
            done(k) = moved <= 1e-9_wp*max(abs(roots(k)%offset), 1e-14_wp*abs(roots(k)%s)) .or. &
               sweep > max_sweeps/2 .and. moved <= 1e-6_wp*abs(roots(k)%s)
         end do
         if (.not. all(done)) cycle
         ! With all the others in place one more correction leaves round-off.
         do k = 1, size(roots)
            call correct(receptance, roots, k, moved)
         end do
         return
      end do
      call failure(error, 'modal: '//to_text(count(.not. done))//' of '//to_text(size(roots))// &
         ' roots of the characteristic equation did not converge')
   end subroutine iterate

   !> Newton's correction of root k for the polynomial without the other roots.
   !>
   !> moved  its size
   pure subroutine correct(receptance, roots, k, moved)
      type(receptance_t), intent(in) :: receptance
      type(root_t), intent(inout) :: roots(:)
      integer, intent(in) :: k
      real(wp), intent(out) :: moved
      complex(wp) :: slope, step

      slope = receptance%secular(roots(k)) - sum(1/(roots(k)%s - roots(:k - 1)%s)) &
         - sum(1/(roots(k)%s - roots(k + 1:)%s))
      step = -1/slope
      roots(k)%s = roots(k)%s + step
      roots(k)%offset = roots(k)%offset + step
      roots(k)%hose = roots(k)%hose + step
      call attach(receptance, roots(k))
      moved = abs(step)
   end subroutine correct

   !> Whether nothing hangs on the beam.
   pure logical function bare(receptance)
      type(receptance_t), intent(in) :: receptance

      bare = .not. receptance%structure%m_T > 0 .and. size(receptance%hose) == 0
   end function bare

   !> Gives the root the nearest pole of the beam as its origin.
   pure subroutine attach(receptance, root)
      type(receptance_t), intent(in) :: receptance
      type(root_t), intent(inout) :: root
      real(wp) :: distance(2)
      integer :: j, side

      do side = 1, 2
         distance(side) = minval(abs(root%s - receptance%pole(:, side)))
      end do
      side = minloc(distance, dim=1)
      j = minloc(abs(root%s - receptance%pole(:, side)), dim=1)
      if (j == root%j .and. side == root%side) return
      root%j = j
      root%side = side
      root%offset = root%s - receptance%pole(j, side)
   end subroutine attach

   !> Distances from the roots of the hose.
   pure subroutine from_hose(receptance, root)
      type(receptance_t), intent(in) :: receptance
      type(root_t), intent(inout) :: root

      associate (m => size(receptance%hose))
         root%hose(:m) = root%s - receptance%hose
      end associate
   end subroutine from_hose

   !> Keeps one root of each complex pair and the real ones.
   subroutine select_half(receptance, roots, half)
      type(receptance_t), intent(in) :: receptance
      type(root_t), intent(inout) :: roots(:)
      type(root_t), allocatable, intent(out) :: half(:)
      integer :: k

      associate (st => receptance%structure)
         if (.not. (st%c_D > 0 .or. st%has_hose() .and. st%c_H > 0)) then
            ! Without damping the real parts are round-off.
            roots%s = cmplx(0.0_wp, aimag(roots%s), wp)
            roots%offset = cmplx(0.0_wp, aimag(roots%offset), wp)
            do k = 1, size(roots)
               roots(k)%hose = cmplx(0.0_wp, aimag(roots(k)%hose), wp)
            end do
         end if
      end associate
      do k = 1, size(roots)
         ! A pair so near the real axis would be refused as a double root.
         if (abs(aimag(roots(k)%s)) > 1e-10_wp*abs(roots(k)%s)) cycle
         roots(k)%s = real(roots(k)%s)
         if (size(receptance%hose) > 0) then
            if (any(abs(aimag(receptance%hose)) > 0)) then
               call from_hose(receptance, roots(k))
            else
               roots(k)%hose = real(roots(k)%hose)
            end if
         end if
         if (roots(k)%j > 0) then
            if (abs(aimag(receptance%pole(roots(k)%j, roots(k)%side))) > 0) then
               roots(k)%offset = roots(k)%s - receptance%pole(roots(k)%j, roots(k)%side)
            else
               roots(k)%offset = real(roots(k)%offset)
            end if
         end if
      end do
      half = pack(roots, aimag(roots%s) >= 0)
   end subroutine select_half

end module beamid_roots
