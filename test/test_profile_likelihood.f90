!> Profiles of a sum of squares: linear problems, of which the intervals are known; Bates and Watts'
!> data, of which the profiles were found with scipy; bounds, ends that are nowhere, and models that
!> fail.
program test_profile_likelihood
   use beamid_errors, only: error_t
   use beamid_kinds, only: wp
   use beamid_profile_likelihood, only: at_bound, follow_profile, is_closed, is_lost, is_open, &
      minimise_at, side_t
   use beamid_strings, only: to_text
   use beamid_variables, only: new_variable, unbounded, variable_t
   use checks, only: check, check_close, finish
   use edged_curves, only: curve_t
   use lehmer_sequences, only: gauss
   implicit none

   !> A linear problem: x = np.arange(1, 31)/30; X = np.stack([x**0, x, x**2], 1);
   !> y = X@[1, 2, 3] + .3*gauss(30, 51); b = np.linalg.lstsq(X, y)[0]; J = ((y - X@b)**2).sum()
   !> h = t*np.sqrt(np.diag(np.linalg.inv(X.T@X))*J/27), t = scipy.stats.t.ppf(.975, 27)
   !> rise = J/27*t**2. Correlations are -.89, .97 and -.97.
   real(wp), parameter :: b(3) = [0.8644973700879376_wp, 2.0272479063100723_wp, &
      3.180703520587621_wp], h(3) = [0.40372974709783305_wp, 1.8010685192804676_wp, &
      1.6912014460235327_wp], J_min = 3.0402052838430844_wp, rise = 0.4740477774270907_wp

   !> An end is where the distance, which is 1 there, is 1 to 1e-6: so many half widths.
   real(wp), parameter :: close_enough = 2e-6_wp

   !> Puromycin, treated (Bates and Watts 1988, table A1.3), and by scipy's least_squares, with
   !> t = scipy.stats.t.ppf(.975, 10): v, K, J, J/10*t**2 and the half widths of linear theory.
   real(wp), parameter :: puromycin(2) = [212.68374337220942_wp, 0.06412128204642256_wp], &
      J_puromycin = 1195.448814439358_wp, rise_puromycin = 593.4928464155263_wp, &
      half(2) = 2.228138851986274_wp*[6.947155407742989_wp, 0.00828095070852443_wp]
   !> brentq(lambda v: S(v) - J - rise, ...), S the least sum of squares with one of them held.
   real(wp), parameter :: ends_v(2) = [197.30193290028396_wp, 229.28905505505378_wp], &
      ends_K(2) = [0.04692034203517087_wp, 0.08615691342713871_wp]

   call test_linear(.true., close_enough)
   ! Differences of first order, and of a search that ends where J falls by 1e-9 of itself no more.
   call test_linear(.false., 1e-5_wp)
   call test_one_parameter()
   call test_own_bound()
   call test_others_bound()
   call test_estimate_at_bound()
   call test_puromycin()
   call test_plateau()
   call test_edges()
   call test_edge_at_bound()
   call test_no_effect()
   call test_far_value()
   call finish('profile_likelihood')

contains

   function linear(exact) result(problem)
      logical, intent(in) :: exact
      type(curve_t) :: problem
      integer :: k

      problem%exact = exact
      problem%x = [(k/30.0_wp, k=1, 30)]
      problem%y = 1 + 2*problem%x + 3*problem%x**2 + 0.3_wp*gauss(30, 51)
   end function linear

   !> (n) around an estimate, without bounds
   function around(estimate) result(variables)
      real(wp), intent(in) :: estimate(:)
      type(variable_t) :: variables(size(estimate))
      integer :: k

      do k = 1, size(estimate)
         variables(k) = new_variable(estimate(k), -unbounded, unbounded, abs(estimate(k)))
      end do
   end function around

   subroutine test_linear(exact, tolerance)
      logical, intent(in) :: exact
      real(wp), intent(in) :: tolerance
      type(curve_t) :: problem
      type(side_t) :: side
      character(len=:), allocatable :: label
      integer :: direction, k, n

      problem = linear(exact)
      do k = 1, 3
         do direction = -1, 1, 2
            call follow_profile(problem, 30, around(b), b, J_min, k, direction, rise, h(k), side)
            label = 'linear'//trim(merge('             ', ', differences', exact))//', b'// &
               to_text(k)//merge(' below: ', ' above: ', direction < 0)
            call check(label//'closed', side%state == is_closed .and. side%reason == '')
            call check_close(label//'end, half widths from the estimate', &
               direction*(side%end - b(k))/h(k), 1.0_wp, tolerance)
            n = size(side%value)
            call check(label//'lists', all([size(side%J), size(side%distance), &
               size(side%parameters, 2)] == n) .and. n >= 4, to_text(n))
            call check_close(label//'last point', side%value(n), side%end, 0.0_wp)
            call check(label//'from the estimate outwards', abs(side%value(1) - b(k)) <= 0 .and. &
               all(direction*(side%value(2:) - side%value(:n - 1)) > 0))
            ! In a linear problem the distance is that in half widths, at every point.
            call check_close(label//'distances', maxval(abs(side%distance &
               - direction*(side%value - b(k))/h(k))), 0.0_wp, tolerance)
            call check_close(label//'own row', maxval(abs(side%parameters(k, :) - side%value)), &
               0.0_wp, 0.0_wp)
         end do
      end do
   end subroutine test_linear

   !> Nothing else is fitted. y = b x: b = x@y/(x@x), half width np.sqrt(rise/(x@x)).
   subroutine test_one_parameter()
      type(curve_t) :: problem
      type(side_t) :: side
      integer :: direction
      real(wp), parameter :: one = 5.727370480330379_wp, J = 5.276834337335013_wp

      problem = linear(.true.)
      problem%law = 'proportional'
      do direction = -1, 1, 2
         call follow_profile(problem, 30, around([one]), [one], J, 1, direction, rise, 0.2_wp, side)
         call check('one parameter: closed', side%state == is_closed)
         call check_close('one parameter: half width', direction*(side%end - one), &
            0.21242300367213948_wp, 0.2_wp*close_enough)
      end do
   end subroutine test_one_parameter

   !> A bound at half of the way to the end.
   subroutine test_own_bound()
      type(curve_t) :: problem
      type(variable_t) :: variables(3)
      type(side_t) :: side

      problem = linear(.true.)
      variables = around(b)
      variables(2) = new_variable(b(2), b(2) - h(2)/2, b(2) + 10*h(2), 1.0_wp)
      call follow_profile(problem, 30, variables, b, J_min, 2, -1, rise, h(2), side)
      call check('own bound: state', side%state == at_bound, to_text(side%state))
      call check_close('own bound: end', side%end, b(2) - h(2)/2, 0.0_wp)
      ! The way to a bound is followed up to its last thousandth.
      call check_close('own bound: distance', side%distance(size(side%distance)), 0.5_wp, 0.5e-3_wp)
      call follow_profile(problem, 30, variables, b, J_min, 2, 1, rise, h(2), side)
      call check('own bound: the other side is closed', side%state == is_closed)
      call check_close('own bound: the other side', (side%end - b(2))/h(2), 1.0_wp, close_enough)
   end subroutine test_own_bound

   !> b2 >= b2 - h2/2 while b1 and b3 are followed, by
   !> scipy.optimize.lsq_linear(X[:, others], y - X[:, k]*v, bounds=...) and brentq.
   subroutine test_others_bound()
      type(curve_t) :: problem
      type(variable_t) :: variables(3)
      type(side_t) :: side
      real(wp), parameter :: lower(3) = [0.4607676229901033_wp, 0.0_wp, 1.4895020745640966_wp], &
         upper(3) = [1.2075127832467158_wp, 0.0_wp, 4.355494732686924_wp]
      integer :: k

      problem = linear(.true.)
      variables = around(b)
      variables(2) = new_variable(b(2), b(2) - h(2)/2, unbounded, 1.0_wp)
      do k = 1, 3, 2
         ! 1e-5: lsq_linear ends at 1e-15 of the cost or where its steps are that small, brentq at
         ! 1e-12; a bound on which a variable is held by steps of 1e-4 of its size.
         call follow_profile(problem, 30, variables, b, J_min, k, -1, rise, h(k), side)
         call check_close('bound of another: b'//to_text(k)//' below', side%end, lower(k), &
            1e-5_wp*h(k))
         call follow_profile(problem, 30, variables, b, J_min, k, 1, rise, h(k), side)
         call check_close('bound of another: b'//to_text(k)//' above', side%end, upper(k), &
            1e-5_wp*h(k))
         call check('bound of another: b'//to_text(k)//' respected', all(side%parameters(2, :) >= &
            variables(2)%lower))
      end do
   end subroutine test_others_bound

   !> b2 >= b2 + h2/2: the estimate is on the bound; np.linalg.lstsq with b2 held, and brentq.
   subroutine test_estimate_at_bound()
      real(wp), parameter :: held(3) = [0.6865431896968779_wp, 2.927782165950306_wp, &
         2.3602180577190124_wp], J = 3.1587172281998597_wp
      type(curve_t) :: problem
      type(variable_t) :: variables(3)
      type(side_t) :: side

      problem = linear(.true.)
      variables = around(b)
      variables(2) = new_variable(held(2), held(2), unbounded, 1.0_wp)
      call follow_profile(problem, 30, variables, held, J, 2, -1, rise, h(2), side)
      call check('estimate at its bound: state', side%state == at_bound, to_text(side%state))
      call check_close('estimate at its bound: end', side%end, held(2), 0.0_wp)
      call follow_profile(problem, 30, variables, held, J, 2, 1, rise, h(2), side)
      call check('estimate at its bound: closed above', side%state == is_closed)
      call check_close('estimate at its bound: above', side%end, 4.040903726933075_wp, &
         close_enough*h(2))
   end subroutine test_estimate_at_bound

   function michaelis_menten() result(problem)
      type(curve_t) :: problem

      problem%law = 'hyperbola'
      problem%x = [0.02_wp, 0.02_wp, 0.06_wp, 0.06_wp, 0.11_wp, 0.11_wp, 0.22_wp, 0.22_wp, &
         0.56_wp, 0.56_wp, 1.10_wp, 1.10_wp]
      problem%y = [76.0_wp, 47.0_wp, 97.0_wp, 107.0_wp, 123.0_wp, 139.0_wp, 159.0_wp, 152.0_wp, &
         191.0_wp, 201.0_wp, 207.0_wp, 200.0_wp]
   end function michaelis_menten

   subroutine test_puromycin()
      type(curve_t) :: problem
      type(variable_t) :: variables(2)
      type(side_t) :: side
      integer :: i, k
      logical :: exact
      character(len=:), allocatable :: label

      problem = michaelis_menten()
      do i = 1, 2
         exact = i == 1
         problem%exact = exact
         variables = around(puromycin)
         if (exact) variables(2) = new_variable(puromycin(2), 0.0_wp, unbounded, 0.1_wp)
         label = 'Puromycin'//trim(merge('             ', ', differences', exact))//', '
         do k = -1, 1, 2
            ! Half widths times close_enough; ten times for differences.
            call follow_profile(problem, 12, variables, puromycin, J_puromycin, 1, k, &
               rise_puromycin, half(1), side)
            call check_close(label//'v', side%end, ends_v((k + 3)/2), &
               half(1)*close_enough*merge(1, 10, exact))
            call check(label//'v: closed', side%state == is_closed)
            call follow_profile(problem, 12, variables, puromycin, J_puromycin, 2, k, &
               rise_puromycin, half(2), side)
            call check_close(label//'K', side%end, ends_K((k + 3)/2), &
               half(2)*close_enough*merge(1, 10, exact))
            call check(label//'K: closed', side%state == is_closed)
         end do
      end do
   end subroutine test_puromycin

   !> Biochemical oxygen demand (Bates and Watts 1988, table A1.4): y = A (1 - exp(-k x)), of which
   !> there are six values.
   !> For 95 %, t = scipy.stats.t.ppf(.975, 4), both are closed, by brentq on the least sums of
   !> squares; for 99 %, t.ppf(.995, 4), a rate without end and a straight line, A without end and k
   !> = 0, are within: J rises by 81.2 and 109.6 there, 137.7 are allowed.
   subroutine test_plateau()
      real(wp), parameter :: estimate(2) = [19.14257528140652_wp, 0.5310913772716043_wp], &
         J = 25.99026728194131_wp, rise_95 = 50.08745172115564_wp, rise_99 = 137.7334045144883_wp
      type(curve_t) :: problem
      type(variable_t) :: variables(2)
      type(side_t) :: side

      problem%law = 'plateau'
      problem%x = [1.0_wp, 2.0_wp, 3.0_wp, 4.0_wp, 5.0_wp, 7.0_wp]
      problem%y = [8.3_wp, 10.3_wp, 19.0_wp, 16.0_wp, 15.6_wp, 19.8_wp]
      variables = around(estimate)
      call follow_profile(problem, 6, variables, estimate, J, 2, -1, rise_95, 0.56_wp, side)
      ! References to 1e-11 or so, and half widths (.56 and 6.9 by linear theory) times
      ! close_enough; where the profile is flat the slope of the distance is a sixth of that of
      ! linear theory.
      call check_close('plateau: k below', side%end, 0.13139774670241267_wp, 0.56_wp*close_enough)
      call follow_profile(problem, 6, variables, estimate, J, 2, 1, rise_95, 0.56_wp, side)
      call check_close('plateau: k above', side%end, 1.8081695947344518_wp, &
         6*0.56_wp*close_enough)
      call follow_profile(problem, 6, variables, estimate, J, 1, -1, rise_95, 6.9_wp, side)
      call check_close('plateau: A below', side%end, 14.049364162826194_wp, 6.9_wp*close_enough)
      call follow_profile(problem, 6, variables, estimate, J, 1, 1, rise_95, 6.9_wp, side)
      call check_close('plateau: A above', side%end, 38.45619796806844_wp, 6*6.9_wp*close_enough)
      call follow_profile(problem, 6, variables, estimate, J, 2, 1, rise_99, 0.93_wp, side)
      call check('plateau: a rate without end', side%state == is_open .and. side%end > &
         1e300_wp, to_text(side%state)//' '//side%reason)
      ! J of a constant: ((y - y.mean())**2).sum() = 107.21333333333334.
      call check_close('plateau: the constant at its end', side%J(size(side%J)), &
         107.21333333333334_wp, 1e-9_wp)
      call follow_profile(problem, 6, variables, estimate, J, 1, 1, rise_99, 11.5_wp, side)
      call check('plateau: a height without end', side%state == is_open .and. side%end > &
         1e300_wp, to_text(side%state)//' '//side%reason)
      call follow_profile(problem, 6, variables, estimate, J, 1, -1, rise_99, 11.5_wp, side)
      call check_close('plateau: A below, 99 %', side%end, 11.530767275855368_wp, &
         11.5_wp*close_enough)
      ! No rate, no curve: A would be without end, and at 0 itself J is that of y = 0.
      variables(2) = new_variable(estimate(2), 0.0_wp, unbounded, 1.0_wp)
      call follow_profile(problem, 6, variables, estimate, J, 2, -1, rise_99, 0.93_wp, side)
      call check('plateau: a rate of nearly 0', side%end >= 0 .and. side%end < 0.01_wp, &
         to_text(side%state)//', '//to_text(side%end))
   end subroutine test_plateau

   !> A model that cannot be computed beyond an edge: inside the interval the end is lost, and said
   !> to be; outside the interval is what it was. Steps beyond the edge are taken back.
   subroutine test_edges()
      type(curve_t) :: problem
      type(side_t) :: side
      real(wp), parameter :: edges(7) = [212.7_wp, 214.0_wp, 222.0_wp, 229.0_wp, 229.4_wp, &
         231.0_wp, 245.0_wp]
      integer :: i

      problem = michaelis_menten()
      problem%refused = 1
      do i = 1, size(edges)
         problem%most = edges(i)
         call follow_profile(problem, 12, around(puromycin), puromycin, J_puromycin, 1, 1, &
            rise_puromycin, half(1), side)
         if (edges(i) < ends_v(2)) then
            ! Eight steps of a quarter: what is left of the way is a hundredth of a half width.
            call check('edge '//to_text(edges(i))//': lost', side%state == is_lost .and. &
               len(side%reason) > 0 .and. side%end <= edges(i) .and. edges(i) - side%end < &
               0.01_wp*half(1), to_text(side%end)//' '//side%reason)
         else
            call check('edge '//to_text(edges(i))//': closed', side%state == is_closed, side%reason)
            call check_close('edge '//to_text(edges(i))//': end', side%end, ends_v(2), &
               half(1)*close_enough)
         end if
         call follow_profile(problem, 12, around(puromycin), puromycin, J_puromycin, 1, -1, &
            rise_puromycin, half(1), side)
         call check_close('edge '//to_text(edges(i))//': the other side', side%end, ends_v(1), &
            half(1)*close_enough)
      end do
      ! The edge is met by the parameter that is fitted along: K = .07 is within its interval, and
      ! the least J is at larger ones from some v on.
      problem%refused = 2
      problem%most = 0.07_wp
      call follow_profile(problem, 12, around(puromycin), puromycin, J_puromycin, 1, 1, &
         rise_puromycin, half(1), side)
      call check('edge of another: said, or closed nearer', side%state == is_lost .and. &
         len(side%reason) > 0 .or. side%state == is_closed .and. side%end < ends_v(2), &
         to_text(side%state)//', '//to_text(side%end)//' '//side%reason)
      ! Nowhere but at the estimate.
      problem%refused = 1
      problem%least = puromycin(1) - 1e-12_wp
      problem%most = puromycin(1) + 1e-12_wp
      call follow_profile(problem, 12, around(puromycin), puromycin, J_puromycin, 1, 1, &
         rise_puromycin, half(1), side)
      call check('nowhere but at the estimate: lost', side%state == is_lost .and. len(side%reason) &
         > 0 .and. size(side%value) == 1, side%reason)
      call check_close('nowhere but at the estimate: end', side%end, puromycin(1), 0.0_wp)
   end subroutine test_edges

   !> Up to its bound all is well, on it nothing can be computed: as far as the bound all the same.
   subroutine test_edge_at_bound()
      type(curve_t) :: problem
      type(variable_t) :: variables(3)
      type(side_t) :: side

      problem = linear(.true.)
      problem%refused = 2
      problem%least = b(2) - h(2)/2
      variables = around(b)
      variables(2) = new_variable(b(2), problem%least, unbounded, 1.0_wp)
      call follow_profile(problem, 30, variables, b, J_min, 2, -1, rise, h(2), side)
      call check('bound that cannot be computed: state', side%state == at_bound, side%reason)
      call check_close('bound that cannot be computed: end', side%end, problem%least, 0.0_wp)
   end subroutine test_edge_at_bound

   !> A parameter that does nothing: open on both sides, at bounds where it has some.
   subroutine test_no_effect()
      type(curve_t) :: problem
      type(variable_t) :: variables(4)
      type(side_t) :: side
      real(wp), parameter :: estimate(4) = [b, 1.0_wp]

      problem = linear(.true.)
      variables = around(estimate)
      call follow_profile(problem, 30, variables, estimate, J_min, 4, 1, rise, 1.0_wp, side)
      call check('no effect: open', side%state == is_open, side%reason)
      call follow_profile(problem, 30, variables, estimate, J_min, 4, -1, rise, 1e30_wp, side)
      call check('no effect: open below, by an endless step', side%state == is_open .and. &
         side%end < -1e300_wp, side%reason)
      variables(4) = new_variable(1.0_wp, 0.0_wp, 5.0_wp, 1.0_wp)
      call follow_profile(problem, 30, variables, estimate, J_min, 4, -1, rise, 1e30_wp, side)
      call check('no effect: at its lower bound', side%state == at_bound .and. abs(side%end) <= 0)
      call follow_profile(problem, 30, variables, estimate, J_min, 4, 1, rise, 1e30_wp, side)
      call check('no effect: at its upper bound', side%state == at_bound .and. &
         abs(side%end - 5) <= 0)
      ! Others are what they were while it is not followed.
      call follow_profile(problem, 30, variables, estimate, J_min, 1, 1, rise, h(1), side)
      call check_close('beside one without effect', (side%end - b(1))/h(1), 1.0_wp, close_enough)
   end subroutine test_no_effect

   !> A way to a hundred times the estimate. In a linear problem J rises all the way: the way ends
   !> at its second step, at four times the estimate, if a value that J exceeds there is hopeless.
   !> The other parameters follow the third with slopes of C[:2, 2]/C[2, 2], C = inv(X.T@X). Each
   !> search begins with an exact step, so that round-off alone is left.
   subroutine test_far_value()
      type(curve_t) :: problem
      type(error_t), allocatable :: error
      real(wp), parameter :: slopes(2) = [0.183703703703704_wp, -1.0333333333333339_wp]
      real(wp) :: q(3)
      integer :: k

      do k = 1, 2
         problem = linear(.true.)
         q = b
         call minimise_at(problem, 30, around(b), 3, 100*b(3), merge(huge(1.0_wp), 1.2_wp*J_min, &
            k == 1), q, error)
         call check('far value: found', .not. allocated(error))
         call check_close('far value: where the way ends, in estimates', q(3)/b(3), &
            merge(100.0_wp, 4.0_wp, k == 1), 1e-12_wp)
         call check_close('far value: others', maxval(abs((q(:2) - b(:2))/(q(3) - b(3)) &
            - slopes)), 0.0_wp, 1e-9_wp)
      end do
   end subroutine test_far_value

end program test_profile_likelihood
