!> Table 4.1 of NASA CR-178199 through the library: the paper's numbers, and that they do not depend
!> on where the search starts.
program test_table_4_1
   use beamid, only: modal_t
   use beamid_cases, only: case_t, measured_samples, needs_fit, needs_response, read_case
   use beamid_csv, only: column_length, read_columns
   use beamid_cvode, only: cvode_t
   use beamid_equations, only: equations_t, new_equations
   use beamid_errors, only: error_t
   use beamid_galerkin, only: galerkin_t, new_galerkin
   use beamid_identification, only: identify_meshes, model_t, simulate, simulation_t, stage_fit_t, &
      stage_t
   use beamid_kinds, only: wp
   use beamid_modes, only: undamped_modes
   use beamid_strings, only: to_text
   use checks, only: check, check_close, finish, in_long_run
   implicit none

   character(len=*), parameter :: names(4) = ['c_D', 'm_H', 'c_H', 'k_H']
   type(case_t) :: truth, case
   type(error_t), allocatable :: error
   type(stage_fit_t), allocatable :: fits(:, :)
   real(wp), allocatable :: samples(:), measured(:), paper(:, :)
   character(len=column_length), allocatable :: header(:)

   call read_case('data/table_4_1_truth.nml', needs_response, truth, error)
   if (.not. allocated(error)) call read_case('data/table_4_1_fit.nml', needs_fit, case, error)
   if (.not. allocated(error)) call measured_samples(case, samples, measured, error)
   if (.not. allocated(error)) call read_columns('data/paper/table_4_1.csv', 6, paper, header, &
      error)
   if (allocated(error)) then
      call check('cases, record and table are read', .false., error%message)
   else
      call check('one mesh for each row of the table', size(case%meshes) == 5 .and. &
         all(case%meshes%elements == nint(paper(1, :))))
      call check('49 samples, .2 to 5', size(samples) == 49)
      call test_truth()
      call test_record()
      call test_paper()
      call test_modal_starts()
      call test_cvode_starts()
   end if
   call finish('table_4_1')

contains

   !> The simulated structure is the one of the reference frequencies, rad/s; damping is left out by
   !> their definition. Half a unit of their last digit, and 1e-9 for the mesh, modes 1 to 3.
   subroutine test_truth()
      real(wp), parameter :: reference(3) = [2.59063789_wp, 4.84629206_wp, 51.96471056_wp]
      type(galerkin_t), target :: galerkin
      type(equations_t) :: equations
      real(wp), allocatable :: omega(:), shapes(:, :)
      integer :: i

      galerkin = new_galerkin(truth%meshes(1), truth%model%structure%length)
      equations = new_equations(galerkin, truth%model%structure, truth%model%excitation)
      call undamped_modes(equations, omega, shapes, error)
      do i = 1, size(reference)
         call check_close('simulated structure, omega '//to_text(i), omega(i), reference(i), &
            0.6e-8_wp + 1e-9_wp*reference(i))
      end do
   end subroutine test_truth

   !> The record comes out of its case again. Integrated with rtol = 1e-11: displacements of .3 to
   !> some hundred rtol, 1e-9 at worst, divided by Delta^2 = .01.
   subroutine test_record()
      type(simulation_t) :: simulation

      call simulate(truth%model, truth%meshes(1), samples, simulation, error)
      call check('the record is simulated', .not. allocated(error))
      if (allocated(error)) return
      call check_close('the record regenerates', maxval(abs(simulation%acceleration - measured)), &
         0.0_wp, 1e-7_wp)
      call check('the record is not zero', maxval(abs(measured)) > 1)
   end subroutine test_record

   !> N = 2 .. 6 with CVODE and lmdif. What is known about the table: m_H, c_H, k_H agree to 2 per
   !> cent; the paper's J is 16 times ours for N = 2 .. 5, to 10 per cent here, and not for N = 6; J
   !> falls with N. Per cents do not need the case's rtol = 1e-11; 1e-9 leaves 3e-4 in c_H.
   subroutine test_paper()
      type(model_t) :: model
      integer :: k, i

      model = case%model
      deallocate (model%solver)
      model%solver = cvode_t(rtol=1e-9_wp)
      call identify_meshes(model, case%meshes, case%stages, samples, measured, fits, error)
      if (allocated(error)) then
         call check('N = 2 .. 6: all searches converge', .false., error%message)
         return
      end if
      do k = 1, size(paper, 2)
         do i = 2, 4
            call check_close('N = '//to_text(fits(1, k)%elements)//', '//names(i)// &
               ' against the paper', fits(1, k)%fit%estimate(i)/paper(i + 1, k), 1.0_wp, 0.02_wp)
         end do
         if (k < size(paper, 2)) call check_close('N = '//to_text(fits(1, k)%elements)// &
            ', 16 J against the paper', 16*fits(1, k)%fit%J/paper(6, k), 1.0_wp, 0.1_wp)
      end do
      do k = 2, size(paper, 2)
         call check('J falls from N = '//to_text(fits(1, k - 1)%elements), &
            fits(1, k)%fit%J < fits(1, k - 1)%fit%J/2, to_text(fits(1, k)%fit%J))
      end do
      ! Not explained, and so not to be lost sight of: at N = 6 the paper's J lies well below 16 J.
      call check('N = 6: 16 J is above the paper''s J', &
         16*fits(1, 5)%fit%J > 2*paper(6, 5), to_text(16*fits(1, 5)%fit%J/paper(6, 5)))
      ! Towards the true values: those of the finest mesh are within a per cent.
      associate (s => truth%model%structure, q => fits(1, 5)%fit%estimate)
         call check_close('N = 6, c_D against the truth', q(1)/s%c_D, 1.0_wp, 0.01_wp)
         call check_close('N = 6, m_H against the truth', q(2)/s%hose(1)%m_H, 1.0_wp, 0.001_wp)
         call check_close('N = 6, c_H against the truth', q(3)/s%hose(1)%c_H, 1.0_wp, 0.001_wp)
         call check_close('N = 6, k_H against the truth', q(4)/s%hose(1)%k_H, 1.0_wp, 0.001_wp)
      end associate
   end subroutine test_paper

   !> Start k: the paper's, or one of two that are 30 to 50 per cent off in every parameter.
   function stages_from(k) result(stages)
      integer, intent(in) :: k
      type(stage_t), allocatable :: stages(:)
      real(wp), parameter :: others(4, 2) = reshape([0.007_wp, 0.024_wp, 0.006_wp, 0.18_wp, &
         0.0025_wp, 0.056_wp, 0.002_wp, 0.42_wp], [4, 2])

      stages = case%stages
      if (k > 1) stages(1)%start = others(:, k - 1)
   end function stages_from

   !> Exact responses: three starts, one minimum, for every mesh. Neither model nor derivatives
   !> leave more than round-off, and J is followed to 1e-14, so that 1e-7 standard deviations
   !> remain: 1e-6 in every parameter, c_D included, whose deviation is as large as itself for N =
   !> 2. `fits` becomes what later checks compare with.
   subroutine test_modal_starts()
      type(stage_fit_t), allocatable :: found(:, :)
      type(model_t) :: model
      integer :: s, k, i

      if (.not. allocated(fits)) return
      model = case%model
      deallocate (model%solver)
      model%solver = modal_t()
      do s = 1, 3
         call identify_meshes(model, case%meshes, stages_from(s), samples, measured, found, error)
         if (allocated(error)) then
            call check('modal, start '//to_text(s)//': converges', .false., error%message)
            cycle
         end if
         do k = 1, size(found, 2)
            do i = 1, 4
               if (s == 1) then
                  ! The noise of CVODE at rtol = 1e-9 hardly moves the minimum: what is left is
                  ! where `lmdif` ends. It follows J to rtol^.75 = 2e-7, which is sqrt(45*2e-7) =
                  ! 3e-3 standard errors. Forward differences are wrong by a share of d = .02 to
                  ! .2 % (the noise over a step of 1e-4). They make J seem least up to d sqrt(49) =
                  ! .014 standard errors away. The limit is three times the sum.
                  call check_close('modal against CVODE, N = '//to_text(found(1, k)%elements)// &
                     ': '//names(i)//' in standard errors', (found(1, k)%fit%estimate(i) &
                     - fits(1, k)%fit%estimate(i))/found(1, k)%statistics%std_error(i), 0.0_wp, &
                     5e-2_wp)
               else
                  call check_close('modal, start '//to_text(s)//', N = '// &
                     to_text(found(1, k)%elements)//': '//names(i), &
                     found(1, k)%fit%estimate(i)/fits(1, k)%fit%estimate(i), 1.0_wp, 1e-6_wp)
               end if
            end do
         end do
         if (s == 1) fits = found
      end do
   end subroutine test_modal_starts

   !> CVODE and lmdif as in 1986, at the case's rtol = 1e-11, from the two other starts, one for
   !> N = 3 (in long runs) and one for N = 4 (a search takes some 4 s): the exact minimum. A search
   !> stops when J falls by less than 1e-10, sqrt(45e-10) = 7e-5 standard deviations away; these are
   !> some per cent of m_H, c_H and k_H. (With rtol = 1e-10 the integrator's noise moves c_H by
   !> 1.6e-5.)
   subroutine test_cvode_starts()
      type(stage_fit_t), allocatable :: found(:, :)
      integer :: s, k, i

      if (.not. allocated(fits)) return
      do s = merge(2, 3, in_long_run()), 3
         associate (first => s, last => s)
            call identify_meshes(case%model, case%meshes(first:last), stages_from(s), samples, &
               measured, found, error)
            if (allocated(error)) then
               call check('CVODE, start '//to_text(s)//': converges', .false., error%message)
               cycle
            end if
            do k = first, last
               associate (fit => found(1, k - first + 1)%fit, exact => fits(1, k)%fit)
                  do i = 2, 4
                     call check_close('CVODE, start '//to_text(s)//', N = '//to_text(k + 1)// &
                        ': '//names(i), fit%estimate(i)/exact%estimate(i), 1.0_wp, 1e-5_wp)
                  end do
                  ! Accelerations off by 1e-8 or so (see the record) against residuals of 2e-3.
                  call check_close('CVODE, start '//to_text(s)//', N = '//to_text(k + 1)//': J', &
                     fit%J/exact%J, 1.0_wp, 1e-6_wp)
               end associate
            end do
         end associate
      end do
   end subroutine test_cvode_starts

end program test_table_4_1
