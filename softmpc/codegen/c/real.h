/* The number type of the controller: double, or float with -DSMPC_FLOAT. */
#ifndef SMPC_REAL_H
#define SMPC_REAL_H

#ifdef SMPC_FLOAT
typedef float smpc_real;
#define SMPC_EPSILON 1.1920929e-7f
#define SMPC_HUGE 3.4028235e38f
#else
typedef double smpc_real;
#define SMPC_EPSILON 2.220446049250313e-16
#define SMPC_HUGE 1.7976931348623157e308
#endif

#endif
