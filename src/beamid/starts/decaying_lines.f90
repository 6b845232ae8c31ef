!> Spectral lines of a record, each a decaying oscillation.
!>
!> A matched filter, evaluated at the sample times themselves, finds one line after the other. After
!> each one, all lines are refined together.
module beamid_decaying_lines
   use beamid_errors, only: error_t
   use beamid_kinds, only: two_pi, wp
   use beamid_projection, only: new_projection, projection_t
   use beamid_spectra, only: condense, line_t, near_mains, order_of_multiple, strongest_line, &
      too_near
   implicit none
   private

   public :: find_lines, refine_lines

contains

   !> Returns the spectral lines of a record, in descending order of energy, and marks multiples.
   !>
   !> t        (m) sample times, ascending [time]
   !> z        (m) values in any unit
   !> highest  highest frequency to search, limited to half the mean sampling rate [1/time]; 0, as
   !>          of a model without oscillating modes: no line is found
   !> most     largest number of lines
   subroutine find_lines(t, z, highest, most, lines)
      real(wp), intent(in) :: t(:), z(:), highest
      integer, intent(in) :: most
      type(line_t), allocatable, intent(out) :: lines(:)
      real(wp), allocatable :: times(:), values(:), rest(:)
      type(line_t), allocatable :: rejected(:), tried(:)
      type(line_t) :: line
      real(wp) :: range(2), span
      integer :: k

      allocate (lines(0), rejected(0))
      if (size(t) < 8 .or. .not. highest > 0) return
      call condense(t, z, highest, times, values)
      if (size(times) < 8) return
      span = times(size(times)) - times(1)
      range = [1.5_wp/span, min(highest, (size(times) - 1)/(2*span))]
      if (.not. range(1) < range(2)) return
      times = times - times(1)
      values = values - sum(values)/size(values)
      rest = values
      do k = 1, 2*most
         call strongest_line(times, rest, range, [lines, rejected], line)
         if (.not. line%frequency > 0 .or. size(lines) == most) exit
         tried = [lines, line]
         call refine(times, values, range, tried, rest)
         if (.not. apart(tried, span)) then
            rejected = [rejected, line]
            call refine(times, values, range, lines, rest)
            cycle
         end if
         lines = tried
      end do
      call sort_by_energy(lines)
      call name_multiples(lines, span)
   end subroutine find_lines

   !> Fits frequencies and decay rates of given lines to a record, with their amplitudes and a mean.
   !>
   !> t, z   (m) sample times, ascending [time], and values in any unit
   !> lines  on return at the least squares
   !> rest   (m) z without mean and lines
   subroutine refine_lines(t, z, lines, rest)
      real(wp), intent(in) :: t(:), z(:)
      type(line_t), intent(inout) :: lines(:)
      real(wp), intent(out) :: rest(:)

      call refine(t - t(1), z - sum(z)/size(z), [0.0_wp, huge(1.0_wp)], lines, rest)
   end subroutine refine_lines

   !> Tells whether the last line still has energy after the refinement, and is distinct from the
   !> others.
   !>
   !> span  length of the record [time]
   pure logical function apart(lines, span)
      type(line_t), intent(in) :: lines(:)
      real(wp), intent(in) :: span
      integer :: n

      n = size(lines)
      apart = .not. any(too_near(lines(n)%frequency, lines(:n - 1), span)) .and. &
         lines(n)%energy > 0
   end function apart

   !> Refines all frequencies and decay rates by Gauss-Newton steps, with amplitudes and a mean
   !> eliminated. A step that does not reduce the sum of squares is shortened.
   !>
   !> t      (m) sample times, starting at 0 [time]
   !> z      (m) values with sum 0
   !> range  (2) range of the frequencies [1/time]
   !> lines  on return with their energies
   !> rest   (m) z without the lines
   subroutine refine(t, z, range, lines, rest)
      real(wp), intent(in) :: t(:), z(:), range(2)
      type(line_t), intent(inout) :: lines(:)
      real(wp), intent(out) :: rest(:)
      integer, parameter :: steps = 6
      type(line_t) :: moved(size(lines))
      real(wp) :: step(2*size(lines)), J, span, share
      integer :: k

      span = t(size(t))
      share = 1
      call separate(t, z, lines, rest, step)
      J = sum(rest**2)
      do k = 1, steps
         moved = lines
         associate (n => size(lines), limit => 1/span)
            moved%frequency = min(max(lines%frequency + share*max(-limit, min(limit, &
               step(:n)/two_pi)), range(1)), range(2))
            moved%decay = max(0.0_wp, lines%decay + share*max(-10*limit - lines%decay/2, &
               min(10*limit + lines%decay, step(n + 1:))))
         end associate
         call try()
      end do

   contains

      !> Evaluates the lines that were moved, and accepts them if the sum of squares is smaller.
      subroutine try()
         real(wp) :: next(size(step)), left(size(rest))

         call separate(t, z, moved, left, next)
         if (.not. sum(left**2) < J) then
            share = share/4
            return
         end if
         lines = moved
         rest = left
         step = next
         share = min(1.0_wp, 2*share)
         J = sum(rest**2)
      end subroutine try

   end subroutine refine

   !> Computes the amplitudes of the lines by least squares, and the next Gauss-Newton step.
   !>
   !> rest   (m) z without the lines and without a mean
   !> step   (2n) step of the angular frequencies, then of the decay rates [1/time]
   subroutine separate(t, z, lines, rest, step)
      real(wp), intent(in) :: t(:), z(:)
      type(line_t), intent(inout) :: lines(:)
      real(wp), intent(out) :: rest(:), step(:)
      complex(wp) :: motion(size(t), size(lines))
      real(wp) :: phi(size(t), 2*size(lines) + 1), slope(size(t), 2*size(lines))
      real(wp) :: c(2*size(lines) + 1), y(size(t)), length(2*size(lines))
      type(projection_t) :: projection
      type(error_t), allocatable :: error
      integer :: k, n

      n = size(lines)
      step = 0
      do k = 1, n
         motion(:, k) = exp(cmplx(-lines(k)%decay, two_pi*lines(k)%frequency, wp)*t)
      end do
      phi(:, :n) = real(motion)
      phi(:, n + 1:2*n) = aimag(motion)
      phi(:, 2*n + 1) = 1
      rest = z
      call new_projection(phi, projection, error)
      if (allocated(error)) then
         lines(n)%energy = 0
         return
      end if
      call projection%coefficients(rest, c)
      do k = 1, n
         ! The signs are those of -z + Phi c, because the coefficients minimise |z + Phi c|.
         motion(:, k) = motion(:, k)*cmplx(-c(k), c(n + k), wp)
         lines(k)%energy = sum(real(motion(:, k))**2)/max(sum(z**2), tiny(1.0_wp))
         slope(:, k) = t*aimag(motion(:, k))
         slope(:, n + k) = t*real(motion(:, k))
      end do
      slope = slope - matmul(projection%q, matmul(transpose(projection%q), slope))
      length = norm2(slope, dim=1)
      if (n == 0 .or. .not. all(length > 0)) return
      slope = slope/spread(length, 1, size(t))
      call new_projection(slope, projection, error)
      if (allocated(error)) return
      y = rest
      call projection%coefficients(y, step)
      step = step/length
   end subroutine separate

   !> Sorts lines in descending order of energy.
   pure subroutine sort_by_energy(lines)
      type(line_t), intent(inout) :: lines(:)
      integer :: k, strongest

      do k = 1, size(lines) - 1
         strongest = k - 1 + maxloc(lines(k:)%energy, dim=1)
         lines([k, strongest]) = lines([strongest, k])
      end do
   end subroutine sort_by_energy

   !> Marks multiples of stronger lines, and lines of the mains.
   !>
   !> A multiple has less than a fiftieth of the energy of the stronger line. A line of the mains is
   !> a multiple of 50 or 60 that does not decay.
   !>
   !> lines  in descending order of energy
   !> span   length of the record [time]
   pure subroutine name_multiples(lines, span)
      type(line_t), intent(inout) :: lines(:)
      real(wp), intent(in) :: span
      real(wp), parameter :: weak = 0.02_wp
      integer :: j, k, order

      do k = 1, size(lines)
         do j = 1, k - 1
            if (lines(j)%harmonic > 0 .or. lines(k)%energy > weak*lines(j)%energy) cycle
            order = order_of_multiple(lines(k)%frequency, lines(j)%frequency, 0.0_wp)
            if (order >= 2) lines(k)%harmonic = order
         end do
         lines(k)%mains = lines(k)%decay*span < 0.7_wp .and. &
            near_mains(lines(k)%frequency, span, 0.0_wp)
      end do
   end subroutine name_multiples

end module beamid_decaying_lines
