/* What belongs to a step of some length: the form of the implicit step, and the linear drive, which
 * goes exactly, by matrix exponentials of its blocks. */
#include "estimator_parts.h"

#include <string.h>

enum {
    TERMS = 14, /* of the series; the next is 0.5^15 / 15!, below rounding */
    MOST_SQUARINGS = 64,
    STAGES = SMPC_FILTER_STAGES
};

static void form(smpc_lasting *of, real h)
{
    const real *A = smpc_filter_tableau;
    of->kept = SMPC_ACCELERATES ? 1 : 0;
    for (int i = 0; i < STAGES; i++) {
        of->of_rate[i] = SMPC_ACCELERATES ? smpc_filter_times[i] * h : 0;
        for (int j = 0; j < STAGES; j++) {
            real twice = 0;
            for (int k = 0; k < STAGES; k++) twice += A[i * STAGES + k] * A[k * STAGES + j];
            of->to_strain[i][j] = SMPC_ACCELERATES ? h * h * twice : h * A[i * STAGES + j];
            of->to_rate[i][j] = SMPC_ACCELERATES ? h * A[i * STAGES + j] : (i == j);
        }
    }
}

/* to = f X Y, n x n */
static void product(const real *X, const real *Y, real f, int n, real *to)
{
    memset(to, 0, sizeof(real) * (size_t)(n * n));
    for (int i = 0; i < n; i++)
        for (int k = 0; k < n; k++)
            for (int j = 0; j < n; j++) to[i * n + j] += f * X[i * n + k] * Y[k * n + j];
}

/* How often h M must be halved until its row sums are below 1/2. */
static int halvings(const real *M, int n, real h)
{
    real norm = 0;
    for (int i = 0; i < n; i++) {
        real sum = 0;
        for (int j = 0; j < n; j++) sum += (real)fabs(h * M[i * n + j]);
        if (sum > norm) norm = sum;
    }
    int count = 0;
    for (; count < MOST_SQUARINGS && norm > (real)0.5; count++) norm *= (real)0.5;
    return count;
}

/* E := exp(h M), by its series and squaring. F = E - 1 is carried, so that slow motions beside fast
 * ones keep all their digits: (1 + F)^2 = 1 + 2 F + F^2. */
static void exponential(smpc_lasting *of, const real *M, int n, real h, real *E)
{
    real *X = of->block[0], *term = of->block[1], *next = of->block[2];
    const size_t size = sizeof(real) * (size_t)(n * n);
    const int squarings = halvings(M, n, h);
    real part = h;
    for (int i = 0; i < squarings; i++) part *= (real)0.5;
    for (int i = 0; i < n * n; i++) X[i] = part * M[i];
    memcpy(E, X, size);
    memcpy(term, X, size);
    for (int k = 2; k <= TERMS; k++) {
        product(term, X, (real)1 / (real)k, n, next);
        memcpy(term, next, size);
        for (int i = 0; i < n * n; i++) E[i] += term[i];
    }
    for (int k = 0; k < squarings; k++) {
        product(E, E, 1, n, next);
        for (int i = 0; i < n * n; i++) E[i] = 2 * E[i] + next[i];
    }
    for (int i = 0; i < n; i++) E[i * n + i] += 1;
}

/* f times the slope of a drive state after a stage, in states and offsets; the entries written. */
static int state_row(const smpc_lasting *of, int stage, int i, real f, real *to)
{
    const int block = smpc_filter_block_of[i], kind = smpc_filter_block_kind[block];
    const int size = smpc_filter_kind_size[kind], states = smpc_filter_block_states[block];
    const real *E = of->drive[stage] + smpc_filter_kind_start[kind];
    const unsigned short *member = smpc_filter_block_member + smpc_filter_block_start[block];
    const smpc_sparse *G = &smpc_filter_offset_by_d;
    int count = 0;
    E += smpc_filter_place_in_block[i] * size;
    for (int j = 0; j < states; j++) to[count++] = f * E[j];
    for (int j = states; j < size; j++) {
        const int input = member[j] - SMPC_DRIVE;
        for (int p = G->start[input]; p < G->start[input + 1]; p++)
            to[count++] = f * E[j] * G->value[p];
    }
    return count;
}

static void pressure_row(const smpc_lasting *of, int stage, int i, real *to)
{
    const smpc_sparse *C = &smpc_filter_pressure_by_z, *D = &smpc_filter_pressure_by_u;
    const smpc_sparse *G = &smpc_filter_offset_by_d;
    for (int p = C->start[i]; p < C->start[i + 1]; p++)
        to += state_row(of, stage, C->column[p], C->value[p], to);
    for (int p = D->start[i]; p < D->start[i + 1]; p++)
        for (int r = G->start[D->column[p]]; r < G->start[D->column[p] + 1]; r++)
            *to++ = D->value[p] * G->value[r];
}

void smpc_prepare_step(smpc_lasting *of, real seconds)
{
    if (of->length == seconds) return;
    form(of, seconds);
    for (int stage = 0; stage < STAGES; stage++) {
        for (int kind = 0; kind < SMPC_DRIVE_KINDS; kind++) {
            const int first = smpc_filter_kind_start[kind];
            exponential(of, smpc_filter_kind_rates + first, smpc_filter_kind_size[kind],
                        smpc_filter_times[stage] * seconds, of->drive[stage] + first);
        }
        for (int i = 0; i < SMPC_PRESSURES; i++)
            pressure_row(of, stage, i, of->pressure_rows[stage] + smpc_filter_pressure_start[i]);
    }
    for (int i = 0; i < SMPC_DRIVE; i++)
        state_row(of, STAGES - 1, i, 1, of->drive_rows + smpc_filter_drive_start[i]);
    of->length = seconds;
}

/* Drive states (scaled) at a stage, from z and the input v with its offset. */
void smpc_move_drive(const smpc_lasting *of, int stage, const real *z, const real *v, real *to)
{
    for (int i = 0; i < SMPC_DRIVE; i++) {
        const int block = smpc_filter_block_of[i], kind = smpc_filter_block_kind[block];
        const int size = smpc_filter_kind_size[kind];
        const real *E = of->drive[stage] + smpc_filter_kind_start[kind];
        const unsigned short *member = smpc_filter_block_member + smpc_filter_block_start[block];
        E += smpc_filter_place_in_block[i] * size;
        to[i] = 0;
        for (int j = 0; j < size; j++) {
            const int of_u = member[j] - SMPC_DRIVE;
            to[i] += E[j] * (of_u < 0 ? z[member[j]] : v[of_u]);
        }
    }
}
