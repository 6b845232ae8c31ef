!> The parts of the summary about errors other than noise: errors of the mesh and of parameters held
!> fixed.
module beamid_error_sources
   use beamid_distributions, only: normal_quantile
   use beamid_held_errors, only: held_t
   use beamid_identification, only: stage_fit_t
   use beamid_kinds, only: wp
   use beamid_lines, only: columns, filled
   use beamid_parameters, only: as_named, free_index, parameters
   use beamid_priors, only: priors_of
   use beamid_statistics, only: unlimited
   use beamid_strings, only: rounded, to_text
   use beamid_structure, only: function_of, is_coefficient, of_E, structure_t
   use beamid_texts, only: left, right, text_t
   use beamid_units, only: units_t
   use beamid_values, only: listed
   use beamid_verdicts, only: ratio_to_case
   implicit none
   private

   public :: add_assumptions, add_error_sources, add_left_out, add_mesh_warning, &
      add_prior_conflicts, add_far_values

   !> Distance from its prior beyond which an estimate is reported [standard deviations].
   real(wp), parameter :: far_from_prior = 3

contains

   !> Adds a table of the intervals that include every source of error, and a line for each fixed
   !> parameter whose error is known.
   subroutine add_error_sources(text, units, fit)
      type(text_t), intent(inout) :: text
      type(units_t), intent(in) :: units
      type(stage_fit_t), intent(in) :: fit
      character(len=:), allocatable :: line
      real(wp) :: from_fixed(3)
      integer :: k

      if (fit%statistics%samples == 0) return
      if (allocated(fit%mesh_shift) .or. allocated(fit%held)) then
         call text%line('total intervals, with every source of error that the case states:')
         call text%line('              mesh shift     from held    total lower    total upper')
         do k = 1, size(fit%free)
            if (is_coefficient(fit%free(k))) cycle
            associate (q => fit%quantities(k))
               line = left(trim(q%name), 10)
               if (allocated(fit%mesh_shift)) then
                  line = line//number_or_dash(q%moved(fit%mesh_shift(k)))
               else
                  line = line//right('unknown')
               end if
               if (fit%half_width(k) < unlimited) then
                  from_fixed = q%limits(fit%from_held(k), 0.0_wp)
                  call text%line(line//number_or_dash(from_fixed(1))// &
                     columns(q%ends(fit%total(k)), 15))
               else
                  call text%line(line//right('unlimited'))
               end if
            end associate
         end do
      end if
      if (.not. allocated(fit%held)) return
      do k = 1, size(fit%held)
         if (.not. fit%held(k)%is_assumed) call text%line(effect_line(fit, k, units))
      end do
   end subroutine add_error_sources

   !> Adds a line for each parameter that the program keeps fixed although the user asked for it.
   subroutine add_assumptions(text, units, fit)
      type(text_t), intent(inout) :: text
      type(units_t), intent(in) :: units
      type(stage_fit_t), intent(in) :: fit
      integer :: k

      if (.not. allocated(fit%held)) return
      do k = 1, size(fit%held)
         if (fit%held(k)%is_assumed) call text%line(effect_line(fit, k, units))
      end do
   end subroutine add_assumptions

   !> Adds a line for each estimate that lies far from its prior.
   subroutine add_prior_conflicts(text, fit)
      type(text_t), intent(inout) :: text
      type(stage_fit_t), intent(in) :: fit
      integer :: which(size(fit%free)), k
      real(wp) :: centre, distance

      if (.not. allocated(fit%priors)) return
      ! A loop, because gfortran would pass `quantities%record` as an array temporary.
      which = priors_of(fit%priors, fit%free, [(fit%quantities(k)%record, k=1, size(which))])
      do k = 1, size(which)
         if (which(k) == 0) cycle
         associate (prior => fit%priors(which(k)), q => fit%quantities(k))
            centre = prior%centre_in(q%record)
            distance = abs(q%searched - centre)/prior%width(centre)
            if (.not. distance > far_from_prior) cycle
            call text%line(trim(q%name)//' = '//to_text(q%value)//' lies '// &
               to_text(nint(distance))//' prior standard deviations from the value of its '// &
               'prior, '//to_text(as_named(q%parameter, centre))//' (sd = '// &
               to_text(prior%sd)//'): check this prior; if it is right, the model is wrong')
         end associate
      end do
   end subroutine add_prior_conflicts

   !> Adds a line for each estimate of E or of a mass that is far from the value of the case, which
   !> may come from a wrong density or dimension.
   !>
   !> given  structure with the values of the case
   subroutine add_far_values(text, given, fit)
      type(text_t), intent(inout) :: text
      type(structure_t), intent(in) :: given
      type(stage_fit_t), intent(in) :: fit
      !> Factors that ordinary uncertainty explains.
      real(wp), parameter :: usual_mass = 2.5_wp, usual_modulus = 1.4_wp
      real(wp) :: ratio
      integer :: k

      do k = 1, size(fit%free)
         ratio = ratio_to_case(given, fit, k)
         if (abs(log(ratio)) <= log(merge(usual_modulus, usual_mass, fit%free(k) == of_E))) cycle
         call text%line(trim(fit%quantities(k)%name)//' is '//rounded(ratio, 2)// &
            ' times the value of the case, '//to_text(given%get(fit%free(k)))// &
            ': check that value, the density and the dimensions of the beam')
      end do
   end subroutine add_far_values

   !> Returns a number in its column; '-' if it is not finite.
   function number_or_dash(value) result(text)
      real(wp), intent(in) :: value
      character(len=:), allocatable :: text

      text = right('-')
      if (abs(value) < unlimited) text = columns([value], 14)
   end function number_or_dash

   !> Returns a line that says how much an error of one standard deviation in the fixed parameter j
   !> moves each estimate; for a parameter with an assumed range, how much the ends of the range do.
   !> Of the coefficients of a field only the one that moves most is named.
   function effect_line(fit, j, units) result(line)
      type(stage_fit_t), intent(in) :: fit
      integer, intent(in) :: j
      type(units_t), intent(in) :: units
      character(len=:), allocatable :: line
      real(wp) :: effect, unit
      integer :: k

      associate (held => fit%held(j))
         line = to_text(held%sd)//unit_of(units, held%name)//' in '//trim(held%name)
         if (held%is_assumed) line = trim(held%name)
         if (held%record > 0) line = line//'('//to_text(held%record)//')'
         ! The effect of an assumed range is that of its ends.
         unit = 1
         if (held%is_assumed) then
            unit = normal_quantile(0.975_wp)
            line = line//' is fixed at '//assumption(held)//'; this'
         end if
         line = line//' moves '
         do k = 1, size(fit%free)
            if (is_coefficient(fit%free(k)) .and. k /= most_moved(fit, held%effect, k)) cycle
            associate (q => fit%quantities(k))
               if (line(len(line) - 6:) /= ' moves ') line = line//', '
               effect = unit*held%effect(k)
               if (.not. abs(held%effect(k)) < unlimited) then
                  line = line//trim(q%name)//' by an unknown amount'
               else if (abs(q%searched) > 0 .and. abs(effect) <= abs(q%searched)) then
                  if (q%is_reciprocal()) effect = -effect
                  line = line//trim(q%name)//filled(' by #.2 %', [100*effect/abs(q%searched)])
               else if (abs(effect) < 1e6_wp*abs(q%searched)) then
                  ! Linear theory ends here: a number would claim to know the effect.
                  line = line//trim(q%name)//' by more than 100 %'
               else
                  ! Nothing to take a percentage of: the value is 0, or the spring is rigid.
                  line = line//trim(q%searched_name())//' by '//to_text(effect)
               end if
            end associate
         end do
      end associate
   end function effect_line

   !> Returns the value of a parameter that the program keeps fixed, and its assumed range.
   function assumption(held) result(text)
      type(held_t), intent(in) :: held
      character(len=:), allocatable :: text
      real(wp) :: width
      integer :: p

      p = free_index(held%name(:scan(trim(held%name)//'.', '.') - 1))
      text = to_text(as_named(p, held%value))//' and assumed '
      if (.not. abs(held%value) > 0) then
         ! The range of a parameter that is 0 begins there, and has a width of twice 1.96 sd.
         width = 2*normal_quantile(0.975_wp)*held%sd
         text = text//'to be at '//trim(merge('least', 'most ', parameters(p)%is_reciprocal))// &
            ' '//to_text(as_named(p, width))
      else if (held%factor < 2) then
         text = text//'known to '//filled('# %', [100*(held%factor - 1)])
      else
         text = text//'known to a factor of '//to_text(held%factor)
      end if
   end function assumption

   !> Returns a blank and the label of the unit of a parameter that a prior names; '' without label.
   function unit_of(units, name) result(unit)
      type(units_t), intent(in) :: units
      character(len=*), intent(in) :: name
      character(len=:), allocatable :: unit
      integer :: k

      unit = ''
      if (name == 'width' .or. name == 'height') unit = units%length
      if (name == 'density' .and. units%mass /= '' .and. units%length /= '') &
         unit = trim(units%mass)//'/'//trim(units%length)//'^3'
      do k = 1, size(parameters)
         if (parameters(k)%name /= name(:scan(name//'.', '.') - 1)) cycle
         unit = units%of_parameter(k)
         exit
      end do
      if (unit /= '') unit = ' '//trim(unit)
   end function unit_of

   !> Returns the coefficient that moves most, relative to its scale, among those of the field of
   !> coefficient k.
   !>
   !> step  (free parameters) changes of the searched quantities
   pure integer function most_moved(fit, step, k)
      type(stage_fit_t), intent(in) :: fit
      real(wp), intent(in) :: step(:)
      integer, intent(in) :: k
      integer :: j, n

      n = size(fit%free)
      most_moved = maxloc([(abs(step(j))/fit%quantities(j)%scale, j=1, n)], dim=1, mask= &
         function_of(fit%free) == function_of(fit%free(k)))
   end function most_moved

   !> Adds a warning if a finer mesh shifts an estimate by too much of its interval or reduces J, or
   !> if the fit on it failed. Of the coefficients of a field only the one that moves most is named.
   subroutine add_mesh_warning(text, fit)
      type(text_t), intent(inout) :: text
      type(stage_fit_t), intent(in) :: fit
      character(len=:), allocatable :: line
      real(wp) :: shift
      integer :: k

      if (fit%statistics%samples > 0 .and. size(fit%free) > 0 .and. &
         .not. allocated(fit%mesh_shift)) call text%line('warning: mesh: N = '// &
         to_text(fit%elements)//': the fit on a finer mesh failed, so that the error of the '// &
         'mesh is unknown; try other elements')
      if (.not. fit%shifted()) return
      line = ''
      do k = 1, size(fit%mesh_shift)
         if (.not. fit%shifts(k)) cycle
         if (is_coefficient(fit%free(k)) .and. k /= most_moved(fit, fit%mesh_shift, k)) cycle
         associate (q => fit%quantities(k))
            shift = fit%mesh_shift(k)
            if (q%is_reciprocal()) shift = -shift
            line = line//', '//trim(q%name)
            ! A record without noise has intervals of width zero, with which no shift compares.
            if (fit%half_width(k) > epsilon(shift)*abs(shift)) line = line//' by '// &
               to_text(shift/fit%half_width(k))
         end associate
      end do
      if (line /= '') then
         line = 'shifts '//line(3:)//' times the half width of its interval'
      else
         line = 'reduces J by '//rounded(100*fit%mesh_decrease, 2)//' %'
      end if
      call text%line('warning: mesh: a finer mesh than N = '//to_text(fit%elements)//' '//line// &
         '; use a higher degree, more elements, or elements=''auto''')
   end subroutine add_mesh_warning

   !> Says what the intervals of profiles, draws and resampled records leave out: the error of the
   !> mesh, if a finer one moves an estimate by a good part of its half width (the mesh is chosen by
   !> total intervals, which may be much wider), what the model may lack, and the errors of fixed
   !> parameters.
   subroutine add_left_out(text, fit)
      type(text_t), intent(inout) :: text
      type(stage_fit_t), intent(in) :: fit
      real(wp), parameter :: good_part = 0.25_wp
      character(len=:), allocatable :: line
      real(wp) :: shifts(size(fit%free))
      logical, allocatable :: able(:)
      integer :: k

      shifts = 0
      associate (half => fit%statistics%corrected_half_width(:size(shifts)))
         if (allocated(fit%mesh_shift)) where (half > 0) shifts = abs(fit%mesh_shift( &
            :size(shifts)))/half
      end associate
      if (any(shifts > good_part)) then
         k = maxloc(shifts, dim=1)
         call text%line('these intervals do not include the error of the mesh: a finer mesh '// &
            'than N = '//to_text(fit%elements)//' shifts '//trim(fit%quantities(k)%name)//' by '// &
            rounded(shifts(k), 2)//' times the half width of linear theory; set more elements')
      end if
      if (allocated(fit%reach) .and. fit%other == '') then
         able = any(fit%reach > 0, dim=1)
         if (any(able)) call text%line('these intervals assume that the model lacks nothing; '// &
            'the total intervals of identify reach further for '// &
            listed(pack(fit%quantities(:size(able))%name, able), ', '))
      end if
      if (.not. allocated(fit%held)) return
      if (size(fit%held) == 0) return
      able = .not. fit%held%is_assumed .and. [(free_index(fit%held(k)%name) > 0 .and. &
         .not. any(fit%held(:k - 1)%name == fit%held(k)%name), k=1, size(fit%held))]
      line = ''
      if (count(able) == 1) line = '. To include that of '//listed(pack(fit%held%name, able), &
         ', ')//', add it to free and keep its &prior'
      if (count(able) > 1) line = '. To include those of '//listed(pack(fit%held%name, able), &
         ', ')//', add them to free and keep their &prior'
      call text%line('these intervals do not include the errors of fixed parameters ('// &
         listed(fit%held%name, ', ')//'); the total intervals of identify do'//line)
   end subroutine add_left_out

end module beamid_error_sources
