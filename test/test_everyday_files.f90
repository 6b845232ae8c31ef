!> Records as phones, spreadsheets and oscilloscopes export them: quotes, names with units, lines of
!> units, decimal commas; and files that only look like records.
program test_everyday_files
   use beamid_kinds, only: wp
   use checks, only: check, finish
   use loaded_records, only: check_loaded, load, message, notes
   use shell, only: own_path, replaced
   implicit none

   character(len=*), parameter :: nl = achar(10), cr = achar(13), tab = achar(9), q = '"', &
      mark = char(239)//char(187)//char(191)
   !> The numbers of every file that is read here; all are exact in binary.
   real(wp), parameter :: times(3) = [0.0_wp, 0.5_wp, 1.25_wp], values(3) = [1.0_wp, -2.5_wp, &
      4.0_wp]
   !> What phyphox exports, with commas and decimal points.
   character(len=*), parameter :: phyphox = &
      '"Time (s)","Acceleration x (m/s^2)","Acceleration y (m/s^2)","Acceleration z (m/s^2)",'// &
      '"Absolute acceleration (m/s^2)"'//nl// &
      '0.000000000E0,8.000000000E-1,7.000000000E-2,1.000000000E0,1.282536549E0'//nl// &
      '5.000000000E-1,8.000000000E-1,7.000000000E-2,-2.500000000E0,2.625766935E0'//nl// &
      '1.250000000E0,9.000000000E-1,7.000000000E-2,4.000000000E0,4.100597517E0'//nl
   character(len=:), allocatable :: scratch

   scratch = own_path('everyday_files')
   call test_phyphox()
   call test_quotes()
   call test_bad_quotes()
   call test_names()
   call test_lines_of_units()
   call test_thousands()
   call test_other_files()
   call execute_command_line('rm -r '//scratch)
   call finish('everyday_files')

contains

   !> The five variants of the text that phyphox offers.
   subroutine test_phyphox()
      character(len=*), parameter :: column = 'Acceleration z (m/s^2)'

      call read_as('phyphox: comma, point', phyphox, '', column)
      call read_as('phyphox: tab, point', replaced(phyphox, ',', tab), '', column)
      call read_as('phyphox: semicolon, point', replaced(phyphox, ',', ';'), '', column)
      call read_as('phyphox: tab, comma', replaced(replaced(phyphox, ',', tab), '.', ','), '', &
         column)
      call read_as('phyphox: semicolon, comma', replaced(replaced(phyphox, ',', ';'), '.', ','), &
         '', column)
      call read_as('phyphox: CRLF and a byte order mark', mark//replaced(phyphox, nl, cr//nl), '', &
         column)
      call read_as('phyphox: without the unit', phyphox, 'Time', 'Acceleration z')
      call read_as('phyphox: in lower case', phyphox, 'time (S)', 'acceleration Z')
      call read_as('phyphox: by number', phyphox, '1', '4')
      call load(phyphox, scratch)
      call check('phyphox: the default is said', any(notes == 'warning: column 2 '// &
         '(''Acceleration x (m/s^2)'') of 5 is the record: value_column names another'))
      call refused('a sensor that has no value', replaced(phyphox, '4.000000000E0', 'NaN'), &
         'record.csv:4: column 4 (''Acceleration z (m/s^2)''): found ''NaN'', expected a number', &
         '', column)
      call refused('no such name without unit', phyphox, 'found the columns ''Time (s)'', '// &
         '''Acceleration x (m/s^2)''', '', 'Acceleration')
   end subroutine test_phyphox

   subroutine test_quotes()
      call read_as('numbers in quotes', '"t","a"'//nl//'"0","1"'//nl//'"0.5","-2.5"'//nl// &
         '"1.25","4"'//nl)
      call read_as('decimal commas in quotes, between commas', '"t","a"'//nl//'"0","1,0"'//nl// &
         '"0,5","-2,5"'//nl//'"1,25","4,0"'//nl)
      call read_as('decimal commas in quotes, without names', '"0,0","1,0"'//nl//'"0,5","-2,5"'// &
         nl//'"1,25","4,0"'//nl)
      call read_as('only some numbers in quotes', 't,a'//nl//'0,1'//nl//'"0,5","-2,5"'//nl// &
         '"1,25",4'//nl)
      call read_as('decimal commas in quotes, between semicolons', 't;a'//nl//'"0,0";"1,0"'//nl// &
         '"0,5";"-2,5"'//nl//'"1,25";"4,0"'//nl)
      call read_as('names with separators and quotes', '"t, s","acc ""z""; top"'//nl//'0,1'//nl// &
         '0.5,-2.5'//nl//'1.25,4'//nl)
      call read_as('a remark with separators', 't,note,a'//nl//'0,"one, two",1'//nl// &
         '0.5,"say ""x, y""",-2.5'//nl//'1.25,,4'//nl, 't', 'a')
      call read_as('blanks around quotes', ' "0" , "1" '//nl//' "0.5" , " -2.5 " '//nl// &
         '"1.25","4"'//nl)
      call read_as('a quotation mark inside a name', 't,5" beam'//nl//'0,1'//nl//'0.5,-2.5'//nl// &
         '1.25,4'//nl)
      call read_as('quotes that no field begins with', 't,5" beam, 3" wide'//nl//'0,1,7'//nl// &
         '0.5,-2.5,7'//nl//'1.25,4,7'//nl)
      call read_as('trailing separators', 't;a;'//nl//'0;1;'//nl//'0,5;-2,5;'//nl//'1,25;4;'//nl)
      call read_as('trailing separators below names without', 't,a'//nl//'0,1,,'//nl// &
         '0.5,-2.5,,'//nl//'1.25,4,,'//nl)
   end subroutine test_quotes

   subroutine test_bad_quotes()
      call refused('a quotation mark that is not closed', 't,a'//nl//'0,1'//nl//'0.5,"-2.5'//nl, &
         'record.csv:3: column 2 (''a''): found ''"-2.5'', expected a number')
      call refused('quotes around a row', 't,a'//nl//'0,1'//nl//'"0.5,-2.5"'//nl, &
         'record.csv:3: column 1 (''t''): found ''0.5,-2.5'', expected a number')
      call refused('text in quotes', 't,a'//nl//'0,1'//nl//'0.5,"x"'//nl, &
         'record.csv:3: column 2 (''a''): found ''x'', expected a number')
      call refused('nothing in quotes', 't,a'//nl//'0,1'//nl//'0.5,""'//nl, &
         'record.csv:3: column 2 (''a''): found an empty field, expected a number')
      call refused('quotes inside a number', 't,a'//nl//'0,1'//nl//'0.5,"-2".5'//nl, &
         'record.csv:3: column 2 (''a''): found ''"-2".5'', expected a number')
      call refused('a comma after points', 't,a'//nl//'"0.5","1.5"'//nl//'"1.5","2,5"'//nl, &
         'record.csv:3: column 2 (''a''): found ''2,5'', expected a number')
      call refused('a point after commas', 't,a'//nl//'"0,5","1,5"'//nl//'"1,5","2.5"'//nl, &
         'record.csv:3: column 2 (''a''): found ''2.5'', expected a number (a decimal sign '// &
         'is '','' as in the lines above)')
      call refused('a row that is short', 't,a'//nl//'0,1'//nl//'"0,5"'//nl, &
         'record.csv:3: column 2 (''a''): found the end of the line, expected a number')
   end subroutine test_bad_quotes

   !> Names with units can be given without them, if that is unambiguous.
   subroutine test_names()
      character(len=*), parameter :: rows = '0,9,1'//nl//'0.5,8,-2.5'//nl//'1.25,7,4'//nl

      call read_as('brackets', 't [s],p [K],a [g]'//nl//rows, 't', 'a')
      call read_as('a slash', 't / s,p / K,a / (m/s^2)'//nl//rows, 't', 'a')
      call read_as('an underscore', 't_s,temp,acc_g'//nl//rows, 't', 'acc')
      call read_as('nested brackets', 't (s),p (K),a (m/(s^2))'//nl//rows, 't', 'a')
      call read_as('the exact name first', 't (s),a (x),a'//nl//rows, 't', 'a')
      call refused('two columns of one name', 't (s),a (g),a (V)'//nl//rows, &
         'record.csv: found 2 columns called ''a'', expected value_column to name one', 't', 'a')
      call refused('a name that has no unit', 't,Temp,acc_x'//nl//rows, &
         'expected value_column = ''acc'' to be one of them', 't', 'acc')
   end subroutine test_names

   subroutine test_lines_of_units()
      character(len=*), parameter :: rows = '0,9,1'//nl//'0.5,8,-2.5'//nl//'1.25,7,4'//nl

      call read_as('an oscilloscope', 'Time,Channel A,Channel B'//nl//'(s),(V),(mV)'//nl//nl// &
         rows, &
         'Time', 'Channel B')
      call check('  no line is skipped', size(notes) == 0)
      call read_as('an oscilloscope, with the unit', 'Time,Channel A,Channel B'//nl// &
         '(s),(V),(mV)'//nl//nl//rows, 'Time [s]', 'Channel B [mV]')
      call read_as('units without brackets, behind a header', 'Logger 3'//nl//'t,p,a'//nl// &
         's,C,m/s2'//nl//rows, 't', 'a')
      call check('  one line is skipped', any(notes == '1 line of a header skipped'))
      call read_as('a unit for some columns', 'n;T;a'//nl//'s;;g'//nl//replaced(rows, ',', ';'), &
         'n', 'a')
      call read_as('two lines of names', 'first,second,third'//nl//'t,p,a'//nl//rows, 't', 'a')
      call read_as('names that are units', 's,C,g'//nl//rows, 's', 'g')
   end subroutine test_lines_of_units

   !> '1,234' may be thousands or a decimal comma: only a file that shows which is read.
   subroutine test_thousands()
      character(len=*), &
         parameter :: ambiguous = 'record.csv: found a comma before three digits in '// &
         'every number with a comma, expected clear decimal commas'

      call refused('thousands in quotes', 't,a'//nl//'1,"1,234"'//nl//'2,"-2,345"'//nl//'3,999'// &
         nl, &
         ambiguous)
      call refused('thousands between tabs', 't'//tab//'a'//nl//'1'//tab//'1,234'//nl//'2'//tab// &
         '-2,345'//nl, ambiguous)
      call refused('millions', 't,a'//nl//'1,"1,234,567"'//nl//'2,"2,345,678"'//nl, &
         'record.csv:2: column 2 (''a''): found ''1,234,567'', expected a number')
      call refused('thousands and a point', 't,a'//nl//'1,"1,234.5"'//nl//'2,"2,345.5"'//nl, &
         'record.csv:2: column 2 (''a''): found ''1,234.5'', expected a number')
      call refused('points between thousands', 't;a'//nl//'1;1.234,5'//nl//'2;2.345,5'//nl, &
         'record.csv:2: column 2 (''a''): found ''1.234,5'', expected a number')
      call read_as('three decimals that are no thousands', 't'//tab//'a'//nl//'0,000'//tab// &
         '1,000'//nl//'0,500'//tab//'-2,500'//nl//'1,250'//tab//'4,000'//nl)
   end subroutine test_thousands

   !> Files that are no text tables, by their first bytes.
   subroutine test_other_files()
      character(len=1), parameter :: zero = achar(0)

      call refused('UTF-16', char(255)//char(254)//'t'//zero//','//zero//'a'//zero//nl//zero, &
         'record.csv: found text in UTF-16, expected UTF-8 (scripts/to_csv.py converts it)')
      call refused('a workbook or archive', 'PK'//achar(3)//achar(4)//repeat(zero, 30), &
         'record.csv: found a zip archive or a workbook, expected text (scripts/to_csv.py '// &
         'reads archives of text; export a sheet as CSV)')
   end subroutine test_other_files

   !> Exact: all numbers are short binary fractions.
   subroutine read_as(what, text, time_column, value_column)
      character(len=*), intent(in) :: what, text
      character(len=*), intent(in), optional :: time_column, value_column

      call load(text, scratch, time_column, value_column)
      call check_loaded('read: '//what, times, values)
   end subroutine read_as

   subroutine refused(what, text, words, time_column, value_column)
      character(len=*), intent(in) :: what, text, words
      character(len=*), intent(in), optional :: time_column, value_column

      call load(text, scratch, time_column, value_column)
      call check('refused: '//what, index(message, words) > 0 .and. index(message, nl) == 0, &
         message)
   end subroutine refused

end program test_everyday_files
