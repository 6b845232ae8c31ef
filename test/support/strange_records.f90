!> Records as strangers have them, made with a seed: an aluminium strip with a sensor that is let
!> go, a second mode that may be weak or soon gone, multiples of the first mode, mains, gaps, uneven
!> stamps, damping that depends on the amplitude, noise with a memory, and poor start values.
module strange_records
   use beamid_equations, only: equations_t, new_equations
   use beamid_errors, only: error_t
   use beamid_excitation, only: new_free, new_pulse
   use beamid_experiments, only: experiment_t
   use beamid_fitted_modes, only: fitted_mode_t, fitted_modes
   use beamid_galerkin, only: galerkin_t, mesh_t, new_galerkin
   use beamid_identification, only: identify, model_t, stage_fit_t, stage_t
   use beamid_kinds, only: wp
   use beamid_modal, only: modal_t
   use beamid_noise, only: gaussian_noise, uniform_noise
   use beamid_projection, only: new_projection, projection_t
   use beamid_responses, only: work_t
   use beamid_spectra, only: noise_near
   use beamid_structure, only: sensor_t, structure_t
   use beamid_verdicts, only: new_verdict, verdict_t
   use models, only: model_of, stage_of
   implicit none
   private

   public :: strange_t, new_strange_record, verdict_on
   public :: right, declared, failed, wrong, vague

   !> What became of a record: the second mode and E are right; the program says that the second
   !> mode is not there; no result; a wrong one whose interval holds the truth, or does not.
   integer, parameter :: right = 1, declared = 2, failed = 3, vague = 4, wrong = 5

   type :: strange_t
      type(experiment_t) :: experiment
      type(structure_t) :: truth
      type(model_t) :: model            !< with the start values
      real(wp) :: frequency(2) = 0      !< of the modes
      real(wp) :: gain = 0              !< what J falls by with mode 2 over the noise around it
      real(wp) :: length_error = 0
   end type strange_t

   type(mesh_t), parameter :: mesh = mesh_t(elements=8)
   character(len=5), parameter :: names(4) = [character(len=5) :: 'E', 'm_S', 'c_D', 'gamma']
   real(wp), parameter :: two_pi = 2*acos(-1.0_wp)

contains

   !> length        [m]; 0: one of .3, .4, .5, .6
   !> gone          whether mode 2 has died out after half a second; left out: one in five
   !> near_multiple whether there is a multiple of mode 1 near mode 2; left out: one in three
   !> length_error  of the model [m]
   subroutine new_strange_record(seed, strange, length, gone, near_multiple, length_error)
      integer, intent(in) :: seed
      type(strange_t), intent(out) :: strange
      real(wp), intent(in), optional :: length, length_error
      logical, intent(in), optional :: gone, near_multiple
      integer, parameter :: n_draws = 60
      real(wp) :: u(n_draws), first, span, sd
      complex(wp) :: s(3), amplitude(3)
      real(wp), allocatable :: t(:), z(:), clean(:)
      integer :: next, k, m, n
      logical :: is_gone, has_multiple

      u = uniform_noise(n_draws, 7919*seed + 11)
      next = 0
      associate (truth => strange%truth)
         truth = structure_t(length=0.3_wp + 0.1_wp*int(4*draw()), rho=0.27_wp, &
            E=6.5e10_wp*exp(0.2_wp*(draw() - 0.5_wp)), I=0.05_wp*0.002_wp**3/12, &
            c_D=1e6_wp*2.5_wp**draw(), gamma=0.04_wp*3**draw())
         if (present(length)) truth%length = length
         truth%sensor(1) = sensor_t(m_S=0.003_wp + 0.004_wp*draw(), x_S=truth%length - 0.06_wp)
         call roots_of(truth, s)
         is_gone = draw() < 0.2_wp
         if (present(gone)) is_gone = gone
         if (is_gone) s(2) = cmplx(-6 - 4*draw(), aimag(s(2)), wp)
         has_multiple = draw() < 0.35_wp
         if (present(near_multiple)) has_multiple = near_multiple
         strange%frequency = aimag(s(:2))/two_pi
         first = merge(0.1_wp, 0.8_wp, draw() < 0.5_wp) + 0.2_wp*draw()
         span = 3 + 3*draw()
         m = int(span*10*strange%frequency(2))
         t = first + span/m*([(k, k=0, m - 1)] + 0.4_wp*draw()*uniform_noise(m, seed))
         if (draw() < 0.4_wp) t = with_gap(t, first + span*draw(), 0.1_wp + 0.4_wp*draw())
         m = size(t)
         amplitude = 10*[1.0_wp, 10**(-2.2_wp + 2.2_wp*draw()), &
            10**(-3 + 1.5_wp*draw())] &
            *exp(cmplx(0.0_wp, two_pi*[draw(), draw(), draw()], wp))
         allocate (z(m), source=0.0_wp)
         ! From t = 0 on for what dies out soon, so that a late beginning finds little of it.
         z = real(first_mode(draw()))
         z = z + real(amplitude(2)*exp(s(2)*t) + amplitude(3)*exp(s(3)*t))
         clean = z
         do k = 1, 3
            if (draw() > 0.5_wp) cycle
            call add_multiple(2 + int(7*draw()))
         end do
         if (has_multiple) call add_multiple(7)
         if (draw() < 0.4_wp) then
            n = 50 + 10*int(2*draw())
            z = z + 10*10**(-3.3_wp + 1.3_wp*draw())*sin(two_pi*n*t + draw())
         end if
         sd = 10*10**(-3 + 1.5_wp*draw())
         z = z + coloured(m, sd, merge(0.0_wp, 0.95_wp*draw(), draw() < 0.4_wp)) + 0.3_wp
         strange%model = model_of(truth, new_free(2))
         associate (guess => strange%model%structure)
            guess%E = truth%E*1.3_wp**(2*draw() - 1)
            guess%sensor(1)%m_S = truth%sensor(1)%m_S*3**(2*draw() - 1)
            guess%c_D = 3e6_wp*4**(2*draw() - 1)
            guess%gamma = 0.07_wp*3**(2*draw() - 1)
            if (present(length_error)) then
               strange%length_error = length_error
               guess%length = truth%length + length_error
               guess%sensor(1)%x_S = guess%length - 0.06_wp
            end if
         end associate
      end associate
      strange%experiment = experiment_t(t, z, new_free(2))
      strange%gain = gain_of(t, z, s)

   contains

      real(wp) function draw()
         next = next + 1
         draw = u(next)
      end function draw

      !> Its damping falls with its amplitude, and its frequency rises by as little.
      function first_mode(strength) result(motion)
         real(wp), intent(in) :: strength
         complex(wp) :: motion(size(t))
         real(wp) :: decayed(size(t))

         decayed = exp(real(s(1))*(t - first))
         motion = amplitude(1)*decayed/(1 + 0.5_wp*strength*(1 - decayed)) &
            *exp(cmplx(0.0_wp, aimag(s(1))*(t - first) - 0.05_wp*strength*(1 - decayed), wp))
      end function first_mode

      !> n times the phase of the first mode.
      subroutine add_multiple(n)
         integer, intent(in) :: n
         complex(wp) :: motion(size(t))

         motion = first_mode(0.0_wp)/10
         z = z + 10*10**(-3.5_wp + 1.5_wp*draw())*real((motion/abs(motion))**n) &
            *abs(motion)**(1 + (n - 1)*draw())
      end subroutine add_multiple

      !> A moving average that forgets by `memory` from sample to sample.
      function coloured(m, sd, memory) result(noise)
         integer, intent(in) :: m
         real(wp), intent(in) :: sd, memory
         real(wp) :: noise(m)
         integer :: k

         noise = gaussian_noise(m, sd, seed + 5)
         do k = 2, m
            noise(k) = memory*noise(k - 1) + sqrt(1 - memory**2)*noise(k)
         end do
      end function coloured

   end subroutine new_strange_record

   function with_gap(t, begin, length) result(rest)
      real(wp), intent(in) :: t(:), begin, length
      real(wp), allocatable :: rest(:)

      rest = pack(t, t < begin .or. t > begin + length)
   end function with_gap

   !> The lowest three roots of a structure.
   subroutine roots_of(structure, s)
      type(structure_t), intent(in) :: structure
      complex(wp), intent(out) :: s(3)
      type(galerkin_t), target :: galerkin
      type(equations_t), target :: equations
      type(modal_t) :: solver
      type(work_t) :: work
      type(error_t), allocatable :: error
      complex(wp), allocatable :: found(:), ds(:, :)
      logical, allocatable :: together(:)

      galerkin = new_galerkin(mesh, structure%length)
      call solver%prepare(galerkin, error)
      equations = new_equations(galerkin, structure, new_pulse(0.0_wp, 1.0_wp))
      call solver%lowest_roots(equations, [integer ::], 3, found, ds, together, work, error)
      s = found
   end subroutine roots_of

   !> What the second mode adds to a fit with the true frequencies.
   real(wp) function gain_of(t, z, s) result(gain)
      real(wp), intent(in) :: t(:), z(:)
      complex(wp), intent(in) :: s(:)
      type(projection_t) :: projection
      type(error_t), allocatable :: error
      real(wp) :: phi(size(t), 5), rest(size(t), 2), c(5)
      integer :: k

      phi(:, 1) = 1
      do k = 1, 2
         phi(:, 2*k) = real(exp(s(k)*(t - t(1))))
         phi(:, 2*k + 1) = aimag(exp(s(k)*(t - t(1))))
      end do
      do k = 1, 2
         rest(:, k) = z
         call new_projection(phi(:, :1 + 2*k), projection, error)
         call projection%coefficients(rest(:, k), c(:1 + 2*k))
      end do
      gain = (sum(rest(:, 1)**2) - sum(rest(:, 2)**2))/noise_near(t, rest(:, 2), &
         aimag(s(2))/two_pi, -real(s(2)))
   end function gain_of

   !> Identifies with automatic start values, and judges.
   !>
   !> found  not allocated: no result
   subroutine verdict_on(strange, verdict, found, error)
      type(strange_t), intent(in) :: strange
      integer, intent(out) :: verdict
      type(stage_fit_t), allocatable, intent(out) :: found(:)
      type(error_t), allocatable, intent(out) :: error
      type(stage_t) :: stage
      type(fitted_mode_t), allocatable :: modes(:)
      type(verdict_t) :: judged
      real(wp) :: off

      stage = stage_of(names, offset=.true.)
      stage%automatic = .true.
      call identify(strange%model, mesh, [stage], [strange%experiment], found, error)
      verdict = failed
      if (allocated(error)) return
      if (found(1)%doubt /= '') return
      verdict = declared
      if (found(1)%note /= '') return
      call new_verdict([strange%experiment], mesh, found(1), judged, error)
      if (judged%no_fit /= '') return
      call fitted_modes(mesh, found(1), 2, modes, error)
      associate (E => found(1)%quantities(1)%value, width => &
         found(1)%statistics%corrected_half_width(1), truth => strange%truth%E)
         ! A length off by a per cent moves E by four.
         off = abs(E/truth - 1) - 5*abs(strange%length_error)/strange%truth%length
         if (abs(modes(2)%frequency/strange%frequency(2) - 1) < 3e-3_wp .and. &
            off < max(0.02_wp, 2*width/truth)) then
            verdict = right
         else
            verdict = merge(vague, wrong, abs(E - truth) < 2*width)
         end if
      end associate
   end subroutine verdict_on

end module strange_records
