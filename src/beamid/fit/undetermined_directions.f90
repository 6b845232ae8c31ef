!> Describes the combinations of parameters that the data of a fit do not determine.
module beamid_undetermined_directions
   use beamid_kinds, only: wp
   use beamid_statistics, only: statistics_t
   use beamid_strings, only: fixed, to_text
   implicit none
   private

   public :: undetermined

contains

   !> Returns a sentence for each combination of parameters whose relative change by 100 % cannot be
   !> distinguished from noise (at 95 %).
   !>
   !> names     (n) of the parameters
   !> scale     (n) as in `new_statistics`
   !> jacobian  (m, n) for the change of J along a direction
   function undetermined(statistics, names, scale, jacobian) result(sentences)
      type(statistics_t), intent(in) :: statistics
      character(len=*), intent(in) :: names(:)
      real(wp), intent(in) :: scale(:), jacobian(:, :)
      character(len=512), allocatable :: sentences(:)
      real(wp) :: t, threshold
      integer :: k, n

      n = statistics%parameters
      allocate (sentences(0))
      t = statistics%quantile
      threshold = max(t*sqrt(statistics%variance), &
         epsilon(1.0_wp)*statistics%samples*statistics%singular(1))
      do k = n, 1, -1
         if (statistics%singular(k) > threshold) cycle
         sentences = [character(len=512) :: sentences, &
            describe_direction(statistics, names, scale, jacobian, k)]
      end do
   end function undetermined

   !> Returns the sentence for direction k: its parameters, and the change of J along it.
   function describe_direction(statistics, names, scale, jacobian, k) result(text)
      type(statistics_t), intent(in) :: statistics
      character(len=*), intent(in) :: names(:)
      real(wp), intent(in) :: scale(:), jacobian(:, :)
      integer, intent(in) :: k
      character(len=:), allocatable :: text
      real(wp), allocatable :: v(:)
      real(wp) :: J, change_alone, change_along, smallest_share
      integer :: i, largest

      J = statistics%variance*statistics%freedom
      v = statistics%direction(:, k)
      largest = maxloc(abs(v), dim=1)
      v = v/v(largest)
      ! Is the largest parameter alone undetermined, or can small changes of others compensate it?
      change_alone = sum((jacobian(:, largest)*scale(largest))**2)
      change_along = (statistics%singular(k)/statistics%direction(largest, k))**2
      smallest_share = 0.1_wp
      if (count(abs(v) > smallest_share) == 1 .and. change_alone > 4*change_along) &
         smallest_share = 1e-4_wp
      if (count(abs(v) > smallest_share) == 1) then
         text = trim(names(largest))// &
            ' is not determined by this record: doubling it changes J by '// &
            to_text(change_alone)//' ('//to_text(100*(change_alone/max(J, tiny(J))))//' % of J)'
         return
      end if
      text = ''
      do i = 1, size(v)
         if (abs(v(i)) <= smallest_share) cycle
         if (text /= '') text = text//', '
         text = text//trim(names(i))//' by '//signed_per_cent(100*v(i))//' %'
      end do
      text = 'not determined together: changing '//text//' at once changes J by '// &
         to_text(change_along)
   end function describe_direction

   !> Returns a percentage with its sign: in whole numbers, or with two decimals below 1 %.
   pure function signed_per_cent(value) result(text)
      real(wp), intent(in) :: value
      character(len=:), allocatable :: text

      text = trim(adjustl(fixed(value, 12, merge(0, 2, abs(value) >= 1))))
      text = text(:verify(text, '.', back=.true.))
      if (value > 0) text = '+'//text
   end function signed_per_cent

end module beamid_undetermined_directions
