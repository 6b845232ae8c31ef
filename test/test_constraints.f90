!> Elimination of what rigid supports hold, against products with the map it stands for.
program test_constraints
   use beamid_bands, only: band_t
   use beamid_constraints, only: constraints_t
   use beamid_cvode, only: cvode_t
   use beamid_errors, only: error_t
   use beamid_excitation, only: new_pulse
   use beamid_galerkin, only: alone, galerkin_t, mesh_t, new_galerkin
   use beamid_kinds, only: wp
   use beamid_responses, only: response_t
   use beamid_strings, only: to_text
   use beamid_structure, only: structure_t
   use checks, only: check, check_close, finish
   use dense_matrices, only: dense_of
   use single_responses, only: attempt
   implicit none

   real(wp), parameter :: eps = epsilon(1.0_wp)
   integer :: k

   call test_map(3, 8, [0.3_wp])
   call test_map(5, 8, [0.3_wp])
   call test_map(3, 16, [(k/8.5_wp, k=1, 8)])
   call test_map(7, 16, [(k/8.5_wp, k=8, 1, -1)])
   call test_map(3, 8, [0.25_wp, 0.5_wp, 1.0_wp])
   call test_map(3, 4, [0.1_wp, 0.15_wp])
   call test_map(3, 8, [0.51_wp, 0.6_wp])
   call test_map(5, 8, [0.51_wp, 0.53_wp, 0.55_wp, 0.6_wp])
   call test_too_many(3, [0.81_wp, 0.83_wp, 0.85_wp, 0.87_wp], [0.89_wp])
   call test_too_many(3, [0.05_wp, 0.1_wp], [0.15_wp])
   call test_too_many(5, [0.05_wp, 0.1_wp, 0.15_wp, 0.18_wp], [0.02_wp])
   call test_too_many(3, [0.5_wp], [0.5_wp])
   call test_refusal()
   call finish('constraints')

contains

   !> The map T: of unit vectors. Its columns meet the constraints, and the condensed matrix is
   !> T'A T. The products have some twenty terms of the entries' size, each with a rounding or two.
   !> The band is as narrow as before: functions are joined to their neighbours only.
   subroutine test_map(degree, elements, places)
      integer, intent(in) :: degree, elements
      real(wp), intent(in) :: places(:)
      type(galerkin_t) :: galerkin
      type(constraints_t) :: constraints
      type(band_t) :: condensed
      real(wp), allocatable :: map(:, :), unit(:, :), whole(:, :), point(:)
      character(len=:), allocatable :: name
      integer :: i, n

      name = 'degree '//to_text(degree)//', '//to_text(size(places))//' from '// &
         to_text(places(1))//': '
      galerkin = new_galerkin(mesh_t(degree, elements, degree + 1, 1), 1.0_wp)
      call hold(galerkin, places, constraints)
      call check(name//'accepted', constraints%number() == size(places) .and. &
         .not. constraints%too_many)
      n = galerkin%space%n - size(places)
      allocate (map(galerkin%space%n, n), unit(n, n), source=0.0_wp)
      do i = 1, n
         unit(i, i) = 1
         map(:, i) = constraints%expanded(unit(:, i))
      end do
      do i = 1, size(places)
         point = galerkin%space%at(places(i), 0)
         call check_close(name//'nothing moves at '//to_text(places(i)), &
            maxval(abs(matmul(point, map)))/maxval(abs(point)), 0.0_wp, 20*eps)
      end do
      condensed = constraints%of_matrix(galerkin%bending)
      whole = matmul(transpose(map), matmul(dense_of(galerkin%bending), map))
      call check_close(name//'condensed', maxval(abs(dense_of(condensed) - whole)) &
         /maxval(abs(whole)), 0.0_wp, 40*eps)
      call check(name//'the band stays', condensed%kd <= degree, to_text(condensed%kd))
      point = galerkin%moments(2.0_wp, alone)
      call check_close(name//'a load', maxval(abs(constraints%of_vector(point) &
         - matmul(point, map)))/maxval(abs(point)), 0.0_wp, 20*eps)
   end subroutine test_map

   subroutine hold(galerkin, places, constraints)
      type(galerkin_t), intent(in) :: galerkin
      real(wp), intent(in) :: places(:)
      type(constraints_t), intent(inout) :: constraints
      integer :: i

      do i = 1, size(places)
         call constraints%add(galerkin%space%at(places(i), 0))
      end do
   end subroutine hold

   !> As many places as functions in one of five elements may be held, and no more, though the mesh
   !> has functions left elsewhere; nor the same place twice.
   subroutine test_too_many(degree, enough, more)
      integer, intent(in) :: degree
      real(wp), intent(in) :: enough(:), more(:)
      type(galerkin_t) :: galerkin
      type(constraints_t) :: constraints
      character(len=:), allocatable :: name

      name = 'degree '//to_text(degree)//', '//to_text(size(enough))//' in one element'
      galerkin = new_galerkin(mesh_t(degree, 5, degree + 1, 1), 1.0_wp)
      call hold(galerkin, enough, constraints)
      call check(name//' are met', .not. constraints%too_many)
      call hold(galerkin, more, constraints)
      call check(name//', one more is not', constraints%too_many)
   end subroutine test_too_many

   !> The integrator refuses such a beam, and takes it where the elements are shorter.
   subroutine test_refusal()
      type(structure_t) :: s
      type(response_t) :: response
      type(error_t), allocatable :: error
      integer :: elements

      s = structure_t(length=1, rho=1, E=1, I=1, c_D=0.01_wp)
      s%supports = 3
      s%support(:3)%x_P = [0.05_wp, 0.1_wp, 0.15_wp]
      do elements = 5, 20, 15
         call attempt(cvode_t(), s, mesh_t(3, elements, 4, 1), new_pulse(1.0_wp, 0.1_wp), &
            [0.1_wp, 0.2_wp], response, error)
         call check(to_text(elements)//' elements, three supports near the root', &
            allocated(error) .eqv. elements == 5)
         if (.not. allocated(error)) cycle
         call check('refused: says why', index(error%message, 'so close together') > 0, &
            error%message)
      end do
   end subroutine test_refusal

end program test_constraints
