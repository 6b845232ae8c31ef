!> Fits several models of the same records, which `compare` ranks.
module beamid_comparisons
   use beamid_candidates, only: candidate_t, fit_candidate, same_samples
   use beamid_case_files, only: case_t
   use beamid_cases, only: load_experiments
   use beamid_damping_models, only: damping_models_t, fit_damping_models
   use beamid_errors, only: bad_input, error_t, locate
   use beamid_least_squares, only: monitor_t
   use beamid_records, only: note_length
   use beamid_responses, only: is_exact
   use beamid_strings, only: string_t
   implicit none
   private

   public :: new_candidate, check_samples, compare_damping, fit_candidates, set_labels

contains

   !> Makes a candidate of a case, with its records and its last mesh.
   subroutine new_candidate(case, candidate, error)
      type(case_t), intent(inout) :: case
      type(candidate_t), intent(out) :: candidate
      type(error_t), allocatable, intent(out) :: error
      character(len=note_length), allocatable :: notes(:)

      call load_experiments(case, candidate%experiments, notes, error)
      if (allocated(error)) return
      candidate%model = case%model
      candidate%mesh = case%meshes(size(case%meshes))
      candidate%refines = case%refines .and. is_exact(case%model%solver)
      candidate%stages = case%stages
   end subroutine new_candidate

   !> Refuses a candidate whose records differ from those of the first one.
   !>
   !> path, first_path  of the two cases, for the message
   subroutine check_samples(candidate, first, path, first_path, error)
      type(candidate_t), intent(in) :: candidate, first
      character(len=*), intent(in) :: path, first_path
      type(error_t), allocatable, intent(out) :: error

      if (.not. same_samples(first, candidate)) call bad_input(error, path// &
         ': &record: found other samples than in '//first_path//', expected the same ones')
   end subroutine check_samples

   !> Fits all candidates. Those that refine their meshes are compared on the finest mesh that any
   !> of them needs.
   !>
   !> paths  (size of models) of the cases, for messages
   subroutine fit_candidates(models, paths, error, monitor)
      type(candidate_t), intent(inout) :: models(:)
      type(string_t), intent(in) :: paths(:)
      type(error_t), allocatable, intent(out) :: error
      class(monitor_t), intent(inout), optional :: monitor
      integer :: finest, k

      do k = 1, size(models)
         call fit_candidate(models(k), error, monitor)
         call locate(error, paths(k)%text)
         if (allocated(error)) return
      end do
      finest = 0
      do k = 1, size(models)
         if (models(k)%refines) finest = max(finest, models(k)%mesh%elements)
      end do
      do k = 1, size(models)
         if (.not. models(k)%refines .or. models(k)%mesh%elements == finest) cycle
         models(k)%refines = .false.
         models(k)%mesh%elements = finest
         call fit_candidate(models(k), error, monitor)
         call locate(error, paths(k)%text)
         if (allocated(error)) return
      end do
   end subroutine fit_candidates

   !> Fits the records of a case with all damping mechanisms.
   !>
   !> by_ratios  whether only damping ratios are compared
   !> labels     (models) names of the models in the tables
   subroutine compare_damping(case, by_ratios, found, labels, error, monitor)
      type(case_t), intent(inout) :: case
      logical, intent(in) :: by_ratios
      type(damping_models_t), intent(out) :: found
      type(string_t), allocatable, intent(out) :: labels(:)
      type(error_t), allocatable, intent(out) :: error
      class(monitor_t), intent(inout), optional :: monitor
      type(candidate_t) :: reference
      integer :: k

      call new_candidate(case, reference, error)
      if (.not. allocated(error)) call fit_damping_models(reference, by_ratios, found, error, &
         monitor)
      call locate(error, case%path)
      if (allocated(error)) return
      allocate (labels(size(found%models)))
      do k = 1, size(labels)
         labels(k)%text = found%combinations(k)%name()
      end do
   end subroutine compare_damping

   !> Sets the names of the models in the tables: the names of the cases, or the paths of those
   !> whose names are the same.
   subroutine set_labels(names, paths, labels)
      type(string_t), intent(in) :: names(:), paths(:)
      type(string_t), allocatable, intent(out) :: labels(:)
      integer :: j, k

      labels = names
      do k = 1, size(names)
         if (count([(names(j)%text == names(k)%text, j=1, size(names))]) > 1) labels(k) = paths(k)
      end do
   end subroutine set_labels

end module beamid_comparisons
