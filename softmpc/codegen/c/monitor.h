/* What a running controller is close to: the edge of where its tip can be, limits of pressure, the
 * end of laminar flow, its own cap of iterations. It only watches; no input depends on it.
 *
 *     static smpc_monitor monitor;
 *     smpc_monitor_init(&monitor);
 *     after each smpc_step(&controller, x, before, u):
 *         smpc_monitor_update(&monitor, &controller, x, u);
 *
 * A margin is measured from the base along the ray through the place, and at the rims of the
 * reachable set across it, at the same azimuth: the smallest of the way out to the outer surface,
 * the way in to the inner one, and the distance from a rim. Where a surface stands oblique to the
 * ray the true distance is smaller. Outside it is below zero: minus the distance to the nearest
 * place of the set at the same azimuth. The surfaces come from a file of `softmpc workspace` and
 * are linear between its directions, good to SMPC_REACH_ERROR; the set may have holes that they do
 * not show. They are for the arm at rest. Without a file (SMPC_REACH is 0) no margin is known.
 */
#ifndef SMPC_MONITOR_H
#define SMPC_MONITOR_H

#include <stdint.h>

#include "controller.h"
#include "monitor_data.h" /* SMPC_REACH, SMPC_TUBES, SMPC_BACK_OFF, ... */

#ifdef __cplusplus
extern "C" {
#endif

/* Bits of smpc_observed.known. */
enum smpc_known {
    SMPC_KNOWS_TIP = 1,
    SMPC_KNOWS_REFERENCE = 2,
    SMPC_KNOWS_PRESSURE = 4,
    SMPC_KNOWS_BACK_OFF = 8,
    SMPC_KNOWS_REYNOLDS = 16
};

/* What was seen. A number that is not known, because its bit is not set, is 0 and means nothing:
 * there is no file, or no such limit or tube, or a state or a reference is not finite. */
typedef struct {
    int known;
    int iterations;             /* of the quadratic program */
    int turbulent;              /* whether a Reynolds number is above SMPC_LAMINAR */
    smpc_real tip_margin;       /* m, of the tip for the state x */
    smpc_real reference_margin; /* m, of the reference of the tip at the first of the nodes */
    smpc_real pressure_room;    /* to the nearest limit of pressure, share of the range; < 0: over */
    smpc_real back_off;         /* used of the margin before these limits, a share; > 1: over */
#if SMPC_TUBES
    smpc_real largest_reynolds;
    smpc_real reynolds[SMPC_TUBES]; /* number in each tube */
#endif
} smpc_observed;

typedef struct {
    smpc_observed last;  /* in the last step */
    smpc_observed worst; /* the worst of each since smpc_monitor_init: smallest margins and room,
                            largest of the others; known where it was known once */
    uint64_t steps;
    uint64_t statuses[SMPC_FAILED + 1]; /* how often each smpc_status was */
    uint64_t since_solved;              /* steps after the last one that was solved */
    uint64_t programs;                  /* steps that asked the quadratic program */
    uint64_t iterations;                /* of all these */
    smpc_real mean_iterations;          /* of one of these; 0 without */
} smpc_monitor;

/* Bytes of an smpc_monitor, for those who cannot ask the compiler. */
unsigned long smpc_monitor_memory(void);

/* Forgets everything; call it first. */
void smpc_monitor_init(smpc_monitor *m);

/* After a step of c: x (SMPC_NX) is the state that it was told, u (SMPC_INPUTS) what it gave. */
void smpc_monitor_update(
    smpc_monitor *m, const smpc_controller *c, const smpc_real *x, const smpc_real *u);

/* Margin (m) of a place (3, m) to the edge of the reachable set; returns whether it is known. */
int smpc_margin(const smpc_real *place, smpc_real *margin);

#ifdef __cplusplus
}
#endif
#endif
