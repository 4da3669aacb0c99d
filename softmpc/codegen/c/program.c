/* What the quadratic program still lacks until the state is known: slope, bounds, sides of rows. */
#include "parts.h"

#include <string.h>

enum { inputs = SMPC_INPUTS, slacks = SMPC_SLACKS, moved = SMPC_MOVED, nu = SMPC_NU };

/* Where decision i of interval k stands among the moves. */
static int move_of(int k, int i)
{
    const int block = smpc_block_of[k];
    return i < inputs ? block * inputs + i : moved + block * slacks + i - inputs;
}

static void bound_moves(smpc_controller *c)
{
    smpc_program *p = &c->program;
    const smpc_path *at = &c->at;
    for (int i = 0; i < SMPC_MOVES; i++) {
        p->low[i] = -SMPC_HUGE;
        p->high[i] = SMPC_HUGE;
    }
    for (int k = 0; k < SMPC_N; k++)
        for (int i = 0; i < nu; i++) {
            const int j = move_of(k, i);
            const real low = c->u_low[i] - at->u[k][i], high = c->u_high[i] - at->u[k][i];
            if (low > p->low[j]) p->low[j] = low;
            if (high < p->high[j]) p->high[j] = high;
        }
}

static void bound_states(smpc_program *p, const smpc_path *at, const smpc_path *freely, int k)
{
    for (int b = 0; b < SMPC_BOUNDED; b++) {
        const int i = smpc_bounded[b], row = k * SMPC_BOUNDED + b;
        const real base = at->x[k][i] + freely->x[k][i];
        p->row_low[row] = smpc_x_low[i] - base;
        p->row_high[row] = smpc_x_high[i] - base;
    }
}

/* The program's slope and sides; `freely` is what changes without any move. */
void smpc_make_program(smpc_controller *c, const smpc_path *freely)
{
    smpc_program *p = &c->program;
    real moves[SMPC_N][SMPC_NU] = {{0}};
    memset(c->slope, 0, sizeof c->slope);
    bound_moves(c);
    for (int k = 0; k < SMPC_N; k++) {
        real terms[SMPC_SIZE(SMPC_TERMS)];
        smpc_terms_after(&c->linear, k, freely, terms);
        smpc_slopes_of(&c->linear, k, terms, 0, SMPC_RESIDUALS, k ? moves[k - 1] : NULL, moves[k],
                       c->slope[k]);
        bound_states(p, &c->at, freely, k);
        for (int r = 0; r < SMPC_ROWS; r++) {
            const int row = SMPC_N * SMPC_BOUNDED + k * SMPC_ROWS + r;
            p->row_low[row] = c->row_low[r] - terms[SMPC_RESIDUALS + r];
            p->row_high[row] = c->row_high[r] - terms[SMPC_RESIDUALS + r];
        }
    }
    if (SMPC_END) {
        real end[SMPC_SIZE(SMPC_END)];
        smpc_end_after(&c->linear, freely, end);
        smpc_end_slopes_of(&c->linear, end, SMPC_N > 1 ? moves[SMPC_N - 2 + (SMPC_N < 2)] : NULL,
                           moves[SMPC_N - 1], c->slope[SMPC_N - 1]);
    }
    smpc_gather(&c->linear, c->slope, moves);
    memset(p->f, 0, sizeof p->f);
    for (int k = 0; k < SMPC_N; k++)
        for (int i = 0; i < nu; i++) p->f[move_of(k, i)] += moves[k][i] + smpc_price[i];
}

/* A row of the program times the moves. */
real smpc_row_times(const smpc_program *p, int row, const real *v)
{
    const int place = smpc_row_place[row];
    real sum = 0;
    if (place >= 0) {
        for (int j = 0; j < SMPC_MOVES; j++) sum += p->moving[place][j] * v[j];
        return sum;
    }
    for (int q = smpc_rows_by.start[row]; q < smpc_rows_by.start[row + 1]; q++)
        sum += smpc_rows_by.value[q] * v[smpc_rows_by.column[q]];
    return sum;
}
