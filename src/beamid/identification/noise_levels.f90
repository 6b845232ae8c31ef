!> Fits with estimated noise: weighted least squares where the noise of the records is not stated.
!>
!> The noise matters if several records are weighed against each other, or records against priors.
!> It is estimated from the residuals, and the search is repeated until the noise agrees with the
!> noise that the search has used.
module beamid_noise_levels
   use beamid_errors, only: error_t, failure
   use beamid_gauss_newton, only: least_squares_step, scales_of
   use beamid_kinds, only: wp
   use beamid_least_squares, only: fit, fit_t, monitor_t, options_t
   use beamid_residuals, only: residual_t
   use beamid_statistics, only: new_statistics, statistics_t
   use beamid_strings, only: to_text
   use beamid_variables, only: variable_t
   implicit none
   private

   public :: estimates_noise, fit_with_noise

   !> Relative change of the noise level below which the iteration has converged.
   real(wp), parameter :: settled = 1e-4_wp

   !> Smallest noise that is assumed, as a share of the root mean square of the record. Otherwise a
   !> record that happens to be fitted exactly would outweigh all others.
   real(wp), parameter :: least_noise = 1e-4_wp

contains

   !> Runs a search like `fit`, with estimated noise. J is the weighted sum of squares of the
   !> samples alone.
   !>
   !> problem    the fit; on return with the noise and the weights that the search has used
   !> variables  (n) start, bounds and scale of each free parameter
   !> found      result
   !> error      no convergence; the noise does not settle
   !> monitor    informed of every iteration
   !> label      name of the search for the monitor
   !> names      (n) names of the variables
   subroutine fit_with_noise(problem, variables, options, found, error, monitor, label, names)
      type(residual_t), intent(inout) :: problem
      type(variable_t), intent(in) :: variables(:)
      type(options_t), intent(in) :: options
      type(fit_t), intent(out) :: found
      type(error_t), allocatable, intent(out) :: error
      class(monitor_t), intent(inout), optional :: monitor
      character(len=*), intent(in) :: label, names(:)
      integer, parameter :: most = 50
      type(variable_t) :: restart(size(variables))
      type(options_t) :: quiet
      type(fit_t) :: previous
      real(wp) :: change
      integer :: k

      call fit(problem, problem%rows(), variables, options, found, error, monitor, label, names)
      quiet = options
      quiet%check = .false.
      do k = 1, most
         if (allocated(error)) return
         call estimate_noise(problem, variables, found, change, error)
         if (allocated(error)) return
         if (change <= settled) exit
         previous = found
         restart = variables%from(found%estimate)
         call fit(problem, problem%rows(), restart, quiet, found, error, monitor, label, names)
         if (allocated(error)) return
         found%start = previous%start
         call found%add_earlier(previous)
      end do
      if (k > most) call failure(error, 'the estimated noise of the records does not '// &
         'settle: it still changes by '//to_text(100*change)//' %; state it by sd in each &record')
      if (size(found%residual) > 0) found%J = sum(found%residual(:problem%samples())**2)
   end subroutine fit_with_noise

   !> Returns whether a fit has to estimate noise.
   pure logical function estimates_noise(problem)
      type(residual_t), intent(in) :: problem

      estimates_noise = problem%prior_rows() > 0 .or. (problem%is_weighted() .and. &
         any(problem%is_estimated()))
   end function estimates_noise

   !> Estimates the noise from a fit, and sets it unless it has converged.
   !>
   !> The noise of a record is the residual that is left, to first order, if the parameters could
   !> adapt to this record alone. A disagreement between records is not noise: if it counted as
   !> noise, the search would follow one record and give up the others. With priors, the
   !> disagreement reduces the weight of all records against the priors: it counts as an error with
   !> as many degrees of freedom as the records determine more parameters one by one than together
   !> (the ratio of Birge, Physical Review 40, 1932, 207).
   !>
   !> variables  (n) variables of the fit
   !> found      result of the fit
   !> change     largest relative change of the noise; 0: nothing has to be estimated
   subroutine estimate_noise(problem, variables, found, change, error)
      type(residual_t), intent(inout) :: problem
      type(variable_t), intent(in) :: variables(:)
      type(fit_t), intent(in) :: found
      real(wp), intent(out) :: change
      type(error_t), allocatable, intent(out) :: error
      type(statistics_t) :: statistics
      real(wp) :: sd(size(problem%parts)), noise, freedom, disagreement, own
      real(wp), dimension(size(variables)) :: scale, step
      logical :: active(size(variables))
      integer :: excess, i, m, n, rank, row

      change = 0
      n = size(found%estimate)
      m = problem%samples()
      if (.not. estimates_noise(problem)) return
      freedom = real(problem%rows() - n - problem%linear_unknowns(), wp)/m
      if (.not. freedom > 0) return
      row = 0
      disagreement = 0
      excess = problem%prior_rows() - n
      scale = scales_of(variables, found%estimate)
      do i = 1, size(sd)
         associate (z => problem%parts(i)%observed%measured, weight => problem%weight(i))
            associate (r => found%residual(row + 1:row + size(z)), &
               jacobian => found%jacobian(row + 1:row + size(z), :))
               active = any(abs(jacobian) > 0, dim=1)
               call least_squares_step(jacobian, r, scale, active, epsilon(freedom)*size(z), step, &
                  rank)
               own = norm2(r + matmul(jacobian, step))
               disagreement = disagreement + sum(r**2) - own**2
               excess = excess + rank
               sd(i) = own/weight/sqrt(max(1.0_wp, size(z) - rank &
                  - real(problem%linear_unknowns(), wp)/size(sd)))
            end associate
            sd(i) = max(sd(i), least_noise*norm2(z)/sqrt(real(size(z), wp)), tiny(freedom))
            row = row + size(z)
         end associate
      end do
      noise = 1
      if (.not. problem%is_weighted()) noise = sd(1)
      if (problem%prior_rows() > 0 .and. n > 0 .and. freedom*m > 1) then
         ! Coloured residuals carry as much information as fewer white ones.
         call new_statistics(found%jacobian, found%residual, found%estimate, &
            max(abs(found%estimate), tiny(freedom)), statistics, error, m, &
            ordered=problem%are_ordered())
         if (allocated(error)) return
         noise = noise*sqrt(m/max(statistics%effective, 1.0_wp))
         ! If several records disagree by more than that, none of them may overrule a prior.
         if (size(sd) > 1 .and. excess > 0) noise = max(noise, sqrt(disagreement/excess))
         change = abs(log(noise/problem%noise))
      end if
      if (problem%is_weighted()) change = max(change, maxval(abs(log(sd*problem%weight)), &
         mask=problem%is_estimated()))
      if (change <= settled) return
      problem%noise = noise
      if (problem%is_weighted()) problem%weight = merge(1/sd, problem%weight, &
         problem%is_estimated())
   end subroutine estimate_noise

end module beamid_noise_levels
