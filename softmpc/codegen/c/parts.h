/* The parts of the controller, for each other. */
#ifndef SMPC_PARTS_H
#define SMPC_PARTS_H

#include "controller.h"
#include "data.h"
#include "linear.h"

/* sparse.c */
void smpc_sparse_add(const smpc_sparse *A, int first, int rows, const real *x, real *y);
void smpc_sparse_add_transposed(const smpc_sparse *A, int first, int rows, const real *x, real *y);

/* dynamics.c: the motion over all intervals, and its slopes */
int smpc_linearise_motion(smpc_linear *l, const smpc_moment *m, const smpc_path *at);
int smpc_linearise_interval(smpc_linear *l, const smpc_moment *m, const smpc_path *at, int k);
void smpc_measure_interval(smpc_measured *found, const smpc_moment *m, const smpc_path *at, int k);

/* spread.c: changes carried through the linearised intervals */
void smpc_spread(const smpc_linear *l, const real *dx, smpc_path *step, int unknowns);
void smpc_gather(const smpc_linear *l, real nodes[][SMPC_NX], real moves[][SMPC_NU]);

/* terms.c: costs and limits of all intervals */
void smpc_linearise_terms(smpc_linear *l, const smpc_moment *m, const smpc_path *at);
void smpc_terms_after(const smpc_linear *l, int k, const smpc_path *step, real *terms);
void smpc_end_after(const smpc_linear *l, const smpc_path *step, real *end);
void smpc_slopes_of(const smpc_linear *l, int k, const real *terms, int first, int count,
                    real *by_before, real *by_u, real *by_x);
void smpc_end_slopes_of(const smpc_linear *l, const real *end, real *by_before, real *by_u,
                        real *by_x);
void smpc_measure(smpc_measured *found, const smpc_moment *m, const smpc_path *at);
int smpc_finite(const smpc_measured *measured);

/* condense.c and program.c: the quadratic program in the moves */
int smpc_condense(smpc_controller *c);
void smpc_make_program(smpc_controller *c, const smpc_path *freely);
real smpc_row_times(const smpc_program *p, int row, const real *v);

/* quadratic.c: its solution */
int smpc_solve_program(smpc_controller *c, double deadline);
void smpc_later_active(smpc_program *p);

/* merit.c */
void smpc_weigh(smpc_controller *c);
real smpc_merit(const smpc_controller *c, const smpc_path *at, const smpc_measured *measured);
real smpc_predicted(const smpc_controller *c, const smpc_path *step);
real smpc_worst(const smpc_controller *c, const smpc_path *at, const smpc_measured *measured);

/* rollout.c: a trajectory that keeps the equations of motion, from its inputs */
int smpc_roll(smpc_controller *c, const smpc_moment *m, smpc_path *at);

/* real_time.c: one iteration */
int smpc_iterate_prepare(smpc_controller *c);
int smpc_iterate_feedback(smpc_controller *c, const real *x, double deadline);

/* plan.c */
void smpc_shift(const smpc_path *from, smpc_path *to);

#endif
