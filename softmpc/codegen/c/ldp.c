/* DAQP on a workspace of the controller's own.
 *
 * Its bounds are those of the moves, whose rows are those of the packed inverse factor; its rows are
 * those that were taken, in y. Rows are normalised, as DAQP wants them. */
#include "ldp.h"
#include "parts.h"

#ifdef SMPC_FLOAT
#define DAQP_SINGLE_PRECISION
#endif
#define DAQP_NO_SOFT_WEIGHTS
#include "daqp/daqp.h"

#include <string.h>

enum { moved = SMPC_MOVED, moves = SMPC_MOVES };

static long packed(int i, int n)
{
    return (long)i * (2 * n - i - 1) / 2; /* where the entry (i, 0) would be */
}

static int takes_part(const smpc_program *p, int row, int move)
{
    const int place = smpc_row_place[row];
    if (place >= 0) return p->moving[place][move] != 0;
    for (int q = smpc_rows_by.start[row]; q < smpc_rows_by.start[row + 1]; q++)
        if (smpc_rows_by.column[q] == move) return 1;
    return 0;
}

/* The rows that were taken and the slacks that these have; -1 where they are too many. */
static int choose(smpc_controller *c, int *slacks)
{
    smpc_qp_memory *m = &c->qp;
    int count = 0;
    *slacks = 0;
    for (int row = 0; row < SMPC_PROGRAM_ROWS; row++) {
        if (!m->taken[row]) continue;
        if (count == SMPC_MAX_ROWS) return -1;
        m->chosen[count++] = row;
    }
    for (int j = moved; j < moves; j++)
        for (int r = 0; r < count; r++)
            if (takes_part(&c->program, m->chosen[r], j)) {
                m->slacks[(*slacks)++] = j;
                break;
            }
    return count;
}

static real normalised(real *row, int count)
{
    real square = 0;
    for (int j = 0; j < count; j++) square += row[j] * row[j];
    if (!(square >= (real)SMPC_QP_ZERO)) return 0;
    const real scale = 1 / (real)sqrt(square);
    for (int j = 0; j < count; j++) row[j] *= scale;
    return scale;
}

static real times(const real *a, const real *b, int count)
{
    real sum = 0;
    for (int j = 0; j < count; j++) sum += a[j] * b[j];
    return sum;
}

static void side(smpc_qp_memory *m, int i, real low, real high, real at, int active)
{
    m->upper[i] = high * m->scaling[i] + at;
    m->lower[i] = low * m->scaling[i] + at;
    m->sense[i] = active ? DAQP_ACTIVE | (active < 0 ? DAQP_LOWER : 0) : 0;
}

/* Bounds of the moves that take part: rows of L^-T, and of the slacks' own diagonal. */
static void fill_bounds(smpc_controller *c, int n)
{
    smpc_qp_memory *m = &c->qp;
    const smpc_program *p = &c->program;
    for (int i = 0; i < n; i++) {
        const int move = i < moved ? i : m->slacks[i - moved];
        real *row = m->rinv + packed(i, n);
        memset(row + i, 0, sizeof(real) * (size_t)(n - i));
        if (i < moved)
            memcpy(row + i, p->inverse + packed(i, moved) + i, sizeof(real) * (size_t)(moved - i));
        else
            row[i] = 1 / (real)sqrt(p->H_diagonal[move]);
        m->scaling[i] = normalised(row + i, n - i);
        side(m, i, p->low[move], p->high[move], times(row + i, m->v + i, n - i), p->active[move]);
    }
}

/* A row in y: each of its entries brings the row of L^-T that belongs to its move. */
static void row_in_y(smpc_controller *c, int row, int n, real *y)
{
    const smpc_program *p = &c->program;
    real all[SMPC_MOVES];
    memset(y, 0, sizeof(real) * (size_t)n);
    memset(all, 0, sizeof all);
    if (smpc_row_place[row] >= 0)
        memcpy(all, p->moving[smpc_row_place[row]], sizeof all);
    else
        for (int q = smpc_rows_by.start[row]; q < smpc_rows_by.start[row + 1]; q++)
            all[smpc_rows_by.column[q]] = smpc_rows_by.value[q];
    for (int i = 0; i < moved; i++) {
        if (all[i] == 0) continue;
        const real *back = p->inverse + packed(i, moved);
        for (int j = i; j < moved; j++) y[j] += all[i] * back[j];
    }
    for (int j = moved; j < n; j++) {
        const int move = c->qp.slacks[j - moved];
        y[j] = all[move] / (real)sqrt(p->H_diagonal[move]);
    }
}

/* The rows that were taken; -1 where one is nothing and must be something. */
static int fill_rows(smpc_controller *c, int n, int count)
{
    smpc_qp_memory *m = &c->qp;
    const smpc_program *p = &c->program;
    for (int r = 0; r < count; r++) {
        const int row = m->chosen[r], i = n + r;
        real *y = m->M + (long)r * n;
        row_in_y(c, row, n, y);
        m->scaling[i] = normalised(y, n);
        if (m->scaling[i] == 0) {
            if (p->row_low[row] > SMPC_BROKEN || p->row_high[row] < -SMPC_BROKEN) return -1;
            m->scaling[i] = 1;
            side(m, i, -1, 1, 0, 0);
            m->sense[i] = DAQP_IMMUTABLE; /* nothing moves it */
            continue;
        }
        side(m, i, p->row_low[row], p->row_high[row], times(y, m->v, n), p->active[moves + row]);
    }
    return 0;
}

static void connect(smpc_qp_memory *m, DAQPSettings *settings, DAQPWorkspace *work, int n, int rows)
{
    memset(work, 0, sizeof *work);
    memset(settings, 0, sizeof *settings);
    settings->primal_tol = (real)SMPC_QP_PRIMAL;
    settings->dual_tol = (real)SMPC_QP_DUAL;
    settings->zero_tol = (real)SMPC_QP_ZERO;
    settings->pivot_tol = (real)SMPC_QP_PIVOT;
    settings->progress_tol = (real)SMPC_QP_PROGRESS;
    settings->cycle_tol = DAQP_DEFAULT_CYCLE_TOL;
    settings->fval_bound = DAQP_INF;
    settings->sing_tol = (real)SMPC_QP_SINGULAR_PIVOT;
    settings->refactor_tol = (real)SMPC_QP_REFACTOR;
    settings->rho_soft = (real)DAQP_DEFAULT_RHO_SOFT;
    work->settings = settings;
    work->n = work->ms = n;
    work->m = n + rows;
    work->M = m->M, work->dupper = m->upper, work->dlower = m->lower, work->Rinv = m->rinv;
    work->v = m->v, work->scaling = m->scaling, work->sense = m->sense;
    work->x = m->x, work->xold = m->x_old, work->u = m->u, work->Mu = m->Mu;
    work->lam = m->lam, work->lam_star = m->lam_star;
    work->L = m->L, work->D = m->D, work->xldl = m->xldl, work->zldl = m->zldl;
    work->WS = m->working;
    work->state = DAQP_STATE_RINV_NORMALIZED;
    reset_daqp_workspace(work);
}

/* DAQP in short runs where a clock is given, so that it can be stopped; else in one. */
static int run(smpc_controller *c, DAQPWorkspace *work, double deadline)
{
    const int piece = c->clock ? 16 : c->cap;
    int flag = DAQP_EXIT_ITERLIMIT;
    while (c->program.iterations < c->cap) {
        const int left = c->cap - c->program.iterations;
        work->settings->iter_limit = piece < left ? piece : left;
        flag = daqp_ldp(work);
        c->program.iterations += work->iterations;
        if (flag != DAQP_EXIT_ITERLIMIT) break;
        if (c->clock && c->clock(c->clock_with) > deadline) return DAQP_EXIT_TIMELIMIT;
    }
    return flag;
}

/* What is left of the slope, y + g + M^T lambda with y = u - v; too much after a bad guess. */
static int is_optimal(smpc_qp_memory *m, const DAQPWorkspace *work)
{
    const int n = work->n;
    real most = 1, left = 0;
    memcpy(m->x_old, work->u, sizeof(real) * (size_t)n);
    for (int a = 0; a < work->n_active; a++) {
        const int id = work->WS[a];
        const real *row = id < n ? m->rinv + packed(id, n) : m->M + (long)(id - n) * n;
        for (int j = id < n ? id : 0; j < n; j++) m->x_old[j] += work->lam_star[a] * row[j];
    }
    for (int j = 0; j < n; j++) {
        if (fabs(m->v[j]) > most) most = (real)fabs(m->v[j]);
        if (!(fabs(m->x_old[j]) <= left)) left = (real)fabs(m->x_old[j]);
    }
    return left <= (real)SMPC_QP_SLOPE * most;
}

static void take_answer(smpc_controller *c, const DAQPWorkspace *work)
{
    smpc_qp_memory *m = &c->qp;
    smpc_program *p = &c->program;
    const int n = work->n;
    for (int j = 0; j < n; j++) m->x[j] = work->u[j] - m->v[j];
    for (int i = 0; i < n; i++) {
        const int move = i < moved ? i : m->slacks[i - moved];
        p->v[move] = times(m->rinv + packed(i, n) + i, m->x + i, n - i) / m->scaling[i];
        p->multipliers[move] = 0;
    }
    for (int a = 0; a < work->n_active; a++) {
        const int id = work->WS[a];
        const real value = work->lam_star[a] * m->scaling[id];
        if (id >= n)
            p->multipliers[moves + m->chosen[id - n]] = value;
        else
            p->multipliers[id < moved ? id : m->slacks[id - moved]] = value;
    }
}

static int meaning(int flag)
{
    switch (flag) {
    case DAQP_EXIT_INFEASIBLE: return SMPC_QP_INFEASIBLE;
    case DAQP_EXIT_CYCLE: return SMPC_QP_CYCLING;
    case DAQP_EXIT_ITERLIMIT: return SMPC_QP_ITERATION_LIMIT;
    case DAQP_EXIT_TIMELIMIT: return SMPC_QP_TIME_LIMIT;
    default: return SMPC_QP_NOT_OPTIMAL;
    }
}

int smpc_least_distance(smpc_controller *c, double deadline)
{
    smpc_qp_memory *m = &c->qp;
    smpc_program *p = &c->program;
    DAQPWorkspace work;
    DAQPSettings settings;
    int slacks;
    const int count = choose(c, &slacks), n = moved + slacks;
    if (count < 0) return SMPC_QP_TOO_MANY_ROWS;
    p->rows = count;
    memcpy(m->v, p->f, sizeof(real) * moved);
    smpc_forward(p->H, moved, m->v);
    for (int j = moved; j < n; j++) {
        const int move = m->slacks[j - moved];
        m->v[j] = p->f[move] / (real)sqrt(p->H_diagonal[move]);
    }
    fill_bounds(c, n);
    if (fill_rows(c, n, count)) return SMPC_QP_INFEASIBLE;
    connect(m, &settings, &work, n, count);
    if (daqp_activate_constraints(&work) < 0) return SMPC_QP_NOT_OPTIMAL;
    const int flag = run(c, &work, deadline);
    if (flag != DAQP_EXIT_OPTIMAL && flag != DAQP_EXIT_SOFT_OPTIMAL) return meaning(flag);
    if (!is_optimal(m, &work)) return SMPC_QP_NOT_OPTIMAL;
    take_answer(c, &work);
    return SMPC_QP_OPTIMAL;
}
