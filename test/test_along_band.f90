!> E(x) and c_D(x) with their bands: the delta method against draws, limits that stay positive, and
!> what the program writes of them.
program test_along_band
   use beamid_field_bands, only: band, field_band_t, varies
   use beamid_kinds, only: wp
   use beamid_noise, only: gaussian_noise
   use beamid_stage_fits, only: stage_fit_t
   use beamid_statistics, only: unlimited
   use beamid_strings, only: to_text
   use beamid_structure, only: E_at, of_d_D, of_E, of_w_D, of_x_D
   use beamid_variations, only: field_modulus, field_viscosity
   use checks, only: check, check_close, finish, skip
   use shell, only: close_shell, exists, has_all, line_count, open_shell, outcome_t, &
      program_path, read_file, run, write_file
   use tables, only: line, number, part
   implicit none

   real(wp), parameter :: t = 1.96_wp
   character(len=*), parameter :: nl = achar(10)
   character(len=:), allocatable :: reason

   call test_coefficients()
   call test_dip()
   call test_limits()
   call open_shell(reason)
   if (reason /= '') then
      call skip('along.csv', reason)
   else
      call test_program()
      call test_searches()
      call test_no_dip()
      call test_two_records()
   end if
   call close_shell()
   call finish('along band')

contains

   !> A fit of so many parameters, of which the errors go together in some way.
   function made_fit(places, values, relative) result(fit)
      integer, intent(in) :: places(:)
      real(wp), intent(in) :: values(:), relative
      type(stage_fit_t) :: fit
      real(wp) :: a(size(places), size(places))
      integer :: j, k, n

      n = size(places)
      allocate (fit%quantities(n))
      fit%free = places
      fit%quantities%parameter = places
      fit%quantities%value = values
      fit%quantities%start = 0.9_wp*values
      do k = 1, n
         do j = 1, n
            a(j, k) = relative*values(j)*sin(real(3*j + 5*k + j*k, wp))/n
         end do
      end do
      associate (s => fit%statistics)
         s%samples = 100
         s%covariance = matmul(a, transpose(a))
         s%std_error = [(sqrt(s%covariance(k, k)), k=1, n)]
         s%corrected_error = 1.5_wp*s%std_error
         s%corrected_half_width = t*s%corrected_error
      end associate
      allocate (fit%scenario%structures(1), fit%scenario%excitations(1))
      fit%scenario%structures(1)%length = 2
      fit%scenario%structures(1)%E = 10
      fit%scenario%structures(1)%c_D = 1
   end function made_fit

   !> Standard deviation of log value at every place by draws of the parameters.
   function scatter(fit, points, draws) result(sd)
      type(stage_fit_t), intent(in) :: fit
      integer, intent(in) :: points, draws
      real(wp), dimension(points) :: sd, mean, logs
      real(wp) :: root(size(fit%free), size(fit%free)), z(size(fit%free)), &
         noise(draws*size(fit%free))
      type(stage_fit_t) :: drawn
      type(field_band_t) :: found
      integer :: j, k, n

      n = size(fit%free)
      noise = gaussian_noise(size(noise), 1.0_wp, 7)
      ! The root of the covariance column by column (Cholesky).
      root = 0
      do j = 1, n
         root(j, j) = sqrt(max(0.0_wp, fit%statistics%covariance(j, j) - sum(root(j, :j - 1)**2)))
         do k = j + 1, n
            if (root(j, j) > 0) root(k, j) = (fit%statistics%covariance(k, j) &
               - sum(root(k, :j - 1)*root(j, :j - 1)))/root(j, j)
         end do
      end do
      sd = 0
      mean = 0
      do k = 1, draws
         z = matmul(root, noise((k - 1)*n + 1:k*n))
         drawn = fit
         do j = 1, n
            call drawn%scenario%structures(1)%set(fit%free(j), fit%quantities(j)%value + z(j))
         end do
         found = band(drawn, field_modulus, points)
         logs = log(found%value)
         mean = mean + logs/draws
         sd = sd + logs**2/draws
      end do
      sd = sqrt(sd - mean**2)
   end function scatter

   subroutine test_coefficients()
      type(stage_fit_t) :: fit
      type(field_band_t) :: found
      real(wp) :: sd(21)
      integer :: j

      fit = made_fit(E_at(:8), [(10 + sin(real(j, wp)), j=1, 8)], 0.02_wp)
      fit%scenario%structures(1)%variations%along(field_modulus)%coefficients = 8
      call check('a structure alone does not vary', .not. varies(fit%scenario%structures(1), &
         field_modulus))
      do j = 1, 8
         call fit%scenario%structures(1)%set(E_at(j), fit%quantities(j)%value)
      end do
      call check('E varies, c_D does not', varies(fit%scenario%structures(1), field_modulus) .and. &
         .not. varies(fit%scenario%structures(1), field_viscosity))
      found = band(fit, field_modulus, 21)
      sd = scatter(fit, 21, 4000)
      call check_close('coefficients: value at the root', found%value(1), &
         (fit%quantities(1)%value + 4*fit%quantities(2)%value + fit%quantities(3)%value)/6, &
         1e-12_wp)
      call check_close('coefficients: start', found%start(7), 0.9_wp*found%value(7), 1e-12_wp)
      call check('coefficients: the delta method', all(abs(found%half_width/(1.5_wp*t*sd) - 1) < &
         0.05_wp), to_text(maxval(abs(found%half_width/(1.5_wp*t*sd) - 1))))
      call check_close('coefficients: spacing', found%spacing, 0.4_wp, 1e-12_wp)
   end subroutine test_coefficients

   subroutine test_dip()
      type(stage_fit_t) :: fit
      type(field_band_t) :: found
      real(wp) :: sd(21)

      fit = made_fit([of_E, of_x_D, of_w_D, of_d_D], [10.0_wp, 0.8_wp, 0.3_wp, 0.4_wp], 0.01_wp)
      call fit%scenario%structures(1)%set(of_x_D, 0.8_wp)
      call fit%scenario%structures(1)%set(of_w_D, 0.3_wp)
      call fit%scenario%structures(1)%set(of_d_D, 0.4_wp)
      found = band(fit, field_modulus, 21)
      sd = scatter(fit, 21, 4000)
      call check_close('dip: value in its middle', found%value(9), 6.0_wp, 1e-12_wp)
      call check('dip: the delta method', all(abs(found%half_width/(1.5_wp*t*sd) - 1) < 0.05_wp), &
         to_text(maxval(abs(found%half_width/(1.5_wp*t*sd) - 1))))
      ! Far from the dip what is left is E by itself.
      call check_close('dip: E alone at the tip', found%half_width(21), &
         fit%statistics%corrected_half_width(1)/10, 1e-2_wp*found%half_width(21))
      call check('dip: no coefficients, no resolution', .not. allocated(found%resolution))
   end subroutine test_dip

   !> However wide the band, its limits are positive; where the record leaves it open it has none.
   subroutine test_limits()
      type(stage_fit_t) :: fit
      type(field_band_t) :: found
      integer :: k

      fit = made_fit([of_E, of_x_D], [10.0_wp, 0.8_wp], 20.0_wp)
      call fit%scenario%structures(1)%set(of_x_D, 0.8_wp)
      call fit%scenario%structures(1)%set(of_w_D, 0.1_wp)
      call fit%scenario%structures(1)%set(of_d_D, 0.4_wp)
      found = band(fit, field_modulus, 11)
      call check('limits are positive', all([(found%lower(k) > 0 .and. found%lower(k) < &
         found%value(k) .and. found%upper(k) > found%value(k), k=1, 11)]))
      fit%statistics%std_error(1) = unlimited
      fit%statistics%corrected_half_width(1) = unlimited
      found = band(fit, field_modulus, 11)
      call check('no limits', all([(.not. found%lower(k) > 0 .and. found%upper(k) >= unlimited, &
         k=1, 11)]))
      fit%scenario%structures(1)%c_D = 0
      found = band(fit, field_viscosity, 11)
      call check('c_D was not searched for', .not. found%is_estimate)
   end subroutine test_limits

   !> A beam that does not vary: the band holds the truth everywhere. One that is known to vary,
   !> with nothing of it free, has no band; one that does not has no file.
   subroutine test_program()
      character(len=*), parameter :: beam = '&beam length=0.5, width=0.03, height=0.002, '// &
         'density=7850, E=2.05e11, c_D=2e6, gamma=0.02 /'//nl// &
         '&excitation kind=''pulse'', amplitude=1, duration=0.005 /'//nl// &
         '&discretization degree=5, elements=12 /'//nl, &
         record = '&record file=''record.csv'' /'//nl, head = &
         'elements,parameter,x,value,lower95,upper95,start,resolution,unit'
      type(outcome_t) :: outcome
      character(len=:), allocatable :: table, row
      integer :: k, holds, rows

      call write_file('truth.nml', beam//'&record t_first=0.01, t_last=1, t_step=0.001 /'//nl// &
         '&noise sd=0.1, seed=3 /'//nl)
      call write_file('fit.nml', beam//record//'&stage free=''E(x)'',''c_D'',''gamma'', '// &
         'coefficients=8 /'//nl)
      call write_file('known.nml', beam//record//'&along parameter=''c_D'', x=0,0.5, '// &
         'value=2e6,2.1e6 /'//nl//'&stage free=''gamma'' /'//nl)
      call write_file('plain.nml', beam//record//'&stage free=''gamma'' /'//nl)
      outcome = run('"'//program_path//'" simulate truth.nml --quiet && '// &
         'cp out/truth/record.csv . && for c in fit known plain; do "'//program_path// &
         '" identify $c.nml --quiet || exit 1; done')
      call check('three fits', outcome%status == 0, outcome%err)
      if (outcome%status /= 0) return
      call check('nothing varies: no along.csv', .not. exists('out/plain/along.csv'))

      table = read_file('out/fit/along.csv')
      rows = line_count(table) - 1
      call check('along.csv: header', line(table, 1) == head, line(table, 1))
      call check('along.csv: rows', rows == 101, to_text(rows))
      holds = 0
      do k = 1, rows
         row = line(table, k + 1)
         if (number(part(row, 5, ',')) <= 2.05e11_wp .and. number(part(row, 6, ',')) >= &
            2.05e11_wp .and. number(part(row, 5, ',')) < number(part(row, 4, ',')) .and. &
            number(part(row, 8, ',')) > 0) holds = holds + 1
      end do
      call check('the band holds the truth', holds == rows, to_text(holds))
      call check('along.csv: from root to tip', number(part(line(table, 2), 3, ',')) <= 0 .and. &
         abs(number(part(line(table, 102), 3, ',')) - 0.5_wp) < 1e-12_wp)
      table = read_file('out/fit/summary.txt')
      call check('summary: the function, not its coefficients', has_all(table, &
         'E(x)|95 % band from|averages over|restricted marginal likelihood|degrees of freedom') &
         .and. index(table, 'E.3') == 0 .and. maxval([(len(line(table, k)), k=1, &
         line_count(table))]) <= 100)

      table = read_file('out/known/along.csv')
      row = line(table, 102)
      call check('a known variation: no band', part(row, 2, ',') == 'c_D' .and. &
         part(row, 5, ',') == '' .and. part(row, 6, ',') == '', row)
      call check_close('a known variation: value', number(part(row, 4, ',')), 2.1e6_wp, 1.0_wp)
   end subroutine test_program

   !> A dip by coefficients that are too few for it: the search ends at a smooth function, and what
   !> that is worth is said. E(x) and c_D(x) at once, of which one varies; a start from the record.
   subroutine test_searches()
      character(len=*), parameter :: beam = '&beam length=0.5, width=0.03, height=0.002, '// &
         'density=7850, E=2.05e11, c_D=2e6, gamma=0.02 /'//nl// &
         '&excitation kind=''pulse'', amplitude=1, duration=0.005 /'//nl// &
         '&discretization degree=5, elements=12 /'//nl, &
         record = '&record file=''record.csv'' /'//nl
      character(len=*), parameter :: coarse(2) = ['6', '8']
      type(outcome_t) :: outcome
      character(len=:), allocatable :: table
      real(wp) :: E
      integer :: j, k, near

      call write_file('dip.nml', beam//'&along kind=''dip'', place=0.2, width=0.05, depth=0.2 /'// &
         nl//'&record t_first=0.01, t_last=1, t_step=0.001 /'//nl//'&noise sd=0.1, seed=3 /'//nl)
      do j = 1, size(coarse)
         call write_file('coarse'//coarse(j)//'.nml', beam//record// &
            '&stage free=''E(x)'',''c_D'',''gamma'', coefficients='//coarse(j)//' /'//nl)
      end do
      call write_file('both.nml', beam//record// &
         '&stage free=''E(x)'',''c_D(x)'',''gamma'', coefficients=14 /'//nl)
      call write_file('auto.nml', beam//record// &
         '&stage free=''E(x)'',''c_D'',''gamma'', coefficients=12, start=''auto'' /'//nl)
      outcome = run('"'//program_path//'" simulate dip.nml --quiet && cp out/dip/record.csv .')
      do j = 1, size(coarse)
         outcome = run('"'//program_path//'" identify coarse'//coarse(j)//'.nml --quiet')
         call check('too few coefficients: a fit, '//coarse(j), outcome%status == 0, outcome%err)
         if (outcome%status /= 0) cycle
         table = read_file('out/coarse'//coarse(j)//'/summary.txt')
         call check('too few coefficients: said so, '//coarse(j), has_all(table, &
            'residuals are NOT white|E(x) are too few to follow|the least that is allowed'), table)
         table = read_file('out/coarse'//coarse(j)//'/along.csv')
         call check('too few coefficients: no band, '//coarse(j), &
            number(part(line(table, 50), 5, ',')) <= 0 .and. &
            part(line(table, 50), 6, ',') == 'inf', line(table, 50))
         near = 0
         do k = 1, line_count(table) - 1
            E = number(part(line(table, k + 1), 4, ','))
            if (abs(log(E/2.05e11_wp)) < log(1.5_wp)) near = near + 1
         end do
         ! The dip takes 20 % away; none of it may come back as a multiple elsewhere.
         call check('too few coefficients: nothing absurd, '//coarse(j), near == 101, to_text(near))
      end do

      outcome = run('"'//program_path//'" identify both.nml --quiet')
      call check('E(x) and c_D(x): a fit', outcome%status == 0, outcome%err)
      if (outcome%status == 0) then
         table = read_file('out/both/summary.txt')
         call check('E(x) and c_D(x): both are told', has_all(table, &
            'E(x): strength|c_D(x): strength|residuals pass for white noise'), table)
         table = read_file('out/both/along.csv')
         near = 0
         do k = 1, line_count(table) - 1
            if (part(line(table, k + 1), 2, ',') /= 'c_D') cycle
            if (abs(number(part(line(table, k + 1), 4, ','))/2e6_wp - 1) < 0.1_wp) near = near + 1
         end do
         ! c_D is known to some per cent where it varies at all.
         call check('E(x) and c_D(x): c_D hardly varies', near == 101, to_text(near))
      end if

      outcome = run('"'//program_path//'" identify auto.nml --quiet')
      call check('a start from the record', outcome%status == 0, outcome%err)
   end subroutine test_searches

   !> A dip where there is none, and one in a record of 50 samples a second, whose second line is
   !> not where the second mode is: 41 Hz.
   subroutine test_no_dip()
      character(len=*), parameter :: beam = '&beam length=0.5, width=0.03, height=0.002, '// &
         'density=7850, E=2.05e11, c_D=2e6, gamma=0.02 /'//nl// &
         '&excitation kind=''pulse'', amplitude=1, duration=0.005 /'//nl// &
         '&discretization degree=5, elements=16 /'//nl, &
         dip = '&along kind=''dip'', place=0.3, width=0.04, depth=0.1 /'//nl, &
         stage = '&stage free=''E'',''c_D'',''gamma'',''place'',''width'',''depth'' /'//nl
      type(outcome_t) :: outcome
      character(len=:), allocatable :: table
      integer :: k

      call write_file('none.nml', beam//'&record t_first=0.01, t_last=1, t_step=0.001 /'//nl// &
         '&noise sd=0.1, seed=11 /'//nl)
      call write_file('find.nml', beam//dip//'&record file=''none.csv'' /'//nl//stage)
      outcome = run('"'//program_path//'" simulate none.nml --quiet && '// &
         'cp out/none/record.csv none.csv && "'//program_path//'" identify find.nml --quiet')
      call check('no dip: a fit', outcome%status == 0, outcome%err)
      if (outcome%status /= 0) return
      table = read_file('out/find/estimates.csv')
      do k = 5, 7
         call check('no dip: not determined, '//part(line(table, k), 3, ','), &
            part(line(table, k), 10, ',') == 'no', line(table, k))
      end do
      call check('no dip: no place', part(line(table, 5), 3, ',') == 'place' .and. &
         part(line(table, 5), 8, ',') == '', line(table, 5))
      call check('no dip: said so', index(outcome%out, 'does not tell that there is a dip') > 0, &
         outcome%out)

      call write_file('far.nml', beam//'&along kind=''dip'', place=0.1, width=0.05, depth=0.4 /'// &
         nl//'&record t_first=0.06, t_last=3, t_step=0.02 /'//nl//'&noise sd=0.5, seed=4 /'//nl)
      call write_file('near.nml', beam//dip//'&record file=''far.csv'' /'//nl//stage)
      outcome = run('"'//program_path//'" simulate far.nml --quiet && '// &
         'cp out/far/record.csv far.csv && "'//program_path//'" identify near.nml --quiet')
      call check('a dip far away: a fit', outcome%status == 0, outcome%err)
      if (outcome%status /= 0) return
      table = read_file('out/near/estimates.csv')
      ! Found, or not told: that is honest as well. A wrong place that passes for known is neither.
      call check('a dip far away', part(line(table, 5), 10, ',') == 'no' .or. &
         abs(number(part(line(table, 5), 6, ',')) - 0.1_wp) < 0.02_wp, line(table, 5))
   end subroutine test_no_dip

   !> Two records whose noise is not stated: J is about m at every minimum then, and says nothing of
   !> which is the right one. And as many unknowns as samples, which leave no statistics.
   subroutine test_two_records()
      character(len=*), parameter :: beam = '&beam length=0.5, width=0.03, height=0.002, '// &
         'density=7850, E=2.05e11, c_D=2e6, gamma=0.02 /'//nl// &
         '&excitation kind=''pulse'', amplitude=1, duration=0.005 /'//nl// &
         '&discretization degree=5, elements=8 /'//nl
      type(outcome_t) :: outcome
      character(len=:), allocatable :: table
      character :: digit
      integer :: k

      do k = 1, 2
         digit = achar(iachar('0') + k)
         call write_file('r'//digit//'.nml', beam//'&along kind=''dip'', place=0.42, '// &
            'width=0.04, depth=0.3 /'//nl//'&record t_first=0.01, t_last=0.4, t_step=0.002 /'// &
            nl//'&noise sd=0.3, seed='//digit//' /'//nl)
         outcome = run('"'//program_path//'" simulate r'//digit//'.nml --quiet && cp out/r'// &
            digit//'/record.csv r'//digit//'.csv')
      end do
      call write_file('two.nml', beam//'&along kind=''dip'', place=0.1, width=0.035, '// &
         'depth=0.05 /'//nl//'&record file=''r1.csv'' /'//nl//'&record file=''r2.csv'' /'//nl// &
         '&stage free=''E'',''place'',''depth'',''width'' /'//nl)
      outcome = run('"'//program_path//'" identify two.nml --quiet')
      call check('two records: a fit', outcome%status == 0, outcome%err)
      if (outcome%status == 0) then
         table = read_file('out/two/estimates.csv')
         ! Its standard error is .3 mm.
         call check('two records: the place', part(line(table, 3), 3, ',') == 'place' .and. &
            abs(number(part(line(table, 3), 6, ',')) - 0.42_wp) < 2e-3_wp, line(table, 3))
      end if

      call write_file('many.nml', beam//'&record file=''r1.csv'', t_last=0.041 /'//nl// &
         '&stage free=''E(x)'', coefficients=16 /'//nl)
      outcome = run('"'//program_path//'" identify many.nml --quiet')
      call check('as many unknowns as samples: it ends', outcome%status == 0 .or. &
         outcome%status == 1, outcome%err)
   end subroutine test_two_records

end program test_along_band
