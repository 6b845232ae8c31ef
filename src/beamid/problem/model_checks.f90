!> Refuses models, experiments and stages from which nothing can be computed. The reader of a case
!> file finds such mistakes by itself; a Fortran program may make them.
module beamid_model_checks
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use beamid_errors, only: bad_input, error_t
   use beamid_excitation, only: excitation_t
   use beamid_experiments, only: experiment_t
   use beamid_kinds, only: wp
   use beamid_parameters, only: key_of, parameters
   use beamid_responses, only: solver_t
   use beamid_strings, only: to_text
   use beamid_structure, only: structure_t
   use beamid_structure_checks, only: check_structure
   use beamid_unknowns, only: stage_t
   implicit none
   private

   public :: check_model, check_experiments, check_stage, check_times

contains

   !> Refuses a model without a solver, an excitation without times and without free modes, and a
   !> structure with a value out of its range.
   !>
   !> excitation  of the structure, which may differ from that of the model
   !> error       what was found, and what is expected
   subroutine check_model(structure, solver, excitation, error)
      type(structure_t), intent(in) :: structure
      class(solver_t), allocatable, intent(in) :: solver
      type(excitation_t), intent(in) :: excitation
      type(error_t), allocatable, intent(out) :: error

      if (.not. allocated(solver)) then
         call bad_input(error, 'found a model without a solver, expected modal_t() or cvode_t()')
      else if (.not. allocated(excitation%t) .and. excitation%modes == 0) then
         call bad_input(error, 'found an excitation without times, expected one of new_pulse, '// &
            'new_release, new_force_table or new_free')
      else
         call check_structure(structure, error)
      end if
   end subroutine check_model

   !> Refuses experiments whose samples and times do not fit together, or whose model is refused by
   !> `check_model`.
   subroutine check_experiments(structure, solver, experiments, error)
      type(structure_t), intent(in) :: structure
      class(solver_t), allocatable, intent(in) :: solver
      type(experiment_t), intent(in) :: experiments(:)
      type(error_t), allocatable, intent(out) :: error
      character(len=:), allocatable :: record
      integer :: r

      do r = 1, size(experiments)
         record = 'record '//to_text(r)//': '
         associate (one => experiments(r))
            if (.not. allocated(one%measured)) then
               call bad_input(error, record//'found no values (measured), expected some')
            else if (.not. all(ieee_is_finite(one%measured))) then
               call bad_input(error, record//'found no finite value in sample '//to_text(findloc( &
                  ieee_is_finite(one%measured), .false., dim=1))//', expected finite numbers')
            else if (one%sensor < 1 .or. one%sensor > max(1, structure%sensors)) then
               call bad_input(error, record//'found sensor '//to_text(one%sensor)//' of '// &
                  to_text(structure%sensors)//', expected one that the structure has')
            else if (.not. allocated(one%observed)) then
               if (.not. allocated(one%samples)) then
                  call bad_input(error, record//'found no times (samples), expected one for '// &
                     'each value')
               else if (size(one%samples) /= size(one%measured)) then
                  call bad_input(error, record//'found '//to_text(size(one%samples))// &
                     ' times (samples) and '//to_text(size(one%measured))// &
                     ' values (measured), expected as many of either')
               else
                  call check_times(one%samples, record, error)
               end if
            end if
            if (.not. allocated(error)) call check_model(one%structure_of(structure), solver, &
               one%excitation, error)
         end associate
         if (allocated(error)) return
      end do
   end subroutine check_experiments

   !> Refuses a stage with a free parameter that does not exist or is free twice, a stage without
   !> any unknown, and components `start`, `lower`, `upper` or `record` whose size is not that of
   !> `free`.
   !>
   !> has_unknown  whether the fit has other unknowns than the free parameters, such as amplitudes
   !> error        what was found, and what is expected
   subroutine check_stage(stage, has_unknown, error)
      type(stage_t), intent(in) :: stage
      logical, intent(in) :: has_unknown
      type(error_t), allocatable, intent(out) :: error
      integer, allocatable :: free(:), record(:), sizes(:)
      integer :: k, n

      allocate (free(0), sizes(0))
      if (allocated(stage%free)) free = stage%free
      if (allocated(stage%start)) sizes = [sizes, size(stage%start)]
      if (allocated(stage%lower)) sizes = [sizes, size(stage%lower)]
      if (allocated(stage%upper)) sizes = [sizes, size(stage%upper)]
      if (allocated(stage%record)) sizes = [sizes, size(stage%record)]
      n = size(free)
      if (any(sizes /= n)) then
         k = findloc(sizes /= n, .true., dim=1)
         call bad_input(error, 'found '//to_text(sizes(k))//' values in start, lower, upper or '// &
            'record of the stage, expected '//to_text(n)//', as many as in free')
         return
      end if
      record = spread(0, 1, n)
      if (allocated(stage%record)) record = stage%record
      if (n == 0 .and. .not. (has_unknown .or. stage%offset)) call bad_input(error, &
         'found no free parameter, expected at least one')
      do k = 1, size(free)
         if (free(k) < 1 .or. free(k) > size(parameters)) then
            call bad_input(error, 'found '//to_text(free(k))//' as a free parameter, expected '// &
               'a number from free_index, which is 0 for an unknown name')
         else if (any(free(:k - 1) == free(k) .and. record(:k - 1) == record(k))) then
            call bad_input(error, 'found '//key_of(free(k))//' twice among the free '// &
               'parameters, expected it once')
         end if
         if (allocated(error)) return
      end do
   end subroutine check_stage

   !> Refuses times that are not finite or do not increase.
   !>
   !> place  beginning of the message
   subroutine check_times(t, place, error)
      real(wp), intent(in) :: t(:)
      character(len=*), intent(in) :: place
      type(error_t), allocatable, intent(out) :: error
      integer :: k

      do k = 1, size(t)
         if (.not. ieee_is_finite(t(k))) then
            call bad_input(error, place//'found no finite time of sample '//to_text(k)// &
               ', expected a finite number')
            return
         end if
      end do
      do k = 2, size(t)
         if (t(k) > t(k - 1)) cycle
         call bad_input(error, place//'found time '//to_text(t(k))//' of sample '//to_text(k)// &
            ', not after that of the sample before it, expected times that increase')
         return
      end do
   end subroutine check_times

end module beamid_model_checks
