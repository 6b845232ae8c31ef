!> Checks of a case's records and stages against one another, once the records are loaded: the
!> channels of one motion, and the positions and lengths that a stage frees.
module beamid_experiment_checks
   use beamid_case_files, only: case_t
   use beamid_errors, only: error_t
   use beamid_experiments, only: experiment_t
   use beamid_kinds, only: wp
   use beamid_parameter_names, only: is_there, name_of_parameter
   use beamid_parameters, only: on_beam, parameters
   use beamid_refusals, only: refuse
   use beamid_strings, only: to_text
   use beamid_structure, only: n_parameters, of_length, same_structure, structure_t
   implicit none
   private

   public :: check_channels, check_free_places

contains

   !> Checks that the channels of each motion follow one another and share beam, start and
   !> parameters.
   !>
   !> experiments  (records) in the order of the case file
   !> error        channels of one motion that are not consecutive, that have different beams or
   !>              different numbers of modes with unknown start, or a parameter not shared by all
   subroutine check_channels(case, experiments, error)
      type(case_t), intent(in) :: case
      type(experiment_t), intent(in) :: experiments(:)
      type(error_t), allocatable, intent(out) :: error
      type(structure_t) :: first, other
      integer :: j, k, p

      do k = 2, size(experiments)
         associate (number => experiments(k)%motion, line => case%recordings(k)%line)
            j = findloc(experiments(:k - 1)%motion, number, dim=1)
            if (number == 0 .or. j == 0) cycle
            first = experiments(j)%structure_of(case%model%structure)
            other = experiments(k)%structure_of(case%model%structure)
            other%observer = first%observer
            if (experiments(k - 1)%motion /= number) then
               call refuse(case%path, line, 'record experiment', to_text(number)//' again', &
                  'the records of one experiment in consecutive groups', error)
            else if (.not. same_structure(first, other)) then
               call refuse(case%path, line, 'record experiment', to_text(number)// &
                  ' with another beam than record '//to_text(j), 'the same beam', error)
            else if (experiments(k)%excitation%modes /= experiments(j)%excitation%modes) then
               call refuse(case%path, line, 'record experiment', to_text(number)// &
                  ' with another excitation than record '//to_text(j), 'the same', error)
            end if
         end associate
         do p = 1, size(case%stages)
            if (allocated(error)) return
            if (any(case%stages(p)%owners() > 0)) call refuse(case%path, case%stage_lines(p), &
               'stage shared', 'parameters that are not shared, beside channels of one '// &
               'experiment', 'all free parameters', error)
         end do
         if (allocated(error)) return
      end do
   end subroutine check_channels

   !> Checks start values and bounds of free positions and lengths against every beam: a position
   !> must lie on the beam, and the beam must reach everything mounted on it.
   !>
   !> experiments  (records) in the order of the case file
   !> error        of the first stage, parameter and record that do not fit
   subroutine check_free_places(case, experiments, error)
      type(case_t), intent(in) :: case
      type(experiment_t), intent(in) :: experiments(:)
      type(error_t), allocatable, intent(out) :: error
      logical :: length_is_free   ! in this stage or an earlier one
      integer :: i, k, p

      length_is_free = .false.
      do k = 1, size(case%stages)
         associate (stage => case%stages(k))
            length_is_free = length_is_free .or. any(stage%free == of_length)
            do p = 1, size(stage%free)
               do i = 1, size(experiments)
                  if (any(stage%record(p) == [0, i])) call check_place(stage%free(p))
                  if (allocated(error)) return
               end do
            end do
         end associate
      end do

   contains

      !> Checks parameter p of stage k in record i.
      !>
      !> q  index of that parameter in `parameters`
      subroutine check_place(q)
         integer, intent(in) :: q
         type(structure_t) :: structure
         real(wp) :: least

         structure = experiments(i)%structure_of(case%model%structure)
         associate (stage => case%stages(k))
            if (stage%record(p) == 0 .and. differs(q, structure)) then
               call refuse(case%path, case%stage_lines(k), 'stage free', trim(name_of_parameter( &
                  structure, q))//' shared by records that give it different values', &
                  'the parameter left out of shared, or one value', error)
            else if (q == of_length) then
               least = outermost(structure, stage%free)
               if (stage%upper(p) <= least) call refuse_value('upper', stage%upper, &
                  'more than '//to_text(least)//', the outermost position on the beam')
               if (.not. allocated(stage%start)) return
               if (stage%start(p) < least) call refuse_value('start', stage%start, &
                  'at least '//to_text(least)//', the outermost position on the beam')
            else if (parameters(q)%range == on_beam) then
               if (stage%lower(p) >= structure%length) call refuse_value('lower', stage%lower, &
                  'less than the length '//to_text(structure%length)//' of the beam')
               if (length_is_free .or. .not. allocated(stage%start)) return
               if (stage%start(p) > structure%length) call refuse_value('start', stage%start, &
                  'at most the length '//to_text(structure%length)//' of the beam')
            end if
         end associate
      end subroutine check_place

      !> Sets `error` to a refusal of the start value or bound of parameter p of stage k.
      !>
      !> key       'start', 'lower' or 'upper'
      !> values    (free parameters) of that key
      !> expected  condition that the value violates, in words
      subroutine refuse_value(key, values, expected)
         character(len=*), intent(in) :: key, expected
         real(wp), intent(in) :: values(:)

         call refuse(case%path, case%stage_lines(k), 'stage '//key, to_text(values(p))//' for '// &
            trim(name_of_parameter(case%model%structure, case%stages(k)%free(p))), expected, error)
      end subroutine refuse_value

      !> Returns whether parameter q of `structure`, the beam of record i, has another value than in
      !> the first record; .false. for a sensor that does not make record i.
      logical function differs(q, structure)
         integer, intent(in) :: q
         type(structure_t), intent(in) :: structure
         type(structure_t) :: first

         differs = .false.
         if (q > n_parameters) return
         if (parameters(q)%group == 'sensor' .and. parameters(q)%item /= experiments(i)%sensor) &
            return
         first = experiments(1)%structure_of(case%model%structure)
         differs = abs(structure%get(q) - first%get(q)) > 0
      end function differs

   end subroutine check_free_places

   !> Returns the position nearest to the tip [length] of anything mounted on the beam that neither
   !> moves with the tip nor has a free position.
   !>
   !> free  indices in `parameters` of the free parameters
   pure real(wp) function outermost(structure, free)
      type(structure_t), intent(in) :: structure
      integer, intent(in) :: free(:)
      integer :: k

      outermost = 0
      do k = 1, n_parameters
         if (parameters(k)%range /= on_beam .or. .not. is_there(structure, k)) cycle
         if (.not. (structure%follows_tip(k) .or. any(free == k))) &
            outermost = max(outermost, structure%get(k))
      end do
   end function outermost

end module beamid_experiment_checks
