!> Kind parameters and constants shared by every module.
module beamid_kinds
   use, intrinsic :: iso_fortran_env, only: real64, int64
   implicit none
   private

   !> Working precision: IEEE double, as in LAPACK's routines d... and in CVODE.
   integer, parameter, public :: wp = real64
   !> 64-bit integers for numbers of bytes and of steps.
   integer, parameter, public :: ip = int64

   real(wp), parameter, public :: pi = acos(-1.0_wp)
   real(wp), parameter, public :: two_pi = 2*acos(-1.0_wp)   !< of cycles to radians

end module beamid_kinds
