!> Fits to frequency responses, tables of modes, and mixtures of them with records in time, by the
!> program.
program test_frequency_fits
   use beamid_kinds, only: wp
   use beamid_noise, only: gaussian_noise
   use beamid_strings, only: to_text
   use case_answers, only: answer_t, check_refused, identified, nl
   use checks, only: check, check_close, finish, skip
   use shell, only: beamid, close_shell, exists, line_count, open_shell, outcome_t, read_file, &
      replaced, write_file
   use tables, only: field, line, number
   implicit none

   real(wp), parameter :: E = 7e10_wp, c_D = 2e6_wp, gamma = 0.05_wp, m_S = 0.005_wp
   real(wp), parameter :: normal = 1.959963984540054_wp
   !> Standard deviation of the noise of the decay.
   real(wp), parameter :: decay_noise = 5
   character(len=*), parameter :: at_F = '&record kind=''frf'', x_F=0.3', &
      all_four = '&stage free=''E'',''c_D'',''m_S'',''gamma'' /', &
      band = ', f_first=4, f_last=300, f_step=1 /'
   character(len=:), allocatable :: reason

   call open_shell(reason)
   if (reason /= '') then
      call skip('fits', reason)
   else
      call make_response('exact.csv', at_F//band)
      call test_exact()
      call test_quantities()
      call test_sensors()
      call test_conjugate()
      call test_sign()
      call test_units()
      call test_windows()
      call test_one_frequency()
      call test_two_frequencies()
      call test_assignment()
      call test_band()
      call test_pure_noise()
      call test_refinement()
      call test_excess()
      call test_mixture()
      call test_read_back()
      call test_design()
      call test_refusals()
      call close_shell()
   end if
   call finish('frequency_fits')

contains

   !> Returns the beam of a case: the true one, with some values multiplied by factors.
   function beam(of_E, of_c_D, of_m_S)
      real(wp), intent(in), optional :: of_E, of_c_D, of_m_S
      character(len=:), allocatable :: beam
      real(wp) :: factors(3)

      factors = 1
      if (present(of_E)) factors(1) = of_E
      if (present(of_c_D)) factors(2) = of_c_D
      if (present(of_m_S)) factors(3) = of_m_S
      beam = '&beam length=0.5, width=0.03, height=0.003, density=2700, '// &
         'E='//to_text(factors(1)*E) &
         //', c_D='//to_text(factors(2)*c_D)//', gamma='//to_text(gamma)//' /'//nl// &
         '&sensor m_S='//to_text(factors(3)*m_S)//', x_S=0.4 /'//nl// &
         '&discretization elements=6, degree=5 /'//nl
   end function beam

   !> Computes a response of the true beam, or of another one, and keeps frf.csv.
   !>
   !> name    of the copy
   !> record  group &record
   subroutine make_response(name, record, other)
      character(len=*), intent(in) :: name, record
      character(len=*), intent(in), optional :: other
      type(outcome_t) :: outcome

      if (present(other)) then
         call write_file('r.nml', other//record//nl)
      else
         call write_file('r.nml', beam()//record//nl)
      end if
      outcome = beamid('frf r.nml --quiet --out r')
      call check('a response for '//name, outcome%status == 0, outcome%err)
      call write_file(name, read_file('r/frf.csv'))
   end subroutine make_response

   !> Reads a column of a table.
   function column(table, k) result(values)
      character(len=*), intent(in) :: table
      integer, intent(in) :: k
      real(wp), allocatable :: values(:)
      integer :: j

      values = [(number(field(table, j, k)), j=1, line_count(table) - 1)]
   end function column

   !> Writes a response with the columns frequency_hz, real, imag, and a standard deviation.
   !>
   !> seed  of the noise
   subroutine write_noisy(name, source, sd, seed)
      character(len=*), intent(in) :: name, source
      real(wp), intent(in) :: sd
      integer, intent(in) :: seed
      character(len=:), allocatable :: table, text
      character(len=120) :: row
      real(wp), allocatable :: f(:), re(:), im(:)
      integer :: k

      table = read_file(source)
      f = column(table, 2)
      re = column(table, 3) + gaussian_noise(size(f), sd, seed)
      im = column(table, 4) + gaussian_noise(size(f), sd, seed + 1)
      text = 'frequency_hz,real,imag,sd'//nl
      do k = 1, size(f)
         write (row, '(es23.16, 3(a, es23.16))') f(k), ',', re(k), ',', im(k), ',', sd
         text = text//trim(row)//nl
      end do
      call write_file(name, text)
   end subroutine write_noisy

   !> Returns a number of estimates.csv.
   real(wp) function value(answer, parameter, column_name)
      type(answer_t), intent(in) :: answer
      character(len=*), intent(in) :: parameter, column_name

      value = number(answer%estimate(parameter, column_name))
   end function value

   !> Checks that a fit succeeds and gives the four true values. The residuals are round-off, 1e-13
   !> of the response or so, and the condition of the Jacobian is 1e3.
   subroutine check_true(name, answer)
      character(len=*), intent(in) :: name
      type(answer_t), intent(in) :: answer
      real(wp), parameter :: allowed = 1e-8_wp

      call check(name, answer%status == 0, answer%err)
      call check_close('  E', value(answer, 'E', 'estimate')/E, 1.0_wp, allowed)
      call check_close('  c_D', value(answer, 'c_D', 'estimate')/c_D, 1.0_wp, allowed)
      call check_close('  m_S', value(answer, 'm_S', 'estimate')/m_S, 1.0_wp, allowed)
      if (answer%is_free('gamma')) call check_close('  gamma', value(answer, 'gamma', 'estimate') &
         /gamma, 1.0_wp, allowed)
   end subroutine check_true

   !> Exact data from starts 20 % off, without an excitation.
   subroutine test_exact()
      call check_true('exact data, E 20 % too high', identified(beam(1.2_wp, 0.8_wp, 1.2_wp)// &
         at_F//', file=''exact.csv'' /'//nl//all_four))
      call check_true('exact data, E 20 % too low', identified(beam(0.8_wp, 1.2_wp, 0.8_wp)// &
         at_F//', file=''exact.csv'' /'//nl//all_four))
   end subroutine test_exact

   !> Receptance and mobility, with an exponential window whose rate is that of the data.
   subroutine test_quantities()
      character(len=*), parameter :: names(2) = [character(len=10) :: 'receptance', 'mobility']
      character(len=:), allocatable :: keys
      integer :: k

      do k = 1, size(names)
         keys = at_F//', quantity='''//trim(names(k))//''', exponential_window=2.5'
         call make_response('window.csv', keys//band)
         call check_true(trim(names(k))//' with a window', identified(beam(1.2_wp, 0.8_wp, &
            1.2_wp)//keys//', file=''window.csv'' /'//nl//all_four))
      end do
   end subroutine test_quantities

   !> Two sensors on one beam, and forces at two places, each in a record of its own.
   subroutine test_sensors()
      character(len=*), parameter :: second = '&sensor name=''b'', m_S=0.01, x_S=0.2 /'//nl, &
         record_a = '&record kind=''frf'', sensor=''a'', x_F=0.3', &
         record_b = '&record kind=''frf'', sensor=''b'', x_F=0.5'
      type(answer_t) :: answer

      call make_response('a.csv', record_a//band, named(beam())//second)
      call make_response('b.csv', record_b//band, named(beam())//second)
      answer = identified(named(beam(1.2_wp, 0.8_wp, 1.2_wp))//second//record_a// &
         ', file=''a.csv'' /'//nl//record_b//', file=''b.csv'' /'//nl// &
         '&stage free=''E'',''c_D'',''m_S.a'',''gamma'' /')
      call check('two sensors and two forces', answer%status == 0, answer%err)
      ! As in `check_true`.
      call check_close('  E', value(answer, 'E', 'estimate')/E, 1.0_wp, 1e-8_wp)
      call check_close('  c_D', value(answer, 'c_D', 'estimate')/c_D, 1.0_wp, 1e-8_wp)
      call check_close('  m_S.a', value(answer, 'm_S.a', 'estimate')/m_S, 1.0_wp, 1e-8_wp)
   end subroutine test_sensors

   !> Returns a beam whose sensor has the name 'a'.
   function named(text)
      character(len=*), intent(in) :: text
      character(len=:), allocatable :: named
      integer :: k

      k = index(text, '&sensor ') + 8
      named = text(:k - 1)//'name=''a'', '//text(k:)
   end function named

   !> A response with the convention exp(-i omega t) is recognised, and the note says so.
   subroutine test_conjugate()
      character(len=:), allocatable :: table, text
      type(answer_t) :: answer
      integer :: k

      table = read_file('exact.csv')
      text = 'frequency_hz,real,imag'//nl
      do k = 1, line_count(table) - 1
         text = text//field(table, k, 2)//','//field(table, k, 3)//','// &
            negative(field(table, k, 4))//nl
      end do
      call write_file('conjugate.csv', text)
      answer = identified(beam(1.2_wp, 0.8_wp, 1.2_wp)//at_F//', file=''conjugate.csv'' /'//nl// &
         all_four)
      call check_true('conjugated response', answer)
      call check('  the note', index(answer%out, ' conjugated') > 0, answer%out)
      answer = identified(beam()//at_F//', file=''exact.csv'' /'//nl//all_four)
      call check('no note without need', index(answer%out, 'conjugated') == 0, answer%out)
   end subroutine test_conjugate

   !> A response of the opposite sign is negated, with a note, and gives the true values.
   subroutine test_sign()
      type(answer_t) :: answer

      answer = identified(beam(1.2_wp, 0.8_wp, 1.2_wp)//at_F// &
         ', file=''exact.csv'', scale=-1 /'//nl//all_four)
      call check_true('negated response', answer)
      call check('  the note', index(answer%out, 'negated') > 0, answer%out)
      answer = identified(beam()//at_F//', file=''exact.csv'' /'//nl//all_four)
      call check('no note on signs without need', index(answer%out, 'negated') == 0, answer%out)
   end subroutine test_sign

   !> A response in another unit, another quantity and frequencies in rad/s are refused with the
   !> likely cause, also from starts that are 20 % off.
   subroutine test_units()
      character(len=*), parameter :: keys(6) = [character(len=22) :: 'scale=1000', 'scale=-1000', &
         'scale=0.101972', 'scale=0.001', 'quantity=''mobility''', 'quantity=''receptance'''], &
         causes(6) = [character(len=22) :: 'mm', 'mm', 'multiples of g', 'per kN', 'accelerance', &
         'accelerance']
      character(len=:), allocatable :: table, text
      integer :: k

      do k = 1, size(keys)
         call refused_start(at_F//', file=''exact.csv'', '//trim(keys(k)), trim(causes(k)))
      end do
      table = read_file('exact.csv')
      text = 'frequency_hz,real,imag'//nl
      do k = 1, line_count(table) - 1
         text = text//to_text(2*acos(-1.0_wp)*number(field(table, k, 2)))//','// &
            field(table, k, 3)//','//field(table, k, 4)//nl
      end do
      call write_file('radians.csv', text)
      call refused_start(at_F//', file=''radians.csv''', 'rad/s')
   end subroutine test_units

   !> Expects that `identify` refuses a record, from starts that are 20 % off, and names the cause.
   subroutine refused_start(record, cause)
      character(len=*), intent(in) :: record, cause
      type(answer_t) :: answer

      answer = identified(beam(1.2_wp, 0.8_wp, 1.2_wp)//record//' /'//nl//all_four)
      call check('refused: '//record, answer%status == 2 .and. index(answer%err, cause) > 0, &
         answer%err)
   end subroutine refused_start

   !> Returns a number with the other sign.
   pure function negative(text)
      character(len=*), intent(in) :: text
      character(len=:), allocatable :: negative

      negative = '-'//text
      if (text(1:1) == '-') negative = text(2:)
   end function negative

   !> A Hann window widens every standard error by sqrt(35/18). The residuals are small, so that
   !> the stated noise counts in both fits.
   subroutine test_windows()
      character(len=*), parameter :: keys = ', file=''exact.csv'', sd=0.5', &
         names(4) = [character(len=5) :: 'E', 'c_D', 'm_S', 'gamma']
      type(answer_t) :: boxcar, hann
      integer :: k

      boxcar = identified(beam()//at_F//keys//' /'//nl//all_four)
      hann = identified(beam()//at_F//keys//', window=''hann'' /'//nl//all_four)
      call check('without a window', boxcar%status == 0, boxcar%err)
      call check('Hann window', hann%status == 0, hann%err)
      do k = 1, size(names)
         ! Both fits end within 1e-6 standard errors of the minimum.
         call check_close('  '//trim(names(k)), value(hann, trim(names(k)), 'std_error')/ &
            value(boxcar, trim(names(k)), 'std_error'), sqrt(35.0_wp/18), 1e-6_wp)
      end do
   end subroutine test_windows

   !> Returns the natural frequencies of a beam.
   function frequencies_of(text) result(f)
      character(len=*), intent(in) :: text
      real(wp), allocatable :: f(:)
      type(outcome_t) :: outcome

      call write_file('m.nml', text//'&excitation kind=''pulse'', amplitude=1, '// &
         'duration=0.01 /'//nl)
      outcome = beamid('modes m.nml --quiet --out m')
      call check('modes', outcome%status == 0, outcome%err)
      f = column(read_file('m/modes.csv'), 3)
   end function frequencies_of

   !> Returns a row of a table of modes.
   function row_of(values)
      real(wp), intent(in) :: values(:)
      character(len=:), allocatable :: row_of
      character(len=30) :: text
      integer :: k

      row_of = ''
      do k = 1, size(values)
         write (text, '(es23.16)') values(k)
         row_of = row_of//trim(merge(', ', '  ', k > 1))//trim(adjustl(text))
      end do
      row_of = row_of//nl
   end function row_of

   !> One frequency determines E: f**2 is proportional to E, so that the relative error of E is
   !> twice that of f. The estimate is linear in this error to second order.
   subroutine test_one_frequency()
      real(wp), parameter :: share = 1e-4_wp
      real(wp), allocatable :: f(:)
      type(answer_t) :: answer

      f = frequencies_of(beam())
      call write_file('one.csv', 'mode,frequency_hz,sd_hz'//nl//row_of([2.0_wp, f(2), share*f(2)]))
      answer = identified(beam(1.2_wp)//'&record kind=''modes'', file=''one.csv'' /'//nl// &
         '&stage free=''E'' /')
      call check('one frequency', answer%status == 0, answer%err)
      ! Round-off of the root and of the search, 1e-6 of the standard error.
      call check_close('  E', value(answer, 'E', 'estimate')/E, 1.0_wp, 1e-9_wp)
      call check_close('  standard error', value(answer, 'E', 'std_error')/(2*share*E), 1.0_wp, &
         1e-6_wp)
      call check_close('  interval', (value(answer, 'E', 'upper95') - value(answer, 'E', &
         'lower95'))/(2*normal*2*share*E), 1.0_wp, 1e-6_wp)
   end subroutine test_one_frequency

   !> Two frequencies determine E and m_S without a degree of freedom left: the intervals come from
   !> the stated deviations alone, D**-1 diag(sd**2) D**-T with the derivatives D of the
   !> frequencies. Central differences over 1e-3 of m_S have a truncation error of 1e-6 times a
   !> factor below 10.
   subroutine test_two_frequencies()
      real(wp), parameter :: share(2) = [2e-4_wp, 1e-4_wp], change = 1e-3_wp
      real(wp), allocatable :: f(:)
      real(wp) :: D(2, 2), inverse(2, 2), sd(2), variance(2)
      type(answer_t) :: answer

      f = frequencies_of(beam())
      D(:, 1) = f(:2)/2
      f = frequencies_of(beam(of_m_S=1 + change))
      D(:, 2) = f(:2)
      f = frequencies_of(beam(of_m_S=1 - change))
      D(:, 2) = (D(:, 2) - f(:2))/(2*change)
      f = frequencies_of(beam())
      sd = share*f(:2)
      inverse = reshape([D(2, 2), -D(2, 1), -D(1, 2), D(1, 1)], [2, 2])/(D(1, 1)*D(2, 2) &
         - D(1, 2)*D(2, 1))
      variance = matmul(inverse**2, sd**2)
      call write_file('two.csv', 'frequency_hz,sd_hz'//nl//row_of([f(1), sd(1)])//row_of([f(2), &
         sd(2)]))
      answer = identified(beam(0.8_wp, of_m_S=1.2_wp)//'&record kind=''modes'', '// &
         'file=''two.csv'' /' &
         //nl//'&stage free=''E'',''m_S'' /')
      call check('two frequencies, two parameters', answer%status == 0, answer%err)
      call check_close('  E', value(answer, 'E', 'estimate')/E, 1.0_wp, 1e-8_wp)
      call check_close('  m_S', value(answer, 'm_S', 'estimate')/m_S, 1.0_wp, 1e-7_wp)
      call check_close('  standard error of E', value(answer, 'E', 'std_error')/(E* &
         sqrt(variance(1))), 1.0_wp, 1e-4_wp)
      call check_close('  standard error of m_S', value(answer, 'm_S', 'std_error')/(m_S* &
         sqrt(variance(2))), 1.0_wp, 1e-4_wp)
   end subroutine test_two_frequencies

   !> Frequencies without numbers are assigned to the nearest modes after a common factor, even if
   !> E is wrong by 40 %, and the assignment is printed.
   subroutine test_assignment()
      real(wp), allocatable :: f(:)
      type(answer_t) :: answer

      f = frequencies_of(beam())
      call write_file('some.csv', 'frequency_hz,sd_hz'//nl//row_of([f(3), 1e-4_wp*f(3)])// &
         row_of([f(1), 1e-4_wp*f(1)]))
      answer = identified(beam(1.4_wp)//'&record kind=''modes'', file=''some.csv'' /'//nl// &
         '&stage free=''E'' /')
      call check('modes 3 and 1 in this order', answer%status == 0, answer%err)
      call check_close('  E', value(answer, 'E', 'estimate')/E, 1.0_wp, 1e-8_wp)
      call check('  the assignment is printed', index(answer%out, ' is mode 3 (model ') > 0 .and. &
         index(answer%out, ' is mode 1 (model ') > 0, answer%out)
   end subroutine test_assignment

   !> Without `elements`, `frf` and `modes` fit on the mesh that `identify` finds. The coarsest
   !> mesh, 8 cubic elements, shifts these frequencies by more than their errors.
   subroutine test_refinement()
      character(len=*), parameter :: response = at_F//band//nl, &
         stage = '&stage free=''E'',''m_S'' /'//nl
      character(len=:), allocatable :: case, elements
      type(answer_t) :: answer
      type(outcome_t) :: outcome

      call write_file('exact_modes.csv', 'frequency_hz,sd_hz'//nl//sharp_rows(frequencies_of( &
         beam())))
      case = replaced(beam(0.9_wp), '&discretization elements=6, degree=5 /'//nl, '')// &
         '&record kind=''modes'', file=''exact_modes.csv'' /'//nl//stage
      answer = identified(case)
      elements = answer%estimate('E', 'elements')
      call check('a refined mesh', answer%status == 0 .and. number(elements) > 8, elements// &
         answer%err)
      call write_file('mesh.nml', case)
      outcome = beamid('modes mesh.nml --out mesh --quiet')
      call check_close('  that of modes', number(last_mesh(read_file( &
         'mesh/modes_fitted.csv'))), number(elements), 0.0_wp)
      call write_file('mesh.nml', case//response)
      outcome = beamid('frf mesh.nml --out mesh --quiet')
      call check_close('  that of frf', number(last_mesh(read_file('mesh/frf.csv'))), &
         number(elements), 0.0_wp)
   end subroutine test_refinement

   !> Returns the number of elements in the last row of a table.
   function last_mesh(table) result(elements)
      character(len=*), intent(in) :: table
      character(len=:), allocatable :: elements

      elements = field(table, line_count(table) - 1, 1)
   end function last_mesh

   !> Returns the rows of the three lowest frequencies, each with a standard deviation of 1e-5 of
   !> its value.
   function sharp_rows(f) result(rows)
      real(wp), intent(in) :: f(:)
      character(len=:), allocatable :: rows
      integer :: k

      rows = ''
      do k = 1, 3
         rows = rows//row_of([f(k), 1e-5_wp*f(k)])
      end do
   end function sharp_rows

   !> The band of a fitted response is that of the delta method, with derivatives of the magnitude
   !> by differences over 1e-4 of a parameter, at the estimates, and the intervals of the
   !> estimates. The truncation error grows beside a resonance of damping ratio .002 to
   !> (1e-4/.002)**2 = 3e-3.
   subroutine test_band()
      real(wp), parameter :: change = 1e-4_wp, allowed = 1e-2_wp
      character(len=*), parameter :: stage = '&stage free=''E'',''c_D'' /'//nl
      type(answer_t) :: answer
      type(outcome_t) :: outcome
      real(wp), allocatable :: slopes(:, :), magnitude(:), width(:)
      real(wp), dimension(2) :: above, below, estimate, half
      real(wp) :: correlation
      character(len=:), allocatable :: table, case
      integer :: k

      call write_noisy('noisy.csv', 'exact.csv', 0.5_wp, 11)
      case = beam()//at_F//', file=''noisy.csv'' /'//nl//stage
      answer = identified(case)
      call check('fit of a response with noise', answer%status == 0, answer%err)
      half = [value(answer, 'E', 'upper95_corrected') - value(answer, 'E', 'lower95_corrected'), &
         value(answer, 'c_D', 'upper95_corrected') - value(answer, 'c_D', 'lower95_corrected')]/2
      table = read_file('o/frf.csv')
      call write_file('fit.csv', table)
      estimate = [value(answer, 'E', 'estimate')/E, value(answer, 'c_D', 'estimate')/c_D]
      correlation = number(field(read_file('o/correlations.csv'), 2, 5))
      call write_file('band.nml', case)
      outcome = beamid('frf band.nml --quiet --out band')
      call check('band of the fitted response', outcome%status == 0, outcome%err)
      table = read_file('band/frf.csv')
      magnitude = column(table, 5)
      call check('the fit writes the same band', all(abs(column(table, 7) - column(read_file( &
         'fit.csv'), 11)) <= 1e-9_wp*magnitude) .and. all(abs(column(table, 8) - column( &
         read_file('fit.csv'), 12)) <= 1e-9_wp*magnitude))
      allocate (slopes(size(magnitude), 2))
      do k = 1, 2
         above = estimate
         above(k) = estimate(k) + change
         below = estimate
         below(k) = estimate(k) - change
         slopes(:, k) = (magnitude_of(above) - magnitude_of(below))/(2*change)
      end do
      slopes = slopes*spread(half/[E, c_D], 1, size(magnitude))
      width = sqrt(slopes(:, 1)**2 + slopes(:, 2)**2 + 2*correlation*slopes(:, 1)*slopes(:, 2))
      call check_close('  upper end by differences', maxval(abs(column(table, 8) - magnitude &
         - width))/maxval(width), 0.0_wp, allowed)
      call check_close('  lower end by differences', maxval(abs(magnitude - column(table, 7) &
         - width))/maxval(width), 0.0_wp, allowed)
      ! With another E, which is fixed, the fit is rejected: it has no band, and no modes.
      call write_file('wrong.nml', beam(of_E=1.3_wp)//at_F//', file=''noisy.csv'' /'//nl// &
         '&stage free=''c_D'' /'//nl)
      outcome = beamid('frf wrong.nml --quiet --out wrong')
      call check('no band of a rejected fit', outcome%status == 1 .and. &
         index(outcome%err, 'no fit: ') > 0 .and. .not. exists('wrong'), outcome%err)
      outcome = beamid('modes wrong.nml --quiet --out wrong')
      call check('no modes of a rejected fit', outcome%status == 0 .and. &
         index(outcome%out, 'no intervals: ') > 0 .and. index(outcome%out, 'no fit: ') > 0 .and. &
         .not. exists('wrong/modes_fitted.csv'), outcome%out)
   end subroutine test_band

   !> A response that is nothing but noise, fitted by a beam without damping, whose peaks exceed it:
   !> the residuals are white within their tests, and some thousand times as large as the record.
   subroutine test_pure_noise()
      type(outcome_t) :: outcome
      character(len=:), allocatable :: table
      real(wp) :: noise(2)
      integer :: k, seed

      do seed = 1, 3
         table = 'frequency_hz,real,imag,sd'//nl
         do k = 5, 299
            noise = gaussian_noise(2, 0.1_wp, 1000*seed + k)
            table = table//to_text(k)//','//to_text(noise(1))//','//to_text(noise(2))//',0.1'//nl
         end do
         call write_file('noise.csv', table)
         call write_file('noise.nml', '&beam length=0.5, rho=0.27, E=6.5e10, I=3e-11 /'//nl// &
            '&sensor x_S=0.4 /'//nl//'&record kind=''frf'', file=''noise.csv'', x_F=0.2 /'//nl// &
            '&stage free=''E'' /'//nl)
         outcome = beamid('identify noise.nml --quiet --out noise')
         call check('pure noise is no fit', outcome%status == 1 .and. &
            index(outcome%err, 'no fit: ') > 0, outcome%err//outcome%out)
      end do
   end subroutine test_pure_noise

   !> Returns the magnitude of the response of a beam.
   !>
   !> factors  of E and c_D
   function magnitude_of(factors) result(magnitude)
      real(wp), intent(in) :: factors(2)
      real(wp), allocatable :: magnitude(:)

      call make_response('other.csv', at_F//band, beam(factors(1), factors(2)))
      magnitude = column(read_file('other.csv'), 5)
   end function magnitude_of

   !> Noise of three times the stated standard deviation is improbable, so that the intervals widen
   !> by what the residuals show: the variance of 1,188 values is 9 within 9 sqrt(2/1188) = .37.
   subroutine test_excess()
      type(answer_t) :: honest, wrong

      call write_noisy('loud.csv', 'exact.csv', 1.5_wp, 31)
      honest = identified(beam()//at_F//', file=''loud.csv'' /'//nl//'&stage free=''E'' /')
      wrong = identified(beam()//at_F//', file=''loud.csv'', sd=0.5 /'//nl//'&stage free=''E'' /')
      call check('stated noise that is right, too low', honest%status == 0 .and. &
         wrong%status == 0, &
         honest%err//wrong%err)
      ! Four standard deviations of the estimated noise, .17.
      call check_close('  standard error', value(wrong, 'E', 'std_error')/value(honest, 'E', &
         'std_error'), 1.0_wp, 0.1_wp)
      call check('  the same estimate', abs(value(wrong, 'E', 'estimate') - value(honest, 'E', &
         'estimate')) < 1e-3_wp*value(honest, 'E', 'std_error'))
   end subroutine test_excess

   !> A free decay, a response and two frequencies of one beam: the errors of the mixture are
   !> smaller than those of each record alone, and every interval holds the truth (five standard
   !> errors).
   subroutine test_mixture()
      character(len=*), parameter :: names(3) = [character(len=3) :: 'E', 'c_D', 'm_S'], &
         blow = '&excitation kind=''pulse'', amplitude=20, duration=0.004, x_F=0.3 /'//nl, &
         records(3) = [character(len=60) :: '&record file=''decay.csv'' /', &
         '&record kind=''frf'', x_F=0.3, file=''mixed.csv'' /', &
         '&record kind=''modes'', file=''mixed-modes.csv'' /'], &
         stage = nl//'&stage free=''E'',''c_D'',''m_S'' /'
      type(answer_t) :: all, alone
      real(wp), allocatable :: f(:)
      integer :: j, k

      call make_decay()
      call write_noisy('mixed.csv', 'exact.csv', 3.0_wp, 21)
      f = frequencies_of(beam())
      call write_file('mixed-modes.csv', 'frequency_hz,sd_hz,damping_ratio,sd_damping'//nl// &
         row_of([f(1), 1e-4_wp*f(1), 0.00244_wp, 3e-5_wp])//row_of([f(2), 1e-4_wp*f(2), &
         0.0058_wp, 4e-5_wp]))
      all = identified(beam(1.2_wp, 0.8_wp, 1.2_wp)//blow//trim(records(1))//nl// &
         trim(records(2))//nl//trim(records(3))//stage)
      call check('mixture from 20 % off', all%status == 0, all%err)
      call check_within(all)
      do k = 1, size(records)
         alone = identified(beam(1.2_wp, 0.8_wp, 1.2_wp)//blow//trim(records(k))//stage)
         call check('record '//to_text(k)//' alone', alone%status == 0, alone%err)
         call check_within(alone)
         do j = 1, size(names)
            call check('  larger error of '//trim(names(j)), value(all, trim(names(j)), &
               'std_error') < value(alone, trim(names(j)), 'std_error'))
         end do
      end do
      call test_order(beam()//blow, [records(2), records(1)], stage)
   end subroutine test_mixture

   !> The rows of fit.csv are those of the record in time, whatever stands before it: the residual
   !> is measured - model, and as large as the noise of the decay. &windows is refused.
   subroutine test_order(before, records, stage)
      character(len=*), intent(in) :: before, records(2), stage
      type(answer_t) :: answer
      character(len=:), allocatable :: table
      real(wp), allocatable :: left(:), right(:)
      integer :: k

      answer = identified(before//trim(records(1))//nl//trim(records(2))//stage)
      call check('response before decay', answer%status == 0, answer%err)
      table = read_file('o/fit.csv')
      left = [(number(field(table, k, 5)), k=1, line_count(table) - 1)]
      right = [(number(field(table, k, 3)) - number(field(table, k, 4)), k=1, size(left))]
      call check('response before decay: residuals', maxval(abs(left - right)) <= &
         1e-12_wp*maxval(abs(left)))
      call check_close('response before decay: noise', norm2(left)/sqrt(real(size(left), wp))/ &
         decay_noise, 1.0_wp, 0.1_wp)
      call check_refused('windows beside a response', 2, 'identify', before//trim(records(1))// &
         nl//trim(records(2))//stage//nl//'&windows n=3 /', 'expected only records that '// &
         'are functions of time')
      ! The fit would have the decay alone, as record 1, but &prior means the decay by record=2.
      call check_refused('frf: a record without a file first', 2, 'frf', before//at_F//band//nl// &
         trim(records(2))//stage//nl//'&prior parameter=''length'', sd=0.001, record=2 /', &
         'expected records without file after all others')
   end subroutine test_order

   !> Writes a free decay of the true beam after a pulse, with noise.
   subroutine make_decay()
      type(outcome_t) :: outcome
      real(wp), allocatable :: t(:), a(:)
      character(len=:), allocatable :: table, text
      integer :: k

      call write_file('s.nml', beam()//'&excitation kind=''pulse'', amplitude=20, '// &
         'duration=0.004, x_F=0.3 /'//nl//'&record t_first=0.01, t_last=0.8, t_step=0.002 /')
      outcome = beamid('simulate s.nml --quiet --out s')
      call check('a decay', outcome%status == 0, outcome%err)
      table = read_file('s/record.csv')
      t = column(table, 1)
      a = column(table, 2)
      a = a + gaussian_noise(size(a), decay_noise, 41)
      text = 't,a'//nl
      do k = 1, size(t)
         text = text//row_of([t(k), a(k)])
      end do
      call write_file('decay.csv', text)
   end subroutine make_decay

   !> Checks that the estimates are within five standard errors of the truth.
   subroutine check_within(answer)
      type(answer_t), intent(in) :: answer

      call check_close('  E', value(answer, 'E', 'estimate'), E, 5*value(answer, 'E', 'std_error'))
      call check_close('  c_D', value(answer, 'c_D', 'estimate'), c_D, 5*value(answer, 'c_D', &
         'std_error'))
      call check_close('  m_S', value(answer, 'm_S', 'estimate'), m_S, 5*value(answer, 'm_S', &
         'std_error'))
   end subroutine check_within

   !> The table that a fit writes is a response, too: that of the fitted structure.
   subroutine test_read_back()
      type(answer_t) :: first, again

      first = identified(beam()//at_F//', file=''exact.csv'' /'//nl//all_four)
      call write_file('fitted.csv', read_file('o/frf.csv'))
      again = identified(beam(1.2_wp)//at_F//', file=''fitted.csv'' /'//nl//all_four)
      call check('frf.csv of a fit without a known noise: no empty column', &
         index(line(read_file('fitted.csv'), 1), ',sd') == 0 .and. &
         index(line(read_file('fitted.csv'), 1), ',coherence') == 0)
      call check_true('frf.csv of a fit is read back', again)
      ! With a window, the standard deviations of the table mean the same as the stated one.
      first = identified(beam()//at_F//', file=''exact.csv'', sd=0.1, window=''hann'' /'//nl// &
         all_four)
      call write_file('windowed.csv', read_file('o/frf.csv'))
      again = identified(beam()//at_F//', file=''windowed.csv'', window=''hann'' /'//nl//all_four)
      call check_close('frf.csv with a window is read back: standard error of E', &
         number(again%estimate('E', 'std_error')), number(first%estimate('E', 'std_error')), &
         1e-6_wp*number(first%estimate('E', 'std_error')))
   end subroutine test_read_back

   !> The standard errors that a design predicts are those of a fit to exact data with the same
   !> known noise, for the present lines and for candidates: J'J of the same residuals, so that only
   !> round-off remains.
   subroutine test_design()
      character(len=*), parameter :: names(4) = [character(len=5) :: 'E', 'c_D', 'm_S', 'gamma'], &
         plan = at_F//band//nl//all_four//nl//'&design noise_sd=0.1, f_step=0.5,1, x_S=0.3,0.4 /'
      type(answer_t) :: answer, fine
      type(outcome_t) :: outcome
      character(len=:), allocatable :: strip, table
      real(wp) :: sd
      integer :: column, k, row

      ! A design chooses positions, so that its mesh has no knots there.
      strip = replaced(beam(), 'degree=5', 'degree=5, knots=''uniform''')
      call make_response('coarse.csv', at_F//band, strip)
      call make_response('fine.csv', at_F//', f_first=4, f_last=300, f_step=0.5 /', strip)
      answer = identified(strip//at_F//', file=''coarse.csv'', sd=0.1 /'//nl//all_four)
      fine = identified(strip//at_F//', file=''fine.csv'', sd=0.1 /'//nl//all_four)
      call write_file('plan.nml', strip//plan//nl)
      outcome = beamid('design plan.nml --quiet --out plan')
      call check('design: status', outcome%status == 0, outcome%err)
      table = read_file('plan/design.csv')
      call check('design: bands', field(table, 0, 6) == 'f_first' .and. field(table, 0, 8) == &
         'f_step')
      call check('design: lines', field(table, 1, 9) == '297')
      do column = 1, 40
         if (field(table, 0, column) == 'sd_E') exit
      end do
      do k = 1, size(names)
         sd = number(answer%estimate(trim(names(k)), 'std_error'))
         call check_close('design: present, '//trim(names(k)), &
            number(field(table, 1, column + k - 1))/sd, 1.0_wp, 1e-6_wp)
         do row = 2, 5
            if (abs(number(field(table, row, 2)) - 0.4_wp) > 1e-9_wp) cycle
            if (number(field(table, row, 8)) < 0.75_wp) sd = number(fine%estimate( &
               trim(names(k)), 'std_error'))
            if (number(field(table, row, 8)) > 0.75_wp) sd = number(answer%estimate( &
               trim(names(k)), 'std_error'))
            call check_close('design: candidate '//to_text(row - 1)//', '//trim(names(k)), &
               number(field(table, row, column + k - 1))/sd, 1.0_wp, 1e-6_wp)
         end do
      end do
      ! A Hann window correlates neighbouring frequencies: variances grow by 35/18.
      sd = number(field(table, 1, column))
      call write_file('plan.nml', strip//replaced(plan, 'f_last=300', &
         'f_last=300, window=''hann''')//nl)
      outcome = beamid('design plan.nml --quiet --out plan')
      table = read_file('plan/design.csv')
      do row = 1, 5
         if (abs(number(field(table, row, 2)) - 0.4_wp) > 1e-9_wp .or. &
            number(field(table, row, 8)) < 0.75_wp) cycle
         call check_close('design: a window, row '//to_text(row - 1), &
            number(field(table, row, column))/sd, sqrt(35.0_wp/18), 1e-6_wp)
      end do
      call write_file('plan.nml', strip//plan(:len(plan) - 2)//', t_last=3 /'//nl)
      outcome = beamid('design plan.nml --quiet --out plan')
      call check('design: times of a frequency response are refused', outcome%status == 2 .and. &
         index(outcome%err, '&design t_last: found a value, expected none with kind = '// &
         '''frf''') > 0, outcome%err)
   end subroutine test_design

   !> What is refused, in words.
   subroutine test_refusals()
      character(len=*), parameter :: free = ' /'//nl//'&stage free=''E'' /', &
         file = at_F//', file=''exact.csv'''

      call write_file('coherence.csv', 'frequency_hz,real,imag,coherence'//nl//'1,2,3,0.9'//nl// &
         '2,2,3,0.9'//nl)
      call write_file('high.csv', 'frequency_hz,sd_hz,mode'//nl//'9.4,0.01,40'//nl)
      call write_file('close.csv', 'frequency_hz,sd_hz'//nl//'9.9,0.01'//nl//'10.1,0.01'//nl)
      call refused('&integrator method=''cvode'' /'//nl//file//free, &
         '&integrator method: found ''cvode''')
      call refused(file//', t_first=1'//free, '&record t_first: found a value, '// &
         'expected none with kind = ''frf''')
      call refused('&record kind=''modes'', file=''high.csv'', f_first=1'//free, '&record '// &
         'f_first: found a value, expected none with kind = ''modes''')
      call refused('&record file=''exact.csv'', quantity=''mobility'''//free, &
         '&record quantity: found a value, expected none with kind = ''time''')
      call refused(at_F//', file=''coherence.csv'''//free, '&record averages: found nothing '// &
         'beside a column coherence, expected the number of averaged blocks, or sd')
      call refused(file//', coherence_least=0.5'//free, &
         '&record coherence_least: found 0.5 for a file without coherence, '// &
         'expected a column coherence')
      call refused(file//', f_first=1000'//free, 'found no line between f_first and f_last')
      call refused(file//', f_first=10, f_last=5'//free, '&record f_last: found 5, '// &
         'expected no less than f_first = 10')
      call refused('&record kind=''frf'', x_F=0.7, file=''exact.csv'''//free, &
         '&record x_F: found 0.7')
      call refused('&record kind=''modes'', file=''high.csv'''//free, 'found mode 40, '// &
         'expected at most ')
      call refused('&record kind=''modes'', file=''close.csv'''//free, &
         'expected a column mode with the numbers of the modes')
      call no_response(at_F//', f_first=1, f_last=9 /', &
         '&record: found no list of frequencies, expected f_first, f_last and f_step')
      call no_response(at_F//', f_first=1, f_last=1e9, f_step=1e-3 /', 'at least 1000, which '// &
         'makes a million frequencies')
      call no_response('&record t_first=1, t_last=2, t_step=1 /', &
         'found no group with kind=''frf''')
      call no_response(at_F//', file=''exact.csv'' /', 'found a measured response and no fit, '// &
         'expected f_first, f_last and f_step, or a &stage')
   end subroutine test_refusals

   !> Expects that `identify` refuses a case with status 2.
   subroutine refused(groups, words)
      character(len=*), intent(in) :: groups, words
      type(answer_t) :: answer

      answer = identified(beam()//groups)
      call check('refused: '//words, answer%status == 2 .and. index(answer%err, words) > 0, &
         answer%err)
   end subroutine refused

   !> Expects that `frf` refuses a case with status 2.
   subroutine no_response(groups, words)
      character(len=*), intent(in) :: groups, words
      type(outcome_t) :: outcome

      call write_file('r.nml', beam()//groups//nl)
      outcome = beamid('frf r.nml --quiet --out r')
      call check('refused: '//words, outcome%status == 2 .and. index(outcome%err, words) > 0, &
         outcome%err)
   end subroutine no_response

end program test_frequency_fits
