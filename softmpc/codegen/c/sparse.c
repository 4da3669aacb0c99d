/* Products with constant sparse matrices. */
#include "parts.h"

/* y (rows) += A[first : first + rows] x */
void smpc_sparse_add(const smpc_sparse *A, int first, int rows, const real *x, real *y)
{
    for (int i = 0; i < rows; i++) {
        real sum = 0;
        for (int p = A->start[first + i]; p < A->start[first + i + 1]; p++)
            sum += A->value[p] * x[A->column[p]];
        y[i] += sum;
    }
}

/* y += A[first : first + rows]^T x (rows) */
void smpc_sparse_add_transposed(const smpc_sparse *A, int first, int rows, const real *x, real *y)
{
    for (int i = 0; i < rows; i++)
        for (int p = A->start[first + i]; p < A->start[first + i + 1]; p++)
            y[A->column[p]] += A->value[p] * x[i];
}
