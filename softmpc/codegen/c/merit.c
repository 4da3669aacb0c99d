/* The l1 merit function that judges how much of a step to take:
 *
 *     cost + sum weight |defect| + sum weight (violation of a limit)
 *
 * With weights above the multipliers of the quadratic program its step is one of descent. */
#include "parts.h"

#include <string.h>

#define MARGIN ((real)1.5) /* weights over multipliers */
#define SHARE ((real)0.1)  /* of the mean multiplier of its kind that a weight is at least */
#define LEAST ((real)1)    /* cost of a scaled unit of defect */

enum { n = SMPC_STRAINS, nu = SMPC_NU, nx = SMPC_NX, na = SMPC_NA };

/* The multipliers of the bounds and rows, where they belong (zero elsewhere). */
static void take_apart(const smpc_program *p, smpc_weights *w)
{
    const real *states = p->multipliers + SMPC_MOVES, *rows = states + SMPC_N * SMPC_BOUNDED;
    memset(w, 0, sizeof *w);
    for (int k = 0; k < SMPC_N; k++) {
        const int block = smpc_block_of[k];
        for (int b = 0; b < SMPC_BOUNDED; b++)
            w->x[k][smpc_bounded[b]] = states[k * SMPC_BOUNDED + b];
        for (int r = 0; r < SMPC_ROWS; r++) w->rows[k][r] = rows[k * SMPC_ROWS + r];
        if (k && smpc_block_of[k - 1] == block) continue; /* a block's are its first interval's */
        for (int i = 0; i < SMPC_INPUTS; i++)
            w->u[k][i] = p->multipliers[block * SMPC_INPUTS + i];
        for (int j = 0; j < SMPC_SLACKS; j++)
            w->u[k][SMPC_INPUTS + j] = p->multipliers[SMPC_MOVED + block * SMPC_SLACKS + j];
    }
}

/* Those of the defects follow from the others backwards through the horizon. */
static void find_nodes(smpc_controller *c)
{
    smpc_weights *w = &c->weights;
    for (int k = 0; k < SMPC_N; k++) {
        real factors[SMPC_SIZE(SMPC_TERMS)];
        smpc_terms_after(&c->linear, k, &c->step, factors);
        memcpy(factors + SMPC_RESIDUALS, w->rows[k], sizeof(real) * SMPC_ROWS);
        memcpy(w->nodes[k], w->x[k], sizeof w->nodes[k]);
        smpc_slopes_of(&c->linear, k, factors, 0, SMPC_TERMS, NULL, NULL, w->nodes[k]);
    }
    if (SMPC_END) {
        real end[SMPC_SIZE(SMPC_END)];
        smpc_end_after(&c->linear, &c->step, end);
        smpc_end_slopes_of(&c->linear, end, NULL, NULL, w->nodes[SMPC_N - 1]);
    }
    smpc_gather(&c->linear, w->nodes, NULL);
}

static void find_stages(const smpc_linear *l, smpc_weights *w)
{
    for (int k = 0; k < SMPC_N; k++) {
        const int kind = smpc_kind_of[k], last = (SMPC_STAGES - 1) * SMPC_STAGES;
        real *stages = w->stages[k];
        for (int j = 0; j < SMPC_STAGES; j++)
            for (int i = 0; i < n; i++)
                stages[j * n + i] =
                    smpc_to_strain[kind][last + j] * smpc_unknown_to_strain[i] * w->nodes[k][i]
                    + smpc_to_rate[kind][last + j] * smpc_unknown_to_rate[i] * w->nodes[k][n + i];
        smpc_lu_solve_transposed(l->interval[k].lu, l->interval[k].pivot, na, stages);
    }
}

static void above(real *multipliers, int count)
{
    real sum = 0, least = LEAST;
    for (int i = 0; i < count; i++) sum += multipliers[i] = (real)fabs(multipliers[i]);
    if (count && SHARE * sum / count > least) least = SHARE * sum / count;
    for (int i = 0; i < count; i++) {
        const real size = MARGIN * multipliers[i];
        multipliers[i] = size > least ? size : least;
    }
}

/* Weights from the multipliers of the program and the step that it gave. */
void smpc_weigh(smpc_controller *c)
{
    smpc_weights *w = &c->weights;
    take_apart(&c->program, w);
    find_nodes(c);
    find_stages(&c->linear, w);
    above(w->stages[0], SMPC_N * na);
    above(w->nodes[0], SMPC_N * nx);
    above(w->u[0], SMPC_N * nu);
    above(w->x[0], SMPC_N * nx);
    if (SMPC_ROWS) above(w->rows[0], SMPC_N * SMPC_ROWS);
}

static real beyond(real value, real low, real high)
{
    const real under = low - value, over = value - high;
    const real most = under > over ? under : over;
    return most > 0 ? most : most <= 0 ? 0 : SMPC_HUGE; /* not a number is far out */
}

real smpc_merit(const smpc_controller *c, const smpc_path *at, const smpc_measured *measured)
{
    const smpc_weights *w = &c->weights;
    real sum = 0;
    for (int k = 0; k < SMPC_N; k++) {
        for (int i = 0; i < na; i++) sum += w->stages[k][i] * (real)fabs(measured->defects[k][i]);
        for (int i = 0; i < nx; i++)
            sum += w->nodes[k][i] * (real)fabs(measured->defects[k][na + i]);
        for (int i = 0; i < nu; i++)
            sum += w->u[k][i] * beyond(at->u[k][i], c->u_low[i], c->u_high[i]);
        for (int b = 0; b < SMPC_BOUNDED; b++) {
            const int i = smpc_bounded[b];
            sum += w->x[k][i] * beyond(at->x[k][i], smpc_x_low[i], smpc_x_high[i]);
        }
        for (int r = 0; r < SMPC_ROWS; r++)
            sum += w->rows[k][r] * beyond(measured->rows[k][r], c->row_low[r], c->row_high[r]);
    }
    return measured->cost + sum;
}

/* Cost of the linearised problem after a step. */
real smpc_predicted(const smpc_controller *c, const smpc_path *step)
{
    real sum = 0, terms[SMPC_SIZE(SMPC_TERMS)], end[SMPC_SIZE(SMPC_END)];
    for (int k = 0; k < SMPC_N; k++) {
        smpc_terms_after(&c->linear, k, step, terms);
        for (int i = 0; i < SMPC_RESIDUALS; i++) sum += terms[i] * terms[i] / 2;
        for (int i = 0; i < nu; i++) sum += smpc_price[i] * step->u[k][i];
    }
    if (SMPC_END) smpc_end_after(&c->linear, step, end);
    for (int i = 0; i < SMPC_END; i++) sum += end[i] * end[i] / 2;
    return sum;
}

static real larger(real a, real b)
{
    return b > a ? b : b <= a ? a : SMPC_HUGE;
}

/* The largest violation of a bound, an equation or a limit. */
real smpc_worst(const smpc_controller *c, const smpc_path *at, const smpc_measured *measured)
{
    real most = 0;
    for (int k = 0; k < SMPC_N; k++) {
        for (int i = 0; i < na + nx; i++)
            most = larger(most, (real)fabs(measured->defects[k][i]));
        for (int i = 0; i < nu; i++)
            most = larger(most, beyond(at->u[k][i], c->u_low[i], c->u_high[i]));
        for (int i = 0; i < nx; i++)
            most = larger(most, beyond(at->x[k][i], smpc_x_low[i], smpc_x_high[i]));
        for (int r = 0; r < SMPC_ROWS; r++)
            most = larger(most, beyond(measured->rows[k][r], c->row_low[r], c->row_high[r]));
    }
    return most;
}
