!> The case file: one namelist group for each part of the experiment, every key with a documented
!> default or required, every value checked where it is read.
module beamid_cases
   use beamid_csv, only: column_length, read_columns
   use beamid_cvode, only: cvode_t
   use beamid_errors, only: error_t, bad_input
   use beamid_excitation, only: new_force_table, new_pulse
   use beamid_files, only: directory_of, join_path, read_text
   use beamid_galerkin, only: mesh_t
   use beamid_identification, only: model_t, stage_t
   use beamid_kinds, only: wp, ip
   use beamid_modal, only: modal_t
   use beamid_namelist, only: block_t, group, group_t, integer_key, real_key, scan_namelist, &
      string_key, string_length
   use beamid_observation, only: formula_names
   use beamid_records, only: everything, grid, read_record, take_samples, window_t
   use beamid_strings, only: lower, to_text
   use beamid_parameters, only: belongs_to_hose, free_index, free_names, may_be_negative
   use beamid_structure, only: check_structure
   use beamid_units, only: units_t
   use beamid_variables, only: unbounded
   implicit none
   private

   public :: case_t, read_case, sample_times, measured_samples
   public :: needs_nothing, needs_response, needs_fit

   !> What a command needs of a case: the structure alone, a response at given times, a fit.
   integer, parameter :: needs_nothing = 0, needs_response = 1, needs_fit = 2

   integer, parameter :: max_elements = 10000, max_list = 50

   type :: case_t
      character(len=:), allocatable :: path     !< as given
      character(len=:), allocatable :: name     !< file name without folder and ending
      type(model_t) :: model
      type(mesh_t), allocatable :: meshes(:)    !< one for each entry of `elements`
      character(len=:), allocatable :: record   !< path of the record; not allocated: none
      type(window_t) :: window
      type(stage_t), allocatable :: stages(:)
      type(units_t) :: units
      real(wp) :: noise_sd = 0                  !< of the noise that `simulate` adds to a record [acceleration]
      integer :: noise_seed = 1
      integer, private :: record_line = 0
      integer, allocatable, private :: stage_lines(:)
   end type case_t

contains

   !> Groups and keys of a case file.
   function schema() result(groups)
      type(group_t), allocatable :: groups(:)

      groups = [ &
         group('beam', [real_key('length'), real_key('rho'), real_key('E'), real_key('I'), &
                        real_key('width'), real_key('height'), real_key('c_D')], required=.true.), &
         group('tip', [real_key('m_T')]), &
         group('hose', [real_key('m_H'), real_key('c_H'), real_key('k_H')]), &
         group('excitation', [string_key('kind'), real_key('amplitude'), real_key('duration'), &
                              string_key('file'), string_key('load'), real_key('power')]), &
         group('discretization', [integer_key('degree'), integer_key('elements', max_list), &
                                  integer_key('gauss_points'), integer_key('panels')]), &
         group('integrator', [string_key('method'), real_key('rtol'), real_key('atol'), &
                              integer_key('max_order'), integer_key('max_steps')]), &
         group('observation', [string_key('formula'), real_key('delta')]), &
         group('record', [string_key('file'), real_key('t_first'), real_key('t_last'), &
                          real_key('t_step')]), &
         group('stage', [string_key('free', size(free_names)), &
                         real_key('start', size(free_names)), &
                         real_key('lower', size(free_names)), &
                         real_key('upper', size(free_names))], may_repeat=.true.), &
         group('noise', [real_key('sd'), integer_key('seed')]), &
         group('units', [string_key('length'), string_key('force'), string_key('time'), &
                         string_key('mass')])]
   end function schema

   !> Reads and checks a case file.
   !>
   !> path   of the case file; paths inside it are relative to it
   !> needs  needs_nothing, needs_response or needs_fit
   !> error  one line per problem: file, line, group, key, what was found, what was expected
   subroutine read_case(path, needs, case, error)
      character(len=*), intent(in) :: path
      integer, intent(in) :: needs
      type(case_t), intent(out) :: case
      type(error_t), allocatable, intent(out) :: error
      type(block_t), allocatable :: blocks(:)
      character(len=:), allocatable :: text
      integer :: k

      call read_text(path, text, error)
      if (allocated(error)) return
      call scan_namelist(path, text, schema(), blocks, error)
      if (allocated(error)) return
      case%path = path
      case%name = name_of(path)
      case%meshes = [mesh_t()]
      allocate (modal_t :: case%model%solver)
      allocate (case%stages(0), case%stage_lines(0))

      ! The structure first, whatever the order in the file: other groups are checked against it.
      do k = 1, size(blocks)
         if (blocks(k)%name == 'beam') call read_beam(blocks(k), case, error)
         if (allocated(error)) return
      end do
      do k = 1, size(blocks)
         if (blocks(k)%name == 'tip') call read_tip(blocks(k), case, error)
         if (blocks(k)%name == 'hose') call read_hose(blocks(k), case, error)
         if (allocated(error)) return
      end do
      do k = 1, size(blocks)
         select case (blocks(k)%name)
         case ('excitation'); call read_excitation(blocks(k), case, error)
         case ('discretization'); call read_discretization(blocks(k), case, error)
         case ('integrator'); call read_integrator(blocks(k), case, error)
         case ('observation'); call read_observation(blocks(k), case, error)
         case ('record'); call read_window(blocks(k), case, error)
         case ('noise'); call read_noise(blocks(k), case, error)
         case ('stage'); call read_stage(blocks(k), case, error)
         case ('units'); call read_units(blocks(k), case, error)
         end select
         if (allocated(error)) return
      end do
      call check_needs(case, needs, error)
   end subroutine read_case

   !> Refuses a case that lacks what the command needs.
   subroutine check_needs(case, needs, error)
      type(case_t), intent(in) :: case
      integer, intent(in) :: needs
      type(error_t), allocatable, intent(out) :: error

      if (needs == needs_nothing) return
      if (.not. allocated(case%model%excitation%t)) then
         call bad_input(error, case%path//': &excitation: found no such group, expected one')
      else if (case%record_line == 0) then
         call bad_input(error, case%path//': &record: found no such group, expected one')
      else if (needs == needs_fit) then
         if (.not. allocated(case%record)) then
            call refuse(case, case%record_line, 'record', 'file', 'nothing', 'the path of a record', error)
         else if (size(case%stages) == 0) then
            call bad_input(error, case%path//': &stage: found no such group, expected one or more')
         end if
      else if (case%window%t_step <= 0 .or. case%window%t_first <= -everything .or. &
               case%window%t_last >= everything) then
         call bad_input(error, case%path//':'//to_text(case%record_line)// &
            ': &record: found no grid of sample times, expected t_first, t_last and t_step')
      end if
   end subroutine check_needs

   subroutine read_beam(block, case, error)
      type(block_t), intent(in) :: block
      type(case_t), intent(inout) :: case
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: length, rho, E, I, width, height, c_D
      integer :: status
      namelist /beam/ length, rho, E, I, width, height, c_D

      length = 0; rho = 0; E = 0; I = 0; width = 0; height = 0; c_D = 0
      read (block%text, nml=beam, iostat=status)
      call accept(case, block, status, error)
      call require(case, block, [character(len=6) :: 'length', 'rho', 'E'], error)
      if (allocated(error)) return
      if (block%has('I') .eqv. (block%has('width') .or. block%has('height'))) then
         call refuse(case, block%line, 'beam', 'I', merge('both I and width or height', &
            'no cross section          ', block%has('I')), 'either I or width and height', error)
         return
      end if
      if (.not. block%has('I')) then
         call require(case, block, [character(len=6) :: 'width', 'height'], error)
         call positive(case, block, 'width', width, error)
         call positive(case, block, 'height', height, error)
         if (allocated(error)) return
         I = width*height**3/12
      end if
      case%model%structure%length = length
      case%model%structure%rho = rho
      case%model%structure%E = E
      case%model%structure%I = I
      case%model%structure%c_D = c_D
      call accept_structure(case, block, error)
   end subroutine read_beam

   subroutine read_tip(block, case, error)
      type(block_t), intent(in) :: block
      type(case_t), intent(inout) :: case
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: m_T
      integer :: status
      namelist /tip/ m_T

      m_T = 0
      read (block%text, nml=tip, iostat=status)
      call accept(case, block, status, error)
      if (allocated(error)) return
      case%model%structure%m_T = m_T
      call accept_structure(case, block, error)
   end subroutine read_tip

   subroutine read_hose(block, case, error)
      type(block_t), intent(in) :: block
      type(case_t), intent(inout) :: case
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: m_H, c_H, k_H
      integer :: status
      namelist /hose/ m_H, c_H, k_H

      m_H = 0; c_H = 0; k_H = 0
      read (block%text, nml=hose, iostat=status)
      call accept(case, block, status, error)
      call require(case, block, ['m_H'], error)
      if (allocated(error)) return
      case%model%structure%m_H = m_H
      case%model%structure%c_H = c_H
      case%model%structure%k_H = k_H
      call accept_structure(case, block, error)
   end subroutine read_hose

   subroutine read_excitation(block, case, error)
      type(block_t), intent(in) :: block
      type(case_t), intent(inout) :: case
      type(error_t), allocatable, intent(out) :: error
      character(len=string_length) :: kind, file, load
      real(wp) :: amplitude, duration, power
      integer :: status
      namelist /excitation/ kind, amplitude, duration, file, load, power

      kind = ''; file = ''; load = 'point'; amplitude = 0; duration = 0; power = 2
      read (block%text, nml=excitation, iostat=status)
      call accept(case, block, status, error)
      call require(case, block, ['kind'], error)
      if (allocated(error)) return
      select case (kind)
      case ('pulse')
         call require(case, block, [character(len=9) :: 'amplitude', 'duration'], error)
         call exclude(case, block, [character(len=9) :: 'file'], 'with kind = ''pulse''', error)
         call positive(case, block, 'duration', duration, error)
         if (allocated(error)) return
         case%model%excitation = new_pulse(amplitude, duration)
      case ('table')
         call require(case, block, ['file'], error)
         call exclude(case, block, [character(len=9) :: 'amplitude', 'duration'], &
            'with kind = ''table''', error)
         if (allocated(error)) return
         call read_force(join_path(directory_of(case%path), trim(file)), case, error)
         if (allocated(error)) return
      case default
         call refuse(case, block%line_of('kind'), 'excitation', 'kind', quoted(kind), &
            '''pulse'' or ''table''', error)
         return
      end select
      if (load /= 'point' .and. load /= 'distributed') then
         call refuse(case, block%line_of('load'), 'excitation', 'load', quoted(load), &
            '''point'' or ''distributed''', error)
      else if (.not. power >= 2) then
         call refuse(case, block%line_of('power'), 'excitation', 'power', to_text(power), &
            '2 or more', error)
      end if
      case%model%excitation%distributed = load == 'distributed'
      case%model%excitation%power = power
   end subroutine read_excitation

   !> Force table: time and force, the first two columns.
   subroutine read_force(path, case, error)
      character(len=*), intent(in) :: path
      type(case_t), intent(inout) :: case
      type(error_t), allocatable, intent(out) :: error
      character(len=column_length), allocatable :: header(:)
      real(wp), allocatable :: values(:, :)

      call read_columns(path, 2, values, header, error, increasing=.true.)
      if (allocated(error)) return
      call new_force_table(values(1, :), values(2, :), case%model%excitation, error)
      if (allocated(error)) error%message = path//': '//error%message
   end subroutine read_force

   subroutine read_discretization(block, case, error)
      type(block_t), intent(in) :: block
      type(case_t), intent(inout) :: case
      type(error_t), allocatable, intent(out) :: error
      integer :: degree, elements(max_list), gauss_points, panels, status, n, k
      namelist /discretization/ degree, elements, gauss_points, panels

      case%meshes(1) = mesh_t()
      degree = case%meshes(1)%degree; elements = case%meshes(1)%elements; gauss_points = 0; panels = 1
      read (block%text, nml=discretization, iostat=status)
      call accept(case, block, status, error)
      if (allocated(error)) return
      if (.not. any(degree == [3, 5, 7])) then
         call refuse(case, block%line_of('degree'), 'discretization', 'degree', to_text(degree), &
            '3, 5 or 7', error)
         return
      end if
      ! Left out, the rule is exact for the products of two splines.
      if (.not. block%has('gauss_points')) gauss_points = degree + 1
      call in_range(case, block, 'gauss_points', gauss_points, 1, 64, error)
      call in_range(case, block, 'panels', panels, 1, 1000, error)
      n = max(1, block%count_of('elements'))
      do k = 1, n
         call in_range(case, block, 'elements', elements(k), 1, max_elements, error)
         if (allocated(error)) return
         if (any(elements(:k - 1) == elements(k))) then
            call refuse(case, block%line_of('elements'), 'discretization', 'elements', &
               to_text(elements(k))//' twice', 'each number once', error)
            return
         end if
      end do
      if (allocated(error)) return
      if (gauss_points*panels < degree - 1) then
         call refuse(case, block%line_of('gauss_points'), 'discretization', 'gauss_points', &
            to_text(gauss_points*panels)//' points per element', 'at least degree - 1 = '// &
            to_text(degree - 1), error)
         return
      end if
      case%meshes = [(mesh_t(degree, elements(k), gauss_points, panels), k=1, n)]
   end subroutine read_discretization

   subroutine read_integrator(block, case, error)
      type(block_t), intent(in) :: block
      type(case_t), intent(inout) :: case
      type(error_t), allocatable, intent(out) :: error
      type(cvode_t) :: solver
      character(len=string_length) :: method
      real(wp) :: rtol, atol
      integer :: max_order, max_steps, status
      namelist /integrator/ method, rtol, atol, max_order, max_steps

      method = 'modal'; rtol = solver%rtol; atol = 0
      max_order = solver%max_order; max_steps = int(solver%max_steps)
      read (block%text, nml=integrator, iostat=status)
      call accept(case, block, status, error)
      if (allocated(error)) return
      if (method /= 'cvode' .and. method /= 'modal') then
         call refuse(case, block%line_of('method'), 'integrator', 'method', quoted(method), &
            '''modal'' or ''cvode''', error)
      else if (.not. (rtol >= 1e-14_wp .and. rtol <= 1e-1_wp)) then
         call refuse(case, block%line_of('rtol'), 'integrator', 'rtol', to_text(rtol), &
            '1E-14 to 0.1', error)
      else if (block%has('atol') .and. .not. atol > 0) then
         call refuse(case, block%line_of('atol'), 'integrator', 'atol', to_text(atol), &
            'a value above 0', error)
      end if
      call in_range(case, block, 'max_order', max_order, 1, 5, error)
      call in_range(case, block, 'max_steps', max_steps, 1, huge(max_steps), error)
      if (allocated(error)) return
      if (method == 'modal') then
         case%model%solver = modal_t()
         return
      end if
      solver%rtol = rtol
      solver%atol = atol
      solver%max_order = max_order
      solver%max_steps = int(max_steps, ip)
      case%model%solver = solver
   end subroutine read_integrator

   subroutine read_observation(block, case, error)
      type(block_t), intent(in) :: block
      type(case_t), intent(inout) :: case
      type(error_t), allocatable, intent(out) :: error
      character(len=string_length) :: formula
      real(wp) :: delta
      integer :: status, k
      namelist /observation/ formula, delta

      formula = 'equation'; delta = 0
      read (block%text, nml=observation, iostat=status)
      call accept(case, block, status, error)
      if (allocated(error)) return
      k = findloc(formula_names == formula, .true., dim=1)
      if (k == 0) then
         call refuse(case, block%line_of('formula'), 'observation', 'formula', quoted(formula), &
            ''''//trim(formula_names(1))//''', '''//trim(formula_names(2))//''' or '''// &
            trim(formula_names(3))//'''', error)
      else if (formula == 'equation') then
         call exclude(case, block, ['delta'], 'with formula = ''equation''', error)
      else
         call require(case, block, ['delta'], error)
         call positive(case, block, 'delta', delta, error)
      end if
      case%model%observation%formula = k
      case%model%observation%delta = delta
   end subroutine read_observation

   subroutine read_window(block, case, error)
      type(block_t), intent(in) :: block
      type(case_t), intent(inout) :: case
      type(error_t), allocatable, intent(out) :: error
      character(len=string_length) :: file
      real(wp) :: t_first, t_last, t_step
      integer :: status
      namelist /record/ file, t_first, t_last, t_step

      file = ''; t_first = -everything; t_last = everything; t_step = 0
      read (block%text, nml=record, iostat=status)
      call accept(case, block, status, error)
      if (block%has('t_step')) call positive(case, block, 't_step', t_step, error)
      if (allocated(error)) return
      if (t_last < t_first) then
         call refuse(case, block%line_of('t_last'), 'record', 't_last', to_text(t_last), &
            'no less than t_first = '//to_text(t_first), error)
         return
      end if
      case%record_line = block%line
      case%window = window_t(t_first, t_last, t_step)
      if (.not. block%has('file')) return
      if (file == '') then
         call refuse(case, block%line_of('file'), 'record', 'file', '''''', 'the path of a record', error)
         return
      end if
      case%record = join_path(directory_of(case%path), trim(file))
   end subroutine read_window

   subroutine read_noise(block, case, error)
      type(block_t), intent(in) :: block
      type(case_t), intent(inout) :: case
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: sd
      integer :: seed, status
      namelist /noise/ sd, seed

      sd = 0; seed = 1
      read (block%text, nml=noise, iostat=status)
      call accept(case, block, status, error)
      call require(case, block, ['sd'], error)
      if (.not. allocated(error) .and. .not. sd >= 0) call refuse(case, block%line_of('sd'), 'noise', &
         'sd', to_text(sd), '0 or more', error)
      case%noise_sd = sd
      case%noise_seed = seed
   end subroutine read_noise

   subroutine read_stage(block, case, error)
      type(block_t), intent(in) :: block
      type(case_t), intent(inout) :: case
      type(error_t), allocatable, intent(out) :: error
      character(len=string_length) :: free(size(free_names))
      real(wp), dimension(size(free_names)) :: start, lower, upper
      type(stage_t) :: found
      integer :: status, n, k
      namelist /stage/ free, start, lower, upper

      free = ''; start = 0; lower = 0; upper = unbounded
      read (block%text, nml=stage, iostat=status)
      call accept(case, block, status, error)
      call require(case, block, ['free'], error)
      if (allocated(error)) return
      n = block%count_of('free')
      call same_count('start')
      call same_count('lower')
      call same_count('upper')
      if (allocated(error)) return
      allocate (found%free(0))
      do k = 1, n
         associate (p => free_index(free(k)), s => case%model%structure)
            if (p > 0 .and. .not. block%has('lower')) then
               if (may_be_negative(p)) lower(k) = -unbounded
            end if
            if (p == 0) then
               call refuse(case, block%line_of('free'), 'stage', 'free', quoted(free(k)), &
                  'one of'//known_parameters(), error)
            else if (any(found%free == p)) then
               call refuse(case, block%line_of('free'), 'stage', 'free', quoted(free(k))//' twice', &
                  'each parameter once', error)
            else if (belongs_to_hose(p) .and. .not. s%has_hose()) then
               call refuse(case, block%line_of('free'), 'stage', 'free', quoted(free(k)), &
                  'a &hose group with m_H > 0 for it', error)
            else if (.not. (lower(k) >= 0 .or. may_be_negative(p))) then
               call refuse(case, block%line_of('lower'), 'stage', 'lower', to_text(lower(k)), &
                  '0 or more', error)
            else if (.not. upper(k) > lower(k)) then
               call refuse(case, block%line_of('upper'), 'stage', 'upper', to_text(upper(k)), &
                  'more than lower = '//to_text(lower(k)), error)
            else if (block%has('start')) then
               if (start(k) < lower(k) .or. start(k) > upper(k)) call refuse(case, &
                  block%line_of('start'), 'stage', 'start', to_text(start(k))//' for '// &
                  trim(free_names(p)), 'a value between '//to_text(lower(k))//' and '// &
                  upper_text(upper(k)), error)
            end if
            if (allocated(error)) return
            found%free = [found%free, p]
         end associate
      end do
      if (block%has('start')) found%start = start(:n)
      found%lower = lower(:n)
      found%upper = upper(:n)
      case%stages = [case%stages, found]
      case%stage_lines = [case%stage_lines, block%line]

   contains

      subroutine same_count(key)
         character(len=*), intent(in) :: key

         if (allocated(error) .or. .not. block%has(key)) return
         if (block%count_of(key) /= n) call refuse(case, block%line_of(key), 'stage', key, &
            to_text(block%count_of(key))//' values', to_text(n)//', one for each of free', error)
      end subroutine same_count

      function upper_text(value) result(text)
         real(wp), intent(in) :: value
         character(len=:), allocatable :: text

         text = 'any larger one'
         if (value < unbounded) text = to_text(value)
      end function upper_text

   end subroutine read_stage

   subroutine read_units(block, case, error)
      type(block_t), intent(in) :: block
      type(case_t), intent(inout) :: case
      type(error_t), allocatable, intent(out) :: error
      character(len=string_length) :: length, force, time, mass
      integer :: status
      namelist /units/ length, force, time, mass

      length = ''; force = ''; time = ''; mass = ''
      read (block%text, nml=units, iostat=status)
      call accept(case, block, status, error)
      call label('length', length)
      call label('force', force)
      call label('time', time)
      call label('mass', mass)
      if (allocated(error)) return
      case%units%length = trim(length)
      case%units%force = trim(force)
      case%units%time = trim(time)
      case%units%mass = trim(mass)

   contains

      !> Labels go into tables of comma-separated fields.
      subroutine label(key, text)
         character(len=*), intent(in) :: key, text

         if (scan(text, ',"') > 0) call refuse(case, block%line_of(key), 'units', key, quoted(text), &
            'a label without commas and double quotes', error)
      end subroutine label

   end subroutine read_units

   !> The grid of sample times of &record, for a response without a record.
   subroutine sample_times(case, times, error)
      type(case_t), intent(in) :: case
      real(wp), allocatable, intent(out) :: times(:)
      type(error_t), allocatable, intent(out) :: error

      call grid(case%window, times, error)
      if (allocated(error)) error%message = case%path//':'//to_text(case%record_line)// &
         ': &record t_step: '//error%message
   end subroutine sample_times

   !> Reads the record and takes the samples of the window; refuses fewer samples than parameters.
   !>
   !> samples, measured  (m) [time], [length/time**2]
   subroutine measured_samples(case, samples, measured, error)
      type(case_t), intent(in) :: case
      real(wp), allocatable, intent(out) :: samples(:), measured(:)
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: t(:), z(:)
      integer :: k

      call read_record(case%record, t, z, error)
      if (allocated(error)) return
      call take_samples(case%window, t, z, samples, measured, error)
      if (allocated(error)) then
         error%message = case%path//':'//to_text(case%record_line)//': &record: '//case%record//': '// &
            error%message
         return
      end if
      do k = 1, size(case%stages)
         if (size(case%stages(k)%free) <= size(samples)) cycle
         call refuse(case, case%stage_lines(k), 'stage', 'free', to_text(size(case%stages(k)%free))// &
            ' parameters for '//to_text(size(samples))//' samples', 'no more parameters than samples', error)
         return
      end do
   end subroutine measured_samples

   !> A range check of the structure gets file, line and group.
   subroutine accept_structure(case, block, error)
      type(case_t), intent(in) :: case
      type(block_t), intent(in) :: block
      type(error_t), allocatable, intent(out) :: error
      character(len=:), allocatable :: key
      integer :: line

      call check_structure(case%model%structure, error)
      if (.not. allocated(error)) return
      key = error%message(:index(error%message, ':') - 1)
      line = block%line_of(key)
      error%message = case%path//':'//to_text(line)//': &'//trim(block%name)//' '//error%message
   end subroutine accept_structure

   !> The scanner let the text pass; should the namelist reader not take it, say so.
   subroutine accept(case, block, status, error)
      type(case_t), intent(in) :: case
      type(block_t), intent(in) :: block
      integer, intent(in) :: status
      type(error_t), allocatable, intent(inout) :: error

      if (status /= 0) call bad_input(error, case%path//':'//to_text(block%line)//': &'// &
         trim(block%name)//': found a group that cannot be read, expected key = value, ... /')
   end subroutine accept

   !> Refuses a group without one of the keys.
   subroutine require(case, block, keys, error)
      type(case_t), intent(in) :: case
      type(block_t), intent(in) :: block
      character(len=*), intent(in) :: keys(:)
      type(error_t), allocatable, intent(inout) :: error
      integer :: k

      do k = 1, size(keys)
         if (allocated(error)) return
         if (.not. block%has(trim(keys(k)))) call refuse(case, block%line, trim(block%name), &
            trim(keys(k)), 'nothing', 'a value', error)
      end do
   end subroutine require

   !> Refuses keys that have no meaning beside another.
   subroutine exclude(case, block, keys, beside, error)
      type(case_t), intent(in) :: case
      type(block_t), intent(in) :: block
      character(len=*), intent(in) :: keys(:), beside
      type(error_t), allocatable, intent(inout) :: error
      integer :: k

      do k = 1, size(keys)
         if (allocated(error)) return
         if (block%has(trim(keys(k)))) call refuse(case, block%line_of(trim(keys(k))), &
            trim(block%name), trim(keys(k)), 'a value', 'none '//beside, error)
      end do
   end subroutine exclude

   subroutine positive(case, block, key, value, error)
      type(case_t), intent(in) :: case
      type(block_t), intent(in) :: block
      character(len=*), intent(in) :: key
      real(wp), intent(in) :: value
      type(error_t), allocatable, intent(inout) :: error

      if (allocated(error) .or. value > 0) return
      call refuse(case, block%line_of(key), trim(block%name), key, to_text(value), 'a value above 0', error)
   end subroutine positive

   subroutine in_range(case, block, key, value, smallest, largest, error)
      type(case_t), intent(in) :: case
      type(block_t), intent(in) :: block
      character(len=*), intent(in) :: key
      integer, intent(in) :: value, smallest, largest
      type(error_t), allocatable, intent(inout) :: error

      if (allocated(error) .or. value >= smallest .and. value <= largest) return
      call refuse(case, block%line_of(key), trim(block%name), key, to_text(value), &
         to_text(smallest)//' to '//to_text(largest), error)
   end subroutine in_range

   !> `file:line: &group key: found ..., expected ...`
   subroutine refuse(case, line, group_name, key, found, expected, error)
      type(case_t), intent(in) :: case
      integer, intent(in) :: line
      character(len=*), intent(in) :: group_name, key, found, expected
      type(error_t), allocatable, intent(inout) :: error

      if (allocated(error)) return
      call bad_input(error, case%path//':'//to_text(line)//': &'//group_name//' '//key//': found '// &
         trim(found)//', expected '//expected)
   end subroutine refuse

   !> Text in quotes, cut where it grows long.
   pure function quoted(text)
      character(len=*), intent(in) :: text
      character(len=:), allocatable :: quoted

      quoted = ''''//trim(text(:min(40, len(text))))//''''
   end function quoted

   pure function known_parameters() result(text)
      character(len=:), allocatable :: text
      integer :: k

      text = ''
      do k = 1, size(free_names)
         text = text//' '//trim(free_names(k))
      end do
   end function known_parameters

   !> File name without folder and ending.
   pure function name_of(path) result(name)
      character(len=*), intent(in) :: path
      character(len=:), allocatable :: name
      integer :: dot

      name = path(index(path, '/', back=.true.) + 1:)
      dot = index(name, '.', back=.true.)
      if (dot > 1) name = name(:dot - 1)
   end function name_of

end module beamid_cases
