!> What a stage makes of its parameters: where they start, and how far they may go.
program test_unknowns
   use beamid_errors, only: error_t, status_bad_input
   use beamid_excitation, only: new_pulse
   use beamid_kinds, only: wp
   use beamid_structure, only: sensor_t, structure_t, support_t, x_P_at
   use beamid_unknowns, only: quantity_t, stage_t, variables_of, scenario_t
   use beamid_variables, only: unbounded, variable_t
   use checks, only: check, check_close, finish
   use models, only: stage_of
   implicit none

   !> A beam of 4 with a sensor at 3 and a support at 2.
   type(structure_t), parameter :: beam = structure_t(length=4, rho=0.03_wp, E=80, I=1, &
      sensors=1, sensor=sensor_t(x_S=3), supports=1, support=support_t(x_P=2))

   call test_alone()
   call test_halfway()
   call test_bounds()
   call test_nothing_left()
   call test_records()
   call finish('unknowns')

contains

   !> Ranges are copies of the structure's numbers and their means: exact, all of them.
   subroutine check_range(what, quantity, lower, upper)
      character(len=*), intent(in) :: what
      type(quantity_t), intent(in) :: quantity
      real(wp), intent(in) :: lower, upper

      call check_close(what//', lower', quantity%lower, lower, 0.0_wp)
      call check_close(what//', upper', quantity%upper, upper, 0.0_wp)
   end subroutine check_range

   subroutine ranges(stage, structures, quantities, error)
      type(stage_t), intent(in) :: stage
      type(structure_t), intent(in) :: structures(:)
      type(quantity_t), allocatable, intent(out) :: quantities(:)
      type(error_t), allocatable, intent(out) :: error
      type(variable_t), allocatable :: variables(:)
      type(scenario_t) :: scenario
      integer :: k

      scenario%structures = structures
      allocate (scenario%excitations(size(structures)))
      do k = 1, size(structures)
         scenario%excitations(k) = new_pulse(1.0_wp, 0.1_wp)
      end do
      call variables_of(stage, scenario, variables, quantities, error)
      if (allocated(error)) return
      call check('starts inside', all(quantities%start > quantities%lower .and. &
         quantities%start < quantities%upper))
   end subroutine ranges

   !> One of them moves: the length down to the outermost place, a place up to the end; a support
   !> down to a thousandth of the length.
   subroutine test_alone()
      type(quantity_t), allocatable :: q(:)
      type(stage_t) :: stage
      type(error_t), allocatable :: error

      call ranges(stage_of(['length']), [beam], q, error)
      call check_range('length alone', q(1), 3.0_wp, unbounded)
      call ranges(stage_of(['x_S']), [beam], q, error)
      call check_range('x_S alone', q(1), 0.0_wp, 4.0_wp)
      stage = stage_of(['x_S'])
      stage%free = [x_P_at(1)]
      call ranges(stage, [beam], q, error)
      call check_range('x_P alone', q(1), 4e-3_wp, 4.0_wp)
   end subroutine test_alone

   !> Where length and place move they meet halfway between their starts in this stage, whatever the
   !> structure's own values are; without starts, halfway between these.
   subroutine test_halfway()
      type(quantity_t), allocatable :: q(:)
      type(stage_t) :: stage
      type(error_t), allocatable :: error

      call ranges(stage_of(['length', 'x_S   ']), [beam], q, error)
      call check_range('no starts: length', q(1), 3.5_wp, unbounded)
      call check_range('no starts: x_S', q(2), 0.0_wp, 3.5_wp)
      call ranges(stage_of(['length', 'x_S   '], [6.0_wp, 5.0_wp]), [beam], q, error)
      call check_range('starts beyond the beam: length', q(1), 5.5_wp, unbounded)
      call check_range('starts beyond the beam: x_S', q(2), 0.0_wp, 5.5_wp)
      call check_close('starts beyond the beam: x_S starts there', q(2)%start, 5.0_wp, 0.0_wp)
      stage = stage_of(['x_S   ', 'length'], [1.0_wp, 3.5_wp])
      stage%free(1) = x_P_at(1)
      call ranges(stage, [beam], q, error)
      call check_range('support: length', q(2), 3.0_wp, unbounded)
      call check_range('support: x_P', q(1), 1e-3_wp*3.5_wp, 2.25_wp)
   end subroutine test_halfway

   !> Bounds of the user are kept: a value that lies outside of them starts at the nearest, and
   !> halfway is reckoned from there.
   subroutine test_bounds()
      type(quantity_t), allocatable :: q(:)
      type(stage_t) :: stage
      type(error_t), allocatable :: error

      stage = stage_of(['length', 'x_S   '])
      stage%lower = [4.5_wp, 3.75_wp]
      stage%upper = [5.0_wp, 4.25_wp]
      call ranges(stage, [beam], q, error)
      call check('bounds beyond halfway of the beam: no error', .not. allocated(error))
      if (allocated(error)) return
      call check_range('bounds beyond halfway of the beam: length', q(1), 4.5_wp, 5.0_wp)
      call check_range('bounds beyond halfway of the beam: x_S', q(2), 3.75_wp, 4.125_wp)
   end subroutine test_bounds

   !> A place that may only lie beyond the longest beam.
   subroutine test_nothing_left()
      type(quantity_t), allocatable :: q(:)
      type(stage_t) :: stage
      type(error_t), allocatable :: error

      stage = stage_of(['length', 'x_S   '], [3.0_wp, 5.0_wp])
      stage%lower(2) = 4.5_wp
      call ranges(stage, [beam], q, error)
      call check('nothing between the bounds: refused', allocated(error))
      if (.not. allocated(error)) return
      call check('and says so', error%status == status_bad_input .and. index(error%message, &
         'x_S: found nothing between its lower bound 4.5 and its upper bound 4, expected') == 1, &
         error%message)
   end subroutine test_nothing_left

   !> Two beams, the second shorter: a shared place must lie on both, one of the second alone on
   !> that.
   subroutine test_records()
      type(quantity_t), allocatable :: q(:)
      type(stage_t) :: stage
      type(structure_t) :: beams(2)
      type(error_t), allocatable :: error

      beams = beam
      beams(2)%length = 3.5_wp
      call ranges(stage_of(['x_S']), beams, q, error)
      call check_range('shared x_S', q(1), 0.0_wp, 3.5_wp)
      stage = stage_of(['x_S', 'x_S'])
      stage%record = [1, 2]
      call ranges(stage, beams, q, error)
      call check_range('x_S of the first', q(1), 0.0_wp, 4.0_wp)
      call check_range('x_S of the second', q(2), 0.0_wp, 3.5_wp)
      call check('with their records', q(1)%name == 'x_S(1)' .and. q(2)%name == 'x_S(2)')
   end subroutine test_records

end program test_unknowns
