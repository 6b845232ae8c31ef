!> Checks whether the groups of a case file go together, after all of them are read. Problems are
!> added to the groups. `workflows/cases` calls them.
module beamid_group_checks
   use beamid_along_groups, only: reference_of, settle_along
   use beamid_blocks, only: block_t
   use beamid_case_files, only: case_t
   use beamid_errors, only: error_t
   use beamid_kinds, only: wp
   use beamid_mesh_unknowns, only: unknowns_of
   use beamid_numbers, only: shown
   use beamid_parameters, only: free_index, key_of, parameters
   use beamid_stage_groups, only: narrowest_dip
   use beamid_strings, only: to_text
   use beamid_structure, only: of_w_D, root, structure_t, tip
   use beamid_structure_checks, only: add_unit_hint, check_structure
   implicit none
   private

   public :: settle_variations, check_whole

contains

   !> Puts all properties that vary along the beam into the structure, once its length and the
   !> values in &beam are known. Problems are added to the blocks.
   subroutine settle_variations(blocks, case)
      type(block_t), intent(inout) :: blocks(:)
      type(case_t), intent(inout) :: case
      integer :: j, k

      associate (structure => case%model%structure, along => case%along, section => case%section)
         structure%variations%by_density = section%density > 0
         do j = 1, size(along)
            if (along(j)%is_dip) cycle
            k = place_of(blocks, 'along', j)
            associate (name => along(j)%parameter)
               if (reference_of(along(:j - 1), name) > 0) then
                  call blocks(k)%refuse('parameter', shown(name)//' twice', 'each once')
               else if (name == 'rho' .and. section%density > 0) then
                  call blocks(k)%refuse('parameter', '''rho'' beside density in &beam', &
                     'width and height, which the mass follows')
               else if (index('width height', name) > 0 .and. &
                  min(section%width, section%height) <= 0) then
                  call blocks(k)%refuse('parameter', shown(name)//' beside I in &beam', &
                     'width and height in the place of I')
               else
                  call settle_along(blocks(k), along(j), value_of(name), structure)
               end if
            end associate
         end do
      end associate

   contains

      !> Returns the reference value of a property.
      real(wp) function value_of(name)
         character(len=*), intent(in) :: name

         if (name == 'width') then
            value_of = case%section%width
         else if (name == 'height') then
            value_of = case%section%height
         else
            value_of = case%model%structure%get(free_index(name))
         end if
      end function value_of

   end subroutine settle_variations

   !> Checks that structure, excitations, meshes and observation fit together. Problems are added to
   !> the blocks.
   subroutine check_whole(blocks, case)
      type(block_t), intent(inout) :: blocks(:)
      type(case_t), intent(in) :: case
      type(error_t), allocatable :: error
      integer :: place, j, k

      call check_short_forms(blocks, case%model%structure)
      call check_structure(case%model%structure, error, place)
      call add_unit_hint(case%model%structure, place, case%units, error)
      if (allocated(error)) then
         associate (row => parameters(place))
            k = place_of(blocks, row%group, max(1, row%item))
            if (row%group == 'end') k = place_of_end(blocks, row%item)
            if (row%group == 'end' .and. k == 0) k = place_of(blocks, 'beam', 1)
            if (row%group == 'along') k = findloc([(blocks(j)%name == row%group .and. &
               blocks(j)%has(key_of(place)), j=1, size(blocks))], .true., dim=1)
            if (k > 0) call blocks(k)%refusals%add(blocks(k)%line_of(key_of(place)), '&'// &
               trim(blocks(k)%name)//' '//error%message)
         end associate
         return
      end if
      associate (s => case%model%structure)
         if ((s%variations%are_known() .or. s%has_dip()) .and. &
            any(case%excitations%by_displacement) .and. abs(s%g) + abs(s%T) > 0) then
            k = place_of(blocks, 'excitation', 1)
            call blocks(k)%refuse('displacement', 'a value for a beam that varies, under '// &
               'weight or an axial force', 'force')
         end if
      end associate
      call check_dip(blocks, case)
      call check_forces(blocks, case)
      call check_rigid(blocks, case)
      call check_held(blocks, case)
      if (case%model%observation%relative .and. size(case%excitations) > 0 .and. &
         .not. any(case%excitations%is_base)) then
         k = place_of(blocks, 'observation', 1)
         call blocks(k)%refuse('frame', '''relative'' without a base that moves', &
            '''absolute'', or kind = ''base'' in &excitation')
      end if
   end subroutine check_whole

   !> Returns the place of the n-th group of a name among the blocks; 0: there are fewer.
   pure integer function place_of(blocks, name, n) result(k)
      type(block_t), intent(in) :: blocks(:)
      character(len=*), intent(in) :: name
      integer, intent(in) :: n
      integer :: found

      found = 0
      do k = 1, size(blocks)
         if (blocks(k)%name == name) found = found + 1
         if (found == n) return
      end do
      k = 0
   end function place_of

   !> Refuses a dip that is too narrow for a mesh: a dip that falls between the quadrature points
   !> has no effect or an arbitrary one. With a width of a third of an element, the second frequency
   !> of a strip has an error of .4 %; with half an element, .05 %.
   subroutine check_dip(blocks, case)
      type(block_t), intent(inout) :: blocks(:)
      type(case_t), intent(in) :: case
      real(wp) :: least
      integer :: j, k

      associate (s => case%model%structure)
         least = narrowest_dip(s, minval(case%meshes%elements))
         if (.not. s%has_dip() .or. s%w_D >= least) return
         k = findloc([(blocks(j)%name == 'along' .and. blocks(j)%has(key_of(of_w_D)), &
            j=1, size(blocks))], .true., dim=1)
         call blocks(k)%refuse(key_of(of_w_D), to_text(s%w_D), 'at least half an element, '// &
            to_text(least)//', or more elements')
      end associate
   end subroutine check_dip

   !> Refuses a force beyond the tip. If a record has a beam length of its own, the force is checked
   !> later, with that length.
   subroutine check_forces(blocks, case)
      type(block_t), intent(inout) :: blocks(:)
      type(case_t), intent(in) :: case
      integer :: k, n

      if (any([(allocated(case%recordings(k)%length), k=1, size(case%recordings))])) return
      do n = 1, size(case%excitations)
         if (.not. allocated(case%excitations(n)%x_F)) cycle
         associate (x_F => case%excitations(n)%x_F, length => case%model%structure%length)
            k = place_of(blocks, 'excitation', n)
            if (x_F > length) call blocks(k)%refuse('x_F', to_text(x_F), &
               'a place above 0, up to the length '//to_text(length))
         end associate
      end do
   end subroutine check_forces

   !> Refuses so many rigid supports that the coarsest mesh has no degree of freedom left.
   subroutine check_rigid(blocks, case)
      type(block_t), intent(inout) :: blocks(:)
      type(case_t), intent(in) :: case
      integer :: rigid, k, unknowns

      associate (structure => case%model%structure, mesh => case%meshes( &
         minloc(case%meshes%elements, dim=1)))
         rigid = structure%rigid_supports()
         unknowns = unknowns_of(mesh, structure) + rigid - count(structure%has_hose())
         if (rigid < unknowns) return
         k = place_of(blocks, 'support', structure%supports)
         if (unknowns < 1) then
            k = place_of(blocks, 'beam', 1)
            call blocks(k)%refuse('', 'conditions at the ends that leave no unknown on a mesh '// &
               'of '//to_text(mesh%elements)//' elements', 'more elements')
         else if (k > 0) then
            call blocks(k)%refuse('', to_text(rigid)//' rigid ones', 'at most '// &
               to_text(unknowns - 1)//' on a mesh of '//to_text(mesh%elements)//' elements')
         end if
      end associate
   end subroutine check_rigid

   !> Refuses k_R and c_R of &beam beside a group &end for the root, in either order.
   subroutine check_short_forms(blocks, structure)
      type(block_t), intent(inout) :: blocks(:)
      type(structure_t), intent(in) :: structure
      character(len=*), parameter :: keys(2) = ['k_R', 'c_R']
      integer :: j, k

      k = place_of(blocks, 'beam', 1)
      if (k == 0 .or. .not. structure%described(root)) return
      do j = 1, size(keys)
         if (blocks(k)%has(keys(j))) call blocks(k)%refuse(keys(j), &
            'a value beside &end at=''root''', 'this key in &end')
      end do
   end subroutine check_short_forms

   !> Returns the number of the group &end that describes an end; 0: none.
   integer function place_of_end(blocks, end) result(place)
      type(block_t), intent(inout) :: blocks(:)
      integer, intent(in) :: end
      character(len=:), allocatable :: at

      do place = size(blocks), 1, -1
         if (blocks(place)%name /= 'end') cycle
         if (allocated(at)) deallocate (at)
         call blocks(place)%get('at', at, 'end of the beam')
         if (.not. allocated(at)) cycle
         if ((at == 'tip') .eqv. (end == tip)) return
      end do
   end function place_of_end

   !> Refuses loads for which the ends must hold the beam.
   subroutine check_held(blocks, case)
      type(block_t), intent(inout) :: blocks(:)
      type(case_t), intent(in) :: case
      character(len=*), parameter :: free = 'a beam that can move as a rigid body', &
         held = 'ends or supports that hold it'
      integer :: j, k

      associate (s => case%model%structure)
         do k = 1, size(case%excitations)
            associate (e => case%excitations(k))
               j = place_of(blocks, 'excitation', k)
               if (s%rigid_body_modes() > 0 .and. (e%is_release .or. e%is_base)) &
                  call blocks(j)%refuse('kind', free, held)
            end associate
         end do
         if (s%rigid_body_modes() == 0) return
         if (s%g > 0) call refuse_group('gravity')
         if (abs(s%T) > 0) call refuse_group('axial')
      end associate

   contains

      !> Refuses a group that loads a beam which nothing holds.
      subroutine refuse_group(name)
         character(len=*), intent(in) :: name

         j = place_of(blocks, name, 1)
         if (j > 0) call blocks(j)%refuse('', free, held)
      end subroutine refuse_group

   end subroutine check_held

end module beamid_group_checks
