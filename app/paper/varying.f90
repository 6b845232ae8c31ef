!> Report of `beamid reproduce varying`: Theorem 3.1 in numbers for parameters that vary along the
!> beam. The meshes of the state and of the fields E(x) and c_D(x) are refined independently.
!> `beamid_varying_study` computes the numbers.
module beamid_varying
   use beamid
   use beamid_lines, only: add_lines, csv_row
   use beamid_outputs, only: output_t
   use beamid_strings, only: fixed, to_text
   use beamid_texts, only: text_t
   use beamid_varying_study, only: beside_step, degree, find_minimisers, minimise, minimiser_t, &
      new_problems, pieces, points, record_truth, reference, state_meshes, step_factor, &
      step_place, strength, varying_t, widest
   implicit none
   private

   public :: reproduce_varying

   !> Names of the fields.
   character(len=*), parameter :: parameters(2) = [character(len=3) :: 'E', 'c_D']
   !> One point of `every` of a field is written.
   integer, parameter :: every = 4
   !> Factor on the penalty of the fit that shows the effect of the penalty.
   real(wp), parameter :: stronger = 100
   !> Indices of the finest mesh of the state and of the fields.
   integer, parameter :: last = size(state_meshes), finest = size(pieces)

contains

   !> Runs the study and writes its report and tables.
   !>
   !> output   on return with varying.csv and varying_functions.csv
   !> summary  on return with the report
   !> error    a response or a fit that fails
   subroutine reproduce_varying(output, summary, error)
      type(output_t), intent(inout) :: output
      type(text_t), intent(inout) :: summary
      type(error_t), allocatable, intent(out) :: error
      type(varying_t), allocatable :: problems(:)
      type(minimiser_t) :: penalised
      type(text_t) :: table, functions
      integer :: a, k

      call new_problems(problems)
      do k = 1, size(problems)
         call record_truth(problems(k), error)
         if (.not. allocated(error)) call find_minimisers(problems(k), state_meshes, pieces, error)
         if (allocated(error)) return
      end do
      call minimise(problems(1), state_meshes(size(state_meshes)), pieces(size(pieces)), &
         stronger*strength, penalised)
      if (allocated(penalised%failure)) then
         call move_alloc(penalised%failure, error)
         return
      end if
      call table%line('problem,N,M,parameter,sup,L2,far,L2_state,order_sup_M,order_L2_M,'// &
         'order_L2_N,order_state_N,J,settled')
      call functions%line('problem,N,M,parameter,x,value,truth')
      call add_head(summary, problems)
      do k = 1, size(problems)
         do a = 1, problems(k)%functions
            call add_distances(summary, table, problems(k), a)
            call add_functions(functions, problems(k), a)
         end do
      end do
      call add_remarks(summary, problems, penalised)
      call output%add('varying.csv', table%content())
      call output%add('varying_functions.csv', functions%content())
   end subroutine reproduce_varying

   !> Adds a description of the computations.
   subroutine add_head(text, problems)
      type(text_t), intent(inout) :: text
      type(varying_t), intent(in) :: problems(:)

      associate (structure => problems(1)%model%structure, t => problems(1)%record(1)%samples, &
         f => problems(1)%model%excitation)
         call add_lines(text, [character(len=110) :: &
            'Theorem 3.1 for E(x) and c_D(x) by numbers: cubic splines of N elements for the '// &
            'state, and cubic', &
            'splines of M coefficients, on M - # elements of their own, for each function', &
            'Beam: length #, rho #, E I #, c_D I #; at the tip m_T #, J_T #; f a hat of # s, '// &
            'in H1', &
            'Data: tip acceleration (3.13), # samples to t = #, without noise, of quintic '// &
            'splines, N = #.', &
            'smooth: E(x) = # (1 - .2 sin(pi x/l) + .1 sin(2 pi x/l)), c_D(x) = # '// &
            '(1 + .3 sin(pi x/l))', &
            'step: E falls to #.2 of itself at x/l = #, which is a point of no mesh; c_D is '// &
            'known there.'], &
            [real(wp) :: degree, structure%length, structure%rho, structure%E*structure%I, &
            structure%c_D*structure%I, structure%m_T, structure%J_T, f%t(size(f%t)), size(t), &
            t(size(t)), reference, structure%E, structure%c_D, step_factor, step_place])
         call add_lines(text, [character(len=110) :: &
            'Q: coefficients within a factor of # of the drawing''s, from which every search '// &
            'starts. That is not', &
            'compact where functions are compared; a penalty # |(log E)''|**2, in units of the '// &
            'record''s sum', &
            'of squares, and its like for c_D stand for what is missing. J in the same units, '// &
            'of the data alone.', &
            'Distances from the truth, relative to it, at # places: largest (sup), root of '// &
            'mean square (L2)', &
            'Orders: in M as the elements of the function are halved, in N as those of the '// &
            'state are.', &
            'state: L2 distance from the minimiser of the same M at N = #', &
            '*: no minimum to 1e-6 after 100 trials'], &
            [real(wp) :: widest, strength, points, state_meshes(size(state_meshes))])
      end associate
   end subroutine add_head

   !> Adds the distances of one estimated field from the truth on every pair of meshes.
   !>
   !> a  1: E(x), 2: c_D(x)
   subroutine add_distances(text, table, problem, a)
      type(text_t), intent(inout) :: text, table
      type(varying_t), intent(in) :: problem
      integer, intent(in) :: a
      character(len=:), allocatable :: line
      character(len=20) :: field
      real(wp) :: orders(4)
      logical :: known(4)
      integer :: i, j, k

      call text%line()
      call text%line(problem%name//': '//trim(parameters(a))//'(x)')
      line = '   N   M        sup  order         L2  order in M  in N      state  in N          J'
      if (problem%has_step) line = line//'        far'
      call text%line(line)
      do i = 1, size(state_meshes)
         do j = 1, size(pieces)
            associate (m => problem%minimisers(i, j))
               call find_orders(problem%minimisers, i, j, a, orders, known)
               line = integers([m%N, m%M])//number(m%sup(a))//shown(1, 7)//number(m%L2(a)) &
                  //shown(2, 12)//shown(3, 6)
               field = ''
               if (i < size(state_meshes)) field = number(m%state(a))
               line = line//field(:11)//shown(4, 6)//number(m%J)
               if (problem%has_step) line = line//number(m%far(a))
               if (.not. m%settled) line = line//' *'
               call text%line(line)
               line = csv_row(problem%name//','//to_text(m%N)//','//to_text(m%M)//','// &
                  trim(parameters(a)), [m%sup(a), m%L2(a), m%far(a), m%state(a)])
               do k = 1, 4
                  line = line//','
                  if (known(k)) line = csv_row(line(:len(line) - 1), orders(k:k))
               end do
               call table%line(csv_row(line, [m%J])//','//merge('1', '0', m%settled))
            end associate
         end do
      end do

   contains

      !> Returns order k in a column of the given width, or blanks if it is not known.
      function shown(k, width)
         integer, intent(in) :: k, width
         character(len=:), allocatable :: shown

         shown = repeat(' ', width)
         if (known(k)) shown = fixed(orders(k), width, 1)
      end function shown

   end subroutine add_distances

   !> Computes the orders of convergence from the next coarser mesh.
   !>
   !> found   (state meshes, pieces) minimisers of one problem
   !> i, j    indices of state mesh and of pieces
   !> a       1: E(x), 2: c_D(x)
   !> orders  of sup and of L2 in M, of L2 and of the distance by the state in N; 0: not known
   !> known   whether there is a coarser mesh to compare with
   pure subroutine find_orders(found, i, j, a, orders, known)
      type(minimiser_t), intent(in) :: found(:, :)
      integer, intent(in) :: i, j, a
      real(wp), intent(out) :: orders(4)
      logical, intent(out) :: known(4)
      real(wp) :: finer

      known = [j > 1, j > 1, i > 1, i > 1 .and. i < size(found, 1)]
      orders = 0
      if (j > 1) then
         finer = log(real(found(i, j)%M - degree, wp)/(found(i, j - 1)%M - degree))
         orders(1) = log(found(i, j - 1)%sup(a)/found(i, j)%sup(a))/finer
         orders(2) = log(found(i, j - 1)%L2(a)/found(i, j)%L2(a))/finer
      end if
      if (i == 1) return
      finer = log(real(found(i, j)%N, wp)/found(i - 1, j)%N)
      orders(3) = log(found(i - 1, j)%L2(a)/found(i, j)%L2(a))/finer
      if (known(4)) orders(4) = log(found(i - 1, j)%state(a)/found(i, j)%state(a))/finer
   end subroutine find_orders

   !> Adds one estimated field on every pair of meshes.
   !>
   !> a  1: E(x), 2: c_D(x)
   subroutine add_functions(table, problem, a)
      type(text_t), intent(inout) :: table
      type(varying_t), intent(in) :: problem
      integer, intent(in) :: a
      integer :: i, j, k

      do i = 1, size(state_meshes)
         do j = 1, size(pieces)
            associate (m => problem%minimisers(i, j))
               do k = 1 + every/2, points, every
                  call table%line(csv_row(problem%name//','//to_text(m%N)//','//to_text(m%M)// &
                     ','//trim(parameters(a)), [problem%x(k)*problem%model%structure%length, &
                     m%found(k, a), problem%truth(k, a)]))
               end do
            end associate
         end do
      end do
   end subroutine add_functions

   !> Adds the conclusions from the tables.
   !>
   !> penalised  the first problem on the finest meshes with a stronger penalty
   subroutine add_remarks(text, problems, penalised)
      type(text_t), intent(inout) :: text
      type(varying_t), intent(in) :: problems(:)
      type(minimiser_t), intent(in) :: penalised

      call text%line()
      call text%line('Remarks')
      call add_smooth_remarks(text, problems(1), penalised)
      call add_other_remarks(text, problems(2)%minimisers, problems(3)%minimisers)
   end subroutine add_remarks

   !> Adds the remarks on the problem of a smooth E(x).
   !>
   !> penalised  its minimiser on the finest meshes with a stronger penalty
   subroutine add_smooth_remarks(text, problem, penalised)
      type(text_t), intent(inout) :: text
      type(varying_t), intent(in) :: problem
      type(minimiser_t), intent(in) :: penalised
      real(wp) :: first_orders(4), last_orders(4), by_state(size(pieces)), orders(4)
      logical :: known(4)
      integer :: best, j, k

      associate (smooth => problem%minimisers)
         best = minloc(smooth(last, :)%L2(1), dim=1)
         call find_orders(smooth, last, 2, 1, first_orders, known)
         call find_orders(smooth, last, finest, 1, last_orders, known)
         call add_lines(text, [character(len=110) :: &
            ' 1. Smooth E, N = #: L2 falls from # at M = # to # at M = #, at first with order '// &
            '#.1,', &
            '    in sup with #.1. The best that cubic splines can do is 4; the proof promises '// &
            'no order.', &
            '    On the finest mesh of the function, M = #, it is #.'], &
            [real(wp) :: state_meshes(last), short(smooth(last, 1)%L2(1)), smooth(last, 1)%M, &
            short(smooth(last, best)%L2(1)), smooth(last, best)%M, first_orders(2), &
            first_orders(1), smooth(last, finest)%M, short(smooth(last, finest)%L2(1))])
         do j = 1, size(pieces)
            call find_orders(smooth, last - 1, j, 1, orders, known)
            by_state(j) = orders(4)
         end do
         call add_lines(text, [character(len=110) :: &
            ' 2. The state has to be refined too. At N = #, from M = # to #, L2 goes from # '// &
            'to #, while', &
            '    J goes from # to #: the function bends to make up for the error of the state.', &
            '    With M held the minimisers approach those of N = # with orders #.1, #.1, #.1 '// &
            'and #.1 from', &
            '    N = # to #; the frequencies of cubic splines have order 4. At N = # they are '// &
            '#, #,', &
            '    # and # from them as M grows.'], &
            [real(wp) :: state_meshes(2), smooth(2, 1)%M, smooth(2, finest)%M, &
            short(smooth(2, 1)%L2(1)), short(smooth(2, finest)%L2(1)), short(smooth(2, 1)%J), &
            short(smooth(2, finest)%J), state_meshes(last), by_state, state_meshes(last - 2), &
            state_meshes(last - 1), state_meshes(last - 1), &
            (short(smooth(last - 1, j)%state(1)), j=1, finest)])
         call add_lines(text, [character(len=110) :: &
            ' 3. Both refined, which is what the theorem speaks of, (N, M) = (#, #), (#, #), '// &
            '(#, #), (#, #):', &
            '    L2 is #, #, # and #.', &
            ' 4. What limits at M = #: from N = # to # L2 goes with order #.1, and a penalty # '// &
            'times as', &
            '    strong makes it #.1 times as large. The largest distance is at x/l = #.2; at '// &
            'the tip only', &
            '    the moment of J_T bends the beam.'], &
            [real(wp) :: (smooth(k, k)%N, smooth(k, k)%M, k=1, last), &
            (short(smooth(k, k)%L2(1)), k=1, last), smooth(last, finest)%M, &
            state_meshes(last - 1), state_meshes(last), last_orders(3), stronger, &
            penalised%L2(1)/smooth(last, finest)%L2(1), &
            problem%x(maxloc(abs(smooth(last, finest)%found(:, 1)/problem%truth(:, 1) - 1), &
            dim=1))])
      end associate
   end subroutine add_smooth_remarks

   !> Adds the remarks on the problems of E(x) with c_D(x) and of a step in E.
   !>
   !> both, step  (state meshes, pieces) their minimisers
   subroutine add_other_remarks(text, both, step)
      type(text_t), intent(inout) :: text
      type(minimiser_t), intent(in) :: both(:, :), step(:, :)
      integer :: best, j

      call add_lines(text, [character(len=110) :: &
         ' 5. c_D(x) beside E(x), N = #: L2 of c_D is #, #, # and # as M grows,', &
         '    #.1, #.1, #.1 and #.1 times that of E.'], [real(wp) :: state_meshes(last), &
         (short(both(last, j)%L2(2)), j=1, finest), &
         (both(last, j)%L2(2)/both(last, j)%L2(1), j=1, finest)])
      best = minloc(step(last, :)%L2(1), dim=1)
      call add_lines(text, [character(len=110) :: &
         ' 6. The step, N = #: L2 goes from # to # at M = #, with order #.2 over all; for '// &
         'a step,', &
         '    which is in no H2, splines allow 1/2. In sup it stays between # and #: what '// &
         'is', &
         '    continuous comes no nearer than # right at the step. Farther than # l from it '// &
         'the largest', &
         '    distance goes from # to #.'], [real(wp) :: state_meshes(last), &
         short(step(last, 1)%L2(1)), short(step(last, best)%L2(1)), &
         step(last, best)%M, overall(step(last, 1), step(last, best)), &
         short(minval(step(last, :)%sup(1))), short(maxval(step(last, :)%sup(1))), &
         short((1 - step_factor)/(1 + step_factor)), beside_step, &
         short(step(last, 1)%far(1)), short(step(last, finest)%far(1))])
   end subroutine add_other_remarks

   !> Returns a value rounded to two digits.
   pure real(wp) function short(value)
      real(wp), intent(in) :: value
      character(len=12) :: digits

      write (digits, '(es12.1)') value
      read (digits, *) short
   end function short

   !> Returns the order of convergence of E's L2 distance from one mesh of the field to a finer one;
   !> 0 if they are the same.
   pure real(wp) function overall(coarse, fine)
      type(minimiser_t), intent(in) :: coarse, fine

      overall = 0
      if (fine%M > coarse%M) overall = log(coarse%L2(1)/fine%L2(1)) &
         /log(real(fine%M - degree, wp)/(coarse%M - degree))
   end function overall

   !> Returns integers in columns of width 4.
   pure function integers(values) result(line)
      integer, intent(in) :: values(:)
      character(len=4*size(values)) :: line

      write (line, '(*(i4))') values
   end function integers

   !> Returns a number in a column of width 11.
   pure character(len=11) function number(value)
      real(wp), intent(in) :: value

      write (number, '(es11.2)') value
   end function number

end module beamid_varying
