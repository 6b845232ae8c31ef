!> `beamid reproduce benchmarks`: published values of natural frequencies and buckling loads beside
!> the exact values and those of the program.
!>
!> Each row of data/benchmarks/benchmarks.csv names a benchmark and a quantity. The benchmark is a
!> case file in the same folder. scripts/exact_benchmarks.py has computed the exact values.
module beamid_benchmarks
   use beamid
   use beamid_errors, only: bad_input, locate
   use beamid_files, only: read_text
   use beamid_kinds, only: ip, pi
   use beamid_lines, only: add_lines, csv_row, split
   use beamid_modes, only: natural_frequencies
   use beamid_numbers, only: parse_number
   use beamid_outputs, only: output_t
   use beamid_paths, only: join_path
   use beamid_strings, only: fixed, rounded, to_text
   use beamid_structure, only: of_g, of_T
   use beamid_texts, only: left, next_line, right, text_t
   implicit none
   private

   public :: reproduce_benchmarks

   !> Columns of the table of benchmarks.
   character(len=*), parameter :: header = 'benchmark,quantity,unit,published,exact,source'

   !> One row of the table.
   type :: row_t
      character(len=40) :: benchmark   !< name of its case file
      character(len=40) :: quantity    !< name, and number of the mode if it belongs to one
      character(len=40) :: unit
      character(len=40) :: published   !< value as it was printed; '': none is known
      character(len=40) :: source      !< of the published value
      real(wp) :: exact = 0            !< value computed independently
      real(wp) :: ours = 0             !< value of the program
   end type row_t

contains

   !> Computes all benchmarks and writes report and table.
   !>
   !> data     folder of the case files
   !> output   on return with benchmarks.csv
   !> summary  on return with the report
   !> error    a file that cannot be read, an unknown quantity, or a computation that fails
   subroutine reproduce_benchmarks(data, output, summary, error)
      character(len=*), intent(in) :: data
      type(output_t), intent(inout) :: output
      type(text_t), intent(inout) :: summary
      type(error_t), allocatable, intent(out) :: error
      type(row_t), allocatable :: rows(:)
      type(case_t) :: case
      real(wp), allocatable :: omega(:)
      character(len=:), allocatable :: folder
      integer :: k

      folder = join_path(data, 'benchmarks')
      call read_rows(join_path(folder, 'benchmarks.csv'), rows, error)
      if (allocated(error)) return
      do k = 1, size(rows)
         if (k == 1 .or. rows(k)%benchmark /= rows(max(1, k - 1))%benchmark) then
            call read_case(join_path(folder, trim(rows(k)%benchmark)//'.nml'), needs_modes, case, &
               error)
            if (.not. allocated(error)) call find_modes(case, omega, error)
         end if
         if (.not. allocated(error)) call find_value(case, omega, rows(k), error)
         call locate(error, case%path)
         if (allocated(error)) return
      end do
      call add_report(summary, rows)
      call add_table(output, rows)
   end subroutine reproduce_benchmarks

   !> Reads the table of benchmarks.
   subroutine read_rows(path, rows, error)
      character(len=*), intent(in) :: path
      type(row_t), allocatable, intent(out) :: rows(:)
      type(error_t), allocatable, intent(out) :: error
      character(len=:), allocatable :: text, line
      character(len=40) :: exact
      type(row_t) :: row
      integer(ip) :: first
      logical :: ok

      allocate (rows(0))
      call read_text(path, text, error)
      if (allocated(error)) return
      first = 1
      ok = next_line(text, first, line)
      if (ok) ok = line == header
      if (.not. ok) call bad_input(error, path//': found another header, expected '//header)
      do while (.not. allocated(error))
         if (.not. next_line(text, first, line)) return
         call read_fields(line)
         call parse_number(trim(exact), row%exact, ok)
         if (.not. ok) call bad_input(error, path//':'//to_text(size(rows) + 2)//': found '// &
            trim(exact)//', expected a number')
         rows = [rows, row]
      end do

   contains

      !> Splits a line into the fields of a row.
      subroutine read_fields(line)
         character(len=*), intent(in) :: line
         character(len=40) :: fields(6)

         call split(line, fields)
         row = row_t(fields(1), fields(2), fields(3), fields(4), fields(6))
         exact = fields(5)
      end subroutine read_fields

   end subroutine read_rows

   !> Computes the natural angular frequencies of a case, without those of motions as a rigid body.
   subroutine find_modes(case, omega, error)
      type(case_t), intent(in) :: case
      real(wp), allocatable, intent(out) :: omega(:)
      type(error_t), allocatable, intent(out) :: error

      call natural_frequencies(case%model%structure, case%meshes(1), omega, error)
      if (.not. allocated(error)) omega = pack(omega, omega > 0)
   end subroutine find_modes

   !> Sets the value of the program in a row.
   !>
   !> omega  natural angular frequencies of the case [1/time]
   !> error  a quantity that is not known
   subroutine find_value(case, omega, row, error)
      type(case_t), intent(in) :: case
      real(wp), intent(in) :: omega(:)
      type(row_t), intent(inout) :: row
      type(error_t), allocatable, intent(out) :: error
      integer :: blank, mode

      blank = index(trim(row%quantity)//' ', ' ')
      mode = 1
      if (blank < len_trim(row%quantity)) read (row%quantity(blank:), *) mode
      associate (s => case%model%structure)
         select case (row%quantity(:blank - 1))
         case ('frequency')
            row%ours = omega(mode)/(2*pi)
         case ('omega')
            row%ours = omega(mode)
         case ('beta_l')
            row%ours = s%length*sqrt(omega(mode)*sqrt(s%rho/(s%E*s%I)))
         case ('compression')
            row%ours = buckling_load(case, of_T)
         case ('gravity')
            row%ours = buckling_load(case, of_g)
         case default
            call bad_input(error, 'found the quantity '//trim(row%quantity)//', expected '// &
               'frequency, omega, beta_l, compression or gravity')
         end select
      end associate
   end subroutine find_value

   !> Returns the load at which the stiffness matrix of the actual beam is no longer positive
   !> definite, by bisection.
   !>
   !> place  parameter that is the load: `of_T` (the result is a compression), or `of_g` (of a beam
   !>        that stands)
   real(wp) function buckling_load(case, place) result(load)
      type(case_t), intent(in) :: case
      integer, intent(in) :: place
      integer, parameter :: halvings = 48
      type(galerkin_t), target :: galerkin
      real(wp) :: stable, step
      integer :: k

      galerkin = galerkin_of(case%meshes(1), case%model%structure)
      step = 1
      do while (.not. buckles(step))
         step = 2*step
      end do
      stable = 0
      do k = 1, halvings
         step = step/2
         if (.not. buckles(stable + step)) stable = stable + step
      end do
      load = stable + step/2

   contains

      !> Returns whether a load buckles the beam.
      logical function buckles(load)
         real(wp), intent(in) :: load
         type(structure_t) :: loaded
         type(equations_t) :: equations

         loaded = case%model%structure
         loaded%stands = .true.
         call loaded%set(place, merge(-load, load, place == of_T))
         equations = new_equations(galerkin, loaded)
         buckles = equations%buckles()
      end function buckles

   end function buckling_load

   !> Adds the report: a line for each row, and the largest difference.
   subroutine add_report(text, rows)
      type(text_t), intent(inout) :: text
      type(row_t), intent(in) :: rows(:)
      character(len=20) :: name
      integer :: k

      call add_lines(text, [character(len=100) :: &
         'Benchmarks: published values, exact values and those of beamid', &
         'The exact values were computed independently, with 50 digits. differs: beamid over '// &
         'exact, less 1.', &
         '*: the published value differs from the exact one by more than rounding explains.', &
         '', &
         'benchmark        quantity        unit    published              exact'// &
         '             beamid   differs'])
      do k = 1, size(rows)
         associate (row => rows(k))
            name = row%benchmark
            if (k > 1) then
               if (rows(k - 1)%benchmark == row%benchmark) name = ''
            end if
            call text%line(left(trim(name), 17)//left(trim(row%quantity), 14)// &
               left(trim(row%unit), 8)//right(trim(row%published), 10)// &
               merge('*', ' ', is_wrong(row))//right(digits(row%exact), 18)// &
               right(digits(row%ours), 19)//right(rounded(difference(row), 2), 10))
         end associate
      end do
      call add_lines(text, [character(len=100) :: '', &
         'Largest relative difference between beamid and the exact values: #'], &
         [maxval(abs([(difference(rows(k)), k=1, size(rows))]))])
   end subroutine add_report

   !> Returns a value with twelve significant digits.
   pure function digits(value) result(text)
      real(wp), intent(in) :: value
      character(len=:), allocatable :: text

      text = trim(adjustl(fixed(value, 20, max(0, 11 - floor(log10(abs(value)))))))
   end function digits

   !> Returns the relative difference between the program's value and the exact one.
   elemental real(wp) function difference(row)
      type(row_t), intent(in) :: row

      difference = row%ours/row%exact - 1
   end function difference

   !> Returns whether a published value differs from the exact one by more than half a unit of its
   !> last digit.
   logical function is_wrong(row)
      type(row_t), intent(in) :: row
      real(wp) :: published
      logical :: ok
      integer :: decimals

      is_wrong = .false.
      if (row%published == '') return
      call parse_number(trim(row%published), published, ok)
      decimals = 0
      if (index(row%published, '.') > 0) decimals = len_trim(row%published) &
         - index(row%published, '.')
      ! A little more than half a unit: decimal fractions are rounded.
      is_wrong = .not. (ok .and. abs(published - row%exact) <= 0.501_wp*10.0_wp**(-decimals))
   end function is_wrong

   !> Writes the table.
   subroutine add_table(output, rows)
      type(output_t), intent(inout) :: output
      type(row_t), intent(in) :: rows(:)
      type(text_t) :: table
      integer :: k

      call table%line('benchmark,quantity,unit,published,exact,beamid,relative_difference,source')
      do k = 1, size(rows)
         associate (row => rows(k))
            call table%line(csv_row(trim(row%benchmark)//','//trim(row%quantity)//','// &
               trim(row%unit)//','//trim(row%published), [row%exact, row%ours, difference(row)])// &
               ','//trim(row%source))
         end associate
      end do
      call output%add('benchmarks.csv', table%content())
   end subroutine add_table

end module beamid_benchmarks
