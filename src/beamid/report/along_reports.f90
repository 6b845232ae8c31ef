!> Reports of the fields E(x) and c_D(x) that a fit has estimated: the table along.csv for other
!> programs, and a short table with remarks in the summary.
module beamid_along_reports
   use beamid_case_files, only: case_t
   use beamid_field_bands, only: band, field_band_t, varies
   use beamid_field_penalties, only: fields
   use beamid_identification, only: stage_fit_t
   use beamid_kinds, only: wp
   use beamid_lines, only: columns, csv_row, unit_suffix
   use beamid_outputs, only: output_t
   use beamid_statistics, only: unlimited
   use beamid_strings, only: full, rounded, to_text
   use beamid_structure, only: most_coefficients, of_c_D, of_E
   use beamid_texts, only: right, text_t
   use beamid_units, only: units_t
   implicit none
   private

   public :: add_along_table, add_along, add_smoothing

   !> (fields) names and parameters of the fields, in the order of `beamid_residuals`.
   character(len=3), parameter :: names(fields) = [character(len=3) :: 'E', 'c_D']
   integer, parameter :: parameters(fields) = [of_E, of_c_D]
   !> Numbers of places along the beam in the table, and in the summary.
   integer, parameter :: points = 101, shown = 11

contains

   !> Adds along.csv, with the last stage on every mesh, if any property varies along the beam.
   !>
   !> fits  (meshes) fits of the last stage
   subroutine add_along_table(output, units, fits)
      type(output_t), intent(inout) :: output
      type(units_t), intent(in) :: units
      type(stage_fit_t), intent(in) :: fits(:)
      type(text_t) :: table
      type(field_band_t) :: found
      integer :: a, k, mesh
      logical :: any_rows

      any_rows = .false.
      call table%line('elements,parameter,x,value,lower95,upper95,start,resolution,unit')
      do mesh = 1, size(fits)
         do a = 1, fields
            if (.not. varies(fits(mesh)%scenario%structures(1), a)) cycle
            any_rows = .true.
            found = band(fits(mesh), a, points)
            do k = 1, points
               call table%line(csv_row(to_text(fits(mesh)%elements)//','//trim(names(a)), &
                  [found%x(k), found%value(k)])//band_ends(found, k)// &
                  start_and_resolution(found, k)//','// &
                  units%of_quantity(parameters(a), fits(mesh)%scenario%excitations(1)))
            end do
         end do
      end do
      if (any_rows) call output%add('along.csv', table%content())
   end subroutine add_along_table

   !> Returns both ends of the 95 % band at place k as fields; empty if the band is not known.
   function band_ends(found, k) result(fields)
      type(field_band_t), intent(in) :: found
      integer, intent(in) :: k
      character(len=:), allocatable :: fields

      fields = ',,'
      if (.not. found%is_estimate .or. .not. allocated(found%half_width)) return
      fields = csv_row('', [found%lower(k)])//',inf'
      if (found%upper(k) < unlimited) fields = csv_row('', [found%lower(k), found%upper(k)])
   end function band_ends

   !> Returns the start value and the resolution [length] at place k as fields; empty if not known.
   function start_and_resolution(found, k) result(fields)
      type(field_band_t), intent(in) :: found
      integer, intent(in) :: k
      character(len=:), allocatable :: fields

      fields = ','
      if (found%is_estimate) fields = csv_row('', [found%start(k)])
      fields = fields//','
      if (allocated(found%resolution)) fields = fields//full(found%resolution(k))
   end function start_and_resolution

   !> Adds a short table of each field that a stage has estimated, and remarks on its limits.
   subroutine add_along(text, case, fit)
      type(text_t), intent(inout) :: text
      type(case_t), intent(in) :: case
      type(stage_fit_t), intent(in) :: fit
      type(field_band_t) :: found
      integer :: a

      do a = 1, fields
         if (.not. varies(fit%scenario%structures(1), a)) cycle
         found = band(fit, a, points)
         if (.not. (found%is_estimate .and. allocated(found%half_width))) cycle
         call text%line()
         call add_band(text, case, fit, found, a)
         call add_limits_of_record(text, case, found, trim(names(a))//'(x)')
         if (fit%is_too_coarse(a)) call add_coarseness(text, fit, a)
      end do
   end subroutine add_along

   !> Adds the remark that field a has too few coefficients to follow the record.
   subroutine add_coarseness(text, fit, a)
      type(text_t), intent(inout) :: text
      type(stage_fit_t), intent(in) :: fit
      integer, intent(in) :: a
      character(len=:), allocatable :: line

      associate (n => size(fit%fields(a)%place))
         line = 'the residuals are not white, and '//to_text(n)//' coefficients of '// &
            trim(names(a))//'(x) are too few to follow the record: the field has no band, do '// &
            'not trust it; '
         if (n < most_coefficients) line = line//'try coefficients='// &
            to_text(min(2*n, most_coefficients))//', or '
         line = line//'look for other errors of the model'
      end associate
      call text%line(line)
   end subroutine add_coarseness

   !> Adds the short table of field a: place, value, 95 % band and resolution.
   subroutine add_band(text, case, fit, found, a)
      type(text_t), intent(inout) :: text
      type(case_t), intent(in) :: case
      type(stage_fit_t), intent(in) :: fit
      type(field_band_t), intent(in) :: found
      integer, intent(in) :: a
      character(len=:), allocatable :: line, unit, length
      logical :: resolves
      integer :: j, k

      resolves = allocated(found%resolution)
      unit = case%units%of_quantity(parameters(a), fit%scenario%excitations(1))
      length = case%units%length
      line = right('x', 10)//right(trim(names(a))//'(x)')//right('95 % band from')//right('to')
      if (resolves) line = line//right('averages over', 16)
      call text%line(line)
      line = right(length, 10)//right(unit)//right(unit)//right(unit)
      if (resolves) line = line//right(length, 16)
      if (unit//length /= '') call text%line(line)
      do j = 1, shown
         k = 1 + (j - 1)*(points - 1)/(shown - 1)
         line = right(to_text(found%x(k)), 10)//columns(found%value(k:k), 14)
         if (found%upper(k) < unlimited) then
            line = line//columns([found%lower(k), found%upper(k)], 14)
         else
            line = line//right('unlimited')//right('-')
         end if
         if (resolves) line = line//right(rounded(found%resolution(k), 3), 16)
         call text%line(line)
      end do
   end subroutine add_band

   !> Adds remarks on the parts of the beam where the fit resolves no short variation of a field, or
   !> where the field is not determined to within 50 %.
   !>
   !> name  of the field, 'E(x)' or 'c_D(x)'
   subroutine add_limits_of_record(text, case, found, name)
      type(text_t), intent(inout) :: text
      type(case_t), intent(in) :: case
      type(field_band_t), intent(in) :: found
      character(len=*), intent(in) :: name
      !> The resolution is poor above so many times the spacing of the coefficients; the field is
      !> not determined if the half width of the band of its logarithm is larger than this.
      real(wp), parameter :: coarse = 3, wide = log(1.5_wp)
      logical :: poor(size(found%x))
      character(len=:), allocatable :: unit
      integer :: first, last

      unit = unit_suffix(case%units%length)
      if (allocated(found%resolution)) then
         poor = found%resolution > coarse*found%spacing
         last = 0
         do while (next_range(poor, last, first))
            call text%line('the fit does not resolve variations of '//name// &
               ' shorter than '//rounded(minval(found%resolution(first:last)), 3)//unit//' '// &
               range_in_words(first, last))
         end do
      end if
      poor = found%half_width > wide
      last = 0
      do while (next_range(poor, last, first))
         call text%line(name//' is not determined to within 50 % '//range_in_words(first, last))
      end do

   contains

      !> Returns the range between two places, given by their rows, in words.
      function range_in_words(first, last) result(words)
         integer, intent(in) :: first, last
         character(len=:), allocatable :: words

         if (first == 1 .and. last == size(found%x)) then
            words = 'anywhere along the beam'
         else if (last == size(found%x)) then
            words = 'beyond x = '//rounded(found%x(first), 3)//unit
         else
            words = 'between x = '//rounded(found%x(first), 3)//' and '// &
               rounded(found%x(last), 3)//unit
         end if
      end function range_in_words

   end subroutine add_limits_of_record

   !> Finds the next range of marked places.
   !>
   !> last   on entry the end of the range before, 0 for the first call; on return that of this
   !>        range
   !> there  whether there is another range
   logical function next_range(marked, last, first) result(there)
      logical, intent(in) :: marked(:)
      integer, intent(inout) :: last
      integer, intent(inout) :: first

      there = any(marked(last + 1:))
      if (.not. there) return
      first = last + findloc(marked(last + 1:), .true., dim=1)
      last = first - 2 + findloc([marked(first:), .false.], .false., dim=1)
   end function next_range

   !> Adds the smoothing of each estimated field, and the results that other smoothing strengths
   !> would give.
   subroutine add_smoothing(text, fit)
      type(text_t), intent(inout) :: text
      type(stage_fit_t), intent(in) :: fit
      character(len=:), allocatable :: name, line
      !> Every second point of the curve is shown.
      integer, parameter :: every = 2
      integer :: a, k, middle

      do a = 1, fields
         if (.not. allocated(fit%fields(a)%place)) cycle
         name = trim(names(a))//'(x)'
         associate (found => fit%fields(a)%smoothing)
            call text%line()
            line = ' by restricted marginal likelihood; '
            if (found%bounded) line = ', the least that is allowed; '
            call text%line(name//': strength of the smoothing '//to_text(found%strength)// &
               line//rounded(found%freedom, 3)//' effective degrees of freedom of '// &
               to_text(size(fit%fields(a)%place))//' coefficients')
            if (found%at_end > 0) call text%line('the record shows no variation of '// &
               trim(names(a))//' along the beam')
            if (found%at_end < 0 .and. .not. found%bounded) call text%line( &
               'the likelihood is largest without any smoothing of '//name)
            if (found%bounded) call text%line('restricted marginal likelihood prefers less '// &
               'smoothing, with neighbouring coefficients that differ by more than 25 %')
            if (abs(log(found%asked/found%strength)) > log(2.0_wp)) call text%line( &
               'the strength of the smoothing is uncertain: two strengths do equally well, and '// &
               'the likelihood linearised about this fit is largest at '//to_text(found%asked))
            if (found%at_end /= 0) cycle
            call text%line('other strengths, for the problem linearised about this fit:')
            call text%line(right('strength')//right('squares')//right('roughness')// &
               right('freedom')//right('score - best'))
            middle = (size(found%curve) + 1)/2
            do k = 1 + mod(middle - 1, every), size(found%curve), every
               associate (point => found%curve(k))
                  line = columns([point%strength, point%misfit, point%roughness], 14)// &
                     columns([point%freedom, point%score - found%curve(middle)%score], 14, '#.2')
               end associate
               if (k == middle) line = line//'  chosen'
               call text%line(line)
            end do
         end associate
      end do
   end subroutine add_smoothing

end module beamid_along_reports
