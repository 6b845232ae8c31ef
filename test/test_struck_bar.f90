!> `new struck-bar`: the total interval of E holds the true value when length, width, height and
!> mass are measured with errors, and E is that of the formula of ASTM E1876.
program test_struck_bar
   use beamid_kinds, only: wp
   use beamid_noise, only: gaussian_noise
   use beamid_strings, only: full, to_text
   use checks, only: check, check_close, finish, skip
   use shell, only: beamid, close_shell, line_count, open_shell, outcome_t, read_file, replaced, &
      write_file
   use tables, only: field, number
   implicit none

   character(len=:), allocatable :: reason
   type(outcome_t) :: outcome

   call open_shell(reason)
   if (reason == '') then
      outcome = beamid('new struck-bar bar')
      call check('new struck-bar', outcome%status == 0, outcome%err)
      if (outcome%status == 0) then
         call test_formula()
         call test_intervals()
      end if
      call close_shell()
   else
      call skip('struck bar', reason)
   end if
   call finish('struck bar')

contains

   !> Returns a number of the row of E in estimates.csv.
   real(wp) function of_E(column)
      integer, intent(in) :: column
      character(len=:), allocatable :: table
      integer :: k

      table = read_file('fit/estimates.csv')
      do k = 1, line_count(table) - 1
         if (field(table, k, 3) == 'E') exit
      end do
      of_E = number(field(table, k, column))
   end function of_E

   !> The formula of the standard for a thin bar, with the exact factor 12 (2 pi)**2/(beta l)**4.
   !> The frequency is that of the fitted bar. Quintic splines on 8 elements raise E by 1e-7.
   subroutine test_formula()
      real(wp), parameter :: pi = acos(-1.0_wp), beta_l = 4.730040744862704_wp
      real(wp) :: f

      outcome = beamid('identify bar/case.nml --out fit --quiet')
      call check('fit', outcome%status == 0, outcome%err)
      outcome = beamid('modes bar/case.nml --out modes --quiet')
      call check('modes', outcome%status == 0, outcome%err)
      f = number(field(read_file('modes/modes_fitted.csv'), 1, 3))
      call check_close('formula of ASTM E1876', 12*(2*pi)**2/beta_l**4*0.1975_wp*f**2/0.025_wp &
         *(0.2_wp/0.005_wp)**3/of_E(6), 1.0_wp, 1e-6_wp)
   end subroutine test_formula

   !> Draws measured dimensions around the true ones of the record, with the standard deviations of
   !> the case. The number of 95 % intervals of 40 that hold the true E is binomial, 38 +- 1.4; it
   !> falls below 34 once in 200 seeds.
   subroutine test_intervals()
      integer, parameter :: trials = 40
      real(wp), parameter :: truth(4) = [0.19997_wp, 0.02501_wp, 0.005006_wp, 0.98775_wp], &
         sd(4) = [5e-5_wp, 2e-5_wp, 1e-5_wp, 5e-4_wp]
      real(wp) :: measured(4, trials)
      integer :: held, k

      measured = spread(truth, 2, trials) + spread(sd, 2, trials) &
         *reshape(gaussian_noise(4*trials, 1.0_wp, 20261125), [4, trials])
      held = 0
      do k = 1, trials
         call write_file('bar/trial.nml', case_with(measured(:, k)))
         outcome = beamid('identify bar/trial.nml --out fit --quiet')
         call check('fit '//to_text(k), outcome%status == 0, outcome%err)
         if (of_E(16) <= 1.95e11_wp .and. of_E(17) >= 1.95e11_wp) held = held + 1
      end do
      call check('intervals of E that hold the true value: '//to_text(held)//' of '// &
         to_text(trials), held >= 34)
   end subroutine test_intervals

   !> Returns the case with other measured values: length, width, height and rho.
   function case_with(measured) result(text)
      real(wp), intent(in) :: measured(4)
      character(len=:), allocatable :: text

      text = replaced(read_file('bar/case.nml'), 'length=0.2, width=0.025, height=0.005', &
         'length='//full(measured(1))//', width='//full(measured(2))//', height='// &
         full(measured(3)))
      text = replaced(text, 'rho=0.9875 ', 'rho='//full(measured(4))//' ')
   end function case_with

end program test_struck_bar
