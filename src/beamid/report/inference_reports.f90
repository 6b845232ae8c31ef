!> Tables and summaries of profile likelihoods, posterior draws and bootstrap estimates.
!> `beamid_inference_outputs` combines them.
module beamid_inference_reports
   use beamid_bootstraps, only: blocks, bootstrap_t
   use beamid_case_files, only: case_t
   use beamid_chains, only: mean_and_deviation, quantile
   use beamid_errors, only: error_t
   use beamid_experiments, only: experiment_t
   use beamid_fitted_modes, only: fitted_mode_t, mode_finder_t, new_mode_finder
   use beamid_galerkin, only: mesh_t
   use beamid_identification, only: stage_fit_t
   use beamid_inference, only: posterior_draws_t
   use beamid_interrupts, only: interrupted, stop_flag
   use beamid_intervals, only: append_interval, end_words, interval_t
   use beamid_kinds, only: wp
   use beamid_lines, only: columns, csv_row
   use beamid_number_tables, only: number_table_t
   use beamid_profile_likelihood, only: is_lost, side_t
   use beamid_resampling, only: percentile_interval
   use beamid_sampling, only: chains
   use beamid_sorting, only: sort
   use beamid_statistics, only: statistics_t
   use beamid_strings, only: to_text
   use beamid_texts, only: left, right, text_t
   implicit none
   private

   public :: add_profiles, add_posterior, add_bootstrap, posterior_header

   !> The modes of a draw; not allocated: they cannot be computed.
   type :: modes_of_draw_t
      type(fitted_mode_t), allocatable :: modes(:)
   end type modes_of_draw_t

contains

   !> Adds the profile likelihoods of all parameters of a fit.
   !>
   !> sides      (2, parameters) the lower and the upper side of each profile
   !> profiles   gets the rows of profiles.csv: J, its signed distance from the minimum, and all
   !>            parameters along the profile
   !> intervals  gets the profile intervals
   !> text       gets remarks
   subroutine add_profiles(case, fit, sides, profiles, intervals, text)
      type(case_t), intent(in) :: case
      type(stage_fit_t), intent(in) :: fit
      type(side_t), intent(in) :: sides(:, :)
      type(text_t), intent(inout) :: profiles, text
      type(interval_t), allocatable, intent(inout) :: intervals(:)
      real(wp) :: ends(2), lowest
      integer :: states(2), i, k, side

      if (profiles%is_empty()) call profiles%line( &
         'elements,parameter,value,J,distance,lower_end,upper_end'//names(fit))
      lowest = sum(fit%fit%residual**2)
      do k = 1, size(fit%free)
         do i = size(sides(1, k)%value), 2, -1
            call add_point(sides(1, k), i, -1)
         end do
         do i = 1, size(sides(2, k)%value)
            call add_point(sides(2, k), i, 1)
         end do
         ends = sides(:, k)%end
         states = sides(:, k)%state
         call append_interval(intervals, 'profile', fit, fit%quantities(k), case%units, &
            fit%fit%estimate(k), ends, states)
         do side = 1, 2
            associate (s => sides(side, k))
               if (s%state == is_lost) call text%line('the profile of '// &
                  trim(fit%quantities(k)%name)//' ends at '//to_text(s%end)//': '//s%reason)
               i = minloc(s%J, dim=1)
               if (s%J(i) < lowest - 1e-2_wp*fit%statistics%variance) call text%line( &
                  'warning: the estimate is not the lowest minimum: at '// &
                  trim(fit%quantities(k)%searched_name())//' = '//to_text(s%value(i))// &
                  ' the profile has J = '//to_text(s%J(i))//'; fit again with start values there')
            end associate
         end do
      end do

   contains

      !> Adds point i of one side of the profile of parameter k; sign is -1 for the lower side.
      subroutine add_point(s, i, sign)
         type(side_t), intent(in) :: s
         integer, intent(in) :: i, sign

         call profiles%line(csv_row(to_text(fit%elements)//','// &
            trim(fit%quantities(k)%searched_name()), [s%value(i), s%J(i), sign*s%distance(i)])// &
            ','//trim(end_words(sides(1, k)%state))//','//trim(end_words(sides(2, k)%state))// &
            csv_row('', s%parameters(:, i)))
      end subroutine add_point

   end subroutine add_profiles

   !> Returns the names of the searched quantities, each preceded by a comma.
   function names(fit)
      type(stage_fit_t), intent(in) :: fit
      character(len=:), allocatable :: names
      integer :: k

      names = ''
      do k = 1, size(fit%free)
         names = names//','//trim(fit%quantities(k)%searched_name())
      end do
   end function names

   !> Returns the header of posterior.csv: chain, draw, elements, log density, parameters.
   function posterior_header(fit) result(header)
      type(stage_fit_t), intent(in) :: fit
      character(len=:), allocatable :: header

      header = 'chain,draw,elements,lp'//names(fit)
   end function posterior_header

   !> Adds the posterior draws of a fit.
   !>
   !> draws      gets the rows of posterior.csv
   !> motion     gets posterior_motion.csv: 95 % intervals of the model's accelerations
   !> modes      gets posterior_modes.csv: natural modes for some of the draws
   !> intervals  gets the posterior intervals
   !> text       gets the summary
   subroutine add_posterior(case, mesh, experiments, fit, posterior, draws, motion, modes, &
      intervals, text)
      type(case_t), intent(in) :: case
      type(mesh_t), intent(in) :: mesh
      type(experiment_t), intent(in) :: experiments(:)
      type(stage_fit_t), intent(in) :: fit
      type(posterior_draws_t), intent(in) :: posterior
      type(number_table_t), intent(inout) :: draws
      type(text_t), intent(inout) :: motion, modes, text
      type(interval_t), allocatable, intent(inout) :: intervals(:)
      real(wp), allocatable :: x(:), values(:, :)
      real(wp) :: mean, sd
      integer :: i, k, length

      associate (d => posterior%draws)
         length = size(d%q, 2)/chains
         allocate (values(1 + size(d%q, 1), size(d%q, 2)))
         values(1, :) = d%log_density
         values(2:, :) = d%q
         call draws%append(reshape([((i - 1)/length, modulo(i - 1, length), fit%elements, &
            i=1, size(d%q, 2))], [3, size(d%q, 2)]), values)
         call text%line()
         if (d%weighted) then
            call text%line('posterior: '//to_text(size(d%q, 2))//' draws by importance '// &
               'sampling, '//to_text(d%evaluations)//' evaluations, Pareto k = '// &
               to_text(d%k)//', worth '//to_text(nint(d%effective))//' independent ones')
         else
            call text%line('posterior: '//to_text(size(d%q, 2))//' draws of '//to_text(chains)// &
               ' Markov chains, '//to_text(d%evaluations)//' evaluations, worth '// &
               to_text(nint(d%effective))//' independent ones')
         end if
         do i = 1, size(posterior%order)
            if (posterior%order(i) > 0) call text%line('noise of record '//to_text(i)// &
               ': autoregressive of order '//to_text(posterior%order(i)))
         end do
         call text%line(left('', 10)//right('mean')//right('sd')//right('bulk')//right('tail')// &
            right('reduction'))
         do k = 1, size(fit%free)
            x = d%q(k, :)
            call mean_and_deviation(x, mean, sd)
            call text%line(left(trim(fit%quantities(k)%searched_name()), 10)//columns([mean, sd, &
               min(d%bulk(k), d%effective), min(d%tail(k), d%effective), d%reduction(k)], 14))
            call append_interval(intervals, 'posterior', fit, fit%quantities(k), case%units, &
               mean, percentile_interval(x))
         end do
      end associate
      call add_motion()
      call add_modes()

   contains

      !> Adds median and 95 % interval of the model's acceleration at each sample.
      subroutine add_motion()
         real(wp), allocatable :: values(:)
         integer :: i, j, row

         if (motion%is_empty()) call motion%line('elements,record,t,lower95,median,upper95')
         row = 0
         do i = 1, size(experiments)
            do j = 1, size(experiments(i)%samples)
               values = posterior%motion(row + j, :)
               call sort(values)
               call motion%line(csv_row(to_text(fit%elements)//','//to_text(i), &
                  [experiments(i)%samples(j), quantile(values, 0.025_wp), &
                  quantile(values, 0.5_wp), quantile(values, 0.975_wp)]))
            end do
            row = row + size(experiments(i)%measured)
         end do
      end subroutine add_motion

      !> Adds the lowest modes for some of the draws; draws whose modes cannot be computed are left
      !> out.
      subroutine add_modes()
         !> Number of draws that start from the same modes, for any number of threads.
         integer, parameter :: block = 25
         type(modes_of_draw_t) :: found(size(posterior%shown))
         integer :: first, i, j

         if (modes%is_empty()) call modes%line( &
            'draw,elements,record,mode,frequency_hz,damping_ratio')
         !$omp parallel do schedule(dynamic, 1) copyin(stop_flag)
         do first = 1, size(found), block
            if (interrupted()) cycle
            call find_modes(first, min(first + block - 1, size(found)), found)
         end do
         !$omp end parallel do
         do i = 1, size(found)
            if (.not. allocated(found(i)%modes)) cycle
            associate (of_draw => found(i)%modes)
               do j = 1, size(of_draw)
                  call modes%line(csv_row(to_text(posterior%shown(i))//','// &
                     to_text(fit%elements)//','//to_text(of_draw(j)%record)//','// &
                     to_text(count(of_draw(:j)%record == of_draw(j)%record)), &
                     [of_draw(j)%frequency, of_draw(j)%damping_ratio]))
               end do
            end associate
         end do
      end subroutine add_modes

      !> Finds the lowest modes for the shown draws `first` to `last`.
      subroutine find_modes(first, last, found)
         integer, intent(in) :: first, last
         type(modes_of_draw_t), intent(inout) :: found(:)
         integer, parameter :: most = 5
         type(stage_fit_t), allocatable :: moved
         type(mode_finder_t) :: finder
         type(error_t), allocatable :: error
         integer :: i, p

         allocate (moved)
         call fit%copy_to(moved)
         moved%statistics = statistics_t()
         call new_mode_finder(mesh, fit, finder, error)
         if (allocated(error)) return
         do i = first, last
            do p = 1, size(fit%free)
               call moved%scenario%set(fit%free(p), fit%quantities(p)%record, &
                  posterior%draws%q(p, posterior%shown(i)))
            end do
            call finder%find(moved, most, found(i)%modes, error)
            if (allocated(error) .and. allocated(found(i)%modes)) deallocate (found(i)%modes)
         end do
      end subroutine find_modes

   end subroutine add_posterior

   !> Adds the bootstrap estimates of a fit.
   !>
   !> table      gets the rows of bootstrap.csv: the estimates from each resampled record
   !> intervals  gets the percentile and the BCa intervals
   !> text       gets the summary
   subroutine add_bootstrap(case, fit, bootstrap, table, intervals, text)
      type(case_t), intent(in) :: case
      type(stage_fit_t), intent(in) :: fit
      type(bootstrap_t), intent(in) :: bootstrap
      type(text_t), intent(inout) :: table, text
      type(interval_t), allocatable, intent(inout) :: intervals(:)
      real(wp) :: mean, sd
      integer :: i, k, n

      if (table%is_empty()) call table%line('number,elements'//names(fit))
      n = size(bootstrap%number)
      do i = 1, n
         call table%line(csv_row(to_text(bootstrap%number(i))//','//to_text(fit%elements), &
            bootstrap%estimates(:, i)))
      end do
      call text%line()
      if (bootstrap%kind == blocks) then
         call text%line('bootstrap: '//to_text(n)//' records from blocks of '// &
            to_text(bootstrap%block)//' residuals')
      else
         call text%line('bootstrap: '//to_text(n)//' records with normal white noise')
         if (.not. fit%check%white) call text%line('warning: the residuals are not white, so '// &
            'that these intervals are too narrow; use kind=''blocks'' in &bootstrap')
      end if
      if (bootstrap%failures > 0) call text%line('warning: '//to_text(bootstrap%failures)// &
         ' further records could not be fitted and are left out: '//bootstrap%reason)
      call text%line(left('', 10)//right('mean')//right('sd')//right('bias'))
      do k = 1, size(fit%free)
         associate (x => bootstrap%estimates(k, :), q => fit%quantities(k))
            call mean_and_deviation(x, mean, sd)
            call text%line(left(trim(q%searched_name()), 10)//columns([mean, sd, &
               mean - fit%fit%estimate(k)], 14))
            call append_interval(intervals, 'percentile', fit, q, case%units, mean, &
               bootstrap%percentile(:, k))
            call append_interval(intervals, 'bca', fit, q, case%units, mean, &
               bootstrap%corrected(:, k))
         end associate
      end do
   end subroutine add_bootstrap

end module beamid_inference_reports
