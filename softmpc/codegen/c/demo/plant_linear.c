/* LU factors in double, whatever the controller computes in. */
#include <math.h>

#include "plant_stages.h"

static void swap_rows(double *A, int n, int i, int k)
{
    for (int j = 0; i != k && j < n; j++) {
        double kept = A[i * n + j];
        A[i * n + j] = A[k * n + j];
        A[k * n + j] = kept;
    }
}

int smpc_plant_factorise(double *A, int *pivot, int n)
{
    for (int k = 0; k < n; k++) {
        int best = k;
        for (int i = k + 1; i < n; i++)
            if (fabs(A[i * n + k]) > fabs(A[best * n + k])) best = i;
        pivot[k] = best;
        if (!(fabs(A[best * n + k]) > 0.0) || !isfinite(A[best * n + k])) return -1;
        swap_rows(A, n, k, best);
        for (int i = k + 1; i < n; i++) {
            double factor = A[i * n + k] /= A[k * n + k];
            for (int j = k + 1; factor != 0.0 && j < n; j++)
                A[i * n + j] -= factor * A[k * n + j];
        }
    }
    return 0;
}

void smpc_plant_solve(const double *LU, const int *pivot, int n, double *x)
{
    for (int i = 0; i < n; i++) {
        double kept = x[pivot[i]];
        x[pivot[i]] = x[i];
        x[i] = kept;
    }
    for (int i = 0; i < n; i++)
        for (int j = 0; j < i; j++) x[i] -= LU[i * n + j] * x[j];
    for (int i = n - 1; i >= 0; i--) {
        for (int j = i + 1; j < n; j++) x[i] -= LU[i * n + j] * x[j];
        x[i] /= LU[i * n + i];
    }
}
