!> The table design.csv of `design`, with a row for each candidate experiment.
module beamid_design_tables
   use beamid_designs, only: design_t, designs_t
   use beamid_kinds, only: wp
   use beamid_lines, only: csv_row, known
   use beamid_statistics, only: unlimited
   use beamid_strings, only: full, to_text
   use beamid_texts, only: text_t
   use beamid_unknowns, only: name_length
   use beamid_values, only: listed
   implicit none
   private

   public :: design_table, names_of_lists

   !> Number of settings of a candidate experiment, each of which may be chosen from a list.
   integer, parameter, public :: settings = 6

contains

   !> Returns the table design.csv with a row for each candidate; row 0 is the present experiment.
   !> The columns sd_* are standard errors, relative_* standard errors of relative changes; a field
   !> is empty if the experiment does not determine the parameter.
   function design_table(designs) result(table)
      type(designs_t), intent(in) :: designs
      character(len=:), allocatable :: table
      character(len=name_length), allocatable :: names(:)
      type(text_t) :: text
      character(len=8) :: lists(settings)
      integer :: k

      names = designs%quantities%name
      lists = names_of_lists(designs)
      call text%line('design,x_S,x_S_2,x_F,duration,'//listed(lists(4:), ',')//',samples,'// &
         'determined,D,A,E,'//listed('sd_'//names, ',')//','//listed('relative_'//names, ','))
      call add_row(text, designs, 0, designs%present)
      do k = 1, size(designs%list)
         call add_row(text, designs, k, designs%list(k))
      end do
      table = text%content()
   end function design_table

   !> Returns the names of the settings that may be chosen from lists.
   pure function names_of_lists(designs) result(names)
      type(designs_t), intent(in) :: designs
      character(len=8) :: names(settings)
      character(len=1) :: what   ! time or frequency

      what = merge('f', 't', designs%box%of_lines)
      names = [character(len=8) :: 'x_S', 'x_F', 'duration', what//'_first', what//'_last', &
         what//'_step']
   end function names_of_lists

   !> Adds the row of one experiment.
   subroutine add_row(text, designs, number, design)
      type(text_t), intent(inout) :: text
      type(designs_t), intent(in) :: designs
      integer, intent(in) :: number
      type(design_t), intent(in) :: design
      character(len=:), allocatable :: row
      real(wp) :: limits(3)
      integer :: k

      row = to_text(number)//','//full(design%x_S(1))//','
      if (design%x_S(2) > 0) row = row//full(design%x_S(2))
      row = row//','//full(design%x_F)//','
      if (design%duration > 0) row = row//full(design%duration)
      associate (p => design%prediction)
         row = csv_row(row, [design%first, design%last, design%step])//','// &
            to_text(design%samples)//','//trim(merge('yes', 'no ', p%determined))
         if (p%finite) then
            row = csv_row(row, [p%D, p%A, p%E])
         else
            row = row//',,,'
         end if
         do k = 1, size(p%sd)
            limits = unlimited
            if (p%sd(k) < unlimited) limits = designs%quantities(k)%limits( &
               p%sd(k)*designs%quantities(k)%scale, 0.0_wp)
            row = row//','//known(limits(1))
         end do
         do k = 1, size(p%sd)
            row = row//','//known(p%sd(k))
         end do
      end associate
      call text%line(row)
   end subroutine add_row

end module beamid_design_tables
