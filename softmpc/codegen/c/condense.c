/* Condensing: the states follow from the moves, so that a dense program in these is left.
 *
 * The drive is linear, so what moves do to it is constant, and so are costs and limits that see
 * nothing of the arm: data.c has them. What is left goes from interval to interval. */
#include "parts.h"

#include <string.h>

enum { arm = SMPC_ARM, moved = SMPC_MOVED, inputs = SMPC_INPUTS, nu = SMPC_NU };

typedef struct {
    real before[SMPC_NU], u[SMPC_NU], x[SMPC_NX];
} coefficients;

static int reached(int k)
{
    return (smpc_block_of[k] + 1) * inputs; /* moves before and in interval k */
}

static void add_scaled(real *restrict y, const real *restrict x, real f, int count)
{
    for (int j = 0; j < count; j++) y[j] += f * x[j];
}

static void add_four(real *restrict y, const real *restrict a, const real *restrict b,
                     const real *restrict c, const real *restrict d, const real *f, int count)
{
    const real p = f[0], q = f[1], r = f[2], s = f[3];
    for (int j = 0; j < count; j++) y[j] += p * a[j] + q * b[j] + r * c[j] + s * d[j];
}

/* The arm's state at the end of interval k in the moves. */
static void next_sensitivity(const smpc_interval *l, int k, real before[][SMPC_MOVED],
                             real after[][SMPC_MOVED])
{
    const int old = k ? reached(k - 1) : 0;
    for (int i = 0; i < arm; i++) {
        memset(after[i], 0, sizeof(real) * (size_t)reached(k));
        if (!k) continue;
        int j = 0;
        for (; j + 4 <= arm; j += 4)
            add_four(after[i], before[j], before[j + 1], before[j + 2], before[j + 3],
                     l->arm + i * arm + j, old);
        for (; j < arm; j++) add_scaled(after[i], before[j], l->arm[i * arm + j], old);
    }
    for (int r = 0; r < SMPC_STAGED; r++) {
        const int row = k * SMPC_STAGED + r;
        for (int p = smpc_pressures_by.start[row]; p < smpc_pressures_by.start[row + 1]; p++)
            for (int i = 0; i < arm; i++)
                after[i][smpc_pressures_by.column[p]] +=
                    l->pressures[i * SMPC_STAGED + r] * smpc_pressures_by.value[p];
    }
}

/* A row of the moves (all of them) from one of (u_before, u, x). */
static void through(const coefficients *by, int k, real sensitivity[][SMPC_MOVED], real *row)
{
    const int count = reached(k), block = smpc_block_of[k];
    for (int i = 0; i < arm; i++)
        if (by->x[i] != 0) add_scaled(row, sensitivity[i], by->x[i], count);
    for (int i = 0; i < SMPC_DRIVE; i++) {
        if (by->x[arm + i] == 0) continue;
        const int z = k * SMPC_DRIVE + i;
        for (int p = smpc_drive_by.start[z]; p < smpc_drive_by.start[z + 1]; p++)
            row[smpc_drive_by.column[p]] += by->x[arm + i] * smpc_drive_by.value[p];
    }
    for (int i = 0; i < inputs; i++) {
        if (by->u[i] != 0) row[block * inputs + i] += by->u[i];
        if (k && by->before[i] != 0) row[smpc_block_of[k - 1] * inputs + i] += by->before[i];
    }
}

/* H += seen^T seen in its lower half. */
static void square(real *H, real seen[][SMPC_MOVED], int rows, int count)
{
    int r = 0;
    for (; r + 4 <= rows; r += 4)
        for (int i = 0; i < count; i++) {
            const real f[4] = {seen[r][i], seen[r + 1][i], seen[r + 2][i], seen[r + 3][i]};
            add_four(H + i * moved, seen[r], seen[r + 1], seen[r + 2], seen[r + 3], f, i + 1);
        }
    if (r + 3 == rows) /* three coordinates of a tip */
        for (int i = 0; i < count; i++) {
            const real x = seen[r][i], y = seen[r + 1][i], z = seen[r + 2][i];
            const real *restrict a = seen[r], *restrict b = seen[r + 1], *restrict c = seen[r + 2];
            real *restrict h = H + i * moved;
            for (int j = 0; j <= i; j++) h[j] += x * a[j] + y * b[j] + z * c[j];
        }
    else
        for (; r < rows; r++)
            for (int i = 0; i < count; i++) add_scaled(H + i * moved, seen[r], seen[r][i], i + 1);
}

/* The residuals of an interval that move: their part of H. */
static void add_costs(smpc_controller *c, int k, real sensitivity[][SMPC_MOVED])
{
    const real one = 1;
    for (int r = 0; r < SMPC_MOVING_TERMS; r++) {
        memset(c->seen[r], 0, sizeof(real) * (size_t)reached(k));
        coefficients by = {{0}, {0}, {0}};
        smpc_slopes_of(&c->linear, k, &one, smpc_moving_terms[r], 1, by.before, by.u, by.x);
        through(&by, k, sensitivity, c->seen[r]);
    }
    square(c->program.H, c->seen, SMPC_MOVING_TERMS, reached(k));
}

static void add_end(smpc_controller *c, real sensitivity[][SMPC_MOVED])
{
    memset(c->seen, 0, sizeof c->seen);
    for (int r = 0; r < SMPC_END; r++) {
        coefficients by = {{0}, {0}, {0}};
        real pick[SMPC_SIZE(SMPC_END)] = {0};
        pick[r] = 1;
        smpc_end_slopes_of(&c->linear, pick, by.before, by.u, by.x);
        through(&by, SMPC_N - 1, sensitivity, c->seen[r]);
    }
    square(c->program.H, c->seen, SMPC_END, moved);
}

/* The rows of the program of an interval that move. */
static void add_rows(smpc_controller *c, int k, real sensitivity[][SMPC_MOVED])
{
    const real one = 1;
    for (int r = 0; r < SMPC_MOVING_ROWS; r++) {
        real *row = c->program.moving[k * SMPC_MOVING_ROWS + r];
        const int term = smpc_moving_rows[r];
        coefficients by = {{0}, {0}, {0}};
        memset(row, 0, sizeof(real) * SMPC_MOVES);
        if (term < 0) { /* a state that is bounded */
            memcpy(row, sensitivity[-1 - term], sizeof(real) * (size_t)reached(k));
            continue;
        }
        smpc_slopes_of(&c->linear, k, &one, term, 1, by.before, by.u, by.x);
        through(&by, k, sensitivity, row);
        for (int j = 0; j < SMPC_SLACKS; j++)
            row[moved + smpc_block_of[k] * SMPC_SLACKS + j] += by.u[inputs + j];
    }
}

static void damp(smpc_program *p)
{
    for (int i = 0; i < SMPC_MOVES; i++) {
        real *diagonal = i < moved ? p->H + i * (moved + 1) : p->H_diagonal + i;
        if (i >= moved) *diagonal = smpc_slack_squares[i - moved];
        *diagonal = *diagonal * (1 + SMPC_DAMPING) + SMPC_DAMPING;
        p->H_diagonal[i] = *diagonal;
    }
}

/* H and all rows that move, around what was linearised; -1 where H is not positive definite. */
int smpc_condense(smpc_controller *c)
{
    smpc_program *p = &c->program;
    memset(p->H, 0, sizeof p->H);
    for (int i = 0; i < moved; i++)
        for (int q = smpc_still_squares.start[i]; q < smpc_still_squares.start[i + 1]; q++)
            p->H[i * moved + smpc_still_squares.column[q]] = smpc_still_squares.value[q];
    for (int k = 0; k < SMPC_N; k++) {
        real(*after)[SMPC_MOVED] = c->sensitivity[k & 1];
        next_sensitivity(&c->linear.interval[k], k, c->sensitivity[!(k & 1)], after);
        add_costs(c, k, after);
        add_rows(c, k, after);
        if (SMPC_END && k == SMPC_N - 1) add_end(c, after);
    }
    damp(p);
    p->has_inverse = 0;
    return smpc_cholesky(p->H, moved);
}
