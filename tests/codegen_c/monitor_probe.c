/* The monitor after a step that is told: what the controller's report and references are. */
#include "monitor.h"

static smpc_controller controller;

void probe(smpc_monitor *m, const int *report, const smpc_real *references, const smpc_real *x,
           const smpc_real *u)
{
    controller.report.status = report[0];
    controller.report.qp = report[1];
    controller.report.iterations = report[2];
    for (int i = 0; i < SMPC_NR; i++) controller.references[0][i] = references[i];
    smpc_monitor_update(m, &controller, x, u);
}
