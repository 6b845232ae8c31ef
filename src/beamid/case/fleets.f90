!> A fleet: a list of case files, each of which is a member of an ensemble. A case that was fitted
!> before may start from where it ended, and one that is as it was need not be fitted again.
module beamid_fleets
   use, intrinsic :: iso_fortran_env, only: int32
   use beamid_case_fits, only: add_mesh_shifts, case_fit_t, fit_case, judge_case, load_case
   use beamid_case_files, only: case_t
   use beamid_cases, only: needs_fit, read_case
   use beamid_ensembles, only: add_fit_rows, member_t, row_t
   use beamid_errors, only: bad_input, error_t, failure
   use beamid_experiments, only: experiment_t
   use beamid_files, only: read_text
   use beamid_kinds, only: ip, wp
   use beamid_manifests, only: crc32, hexadecimal
   use beamid_parameters, only: name_of_parameter
   use beamid_paths, only: directory_of, join_path
   use beamid_statistics, only: unlimited
   use beamid_unknowns, only: name_of
   implicit none
   private

   public :: fleet_case_t, read_fleet, fit_fleet_case, judge_fleet_case, moved, &
      open_fleet_case

   !> One case of the list.
   type :: fleet_case_t
      character(len=:), allocatable :: name    !< as in the list
      character(len=:), allocatable :: path
      !> of its text and samples; '': it cannot be read
      character(len=8) :: fingerprint = ''
      type(row_t), allocatable :: before(:)    !< what an earlier run has found; none
      logical :: is_as_before = .false.        !< that is of the same text and samples
      type(member_t) :: member                 !< what this run finds
      type(case_t), allocatable, private :: case         !< between `open` and `close`
      type(case_fit_t), allocatable, private :: found
      type(error_t), allocatable, private :: error
      logical, private :: is_warm = .false.
   end type fleet_case_t

   character(len=*), parameter :: line_feed = achar(10)

contains

   !> Reads the list, and the cases on it for their fingerprints.
   !>
   !> list  paths, relative to its folder, a line each; behind ! or # a comment
   subroutine read_fleet(list, fleet, error)
      character(len=*), intent(in) :: list
      type(fleet_case_t), allocatable, intent(out) :: fleet(:)
      type(error_t), allocatable, intent(out) :: error
      character(len=:), allocatable :: line, text
      integer(ip) :: first, length
      integer :: n, pass

      call read_text(list, text, error)
      if (allocated(error)) return
      text = text//line_feed
      do pass = 1, 2
         first = 1
         n = 0
         do while (first <= len(text, ip))
            length = scan(text(first:), line_feed, kind=ip) - 1
            line = text(first:first + length - 1)
            first = first + length + 1
            if (len(line) > 0) line = trim(adjustl(line(:scan(line//'!', '!#'//achar(13)) - 1)))
            if (line == '') cycle
            n = n + 1
            if (pass == 1) cycle
            fleet(n)%name = line
            fleet(n)%path = join_path(directory_of(list), line)
            allocate (fleet(n)%before(0))
            call open_fleet_case(fleet(n))
            call close_fleet_case(fleet(n))
         end do
         if (n == 0) call bad_input(error, list//': found no path of a case, expected one a line')
         if (allocated(error)) return
         if (pass == 1) allocate (fleet(n))
      end do
   end subroutine read_fleet

   !> Reads a case and its records; where there are estimates from before it starts from them.
   !>
   !> declared  .true.: from the declared start all the same
   subroutine open_fleet_case(one, declared)
      type(fleet_case_t), intent(inout) :: one
      logical, intent(in), optional :: declared

      call close_fleet_case(one)
      allocate (one%case, one%found)
      one%is_warm = .false.
      call read_case(one%path, needs_fit, one%case, one%error)
      if (.not. allocated(one%error)) call load_case(one%case, one%found, one%error)
      if (allocated(one%error)) return
      one%case%windows = 0
      one%fingerprint = fingerprint_of(one%case%text, one%found%experiments)
      if (present(declared)) then
         if (declared) return
      end if
      call start_from(one%before, one%case, one%is_warm)
   end subroutine open_fleet_case

   !> What it was fitted from is not needed any more.
   subroutine close_fleet_case(one)
      type(fleet_case_t), intent(inout) :: one

      if (allocated(one%case)) deallocate (one%case)
      if (allocated(one%found)) deallocate (one%found)
      if (allocated(one%error)) deallocate (one%error)
   end subroutine close_fleet_case

   !> Checksum of a case's text, its samples and its forces.
   function fingerprint_of(text, experiments) result(digits)
      character(len=*), intent(in) :: text
      type(experiment_t), intent(in) :: experiments(:)
      character(len=8) :: digits
      integer(int32) :: sum
      integer :: k

      sum = crc32(text, 0_int32)
      do k = 1, size(experiments)
         call add(experiments(k)%samples)
         call add(experiments(k)%measured)
         if (allocated(experiments(k)%excitation%t)) call add(experiments(k)%excitation%t)
         if (allocated(experiments(k)%excitation%f)) call add(experiments(k)%excitation%f)
      end do
      digits = hexadecimal(sum)

   contains

      subroutine add(values)
         real(wp), intent(in) :: values(:)
         integer, parameter :: n = 1024
         character(len=8*n) :: bytes
         integer :: first, last

         do first = 1, size(values), n
            last = min(first + n - 1, size(values))
            bytes = transfer(values(first:last), bytes)
            sum = crc32(bytes(:8*(last - first + 1)), sum)
         end do
      end subroutine add

   end function fingerprint_of

   !> Gives each stage whose parameters all have estimates these as its start.
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
               ! Of several meshes the last one counts.
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
      ! One start, that of the estimates.
      if (is_warm) case%multistart%n = 0
   end subroutine start_from

   !> Fits what was opened. In threads.
   subroutine fit_fleet_case(one)
      type(fleet_case_t), intent(inout) :: one

      if (allocated(one%error)) return
      call fit_case(one%case, one%found, one%error, check=.false.)
      if (.not. allocated(one%error)) call add_mesh_shifts(one%case, one%found)
   end subroutine fit_fleet_case

   !> Judges the fit and keeps what it has found. Where there is none from the estimates before, the
   !> declared start is tried.
   subroutine judge_fleet_case(one)
      type(fleet_case_t), intent(inout) :: one
      integer :: k

      call judge()
      if (allocated(one%error) .and. one%is_warm) then
         call open_fleet_case(one, declared=.true.)
         call fit_fleet_case(one)
         call judge()
      end if
      one%member = member_t()
      allocate (one%member%rows(0))
      if (allocated(one%error)) then
         one%member%message = one%error%message
      else
         do k = 1, size(one%case%meshes)
            call add_fit_rows(one%found%fits(size(one%found%fits, 1), k), &
               one%found%experiments, one%member%rows)
         end do
      end if
      call close_fleet_case(one)

   contains

      subroutine judge()
         if (.not. allocated(one%error)) call judge_case(one%case, one%found, one%error)
         if (allocated(one%error)) return
         if (one%found%verdict%no_fit /= '') call failure(one%error, one%path//': no fit: '// &
            one%found%verdict%no_fit)
      end subroutine judge

   end subroutine judge_fleet_case

   !> Whether a parameter is further from where it was than both intervals together explain.
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
