!> A fit with a mistake.
module mistaken_fits
   use beamid_errors, only: error_t
   use beamid_kinds, only: wp
   use beamid_residuals, only: residual_t
   implicit none
   private

   public :: mistaken_t

   !> A fit whose derivatives by its third parameter are wrong by 2 %.
   type, extends(residual_t) :: mistaken_t
   contains
      procedure :: jacobian
   end type mistaken_t

contains

   !> Computes residuals and derivatives. Arguments as of `residual_t`.
   subroutine jacobian(self, parameters, r, jac, error)
      class(mistaken_t), intent(inout) :: self
      real(wp), intent(in) :: parameters(:)
      real(wp), intent(out) :: r(:), jac(:, :)
      type(error_t), allocatable, intent(out) :: error

      call self%residual_t%jacobian(parameters, r, jac, error)
      jac(:, 3) = 1.02_wp*jac(:, 3)
   end subroutine jacobian

end module mistaken_fits

!> Condensed rows of long records: exponentials against quadruple precision, decompositions of
!> matrices of known condition, and searches that see condensed rows against those that see all.
program test_condensation
   use beamid_autoregression, only: new_autoregression
   use beamid_condensation, only: condense_matrix, condensed_t, few_rows, rows_of_part
   use beamid_decay_rows, only: decay_rows_t, new_decay_rows
   use beamid_errors, only: error_t
   use beamid_experiments, only: experiment_t
   use beamid_gauss_newton, only: least_squares_step
   use beamid_kernels, only: block_rows, decay_t, new_decay
   use beamid_kinds, only: wp
   use beamid_lapack, only: dgels, dgesv
   use beamid_least_squares, only: fit, fit_t, options_t
   use beamid_noise, only: gaussian_noise, uniform_noise
   use beamid_parameters, only: free_index
   use beamid_priors, only: prior_t
   use beamid_problems, only: compare_derivatives
   use beamid_residuals, only: checked_samples, residual_t
   use beamid_strings, only: to_text
   use beamid_structure, only: structure_t
   use beamid_variables, only: new_variable, unbounded, variable_t
   use checks, only: check, check_close, finish
   use free_decays, only: long_record, made, make_channels, names, noisy, problem_of, stamps, truth
   use mistaken_fits, only: mistaken_t
   use omp_lib, only: omp_get_max_threads, omp_set_num_threads
   implicit none

   integer, parameter :: quad = selected_real_kind(30)
   !> E, m_S, c_D and gamma of the strip, and where derivatives are compared, as shares of these.
   real(wp), parameter :: exact(4) = [truth%E, truth%sensor(1)%m_S, truth%c_D, truth%gamma], &
      near(4) = [1.0003_wp, 0.998_wp, 1.03_wp, 0.98_wp]

   call test_exponentials()
   call test_decompositions()
   call test_parts()
   call test_ill_conditioned()
   call test_one_record()
   call test_not_converged()
   call test_sample()
   call test_without_rows()
   call test_noise_free()
   call test_formulas()
   call test_channels()
   call test_coloured()
   call finish('condensation')

contains

   !> The phase reaches 3e5: even so far, the error is that of a few operations. Stamps: even, even
   !> but for round-off and for ten digits, jittered, very uneven, with a gap.
   subroutine test_exponentials()
      integer, parameter :: m = 4*block_rows
      real(wp), parameter :: step = 2e-3_wp, jitter(5) = [0.0_wp, 1e-7_wp, 1e-3_wp, 0.6_wp, 30.0_wp]
      complex(wp), parameter :: s = (-1e-3_wp, 31.4_wp)
      complex(quad) :: exact
      real(wp) :: t(m), re(block_rows), im(block_rows), error
      type(decay_t) :: decay
      integer :: first, j, k

      do k = 1, 6
         t = 1e4_wp + step*[(j, j=1, m)]
         if (k <= 5) t = t + step*jitter(k)*(uniform_noise(m, 3) - 0.5_wp)
         if (k == 6) t(m/2 + 10:) = t(m/2 + 10:) + 0.77_wp
         decay = new_decay(s, step)
         error = 0
         do first = 1, m, block_rows
            call decay%fill(t(first:first + block_rows - 1), re, im)
            do j = 1, block_rows
               exact = exp(cmplx(s, kind=quad)*real(t(first + j - 1), quad))
               error = max(error, real(abs(cmplx(re(j), im(j), quad) - exact)/abs(exact), wp))
            end do
         end do
         ! exp, two products, a table with phases up to 1: some ten round-offs. A phase of 3e5
         ! alone has a round-off of 3e-11.
         call check_close('exponentials, stamps '//to_text(k), error, 0.0_wp, 3e-15_wp)
      end do
   end subroutine test_exponentials

   !> R'R = A'A, and the remainder of y is the one of a projection in quadruple precision, for
   !> columns of which two differ little, for a column of zeros, and for more rows than blocks hold.
   subroutine test_decompositions()
      integer, parameter :: m = 4*few_rows + 7, k = 5
      real(wp), parameter :: close(5) = [1.0_wp, 1e-3_wp, 1e-6_wp, 1e-9_wp, 1e-13_wp]
      real(wp), target :: a(m, k), y(m)
      real(wp) :: columns(m, k), difference(k + 1, k + 1), whole(k + 1, k + 1)
      real(quad) :: left
      type(condensed_t) :: found
      integer :: i

      columns = reshape(gaussian_noise(m*k, 1.0_wp, 7), [m, k])
      do i = 1, size(close) + 1
         a = columns
         if (i <= size(close)) then
            a(:, 4) = a(:, 2) + close(i)*a(:, 4)
            a(:, 3) = 1e6_wp*a(:, 3)
         else
            a(:, 3) = 0
         end if
         y = matmul(a, [1.0_wp, -2.0_wp, 0.5_wp, 3.0_wp, 1.0_wp]) + 1e-5_wp*gaussian_noise(m, &
            1.0_wp, 8)
         call condense_matrix(a, y, found)
         whole = 0
         whole(:k, :k) = found%factor
         whole(:k, k + 1) = found%y
         whole(k + 1, k + 1) = found%left
         difference = matmul(transpose(whole), whole) - products(a, y)
         difference = difference/scales(a, y)
         ! Sums of 2000 products: their round-offs are 1e-14 at most, relative to the lengths.
         call check_close('matrix '//to_text(i)//': products', maxval(abs(difference)), 0.0_wp, &
            1e-13_wp)
         left = remainder(a, y)
         ! y is 1e6 to 1e11 times longer than what is left of it.
         call check_close('matrix '//to_text(i)//': remainder', found%left/real(left, wp), 1.0_wp, &
            merge(1e-4_wp, 1e-7_wp, i <= size(close)))
      end do
   end subroutine test_decompositions

   !> Rows that are divided into three parts: the same bits for any number of threads, and R'R =
   !> A'A.
   subroutine test_parts()
      integer, parameter :: k = 36
      real(wp), allocatable, target :: a(:, :), y(:)
      real(wp) :: gap(k + 1, k + 1), whole(k + 1, k + 1)
      type(condensed_t) :: found, by_one
      integer :: i, m, threads, usual

      m = 2*rows_of_part(1, k + 2) + 7
      a = reshape(gaussian_noise(m*k, 1.0_wp, 9), [m, k])
      y = gaussian_noise(m, 1.0_wp, 10)
      usual = omp_get_max_threads()
      do i = 1, 2
         ! Then a correction in a second pass is needed: the remainder is small.
         if (i == 2) y = sum(a, dim=2) + 1e-6_wp*y
         do threads = 1, 4
            call omp_set_num_threads(threads)
            call condense_matrix(a, y, found)
            if (threads == 1) by_one = found
            call check('parts '//to_text(i)//', threads '//to_text(threads), &
               all(abs(found%factor - by_one%factor) <= 0) .and. &
               all(abs(found%y - by_one%y) <= 0) .and. abs(found%left - by_one%left) <= 0)
         end do
         whole = 0
         whole(:k, :k) = found%factor
         whole(:k, k + 1) = found%y
         whole(k + 1, k + 1) = found%left
         gap = (matmul(transpose(whole), whole) - products(a, y))/scales(a, y)
         ! As in `test_decompositions`.
         call check_close('parts '//to_text(i)//': products', maxval(abs(gap)), 0.0_wp, 1e-13_wp)
         call check_close('parts '//to_text(i)//': remainder', found%left/real(remainder(a, y), &
            wp), 1.0_wp, 1e-7_wp)
      end do
      call omp_set_num_threads(usual)
   end subroutine test_parts

   !> [a y]'[a y].
   function products(a, y) result(p)
      real(wp), intent(in) :: a(:, :), y(:)
      real(wp) :: p(size(a, 2) + 1, size(a, 2) + 1), b(size(y), size(a, 2) + 1)

      b(:, :size(a, 2)) = a
      b(:, size(a, 2) + 1) = y
      p = real(matmul(transpose(real(b, quad)), real(b, quad)), wp)
   end function products

   !> Products of the lengths of the columns.
   function scales(a, y) result(p)
      real(wp), intent(in) :: a(:, :), y(:)
      real(wp) :: p(size(a, 2) + 1, size(a, 2) + 1), length(size(a, 2) + 1)

      length = max([norm2(a, dim=1), norm2(y)], 1e-300_wp)
      p = spread(length, 1, size(length))*spread(length, 2, size(length))
   end function scales

   !> |y - a c| for the best c, by modified Gram and Schmidt twice in quadruple precision.
   real(quad) function remainder(a, y)
      real(wp), intent(in) :: a(:, :), y(:)
      real(quad) :: q(size(y), size(a, 2)), r(size(y))
      integer :: j, k, pass

      q = a
      r = y
      do j = 1, size(a, 2)
         do pass = 1, 2
            do k = 1, j - 1
               q(:, j) = q(:, j) - dot_product(q(:, k), q(:, j))*q(:, k)
            end do
         end do
         if (norm2(q(:, j)) > 0) q(:, j) = q(:, j)/norm2(q(:, j))
      end do
      do pass = 1, 2
         do j = 1, size(a, 2)
            r = r - dot_product(q(:, j), r)*q(:, j)
         end do
      end do
      remainder = norm2(r)
   end function remainder

   !> 200 decays of two modes that are close, over a few periods, with stamps up to 1e4 s and 1 % of
   !> noise, against normal equations in quadruple precision. The distance is that of the linear
   !> unknowns in standard errors.
   subroutine test_ill_conditioned()
      integer, parameter :: m = few_rows + 50, columns = 9, records = 200
      real(wp), target :: t(m), z(m)
      real(wp) :: u(records, 5), distance, condition, by_reflections
      real(wp), dimension(records) :: conditions, distances, excess
      real(quad) :: basis(m, columns)
      complex(wp) :: s(2)
      type(decay_rows_t) :: rows
      integer :: j, k

      u = reshape(uniform_noise(records*5, 12), [records, 5])
      do k = 1, records
         s(1) = cmplx(-10**(-2*u(k, 1)), 31.4_wp, wp)
         s(2) = s(1)*(1 + 10**(-0.3_wp - 2.5_wp*u(k, 2)))
         t = 10**(4*u(k, 3)) + (1 + 4*u(k, 4))*0.2_wp*([(j, j=1, m)] + 0.6_wp*uniform_noise(m, &
            100 + k))/m
         call quad_basis(s, t, basis)
         z = real(matmul(basis, real([3.0_wp, 0.0_wp, 1.0_wp, 0.0_wp, -2.0_wp, 0.0_wp, 2.0_wp, &
            0.0_wp, 0.4_wp], quad)), wp)
         z = z + 0.01_wp*norm2(z)/sqrt(real(m, wp))*gaussian_noise(m, 1.0_wp, 500 + k)
         rows = new_decay_rows(s, t(1), 1.0_wp, t, z)
         call compare_with_quad(basis, z, rows%condensed(), distance, by_reflections, condition)
         conditions(k) = condition
         distances(k) = distance
         excess(k) = distance/max(by_reflections, 1e-7_wp)
      end do
      call check('poor: conditions on both sides', count(conditions > 1e6_wp) > 20 .and. &
         count(conditions <= 1e6_wp) > 100, to_text(maxval(conditions)))
      call check('poor: up to 1e6', all(distances <= 1e-6_wp .or. conditions > 1e6_wp), &
         to_text(maxval(distances, mask=conditions <= 1e6_wp))//' standard errors')
      call check('poor: beyond that, as close as reflections', all(excess <= 10), &
         to_text(maxval(distances))//' standard errors, '//to_text(maxval(excess)))
   end subroutine test_ill_conditioned

   !> The basis of a decay with an offset, in the order of `decay_rows_t%condensed`.
   subroutine quad_basis(s, t, basis)
      complex(wp), intent(in) :: s(2)
      real(wp), intent(in) :: t(:)
      real(quad), intent(out) :: basis(:, :)
      complex(quad) :: motion(size(t))
      real(quad) :: tau(size(t))
      integer :: k

      tau = t - t(1)
      do k = 1, 2
         motion = exp(cmplx(s(k), kind=quad)*tau)
         basis(:, 4*k - 3) = real(motion)
         basis(:, 4*k - 2) = tau*real(motion)
         basis(:, 4*k - 1) = aimag(motion)
         basis(:, 4*k) = tau*aimag(motion)
      end do
      basis(:, 9) = 1
   end subroutine quad_basis

   !> Distances of the best c of |basis c - z| from that in quadruple precision.
   !>
   !> condensed       of the basis and -z
   !> distance        by the condensed rows, in standard errors
   !> by_reflections  by LAPACK, of the basis in double precision
   !> condition       estimate for columns of length one
   subroutine compare_with_quad(basis, z, condensed, distance, by_reflections, condition)
      real(quad), intent(in) :: basis(:, :)
      real(wp), intent(in) :: z(:)
      type(condensed_t), intent(in) :: condensed
      real(wp), intent(out) :: distance, by_reflections, condition
      real(quad), dimension(size(basis, 2), size(basis, 2)) :: r, inverse
      real(quad) :: b(size(basis, 1), size(basis, 2)), c(size(basis, 2)), length(size(basis, 2))
      real(wp) :: a(size(basis, 1), size(basis, 2)), y(size(z), 1), noise, work(64*size(basis, 2))
      real(wp) :: factor(size(basis, 2), size(basis, 2))
      integer :: i, info, j, n, pivots(size(basis, 2))

      n = size(basis, 2)
      length = norm2(basis, dim=1)
      b = basis/spread(length, 1, size(z))
      r = matmul(transpose(b), b)
      do j = 1, n
         do i = 1, j - 1
            r(i, j) = (r(i, j) - dot_product(r(:i - 1, i), r(:i - 1, j)))/r(i, i)
         end do
         r(j, j) = sqrt(r(j, j) - dot_product(r(:j - 1, j), r(:j - 1, j)))
         r(j + 1:, j) = 0
      end do
      inverse = 0
      do j = 1, n
         inverse(j, j) = 1
         inverse(:, j) = solved(r, inverse(:, j))
      end do
      condition = real(norm2(inverse)*sqrt(real(n, quad)), wp)
      c = matmul(inverse, matmul(transpose(inverse), matmul(transpose(b), real(z, quad))))
      noise = real(norm2(z - matmul(b, c)), wp)/sqrt(real(size(z) - n, wp))
      c = c/length
      r = r*spread(length, 1, n)
      factor = condensed%factor
      y(:n, 1) = -condensed%y
      call dgesv(n, 1, factor, n, pivots, y, size(z), info)
      distance = real(norm2(matmul(r, y(:n, 1) - c)), wp)/noise
      a = real(b, wp)
      y(:, 1) = z
      call dgels('N', size(z), n, 1, a, size(z), y, size(z), work, size(work), info)
      by_reflections = real(norm2(matmul(r, y(:n, 1)/length - c)), wp)/noise
   end subroutine compare_with_quad

   !> The solution of r x = b, with an upper triangle r.
   function solved(r, b) result(x)
      real(quad), intent(in) :: r(:, :), b(:)
      real(quad) :: x(size(b))
      integer :: j

      x = b
      do j = size(b), 1, -1
         x(j) = x(j)/r(j, j)
         x(:j - 1) = x(:j - 1) - x(j)*r(:j - 1, j)
      end do
   end function solved

   !> Compares J, J'J, J'r and Gauss and Newton's step of condensed rows with those of all rows. All
   !> rows are once computed from the condensed rows, and once formed and decomposed by reflections:
   !> a filter for white noise, which changes nothing, has that effect.
   subroutine compare(label, problem)
      character(len=*), intent(in) :: label
      type(residual_t), intent(inout) :: problem
      type(residual_t) :: formed, other
      integer :: i

      formed = problem
      if (.not. allocated(formed%colour)) then
         allocate (formed%colour(size(formed%parts)))
         do i = 1, size(formed%colour)
            associate (record => formed%parts(i)%observed)
               formed%colour(i) = new_autoregression(record%measured, record%times(), white=.true.)
            end associate
         end do
      end if
      other = problem
      call compare_rows(label, problem, other)
      call compare_rows(label//', formed', problem, formed)
   end subroutine compare

   !> Compares condensed rows of one problem with all rows of another.
   subroutine compare_rows(label, problem, other)
      character(len=*), intent(in) :: label
      type(residual_t), intent(inout) :: problem, other
      type(error_t), allocatable :: error
      real(wp), allocatable :: r(:), jac(:, :), all_r(:), all_jac(:, :), scale(:)
      real(wp), dimension(size(names)) :: parameters, step, all_step, sd
      real(wp) :: volume, all_volume, noise
      integer :: k, m, n, rank

      parameters = near*exact
      n = size(parameters)
      m = problem%rows()
      allocate (r(problem%condensed_rows(m, n)), jac(problem%condensed_rows(m, n), n))
      allocate (all_r(m), all_jac(m, n))
      call check(label//': few rows', size(r) == n + 1, to_text(size(r)))
      call other%jacobian(parameters, all_r, all_jac, error)
      call check(label//': all rows', .not. allocated(error))
      all_volume = other%log_volume
      call problem%condensed(parameters, r, jac, error)
      call check(label//': condensed rows', .not. allocated(error))
      volume = problem%log_volume
      scale = norm2(all_jac, dim=1)
      noise = norm2(all_r)/sqrt(real(m - n, wp))
      ! Round-off of sums of up to 3000 terms, and of a condition of the columns of up to 100.
      call check_close(label//': J', sum(r**2)/sum(all_r**2), 1.0_wp, 1e-12_wp)
      call check_close(label//': products of derivatives', maxval(abs(matmul(transpose(jac), jac) &
         - matmul(transpose(all_jac), all_jac))/(spread(scale, 1, n)*spread(scale, 2, n))), &
         0.0_wp, 1e-11_wp)
      call check_close(label//': gradient', maxval(abs(matmul(r, jac) - matmul(all_r, all_jac)) &
         /(scale*norm2(all_r))), 0.0_wp, 1e-11_wp)
      call check_close(label//': volume', volume, all_volume, 1e-11_wp)
      associate (free => spread(.true., 1, n))
         call least_squares_step(jac, r, parameters, free, 1e-14_wp, step, rank)
         call least_squares_step(all_jac, all_r, parameters, free, 1e-14_wp, all_step, rank)
      end associate
      sd = standard_errors(all_jac, noise)
      call check_close(label//': step, in standard errors', maxval(abs(step - all_step)/sd), &
         0.0_wp, 1e-9_wp)
      sd = standard_errors(jac, noise)/sd
      do k = 1, n
         call check_close(label//': standard error '//to_text(k), sd(k), 1.0_wp, 1e-9_wp)
      end do
   end subroutine compare_rows

   !> Standard errors (n) for noise of a standard deviation, by unit steps in the residuals' space.
   function standard_errors(jac, noise) result(sd)
      real(wp), intent(in) :: jac(:, :), noise
      real(wp) :: sd(size(jac, 2)), others(size(jac, 2))
      integer :: j, k, rank

      do k = 1, size(sd)
         call least_squares_step(jac, jac(:, k), [(1/norm2(jac(:, j)), j=1, size(sd))], &
            [(j /= k, j=1, size(sd))], 1e-14_wp, others, rank)
         sd(k) = noise/norm2(jac(:, k) + matmul(jac, others))
      end do
   end function standard_errors

   !> Without and with priors.
   subroutine test_one_record()
      type(residual_t) :: problem
      type(prior_t) :: prior

      problem = problem_of([long_record(3000, 3, 4)], truth, 3, [prior_t ::])
      call compare('one record', problem)
      prior = prior_t(parameter=[free_index('m_S')], slope=[1.0_wp], sd=0.01_wp*exact(2))
      problem = problem_of([long_record(3000, 3, 4)], truth, 3, [prior])
      call compare('prior', problem)
   end subroutine test_one_record

   !> A search that ends too early leaves an estimate, and the rows of a fit are all rows there.
   subroutine test_not_converged()
      type(residual_t) :: problem
      type(fit_t) :: found
      type(error_t), allocatable :: error
      real(wp), allocatable :: r(:), jac(:, :)
      integer :: k

      problem = problem_of([long_record(3000, 3, 4)], truth, 3, [prior_t ::])
      call fit(problem, problem%rows(), [(new_variable(1.2_wp*exact(k), 0.0_wp, unbounded, &
         exact(k)), k=1, size(exact))], options_t(check=.false., max_evaluations=2), found, error)
      call check('not converged: an error', allocated(error))
      call check('not converged: an estimate', allocated(found%estimate))
      if (.not. allocated(found%estimate)) return
      allocate (r(problem%rows()), jac(problem%rows(), size(exact)))
      call problem%jacobian(found%estimate, r, jac, error)
      ! The same computation: exact.
      call check_close('not converged: residuals', maxval(abs(found%residual - r)), 0.0_wp, 0.0_wp)
      call check_close('not converged: derivatives', maxval(abs(found%jacobian - jac)), 0.0_wp, &
         0.0_wp)
   end subroutine test_not_converged

   !> The variables of a fit that starts at a factor of the true values.
   function variables_from(factor) result(variables)
      real(wp), intent(in) :: factor(:)
      type(variable_t) :: variables(size(exact))
      integer :: k

      variables = [(new_variable(factor(k)*exact(k), 0.0_wp, unbounded, exact(k)), &
         k=1, size(exact))]
   end function variables_from

   !> The derivatives of a long record are compared with differences at some samples. A mistake is
   !> found there, and the fit has all its samples afterwards. A shorter record is compared as a
   !> whole.
   subroutine test_sample()
      integer, parameter :: m = checked_samples + 1000
      type(residual_t) :: problem
      type(mistaken_t) :: mistaken
      type(fit_t) :: found
      type(error_t), allocatable :: error
      real(wp), allocatable :: r(:), jac(:, :), worst, worst_of_all
      integer :: wrong
      logical :: is_done

      problem = problem_of([long_record(m, 3, 4)], truth, 3, [prior_t ::])
      associate (variables => variables_from(near))
         call problem%check_sample(near*exact, variables, worst, wrong, is_done)
         call check('sample: compared', is_done .and. allocated(worst) .and. wrong == 0)
         call check('sample: all samples are there again', problem%rows() == m .and. &
            size(problem%parts(1)%observed%times()) == m)
         allocate (r(m), jac(m, size(exact)))
         call problem%jacobian(near*exact, r, jac, error)
         call compare_derivatives(problem, near*exact, variables, jac, worst_of_all, wrong)
         ! Both are the error of the same differences, at more or less than half of the samples.
         if (allocated(worst)) call check('sample: the difference of all samples', worst > 0 .and. &
            abs(log(worst/worst_of_all)) < log(2.0_wp), to_text(worst)//', '//to_text(worst_of_all))
      end associate
      mistaken%residual_t = problem
      call fit(mistaken, m, variables_from(near), options_t(), found, error, names=names)
      call check('sample: a mistake is found', allocated(error))
      if (allocated(error)) call check('sample: the parameter is named', &
         index(error%message, 'derivative by c_D disagrees') > 0, error%message)
      problem = problem_of([long_record(1000, 3, 4)], truth, 3, [prior_t ::])
      call problem%check_sample(near*exact, variables_from(near), worst, wrong, is_done)
      call check('sample: not of a shorter record', .not. is_done)
   end subroutine test_sample

   !> A search for the estimate alone leaves no rows, and finds the same estimate and the same J.
   subroutine test_without_rows()
      type(residual_t) :: problem, same
      type(fit_t) :: found, bare
      type(error_t), allocatable :: error

      problem = problem_of([long_record(3000, 3, 4)], truth, 3, [prior_t ::])
      same = problem
      call fit(problem, problem%rows(), variables_from(near), options_t(check=.false.), &
         found, error)
      call check('with rows: converged', .not. allocated(error))
      call fit(same, same%rows(), variables_from(near), options_t(check=.false., &
         all_rows=.false.), bare, error)
      call check('without rows: converged', .not. allocated(error))
      call check('with rows', size(found%residual) == 3000 .and. size(found%jacobian, 1) == 3000)
      call check('without rows', size(bare%residual) == 0 .and. size(bare%jacobian, 1) == 0)
      ! The same computation: exact.
      call check_close('without rows: estimate', maxval(abs(bare%estimate - found%estimate)), &
         0.0_wp, 0.0_wp)
      call check_close('without rows: J', bare%J, found%J, 0.0_wp)
   end subroutine test_without_rows

   !> A record that is made of the columns of the linear unknowns themselves leaves round-off.
   subroutine test_noise_free()
      integer, parameter :: m = 3000
      type(residual_t) :: problem
      type(error_t), allocatable :: error
      integer, parameter :: n = size(names)
      real(wp) :: r(m), jac(m, n + 5), c(5), few(n + 1), few_jac(n + 1, n)

      problem = problem_of([long_record(m, 3, 4)], truth, 3, [prior_t ::])
      call problem%evaluate(exact, r, jac, error, c)
      call problem%parts(1)%observed%take(-matmul(jac(:, size(names) + 1:), &
         [20.0_wp, 5.0_wp, 4.0_wp, -3.0_wp, 0.04_wp]))
      call problem%condensed(exact, few, few_jac, error)
      call check_close('no noise: J/|z|**2', sum(few**2) &
         /sum(problem%parts(1)%observed%measured**2), 0.0_wp, 1e-28_wp)
   end subroutine test_noise_free

   !> The differences of displacements and velocities.
   subroutine test_formulas()
      type(residual_t) :: problem
      integer :: k

      do k = 1, 2
         problem = problem_of([long_record(1500, k, 5)], truth, k, [prior_t ::])
         call compare('formula '//to_text(k), problem)
      end do
   end subroutine test_formulas

   !> A long and a short channel of one motion, with weights.
   subroutine test_channels()
      type(residual_t) :: problem
      type(structure_t) :: beam
      type(experiment_t) :: two(2)

      call make_channels(1500, beam, two)
      problem = problem_of(two, beam, 3, [prior_t ::])
      call compare('channels', problem)
   end subroutine test_channels

   !> Coloured noise: the rows are whitened before they are condensed.
   subroutine test_coloured()
      integer, parameter :: m = 1500
      type(residual_t) :: problem
      type(experiment_t) :: record
      real(wp) :: noise(m)
      integer :: k

      record = long_record(m, 3, 6)
      noise = gaussian_noise(m, 0.1_wp, 9)
      do k = 2, m
         noise(k) = noise(k) + 0.8_wp*noise(k - 1)
      end do
      problem = problem_of([noisy(record, noise)], truth, 3, [prior_t ::])
      allocate (problem%colour(1))
      problem%colour(1) = new_autoregression(noise, record%samples, white=.false.)
      call check('coloured: an order', problem%colour(1)%order > 0)
      call compare('coloured', problem)
   end subroutine test_coloured

end program test_condensation
