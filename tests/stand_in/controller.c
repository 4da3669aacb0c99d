/* Stands in for a generated controller: a dense system made of what is given, solved by LU. */
#include "controller.h"
#include "linear.h"

void smpc_init(smpc_controller *c)
{
    for (int i = 0; i < SMPC_N * SMPC_NR; i++) c->references[i] = 0;
    c->report.status = c->report.qp = c->report.iterations = 0;
}

void smpc_set_reference(smpc_controller *c, const real *references)
{
    for (int i = 0; i < SMPC_N * SMPC_NR; i++) c->references[i] = references[i];
}

void smpc_prepare(smpc_controller *c, const real *u_before)
{
    enum { n = STAND_IN_SIZE };
    real phase = u_before[0] + u_before[1];

    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) {
            real angle = phase + (real)(i * n + j);
            c->H[i * n + j] = sin(angle) + (i == j ? 20 : 0);
        }
    c->report.status = smpc_lu(c->H, c->pivot, n);
}

int smpc_feedback(smpc_controller *c, const real *x, real *u)
{
    enum { n = STAND_IN_SIZE };
    real kept[256]; /* so that the stack has a known least depth */

    for (int i = 0; i < 256; i++) kept[i] = x[i % SMPC_NX] * (real)exp((real)i * (real)-0.01);
    for (int i = 0; i < n; i++)
        c->f[i] = kept[(7 * i) % 256] + c->references[i % (SMPC_N * SMPC_NR)];
    smpc_lu_solve(c->H, c->pivot, n, c->f, 1);
    for (int i = 0; i < SMPC_INPUTS; i++) u[i] = c->f[i];
    c->report.qp = 1;
    c->report.iterations++;
    return c->report.status;
}

const smpc_report *smpc_last(const smpc_controller *c) { return &c->report; }
