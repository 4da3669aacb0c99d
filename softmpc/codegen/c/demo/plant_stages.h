/* The stages of one step of the plant; used by plant.c alone. */
#ifndef SMPC_PLANT_STAGES_H
#define SMPC_PLANT_STAGES_H

#include "plant.h"

/* Highest derivatives (SMPC_PLANT_SIZE) at the state now, to p->y and to all stages. */
int smpc_plant_begin(smpc_plant *p);

/* Solves the stages of a step of length h (s) into p->found. Returns 1 where that went well. */
int smpc_plant_solve_stages(smpc_plant *p, double h);

/* How large the error of that step is, in tolerances. */
double smpc_plant_error(smpc_plant *p, double h);

/* Takes the state at the end of that step. */
void smpc_plant_accept(smpc_plant *p, double h);

/* LU factors of A (n x n, row by row) in place; 0, or -1 where A is singular or not finite. */
int smpc_plant_factorise(double *A, int *pivot, int n);

/* x (n) := A^-1 x. */
void smpc_plant_solve(const double *LU, const int *pivot, int n, double *x);

#endif
