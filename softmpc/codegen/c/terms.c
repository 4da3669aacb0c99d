/* Costs and limits of all intervals: values, and slopes. Most are linear, and their slopes are
 * constants; those of the others ("bent") are asked of the model. */
#include "model.h"
#include "parts.h"

#include <string.h>

enum { nu = SMPC_NU, nx = SMPC_NX, across = 2 * SMPC_NU + SMPC_NX };

typedef struct {
    const real *before, *u, *x, *given;
    real ratio;
} place;

static place place_of(const smpc_moment *m, const smpc_path *at, int k)
{
    place p = {k ? at->u[k - 1] : m->u_before, at->u[k], at->x[k], m->given[k], smpc_ratio[k]};
    return p;
}

static real squares(const real *e, int count)
{
    real sum = 0;
    for (int i = 0; i < count; i++) sum += e[i] * e[i];
    return sum;
}

/* The cost and the limit rows from the values of all terms of an interval. */
static void take(smpc_measured *found, const smpc_path *at, int k, const real *terms)
{
    found->cost += squares(terms, SMPC_RESIDUALS) / 2;
    for (int i = 0; i < nu; i++) found->cost += smpc_price[i] * at->u[k][i];
    memcpy(found->rows[k], terms + SMPC_RESIDUALS, sizeof(real) * SMPC_ROWS);
}

static void measure_terms(smpc_measured *found, const smpc_moment *m, const smpc_path *at)
{
    found->cost = 0;
    for (int k = 0; k < SMPC_N; k++) {
        place p = place_of(m, at, k);
        real terms[SMPC_SIZE(SMPC_TERMS)];
        smpc_terms(p.before, p.u, p.x, p.given, &p.ratio, terms);
        take(found, at, k, terms);
    }
#if SMPC_END
    place p = place_of(m, at, SMPC_N - 1);
    real end[SMPC_END];
    smpc_end_terms(p.before, p.u, p.x, p.given, &p.ratio, end);
    found->cost += squares(end, SMPC_END) / 2;
#endif
}

void smpc_linearise_terms(smpc_linear *l, const smpc_moment *m, const smpc_path *at)
{
    l->measured.cost = 0;
    for (int k = 0; k < SMPC_N; k++) {
        place p = place_of(m, at, k);
        smpc_terms(p.before, p.u, p.x, p.given, &p.ratio, l->terms[k]);
#if SMPC_BENT
        smpc_terms_slopes(p.before, p.u, p.x, p.given, &p.ratio, l->bent[k]);
#endif
        take(&l->measured, at, k, l->terms[k]);
    }
#if SMPC_END
    place p = place_of(m, at, SMPC_N - 1);
    smpc_end_terms(p.before, p.u, p.x, p.given, &p.ratio, l->end);
#if SMPC_END_BENT
    smpc_end_slopes(p.before, p.u, p.x, p.given, &p.ratio, l->end_bent);
#endif
    l->measured.cost += squares(l->end, SMPC_END) / 2;
#endif
}

void smpc_measure(smpc_measured *found, const smpc_moment *m, const smpc_path *at)
{
    for (int k = 0; k < SMPC_N; k++) smpc_measure_interval(found, m, at, k);
    measure_terms(found, m, at);
}

int smpc_finite(const smpc_measured *measured)
{
    return fabs(measured->cost) <= SMPC_HUGE
           && smpc_all_finite(measured->defects[0], SMPC_N * (SMPC_NA + nx))
           && (SMPC_ROWS == 0 || smpc_all_finite(measured->rows[0], SMPC_N * SMPC_ROWS));
}

/* (u_before, u, x) of a step side by side. */
static void beside(const smpc_path *step, int k, real *all)
{
    if (k)
        memcpy(all, step->u[k - 1], sizeof(real) * nu);
    else
        memset(all, 0, sizeof(real) * nu);
    memcpy(all + nu, step->u[k], sizeof(real) * nu);
    memcpy(all + 2 * nu, step->x[k], sizeof(real) * nx);
}

static void add_bent(const real *slopes, const short *rows, int count, const short *columns,
                     int width, const real *all, real *values)
{
    for (int i = 0; i < count; i++)
        for (int j = 0; j < width; j++)
            values[rows[i]] += slopes[i * width + j] * all[columns[j]];
}

/* The linearised terms of an interval after a step. */
void smpc_terms_after(const smpc_linear *l, int k, const smpc_path *step, real *terms)
{
    real all[across];
    beside(step, k, all);
    memcpy(terms, l->terms[k], sizeof(real) * SMPC_TERMS);
    smpc_sparse_add(&smpc_terms_by[smpc_kind_of[k]], 0, SMPC_TERMS, all, terms);
    add_bent(l->bent[k], smpc_bent, SMPC_BENT, smpc_bent_columns, SMPC_BENT_COLUMNS, all, terms);
}

/* The same of what counts at the end of the horizon alone. */
void smpc_end_after(const smpc_linear *l, const smpc_path *step, real *end)
{
    real all[across];
    beside(step, SMPC_N - 1, all);
    memcpy(end, l->end, sizeof(real) * SMPC_END);
    smpc_sparse_add(&smpc_end_by, 0, SMPC_END, all, end);
    add_bent(l->end_bent, smpc_end_bent, SMPC_END_BENT, smpc_end_columns, SMPC_END_COLUMNS, all,
             end);
}

static void spread_out(const real *all, real *by_before, real *by_u, real *by_x)
{
    for (int i = 0; i < nu && by_before; i++) by_before[i] += all[i];
    for (int i = 0; i < nu && by_u; i++) by_u[i] += all[nu + i];
    for (int i = 0; i < nx; i++) by_x[i] += all[2 * nu + i];
}

/* Adds the slopes of the sum of factor times term, for some terms of an interval. */
void smpc_slopes_of(const smpc_linear *l, int k, const real *factors, int first, int count,
                    real *by_before, real *by_u, real *by_x)
{
    real all[across] = {0};
    smpc_sparse_add_transposed(&smpc_terms_by[smpc_kind_of[k]], first, count, factors, all);
    for (int i = 0; i < SMPC_BENT; i++) {
        const int row = smpc_bent[i] - first;
        if (row < 0 || row >= count) continue;
        for (int j = 0; j < SMPC_BENT_COLUMNS; j++)
            all[smpc_bent_columns[j]] += factors[row] * l->bent[k][i * SMPC_BENT_COLUMNS + j];
    }
    spread_out(all, by_before, by_u, by_x);
}

void smpc_end_slopes_of(const smpc_linear *l, const real *factors, real *by_before, real *by_u,
                        real *by_x)
{
    real all[across] = {0};
    smpc_sparse_add_transposed(&smpc_end_by, 0, SMPC_END, factors, all);
    for (int i = 0; i < SMPC_END_BENT; i++)
        for (int j = 0; j < SMPC_END_COLUMNS; j++)
            all[smpc_end_columns[j]] +=
                factors[smpc_end_bent[i]] * l->end_bent[i * SMPC_END_COLUMNS + j];
    spread_out(all, by_before, by_u, by_x);
}
