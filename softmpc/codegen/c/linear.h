/* Small dense linear algebra, row by row; nothing is checked for size. */
#ifndef SMPC_LINEAR_H
#define SMPC_LINEAR_H

#include "scalar.h"

/* LU factors of A (n x n) in place, rows exchanged as pivot says; 0, or -1 where A is singular or
 * not finite. */
int smpc_lu(real *A, int *pivot, int n);

/* X (n x m, rows m apart) := A^-1 X with the factors of smpc_lu. */
void smpc_lu_solve(const real *LU, const int *pivot, int n, real *X, int m);

/* x (n) := A^-T x with the factors of smpc_lu. */
void smpc_lu_solve_transposed(const real *LU, const int *pivot, int n, real *x);

/* Cholesky factor of the symmetric H (n x n, lower half given): L in its lower half; 0, or -1 where
 * H is not positive definite. */
int smpc_cholesky(real *H, int n);

/* R := the inverse of the upper factor L^T, row after row without what is below the diagonal. */
void smpc_inverse_packed(const real *L, int n, real *R);

/* x := L^-1 x, and x := L^-T x. */
void smpc_forward(const real *L, int n, real *x);
void smpc_backward(const real *L, int n, real *x);

/* y (rows) = A x + y, A rows x columns. */
void smpc_add_product(const real *A, int rows, int columns, const real *x, real *y);

/* y (columns) = A^T x + y. */
void smpc_add_transposed(const real *A, int rows, int columns, const real *x, real *y);

int smpc_all_finite(const real *x, int n);

#endif
