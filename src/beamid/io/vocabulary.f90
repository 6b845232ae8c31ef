!> What a case file may hold: the table of groups and keys.
module beamid_vocabulary
   use beamid_namelist, only: group, group_t, integer_key, real_key, string_key
   use beamid_parameters, only: free_names
   implicit none
   private

   public :: case_vocabulary, max_list

   !> The longest list of numbers of elements.
   integer, parameter :: max_list = 50

contains

   !> Groups and keys of a case file.
   function case_vocabulary() result(groups)
      type(group_t), allocatable :: groups(:)

      allocate (groups(0))
      call declare(groups, group('beam', [real_key('length'), real_key('rho'), real_key('E'), &
         real_key('I'), real_key('width'), real_key('height'), real_key('c_D'), &
         real_key('gamma'), real_key('k_R')], required=.true.))
      call declare(groups, group('tip', [real_key('m_T'), real_key('J_T')]))
      call declare(groups, group('sensor', [real_key('m_S'), real_key('x_S')]))
      call declare(groups, group('hose', [real_key('m_H'), real_key('c_H'), real_key('k_H')]))
      call declare(groups, group('excitation', [string_key('kind'), real_key('amplitude'), &
         real_key('duration'), string_key('file'), string_key('load'), real_key('power'), &
         real_key('force'), real_key('displacement'), real_key('time'), integer_key('modes')], &
         may_repeat=.true.))
      call declare(groups, group('discretization', [integer_key('degree'), &
         integer_key('elements', max_list), integer_key('gauss_points'), integer_key('panels')]))
      call declare(groups, group('integrator', [string_key('method'), real_key('rtol'), &
         real_key('atol'), integer_key('max_order'), integer_key('max_steps')]))
      call declare(groups, group('observation', [string_key('formula'), real_key('delta')]))
      call declare(groups, group('record', [string_key('file'), real_key('t_first'), &
         real_key('t_last'), real_key('t_step'), real_key('scale'), real_key('offset'), &
         string_key('time_column'), string_key('value_column'), real_key('clip_low'), &
         real_key('clip_high'), integer_key('thin'), real_key('length'), real_key('x_S')], &
         may_repeat=.true.))
      call declare(groups, group('score', [real_key('t_first'), real_key('t_last'), &
         real_key('t_step')]))
      call declare(groups, group('stage', [string_key('free', size(free_names)), &
         string_key('shared', size(free_names)), real_key('start', size(free_names), &
         text_key='start_from'), string_key('start_from'), real_key('lower', size(free_names)), &
         real_key('upper', size(free_names))], may_repeat=.true.))
      call declare(groups, group('multistart', [integer_key('n'), integer_key('seed'), &
         real_key('spread')]))
      call declare(groups, group('noise', [real_key('sd'), integer_key('seed')]))
      call declare(groups, group('units', [string_key('length'), string_key('force'), &
         string_key('time'), string_key('mass')]))
   end function case_vocabulary

   !> Adds a group. In an array constructor gfortran 12 would never free the keys of one that a
   !> function returns.
   subroutine declare(groups, more)
      type(group_t), allocatable, intent(inout) :: groups(:)
      type(group_t), intent(in) :: more

      groups = [groups, more]
   end subroutine declare

end module beamid_vocabulary
