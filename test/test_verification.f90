!> What an integrator's error may do to estimates, and what the program says of it.
program test_verification
   use beamid_errors, only: error_t, status_failed
   use beamid_excitation, only: new_pulse
   use beamid_experiments, only: experiment_t
   use beamid_identification, only: identify, simulate, simulation_t, stage_fit_t, stage_t
   use beamid_kinds, only: wp
   use beamid_least_squares, only: fit, fit_t, options_t
   use beamid_noise, only: gaussian_noise
   use beamid_residuals, only: new_residuals, residual_t
   use beamid_strings, only: to_text
   use beamid_unknowns, only: quantity_t, variables_of
   use beamid_variables, only: variable_t
   use beamid_verification, only: exact_counterpart, verify_integrator
   use checks, only: check, check_close, finish
   use hose_model, only: hosed, mesh
   use models, only: stage_of
   implicit none

   integer :: k
   real(wp), parameter :: samples(40) = [(0.1_wp*k, k=1, 40)]

   call test_promise()
   call test_judges()
   call test_limits()
   call finish('verification')

contains

   !> Exact accelerations, of some ten ft/s^2, and noise.
   function record_of(sd) result(measured)
      real(wp), intent(in) :: sd
      real(wp), allocatable :: measured(:)
      type(simulation_t) :: simulation
      type(error_t), allocatable :: error

      call simulate(hosed(1), mesh, samples, simulation, error)
      measured = simulation%acceleration + gaussian_noise(size(samples), sd, 3)
   end function record_of

   !> Any tolerance, much noise or little: a result that is not refused lies within a quarter of a
   !> standard error of the exact one. `moved` is that distance; both minima are sought to 1e-10 of
   !> J, sqrt(36e-10) = 6e-5 standard errors, twice over. Refused is the tolerance at which a search
   !> does not leave its start, and let pass the smallest; between them the integrator's steps
   !> decide, which hang on the BLAS: whether a result passes, is refused for where it lies, or the
   !> search for where it ended.
   subroutine test_promise()
      real(wp), parameter :: rtol(5) = [1e-1_wp, 1e-2_wp, 1e-4_wp, 1e-6_wp, 1e-9_wp], &
         sd(2) = [1e-3_wp, 1e-1_wp]
      type(stage_fit_t), allocatable :: exact(:), found(:)
      type(stage_t) :: stage
      type(error_t), allocatable :: error
      character(len=:), allocatable :: name
      real(wp) :: distance
      integer :: i, j

      stage = stage_of(['c_D', 'm_H', 'c_H', 'k_H'], [0.04_wp, 0.035_wp, 0.008_wp, 0.35_wp])
      do j = 1, size(sd)
         call identify(hosed(1), mesh, [stage], samples, record_of(sd(j)), exact, error)
         call check('the exact fit converges', .not. allocated(error))
         if (allocated(error)) return
         call check('no integrator, nothing moved', exact(1)%moved < 0)
         do i = 1, size(rtol)
            name = 'noise '//to_text(sd(j))//', rtol = '//to_text(rtol(i))
            call identify(hosed(1, rtol(i)), mesh, [stage], samples, record_of(sd(j)), found, error)
            if (allocated(error)) then
               call check(name//': refused', i < size(rtol) .and. &
                  error%status == status_failed .and. (index(error%message, &
                  'the residuals have a relative error of '//to_text(rtol(i))) > 0 .or. &
                  index(error%message, 'of '//to_text(rtol(i))//' is too large') > 0 .and. &
                  index(error%message, ' standard errors, compared with the exact response') > 0 &
                  .and. index(error%message, 'or use method=''modal''') > 0), error%message)
               cycle
            end if
            distance = maxval(abs(found(1)%fit%estimate - exact(1)%fit%estimate) &
               /exact(1)%statistics%std_error)
            call check(name//': within a quarter', distance <= 0.25_wp + 1e-3_wp .and. i > 1, &
               to_text(distance))
            call check_close(name//': moved', found(1)%moved, distance, 1e-3_wp)
         end do
      end do
   end subroutine test_promise

   !> A fit of this record with k_H and m_H free, and what `verify_integrator` asks for.
   subroutine fit_of(rtol, measured, stage, problem, exact, variables, quantities, found)
      real(wp), intent(in) :: rtol, measured(:)
      type(stage_t), intent(in) :: stage
      type(residual_t), intent(out) :: problem, exact
      type(variable_t), allocatable, intent(out) :: variables(:)
      type(quantity_t), allocatable, intent(out) :: quantities(:)
      type(fit_t), intent(out) :: found
      type(experiment_t) :: experiments(1)
      type(error_t), allocatable :: error

      experiments(1)%samples = samples(:size(measured))
      experiments(1)%measured = measured
      experiments(1)%excitation = new_pulse(1.0_wp, 0.05_wp)
      call new_residuals(hosed(1, rtol), mesh, experiments, problem, error)
      problem%free = stage%free
      problem%record = stage%owners()
      call exact_counterpart(hosed(1), mesh, experiments, [integer ::], exact)
      call variables_of(stage, problem%scenario, variables, quantities, error)
      call fit(problem, size(measured), variables, options_t(relative_error=rtol), found, error)
      call check('rtol = '//to_text(rtol)//': the fit converges', .not. allocated(error))
   end subroutine fit_of

   !> Where there is no exact response, a smaller tolerance is the judge: a hundredth of that of the
   !> fit. Both judges see the same shift.
   !>
   !> The shift counts in standard errors of the judge's own fit. These go with its residuals, which
   !> contain the error of its integrator beside the noise, hence the factor sqrt(J/J of the exact
   !> fit). The judge's own error is a hundredth of the shift if errors are proportional to the
   !> tolerance, and .01**(k/(k + 1)) of it where a method of order k controls them: 10 % for k = 1,
   !> 3 % for k = 3. The search with the exact response stops up to .2 standard errors from its
   !> minimum. That with the smaller tolerance stops where its errors e hide the decrease of J: with
   !> |e| = delta noise standard deviations, 2 r'e differs by about 3 delta noise variances from one
   !> evaluation to the next, and a shift by d standard errors changes J by d**2 of them.
   subroutine test_judges()
      real(wp), parameter :: rtol(3) = [1e-2_wp, 3e-3_wp, 1e-3_wp]
      type(residual_t) :: problem, exact, none, finer_problem, unused
      type(variable_t), allocatable :: variables(:)
      type(quantity_t), allocatable :: quantities(:)
      type(stage_t) :: stage
      type(fit_t) :: found, finer, best
      type(error_t), allocatable :: error
      character(len=:), allocatable :: judge, name
      real(wp) :: delta, moved, moved_too
      integer :: i

      stage = stage_of(['m_H', 'k_H'], [0.035_wp, 0.35_wp])
      do i = 1, size(rtol)
         name = 'rtol = '//to_text(rtol(i))//': '
         call fit_of(rtol(i)/100, record_of(1e-3_wp), stage, finer_problem, unused, variables, &
            quantities, finer)
         call fit_of(rtol(i), record_of(1e-3_wp), stage, problem, exact, variables, quantities, &
            found)
         call verify_integrator(problem, exact, variables, quantities%name, found, moved, judge, &
            error)
         call check(name//'the exact response is the judge', (moved > 0.25_wp) .eqv. &
            allocated(error), to_text(moved))
         exact%free = stage%free
         exact%record = stage%owners()
         call fit(exact, size(found%residual), variables, options_t(), best, error)
         call check(name//'the exact fit converges', .not. allocated(error))
         call verify_integrator(problem, none, variables, quantities%name, found, moved_too, &
            judge, error)
         call check(name//'a smaller tolerance is the judge', (moved_too > 0.25_wp) .eqv. &
            allocated(error), to_text(moved_too))
         if (allocated(error)) call check(name//'and is named', index(error%message, &
            'compared with a tolerance of '//to_text(rtol(i)/100)//';') > 0, error%message)
         delta = rtol(i)/100*norm2(record_of(1e-3_wp))/sqrt(best%J/(size(found%residual) &
            - size(variables)))
         call check_close(name//'both say the same', moved_too*sqrt(finer%J/best%J), moved, &
            0.1_wp*moved + 0.2_wp + sqrt(3*delta))
      end do
      call fit_of(1e-8_wp, record_of(1e-3_wp), stage, problem, exact, variables, quantities, found)
      call verify_integrator(problem, none, variables, quantities%name, found, moved_too, judge, &
         error)
      call check('a smaller tolerance lets pass', .not. allocated(error) .and. moved_too > 0, &
         to_text(moved_too))
      call check('and says which', judge == 'a tolerance of 1E-10', judge)
   end subroutine test_judges

   !> A parameter at its bound is there for both, and is not said to have moved; where no degree of
   !> freedom is left there are no standard errors to compare with.
   subroutine test_limits()
      type(residual_t) :: problem, exact
      type(variable_t), allocatable :: variables(:)
      type(quantity_t), allocatable :: quantities(:)
      type(stage_t) :: stage
      type(fit_t) :: found
      type(error_t), allocatable :: error
      character(len=:), allocatable :: judge
      real(wp) :: moved, measured(size(samples))

      measured = record_of(1e-3_wp)
      stage = stage_of(['m_H', 'k_H'], [0.035_wp, 0.2_wp])
      stage%upper(2) = 0.25_wp
      call fit_of(1e-6_wp, measured, stage, problem, exact, variables, quantities, found)
      ! Near enough to be held there.
      call check_close('k_H is at its bound', found%estimate(2), 0.25_wp, 1e-5_wp)
      call verify_integrator(problem, exact, variables, quantities%name, found, moved, judge, error)
      call check('a parameter at its bound', .not. allocated(error) .and. moved >= 0, &
         to_text(moved))
      stage = stage_of(['m_H', 'k_H'], [0.04_wp, 0.3_wp])
      call fit_of(1e-6_wp, measured(:2), stage, problem, exact, variables, quantities, found)
      call verify_integrator(problem, exact, variables, quantities%name, found, moved, judge, error)
      call check('no degree of freedom', .not. allocated(error) .and. moved < 0)
   end subroutine test_limits

end program test_verification
