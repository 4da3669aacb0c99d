/* What a controller remembers, and what it works with during a step. Variables are scaled; their
 * order is that of softmpc's transcription: decisions u (inputs, then slacks), unknowns a of the
 * stages, states x (strains, rates, drive) at the end of each interval. */
#ifndef SMPC_MEMORY_H
#define SMPC_MEMORY_H

#include "real.h"
#include "sizes.h"

#define SMPC_SIZE(n) ((n) > 0 ? (n) : 1) /* an array needs an element */

/* A trajectory. */
typedef struct {
    real u[SMPC_N][SMPC_NU];
    real a[SMPC_N][SMPC_NA];
    real x[SMPC_N][SMPC_NX];
} smpc_path;

/* What a solve is told of the moment. */
typedef struct {
    real x[SMPC_NX];
    real u_before[SMPC_NU];
    real given[SMPC_N][SMPC_SIZE(SMPC_NR)];
} smpc_moment;

/* How good a trajectory is. */
typedef struct {
    real cost;
    real defects[SMPC_N][SMPC_NA + SMPC_NX]; /* residuals of the stages, gaps between intervals */
    real rows[SMPC_N][SMPC_SIZE(SMPC_ROWS)]; /* of the limits */
} smpc_measured;

/* One interval around a trajectory: a step of its unknowns is a_0 - by (dx, dp), and the arm's part
 * of the state after it arm dx + pressures dp + gap, with dp the pressures at the stages. */
typedef struct {
    real lu[SMPC_NA * SMPC_NA];
    int pivot[SMPC_NA];
    real a_0[SMPC_NA];
    real by[SMPC_NA * (SMPC_ARM + SMPC_STAGED)];
    real arm[SMPC_ARM * SMPC_ARM];
    real pressures[SMPC_ARM * SMPC_STAGED];
    real gap[SMPC_NX];
} smpc_interval;

/* The problem around a trajectory. */
typedef struct {
    smpc_interval interval[SMPC_N];
    real terms[SMPC_N][SMPC_SIZE(SMPC_TERMS)]; /* residuals of the costs, then rows of limits */
    real bent[SMPC_N][SMPC_SIZE(SMPC_BENT * SMPC_BENT_COLUMNS)];
    real end[SMPC_SIZE(SMPC_END)];
    real end_bent[SMPC_SIZE(SMPC_END_BENT * SMPC_END_COLUMNS)];
    smpc_measured measured;
} smpc_linear;

/* Weights of the merit function. */
typedef struct {
    real u[SMPC_N][SMPC_NU];
    real x[SMPC_N][SMPC_NX];
    real stages[SMPC_N][SMPC_NA];
    real nodes[SMPC_N][SMPC_NX];
    real rows[SMPC_N][SMPC_SIZE(SMPC_ROWS)];
} smpc_weights;

/* The quadratic program in the moves: inputs of all blocks, then their slacks. Its constraints are
 * bounds of the moves, then rows of all intervals; above zero is a multiplier at an upper bound. */
typedef struct {
    real H[SMPC_MOVED * SMPC_MOVED];               /* of the inputs, its Cholesky factor then */
    real H_diagonal[SMPC_MOVES];                   /* of H */
    real inverse[SMPC_MOVED * (SMPC_MOVED + 1) / 2]; /* upper half of L^-T, row after row */
    real moving[SMPC_SIZE(SMPC_MOVING_ROWS) * SMPC_N][SMPC_MOVES]; /* rows that change */
    real f[SMPC_MOVES];
    real low[SMPC_MOVES], high[SMPC_MOVES];
    real row_low[SMPC_SIZE(SMPC_PROGRAM_ROWS)], row_high[SMPC_SIZE(SMPC_PROGRAM_ROWS)];
    real v[SMPC_MOVES];
    real multipliers[SMPC_MOVES + SMPC_PROGRAM_ROWS];
    signed char active[SMPC_MOVES + SMPC_PROGRAM_ROWS]; /* where the next one begins */
    int has_inverse, any_active;
    int bounded; /* whether an input or a row was at a bound in the last solution */
    int iterations, rows, flag;
} smpc_program;

/* Workspace of DAQP, for up to SMPC_MOVES variables and SMPC_MAX_ROWS rows. */
typedef struct {
    real rinv[SMPC_MOVES * (SMPC_MOVES + 1) / 2];
    real M[SMPC_SIZE(SMPC_MAX_ROWS) * SMPC_MOVES];
    real upper[SMPC_MOVES + SMPC_MAX_ROWS], lower[SMPC_MOVES + SMPC_MAX_ROWS];
    real scaling[SMPC_MOVES + SMPC_MAX_ROWS];
    real v[SMPC_MOVES], x[SMPC_MOVES], x_old[SMPC_MOVES], u[SMPC_MOVES];
    real Mu[SMPC_SIZE(SMPC_MAX_ROWS)];
    real lam[SMPC_MOVES + 2], lam_star[SMPC_MOVES + 2];
    real L[(SMPC_MOVES + 2) * (SMPC_MOVES + 3) / 2], D[SMPC_MOVES + 2];
    real xldl[SMPC_MOVES + 2], zldl[SMPC_MOVES + 2];
    int sense[SMPC_MOVES + SMPC_MAX_ROWS], working[SMPC_MOVES + 2];
    int slacks[SMPC_SIZE(SMPC_SLACKED)];         /* moves of the slacks that take part */
    int chosen[SMPC_SIZE(SMPC_MAX_ROWS)];        /* rows that do */
    unsigned char taken[SMPC_SIZE(SMPC_PROGRAM_ROWS)];
} smpc_qp_memory;

/* What a step was like. */
typedef struct {
    int status, qp, source; /* see controller.h */
    int iterations;         /* of the quadratic program */
    int active;             /* constraints that hold in its solution */
    int failures;           /* steps without a usable solution, in a row */
    int clipped;            /* whether the last guard changed the input */
    int restarted;          /* whether it began at rest, without a plan */
    smpc_real cost, kkt, share, violation;
    double seconds;         /* by the clock that was given */
} smpc_report;

typedef struct {
    smpc_path plan; /* of the last usable solution, from this step on */
    real expected[SMPC_NX];
    real violation; /* of the plan */
    int age;        /* steps since the plan was made; -1: there is none */
    int failures;
    real last_u[SMPC_INPUTS];
    int has_last;
    real low[SMPC_INPUTS], high[SMPC_INPUTS], fall[SMPC_INPUTS], rise[SMPC_INPUTS];
    real u_low[SMPC_NU], u_high[SMPC_NU]; /* the same for the program: scaled decisions, */
    real row_low[SMPC_SIZE(SMPC_ROWS)], row_high[SMPC_SIZE(SMPC_ROWS)]; /* and rows of limits */
    int cap; /* iterations of the quadratic program */
    double (*clock)(void *);
    void *clock_with;
    double budget;

    real references[SMPC_N][SMPC_SIZE(SMPC_NR)];
    int asked, finite, prepared, broken;
    double prepare_seconds;
    real u_before[SMPC_INPUTS]; /* SI */

    smpc_moment moment;
    smpc_path at, step, there;
    smpc_linear linear;
    smpc_measured measured;
    smpc_weights weights;
    smpc_program program;
    smpc_qp_memory qp;
    real sensitivity[2][SMPC_ARM][SMPC_MOVED]; /* of the arm's state at the ends of two intervals */
    real seen[SMPC_MOST_SEEN][SMPC_MOVED];     /* of the residuals of an interval that move */
    real slope[SMPC_N][SMPC_NX];
    smpc_report report;
} smpc_controller;

#endif
