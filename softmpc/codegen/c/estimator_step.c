/* The augmented state after some time, and its slope: one implicit step of the arm by Newton's
 * method, Radau IIA in second-order form, with the drive exactly beside it. All is scaled. */
#include "estimator_parts.h"

#include <string.h>

#include "linear.h"
#include "model.h"

enum {
    n = SMPC_STRAINS, m = SMPC_PRESSURES, s = SMPC_FILTER_STAGES, na = SMPC_UNKNOWNS,
    nc = SMPC_CAUSES, arm = SMPC_FILTER_ARM, nx = SMPC_FILTER_X, all = SMPC_FILTERED,
    width = 1 + SMPC_CAUSES
};

static void add_sparse(const smpc_sparse *A, int rows, const real *x, real *y)
{
    for (int i = 0; i < rows; i++)
        for (int p = A->start[i]; p < A->start[i + 1]; p++) y[i] += A->value[p] * x[A->column[p]];
}

/* What the unknowns follow from: strains, rates, pressures at the stages, force. */
static void find_causes(smpc_move *w, const real *at, const real *u)
{
    real v[SMPC_INPUTS], *causes = w->causes;
    for (int i = 0; i < SMPC_INPUTS; i++) v[i] = u[i] / smpc_filter_u_scale[i];
    add_sparse(&smpc_filter_offset_by_d, SMPC_INPUTS, at + nx, v);
    memset(causes, 0, sizeof w->causes);
    memcpy(causes, at, sizeof(real) * arm);
    for (int i = 0; i < s; i++) {
        smpc_move_drive(&w->of, i, at + arm, v, w->z); /* the last stage is the end */
        add_sparse(&smpc_filter_pressure_by_z, m, w->z, causes + arm + i * m);
        add_sparse(&smpc_filter_pressure_by_u, m, v, causes + arm + i * m);
    }
    add_sparse(&smpc_filter_force_by_d, n, at + nx, causes + arm + s * m);
}

/* Strains and rates at a stage. */
static void arm_at(const smpc_move *w, int stage, real *q, real *dq)
{
    const smpc_lasting *of = &w->of;
    for (int i = 0; i < n; i++) {
        const real rate = w->causes[n + i];
        q[i] = w->causes[i] + of->of_rate[stage] * smpc_filter_rate_to_strain[i] * rate;
        dq[i] = of->kept * rate;
        for (int j = 0; j < s; j++) {
            const real a = w->a[j * n + i];
            q[i] += of->to_strain[stage][j] * smpc_filter_unknown_to_strain[i] * a;
            dq[i] += of->to_rate[stage][j] * smpc_filter_unknown_to_rate[i] * a;
        }
    }
}

/* Equations of a stage, and their slopes in unknowns and causes. */
static void stage_rows(smpc_move *w, int stage)
{
    real q[n], dq[n], still[n] = {0}, r[n], K[n * n], D[n * n], M[n * n];
    real P[n * SMPC_SIZE(m)];
    const smpc_lasting *of = &w->of;
    const real *causes = w->causes, *a = SMPC_ACCELERATES ? w->a + stage * n : still;
    arm_at(w, stage, q, dq);
    smpc_stage(q, dq, a, causes + arm + stage * m, r, K, D, M, P);
    for (int i = 0; i < n; i++) {
        real *left = w->by_a + (stage * n + i) * na, *right = w->right + (stage * n + i) * width;
        const real *k = K + i * n, *d = D + i * n;
        memset(right, 0, sizeof(real) * width);
        right[0] = r[i] - causes[arm + s * m + i];
        for (int j = 0; j < n; j++) {
            const real of_rate = of->of_rate[stage] * smpc_filter_rate_to_strain[j];
            right[1 + j] = k[j];
            right[1 + n + j] = of_rate * k[j] + of->kept * d[j];
        }
        memcpy(right + 1 + arm + stage * m, P + i * m, sizeof(real) * m);
        right[1 + arm + s * m + i] = -1;
        for (int other = 0; other < s; other++)
            for (int j = 0; j < n; j++)
                left[other * n + j] =
                    of->to_strain[stage][other] * smpc_filter_unknown_to_strain[j] * k[j]
                    + of->to_rate[stage][other] * smpc_filter_unknown_to_rate[j] * d[j];
        for (int j = 0; SMPC_ACCELERATES && j < n; j++) left[stage * n + j] += M[i * n + j];
    }
}

/* Where Newton's method begins: what the step before makes likely. */
static void guess(smpc_move *w, const smpc_stages *before)
{
    real change[nc];
    memset(w->a, 0, sizeof w->a);
    if (!before->known) return;
    for (int i = 0; i < nc; i++) change[i] = w->causes[i] - before->causes[i];
    memcpy(w->a, before->a, sizeof w->a);
    smpc_add_product(before->slope, na, nc, change, w->a);
}

static int solve_stages(smpc_move *w, smpc_stages *stages)
{
    guess(w, stages);
    for (int k = 0; k < SMPC_NEWTON_ITERATIONS; k++) {
        real most = 0;
        for (int i = 0; i < s; i++) stage_rows(w, i);
        if (smpc_lu(w->by_a, w->pivot, na)) return SMPC_STEP_UNSOLVED;
        smpc_lu_solve(w->by_a, w->pivot, na, w->right, width);
        for (int i = 0; i < na; i++) {
            const real change = (real)fabs(w->right[i * width]);
            w->a[i] -= w->right[i * width];
            if (change > most) most = change;
        }
        if (!smpc_all_finite(w->a, na)) return SMPC_STEP_UNSOLVED;
        if (most > (real)SMPC_NEWTON_CONVERGED) continue;
        stages->known = 1;
        memcpy(stages->causes, w->causes, sizeof w->causes);
        memcpy(stages->a, w->a, sizeof w->a);
        for (int i = 0; i < na; i++)
            for (int j = 0; j < nc; j++) stages->slope[i * nc + j] = -w->right[i * width + 1 + j];
        return SMPC_NO_TROUBLE;
    }
    return SMPC_STEP_UNSOLVED;
}

/* Slopes of strains and rates at the end in the causes. */
static void end_rows(smpc_move *w, const real *slope)
{
    const smpc_lasting *of = &w->of;
    memset(w->ends, 0, sizeof w->ends);
    for (int i = 0; i < n; i++) {
        real *strain = w->ends + i * nc, *rate = w->ends + (n + i) * nc;
        for (int j = 0; j < s; j++) {
            const real q = of->to_strain[s - 1][j] * smpc_filter_unknown_to_strain[i];
            const real dq = of->to_rate[s - 1][j] * smpc_filter_unknown_to_rate[i];
            const real *row = slope + (j * n + i) * nc;
            for (int c = 0; c < nc; c++) {
                strain[c] += q * row[c];
                rate[c] += dq * row[c];
            }
        }
        strain[i] += 1;
        strain[n + i] += of->of_rate[s - 1] * smpc_filter_rate_to_strain[i];
        rate[n + i] += of->kept;
    }
}

/* ... and in the augmented state. */
static void slope_of_arm(smpc_move *w)
{
    const smpc_sparse *F = &smpc_filter_force_by_d;
    memset(w->A, 0, sizeof w->A);
    for (int i = 0; i < arm; i++) {
        real *to = w->A + i * all;
        const real *from = w->ends + i * nc;
        memcpy(to, from, sizeof(real) * arm);
        for (int stage = 0; stage < s; stage++)
            for (int j = 0; j < m; j++) {
                const real f = from[arm + stage * m + j];
                const int last = smpc_filter_pressure_start[j + 1];
                for (int p = smpc_filter_pressure_start[j]; p < last; p++)
                    to[smpc_filter_pressure_column[p]] += f * w->of.pressure_rows[stage][p];
            }
        for (int j = 0; j < n; j++)
            for (int p = F->start[j]; p < F->start[j + 1]; p++)
                to[nx + F->column[p]] += from[arm + s * m + j] * F->value[p];
    }
}

static int one_step(smpc_belief *b, smpc_move *w, const real *u, real seconds)
{
    find_causes(w, b->s, u);
    int trouble = solve_stages(w, &b->stages);
    if (trouble) return trouble;
    arm_at(w, s - 1, b->s, b->s + n);
    memcpy(b->s + arm, w->z, sizeof(real) * SMPC_DRIVE);
    end_rows(w, b->stages.slope);
    slope_of_arm(w);
    smpc_predict(b, w, seconds, smpc_linearising_leaves(b->P));
    return SMPC_NO_TROUBLE;
}

int smpc_advance(smpc_belief *b, smpc_move *w, const real *u, int64_t ticks)
{
    if (ticks <= 0) return SMPC_NO_TROUBLE;
    if (ticks > SMPC_LONGEST_GAP) return SMPC_GAP_TOO_LONG;
    const int pieces = ((int)ticks + SMPC_LONGEST_TICKS - 1) / SMPC_LONGEST_TICKS;
    const real seconds = (real)ticks * (real)SMPC_TICK / (real)pieces;
    smpc_prepare_step(&w->of, seconds);
    for (int k = 0; k < pieces; k++) {
        int trouble = one_step(b, w, u, seconds);
        if (trouble) return trouble;
    }
    return SMPC_NO_TROUBLE;
}
