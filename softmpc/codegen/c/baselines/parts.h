/* The parts of the controller, for each other. */
#ifndef SMPC_PARTS_H
#define SMPC_PARTS_H

#include "controller.h"
#include "data.h"
#include "linear.h"

/* lqr.c or table.c: the input for the state x that the controller would give without limits. */
void smpc_wanted(smpc_controller *c, const real *x, real *wanted);

/* baseline.c: which of the places of the gains is nearest to a tip (3). */
int smpc_nearest(const real *tip);

#endif
