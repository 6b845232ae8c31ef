!> The groups of a case file that say how to compute: mesh, integrator, observation, stages of a
!> fit. Each procedure reads one group, checks every value, and leaves its argument alone on error.
module beamid_method_groups
   use beamid_cvode, only: cvode_t
   use beamid_errors, only: error_t
   use beamid_galerkin, only: mesh_t
   use beamid_identification, only: stage_t
   use beamid_kinds, only: wp, ip
   use beamid_modal, only: modal_t
   use beamid_multistart, only: multistart_t
   use beamid_namelist, only: block_t, string_length
   use beamid_observation, only: formula_names, observation_t
   use beamid_excitation, only: excitation_t
   use beamid_parameters, only: amplitude, belongs_to_hose, free_index, free_names, &
      may_be_negative, offset, parameters
   use beamid_refusals, only: accept, exclude, in_range, positive, quoted, refuse, require
   use beamid_responses, only: solver_t
   use beamid_vocabulary, only: max_list
   use beamid_strings, only: to_text
   use beamid_structure, only: of_k_R, structure_t
   use beamid_variables, only: unbounded
   implicit none
   private

   public :: read_discretization, read_integrator, read_multistart, read_observation, read_stage

   !> More elements than this are taken for a slip of the pen.
   integer, parameter :: max_elements = 10000

contains

   subroutine read_discretization(path, block, meshes, error)
      character(len=*), intent(in) :: path
      type(block_t), intent(in) :: block
      type(mesh_t), allocatable, intent(inout) :: meshes(:)
      type(error_t), allocatable, intent(out) :: error
      integer :: degree, elements(max_list), gauss_points, panels, status, n, k
      namelist /discretization/ degree, elements, gauss_points, panels

      meshes(1) = mesh_t()
      degree = meshes(1)%degree; elements = meshes(1)%elements; gauss_points = 0; panels = 1
      read (block%text, nml=discretization, iostat=status)
      call accept(path, block, status, error)
      if (allocated(error)) return
      if (.not. any(degree == [3, 5, 7])) then
         call refuse(path, block%line_of('degree'), 'discretization', 'degree', to_text(degree), &
            '3, 5 or 7', error)
         return
      end if
      ! Left out, the rule is exact for the products of two splines.
      if (.not. block%has('gauss_points')) gauss_points = degree + 1
      call in_range(path, block, 'gauss_points', gauss_points, 1, 64, error)
      call in_range(path, block, 'panels', panels, 1, 1000, error)
      n = max(1, block%count_of('elements'))
      do k = 1, n
         call in_range(path, block, 'elements', elements(k), 1, max_elements, error)
         if (allocated(error)) return
         if (any(elements(:k - 1) == elements(k))) then
            call refuse(path, block%line_of('elements'), 'discretization', 'elements', &
               to_text(elements(k))//' twice', 'each number once', error)
            return
         end if
      end do
      if (allocated(error)) return
      if (gauss_points*panels < degree - 1) then
         call refuse(path, block%line_of('gauss_points'), 'discretization', 'gauss_points', &
            to_text(gauss_points*panels)//' points per element', 'at least degree - 1 = '// &
            to_text(degree - 1), error)
         return
      end if
      meshes = [(mesh_t(degree, elements(k), gauss_points, panels), k=1, n)]
   end subroutine read_discretization

   subroutine read_integrator(path, block, chosen, error)
      character(len=*), intent(in) :: path
      type(block_t), intent(in) :: block
      class(solver_t), allocatable, intent(inout) :: chosen
      type(error_t), allocatable, intent(out) :: error
      type(cvode_t) :: solver
      character(len=string_length) :: method
      real(wp) :: rtol, atol
      integer :: max_order, max_steps, status
      namelist /integrator/ method, rtol, atol, max_order, max_steps

      method = 'modal'; rtol = solver%rtol; atol = 0
      max_order = solver%max_order; max_steps = int(solver%max_steps)
      read (block%text, nml=integrator, iostat=status)
      call accept(path, block, status, error)
      if (allocated(error)) return
      if (method /= 'cvode' .and. method /= 'modal') then
         call refuse(path, block%line_of('method'), 'integrator', 'method', quoted(method), &
            '''modal'' or ''cvode''', error)
      else if (.not. (rtol >= 1e-14_wp .and. rtol <= 1e-1_wp)) then
         call refuse(path, block%line_of('rtol'), 'integrator', 'rtol', to_text(rtol), &
            '1E-14 to 0.1', error)
      else if (block%has('atol') .and. .not. atol > 0) then
         call refuse(path, block%line_of('atol'), 'integrator', 'atol', to_text(atol), &
            'a value above 0', error)
      end if
      call in_range(path, block, 'max_order', max_order, 1, 5, error)
      call in_range(path, block, 'max_steps', max_steps, 1, huge(max_steps), error)
      if (allocated(error)) return
      if (method == 'modal') then
         chosen = modal_t()
         return
      end if
      solver%rtol = rtol
      solver%atol = atol
      solver%max_order = max_order
      solver%max_steps = int(max_steps, ip)
      chosen = solver
   end subroutine read_integrator

   subroutine read_multistart(path, block, plan, error)
      character(len=*), intent(in) :: path
      type(block_t), intent(in) :: block
      type(multistart_t), intent(inout) :: plan
      type(error_t), allocatable, intent(out) :: error
      integer :: n, seed, status
      real(wp) :: spread
      namelist /multistart/ n, seed, spread

      n = 20; seed = plan%seed; spread = plan%spread
      read (block%text, nml=multistart, iostat=status)
      call accept(path, block, status, error)
      call in_range(path, block, 'n', n, 1, 100000, error)
      if (allocated(error)) return
      if (.not. (spread > 1 .and. spread <= 1e6_wp)) then
         call refuse(path, block%line_of('spread'), 'multistart', 'spread', to_text(spread), &
            'a factor above 1, up to 1e6', error)
         return
      end if
      plan = multistart_t(n, seed, spread)
   end subroutine read_multistart

   subroutine read_observation(path, block, observed, error)
      character(len=*), intent(in) :: path
      type(block_t), intent(in) :: block
      type(observation_t), intent(inout) :: observed
      type(error_t), allocatable, intent(out) :: error
      character(len=string_length) :: formula
      real(wp) :: delta
      integer :: status, k
      namelist /observation/ formula, delta

      formula = 'equation'; delta = 0
      read (block%text, nml=observation, iostat=status)
      call accept(path, block, status, error)
      if (allocated(error)) return
      k = findloc(formula_names == formula, .true., dim=1)
      if (k == 0) then
         call refuse(path, block%line_of('formula'), 'observation', 'formula', quoted(formula), &
            ''''//trim(formula_names(1))//''', '''//trim(formula_names(2))//''' or '''// &
            trim(formula_names(3))//'''', error)
      else if (formula == 'equation') then
         call exclude(path, block, ['delta'], 'with formula = ''equation''', error)
      else
         call require(path, block, ['delta'], error)
         call positive(path, block, 'delta', delta, error)
      end if
      observed%formula = k
      observed%delta = delta
   end subroutine read_observation

   !> records      how many there are: a parameter that is not shared gets a value for each
   !> excitations  of the case
   subroutine read_stage(path, block, structure, records, excitations, found, error)
      character(len=*), intent(in) :: path
      type(block_t), intent(in) :: block
      type(structure_t), intent(in) :: structure
      integer, intent(in) :: records
      type(excitation_t), intent(in) :: excitations(:)
      type(stage_t), intent(out) :: found
      type(error_t), allocatable, intent(out) :: error
      character(len=string_length) :: free(size(free_names)), shared(size(free_names)), start_from
      real(wp), dimension(size(free_names)) :: start, lower, upper
      integer, allocatable :: together(:)
      integer :: status, n, k
      namelist /stage/ free, shared, start, start_from, lower, upper

      free = ''; shared = ''; start = 0; start_from = ''; lower = 0; upper = unbounded
      read (block%text, nml=stage, iostat=status)
      call accept(path, block, status, error)
      call require(path, block, ['free'], error)
      if (allocated(error)) return
      n = block%count_of('free')
      call same_count('start')
      call same_count('lower')
      call same_count('upper')
      if (allocated(error)) return
      allocate (found%free(0))
      do k = 1, n
         associate (p => free_index(free(k)), s => structure)
            if (p > 0 .and. .not. block%has('lower')) then
               if (may_be_negative(p)) lower(k) = -unbounded
            end if
            if (p == 0) then
               call refuse(path, block%line_of('free'), 'stage', 'free', quoted(free(k)), &
                  'one of'//known_parameters(), error)
            else if (any(found%free == p)) then
               call refuse(path, block%line_of('free'), 'stage', 'free', quoted(free(k))// &
                  ' twice', &
                  'each parameter once', error)
            else if (parameters(p)%needs == of_k_R .and. .not. s%has_soft_root()) then
               call refuse(path, block%line_of('free'), 'stage', 'free', quoted(free(k)), &
                  'a value of k_R in &beam for it', error)
            else if (p == amplitude .and. any(excitations%modes > 0)) then
               call refuse(path, block%line_of('free'), 'stage', 'free', quoted(free(k)), &
                  'no amplitude beside a free start', error)
            else if (belongs_to_hose(p) .and. .not. s%has_hose()) then
               call refuse(path, block%line_of('free'), 'stage', 'free', quoted(free(k)), &
                  'a &hose group with m_H > 0 for it', error)
            else if (.not. (lower(k) >= 0 .or. may_be_negative(p))) then
               call refuse(path, block%line_of('lower'), 'stage', 'lower', to_text(lower(k)), &
                  '0 or more', error)
            else if (.not. upper(k) > lower(k)) then
               call refuse(path, block%line_of('upper'), 'stage', 'upper', to_text(upper(k)), &
                  'more than lower = '//to_text(lower(k)), error)
            else if (block%has('start')) then
               if (start(k) < lower(k) .or. start(k) > upper(k)) call refuse(path, &
                  block%line_of('start'), 'stage', 'start', to_text(start(k))//' for '// &
                  trim(free_names(p)), 'a value between '//to_text(lower(k))//' and '// &
                  upper_text(upper(k)), error)
            end if
            if (allocated(error)) return
            if (p == offset) found%offset = .true.
            found%free = [found%free, p]
         end associate
      end do
      found%lower = lower(:n)
      found%upper = upper(:n)
      if (block%has('start')) found%start = start(:n)
      if (block%has('start_from') .and. start_from /= 'auto') then
         call refuse(path, block%line_of('start_from'), 'stage', 'start', quoted(start_from), &
            'numbers or ''auto''', error)
         return
      end if
      found%automatic = block%has('start_from')
      call read_shared(together)
      if (.not. allocated(error)) call found%distribute(together, records)

   contains

      subroutine same_count(key)
         character(len=*), intent(in) :: key

         if (allocated(error) .or. .not. block%has(key)) return
         if (block%count_of(key) /= n) call refuse(path, block%line_of(key), 'stage', key, &
            to_text(block%count_of(key))//' values', to_text(n)//', one for each of free', error)
      end subroutine same_count

      !> Places of the parameters that all records have in common.
      subroutine read_shared(places)
         integer, allocatable, intent(out) :: places(:)
         integer :: j, place

         allocate (places(0))
         if (.not. block%has('shared')) then
            places = found%free
            return
         end if
         do j = 1, block%count_of('shared')
            place = free_index(shared(j))
            if (any(found%free == place)) then
               places = [places, place]
            else
               call refuse(path, block%line_of('shared'), 'stage', 'shared', quoted(shared(j)), &
                  'parameters that are free', error)
               return
            end if
         end do
      end subroutine read_shared

      function upper_text(value) result(text)
         real(wp), intent(in) :: value
         character(len=:), allocatable :: text

         text = 'any larger one'
         if (value < unbounded) text = to_text(value)
      end function upper_text

   end subroutine read_stage

   pure function known_parameters() result(text)
      character(len=:), allocatable :: text
      integer :: k

      text = ''
      do k = 1, size(free_names)
         if (parameters(k)%is_free) text = text//' '//trim(free_names(k))
      end do
   end function known_parameters

end module beamid_method_groups
