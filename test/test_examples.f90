!> The examples run, and print what they promise.
program test_examples
   use checks, only: check, finish, skip
   implicit none

   call run_example('fit_record', 'k_H        0.299988')
   call run_example('simulate_pulse', '1.0     0.95959     0.95985')
   call run_example('derivatives', '-1.171668    -27.276704      0.215841')
   call run_example('natural_modes', '    1           6.0729')
   call run_example('fit_case', 'E         1.99995E+11')
   call run_example('time_fits', 'samples 3900')
   call finish('examples')

contains

   !> Runs the newest build of an example from this folder.
   subroutine run_example(name, expected)
      !> The example's name, and what a line of its output holds.
      character(len=*), intent(in) :: name, expected
      character(len=*), parameter :: found = 'build/test_examples.txt'
      integer :: status

      call execute_command_line('ls -t build/gfortran_*/example/'//name//' >'//found// &
         ' 2>/dev/null', exitstat=status)
      if (status /= 0) then
         call skip(name, 'it has not been built')
         return
      end if
      call execute_command_line('$(head -n 1 '//found//') >'//found//'.out', exitstat=status)
      call check(name//': exit status 0', status == 0)
      call execute_command_line('grep -q -e "'//expected//'" '//found//'.out', exitstat=status)
      call check(name//' prints '//expected, status == 0)
      call execute_command_line('rm -f '//found//' '//found//'.out')
   end subroutine run_example

end program test_examples
