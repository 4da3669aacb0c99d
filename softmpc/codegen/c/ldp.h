/* Least distance: the quadratic program with the rows that were taken, solved by DAQP. */
#ifndef SMPC_LDP_H
#define SMPC_LDP_H

#include "memory.h"
#include "scalar.h"

#define SMPC_OPTIMAL_SLOPE ((real)SMPC_QP_SLOPE) /* of the largest g, that may be left */

int smpc_least_distance(smpc_controller *c, double deadline);

#endif
