!> Kind parameters shared by every module.
module beamid_kinds
   use, intrinsic :: iso_fortran_env, only: real64, int64
   implicit none
   private

   !> Working precision: IEEE double, the precision of LAPACK's `d` routines and of CVODE.
   integer, parameter, public :: wp = real64
   !> 64-bit integers for byte counts and step counts.
   integer, parameter, public :: ip = int64

end module beamid_kinds
