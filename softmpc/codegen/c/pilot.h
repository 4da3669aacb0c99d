/* The controller of a rig: estimator, supervision and MPC, from readings to an input.
 *
 * Once a step it takes what has arrived, estimates state and disturbance for the time at which its
 * input will act, SMPC_DELAY ticks later, and asks the MPC, or falls back. The input is finite and
 * within the limits of torque and torque rate whatever happens. Times are ticks of a millisecond.
 *
 *     static smpc_pilot pilot;
 *     smpc_pilot_init(&pilot, x, u, tick);
 *     each SMPC_STEP_TICKS:
 *         smpc_pilot_step(&pilot, tick, samples, count, references, rest, holding, u);
 *
 * All of its memory is one smpc_pilot.
 */
#ifndef SMPC_PILOT_H
#define SMPC_PILOT_H

#include "controller.h"
#include "estimator.h"
#include "supervision.h"

#ifdef __cplusplus
extern "C" {
#endif

/* What a step was like. */
typedef struct {
    int state;       /* an smpc_state */
    int asked;       /* whether the MPC was asked */
    int status;      /* its smpc_status, where it was */
    int trouble;     /* an smpc_trouble of the estimator, which then began anew */
    smpc_real tip_spread; /* m, standard deviation of the tip when the input will act */
    double estimate_seconds; /* by the clock that was given, 0 without */
} smpc_act;

typedef struct {
    smpc_controller controller;
    smpc_estimator estimator;
    smpc_supervisor supervisor;
    smpc_act act;
    smpc_real u[SMPC_INPUTS]; /* given last */
    smpc_input pending[SMPC_PENDING]; /* inputs that do not act yet */
    int pending_count;
    int failed_steps;    /* of the MPC, in a row */
    int problem;         /* status of its last step; SMPC_SOLVED without one */
    int holds;           /* whether `held` is used, in fall-back */
    smpc_real held[SMPC_INPUTS];
    smpc_real rest[SMPC_NX], holding[SMPC_INPUTS]; /* where the reference is: the last that were given */
    smpc_real x[SMPC_NX], d[SMPC_FILTERED - SMPC_NX + 1]; /* expected when the input will act */
    smpc_real references[SMPC_SIZE(SMPC_N * SMPC_NR)];
    double (*clock)(void *);
    void *clock_with;
} smpc_pilot;

/* Bytes of an smpc_pilot. */
unsigned long smpc_pilot_memory(void);

/* Begin at a state (SMPC_NX) and an input (SMPC_INPUTS). 0, or an smpc_trouble: nothing is begun.
 * Limits, clocks and the cap of p->controller are set after it. */
int smpc_pilot_init(smpc_pilot *p, const smpc_real *x, const smpc_real *u, int32_t tick);

/* Take what has arrived, without an input: the last one is held. */
void smpc_pilot_listen(smpc_pilot *p, int32_t tick, const smpc_sample *samples, int count);

/* The input u (SMPC_INPUTS) from what has arrived until `tick`. Returns an smpc_state.
 *
 * references (SMPC_N x SMPC_NR): at the nodes after tick + SMPC_DELAY; the pilot fills in the
 * disturbance. rest (SMPC_NX): the arm at rest where the reference is at `tick`; holding
 * (SMPC_INPUTS): the input that holds it there. */
int smpc_pilot_step(
    smpc_pilot *p, int32_t tick, const smpc_sample *samples, int count,
    const smpc_real *references, const smpc_real *rest, const smpc_real *holding, smpc_real *u);

/* A clock in seconds, for smpc_act.estimate_seconds; that of a budget is smpc_set_clock's. */
void smpc_pilot_set_clock(smpc_pilot *p, double (*clock)(void *), void *with);

/* For those who cannot read the struct: its parts, and what the last step was like. */
smpc_controller *smpc_pilot_controller(smpc_pilot *p);
smpc_estimator *smpc_pilot_estimator(smpc_pilot *p);
smpc_supervisor *smpc_pilot_supervisor(smpc_pilot *p);
const smpc_act *smpc_pilot_last(const smpc_pilot *p);
double smpc_pilot_estimate_seconds(const smpc_pilot *p);

#ifdef __cplusplus
}
#endif
#endif
