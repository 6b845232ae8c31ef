!> Computations of Section 4 of the paper: six models of one record, fitted as the text describes,
!> evaluated at our estimates and at the paper's.
module beamid_section_4_results
   use beamid
   use beamid_cases, only: scored_samples
   use beamid_csv, only: column_length, read_columns
   use beamid_errors, only: bad_input, locate
   use beamid_identification, only: score_fits
   use beamid_paths, only: join_path
   use beamid_profiles, only: difference_bound, squared_distance, sum_of_squares
   use beamid_strings, only: to_text
   implicit none
   private

   public :: entry_t, results_t, search_t, compute_section_4, first_bending, basis, table_4_2, &
      table_4_3, table_4_4, table_4_5, table_4_6

   !> Indices of the models.
   integer, parameter :: basis = 1, table_4_2 = 2, table_4_3 = 3, table_4_4 = 4, table_4_5 = 5, &
      table_4_6 = 6

   !> Names of the models, and their case files.
   character(len=*), parameter, public :: model_names(6) = [character(len=7) :: 'no_hose', &
      '4.2', '4.3', '4.4', '4.5', '4.6']
   character(len=*), parameter :: case_files(6) = [character(len=17) :: 'rpl_no_hose.nml', &
      'rpl_table_4_2.nml', 'rpl_table_4_3.nml', 'rpl_table_4_4.nml', 'rpl_table_4_5.nml', &
      'rpl_table_4_6.nml']

   !> Columns of data/paper/section_4.csv between the table's number and the sum.
   character(len=*), parameter :: parameters(6) = [character(len=3) :: 'm_T', 'E', 'c_D', 'm_H', &
      'c_H', 'k_H']

   !> Number of natural frequencies that are computed.
   integer, parameter :: modes = 3

   !> One model of the record. "Sum" is the sum of squared residuals over t = 0 to 5 s, J that over
   !> the samples of the fits.
   type :: entry_t
      character(len=:), allocatable :: name           !< number of the table, or 'no_hose'
      logical :: wanted = .true.                      !< whether the report contains the model
      !> (stages, 1) fits of the stages; of size 0: nothing is fitted
      type(stage_fit_t), allocatable :: fits(:, :)
      type(structure_t) :: ours, paper                !< with our estimates, with the paper's
      real(wp) :: printed_sum = 0                     !< sum as printed in the paper
      real(wp) :: our_sum = 0, sum_at_paper = 0       !< sum at our estimates, at the paper's
      real(wp) :: our_J = 0, J_at_paper = 0           !< J at our estimates, at the paper's
      real(wp), allocatable :: response(:)            !< at the paper's estimates, t = 0 to 5 by .1
      real(wp) :: distance2 = 0                       !< squared distance to Table 4.4's response
      real(wp) :: bound = 0                           !< as by `difference_bound`
      real(wp), allocatable :: curve(:)               !< at our estimates, over the whole record
      !> undamped natural frequencies at our estimates and at the paper's [Hz]
      real(wp) :: our_frequencies(modes) = 0, paper_frequencies(modes) = 0
   end type entry_t

   !> Where a search that starts at the paper's estimates has ended.
   type :: search_t
      integer, allocatable :: free(:)         !< (n) numbers of the free parameters
      real(wp), allocatable :: estimate(:)    !< (n) estimates
      real(wp) :: J = 0                       !< J at the estimates
      real(wp) :: m_H = 0                     !< estimate of m_H
   end type search_t

   !> All results of Section 4. Times in s, accelerations in ft/s**2.
   type :: results_t
      type(entry_t), allocatable :: entries(:)           !< the six models
      real(wp), allocatable :: samples(:), measured(:)   !< record for the fits, t = 3 to 5 by .1
      real(wp), allocatable :: scored(:), expected(:)    !< record for the sums, t = 0 to 5 by .1
      real(wp), allocatable :: t(:), z(:)                !< the whole record
      !> (4, places) m_H, c_H, k_H and J of the fits of c_H and k_H with c_D = 0, along m_H
      real(wp), allocatable :: valley(:, :)
      integer, allocatable :: bottoms(:)                 !< indices of the local minima of J in it
      type(search_t) :: from_4_3                         !< m_H, c_H, k_H from the paper's Table 4.3
      type(search_t) :: from_4_4                         !< all four from the paper's Table 4.4
      type(search_t) :: from_4_4_undamped                !< m_H, c_H, k_H from there with c_D = 0
      real(wp) :: J_without_c_D = 0                      !< J at the paper's Table 4.4, c_D = 0
      !> squared distance of the responses at the paper's Table 4.4 with c_D and with c_D = 0
      real(wp) :: distance2_without_c_D = 0
   end type results_t

contains

   !> Reads cases, record and the paper's numbers, and computes all results but those of the valley.
   !>
   !> data     folder of the case files
   !> cases    (models) on return as read; the structures of their models are replaced
   !> error    a file that cannot be read, or a computation that fails
   !> monitor  is told of every iteration of the fits that the text describes
   subroutine compute_section_4(data, cases, results, error, monitor)
      character(len=*), intent(in) :: data
      type(case_t), intent(inout) :: cases(:)
      type(results_t), intent(inout) :: results
      type(error_t), allocatable, intent(out) :: error
      class(monitor_t), intent(inout) :: monitor
      integer :: k

      allocate (results%entries(size(cases)))
      do k = 1, size(cases)
         results%entries(k)%name = trim(model_names(k))
         call read_case(join_path(data, trim(case_files(k))), merge(needs_response, needs_fit, &
            k == basis .or. k == table_4_5), cases(k), error)
         if (allocated(error)) return
      end do
      call read_paper(join_path(data, 'paper/section_4.csv'), cases, results%entries, error)
      if (allocated(error)) return
      associate (case => cases(table_4_2))
         call measured_samples(case, results%samples, results%measured, error)
         if (.not. allocated(error)) call scored_samples(case, results%scored, results%expected, &
            error)
         if (.not. allocated(error)) call read_record(case%recordings(1), results%t, &
            results%z, error)
      end associate
      if (allocated(error)) return
      do k = 1, size(cases)
         call compute_entry(cases(k), results, results%entries(k), monitor, error)
         call locate(error, cases(k)%path)
         if (allocated(error)) return
      end do
      ! These numbers are independent of the record, except the printed sum of Table 4.4 in the
      ! bound.
      do k = 1, size(results%entries)
         associate (e => results%entries(k), four => results%entries(table_4_4))
            e%distance2 = squared_distance(e%response, four%response)
            e%bound = difference_bound(four%printed_sum, e%distance2)
         end associate
      end do
   end subroutine compute_section_4

   !> Reads the paper's parameters and sums, one row per model.
   !>
   !> path     of data/paper/section_4.csv
   !> entries  on return with `paper` and `printed_sum`
   !> error    a file that cannot be read, or that has other tables
   subroutine read_paper(path, cases, entries, error)
      character(len=*), intent(in) :: path
      type(case_t), intent(in) :: cases(:)
      type(entry_t), intent(inout) :: entries(:)
      type(error_t), allocatable, intent(out) :: error
      real(wp), parameter :: tables(6) = [4.0_wp, 4.2_wp, 4.3_wp, 4.4_wp, 4.5_wp, 4.6_wp]
      character(len=column_length), allocatable :: header(:)
      real(wp), allocatable :: values(:, :)
      integer :: k, j

      call read_columns(path, size(parameters) + 2, values, header, error)
      if (allocated(error)) return
      if (size(values, 2) /= size(tables)) then
         call bad_input(error, path//': found '//to_text(size(values, 2))//' rows, expected '// &
            to_text(size(tables)))
         return
      else if (any(nint(10*values(1, :)) /= nint(10*tables))) then
         call bad_input(error, path//': found other tables, expected 4, 4.2, 4.3, 4.4, 4.5, 4.6')
         return
      end if
      do k = 1, size(entries)
         entries(k)%paper = cases(k)%model%structure
         do j = 1, size(parameters)
            call entries(k)%paper%set(free_index(parameters(j)), values(j + 1, k))
         end do
         entries(k)%printed_sum = values(size(parameters) + 2, k)
      end do
   end subroutine read_paper

   !> Fits the stages of one model, if it has any, and computes sums, responses and frequencies at
   !> our estimates and at the paper's.
   !>
   !> case  the structure of its model is replaced
   subroutine compute_entry(case, results, entry, monitor, error)
      type(case_t), intent(inout) :: case
      type(results_t), intent(in) :: results
      type(entry_t), intent(inout) :: entry
      class(monitor_t), intent(inout) :: monitor
      type(error_t), allocatable, intent(out) :: error

      if (size(case%stages) > 0) then
         call identify_meshes(case%model, case%meshes(:1), case%stages, results%samples, &
            results%measured, entry%fits, error, monitor)
         if (.not. allocated(error)) call score_fits(case%model, case%meshes(:1), &
            results%scored, results%expected, entry%fits, error)
         if (allocated(error)) return
         entry%ours = entry%fits(size(entry%fits), 1)%scenario%structures(1)
      else
         allocate (entry%fits(0, 1))
         entry%ours = case%model%structure
      end if
      call evaluate_at(entry%paper, results%scored, entry%response, entry%sum_at_paper, &
         entry%J_at_paper, entry%paper_frequencies)
      if (.not. allocated(error)) call evaluate_at(entry%ours, results%t, entry%curve, &
         entry%our_sum, entry%our_J, entry%our_frequencies)

   contains

      !> Evaluates the model with the parameters of a structure.
      !>
      !> times         (m) of the response [s]
      !> acceleration  (m) response [ft/s**2]
      !> total         sum of squared residuals over t = 0 to 5 s
      !> J             sum of squared residuals over the samples of the fits
      !> hertz         lowest undamped natural frequencies [Hz]
      subroutine evaluate_at(structure, times, acceleration, total, J, hertz)
         type(structure_t), intent(in) :: structure
         real(wp), intent(in) :: times(:)
         real(wp), allocatable, intent(out) :: acceleration(:)
         real(wp), intent(out) :: total, J, hertz(:)
         real(wp), parameter :: two_pi = 8*atan(1.0_wp)
         type(simulation_t) :: simulation
         type(galerkin_t), target :: galerkin
         real(wp), allocatable :: omega(:), shapes(:, :)

         case%model%structure = structure
         associate (model => case%model, mesh => case%meshes(1))
            call simulate(model, mesh, times, simulation, error)
            if (.not. allocated(error)) call sum_of_squares(model, mesh, results%scored, &
               results%expected, total, error)
            if (.not. allocated(error)) call sum_of_squares(model, mesh, results%samples, &
               results%measured, J, error)
            if (allocated(error)) return
            galerkin = galerkin_of(mesh, structure)
         end associate
         call undamped_modes(new_equations(galerkin, structure, case%model%excitation), omega, &
            shapes, error)
         if (allocated(error)) return
         acceleration = simulation%acceleration
         hertz = omega(:size(hertz))/two_pi
      end subroutine evaluate_at

   end subroutine compute_entry

   !> Returns the number of the beam's first bending mode. A hose as soft as here has its own mode
   !> before it.
   elemental integer function first_bending(entry)
      type(entry_t), intent(in) :: entry

      first_bending = merge(2, 1, any(entry%paper%has_hose()))
   end function first_bending

end module beamid_section_4_results
