!> Checks of a structure before it is used: refuses values that are physically impossible or
!> numerically out of proportion, and loads that buckle the beam.
module beamid_structure_checks
   use beamid_errors, only: bad_input, error_t, failure, locate, status_bad_input
   use beamid_kinds, only: wp
   use beamid_parameter_names, only: is_there
   use beamid_parameters, only: as_named, key_of, magnitude, not_negative, on_beam, parameters, &
      positive, share
   use beamid_strings, only: to_text
   use beamid_structure, only: deflection, n_parameters, no_spring, of_d, of_E, of_eta, &
      of_g, of_I, of_length, of_rho, of_T, rotation, structure_t, tip, x_P_at
   use beamid_units, only: units_t
   implicit none
   private

   public :: check_structure, check_axial_load, check_causal, check_local, add_unit_hint, &
      is_at_tip, furthest_parameter

   !> Largest axial force, as a multiple of E I/length**2. At this force the beam is 500 times as
   !> long as sqrt(E I/N), the length over which the force bends it. Under a larger tension the beam
   !> is a string with two boundary layers, which no practical mesh resolves; under compression it
   !> has buckled at a much smaller force.
   real(wp), parameter :: greatest_load = 2.5e5_wp
   !> Axial force, as a multiple of E I/length**2, that suggests inconsistent units.
   real(wp), parameter :: suspicious_load = 1e3_wp
   !> Smallest and largest values of length, I, rho and E in any units: their powers and products
   !> stay far from overflow and underflow.
   real(wp), parameter :: smallest = 1e-40_wp, largest = 1e40_wp
   !> Range of the first natural frequency of the bare beam [1/time].
   real(wp), parameter :: slowest = 1e-20_wp, fastest = 1e20_wp
   !> Largest ratio of a parameter to its moderate value. At a ratio of 1/epsilon, about 1e16, the
   !> round-off of the larger term would hide the smaller one.
   real(wp), parameter :: greatest_ratio = 1e14_wp
   !> Smallest distance of a position from the root, as a share of the length.
   real(wp), parameter :: nearest = 1e-9_wp

contains

   !> Refuses values outside their physical ranges, values out of proportion, buckling, and a
   !> structure whose `set` was called with the number of no parameter.
   !>
   !> error  the message starts with the key of the offending parameter, if there is one
   !> place  number of that parameter
   subroutine check_structure(structure, error, place)
      type(structure_t), intent(in) :: structure
      type(error_t), allocatable, intent(out) :: error
      integer, intent(out), optional :: place
      integer :: k

      if (present(place)) place = of_length
      if (structure%has_unknown_parameter) then
         call bad_input(error, 'found a call of set with a number that is no parameter of a '// &
            'structure, expected one from free_index, which is 0 for an unknown name '// &
            "('amplitude' belongs to the excitation)")
         return
      end if
      do k = 1, n_parameters
         if (present(place)) place = k
         if (.not. is_there(structure, k)) cycle
         call check_range(structure, k, error)
         if (.not. allocated(error)) call check_combination(structure, k, error)
         if (allocated(error)) return
      end do
      call check_frequency(structure, k, error)
      if (.not. allocated(error)) call check_proportions(structure, k, error)
      if (.not. allocated(error)) then
         call check_axial_load(structure, error, k)
         if (allocated(error)) error%status = status_bad_input
      end if
      if (present(place)) place = k
   end subroutine check_structure

   !> Refuses a value of parameter k outside its range in the table of parameters.
   subroutine check_range(structure, k, error)
      type(structure_t), intent(in) :: structure
      integer, intent(in) :: k
      type(error_t), allocatable, intent(out) :: error
      character(len=:), allocatable :: expected
      real(wp) :: value

      value = as_named(k, structure%get(k))
      select case (parameters(k)%range)
      case (positive)
         if (.not. value > 0) expected = 'a value above 0'
      case (not_negative)
         if (.not. value >= 0) expected = '0 or more'
      case (on_beam)
         if (.not. (value > 0 .and. value <= structure%length) .and. structure%length > 0) &
            expected = 'a place above 0, up to the length '//to_text(structure%length)
      case (share)
         if (.not. (value >= 0 .and. value < 1)) expected = 'a share from 0 up to less than 1'
      end select
      if (allocated(expected)) call bad_input(error, key_of(k)//': found '// &
         to_text(value)//', expected '//expected)
   end subroutine check_range

   !> Returns whether a place x [length] is the tip, up to rounding in a case file.
   pure logical function is_at_tip(structure, x)
      type(structure_t), intent(in) :: structure
      real(wp), intent(in) :: x

      is_at_tip = x >= structure%length*(1 - 1e-6_wp)
   end function is_at_tip

   !> Refuses a value of parameter k that has no effect without another parameter, and two supports
   !> at one position.
   subroutine check_combination(structure, k, error)
      type(structure_t), intent(in) :: structure
      integer, intent(in) :: k
      type(error_t), allocatable, intent(out) :: error
      integer :: c

      associate (needs => parameters(k)%needs, item => parameters(k)%item)
         if (needs > 0) then
            if (structure%get(k) > 0 .and. .not. structure%get(needs) > 0) call bad_input(error, &
               key_of(k)//': found a value without '//key_of(needs)//', expected both')
         end if
         if (allocated(error) .or. .not. any(x_P_at == k)) return
         if (is_at_tip(structure, structure%support(item)%x_P) .and. any([( &
            structure%has_spring(item, c) .and. structure%has_end_spring(c, tip), &
            c=deflection, rotation)])) call bad_input(error, 'x_P: found a support at the '// &
            'tip, which &end holds already, expected one of the two')
         if (any(abs(structure%support(:item - 1)%x_P - structure%support(item)%x_P) <= &
            1e-6_wp*structure%length)) call bad_input(error, 'x_P: found two supports at '// &
            to_text(structure%support(item)%x_P)//', expected one in one place')
      end associate
   end subroutine check_combination

   !> Refuses a bare beam whose dimensions, mass, modulus or first natural frequency are outside the
   !> range of any system of units.
   !>
   !> place  number of the parameter (E, I, length or rho) that is furthest from 1
   subroutine check_frequency(structure, place, error)
      type(structure_t), intent(in) :: structure
      integer, intent(out) :: place
      type(error_t), allocatable, intent(out) :: error
      integer, parameter :: rows(4) = [of_E, of_I, of_length, of_rho]
      type(structure_t) :: bare
      real(wp) :: values(4)
      integer :: k

      values = [(structure%get(rows(k)), k=1, size(rows))]
      k = maxloc(abs(log(values)), dim=1)
      place = rows(k)
      if (.not. (values(k) >= smallest .and. values(k) <= largest)) then
         call bad_input(error, trim(parameters(place)%name)//': found '// &
            to_text(values(k))//', expected '//to_text(smallest)//' to '//to_text(largest)// &
            ' in any units')
         return
      end if
      bare = bare_beam(structure)
      if (bare%omega() >= slowest .and. bare%omega() <= fastest) return
      call bad_input(error, trim(parameters(place)%name)//': found '// &
         to_text(values(k))//', which with E = '//to_text(structure%E)//', I = '// &
         to_text(structure%I)//', length = '// &
         to_text(structure%length)//' and rho = '//to_text(structure%rho)// &
         ' puts the first natural angular frequency at about '//to_text(bare%omega())// &
         ', expected '//to_text(slowest)//' to '//to_text(fastest)//': check the units')
   end subroutine check_frequency

   !> Returns the clamped beam without attachments and loads.
   type(structure_t) function bare_beam(structure) result(bare)
      type(structure_t), intent(in) :: structure

      bare = structure_t(length=structure%length, rho=structure%rho, E=structure%E, I=structure%I)
   end function bare_beam

   !> Refuses masses, springs and dampers that exceed `greatest_ratio` times the moderate value for
   !> the bare beam, and positions closer than `nearest` to the root.
   !>
   !> place  number of the parameter that was checked last, at fault if there is an error
   subroutine check_proportions(structure, place, error)
      type(structure_t), intent(in) :: structure
      integer, intent(out) :: place
      type(error_t), allocatable, intent(out) :: error
      type(structure_t) :: bare
      character(len=:), allocatable :: limit
      real(wp) :: most
      integer :: k

      bare = bare_beam(structure)
      do k = 1, n_parameters
         place = k
         if (parameters(k)%range == share .or. any(k == [of_E, of_I, of_length, of_rho, of_g, &
            of_T]) .or. .not. is_there(structure, k)) cycle
         if (parameters(k)%range == on_beam) then
            if (structure%get(k) >= nearest*structure%length) cycle
            call bad_input(error, key_of(k)//': found '// &
               to_text(structure%get(k))//', which is out of proportion to the beam, expected '// &
               'at least '//to_text(nearest*structure%length))
            return
         end if
         most = greatest_ratio*magnitude(bare, k)
         if (abs(structure%get(k)) <= most .or. structure%get(k) >= no_spring) cycle
         limit = 'at most '
         if (parameters(k)%is_reciprocal) limit = 'at least '
         call bad_input(error, key_of(k)//': found '// &
            to_text(as_named(k, structure%get(k)))//', which is out of proportion to the '// &
            'beam, expected '//limit//to_text(as_named(k, most)))
         return
      end do
   end subroutine check_proportions

   !> Returns the number of the parameter with the largest or smallest ratio to its moderate value
   !> on the same beam; 0: no ratio or its reciprocal exceeds 1e8.
   integer function furthest_parameter(structure) result(place)
      type(structure_t), intent(in) :: structure
      real(wp), parameter :: far = 1e8_wp
      type(structure_t) :: bare
      real(wp) :: ratios(n_parameters), value
      integer :: k

      ratios = 0
      bare = bare_beam(structure)
      do k = 1, n_parameters
         value = abs(structure%get(k))
         if (is_there(structure, k) .and. value > 0 .and. value < no_spring) &
            ratios(k) = abs(log(value) - log(magnitude(bare, k)))
      end do
      place = maxloc(ratios, dim=1)
      if (.not. ratios(place) > log(far)) place = 0
   end function furthest_parameter

   !> Refuses an axial force or weight that buckles the beam, or that is so large that the bending
   !> stiffness has no effect.
   !>
   !> place  number of the larger of the two loads, `of_T` or `of_g`
   subroutine check_axial_load(structure, error, place)
      type(structure_t), intent(in) :: structure
      type(error_t), allocatable, intent(out) :: error
      integer, intent(out), optional :: place
      real(wp) :: load(2), most, force, weight, mass
      integer :: k

      if (present(place)) place = of_T
      if (.not. (abs(structure%T) > 0 .or. structure%g > 0)) return
      if (.not. structure%E > 0) then
         call failure(error, 'E: found '//to_text(structure%E)//', expected a value above 0')
         return
      end if
      load = structure%axial_load()
      most = maxval(abs(load))
      if (most <= greatest_load .and. .not. structure%buckles()) return
      mass = structure%total_mass()
      force = structure%T
      weight = structure%g*mass
      if (minval(load) < 0) then
         ! Only the loads that compress the beam count.
         force = min(force, 0.0_wp)
         if (.not. structure%stands) weight = 0
      end if
      k = of_T
      if (weight > abs(force)) k = of_g
      if (present(place)) place = k
      if (minval(load) < 0) then
         call failure(error, 'found '//to_text(structure%get(k))//', which buckles the beam, '// &
            'expected less compression or more than E = '//to_text(structure%E))
      else
         most = greatest_load*structure%E*structure%I/structure%length**2
         if (k == of_g) most = most/mass
         call failure(error, 'found '//to_text(structure%get(k))//', which stretches '// &
            'the beam until it behaves like a string: its bending stiffness has no effect (E = '// &
            to_text(structure%E)//'), expected at most '//to_text(most))
      end if
      call locate(error, trim(merge('force', 'g    ', k == of_T)))
   end subroutine check_axial_load

   !> Refuses structural damping in time, which is defined for vibrations at one frequency: a
   !> stiffness E (1 + i eta) would make a structure move before the force acts (Crandall, J. Sound
   !> Vib. 11, 1970, 3). Refuses derivatives with respect to a relaxation of strength 0, which has
   !> no root.
   !>
   !> parameters  numbers of the parameters of derivatives
   subroutine check_causal(structure, parameters, error)
      type(structure_t), intent(in) :: structure
      integer, intent(in) :: parameters(:)
      type(error_t), allocatable, intent(out) :: error
      integer :: l

      if (structure%eta > 0 .or. any(parameters == of_eta)) call failure(error, &
         'eta: found '//to_text(structure%eta)//' for a response in time, expected 0 and no '// &
         'derivative: a loss factor is not causal')
      if (allocated(error)) return
      do l = 1, size(of_d)
         if (any(parameters == of_d(l)) .and. .not. structure%get(of_d(l)) > 0) call failure( &
            error, 'd_'//to_text(l)//': found 0 for a derivative in time, expected a value above 0')
      end do
   end subroutine check_causal

   !> Refuses spatial hysteresis, which couples all points of the beam, for a solver with band
   !> matrices.
   subroutine check_local(structure, error)
      type(structure_t), intent(in) :: structure
      type(error_t), allocatable, intent(out) :: error

      if (structure%a_h > 0) call failure(error, 'a_h: found '//to_text(structure%a_h)// &
         ' with cvode, expected modal: spatial hysteresis couples all points of the beam')
   end subroutine check_local

   !> Adds E I/length**2 and a hint at the unit of E to the message of an error, if the error is
   !> about an axial force far beyond the bending stiffness; leaves other errors unchanged.
   !>
   !> place  number of the parameter that the error is about
   subroutine add_unit_hint(structure, place, units, error)
      type(structure_t), intent(in) :: structure
      integer, intent(in) :: place
      type(units_t), intent(in) :: units
      type(error_t), allocatable, intent(inout) :: error
      character(len=:), allocatable :: hint, unit
      logical :: is_si

      if (.not. allocated(error) .or. .not. any(place == [of_g, of_T])) return
      if (.not. maxval(abs(structure%axial_load())) > suspicious_load) return
      ! A string or a wire in SI units: the modulus is plausible, and the units need no check.
      if (structure%E >= 1e5_wp .and. structure%E <= 1e13_wp .and. &
         minval(structure%axial_load()) >= 0) return
      unit = units%of_parameter(of_E)
      is_si = unit == 'N/m^2' .and. any(units%mass == [character(len=2) :: '', 'kg']) .and. &
         any(units%time == ['s', ' '])
      hint = ' (E = '//to_text(structure%E)
      if (unit /= '') hint = hint//' '//unit
      if ((unit == '' .or. is_si) .and. structure%E >= 1 .and. structure%E <= 1000) &
         hint = hint//' looks like GPa'
      if (unit == '') then
         hint = hint//': with m, s and kg, E is in N/m^2; aluminium: 7e10'
      else if (is_si) then
         hint = hint//'; aluminium: 7e10'
      end if
      error%message = error%message//'; check the units: E I/length^2 is only '// &
         to_text(structure%E*structure%I/structure%length**2)//hint//')'
   end subroutine add_unit_hint

end module beamid_structure_checks
