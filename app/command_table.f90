!> The table of commands and options. Help, manual page, completion and the messages of the command
!> line name commands and options from this table.
module beamid_command_table
   use beamid_reproduction, only: reproducible
   use beamid_values, only: one_of
   implicit none
   private

   public :: command_names, commands_in_words, has_option, usage

   !> A command.
   type, public :: command_t
      character(len=9) :: name          !< name of the command
      character(len=22) :: arguments    !< words behind the command
      character(len=66) :: help         !< purpose, in one line
      character(len=640) :: detail      !< arguments and files that it writes
      character(len=40) :: example      !< words of an example, behind `beamid`
   end type command_t

   !> An option.
   type, public :: option_t
      character(len=10) :: name         !< option and its value
      character(len=9) :: command       !< command that takes it; blank: all that write results
      character(len=64) :: help         !< meaning, in one line
   end type option_t

   type(command_t), parameter, public :: commands(*) = [ &
      command_t('identify', 'case.nml', 'fit the free parameters of each stage to the records', &
         'Writes quality.csv, modes_seen.csv, estimates.csv, fit.csv, correlations.csv, '// &
         'autocorrelation.csv, modes.csv, shapes.csv, attachments.csv, labels.csv, case.txt '// &
         'and summary.txt; also along.csv if E or c_D varies along the beam, minima.csv with '// &
         '&multistart, windows.csv with &windows, frf.csv and modal_fit.csv with records of '// &
         'the kinds ''frf'' and ''modes''.', 'identify case.nml --out out/trial'), &
      command_t('simulate', 'case.nml', &
         'compute the response of the structure at the sample times', &
         'Writes response.csv and, with the group &noise, record.csv in the form that identify '// &
         'reads.', 'simulate case.nml'), &
      command_t('modes', 'case.nml', &
         'compute natural frequencies, damping ratios and mode shapes', &
         'Writes modes.csv, shapes.csv and attachments.csv. If the case describes a fit, also '// &
         'writes modes_fitted.csv: the modes of the fitted structure with their intervals.', &
         'modes case.nml'), &
      command_t('frf', 'case.nml', 'compute the frequency response function of the structure', &
         'Writes frf.csv at the frequencies f_first, f_first + f_step, ... f_last of &record '// &
         'kind=''frf''. If the case describes a fit, the response is that of the fitted '// &
         'structure, with the 95 % band of its magnitude.', 'frf case.nml'), &
      command_t('profile', 'case.nml', 'compute 95 % intervals from the profile of J', &
         'The intervals may be asymmetric or unbounded. Writes profiles.csv and intervals.csv. '// &
         'intervals.csv keeps the intervals of earlier runs of sample and bootstrap.', &
         'profile case.nml'), &
      command_t('sample', 'case.nml', 'draw from the posterior of the parameters', &
         'Writes posterior.csv (chain, draw, log density, parameters), posterior_motion.csv, '// &
         'posterior_modes.csv, profiles.csv and intervals.csv. The group &sample sets the '// &
         'number of draws and the method.', 'sample case.nml'), &
      command_t('bootstrap', 'case.nml', 'fit resampled records', &
         'Writes bootstrap.csv and intervals.csv. The group &bootstrap sets the number of '// &
         'records and the method.', 'bootstrap case.nml'), &
      command_t('compare', 'a.nml b.nml ...', &
         'compare models of one record by AICc, BIC and nested-model tests', &
         'Writes models.csv and nested.csv. With --damping, one case is enough: its records '// &
         'are fitted with air, Kelvin-Voigt and structural damping, time and spatial '// &
         'hysteresis and pairs of these, together with the other free parameters of the case. '// &
         'Also writes damping.csv: measured damping ratios beside those of each model. '// &
         '--damping=ratios compares damping ratios alone.', 'compare rigid.nml spring.nml'), &
      command_t('design', 'case.nml', &
         'find the experiment that determines the free parameters best', &
         'Computes, for every combination of the lists in &design, the standard errors of the '// &
         'parameters that are free in the last stage, and the criteria D (log determinant of '// &
         'the information matrix), A (sum of relative variances) and E (least eigenvalue of '// &
         'the information matrix). Uses the exact response on the last mesh. Writes '// &
         'design.csv, labels.csv and summary.txt.', 'design case.nml'), &
      command_t('track', 'case.nml', 'follow a parameter through a long record', &
         'Fits windows of the record, each from the result of the window before; the group '// &
         '&track names the parameter. Flags windows in which the parameter moves. With '// &
         'file=''-'' in &record it reads standard input line by line, and prints each row at '// &
         'once. Writes track.csv, labels.csv and summary.txt.', 'track case.nml'), &
      command_t('reproduce', 'WHAT', &
         'compute results of NASA CR-178199 and published benchmarks', &
         'WHAT is '//reproducible//'. section-4 uses a reconstructed record: it checks '// &
         'consistency and confirms nothing independently. benchmarks compares natural '// &
         'frequencies and buckling loads with published and exact values. damping compares '// &
         'damping mechanisms on simulated records, after Banks and Inman (1991). all computes '// &
         'table-4.1 (with the exact response instead of CVODE), section-4, acceleration, '// &
         'convergence, varying, benchmarks and damping, and writes each to out/<name> or '// &
         'DIR/<name>.', &
         'reproduce table-4.1'), &
      command_t('ensemble', 'case.nml', &
         'run a command on many simulated records or on a list of cases', &
         'Writes members.csv and ensemble.csv, and for a list of cases also cases.csv. An '// &
         'interrupted run continues when the command is given again. With --only, the program '// &
         'that computes the last missing members writes the tables. With --only-new, each new '// &
         'or changed case starts from its last estimate, and changed.csv lists the estimates '// &
         'that have changed.', 'ensemble case.nml --only 1:100'), &
      command_t('new', '[KIND] [DIR]', 'write a case file with comments and a small record', &
         'KIND is free-decay (default), impulse, base, struck-bar or paper. Writes case.nml '// &
         'and record.csv to DIR, by default a folder named KIND. Existing files are not '// &
         'replaced.', &
         'new free-decay trial'), &
      command_t('help', '[WORD ...]', 'explain a command, group, key or parameter', &
         'help man, help bash and help zsh print the manual page and the completion for these '// &
         'shells.', 'help record t_first'), &
      command_t('version', '', 'print the version', '', 'version')]

   type(option_t), parameter, public :: options(*) = [ &
      option_t('--out DIR', '', 'folder of the outputs; default: out/<case name>'), &
      option_t('--quiet', '', 'no progress on standard error'), &
      option_t('--time', 'identify', 'measures the time of a fit, on standard error'), &
      option_t('--only i:j', 'ensemble', 'computes only the members i to j'), &
      option_t('--only-new', 'ensemble', 'computes only cases without result or with new files'), &
      option_t('--damping', 'compare', 'compares damping mechanisms for one case'), &
      option_t('--markdown', 'help', 'prints the reference of case files in Markdown')]

contains

   !> Returns the names of all commands.
   pure function command_names() result(names)
      character(len=len(commands%name)) :: names(size(commands))

      names = commands%name
   end function command_names

   !> Returns the names of all commands as `a, b or c`.
   function commands_in_words() result(text)
      character(len=:), allocatable :: text

      text = one_of(command_names(), '')
   end function commands_in_words

   !> Returns whether a command takes an option.
   elemental logical function has_option(command, option)
      type(command_t), intent(in) :: command
      type(option_t), intent(in) :: option

      has_option = option%command == command%name
      if (option%command == '') has_option = all(command%name /= [character(len=9) :: 'help', &
         'version', 'new'])
   end function has_option

   !> Returns the command line of a command with its options.
   pure function usage(command) result(line)
      type(command_t), intent(in) :: command
      character(len=:), allocatable :: line
      integer :: k

      line = 'beamid '//trim(trim(command%name)//' '//command%arguments)
      do k = 1, size(options)
         if (has_option(command, options(k))) line = line//' ['//trim(options(k)%name)//']'
      end do
   end function usage

end module beamid_command_table
