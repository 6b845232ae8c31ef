!> Computes Student's t, chi-square and normal distributions from the incomplete beta and gamma
!> functions, for intervals and tests.
module beamid_distributions
   use beamid_kinds, only: pi, two_pi, wp
   implicit none
   private

   public :: incomplete_beta, incomplete_gamma, student_probability, student_quantile, &
      chi_square_tail, normal_probability, normal_quantile

   !> Half width of a 95 % interval of a standard normal variable.
   real(wp), parameter, public :: normal_95 = 1.959963984540054_wp

   !> Largest number of terms of a series or continued fraction.
   integer, parameter :: max_terms = 100000

contains

   !> Returns the regularised incomplete beta function I_x(a, b), 0 <= x <= 1, a, b > 0, by the
   !> continued fraction DLMF 8.17.22, of x or of 1 - x, whichever converges faster.
   pure real(wp) function incomplete_beta(a, b, x) result(value)
      real(wp), intent(in) :: a, b, x
      real(wp) :: front

      if (x <= 0 .or. x >= 1) then
         value = merge(0.0_wp, 1.0_wp, x <= 0)
         return
      end if
      front = exp(log_gamma(a + b) - log_gamma(a) - log_gamma(b) + a*log(x) + b*log1m(x))
      if (x < (a + 1)/(a + b + 2)) then
         value = front*beta_fraction(a, b, x)/a
      else
         value = 1 - front*beta_fraction(b, a, 1 - x)/b
      end if
   end function incomplete_beta

   !> Returns log(1 - x), accurate also for small x.
   pure real(wp) function log1m(x)
      real(wp), intent(in) :: x
      real(wp) :: y

      ! log(y)/(y - 1) varies slowly: the round-off of y = 1 - x cancels.
      y = 1 - x
      log1m = -x
      if (abs(y - 1) > 0) log1m = -x*log(y)/(y - 1)
   end function log1m

   !> Returns the continued fraction 1/(1+ d_1/(1+ d_2/(1+ ...))) of the incomplete beta function,
   !> by Lentz's method.
   pure real(wp) function beta_fraction(a, b, x) result(value)
      real(wp), intent(in) :: a, b, x
      real(wp) :: c, d, term
      integer :: m, k

      c = 1
      d = 1/away_from_zero(1 - (a + b)*x/(a + 1))
      value = d
      do m = 1, max_terms
         do k = 0, 1
            if (k == 0) then
               term = m*(b - m)*x/((a + 2*m - 1)*(a + 2*m))
            else
               term = -(a + m)*(a + b + m)*x/((a + 2*m)*(a + 2*m + 1))
            end if
            d = 1/away_from_zero(1 + term*d)
            c = away_from_zero(1 + term/c)
            value = value*c*d
            if (k == 1 .and. abs(c*d - 1) <= epsilon(value)) return
         end do
      end do
   end function beta_fraction

   !> Returns x, or the smallest normal number if |x| is smaller, for Lentz's method.
   pure real(wp) function away_from_zero(x)
      real(wp), intent(in) :: x

      away_from_zero = x
      if (abs(x) < tiny(x)) away_from_zero = tiny(x)
   end function away_from_zero

   !> Returns the regularised upper incomplete gamma function Q(a, x), a > 0, x >= 0: by the series
   !> DLMF 8.11.4 of 1 - Q for x < a + 1, otherwise by the continued fraction 8.9.2.
   pure real(wp) function incomplete_gamma(a, x) result(value)
      real(wp), intent(in) :: a, x
      real(wp) :: front, term, c, d, b
      integer :: k

      value = 1
      if (x <= 0) return
      front = exp(a*log(x) - x - log_gamma(a))
      if (x < a + 1) then
         term = 1/a
         value = term
         do k = 1, max_terms
            term = term*x/(a + k)
            value = value + term
            if (term <= epsilon(value)*value) exit
         end do
         value = 1 - front*value
      else
         b = x + 1 - a
         c = 1/tiny(x)
         d = 1/b
         value = d
         do k = 1, max_terms
            b = b + 2
            d = 1/away_from_zero(b - k*(k - a)*d)
            c = away_from_zero(b - k*(k - a)/c)
            value = value*c*d
            if (abs(c*d - 1) <= epsilon(value)) exit
         end do
         value = front*value
      end if
   end function incomplete_gamma

   !> Returns the probability that |T| <= t, t >= 0, for Student's t with `freedom` > 0 degrees of
   !> freedom.
   pure real(wp) function student_probability(t, freedom) result(value)
      real(wp), intent(in) :: t, freedom

      if (t**2 < freedom) then
         value = incomplete_beta(0.5_wp, freedom/2, t**2/(freedom + t**2))
      else
         value = 1 - incomplete_beta(freedom/2, 0.5_wp, freedom/(freedom + t**2))
      end if
   end function student_probability

   !> Returns the two-sided quantile of Student's distribution, the t with P(|T| <= t) =
   !> probability, 0 < probability < 1, up to the round-off of `student_probability`. A 95 %
   !> interval has the probability 0.95 here, and 0.975 in the one-sided `normal_quantile`.
   pure real(wp) function student_quantile(probability, freedom) result(t)
      real(wp), intent(in) :: probability, freedom
      real(wp) :: excess, density, height, last
      logical :: from_below
      integer :: k

      height = 2*exp(log_gamma((freedom + 1)/2) - log_gamma(freedom/2))/sqrt(freedom*pi)
      ! The quantile of the normal distribution with the first correction for `freedom` (26.7.5 of
      ! Abramowitz and Stegun), then Newton's method; the derivative of the probability is twice the
      ! density. The probability is a concave function of t: once an iterate is below the root, the
      ! next ones rise towards it.
      t = -normal_quantile((1 - probability)/2)
      t = t + t*(t**2 + 1)/(4*freedom)
      from_below = .false.
      do k = 1, 1000
         excess = student_probability(t, freedom) - probability
         if (from_below .and. excess >= 0) exit
         from_below = from_below .or. excess < 0
         density = height*exp(-(freedom + 1)/2*log(1 + t**2/freedom))
         last = t
         t = max(t - excess/max(density, tiny(t)), t/2)
         if (abs(t - last) <= epsilon(t)*t) exit
      end do
   end function student_quantile

   !> Returns the probability that chi-square with `freedom` degrees of freedom exceeds x.
   pure real(wp) function chi_square_tail(x, freedom) result(value)
      real(wp), intent(in) :: x, freedom

      value = incomplete_gamma(freedom/2, max(0.0_wp, x)/2)
   end function chi_square_tail

   !> Returns the probability that a standard normal variable is below x.
   elemental real(wp) function normal_probability(x) result(value)
      real(wp), intent(in) :: x

      value = erfc(-x/sqrt(2.0_wp))/2
   end function normal_probability

   !> Returns the one-sided quantile of the standard normal distribution, the x with P(X <= x) =
   !> probability, for a probability in (0, 1): 0.975 for the upper end of a 95 % interval. It uses
   !> Newton's method on the logarithm of the tail, from the approximation 26.2.23 of Abramowitz and
   !> Stegun. This function is concave: the iteration passes the root at most once and then
   !> converges from one side.
   elemental real(wp) function normal_quantile(probability) result(x)
      real(wp), intent(in) :: probability
      real(wp), parameter :: root_of_2_pi = sqrt(two_pi)
      real(wp) :: tail, there, step, t
      integer :: k

      tail = min(probability, 1 - probability)
      t = sqrt(-2*log(tail))
      x = (2.515517_wp + t*(0.802853_wp + t*0.010328_wp)) &
         /(1 + t*(1.432788_wp + t*(0.189269_wp + t*0.001308_wp))) - t
      do k = 1, 100
         there = normal_probability(x)
         step = log(there/tail)*(there*exp(x**2/4))*exp(x**2/4)*root_of_2_pi
         x = x - step
         if (abs(step) <= 4*epsilon(x)*max(abs(x), 1.0_wp)) exit
      end do
      if (probability > 0.5_wp) x = -x
   end function normal_quantile

end module beamid_distributions
