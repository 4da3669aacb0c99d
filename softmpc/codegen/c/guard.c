/* The last guard of an input, and the limits that a user may narrow. */
#include "guard.h"

#include "parts.h"

#include <string.h>

enum { inputs = SMPC_INPUTS };

static real within(real value, real low, real high)
{
    if (!(value >= low)) value = low; /* not a number too */
    return value <= high ? value : high;
}

void smpc_inside(const smpc_controller *c, const real *u, real *to)
{
    for (int i = 0; i < inputs; i++) to[i] = within(u[i], c->low[i], c->high[i]);
}

void smpc_guarded(const smpc_controller *c, const real *before, const real *u, real *to)
{
    for (int i = 0; i < inputs; i++) {
        const real near = within(u[i], before[i] + c->fall[i], before[i] + c->rise[i]);
        to[i] = within(near, c->low[i], c->high[i]);
    }
}

int smpc_make_finite(const smpc_controller *c, const real *u, real *to)
{
    real none[SMPC_INPUTS] = {0};
    if (!c->has_last) smpc_inside(c, none, none);
    for (int i = 0; i < inputs; i++)
        to[i] = fabs(u[i]) <= SMPC_HUGE ? u[i] : c->has_last ? c->last_u[i] : none[i];
    return smpc_all_finite(u, inputs);
}

#ifdef SMPC_ROWS /* a controller that plans: it plans within the same limits */
static real larger(real a, real b)
{
    return a > b ? a : b;
}

static real smaller(real a, real b)
{
    return a < b ? a : b;
}

static void limit_plan(smpc_controller *c)
{
    memcpy(c->u_low, smpc_u_low, sizeof c->u_low);
    memcpy(c->u_high, smpc_u_high, sizeof c->u_high);
    memcpy(c->row_low, smpc_row_low, sizeof c->row_low);
    memcpy(c->row_high, smpc_row_high, sizeof c->row_high);
    for (int i = 0; i < inputs; i++) {
        const real scale = smpc_u_scale[i];
        const int row = smpc_rate_row[i]; /* of the limit of its change, -1: it has none */
        c->u_low[i] = larger(c->u_low[i], c->low[i] / scale);
        c->u_high[i] = smaller(c->u_high[i], c->high[i] / scale);
        if (row < 0) continue;
        c->row_low[row] = larger(c->row_low[row], c->fall[i] / scale);
        c->row_high[row] = smaller(c->row_high[row], c->rise[i] / scale);
    }
}
#else
static void limit_plan(smpc_controller *c)
{
    (void)c;
}
#endif

void smpc_widest(smpc_controller *c)
{
    memcpy(c->low, smpc_least_input, sizeof c->low);
    memcpy(c->high, smpc_most_input, sizeof c->high);
    memcpy(c->fall, smpc_most_fall, sizeof c->fall);
    memcpy(c->rise, smpc_most_rise, sizeof c->rise);
    limit_plan(c);
}

int smpc_set_limits(
    smpc_controller *c, const real *low, const real *high, const real *fall, const real *rise)
{
    real bounds[4][SMPC_INPUTS];
    const real *given[4] = {low, high, fall, rise};
    const real *widest_of[4] = {smpc_least_input, smpc_most_input, smpc_most_fall, smpc_most_rise};
    real *to[4] = {c->low, c->high, c->fall, c->rise};
    for (int b = 0; b < 4; b++)
        for (int i = 0; i < inputs; i++) {
            const real wide = widest_of[b][i], value = given[b] ? given[b][i] : wide;
            if (value != value) return -1;
            const int wider = b % 2 ? value > wide : value < wide;
            bounds[b][i] = wider ? wide : value;
        }
    for (int i = 0; i < inputs; i++)
        if (!(bounds[0][i] < bounds[1][i]) || !(bounds[2][i] < bounds[3][i])) return -1;
    for (int b = 0; b < 4; b++) memcpy(to[b], bounds[b], sizeof bounds[b]);
    limit_plan(c);
    return 0;
}
