!> What a fit searches for, and where the values go: parameters that several records share, and
!> parameters of one record alone.
module beamid_unknowns
   use beamid_errors, only: bad_input, error_t
   use beamid_excitation, only: excitation_t
   use beamid_kinds, only: wp
   use beamid_parameters, only: as_named, free_magnitude, get_free, is_there, may_be_negative, &
      name_of_parameter, offset, on_beam, parameters, parameter_name_length => name_length, &
      set_free, share
   use beamid_strings, only: to_text
   use beamid_structure, only: is_coefficient, n_parameters, of_length, of_w_D, structure_t, x_P_at
   use beamid_variables, only: new_variable, unbounded, variable_t
   implicit none
   private

   public :: stage_t, scenario_t, quantity_t, name_of, variables_of, name_length

   !> Of the name of a quantity.
   integer, parameter :: name_length = parameter_name_length + 8

   !> One search: which parameters are free and from where. Each array has one entry per parameter.
   type :: stage_t
      integer, allocatable :: free(:)     !< places among the `parameters`
      !> the record that a parameter belongs to, 0: all of them; not allocated: all shared
      integer, allocatable :: record(:)
      !> not allocated: where the stage before ended. Starts and bounds are those of what a
      !> parameter is named for: of a stiffness, also where the search looks for its reciprocal.
      real(wp), allocatable :: start(:)
      !> not allocated: 0, and no bound of what may be negative
      real(wp), allocatable :: lower(:)
      real(wp), allocatable :: upper(:)   !< not allocated: no bounds
      logical :: offset = .false.         !< the sensor's offset is unknown, in each record
      logical :: automatic = .false.      !< start values come from the record
      logical :: declared = .false.       !< they are those of the case, whatever the default is
   contains
      procedure :: without
      procedure :: owners
      procedure :: set_bounds
      procedure :: distribute
   end type stage_t

   !> Structure and excitation in each record.
   type :: scenario_t
      type(structure_t), allocatable :: structures(:)
      type(excitation_t), allocatable :: excitations(:)
   contains
      procedure :: set
      procedure :: range_on_beam
   end type scenario_t

   !> Something that was estimated.
   type :: quantity_t
      character(len=name_length) :: name = ''
      integer :: parameter = 0            !< place among the `parameters`; 0: motion of a mode
      integer :: record = 0               !< 0: all of them
      real(wp) :: start = 0, value = 0, lower = 0, upper = 0
      !> Of what was searched for, which may be the reciprocal; statistics are about it.
      real(wp) :: searched = 0
      real(wp) :: scale = 1               !< what relative changes of it are relative to, > 0
   contains
      procedure :: limits
      procedure :: ends
      procedure :: moved
      procedure :: is_reciprocal
      procedure :: searched_name
   end type quantity_t

contains

   !> Bounds that were not given.
   pure subroutine set_bounds(self)
      class(stage_t), intent(inout) :: self

      if (.not. allocated(self%lower)) self%lower = merge(-unbounded, 0.0_wp, &
         may_be_negative(self%free))
      if (.not. allocated(self%upper)) self%upper = merge(0.99_wp, unbounded, &
         parameters(self%free)%range == share)
   end subroutine set_bounds

   !> Gives a parameter that is not shared a place for each record, and takes the offset, which
   !> enters linearly, from the list.
   !>
   !> shared   places of the parameters that all records have in common
   !> records  their number
   pure subroutine distribute(self, shared, records)
      class(stage_t), intent(inout) :: self
      integer, intent(in) :: shared(:), records
      integer, allocatable :: from(:), record(:)
      integer :: k, r

      call self%set_bounds()
      allocate (from(0), record(0))
      do k = 1, size(self%free)
         if (self%free(k) == offset) cycle
         if (records < 2 .or. any(shared == self%free(k))) then
            from = [from, k]
            record = [record, 0]
         else
            from = [from, [(k, r=1, records)]]
            record = [record, [(r, r=1, records)]]
         end if
      end do
      self%free = self%free(from)
      self%record = record
      self%lower = self%lower(from)
      self%upper = self%upper(from)
      if (allocated(self%start)) self%start = self%start(from)
   end subroutine distribute

   !> A stage that leaves some of its parameters alone.
   pure type(stage_t) function without(self, lost) result(rest)
      class(stage_t), intent(in) :: self
      logical, intent(in) :: lost(:)

      rest = self
      call rest%set_bounds()
      if (allocated(self%start)) rest%start = pack(self%start, .not. lost)
      rest%record = pack(self%owners(), .not. lost)
      rest%free = pack(self%free, .not. lost)
      rest%lower = pack(rest%lower, .not. lost)
      rest%upper = pack(rest%upper, .not. lost)
   end function without

   !> The record of each parameter.
   pure function owners(self)
      class(stage_t), intent(in) :: self
      integer :: owners(size(self%free))

      owners = 0
      if (allocated(self%record)) owners = self%record
   end function owners

   !> Gives a parameter a value, in one record or in all.
   pure subroutine set(self, parameter, record, value)
      class(scenario_t), intent(inout) :: self
      integer, intent(in) :: parameter, record
      real(wp), intent(in) :: value
      integer :: r

      do r = 1, size(self%structures)
         if (record > 0 .and. r /= record) cycle
         call set_free(self%structures(r), self%excitations(r), parameter, value)
      end do
   end subroutine set

   !> The range in which everything stays on every beam of a record, or of all: of a place up to the
   !> end, of the length down to the outermost place. Where both move they meet halfway between the
   !> values that they have. A dip that is wider than the beam is none.
   !>
   !> free  parameters that move
   pure function range_on_beam(self, parameter, record, free) result(range)
      class(scenario_t), intent(in) :: self
      integer, intent(in) :: parameter, record, free(:)
      real(wp) :: range(2)
      integer :: k, r

      range = [-unbounded, unbounded]
      do r = 1, size(self%structures)
         if (record > 0 .and. r /= record) cycle
         associate (s => self%structures(r))
            if (parameter == of_w_D) then
               range(2) = min(range(2), s%length)
            else if (parameter == of_length) then
               do k = 1, n_parameters
                  if (parameters(k)%range /= on_beam .or. .not. is_there(s, k)) cycle
                  if (any(free == k)) then
                     range(1) = max(range(1), (s%get(k) + s%length)/2)
                  else if (.not. s%follows_tip(k)) then
                     range(1) = max(range(1), s%get(k))
                  end if
               end do
            else if (parameters(parameter)%range == on_beam) then
               range(2) = min(range(2), merge((s%get(parameter) + s%length)/2, s%length, &
                  any(free == of_length)))
               ! At the clamp a rigid support holds nothing, and what it does cannot be computed.
               if (any(x_P_at == parameter)) range(1) = max(range(1), 1e-3_wp*s%length)
            end if
         end associate
      end do
   end function range_on_beam

   !> A name with the number of its record, where it belongs to one.
   pure function name_of(text, record) result(name)
      character(len=*), intent(in) :: text
      integer, intent(in) :: record
      character(len=name_length) :: name

      name = text
      if (record > 0) name = trim(text)//'('//to_text(record)//')'
   end function name_of

   !> Whether the search looks for the reciprocal.
   elemental logical function is_reciprocal(self)
      class(quantity_t), intent(in) :: self

      is_reciprocal = .false.
      if (self%parameter > 0) is_reciprocal = parameters(self%parameter)%is_reciprocal
   end function is_reciprocal

   !> The name of what the search looks for.
   elemental function searched_name(self) result(name)
      class(quantity_t), intent(in) :: self
      character(len=name_length) :: name

      name = self%name
      if (self%is_reciprocal()) name = '1/'//self%name
   end function searched_name

   !> Standard error and both ends of an interval, the ends within the bounds of the search. Of a
   !> reciprocal they follow from those of what was searched for, and may be infinite.
   !>
   !> std_error, half_width  of what was searched for
   pure function limits(self, std_error, half_width)
      class(quantity_t), intent(in) :: self
      real(wp), intent(in) :: std_error, half_width
      real(wp) :: limits(3)

      limits = [std_error, self%ends([half_width, half_width])]
      if (self%is_reciprocal()) limits(1) = std_error*self%value**2
   end function limits

   !> Both ends of an interval within the bounds of the search.
   !>
   !> distance  of the lower and the upper end of what was searched for
   pure function ends(self, distance)
      class(quantity_t), intent(in) :: self
      real(wp), intent(in) :: distance(2)
      real(wp) :: ends(2)

      ends = self%value + [-distance(1), distance(2)]
      if (self%is_reciprocal()) ends = as_named(self%parameter, [self%searched + distance(2), &
         max(self%searched - distance(1), 0.0_wp)])
      ends(1) = max(ends(1), self%lower)
      if (self%upper < unbounded) ends(2) = min(ends(2), self%upper)
   end function ends

   !> By how much a step of what was searched for moves the value.
   pure real(wp) function moved(self, step)
      class(quantity_t), intent(in) :: self
      real(wp), intent(in) :: step

      moved = step
      if (self%is_reciprocal()) moved = as_named(self%parameter, self%searched + step) - self%value
   end function moved

   !> The range of the reciprocals of positive values.
   pure function reciprocals(range)
      real(wp), intent(in) :: range(2)
      real(wp) :: reciprocals(2)

      reciprocals = [0.0_wp, unbounded]
      if (range(2) < unbounded) reciprocals(1) = 1/range(2)
      if (range(1) > 0) reciprocals(2) = 1/range(1)
   end function reciprocals

   !> Starts, bounds and scales of a stage's parameters, and the quantities they are.
   !>
   !> error  the bounds of a parameter leave it nothing that keeps everything on the beam
   subroutine variables_of(stage, scenario, variables, quantities, error)
      type(stage_t), intent(in) :: stage
      type(scenario_t), intent(in) :: scenario
      type(variable_t), allocatable, intent(out) :: variables(:)
      type(quantity_t), allocatable, intent(out) :: quantities(:)
      type(error_t), allocatable, intent(out) :: error
      type(stage_t) :: bounded
      type(scenario_t) :: placed
      real(wp) :: start(size(stage%free)), range(2), moderate
      integer :: owners(size(stage%free)), k, r

      bounded = stage
      call bounded%set_bounds()
      owners = stage%owners()
      placed = scenario
      do k = 1, size(start)
         r = max(owners(k), 1)
         start(k) = get_free(scenario%structures(r), scenario%excitations(r), stage%free(k))
         if (allocated(stage%start)) start(k) = as_named(stage%free(k), stage%start(k))
         if (parameters(stage%free(k))%is_reciprocal) then
            if (.not. start(k) <= unbounded) call bad_input(error, trim(parameters( &
               stage%free(k))%name)//': found a start of 0, expected a value above 0')
            if (allocated(error)) return
            range = reciprocals([bounded%lower(k), bounded%upper(k)])
            bounded%lower(k) = range(1)
            bounded%upper(k) = range(2)
         end if
         start(k) = min(max(start(k), bounded%lower(k)), bounded%upper(k))
         call placed%set(stage%free(k), owners(k), start(k))
      end do
      allocate (variables(size(start)), quantities(size(start)))
      do k = 1, size(start)
         associate (q => quantities(k))
            q%name = name_of(name_of_parameter(scenario%structures(1), stage%free(k)), owners(k))
            q%parameter = stage%free(k)
            q%record = owners(k)
            range = placed%range_on_beam(stage%free(k), owners(k), stage%free)
            q%lower = max(bounded%lower(k), range(1))
            q%upper = min(bounded%upper(k), range(2))
            if (.not. q%lower < q%upper) then
               call bad_input(error, trim(q%name)//': found nothing between its lower bound '// &
                  to_text(q%lower)//' and its upper bound '//to_text(q%upper)// &
                  ', expected bounds and starts with every place on the beam')
               return
            end if
            r = max(owners(k), 1)
            moderate = free_magnitude(scenario%structures(r), scenario%excitations(r), &
               stage%free(k))
            ! A search does not start from a bound, but near it where that is a rigid spring.
            if (q%is_reciprocal()) start(k) = max(start(k), 1e-3_wp*moderate)
            variables(k) = new_variable(min(max(start(k), q%lower), q%upper), q%lower, q%upper, &
               moderate)
            ! Differences of logarithms keep E(x) and c_D(x) smooth.
            variables(k)%is_logarithmic = is_coefficient(stage%free(k)) .and. &
               .not. q%lower > 0 .and. .not. q%upper < unbounded
            q%start = as_named(stage%free(k), variables(k)%start)
            range = [q%lower, q%upper]
            if (q%is_reciprocal()) range = reciprocals(range)
            q%lower = range(1)
            q%upper = range(2)
         end associate
      end do
   end subroutine variables_of

end module beamid_unknowns
