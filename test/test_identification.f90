!> Parameters come back from records that the model itself made.
program test_identification
   use, intrinsic :: iso_c_binding, only: c_size_t
   use beamid_cvode, only: cvode_t
   use beamid_errors, only: error_t, status_failed
   use beamid_galerkin, only: mesh_t
   use beamid_identification, only: identify, identify_meshes, model_t, score_fits, simulate, &
      simulation_t, stage_fit_t, stage_t
   use beamid_kinds, only: ip, wp
   use beamid_noise, only: gaussian_noise
   use beamid_parameters, only: free_index
   use beamid_strings, only: to_text
   use checks, only: check, check_close, finish
   use hose_model, only: hosed, mesh, truth
   use models, only: stage_of
   implicit none

   integer :: k
   real(wp), parameter :: samples(30) = [(0.1_wp*k, k=1, 30)]

   !> What the C library has given out (malloc.h), in bytes.
   type, bind(c) :: memory_t
      integer(c_size_t) :: others(7), used, more(2)
   end type memory_t

   interface
      type(memory_t) function memory() bind(c, name='mallinfo2')
         import :: memory_t
      end function memory
   end interface

   call test_recovery(1)
   call test_recovery(2)
   call test_recovery(3)
   call test_stages()
   call test_meshes()
   call test_refused()
   call test_score()
   call test_place_of_force()
   call test_beside_bound()
   call test_memory()
   call finish('identification')

contains

   subroutine record_of(model, measured)
      type(model_t), intent(in) :: model
      real(wp), allocatable, intent(out) :: measured(:)
      type(simulation_t) :: simulation
      type(error_t), allocatable :: error

      call simulate(model, mesh, samples, simulation, error)
      call check('record simulated', .not. allocated(error))
      measured = simulation%acceleration
   end subroutine record_of

   !> Same model, same mesh, same integrator: J = 0 at the truth, and a search that ends where J, or
   !> the step, is at the level of the integrator's noise. That is 1e-10 of each response and some
   !> ten times as much of its acceleration; what it does to a parameter is worse by the condition
   !> of the problem, some hundred: 1e-7, and 1e-6 is asked for.
   subroutine test_recovery(formula)
      integer, intent(in) :: formula
      type(model_t) :: model
      type(stage_fit_t), allocatable :: fits(:)
      type(error_t), allocatable :: error
      real(wp), allocatable :: measured(:)
      character(len=*), parameter :: names(3) = ['m_H', 'c_H', 'k_H']
      real(wp), parameter :: exact(3) = [truth%hose(1)%m_H, truth%hose(1)%c_H, truth%hose(1)%k_H]
      integer :: i

      model = hosed(formula, 1e-10_wp)
      call record_of(model, measured)
      call identify(model, mesh, [stage_of(names, exact*[0.8_wp, 1.2_wp, 1.2_wp])], samples, &
         measured, fits, error)
      if (allocated(error)) then
         call check('formula '//to_text(formula)//': converges', .false., error%message)
         return
      end if
      do i = 1, 3
         call check_close('formula '//to_text(formula)//': '//names(i), &
            fits(1)%fit%estimate(i)/exact(i), 1.0_wp, 1e-6_wp)
         call check_close('formula '//to_text(formula)//': start of '//names(i), &
            fits(1)%fit%start(i)/exact(i), merge(0.8_wp, 1.2_wp, i == 1), 1e-12_wp)
         call check_close('formula '//to_text(formula)//': '//names(i)//' is in the structure', &
            fits(1)%scenario%structures(1)%get(free_index(names(i))), fits(1)%fit%estimate(i), &
            0.0_wp)
      end do
      ! (1e-6)^2 of the sum of squares of the record.
      call check_close('formula '//to_text(formula)//': J', fits(1)%fit%J/sum(measured**2), &
         0.0_wp, 1e-12_wp)
      ! Parameters not free stay as they are; the work of the search is counted.
      call check('formula '//to_text(formula)//': others untouched', &
         abs(fits(1)%scenario%structures(1)%c_D - truth%c_D) <= 0 .and. &
         abs(fits(1)%scenario%structures(1)%E - truth%E) <= 0)
      call check('formula '//to_text(formula)//': counts', fits(1)%stage == 1 .and. &
         fits(1)%elements == mesh%elements .and. &
         fits(1)%work%solves >= fits(1)%fit%evaluations .and. &
         fits(1)%work%steps > fits(1)%work%solves, to_text(fits(1)%work%solves)//' responses')
   end subroutine test_recovery

   !> The second stage starts where the first ended, for parameters with and without starts of their
   !> own; the first alone cannot fit, since c_H is 20 per cent off and held.
   subroutine test_stages()
      type(model_t) :: model
      type(stage_t) :: stages(2)
      type(stage_fit_t), allocatable :: fits(:)
      type(error_t), allocatable :: error
      real(wp), allocatable :: measured(:)

      model = hosed(1, 1e-9_wp)
      call record_of(model, measured)
      model%structure%hose(1)%c_H = 1.2_wp*truth%hose(1)%c_H
      stages(1) = stage_of(['m_H', 'k_H'], [0.8_wp*truth%hose(1)%m_H, 1.2_wp*truth%hose(1)%k_H])
      stages(2) = stage_of(['k_H', 'm_H', 'c_H'])
      call identify(model, mesh, stages, samples, measured, fits, error)
      if (allocated(error)) then
         call check('two stages: converge', .false., error%message)
         return
      end if
      ! A start goes through the change of variable and back: round-off.
      call check_close('two stages: k_H from the first', fits(2)%fit%start(1), &
         fits(1)%fit%estimate(2), 1e-14_wp)
      call check_close('two stages: m_H from the first', fits(2)%fit%start(2), &
         fits(1)%fit%estimate(1), 1e-14_wp)
      call check_close('two stages: c_H from the case', fits(2)%fit%start(3), &
         1.2_wp*truth%hose(1)%c_H, &
         1e-14_wp)
      call check('two stages: the first could not fit', fits(1)%fit%J > 1e-6_wp, &
         to_text(fits(1)%fit%J)//' and '//to_text(fits(2)%fit%J))
      ! As in test_recovery.
      call check_close('two stages: k_H', fits(2)%fit%estimate(1)/truth%hose(1)%k_H, 1.0_wp, &
         1e-6_wp)
      call check_close('two stages: m_H', fits(2)%fit%estimate(2)/truth%hose(1)%m_H, 1.0_wp, &
         1e-6_wp)
      call check_close('two stages: c_H', fits(2)%fit%estimate(3)/truth%hose(1)%c_H, 1.0_wp, &
         1e-6_wp)
   end subroutine test_stages

   !> Several meshes at once are what each would be alone, bit for bit.
   subroutine test_meshes()
      type(mesh_t), parameter :: meshes(3) = [mesh_t(3, 1, 4, 1), mesh, mesh_t(5, 2, 6, 1)]
      type(model_t) :: model
      type(stage_t) :: stage
      type(stage_fit_t), allocatable :: fits(:, :), alone(:)
      type(error_t), allocatable :: error
      real(wp), allocatable :: measured(:)
      integer :: m

      model = hosed(1, 1e-7_wp)
      call record_of(model, measured)
      stage = stage_of(['m_H', 'k_H'], [0.8_wp*truth%hose(1)%m_H, 1.2_wp*truth%hose(1)%k_H])
      call identify_meshes(model, meshes, [stage], samples, measured, fits, error)
      call check('several meshes: converge', .not. allocated(error))
      if (allocated(error)) return
      do m = 1, size(meshes)
         call identify(model, meshes(m), [stage], samples, measured, alone, error)
         call check_close('several meshes: '//to_text(meshes(m)%elements)//' of degree '// &
            to_text(meshes(m)%degree), maxval(abs(fits(1, m)%fit%estimate &
            - alone(1)%fit%estimate)), 0.0_wp, 0.0_wp)
      end do
   end subroutine test_meshes

   !> Fewer samples than parameters; an integrator that gives up: which mesh, which stage, and why.
   subroutine test_refused()
      type(model_t) :: model
      type(stage_t) :: stage
      type(stage_fit_t), allocatable :: fits(:)
      type(error_t), allocatable :: error

      model = hosed(1, 1e-7_wp)
      stage = stage_of(['m_H', 'k_H'])
      call identify(model, mesh, [stage], samples(:1), [0.1_wp], fits, error)
      call refused('one sample, two parameters', error, 'elements = 2, stage 1: ', &
         '1 residuals for 2')
      deallocate (model%solver)
      model%solver = cvode_t(max_steps=20_ip)
      call identify(model, mesh, [stage], samples, 0*samples, fits, error)
      call refused('an integrator that gives up', error, 'elements = 2, stage 1: ', &
         'max_steps = 20')
   end subroutine test_refused

   !> Squared residuals over other samples; one whose square overflows is an error.
   subroutine test_score()
      type(model_t) :: model
      type(stage_fit_t), allocatable :: fits(:, :)
      type(error_t), allocatable :: error
      real(wp), allocatable :: measured(:)

      model = hosed(1)
      call record_of(model, measured)
      call identify_meshes(model, [mesh], [stage_of(['m_H', 'k_H'])], samples, measured, fits, &
         error)
      call check('score: the fit converges', .not. allocated(error))
      if (allocated(error)) return
      measured(3) = measured(3) + 0.5_wp
      call score_fits(model, [mesh], samples, measured, fits, error)
      ! The fit's own J is that of round-off.
      call check_close('score', fits(1, 1)%score, 0.25_wp, 1e-9_wp)
      measured(3) = 1e200_wp
      call score_fits(model, [mesh], samples, measured, fits, error)
      call refused('score that is not finite', error, 'elements = 2, stage 1: ', '1E+200')
   end subroutine test_score

   !> A force acts where its excitation says, or else the structure: the same sums, to the digit.
   subroutine test_place_of_force()
      type(model_t) :: by_excitation, by_structure
      real(wp), allocatable :: at_tip(:), a(:), b(:)

      call record_of(hosed(1), at_tip)
      by_structure = hosed(1)
      by_structure%structure%x_F = 2
      call record_of(by_structure, a)
      by_excitation = hosed(1)
      by_excitation%excitation%x_F = 2
      call record_of(by_excitation, b)
      call check_close('a force at half the length, by the excitation', maxval(abs(b - a)), &
         0.0_wp, 0.0_wp)
      ! Where the static deflection of the tip is 5/16 of what it is under a force there.
      call check('and not at the tip', norm2(b - at_tip) > 0.1_wp*norm2(at_tip), &
         to_text(norm2(b - at_tip)/norm2(at_tip)))
   end subroutine test_place_of_force

   !> Air damping that is not there, from noisy records: estimates lie at the bound 0, or where a
   !> search has left them beside it, or well above; its standard error, relative
   !> to the residuals, is the same but for what the derivative changes up to 3 of them above 0.
   subroutine test_beside_bound()
      type(model_t) :: model
      type(stage_fit_t), allocatable :: fits(:)
      type(error_t), allocatable :: error
      real(wp) :: sd(40), estimate(40)
      real(wp), allocatable :: measured(:)
      integer :: k

      model = hosed(1)
      call record_of(model, measured)
      do k = 1, size(sd)
         call identify(model, mesh, [stage_of(['gamma'], [1e-3_wp])], samples, &
            measured + gaussian_noise(size(samples), 1e-2_wp, k), fits, error)
         if (allocated(error)) exit
         sd(k) = fits(1)%statistics%std_error(1)/sqrt(fits(1)%fit%J)
         estimate(k) = fits(1)%fit%estimate(1)
      end do
      call check('beside a bound: all converge', .not. allocated(error))
      if (allocated(error)) return
      call check('beside a bound: some are', count(estimate < 1e-9_wp) > 5, &
         to_text(count(estimate < 1e-9_wp))//', '//to_text(count(estimate > 0 .and. &
         estimate < 1e-9_wp))//' of them above 0')
      call check_close('beside a bound: the same standard error', maxval(sd)/minval(sd), 1.0_wp, &
         0.05_wp)
   end subroutine test_beside_bound

   !> Twenty more fits leave nothing behind, by either method. What the C library keeps back for the
   !> next request counts as given out: it settles at some 12 kB after 400 fits, where a record lost
   !> with each of twenty fits would be 200 kB, and a band matrix with each response more.
   subroutine test_memory()
      type(model_t) :: model
      type(stage_t) :: stage
      type(stage_fit_t), allocatable :: fits(:)
      type(error_t), allocatable :: error
      type(memory_t) :: before, after
      real(wp), allocatable :: measured(:)
      integer :: method, i

      stage = stage_of(['m_H', 'k_H'], [0.9_wp*truth%hose(1)%m_H, 1.1_wp*truth%hose(1)%k_H])
      call record_of(hosed(1), measured)
      do method = 1, 2
         model = hosed(1)
         if (method == 2) model = hosed(1, 1e-8_wp)
         do i = 1, 22
            call identify(model, mesh, [stage], samples, measured, fits, error)
            after = memory()
            if (i == 2) before = after
         end do
         call check('memory after twenty more fits, '//trim(merge('modal', 'cvode', method == 1)), &
            .not. allocated(error) .and. after%used - before%used < 16384, &
            to_text(int(before%used, ip))//' and '//to_text(int(after%used, ip))//' bytes')
      end do
   end subroutine test_memory

   subroutine refused(name, error, first, words)
      character(len=*), intent(in) :: name, first, words
      type(error_t), allocatable, intent(in) :: error

      if (.not. allocated(error)) then
         call check(name, .false., 'no error')
      else
         call check(name, error%status == status_failed .and. &
            index(error%message, first) == 1 .and. index(error%message, words) > 0, error%message)
      end if
   end subroutine refused

end program test_identification
