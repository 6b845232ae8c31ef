!> The force in time: the pulse on its closed interval, tables, and tables that are none.
program test_excitation
   use beamid_errors, only: error_t, status_bad_input
   use beamid_excitation, only: excitation_t, new_force_table, new_free, new_pulse, &
      new_release
   use beamid_kinds, only: wp
   use beamid_strings, only: to_text
   use checks, only: check, check_close, finish
   implicit none

   call test_pulse()
   call test_table()
   call test_replaced()
   call test_refused()
   call test_scale()
   call test_kinks()
   call finish('excitation')

contains

   !> Exact comparisons: the amplitude is passed on, not computed with.
   subroutine test_pulse()
      real(wp), parameter :: duration = 0.05_wp, amplitude = -1.7_wp
      type(excitation_t) :: pulse

      pulse = new_pulse(amplitude, duration)
      call check_close('f(0)', pulse%force(0.0_wp), amplitude, 0.0_wp)
      call check_close('f(duration)', pulse%force(duration), amplitude, 0.0_wp)
      call check_close('f within', pulse%force(0.031_wp), amplitude, 0.0_wp)
      call check_close('f just after', pulse%force(duration*(1 + 1e-13_wp)), 0.0_wp, 0.0_wp)
      ! A time that misses the end by round-off, as .1 + 2*.1 misses .3, is still the end.
      call check_close('f at the end but for round-off', pulse%force(nearest(duration, 1.0_wp)), &
         amplitude, 0.0_wp)
      call check_close('f just before', pulse%force(nearest(0.0_wp, -1.0_wp)), 0.0_wp, 0.0_wp)
      call check_close('f long after', pulse%force(1e6_wp), 0.0_wp, 0.0_wp)
      call check_close('f of an array of times', &
         sum(pulse%force([-1.0_wp, 0.0_wp, duration, 1.0_wp])), 2*amplitude, 0.0_wp)
      call check('a point load by default', .not. pulse%distributed)
   end subroutine test_pulse

   subroutine test_table()
      real(wp), parameter :: t(*) = [0.5_wp, 1.0_wp, 1.25_wp, 4.0_wp, 4.5_wp], &
         f(*) = [2.0_wp, -1.0_wp, -1.0_wp, 7.5_wp, 0.0_wp]
      !> Time, and the force by hand.
      real(wp), parameter :: rows(2, 9) = reshape([0.0_wp, 0.0_wp, 0.4999_wp, 0.0_wp, &
         0.5_wp, 2.0_wp, 0.75_wp, 0.5_wp, 1.0_wp, -1.0_wp, 1.1_wp, -1.0_wp, &
         2.625_wp, 3.25_wp, 4.25_wp, 3.75_wp, 4.6_wp, 0.0_wp], [2, 9])
      type(excitation_t) :: table
      type(error_t), allocatable :: error
      integer :: k

      call new_force_table(t, f, table, error)
      call check('table accepted', .not. allocated(error))
      do k = 1, size(rows, 2)
         ! One interpolation of numbers below 8.
         call check_close('f('//to_text(rows(1, k))//')', table%force(rows(1, k)), rows(2, k), &
            16*epsilon(1.0_wp))
      end do
      do k = 1, size(t)
         call check_close('node '//to_text(k), table%force(t(k)), f(k), 8*epsilon(1.0_wp))
      end do
      call check_close('last node is inside', table%force(4.5_wp), 0.0_wp, 0.0_wp)
   end subroutine test_table

   !> A table in the place of a release or of a free start keeps nothing of it.
   subroutine test_replaced()
      type(excitation_t) :: force
      type(error_t), allocatable :: error

      force = new_free(3)
      call new_force_table([0.0_wp, 1.0_wp], [1.0_wp, 2.0_wp], force, error)
      call check('a table is no free start', force%modes == 0)
      force = new_release(0.02_wp, 0.5_wp, .true.)
      call new_force_table([0.0_wp, 1.0_wp], [1.0_wp, 2.0_wp], force, error)
      call force%fit_to(100.0_wp)
      call check('a table is no release', .not. (force%is_release .or. &
         force%by_displacement) .and. abs(force%force(1.0_wp) - 2) <= 0)
   end subroutine test_replaced

   subroutine test_refused()
      call refused('no node', [real(wp) ::], [real(wp) ::], '0 rows')
      call refused('one node', [0.0_wp], [1.0_wp], '1 rows')
      call refused('negative time', [-0.1_wp, 1.0_wp], [1.0_wp, 1.0_wp], '-0.1')
      call refused('equal times', [0.0_wp, 1.0_wp, 1.0_wp], [1.0_wp, 1.0_wp, 2.0_wp], 'increase')
      call refused('falling times', [0.0_wp, 2.0_wp, 1.0_wp], [1.0_wp, 1.0_wp, 2.0_wp], 'increase')
   end subroutine test_refused

   !> A refused table leaves the force as it was.
   subroutine refused(name, t, f, words)
      character(len=*), intent(in) :: name, words
      real(wp), intent(in) :: t(:), f(:)
      type(excitation_t) :: table
      type(error_t), allocatable :: error

      table = new_pulse(3.0_wp, 1.0_wp)
      call new_force_table(t, f, table, error)
      if (.not. allocated(error)) then
         call check('refused: '//name, .false., 'accepted')
         return
      end if
      call check('refused: '//name, error%status == status_bad_input .and. &
         index(error%message, words) > 0 .and. size(table%t) == 2 .and. table%f(1) > 2, &
         error%message)
   end subroutine refused

   !> The smaller of the static deflection and that of the impulse, in powers of 2: exact.
   subroutine test_scale()
      type(excitation_t) :: force
      type(error_t), allocatable :: error

      force = new_pulse(-4.0_wp, 8.0_wp)
      call check_close('long pulse: static', force%size_scale(2.0_wp, 1.0_wp), 2.0_wp, 0.0_wp)
      force = new_pulse(-4.0_wp, 0.125_wp)
      call check_close('short pulse: impulse', force%size_scale(2.0_wp, 1.0_wp), 0.25_wp, 0.0_wp)
      call new_force_table([0.0_wp, 0.25_wp, 0.5_wp], [0.0_wp, 1.0_wp, 0.0_wp], force, error)
      call check_close('triangle: impulse', force%size_scale(2.0_wp, 2.0_wp), 0.25_wp, 0.0_wp)
   end subroutine test_scale

   !> An integrator restarts where a force begins, bends or jumps, but not in a rest at 0, at the
   !> samples of a smooth force, or between two times that round-off separates.
   subroutine test_kinks()
      real(wp), parameter :: step = 0.01_wp
      integer, parameter :: nodes = 100
      real(wp) :: t(nodes), f(nodes)
      type(excitation_t) :: force
      type(error_t), allocatable :: error
      integer :: k

      force = new_pulse(2.0_wp, 0.1_wp)
      call check('kinks of a pulse', all(force%kinks() .eqv. [.false., .true.]))
      t = [(k*step, k=1, nodes)]
      f = 0
      f(11) = 1
      call new_force_table(t, f, force, error)
      call check('kinks of a blow', all(force%kinks() .eqv. [(abs(k - 11) <= 1, k=1, nodes)]))
      ! From sample to sample the slope changes by at most 3 % of the largest one; it ends at the
      ! last sample.
      call new_force_table(t, sin(3*t) - sin(3*t(nodes)), force, error)
      call check('kinks of a sampled sine', all(force%kinks() .eqv. [(k == nodes, k=1, nodes)]))
      call new_force_table([0.0_wp, 1.0_wp, nearest(1.0_wp, 2.0_wp), 2.0_wp], &
         [0.0_wp, 0.0_wp, 1.0_wp, 1.0_wp], force, error)
      call check('kinks beside a jump', all(force%kinks() .eqv. [.false., .false., .true., .true.]))
   end subroutine test_kinks

end program test_excitation
