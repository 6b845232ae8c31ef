!> Derivatives of motions with respect to what hangs on a beam, and to everything else, against
!> differences in quadruple precision.
program test_attachment_derivatives
   use attached_beams, only: coarse, everything, experiment_on, references
   use beamid_equations, only: equations_t, new_equations
   use beamid_errors, only: error_t
   use beamid_kinds, only: wp
   use beamid_parameters, only: free_names
   use beamid_strings, only: to_text
   use beamid_structure, only: at_tip, of_c_H, of_c_R, of_g, of_gamma, of_J_S, of_J_T, of_k_H, &
      of_kappa_R, of_length, of_m_H, of_m_S, of_m_T, of_x_S
   use checks, only: check, check_close, finish, in_long_run
   use exact_motions, only: exact, galerkin, kinds, prepare, relative
   use random_experiments, only: experiment_t, random_structure
   use random_numbers, only: start_random
   implicit none

   !> Those that do not act between all modes at once, of structures with a soft root, and how many.
   integer :: k
   integer, parameter :: all(*) = [(k, k=1, of_g - 1), of_kappa_R, of_c_R, of_m_S, of_J_S, of_x_S, &
      of_m_H, of_c_H, of_k_H], every = size(all)

   !> What many structures showed of one motion or its derivative.
   type :: tally_t
      integer :: compared = 0, beyond = 0, worst_at = 0
      !> relative, in the 2-norm over the samples; of a derivative times the parameter, relative to
      !> the motion
      real(wp) :: worst = 0, worst_of_motion = 0
   end type tally_t

   call start_random(674017406)
   call test_at_zero()
   call start_random(709429935)
   call test_many()
   call finish('attachment_derivatives')

contains

   !> Derivatives where a parameter is 0, or the sensor where it is by default: those of a fit that
   !> starts there, against one-sided differences; the same when a plain response was asked for
   !> before; and the sensor near the root, and at the tip.
   subroutine test_at_zero()
      integer, parameter :: some(7) = [of_m_T, of_gamma, of_J_T, of_kappa_R, of_c_R, of_m_S, &
         of_x_S]
      character(len=*), parameter :: names(9) = [character(len=20) :: 'J_T = 0', 'm_S = 0', &
         'gamma = 0', 'all of them 0', 'x_S by default', 'J_T = 0, x_S default', &
         'x_S = .001 l', 'x_S = l', 'nothing at all'], &
         roots(2) = [character(len=10) :: 'soft root', 'rigid root']
      type(experiment_t) :: e
      type(error_t), allocatable :: error
      real(wp), allocatable, dimension(:, :) :: columns, known
      real(wp), allocatable, dimension(:, :, :) :: derivatives, later, reference
      character(len=:), allocatable :: name
      real(wp) :: allowed
      logical :: lost
      integer :: i, k, m, root

      do root = 1, 2
         do i = 1, size(names)
            e = experiment_on(everything)
            e%mesh = coarse
            if (root == 2) e%structure%end(1)%kappa_R = 0
            associate (s => e%structure)
               if (any(i == [1, 4, 6, 9])) s%J_T = 0
               if (any(i == [2, 4, 9])) s%sensor(1)%m_S = 0
               if (any(i == [3, 4, 9])) s%gamma = 0
               if (any(i == [5, 6, 9])) s%sensor(1)%x_S = at_tip
               if (i == 7) s%sensor(1)%x_S = 0.001_wp
               if (i == 8) s%sensor(1)%x_S = 1
               if (i == 9) s%m_T = 0
               if (i == 9) s%hose(1)%m_H = 0
            end associate
            name = trim(names(i))//', '//trim(roots(root))
            call prepare(e)
            call exact(e, some, columns, derivatives, error)
            call check(name//': derivatives', .not. allocated(error))
            call references(e, some, known, reference, lost)
            call check(name//': a reference', .not. lost)
            call prepare(e)
            call exact(e, [integer ::], columns, later, error)
            call exact(e, some, columns, later, error)
            if (allocated(error)) then
               call check(name//': derivatives after a response', .false., error%message)
               cycle
            end if
            do k = 1, size(some)
               if (root == 2 .and. any(some(k) == [of_kappa_R, of_c_R])) cycle
               do m = 1, 3
                  ! Sums over roots of relative error 1e-14 times the phase, 1e2; the acceleration
                  ! has all modes in it. A sensor near the root that is as heavy as the beam moves
                  ! the motion by 1e-9 of itself: of the motion, round-off counts.
                  allowed = 1e-9_wp
                  if (e%structure%get(some(k)) > 0) allowed = max(allowed, 1e-13_wp/ &
                     e%structure%get(some(k))*norm2(known(:, m))/norm2(reference(:, m, k)))
                  call check_close(name//', '//trim(kinds(m))//' by '// &
                     trim(free_names(some(k))), relative(derivatives(:, m, k), &
                     reference(:, m, k)), 0.0_wp, allowed)
                  call check_close(name//', after a response, '//trim(kinds(m))//' by '// &
                     trim(free_names(some(k))), relative(later(:, m, k), &
                     reference(:, m, k)), 0.0_wp, allowed)
               end do
            end do
         end do
      end do
   end subroutine test_at_zero

   !> Derivatives of 150 random structures, in long runs 300, with respect to all parameters. The
   !> differences themselves are right to 1e-15 or so: what shows is the round-off of double
   !> precision.
   subroutine test_many()
      type(experiment_t) :: e
      type(tally_t) :: tallies(0:every, size(kinds))
      type(error_t), allocatable :: error
      real(wp), allocatable, dimension(:, :) :: columns, known
      real(wp), allocatable, dimension(:, :, :) :: derivatives, reference
      character(len=:), allocatable :: name
      real(wp) :: sudden(size(kinds))
      integer :: structures, number, k, m, refused, unknown
      logical :: lost

      structures = merge(300, 150, in_long_run())
      refused = 0
      unknown = 0
      do number = 1, structures
         e = experiment_on(random_structure())
         call prepare(e)
         call exact(e, all, columns, derivatives, error)
         if (allocated(error)) then
            refused = refused + 1
            print '(a,i0,2a)', '      structure ', number, ': ', error%message
            cycle
         end if
         call references(e, all, known, reference, lost)
         if (lost) then
            unknown = unknown + 1
            cycle
         end if
         ! What is left of the acceleration that a force causes at once is known to the condition
         ! of M, 1e9 with a heavy J_T on a root that turns, times round-off of that.
         sudden = merge(1, 0, kinds == 'acceleration')*acceleration_at_once(e)
         do m = 1, size(kinds)
            call count_in(tallies(0, m), number, columns(:, m), known(:, m), &
               [known(:, m), sudden(m)], 1.0_wp)
            do k = 1, every
               call count_in(tallies(k, m), number, derivatives(:, m, k), reference(:, m, k), &
                  known(:, m), e%structure%get(all(k)))
            end do
         end do
      end do
      call check('derivatives: none refused', refused == 0, to_text(refused))
      call check('derivatives: references for all', unknown == 0, to_text(unknown))
      do m = 1, size(kinds)
         call check_close('motions, '//trim(kinds(m))//' (structure '// &
            to_text(tallies(0, m)%worst_at)//'), worst of '// &
            to_text(tallies(0, m)%compared), tallies(0, m)%worst_of_motion, 0.0_wp, 1e-9_wp)
         do k = 1, every
            name = trim(kinds(m))//' by '//trim(free_names(all(k)))
            associate (tally => tallies(k, m))
               ! Of a derivative that hardly counts (a motion changes by 1e-6 when the parameter
               ! doubles) few digits are left, but what it says of the motion is right. The length
               ! has four times the effect of E: frequencies go with l**-2 and E**(1/2).
               call check(name//': at most 3 % beyond 1e-7', 100*tally%beyond <= 3*structures, &
                  to_text(tally%beyond)//' of '//to_text(tally%compared)//', worst '// &
                  to_text(tally%worst))
               call check_close(name//', of the motion, worst of '//to_text(tally%compared)// &
                  ' (structure '//to_text(tally%worst_at)//')', tally%worst_of_motion, 0.0_wp, &
                  merge(4e-7_wp, 1e-7_wp, all(k) == of_length))
            end associate
         end do
      end do
   end subroutine test_many

   !> The largest acceleration that the force causes at once.
   real(wp) function acceleration_at_once(e) result(a)
      type(experiment_t), intent(in) :: e
      type(equations_t), target :: equations
      real(wp), allocatable :: x(:)
      logical :: positive

      equations = new_equations(galerkin, e%structure, e%excitation)
      x = equations%load
      call equations%mass%factor(positive)
      call equations%mass%solve(x)
      a = maxval(abs(e%excitation%f))*abs(dot_product(equations%observer, x))
   end function acceleration_at_once

   !> One motion of one structure.
   subroutine count_in(tally, number, found, expected, motion, parameter)
      type(tally_t), intent(inout) :: tally
      integer, intent(in) :: number
      real(wp), intent(in) :: found(:), expected(:), motion(:), parameter
      real(wp) :: wrong, of_motion

      wrong = relative(found, expected)
      of_motion = wrong*parameter*norm2(expected)/norm2(motion)
      tally%compared = tally%compared + 1
      if (.not. wrong <= 1e-7_wp) tally%beyond = tally%beyond + 1
      if (.not. wrong <= tally%worst) tally%worst = wrong
      if (of_motion <= tally%worst_of_motion) return
      tally%worst_of_motion = of_motion
      tally%worst_at = number
   end subroutine count_in

end program test_attachment_derivatives
