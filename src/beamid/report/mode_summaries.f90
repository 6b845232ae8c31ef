!> The parts of the summary about natural modes, and about the minima found from several starts.
module beamid_mode_summaries
   use beamid_case_files, only: case_t
   use beamid_fitted_modes, only: fitted_mode_t
   use beamid_kinds, only: pi, wp
   use beamid_lines, only: columns
   use beamid_multistart, only: minimum_t
   use beamid_statistics, only: unlimited
   use beamid_strings, only: fixed, rounded, to_text
   use beamid_texts, only: right, text_t
   implicit none
   private

   public :: add_refinement_warning, modes_summary, fitted_modes_summary, minima_summary

contains

   !> Adds a warning if even the finest mesh does not determine the natural frequencies.
   !>
   !> remaining  largest relative change of a natural frequency in the last refinement
   subroutine add_refinement_warning(text, remaining)
      type(text_t), intent(inout) :: text
      real(wp), intent(in) :: remaining
      real(wp), parameter :: too_large = 1e-3_wp

      if (remaining > too_large) call text%line('warning: mesh: the last refinement still '// &
         'changes natural frequencies by up to '//rounded(100*remaining, 2)// &
         ' %; use degree=5 or give more elements')
   end subroutine add_refinement_warning

   !> Adds the lowest modes on one mesh: undamped frequencies and damped roots.
   !>
   !> elements  of the mesh
   !> omega     undamped angular frequencies, ascending [1/time]
   !> roots     roots of the characteristic equation in the order of their moduli [1/time]
   subroutine modes_summary(text, case, elements, omega, roots)
      type(text_t), intent(inout) :: text
      type(case_t), intent(in) :: case
      integer, intent(in) :: elements
      real(wp), intent(in) :: omega(:)
      complex(wp), intent(in) :: roots(:)
      integer, parameter :: shown = 10
      character(len=:), allocatable :: line
      real(wp) :: ratio
      integer :: k

      call text%line('N = '//to_text(elements)//': '//to_text(size(omega))// &
         ' modes, the lowest '//to_text(min(shown, size(omega))))
      call text%line(' mode  undamped '//frequency_unit(case)//'    |s|/2 pi '// &
         frequency_unit(case)//'   damping ratio        Re s         Im s')
      do k = 1, min(shown, size(roots))
         line = right(to_text(k), 5)//right(merge(frequency(omega(min(k, size(omega)))/(2*pi)), &
            repeat(' ', 14), k <= size(omega)), 16)
         ratio = 0
         if (abs(real(roots(k))) > 0) ratio = -real(roots(k))/abs(roots(k))
         call text%line(line//right(frequency(abs(roots(k))/(2*pi)), 18)//columns([ratio], 16)// &
            columns([real(roots(k)), aimag(roots(k))], 13))
      end do
   end subroutine modes_summary

   !> Adds the modes of a fitted structure with 95 % intervals.
   !>
   !> modes  of all records
   subroutine fitted_modes_summary(text, case, elements, modes)
      type(text_t), intent(inout) :: text
      type(case_t), intent(in) :: case
      integer, intent(in) :: elements
      type(fitted_mode_t), intent(in) :: modes(:)
      character(len=:), allocatable :: line, width
      integer :: k

      if (size(modes) == 0) return
      call text%line('N = '//to_text(elements)// &
         ': modes of the fitted structure, 95 % intervals from noise and mesh')
      line = ' mode'
      if (maxval(modes%record) > 1) line = line//' record'
      call text%line(line//'  |s|/2 pi '//frequency_unit(case)// &
         '            +-   damping ratio            +-')
      do k = 1, size(modes)
         associate (mode => modes(k))
            line = right(to_text(count(modes(:k)%record == mode%record)), 5)
            if (maxval(modes%record) > 1) line = line//right(to_text(mode%record), 7)
            width = '-'
            if (mode%frequency_half_width < unlimited) width = to_text(mode%frequency_half_width)
            line = line//right(frequency(mode%frequency), 15)//right(width)
            width = '-'
            if (mode%damping_half_width < unlimited) width = to_text(mode%damping_half_width)
            line = line//right(to_text(mode%damping_ratio), 16)//right(width)
         end associate
         call text%line(line)
      end do
      if (all(.not. abs(aimag(modes%s)) > 0)) then
         call text%line('no mode oscillates: every root is real, a decay without oscillation')
      else if (any(.not. abs(aimag(modes%s)) > 0)) then
         call text%line('damping ratio 1: a real root, a decay without oscillation')
      end if
      if (any(modes%together)) call text%line('roots that nearly coincide have no interval, '// &
         'because a single one of them does not depend smoothly on the parameters')
   end subroutine fitted_modes_summary

   !> Adds the distinct minima, the lowest first.
   !>
   !> failures  number of starts whose fit failed
   subroutine minima_summary(text, case, elements, minima, failures)
      type(text_t), intent(inout) :: text
      type(case_t), intent(in) :: case
      integer, intent(in) :: elements, failures
      type(minimum_t), intent(in) :: minima(:)
      !> Number of parameters side by side.
      integer, parameter :: most = 5
      character(len=:), allocatable :: line
      integer :: first, j, k, last, n

      call text%line('N = '//to_text(elements)//': '//to_text(case%multistart%n)// &
         ' starts, minima found: '//to_text(size(minima))//'; '//to_text(failures)// &
         ' starts failed')
      n = size(minima(1)%fits(size(minima(1)%fits))%free)
      do first = 1, max(n, 1), most
         last = min(first + most - 1, n)
         line = '  found'//right('J')
         associate (fit => minima(1)%fits(size(minima(1)%fits)))
            do j = first, last
               line = line//right(trim(fit%quantities(j)%name))
            end do
         end associate
         call text%line(line)
         do k = 1, size(minima)
            associate (fit => minima(k)%fits(size(minima(k)%fits)))
               call text%line(right(to_text(minima(k)%count), 7)//columns([fit%fit%J, &
                  fit%quantities(first:last)%value], 14))
            end associate
         end do
      end do
   end subroutine minima_summary

   !> Returns a frequency with six decimals if these show at least four digits.
   pure function frequency(value) result(text)
      real(wp), intent(in) :: value
      character(len=14) :: text

      text = to_text(value)
      if (value >= 1e-3_wp .and. value < 1e6_wp) text = fixed(value, 14, 6)
   end function frequency

   !> Returns the unit of frequencies: Hz if the time is in seconds or has no label.
   function frequency_unit(case) result(unit)
      type(case_t), intent(in) :: case
      character(len=:), allocatable :: unit

      unit = '[Hz]'
      if (case%units%time /= '') unit = '['//case%units%frequency()//']'
   end function frequency_unit

end module beamid_mode_summaries
