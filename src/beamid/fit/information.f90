!> What an experiment that nobody has done yet would tell of its parameters: linear theory from the
!> information matrix J'J/sigma**2 of relative changes (Fedorov, Theory of Optimal Experiments,
!> 1972; Pukelsheim, Optimal Design of Experiments, 2006). Those of independent samples add up.
module beamid_information
   use beamid_distributions, only: normal_95
   use beamid_kinds, only: wp
   use beamid_statistics, only: unlimited
   implicit none
   private

   public :: prediction_t, eliminate, predict

   !> Errors of n parameters, k of which are of interest and the others a nuisance, which is free.
   type :: prediction_t
      !> Every parameter of interest has a standard error; without, the criteria have no values.
      logical :: finite = .false.
      logical :: determined = .false.           !< and a 95 % interval narrower than its value
      !> D: log det of the information of what is of interest, the nuisance free. A: sum of relative
      !> variances. E: the least eigenvalue of that information.
      real(wp) :: D = -unlimited, A = unlimited, E = 0
      real(wp), allocatable :: sd(:)            !< (n) relative; `unlimited`: nothing is known of it
      !> (k) of that information, ascending, and (k, k) the direction of each; of size 0: none
      real(wp), allocatable :: eigenvalue(:), direction(:, :)
   end type prediction_t

   !> Eigenvalues of correlations below this are round-off, of columns parallel to 7 digits.
   real(wp), parameter :: round_off = 1e-13_wp

contains

   !> Information of the first n parameters with those behind them free: the Schur complement.
   !>
   !> information  (m, m) -> (n, n)
   pure function eliminate(information, n) result(rest)
      real(wp), intent(in) :: information(:, :)
      integer, intent(in) :: n
      real(wp) :: rest(n, n), whole(size(information, 1), size(information, 1))
      real(wp) :: pivot
      integer :: j, k

      whole = information
      do k = size(whole, 1), n + 1, -1
         pivot = whole(k, k)
         ! What is left of it once the others are known is round-off: it is they.
         if (.not. pivot > round_off*information(k, k)) cycle
         do j = 1, k - 1
            whole(:k - 1, j) = whole(:k - 1, j) - whole(:k - 1, k)*(whole(k, j)/pivot)
         end do
      end do
      rest = whole(:n, :n)
   end function eliminate

   !> Standard errors and criteria, by the eigenvalues of the correlations of the columns of J. A
   !> parameter with a part in a direction that says nothing is not known; nothing is inverted.
   !>
   !> information  (n, n) of relative changes, in units of the noise
   !> interest     (n)
   pure subroutine predict(information, interest, prediction)
      real(wp), intent(in) :: information(:, :)
      logical, intent(in) :: interest(:)
      type(prediction_t), intent(out) :: prediction
      real(wp) :: a(size(interest), size(interest)), v(size(interest), size(interest)), &
         covariance(size(interest), size(interest)), length(size(interest)), value(size(interest))
      logical :: lost(size(interest))
      integer :: j, k, n

      n = size(interest)
      length = [(sqrt(max(information(k, k), 0.0_wp)), k=1, n)]
      where (.not. length > 0) length = 1
      do k = 1, n
         a(:, k) = information(:, k)/length/length(k)
      end do
      call decompose(a, value, v)
      covariance = 0
      lost = .false.
      do k = 1, n
         if (value(k) <= n*round_off) then
            lost = lost .or. abs(v(:, k)) > 1e-6_wp
         else
            do j = 1, n
               covariance(:, j) = covariance(:, j) + v(:, k)/length*(v(j, k)/length(j)/value(k))
            end do
         end if
      end do
      prediction%sd = [(merge(unlimited, sqrt(covariance(k, k)), lost(k)), k=1, n)]
      prediction%finite = .not. any(lost .and. interest)
      prediction%determined = all(pack(prediction%sd, interest) < 1/normal_95)
      call judge(covariance, pack([(k, k=1, n)], interest), prediction)
   end subroutine predict

   !> Criteria from the covariance of all, of which the rows and columns of interest count.
   pure subroutine judge(covariance, places, prediction)
      real(wp), intent(in) :: covariance(:, :)
      integer, intent(in) :: places(:)
      type(prediction_t), intent(inout) :: prediction
      real(wp) :: part(size(places), size(places))
      integer :: k, n

      n = merge(size(places), 0, prediction%finite)
      allocate (prediction%eigenvalue(n), prediction%direction(n, n))
      if (n == 0) return
      part = covariance(places, places)
      prediction%A = sum([(part(k, k), k=1, n)])
      call decompose(part, prediction%eigenvalue, prediction%direction)
      ! Those of the information are the reciprocals, in the opposite order.
      prediction%eigenvalue = 1/max(prediction%eigenvalue(n:1:-1), tiny(1.0_wp))
      prediction%direction = prediction%direction(:, n:1:-1)
      prediction%D = sum(log(prediction%eigenvalue))
      prediction%E = prediction%eigenvalue(1)
   end subroutine judge

   !> Eigenvalues, ascending, and vectors of a symmetric matrix without negative ones, by Jacobi's
   !> rotations: small ones keep their digits too (Demmel and Veselic, SIAM J. Matrix Anal. Appl.
   !> 13, 1992, 1204).
   !>
   !> a  (n, n) is lost
   pure subroutine decompose(a, value, vector)
      real(wp), intent(inout) :: a(:, :)
      real(wp), intent(out) :: value(:), vector(:, :)
      integer, parameter :: most_sweeps = 50
      real(wp) :: theta, t, c
      integer :: i, j, n, sweep
      logical :: done

      n = size(value)
      vector = 0
      do i = 1, n
         vector(i, i) = 1
      end do
      do sweep = 1, most_sweeps
         done = .true.
         do j = 2, n
            do i = 1, j - 1
               if (abs(a(i, j)) <= epsilon(t)*sqrt(abs(a(i, i))*abs(a(j, j)))) cycle
               done = .false.
               theta = (a(j, j) - a(i, i))/(2*a(i, j))
               t = sign(1.0_wp, theta)/(abs(theta) + hypot(1.0_wp, theta))
               c = 1/hypot(1.0_wp, t)
               call turn(a(:, i), a(:, j), c, t*c)
               call turn(a(i, :), a(j, :), c, t*c)
               call turn(vector(:, i), vector(:, j), c, t*c)
               a(i, j) = 0
               a(j, i) = 0
            end do
         end do
         if (done) exit
      end do
      value = [(a(i, i), i=1, n)]
      do i = 1, n - 1
         j = i - 1 + minloc(value(i:), dim=1)
         value([i, j]) = value([j, i])
         vector(:, [i, j]) = vector(:, [j, i])
      end do

   end subroutine decompose

   !> Turns the plane of two coordinates.
   elemental subroutine turn(x, y, c, s)
      real(wp), intent(inout) :: x, y
      real(wp), intent(in) :: c, s
      real(wp) :: before

      before = x
      x = c*before - s*y
      y = s*before + c*y
   end subroutine turn

end module beamid_information
