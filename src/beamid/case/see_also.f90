!> Cross references of the help: related commands, groups, keys and parameters for each command and
!> group, and for keys whose relatives are in other groups or hard to find.
module beamid_see_also
   implicit none
   private

   public :: related_t, related_words, see_also

   !> Kinds of topics with a row of their own, beside the keys of a group.
   character(len=*), parameter, public :: a_command = 'command', a_group = 'group', &
      a_parameter = 'parameter', an_everyday_word = 'everyday word'

   !> One row: a topic and the words that `beamid help` understands.
   type :: related_t
      !> `a_command`, `a_group`, `an_everyday_word`, or the name of the group of a key; blank: a key
      !> of any group.
      character(len=14) :: of
      character(len=18) :: topic
      character(len=56) :: words
   end type related_t

   type(related_t), parameter :: command_rows(*) = [ &
      related_t(a_command, 'identify', 'stage record prior windows multistart profile'), &
      related_t(a_command, 'simulate', 'excitation noise record observation'), &
      related_t(a_command, 'modes', 'beam support discretization'), &
      related_t(a_command, 'frf', 'record excitation sensor modes'), &
      related_t(a_command, 'profile', 'identify sample bootstrap stage'), &
      related_t(a_command, 'sample', 'identify profile bootstrap prior'), &
      related_t(a_command, 'bootstrap', 'identify profile sample'), &
      related_t(a_command, 'compare', 'identify stage'), &
      related_t(a_command, 'track', 'identify stage windows'), &
      related_t(a_command, 'design', 'identify stage noise'), &
      related_t(a_command, 'reproduce', 'identify'), &
      related_t(a_command, 'ensemble', 'identify draw noise'), &
      related_t(a_command, 'new', 'identify record stage'), &
      related_t(a_command, 'help', 'identify beam E'), &
      related_t(a_command, 'version', 'help')]

   type(related_t), parameter :: group_rows(*) = [ &
      related_t(a_group, 'beam', 'end tip sensor support along units'), &
      related_t(a_group, 'end', 'beam support k_R'), &
      related_t(a_group, 'tip', 'beam mass hose sensor'), &
      related_t(a_group, 'hose', 'tip mass'), &
      related_t(a_group, 'mass', 'tip sensor hose'), &
      related_t(a_group, 'sensor', 'record observation'), &
      related_t(a_group, 'support', 'beam k_R'), &
      related_t(a_group, 'gravity', 'axial'), &
      related_t(a_group, 'axial', 'gravity'), &
      related_t(a_group, 'along', 'beam coefficients'), &
      related_t(a_group, 'excitation', 'record x_F amplitude'), &
      related_t(a_group, 'discretization', 'integrator'), &
      related_t(a_group, 'integrator', 'discretization observation'), &
      related_t(a_group, 'observation', 'integrator sensor record'), &
      related_t(a_group, 'record', 'sensor excitation observation score frf'), &
      related_t(a_group, 'score', 'record windows'), &
      related_t(a_group, 'stage', 'prior multistart windows identify'), &
      related_t(a_group, 'prior', 'stage sample identify'), &
      related_t(a_group, 'multistart', 'stage start'), &
      related_t(a_group, 'windows', 'stage score identify'), &
      related_t(a_group, 'track', 'stage record windows'), &
      related_t(a_group, 'sample', 'profile bootstrap prior'), &
      related_t(a_group, 'bootstrap', 'profile sample'), &
      related_t(a_group, 'noise', 'simulate ensemble'), &
      related_t(a_group, 'design', 'stage noise'), &
      related_t(a_group, 'ensemble', 'draw noise'), &
      related_t(a_group, 'draw', 'ensemble'), &
      related_t(a_group, 'units', 'beam')]

   type(related_t), parameter :: key_rows(*) = [ &
      related_t('beam', 'rho', 'density width height'), &
      related_t('beam', 'I', 'width height'), &
      related_t('beam', 'width', 'height density I'), &
      related_t('beam', 'height', 'width density I'), &
      related_t('beam', 'density', 'rho width height'), &
      related_t('beam', 'E', 'coefficients along'), &
      related_t('beam', 'c_D', 'gamma coefficients along'), &
      related_t('beam', 'gamma', 'c_D'), &
      related_t('beam', 'eta', 'c_D kind'), &
      related_t('beam', 'a_h', 'b_h c_D'), &
      related_t('beam', 'b_h', 'a_h'), &
      related_t('beam', 'd_1', 'b_1 c_D eta'), &
      related_t('beam', 'b_1', 'd_1'), &
      related_t('beam', 'd_2', 'b_2 d_1'), &
      related_t('beam', 'b_2', 'd_2 b_1'), &
      related_t('beam', 'k_R', 'c_R end support'), &
      related_t('beam', 'c_R', 'k_R end'), &
      related_t('end', 'k_w', 'c_w kind'), &
      related_t('end', 'c_w', 'k_w'), &
      related_t('end', 'k_R', 'c_R kind'), &
      related_t('end', 'c_R', 'k_R'), &
      related_t('sensor', 'name', 'record'), &
      related_t('hose', 'name', 'x_H'), &
      related_t('mass', 'name', 'x'), &
      related_t('support', 'name', 'x_P'), &
      related_t('support', 'k_P', 'c_P k_R'), &
      related_t('support', 'c_P', 'k_P'), &
      related_t('axial', 'force', 'T gravity'), &
      related_t('along', 'kind', 'place width depth'), &
      related_t('along', 'place', 'width depth'), &
      related_t('along', 'width', 'place depth'), &
      related_t('along', 'depth', 'place width'), &
      related_t('excitation', 'kind', 'file displacement modes'), &
      related_t('excitation', 'load', 'power x_F'), &
      related_t('excitation', 'power', 'load'), &
      related_t('excitation', 'x_F', 'load design'), &
      related_t('excitation', 'modes', 'start'), &
      related_t('excitation', 'displacement', 'force x_F'), &
      related_t('excitation', 'force', 'displacement x_F'), &
      related_t('record', 'scale', 'offset units'), &
      related_t('record', 'offset', 'scale'), &
      related_t('record', 'thin', 't_step'), &
      related_t('record', 'sd', 'noise'), &
      related_t('record', 'sensor', 'experiment'), &
      related_t('record', 'experiment', 'sensor'), &
      related_t('record', 'file', 'time_column value_column rate'), &
      related_t('record', 'kind', 'frf quantity averages f_first'), &
      related_t('record', 'quantity', 'kind x_F frf'), &
      related_t('record', 'averages', 'coherence_least sd window'), &
      related_t('record', 'coherence_least', 'averages f_first f_last'), &
      related_t('record', 'exponential_window', 'window'), &
      related_t('record', 'window', 'averages exponential_window'), &
      related_t('record', 'x_F', 'sensor x_S quantity'), &
      related_t('', 'f_first', 'f_last f_step'), &
      related_t('', 'f_last', 'f_first f_step'), &
      related_t('', 'f_step', 'f_first f_last frf'), &
      related_t('', 't_first', 't_last t_step'), &
      related_t('', 't_last', 't_first t_step'), &
      related_t('', 't_step', 't_first t_last'), &
      related_t('', 'time_column', 'value_column rate'), &
      related_t('', 'value_column', 'time_column scale'), &
      related_t('', 'rate', 'time_column'), &
      related_t('', 'clip_low', 'clip_high'), &
      related_t('', 'clip_high', 'clip_low'), &
      related_t('', 'elements', 'degree integrator'), &
      related_t('', 'rtol', 'atol method'), &
      related_t('', 'atol', 'rtol method'), &
      related_t('', 'formula', 'delta'), &
      related_t('', 'delta', 'formula'), &
      related_t('', 'frame', 'excitation'), &
      related_t('', 'free', 'shared start lower upper prior'), &
      related_t('', 'shared', 'free record'), &
      related_t('', 'start', 'free multistart'), &
      related_t('', 'lower', 'upper free'), &
      related_t('', 'upper', 'lower free'), &
      related_t('', 'coefficients', 'along'), &
      related_t('', 'spread', 'start'), &
      related_t('', 'sensors', 'x_S'), &
      related_t('', 'noise_sd', 'noise'), &
      related_t('', 'cases', 'ensemble')]

   !> Words that name no topic, but that users look up.
   type(related_t), parameter :: everyday_rows(*) = [ &
      related_t(an_everyday_word, 'clamp', 'k_R end support'), &
      related_t(an_everyday_word, 'boundary', 'end k_R support'), &
      related_t(an_everyday_word, 'spring', 'k_P k_R end'), &
      related_t(an_everyday_word, 'thickness', 'height'), &
      related_t(an_everyday_word, 'young', 'E'), &
      related_t(an_everyday_word, 'youngs', 'E'), &
      related_t(an_everyday_word, 'modulus', 'E'), &
      related_t(an_everyday_word, 'stiffness', 'E k_R k_P'), &
      related_t(an_everyday_word, 'damping', 'c_D gamma eta d_1 a_h'), &
      related_t(an_everyday_word, 'air', 'gamma'), &
      related_t(an_everyday_word, 'accelerometer', 'sensor m_S x_S'), &
      related_t(an_everyday_word, 'absorber', 'hose'), &
      related_t(an_everyday_word, 'crack', 'along'), &
      related_t(an_everyday_word, 'damage', 'along'), &
      related_t(an_everyday_word, 'mesh', 'elements degree'), &
      related_t(an_everyday_word, 'hammer', 'excitation frf'), &
      related_t(an_everyday_word, 'impact', 'excitation frf'), &
      related_t(an_everyday_word, 'shaker', 'excitation frf'), &
      related_t(an_everyday_word, 'tolerance', 'sd prior'), &
      related_t(an_everyday_word, 'uncertainty', 'prior sd profile'), &
      related_t(an_everyday_word, 'interval', 'profile sample bootstrap prior'), &
      related_t(an_everyday_word, 'frequency', 'modes frf'), &
      related_t(an_everyday_word, 'unit', 'units scale')]

   !> The table.
   type(related_t), parameter :: see_also(*) = [command_rows, group_rows, key_rows, everyday_rows]

contains

   !> Returns the words related to a topic, separated by blanks; '' if there are none. The group of
   !> a key, and `free` for a parameter, are among the words.
   !>
   !> of     `a_command`, `a_group`, `a_parameter`, `an_everyday_word`, or the name of the group of
   !>        a key
   !> topic  name of the command, group, key or parameter
   pure function related_words(of, topic) result(words)
      character(len=*), intent(in) :: of, topic
      character(len=:), allocatable :: words
      logical :: is_key
      integer :: k

      is_key = all(of /= [character(len=13) :: a_command, a_group, a_parameter, &
         an_everyday_word])
      words = ''
      do k = 1, size(see_also)
         if (see_also(k)%topic /= topic) cycle
         if (see_also(k)%of == of .or. see_also(k)%of == '' .and. is_key) words = words//' '// &
            trim(see_also(k)%words)
      end do
      if (of == a_parameter) words = ' free prior'
      if (is_key .and. index(words//' ', ' '//of//' ') == 0) words = words//' '//of
      words = words(2:)
   end function related_words

end module beamid_see_also
