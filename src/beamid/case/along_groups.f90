!> The groups &along of a case file: properties that vary along the beam, given by values at
!> places, or a local dip of the stiffness. `settle_along` puts them into the structure after the
!> whole file has been read.
module beamid_along_groups
   use beamid_blocks, only: block_t
   use beamid_errors, only: error_t
   use beamid_kinds, only: wp
   use beamid_records, only: column_length
   use beamid_series, only: part_t, read_series, series_t
   use beamid_strings, only: to_text
   use beamid_structure, only: of_d_D, of_w_D, of_x_D, structure_t
   use beamid_values, only: positive, range_t
   use beamid_variations, only: as_spline, constant, in_steps, known_names, new_variation, &
      variation_t
   implicit none
   private

   public :: along_t, read_along, settle_along, reference_of

   !> One group &along.
   type :: along_t
      !> Property that varies: 'E', 'c_D', 'rho', 'gamma', 'width' or 'height'.
      character(len=:), allocatable :: parameter
      !> `in_steps`, `in_lines` or `as_spline` (`beamid_variations`).
      integer :: kind = constant
      !> (places) places [length] and values there, in the property's unit.
      real(wp), allocatable :: x(:), value(:)
      !> The group is a dip of E, which the structure holds; there are no places or values.
      logical :: is_dip = .false.
   end type along_t

   !> Largest number of places in the case file.
   integer, parameter :: most = 10000

contains

   !> Reads a group &along.
   !>
   !> structure  gets the dip, if the group is one
   !> error      error in a file that the group names; an earlier error is kept
   subroutine read_along(block, structure, found, error)
      type(block_t), intent(inout) :: block
      type(structure_t), intent(inout) :: structure
      type(along_t), intent(out) :: found
      type(error_t), allocatable, intent(inout) :: error
      character(len=:), allocatable :: kind, file
      character(len=column_length) :: columns(2)
      real(wp), allocatable :: place, width, depth
      type(series_t) :: series
      integer :: k
      character(len=*), parameter :: of_values(3) = [character(len=5) :: 'x', 'value', 'file'], &
         of_dips(3) = [character(len=5) :: 'place', 'width', 'depth'], &
         no_table = 'required without file and without kind=''dip''', &
         no_dip = 'required with kind=''dip'''

      kind = 'linear'
      call block%get('parameter', found%parameter, 'property that varies along the beam', &
         known_names, default='required; ''E'' with kind=''dip''')
      call block%get('kind', kind, 'shape of the variation: ''linear'', straight lines; '// &
         '''spline'', a natural cubic spline; ''steps'', constant from each position to the '// &
         'next; ''dip'', a Gaussian dip of E', &
         [character(len=6) :: 'linear', 'spline', 'steps', 'dip'])
      call block%get('x', found%x, no_table, 'positions, ascending from 0 to the length; with '// &
         'kind=''steps'' the start of each step', most)
      call block%get('value', found%value, no_table, 'value of the property at each position', most)
      call block%get_file('file', file, 'path of a table with the columns x and value, which '// &
         'replaces these keys', default='none')
      call block%get('place', place, no_dip, 'position of the middle of the dip', positive)
      call block%get('width', width, no_dip, 'standard deviation of the dip, '// &
         'at least half an element', positive)
      call block%get('depth', depth, no_dip, &
         'share of E that is missing in the middle of the dip', range_t(0))
      call block%close()
      if (block%failed()) return
      found%is_dip = kind == 'dip'
      found%kind = findloc([character(len=6) :: 'steps', 'linear', 'spline'] == kind, .true., dim=1)
      if (found%is_dip) then
         call read_dip()
         return
      end if
      do k = 1, 3
         call block%exclude(trim(of_dips(k)), 'with kind = '''//kind//'''')
      end do
      call block%require('parameter')
      if (allocated(file)) then
         call read_table()
         if (block%failed() .or. allocated(error)) return
      else
         call block%require('x')
         call block%require('value')
         if (block%failed()) return
      end if
      call check_values(block, kind, found)

   contains

      !> Checks the keys of a dip and puts it into the structure.
      subroutine read_dip()
         do k = 1, 3
            call block%exclude(trim(of_values(k)), 'with kind = ''dip''')
            call block%require(trim(of_dips(k)))
         end do
         if (block%failed()) return
         if (.not. allocated(found%parameter)) found%parameter = 'E'
         if (found%parameter /= 'E') call block%refuse('parameter', ''''//found%parameter// &
            ''' with a dip', '''E''')
         if (structure%has_dip()) call block%refuse('kind', 'a second dip', 'one')
         if (.not. depth < 1) call block%refuse('depth', to_text(depth), 'less than 1')
         call structure%set(of_x_D, place)
         call structure%set(of_w_D, width)
         call structure%set(of_d_D, depth)
      end subroutine read_dip

      !> Reads places and values from a file.
      subroutine read_table()
         call block%exclude('x', 'beside file')
         call block%exclude('value', 'beside file')
         if (block%failed() .or. allocated(error)) return
         columns = ''
         call read_series(file, columns, part_t(), series, error)
         if (allocated(error)) return
         found%x = series%t
         found%value = series%z
      end subroutine read_table

   end subroutine read_along

   !> Refuses places and values that do not define a function of x: places must ascend from 0,
   !> values must be positive (c_D and gamma: not negative, and not all 0).
   subroutine check_values(block, kind, found)
      type(block_t), intent(inout) :: block
      character(len=*), intent(in) :: kind
      type(along_t), intent(inout) :: found
      logical :: may_vanish
      integer :: k, n

      n = size(found%x)
      ! The last place of steps may be the end of the beam; it needs no value.
      if (found%kind == in_steps .and. n == size(found%value) + 1) &
         found%value = [found%value, found%value(n - 1)]
      if (n /= size(found%value)) then
         call block%refuse('value', to_text(size(found%value))//' values', to_text(n)// &
            ', one for each x')
         return
      end if
      if (n < 2) call block%refuse('x', to_text(n)//' place', 'two or more')
      if (abs(found%x(1)) > 0) call block%refuse('x', to_text(found%x(1))//' as the first place', &
         '0, the root')
      do k = 2, n
         if (.not. found%x(k) > found%x(k - 1)) call block%refuse('x', to_text(found%x(k))// &
            ' after '//to_text(found%x(k - 1)), 'ascending places')
      end do
      may_vanish = found%parameter == 'c_D' .or. found%parameter == 'gamma'
      if (any(found%value < 0)) then
         call block%refuse('value', to_text(minval(found%value)), trim(merge('0 or more      ', &
            'a value above 0', may_vanish)))
      else if (.not. may_vanish .and. any(.not. found%value > 0) .or. &
         .not. any(found%value > 0)) then
         call block%refuse('value', '0', 'values above 0')
      end if
      if (.not. kind == 'spline' .or. block%failed()) return
      if (lowest(new_variation(as_spline, found%x/found%x(n), found%value)) <= 0) &
         call block%refuse('value', 'a spline through the values that falls to 0 between them', &
         'more places, or kind = ''linear''')
   end subroutine check_values

   !> Returns the lowest value of a variation, sampled at 101 places of each interval.
   real(wp) function lowest(variation)
      type(variation_t), intent(in) :: variation
      integer, parameter :: parts = 100
      integer :: j, k

      lowest = huge(lowest)
      associate (xi => variation%table(:, 1))
         do k = 1, size(xi) - 1
            do j = 0, parts
               lowest = min(lowest, variation%at(xi(k) + (xi(k + 1) - xi(k))*j/parts))
            end do
         end do
      end associate
   end function lowest

   !> Returns the reference value of a property that varies: its value at the root or, if that is 0,
   !> its largest value. The structure uses it if &beam gives no value. 0: it does not vary.
   !>
   !> along  groups &along read so far
   pure real(wp) function reference_of(along, parameter)
      type(along_t), intent(in) :: along(:)
      character(len=*), intent(in) :: parameter
      integer :: k

      reference_of = 0
      do k = 1, size(along)
         if (along(k)%is_dip .or. along(k)%parameter /= parameter) cycle
         reference_of = along(k)%value(1)
         if (.not. reference_of > 0) reference_of = maxval(along(k)%value)
      end do
   end function reference_of

   !> Puts a group into the structure, as a factor of the property's reference value. Refuses places
   !> that do not cover the beam, and a reference value outside the range of the group's values.
   !>
   !> value  reference value of the property, which the factor multiplies
   subroutine settle_along(block, along, value, structure)
      type(block_t), intent(inout) :: block
      type(along_t), intent(in) :: along
      real(wp), intent(in) :: value
      type(structure_t), intent(inout) :: structure
      real(wp), allocatable :: xi(:)
      integer :: k, n
      real(wp), parameter :: same = 1e-9_wp

      n = size(along%x)
      associate (l => structure%length)
         xi = along%x/l
         if (xi(n) > 1 + same) then
            call block%refuse('x', to_text(along%x(n)), 'places up to the length '//to_text(l))
         else if (along%kind /= in_steps .and. xi(n) < 1 - same) then
            call block%refuse('x', to_text(along%x(n))//' as the last place', &
               'the length '//to_text(l))
         end if
      end associate
      if (value < minval(along%value)*(1 - same) .or. value > maxval(along%value)*(1 + same)) &
         call block%refuse('value', to_text(minval(along%value))//' to '// &
         to_text(maxval(along%value)), 'values around '//along%parameter//' = '// &
         to_text(value)//' of &beam, or that left out')
      if (block%failed()) return
      if (along%kind /= in_steps) xi(n) = 1
      k = findloc(known_names == along%parameter, .true., dim=1)
      structure%variations%known(k) = new_variation(along%kind, xi, along%value/value)
   end subroutine settle_along

end module beamid_along_groups
