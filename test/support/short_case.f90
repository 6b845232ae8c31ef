!> A case that takes no time, and what the command line's tests ask of its runs.
module short_case
   use checks, only: check
   use shell, only: outcome_t, read_file, run
   implicit none
   private

   public :: nl, pulse, stage, case_text, check_success, listing, text_of

   character(len=*), parameter :: nl = achar(10)
   character(len=*), parameter :: pulse = 'kind=''pulse'', amplitude=1.0, duration=0.05', &
      stage = '&stage free=''m_H'',''k_H'', start=0.035,0.4 /'
   !> A short record of a coarse beam; six samples.
   character(len=*), parameter :: case_text = &
      '&beam length=4.0, rho=0.03, E=80.0, I=1.0, c_D=0.005 /'//nl// &
      '&tip m_T=0.15 /'//nl// &
      '&hose m_H=0.04, c_H=0.004, k_H=0.3 /'//nl// &
      '&excitation '//pulse//' /'//nl// &
      '&discretization degree=3, elements=2 /'//nl// &
      '&integrator method=''cvode'', rtol=1e-8 /'//nl// &
      '&observation formula=''displacement_difference'', delta=0.1 /'//nl// &
      '&record file=''record.csv'', t_first=0.1, t_last=0.6, t_step=0.1 /'//nl// &
      stage//nl// &
      '&units length=''ft'', force=''lb'', time=''s'', mass=''slug'' /'//nl

contains

   !> Status 0, nothing on standard error, and standard output kept in summary.txt.
   subroutine check_success(what, outcome, folder)
      character(len=*), intent(in) :: what, folder
      type(outcome_t), intent(in) :: outcome

      call check(what//': status 0 and no message', outcome%status == 0 .and. outcome%err == '', &
         outcome%err)
      call check(what//': summary.txt is standard output', outcome%out /= '' .and. &
         read_file(folder//'summary.txt') == outcome%out)
      call check(what//': no NaN, infinity or stars in the summary', scan(outcome%out, '*') == 0 &
         .and. index(outcome%out, 'NaN') == 0 .and. index(outcome%out, 'Infinity') == 0)
   end subroutine check_success

   !> Names, sizes and bytes of all files of a folder.
   function listing(folder) result(text)
      character(len=*), intent(in) :: folder
      character(len=:), allocatable :: text
      type(outcome_t) :: outcome

      outcome = run('find . -type f | sort | xargs cksum', folder)
      text = outcome%out
   end function listing

   function text_of(outcome) result(text)
      type(outcome_t), intent(in) :: outcome
      character(len=:), allocatable :: text

      text = outcome%out
   end function text_of

end module short_case
