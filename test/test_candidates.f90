!> Which model is a special case of which: two beams with two records, made alike, and one
!> difference at a time. Nothing is computed.
program test_candidates
   use beamid_candidates, only: candidate_t, held, is_nested, same_samples, shared
   use beamid_errors, only: error_t
   use beamid_excitation, only: excitation_t, new_base_motion, new_free, new_pulse, new_release
   use beamid_galerkin, only: mesh_t
   use beamid_kinds, only: wp
   use beamid_parameters, only: free_index, parameters
   use beamid_strings, only: to_text
   use beamid_structure, only: of_x_F, of_x_S, structure_t, x_P_at
   use checks, only: check, finish
   implicit none

   integer, parameter :: records = 2
   type(candidate_t) :: a, b
   type(excitation_t) :: base
   type(error_t), allocatable :: error

   call new_base_motion([0.0_wp, 1.0_wp], [0.0_wp, 1.0_wp], base, error)
   call test_parameters()
   call test_records()
   call test_places()
   call test_methods()
   call test_samples()
   call finish('candidates')

contains

   !> The smaller model has E free, the larger one E and m_T; all values are alike.
   subroutine prepare()
      a = new_candidate([free_index('E')])
      b = new_candidate([free_index('E'), free_index('m_T')])
   end subroutine prepare

   function new_candidate(free) result(new)
      integer, intent(in) :: free(:)
      type(candidate_t) :: new
      integer :: r

      new%mesh = mesh_t(elements=4)
      new%model%structure = structure_t(length=4, rho=0.03_wp, E=80, I=1, m_T=0.15_wp)
      allocate (new%stages(0), new%experiments(records), new%fit%quantities(size(free)))
      allocate (new%fit%scenario%structures(records), new%fit%scenario%excitations(records))
      allocate (new%owner(size(parameters), records), source=held)
      new%owner(free, :) = shared
      new%fit%free = free
      new%fit%scenario%structures = new%model%structure
      do r = 1, records
         new%experiments(r)%samples = [0.1_wp, 0.2_wp]
         new%experiments(r)%measured = [1.0_wp, 2.0_wp]
         call drive(new, r, new_pulse(1.0_wp, 0.05_wp))
      end do
   end function new_candidate

   !> What sets the beam in motion in record r.
   subroutine drive(model, r, excitation)
      type(candidate_t), intent(inout) :: model
      integer, intent(in) :: r
      type(excitation_t), intent(in) :: excitation

      model%experiments(r)%excitation = excitation
      model%fit%scenario%excitations(r) = excitation
   end subroutine drive

   subroutine expect(what, nested)
      character(len=*), intent(in) :: what
      logical, intent(in) :: nested

      call check(what//': '//trim(merge('nested    ', 'not nested', nested)), &
         is_nested(a, b) .eqv. nested)
   end subroutine expect

   subroutine test_parameters()
      call prepare()
      call expect('E within E and m_T', .true.)
      call check('but not the other way round', .not. is_nested(b, a))
      a%fit%scenario%structures%m_T = 0.2_wp
      call expect('another mass, free in the larger', .true.)
      a%fit%scenario%structures%rho = 0.031_wp
      call expect('another density, held in both', .false.)
      call prepare()
      b%owner(free_index('E'), :) = held
      b%owner(free_index('c_D'), :) = shared
      call expect('E, which the larger one holds', .false.)
      ! The tip is where the beam ends, here and there.
      call prepare()
      b%owner(free_index('length'), :) = shared
      b%fit%scenario%structures%length = 4.1_wp
      call expect('a length that is free in the larger', .true.)
      b%owner(free_index('length'), :) = held
      call expect('another length, held', .false.)
   end subroutine test_parameters

   !> What holds in the second record counts as well.
   subroutine test_records()
      integer :: r

      call prepare()
      a%fit%scenario%structures(2)%rho = 0.031_wp
      call expect('another density in the second record', .false.)
      b%fit%scenario%structures(2)%rho = 0.031_wp
      call expect('the same one there', .true.)
      call prepare()
      a%fit%scenario%structures(2)%m_T = 0.2_wp
      call expect('masses of their own for the shared one', .false.)
      b%owner(free_index('m_T'), :) = [(r, r=1, records)]
      call expect('masses of their own for each its own', .true.)
      call prepare()
      b = a
      b%owner(free_index('E'), :) = [(r, r=1, records)]
      call check('E for each record: two unknowns', b%unknowns() == records .and. &
         a%unknowns() == 1, to_text(b%unknowns()))
      call expect('one E within an E for each record', .true.)
      a%owner(free_index('E'), :) = [(r, r=1, records)]
      b = a
      b%owner(free_index('E'), :) = shared
      b%owner([free_index('m_T'), free_index('c_D'), free_index('gamma')], :) = shared
      call expect('an E for each record within one E', .false.)
   end subroutine test_records

   subroutine test_places()
      call prepare()
      a%fit%scenario%structures(2)%x_F = 2
      call expect('a force elsewhere', .false.)
      a%fit%scenario%structures(2)%x_F = 4
      call expect('a force at the tip, by its place', .true.)
      b%owner(of_x_F, :) = shared
      a%fit%scenario%structures(2)%x_F = b%fit%scenario%structures(2)%x_F
      call expect('a force at a free place', .true.)
      call prepare()
      a%fit%scenario%structures%sensor(1)%x_S = 3
      call expect('a sensor elsewhere', .false.)
      b%owner(of_x_S, :) = shared
      call expect('a sensor at a free place', .true.)
      call prepare()
      a%model%structure%supports = 1
      a%fit%scenario%structures%support(1)%x_P = 2
      call expect('a support', .false.)
      b%owner(x_P_at(1), :) = shared
      call expect('a support, and a free place of what is not there', .false.)
      b%model%structure%supports = 1
      call expect('a support at a free place', .true.)
   end subroutine test_places

   subroutine test_methods()
      call prepare()
      a%experiments(2)%sensor = 2
      call expect('seen by another sensor', .false.)
      call prepare()
      a%model%structure%sensors = 2
      call expect('two sensors', .false.)
      call prepare()
      a%model%observation%relative = .true.
      call expect('another frame', .false.)
      call prepare()
      a%mesh%elements = 5
      call expect('another mesh', .false.)
      call prepare()
      call drive(a, 2, new_pulse(1.0_wp, 0.06_wp))
      call expect('a longer pulse', .false.)
      call drive(a, 2, new_pulse(2.0_wp, 0.05_wp))
      call expect('a stronger pulse', .false.)
      b%owner(free_index('amplitude'), 2) = 2
      call expect('a stronger pulse, free in the larger', .true.)
      call drive(a, 2, new_free(2))
      call expect('an unknown start', .false.)
      call prepare()
      call drive(a, 1, base)
      call expect('a base that moves', .false.)
      call drive(b, 1, base)
      call expect('a base that moves in both', .true.)
      call prepare()
      call drive(a, 1, new_release(1.0_wp, 0.0_wp, .true.))
      call drive(b, 1, new_release(1.0_wp, 0.0_wp, .false.))
      call expect('releases by a displacement and by a force', .false.)
   end subroutine test_methods

   subroutine test_samples()
      call prepare()
      call check('the same samples', same_samples(a, b))
      b%experiments(2)%measured(2) = nearest(2.0_wp, 1.0_wp)
      call check('one value of the second record differs', .not. same_samples(a, b))
      call prepare()
      b%experiments(2)%samples = [0.1_wp]
      b%experiments(2)%measured = [1.0_wp]
      call check('fewer samples', .not. same_samples(a, b))
      b%experiments = b%experiments(:1)
      call check('fewer records', .not. same_samples(a, b))
   end subroutine test_samples

end program test_candidates
