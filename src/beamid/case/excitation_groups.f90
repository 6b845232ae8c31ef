!> Reader of the group &excitation of a case file. `beamid_case_files` calls it.
module beamid_excitation_groups
   use beamid_blocks, only: block_t
   use beamid_errors, only: bad_input, error_t, locate
   use beamid_excitation, only: excitation_t, new_base_motion, new_force_table, new_free, &
      new_pulse, new_release
   use beamid_kinds, only: wp
   use beamid_model_groups, only: read_parameter
   use beamid_record_groups, only: get_columns
   use beamid_records, only: column_length
   use beamid_series, only: part_t, read_series, series_t
   use beamid_strings, only: to_text
   use beamid_structure, only: of_x_F
   use beamid_values, only: positive, range_t
   implicit none
   private

   public :: read_excitation

contains

   !> Reads an excitation and refuses keys that do not belong to its kind.
   !>
   !> error  error in the table of the force or of the base acceleration; an earlier error is kept
   subroutine read_excitation(block, found, error)
      type(block_t), intent(inout) :: block
      type(excitation_t), intent(out) :: found
      type(error_t), allocatable, intent(inout) :: error
      character(len=:), allocatable :: kind, file, load
      character(len=column_length) :: columns(2)
      type(series_t) :: series
      real(wp), allocatable :: amplitude, duration, force, displacement, x_F, rate
      real(wp) :: power, time
      integer :: modes
      character(len=*), parameter :: no_pulse = 'required with kind=''pulse'''

      load = 'point'
      power = 2
      time = 0
      modes = 2
      call block%get('kind', kind, 'kind of excitation: ''pulse'' or ''table'', a force; '// &
         '''release'' of the deflected beam; ''free'', an unknown initial state; ''base'', a '// &
         'motion of the base', &
         [character(len=7) :: 'pulse', 'table', 'release', 'free', 'base'], required=.true.)
      call block%get('amplitude', amplitude, no_pulse, 'constant force of the pulse; with '// &
         'load=''distributed'' a force per length, in force/length (N/m)')
      call block%get('duration', duration, no_pulse, 'duration of the pulse, from t = 0', positive)
      call block%get_file('file', file, 'path of the table of time and force (or force per '// &
         'length with load=''distributed''), or of time and base acceleration; linear between '// &
         'the rows', &
         default='required with kind=''table'' and kind=''base''')
      columns = ''
      call get_columns(block, 'force or base acceleration', columns(1), columns(2), rate)
      call block%get('load', load, 'load of a pulse or a table: ''point'', a force at x_F; '// &
         '''distributed'', a force along the beam', [character(len=11) :: 'point', 'distributed'])
      call block%get('power', power, 'exponent p of a distributed load of the shape (x/l)^p', &
         range_t(2))
      call block%get('force', force, 'required with kind=''release'' without displacement', &
         'static force at x_F before the release')
      call block%get('displacement', displacement, 'required with kind=''release'' without force', &
         'static displacement at x_F before the release')
      call block%get('time', time, 'time of the release')
      call block%get('modes', modes, 'number of modes whose initial amplitude and phase are '// &
         'estimated, with kind=''free''', range_t(1, 20))
      call read_parameter(block, of_x_F, x_F)
      call block%close()
      if (block%failed()) return
      call exclude_keys_of_other_kinds(block, kind)
      call make_excitation()

   contains

      !> Makes the excitation of its kind from the values of the keys.
      subroutine make_excitation()
         select case (kind)
         case ('pulse')
            call block%require('amplitude')
            call block%require('duration')
            if (block%failed()) return
            found = new_pulse(amplitude, duration)
         case ('table', 'base')
            call block%require('file')
            if (block%failed() .or. allocated(error)) return
            call read_series(file, columns, part_t(), series, error, rate)
            if (allocated(error)) return
            call use_table()
         case ('release')
            call set_release(block, force, displacement, time, found)
         case ('free')
            found = new_free(modes)
         end select
         call set_load()
      end subroutine make_excitation

      !> Makes a base motion or a force of the table that was read.
      subroutine use_table()
         if (kind == 'base') call new_base_motion(series%t, series%z, found, error)
         if (kind == 'table') call new_force_table(series%t, series%z, found, error)
         if (.not. allocated(error) .and. kind == 'table') call refuse_constant(series%z, error)
         call locate(error, file)
      end subroutine use_table

      !> Sets where the force acts.
      subroutine set_load()
         found%distributed = load == 'distributed'
         found%power = power
         if (found%distributed) call block%exclude('x_F', 'with load = ''distributed''')
         if (allocated(x_F)) found%x_F = x_F
      end subroutine set_load

   end subroutine read_excitation

   !> Sets the release of a tip that is deflected statically, by a given force or displacement.
   !>
   !> force, displacement  of the tip before the release, exactly one of them allocated
   !> time                 of the release [time]
   subroutine set_release(block, force, displacement, time, found)
      type(block_t), intent(inout) :: block
      real(wp), allocatable, intent(in) :: force, displacement
      real(wp), intent(in) :: time
      type(excitation_t), intent(inout) :: found

      if (allocated(force) .eqv. allocated(displacement)) then
         call block%refuse('force', trim(merge('both force and displacement', &
            'neither force, displacement', allocated(force))), &
            'either force or displacement of the tip before')
      else if (allocated(force)) then
         found = new_release(force, time, .false.)
      else
         found = new_release(displacement, time, .true.)
      end if
   end subroutine set_release

   !> Refuses keys of the group &excitation that have no meaning for its kind.
   subroutine exclude_keys_of_other_kinds(block, kind)
      type(block_t), intent(inout) :: block
      character(len=*), intent(in) :: kind
      !> Keys that belong to certain kinds only, and these kinds.
      character(len=*), parameter :: keys(13) = [character(len=12) :: 'amplitude', 'duration', &
         'file', 'time_column', 'value_column', 'rate', 'load', 'power', 'force', 'displacement', &
         'time', 'modes', 'x_F'], &
         kinds(13) = [character(len=19) :: 'pulse', 'pulse', 'table base', 'table base', &
         'table base', 'table base', 'pulse table', 'pulse table', 'release', 'release', &
         'release', 'free', 'pulse table release']

      call block%exclude_other_kinds(kind, keys, kinds)
   end subroutine exclude_keys_of_other_kinds

   !> Refuses a table with the same force in every row, which no thruster or hammer produces. A
   !> table of two rows is an exception: it is a pulse.
   subroutine refuse_constant(force, error)
      real(wp), intent(in) :: force(:)
      type(error_t), allocatable, intent(inout) :: error

      if (maxval(force) > minval(force) .or. size(force) == 2 .and. abs(force(1)) > 0) return
      call bad_input(error, 'found the same force ('//to_text(force(1))//') in all '// &
         to_text(size(force))//' rows, expected one that changes')
   end subroutine refuse_constant

end module beamid_excitation_groups
