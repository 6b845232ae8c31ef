!> The groups of a case file that describe the structure, its excitation, its units and the noise.
!> Each procedure reads one group, checks every value, and leaves its argument alone on error.
module beamid_model_groups
   use beamid_csv, only: column_length, read_columns
   use beamid_errors, only: error_t
   use beamid_excitation, only: excitation_t, new_force_table, new_pulse
   use beamid_files, only: directory_of, join_path
   use beamid_kinds, only: wp
   use beamid_namelist, only: block_t, string_length
   use beamid_refusals, only: accept, exclude, positive, quoted, refuse, require
   use beamid_strings, only: to_text
   use beamid_structure, only: check_structure, structure_t
   use beamid_units, only: label_length, units_t
   implicit none
   private

   public :: read_beam, read_tip, read_hose, read_excitation, read_units, read_noise

contains

   subroutine read_beam(path, block, structure, error)
      character(len=*), intent(in) :: path
      type(block_t), intent(in) :: block
      type(structure_t), intent(inout) :: structure
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: length, rho, E, I, width, height, c_D
      integer :: status
      namelist /beam/ length, rho, E, I, width, height, c_D

      length = 0; rho = 0; E = 0; I = 0; width = 0; height = 0; c_D = 0
      read (block%text, nml=beam, iostat=status)
      call accept(path, block, status, error)
      call require(path, block, [character(len=6) :: 'length', 'rho', 'E'], error)
      if (allocated(error)) return
      if (block%has('I') .eqv. (block%has('width') .or. block%has('height'))) then
         call refuse(path, block%line, 'beam', 'I', merge('both I and width or height', &
            'no cross section          ', block%has('I')), 'either I or width and height', error)
         return
      end if
      if (.not. block%has('I')) then
         call require(path, block, [character(len=6) :: 'width', 'height'], error)
         call positive(path, block, 'width', width, error)
         call positive(path, block, 'height', height, error)
         if (allocated(error)) return
         I = width*height**3/12
      end if
      structure%length = length
      structure%rho = rho
      structure%E = E
      structure%I = I
      structure%c_D = c_D
      call accept_structure(path, block, structure, error)
   end subroutine read_beam

   subroutine read_tip(path, block, structure, error)
      character(len=*), intent(in) :: path
      type(block_t), intent(in) :: block
      type(structure_t), intent(inout) :: structure
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: m_T
      integer :: status
      namelist /tip/ m_T

      m_T = 0
      read (block%text, nml=tip, iostat=status)
      call accept(path, block, status, error)
      if (allocated(error)) return
      structure%m_T = m_T
      call accept_structure(path, block, structure, error)
   end subroutine read_tip

   subroutine read_hose(path, block, structure, error)
      character(len=*), intent(in) :: path
      type(block_t), intent(in) :: block
      type(structure_t), intent(inout) :: structure
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: m_H, c_H, k_H
      integer :: status
      namelist /hose/ m_H, c_H, k_H

      m_H = 0; c_H = 0; k_H = 0
      read (block%text, nml=hose, iostat=status)
      call accept(path, block, status, error)
      call require(path, block, ['m_H'], error)
      if (allocated(error)) return
      structure%m_H = m_H
      structure%c_H = c_H
      structure%k_H = k_H
      call accept_structure(path, block, structure, error)
   end subroutine read_hose

   subroutine read_excitation(path, block, force, error)
      character(len=*), intent(in) :: path
      type(block_t), intent(in) :: block
      type(excitation_t), intent(inout) :: force
      type(error_t), allocatable, intent(out) :: error
      character(len=string_length) :: kind, file, load
      real(wp) :: amplitude, duration, power
      integer :: status
      namelist /excitation/ kind, amplitude, duration, file, load, power

      kind = ''; file = ''; load = 'point'; amplitude = 0; duration = 0; power = 2
      read (block%text, nml=excitation, iostat=status)
      call accept(path, block, status, error)
      call require(path, block, ['kind'], error)
      if (allocated(error)) return
      select case (kind)
      case ('pulse')
         call require(path, block, [character(len=9) :: 'amplitude', 'duration'], error)
         call exclude(path, block, [character(len=9) :: 'file'], 'with kind = ''pulse''', error)
         call positive(path, block, 'duration', duration, error)
         if (allocated(error)) return
         force = new_pulse(amplitude, duration)
      case ('table')
         call require(path, block, ['file'], error)
         call exclude(path, block, [character(len=9) :: 'amplitude', 'duration'], &
            'with kind = ''table''', error)
         if (allocated(error)) return
         if (file == '') then
            call refuse(path, block%line_of('file'), 'excitation', 'file', '''''', &
               'the path of a force table', error)
            return
         end if
         call read_force(join_path(directory_of(path), trim(file)), force, error)
         if (allocated(error)) return
      case default
         call refuse(path, block%line_of('kind'), 'excitation', 'kind', quoted(kind), &
            '''pulse'' or ''table''', error)
         return
      end select
      if (load /= 'point' .and. load /= 'distributed') then
         call refuse(path, block%line_of('load'), 'excitation', 'load', quoted(load), &
            '''point'' or ''distributed''', error)
      else if (.not. power >= 2) then
         call refuse(path, block%line_of('power'), 'excitation', 'power', to_text(power), &
            '2 or more', error)
      end if
      force%distributed = load == 'distributed'
      force%power = power
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
