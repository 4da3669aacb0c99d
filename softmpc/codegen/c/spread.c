/* Changes carried through the linearised intervals: states from inputs forwards, slopes of whatever
 * the states and inputs do backwards. */
#include "parts.h"

#include <string.h>

enum { arm = SMPC_ARM, known = SMPC_ARM + SMPC_STAGED };

/* From a first state that differs by dx and the changes of the inputs in `step` to those of all
 * states and, where `unknowns` is set, of the unknowns of the stages. */
void smpc_spread(const smpc_linear *l, const real *dx, smpc_path *step, int unknowns)
{
    const real *before = dx;
    for (int k = 0; k < SMPC_N; k++) {
        const smpc_interval *i = &l->interval[k];
        const int kind = smpc_kind_of[k];
        real causes[known], *after = step->x[k];
        memcpy(causes, before, sizeof(real) * arm);
        memset(causes + arm, 0, sizeof(real) * SMPC_STAGED);
        smpc_sparse_add(&smpc_p_by_z[kind], 0, SMPC_STAGED, before + arm, causes + arm);
        smpc_sparse_add(&smpc_p_by_u[kind], 0, SMPC_STAGED, step->u[k], causes + arm);
        memcpy(after, i->gap, sizeof i->gap);
        smpc_add_product(i->arm, arm, arm, before, after);
        smpc_add_product(i->pressures, arm, SMPC_STAGED, causes + arm, after);
        smpc_sparse_add(&smpc_z_by_z[kind], 0, SMPC_DRIVE, before + arm, after + arm);
        smpc_sparse_add(&smpc_z_by_u[kind], 0, SMPC_DRIVE, step->u[k], after + arm);
        if (unknowns) {
            real moved[SMPC_NA] = {0};
            smpc_add_product(i->by, SMPC_NA, known, causes, moved);
            for (int j = 0; j < SMPC_NA; j++) step->a[k][j] = i->a_0[j] - moved[j];
        }
        before = after;
    }
}

/* From slopes in the state at the end of each interval (`nodes`) to slopes that count what follows
 * from it; those in the inputs are added to `moves`, if it is not NULL. */
void smpc_gather(const smpc_linear *l, real nodes[][SMPC_NX], real moves[][SMPC_NU])
{
    for (int k = SMPC_N - 1; k >= 0; k--) {
        const smpc_interval *i = &l->interval[k];
        const int kind = smpc_kind_of[k];
        real *here = nodes[k], pressures[SMPC_STAGED] = {0};
        smpc_add_transposed(i->pressures, arm, SMPC_STAGED, here, pressures);
        if (moves) {
            smpc_sparse_add_transposed(&smpc_p_by_u[kind], 0, SMPC_STAGED, pressures, moves[k]);
            smpc_sparse_add_transposed(&smpc_z_by_u[kind], 0, SMPC_DRIVE, here + arm, moves[k]);
        }
        if (!k) break;
        real *before = nodes[k - 1];
        smpc_add_transposed(i->arm, arm, arm, here, before);
        smpc_sparse_add_transposed(&smpc_p_by_z[kind], 0, SMPC_STAGED, pressures, before + arm);
        smpc_sparse_add_transposed(&smpc_z_by_z[kind], 0, SMPC_DRIVE, here + arm, before + arm);
    }
}
