!> Fleets: lists of case files, each of which is a member of an ensemble. A case that was fitted
!> before starts from its earlier estimates (a warm start). A case whose fingerprint has not changed
!> need not be fitted again.
module beamid_fleets
   use beamid_case_files, only: add_case, case_t
   use beamid_case_fits, only: add_mesh_shifts, case_fit_t, fail_if_rejected, fit_case, &
      judge_case, load_case
   use beamid_cases, only: needs_fit, read_case
   use beamid_ensemble_rows, only: add_fit_rows, row_t
   use beamid_ensembles, only: member_t
   use beamid_errors, only: bad_input, error_t, failure
   use beamid_files, only: read_text
   use beamid_fingerprints, only: fingerprint_length, fingerprint_t
   use beamid_interrupts, only: stop_flag
   use beamid_kinds, only: ip, wp
   use beamid_parameter_names, only: name_of_parameter
   use beamid_paths, only: directory_of, join_path
   use beamid_statistics, only: unlimited
   use beamid_texts, only: next_line
   use beamid_unknowns, only: name_of
   implicit none
   private

   public :: fleet_case_t, fleet_fit_t, read_fleet, run_fleet, open_fleet_case, moved

   !> One case of the list.
   type :: fleet_case_t
      character(len=:), allocatable :: name    !< path as written in the list
      character(len=:), allocatable :: path    !< path of the case file
      !> of the program's version, the case's text and every file that the case names
      character(len=fingerprint_length) :: fingerprint = ''
      type(row_t), allocatable :: before(:)    !< results of an earlier run; of size 0: none
      logical :: is_as_before = .false.        !< `before` belongs to the present fingerprint
      type(member_t) :: member                 !< result of this run
      character(len=:), allocatable, private :: program   !< version of the program
   end type fleet_case_t

   !> The fit of one case, from `open_fleet_case` to `judge_fleet_case`.
   type :: fleet_fit_t
      private
      type(case_t) :: case
      type(case_fit_t) :: found              !< records and fit
      type(error_t), allocatable :: error    !< first error of this case
      logical :: is_warm = .false.           !< start values are the estimates before
   end type fleet_fit_t

contains

   !> Reads a list of case files, and each case for its fingerprint.
   !>
   !> list     path of the list: one path of a case file in each line, relative to the folder of the
   !>          list; ! or # begins a comment
   !> program  version of the program, on which results depend as well
   !> fleet    the cases in the order of the list
   !> error    a list that cannot be read or is empty; errors of a case remain with the case
   subroutine read_fleet(list, program, fleet, error)
      character(len=*), intent(in) :: list, program
      type(fleet_case_t), allocatable, intent(out) :: fleet(:)
      type(error_t), allocatable, intent(out) :: error
      type(case_t) :: case
      type(error_t), allocatable :: ignored
      character(len=:), allocatable :: line, text
      integer(ip) :: first
      integer :: n, pass

      call read_text(list, text, error)
      if (allocated(error)) return
      do pass = 1, 2
         first = 1
         n = 0
         do while (next_line(text, first, line))
            if (len(line) > 0) line = trim(adjustl(line(:scan(line//'!', '!#'//achar(13)) - 1)))
            if (line == '') cycle
            n = n + 1
            if (pass == 1) cycle
            fleet(n)%name = line
            fleet(n)%path = join_path(directory_of(list), line)
            fleet(n)%program = program
            allocate (fleet(n)%before(0))
            call read_case(fleet(n)%path, needs_fit, case, ignored)
            call set_fingerprint(fleet(n), case)
         end do
         if (n == 0) call bad_input(error, list//': found no path of a case, expected one a line')
         if (allocated(error)) return
         if (pass == 1) allocate (fleet(n))
      end do
   end subroutine read_fleet

   !> Fits a block of listed cases; those with earlier results of the same files keep them. Only the
   !> fits run in parallel: the procedures that read and judge the cases have functions that return
   !> text.
   !>
   !> fleet    the block; on return with the component `member`
   !> members  (size of fleet) copies of this component
   !> error    a file has changed since the fingerprint of the fleet was taken
   subroutine run_fleet(fleet, members, error)
      type(fleet_case_t), intent(inout) :: fleet(:)
      type(member_t), intent(inout) :: members(:)
      type(error_t), allocatable, intent(out) :: error
      character(len=fingerprint_length), allocatable :: expected(:)
      type(fleet_fit_t), allocatable :: fits(:)
      integer, allocatable :: new(:)   ! places of the cases that have to be fitted
      integer :: k

      expected = fleet%fingerprint
      new = pack([(k, k=1, size(fleet))], .not. fleet%is_as_before)
      allocate (fits(size(new)))
      do k = 1, size(new)
         call open_fleet_case(fleet(new(k)), fits(k))
      end do
      !$omp parallel do schedule(dynamic, 1) copyin(stop_flag)
      do k = 1, size(new)
         call fit_fleet_case(fits(k))
      end do
      !$omp end parallel do
      do k = 1, size(new)
         call judge_fleet_case(fleet(new(k)), fits(k))
         if (fleet(new(k))%fingerprint /= expected(new(k))) call failure(error, &
            fleet(new(k))%path//': the case or a file that it names has changed since this run '// &
            'began; run it again')
      end do
      do k = 1, size(fleet)
         if (fleet(k)%is_as_before) fleet(k)%member%rows = fleet(k)%before
         members(k) = fleet(k)%member
      end do
   end subroutine run_fleet

   !> Reads a case and its records, and sets its start values to the estimates before, if any.
   !>
   !> The fingerprint is computed after all files have been read: if it still equals that of the
   !> list, no file has changed in between.
   !>
   !> fit       on return ready for `fit_fleet_case`
   !> declared  .true.: use the start values of the case all the same; default .false.
   subroutine open_fleet_case(one, fit, declared)
      type(fleet_case_t), intent(inout) :: one
      type(fleet_fit_t), intent(out) :: fit
      logical, intent(in), optional :: declared

      call read_case(one%path, needs_fit, fit%case, fit%error)
      if (.not. allocated(fit%error)) call load_case(fit%case, fit%found, fit%error)
      call set_fingerprint(one, fit%case)
      if (allocated(fit%error)) return
      fit%case%windows = 0
      if (present(declared)) then
         if (declared) return
      end if
      call start_from(one%before, fit%case, fit%is_warm)
   end subroutine open_fleet_case

   !> Sets the fingerprint of a case that has been read.
   subroutine set_fingerprint(one, case)
      type(fleet_case_t), intent(inout) :: one
      type(case_t), intent(in) :: case
      type(fingerprint_t) :: fingerprint

      call fingerprint%add(one%program)
      call add_case(fingerprint, case)
      one%fingerprint = fingerprint%digits()
   end subroutine set_fingerprint

   !> Sets the start values of each stage whose parameters all have estimates to these estimates.
   !>
   !> rows     results of an earlier run; of several meshes the last one counts
   !> case     on return without multiple starts if any stage has got such start values
   !> is_warm  whether any stage has got such start values
   subroutine start_from(rows, case, is_warm)
      type(row_t), intent(in) :: rows(:)
      type(case_t), intent(inout) :: case
      logical, intent(out) :: is_warm
      real(wp), allocatable :: start(:)
      integer :: j, k, s

      is_warm = .false.
      do s = 1, size(case%stages)
         associate (stage => case%stages(s))
            call stage%set_bounds()
            if (.not. allocated(stage%record)) stage%record = stage%owners()
            start = [(unlimited, k=1, size(stage%free))]
            do k = 1, size(start)
               do j = 1, size(rows)
                  if (rows(j)%parameter == name_of(name_of_parameter(case%model%structure, &
                     stage%free(k)), stage%record(k))) start(k) = rows(j)%estimate
               end do
            end do
            if (size(start) == 0 .or. any(start >= unlimited)) cycle
            stage%start = min(max(start, stage%lower), stage%upper)
            stage%automatic = .false.
            is_warm = .true.
         end associate
      end do
      if (is_warm) case%multistart%n = 0
   end subroutine start_from

   !> Fits a case after `open_fleet_case` has read it. May run beside other threads.
   subroutine fit_fleet_case(fit)
      type(fleet_fit_t), intent(inout) :: fit

      if (allocated(fit%error)) return
      call fit_case(fit%case, fit%found, fit%error, check=.false.)
      if (.not. allocated(fit%error)) call add_mesh_shifts(fit%case, fit%found, fit%error)
   end subroutine fit_fleet_case

   !> Judges the fit of a case and stores the result in `member`. If a warm start has led to no
   !> valid fit, fits again from the start values of the case.
   subroutine judge_fleet_case(one, fit)
      type(fleet_case_t), intent(inout) :: one
      type(fleet_fit_t), intent(inout) :: fit
      integer :: k

      call judge()
      if (allocated(fit%error) .and. fit%is_warm) then
         call open_fleet_case(one, fit, declared=.true.)
         call fit_fleet_case(fit)
         call judge()
      end if
      one%member = member_t()
      allocate (one%member%rows(0))
      if (allocated(fit%error)) then
         one%member%message = fit%error%message
      else
         do k = 1, size(fit%case%meshes)
            call add_fit_rows(fit%found%fits(size(fit%found%fits, 1), k), &
               fit%found%experiments, one%member%rows)
         end do
      end if

   contains

      !> Sets the error of the case if the verdict rejects the fit.
      subroutine judge()
         if (.not. allocated(fit%error)) call judge_case(fit%case, fit%found, fit%error)
         call fail_if_rejected(fit%case, fit%found, fit%error)
      end subroutine judge

   end subroutine judge_fleet_case

   !> Returns whether a parameter has moved by more than the root of the sum of squares of the two
   !> half widths that face each other.
   !>
   !> before, now  rows of the same parameter, of two runs; .false. if either interval is unlimited
   pure logical function moved(before, now)
      type(row_t), intent(in) :: before, now
      type(row_t) :: lower, upper

      moved = .false.
      if (any(abs([before%total, now%total]) >= unlimited)) return
      lower = before
      upper = now
      if (before%estimate > now%estimate) lower = now
      if (before%estimate > now%estimate) upper = before
      moved = upper%estimate - lower%estimate > hypot(lower%total(2) - lower%estimate, &
         upper%estimate - upper%total(1))
   end function moved

end module beamid_fleets
