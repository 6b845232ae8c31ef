!> Table 4.1 of the paper: four parameters from simulated accelerations.
module beamid_table_4_1
   use beamid
   use beamid_commands, only: add_fit_tables, deliver, settings_t
   use beamid_csv, only: column_length, read_columns
   use beamid_errors, only: bad_input
   use beamid_outputs, only: output_t
   use beamid_paper, only: find_data, percent
   use beamid_paths, only: join_path
   use beamid_strings, only: fixed, full, to_text
   use beamid_terminal, only: new_progress, progress_t
   use beamid_texts, only: right, text_t
   implicit none
   private

   public :: run_table_4_1

   !> Columns of the paper's Table 4.1: N, then the parameters of the fit in this order, then J.
   character(len=*), parameter :: columns(4) = [character(len=3) :: 'c_D', 'm_H', 'c_H', 'k_H']

   !> Table 4.1 as we compute it, with what the remarks below it need.
   type :: table_t
      type(case_t) :: truth, case
      real(wp), allocatable :: paper(:, :)              !< (6, meshes) rows of the paper's table
      real(wp), allocatable :: samples(:), measured(:)
      type(stage_fit_t), allocatable :: fits(:, :)      !< (1, meshes)
      real(wp) :: record_difference = 0                 !< record in data/ against a new computation
      real(wp) :: coarse_rule_J = 0                     !< N = 2, one panel of two Gauss points
      real(wp), allocatable :: exact_data_J(:)          !< exact accelerations as data
      logical :: exact = .false.                        !< responses exact in time, not by CVODE
   end type table_t

contains

   !> beamid reproduce table-4.1
   !>
   !> exact  by the exact response, whatever integrator the cases name; quick
   subroutine run_table_4_1(settings, error, exact)
      type(settings_t), intent(in) :: settings
      type(error_t), allocatable, intent(out) :: error
      logical, intent(in), optional :: exact
      type(table_t) :: table
      type(progress_t) :: progress
      type(output_t) :: output
      type(experiment_t) :: experiment
      character(len=:), allocatable :: data

      call find_data(data, error)
      if (allocated(error)) return
      call read_table(data, table, error)
      if (allocated(error)) return
      if (present(exact)) table%exact = exact
      if (table%exact) then
         call make_exact(table%case%model)
         call make_exact(table%truth%model)
      end if
      progress = new_progress(settings%quiet)
      associate (case => table%case)
         call identify_meshes(case%model, case%meshes, case%stages, table%samples, table%measured, &
            table%fits, error, progress)
      end associate
      if (.not. allocated(error)) call gather_evidence(table, error)
      call progress%finish()
      if (allocated(error)) then
         error%message = table%case%path//': '//error%message
         return
      end if
      experiment%samples = table%samples
      experiment%measured = table%measured
      call add_fit_tables(output, table%case, table%fits, [experiment])
      call output%add('truth.csv', truth_csv(table%truth%model%structure))
      call output%add('paper.csv', paper_csv(table%paper))
      call deliver(output, report(table), settings, 'table-4.1', error)
   end subroutine run_table_4_1

   !> Cases, record and the paper's table.
   subroutine read_table(data, table, error)
      character(len=*), intent(in) :: data
      type(table_t), intent(out) :: table
      type(error_t), allocatable, intent(out) :: error
      character(len=column_length), allocatable :: header(:)

      call read_case(join_path(data, 'table_4_1_truth.nml'), needs_response, table%truth, error)
      if (.not. allocated(error)) call read_case(join_path(data, 'table_4_1_fit.nml'), needs_fit, &
         table%case, error)
      if (.not. allocated(error)) call measured_samples(table%case, table%samples, table%measured, &
         error)
      if (.not. allocated(error)) call read_columns(join_path(data, 'paper/table_4_1.csv'), 6, &
         table%paper, header, error)
      if (allocated(error)) return
      if (size(table%paper, 2) /= size(table%case%meshes)) then
         call bad_input(error, 'paper/table_4_1.csv: found '//to_text(size(table%paper, 2))// &
            ' rows, expected one for each of the meshes')
      else if (any(nint(table%paper(1, :)) /= table%case%meshes%elements)) then
         call bad_input(error, &
            'paper/table_4_1.csv: found other numbers of elements than in the case')
      end if
   end subroutine read_table

   !> Responses exact in time.
   subroutine make_exact(model)
      type(model_t), intent(inout) :: model

      deallocate (model%solver)
      allocate (modal_t :: model%solver)
   end subroutine make_exact

   !> Runs what the remarks below the table speak of.
   subroutine gather_evidence(table, error)
      type(table_t), intent(inout) :: table
      type(error_t), allocatable, intent(out) :: error
      type(simulation_t) :: simulation
      type(stage_fit_t), allocatable :: fits(:, :)
      type(model_t) :: model
      type(mesh_t) :: mesh

      mesh = table%truth%meshes(size(table%truth%meshes))
      call simulate(table%truth%model, mesh, table%samples, simulation, error)
      if (allocated(error)) return
      table%record_difference = maxval(abs(simulation%acceleration - table%measured))

      ! The remarks rest on the exact response: quick, and without an integrator's noise.
      model = table%case%model
      call make_exact(model)
      mesh = table%case%meshes(1)
      mesh%gauss_points = 2
      mesh%panels = 1
      call identify_meshes(model, [mesh], table%case%stages, table%samples, table%measured, fits, &
         error)
      if (allocated(error)) return
      table%coarse_rule_J = fits(1, 1)%fit%J

      table%truth%model%observation = observation_t()
      call make_exact(table%truth%model)
      call simulate(table%truth%model, table%truth%meshes(1), table%samples, simulation, error)
      if (allocated(error)) return
      call identify_meshes(model, table%case%meshes, table%case%stages, table%samples, &
         simulation%acceleration, fits, error)
      if (allocated(error)) return
      table%exact_data_J = fits(1, :)%fit%J
   end subroutine gather_evidence

   !> The table, ours above the paper's, and the remarks.
   function report(table) result(content)
      type(table_t), intent(in) :: table
      character(len=:), allocatable :: content
      character(len=:), allocatable :: method
      type(text_t) :: text
      integer :: k

      method = 'CVODE and lmdif'
      if (table%exact) method = 'exact responses and lmder'
      call text%line('Table 4.1 of NASA CR-178199: simulated data, '// &
         to_text(size(table%samples))// &
         ' samples, cubic splines, '//method)
      call text%line('c_D stands for c_D I (I = 1). J is the sum of squared residuals; '// &
         'see remark 1 for 16 J.')
      call text%line()
      call text%line( &
         '   N            c_D         m_H         c_H         k_H           J        16 J')
      do k = 1, size(table%fits, 2)
         call add_mesh(text, table%fits(1, k), table%paper(:, k))
      end do
      associate (s => table%truth%model%structure)
         call text%line('   true     '//estimates([s%c_D, s%m_H, s%c_H, s%k_H]))
      end associate
      call text%line('   start    '//estimates(table%fits(1, 1)%fit%start))
      call text%line()
      call add_remarks(text, table)
      content = text%content()
   end function report

   !> Three lines: ours, the paper's, the relative difference.
   subroutine add_mesh(text, fit, paper)
      type(text_t), intent(inout) :: text
      type(stage_fit_t), intent(in) :: fit
      real(wp), intent(in) :: paper(:)
      character(len=:), allocatable :: line
      integer :: k

      call text%line(right(to_text(fit%elements), 4)//' ours   '//estimates(fit%fit%estimate)// &
         scientific(fit%fit%J)//scientific(16*fit%fit%J))
      call text%line('     paper  '//estimates(paper(2:5))//repeat(' ', 12)//scientific(paper(6)))
      line = '     differs'
      do k = 1, 4
         line = line//right(percent(fit%fit%estimate(k)/paper(k + 1) - 1), 12)
      end do
      call text%line(line//repeat(' ', 12)//right(percent(16*fit%fit%J/paper(6) - 1), 12))
   end subroutine add_mesh

   !> What is to be known about the table, each with its evidence.
   subroutine add_remarks(text, table)
      type(text_t), intent(inout) :: text
      type(table_t), intent(in) :: table
      character(len=:), allocatable :: line
      integer :: k

      associate (fits => table%fits(1, :), paper => table%paper)
         call text%line('Remarks')
         line = ' 1. The paper''s J over ours:'
         do k = 1, size(fits)
            line = line//' '//trim(adjustl(fixed(paper(6, k)/fits(k)%fit%J, 12, 1)))//' (N = '// &
               to_text(fits(k)%elements)//')'//merge(',', '.', k < size(fits))
         end do
         call text%line(line)
         call text%line( &
            '    16 = 4**2, and 4 is the value of a cubic B-spline at its node: a constant')
         call text%line('    factor 4 in the observation leaves every estimate as it is and '// &
            'multiplies J by 16.')
         call text%line(' 2. At the finest mesh the paper''s J lies below 16 J by a factor of '// &
            to_text(16*fits(size(fits))%fit%J/paper(6, size(fits)))//'. Not explained.')
         call text%line(' 3. The printed c_D at N = 3, .066997, is '//trim(adjustl(fixed( &
            paper(2, 2)/fits(2)%fit%estimate(1), 12, 2)))// &
               ' times ours; .0066997 would differ by '// &
            trim(percent(fits(2)%fit%estimate(1)/(paper(2, 2)/10) - 1))// &
               ': a misprint, in all likelihood.')
         call text%line( &
            ' 4. The quadrature is fine enough to be exact. With one panel of two Gauss points')
         call text%line('    per element J at N = 2 would be '//to_text(table%coarse_rule_J)// &
            ', '// &
            trim(adjustl(fixed(fits(1)%fit%J/table%coarse_rule_J, 12, 0)))// &
            ' times smaller than '//to_text(fits(1)%fit%J)//': not what the authors used.')
         call text%line( &
            ' 5. The data must have been differenced as the model is. With exact accelerations as')
         call text%line('    data J is')
         line = '   '
         do k = 1, size(fits)
            line = line//' '//to_text(table%exact_data_J(k))//' (N = '// &
               to_text(fits(k)%elements)// &
               ')'// &
               merge(',', '.', k < size(fits))
         end do
         call text%line(line)
         call text%line(' 6. The text names no start value for c_H; ours is the table''s, .0035.')
         call text%line(' 7. The record in data/ and the one computed now differ by at most '// &
            to_text(table%record_difference)//'.')
      end associate
   end subroutine add_remarks

   !> Four numbers with six decimals.
   function estimates(values) result(line)
      real(wp), intent(in) :: values(:)
      character(len=:), allocatable :: line
      integer :: k

      line = ''
      do k = 1, size(values)
         line = line//fixed(values(k), 12, 6)
      end do
   end function estimates

   !> Three significant digits in twelve places.
   function scientific(value) result(text)
      real(wp), intent(in) :: value
      character(len=12) :: text

      write (text, '(es12.2)') value
   end function scientific

   !> True values, for the convergence plot.
   function truth_csv(structure) result(content)
      type(structure_t), intent(in) :: structure
      character(len=:), allocatable :: content
      type(text_t) :: text
      integer :: k

      call text%line('parameter,value')
      do k = 1, size(columns)
         call text%line(trim(columns(k))//','//full(structure%get(free_index(columns(k)))))
      end do
      content = text%content()
   end function truth_csv

   !> The paper's table, a row for each number.
   function paper_csv(paper) result(content)
      real(wp), intent(in) :: paper(:, :)
      character(len=:), allocatable :: content
      type(text_t) :: text
      integer :: k, mesh

      call text%line('elements,parameter,value')
      do mesh = 1, size(paper, 2)
         do k = 1, size(columns)
            call text%line(to_text(nint(paper(1, mesh)))//','//trim(columns(k))//','// &
               full(paper(k + 1, mesh)))
         end do
         call text%line(to_text(nint(paper(1, mesh)))//',J,'//full(paper(6, mesh)))
      end do
      content = text%content()
   end function paper_csv

end module beamid_table_4_1
