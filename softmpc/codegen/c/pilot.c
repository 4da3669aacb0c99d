/* From readings to an input. */
#include "pilot.h"

#include <string.h>

#include "guard.h"
#include "linear.h"
#include "pilot_data.h"

#if SMPC_DISTURBANCES && SMPC_DISTURBANCES != SMPC_FILTERED - SMPC_NX
#error "the disturbance of the controller is another one than that of the estimator"
#endif

enum { inputs = SMPC_INPUTS, nx = SMPC_NX, MOST_CONDITIONS = SMPC_SENSORS + 4 };

unsigned long smpc_pilot_memory(void)
{
    return (unsigned long)sizeof(smpc_pilot);
}

smpc_controller *smpc_pilot_controller(smpc_pilot *p) { return &p->controller; }

smpc_estimator *smpc_pilot_estimator(smpc_pilot *p) { return &p->estimator; }

smpc_supervisor *smpc_pilot_supervisor(smpc_pilot *p) { return &p->supervisor; }

const smpc_act *smpc_pilot_last(const smpc_pilot *p) { return &p->act; }

double smpc_pilot_estimate_seconds(const smpc_pilot *p) { return p->act.estimate_seconds; }

void smpc_pilot_set_clock(smpc_pilot *p, double (*clock)(void *), void *with)
{
    p->clock = clock;
    p->clock_with = with;
}

static double now(const smpc_pilot *p) { return p->clock ? p->clock(p->clock_with) : 0; }

int smpc_pilot_init(smpc_pilot *p, const smpc_real *x, const smpc_real *u, int32_t tick)
{
    const int trouble = smpc_estimator_reset(&p->estimator, x, u, tick);
    if (trouble) return trouble;
    smpc_init(&p->controller);
    smpc_supervisor_reset(&p->supervisor, tick);
    memset(&p->act, 0, sizeof p->act);
    memcpy(p->u, u, sizeof p->u);
    memcpy(p->rest, x, sizeof p->rest);
    memcpy(p->holding, u, sizeof p->holding);
    p->pending_count = p->failed_steps = p->holds = 0;
    p->problem = SMPC_SOLVED;
    smpc_pilot_set_clock(p, NULL, NULL);
    return SMPC_NO_TROUBLE;
}

/* ---------------------------------------------------------------- the estimate */

/* Inputs that act by now. */
static void take_inputs(smpc_pilot *p, int32_t tick)
{
    int left = 0;
    for (int i = 0; i < p->pending_count; i++)
        if (p->pending[i].tick <= tick)
            smpc_estimator_applied(&p->estimator, p->pending[i].u, p->pending[i].tick);
        else
            p->pending[left++] = p->pending[i];
    p->pending_count = left;
}

static int estimate(smpc_pilot *p, int32_t tick, const smpc_sample *samples, int count)
{
    smpc_estimator *e = &p->estimator;
    smpc_estimator_receive(e, tick, samples, count);
    const int trouble = smpc_estimator_estimate(e, tick);
    if (trouble) return trouble;
    return smpc_estimator_ahead(e, tick + SMPC_DELAY, p->pending, p->pending_count);
}

/* What is believed of when the input will act: of now where the filter has begun anew, at rest
 * where the reference is. */
static const smpc_belief *expected(
    smpc_pilot *p, int32_t tick, const smpc_sample *samples, int count)
{
    smpc_estimator *e = &p->estimator;
    const smpc_belief *found = &e->ahead;
    take_inputs(p, tick);
    p->act.trouble = estimate(p, tick, samples, count);
    smpc_belief_state(found, p->x, p->d);
    if (!p->act.trouble && !smpc_all_finite(p->x, nx)) p->act.trouble = SMPC_ESTIMATE_INFINITE;
    if (p->act.trouble) {
        smpc_estimator_reset(e, p->rest, p->u, tick);
        smpc_estimator_estimate(e, tick);
        found = &e->now;
        smpc_belief_state(found, p->x, p->d);
    }
    return found;
}

void smpc_pilot_listen(smpc_pilot *p, int32_t tick, const smpc_sample *samples, int count)
{
    expected(p, tick, samples, count);
}

/* ---------------------------------------------------------------- supervision */

typedef struct {
    smpc_condition found[MOST_CONDITIONS];
    int count;
} conditions;

static void add(conditions *to, int state, int cause, int detail)
{
    const smpc_condition one = {state, cause, detail};
    to->found[to->count++] = one;
}

/* All that is not as it should be. */
static void look(smpc_pilot *p, int32_t tick, conditions *to)
{
    const int32_t doubted = smpc_estimator_contradicted(&p->estimator);
    if (p->act.trouble) add(to, SMPC_FALL_BACK, SMPC_ESTIMATOR_FAILED, p->act.trouble);
    for (int i = 0; i < SMPC_SENSORS; i++) {
        const int64_t age = (int64_t)tick - p->estimator.now.trust.good[i];
        if (age >= smpc_blind_after[i])
            add(to, SMPC_FALL_BACK, SMPC_BLIND, i);
        else if (age >= smpc_silent_after[i])
            add(to, SMPC_DEGRADED, SMPC_SILENT, i);
    }
    if (p->act.tip_spread > (real)SMPC_TIP_SPREAD) add(to, SMPC_FALL_BACK, SMPC_TIP_UNKNOWN, 0);
    if (doubted != SMPC_NEVER && (int64_t)tick - doubted < SMPC_DOUBTFUL)
        add(to, SMPC_DEGRADED, SMPC_CONTRADICTED, 0);
    if (p->failed_steps >= SMPC_FAILED_STEPS)
        add(to, SMPC_FALL_BACK, SMPC_STEPS_FAILED, p->problem);
    else if (p->problem != SMPC_SOLVED)
        add(to, SMPC_DEGRADED, SMPC_STEP_FAILED, p->problem);
}

/* ---------------------------------------------------------------- the input */

/* Forget the plan, and keep limits and clock. */
static void forget_plan(smpc_controller *c)
{
    c->age = -1;
    c->has_last = c->asked = c->failures = 0;
    c->program.any_active = 0;
}

/* The MPC's answer for the time at which the input acts. */
static void ask(smpc_pilot *p, const real *references, real *u)
{
    if (SMPC_NR) memcpy(p->references, references, sizeof(real) * SMPC_N * SMPC_NR);
    for (int k = 0; k < SMPC_N; k++)
        memcpy(p->references + k * SMPC_NR + SMPC_DISTURBANCE_AT, p->d,
               sizeof(real) * SMPC_DISTURBANCES);
    p->holds = 0;
    p->act.asked = 1;
    smpc_set_reference(&p->controller, p->references);
    p->act.status = p->problem = smpc_step(&p->controller, p->x, p->u, u);
    p->failed_steps = p->problem == SMPC_SOLVED ? 0 : p->failed_steps + 1;
}

/* What holds the reference where it was, or on the way to the arm at rest. */
static void go_without(smpc_pilot *p, int state, real *u)
{
    if (state == SMPC_SAFE_STOP) {
        const real none[SMPC_INPUTS] = {0};
        smpc_inside(&p->controller, none, u);
        for (int i = 0; i < inputs; i++) {
            const real low = p->u[i] - smpc_ramp[i], high = p->u[i] + smpc_ramp[i];
            u[i] = u[i] < low ? low : u[i] > high ? high : u[i];
        }
        return;
    }
    if (!p->holds) memcpy(p->held, p->holding, sizeof p->held);
    p->holds = 1;
    p->failed_steps = 0; /* it will be asked again */
    p->problem = SMPC_SOLVED;
    memcpy(u, p->held, sizeof p->held);
}

/* Remember an input that will act; the oldest acts already where there is no room. */
static void remember(smpc_pilot *p, int32_t tick)
{
    if (p->pending_count == SMPC_PENDING) {
        smpc_estimator_applied(&p->estimator, p->pending[0].u, p->pending[0].tick);
        memmove(p->pending, p->pending + 1, sizeof *p->pending * (SMPC_PENDING - 1));
        p->pending_count--;
    }
    smpc_input *to = &p->pending[p->pending_count++];
    to->tick = tick;
    memcpy(to->u, p->u, sizeof to->u);
}

int smpc_pilot_step(
    smpc_pilot *p, int32_t tick, const smpc_sample *samples, int count,
    const smpc_real *references, const smpc_real *rest, const smpc_real *holding, smpc_real *u)
{
    const int before = p->supervisor.state;
    conditions wrong = {.count = 0};
    real wanted[SMPC_INPUTS];
    memset(&p->act, 0, sizeof p->act);
    if (smpc_all_finite(rest, nx)) memcpy(p->rest, rest, sizeof p->rest);
    if (smpc_all_finite(holding, inputs)) memcpy(p->holding, holding, sizeof p->holding);
    const double began = now(p);
    const smpc_belief *belief = expected(p, tick, samples, count);
    p->act.estimate_seconds = now(p) - began;
    p->act.tip_spread = smpc_tip_spread(&p->estimator, belief);
    look(p, tick, &wrong);
    p->act.state = smpc_supervisor_update(&p->supervisor, tick, wrong.found, wrong.count);
    if (p->act.state >= SMPC_FALL_BACK) {
        go_without(p, p->act.state, wanted);
    } else {
        if (before >= SMPC_FALL_BACK) forget_plan(&p->controller);
        ask(p, references, wanted);
    }
    smpc_guarded(&p->controller, p->u, wanted, u);
    memcpy(p->u, u, sizeof p->u);
    remember(p, tick + SMPC_DELAY);
    return p->act.state;
}
