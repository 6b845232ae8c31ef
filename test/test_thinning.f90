!> Every k-th sample behind a low-pass filter: what passes, what is stopped, what is left out.
program test_thinning
   use beamid_kinds, only: wp
   use beamid_thinning, only: margin_of, thin_out, thinned_t
   use checks, only: check, check_close, finish
   use random_numbers, only: start_random, uniform
   implicit none

   real(wp), parameter :: pi = acos(-1.0_wp), rate = 4000
   integer, parameter :: n = 20000

   call start_random(20240607, 16807)
   call test_tones(0.0_wp, 2, 'even stamps')
   call test_tones(0.0_wp, 10, 'even stamps')
   call test_tones(0.2_wp, 4, 'stamps off by 20 %')
   call test_tones(0.2_wp, 10, 'stamps off by 20 %')
   call test_tones(0.35_wp, 10, 'stamps off by 35 %')
   call test_tones(0.2_wp, 50, 'stamps off by 20 %')
   call test_report()
   call test_noise()
   call test_ends()
   call test_gap()
   call test_noise_at_a_gap()
   call test_bad_samples()
   call finish('thinning')

contains

   !> Tones of amplitude 1, singly: in the pass band, then above the new Nyquist frequency, where
   !> each would fold back.
   subroutine test_tones(jitter, k, what)
      real(wp), intent(in) :: jitter
      integer, intent(in) :: k
      character(len=*), intent(in) :: what
      real(wp), parameter :: inside(*) = [0.0_wp, 0.03_wp, 0.25_wp, 0.4_wp, 0.5_wp], &
         outside(*) = [1.05_wp, 1.3_wp, 1.6_wp, 1.97_wp]
      real(wp) :: t(n), worst
      type(thinned_t) :: thinned
      character(len=60) :: name
      integer :: j

      t = stamps(jitter)
      write (name, '(2a,i0)') what, ', k = ', k
      worst = 0
      do j = 1, size(inside)
         thinned = of_tone(t, inside(j)*rate/(2*k), k)
         worst = max(worst, maxval(abs(thinned%z - tone(thinned%t, inside(j)*rate/(2*k)))))
      end do
      ! The promise of the pass band.
      call check_close(trim(name)//': pass band', worst, 0.0_wp, 1e-4_wp)
      worst = 0
      do j = 1, size(outside)
         ! Uneven stamps, fewer than 4.4 to a period: 12 neighbours do not tell the tone.
         if (jitter > 0 .and. outside(j)/k > 0.45_wp) cycle
         thinned = of_tone(t, outside(j)*rate/(2*k), k)
         worst = max(worst, maxval(abs(thinned%z)))
      end do
      ! 70 dB below the tone.
      call check_close(trim(name)//': stop band', worst, 0.0_wp, 10.0_wp**(-3.5_wp))
      call check(trim(name)//': as many as there should be', size(thinned%t) + thinned%lost == &
         (n + k - 1)/k .and. thinned%lost <= 2*15 + 2)
   end subroutine test_tones

   !> The frequencies and the length that are reported are those of the filter.
   subroutine test_report()
      type(thinned_t) :: thinned

      thinned = of_tone(stamps(0.0_wp), 1.0_wp, 10)
      call check_close('passes up to half of f_N', thinned%passes, 0.25_wp*rate/10, 1e-9_wp*rate)
      call check_close('stops above f_N', thinned%stops, 0.5_wp*rate/10, 1e-9_wp*rate)
      ! 14.4*10 rows of 1/4000 on either side; the first of rows 1, 11, 21, ... behind row 145.
      call check_close('half the length', thinned%half_width, 144/rate, 1e-9_wp)
      call check_close('first sample', thinned%t(1), 151/rate, 1e-9_wp)
   end subroutine test_report

   !> White noise keeps the share of its power that lies in the band.
   subroutine test_noise()
      real(wp) :: z(n)
      type(thinned_t) :: thinned
      integer :: j

      z = [(sqrt(12.0_wp)*(uniform() - 0.5_wp), j=1, n)]
      call thin_out(stamps(0.2_wp), z, [(.false., j=1, n)], [(j, j=1, n)], 10, thinned)
      ! 0.8/10 of it, known to sqrt(2/1970) = 3 % from so many; interpolation adds a little.
      call check_close('white noise, mean square', sum(thinned%z**2)/size(thinned%z), 0.08_wp, &
         0.012_wp)
   end subroutine test_noise

   !> Of a window inside the record nothing is lost; rows beside it serve the filter.
   subroutine test_ends()
      real(wp) :: t(n)
      type(thinned_t) :: thinned
      logical :: bad(n)
      integer :: j, margin

      t = stamps(0.2_wp)
      bad = .false.
      margin = margin_of(10)
      call thin_out(t, tone(t, 20.0_wp), bad, [(j, j=margin + 1, n - margin)], 10, thinned)
      call check('window inside: nothing lost', thinned%lost == 0)
      call check('window inside: every tenth stamp as it is', &
         size(thinned%t) == (n - 2*margin + 9)/10 .and. &
         all(abs(thinned%t - t(margin + 1:n - margin:10)) <= 0))
      call thin_out(t(:250), tone(t(:250), 20.0_wp), bad(:250), [(j, j=1, 250)], 10, thinned)
      call check('shorter than the filter', size(thinned%t) == 0 .and. thinned%lost == 25)
   end subroutine test_ends

   !> Gaps of all lengths: what is kept is right, however much is lost.
   subroutine test_gap()
      integer, parameter :: lengths(*) = [1, 2, 3, 5, 8, 15, 30, 1000], k = 10
      real(wp) :: t(n)
      real(wp), allocatable :: rest(:)
      type(thinned_t) :: thinned
      integer :: j, i, ends, lost
      character(len=60) :: name
      logical :: none(n)

      none = .false.
      t = stamps(0.2_wp)
      thinned = of_tone(t, 100.0_wp, k)
      ends = thinned%lost
      do j = 1, size(lengths)
         rest = [t(:n/2), t(n/2 + 1 + lengths(j):)]
         associate (m => size(rest))
            call thin_out(rest, tone(rest, 100.0_wp), none(:m), [(i, i=1, m)], k, thinned)
         end associate
         lost = thinned%lost - ends
         write (name, '(a,i0,a,i0,a)') 'gap of ', lengths(j), ': kept are right, ', lost, ' lost'
         call check_close(trim(name), maxval(abs(thinned%z - tone(thinned%t, 100.0_wp))), 0.0_wp, &
            1e-4_wp)
         ! The filter is 288 rows long: a gap can cost 29 samples, give or take one at the ends. One
         ! that is shorter than half a period of the tone costs none.
         call check('  no more lost than need be', lost <= merge(1, 30, lengths(j) < 4))
         call check('  all lost at a long gap', lost >= 27 .or. lengths(j) < 20)
      end do
   end subroutine test_gap

   !> Where rows are missing and the samples are kept, the noise is not blown up.
   subroutine test_noise_at_a_gap()
      integer, parameter :: k = 50, missing = 5
      real(wp) :: t(n)
      real(wp), allocatable :: rest(:), z(:)
      type(thinned_t) :: thinned
      integer :: j

      t = stamps(0.2_wp)
      rest = [t(:n/2), t(n/2 + 1 + missing:)]
      z = [(sqrt(12.0_wp)*(uniform() - 0.5_wp), j=1, size(rest))]
      call thin_out(rest, z, [(.false., j=1, size(z))], [(j, j=1, size(z))], k, thinned)
      call check('noise at a gap: nothing lost there', thinned%lost <= 31)
      ! 5 standard deviations of what noise leaves of 1 in a band of 0.8/50.
      call check_close('noise at a gap', maxval(abs(thinned%z)), 0.0_wp, 5*sqrt(0.8_wp/k))
   end subroutine test_noise_at_a_gap

   !> A sample is lost where a bad one lies inside its filter, and only there.
   subroutine test_bad_samples()
      real(wp) :: t(n), z(n)
      logical :: bad(n)
      type(thinned_t) :: whole, thinned
      integer :: j

      t = stamps(0.0_wp)
      z = tone(t, 100.0_wp)
      bad = .false.
      call thin_out(t, z, bad, [(j, j=1, n)], 10, whole)
      bad(10000:10002) = .true.
      z(10000:10002) = 1e6_wp
      call thin_out(t, z, bad, [(j, j=1, n)], 10, thinned)
      call check_close('bad samples do no harm', maxval(abs(thinned%z - &
         tone(thinned%t, 100.0_wp))), 0.0_wp, 1e-4_wp)
      ! Stamps from 9856 to 10146, those of 10 j + 1: 29 of them.
      call check('bad samples: 29 lost', thinned%lost - whole%lost == 29)
   end subroutine test_bad_samples

   function of_tone(t, frequency, k) result(thinned)
      real(wp), intent(in) :: t(:), frequency
      integer, intent(in) :: k
      type(thinned_t) :: thinned
      integer :: j

      call thin_out(t, tone(t, frequency), [(.false., j=1, size(t))], [(j, j=1, size(t))], k, &
         thinned)
   end function of_tone

   pure elemental real(wp) function tone(t, frequency)
      real(wp), intent(in) :: t, frequency

      tone = cos(2*pi*frequency*t + 0.7_wp)
   end function tone

   !> Even but for a part of the step.
   function stamps(jitter) result(t)
      real(wp), intent(in) :: jitter
      real(wp) :: t(n)
      integer :: j

      t = [(real(j, wp), j=1, n)]
      do j = 1, n
         t(j) = (t(j) + jitter*(2*uniform() - 1))/rate
      end do
   end function stamps

end program test_thinning
