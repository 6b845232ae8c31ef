!> Predicts the errors of a planned experiment by linear theory, from the information matrix
!> J'J/sigma**2 of relative changes of the parameters (Fedorov, Theory of Optimal Experiments, 1972;
!> Pukelsheim, Optimal Design of Experiments, 2006). The information matrices of independent samples
!> add. The design of experiments uses it.
module beamid_information
   use beamid_distributions, only: normal_95
   use beamid_kinds, only: wp
   use beamid_statistics, only: unlimited
   implicit none
   private

   public :: prediction_t, eliminate, predict

   !> Predicted errors of n parameters and criteria of a design. k of the parameters are of
   !> interest; the others are nuisance parameters, which are free.
   type :: prediction_t
      !> whether every parameter of interest has a standard error; if not, the criteria have no
      !> values
      logical :: finite = .false.
      logical :: determined = .false.           !< whether their 95 % intervals also exclude zero
      !> D: log det of the information on the parameters of interest with the nuisance parameters
      !> free. A: sum of relative variances. E: smallest eigenvalue of this information.
      real(wp) :: D = -unlimited, A = unlimited, E = 0
      !> (n) relative standard deviations; `unlimited` if the experiment says nothing
      real(wp), allocatable :: sd(:)
      !> (k) eigenvalues of this information, ascending, and (k, k) eigenvectors in columns; size 0
      !> if `finite` is .false.
      real(wp), allocatable :: eigenvalue(:), direction(:, :)
   end type prediction_t

   !> Eigenvalues of a correlation matrix below this value are round-off: columns parallel to 7
   !> digits.
   real(wp), parameter :: round_off = 1e-13_wp

contains

   !> Returns the information on the first n parameters with the others free: the Schur complement.
   !>
   !> information  (m, m)
   !> rest         (n, n)
   pure function eliminate(information, n) result(rest)
      real(wp), intent(in) :: information(:, :)
      integer, intent(in) :: n
      real(wp) :: rest(n, n), reduced(size(information, 1), size(information, 1))
      real(wp) :: pivot
      integer :: j, k

      reduced = information
      do k = size(reduced, 1), n + 1, -1
         pivot = reduced(k, k)
         ! The remainder of a parameter that the others determine is round-off.
         if (.not. pivot > round_off*information(k, k)) cycle
         do j = 1, k - 1
            reduced(:k - 1, j) = reduced(:k - 1, j) - reduced(:k - 1, k)*(reduced(k, j)/pivot)
         end do
      end do
      rest = reduced(:n, :n)
   end function eliminate

   !> Predicts standard errors and criteria from the eigenvalues of the correlations of the columns
   !> of J. A parameter with a component in a direction without information has no error. No matrix
   !> is inverted.
   !>
   !> information  (n, n) of relative changes, in units of the noise
   !> interest     (n) whether a parameter is of interest
   pure subroutine predict(information, interest, prediction)
      real(wp), intent(in) :: information(:, :)
      logical, intent(in) :: interest(:)
      type(prediction_t), intent(out) :: prediction
      real(wp) :: a(size(interest), size(interest)), v(size(interest), size(interest)), &
         covariance(size(interest), size(interest)), length(size(interest)), value(size(interest))
      logical :: is_lost(size(interest))
      integer :: j, k, n

      n = size(interest)
      length = [(sqrt(max(information(k, k), 0.0_wp)), k=1, n)]
      where (.not. length > 0) length = 1
      do k = 1, n
         a(:, k) = information(:, k)/length/length(k)
      end do
      call decompose(a, value, v)
      covariance = 0
      is_lost = .false.
      do k = 1, n
         if (value(k) <= n*round_off) then
            is_lost = is_lost .or. abs(v(:, k)) > 1e-6_wp
         else
            do j = 1, n
               covariance(:, j) = covariance(:, j) + v(:, k)/length*(v(j, k)/length(j)/value(k))
            end do
         end if
      end do
      prediction%sd = [(merge(unlimited, sqrt(covariance(k, k)), is_lost(k)), k=1, n)]
      prediction%finite = .not. any(is_lost .and. interest)
      prediction%determined = all(pack(prediction%sd, interest) < 1/normal_95)
      call add_criteria(covariance, pack([(k, k=1, n)], interest), prediction)
   end subroutine predict

   !> Adds the criteria, from the covariance of all parameters.
   !>
   !> covariance   (n, n) relative
   !> of_interest  (k) indices of the parameters of interest
   pure subroutine add_criteria(covariance, of_interest, prediction)
      real(wp), intent(in) :: covariance(:, :)
      integer, intent(in) :: of_interest(:)
      type(prediction_t), intent(inout) :: prediction
      real(wp) :: part(size(of_interest), size(of_interest))
      integer :: k, n

      n = merge(size(of_interest), 0, prediction%finite)
      allocate (prediction%eigenvalue(n), prediction%direction(n, n))
      if (n == 0) return
      part = covariance(of_interest, of_interest)
      prediction%A = sum([(part(k, k), k=1, n)])
      call decompose(part, prediction%eigenvalue, prediction%direction)
      ! The eigenvalues of the information are the reciprocals, in the opposite order.
      prediction%eigenvalue = 1/max(prediction%eigenvalue(n:1:-1), tiny(1.0_wp))
      prediction%direction = prediction%direction(:, n:1:-1)
      prediction%D = sum(log(prediction%eigenvalue))
      prediction%E = prediction%eigenvalue(1)
   end subroutine add_criteria

   !> Computes eigenvalues, ascending, and eigenvectors of a symmetric positive semidefinite matrix
   !> by Jacobi rotations, which give small eigenvalues full relative accuracy (Demmel and Veselic,
   !> SIAM J. Matrix Anal. Appl. 13, 1992, 1204).
   !>
   !> a       (n, n); undefined on return
   !> value   (n)
   !> vector  (n, n) eigenvectors in columns
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
               call rotate(a(:, i), a(:, j), c, t*c)
               call rotate(a(i, :), a(j, :), c, t*c)
               call rotate(vector(:, i), vector(:, j), c, t*c)
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

   !> Rotates the pair (x, y) by an angle of cosine c and sine s.
   elemental subroutine rotate(x, y, c, s)
      real(wp), intent(inout) :: x, y
      real(wp), intent(in) :: c, s
      real(wp) :: before

      before = x
      x = c*before - s*y
      y = s*before + c*y
   end subroutine rotate

end module beamid_information
