/* The parts of the estimator, for each other. */
#ifndef SMPC_ESTIMATOR_PARTS_H
#define SMPC_ESTIMATOR_PARTS_H

#include "estimator.h"
#include "estimator_data.h"
#include "scalar.h"

/* Of the augmented state s: strains and rates (arm), drive, disturbance. */
enum {
    SMPC_FILTER_ARM = 2 * SMPC_STRAINS,
    SMPC_FILTER_X = SMPC_FILTER_ARM + SMPC_DRIVE
};

/* estimator_knots.c: times that it can go back to */
smpc_knot *smpc_knot_at(smpc_estimator *e, int i);
smpc_knot *smpc_last_knot(smpc_estimator *e);
void smpc_add_knot(smpc_estimator *e, int32_t tick);
void smpc_recall(const smpc_knot *k, smpc_belief *b);
void smpc_unjudge(smpc_knot *k);
void smpc_forget_after(smpc_estimator *e, int32_t tick);
void smpc_prune(smpc_estimator *e, int32_t tick);

/* kalman.c: the two halves of the filter */
void smpc_predict(smpc_belief *b, smpc_move *m, real seconds, real bent);
int smpc_expect(smpc_look *look, const real *P);
void smpc_update(smpc_belief *b, const smpc_look *look);
real smpc_linearising_leaves(const real *P);

/* estimator_drive.c: what belongs to a step of some length */
void smpc_prepare_step(smpc_lasting *of, real seconds);
void smpc_move_drive(const smpc_lasting *of, int stage, const real *z, const real *v, real *to);

/* estimator_step.c: s after some time, and its slope */
int smpc_advance(smpc_belief *b, smpc_move *m, const real *u, int64_t ticks);

/* readings.c */
int smpc_implausible(smpc_seen *seen, const smpc_sample *sample);
void smpc_look_at(smpc_look *look, const smpc_belief *b, const smpc_sample *sample, const real *u);
int smpc_weigh_readings(smpc_look *look, const real *P);

#endif
