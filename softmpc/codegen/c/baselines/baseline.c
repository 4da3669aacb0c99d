/* What all simple controllers have in common: checks, the guard of the input, the report. */
#include <string.h>

#include "guard.h"
#include "parts.h"

enum { inputs = SMPC_INPUTS };

static double now(const smpc_controller *c)
{
    return c->clock ? c->clock(c->clock_with) : 0;
}

unsigned long smpc_memory(void)
{
    return (unsigned long)sizeof(smpc_controller);
}

void smpc_init(smpc_controller *c)
{
    memset(c, 0, sizeof *c);
    smpc_widest(c);
}

void smpc_set_reference(smpc_controller *c, const real *references)
{
    memcpy(c->references, references, sizeof c->references);
}

void smpc_set_clock(smpc_controller *c, double (*clock)(void *), void *with, double budget)
{
    c->clock = clock;
    c->clock_with = with;
    c->budget = clock && budget > 0 ? budget : 0;
}

/* There is no quadratic program, so there is nothing to cap. */
void smpc_set_cap(smpc_controller *c, unsigned cap)
{
    (void)c;
    (void)cap;
}

const smpc_report *smpc_last(const smpc_controller *c)
{
    return &c->report;
}

int smpc_nearest(const real *tip)
{
    int found = 0;
    real least = SMPC_HUGE;
    for (int p = 0; p < SMPC_PLACES; p++) {
        real off = 0;
        for (int i = 0; i < 3; i++) {
            const real d = smpc_places[3 * p + i] - tip[i];
            off += d * d;
        }
        if (off < least) {
            least = off;
            found = p;
        }
    }
    return found;
}

void smpc_prepare(smpc_controller *c, const real *u_before)
{
    const double began = now(c);
    c->asked = 1;
    c->finite = smpc_make_finite(c, u_before, c->u_before);
    c->finite &= smpc_all_finite(c->references, SMPC_NR);
    c->prepare_seconds = now(c) - began;
}

/* The input that follows from what is wanted, or the one before where nothing is. */
static void conclude(smpc_controller *c, const real *wanted, real *u)
{
    smpc_report *r = &c->report;
    const real *from = r->status == SMPC_SOLVED ? wanted : c->u_before;
    r->source = r->status == SMPC_SOLVED ? SMPC_FROM_SOLUTION : SMPC_HELD;
    smpc_guarded(c, c->u_before, from, u);
    for (int i = 0; i < inputs; i++) r->clipped |= u[i] != from[i];
    memcpy(c->last_u, u, sizeof c->last_u);
    c->has_last = 1;
}

int smpc_feedback(smpc_controller *c, const real *x, real *u)
{
    const double began = now(c);
    const int failures = c->report.failures;
    smpc_report *r = &c->report;
    real wanted[SMPC_INPUTS], integral[3];
    memset(r, 0, sizeof *r);
    if (!c->asked) smpc_prepare(c, c->last_u);
    c->asked = 0;
    memcpy(integral, c->integral, sizeof integral);
    r->status = SMPC_INPUT_NOT_FINITE;
    if (c->finite && smpc_all_finite(x, SMPC_NX)) {
        smpc_wanted(c, x, wanted);
        r->status = smpc_all_finite(wanted, inputs) ? SMPC_SOLVED : SMPC_FAILED;
    }
    r->seconds = c->prepare_seconds + now(c) - began;
    if (r->status == SMPC_SOLVED && c->budget > 0 && r->seconds > c->budget)
        r->status = SMPC_BUDGET_OVERRUN;
    r->failures = r->status == SMPC_SOLVED ? 0 : failures + (failures < SMPC_MOST_FAILURES);
    conclude(c, wanted, u);
    if (r->clipped || r->status != SMPC_SOLVED) /* what is not acted upon is not added up */
        memcpy(c->integral, integral, sizeof integral);
    return r->status;
}

int smpc_step(smpc_controller *c, const real *x, const real *u_before, real *u)
{
    smpc_prepare(c, u_before);
    return smpc_feedback(c, x, u);
}
