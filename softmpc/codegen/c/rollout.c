/* A trajectory made anew from a state and inputs, by Newton's method: on all intervals at once where
 * it is near enough, else one by one. */
#include "parts.h"

#include <string.h>

#define AT_ONCE ((real)1e-2) /* of all intervals at once: the next linearisation takes the rest */
#define MOST 12              /* Newton iterations */

enum { na = SMPC_NA, nx = SMPC_NX };

static real largest(const real *x, int count)
{
    real most = 0;
    for (int i = 0; i < count; i++) {
        const real size = (real)fabs(x[i]);
        if (!(size <= most)) most = size;
        if (!(size <= SMPC_HUGE)) return SMPC_HUGE;
    }
    return most;
}

static real worst_of_all(const smpc_measured *measured)
{
    return largest(measured->defects[0], SMPC_N * (na + nx));
}

static int at_once(smpc_controller *c, const smpc_moment *m, smpc_path *at)
{
    const real still[SMPC_NX] = {0};
    for (int iteration = 0; iteration < MOST; iteration++) {
        for (int k = 0; k < SMPC_N; k++)
            if (smpc_linearise_interval(&c->linear, m, at, k)) return -1;
        memset(c->step.u, 0, sizeof c->step.u);
        smpc_spread(&c->linear, still, &c->step, 1);
        for (int k = 0; k < SMPC_N; k++) {
            for (int i = 0; i < na; i++) at->a[k][i] += c->step.a[k][i];
            for (int i = 0; i < nx; i++) at->x[k][i] += c->step.x[k][i];
        }
        for (int k = 0; k < SMPC_N; k++) smpc_measure_interval(&c->measured, m, at, k);
        const real after = worst_of_all(&c->measured);
        if (after <= AT_ONCE) return 0;
        if (!(after < worst_of_all(&c->linear.measured))) return -1;
    }
    return -1;
}

/* As much of a Newton step as makes the residuals smaller; their size, or -1. */
static real go(smpc_controller *c, const smpc_moment *m, smpc_path *at, int k, real before)
{
    static const real shares[] = {1, (real)0.5, (real)0.25, (real)0.1};
    real from[SMPC_NA];
    memcpy(from, at->a[k], sizeof from);
    for (unsigned i = 0; i < sizeof shares / sizeof *shares; i++) {
        for (int j = 0; j < na; j++)
            at->a[k][j] = from[j] + shares[i] * c->linear.interval[k].a_0[j];
        smpc_measure_interval(&c->measured, m, at, k);
        const real after = largest(c->measured.defects[k], na);
        if (after < before) return after;
    }
    return -1;
}

/* Newton's method on one interval from the unknowns given. */
static int newton(smpc_controller *c, const smpc_moment *m, smpc_path *at, int k, const real *guess)
{
    memcpy(at->a[k], guess, sizeof at->a[k]);
    smpc_measure_interval(&c->measured, m, at, k);
    real size = largest(c->measured.defects[k], na);
    for (int iteration = 0; iteration < MOST; iteration++) {
        if (size <= (real)SMPC_ROLLED) {
            for (int i = 0; i < nx; i++) at->x[k][i] += c->measured.defects[k][na + i];
            return 0;
        }
        if (!(size < SMPC_HUGE) || smpc_linearise_interval(&c->linear, m, at, k)) return -1;
        size = go(c, m, at, k, size);
        if (size < 0) return -1;
    }
    return -1;
}

static int one_by_one(smpc_controller *c, const smpc_moment *m, smpc_path *at)
{
    const real none[SMPC_NA] = {0};
    real given[SMPC_NA];
    for (int k = 0; k < SMPC_N; k++) {
        memcpy(given, at->a[k], sizeof given);
        if (newton(c, m, at, k, given) && newton(c, m, at, k, k ? at->a[k - 1] : none)
            && newton(c, m, at, k, none))
            return -1;
    }
    return 0;
}

/* The motion from the moment's state under the inputs of `at`; -1 and no change where there is
 * none. */
int smpc_roll(smpc_controller *c, const smpc_moment *m, smpc_path *at)
{
    memcpy(&c->there, at, sizeof *at);
    for (int k = 0; k < SMPC_N; k++)
        for (int i = 0; i < SMPC_NU; i++) {
            real *u = &at->u[k][i];
            *u = *u < c->u_low[i] ? c->u_low[i] : *u > c->u_high[i] ? c->u_high[i] : *u;
        }
    if (!at_once(c, m, at)) return 0;
    memcpy(at->a, c->there.a, sizeof at->a);
    memcpy(at->x, c->there.x, sizeof at->x);
    if (!one_by_one(c, m, at)) return 0;
    memcpy(at, &c->there, sizeof *at);
    return -1;
}
