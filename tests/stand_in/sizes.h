/* Sizes of a small controller that stands in for a generated one. */
#ifndef SMPC_SIZES_H
#define SMPC_SIZES_H

#define SMPC_N 4
#define SMPC_NX 5
#define SMPC_NR 3
#define SMPC_INPUTS 2
#define SMPC_STEP 0.025

#endif
