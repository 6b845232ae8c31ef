!> The groups &stage of a case file: free parameters, their start values and bounds. The checks of
!> free parameters also serve the groups &prior and &draw.
module beamid_stage_groups
   use beamid_blocks, only: block_t
   use beamid_excitation, only: excitation_t
   use beamid_identification, only: stage_t
   use beamid_kinds, only: wp
   use beamid_numbers, only: shown
   use beamid_parameter_names, only: group_of, is_there, name_length, name_of_parameter, &
      place_of_name
   use beamid_parameters, only: amplitude, belongs_to_hose, may_be_negative, offset, parameters, &
      share
   use beamid_spelling, only: or_nearest
   use beamid_strings, only: lower, to_text
   use beamid_structure, only: most_coefficients, n_parameters, no_spring, of_w_D, of_x_F, &
      structure_t
   use beamid_values, only: listed, range_t
   use beamid_variables, only: unbounded
   use beamid_variations, only: constant, field_t, known_c_D, known_E
   implicit none
   private

   public :: read_stage, check_free, narrowest_dip

   !> Largest number of names in a stage: every parameter and E(x) and c_D(x), with room to spare.
   integer, parameter :: most_free = n_parameters + 4

contains

   !> Reads a group &stage.
   !>
   !> structure    of the case; a stage may make E or c_D vary along the beam
   !> excitations  of the case
   !> records      number of records; a parameter that is not shared has a value for each
   !> elements     of the coarsest mesh
   !> sound        whether no earlier group had a problem
   subroutine read_stage(block, structure, excitations, records, elements, sound, found)
      type(block_t), intent(inout) :: block
      type(structure_t), intent(inout) :: structure
      type(excitation_t), intent(in) :: excitations(:)
      integer, intent(in) :: records, elements
      logical, intent(in) :: sound
      type(stage_t), intent(out) :: found
      character(len=:), allocatable :: free(:), shared(:), kind
      character(len=4) :: word
      integer, allocatable :: places(:)
      integer :: coefficients, k

      call block%get('free', free, '', 'names of the parameters that are estimated', most_free, &
         required=.true.)
      call block%get('shared', shared, 'all in free', &
         'names of the free parameters that all records have in common', most_free)
      call block%get('start', found%start, &
         'estimates of the previous stage; first stage: ''case'', or ''auto'' with '// &
         'kind=''free''', 'start values, one for each name in free; ''auto'': values from the '// &
         'spectral lines of the record; ''case'': the values of the case', most_free, &
         ['auto', 'case'], word)
      found%automatic = word == 'auto'
      found%declared = word == 'case'
      call block%get('lower', found%lower, '0, or none for T, amplitude and offset', &
         'lower bounds, one for each name in free', most_free)
      call block%get('upper', found%upper, 'none', &
         'upper bounds, one for each name in free', most_free)
      coefficients = 16
      kind = 'spline'
      call block%get('coefficients', coefficients, 'number of coefficients of E(x) and of '// &
         'c_D(x)', range_t(4, most_coefficients))
      call block%get('kind', kind, 'form of E(x) and c_D(x): ''spline'', a cubic spline; '// &
         '''linear'', straight lines', &
         [character(len=6) :: 'spline', 'linear'])
      call block%close()
      if (block%failed()) return
      call check_count(block, 'start', found%start, size(free))
      call check_count(block, 'lower', found%lower, size(free))
      call check_count(block, 'upper', found%upper, size(free))
      if (.not. allocated(shared)) shared = free
      call spread_along(block, structure, coefficients, kind, found, free, shared)
      if (block%failed()) return
      call find_free(block, structure, free, found%free)
      places = place_of_name(structure, shared)
      do k = 1, size(shared)
         if (any(found%free == places(k))) cycle
         call block%refuse('shared', shown(shared(k)), 'parameters that are free')
      end do
      if (.not. block%failed()) call check_bounds(block, structure, elements, found)
      if (sound .and. .not. block%failed()) call check_free(block, found%free, structure, &
         excitations, 'free')
      if (block%failed()) return
      found%offset = any(found%free == offset)
      call found%distribute(places, records)
   end subroutine read_stage

   !> Finds the parameters that a stage frees, and refuses unknown and repeated names.
   !>
   !> names   names as given
   !> places  (size of names) places among the `parameters`; 0: unknown
   subroutine find_free(block, structure, names, places)
      type(block_t), intent(inout) :: block
      type(structure_t), intent(in) :: structure
      character(len=*), intent(in) :: names(:)
      integer, allocatable, intent(out) :: places(:)
      character(len=name_length), allocatable :: known(:)
      character(len=:), allocatable :: suggestion
      integer :: k

      places = place_of_name(structure, names)
      do k = 1, size(names)
         if (places(k) == 0 .and. .not. any(names(:k - 1) == names(k))) then
            known = pack(name_of_parameter(structure, parameters%place), parameters%is_free .and. &
               is_there(structure, parameters%place))
            call or_nearest(names(k), known, suggestion)
            call block%refuse('free', shown(names(k)), 'one of '//listed(known, ' ')// &
               ' E(x) c_D(x)'//suggestion)
         else if (places(k) > 0 .and. count(places(:k - 1) == places(k)) == 1) then
            call block%refuse('free', shown(names(k))//' twice', 'each parameter once')
         end if
      end do
   end subroutine find_free

   !> Replaces E(x) and c_D(x) in a stage by their spline coefficients E.1, E.2, ..., and their
   !> start values and bounds by as many equal ones. All records share these coefficients.
   !>
   !> coefficients, kind  of the fields, as given in the stage
   !> free, shared        names of the free and of the shared parameters
   subroutine spread_along(block, structure, coefficients, kind, stage, free, shared)
      type(block_t), intent(inout) :: block
      type(structure_t), intent(inout) :: structure
      integer, intent(in) :: coefficients
      character(len=*), intent(in) :: kind
      type(stage_t), intent(inout) :: stage
      character(len=:), allocatable, intent(inout) :: free(:), shared(:)
      character(len=*), parameter :: fields(2) = [character(len=3) :: 'E', 'c_D']
      character(len=len(free)), allocatable :: names(:)
      character(len=name_length) :: field
      integer :: a, j, k
      logical :: known(size(fields)), any_field

      known = [structure%variations%known(known_E)%kind /= constant .or. structure%has_dip(), &
         structure%variations%known(known_c_D)%kind /= constant]
      any_field = .false.
      do a = 1, size(fields)
         field = trim(fields(a))//'(x)'
         if (count(lower_all(free) == lower(field)) > 1) call block%refuse('free', &
            shown(trim(field))//' twice', 'each parameter once')
         if (block%failed()) return
         k = findloc(lower_all(free) == lower(field), .true., dim=1)
         if (k == 0) cycle
         any_field = .true.
         call prepare_field(block, trim(field), coefficients, kind, known(a), &
            structure%variations%along(a))
         if (block%failed()) return
         allocate (names(coefficients))
         do j = 1, coefficients
            names(j) = trim(fields(a))//'.'//to_text(j)
         end do
         call spread_value(stage%start, k, coefficients)
         call spread_value(stage%lower, k, coefficients)
         call spread_value(stage%upper, k, coefficients)
         call spread_name(shared, lower(field), names)
         call spread_name(free, lower(field), names)
         deallocate (names)
      end do
      do a = 1, size(fields)
         if (structure%variations%along(a)%coefficients > 0 .and. &
            any(lower_all(free) == lower(fields(a)))) call block%refuse('free', &
            trim(fields(a))//' beside '//trim(fields(a))//'(x)', 'one of them')
      end do
      if (any_field) return
      call block%exclude('coefficients', 'without E(x) or c_D(x) in free')
      call block%exclude('kind', 'without E(x) or c_D(x) in free')
   end subroutine spread_along

   !> Replaces a name in a list by several names; appends them if the list lacks the name.
   !>
   !> name  in lower case
   subroutine spread_name(list, name, names)
      character(len=:), allocatable, intent(inout) :: list(:)
      character(len=*), intent(in) :: name, names(:)
      integer :: k

      k = findloc(lower_all(list) == name, .true., dim=1)
      if (k == 0) k = size(list) + 1
      list = [character(len=len(list)) :: list(:k - 1), names, list(k + 1:)]
   end subroutine spread_name

   !> Returns names in lower case.
   pure function lower_all(names) result(small)
      character(len=*), intent(in) :: names(:)
      character(len=len(names)) :: small(size(names))
      integer :: k

      do k = 1, size(names)
         small(k) = lower(names(k))
      end do
   end function lower_all

   !> Replaces value k of a list by as many equal values.
   subroutine spread_value(values, k, times)
      real(wp), allocatable, intent(inout) :: values(:)
      integer, intent(in) :: k, times

      if (allocated(values)) values = [values(:k - 1), spread(values(k), 1, times), values(k + 1:)]
   end subroutine spread_value

   !> Makes E or c_D a field along the beam with unknown coefficients. All stages must use the same
   !> number and kind of coefficients.
   !>
   !> name   'E(x)' or 'c_D(x)'
   !> known  whether a group &along already defines the property along the beam
   subroutine prepare_field(block, name, coefficients, kind, known, field)
      type(block_t), intent(inout) :: block
      character(len=*), intent(in) :: name, kind
      integer, intent(in) :: coefficients
      logical, intent(in) :: known
      type(field_t), intent(inout) :: field
      integer :: degree

      degree = merge(3, 1, kind == 'spline')
      if (known) call block%refuse('free', name//' beside &along of the same parameter', &
         'one of them')
      if (field%coefficients > 0 .and. (field%coefficients /= coefficients .or. &
         field%degree /= degree)) call block%refuse('coefficients', to_text(coefficients)// &
         ' of kind '//kind, 'the same number and kind in all stages')
      field%coefficients = coefficients
      field%degree = degree
   end subroutine prepare_field

   !> Refuses a list of numbers that has not one for each free parameter.
   subroutine check_count(block, key, values, n)
      type(block_t), intent(inout) :: block
      character(len=*), intent(in) :: key
      real(wp), allocatable, intent(in) :: values(:)
      integer, intent(in) :: n

      if (.not. allocated(values)) return
      if (size(values) /= n) call block%refuse(key, to_text(size(values))//' values', &
         to_text(n)//', one for each of free')
   end subroutine check_count

   !> Returns the width of the narrowest dip that a mesh resolves: half an element [length].
   pure real(wp) function narrowest_dip(structure, elements) result(width)
      type(structure_t), intent(in) :: structure
      integer, intent(in) :: elements

      width = structure%length/(2*real(elements, wp))
   end function narrowest_dip

   !> Sets the default bounds; refuses bounds that are not allowed or not in order, and start values
   !> outside them.
   subroutine check_bounds(block, structure, elements, stage)
      type(block_t), intent(inout) :: block
      type(structure_t), intent(in) :: structure
      integer, intent(in) :: elements
      type(stage_t), intent(inout) :: stage
      character(len=:), allocatable :: larger
      integer :: k

      call stage%set_bounds()
      do k = 1, size(stage%free)
         associate (p => stage%free(k), lower => stage%lower(k), upper => stage%upper(k))
            if (p == of_w_D .and. .not. lower > 0) lower = narrowest_dip(structure, elements)
            if (p == of_w_D .and. lower < narrowest_dip(structure, elements)) then
               call block%refuse('lower', to_text(lower)//' for width', 'half an element, '// &
                  to_text(narrowest_dip(structure, elements))//', or more')
            else if (lower < 0 .and. .not. may_be_negative(p)) then
               call block%refuse('lower', to_text(lower), '0 or more')
            else if (parameters(p)%range == share .and. upper >= 1) then
               call block%refuse('upper', to_text(upper)//' for '//trim(name_of_parameter( &
                  structure, p)), 'less than 1')
            else if (upper <= lower) then
               call block%refuse('upper', to_text(upper), 'more than lower = '//to_text(lower))
            else if (allocated(stage%start)) then
               larger = 'any larger one'
               if (upper < unbounded) larger = to_text(upper)
               if (parameters(p)%is_reciprocal .and. .not. stage%start(k) > 0) call block%refuse( &
                  'start', to_text(stage%start(k))//' for '//trim(name_of_parameter(structure, &
                  p)), 'a value above 0')
               if (stage%start(k) < lower .or. stage%start(k) > upper) call block%refuse('start', &
                  to_text(stage%start(k))//' for '//trim(name_of_parameter(structure, p)), &
                  'a value between '//to_text(lower)//' and '//larger)
            end if
         end associate
      end do
   end subroutine check_bounds

   !> Refuses free parameters that have no effect or no start value in this case, for example a
   !> parameter of a hose that is absent.
   !>
   !> free  places among the `parameters`
   !> key   key of the group that names them, for the message
   subroutine check_free(block, free, structure, excitations, key)
      type(block_t), intent(inout) :: block
      integer, intent(in) :: free(:)
      type(structure_t), intent(in) :: structure
      type(excitation_t), intent(in) :: excitations(:)
      character(len=*), intent(in) :: key
      character(len=:), allocatable :: lacking
      integer :: k, needs

      do k = 1, size(free)
         lacking = ''
         needs = parameters(free(k))%needs
         if (needs > 0) then
            if (.not. (structure%get(needs) > 0 .or. any(free == needs))) lacking = &
               'a value of '// &
               trim(parameters(needs)%name)//' in &'//group_of(structure, needs)//' for it'
         end if
         if (parameters(free(k))%is_reciprocal) then
            if (structure%get(free(k)) >= no_spring) lacking = 'a value above 0 to start from'
         end if
         if (free(k) == amplitude .and. any(excitations%modes > 0)) &
            lacking = 'no amplitude beside a free start'
         if (free(k) == of_x_F .and. any(excitations%modes > 0 .or. excitations%is_base .or. &
            excitations%distributed)) lacking = 'a force at a point for it'
         if (belongs_to_hose(free(k))) then
            if (.not. structure%hose(parameters(free(k))%item)%m_H > 0) &
               lacking = 'a &hose group with m_H > 0 for it'
         end if
         if (lacking == '') cycle
         call block%refuse(key, shown(name_of_parameter(structure, free(k))), lacking)
         return
      end do
   end subroutine check_free

end module beamid_stage_groups
