!> What the readers of the groups do not say about a key: a valid example, the unit of a number that
!> is no parameter, and the texts that a key allows. The help, the manual page and the reference of
!> case files read this table. `test_key_examples` gives each example to the readers.
module beamid_key_examples
   implicit none
   private

   public :: key_example_t, example_row

   !> One row of the table, about one key of one group.
   type :: key_example_t
      character(len=14) :: group
      character(len=18) :: key
      !> Keys and values of a valid group that shows the key, without `&group` and `/`.
      character(len=76) :: example
      !> Unit as a dimension; blank: no unit, or that of the parameter of the same name.
      character(len=36) :: unit = ''
      !> Allowed values in words; blank: they follow from the definition of the key.
      character(len=48) :: allowed = ''
   end type key_example_t

   character(len=*), parameter :: of_record = 'unit of the record', &
      of_parameter = 'unit of the parameter', acceleration = 'acceleration', &
      column = 'text: a name, or a number in quotes', &
      label = 'text of up to 16 characters', &
      item_name = 'text of up to 12 letters, digits and _'
   !> Values of `allowed` that stand for a list of names: of the parameters that a fit may estimate,
   !> with or without the functions E(x) and c_D(x), and of those that a prior may be about.
   character(len=*), parameter, public :: names_for_fit = 'names for a fit', &
      names_without_fields = 'names without fields', names_for_prior = 'names for a prior'

   ! Keys that a valid group needs beside the key that the example shows.
   character(len=*), parameter :: beam = 'length=0.5, E=7e10, rho=0.27, I=3.3e-11', &
      section = 'length=0.5, E=7e10, width=0.05, height=0.002, density=2700', &
      pulse = 'kind=''pulse'', amplitude=1, duration=0.01', &
      force = 'kind=''table'', file=''force.csv''', &
      release = 'kind=''release'', displacement=0.02', &
      property = 'parameter=''E'', x=0,0.5, value=7e10,6e10', &
      response = 'kind=''frf'', file=''frf.csv''', &
      dip = 'kind=''dip'', place=0.2, width=0.05, depth=0.3', &
      cvode = 'method=''cvode''', &
      difference = 'formula=''displacement_difference'', delta=0.001', &
      fit = 'free=''E'',''c_D''', field = 'free=''E(x)'', coefficients=12', &
      prior = 'parameter=''length'', sd=0.001', draw = 'parameter=''E'', low=6e10, high=8e10', &
      track = 'parameter=''E'', window=0.5, hop=0.1'

   type(key_example_t), parameter :: structure_examples(*) = [ &
      key_example_t('beam', 'E', beam), &
      key_example_t('beam', 'c_D', beam//', c_D=2e6'), &
      key_example_t('beam', 'rho', beam), &
      key_example_t('beam', 'gamma', beam//', gamma=0.05'), &
      key_example_t('beam', 'eta', beam//', eta=0.01'), &
      key_example_t('beam', 'a_h', beam//', a_h=0.05, b_h=0.05'), &
      key_example_t('beam', 'b_h', beam//', a_h=0.05, b_h=0.05'), &
      key_example_t('beam', 'd_1', beam//', d_1=0.05, b_1=60'), &
      key_example_t('beam', 'b_1', beam//', d_1=0.05, b_1=60'), &
      key_example_t('beam', 'd_2', beam//', d_2=0.05, b_2=600'), &
      key_example_t('beam', 'b_2', beam//', d_2=0.05, b_2=600'), &
      key_example_t('beam', 'k_R', beam//', k_R=50'), &
      key_example_t('beam', 'c_R', beam//', k_R=50, c_R=0.01'), &
      key_example_t('beam', 'length', beam), &
      key_example_t('beam', 'I', beam), &
      key_example_t('beam', 'width', section, 'length'), &
      key_example_t('beam', 'height', section, 'length'), &
      key_example_t('beam', 'density', section, 'mass/length^3'), &
      key_example_t('end', 'at', 'at=''tip'', kind=''pinned'''), &
      key_example_t('end', 'kind', 'at=''tip'', kind=''guided'''), &
      key_example_t('end', 'k_w', 'at=''tip'', k_w=200'), &
      key_example_t('end', 'c_w', 'at=''tip'', k_w=200, c_w=0.1'), &
      key_example_t('end', 'k_R', 'at=''root'', k_R=50'), &
      key_example_t('end', 'c_R', 'at=''root'', k_R=50, c_R=0.01'), &
      key_example_t('tip', 'm_T', 'm_T=0.01'), &
      key_example_t('tip', 'J_T', 'm_T=0.01, J_T=2e-6'), &
      key_example_t('hose', 'm_H', 'm_H=0.004'), &
      key_example_t('hose', 'c_H', 'm_H=0.004, c_H=0.01, k_H=5'), &
      key_example_t('hose', 'k_H', 'm_H=0.004, k_H=5'), &
      key_example_t('hose', 'x_H', 'm_H=0.004, k_H=5, x_H=0.3'), &
      key_example_t('hose', 'name', 'name=''absorber'', m_H=0.004, k_H=5', allowed=item_name), &
      key_example_t('mass', 'name', 'name=''clip'', m=0.002, x=0.2', allowed=item_name), &
      key_example_t('mass', 'm', 'm=0.002, x=0.2'), &
      key_example_t('mass', 'J', 'm=0.002, J=1e-7, x=0.2'), &
      key_example_t('mass', 'x', 'm=0.002, x=0.2'), &
      key_example_t('sensor', 'name', 'name=''tip'', m_S=0.004', allowed=item_name), &
      key_example_t('sensor', 'm_S', 'm_S=0.004, x_S=0.44'), &
      key_example_t('sensor', 'J_S', 'm_S=0.004, J_S=1e-7'), &
      key_example_t('sensor', 'x_S', 'x_S=0.44'), &
      key_example_t('support', 'name', 'name=''middle'', x_P=0.3', allowed=item_name), &
      key_example_t('support', 'x_P', 'x_P=0.3'), &
      key_example_t('support', 'k_P', 'x_P=0.3, k_P=200'), &
      key_example_t('support', 'c_P', 'x_P=0.3, k_P=200, c_P=0.1'), &
      key_example_t('support', 'k_R', 'x_P=0.3, k_R=50'), &
      key_example_t('support', 'c_R', 'x_P=0.3, k_R=50, c_R=0.01'), &
      key_example_t('gravity', 'g', 'g=9.81'), &
      key_example_t('gravity', 'direction', 'g=9.81, direction=''standing'''), &
      key_example_t('axial', 'force', 'force=-0.2'), &
      key_example_t('along', 'parameter', property), &
      key_example_t('along', 'kind', property//', kind=''spline'''), &
      key_example_t('along', 'x', property, 'length'), &
      key_example_t('along', 'value', property, 'unit of the property'), &
      key_example_t('along', 'file', 'parameter=''E'', file=''modulus.csv'''), &
      key_example_t('along', 'place', dip), &
      key_example_t('along', 'width', dip), &
      key_example_t('along', 'depth', dip)]

   type(key_example_t), parameter :: excitation_examples(*) = [ &
      key_example_t('excitation', 'kind', pulse), &
      key_example_t('excitation', 'amplitude', pulse, 'force'), &
      key_example_t('excitation', 'duration', pulse, 'time'), &
      key_example_t('excitation', 'file', force), &
      key_example_t('excitation', 'time_column', force//', time_column=''t''', allowed=column), &
      key_example_t('excitation', 'value_column', force//', value_column=''force''', &
         allowed=column), &
      key_example_t('excitation', 'rate', &
         'kind=''table'', file=''force.csv'', rate=1000, value_column=''2''', '1/time'), &
      key_example_t('excitation', 'load', pulse//', load=''distributed'''), &
      key_example_t('excitation', 'power', pulse//', load=''distributed'', power=3'), &
      key_example_t('excitation', 'force', 'kind=''release'', force=0.5', 'force'), &
      key_example_t('excitation', 'displacement', release, 'length'), &
      key_example_t('excitation', 'time', release//', time=0.1', 'time'), &
      key_example_t('excitation', 'modes', 'kind=''free'', modes=3'), &
      key_example_t('excitation', 'x_F', pulse//', x_F=0.2')]

   type(key_example_t), parameter :: method_examples(*) = [ &
      key_example_t('discretization', 'degree', 'degree=5'), &
      key_example_t('discretization', 'elements', 'elements=8,16'), &
      key_example_t('discretization', 'gauss_points', 'gauss_points=4'), &
      key_example_t('discretization', 'panels', 'panels=2'), &
      key_example_t('discretization', 'knots', 'knots=''attachments'''), &
      key_example_t('integrator', 'method', cvode), &
      key_example_t('integrator', 'rtol', cvode//', rtol=1e-9'), &
      key_example_t('integrator', 'atol', cvode//', atol=1e-12', 'length'), &
      key_example_t('integrator', 'max_order', cvode//', max_order=4'), &
      key_example_t('integrator', 'max_steps', cvode//', max_steps=200000'), &
      key_example_t('observation', 'formula', difference), &
      key_example_t('observation', 'delta', difference, 'time'), &
      key_example_t('observation', 'frame', 'frame=''absolute''')]

   type(key_example_t), parameter :: record_examples(*) = [ &
      key_example_t('record', 'file', 'file=''record.csv'''), &
      key_example_t('record', 't_first', 't_first=0.2', 'time'), &
      key_example_t('record', 't_last', 't_last=4.2', 'time'), &
      key_example_t('record', 't_step', 't_step=0.01', 'time'), &
      key_example_t('record', 'scale', 'scale=9.81', &
         unit='acceleration per unit of the record', &
         allowed='any number except 0'), &
      key_example_t('record', 'offset', 'offset=0.02', of_record), &
      key_example_t('record', 'time_column', 'time_column=''t''', allowed=column), &
      key_example_t('record', 'value_column', 'value_column=''acceleration''', allowed=column), &
      key_example_t('record', 'rate', 'rate=1000, value_column=''2''', '1/time'), &
      key_example_t('record', 'clip_low', 'clip_low=-5', of_record), &
      key_example_t('record', 'clip_high', 'clip_high=5', of_record), &
      key_example_t('record', 'thin', 'thin=4'), &
      key_example_t('record', 'sd', 'sd=0.05', acceleration), &
      key_example_t('record', 'length', 'length=0.45', 'length'), &
      key_example_t('record', 'x_S', 'x_S=0.44', 'length'), &
      key_example_t('record', 'x_P', 'x_P=0.3', 'length'), &
      key_example_t('record', 'sensor', 'sensor=''tip''', allowed='name of a &sensor'), &
      key_example_t('record', 'experiment', 'sensor=''tip'', experiment=1'), &
      key_example_t('record', 'kind', 'kind=''frf'', file=''frf.csv'', averages=5'), &
      key_example_t('record', 'quantity', response//', quantity=''mobility'''), &
      key_example_t('record', 'f_first', response//', f_first=5', '1/time'), &
      key_example_t('record', 'f_last', response//', f_last=400', '1/time'), &
      key_example_t('record', 'f_step', &
         'kind=''frf'', f_first=1, f_last=400, f_step=0.5', '1/time'), &
      key_example_t('record', 'coherence_least', response//', coherence_least=0.5'), &
      key_example_t('record', 'averages', response//', averages=5'), &
      key_example_t('record', 'exponential_window', response//', exponential_window=2', '1/time'), &
      key_example_t('record', 'window', response//', window=''hann'''), &
      key_example_t('record', 'x_F', response//', x_F=0.3', 'length'), &
      key_example_t('score', 't_first', 't_first=1', 'time'), &
      key_example_t('score', 't_last', 't_last=2', 'time'), &
      key_example_t('score', 't_step', 't_step=0.01', 'time')]

   type(key_example_t), parameter :: fit_examples(*) = [ &
      key_example_t('stage', 'free', fit, allowed=names_for_fit), &
      key_example_t('stage', 'shared', fit//', shared=''E''', allowed='names in free'), &
      key_example_t('stage', 'start', fit//', start=7e10,2e6', of_parameter), &
      key_example_t('stage', 'lower', fit//', lower=5e10,0', of_parameter), &
      key_example_t('stage', 'upper', fit//', upper=9e10,1e7', of_parameter), &
      key_example_t('stage', 'coefficients', field), &
      key_example_t('stage', 'kind', field//', kind=''linear'''), &
      key_example_t('prior', 'parameter', prior, allowed=names_for_prior), &
      key_example_t('prior', 'sd', prior, of_parameter), &
      key_example_t('prior', 'value', 'parameter=''E'', value=7e10, sd=1e9', of_parameter), &
      key_example_t('prior', 'record', prior//', record=1'), &
      key_example_t('multistart', 'n', 'n=50'), &
      key_example_t('multistart', 'seed', 'n=50, seed=7'), &
      key_example_t('multistart', 'spread', 'n=50, spread=5'), &
      key_example_t('windows', 'n', 'n=5'), &
      key_example_t('track', 'parameter', track, allowed=names_without_fields), &
      key_example_t('track', 'window', track, 'time'), &
      key_example_t('track', 'hop', track, 'time'), &
      key_example_t('track', 'rate', track//', rate=1e9', 'unit of the parameter/sqrt(time)'), &
      key_example_t('track', 'frequency_error', track//', frequency_error=0.005'), &
      key_example_t('sample', 'draws', 'draws=20000'), &
      key_example_t('sample', 'seed', 'draws=20000, seed=7'), &
      key_example_t('sample', 'method', 'method=''chains'''), &
      key_example_t('sample', 'noise', 'noise=''white'''), &
      key_example_t('bootstrap', 'n', 'n=2000'), &
      key_example_t('bootstrap', 'seed', 'n=2000, seed=7'), &
      key_example_t('bootstrap', 'kind', 'kind=''blocks'''), &
      key_example_t('bootstrap', 'block', 'kind=''blocks'', block=40')]

   type(key_example_t), parameter :: plan_examples(*) = [ &
      key_example_t('noise', 'sd', 'sd=0.05', acceleration), &
      key_example_t('noise', 'seed', 'sd=0.05, seed=7'), &
      key_example_t('design', 'x_S', 'x_S=0.3,0.4,0.5', 'length'), &
      key_example_t('design', 'x_F', 'x_F=''auto''', 'length'), &
      key_example_t('design', 'duration', 'duration=0.005,0.01', 'time'), &
      key_example_t('design', 't_first', 't_first=0,0.1', 'time'), &
      key_example_t('design', 't_last', 't_last=1,2,4', 'time'), &
      key_example_t('design', 't_step', 't_step=0.001,0.002', 'time'), &
      key_example_t('design', 'sensors', 'x_S=0.3,0.4,0.5, sensors=2'), &
      key_example_t('design', 'modes', 'modes=2'), &
      key_example_t('design', 'noise_sd', 'noise_sd=0.05', acceleration), &
      key_example_t('design', 'f_first', 'f_first=5,10', '1/time'), &
      key_example_t('design', 'f_last', 'f_last=200,400', '1/time'), &
      key_example_t('design', 'f_step', 'f_step=0.5,1', '1/time'), &
      key_example_t('design', 'parameters', 'parameters=''E'',''c_D''', &
         allowed=names_without_fields), &
      key_example_t('design', 'target', 'target=0.01'), &
      key_example_t('ensemble', 'command', 'command=''profile'', members=200'), &
      key_example_t('ensemble', 'members', 'members=200'), &
      key_example_t('ensemble', 'seed', 'members=200, seed=7'), &
      key_example_t('ensemble', 'elements', 'members=200, elements=32'), &
      key_example_t('ensemble', 'cases', 'cases=''cases.txt'''), &
      key_example_t('draw', 'parameter', draw, allowed=names_without_fields), &
      key_example_t('draw', 'low', draw, of_parameter), &
      key_example_t('draw', 'high', draw, of_parameter), &
      key_example_t('units', 'length', 'length=''m''', allowed=label), &
      key_example_t('units', 'force', 'force=''N''', allowed=label), &
      key_example_t('units', 'time', 'time=''s''', allowed=label), &
      key_example_t('units', 'mass', 'mass=''kg''', allowed=label)]

   !> The table.
   type(key_example_t), parameter, public :: key_examples(*) = [structure_examples, &
      excitation_examples, method_examples, record_examples, fit_examples, plan_examples]

contains

   !> Returns the number of the row about a key of a group; 0: there is none.
   pure integer function example_row(group, key) result(row)
      character(len=*), intent(in) :: group, key

      do row = size(key_examples), 1, -1
         if (key_examples(row)%group == group .and. key_examples(row)%key == key) return
      end do
   end function example_row

end module beamid_key_examples
