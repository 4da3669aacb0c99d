/* A linear-quadratic regulator about the moving posture: u = input - K (x - moving, u_before -
 * input before), with the gains K of the nearest place. */
#include "parts.h"

/* Where the references are, in the order of SMPC_REFERENCES. */
enum { MOVING = 0, BEFORE = SMPC_NX, INPUT = BEFORE + SMPC_INPUTS, TIP = INPUT + SMPC_INPUTS };

void smpc_wanted(smpc_controller *c, const real *x, real *wanted)
{
    const real *told = c->references;
    const real *K = smpc_gains + smpc_nearest(told + TIP) * SMPC_INPUTS * (SMPC_NX + SMPC_INPUTS);
    for (int i = 0; i < SMPC_INPUTS; i++) {
        real sum = 0;
        for (int j = 0; j < SMPC_NX; j++) sum += *K++ * (x[j] - told[MOVING + j]);
        for (int j = 0; j < SMPC_INPUTS; j++) sum += *K++ * (c->u_before[j] - told[BEFORE + j]);
        wanted[i] = told[INPUT + i] - sum;
    }
}
