!> The table fit.csv: measured values, model and residuals of the last stage at every sample. Its
!> rows become text only while the file is written, because a record may have millions of samples.
module beamid_fit_curves
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use beamid_experiments, only: experiment_t
   use beamid_identification, only: stage_fit_t
   use beamid_kinds, only: wp
   use beamid_row_tables, only: row_table_t
   use beamid_statistics, only: unlimited
   use beamid_strings, only: full_length, put_full, to_text
   use beamid_texts, only: text_t
   implicit none
   private

   public :: new_fit_curves

   character(len=*), parameter, public :: fit_header = &
      'elements,t,measured,model,residual,record,model_sd'

   !> The fit on one mesh.
   type :: curve_t
      integer :: elements = 0               !< number of elements
      real(wp), allocatable :: residual(:)  !< (m) model - measured
      !> (m) standard deviation of the model's curve due to the errors of the estimates; of size 0:
      !> a parameter is not determined
      real(wp), allocatable :: sd(:)
   end type curve_t

   !> The fits on all meshes, one below the other. The residual in the table is measured - model, as
   !> in the paper.
   type, extends(row_table_t) :: fit_curves_t
      real(wp), allocatable :: t(:), measured(:)   !< (m) of all records
      integer, allocatable :: last(:)              !< (records) number of the last sample
      type(curve_t), allocatable :: curves(:)      !< (meshes)
   contains
      procedure :: add_rows
      procedure :: is_finite
   end type fit_curves_t

   !> Number of rows for which standard deviations are computed at once.
   integer, parameter :: block_rows = 512

contains

   !> Makes the table of some fits.
   !>
   !> fits  (meshes)
   subroutine new_fit_curves(fits, experiments, table)
      type(stage_fit_t), intent(in) :: fits(:)
      type(experiment_t), intent(in) :: experiments(:)
      class(row_table_t), allocatable, intent(out) :: table
      type(fit_curves_t), allocatable :: curves
      integer, allocatable :: row(:)   ! of a sample among all residuals
      integer :: before, i, k, m

      allocate (curves)
      associate (sizes => [(size(experiments(i)%samples), i=1, size(experiments))])
         curves%last = [(sum(sizes(:i)), i=1, size(sizes))]
         m = sum(sizes)
      end associate
      allocate (curves%t(m), curves%measured(m), curves%curves(size(fits)), row(m))
      before = 0
      do i = 1, size(experiments)
         associate (first => curves%last(i) - size(experiments(i)%samples) + 1, last => &
            curves%last(i))
            curves%t(first:last) = experiments(i)%samples
            curves%measured(first:last) = experiments(i)%measured(:last - first + 1)
            row(first:last) = before + [(k, k=1, last - first + 1)]
         end associate
         before = before + size(experiments(i)%measured)
      end do
      do k = 1, size(fits)
         curves%curves(k)%elements = fits(k)%elements
         curves%curves(k)%residual = fits(k)%residual(row)
         call find_sd(fits(k), row, curves%last, curves%curves(k)%sd)
      end do
      curves%rows = m*size(fits)
      call move_alloc(curves, table)
   end subroutine new_fit_curves

   !> Computes the standard deviations of a model's curve.
   !>
   !> row   (m) row of each sample in the Jacobian
   !> last  (records) number of the last sample
   !> sd    (m), or of size 0 if a parameter is not determined
   pure subroutine find_sd(fit, row, last, sd)
      type(stage_fit_t), intent(in) :: fit
      integer, intent(in) :: row(:), last(:)
      real(wp), allocatable, intent(out) :: sd(:)
      real(wp), allocatable :: covariance(:, :)
      real(wp) :: change(block_rows), variance(block_rows)
      integer :: first, i, j, k, n

      call get_covariance(fit, covariance)
      n = 0
      if (size(covariance) > 0 .and. size(last) > 0) n = last(size(last))
      allocate (sd(n))
      do first = 1, size(sd), block_rows
         n = min(block_rows, size(sd) - first + 1)
         variance = 0
         do j = 1, size(covariance, 2)
            change = 0
            do k = 1, size(covariance, 1)
               change(:n) = change(:n) + covariance(k, j)*fit%jacobian(row(first:first + n - 1), k)
            end do
            variance(:n) = variance(:n) + change(:n)*fit%jacobian(row(first:first + n - 1), j)
         end do
         sd(first:first + n - 1) = sqrt(max(0.0_wp, variance(:n)))
      end do
      if (size(sd) == 0) return
      first = 1
      do i = 1, size(last)
         sd(first:last(i)) = sd(first:last(i))/fit%weight(i)
         first = last(i) + 1
      end do
   end subroutine find_sd

   !> Computes the covariance of the estimates, corrected for the autocorrelation of the noise; of
   !> size 0 if it is not known.
   pure subroutine get_covariance(fit, covariance)
      type(stage_fit_t), intent(in) :: fit
      real(wp), allocatable, intent(out) :: covariance(:, :)
      integer :: j

      associate (s => fit%statistics)
         allocate (covariance(0, 0))
         if (s%samples == 0) return
         if (.not. all(s%corrected_error < unlimited .and. s%std_error > 0)) return
         covariance = s%covariance
         do j = 1, size(s%std_error)
            covariance(:, j) = covariance(:, j)*s%corrected_error/s%std_error &
               *s%corrected_error(j)/s%std_error(j)
         end do
      end associate
   end subroutine get_covariance

   !> Adds rows to a text. Arguments as of `row_table_t`.
   subroutine add_rows(self, first, last, text)
      class(fit_curves_t), intent(in) :: self
      integer, intent(in) :: first, last
      type(text_t), intent(inout) :: text
      character(len=7*full_length) :: row
      character(len=:), allocatable :: elements, record
      integer :: i, k, length, mesh, n

      i = 0
      do n = first, last
         mesh = (n - 1)/size(self%t) + 1
         k = n - (mesh - 1)*size(self%t)
         if (n == first .or. k == 1 .or. k > self%last(max(i, 1))) then
            i = findloc(self%last >= k, .true., dim=1)
            elements = to_text(self%curves(mesh)%elements)
            record = ','//to_text(i)
         end if
         associate (curve => self%curves(mesh))
            length = 0
            call put(elements)
            call put_number(self%t(k))
            call put_number(self%measured(k))
            call put_number(self%measured(k) + curve%residual(k))
            call put_number(-curve%residual(k))
            call put(record)
            if (size(curve%sd) > 0) then
               call put_number(curve%sd(k))
            else
               call put(',')
            end if
         end associate
         call put(new_line('a'))
         call text%add(row(:length))
      end do

   contains

      !> Appends a text to the row.
      subroutine put(part)
         character(len=*), intent(in) :: part

         row(length + 1:length + len(part)) = part
         length = length + len(part)
      end subroutine put

      !> Appends a comma and a number to the row.
      subroutine put_number(value)
         real(wp), intent(in) :: value
         integer :: digits

         row(length + 1:length + 1) = ','
         call put_full(value, row(length + 2:length + 1 + full_length), digits)
         length = length + 1 + digits
      end subroutine put_number

   end subroutine add_rows

   !> Returns whether all numbers of the table are finite.
   pure logical function is_finite(self)
      class(fit_curves_t), intent(in) :: self
      integer :: k

      is_finite = all(ieee_is_finite(self%t)) .and. all(ieee_is_finite(self%measured))
      do k = 1, size(self%curves)
         is_finite = is_finite .and. all(ieee_is_finite(self%curves(k)%residual)) .and. &
            all(ieee_is_finite(self%curves(k)%sd)) .and. &
            all(ieee_is_finite(self%measured + self%curves(k)%residual))
      end do
   end function is_finite

end module beamid_fit_curves
