/* Recorded steps, one after the other through the controller: what a target answers is then compared
 * with what a host answers.
 *
 * A step is SMPC_STEP_NUMBERS doubles: the references (SMPC_N x SMPC_NR), the input applied until
 * now (SMPC_INPUTS), the measured state (SMPC_NX). Its answer is SMPC_ANSWER_NUMBERS doubles: the
 * input (SMPC_INPUTS), the status, how the quadratic program ended, its iterations.
 */
#ifndef SMPC_STEPS_H
#define SMPC_STEPS_H

#include "controller.h"

#define SMPC_STEP_NUMBERS (SMPC_N * SMPC_NR + SMPC_INPUTS + SMPC_NX)
#define SMPC_ANSWER_NUMBERS (SMPC_INPUTS + 3)

/* What a step took, in ticks of smpc_ticks. */
typedef struct {
    unsigned long steps, prepare_most, feedback_most;
    unsigned long long prepare, feedback; /* sums */
} smpc_tally;

/* Through all steps that there are. Returns 0, or -1 where one is cut off or an answer is lost. */
int smpc_run_steps(smpc_tally *tally);

/* What the target has to bring. */
long smpc_read(void *buffer, unsigned long bytes);        /* bytes read, 0 at the end */
int smpc_write(const void *buffer, unsigned long bytes);  /* 0, or -1 */
unsigned long smpc_ticks(void);                           /* a clock of SMPC_TICK_BITS bits */

#define SMPC_TICK_BITS 24

#endif
