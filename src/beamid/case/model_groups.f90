!> Readers of the groups of a case file that describe the structure, the unit labels and the
!> simulated noise. `beamid_case_files` calls them.
module beamid_model_groups
   use beamid_along_groups, only: along_t, reference_of
   use beamid_blocks, only: block_t
   use beamid_kinds, only: wp
   use beamid_numbers, only: shown
   use beamid_parameters, only: any_value, as_named, key_of, parameters, &
      zero_or_more => not_negative
   use beamid_strings, only: lower, to_text
   use beamid_structure, only: c_R_at, item_name_length, kappa_R_at, n_parameters, no_spring, &
      of_x_F, root, structure_t, tip
   use beamid_tokens, only: digits, letters
   use beamid_units, only: label_length, units_t
   use beamid_values, only: not_negative, positive, range_t
   implicit none
   private

   public :: section_t, read_structure, read_parameter, read_units, read_noise

   !> Rectangular cross section: I = width height**3/12, and rho = density width height if the
   !> density is given. 0: not given.
   type :: section_t
      real(wp) :: width = 0      !< b [length]
      real(wp) :: height = 0     !< h, in the direction of the vibration [length]
      real(wp) :: density = 0    !< [mass/length**3]
   end type section_t

contains

   !> Reads a group of parameters of the structure: all rows of the table `parameters` that name the
   !> group. Each attachment has a group and a name of its own.
   !>
   !> section  of the beam, set by the group &beam
   !> along    properties that vary along the beam; &beam need not give a value for them
   subroutine read_structure(block, structure, section, along)
      type(block_t), intent(inout) :: block
      type(structure_t), intent(inout) :: structure
      type(section_t), intent(inout) :: section
      type(along_t), intent(in) :: along(:)
      real(wp), allocatable :: value, width, height, density
      character(len=:), allocatable :: direction
      integer :: item, k

      item = 0
      select case (block%name)
      case ('sensor'); call read_name(block, structure%sensors, structure%sensor_name, item)
      case ('support'); call read_name(block, structure%supports, structure%support_name, item)
      case ('mass'); call read_name(block, structure%masses, structure%mass_name, item)
      case ('hose'); call read_name(block, structure%hoses, structure%hose_name, item)
      case ('end'); call read_kind_of_end(block, structure, item)
      end select
      do k = 1, n_parameters
         if (parameters(k)%group /= block%name .or. parameters(k)%item /= item) cycle
         call read_parameter(block, k, value, along)
         if (allocated(value)) call structure%set(k, min(as_named(k, value), huge(value)))
      end do
      if (block%name == 'support' .and. item > 0) then
         associate (support => structure%support(item))
            if (support%kappa_P >= no_spring .and. support%kappa_RP >= no_spring .and. &
               .not. (support%c_P > 0 .or. support%c_RP > 0)) call block%refuse('k_P', '0', &
               'a value above 0, or k_R, c_P or c_R above 0 beside it')
         end associate
      end if
      if (block%name == 'gravity') then
         direction = 'hanging'
         call block%get('direction', direction, 'direction of the beam: ''hanging'' below '// &
            'its root, or ''standing'' above it', [character(len=8) :: 'hanging', 'standing'])
         structure%stands = direction == 'standing'
      end if
      if (block%name == 'beam') then
         call read_root(block, structure)
         call block%get('width', width, 'required without I', 'width of the rectangular section', &
            positive)
         call block%get('height', height, 'required without I', &
            'height of the rectangular section, in the direction of the vibration', positive)
         call block%get('density', density, 'required without rho', 'mass per unit volume', &
            positive)
      end if
      call block%close()
      if (block%failed() .or. block%name /= 'beam') return
      call check_dimension(block, 'width', width)
      call check_dimension(block, 'height', height)
      call check_dimension(block, 'density', density)
      call set_section(block, structure, section, along, width, height, density)
   end subroutine read_structure

   !> Reads which end a group &end describes, and the kind of the end, which sets its springs: rigid
   !> or none.
   !>
   !> item  number of the end, `root` or `tip`
   subroutine read_kind_of_end(block, structure, item)
      type(block_t), intent(inout) :: block
      type(structure_t), intent(inout) :: structure
      integer, intent(out) :: item
      character(len=:), allocatable :: at, kind

      call block%get('at', at, 'end of the beam', [character(len=4) :: 'root', 'tip'], &
         required=.true.)
      call block%get('kind', kind, 'motion that the end cannot make: ''clamped'': deflection '// &
         'and rotation; ''pinned'': deflection; ''guided'': rotation; ''free'': none. Springs '// &
         'of this group replace it', [character(len=7) :: 'clamped', 'pinned', 'guided', &
         'free'], default='''clamped'' at the root, ''free'' at the tip')
      ! The springs are listed in any case, for the help.
      item = root
      if (allocated(at)) item = merge(tip, root, at == 'tip')
      if (block%failed() .or. .not. allocated(at)) return
      if (structure%described(item)) then
         call block%refuse('at', shown(at)//' twice', 'one group for each end')
         return
      end if
      structure%described(item) = .true.
      if (.not. allocated(kind)) return
      associate (end => structure%end(item))
         end%kappa_w = merge(0.0_wp, no_spring, kind == 'clamped' .or. kind == 'pinned')
         end%kappa_R = merge(0.0_wp, no_spring, kind == 'clamped' .or. kind == 'guided')
      end associate
   end subroutine read_kind_of_end

   !> Reads k_R and c_R of &beam, the short form of a root that does not move and rotates against a
   !> spring.
   subroutine read_root(block, structure)
      type(block_t), intent(inout) :: block
      type(structure_t), intent(inout) :: structure
      real(wp), allocatable :: value
      integer :: k

      do k = kappa_R_at(root), c_R_at(root)
         call read_parameter(block, k, value, default=trim(merge('a rigid clamp', '0            ', &
            k == kappa_R_at(root))), help='of the root, as in &end')
         if (.not. allocated(value)) cycle
         call structure%set(k, min(as_named(k, value), huge(value)))
      end do
   end subroutine read_root

   !> Sets I and rho of a structure, either as given or from the rectangular cross section; refuses
   !> the group &beam if it gives too many or too few of these keys.
   !>
   !> width, height, density  as given in the group; not allocated: not given
   subroutine set_section(block, structure, section, along, width, height, density)
      type(block_t), intent(inout) :: block
      type(structure_t), intent(inout) :: structure
      type(section_t), intent(inout) :: section
      type(along_t), intent(in) :: along(:)
      real(wp), allocatable, intent(inout) :: width, height, density

      ! `settle_variations` refuses &along of width or height beside I, and of rho beside density.
      if (.not. block%has('I')) then
         call take_reference(along, 'width', width)
         call take_reference(along, 'height', height)
      end if
      if (allocated(density) .and. .not. block%has('rho')) structure%rho = 0
      if (block%has('I') .eqv. (allocated(width) .or. allocated(height))) then
         call block%refuse('I', trim(merge('both I and width or height', &
            'no cross section          ', block%has('I'))), 'either I or width and height')
      else if (.not. block%has('I')) then
         if (.not. allocated(width)) call block%require('width')
         if (.not. allocated(height)) call block%require('height')
         if (.not. block%failed()) structure%I = width*height**3/12
      end if
      if ((structure%rho > 0) .eqv. allocated(density)) then
         call block%refuse('rho', trim(merge('both rho and density', 'no mass             ', &
            structure%rho > 0)), 'either rho or width, height and density')
      else if (allocated(density)) then
         if (.not. (allocated(width) .and. allocated(height))) then
            call block%refuse('density', to_text(density), 'width and height beside density')
         else if (.not. block%failed()) then
            structure%rho = density*width*height
         end if
      end if
      if (block%failed()) return
      if (allocated(width)) section%width = width
      if (allocated(height)) section%height = height
      if (allocated(density)) section%density = density
   end subroutine set_section

   !> Refuses a dimension so large or small that its powers would overflow or underflow.
   !>
   !> value  not allocated: not given
   subroutine check_dimension(block, key, value)
      type(block_t), intent(inout) :: block
      character(len=*), intent(in) :: key
      real(wp), allocatable, intent(in) :: value
      real(wp), parameter :: smallest = 1e-30_wp, largest = 1e30_wp

      if (.not. allocated(value)) return
      if (value > 0 .and. (value < smallest .or. value > largest)) call block%refuse(key, &
         to_text(value), to_text(smallest)//' to '//to_text(largest)//' in any units')
   end subroutine check_dimension

   !> Reads the value of parameter k of the table `parameters`.
   !>
   !> value    as named in the case file; not allocated: not given
   !> along    properties that vary along the beam, whose values there make the key optional
   !> default  text for the help; absent: that of the table
   !> help     text to follow that of the table
   subroutine read_parameter(block, k, value, along, default, help)
      type(block_t), intent(inout) :: block
      integer, intent(in) :: k
      real(wp), allocatable, intent(inout) :: value
      type(along_t), intent(in), optional :: along(:)
      character(len=*), intent(in), optional :: default, help
      character(len=:), allocatable :: default_text, help_text
      type(range_t) :: range
      logical :: required

      if (allocated(value)) deallocate (value)
      required = parameters(k)%default == ''
      if (present(along)) required = required .and. .not. reference_of(along, key_of(k)) > 0
      range = range_t(0, open=parameters(k)%range /= zero_or_more)
      if (parameters(k)%range == any_value) range = range_t()
      default_text = trim(parameters(k)%default)
      if (present(default)) default_text = default
      help_text = trim(parameters(k)%help)
      if (present(help)) help_text = help_text//', '//help
      call block%get(key_of(k), value, default_text, help_text, range, required=required, &
         infinite=parameters(k)%is_reciprocal)
      if (present(along) .and. parameters(k)%group == 'beam') call take_reference(along, &
         key_of(k), value)
   end subroutine read_parameter

   !> Takes the reference value of a property that varies along the beam if &beam gives no value.
   !>
   !> name   of the property
   !> value  unchanged if it is allocated, or if the property does not vary
   subroutine take_reference(along, name, value)
      type(along_t), intent(in) :: along(:)
      character(len=*), intent(in) :: name
      real(wp), allocatable, intent(inout) :: value

      if (allocated(value)) return
      if (reference_of(along, name) > 0) value = reference_of(along, name)
   end subroutine take_reference

   !> Reads the name of the next attachment of a kind. A single one needs no name; several need
   !> different names.
   !>
   !> n      number of attachments of this kind read so far; increased by one
   !> names  their names
   !> item   number of the new one
   subroutine read_name(block, n, names, item)
      type(block_t), intent(inout) :: block
      integer, intent(inout) :: n
      character(len=item_name_length), intent(inout) :: names(:)
      integer, intent(out) :: item
      character(len=:), allocatable :: name
      integer :: k

      call block%get('name', name, 'name of the '//block%name//', by which other groups '// &
         'refer to it', default='none; required with several groups')
      if (allocated(name)) then
         if (verify(name, letters//digits) > 0 .or. len(name) > item_name_length .or. name == '') &
            call block%refuse('name', shown(name), 'at most '//to_text(item_name_length)// &
            ' letters, digits and _')
         if (block%name /= 'sensor' .and. (lower(name) == 'root' .or. lower(name) == 'tip')) &
            call block%refuse('name', shown(name), 'another name: root and tip are the ends')
      else
         name = ''
      end if
      item = min(n + 1, size(names))
      if (n == size(names)) then
         call block%refuse('name', to_text(n + 1)//' groups &'//block%name, 'at most '//to_text(n))
      else if (n > 0 .and. (name == '' .or. names(1) == '')) then
         call block%refuse('name', 'several groups &'//block%name//', and one without it', &
            'a name for each')
      else if (any([(lower(trim(names(k))) == lower(name), k=1, n)])) then
         call block%refuse('name', shown(name)//' twice', 'a name of its own for each')
      end if
      n = item
      names(n) = name
   end subroutine read_name

   !> Reads the unit labels.
   subroutine read_units(block, labels)
      type(block_t), intent(inout) :: block
      type(units_t), intent(inout) :: labels
      real(wp) :: ratio

      call read_label('length', labels%length)
      call read_label('force', labels%force)
      call read_label('time', labels%time)
      call read_label('mass', labels%mass)
      ratio = labels%force_ratio()
      if (abs(ratio - 1) > 1e-6_wp) call block%refuse('force', shown(trim(labels%force)), &
         'a consistent unit, because the program converts none: 1 '//trim(labels%mass)//' '// &
         trim(labels%length)//'/'//trim(labels%time)//'^2 is '//to_text(ratio)//' '// &
         trim(labels%force)//'; consistent are m, N, s, kg or mm, N, s, t')
      call block%close()

   contains

      !> Reads one label and refuses labels that would break a field of a table (commas, quotes).
      subroutine read_label(key, label)
         character(len=*), intent(in) :: key
         character(len=*), intent(inout) :: label
         character(len=:), allocatable :: text

         call block%get(key, text, 'label of the unit of '//key//' in the output', default='none')
         if (.not. allocated(text)) return
         if (scan(text, ',"') > 0 .or. len(text) > label_length) call block%refuse(key, &
            shown(text), 'a label without commas and double quotes, of at most '// &
            to_text(label_length)//' characters')
         label = text
      end subroutine read_label

   end subroutine read_units

   !> Reads the noise that `simulate` adds to a record.
   !>
   !> sd    standard deviation [acceleration]
   !> seed  of the random numbers
   subroutine read_noise(block, sd, seed)
      type(block_t), intent(inout) :: block
      real(wp), intent(inout) :: sd
      integer, intent(inout) :: seed

      call block%get('sd', sd, 'standard deviation of the noise of the acceleration', &
         not_negative, required=.true.)
      call block%get('seed', seed, 'seed of the random numbers')
      call block%close()
   end subroutine read_noise

end module beamid_model_groups
