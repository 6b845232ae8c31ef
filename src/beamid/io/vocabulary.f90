!> What a case file may hold: the table of groups and keys.
module beamid_vocabulary
   use beamid_namelist, only: group, group_t, integer_key, key_t, real_key, string_key
   use beamid_parameters, only: free_names, parameters
   use beamid_structure, only: n_parameters
   implicit none
   private

   public :: case_vocabulary, max_list

   !> The longest list of numbers of elements.
   integer, parameter :: max_list = 50

contains

   !> Groups and keys of a case file.
   function case_vocabulary() result(groups)
      type(group_t), allocatable :: groups(:)

      groups = [ &
         group('beam', [parameter_keys('beam'), real_key('width'), real_key('height')], &
               required=.true.), &
         group('tip', parameter_keys('tip')), &
         group('sensor', parameter_keys('sensor')), &
         group('hose', parameter_keys('hose')), &
         group('excitation', [string_key('kind'), real_key('amplitude'), real_key('duration'), &
                              string_key('file'), string_key('load'), real_key('power'), &
                              real_key('force'), real_key('displacement'), real_key('time'), &
                              integer_key('modes')], may_repeat=.true.), &
         group('discretization', [integer_key('degree'), integer_key('elements', max_list), &
                                  integer_key('gauss_points'), integer_key('panels')]), &
         group('integrator', [string_key('method'), real_key('rtol'), real_key('atol'), &
                              integer_key('max_order'), integer_key('max_steps')]), &
         group('observation', [string_key('formula'), real_key('delta')]), &
         group('record', [string_key('file'), real_key('t_first'), real_key('t_last'), &
                          real_key('t_step'), real_key('scale'), real_key('offset'), &
                          string_key('time_column'), string_key('value_column'), &
                          real_key('clip_low'), real_key('clip_high'), integer_key('thin'), &
                          real_key('length'), real_key('x_S')], may_repeat=.true.), &
         group('score', [real_key('t_first'), real_key('t_last'), real_key('t_step')]), &
         group('stage', [string_key('free', size(free_names)), &
                         string_key('shared', size(free_names)), &
                         real_key('start', size(free_names), text_key='start_from'), &
                         string_key('start_from'), real_key('lower', size(free_names)), &
                         real_key('upper', size(free_names))], may_repeat=.true.), &
         group('multistart', [integer_key('n'), integer_key('seed'), real_key('spread')]), &
         group('noise', [real_key('sd'), integer_key('seed')]), &
         group('units', [string_key('length'), string_key('force'), string_key('time'), &
                         string_key('mass')])]
   end function case_vocabulary

   !> The keys of a group that the table of parameters knows.
   function parameter_keys(name) result(keys)
      character(len=*), intent(in) :: name
      type(key_t), allocatable :: keys(:)
      integer :: k

      allocate (keys(0))
      do k = 1, n_parameters
         if (parameters(k)%group == name) keys = [keys, real_key(trim(parameters(k)%name))]
      end do
   end function parameter_keys

end module beamid_vocabulary
