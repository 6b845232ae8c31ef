!> `reproduce benchmarks`: the table in data/benchmarks, and what the program prints and writes.
program test_benchmarks
   use beamid_errors, only: error_t
   use beamid_files, only: read_text
   use beamid_kinds, only: wp
   use checks, only: check, check_close, finish, skip
   use shell, only: close_shell, in_root, line_count, open_shell, outcome_t, read_file
   use tables, only: field, line_of => line, number
   implicit none

   character(len=:), allocatable :: reason
   type(outcome_t) :: outcome

   call open_shell(reason)
   if (reason == '') then
      outcome = in_root('reproduce benchmarks --out @/b')
      call check('status, streams', outcome%status == 0 .and. outcome%err == '' .and. &
         outcome%out == read_file('b/summary.txt'), outcome%err)
      if (outcome%status == 0) call test_table(read_file('b/benchmarks.csv'), outcome%out)
      call close_shell()
   else
      call skip('program', reason)
   end if
   call finish('benchmarks')

contains

   !> Rows against the exact values of the table, and against values that are kept here, too: those
   !> of the free bar from the roots of cos x cosh x = 1, those of SDLL10 from its characteristic
   !> equation, the height of a column from the zero of the Bessel function J_(-1/3).
   !>
   !> The error of the splines is below 1e-9 in all but the sixth mode of five spans (1e-9). That of
   !> the bisection is the round-off of K, some units times N**2: 1e-10.
   subroutine test_table(table, summary)
      character(len=*), intent(in) :: table, summary
      real(wp), parameter :: bar(3) = [1801.55262965_wp, 4966.04919621_wp, 9735.44202106_wp], &
         sdll10(4) = [145.877072789_wp, 400.295105968_wp, 783.231892176_wp, 1293.57215637_wp]
      character(len=:), allocatable :: source
      type(error_t), allocatable :: error
      real(wp) :: exact, ours, allowed
      integer :: k, n

      call check('header', line_of(table, 1) == 'benchmark,quantity,unit,published,exact,'// &
         'beamid,relative_difference,source')
      n = line_count(table) - 1
      call read_text('data/benchmarks/benchmarks.csv', source, error)
      call check('one row for each of the table in data', n == &
         line_count(source) - 1 .and. n > 70)
      do k = 1, n
         exact = number(line_of(table, k + 1), 5)
         ours = number(line_of(table, k + 1), 6)
         allowed = 1e-9_wp
         if (field(table, k, 1) == 'five-spans') allowed = 2e-9_wp
         call check_close(field(table, k, 1)//', '//field(table, k, 2), ours/exact, 1.0_wp, allowed)
         call check_close(field(table, k, 1)//', '//field(table, k, 2)//': difference', &
            number(line_of(table, k + 1), 7), ours/exact - 1, 1e-15_wp)
      end do
      ! The values of the bar and of SDLL10 are given to twelve digits.
      call check_known(table, 'free-bar', bar, 1e-9_wp)
      call check_known(table, 'sdll10', sdll10, 1e-9_wp)
      call check('summary: a published value that is wrong', index(summary, '143.303*') > 0 &
         .and. index(summary, '16.07*') == 0)
   end subroutine test_table

   !> Compares the frequencies of a benchmark with known ones.
   subroutine check_known(table, benchmark, known, allowed)
      character(len=*), intent(in) :: table, benchmark
      real(wp), intent(in) :: known(:), allowed
      integer :: first, i

      do first = 1, line_count(table)
         if (field(table, first, 1) == benchmark) exit
      end do
      do i = 1, size(known)
         call check_close(benchmark//': known', number(line_of(table, first + i), 6)/known(i), &
            1.0_wp, allowed)
      end do
   end subroutine check_known

end program test_benchmarks
