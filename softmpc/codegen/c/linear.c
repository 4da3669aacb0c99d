/* Small dense linear algebra. Inner loops run along rows, so that compilers vectorise them. */
#include "linear.h"

#define IN_ONE 4 /* rows that one pass over a row of results takes in */

static void swap_rows(real *a, real *b, int m)
{
    for (int j = 0; j < m; j++) {
        real kept = a[j];
        a[j] = b[j];
        b[j] = kept;
    }
}

/* y -= f[0] x + f[1] x1 + f[2] x2 + f[3] x3 */
static void subtract_four(real *restrict y, const real *x, const real *x1, const real *x2,
                          const real *x3, const real *f, int m)
{
    const real a = f[0], b = f[1], c = f[2], d = f[3];
    for (int j = 0; j < m; j++) y[j] -= a * x[j] + b * x1[j] + c * x2[j] + d * x3[j];
}

/* y -= f x */
static void subtract(real *restrict y, const real *restrict x, real f, int m)
{
    for (int j = 0; j < m; j++) y[j] -= f * x[j];
}

static int largest_below(const real *A, int n, int k)
{
    int found = k;
    for (int i = k + 1; i < n; i++)
        if (fabs(A[i * n + k]) > fabs(A[found * n + k])) found = i;
    return found;
}

int smpc_lu(real *A, int *pivot, int n)
{
    for (int k = 0; k < n; k++) {
        int p = pivot[k] = largest_below(A, n, k);
        real size = (real)fabs(A[p * n + k]);
        if (!(size > 0) || !(size <= SMPC_HUGE)) return -1;
        if (p != k) swap_rows(A + p * n, A + k * n, n);
        for (int i = k + 1; i < n; i++) {
            real f = A[i * n + k] /= A[k * n + k];
            subtract(A + i * n + k + 1, A + k * n + k + 1, f, n - k - 1);
        }
    }
    return 0;
}

/* y -= sum of f[k] times row k of X */
static void subtract_all(real *y, const real *X, const real *f, int rows, int m)
{
    int k = 0;
    for (; k + IN_ONE <= rows; k += IN_ONE) {
        const real *x = X + k * m;
        subtract_four(y, x, x + m, x + 2 * m, x + 3 * m, f + k, m);
    }
    for (; k < rows; k++) subtract(y, X + k * m, f[k], m);
}

void smpc_lu_solve(const real *LU, const int *pivot, int n, real *X, int m)
{
    for (int k = 0; k < n; k++)
        if (pivot[k] != k) swap_rows(X + k * m, X + pivot[k] * m, m);
    for (int i = 1; i < n; i++) subtract_all(X + i * m, X, LU + i * n, i, m);
    for (int i = n - 1; i >= 0; i--) {
        real *x = X + i * m, f = 1 / LU[i * n + i];
        subtract_all(x, x + m, LU + i * n + i + 1, n - i - 1, m);
        for (int j = 0; j < m; j++) x[j] *= f;
    }
}

void smpc_lu_solve_transposed(const real *LU, const int *pivot, int n, real *x)
{
    for (int i = 0; i < n; i++) {
        x[i] /= LU[i * n + i];
        subtract(x + i + 1, LU + i * n + i + 1, x[i], n - i - 1);
    }
    for (int i = n - 1; i > 0; i--) subtract(x, LU + i * n, x[i], i);
    for (int k = n - 1; k >= 0; k--)
        if (pivot[k] != k) swap_rows(x + k, x + pivot[k], 1);
}

/* The upper factor is made row by row, so that loops run along rows, and is then turned over. */
int smpc_cholesky(real *H, int n)
{
    for (int i = 0; i < n; i++)
        for (int j = i + 1; j < n; j++) H[i * n + j] = H[j * n + i];
    for (int k = 0; k < n; k++) {
        real *row = H + k * n, f[IN_ONE];
        int i = 0;
        for (; i + IN_ONE <= k; i += IN_ONE) {
            for (int p = 0; p < IN_ONE; p++) f[p] = H[(i + p) * n + k];
            const real *x = H + i * n + k;
            subtract_four(row + k, x, x + n, x + 2 * n, x + 3 * n, f, n - k);
        }
        for (; i < k; i++) subtract(row + k, H + i * n + k, H[i * n + k], n - k);
        if (!(row[k] > 0) || !(row[k] <= SMPC_HUGE)) return -1;
        real scale = 1 / (real)sqrt(row[k]);
        for (int j = k; j < n; j++) row[j] *= scale;
    }
    for (int i = 0; i < n; i++)
        for (int j = 0; j < i; j++) H[i * n + j] = H[j * n + i];
    return 0;
}

/* Row i of U^-1 is (e_i - sum over k > i of U_ik row k) / U_ii: backwards from the last one. */
void smpc_inverse_packed(const real *L, int n, real *R)
{
    for (int i = n - 1; i >= 0; i--) {
        real *row = R + (long)i * (2 * n - i - 1) / 2; /* row[j] is column j */
        const real f = 1 / L[i * n + i];
        row[i] = f;
        for (int j = i + 1; j < n; j++) row[j] = 0;
        int k = i + 1;
        for (; k + IN_ONE <= n; k += IN_ONE) {
            const real *x[IN_ONE];
            real a[IN_ONE];
            for (int p = 0; p < IN_ONE; p++) {
                x[p] = R + (long)(k + p) * (2 * n - k - p - 1) / 2;
                a[p] = f * L[(k + p) * n + i];
                for (int j = k + p; j < k + IN_ONE; j++) row[j] -= a[p] * x[p][j];
            }
            const int from = k + IN_ONE;
            subtract_four(row + from, x[0] + from, x[1] + from, x[2] + from, x[3] + from, a,
                          n - from);
        }
        for (; k < n; k++) {
            const real *below = R + (long)k * (2 * n - k - 1) / 2;
            subtract(row + k, below + k, f * L[k * n + i], n - k);
        }
    }
}

void smpc_forward(const real *L, int n, real *x)
{
    for (int i = 0; i < n; i++) {
        real sum = x[i];
        for (int k = 0; k < i; k++) sum -= L[i * n + k] * x[k];
        x[i] = sum / L[i * n + i];
    }
}

void smpc_backward(const real *L, int n, real *x)
{
    for (int i = n - 1; i >= 0; i--) {
        x[i] /= L[i * n + i];
        subtract(x, L + i * n, x[i], i);
    }
}

void smpc_add_product(const real *A, int rows, int columns, const real *x, real *y)
{
    for (int i = 0; i < rows; i++) {
        real sum = 0;
        for (int j = 0; j < columns; j++) sum += A[i * columns + j] * x[j];
        y[i] += sum;
    }
}

void smpc_add_transposed(const real *A, int rows, int columns, const real *x, real *y)
{
    for (int i = 0; i < rows; i++) subtract(y, A + i * columns, -x[i], columns);
}

int smpc_all_finite(const real *x, int n)
{
    for (int i = 0; i < n; i++)
        if (!(fabs(x[i]) <= SMPC_HUGE)) return 0;
    return 1;
}
