/* The motion over all intervals: implicit steps of the arm, with the linear drive exactly between.
 *
 * The equations of the stages are eliminated interval by interval, so that only states and inputs
 * are left. All is scaled; the forms of a step say how its unknowns make strains and rates. */
#include "model.h"
#include "parts.h"

#include <string.h>

enum { n = SMPC_STRAINS, s = SMPC_STAGES, na = SMPC_NA, arm = SMPC_ARM, m = SMPC_PRESSURES };
enum { known = SMPC_ARM + SMPC_STAGED, width = SMPC_ARM + SMPC_STAGED + 1 };

typedef struct {
    real q[s][n], dq[s][n], a[s][n], p[s][m];
    real end[SMPC_NX];
} stages;

/* Inputs with the unknown offset, and the unknown force on the strains; scaled. */
static void disturbed(const smpc_moment *mo, const smpc_path *at, int k, real *u, real *force)
{
    memcpy(u, at->u[k], sizeof(real) * SMPC_INPUTS);
    memset(force, 0, sizeof(real) * n);
#if SMPC_DISTURBANCES
    const real *d = mo->given[k] + SMPC_DISTURBANCE_AT;
    smpc_sparse_add(&smpc_offset_by_d, 0, SMPC_INPUTS, d, u);
    smpc_sparse_add(&smpc_force_by_d, 0, n, d, force);
#else
    (void)mo;
#endif
}

/* Strains and rates at a stage; the last stage is the end of the interval. */
static void arm_at_stage(const real *x, const real *a, int kind, int stage, real *q, real *dq)
{
    const real *to_strain = smpc_to_strain[kind] + stage * s;
    const real *to_rate = smpc_to_rate[kind] + stage * s;
    for (int i = 0; i < n; i++) {
        real strain = 0, rate = 0;
        for (int j = 0; j < s; j++) {
            strain += to_strain[j] * a[j * n + i];
            rate += to_rate[j] * a[j * n + i];
        }
        q[i] = x[i] + smpc_of_rate[kind][stage] * smpc_rate_to_strain[i] * x[n + i]
               + smpc_unknown_to_strain[i] * strain;
        dq[i] = smpc_kept[kind] * x[n + i] + smpc_unknown_to_rate[i] * rate;
    }
}

static void at_stages(const real *x, const real *u, const real *a, int kind, stages *v)
{
    memset(v, 0, sizeof *v);
    for (int i = 0; i < s; i++) arm_at_stage(x, a, kind, i, v->q[i], v->dq[i]);
    if (SMPC_ACCELERATES) memcpy(v->a, a, sizeof v->a);
    smpc_sparse_add(&smpc_p_by_z[kind], 0, SMPC_STAGED, x + arm, v->p[0]);
    smpc_sparse_add(&smpc_p_by_u[kind], 0, SMPC_STAGED, u, v->p[0]);
    memcpy(v->end, v->q[s - 1], sizeof(real) * n);
    memcpy(v->end + n, v->dq[s - 1], sizeof(real) * n);
    smpc_sparse_add(&smpc_z_by_z[kind], 0, SMPC_DRIVE, x + arm, v->end + arm);
    smpc_sparse_add(&smpc_z_by_u[kind], 0, SMPC_DRIVE, u, v->end + arm);
}

static const real *state_before(const smpc_moment *mo, const smpc_path *at, int k)
{
    return k ? at->x[k - 1] : mo->x;
}

/* What interval k breaks: residuals of its stages, then the gap to the state after it. */
void smpc_measure_interval(smpc_measured *found, const smpc_moment *mo, const smpc_path *at, int k)
{
    stages v;
    real u[SMPC_INPUTS], force[n], *defects = found->defects[k];
    disturbed(mo, at, k, u, force);
    at_stages(state_before(mo, at, k), u, at->a[k], smpc_kind_of[k], &v);
    for (int i = 0; i < s; i++) {
        smpc_residual(v.q[i], v.dq[i], v.a[i], v.p[i], defects + i * n);
        for (int j = 0; j < n; j++) defects[i * n + j] -= force[j];
    }
    for (int i = 0; i < SMPC_NX; i++) defects[na + i] = v.end[i] - at->x[k][i];
}

/* Slopes of one stage's equations in its own unknowns, and in all else beside the residual. */
static void stage_rows(const stages *v, int kind, int i, real *by_a, real *rows)
{
    real r[n], K[n * n], D[n * n], M[n * n], P[n * SMPC_SIZE(m)];
    smpc_stage(v->q[i], v->dq[i], v->a[i], v->p[i], r, K, D, M, P);
    const real of_rate = smpc_of_rate[kind][i], kept = smpc_kept[kind];
    for (int row = 0; row < n; row++) {
        real *left = by_a + (i * n + row) * na, *right = rows + (i * n + row) * width;
        const real *k = K + row * n, *d = D + row * n;
        memset(right, 0, sizeof(real) * width);
        right[0] = r[row];
        for (int j = 0; j < n; j++) {
            right[1 + j] = k[j];
            right[1 + n + j] = of_rate * smpc_rate_to_strain[j] * k[j] + kept * d[j];
        }
        memcpy(right + 1 + arm + i * m, P + row * m, sizeof(real) * m);
        for (int stage = 0; stage < s; stage++) {
            const real q = smpc_to_strain[kind][i * s + stage];
            const real dq = smpc_to_rate[kind][i * s + stage];
            for (int j = 0; j < n; j++)
                left[stage * n + j] =
                    q * smpc_unknown_to_strain[j] * k[j] + dq * smpc_unknown_to_rate[j] * d[j];
        }
        if (SMPC_ACCELERATES)
            for (int j = 0; j < n; j++) left[i * n + j] += M[row * n + j];
    }
}

/* The end of the arm in the pressures and the state before, with the unknowns eliminated. */
static void eliminate(smpc_interval *to, const real *solved, int kind)
{
    const real *to_strain = smpc_to_strain[kind] + (s - 1) * s;
    const real *to_rate = smpc_to_rate[kind] + (s - 1) * s;
    for (int i = 0; i < n; i++) {
        real strain[width] = {0}, rate[width] = {0};
        for (int j = 0; j < s; j++) {
            const real *row = solved + (j * n + i) * width;
            const real q = smpc_unknown_to_strain[i] * to_strain[j];
            const real dq = smpc_unknown_to_rate[i] * to_rate[j];
            for (int col = 0; col < width; col++) {
                strain[col] -= q * row[col];
                rate[col] -= dq * row[col];
            }
        }
        strain[1 + i] += 1;
        strain[1 + n + i] += smpc_of_rate[kind][s - 1] * smpc_rate_to_strain[i];
        rate[1 + n + i] += smpc_kept[kind];
        to->gap[i] += strain[0];
        to->gap[n + i] += rate[0];
        memcpy(to->arm + i * arm, strain + 1, sizeof(real) * arm);
        memcpy(to->arm + (n + i) * arm, rate + 1, sizeof(real) * arm);
        memcpy(to->pressures + i * SMPC_STAGED, strain + 1 + arm, sizeof(real) * SMPC_STAGED);
        memcpy(to->pressures + (n + i) * SMPC_STAGED, rate + 1 + arm, sizeof(real) * SMPC_STAGED);
    }
}

int smpc_linearise_interval(smpc_linear *l, const smpc_moment *mo, const smpc_path *at, int k)
{
    smpc_interval *to = &l->interval[k];
    const int kind = smpc_kind_of[k];
    real *defects = l->measured.defects[k], u[SMPC_INPUTS], force[n], solved[na * width];
    stages v;
    disturbed(mo, at, k, u, force);
    at_stages(state_before(mo, at, k), u, at->a[k], kind, &v);
    for (int i = 0; i < s; i++) stage_rows(&v, kind, i, to->lu, solved);
    for (int i = 0; i < na; i++) defects[i] = solved[i * width] -= force[i % n];
    for (int i = 0; i < SMPC_NX; i++) to->gap[i] = defects[na + i] = v.end[i] - at->x[k][i];
    if (smpc_lu(to->lu, to->pivot, na)) return -1;
    smpc_lu_solve(to->lu, to->pivot, na, solved, width);
    for (int i = 0; i < na; i++) {
        to->a_0[i] = -solved[i * width];
        memcpy(to->by + i * known, solved + i * width + 1, sizeof(real) * known);
    }
    eliminate(to, solved, kind);
    return 0;
}

int smpc_linearise_motion(smpc_linear *l, const smpc_moment *mo, const smpc_path *at)
{
    for (int k = 0; k < SMPC_N; k++)
        if (smpc_linearise_interval(l, mo, at, k)) return -1;
    return 0;
}
