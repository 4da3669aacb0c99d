/* See log.h. */
#include "log.h"

#include <math.h>
#include <string.h>

enum { constraints = SMPC_MOVES + SMPC_PROGRAM_ROWS };

void smpc_log_step(
    smpc_recorder *r, const smpc_controller *c, const smpc_real *u_before, const smpc_real *x,
    const smpc_real *u)
{
    const smpc_report *report = &c->report;
    const float prepare = (float)c->prepare_seconds;
    smpc_outcome outcome;
    outcome.status = report->status;
    outcome.qp = report->qp;
    outcome.source = report->source;
    outcome.clipped = report->clipped;
    outcome.iterations = (unsigned)report->iterations;
    outcome.active = (unsigned)report->active;
    outcome.kkt = report->kkt;
    outcome.violation = report->violation;
    outcome.prepare_seconds = c->clock ? prepare : (float)NAN;
    outcome.feedback_seconds = c->clock ? (float)report->seconds - prepare : (float)NAN;
    smpc_record_step(r, c->references[0], u_before, x, u, &outcome);
}

void smpc_log_snapshot(smpc_recorder *r, const smpc_controller *c)
{
    smpc_snapshot s;
    const int planned = c->age >= 0;
    s.age = planned ? (unsigned)c->age : 0;
    s.failures = (unsigned)c->failures;
    s.u = c->has_last ? c->last_u : NULL;
    s.plan = planned ? (const smpc_real *)&c->plan : NULL;
    s.expected = c->expected;
    s.multipliers = c->program.any_active ? c->program.multipliers : NULL;
    s.plan_count = SMPC_PATH_SIZE;
    s.multiplier_count = constraints;
    s.violation = c->violation;
    smpc_record_snapshot(r, &s);
}

void smpc_log_settings(smpc_recorder *r, const smpc_controller *c)
{
    smpc_record_limits(r, c->low, c->high, c->fall, c->rise);
    smpc_record_settings(r, c->budget, c->cap == SMPC_QP_ITERATIONS ? 0 : (uint32_t)c->cap);
}

int smpc_restore(smpc_controller *c, const smpc_snapshot *s)
{
    double (*clock)(void *);
    void *with;
    double budget;
    if ((s->plan && s->plan_count != SMPC_PATH_SIZE)
        || (s->multipliers && s->multiplier_count != constraints)) {
        return -1;
    }
    clock = c->clock;
    with = c->clock_with;
    budget = c->budget;
    smpc_init(c);
    smpc_set_clock(c, clock, with, budget);
    c->failures = (int)s->failures;
    if (s->u) {
        memcpy(c->last_u, s->u, sizeof c->last_u);
        c->has_last = 1;
    }
    if (s->plan) {
        memcpy(&c->plan, s->plan, sizeof c->plan);
        memcpy(c->expected, s->expected, sizeof c->expected);
        c->age = (int)s->age;
        c->violation = s->violation;
    }
    if (s->multipliers) {
        memcpy(c->program.multipliers, s->multipliers, sizeof c->program.multipliers);
        c->program.any_active = 1;
    }
    return 0;
}
