!> No result of other inputs passes for a result of these: every file that a case names is part of
!> the fingerprint, and a shard or a table that is not what its name says is never used.
program test_stale_results
   use, intrinsic :: iso_fortran_env, only: int64
   use beamid_blocks, only: block_t
   use beamid_case_files, only: add_case, case_t, list_keys
   use beamid_cases, only: needs_nothing, read_case
   use beamid_ensembles, only: member_t
   use beamid_errors, only: error_t
   use beamid_fingerprints, only: crc64, fingerprint_length, fingerprint_t
   use beamid_fleets, only: fleet_case_t, fleet_fit_t, open_fleet_case, read_fleet
   use beamid_kinds, only: wp
   use beamid_member_rows, only: members_header, read_members
   use checks, only: check, check_close, finish, skip
   use shell, only: beamid, close_shell, has_all, in_scratch, line_count, open_shell, &
      outcome_t, program_path, read_file, replaced, run, write_file
   use tables, only: field, number
   implicit none

   character(len=*), parameter :: nl = achar(10)
   character(len=*), parameter :: &
      beam = '&beam length=4.0, rho=0.03, E=80.0, I=1.0, c_D=0.005 /'//nl//'&tip m_T=0.15 /'//nl// &
      '&discretization elements=2 /'//nl, &
      pulse = '&excitation kind=''pulse'', amplitude=1.0, duration=0.05 /'//nl, &
      force = '&excitation kind=''table'', file=''force.csv'' /'//nl, &
      samples = '&record t_first=0.1, t_last=2.0, t_step=0.05 /'//nl, &
      noise = '&noise sd=0.02 /'//nl, &
      stage = '&stage free=''E'',''m_T'', start=79,0.14 /'//nl, &
      group = '&ensemble members=400 /'//nl, &
      force_table = 't,F'//nl//'0,0'//nl//'0.01,1'//nl//'0.05,1'//nl//'0.06,0'//nl
   character(len=:), allocatable :: reason
   type(outcome_t) :: outcome

   call test_checksum()
   call test_members_table()
   call open_shell(reason)
   if (reason /= '') then
      call skip('stale results', reason)
   else
      call test_every_file_key()
      call test_changing_file()
      call write_file('case.nml', beam//pulse//samples//noise//stage//group)
      outcome = beamid('ensemble case.nml --out right --quiet')
      call check('an ensemble to compare with', outcome%status == 0, outcome%err)
      call test_wider_range()
      call test_shard_of_another_ensemble()
      call test_directory()
      call test_damaged_shards()
      call test_force_table()
      call test_fleet()
   end if
   call close_shell()
   call finish('stale_results')

contains

   !> The check value of CRC-64/XZ, in one piece and in two; texts that share their bytes differ.
   subroutine test_checksum()
      integer(int64), parameter :: known = int(z'995dc9bbdf1939fa', int64)

      call check('CRC-64/XZ of 123456789', crc64('123456789', 0_int64) == known)
      call check('the same in two pieces', crc64('56789', crc64('1234', 0_int64)) == known)
      call check('a byte that moves to the next text', digits_of('ab', 'c') /= digits_of('a', 'bc'))
      call check('the order of texts', digits_of('a', 'b') /= digits_of('b', 'a'))
      call check('a text that becomes empty', digits_of('ab', '') /= digits_of('', 'ab'))
   end subroutine test_checksum

   !> Returns the fingerprint of two texts.
   function digits_of(one, other) result(digits)
      character(len=*), intent(in) :: one, other
      character(len=fingerprint_length) :: digits
      type(fingerprint_t) :: fingerprint

      call fingerprint%add(one)
      call fingerprint%add(other)
      digits = fingerprint%digits()
   end function digits_of

   !> A row that no run has written is refused with its line, whatever number it has.
   subroutine test_members_table()
      character(len=*), parameter :: row = ',ok,,2,E,80,1,78,82,77,83,'//nl
      type(member_t), allocatable :: members(:)
      type(error_t), allocatable :: error

      call read_members(members_header//nl//'1'//row//'1'//row//'3,failed,"no, ""fit""",,,,,,,,,', &
         'm.csv', 3, members, error)
      call check('a table is read', .not. allocated(error))
      call check('rows by members', size(members(1)%rows) == 2 .and. size(members(2)%rows) == 0 &
         .and. size(members(3)%rows) == 0)
      call refused('1'//row//'999999999'//row, 'm.csv:3: found ''999999999')
      call refused('4'//row, 'm.csv:2: found ''4,ok')
      call refused('2'//row//'1'//row, 'm.csv:3: found ''1,ok')
      call refused('0'//row, 'm.csv:2: ')
      call refused('x'//row, 'm.csv:2: ')
      call refused('1,ok,,2,E,80,1'//nl, 'm.csv:2: ')
      call refused('1,ok,,2,E,8O,1,78,82,77,83,'//nl, 'm.csv:2: ')
      call refused('1,ko,,2,E,80,1,78,82,77,83,'//nl, 'm.csv:2: ')
      call refused(nl, 'm.csv:2: ')
      call read_members('1'//row, 'm.csv', 3, members, error)
      call check('another header', allocated(error))
      if (allocated(error)) call check('  says so', index(error%message, 'm.csv:1: ') == 1, &
         error%message)
   end subroutine test_members_table

   subroutine refused(rows, words)
      character(len=*), intent(in) :: rows, words
      type(member_t), allocatable :: members(:)
      type(error_t), allocatable :: error

      call read_members(members_header//nl//rows, 'm.csv', 3, members, error)
      call check('refused: '//rows(:len(rows) - 1), allocated(error))
      if (allocated(error)) call check('  '//words, index(error%message, words) == 1, error%message)
   end subroutine refused

   !> Goes over all keys of all groups that name a file. A new one needs a line here.
   subroutine test_every_file_key()
      type(block_t), allocatable :: blocks(:)
      integer :: found, g, k

      found = 0
      call list_keys(blocks)
      do g = 1, size(blocks)
         do k = 1, size(blocks(g)%keys)
            if (.not. blocks(g)%keys(k)%is_file) cycle
            found = found + 1
            select case (blocks(g)%name//' '//trim(blocks(g)%keys(k)%name))
            case ('excitation file')
               call check_file_key(beam//'&excitation kind=''table'', file=''x.csv'' /'//nl)
               call check_file_key(beam//'&excitation kind=''base'', file=''x.csv'' /'//nl)
            case ('along file')
               call check_file_key(beam//'&along parameter=''E'', file=''x.csv'' /'//nl)
            case ('record file')
               call check_file_key(beam//pulse//'&record file=''x.csv'' /'//nl)
            case ('ensemble cases')
               call check_file_key('&ensemble cases=''x.csv'' /'//nl)
            case default
               call check('&'//blocks(g)%name//' '//trim(blocks(g)%keys(k)%name)//' has a case', &
                  .false.)
            end select
         end do
      end do
      call check('keys that name files', found == 4)
   end subroutine test_every_file_key

   !> The fingerprint of a case is that of its file's bytes, wherever the folder is.
   subroutine check_file_key(text)
      character(len=*), intent(in) :: text
      character(len=*), parameter :: table = 'x,y'//nl//'0,70'//nl//'1,90'//nl//'4,70'//nl
      character(len=fingerprint_length) :: before
      character(len=:), allocatable :: label

      label = text(index(text, '&', back=.true.):len(text) - 1)
      call write_file('keys/case.nml', text)
      call write_file('keys/x.csv', table)
      before = fingerprint_of('keys')
      call write_file('moved/case.nml', text)
      call write_file('moved/x.csv', table)
      call check(label//' in another folder', fingerprint_of('moved') == before)
      call write_file('keys/x.csv', replaced(table, '1,90', '1,91'))
      call check(label//' with another file', fingerprint_of('keys') /= before)
   end subroutine check_file_key

   function fingerprint_of(folder) result(digits)
      character(len=*), intent(in) :: folder
      character(len=fingerprint_length) :: digits
      type(case_t) :: case
      type(error_t), allocatable :: error
      type(fingerprint_t) :: fingerprint

      call read_case(in_scratch(folder//'/case.nml'), needs_nothing, case, error)
      call check('one file', size(case%files) == 1)
      call add_case(fingerprint, case)
      digits = fingerprint%digits()
   end function fingerprint_of

   !> A file that changes between the list and the fit shows in the case that is opened for the fit.
   subroutine test_changing_file()
      type(fleet_case_t), allocatable :: fleet(:)
      type(fleet_fit_t) :: fit
      type(error_t), allocatable :: error
      character(len=fingerprint_length) :: before

      call write_file('fleet/list.txt', 'force.nml')
      call write_file('fleet/force.nml', beam//force//replaced(samples, '&record', &
         '&record file=''record.csv'',')//stage)
      call write_file('fleet/force.csv', force_table)
      call read_fleet(in_scratch('fleet/list.txt'), '1', fleet, error)
      before = fleet(1)%fingerprint
      call open_fleet_case(fleet(1), fit)
      call check('a fleet''s case without a record keeps its fingerprint', &
         fleet(1)%fingerprint == before)
      call write_file('fleet/record.csv', 't,a'//nl)
      call open_fleet_case(fleet(1), fit)
      call check('a record that appears', fleet(1)%fingerprint /= before)
      call read_fleet(in_scratch('fleet/list.txt'), '2', fleet, error)
      before = fleet(1)%fingerprint
      call read_fleet(in_scratch('fleet/list.txt'), '1', fleet, error)
      call check('another version of the program', fleet(1)%fingerprint /= before)
   end subroutine test_changing_file

   !> Ten members do not pass for two hundred.
   subroutine test_wider_range()
      outcome = beamid('ensemble case.nml --out wide --only 1:10 --quiet')
      outcome = run('f=$(ls wide/shards/members-*-1-10.csv); mv $f ${f%1-10.csv}1-200.csv')
      call repaired('wide', 'a shard with the name of a wider range', '1-200.csv: found a damaged')
      outcome = beamid('ensemble case.nml --out part --only 11:20 --quiet')
      outcome = run('f=$(ls part/shards/members-*-11-20.csv); cp $f ${f%11-20.csv}1-10.csv; '// &
         'mv $f ${f%11-20.csv}5-30.csv; "'//program_path//'" ensemble case.nml --out part '// &
         '--only 8:12 --quiet')
      call check('a part removes its own damaged shards', outcome%status == 0 .and. &
         line_count(outcome%err) == 1 .and. has_all(outcome%err, 'damaged shard, and 1 more'), &
         outcome%err)
      call repaired('part', 'parts', '')
   end subroutine test_wider_range

   !> Rows of a case with other noise do not pass under this ensemble's fingerprint.
   subroutine test_shard_of_another_ensemble()
      call write_file('other.nml', replaced(read_file('case.nml'), 'sd=0.02', 'sd=0.03'))
      outcome = beamid('ensemble other.nml --out others --only 1:10 --quiet')
      outcome = beamid('ensemble case.nml --out mixed --only 1:10 --quiet')
      outcome = run('cat others/shards/* >$(ls mixed/shards/*)')
      call repaired('mixed', 'a shard of another ensemble', '1-10.csv: found a damaged')
   end subroutine test_shard_of_another_ensemble

   !> A directory in the place of a shard is told before anything is computed, and stays.
   subroutine test_directory()
      outcome = beamid('ensemble case.nml --out taken --only 1:10 --quiet')
      outcome = run('f=$(ls taken/shards/*-1-10.csv); mkdir ${f%1-10.csv}11-26.csv')
      outcome = beamid('ensemble case.nml --out taken')
      call check('a directory with a shard''s name', outcome%status == 2 .and. outcome%out == '' &
         .and. line_count(outcome%err) == 1 .and. has_all(outcome%err, 'beamid: taken/shards/'// &
         'members-|-11-26.csv: found a directory|move it elsewhere and run'), outcome%err)
      outcome = run('rmdir taken/shards/*-11-26.csv && ls taken/shards')
      call check('no shard is lost', outcome%status == 0 .and. line_count(outcome%out) == 1, &
         outcome%out)
      call repaired('taken', 'after the directory is gone', '')
   end subroutine test_directory

   !> Empty, cut, changed and swapped shards are found in one run, which computes them again.
   subroutine test_damaged_shards()
      outcome = run('for k in 0 1 2 3 4 5 6 7; do "'//program_path//'" ensemble case.nml --out '// &
         'hurt --quiet --only $((1 + 20*k)):$((20*k + 10)) || exit 1; done')
      call check('eight parts', outcome%status == 0, outcome%err)
      outcome = run('cd hurt/shards; : >$(ls *-1-10.csv); truncate -s -1 $(ls *-21-30.csv); '// &
         'sed -i 4s/ok/OK/ $(ls *-41-50.csv); a=$(ls *-61-70.csv) b=$(ls *-81-90.csv); '// &
         'mv $a c; mv $b $a; mv c $b; truncate -s 20 $(ls *-101-110.csv)')
      call repaired('hurt', 'six damaged shards', 'found a damaged shard, and 5 more')
      outcome = beamid('ensemble case.nml --out hurt --quiet')
      call check('nothing is left to repair', outcome%status == 0 .and. outcome%err == '', &
         outcome%err)
      outcome = run('for f in hurt/shards/*; do echo x >>$f; done; "'//program_path// &
         '" ensemble case.nml --out hurt --only 1:5 --quiet; s=$?; ls hurt/shards | wc -l >&2; '// &
         'exit $s')
      call check('all damaged', outcome%status == 0 .and. has_all(outcome%err, 'found a damaged'))
      call repaired('hurt', 'all shards damaged', '')
   end subroutine test_damaged_shards

   !> One run makes the tables of the undamaged ensemble, and says in one line at most what was
   !> wrong.
   subroutine repaired(folder, label, words)
      character(len=*), intent(in) :: folder, label, words

      outcome = beamid('ensemble case.nml --quiet --out '//folder)
      call check(label//': status 0', outcome%status == 0, outcome%err)
      if (words /= '') call check(label//': one line', line_count(outcome%err) == 1 .and. &
         has_all(outcome%err, words), outcome%err)
      outcome = run('cmp right/members.csv '//folder//'/members.csv && cmp right/ensemble.csv '// &
         folder//'/ensemble.csv')
      call check(label//': the right tables', outcome%status == 0, outcome%err)
   end subroutine repaired

   !> A force three times as large is another ensemble, in the midst of it too.
   subroutine test_force_table()
      call write_file('force.csv', force_table)
      call write_file('force.nml', beam//force//samples//noise//stage//'&ensemble members=40 /')
      outcome = beamid('ensemble force.nml --out force --quiet --only 1:20')
      call check('half of an ensemble', outcome%status == 0, outcome%err)
      call write_file('force.csv', replaced(force_table, ',1', ',3'))
      outcome = run('"'//program_path//'" ensemble force.nml --out force --quiet && "'// &
         program_path//'" ensemble force.nml --out new --quiet && cmp force/members.csv '// &
         'new/members.csv')
      call check('another force table', outcome%status == 0 .and. has_all(outcome%err, &
         'force/shards: found members of another case'), outcome%err)
   end subroutine test_force_table

   !> Two beams, one of which varies along its length by a table.
   subroutine test_fleet()
      character(len=*), parameter :: table = 'x,E'//nl//'0,82'//nl//'4,78'//nl
      character(len=:), allocatable :: before

      call write_file('truth.nml', beam//pulse//samples//'&noise sd=0.01, seed=1 /')
      outcome = beamid('simulate truth.nml --out truth --quiet')
      call write_file('fleet/record.csv', read_file('truth/record.csv'))
      call write_file('fleet/plain.nml', beam//pulse//replaced(samples, '&record', &
         '&record file=''record.csv'',')//'&stage free=''m_T'', start=0.14 /')
      call write_file('fleet/along.nml', read_file('fleet/plain.nml')// &
         '&along parameter=''E'', file=''along.csv'' /')
      call write_file('fleet/along.csv', table)
      call write_file('fleet/list.txt', 'plain.nml'//nl//'along.nml')
      call write_file('fleet.nml', '&ensemble cases=''fleet/list.txt'' /')
      outcome = beamid('ensemble fleet.nml --out known --quiet')
      call check('a fleet', outcome%status == 0, outcome%err)
      call write_file('fleet/along.csv', replaced(table, '0,82', '0,81'))
      call refitted('another table of E', '1 of 2 cases are new', '')
      before = read_file('known/members.csv')
      ! What an earlier run has left is used only as it was written.
      call write_file('known/members.csv', replaced(before, nl//'2,ok', nl//'999999999,ok'))
      call refitted('a member of another number', '2 of 2 cases are new', &
         'known/members.csv: found')
      call write_file('known/members.csv', replaced(before, '1,ok,,2,m_T,1.', '1,ok,,2,m_T,2.'))
      call refitted('an estimate that has changed', '2 of 2 cases are new', &
         'known/members.csv: found')
      call write_file('known/cases.csv', replaced(read_file('known/cases.csv'), 'plain', 'along'))
      call refitted('another name of a case', '2 of 2 cases are new', 'known/cases.csv: found')
      outcome = run('rm known/manifest.txt')
      call refitted('without a manifest', '2 of 2 cases are new', 'known/manifest.txt: found no')
   end subroutine test_fleet

   !> `--only-new` ends at the estimates of a run that knows no earlier one.
   subroutine refitted(label, told, words)
      character(len=*), intent(in) :: label, told, words
      integer :: k

      outcome = beamid('ensemble fleet.nml --out known --only-new --quiet')
      call check(label//': '//told, outcome%status == 0 .and. has_all(outcome%out, told), &
         outcome%out//outcome%err)
      call check(label//': what is wrong', line_count(outcome%err) == merge(0, 1, words == '') &
         .and. has_all(outcome%err, words), outcome%err)
      outcome = beamid('ensemble fleet.nml --out fresh --quiet')
      do k = 1, 2
         call check_close(label//': m_T of '//field(read_file('known/cases.csv'), k, 3), &
            number(field(read_file('known/members.csv'), k, 6)), &
            number(field(read_file('fresh/members.csv'), k, 6)), 1e-7_wp)
      end do
   end subroutine refitted

end program test_stale_results
