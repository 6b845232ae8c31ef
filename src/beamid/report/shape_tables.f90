!> Tables for the plots of mode shapes: shapes.csv and attachments.csv.
module beamid_shape_tables
   use beamid_equations, only: equations_t, new_equations
   use beamid_errors, only: error_t
   use beamid_galerkin, only: galerkin_of, galerkin_t, mesh_t
   use beamid_kinds, only: wp
   use beamid_lines, only: csv_row
   use beamid_mode_shapes, only: mode_shapes
   use beamid_outputs, only: output_t
   use beamid_strings, only: full, to_text
   use beamid_structure, only: structure_t, x_H_at, x_M_at, x_S_at
   use beamid_texts, only: text_t
   implicit none
   private

   public :: add_shapes

   !> Largest number of modes, number of places along the beam, and number of elements above which a
   !> plot shows no difference.
   integer, parameter :: most = 8, points = 101, finest = 64

contains

   !> Adds shapes.csv and attachments.csv.
   !>
   !> roots    [1/time]; the shapes are those of the first oscillating roots
   !> summary  gets the reason if the shapes cannot be computed
   subroutine add_shapes(output, structure, mesh, roots, summary)
      type(output_t), intent(inout) :: output
      type(structure_t), intent(in) :: structure
      type(mesh_t), intent(in) :: mesh
      complex(wp), intent(in) :: roots(:)
      type(text_t), intent(inout) :: summary
      type(galerkin_t), target :: galerkin
      type(equations_t), target :: equations
      type(mesh_t) :: coarser
      type(error_t), allocatable :: error
      type(text_t) :: table
      complex(wp), allocatable :: shapes(:, :), s(:)
      real(wp) :: x(points)
      character(len=:), allocatable :: header
      integer :: j, k

      s = pack(roots, aimag(roots) > 0)
      s = s(:min(most, size(s)))
      if (size(s) == 0) return
      coarser = mesh
      coarser%elements = min(mesh%elements, finest)
      galerkin = galerkin_of(coarser, structure, fixed=.true.)
      equations = new_equations(galerkin, structure)
      x = structure%length*[(k/(points - 1.0_wp), k=0, points - 1)]
      call mode_shapes(equations, s, x, shapes, error)
      if (allocated(error)) then
         call summary%line('no mode shapes: '//error%message)
         return
      end if
      header = 'x'
      do k = 1, size(s)
         header = header//',mode_'//to_text(k)//'_real,mode_'//to_text(k)//'_imag'
      end do
      call table%line(header)
      do j = 1, points
         call table%line(csv_row(full(x(j)), [(real(shapes(j, k)), aimag(shapes(j, k)), &
            k=1, size(s))]))
      end do
      call output%add('shapes.csv', table%content())
      call output%add('attachments.csv', attachments(structure))
   end subroutine add_shapes

   !> Returns a table of what is attached to the beam, with the places [length].
   function attachments(structure) result(content)
      type(structure_t), intent(in) :: structure
      character(len=:), allocatable :: content
      type(text_t) :: table
      logical, allocatable :: has_hose(:)
      integer :: k

      call table%line('name,x')
      if (structure%m_T > 0 .or. structure%J_T > 0) &
         call table%line(csv_row('tip mass', [structure%length]))
      has_hose = structure%has_hose()
      do k = 1, size(has_hose)
         if (has_hose(k)) call table%line(csv_row(trim('hose '//structure%hose_name(k)), &
            [structure%get(x_H_at(k))]))
      end do
      do k = 1, structure%masses
         call table%line(csv_row(trim('mass '//structure%mass_name(k)), &
            [structure%get(x_M_at(k))]))
      end do
      do k = 1, max(1, structure%sensors)
         call table%line(csv_row(trim('sensor '//structure%sensor_name(k)), &
            [structure%get(x_S_at(k))]))
      end do
      do k = 1, structure%supports
         call table%line(csv_row(trim('support '//structure%support_name(k)), &
            [structure%support(k)%x_P]))
      end do
      content = table%content()
   end function attachments

end module beamid_shape_tables
