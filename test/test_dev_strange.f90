program test_dev_strange
   use strange_records
   use beamid_kinds, only: wp
   use beamid_errors, only: error_t
   use beamid_identification, only: stage_fit_t
   implicit none
   type(strange_t) :: strange
   type(stage_fit_t), allocatable :: found(:)
   type(error_t), allocatable :: error
   character(len=200) :: arg
   character(len=8), parameter :: words(5) = [character(len=8) :: 'right','declared','failed','vague','WRONG']
   integer :: i, a, b, mode, v, count(5), strong(5)
   real(wp) :: t0, t1
   call get_command_argument(1, arg); read (arg, *) a
   call get_command_argument(2, arg); read (arg, *) b
   mode = 0
   call get_command_argument(3, arg); if (arg /= '') read (arg, *) mode
   count = 0; strong = 0
   do i = a, b
      select case (mode)
      case (0); call new_strange_record(i, strange)
      case (1); call new_strange_record(i, strange, gone=.true., near_multiple=.true., length=0.3_wp+0.1_wp*modulo(i,4))
      case (2); call new_strange_record(i, strange, gone=.true., near_multiple=.true., length=0.3_wp+0.1_wp*modulo(i,4), &
         length_error=merge(2.5e-3_wp,-2.5e-3_wp, modulo(i/4,2)==0))
      end select
      call cpu_time(t0)
      call verdict_on(strange, v, found, error)
      call cpu_time(t1)
      if (a == b) call show()
      count(v) = count(v) + 1
      if (strange%gain > 50) strong(v) = strong(v) + 1
      write (*, '(i6,1x,a8,f5.2,i6,f6.2,f8.3,f8.3,f10.1,f6.2)', advance='no') i, words(v), strange%truth%length, &
         size(strange%experiment%samples), t1-t0, strange%frequency, strange%gain, &
         strange%frequency(2)/strange%frequency(1)
      if (allocated(found) .and. v /= failed) then
         write (*, '(2f7.3,f8.4)', advance='no') found(1)%quantities(1)%value/strange%truth%E, &
            found(1)%quantities(2)%value/strange%truth%sensor(1)%m_S, &
            found(1)%statistics%corrected_half_width(1)/strange%truth%E
         write (*, '(1x,a)') found(1)%note(:min(50,len(found(1)%note)))
      else if (allocated(error)) then
         write (*, '(1x,a)') error%message
      else
         write (*, '(1x,a)') found(1)%doubt
      end if
   end do
   print '(a,5(1x,a,i4))', 'all   ', (trim(words(i)), count(i), i=1,5)
   print '(a,5(1x,a,i4))', 'strong', (trim(words(i)), strong(i), i=1,5)
contains
   subroutine show()
      use beamid_decaying_lines, only: find_lines
      use beamid_spectra, only: line_t
      use beamid_fitted_modes, only: fitted_mode_t, fitted_modes
      use beamid_galerkin, only: mesh_t
      type(line_t), allocatable :: lines(:)
      type(fitted_mode_t), allocatable :: modes(:)
      integer :: k
      call find_lines(strange%experiment%samples, strange%experiment%measured, 2*strange%frequency(2), 12, lines)
      do k = 1, size(lines)
         print '(f10.4,f9.3,es11.2,i4,l2,f9.4)', lines(k)%frequency, lines(k)%decay, lines(k)%energy, lines(k)%harmonic, &
            lines(k)%mains, lines(k)%frequency/strange%frequency(1)
      end do
      open (77, file='/tmp/dump.txt')
      write (77, '(2es25.16)') (strange%experiment%samples(k), &
      strange%experiment%measured(k), k=1, size(strange%experiment%samples))
      close (77)
      print *, 'guess', strange%model%structure%E/strange%truth%E, strange%model%structure%sensor(1)%m_S/strange%truth%sensor(1)%m_S
      if (.not. allocated(found)) return
      call fitted_modes(mesh_t(elements=8), found(1), 2, modes, error)
      do k = 1, 2
         print *, modes(k)%s, modes(k)%frequency, modes(k)%frequency/modes(1)%frequency
      end do
   end subroutine
end program
