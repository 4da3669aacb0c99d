/* What a simple controller remembers. All numbers are SI. */
#ifndef SMPC_MEMORY_H
#define SMPC_MEMORY_H

#include "real.h"
#include "sizes.h"

/* What a step was like; fields that only a quadratic program fills are zero. */
typedef struct {
    int status, qp, source; /* see controller.h */
    int iterations, active;
    int failures;           /* steps in a row whose input is not the controller's own */
    int clipped;            /* whether the last guard changed the input */
    int restarted;
    smpc_real cost, share, kkt, violation;
    double seconds;         /* by the clock that was given */
} smpc_report;

typedef struct {
    smpc_real references[SMPC_NR];
    smpc_real u_before[SMPC_INPUTS];
    smpc_real integral[3]; /* of the tip's error (m s), of the controller that has one */
    smpc_real last_u[SMPC_INPUTS];
    int has_last, asked, finite;
    smpc_real low[SMPC_INPUTS], high[SMPC_INPUTS], fall[SMPC_INPUTS], rise[SMPC_INPUTS];
    double (*clock)(void *);
    void *clock_with;
    double budget, prepare_seconds;
    smpc_report report;
} smpc_controller;

#endif
