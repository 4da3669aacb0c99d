/* A controller's steps into a flight recorder, and a controller put back to where a log begins. */
#ifndef SMPC_LOG_H
#define SMPC_LOG_H

#include "controller.h"
#include "recorder.h"

#ifdef __cplusplus
extern "C" {
#endif

/* The step that has just been made, with what it was given (SMPC_INPUTS, SMPC_NX) and gave. */
void smpc_log_step(
    smpc_recorder *r, const smpc_controller *c, const smpc_real *u_before, const smpc_real *x,
    const smpc_real *u);

/* What the controller remembers between two steps: a replay can begin there. */
void smpc_log_snapshot(smpc_recorder *r, const smpc_controller *c);

/* Limits, budget and cap as they are, after they have been set. */
void smpc_log_settings(smpc_recorder *r, const smpc_controller *c);

/* Make it remember what a snapshot says, and beside that its clock alone. Returns 0, or -1 where the
 * snapshot is of another controller. */
int smpc_restore(smpc_controller *c, const smpc_snapshot *s);

#ifdef __cplusplus
}
#endif
#endif
