/* The last good plan, a step later. */
#include "parts.h"

/* What was last is repeated; on a grid with long intervals states lie on lines between the nodes. */
void smpc_shift(const smpc_path *from, smpc_path *to)
{
    for (int k = 0; k < SMPC_N; k++) {
        const int later = smpc_later[k], low = smpc_between[k], high = low + 1 < SMPC_N ? low + 1 : low;
        for (int i = 0; i < SMPC_NU; i++) to->u[k][i] = from->u[later][i];
        for (int i = 0; i < SMPC_NA; i++) to->a[k][i] = from->a[later][i];
        for (int i = 0; i < SMPC_NX; i++) {
            const real x = from->x[low][i];
            to->x[k][i] = x + smpc_share[k] * (from->x[high][i] - x);
        }
    }
}
