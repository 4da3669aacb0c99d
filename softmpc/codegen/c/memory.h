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
    smpc_real u[SMPC_N][SMPC_NU];
    smpc_real a[SMPC_N][SMPC_NA];
    smpc_real x[SMPC_N][SMPC_NX];
} smpc_path;

/* What a solve is told of the moment. */
typedef struct {
    smpc_real x[SMPC_NX];
    smpc_real u_before[SMPC_NU];
    smpc_real given[SMPC_N][SMPC_SIZE(SMPC_NR)];
} smpc_moment;

/* How good a trajectory is. */
typedef struct {
    smpc_real cost;
    smpc_real defects[SMPC_N][SMPC_NA + SMPC_NX]; /* residuals of the stages, gaps between intervals */
    smpc_real rows[SMPC_N][SMPC_SIZE(SMPC_ROWS)]; /* of the limits */
} smpc_measured;

/* One interval around a trajectory: a step of its unknowns is a_0 - by (dx, dp), and the arm's part
 * of the state after it arm dx + pressures dp + gap, with dp the pressures at the stages. */
typedef struct {
    smpc_real lu[SMPC_NA * SMPC_NA];
    int pivot[SMPC_NA];
    smpc_real a_0[SMPC_NA];
    smpc_real by[SMPC_NA * (SMPC_ARM + SMPC_STAGED)];
    smpc_real arm[SMPC_ARM * SMPC_ARM];
    smpc_real pressures[SMPC_ARM * SMPC_STAGED];
    smpc_real gap[SMPC_NX];
} smpc_interval;

/* The problem around a trajectory. */
typedef struct {
    smpc_interval interval[SMPC_N];
    smpc_real terms[SMPC_N][SMPC_SIZE(SMPC_TERMS)]; /* residuals of the costs, then rows of limits */
    smpc_real bent[SMPC_N][SMPC_SIZE(SMPC_BENT * SMPC_BENT_COLUMNS)];
    smpc_real end[SMPC_SIZE(SMPC_END)];
    smpc_real end_bent[SMPC_SIZE(SMPC_END_BENT * SMPC_END_COLUMNS)];
    smpc_measured measured;
} smpc_linear;

/* Weights of the merit function. */
typedef struct {
    smpc_real u[SMPC_N][SMPC_NU];
    smpc_real x[SMPC_N][SMPC_NX];
    smpc_real stages[SMPC_N][SMPC_NA];
    smpc_real nodes[SMPC_N][SMPC_NX];
    smpc_real rows[SMPC_N][SMPC_SIZE(SMPC_ROWS)];
} smpc_weights;

/* The quadratic program in the moves: inputs of all blocks, then their slacks. Its constraints are
 * bounds of the moves, then rows of all intervals; above zero is a multiplier at an upper bound. */
typedef struct {
    smpc_real H[SMPC_MOVED * SMPC_MOVED];               /* of the inputs, its Cholesky factor then */
    smpc_real H_diagonal[SMPC_MOVES];                   /* of H */
    smpc_real inverse[SMPC_MOVED * (SMPC_MOVED + 1) / 2]; /* upper half of L^-T, row after row */
    smpc_real moving[SMPC_SIZE(SMPC_MOVING_ROWS) * SMPC_N][SMPC_MOVES]; /* rows that change */
    smpc_real f[SMPC_MOVES];
    smpc_real low[SMPC_MOVES], high[SMPC_MOVES];
    smpc_real row_low[SMPC_SIZE(SMPC_PROGRAM_ROWS)], row_high[SMPC_SIZE(SMPC_PROGRAM_ROWS)];
    smpc_real v[SMPC_MOVES];
    smpc_real multipliers[SMPC_MOVES + SMPC_PROGRAM_ROWS];
    signed char active[SMPC_MOVES + SMPC_PROGRAM_ROWS]; /* where the next one begins */
    int has_inverse, any_active;
    int bounded; /* whether an input or a row was at a bound in the last solution */
    int iterations, rows, flag;
} smpc_program;

/* Workspace of DAQP, for up to SMPC_MOVES variables and SMPC_MAX_ROWS rows. */
typedef struct {
    smpc_real rinv[SMPC_MOVES * (SMPC_MOVES + 1) / 2];
    smpc_real M[SMPC_SIZE(SMPC_MAX_ROWS) * SMPC_MOVES];
    smpc_real upper[SMPC_MOVES + SMPC_MAX_ROWS], lower[SMPC_MOVES + SMPC_MAX_ROWS];
    smpc_real scaling[SMPC_MOVES + SMPC_MAX_ROWS];
    smpc_real v[SMPC_MOVES], x[SMPC_MOVES], x_old[SMPC_MOVES], u[SMPC_MOVES];
    smpc_real Mu[SMPC_SIZE(SMPC_MAX_ROWS)];
    smpc_real lam[SMPC_MOVES + 2], lam_star[SMPC_MOVES + 2];
    smpc_real L[(SMPC_MOVES + 2) * (SMPC_MOVES + 3) / 2], D[SMPC_MOVES + 2];
    smpc_real xldl[SMPC_MOVES + 2], zldl[SMPC_MOVES + 2];
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
    smpc_real cost, share;  /* of the plan; how much of the step was taken */
    smpc_real kkt;          /* what the cost could still fall by, or the violation; scaled */
    smpc_real violation;    /* the largest of a bound, an equation or a limit, scaled */
    double seconds;         /* by the clock that was given */
} smpc_report;

typedef struct {
    smpc_path plan; /* of the last usable solution, from this step on */
    smpc_real expected[SMPC_NX];
    smpc_real violation; /* of the plan */
    int age;        /* steps since the plan was made; -1: there is none */
    int failures;
    smpc_real last_u[SMPC_INPUTS];
    int has_last;
    smpc_real low[SMPC_INPUTS], high[SMPC_INPUTS], fall[SMPC_INPUTS], rise[SMPC_INPUTS];
    smpc_real u_low[SMPC_NU], u_high[SMPC_NU]; /* the same for the program: scaled decisions, */
    smpc_real row_low[SMPC_SIZE(SMPC_ROWS)], row_high[SMPC_SIZE(SMPC_ROWS)]; /* and rows of limits */
    int cap; /* iterations of the quadratic program */
    double (*clock)(void *);
    void *clock_with;
    double budget;

    smpc_real references[SMPC_N][SMPC_SIZE(SMPC_NR)];
    int asked, finite, prepared, broken;
    double prepare_seconds;
    smpc_real u_before[SMPC_INPUTS]; /* SI */

    smpc_moment moment;
    smpc_path at, step, there;
    smpc_linear linear;
    smpc_measured measured;
    smpc_weights weights;
    smpc_program program;
    smpc_qp_memory qp;
    smpc_real sensitivity[2][SMPC_ARM][SMPC_MOVED]; /* of the arm's state at the ends of two intervals */
    smpc_real seen[SMPC_MOST_SEEN][SMPC_MOVED];     /* of the residuals of an interval that move */
    smpc_real slope[SMPC_N][SMPC_NX];
    smpc_report report;
} smpc_controller;

#endif
