!> The layers of src/: each folder uses those below it and no other, no two modules need each other,
!> and none of them prints or stops.
program test_modules
   use checks, only: check, finish
   implicit none

   !> A folder, and after the colon those that it may use.
   character(len=*), parameter :: layers(*) = [character(len=120) :: &
      'support:', &
      'model: support', &
      'discretization: support model', &
      'dynamics: support model discretization', &
      'fit: support', &
      'record: support', &
      'problem: support model discretization dynamics fit', &
      'starts: support model fit record problem', &
      'identification: support model discretization dynamics fit problem starts', &
      'judgement: support model discretization dynamics fit record problem starts '// &
         'identification', &
      'inference: support model discretization fit problem starts identification', &
      'case: support model discretization dynamics fit record problem identification inference', &
      'workflows: support model discretization dynamics fit record problem starts '// &
         'identification judgement inference case', &
      'report: support model discretization dynamics fit problem identification judgement '// &
         'inference case workflows', &
      'paper: support model discretization dynamics problem identification']
   !> Rooms whose procedures run in threads, and their modules with functions whose result is text
   !> of deferred length. gfortran keeps this length in static memory, so that no thread may call
   !> them: they write units, sentences for reports, and messages about input.
   character(len=*), parameter :: rooms = 'model discretization dynamics fit problem starts '// &
      'identification judgement'
   character(len=*), parameter :: with_texts(*) = [character(len=80) :: &
      'fit/undetermined_directions.f90', 'judgement/scores.f90', 'judgement/verdicts.f90', &
      'judgement/weak_estimates.f90', 'model/mechanisms.f90', 'model/parameter_names.f90', &
      'model/units.f90', 'problem/frequency_responses.f90', 'problem/modal_tables.f90', &
      'problem/observed_data.f90']
   character(len=*), parameter :: deferred_result = "'(?s)function (?:\w+\([^)]*\)[ &\n]*"// &
      "result\((\w+)\)|(\w+)\([^)]*\))\n(?:(?!end function).)*?"// &
      "character\(len=:\), allocatable :: [^\n]*\b(?:\1|\2)\b'"
   character(len=*), parameter :: scratch = 'build/test_modules.txt'
   character(len=80), allocatable :: uses(:, :), files(:), lines(:)
   character(len=80) :: word
   integer :: k

   call search("-oE '^ *use beamid_[a-z0-9_]+' src/beamid", lines)
   allocate (uses(2, size(lines)))
   do k = 1, size(lines)
      ! folder/module.f90:   use beamid_other
      uses(1, k) = lines(k)(:index(lines(k), '.f90:') - 1)
      uses(2, k) = lines(k)(index(lines(k), 'use beamid_') + len('use beamid_'):)
   end do
   call search("-lE '^module beamid_' src/beamid", files)
   do k = 1, size(files)
      files(k) = files(k)(:index(files(k), '.f90') - 1)
   end do
   call check('modules and their uses are found', size(files) > 50 .and. size(uses, 2) > 200)
   do k = 1, size(files)
      call check(trim(files(k))//' is in a known folder', allowed(folder_of(files(k))) /= '')
   end do
   do k = 1, size(uses, 2)
      word = folder_of(path_of(uses(2, k)))
      if (index(allowed(folder_of(uses(1, k))), ' '//trim(word)//' ') > 0) cycle
      call check(trim(uses(1, k))//' may use '//trim(uses(2, k)), .false.)
   end do
   call check('no two modules need each other', count_left() == 0)
   call search("-lE 'use beamid_(paths|files)' --include='*_groups.f90' src/beamid/case", lines)
   call check('readers of groups take the paths of files from the case, which lists them', &
      size(lines) == 0)
   do k = 1, size(lines)
      call check(trim(lines(k)), .false.)
   end do
   call search("-niE '^ *(print|stop|error stop)\b|write *\(\*|(output|error)_unit' src/beamid", &
      lines)
   call check('only the command line prints and stops', size(lines) == 0)
   do k = 1, size(lines)
      call check(trim(lines(k)), .false.)
   end do
   call search('-lPz '//deferred_result//' src/beamid/support/strings.f90 $(printf '// &
      '"src/beamid/%s " '//rooms//')', lines)
   do k = 1, size(with_texts)
      call check(trim(with_texts(k))//': its functions with text of deferred length are found', &
         any(lines == with_texts(k)))
   end do
   do k = 1, size(lines)
      call check(trim(lines(k))//' has no function for threads whose text has a deferred length', &
         any(lines(k) == with_texts))
   end do
   call finish('modules')

contains

   !> Lines that grep finds, without the folder src/beamid/.
   subroutine search(arguments, found)
      character(len=*), intent(in) :: arguments
      character(len=80), allocatable, intent(out) :: found(:)
      character(len=200) :: line
      integer :: unit, status

      call execute_command_line('grep -r '//arguments//' >'//scratch)
      allocate (found(0))
      open (newunit=unit, file=scratch, status='old', action='read')
      do
         read (unit, '(a)', iostat=status) line
         if (status /= 0) exit
         found = [character(len=80) :: found, line(len('src/beamid/') + 1:)]
      end do
      close (unit, status='delete')
   end subroutine search

   !> The folders that one may use, itself among them, each between blanks; '' where it is unknown.
   pure function allowed(folder) result(names)
      character(len=*), intent(in) :: folder
      character(len=:), allocatable :: names
      integer :: i

      names = ''
      do i = 1, size(layers)
         if (index(layers(i), trim(folder)//':') == 1) names = ' '//trim(folder)// &
            layers(i)(len_trim(folder) + 2:)
      end do
   end function allowed

   !> `folder/module` of a module.
   pure function path_of(module) result(path)
      character(len=*), intent(in) :: module
      character(len=80) :: path
      integer :: i

      path = '?'
      do i = 1, size(files)
         if (files(i)(index(files(i), '/') + 1:) == module) path = files(i)
      end do
   end function path_of

   pure function folder_of(path) result(folder)
      character(len=*), intent(in) :: path
      character(len=80) :: folder

      folder = path(:index(path, '/') - 1)
   end function folder_of

   !> Removes the modules that use no other of the remaining ones, repeatedly. Those that remain
   !> depend on each other or use a module that does.
   integer function count_left()
      logical :: left(0:size(files))
      integer, dimension(size(uses, 2)) :: user, used
      integer :: i, before

      do i = 1, size(uses, 2)
         user(i) = place_of(uses(1, i))
         used(i) = place_of(path_of(uses(2, i)))
      end do
      left = .true.
      left(0) = .false.
      do
         before = count(left)
         do i = 1, size(files)
            left(i) = any(user == i .and. left(used))
         end do
         count_left = count(left)
         if (count_left == before) return
      end do
   end function count_left

   !> Returns the index of `folder/module` in `files`, or 0.
   pure integer function place_of(path) result(place)
      character(len=*), intent(in) :: path

      do place = size(files), 1, -1
         if (files(place) == path) return
      end do
   end function place_of

end program test_modules
