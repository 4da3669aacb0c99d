/* The quadratic program in the moves, by DAQP from the active set before.
 *
 * Most rows are far from their bounds and most slacks at theirs: the program begins with the rows
 * that are active or nearly so, and gets those that its answer breaks, until it breaks none. Slacks
 * that no such row has are alone and need no solver. With v = L^-T y and H = L L^T
 *
 *     1/2 v.H v + f.v = 1/2 |y|^2 + g.y + constant      g = L^-1 f
 *
 * is the form that DAQP works on; its workspace is filled here, so that nothing is allocated. */
#include "ldp.h"
#include "parts.h"

#include <string.h>

#define NEAR ((real)0.01)     /* of a scaled bound without any move: rows to begin with */
#define SMALL ((real)1e-9)    /* of the largest multiplier: those below belong to nothing active */

enum { moved = SMPC_MOVED, moves = SMPC_MOVES, rows = SMPC_PROGRAM_ROWS };

static int crossed(const smpc_program *p)
{
    for (int i = 0; i < moves; i++)
        if (p->low[i] > p->high[i]) return 1;
    for (int i = 0; i < rows; i++)
        if (p->row_low[i] > p->row_high[i]) return 1;
    return 0;
}

/* What no solver needs to be asked about. */
static int wrong(const smpc_program *p, int not_convex)
{
    if (!smpc_all_finite(p->f, moves) || !smpc_all_finite(p->H_diagonal, moves))
        return SMPC_QP_NOT_FINITE;
    if (SMPC_MOVING_ROWS && !smpc_all_finite(p->moving[0], SMPC_MOVING_ROWS * SMPC_N * moves))
        return SMPC_QP_NOT_FINITE;
    if (not_convex) return SMPC_QP_NOT_CONVEX;
    return crossed(p) ? SMPC_QP_INFEASIBLE : 0;
}

/* Which constraints to begin with, from multipliers: 1 at the upper bound, -1 at the lower one. */
static void signs(smpc_program *p)
{
    real most = 0;
    for (int i = 0; i < moves + rows; i++)
        if (fabs(p->multipliers[i]) > most) most = (real)fabs(p->multipliers[i]);
    for (int i = 0; i < moves + rows; i++) {
        const real value = p->multipliers[i];
        p->active[i] = (signed char)(value > SMALL * most ? 1 : value < -SMALL * most ? -1 : 0);
    }
}

static int any(const signed char *active, int count)
{
    for (int i = 0; i < count; i++)
        if (active[i]) return 1;
    return 0;
}

/* By how much a row is beyond its nearer bound; below zero within them. */
static real excess(const smpc_program *p, int row)
{
    const real value = smpc_row_times(p, row, p->v);
    const real under = p->row_low[row] - value, over = value - p->row_high[row];
    return under > over ? under : over;
}

/* The best value of each slack if no row mattered, and its multiplier. */
static void alone(smpc_program *p)
{
    for (int i = moved; i < moves; i++) {
        const real best = -p->f[i] / p->H_diagonal[i];
        p->v[i] = best < p->low[i] ? p->low[i] : best > p->high[i] ? p->high[i] : best;
        p->multipliers[i] = p->H_diagonal[i] * (best - p->v[i]);
    }
}

/* Whether the best inputs without any bound are within all of them. */
static int unbounded(smpc_program *p)
{
    for (int i = 0; i < moved; i++) p->v[i] = -p->f[i];
    smpc_forward(p->H, moved, p->v);
    smpc_backward(p->H, moved, p->v);
    for (int i = 0; i < moved; i++)
        if (!(p->v[i] >= p->low[i] && p->v[i] <= p->high[i])) return 0;
    for (int i = 0; i < rows; i++)
        if (!(excess(p, i) <= SMPC_BROKEN)) return 0;
    return 1;
}

/* Take the rows that the answer breaks; whether there were any. */
static int take_broken(smpc_controller *c)
{
    int found = 0;
    for (int i = 0; i < rows; i++)
        if (!c->qp.taken[i] && excess(&c->program, i) > SMPC_BROKEN) found = c->qp.taken[i] = 1;
    return found;
}

static int begin(smpc_controller *c)
{
    smpc_program *p = &c->program;
    int close = 0;
    if (p->any_active)
        signs(p);
    else
        memset(p->active, 0, sizeof p->active);
    for (int i = 0; i < rows; i++) {
        const real nearest = p->row_low[i] > -p->row_high[i] ? p->row_low[i] : -p->row_high[i];
        c->qp.taken[i] = p->active[moves + i] != 0 || nearest > -NEAR;
        close |= c->qp.taken[i];
    }
    return close || any(p->active, moved);
}

/* Whether a bound of an input or a row holds in the solution; slacks are at theirs nearly always. */
static int at_bounds(const smpc_program *p)
{
    for (int i = 0; i < moves + rows; i++)
        if (p->multipliers[i] != 0 && (i < moved || i >= moves)) return 1;
    return 0;
}

/* Rounds of DAQP until no row is broken that was left out. */
static int rounds(smpc_controller *c, double deadline)
{
    smpc_program *p = &c->program;
    for (;;) {
        memset(p->multipliers, 0, sizeof p->multipliers);
        alone(p);
        int found = smpc_least_distance(c, deadline);
        if (found != SMPC_QP_OPTIMAL && found != SMPC_QP_TIME_LIMIT
            && found != SMPC_QP_TOO_MANY_ROWS && any(p->active, moves + rows)) {
            memset(p->active, 0, sizeof p->active); /* a guess that leads nowhere is left */
            continue;
        }
        if (found != SMPC_QP_OPTIMAL || !take_broken(c)) return found;
        signs(p);
    }
}

int smpc_solve_program(smpc_controller *c, double deadline)
{
    smpc_program *p = &c->program;
    p->iterations = p->rows = 0;
    const int said = wrong(p, p->flag);
    if (said) return said;
    const int bounded = begin(c);
    if (!bounded && c->cap > 1) { /* to find no bound in the way is DAQP's first iteration */
        memset(p->multipliers, 0, sizeof p->multipliers);
        alone(p);
        p->bounded = 0;
        if (unbounded(p)) return SMPC_QP_OPTIMAL;
    }
    if (!p->has_inverse) smpc_inverse_packed(p->H, moved, p->inverse);
    p->has_inverse = 1;
    const int found = rounds(c, deadline);
    p->bounded = found == SMPC_QP_OPTIMAL && at_bounds(p);
    if (found == SMPC_QP_OPTIMAL && !smpc_all_finite(p->v, moves)) return SMPC_QP_NOT_OPTIMAL;
    return found;
}

/* Multipliers of the program a step later: those of each interval become its predecessor's. */
void smpc_later_active(smpc_program *p)
{
    real *m = p->multipliers;
    if (!p->any_active) return;
    real kept[SMPC_MOVES];
    memcpy(kept, m, sizeof kept);
    for (int b = 0; b < SMPC_BLOCKS; b++) {
        const int next = smpc_block_later[b]; /* the block that begins an interval later, or -1 */
        for (int i = 0; i < SMPC_INPUTS; i++)
            m[b * SMPC_INPUTS + i] = next < 0 ? 0 : kept[next * SMPC_INPUTS + i];
        for (int j = 0; j < SMPC_SLACKS; j++)
            m[moved + b * SMPC_SLACKS + j] = next < 0 ? 0 : kept[moved + next * SMPC_SLACKS + j];
    }
    real *states = m + moves, *limits = states + SMPC_N * SMPC_BOUNDED;
    for (int i = 0; i < (SMPC_N - 1) * SMPC_BOUNDED; i++) states[i] = states[i + SMPC_BOUNDED];
    for (int i = 0; i < (SMPC_N - 1) * SMPC_ROWS; i++) limits[i] = limits[i + SMPC_ROWS];
}
