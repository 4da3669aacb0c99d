/* What happens when things go wrong: a small state machine, and a short log of what it did and why.
 *
 *     normal      the controller runs on the estimate
 *     degraded    it still does, on less: a sensor is silent, or a step of the solver failed
 *     fall-back   estimate or solver cannot be trusted: the reference stands still
 *     safe stop   too long in fall-back: inputs are ramped to the arm at rest
 *
 * The worst condition that holds decides; the way back up takes a while of good conditions.
 */
#ifndef SMPC_SUPERVISION_H
#define SMPC_SUPERVISION_H

#include <stdint.h>

#include "supervision_sizes.h" /* times in ticks */

#ifdef __cplusplus
extern "C" {
#endif

enum smpc_state { SMPC_NORMAL = 0, SMPC_DEGRADED = 1, SMPC_FALL_BACK = 2, SMPC_SAFE_STOP = 3 };

/* What is not as it should be; `detail` of a condition says more. */
enum smpc_cause {
    SMPC_ALL_WELL = 0,
    SMPC_ESTIMATOR_FAILED = 1, /* detail: an smpc_trouble */
    SMPC_BLIND = 2,            /* detail: the sensor of the tips */
    SMPC_SILENT = 3,           /* detail: the sensor */
    SMPC_TIP_UNKNOWN = 4,      /* its standard deviation is too large */
    SMPC_CONTRADICTED = 5,     /* readings contradict the estimate */
    SMPC_STEPS_FAILED = 6,     /* too many in a row; detail: the last smpc_status */
    SMPC_STEP_FAILED = 7       /* detail: the smpc_status */
};

/* A cause, and the best state that it allows. */
typedef struct {
    int state, cause, detail;
} smpc_condition;

/* A change of state: when, from where to where, why. */
typedef struct {
    int32_t tick;
    int before, after;
    int cause, detail; /* towards a better state: what is left of what was wrong */
    int too_long;      /* it was in fall-back for too long */
} smpc_transition;

typedef struct {
    int state;
    int32_t entered;    /* the present state */
    int32_t good_since; /* conditions that allow a better one */
    int is_good;        /* whether there are such */
    uint32_t changes;   /* in all */
    smpc_transition log[SMPC_LOG]; /* the last ones: number i is at i % SMPC_LOG */
} smpc_supervisor;

/* Begin in SMPC_NORMAL; the way out of a safe stop for an operator. */
void smpc_supervisor_reset(smpc_supervisor *s, int32_t tick);

/* The state from this tick on, given all that is wrong. */
int smpc_supervisor_update(
    smpc_supervisor *s, int32_t tick, const smpc_condition *conditions, int count);

/* How many changes there were, and number i of them, from 0; NULL where it is forgotten. */
uint32_t smpc_supervisor_changes(const smpc_supervisor *s);
const smpc_transition *smpc_supervisor_change(const smpc_supervisor *s, uint32_t i);

/* "normal", ..., and "the estimator failed", ...: never NULL. */
const char *smpc_state_name(int state);
const char *smpc_cause_name(int cause);

#ifdef __cplusplus
}
#endif
#endif
