/* One real-time iteration: linearise and condense before the state is known, the rest when it is. */
#include "parts.h"

#include <string.h>

#define DECREASE ((real)1e-4) /* of what the linearised problem promises, that a step must bring */

enum { nu = SMPC_NU, nx = SMPC_NX, moved = SMPC_MOVED };

/* Around the trajectory c->at, from the state c->moment.x that is expected; -1 where there is
 * nothing to go on. */
int smpc_iterate_prepare(smpc_controller *c)
{
    smpc_later_active(&c->program);
    if (smpc_linearise_motion(&c->linear, &c->moment, &c->at)) return -1;
    smpc_linearise_terms(&c->linear, &c->moment, &c->at);
    c->program.flag = smpc_condense(c);
    if (!c->program.flag && c->program.bounded) { /* it will be needed again */
        smpc_inverse_packed(c->program.H, moved, c->program.inverse);
        c->program.has_inverse = 1;
    }
    return 0;
}

/* Of the moves to the whole trajectory. */
static void expand(smpc_controller *c, const real *dx)
{
    const real *v = c->program.v;
    for (int k = 0; k < SMPC_N; k++) {
        const int block = smpc_block_of[k];
        memcpy(c->step.u[k], v + block * SMPC_INPUTS, sizeof(real) * SMPC_INPUTS);
        for (int j = 0; j < SMPC_SLACKS; j++)
            c->step.u[k][SMPC_INPUTS + j] = v[moved + block * SMPC_SLACKS + j];
    }
    smpc_spread(&c->linear, dx, &c->step, 1);
}

/* What the cost would still fall by: the largest entry of |H v|, with H = L L^T. */
static real slope_left(const smpc_program *p)
{
    real most = 0, upper[SMPC_MOVED] = {0};
    for (int i = 0; i < moved; i++)
        for (int j = 0; j <= i; j++) upper[j] += p->H[i * moved + j] * p->v[i];
    for (int i = 0; i < moved; i++) {
        real sum = 0;
        for (int j = 0; j <= i; j++) sum += p->H[i * moved + j] * upper[j];
        if (fabs(sum) > most) most = (real)fabs(sum);
    }
    for (int i = moved; i < SMPC_MOVES; i++)
        if (fabs(p->H_diagonal[i] * p->v[i]) > most) most = (real)fabs(p->H_diagonal[i] * p->v[i]);
    return most;
}

static void move(const smpc_path *at, const smpc_path *step, real share, smpc_path *to)
{
    for (int k = 0; k < SMPC_N; k++) {
        for (int i = 0; i < nu; i++) to->u[k][i] = at->u[k][i] + share * step->u[k][i];
        for (int i = 0; i < SMPC_NA; i++) to->a[k][i] = at->a[k][i] + share * step->a[k][i];
        for (int i = 0; i < nx; i++) to->x[k][i] = at->x[k][i] + share * step->x[k][i];
    }
}

/* As much of the step as makes the merit function smaller; nothing where none does. `here` is what
 * the start is like; c->there and c->measured become what was taken. */
static real globalise(smpc_controller *c, const smpc_measured *here)
{
    static const real shares[] = {1, (real)0.5, (real)0.25, (real)0.1, (real)0.02};
    const real now = smpc_merit(c, &c->at, here);
    real promised = now - smpc_predicted(c, &c->step);
    for (int k = 0; k < SMPC_N; k++)
        for (int i = 0; i < nu; i++) promised -= c->at.u[k][i] * smpc_price[i];
    if (!(promised > 0)) promised = 0;
    for (unsigned i = 0; i < sizeof shares / sizeof *shares; i++) {
        move(&c->at, &c->step, shares[i], &c->there);
        smpc_measure(&c->measured, &c->moment, &c->there);
        const real wanted = now - DECREASE * shares[i] * promised + SMPC_ROUNDING * (real)fabs(now);
        if (smpc_merit(c, &c->there, &c->measured) <= wanted) return shares[i];
    }
    memcpy(&c->there, &c->at, sizeof c->at);
    memcpy(&c->measured, here, sizeof *here);
    return 0;
}

/* What the start is like from the state as measured: only its first interval changes. */
static void look_again(smpc_controller *c)
{
    smpc_measure_interval(&c->linear.measured, &c->moment, &c->at, 0);
}

/* The rest, from c->moment.x as measured; `expected` is the state that was prepared for. The new
 * trajectory is c->there. Returns whether it is a solution; c->report says more. */
static int finish(smpc_controller *c, const real *expected, double deadline)
{
    smpc_report *r = &c->report;
    real dx[SMPC_NX];
    int moved_away = 0;
    for (int i = 0; i < nx; i++) moved_away |= (dx[i] = c->moment.x[i] - expected[i]) != 0;
    memset(c->step.u, 0, sizeof c->step.u);
    smpc_spread(&c->linear, dx, &c->step, 0);
    smpc_make_program(c, &c->step);
    r->qp = smpc_solve_program(c, deadline);
    r->iterations = c->program.iterations;
    c->program.any_active = r->qp == SMPC_QP_OPTIMAL; /* never from a failure */
    if (moved_away) look_again(c);
    if (r->qp != SMPC_QP_OPTIMAL) {
        memcpy(&c->there, &c->at, sizeof c->at);
        r->violation = smpc_worst(c, &c->at, &c->linear.measured);
        return 0;
    }
    expand(c, dx);
    smpc_weigh(c);
    r->share = globalise(c, &c->linear.measured);
    r->cost = c->measured.cost;
    r->violation = smpc_worst(c, &c->there, &c->measured);
    r->kkt = slope_left(&c->program);
    if (r->violation > r->kkt) r->kkt = r->violation;
    return smpc_finite(&c->measured);
}

int smpc_iterate_feedback(smpc_controller *c, const real *x, double deadline)
{
    real expected[SMPC_NX];
    memcpy(expected, c->moment.x, sizeof expected);
    memcpy(c->moment.x, x, sizeof expected);
    return finish(c, expected, deadline);
}
