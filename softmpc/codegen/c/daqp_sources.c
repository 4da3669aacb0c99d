/* DAQP as its authors wrote it (daqp/), in the number type of the controller. */
#include "scalar.h"

#ifdef SMPC_FLOAT
#define DAQP_SINGLE_PRECISION
#endif
#define DAQP_NO_SOFT_WEIGHTS

#include "daqp/factorization.c"
#include "daqp/auxiliary.c"
#include "daqp/daqp.c"
