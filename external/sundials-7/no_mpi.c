/* The core of SUNDIALS refers to functions of MPI where it is built with MPI, as on Debian 13. Its
 * shared library then loads Open MPI with drivers of networks, which delays the start of each program
 * by .15 s. beamid does not use MPI, so scripts/setup.sh joins the static libraries and this file,
 * which answers their only question: MPI is not initialized. Any other call ends the program. setup.sh
 * makes these names local, so that a program with MPI beside beamid keeps its own.
 */
#include <stdlib.h>

int MPI_Initialized(int *flag)
{
   *flag = 0;
   return 0;
}

#define NEVER_CALLED(name) int name(void) { abort(); }

NEVER_CALLED(MPI_Abort)
NEVER_CALLED(MPI_Comm_c2f)
NEVER_CALLED(MPI_Comm_dup)
NEVER_CALLED(MPI_Comm_f2c)
NEVER_CALLED(MPI_Comm_free)
NEVER_CALLED(MPI_Comm_rank)
NEVER_CALLED(MPI_Comm_size)
NEVER_CALLED(MPI_Op_create)
NEVER_CALLED(MPI_Op_free)
NEVER_CALLED(MPI_Reduce)
NEVER_CALLED(MPI_Type_commit)
NEVER_CALLED(MPI_Type_create_resized)
NEVER_CALLED(MPI_Type_create_struct)
NEVER_CALLED(MPI_Type_free)
NEVER_CALLED(MPI_Type_get_extent)

/* Their addresses are the constants MPI_COMM_NULL, MPI_DOUBLE and MPI_LONG of Open MPI. */
char ompi_mpi_comm_null, ompi_mpi_double, ompi_mpi_long;
