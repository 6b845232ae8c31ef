!> Rows of free decays that are condensed once for all parameters near an estimate: against rows in
!> quadruple precision, against all rows of a fit, and by posteriors and bootstraps.
program test_local_decays
   use beamid_autoregression, only: new_autoregression
   use beamid_bootstraps, only: bootstrap_fit, bootstrap_plan_t, bootstrap_t, parametric
   use beamid_condensation, only: condensed_t
   use beamid_errors, only: error_t
   use beamid_excitation, only: new_free
   use beamid_experiments, only: experiment_t
   use beamid_identification, only: identify, model_t, stage_fit_t, stage_t
   use beamid_inference, only: posterior_draws_t, profile_fit, sample_fit
   use beamid_kinds, only: wp
   use beamid_local_decays, only: local_decay_t, new_local_decay
   use beamid_matrices, only: identity
   use beamid_motion_rows, only: basis_t
   use beamid_noise, only: gaussian_noise, uniform_noise
   use beamid_parameters, only: free_index
   use beamid_priors, only: prior_t
   use beamid_profile_likelihood, only: side_t
   use beamid_residuals, only: residual_t
   use beamid_sampling, only: plan_t
   use beamid_strings, only: to_text
   use beamid_structure, only: structure_t
   use checks, only: check, check_close, finish
   use free_decays, only: formulas, long_record, make_channels, mesh, names, noisy, problem_of, &
      stage_for, stamps, truth
   use models, only: model_of
   use omp_lib, only: omp_get_max_threads, omp_set_num_threads
   implicit none

   integer, parameter :: quad = selected_real_kind(30)
   !> E, m_S, c_D and gamma of the strip.
   real(wp), parameter :: exact(4) = [truth%E, truth%sensor(1)%m_S, truth%c_D, truth%gamma]

   call test_rows()
   call test_problems()
   call test_values_before_derivatives()
   call test_threads()
   call test_resampled()
   call finish('local decays')

contains

   !> Products of columns and record at the rim of the disc in which a basis holds, in quadruple
   !> precision: modes that last and that decay at once, expected distances from none to more than
   !> a basis can cover, even and uneven stamps, and stamps far from 0.
   subroutine test_rows()
      integer, parameter :: m = 900
      complex(wp), parameter :: s(2) = [(-0.2_wp, 40.0_wp), (-60.0_wp, 250.0_wp)]
      real(wp), parameter :: shares(5) = [0.0_wp, 1e-4_wp, 1e-2_wp, 0.3_wp, 30.0_wp], &
         directions(3) = [0.0_wp, 1.0_wp, 2.5_wp]
      type(local_decay_t) :: local
      real(wp), allocatable :: x(:, :)
      real(wp) :: t(m), z(m), error
      complex(wp) :: moved(2), turn
      integer :: i, j, k

      z = gaussian_noise(m, 1.0_wp, 3)
      error = 0
      do i = 1, size(shares)
         t = merge(1e3_wp, 0.0_wp, i == 3) + 2e-3_wp*[(k, k=0, m - 1)]
         if (i > 2) t = t + 1e-3_wp*uniform_noise(m, 4)
         local = new_local_decay(s, spread(shares(i), 1, 2), t(1), 2.0_wp, t)
         x = local%matrix(t, z)
         call local%decompose(x)
         call check_close('basis '//to_text(i)//': orthonormal', maxval(abs( &
            matmul(transpose(x), x) - identity(size(x, 2)))), 0.0_wp, 1e-13_wp)
         do j = 1, size(directions)
            turn = exp(cmplx(0.0_wp, directions(j), wp))
            moved = s + 0.999_wp*turn*local%radius/local%half
            call check('basis '//to_text(i)//': covered', local%covers(moved, t(1), 2.0_wp))
            call check('basis '//to_text(i)//': other offset', &
               .not. local%covers(moved, t(1), 0.0_wp))
            error = max(error, error_of(local%near(moved), moved, t, z))
            moved(2) = s(2) + 1.001_wp*turn*local%radius(2)/local%half(2)
            call check('basis '//to_text(i)//': not covered', .not. &
               local%covers(moved, t(1), 2.0_wp))
         end do
         call check('basis '//to_text(i)//': large enough', i == size(shares) .or. &
            local%covers(s + shares(i), t(1), 2.0_wp))
      end do
      ! The derivative of the series neglects 1e-14 times half the length in which a motion is seen.
      ! That is up to 40 times the time in which the fast mode decays by a factor e. Round-off of
      ! phases and sums is smaller.
      call check_close('products of rows', error, 0.0_wp, 4e-12_wp)
   end subroutine test_rows

   !> Largest difference of the products of the rows from those of columns in quadruple precision,
   !> relative to the lengths of the columns.
   real(wp) function error_of(rows, s, t, z) result(error)
      type(condensed_t), intent(in) :: rows
      complex(wp), intent(in) :: s(:)
      real(wp), intent(in) :: t(:), z(:)
      complex(quad) :: motion(size(t))
      real(quad) :: a(size(t), 4*size(s) + 2), tau(size(t))
      real(wp) :: b(size(rows%y) + 1, 4*size(s) + 2), length(4*size(s) + 2)
      integer :: k, n

      n = size(a, 2)
      tau = real(t, quad) - real(t(1), quad)
      do k = 1, size(s)
         motion = exp(cmplx(s(k), kind=quad)*tau)
         a(:, 4*k - 3) = real(motion)
         a(:, 4*k - 2) = tau*real(motion)
         a(:, 4*k - 1) = aimag(motion)
         a(:, 4*k) = tau*aimag(motion)
      end do
      a(:, n - 1) = 2
      a(:, n) = -z
      b = 0
      b(:size(rows%y), :n - 1) = rows%factor
      b(:size(rows%y), n) = rows%y
      b(size(rows%y) + 1, n) = rows%left
      length = real(norm2(a, dim=1), wp)
      error = maxval(abs(matmul(transpose(b), b) - real(matmul(transpose(a), a), wp)) &
         /(spread(length, 1, n)*spread(length, 2, n)))
   end function error_of

   !> One record with a prior, a record with coloured noise, and two channels, the second short.
   subroutine test_problems()
      type(experiment_t) :: record, two(2)
      type(structure_t) :: beam
      type(residual_t) :: problem
      type(prior_t) :: prior
      real(wp) :: noise(700)
      integer :: k

      prior = prior_t(parameter=[free_index('m_S')], slope=[1.0_wp], sd=0.01_wp*exact(2))
      problem = problem_of([long_record(700, 3, 4)], truth, 3, [prior])
      call compare('prior', problem)
      noise = gaussian_noise(700, 0.1_wp, 9)
      do k = 2, 700
         noise(k) = noise(k) + 0.8_wp*noise(k - 1)
      end do
      record = noisy(long_record(700, 3, 6), noise)
      problem = problem_of([record], truth, 3, [prior_t ::])
      allocate (problem%colour(1))
      problem%colour(1) = new_autoregression(noise, record%samples, white=.false.)
      call compare('coloured', problem)
      call make_channels(700, beam, two)
      problem = problem_of(two, beam, 3, [prior_t ::])
      call compare('channels', problem)
   end subroutine test_problems

   !> Derivatives at one place after values alone at another: every search of roots starts from the
   !> poles at the estimate, whose derivatives the solver has kept.
   subroutine test_values_before_derivatives()
      type(residual_t) :: local, whole
      type(basis_t), allocatable :: bases(:)
      type(error_t), allocatable :: error
      real(wp) :: covariance(4, 4), q(4), few(5), few_jac(5, 4), J(2)
      real(wp), allocatable :: r(:), jac(:, :)

      whole = problem_of([long_record(700, 3, 4)], truth, 3, [prior_t ::])
      local = whole
      allocate (r(whole%rows()), jac(whole%rows(), 4))
      call local%condensed(exact, few, few_jac, error)
      call check('derivatives at the estimate', .not. allocated(error))
      covariance = 1e-6_wp*identity(4)*spread(exact**2, 2, 4)
      call local%localize(exact, covariance, bases)
      call local%squares(1.1_wp*exact, J, error)
      call check('values at another place', .not. allocated(error))
      q = 1.2_wp*exact
      call local%condensed(q, few, few_jac, error)
      call check('derivatives at a third place', .not. allocated(error))
      call whole%evaluate(q, r, jac, error)
      ! As in `compare`.
      call check_close('derivatives at a third place: gradient', maxval(abs(matmul(few, few_jac) &
         - matmul(r, jac))/(norm2(r)*norm2(jac, dim=1))), 0.0_wp, 1e-10_wp)
   end subroutine test_values_before_derivatives

   !> Compares sums of squares of each record, condensed rows and the volume near the centre of the
   !> bases and far away with those of all rows. Near the centre the bases are used, which shows if
   !> one of them is spoiled.
   subroutine compare(label, problem)
      character(len=*), intent(in) :: label
      type(residual_t), intent(in) :: problem
      real(wp), parameter :: places(3) = [0.0_wp, 1e-3_wp, 0.2_wp]
      type(residual_t) :: local, whole, spoiled
      type(basis_t), allocatable :: bases(:)
      type(error_t), allocatable :: error
      real(wp) :: covariance(4, 4), q(4), few(5), few_jac(5, 4)
      real(wp), allocatable :: r(:), jac(:, :), J(:), J_of(:)
      integer, allocatable :: first(:)
      character(len=:), allocatable :: place
      integer :: i, k

      local = problem
      whole = problem
      covariance = 0
      do k = 1, 4
         covariance(k, k) = (1e-3_wp*exact(k))**2
      end do
      call local%localize(exact, covariance, bases)
      call check(label//': a basis', allocated(bases(1)%columns) .and. local%local(1)%columns() > 0)
      spoiled = local
      spoiled%local(1)%rows%left = 2*spoiled%local(1)%rows%left
      allocate (r(whole%rows()), jac(whole%rows(), 4), J(size(whole%parts) + 1))
      J_of = J
      first = [whole%first_rows(), whole%samples() + 1]
      do i = 1, size(places)
         place = label//', '//to_text(places(i))
         q = exact*(1 + places(i)*[1, -1, 1, 1])
         call whole%evaluate(q, r, jac, error)
         call check(place//': all rows', .not. allocated(error))
         call local%squares(q, J, error)
         call check(place//': squares', .not. allocated(error))
         J_of(:size(J) - 1) = [(sum(r(first(k):first(k + 1) - 1)**2), k=1, size(J) - 1)]
         J_of(size(J)) = sum(r(first(size(J)):)**2)
         ! Round-off of 700 rows, and of a condition of the columns of up to 100.
         call check_close(place//': J', maxval(abs(J - J_of))/sum(J_of), 0.0_wp, 1e-11_wp)
         call check_close(place//': volume', local%log_volume, whole%log_volume, 1e-11_wp)
         call local%condensed(q, few, few_jac, error)
         call check_close(place//': gradient', maxval(abs(matmul(few, few_jac) - matmul(r, jac)) &
            /(norm2(r)*norm2(jac, dim=1))), 0.0_wp, 1e-10_wp)
         call spoiled%squares(q, J_of, error)
         call check(place//': which rows', J_of(1) > 1.1_wp*J(1) .eqv. i < 3)
      end do
   end subroutine compare

   !> A fit of a long record, from near the truth.
   subroutine fit_long(model, record, found, error, start)
      type(model_t), intent(in) :: model
      type(experiment_t), intent(in) :: record
      type(stage_fit_t), intent(out) :: found
      type(error_t), allocatable, intent(out) :: error
      real(wp), intent(in), optional :: start(:)
      type(stage_fit_t), allocatable :: fits(:)
      type(stage_t) :: stage

      stage = stage_for(names, 1)
      if (present(start)) stage%start = start
      call identify(model, mesh, [stage], [record], fits, error, check=.false.)
      if (.not. allocated(error)) found = fits(1)
   end subroutine fit_long

   !> The same bits, however many threads there are.
   subroutine test_threads()
      type(model_t) :: model
      type(experiment_t) :: record
      type(stage_fit_t) :: found
      type(side_t), allocatable :: sides(:, :)
      type(posterior_draws_t) :: posterior
      type(bootstrap_t) :: resampled
      type(error_t), allocatable :: error
      real(wp), allocatable :: draws(:, :), density(:), estimates(:, :)
      integer :: before, threads

      model = model_of(truth, new_free(2), formulas(3))
      record = long_record(700, 3, 4)
      before = omp_get_max_threads()
      do threads = 1, 3
         call omp_set_num_threads(threads)
         call fit_long(model, record, found, error)
         if (.not. allocated(error)) call profile_fit(model, mesh, [record], found, sides, error)
         if (.not. allocated(error)) call sample_fit(model, mesh, [record], found, sides, &
            plan_t(draws=1000), posterior, error)
         if (.not. allocated(error)) call bootstrap_fit(model, mesh, [record], found, &
            bootstrap_plan_t(n=100), resampled, error)
         call check(to_text(threads)//' threads', .not. allocated(error))
         if (allocated(error)) exit
         if (threads == 1) then
            draws = posterior%draws%q
            density = posterior%draws%log_density
            estimates = resampled%estimates
         else
            call check('as with one: draws', same(posterior%draws%q, draws))
            call check('as with one: density', same(reshape(posterior%draws%log_density, [1, &
               size(density)]), reshape(density, [1, size(density)])))
            call check('as with one: bootstrap', same(resampled%estimates, estimates))
         end if
      end do
      call omp_set_num_threads(before)
   end subroutine test_threads

   !> Whether two arrays are equal to the last bit.
   pure logical function same(a, b)
      real(wp), intent(in) :: a(:, :), b(:, :)

      same = all(shape(a) == shape(b))
      if (same) same = all(a <= b .and. a >= b)
   end function same

   !> The estimates of a bootstrap are those of fits to the same records.
   subroutine test_resampled()
      integer, parameter :: m = 700, n = 6
      type(model_t) :: model
      type(experiment_t) :: record, other
      type(stage_fit_t) :: found, again
      type(bootstrap_plan_t), parameter :: plan = bootstrap_plan_t(n=n, seed=5, kind=parametric)
      type(bootstrap_t) :: resampled
      type(error_t), allocatable :: error
      real(wp) :: sd
      integer :: k

      model = model_of(truth, new_free(2), formulas(3))
      record = long_record(m, 3, 4)
      call fit_long(model, record, found, error)
      if (.not. allocated(error)) call bootstrap_fit(model, mesh, [record], found, plan, &
         resampled, error)
      call check('resampled: bootstrap', .not. allocated(error))
      if (allocated(error)) return
      sd = sqrt(sum(found%residual**2)/found%statistics%freedom)
      do k = 1, n
         other = noisy(record, found%residual + gaussian_noise(m, sd, plan%seed + 7919*k + 101))
         call fit_long(model, other, again, error, found%fit%estimate)
         call check('resampled: fit', .not. allocated(error))
         if (allocated(error)) return
         ! Both searches end within 1e-6 standard errors of the minimum.
         call check_close('resampled '//to_text(k)//', in standard errors', maxval(abs( &
            again%fit%estimate - resampled%estimates(:, k))/found%statistics%std_error(:4)), &
            0.0_wp, 1e-5_wp)
      end do
   end subroutine test_resampled

end program test_local_decays
