!> All roots of 2000 random structures with everything that may hang on a beam: their number, their
!> sums, and each against inverse iteration in quadruple precision.
program test_scan
   use attached_beams, only: poles_of, starting_vector
   use beamid_excitation, only: new_pulse
   use full_matrices, only: full_t, new_full, qp
   use beamid_errors, only: error_t
   use beamid_galerkin, only: mesh_t
   use beamid_kinds, only: wp
   use beamid_poles, only: poles_t
   use beamid_structure, only: at_tip, structure_t
   use checks, only: finish
   use exact_motions, only: galerkin, mesh_of
   use random_experiments, only: random_beam
   use random_numbers, only: decades, start_random, uniform
   implicit none

   call test_roots()

contains

   !> Every parameter over six decades about the beam's own; each left out in one of ten.
   function wide_structure() result(s)
      type(structure_t) :: s
      real(wp) :: mass

      s = random_beam()
      mass = s%rho*s%length
      s%m_T = mass*decades(-3.0_wp, 3.0_wp)
      s%J_T = mass*s%length**2*decades(-5.0_wp, 1.0_wp)
      s%kappa_R = s%length/(s%E*s%I*decades(-3.0_wp, 3.0_wp))
      s%c_R = 0.1_wp/(s%kappa_R*s%omega())
      s%sensor(1)%m_S = mass*decades(-4.0_wp, 2.0_wp)
      s%sensor(1)%x_S = s%length*decades(-2.0_wp, 0.0_wp)
      s%c_D = 2*s%E/s%omega()*decades(-5.0_wp, 1.0_wp)
      s%gamma = 2*s%rho*s%omega()*decades(-4.0_wp, 2.0_wp)
      s%m_H = mass*decades(-4.0_wp, 2.0_wp)
      s%k_H = s%m_H*(s%omega()*decades(-3.0_wp, 3.0_wp))**2
      s%c_H = 2*sqrt(s%k_H*s%m_H)*decades(-4.0_wp, 2.0_wp)
      if (uniform() < 0.1_wp) s%m_T = 0
      if (uniform() < 0.1_wp) s%J_T = 0
      if (uniform() < 0.1_wp) s%kappa_R = 0
      if (uniform() < 0.1_wp) s%sensor(1)%m_S = 0
      if (uniform() < 0.1_wp) s%sensor(1)%x_S = at_tip
      if (uniform() < 0.1_wp) s%c_D = 0
      if (uniform() < 0.1_wp) s%gamma = 0
      if (uniform() < 0.1_wp) s%m_H = 0
      if (uniform() < 0.1_wp) s%c_H = 0
   end function wide_structure

   subroutine test_roots()
      type(structure_t) :: structure
      type(poles_t) :: poles
      type(error_t), allocatable :: error
      type(mesh_t) :: mesh
      integer :: number, refused, numbers, seed, most_elements
      integer(8) :: t0, t1, rate
      character(len=20) :: arg

      call get_command_argument(1, arg); read (arg, *) seed
      call get_command_argument(2, arg); read (arg, *) numbers
      call get_command_argument(3, arg); read (arg, *) most_elements
      call start_random(seed)
      refused = 0
      call system_clock(t0, rate)
      do number = 1, numbers
         structure = wide_structure()
         if (uniform() < 0.1_wp) structure%kappa_R = structure%kappa_R*decades(-12.0_wp, 0.0_wp)
         mesh = mesh_t(3, int(decades(log10(2.0_wp), log10(real(most_elements, wp)))), 4, 1)
         if (uniform() < 0.3_wp) mesh = mesh_t(5, mesh%elements, 6, 1)
         galerkin = mesh_of(mesh, structure)
         call poles_of(structure, poles, error)
         if (allocated(error)) then
            refused = refused + 1
            print '(a,i0,a,i0,a,i0,2a)', '      structure ', number, ' N ', &
               mesh%elements, ' deg ', mesh%degree, ': ', error%message
            associate (q => structure)
            print '(*(a,es10.2))', '  kap', q%kappa_R*q%E*q%I/q%length, ' mT ', q%m_T/q%rho, &
               ' JT ', q%J_T/q%rho, ' cD w/E ', q%c_D*q%omega()/q%E, ' mS ', q%sensor(1)%m_S, &
               ' mH ', q%m_H/q%rho, ' cH ', q%c_H, ' kH ', q%k_H, &
               ' gam ', q%gamma/q%omega()/q%rho, ' xS ', q%sensor(1)%x_S/q%length
            end associate
            if (number == 23) call against(structure, poles)
            cycle
         end if
      end do
      call system_clock(t1)
      print *, 'refused', refused, ' of', numbers, ' seconds', real(t1 - t0)/rate
   end subroutine test_roots

   subroutine against(structure, poles)
      type(structure_t), intent(in) :: structure
      type(poles_t), intent(in) :: poles
      type(full_t) :: full
      complex(qp), allocatable :: x(:)
      complex(qp) :: s, r
      real(qp) :: last
      real(wp) :: off(size(poles%s))
      complex(wp) :: ours(size(poles%s)), theirs(size(poles%s)), at(size(poles%s))
      integer :: k, j

      full = new_full(galerkin, structure, new_pulse(1.0_wp, 1.0_wp))
      do k = 1, size(poles%s)
         s = poles%s(k)
         x = starting_vector(full%n)
         call full%improve(12, s, x, last)
         r = full%residue(s, x)
         ours(k) = poles%residue(k)*poles%s(k)
         theirs(k) = r*s
         at(k) = s
         off(k) = abs(ours(k) - theirs(k))
      end do
      print *, 'sum quad', sum(real(theirs)), 'ours', sum(real(ours)), 'imp quad', &
         real(full%impulse(), wp), 'ours', poles%impulse
      do k = 1, 8
         j = maxloc(off, dim=1)
         print '(9es13.4)', poles%s(j), abs(at(j) - poles%s(j))/abs(at(j)), ours(j), theirs(j), off(j)
         off(j) = 0
      end do
   end subroutine against

end program test_scan
