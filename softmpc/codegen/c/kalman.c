/* The two halves of an extended Kalman filter on the augmented state. */
#include "estimator_parts.h"

#include <string.h>

#include "linear.h"

enum { arm = SMPC_FILTER_ARM, nx = SMPC_FILTER_X, all = SMPC_FILTERED };

static void add_row(real *restrict to, const real *restrict row, real f, int size)
{
    for (int j = 0; j < size; j++) to[j] += f * row[j];
}

/* Share of a variance that linearising leaves: as large as the uncertainty of the strains. */
real smpc_linearising_leaves(const real *P)
{
    real worst = 0;
    for (int i = 0; i < SMPC_STRAINS; i++)
        if (P[i * all + i] > worst) worst = P[i * all + i];
    real share = (real)SMPC_CURVATURE * (real)SMPC_CURVATURE * worst;
    if (share > (real)SMPC_BENT_MOST) share = (real)SMPC_BENT_MOST;
    return share > (real)SMPC_BENT_LEAST && worst < 1 ? share : 0;
}

/* row . A[i] for a row of the drive */
static real times_drive(const real *row, const smpc_move *m, int i)
{
    real sum = 0;
    for (int p = smpc_filter_drive_start[i]; p < smpc_filter_drive_start[i + 1]; p++)
        sum += m->of.drive_rows[p] * row[smpc_filter_drive_column[p]];
    return sum;
}

/* A P: rows of the arm are full, those of the drive have a few entries, the others are ones. */
static void multiply(smpc_move *m, const real *P)
{
    memset(m->AP, 0, sizeof m->AP);
    for (int i = 0; i < arm; i++)
        for (int k = 0; k < all; k++) {
            add_row(m->AP + i * all, P + k * all, m->A[i * all + k], all);
            m->A_turned[k * arm + i] = m->A[i * all + k];
        }
    for (int i = 0; i < SMPC_DRIVE; i++)
        for (int p = smpc_filter_drive_start[i]; p < smpc_filter_drive_start[i + 1]; p++)
            add_row(m->AP + (arm + i) * all, P + smpc_filter_drive_column[p] * all,
                    m->of.drive_rows[p], all);
    memcpy(m->AP + nx * all, P + nx * all, sizeof(real) * (all - nx) * all);
}

/* P := (A P) A^T; what is above the diagonal decides. */
static void multiply_turned(const smpc_move *m, real *P)
{
    for (int i = 0; i < all; i++) {
        const real *row = m->AP + i * all;
        real *to = P + i * all;
        if (i < arm) {
            memset(to, 0, sizeof(real) * arm);
            for (int k = 0; k < all; k++) add_row(to, m->A_turned + k * arm, row[k], arm);
        }
        for (int j = i < arm ? arm : i; j < all; j++)
            to[j] = j < nx ? times_drive(row, m, j - arm) : row[j];
        for (int j = 0; j < i; j++) to[j] = P[j * all + i];
    }
}

/* Covariance after a step with the slope in m. `bent` is the variance that linearising leaves of
 * each change, as a share: the model is not straight over what P spans. */
void smpc_predict(smpc_belief *b, smpc_move *m, real seconds, real bent)
{
    real before[all], *P = b->P;
    for (int i = 0; i < all; i++) before[i] = P[i * all + i];
    multiply(m, P);
    multiply_turned(m, P);
    for (int i = 0; i < all; i++) {
        const real after = P[i * all + i];
        const real change = after - 2 * m->AP[i * all + i] + before[i];
        P[i * all + i] = after + (change > 0 ? bent * change : 0)
                         + smpc_filter_intensity[i] * seconds;
    }
}

/* X (n x m) := S^-1 X with its Cholesky factor. */
static void solve_rows(const real *L, int size, real *X)
{
    for (int i = 0; i < size; i++) {
        real *row = X + i * all, f = 1 / L[i * size + i];
        for (int k = 0; k < i; k++) add_row(row, X + k * all, -L[i * size + k], all);
        for (int j = 0; j < all; j++) row[j] *= f;
    }
    for (int i = size - 1; i >= 0; i--) {
        real *row = X + i * all, f = 1 / L[i * size + i];
        for (int k = i + 1; k < size; k++) add_row(row, X + k * all, -L[k * size + i], all);
        for (int j = 0; j < all; j++) row[j] *= f;
    }
}

static real times_row(const smpc_look *look, int i, const real *x)
{
    real sum = 0;
    for (int p = 0; p < look->filled[i]; p++)
        sum += look->H[i * all + look->column[i][p]] * x[look->column[i][p]];
    return sum;
}

/* What innovations mean before covariance P: H P, their covariance S, the gain. */
int smpc_expect(smpc_look *look, const real *P)
{
    const int size = look->count;
    for (int i = 0; i < size; i++) {
        real *row = look->HP + i * all;
        memset(row, 0, sizeof(real) * all);
        for (int p = 0; p < look->filled[i]; p++) {
            const int c = look->column[i][p];
            add_row(row, P + c * all, look->H[i * all + c], all);
        }
        for (int j = 0; j < size; j++) look->S[i * size + j] = times_row(look, j, row);
        look->S[i * size + i] += look->R[i];
    }
    memcpy(look->factor, look->S, sizeof(real) * (size_t)(size * size));
    if (smpc_cholesky(look->factor, size)) return SMPC_NOT_POSITIVE;
    memcpy(look->gain, look->HP, sizeof(real) * (size_t)(size * all));
    solve_rows(look->factor, size, look->gain);
    return SMPC_NO_TROUBLE;
}

/* State and covariance after readings. Joseph's form, (I - K H) P (I - K H)^T + K R K^T, one factor
 * after the other: symmetric and positive whatever the rounding of the gain K. */
void smpc_update(smpc_belief *b, const smpc_look *look)
{
    const int size = look->count;
    for (int i = 0; i < all; i++) {
        real other[SMPC_READ], *row = b->P + i * all;
        for (int k = 0; k < size; k++) {
            const real gain = look->gain[k * all + i];
            add_row(row, look->HP + k * all, -gain, all);
            b->s[i] += gain * look->e[k];
        }
        for (int k = 0; k < size; k++)
            other[k] = times_row(look, k, row) - look->gain[k * all + i] * look->R[k];
        for (int k = 0; k < size; k++) add_row(row, look->gain + k * all, -other[k], all);
    }
    for (int i = 0; i < all; i++)
        for (int j = 0; j < i; j++) {
            const real mean = (b->P[i * all + j] + b->P[j * all + i]) / 2;
            b->P[i * all + j] = b->P[j * all + i] = mean;
        }
}
