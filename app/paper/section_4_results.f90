!> Computations of Section 4 of the paper: six models of one record, fitted as the text describes,
!> evaluated at our estimates and at the paper's.
module beamid_section_4_results
   use beamid
   use beamid_cases, only: scored_samples
   use beamid_csv, only: column_length, read_columns
   use beamid_errors, only: bad_input, locate
   use beamid_identification, only: score_fits
   use beamid_paths, only: join_path
   use beamid_profiles, only: difference_bound, lowest_places, profile, squared_distance, &
      sum_of_squares
   use beamid_strings, only: to_text
   implicit none
   private

   public :: entry_t, results_t, compute_section_4, basis, table_4_2, table_4_3, table_4_4, &
      table_4_5, table_4_6, first_bending

   !> Indices of the models.
   integer, parameter :: basis = 1, table_4_2 = 2, table_4_3 = 3, table_4_4 = 4, table_4_5 = 5, &
      table_4_6 = 6

   !> Names of the models, and their case files.
   character(len=*), parameter :: model_names(6) = [character(len=7) :: 'no_hose', '4.2', '4.3', &
      '4.4', '4.5', '4.6']
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
      type(case_t) :: case
      type(stage_fit_t), allocatable :: fits(:)       !< (stages); of size 0: nothing is fitted
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

   !> All results of Section 4. Times in s, accelerations in ft/s**2.
   type :: results_t
      type(entry_t), allocatable :: entries(:)           !< the six models
      real(wp), allocatable :: samples(:), measured(:)   !< record for the fits, t = 3 to 5 by .1
      real(wp), allocatable :: scored(:), expected(:)    !< record for the sums, t = 0 to 5 by .1
      real(wp), allocatable :: t(:), z(:)                !< the whole record
      !> fits of c_H and k_H with c_D = 0, along m_H
      type(stage_fit_t), allocatable :: valley(:)
      integer, allocatable :: bottoms(:)                 !< indices of the local minima of J in it
      type(stage_fit_t) :: from_4_3                      !< m_H, c_H, k_H from the paper's Table 4.3
      type(stage_fit_t) :: from_4_4                      !< all four from the paper's Table 4.4
      type(stage_fit_t) :: from_4_4_undamped             !< m_H, c_H, k_H from there with c_D = 0
      real(wp) :: J_without_c_D = 0                      !< J at the paper's Table 4.4, c_D = 0
      !> squared distance of the responses at the paper's Table 4.4 with c_D and with c_D = 0
      real(wp) :: distance2_without_c_D = 0
   end type results_t

contains

   !> Reads cases, record and the paper's numbers, and computes all results.
   !>
   !> data     folder of the case files
   !> error    a file that cannot be read, or a computation that fails
   !> monitor  is told of every iteration of the fits that the text describes
   subroutine compute_section_4(data, results, error, monitor)
      character(len=*), intent(in) :: data
      type(results_t), intent(out) :: results
      type(error_t), allocatable, intent(out) :: error
      class(monitor_t), intent(inout) :: monitor
      integer :: k

      allocate (results%entries(size(model_names)))
      do k = 1, size(results%entries)
         results%entries(k)%name = trim(model_names(k))
         call read_case(join_path(data, trim(case_files(k))), merge(needs_response, needs_fit, &
            k == basis .or. k == table_4_5), results%entries(k)%case, error)
         if (allocated(error)) return
      end do
      call read_paper(join_path(data, 'paper/section_4.csv'), results%entries, error)
      if (allocated(error)) return
      associate (case => results%entries(table_4_2)%case)
         call measured_samples(case, results%samples, results%measured, error)
         if (.not. allocated(error)) call scored_samples(case, results%scored, results%expected, &
            error)
         if (.not. allocated(error)) call read_record(case%recordings(1), results%t, &
            results%z, error)
      end associate
      if (allocated(error)) return
      do k = 1, size(results%entries)
         call compute_entry(results%entries(k), results, monitor, error)
         call locate(error, results%entries(k)%case%path)
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
      call explore_valley(results, error)
      call locate(error, results%entries(table_4_4)%case%path)
   end subroutine compute_section_4

   !> Reads the paper's parameters and sums, one row per model.
   !>
   !> path     of data/paper/section_4.csv
   !> entries  on return with `paper` and `printed_sum`
   !> error    a file that cannot be read, or that has other tables
   subroutine read_paper(path, entries, error)
      character(len=*), intent(in) :: path
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
         entries(k)%paper = entries(k)%case%model%structure
         do j = 1, size(parameters)
            call entries(k)%paper%set(free_index(parameters(j)), values(j + 1, k))
         end do
         entries(k)%printed_sum = values(size(parameters) + 2, k)
      end do
   end subroutine read_paper

   !> Fits the stages of one model, if it has any, and computes sums, responses and frequencies at
   !> our estimates and at the paper's.
   subroutine compute_entry(entry, results, monitor, error)
      type(entry_t), intent(inout) :: entry
      type(results_t), intent(in) :: results
      class(monitor_t), intent(inout) :: monitor
      type(error_t), allocatable, intent(out) :: error
      type(stage_fit_t), allocatable :: fits(:, :)
      type(model_t) :: model

      model = entry%case%model
      entry%ours = model%structure
      allocate (entry%fits(0))
      if (size(entry%case%stages) > 0) then
         call identify_meshes(model, entry%case%meshes(:1), entry%case%stages, results%samples, &
            results%measured, fits, error, monitor)
         if (.not. allocated(error)) call score_fits(model, entry%case%meshes(:1), &
            results%scored, results%expected, fits, error)
         if (allocated(error)) return
         entry%fits = fits(:, 1)
         entry%ours = fits(size(fits, 1), 1)%scenario%structures(1)
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

         model%structure = structure
         associate (mesh => entry%case%meshes(1))
            call simulate(model, mesh, times, simulation, error)
            if (.not. allocated(error)) call sum_of_squares(model, mesh, results%scored, &
               results%expected, total, error)
            if (.not. allocated(error)) call sum_of_squares(model, mesh, results%samples, &
               results%measured, J, error)
            if (allocated(error)) return
            galerkin = new_galerkin(mesh, structure%length)
         end associate
         call undamped_modes(new_equations(galerkin, structure, model%excitation), omega, shapes, &
            error)
         if (allocated(error)) return
         acceleration = simulation%acceleration
         hertz = omega(:size(hertz))/two_pi
      end subroutine evaluate_at

   end subroutine compute_entry

   !> Returns the number of the beam's first bending mode. A hose as soft as here has its own mode
   !> before it.
   elemental integer function first_bending(entry)
      type(entry_t), intent(in) :: entry

      first_bending = merge(2, 1, entry%paper%has_hose())
   end function first_bending

   !> Computes J along m_H with c_D = 0, and fits that start at the paper's estimates.
   !>
   !> results  on return with `valley`, `bottoms` and all components after them
   !> error    a fit or a response that fails
   subroutine explore_valley(results, error)
      type(results_t), intent(inout) :: results
      type(error_t), allocatable, intent(out) :: error
      integer, parameter :: places = 27
      real(wp), parameter :: m_first = 0.03_wp, m_step = 0.005_wp
      type(model_t) :: model
      type(simulation_t) :: simulation
      type(stage_t) :: along
      integer :: k

      associate (case => results%entries(table_4_3)%case, &
         three => results%entries(table_4_3), four => results%entries(table_4_4))
         model = case%model
         model%structure = three%paper
         along%free = [free_index('c_H'), free_index('k_H')]
         along%lower = [0.0_wp, 0.0_wp]
         along%upper = [unbounded, unbounded]
         call profile(model, case%meshes(1), free_index('m_H'), [(m_first + k*m_step, k=0, &
            places - 1)], along, results%samples, results%measured, results%valley, error)
         if (allocated(error)) return
         results%bottoms = lowest_places([(results%valley(k)%fit%J, k=1, places)])

         call search_from(three%paper, case%stages, results%from_4_3)
         if (allocated(error)) return
         model%structure = four%paper
         model%structure%c_D = 0
         call sum_of_squares(model, case%meshes(1), results%samples, results%measured, &
            results%J_without_c_D, error)
         if (allocated(error)) return
         call simulate(model, case%meshes(1), results%scored, simulation, error)
         if (allocated(error)) return
         results%distance2_without_c_D = squared_distance(simulation%acceleration, four%response)
         call search_from(model%structure, case%stages, results%from_4_4_undamped)
         if (allocated(error)) return
         call search_from(four%paper, four%case%stages, results%from_4_4)
      end associate

   contains

      !> Fits the last of some stages, starting from the parameters of a structure.
      subroutine search_from(structure, stages, found)
         type(structure_t), intent(in) :: structure
         type(stage_t), intent(in) :: stages(:)
         type(stage_fit_t), intent(out) :: found
         type(model_t) :: start
         type(stage_t) :: stage(1)
         type(stage_fit_t), allocatable :: fits(:)

         stage(1) = stages(size(stages))
         if (allocated(stage(1)%start)) deallocate (stage(1)%start)
         start = results%entries(table_4_4)%case%model
         start%structure = structure
         call identify(start, results%entries(table_4_4)%case%meshes(1), stage, &
            results%samples, results%measured, fits, error)
         if (.not. allocated(error)) found = fits(1)
      end subroutine search_from

   end subroutine explore_valley

end module beamid_section_4_results
