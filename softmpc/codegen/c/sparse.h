/* A constant sparse matrix, row by row: the entries of row i are start[i] to start[i + 1]. */
#ifndef SMPC_SPARSE_H
#define SMPC_SPARSE_H

#include "real.h"

typedef struct {
    const int *start;
    const unsigned short *column;
    const smpc_real *value;
} smpc_sparse;

#endif
