!> Sums of squares around a fit: profiles, their lowest places, the bound on the sums of two models.
program test_profiles
   use beamid
   use beamid_profiles, only: difference_bound, lowest_places, profile, squared_distance, &
      sum_of_squares
   use checks, only: check, check_close, finish
   use models, only: stage_of
   implicit none

   type(mesh_t), parameter :: coarse = mesh_t(elements=4)
   type(case_t) :: truth
   type(error_t), allocatable :: error
   real(wp), allocatable :: samples(:), measured(:)
   type(simulation_t) :: simulation
   type(model_t) :: model
   integer :: k

   call test_lowest_places()
   call read_case('data/table_4_1_truth.nml', needs_response, truth, error)
   if (allocated(error)) then
      call check('a structure is read', .false., error%message)
   else
      model = truth%model
      deallocate (model%solver)
      allocate (modal_t :: model%solver)
      samples = [(0.1_wp*k, k=2, 50)]
      call simulate(model, coarse, samples, simulation, error)
      call check('a record is made', .not. allocated(error))
      if (.not. allocated(error)) then
         measured = simulation%acceleration
         call test_sum_of_squares()
         call test_profile()
         call test_bound()
      end if
   end if
   call finish('profiles')

contains

   subroutine test_lowest_places()
      call check('one place', all(lowest_places([3.0_wp, 1.0_wp, 2.0_wp]) == [2]) .and. &
         size(lowest_places([3.0_wp, 1.0_wp, 2.0_wp])) == 1)
      call check('two places', size(lowest_places([3.0_wp, 1.0_wp, 2.0_wp, 0.0_wp, 5.0_wp])) == 2)
      call check('ends do not count', size(lowest_places([1.0_wp, 2.0_wp, 1.0_wp])) == 0 .and. &
         size(lowest_places([1.0_wp])) == 0)
   end subroutine test_lowest_places

   !> A record of the model itself plus a constant c: J = m c**2.
   subroutine test_sum_of_squares()
      real(wp), parameter :: c = 0.5_wp
      real(wp) :: J

      call sum_of_squares(model, coarse, samples, measured + c, J, error)
      call check('a sum of squares', .not. allocated(error))
      if (allocated(error)) return
      ! 49 residuals with round-off of 1e-15 each.
      call check_close('a constant residual', J, size(samples)*c**2, 1e-12_wp)
   end subroutine test_sum_of_squares

   !> A record without noise: J along m_H is least, and zero, at the true m_H, where the fitted
   !> parameters are the true ones; on either side it grows.
   subroutine test_profile()
      type(stage_fit_t), allocatable :: fits(:)
      real(wp) :: masses(5), J(5)

      masses = [0.9_wp, 0.95_wp, 1.0_wp, 1.05_wp, 1.1_wp]*model%structure%hose(1)%m_H
      call profile(model, coarse, free_index('m_H'), masses, stage_of(['c_H', 'k_H']), samples, &
         measured, fits, error)
      if (allocated(error)) then
         call check('profile', .false., error%message)
         return
      end if
      J = [(fits(k)%fit%J, k=1, 5)]
      ! The search stops when J falls by less than 1e-10 of it, and no lower than round-off.
      call check_close('least J', J(3), 0.0_wp, 1e-10_wp*J(1))
      call check_close('c_H where J is least', &
         fits(3)%scenario%structures(1)%hose(1)%c_H/model%structure%hose(1)%c_H, 1.0_wp, &
         1e-4_wp)
      call check_close('k_H where J is least', &
         fits(3)%scenario%structures(1)%hose(1)%k_H/model%structure%hose(1)%k_H, 1.0_wp, &
         1e-5_wp)
      call check('one lowest place, the third', size(lowest_places(J)) == 1 .and. &
         all(lowest_places(J) == [3]))
      call check('the parameter stays where it is put', &
         all([(abs(fits(k)%scenario%structures(1)%hose(1)%m_H - &
         masses(k)) <= 0, k=1, 5)]))
   end subroutine test_profile

   !> Schwarz's inequality on a record of which nothing is special, and equality when the responses
   !> differ by a multiple of the residual.
   subroutine test_bound()
      real(wp), allocatable :: record(:), other(:)
      real(wp) :: gap, J

      record = measured + gaussian_noise(size(samples), 0.3_wp, 11)
      other = 1.2_wp*measured
      J = squared_distance(measured, record)
      gap = squared_distance(other, record) - J - squared_distance(other, measured)
      call check('within the bound, and not zero', abs(gap) <= difference_bound(J, &
         squared_distance(other, measured)) .and. abs(gap) > 0)
      other = measured + 0.5_wp*(measured - record)
      gap = squared_distance(other, record) - J - squared_distance(other, measured)
      ! Sums of 49 numbers of some 0.1: round-off 1e-14.
      call check_close('the bound is reached', gap, difference_bound(J, squared_distance(other, &
         measured)), 1e-13_wp*J)
   end subroutine test_bound

end program test_profiles
