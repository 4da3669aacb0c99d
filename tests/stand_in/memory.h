/* What the stand-in remembers: as large as a real controller's. */
#ifndef SMPC_MEMORY_H
#define SMPC_MEMORY_H

#include "real.h"

enum { STAND_IN_SIZE = 60 };

typedef struct {
    int status, qp, iterations;
} smpc_report;

typedef struct smpc_controller {
    smpc_real references[SMPC_N * SMPC_NR];
    smpc_real H[STAND_IN_SIZE * STAND_IN_SIZE];
    smpc_real f[STAND_IN_SIZE];
    int pivot[STAND_IN_SIZE];
    smpc_real spare[20000];
    smpc_report report;
} smpc_controller;

#endif
