!> Springs to the ground of any stiffness: the clamp that hardly gives way and the one that does
!> not, in responses, derivatives and fits; structures with soft clamps and heavy ends on fine
!> meshes.
program test_clamps
   use attached_beams, only: poles_of
   use beamid_cvode, only: cvode_t
   use beamid_equations, only: equations_t, new_equations
   use beamid_errors, only: error_t
   use beamid_excitation, only: new_pulse
   use beamid_galerkin, only: galerkin_of, galerkin_t, mesh_t, new_galerkin
   use beamid_identification, only: identify, model_t, simulate, simulation_t, stage_fit_t
   use beamid_kinds, only: wp
   use beamid_modal, only: modal_t
   use beamid_noise, only: gaussian_noise
   use beamid_observation, only: observation_t
   use beamid_poles, only: poles_t
   use beamid_responses, only: response_t, work_t
   use beamid_strings, only: to_text
   use beamid_structure, only: of_kappa_R, structure_t
   use checks, only: check, check_close, finish, held_root
   use exact_motions, only: grid => galerkin
   use models, only: model_of, stage_of
   use random_experiments, only: random_structure
   use random_numbers, only: decades, start_random, uniform
   implicit none

   call start_random(20261122)
   call test_limit()
   call test_fine_meshes()
   call test_fits()
   call finish('clamps')

contains

   !> The strip of the tests, with a tip mass.
   function strip() result(s)
      type(structure_t) :: s

      s = structure_t(length=0.5_wp, rho=0.27_wp, E=6.4e10_wp, I=0.05_wp*0.002_wp**3/12, &
         c_D=6e6_wp, m_T=0.02_wp, gamma=0.07_wp)
   end function strip

   !> Response, and its derivative with respect to the compliance of the clamp.
   subroutine respond(structure, integrals, times, response, sensitivity)
      type(structure_t), intent(in) :: structure
      type(galerkin_t), intent(in), target :: integrals
      real(wp), intent(in) :: times(:)
      type(response_t), intent(out) :: response, sensitivity
      type(response_t), allocatable :: all(:)
      type(modal_t) :: solver
      type(error_t), allocatable :: error
      type(work_t) :: work
      type(equations_t), target :: equations

      equations = new_equations(integrals, structure, new_pulse(1.0_wp, times(2)))
      call solver%prepare(integrals, error)
      if (.not. allocated(error)) call solver%differentiate(equations, new_pulse(1.0_wp, &
         times(2)), times, [of_kappa_R], response, all, work, error)
      call check('a response, compliance '//to_text(structure%end(1)%kappa_R), &
         .not. allocated(error))
      if (.not. allocated(error)) sensitivity = all(1)
   end subroutine respond

   !> A compliance of 0 on a mesh whose root may turn is the clamp itself, by both solvers, and a
   !> small one is next to it: the difference is the derivative at 0 times the compliance.
   subroutine test_limit()
      type(structure_t) :: s
      type(galerkin_t), target :: clamped, turning
      type(response_t) :: exact, held, slope, near, unused
      type(equations_t), target :: equations
      type(cvode_t) :: integrator
      type(work_t) :: work
      type(error_t), allocatable :: error
      real(wp) :: kappa, size_of_slope
      integer :: i, k, n
      real(wp) :: times(100)

      do n = 1, 3
         s = random_structure()
         s%end(1)%kappa_R = 0
         s%end(1)%c_R = 0
         if (n == 3) s = strip()
         times = [(0.2_wp*i/s%omega(), i=1, size(times))]
         k = 4**n
         clamped = new_galerkin(mesh_t(3, k, 4, 1), s%length)
         turning = new_galerkin(mesh_t(3, k, 4, 1), s%length, held_root(.true.))
         call respond(s, clamped, times, exact, unused)
         call respond(s, turning, times, held, slope)
         associate (name => 'clamp '//to_text(n)//', ')
            ! Round-off of frequencies, 1e-13, times the phases, 100 and more.
            call check_close(name//'displacement', maxval(abs(held%displacement &
               - exact%displacement))/maxval(abs(exact%displacement)), 0.0_wp, 1e-10_wp)
            size_of_slope = maxval(abs(slope%displacement))
            do i = 1, 3
               kappa = 10.0_wp**(-i - 3)*maxval(abs(exact%displacement))/size_of_slope
               s%end(1)%kappa_R = kappa
               call respond(s, turning, times, near, unused)
               ! The second derivative is a few times the square of the first over the motion, since
               ! all modes move; 1e-10 as above.
               call check_close(name//'next to it '//to_text(i), maxval(abs(near%displacement &
                  - held%displacement - kappa*slope%displacement))/(kappa*size_of_slope), 0.0_wp, &
                  100*10.0_wp**(-i - 3) + 1e-10_wp*10.0_wp**(i + 3))
            end do
         end associate
         s%end(1)%kappa_R = 0
         if (n > 1) cycle
         integrator = cvode_t(rtol=1e-10_wp)
         equations = new_equations(turning, s, new_pulse(1.0_wp, times(2)))
         call integrator%respond(equations, new_pulse(1.0_wp, times(2)), times, near, work, error)
         call check('clamp, cvode: a response', .not. allocated(error))
         if (allocated(error)) cycle
         ! A few hundred times its tolerance, as elsewhere.
         call check_close('clamp, cvode: displacement', maxval(abs(near%displacement &
            - exact%displacement))/maxval(abs(exact%displacement)), 0.0_wp, 1e-7_wp)
      end do
   end subroutine test_limit

   !> Random structures on 2 to 40 elements, a tenth of them on clamps that are stiffer by up to
   !> twelve orders: none is refused. Inside, the residues are compared with their sums.
   subroutine test_fine_meshes()
      type(structure_t) :: s
      type(poles_t) :: poles
      type(error_t), allocatable :: error
      integer :: number, refused, elements

      refused = 0
      do number = 1, 400
         s = random_structure()
         if (uniform() < 0.1_wp) s%end(1)%kappa_R = s%end(1)%kappa_R*decades(-12.0_wp, 0.0_wp)
         elements = int(decades(log10(2.0_wp), log10(41.0_wp)))
         grid = galerkin_of(mesh_t(3, elements, 4, 1), s)
         if (uniform() < 0.3_wp) grid = galerkin_of(mesh_t(5, elements, 6, 1), s)
         call poles_of(s, poles, error)
         if (allocated(error)) refused = refused + 1
      end do
      call check('fine meshes: none of 400 structures refused', refused == 0, to_text(refused))
   end subroutine test_fine_meshes

   !> Records of a clamp that can hardly be told from a rigid one: whether a fit ends at an infinite
   !> stiffness or not, the interval of E holds the truth in 95 % of 60 records; 50 and fewer come
   !> once in 2000 times. The estimate of k_R is above 0, its interval ends at or below infinity.
   subroutine test_fits()
      type(model_t) :: model
      type(simulation_t) :: clean
      type(stage_fit_t), allocatable :: fits(:)
      type(error_t), allocatable :: error
      real(wp) :: times(400), ends(3), sd
      integer :: i, k, right, infinite, failed
      character(len=:), allocatable :: why
      type(mesh_t), parameter :: mesh = mesh_t(3, 4, 4, 1)

      times = [(0.02_wp + 0.005_wp*i, i=1, 400)]
      model = model_of(strip(), new_pulse(1.0_wp, 0.01_wp), observation_t(3, 0.0_wp))
      model%structure%end(1)%kappa_R = 1/5000.0_wp
      call simulate(model, mesh, times, clean, error)
      call check('a record', .not. allocated(error))
      if (allocated(error)) return
      sd = 0.1_wp*norm2(clean%acceleration)/sqrt(real(size(times), wp))
      why = ''
      right = 0
      infinite = 0
      failed = 0
      do k = 1, 60
         call identify(model, mesh, [stage_of(['E  ', 'k_R'], [6.38e10_wp, 2000.0_wp])], times, &
            clean%acceleration + sd*gaussian_noise(size(times), 1.0_wp, 100 + k), fits, error)
         if (allocated(error)) then
            failed = failed + 1
            why = error%message
            cycle
         end if
         associate (f => fits(1))
            ends = f%quantities(1)%limits(f%statistics%std_error(1), f%statistics%half_width(1))
            if (ends(2) <= model%structure%E .and. ends(3) >= model%structure%E) right = right + 1
            ends = f%quantities(2)%limits(f%statistics%std_error(2), f%statistics%half_width(2))
            if (f%quantities(2)%value > huge(1.0_wp)) infinite = infinite + 1
            call check('fit '//to_text(k)//': interval of k_R', ends(2) > 0 .and. &
               ends(2) < f%quantities(2)%value .and. ends(3) >= f%quantities(2)%value)
         end associate
      end do
      call check('fits: none failed', failed == 0, to_text(failed)//why)
      call check('fits: some end at infinity, most do not', infinite > 0 .and. infinite < 60, &
         to_text(infinite))
      call check('fits: intervals of E hold the truth', right > 50, to_text(right))
   end subroutine test_fits

end program test_clamps
