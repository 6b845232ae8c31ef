!> The exact response refuses nothing: wide random structures, a clamp that gives way or is next to
!> rigid, up to 128 elements. A few against the whole first-order system in quadruple precision,
!> which knows of no roots.
program test_any_structure
   use beamid_equations, only: equations_t, new_equations
   use beamid_errors, only: error_t
   use beamid_excitation, only: excitation_t, new_force_table, new_pulse
   use beamid_galerkin, only: galerkin_of, galerkin_t, mesh_t
   use beamid_kinds, only: wp
   use beamid_modal, only: modal_t
   use beamid_responses, only: response_t, work_t
   use beamid_strings, only: to_text
   use beamid_structure, only: of_c_D, of_c_R, of_E, of_gamma, of_J_T, of_kappa_R, of_length, &
      of_m_H, of_m_S, of_m_T, of_rho, of_x_S, structure_t
   use checks, only: check, check_close, finish, in_long_run
   use full_matrices, only: full_t, new_full, qp
   use random_experiments, only: wide_structure
   use random_numbers, only: decades, start_random, uniform
   implicit none

   integer, parameter :: samples = 24, nodes = 9
   integer, parameter :: places(*) = [of_m_T, of_E, of_c_D, of_m_H, of_rho, of_gamma, of_J_T, &
      of_kappa_R, of_c_R, of_length, of_m_S, of_x_S]
   type(galerkin_t), target :: galerkin

   if (in_long_run()) then
      call test_all(745739799, 2000)
      call test_all(20251122, 2000)
      call test_all(31415926, 2000)
      call test_all(271828, 2000)
   else
      call test_all(745739799, 200)
   end if
   call test_some(merge(400, 12, in_long_run()))
   call test_impossible()
   call finish('any_structure')

contains

   !> A structure and a mesh for it: as many elements as `most`, evenly by their logarithm. One in
   !> ten has a clamp stiffer by up to twelve decades.
   subroutine draw(most, s)
      integer, intent(in) :: most
      type(structure_t), intent(out) :: s
      type(mesh_t) :: mesh

      s = wide_structure()
      if (uniform() < 0.1_wp) s%end(1)%kappa_R = s%end(1)%kappa_R*decades(-12.0_wp, 0.0_wp)
      mesh = mesh_t(3, int(decades(log10(2.0_wp), log10(most + 1.0_wp))), 4, 1)
      if (uniform() < 0.3_wp) mesh = mesh_t(5, mesh%elements, 6, 1)
      galerkin = galerkin_of(mesh, s)
   end subroutine draw

   !> A force of random nodes, twenty-four samples over four periods or so of the first mode.
   subroutine drive(s, f, excitation, times)
      type(structure_t), intent(in) :: s
      real(wp), intent(out) :: f(nodes), times(samples)
      type(excitation_t), intent(out) :: excitation
      type(error_t), allocatable :: error
      integer :: i

      f = [(2*uniform() - 1, i=1, nodes)]
      times = [(i/s%omega(), i=1, samples)]
      call new_force_table([((i - 1)/s%omega(), i=1, nodes)], f, excitation, error)
   end subroutine drive

   !> No structure is refused.
   subroutine test_all(seed, structures)
      integer, intent(in) :: seed, structures
      type(structure_t) :: s
      type(equations_t), target :: equations
      type(excitation_t) :: excitation
      type(modal_t) :: solver
      type(response_t) :: response
      type(response_t), allocatable :: slopes(:)
      type(work_t) :: work
      type(error_t), allocatable :: error
      real(wp) :: f(nodes), times(samples)
      integer :: number, refused

      call start_random(seed)
      refused = 0
      do number = 1, structures
         call draw(128, s)
         call drive(s, f, excitation, times)
         equations = new_equations(galerkin, s, excitation, matrices=.false.)
         call solver%prepare(galerkin, error)
         if (.not. allocated(error)) call solver%differentiate(equations, excitation, times, &
            [of_E, of_c_D], response, slopes, work, error)
         if (.not. allocated(error)) cycle
         refused = refused + 1
         print '(a,i0,a,i0,2a)', '      structure ', number, ', ', galerkin%mesh%elements, &
            ' elements: ', error%message
      end do
      call check('of '//to_text(structures)//' structures none is refused', refused == 0, &
         to_text(refused))
   end subroutine test_all

   !> Motions to 1e-8 of their largest, and what they change by when a parameter doubles to 1e-6:
   !> three parameters of each structure, on up to 12 elements, whose system has an exponential in
   !> quadruple precision within a second. The roots themselves are good to 1e-12 or so, less the
   !> condition of M and K, 1e4 with masses and springs of a thousand beams. Central differences
   !> of 1e-12; the exponential of a system with a clamp that is next to rigid has some 15 digits
   !> left of 34, and 1e-9 has to do there. (With 1e-8 the third derivative shows, 2e-6 in one of
   !> 400.)
   subroutine test_some(structures)
      integer, intent(in) :: structures
      type(structure_t) :: s
      type(equations_t), target :: equations
      type(excitation_t) :: excitation
      type(modal_t) :: solver
      type(response_t) :: response
      type(response_t), allocatable :: slopes(:)
      type(work_t) :: work
      type(error_t), allocatable :: error
      type(full_t) :: full, moved
      real(qp), dimension(samples, 3) :: known, changed, above, below
      real(wp) :: f(nodes), times(samples), worst(2), off(2), scale, step
      integer :: i, k, number, p, free(3), beyond(2)

      call start_random(20261123)
      worst = 0
      beyond = 0
      do number = 1, structures
         call draw(12, s)
         call drive(s, f, excitation, times)
         free = [(places(1 + int(size(places)*uniform())), i=1, 3)]
         equations = new_equations(galerkin, s, excitation, matrices=.false.)
         call solver%prepare(galerkin, error)
         call solver%differentiate(equations, excitation, times, free, response, slopes, work, &
            error)
         call check('a response', .not. allocated(error))
         if (allocated(error)) cycle
         full = new_full(galerkin, s, excitation)
         call full%motions(1/real(s%omega(), qp), f, known)
         off = 0
         do k = 1, 3
            off(1) = max(off(1), apart(response, known(:, k), k)/real(maxval(abs(known(:, k))), wp))
         end do
         do p = 1, size(free)
            associate (at => free(p))
               if (.not. s%get(at) > 0 .or. s%follows_tip(at)) cycle
               step = 1e-12_wp*s%get(at)
               if (s%end(1)%kappa_R*s%E*s%I < 1e-8_wp*s%length) step = 1e-9_wp*s%get(at)
               moved = full
               moved%q(at) = full%q(at) + step
               call moved%assemble()
               call moved%motions(1/real(s%omega(), qp), f, above)
               moved%q(at) = full%q(at) - step
               call moved%assemble()
               call moved%motions(1/real(s%omega(), qp), f, below)
               changed = (above - below)/(2*step)
               do k = 1, 3
                  scale = real(maxval(abs(known(:, k))), wp)/s%get(at)
                  off(2) = max(off(2), apart(slopes(p), changed(:, k), k)/max(scale, &
                     real(maxval(abs(changed(:, k))), wp)))
               end do
            end associate
         end do
         if (any(off > [1e-8_wp, 1e-6_wp])) print '(a,i0,a,2es9.1)', &
            '      structure ', number, ':', off
         where (off > [1e-8_wp, 1e-6_wp]) beyond = beyond + 1
         worst = max(worst, off)
         where (.not. off >= 0) worst = huge(worst)
      end do
      print '(a,2es9.1,a,2i4)', '      worst of motions, derivatives', worst, ' beyond', beyond
      call check_close('motions', worst(1), 0.0_wp, 1e-8_wp)
      call check_close('derivatives', worst(2), 0.0_wp, 1e-6_wp)
   end subroutine test_some

   !> Values out of all proportion are refused in words: neither a NaN nor an infinity, and the name
   !> of the parameter. With some BLAS the roots beside a tip mass of 1e250 are found; then the tip
   !> must rest, as a force of 1 moves it by 1e-250 at most.
   subroutine test_impossible()
      integer, parameter :: parameters(*) = [of_m_T, of_c_D, of_gamma, of_J_T]
      character(len=*), parameter :: names(*) = [character(len=5) :: 'm_T', 'c_D', 'gamma', 'J_T']
      type(structure_t) :: s
      type(equations_t), target :: equations
      type(modal_t) :: modal
      type(response_t) :: response
      type(work_t) :: work
      type(error_t), allocatable :: error
      integer :: k

      do k = 1, size(parameters)
         s = structure_t(length=1, rho=1, E=1, I=1)
         call s%set(parameters(k), 1e250_wp)
         galerkin = galerkin_of(mesh_t(3, 4, 4, 1), s)
         call modal%prepare(galerkin, error)
         equations = new_equations(galerkin, s, new_pulse(1.0_wp, 1.0_wp), matrices=.false.)
         call modal%respond(equations, new_pulse(1.0_wp, 1.0_wp), [0.5_wp], response, work, error)
         if (.not. allocated(error)) then
            call check('impossible '//trim(names(k))//': refused, or at rest', names(k) == 'm_T' &
               .and. all(abs([response%displacement, response%velocity, &
               response%acceleration]) < 1e-200_wp))
            cycle
         end if
         call check('impossible '//trim(names(k))//': in words', index(error%message, 'NaN') == 0 &
            .and. index(error%message, 'inf') == 0 .and. index(error%message, ' '// &
            trim(names(k))//' = ') > 0, error%message)
      end do
   end subroutine test_impossible

   !> The largest difference of motion k.
   pure real(wp) function apart(response, known, k)
      type(response_t), intent(in) :: response
      real(qp), intent(in) :: known(:)
      integer, intent(in) :: k

      if (k == 1) apart = real(maxval(abs(response%displacement - known)), wp)
      if (k == 2) apart = real(maxval(abs(response%velocity - known)), wp)
      if (k == 3) apart = real(maxval(abs(response%acceleration - known)), wp)
   end function apart

end program test_any_structure
