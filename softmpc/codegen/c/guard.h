/* The last guard of an input: whatever a solver says, it leaves finite and within its limits. */
#ifndef SMPC_GUARD_H
#define SMPC_GUARD_H

#include "memory.h"
#include "scalar.h"

/* The nearest input within the limits. */
void smpc_inside(const smpc_controller *c, const real *u, real *to);

/* The nearest input within the limits that may follow `before`; the limit of the input goes before
 * that of its change. */
void smpc_guarded(const smpc_controller *c, const real *before, const real *u, real *to);

/* u where it is finite; else the input given last, or the nearest to none. */
int smpc_make_finite(const smpc_controller *c, const real *u, real *to);

/* The limits of the scene. */
void smpc_widest(smpc_controller *c);

#endif
