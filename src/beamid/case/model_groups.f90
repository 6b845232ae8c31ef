!> The groups of a case file that describe the structure, its excitation, its units and the noise.
module beamid_model_groups
   use beamid_blocks, only: block_t
   use beamid_csv, only: column_length, read_columns
   use beamid_errors, only: error_t
   use beamid_excitation, only: excitation_t, new_force_table, new_free, new_pulse, new_release
   use beamid_paths, only: directory_of, join_path
   use beamid_kinds, only: wp
   use beamid_numbers, only: shown
   use beamid_parameters, only: parameters, zero_or_more => not_negative
   use beamid_strings, only: to_text
   use beamid_structure, only: n_parameters, structure_t
   use beamid_units, only: label_length, units_t
   use beamid_values, only: not_negative, positive, range_t
   implicit none
   private

   public :: read_structure, read_excitation, read_units, read_noise

contains

   !> A group of parameters of the structure: the rows of the table that name it.
   subroutine read_structure(block, structure)
      type(block_t), intent(inout) :: block
      type(structure_t), intent(inout) :: structure
      real(wp), allocatable :: value, width, height
      integer :: k

      do k = 1, n_parameters
         if (parameters(k)%group /= block%name) cycle
         if (allocated(value)) deallocate (value)
         call block%get(trim(parameters(k)%name), value, trim(parameters(k)%default), &
            trim(parameters(k)%help), range_t(0, open=parameters(k)%range /= zero_or_more), &
            required=parameters(k)%default == '')
         if (allocated(value)) call structure%set(k, value)
      end do
      if (block%name == 'beam') then
         call block%get('width', width, 'give I', 'b of a rectangle', positive)
         call block%get('height', height, 'give I', 'h of a rectangle', positive)
      end if
      call block%close()
      if (block%failed() .or. block%name /= 'beam') return
      if (block%has('I') .eqv. (allocated(width) .or. allocated(height))) then
         call block%refuse('I', trim(merge('both I and width or height', &
            'no cross section          ', block%has('I'))), 'either I or width and height')
      else if (.not. block%has('I')) then
         call block%require('width')
         call block%require('height')
         if (.not. block%failed()) structure%I = width*height**3/12
      end if
   end subroutine read_structure

   !> path   of the case file
   !> error  of a force table
   subroutine read_excitation(path, block, found, error)
      character(len=*), intent(in) :: path
      type(block_t), intent(inout) :: block
      type(excitation_t), intent(out) :: found
      type(error_t), allocatable, intent(inout) :: error
      character(len=:), allocatable :: kind, file, load
      real(wp), allocatable :: amplitude, duration, force, displacement
      real(wp) :: power, time
      integer :: modes, k
      !> Keys that only some kinds have, and these kinds.
      character(len=*), parameter :: keys(9) = [character(len=12) :: 'amplitude', 'duration', &
         'file', 'load', 'power', 'force', 'displacement', 'time', 'modes'], &
         owners(9) = [character(len=11) :: 'pulse', 'pulse', 'table', 'pulse table', &
         'pulse table', 'release', 'release', 'release', 'free']

      load = 'point'; power = 2; time = 0; modes = 2
      call block%get('kind', kind, 'what sets the beam in motion', &
         [character(len=7) :: 'pulse', 'table', 'release', 'free'], required=.true.)
      call block%get('amplitude', amplitude, 'a pulse needs it', 'force of a pulse')
      call block%get('duration', duration, 'a pulse needs it', 'of a pulse, from t = 0', positive)
      call block%get('file', file, 'of a table: time and force, linear between the rows', &
         default='a table needs it')
      call block%get('load', load, 'where a pulse or a table acts', [character(len=11) :: 'point', &
         'distributed'])
      call block%get('power', power, 'p of a distributed load (x/l)^p', range_t(2))
      call block%get('force', force, 'give displacement', 'that held the tip before its release')
      call block%get('displacement', displacement, 'give force', 'of the tip before its release')
      call block%get('time', time, 'of the release')
      call block%get('modes', modes, 'that move at a free start', range_t(1, 20))
      call block%close()
      if (block%failed()) return
      do k = 1, size(keys)
         if (index(owners(k), kind) == 0) call block%exclude(trim(keys(k)), 'with kind = '''// &
            kind//'''')
      end do
      select case (kind)
      case ('pulse')
         call block%require('amplitude')
         call block%require('duration')
         if (block%failed()) return
         found = new_pulse(amplitude, duration)
      case ('table')
         call block%require('file')
         if (block%failed() .or. allocated(error)) return
         if (file == '') then
            call block%refuse('file', '''''', 'the path of a force table')
            return
         end if
         call read_force(join_path(directory_of(path), file), found, error)
      case ('release')
         if (allocated(force) .eqv. allocated(displacement)) then
            call block%refuse('force', trim(merge('both force and displacement', &
               'neither force, displacement', allocated(force))), &
               'either force or displacement of the tip before')
         else if (allocated(force)) then
            found = new_release(force, time, .false.)
         else
            found = new_release(displacement, time, .true.)
         end if
      case ('free')
         found = new_free(modes)
      end select
      found%distributed = load == 'distributed'
      found%power = power
   end subroutine read_excitation

   !> Force table: time and force, the first two columns.
   subroutine read_force(path, force, error)
      character(len=*), intent(in) :: path
      type(excitation_t), intent(inout) :: force
      type(error_t), allocatable, intent(out) :: error
      character(len=column_length), allocatable :: header(:)
      real(wp), allocatable :: values(:, :)

      call read_columns(path, 2, values, header, error, increasing=.true.)
      if (allocated(error)) return
      call new_force_table(values(1, :), values(2, :), force, error)
      if (allocated(error)) error%message = path//': '//error%message
   end subroutine read_force

   subroutine read_units(block, labels)
      type(block_t), intent(inout) :: block
      type(units_t), intent(inout) :: labels

      call read_label('length', labels%length)
      call read_label('force', labels%force)
      call read_label('time', labels%time)
      call read_label('mass', labels%mass)
      call block%close()

   contains

      !> Labels go into tables of comma-separated fields.
      subroutine read_label(key, label)
         character(len=*), intent(in) :: key
         character(len=*), intent(inout) :: label
         character(len=:), allocatable :: text

         call block%get(key, text, 'label of its unit', default='none')
         if (.not. allocated(text)) return
         if (scan(text, ',"') > 0 .or. len(text) > label_length) call block%refuse(key, &
            shown(text), 'a label without commas and double quotes, of at most '// &
            to_text(label_length)//' characters')
         label = text
      end subroutine read_label

   end subroutine read_units

   subroutine read_noise(block, sd, seed)
      type(block_t), intent(inout) :: block
      real(wp), intent(inout) :: sd
      integer, intent(inout) :: seed

      call block%get('sd', sd, 'standard deviation of the acceleration', not_negative, &
         required=.true.)
      call block%get('seed', seed, 'of the random numbers')
      call block%close()
   end subroutine read_noise

end module beamid_model_groups
