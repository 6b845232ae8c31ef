!> Fits of the structure of Table 4.1: by CVODE as by the exact response, and on the bound of a
!> parameter.
program test_fits
   use beamid_cases, only: case_t, measured_samples, needs_fit, read_case
   use beamid_cvode, only: cvode_t
   use beamid_errors, only: error_t
   use beamid_galerkin, only: mesh_t
   use beamid_identification, only: identify, identify_meshes, model_t, simulate, simulation_t, &
      stage_fit_t, stage_t
   use beamid_kinds, only: wp
   use beamid_modal, only: modal_t
   use beamid_noise, only: gaussian_noise
   use beamid_strings, only: to_text
   use beamid_undetermined_directions, only: undetermined
   use checks, only: check, check_close, finish, in_long_run
   implicit none

   call test_table_4_1()
   call test_bound()
   call finish('fits')

contains

   !> The case of Table 4.1, exact responses and CVODE with rtol 1e-11.
   !>
   !> What CVODE leaves is measured at the modal minimum: 3e-9 of the record, and ten times less for
   !> each digit of rtol, so that it is the integrator that is off. It moves the minimum of J by a
   !> step of Gauss and Newton, J by 2 r dr at most. On top of that, `lmdif` ends where its forward
   !> differences say that J is flat: their steps are 1e-4 of a parameter (a tenth of a per cent of
   !> J's digits, but no integrator noise), which moves the end by 1e-4 standard deviations times
   !> the curvature of the model, of order one. c_D, whose deviation is up to 36 % of it, is the
   !> only one of which that could be more than 1e-5.
   subroutine test_table_4_1()
      character(len=3), parameter :: names(4) = ['c_D', 'm_H', 'c_H', 'k_H']
      type(case_t) :: case
      type(model_t) :: model
      type(stage_fit_t), allocatable :: exact(:, :), integrated(:, :)
      type(simulation_t) :: simulation
      type(error_t), allocatable :: error
      real(wp), allocatable :: samples(:), measured(:), change(:), shift(:)
      real(wp) :: moved
      character(len=:), allocatable :: label
      character(len=160), allocatable :: text(:)
      integer, allocatable :: meshes(:)
      integer :: i, j, k

      call read_case('data/table_4_1_fit.nml', needs_fit, case, error)
      if (.not. allocated(error)) call measured_samples(case, samples, measured, error)
      if (allocated(error)) then
         call check('Table 4.1: read', .false., error%message)
         return
      end if
      model = case%model
      deallocate (model%solver)
      model%solver = modal_t()
      call identify_meshes(model, case%meshes, case%stages, samples, measured, exact, error)
      call check('Table 4.1: modal converges', .not. allocated(error))
      if (allocated(error)) return
      deallocate (model%solver)
      model%solver = cvode_t(rtol=1e-11_wp)
      meshes = [2, 3]
      if (in_long_run()) meshes = [(k, k=1, size(case%meshes))]
      call identify_meshes(model, case%meshes(meshes), case%stages, samples, measured, integrated, &
         error)
      call check('Table 4.1: cvode converges', .not. allocated(error))
      if (allocated(error)) return
      do j = 1, size(meshes)
         k = meshes(j)
         associate (a => exact(1, k), b => integrated(1, j))
            label = 'Table 4.1, N = '//to_text(a%elements)//': '
            model%structure = a%scenario%structures(1)
            call simulate(model, case%meshes(k), samples, simulation, error)
            change = simulation%acceleration - measured - a%fit%residual
            call check_close(label//'the integrator''s error at the minimum', norm2(change) &
               /norm2(measured), 0.0_wp, 1e-8_wp)
            shift = matmul(a%statistics%covariance, matmul(change, &
               a%fit%jacobian))/a%statistics%variance
            moved = 2*norm2(change)/sqrt(a%fit%J)
            do i = 1, 4
               call check_close(label//names(i)//', shift of the minimum by the integrator', &
                  shift(i)/a%fit%estimate(i), 0.0_wp, 1e-5_wp)
               call check_close(label//names(i)//', cvode over modal', b%fit%estimate(i) &
                  /a%fit%estimate(i), 1.0_wp, max(1e-5_wp, merge(1e-3_wp, 0.0_wp, i == 1) &
                  *a%statistics%std_error(i)/a%fit%estimate(i)))
               ! Central differences with a step of rtol**(1/3) at least 1e-8**(1/3): 2e-3, squared.
               call check_close(label//'sd of '//names(i)//', cvode over modal', &
                  b%statistics%std_error(i)/a%statistics%std_error(i), 1.0_wp, 1e-4_wp)
            end do
            call check_close(label//'J, cvode over modal', b%fit%J/a%fit%J, 1.0_wp, 1e-7_wp + moved)
            ! A step of 6e-6, its square 4e-11, round-off 1e-16/6e-6 of responses whose derivative
            ! is, for c_D, a thousand times smaller than themselves.
            call check(label//'exact derivatives against differences', &
               all(a%fit%derivative_check >= 0) .and. all(a%fit%derivative_check < 1e-5_wp), &
               to_text(a%fit%derivative_check(1))//' and '//to_text(a%fit%derivative_check(2)))
            call check(label//'no exact derivatives with cvode', &
               .not. allocated(b%fit%derivative_check))
            text = undetermined(a%statistics, names, a%quantities%scale, a%jacobian)
            do i = 1, size(text)
               print '(3a)', '      ', label, trim(text(i))
            end do
            print '(5a)', '      ', label, 'c_D '//to_text(a%fit%estimate(1)), ' +- ', &
               to_text(a%statistics%half_width(1))//', condition '//to_text(a%statistics%condition)
            call check(label//'determined, all four', all(a%statistics%determined))
            ! An interval narrower than the value, and a sentence that denies it, do not go
            ! together: relative changes are relative to the estimates.
            do i = 1, 4
               call check_close(label//names(i)//', relative to its estimate', &
                  a%quantities(i)%scale/a%fit%estimate(i), 1.0_wp, 1e-12_wp)
            end do
            call check(label//'no sentence denies it', size(text) == 0)
         end associate
      end do
      ! N = 2 misses mode 3 by several per cent and has nothing else for c_D to explain: the
      ! interval is some three quarters of the value, against 3 % for N = 6.
      associate (s => exact(1, 1)%statistics, q => exact(1, 1)%fit%estimate)
         call check('Table 4.1, N = 2: c_D known to no better than half of itself', &
            s%half_width(1)/q(1) > 0.5_wp .and. s%half_width(1)/q(1) < 1, &
            to_text(s%half_width(1)/q(1)))
      end associate
      associate (s => exact(1, 5)%statistics, q => exact(1, 5)%fit%estimate)
         call check('Table 4.1, N = 6: c_D known to 5 %', s%half_width(1)/q(1) < 0.05_wp, &
            to_text(s%half_width(1)/q(1)))
      end associate
   end subroutine test_table_4_1

   !> The truth lies on the bound of c_D. Where the noise pulls c_D below it, c_D is held there: its
   !> value is the bound itself, the others are those of a fit with c_D = 0 not free, in few
   !> iterations; where it does not, the minimum lies inside, with a smaller J than on the bound.
   subroutine test_bound()
      character(len=3), parameter :: names(4) = ['c_D', 'm_H', 'c_H', 'k_H']
      type(mesh_t), parameter :: mesh = mesh_t(3, 4, 4, 1)
      integer, parameter :: records = 12
      type(case_t) :: case
      type(model_t) :: model
      type(stage_t) :: all_four, three
      type(simulation_t) :: simulation
      type(stage_fit_t), allocatable :: found(:), held(:)
      type(error_t), allocatable :: error
      real(wp), allocatable :: samples(:), unused(:), noise(:), measured(:)
      character(len=:), allocatable :: label
      integer :: i, r, on_bound

      call read_case('data/table_4_1_fit.nml', needs_fit, case, error)
      if (.not. allocated(error)) call measured_samples(case, samples, unused, error)
      model = case%model
      deallocate (model%solver)
      model%solver = modal_t()
      associate (s => model%structure)
         s%c_D = 0
         s%hose(1)%m_H = 0.04_wp
         s%hose(1)%c_H = 0.004_wp
         s%hose(1)%k_H = 0.3_wp
      end associate
      call simulate(model, mesh, samples, simulation, error)
      call check('on a bound: record made', .not. allocated(error))
      if (allocated(error)) return
      noise = gaussian_noise(records*size(samples), 0.02_wp*norm2(simulation%acceleration) &
         /sqrt(real(size(samples), wp)), 404)
      all_four = case%stages(1)
      three = stage_t(free=all_four%free(2:), start=all_four%start(2:), lower=all_four%lower(2:), &
         upper=all_four%upper(2:))
      on_bound = 0
      do r = 1, records
         label = 'on a bound, record '//to_text(r)//': '
         measured = simulation%acceleration + noise((r - 1)*size(samples) + 1:r*size(samples))
         model%structure%c_D = 0
         call identify(model, mesh, [three], samples, measured, held, error)
         if (.not. allocated(error)) call identify(model, mesh, [all_four], samples, measured, &
            found, error)
         if (allocated(error)) then
            call check(label//'converges', .false., error%message)
            cycle
         end if
         ! Measured with the holding of bounds switched off: 1600 iterations where the minimum is
         ! on the bound. With it some twenty; a minimum inside but near the bound lets go again,
         ! at a price.
         call check(label//'few iterations', found(1)%fit%iterations <= &
            merge(40, 200, found(1)%fit%estimate(1) <= 0), &
            to_text(found(1)%fit%iterations)//', c_D '// to_text(found(1)%fit%estimate(1)))
         if (found(1)%fit%estimate(1) > 0) then
            call check(label//'inside: J below that on the bound', found(1)%fit%J < held(1)%fit%J, &
               to_text(held(1)%fit%J/found(1)%fit%J - 1))
            cycle
         end if
         on_bound = on_bound + 1
         call check_close(label//'c_D is its bound', found(1)%fit%estimate(1), 0.0_wp, 0.0_wp)
         ! J falls towards the outside: the slope at the bound is positive.
         call check(label//'J rises towards the inside', &
            dot_product(found(1)%fit%jacobian(:, 1), found(1)%fit%residual) > 0)
         do i = 2, 4
            ! Two searches for one minimum of J, each followed to 1e-14: 1e-7 standard deviations.
            call check_close(label//names(i), found(1)%fit%estimate(i)/held(1)%fit%estimate(i &
               - 1), 1.0_wp, 1e-7_wp)
         end do
         call check_close(label//'J', found(1)%fit%J/held(1)%fit%J, 1.0_wp, 1e-12_wp)
      end do
      ! Half of the records, by the sign of the noise: all or none happens once in 2000 times.
      call check('on a bound: some records', on_bound > 0 .and. on_bound < records, &
         to_text(on_bound))
   end subroutine test_bound

end program test_fits
