/* The stages of one step, solved by simplified Newton iterations with the matrix of all stages,
 * I x B0 + h A x B1 + h^2 A^2 x B2 (Hairer and Wanner, Solving ODEs II, IV.8). The unknowns y of a
 * stage are the highest derivatives: accelerations of the strains (rates without inertia), and
 * rates of those states of the drive that have no closed form. */
#include "plant_stages.h"

#include <math.h>
#include <string.h>

#include "plant_model.h"

enum {
    N = SMPC_PLANT_N,
    K = SMPC_PLANT_K,
    SIZE = SMPC_PLANT_SIZE,
    STAGES = SMPC_PLANT_STAGES,
    ALL = SMPC_PLANT_UNKNOWNS,
    ITERATIONS = 7
};

static const double SLOWEST = 0.9;    /* a contraction above it says nothing about what is left */
static const double ACCURACY = 0.02;  /* of the stages, of the tolerance */
static const double ROUNDING = 1e-10; /* m */
static const double SURE = 0.2;       /* of the wanted size: small enough whatever the contraction */

typedef struct state {
    double q[N], dq[N], z[K + 1];
} state;

/* --- the equations of a stage ----------------------------------------------------------------- */

static void rows_at(const state *s, const double *y, const double *w, double *rows)
{
    smpc_plant_rows(s->q, s->dq, s->z, y, w, rows);
}

static void blocks_at(smpc_plant *p, const state *s, const double *y, const double *w)
{
    smpc_plant_blocks(s->q, s->dq, s->z, y, w, p->by_y, p->by_first, p->by_second);
}

/* Pressures, or the input of a drive that is solved with the arm, so long after `held` (s). */
static void drive_at(const smpc_plant *p, double after, double *z, double *w)
{
    double t = p->held + after;

    if (K || SMPC_PLANT_JOINT) {
        if (w) memcpy(w, p->u, sizeof p->u);
        return;
    }
    smpc_plant_drive(p->z, p->u, &t, z, w);
}

static state state_now(const smpc_plant *p)
{
    state s;

    memcpy(s.q, p->x, sizeof s.q);
    memcpy(s.dq, p->x + N, sizeof s.dq);
    memset(s.z, 0, sizeof s.z);
    memcpy(s.z, p->x + 2 * N, K * sizeof *s.z);
    return s;
}

/* The state at stage i of a step with unknowns y. */
static state state_at(const smpc_plant *p, double h, const double *y, int i)
{
    state s = state_now(p);

    for (int a = 0; a < N && SMPC_PLANT_ORDER == 2; a++)
        s.q[a] += smpc_plant_c[i] * h * s.dq[a];
    for (int a = 0; a < N && SMPC_PLANT_ORDER == 1; a++) s.dq[a] = y[i * SIZE + a];
    for (int j = 0; j < STAGES; j++) {
        double once = h * smpc_plant_A[i * STAGES + j];
        double twice = h * h * smpc_plant_A2[i * STAGES + j];
        for (int a = 0; a < N; a++) {
            double value = y[j * SIZE + a];
            s.q[a] += (SMPC_PLANT_ORDER == 2 ? twice : once) * value;
            s.dq[a] += SMPC_PLANT_ORDER == 2 ? once * value : 0.0;
        }
        for (int a = 0; a < K; a++) s.z[a] += once * y[j * SIZE + N + a];
    }
    return s;
}

/* --- start of an input ------------------------------------------------------------------------ */

int smpc_plant_begin(smpc_plant *p)
{
    state s = state_now(p);
    double rows[SIZE];

    memset(p->y, 0, sizeof p->y);
    drive_at(p, 0.0, 0, p->w);
    for (int round = 0; round < 2; round++) { /* the second one takes the rounding out */
        rows_at(&s, p->y, p->w, rows);
        blocks_at(p, &s, p->y, p->w);
        memcpy(p->newton, p->by_y, sizeof p->by_y);
        if (smpc_plant_factorise(p->newton, p->pivot, SIZE) != 0) return -1;
        smpc_plant_solve(p->newton, p->pivot, SIZE, rows);
        for (int i = 0; i < SIZE; i++) p->y[i] -= smpc_plant_y_scale[i] * rows[i];
    }
    for (int i = 0; i < ALL; i++) p->stages[i] = p->y[i % SIZE];
    if (SMPC_PLANT_ORDER == 1) memcpy(p->x + N, p->y, N * sizeof *p->y);
    return 0;
}

/* --- one step --------------------------------------------------------------------------------- */

/* Unknowns at the stages from the polynomial of the last step. */
static void predict(smpc_plant *p, double h)
{
    memset(p->found, 0, sizeof p->found);
    for (int i = 0; i < STAGES; i++) {
        double ahead = 1.0 + h / p->h_before * smpc_plant_c[i];
        for (int j = 0; j < STAGES; j++) {
            double weight = 1.0;
            for (int k = 0; k < STAGES; k++)
                if (k != j)
                    weight *= (ahead - smpc_plant_c[k]) / (smpc_plant_c[j] - smpc_plant_c[k]);
            for (int a = 0; a < SIZE; a++)
                p->found[i * SIZE + a] += weight * p->stages[j * SIZE + a];
        }
    }
}

/* Factors of the matrix of all stages, with derivatives at the middle one. */
static int prepare(smpc_plant *p, double h)
{
    state s = state_at(p, h, p->found, STAGES / 2);

    blocks_at(p, &s, p->found + STAGES / 2 * SIZE, p->w + STAGES / 2 * SMPC_PLANT_NW);
    for (int i = 0; i < STAGES; i++)
        for (int j = 0; j < STAGES; j++) {
            double once = h * smpc_plant_A[i * STAGES + j];
            double twice = h * h * smpc_plant_A2[i * STAGES + j];
            for (int a = 0; a < SIZE; a++)
                for (int b = 0; b < SIZE; b++) {
                    int at = a * SIZE + b;
                    p->newton[(i * SIZE + a) * ALL + j * SIZE + b] =
                        (i == j ? p->by_y[at] : 0.0) + once * p->by_first[at] +
                        twice * p->by_second[at];
                }
        }
    return smpc_plant_factorise(p->newton, p->pivot, ALL);
}

/* How far (m) a change of the scaled unknowns moves the tip at the end of the step. */
static double size_of(const double *change, double h)
{
    const double *b = smpc_plant_A + (STAGES - 1) * STAGES; /* the last stage is the end */
    const double *arm = SMPC_PLANT_ORDER == 2 ? smpc_plant_A2 + (STAGES - 1) * STAGES : b;
    double size = 0.0;

    for (int a = 0; a < SIZE; a++) {
        double sum = 0.0;
        for (int j = 0; j < STAGES; j++) sum += (a < N ? arm : b)[j] * change[j * SIZE + a];
        size += smpc_plant_levers[a] * fabs(sum) * (a < N && SMPC_PLANT_ORDER == 2 ? h * h : h);
    }
    return size;
}

static int is_done(double size, double rate, int first)
{
    double wanted = ACCURACY * SMPC_PLANT_TOLERANCE;
    int known = !first && rate < SLOWEST && size * rate / (1.0 - rate) <= wanted;
    int rounding = rate >= SLOWEST && size <= ROUNDING;

    return size <= SURE * wanted || known || rounding;
}

int smpc_plant_solve_stages(smpc_plant *p, double h)
{
    double before = 0.0;

    for (int i = 0; i < STAGES; i++)
        drive_at(p, smpc_plant_c[i] * h, 0, p->w + i * SMPC_PLANT_NW);
    predict(p, h);
    if (prepare(p, h) != 0) return 0;
    for (int k = 0; k < ITERATIONS; k++) {
        double size, rate;

        for (int i = 0; i < STAGES; i++) {
            state s = state_at(p, h, p->found, i);
            rows_at(&s, p->found + i * SIZE, p->w + i * SMPC_PLANT_NW, p->change + i * SIZE);
        }
        smpc_plant_solve(p->newton, p->pivot, ALL, p->change);
        for (int i = 0; i < ALL; i++)
            p->found[i] -= smpc_plant_y_scale[i % SIZE] * p->change[i];
        size = size_of(p->change, h);
        rate = k > 0 ? size / before : SLOWEST / 2;
        if (is_done(size, rate, k == 0)) return 1;
        if ((k > 0 && !(rate < SLOWEST)) || !(size < 1e6)) /* true for NaN too */
            return 0;
        before = size;
    }
    return 0;
}

double smpc_plant_error(smpc_plant *p, double h)
{
    double *raw = p->change, error = 0.0, scaled[SIZE];

    for (int a = 0; a < SIZE; a++) {
        scaled[a] = smpc_plant_embedded[0] * p->y[a];
        for (int j = 0; j < STAGES; j++)
            scaled[a] += smpc_plant_embedded[1 + j] * p->found[j * SIZE + a];
        scaled[a] /= smpc_plant_y_scale[a];
    }
    /* What stiff modes would do with it in a step: the Newton matrix takes them out. */
    memset(raw, 0, sizeof p->change);
    for (int b = 0; b < SIZE; b++)
        for (int a = 0; a < SIZE; a++)
            for (int i = 0; i < STAGES; i++)
                raw[i * SIZE + a] += p->by_y[a * SIZE + b] * scaled[b];
    smpc_plant_solve(p->newton, p->pivot, ALL, raw);
    raw += (STAGES - 1) * SIZE;
    for (int a = 0; a < SIZE; a++)
        error += smpc_plant_levers[a] * fabs(raw[a]) *
                 (a < N && SMPC_PLANT_ORDER == 2 ? h * h : h);
    return error / SMPC_PLANT_TOLERANCE;
}

void smpc_plant_accept(smpc_plant *p, double h)
{
    state end = state_at(p, h, p->found, STAGES - 1);

    memcpy(p->x, end.q, sizeof end.q);
    memcpy(p->x + N, end.dq, sizeof end.dq);
    memcpy(p->x + 2 * N, end.z, K * sizeof *end.z);
    drive_at(p, h, p->x + 2 * N, 0);
    p->held += h;
    memcpy(p->stages, p->found, sizeof p->stages);
    memcpy(p->y, p->found + (STAGES - 1) * SIZE, sizeof p->y);
}
