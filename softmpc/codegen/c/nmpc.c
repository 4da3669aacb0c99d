/* Model predictive control: one iteration a step, and what to do when it fails.
 *
 * A failed solve is never used as a warm start; the last good plan is followed instead, and after a
 * few failures in a row the solver starts afresh from the arm at rest. */
#include "guard.h"
#include "parts.h"

#include <string.h>

#define CONSISTENT ((real)0.1) /* largest violation of a plan that an iteration may begin with */
#define FEASIBLE ((real)SMPC_FEASIBLE) /* of a start that is used at the iteration cap */
/* By how much the last guard must change a scaled input to be reported. */
#define CLIPPED ((real)1e-6 + 1024 * SMPC_EPSILON)

enum { inputs = SMPC_INPUTS, nx = SMPC_NX };

static double now(const smpc_controller *c)
{
    return c->clock ? c->clock(c->clock_with) : 0;
}

static int over(const smpc_controller *c)
{
    return c->age >= SMPC_PLAN_STEPS;
}

static int starts_afresh(const smpc_controller *c)
{
    return c->failures >= SMPC_RESTART_AFTER || c->age < 0 || over(c);
}

unsigned long smpc_memory(void)
{
    return (unsigned long)sizeof(smpc_controller);
}

void smpc_init(smpc_controller *c)
{
    memset(c, 0, sizeof *c);
    c->age = -1;
    c->cap = SMPC_QP_ITERATIONS;
    smpc_widest(c);
}

void smpc_set_reference(smpc_controller *c, const real *references)
{
    if (SMPC_NR) memcpy(c->references, references, sizeof(real) * SMPC_N * SMPC_NR);
}

void smpc_set_clock(smpc_controller *c, double (*clock)(void *), void *with, double budget)
{
    c->clock = clock;
    c->clock_with = with;
    c->budget = clock && budget > 0 ? budget : 0;
}

void smpc_set_cap(smpc_controller *c, unsigned cap)
{
    c->cap = cap && cap < SMPC_QP_ITERATIONS ? (int)cap : SMPC_QP_ITERATIONS;
}

const smpc_report *smpc_last(const smpc_controller *c)
{
    return &c->report;
}

/* The plan from this step on; made anew where it breaks the arm's equations. */
static void begin_at_plan(smpc_controller *c)
{
    memcpy(&c->at, &c->plan, sizeof c->plan);
    if (!(c->violation <= CONSISTENT)) smpc_roll(c, &c->moment, &c->at);
}

/* The arm stays where it is, under the inputs that are planned, or the one until now. */
static void begin_at_rest(smpc_controller *c)
{
    memset(&c->at, 0, sizeof c->at);
    for (int k = 0; k < SMPC_N; k++) {
        real u[SMPC_INPUTS];
        smpc_inside(c, SMPC_PLANNED ? c->references[k] + SMPC_PLANNED_AT : c->u_before, u);
        for (int i = 0; i < inputs; i++) c->at.u[k][i] = u[i] / smpc_u_scale[i];
        memcpy(c->at.x[k], c->moment.x, sizeof c->moment.x);
    }
    smpc_roll(c, &c->moment, &c->at);
}

void smpc_prepare(smpc_controller *c, const real *u_before)
{
    const double began = now(c);
    c->asked = 1;
    c->finite = smpc_make_finite(c, u_before, c->u_before);
    c->finite &= SMPC_NR == 0 || smpc_all_finite(c->references[0], SMPC_N * SMPC_NR);
    c->prepared = c->broken = 0;
    memset(c->moment.u_before, 0, sizeof c->moment.u_before);
    for (int i = 0; i < inputs; i++) c->moment.u_before[i] = c->u_before[i] / smpc_u_scale[i];
    memcpy(c->moment.given, c->references, sizeof c->references);
    if (c->finite && !starts_afresh(c)) {
        memcpy(c->moment.x, c->expected, sizeof c->expected);
        begin_at_plan(c);
        c->broken = smpc_iterate_prepare(c);
        c->prepared = !c->broken;
    }
    c->prepare_seconds = now(c) - began;
}

/* One iteration from the state as measured (scaled); whether it gave a solution. */
static int attempt(smpc_controller *c, const real *x, double began)
{
    double deadline = began;
    if (starts_afresh(c)) {
        c->program.any_active = 0;
        memcpy(c->moment.x, x, sizeof c->moment.x);
        begin_at_rest(c);
        c->report.restarted = 1;
    } else if (!c->prepared && !c->broken) {
        memcpy(c->moment.x, x, sizeof c->moment.x);
        begin_at_plan(c);
    }
    if (!c->prepared && !c->broken) c->broken = smpc_iterate_prepare(c);
    if (c->broken) {
        c->report.qp = SMPC_QP_SINGULAR;
        return 0;
    }
    if (c->budget > 0) { /* where nothing is left, the result is of use in the next step */
        const double left = c->budget - c->prepare_seconds - (now(c) - began);
        deadline = now(c) + (left > 0 ? left : c->budget);
    }
    return smpc_iterate_feedback(c, x, deadline);
}

static int usable(const smpc_controller *c, int solved)
{
    const int capped = c->report.qp == SMPC_QP_ITERATION_LIMIT && c->report.violation <= FEASIBLE;
    return (solved || capped) && smpc_all_finite((const real *)&c->there, SMPC_PATH_SIZE);
}

static int status_of(const smpc_controller *c, int solved, int good, int late)
{
    if (c->report.qp == SMPC_QP_TIME_LIMIT) return SMPC_BUDGET_OVERRUN;
    if (solved && !good) return SMPC_FAILED;
    if (late && good) return SMPC_BUDGET_OVERRUN;
    if (c->report.qp == SMPC_QP_ITERATION_LIMIT) return SMPC_ITERATION_CAP;
    return solved ? SMPC_SOLVED : SMPC_FAILED;
}

/* The input that follows, and the plan for the next step. */
static void conclude(smpc_controller *c, int good, real *u)
{
    smpc_report *r = &c->report;
    real wanted[SMPC_INPUTS];
    const real *from = NULL;
    if (good && r->status != SMPC_BUDGET_OVERRUN) {
        from = c->there.u[0];
        r->source = SMPC_FROM_SOLUTION;
    } else if (c->age >= 0 && !over(c)) {
        from = c->plan.u[0];
        r->source = SMPC_FROM_PLAN;
    } else
        r->source = SMPC_HELD;
    for (int i = 0; i < inputs; i++) wanted[i] = from ? from[i] * smpc_u_scale[i] : c->u_before[i];
    smpc_guarded(c, c->u_before, wanted, u);
    for (int i = 0; i < inputs; i++)
        r->clipped |= !(fabs(u[i] - wanted[i]) <= CLIPPED * smpc_u_scale[i]);
    memcpy(c->last_u, u, sizeof c->last_u);
    c->has_last = 1;
    if (!good && c->age < 0) return;
    smpc_path *plan = good ? &c->there : &c->plan;
    memcpy(c->expected, plan->x[0], sizeof c->expected);
    if (!good) memcpy(&c->there, &c->plan, sizeof c->plan);
    smpc_shift(&c->there, &c->plan);
    if (good) c->violation = r->violation;
    c->age = good ? 1 : over(c) ? c->age : c->age + 1;
}

int smpc_feedback(smpc_controller *c, const real *x, real *u)
{
    const double began = now(c);
    smpc_report *r = &c->report;
    real scaled[SMPC_NX];
    int solved = 0, good = 0;
    memset(r, 0, sizeof *r);
    r->kkt = SMPC_HUGE; /* until something is solved */
    if (!c->asked) smpc_prepare(c, c->last_u);
    c->asked = 0;
    for (int i = 0; i < nx; i++) scaled[i] = x[i] / smpc_x_scale[i];
    if (c->finite && smpc_all_finite(scaled, nx)) {
        solved = attempt(c, scaled, began);
        good = usable(c, solved);
        r->seconds = c->prepare_seconds + now(c) - began;
        r->status = status_of(c, solved, good, c->budget > 0 && r->seconds > c->budget);
        c->failures = good ? 0 : c->failures + (c->failures < SMPC_RESTART_AFTER);
        for (int i = 0; i < SMPC_MOVES + SMPC_PROGRAM_ROWS && solved; i++)
            r->active += c->program.multipliers[i] != 0;
    } else
        r->status = SMPC_INPUT_NOT_FINITE;
    r->failures = c->failures;
    conclude(c, good, u);
    return r->status;
}

int smpc_step(smpc_controller *c, const real *x, const real *u_before, real *u)
{
    smpc_prepare(c, u_before);
    return smpc_feedback(c, x, u);
}
