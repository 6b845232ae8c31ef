!> The groups of a case file that describe the structure, its excitation, its units and the noise.
!> Each procedure reads one group, checks every value, and leaves its argument alone on error.
module beamid_model_groups
   use beamid_csv, only: column_length, read_columns
   use beamid_errors, only: error_t
   use beamid_excitation, only: excitation_t, new_force_table, new_free, new_pulse, new_release
   use beamid_files, only: directory_of, join_path
   use beamid_kinds, only: wp
   use beamid_namelist, only: block_t, string_length
   use beamid_parameters, only: check_structure, on_beam, parameters
   use beamid_refusals, only: accept, exclude, in_range, positive, quoted, refuse, require
   use beamid_strings, only: to_text
   use beamid_structure, only: n_parameters, structure_t
   use beamid_units, only: label_length, units_t
   implicit none
   private

   public :: read_structure, read_excitation, read_units, read_noise

contains

   !> A group of parameters of the structure: the rows of the table that name it.
   subroutine read_structure(path, block, structure, error)
      character(len=*), intent(in) :: path
      type(block_t), intent(in) :: block
      type(structure_t), intent(inout) :: structure
      type(error_t), allocatable, intent(out) :: error
      character(len=:), allocatable :: key
      real(wp) :: value
      integer :: k

      do k = 1, n_parameters
         if (parameters(k)%group /= block%name) cycle
         key = trim(parameters(k)%name)
         if (parameters(k)%default == '') call require(path, block, [key], error)
         if (allocated(error)) return
         if (.not. block%has(key)) cycle
         value = value_of_key(block, key)
         ! Below 0 a structure may say that there is none.
         if (parameters(k)%range == on_beam) call positive(path, block, key, value, error)
         call structure%set(k, value)
      end do
      if (block%name == 'beam') call read_section(path, block, structure, error)
      if (.not. allocated(error)) call accept_structure(path, block, structure, error)
   end subroutine read_structure

   !> The second moment of a rectangle.
   subroutine read_section(path, block, structure, error)
      character(len=*), intent(in) :: path
      type(block_t), intent(in) :: block
      type(structure_t), intent(inout) :: structure
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: width, height

      if (block%has('I') .eqv. (block%has('width') .or. block%has('height'))) then
         call refuse(path, block%line, 'beam', 'I', merge('both I and width or height', &
            'no cross section          ', block%has('I')), 'either I or width and height', error)
      else if (.not. block%has('I')) then
         call require(path, block, [character(len=6) :: 'width', 'height'], error)
         if (allocated(error)) return
         width = value_of_key(block, 'width')
         height = value_of_key(block, 'height')
         call positive(path, block, 'width', width, error)
         call positive(path, block, 'height', height, error)
         structure%I = width*height**3/12
      end if
   end subroutine read_section

   !> The number behind ` key=` in the clean text of a group.
   real(wp) function value_of_key(block, key) result(value)
      type(block_t), intent(in) :: block
      character(len=*), intent(in) :: key

      associate (from => index(block%text, ' '//key//'=') + len(key) + 2)
         read (block%text(from:), *) value
      end associate
   end function value_of_key

   subroutine read_excitation(path, block, found, error)
      character(len=*), intent(in) :: path
      type(block_t), intent(in) :: block
      type(excitation_t), intent(inout) :: found
      type(error_t), allocatable, intent(out) :: error
      character(len=string_length) :: kind, file, load
      real(wp) :: amplitude, duration, power, force, displacement, time
      integer :: modes, status
      namelist /excitation/ kind, amplitude, duration, file, load, power, force, displacement, &
         time, modes

      kind = ''; file = ''; load = 'point'; amplitude = 0; duration = 0; power = 2
      force = 0; displacement = 0; time = 0; modes = 2
      read (block%text, nml=excitation, iostat=status)
      call accept(path, block, status, error)
      call require(path, block, ['kind'], error)
      if (allocated(error)) return
      call exclude_strangers(path, block, trim(kind), error)
      if (allocated(error)) return
      select case (kind)
      case ('pulse')
         call require(path, block, [character(len=9) :: 'amplitude', 'duration'], error)
         call positive(path, block, 'duration', duration, error)
         if (allocated(error)) return
         found = new_pulse(amplitude, duration)
      case ('table')
         call require(path, block, ['file'], error)
         if (.not. allocated(error) .and. file == '') call refuse(path, block%line_of('file'), &
            'excitation', 'file', '''''', 'the path of a force table', error)
         if (allocated(error)) return
         call read_force(join_path(directory_of(path), trim(file)), found, error)
         if (allocated(error)) return
      case ('release')
         if (block%has('force') .eqv. block%has('displacement')) then
            call refuse(path, block%line, 'excitation', 'force', merge( &
               'both force and displacement', 'neither force, displacement', &
               block%has('force')), 'either force or displacement of the tip before', error)
            return
         end if
         found = new_release(merge(displacement, force, block%has('displacement')), time, &
            block%has('displacement'))
      case ('free')
         call in_range(path, block, 'modes', modes, 1, 20, error)
         if (allocated(error)) return
         found = new_free(modes)
      case default
         call refuse(path, block%line_of('kind'), 'excitation', 'kind', quoted(kind), &
            '''pulse'', ''table'', ''release'' or ''free''', error)
         return
      end select
      if (load /= 'point' .and. load /= 'distributed') then
         call refuse(path, block%line_of('load'), 'excitation', 'load', quoted(load), &
            '''point'' or ''distributed''', error)
      else if (.not. power >= 2) then
         call refuse(path, block%line_of('power'), 'excitation', 'power', to_text(power), &
            '2 or more', error)
      end if
      found%distributed = load == 'distributed'
      found%power = power
   end subroutine read_excitation

   !> Each kind of excitation has its own keys.
   subroutine exclude_strangers(path, block, kind, error)
      character(len=*), intent(in) :: path, kind
      type(block_t), intent(in) :: block
      type(error_t), allocatable, intent(inout) :: error
      character(len=12), parameter :: keys(9) = [character(len=12) :: 'amplitude', 'duration', &
                                      'file', 'load', 'power', 'force', 'displacement', 'time', &
                                      'modes']
      character(len=*), parameter :: owners(9) = [character(len=13) :: 'pulse', 'pulse', 'table', &
                                     'pulse table', 'pulse table', 'release', 'release', &
                                     'release', 'free']
      integer :: k

      if (.not. any(kind == [character(len=7) :: 'pulse', 'table', 'release', 'free'])) return
      do k = 1, size(keys)
         if (index(owners(k), kind) == 0) call exclude(path, block, keys(k:k), &
            'with kind = '''//kind//'''', error)
      end do
   end subroutine exclude_strangers

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

   subroutine read_units(path, block, labels, error)
      character(len=*), intent(in) :: path
      type(block_t), intent(in) :: block
      type(units_t), intent(inout) :: labels
      type(error_t), allocatable, intent(out) :: error
      character(len=string_length) :: length, force, time, mass
      integer :: status
      namelist /units/ length, force, time, mass

      length = ''; force = ''; time = ''; mass = ''
      read (block%text, nml=units, iostat=status)
      call accept(path, block, status, error)
      call label('length', length)
      call label('force', force)
      call label('time', time)
      call label('mass', mass)
      if (allocated(error)) return
      labels%length = length
      labels%force = force
      labels%time = time
      labels%mass = mass

   contains

      !> Labels go into tables of comma-separated fields.
      subroutine label(key, text)
         character(len=*), intent(in) :: key, text

         if (scan(text, ',"') > 0 .or. len_trim(text) > label_length) call refuse(path, &
            block%line_of(key), 'units', key, quoted(text), &
            'a label without commas and double quotes, of at most '// &
            to_text(label_length)//' characters', error)
      end subroutine label

   end subroutine read_units

   subroutine read_noise(path, block, deviation, start, error)
      character(len=*), intent(in) :: path
      type(block_t), intent(in) :: block
      real(wp), intent(inout) :: deviation
      integer, intent(inout) :: start
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: sd
      integer :: seed, status
      namelist /noise/ sd, seed

      sd = 0; seed = 1
      read (block%text, nml=noise, iostat=status)
      call accept(path, block, status, error)
      call require(path, block, ['sd'], error)
      if (.not. allocated(error) .and. .not. sd >= 0) call refuse(path, block%line_of('sd'), &
         'noise', &
         'sd', to_text(sd), '0 or more', error)
      deviation = sd
      start = seed
   end subroutine read_noise

   !> A range check of the structure gets file, line and group.
   subroutine accept_structure(path, block, structure, error)
      character(len=*), intent(in) :: path
      type(structure_t), intent(in) :: structure
      type(block_t), intent(in) :: block
      type(error_t), allocatable, intent(out) :: error
      character(len=:), allocatable :: key
      integer :: line

      call check_structure(structure, error)
      if (.not. allocated(error)) return
      key = error%message(:index(error%message, ':') - 1)
      line = block%line_of(key)
      error%message = path//':'//to_text(line)//': &'//trim(block%name)//' '//error%message
   end subroutine accept_structure

end module beamid_model_groups
