!> Searches whose rows are weighted by the noise: of each record where there are several, of the
!> data beside what else is known. Where it is not stated it is estimated from the residuals, and
!> the search repeated until it is the noise that the search has used.
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

   public :: fit_with_noise

   !> A smaller relative change of the noise is none.
   real(wp), parameter :: settled = 1e-4_wp

   !> No sensor is better than this part of what it records: without it a record that happens to be
   !> fitted without rest would count for all.
   real(wp), parameter :: least_noise = 1e-4_wp

contains

   !> As `fit`, J that of the records alone.
   subroutine fit_with_noise(problem, variables, options, found, error, monitor, label, names)
      type(residual_t), intent(inout) :: problem
      type(variable_t), intent(in) :: variables(:)
      type(options_t), intent(in) :: options
      type(fit_t), intent(out) :: found
      type(error_t), allocatable, intent(out) :: error
      class(monitor_t), intent(inout), optional :: monitor
      character(len=*), intent(in) :: label, names(:)
      integer, parameter :: most = 50
      type(variable_t) :: from(size(variables))
      type(options_t) :: quiet
      type(fit_t) :: before
      real(wp) :: change
      integer :: k

      call fit(problem, problem%rows(), variables, options, found, error, monitor, label, names)
      quiet = options
      quiet%check = .false.
      do k = 1, most
         if (allocated(error)) return
         call learn_noise(problem, variables, found, change, error)
         if (allocated(error)) return
         if (change <= settled) exit
         before = found
         from = variables%from(found%estimate)
         call fit(problem, problem%rows(), from, quiet, found, error, monitor, label, names)
         if (allocated(error)) return
         found%start = before%start
         call found%add_earlier(before)
      end do
      if (k > most) call failure(error, 'the noise of the records does not settle: it still '// &
         'changes by '//to_text(100*change)//' %; expected sd of each record')
      found%J = sum(found%residual(:problem%samples())**2)
   end subroutine fit_with_noise

   !> Estimates the noise from a fit, unless that has used nearly the same: of each record what the
   !> parameters cannot explain even where they are its own, to first order. What records disagree
   !> about is no noise; taken for it, the search would follow one record and leave the others.
   !>
   !> variables  of the fit
   !> change  the largest relative one; 0: nothing is estimated
   subroutine learn_noise(problem, variables, found, change, error)
      type(residual_t), intent(inout) :: problem
      type(variable_t), intent(in) :: variables(:)
      type(fit_t), intent(in) :: found
      real(wp), intent(out) :: change
      type(error_t), allocatable, intent(out) :: error
      type(statistics_t) :: statistics
      real(wp) :: sd(size(problem%parts)), noise, free
      real(wp), dimension(size(variables)) :: scale, step
      logical :: mine(size(variables))
      integer :: i, m, n, rank, row

      change = 0
      n = size(found%estimate)
      m = problem%samples()
      if (problem%prior_rows() == 0 .and. .not. (problem%is_weighted() .and. &
         any(problem%is_estimated()))) return
      free = real(problem%rows() - n - problem%linear_unknowns(), wp)/m
      if (.not. free > 0) return
      row = 0
      scale = scales_of(variables, found%estimate)
      do i = 1, size(sd)
         associate (z => problem%parts(i)%experiment%measured, weight => problem%weight(i))
            associate (r => found%residual(row + 1:row + size(z)), &
               jacobian => found%jacobian(row + 1:row + size(z), :))
               mine = any(abs(jacobian) > 0, dim=1)
               call least_squares_step(jacobian, r, scale, mine, epsilon(free)*size(z), step, rank)
               sd(i) = norm2(r + matmul(jacobian, step))/weight/sqrt(real(max(1, size(z) - rank &
                  - problem%linear_unknowns()/size(sd)), wp))
            end associate
            sd(i) = max(sd(i), least_noise*norm2(z)/sqrt(real(size(z), wp)), tiny(free))
            row = row + size(z)
         end associate
      end do
      noise = 1
      if (.not. problem%is_weighted()) noise = sd(1)
      if (problem%prior_rows() > 0 .and. n > 0 .and. free*m > 1) then
         ! Of coloured residuals fewer would carry as much.
         call new_statistics(found%jacobian, found%residual, found%estimate, &
            max(abs(found%estimate), tiny(free)), statistics, error, m)
         if (allocated(error)) return
         noise = noise*sqrt(m/max(statistics%effective, 1.0_wp))
         change = abs(log(noise/problem%noise))
      end if
      if (problem%is_weighted()) change = max(change, maxval(abs(log(sd*problem%weight)), &
         mask=problem%is_estimated()))
      if (change <= settled) return
      problem%noise = noise
      if (problem%is_weighted()) problem%weight = merge(1/sd, problem%weight, &
         problem%is_estimated())
   end subroutine learn_noise

end module beamid_noise_levels
