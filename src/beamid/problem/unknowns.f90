!> Unknown parameters: which parameters a stage estimates, and where their values go.
!>
!> A parameter may be common to all records or belong to one record. The stages of a fit turn their
!> free parameters into the variables of a search and into the quantities of the result.
module beamid_unknowns
   use beamid_errors, only: bad_input, error_t
   use beamid_excitation, only: excitation_t
   use beamid_kinds, only: wp
   use beamid_parameter_names, only: is_there, name_of_parameter, &
      parameter_name_length => name_length
   use beamid_parameters, only: as_named, free_magnitude, get_free, may_be_negative, offset, &
      on_beam, parameters, set_free, share
   use beamid_strings, only: to_text
   use beamid_structure, only: is_coefficient, n_parameters, of_length, of_w_D, structure_t, x_P_at
   use beamid_variables, only: new_variable, unbounded, variable_t
   implicit none
   private

   public :: stage_t, scenario_t, quantity_t, name_of, variables_of, name_length

   !> Length of the name of a quantity.
   integer, parameter :: name_length = parameter_name_length + 8

   !> One stage of a fit: its free parameters, their start values and their bounds.
   !>
   !> Each array has one entry for each of the n free parameters. Start values and bounds are those
   !> of the named parameter. For a stiffness they are values of the stiffness, although the search
   !> uses its reciprocal.
   type :: stage_t
      integer, allocatable :: free(:)     !< (n) numbers in `parameters`
      !> (n) record a parameter belongs to; 0: all records; not allocated: all are common
      integer, allocatable :: record(:)
      !> (n) start values; not allocated: the values at the end of the previous stage
      real(wp), allocatable :: start(:)
      !> (n) lower bounds; not allocated: 0, or none for parameters that may be negative
      real(wp), allocatable :: lower(:)
      !> (n) upper bounds; not allocated: .99 for a share of 1, none for other parameters
      real(wp), allocatable :: upper(:)
      logical :: offset = .false.         !< whether the offset of each record is unknown
      logical :: automatic = .false.      !< start values are found from the record
      !> whether a fit is of use only if it estimates all these parameters: the search for start
      !> values then does not try to fix one parameter in place of another
      logical :: is_whole = .false.
      !> start values are those of the case file, even where the default is `automatic`
      logical :: declared = .false.
      !> lowest mode that the search for start values must not use, because an earlier fit could not
      !> tell it from another line; 0: none
      integer :: rejected_mode = 0
   contains
      procedure :: without
      procedure :: owners
      procedure :: set_bounds
      procedure :: distribute
   end type stage_t

   !> The structure and the excitation of each record.
   type :: scenario_t
      type(structure_t), allocatable :: structures(:)     !< (records)
      type(excitation_t), allocatable :: excitations(:)   !< (records)
   contains
      procedure :: get
      procedure :: set
      procedure :: magnitude_of
      procedure :: range_on_beam
   end type scenario_t

   !> An estimated quantity: a parameter, or a linear unknown.
   type :: quantity_t
      character(len=name_length) :: name = ''
      integer :: parameter = 0   !< number in `parameters`; 0: amplitude of a mode
      integer :: record = 0      !< record it belongs to; 0: all records
      real(wp) :: start = 0, value = 0, lower = 0, upper = 0   !< [unit of the parameter]
      !> value of the searched variable, which is the reciprocal of `value` for a stiffness; all
      !> statistics refer to this variable
      real(wp) :: searched = 0
      real(wp) :: scale = 1      !< reference of relative changes of `searched`, > 0
      real(wp) :: moderate = 1   !< moderate value of `searched`, > 0
   contains
      procedure :: limits
      procedure :: ends
      procedure :: moved
      procedure :: is_reciprocal
      procedure :: searched_name
   end type quantity_t

contains

   !> Sets the bounds that were not given to their defaults.
   pure subroutine set_bounds(self)
      class(stage_t), intent(inout) :: self

      if (.not. allocated(self%lower)) self%lower = merge(-unbounded, 0.0_wp, &
         may_be_negative(self%free))
      if (.not. allocated(self%upper)) self%upper = merge(0.99_wp, unbounded, &
         parameters(self%free)%range == share)
   end subroutine set_bounds

   !> Gives each parameter that is not common an entry for each record, and removes the offset from
   !> the list, because it is a linear unknown.
   !>
   !> shared   numbers of the parameters that all records have in common
   !> records  number of records
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

   !> Returns the stage without some of its parameters.
   !>
   !> lost  (n) whether to leave out a parameter
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

   !> Returns the record that each parameter belongs to (n); 0: all records.
   pure function owners(self)
      class(stage_t), intent(in) :: self
      integer :: owners(size(self%free))

      owners = 0
      if (allocated(self%record)) owners = self%record
   end function owners

   !> Returns the searched variable of a parameter in one record; record 0 counts as the first.
   pure real(wp) function get(self, parameter, record)
      class(scenario_t), intent(in) :: self
      integer, intent(in) :: parameter, record

      associate (r => max(record, 1))
         get = get_free(self%structures(r), self%excitations(r), parameter)
      end associate
   end function get

   !> Returns a moderate value of the searched variable, as a scale for changes; arguments as `get`.
   pure real(wp) function magnitude_of(self, parameter, record)
      class(scenario_t), intent(in) :: self
      integer, intent(in) :: parameter, record

      associate (r => max(record, 1))
         magnitude_of = free_magnitude(self%structures(r), self%excitations(r), parameter)
      end associate
   end function magnitude_of

   !> Sets a parameter, in one record or in all (record = 0).
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

   !> Returns the range of a parameter for which every attachment stays on the beam.
   !>
   !> A place extends up to the end of the beam, and the length extends down to the outermost place.
   !> If both are free, their ranges meet halfway between the current values. A dip is at most as
   !> wide as the beam is long.
   !>
   !> record  record to consider; 0: all records
   !> free    numbers of the free parameters
   !> range   lower and upper end; `unbounded` if there is none
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
               ! A rigid support at the clamp would make the equations singular.
               if (any(x_P_at == parameter)) range(1) = max(range(1), 1e-3_wp*s%length)
            end if
         end associate
      end do
   end function range_on_beam

   !> Returns a name, followed by the number of the record in parentheses if record > 0.
   pure function name_of(text, record) result(name)
      character(len=*), intent(in) :: text
      integer, intent(in) :: record
      character(len=name_length) :: name

      name = text
      if (record > 0) name = trim(text)//'('//to_text(record)//')'
   end function name_of

   !> Tells whether the search uses the reciprocal of the parameter.
   elemental logical function is_reciprocal(self)
      class(quantity_t), intent(in) :: self

      is_reciprocal = .false.
      if (self%parameter > 0) is_reciprocal = parameters(self%parameter)%is_reciprocal
   end function is_reciprocal

   !> Returns the name of the searched variable.
   elemental function searched_name(self) result(name)
      class(quantity_t), intent(in) :: self
      character(len=name_length) :: name

      name = self%name
      if (self%is_reciprocal()) name = '1/'//self%name
   end function searched_name

   !> Returns the standard error and both ends of an interval of the parameter, within the bounds of
   !> the search. The upper end may be infinite for the reciprocal of the searched variable.
   !>
   !> std_error, half_width  those of the searched variable
   pure function limits(self, std_error, half_width)
      class(quantity_t), intent(in) :: self
      real(wp), intent(in) :: std_error, half_width
      real(wp) :: limits(3)

      limits = [std_error, self%ends([half_width, half_width])]
      if (self%is_reciprocal()) limits(1) = std_error*self%value**2
   end function limits

   !> Returns both ends of an interval of the parameter, within the bounds of the search. The linear
   !> theory holds for the reciprocal of a stiff spring, but for the stiffness itself of a soft one.
   !>
   !> distance  (2) distance of the lower and of the upper end from the estimate of the searched
   !>           variable
   pure function ends(self, distance)
      class(quantity_t), intent(in) :: self
      real(wp), intent(in) :: distance(2)
      real(wp) :: ends(2)

      ends = self%value + [-distance(1), distance(2)]
      if (self%is_reciprocal()) then
         if (self%searched > self%moderate) then
            ends = self%value + self%value**2*[-distance(2), distance(1)]
         else
            ends = as_named(self%parameter, [self%searched + distance(2), max(self%searched &
               - distance(1), 0.0_wp)])
         end if
      end if
      ends(1) = max(ends(1), self%lower)
      if (self%upper < unbounded) ends(2) = min(ends(2), self%upper)
   end function ends

   !> Returns the change of the parameter for a step of the searched variable.
   pure real(wp) function moved(self, step)
      class(quantity_t), intent(in) :: self
      real(wp), intent(in) :: step

      moved = step
      if (self%is_reciprocal()) moved = as_named(self%parameter, self%searched + step) - self%value
   end function moved

   !> Returns the range of the reciprocals of a range of positive values.
   pure function reciprocals(range)
      real(wp), intent(in) :: range(2)
      real(wp) :: reciprocals(2)

      reciprocals = [0.0_wp, unbounded]
      if (range(2) < unbounded) reciprocals(1) = 1/range(2)
      if (range(1) > 0) reciprocals(2) = 1/range(1)
   end function reciprocals

   !> Returns the variables of a search, and the quantities that it estimates.
   !>
   !> scenario    current values of the parameters
   !> variables   (n) start, bounds and scale of each free parameter
   !> quantities  (n) name, record, start and bounds of each free parameter
   !> error       a stiffness would start from 0; the bounds of a parameter leave no value for which
   !>             everything stays on the beam
   subroutine variables_of(stage, scenario, variables, quantities, error)
      type(stage_t), intent(in) :: stage
      type(scenario_t), intent(in) :: scenario
      type(variable_t), allocatable, intent(out) :: variables(:)
      type(quantity_t), allocatable, intent(out) :: quantities(:)
      type(error_t), allocatable, intent(out) :: error
      type(stage_t) :: searched
      type(scenario_t) :: placed
      real(wp) :: start(size(stage%free)), range(2), moderate
      integer :: owners(size(stage%free)), k

      call place_starts(stage, scenario, searched, placed, error)
      if (allocated(error)) return
      start = searched%start
      owners = stage%owners()
      allocate (variables(size(start)), quantities(size(start)))
      do k = 1, size(start)
         associate (q => quantities(k))
            q%name = name_of(name_of_parameter(scenario%structures(1), stage%free(k)), owners(k))
            q%parameter = stage%free(k)
            q%record = owners(k)
            range = placed%range_on_beam(stage%free(k), owners(k), stage%free)
            q%lower = max(searched%lower(k), range(1))
            q%upper = min(searched%upper(k), range(2))
            if (.not. q%lower < q%upper) then
               call bad_input(error, trim(q%name)//': found nothing between its lower bound '// &
                  to_text(q%lower)//' and its upper bound '//to_text(q%upper)// &
                  ', expected bounds and starts with every place on the beam')
               return
            end if
            moderate = scenario%magnitude_of(stage%free(k), owners(k))
            ! A rigid spring (reciprocal 0) starts near its bound, because a search cannot start
            ! from a bound.
            if (q%is_reciprocal()) start(k) = max(start(k), 1e-3_wp*moderate)
            variables(k) = new_variable(min(max(start(k), q%lower), q%upper), q%lower, q%upper, &
               moderate)
            ! The penalties on E(x) and c_D(x) are differences of logarithms.
            variables(k)%is_logarithmic = is_coefficient(stage%free(k)) .and. &
               .not. q%lower > 0 .and. .not. q%upper < unbounded
            q%start = as_named(stage%free(k), variables(k)%start)
            q%moderate = moderate
            range = [q%lower, q%upper]
            if (q%is_reciprocal()) range = reciprocals(range)
            q%lower = range(1)
            q%upper = range(2)
         end associate
      end do
   end subroutine variables_of

   !> Determines start and bounds of the searched variables, and the scenario with the starts.
   !>
   !> searched  the stage with start, lower and upper of the searched variables
   !> placed    the scenario with these starts
   !> error     a stiffness would start from 0
   subroutine place_starts(stage, scenario, searched, placed, error)
      type(stage_t), intent(in) :: stage
      type(scenario_t), intent(in) :: scenario
      type(stage_t), intent(out) :: searched
      type(scenario_t), intent(out) :: placed
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: range(2), start(size(stage%free))
      integer :: owners(size(stage%free)), k

      searched = stage
      call searched%set_bounds()
      owners = stage%owners()
      placed = scenario
      do k = 1, size(start)
         start(k) = scenario%get(stage%free(k), owners(k))
         if (allocated(stage%start)) start(k) = as_named(stage%free(k), stage%start(k))
         if (parameters(stage%free(k))%is_reciprocal) then
            if (.not. start(k) <= unbounded) call bad_input(error, trim(parameters( &
               stage%free(k))%name)//': found a start of 0, expected a value above 0')
            if (allocated(error)) return
            range = reciprocals([searched%lower(k), searched%upper(k)])
            searched%lower(k) = range(1)
            searched%upper(k) = range(2)
         end if
         start(k) = min(max(start(k), searched%lower(k)), searched%upper(k))
         call placed%set(stage%free(k), owners(k), start(k))
      end do
      searched%start = start
   end subroutine place_starts

end module beamid_unknowns
