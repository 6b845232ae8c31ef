!> The report of `compare --damping`: measured damping ratios beside those of each model, what the
!> data reject and what they cannot distinguish, and a measurement that would decide.
module beamid_damping_reports
   use beamid_candidates, only: criteria_t
   use beamid_damping_models, only: damping_models_t
   use beamid_distributions, only: normal_quantile
   use beamid_fitted_modes, only: fitted_mode_t
   use beamid_kinds, only: pi, wp
   use beamid_lines, only: filled
   use beamid_mechanisms, only: mechanism_t, mechanisms, spatial_hysteresis, &
      time_hysteresis
   use beamid_outputs, only: output_t
   use beamid_parameters, only: parameters
   use beamid_strings, only: full, rounded, string_t, to_text
   use beamid_structure, only: of_b, of_b_h
   use beamid_texts, only: left, right, text_t
   implicit none
   private

   public :: add_damping

   !> Difference of AICc from the best model up to which a model counts as possible, if the
   !> residuals are white.
   real(wp), parameter :: within = 6

   !> Width of the column with the names of the models, and of the other columns.
   integer, parameter :: of_names = 26, of_numbers = 10

contains

   !> Adds damping.csv and the first part of the summary.
   !>
   !> labels  (models) names of the models
   subroutine add_damping(found, criteria, labels, output, text)
      type(damping_models_t), intent(in) :: found
      type(criteria_t), intent(in) :: criteria
      type(string_t), intent(in) :: labels(:)
      type(output_t), intent(inout) :: output
      type(text_t), intent(inout) :: text
      logical :: is_possible(size(labels))
      real(wp) :: excess
      integer :: best, k

      best = criteria%best()
      excess = excess_of(found, best)
      is_possible = criteria%aicc - criteria%aicc(best) <= within*excess
      call output%add('damping.csv', damping_table(found, labels, is_possible))
      call text%line('Preferred damping mechanism: '//labels(best)%text)
      if (count(is_possible) > 1) call text%line('The data do not distinguish it from: '// &
         list_of(labels, is_possible .and. [(k /= best, k=1, size(labels))])// &
         ' (AICc within '//rounded(within*excess, 2)//')')
      if (.not. all(is_possible)) call text%line('The data reject: '//list_of(labels, &
         .not. is_possible)//' (AICc more than '//rounded(within*excess, 2)//' above the best)')
      if (excess > 1) call text%line('The residuals are not white: the samples are worth '// &
         rounded(excess, 2)//' times fewer independent ones. The threshold of AICc, 6 for '// &
         'white residuals, is multiplied by this number.')
      if (count(is_possible) > 1) then
         call add_reason(found, is_possible, text)
         call add_decision(found, labels, is_possible, best, text)
      end if
      do k = 1, size(labels)
         if (is_possible(k)) call add_limits(found, k, text)
      end do
      call add_misfit(found, labels(best)%text, best, text)
      do k = 1, size(found%failed)
         call text%line('Not fitted: '//found%failed(k)%text//': '//found%reasons(k)%text)
      end do
      call text%line()
      call add_ratios(found, labels, text)
   end subroutine add_damping

   !> Returns the factor by which differences of AICc are too large because the residuals of the
   !> best model are not white; at least 1.
   pure real(wp) function excess_of(found, best) result(excess)
      type(damping_models_t), intent(in) :: found
      integer, intent(in) :: best

      excess = 1
      associate (fit => found%models(best)%fit)
         if (.not. fit%check%white .and. fit%statistics%effective > 0) excess = max(1.0_wp, &
            fit%statistics%samples/fit%statistics%effective)
      end associate
   end function excess_of

   !> Returns names, separated by commas.
   pure function list_of(labels, chosen) result(list)
      type(string_t), intent(in) :: labels(:)
      logical, intent(in) :: chosen(:)
      character(len=:), allocatable :: list
      integer :: k

      list = ''
      do k = 1, size(labels)
         if (.not. chosen(k)) cycle
         if (list /= '') list = list//', '
         list = list//labels(k)%text
      end do
   end function list_of

   !> Adds why the data do not distinguish the possible models: too few damping ratios, or ratios
   !> that agree within their errors.
   subroutine add_reason(found, is_possible, text)
      type(damping_models_t), intent(in) :: found
      logical, intent(in) :: is_possible(:)
      type(text_t), intent(inout) :: text
      real(wp) :: largest, ratio(size(is_possible))
      integer :: j, k, most, n

      n = size(found%measured)
      if (n == 0) return
      most = maxval([(size(found%combinations(k)%parameters()), k=1, size(is_possible))], &
         is_possible)
      if (n <= most) then
         call text%line('Reason: '//to_text(n)//' measured damping ratio'// &
            trim(merge(' is  ', 's are', n == 1))//' too few to separate models with '// &
            to_text(n)//' or more damping parameters.')
         return
      end if
      largest = 0
      do j = 1, n
         do k = 1, size(is_possible)
            ratio(k) = ratio_of(found, k, j)
         end do
         largest = max(largest, (maxval(ratio, is_possible) - minval(ratio, is_possible)) &
            /found%measured(j)%sd_damping)
      end do
      call text%line(filled('Reason: in the measured modes, the damping ratios of these models '// &
         'differ by at most #.1 standard errors.', [largest]))
   end subroutine add_reason

   !> Returns the damping ratio of the j-th measured mode by model k.
   pure real(wp) function ratio_of(found, k, j)
      type(damping_models_t), intent(in) :: found
      integer, intent(in) :: k, j
      type(fitted_mode_t) :: mode

      mode = mode_of(found, k, found%measured(j)%record, found%measured(j)%mode)
      ratio_of = mode%damping_ratio
   end function ratio_of

   !> Returns a mode of a model; with a frequency of 0 if the model has no such mode.
   pure type(fitted_mode_t) function mode_of(found, k, record, number)
      type(damping_models_t), intent(in) :: found
      integer, intent(in) :: k, record, number
      integer :: i, n

      n = 0
      associate (modes => found%modes(k)%modes)
         do i = 1, size(modes)
            if (modes(i)%record /= record) cycle
            n = n + 1
            if (n < number) cycle
            mode_of = modes(i)
            return
         end do
      end associate
   end function mode_of

   !> Adds a damping ratio whose measurement would decide between the best model and another
   !> possible one: that of the lowest mode in which a model differs from the best one by a fifth,
   !> or else of the mode in which one differs most.
   subroutine add_decision(found, labels, is_possible, best, text)
      type(damping_models_t), intent(in) :: found
      type(string_t), intent(in) :: labels(:)
      logical, intent(in) :: is_possible(:)
      integer, intent(in) :: best
      type(text_t), intent(inout) :: text
      !> Difference of two damping ratios, in standard errors, that decides; and relative difference
      !> below which no measurement does, and from which one is easy.
      real(wp), parameter :: decisive = 4, least = 0.05_wp, easy = 0.2_wp
      !> Relative difference up to which two differences count as the same.
      real(wp), parameter :: same = 0.01_wp
      type(fitted_mode_t) :: one, other
      real(wp) :: difference, largest, ratios(2)
      integer :: chosen, j, k, second

      largest = 0
      chosen = 0
      second = 0
      do k = 1, size(found%modes(best)%modes)
         one = mode_of(found, best, 1, k)
         if (.not. one%frequency > 0 .or. largest > easy) exit
         do j = 1, size(labels)
            if (j == best .or. .not. is_possible(j)) cycle
            other = mode_of(found, j, 1, k)
            if (.not. other%frequency > 0) cycle
            difference = abs(one%damping_ratio - other%damping_ratio) &
               /max(one%damping_ratio, other%damping_ratio, tiny(1.0_wp))
            if (difference <= (1 + same)*largest) cycle
            largest = difference
            chosen = k
            second = j
         end do
      end do
      if (largest < least) then
         call text%line('No damping ratio of the modes up to '//to_text(size(found%modes(best) &
            %modes))//' differs by more than 5 % between these models: they describe the same '// &
            'damping.')
         return
      end if
      one = mode_of(found, best, 1, chosen)
      other = mode_of(found, second, 1, chosen)
      ratios = 100*[one%damping_ratio, other%damping_ratio]
      call text%line('A measurement that would decide: the damping ratio of mode '// &
         to_text(chosen)//' (frequency '//rounded(one%frequency, 4)//'), with a standard error '// &
         'below '//rounded(abs(ratios(1) - ratios(2))/decisive, 2)//' percentage points. The '// &
         'fitted models predict '//rounded(ratios(1), 3)//' % ('//labels(best)%text//') and '// &
         rounded(ratios(2), 3)//' % ('//labels(second)%text//').')
   end subroutine add_decision

   !> Adds a sentence if the rate or range of a model is at a limit, where only one combination of
   !> its parameters can be determined, or was kept fixed.
   subroutine add_limits(found, k, text)
      type(damping_models_t), intent(in) :: found
      integer, intent(in) :: k
      type(text_t), intent(inout) :: text
      real(wp), parameter :: far = 3
      type(mechanism_t) :: m
      real(wp) :: ends(2), range, wavelength
      integer :: j, n

      do j = 1, size(found%combinations(k)%parts)
         m = mechanisms(found%combinations(k)%parts(j))
         if (m%range == 0) cycle
         if (any(found%models(k)%fit%free == m%range)) cycle
         call text%line(found%combinations(k)%name()//': '//trim(parameters(m%range)%name)// &
            ' is fixed at '//rounded(found%models(k)%fit%scenario%get(m%range, 0), 3)// &
            ', because the fit did not converge with it free.')
      end do
      n = size(found%measured)
      if (n == 0) return
      ends = 2*pi*[minval(found%measured%frequency), maxval(found%measured%frequency)]
      do j = 1, size(found%combinations(k)%parts)
         associate (part => found%combinations(k)%parts(j), structure => found%models(k)%fit &
            %scenario%structures(1))
            select case (part)
            case (time_hysteresis)
               range = found%models(k)%fit%scenario%get(of_b(1), 0)
               if (range > far*ends(2)) then
                  call say('b_1 is far above the angular frequencies of the modes, where time '// &
                     'hysteresis is Kelvin-Voigt damping: only d_1/b_1 is determined')
               else if (range < ends(1)/far) then
                  call say('b_1 is far below the angular frequencies of the modes, where the '// &
                     'damping ratio falls like 1/frequency: only d_1 b_1 is determined')
               end if
            case (spatial_hysteresis)
               range = found%models(k)%fit%scenario%get(of_b_h, 0)
               wavelength = structure%length/max(1, maxval(found%measured%mode))
               if (range < wavelength/(2*pi)/far) then
                  call say('b_h is far below the wavelengths, where spatial hysteresis is '// &
                     'Kelvin-Voigt damping: only a_h b_h^2 is determined')
               else if (range > structure%length) then
                  call say('b_h is longer than the beam: only a_h/b_h is determined')
               end if
            end select
         end associate
      end do

   contains

      !> Adds a sentence about the model.
      subroutine say(sentence)
         character(len=*), intent(in) :: sentence

         call text%line('Limit of '//found%combinations(k)%name()//': '//sentence//'.')
      end subroutine say

   end subroutine add_limits

   !> Warns if the best model does not explain a measured damping ratio, or leaves residuals that
   !> are much larger than the stated noise.
   subroutine add_misfit(found, name, best, text)
      type(damping_models_t), intent(in) :: found
      character(len=*), intent(in) :: name
      integer, intent(in) :: best
      type(text_t), intent(inout) :: text
      real(wp), parameter :: allowed = 3.5_wp, excess = 1.5_wp
      real(wp) :: distance(size(found%measured)), noise
      integer :: j

      associate (fit => found%models(best)%fit)
         noise = sqrt(fit%statistics%variance)
         if (fit%weighted .and. noise > excess) call text%line(filled('warning: the residuals '// &
            'of the best model are #.1 times the stated noise: all models lack an effect other '// &
            'than damping', [noise]))
      end associate
      if (size(distance) == 0) return
      distance = [(abs(ratio_of(found, best, j) - found%measured(j)%damping) &
         /found%measured(j)%sd_damping, j=1, size(distance))]
      j = maxloc(distance, dim=1)
      if (distance(j) > allowed) call text%line(filled('warning: the damping ratio of mode '// &
         to_text(found%measured(j)%mode)//' is #.1 standard errors from that of '//name// &
         ', the best model: no mechanism in this list explains it', distance(j:j)))
   end subroutine add_misfit

   !> Adds a table of the damping ratios, with a column for each measured mode.
   subroutine add_ratios(found, labels, text)
      type(damping_models_t), intent(in) :: found
      type(string_t), intent(in) :: labels(:)
      type(text_t), intent(inout) :: text
      integer, parameter :: most = 5
      real(wp) :: t
      integer :: first, j, k, last

      if (size(found%measured) == 0) then
         call text%line('No damping ratio can be measured without a model of the damping: that '// &
            'takes a free decay, a frequency response or a table of modes.')
         call text%line()
      end if
      t = normal_quantile(0.975_wp)
      do first = 1, size(found%measured), most
         last = min(first + most - 1, size(found%measured))
         associate (m => found%measured(first:last))
            call text%line(left('damping ratio [%] of mode', of_names)//titles(found, first, last))
            call text%line(left('natural frequency', of_names)//numbers([m%frequency], 4))
            call text%line(left('measured', of_names)//numbers(100*m%damping, 3))
            call text%line(left('95 % half width', of_names)//numbers(100*t*m%sd_damping, 2))
         end associate
         do k = 1, size(labels)
            call text%line(left(labels(k)%text, of_names)//numbers([(100*ratio_of(found, k, j), &
               j=first, last)], 3))
         end do
         call text%line()
      end do
   end subroutine add_ratios

   !> Returns the numbers of the modes as titles of columns, with that of the record if there are
   !> several.
   pure function titles(found, first, last) result(line)
      type(damping_models_t), intent(in) :: found
      integer, intent(in) :: first, last
      character(len=:), allocatable :: line, title
      integer :: j

      line = ''
      do j = first, last
         associate (m => found%measured(j))
            title = to_text(m%mode)
            if (any(found%measured%record /= 1)) title = title//'('//to_text(m%record)//')'
            line = line//right(title, of_numbers)
         end associate
      end do
   end function titles

   !> Returns rounded values side by side.
   pure function numbers(values, digits) result(line)
      real(wp), intent(in) :: values(:)
      integer, intent(in) :: digits
      character(len=:), allocatable :: line
      integer :: j

      line = ''
      do j = 1, size(values)
         line = line//right(rounded(values(j), digits), of_numbers)
      end do
   end function numbers

   !> Returns damping.csv: a row for each mode of each model, with the measured values beside it.
   pure function damping_table(found, labels, is_possible) result(content)
      type(damping_models_t), intent(in) :: found
      type(string_t), intent(in) :: labels(:)
      logical, intent(in) :: is_possible(:)
      character(len=:), allocatable :: content
      type(text_t) :: table
      real(wp) :: t
      integer :: i, j, k, number, record

      t = normal_quantile(0.975_wp)
      call table%line('model,possible,record,mode,frequency_hz,damping_ratio,measured_hz,'// &
         'measured_damping,lower95,upper95')
      do k = 1, size(labels)
         number = 0
         record = 0
         do i = 1, size(found%modes(k)%modes)
            associate (mode => found%modes(k)%modes(i))
               if (mode%record /= record) number = 0
               record = mode%record
               number = number + 1
               call table%add(labels(k)%text//','//trim(merge('yes', 'no ', is_possible(k)))// &
                  ','//to_text(record)//','//to_text(number)//','// &
                  full(mode%frequency)//','//full(mode%damping_ratio))
               j = findloc(found%measured%record == record .and. found%measured%mode == number, &
                  .true., dim=1)
               if (j == 0) then
                  call table%line(',,,,')
                  cycle
               end if
               associate (m => found%measured(j))
                  call table%line(','//full(m%frequency)//','//full(m%damping)//','// &
                     full(m%damping - t*m%sd_damping)//','//full(m%damping + t*m%sd_damping))
               end associate
            end associate
         end do
      end do
      content = table%content()
   end function damping_table

end module beamid_damping_reports
