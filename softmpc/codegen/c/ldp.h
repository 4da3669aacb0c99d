/* Least distance: the quadratic program with the rows that were taken, solved by DAQP. */
#ifndef SMPC_LDP_H
#define SMPC_LDP_H

#include "memory.h"
#include "scalar.h"

int smpc_least_distance(smpc_controller *c, double deadline);

#endif
