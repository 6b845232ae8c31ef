!> Refuses models that cannot have caused their record.
module beamid_frequency_checks
   use beamid_errors, only: bad_input, error_t
   use beamid_kinds, only: two_pi, wp
   use beamid_model_roots, only: model_roots
   use beamid_residuals, only: residual_t
   use beamid_spectra, only: strongest_peak
   use beamid_strings, only: rounded, to_text
   implicit none
   private

   public :: check_frequencies

contains

   !> Refuses a model whose frequencies are far from those of its record, as after a slip in the
   !> units.
   subroutine check_frequencies(problem, error)
      type(residual_t), intent(inout) :: problem
      type(error_t), allocatable, intent(out) :: error
      real(wp), parameter :: too_far = 20
      complex(wp), allocatable :: s(:), none(:, :)
      real(wp), allocatable :: t(:)
      real(wp) :: share, strongest, low, high
      integer :: r

      problem%free = [integer ::]
      problem%record = [integer ::]
      do r = 1, size(problem%parts)
         t = problem%parts(r)%observed%times()
         if (problem%scenario%excitations(r)%modes == 0 .or. size(t) < 50) cycle
         s = spread((0.0_wp, 0.0_wp), 1, problem%scenario%excitations(r)%modes)
         allocate (none(size(s), 0))
         call model_roots(problem, problem%scenario, r, s, none, error)
         if (allocated(error)) return
         deallocate (none)
         low = aimag(s(1))/two_pi
         high = aimag(s(size(s)))/two_pi
         call strongest_peak(t, problem%parts(r)%observed%measured, 5*high, strongest, share)
         if (share > 0.05_wp .and. strongest*too_far > low) cycle
         if (.not. strongest > 0) then
            call bad_input(error, 'record '//to_text(r)//': found no spectral line above the '// &
               'noise up to '//rounded(5*high, 3)//', five times the highest natural frequency '// &
               'of the model; expected vibrations of the beam: check whether value_column '// &
               'names the right column, and the units of the case')
            return
         end if
         call bad_input(error, 'record '//to_text(r)//': found almost no '// &
            'vibration near the natural frequencies of the model, '//to_text(low)//' to '// &
            to_text(high)//'; expected consistent units in the case and the record')
         return
      end do
   end subroutine check_frequencies

end module beamid_frequency_checks
