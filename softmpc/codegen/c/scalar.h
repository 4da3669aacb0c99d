/* Arithmetic of the controller's own sources, in its number type. Not for those who include
 * controller.h: in float it redefines functions of <math.h>. */
#ifndef SMPC_SCALAR_H
#define SMPC_SCALAR_H

#include "real.h"

#include <math.h>

typedef smpc_real real;

#ifdef SMPC_FLOAT
/* As <tgmath.h> would have it, which newlib, the library of most microcontrollers, has broken: it
 * names complex functions of long double that are not there. */
#define sin(x) sinf(x)
#define cos(x) cosf(x)
#define tan(x) tanf(x)
#define asin(x) asinf(x)
#define acos(x) acosf(x)
#define atan(x) atanf(x)
#define sinh(x) sinhf(x)
#define cosh(x) coshf(x)
#define tanh(x) tanhf(x)
#define exp(x) expf(x)
#define expm1(x) expm1f(x)
#define log(x) logf(x)
#define log1p(x) log1pf(x)
#define sqrt(x) sqrtf(x)
#define fabs(x) fabsf(x)
#define floor(x) floorf(x)
#define ceil(x) ceilf(x)
#define fmin(x, y) fminf(x, y)
#define fmax(x, y) fmaxf(x, y)
#define pow(x, y) powf(x, y)
#define fmod(x, y) fmodf(x, y)
#define atan2(x, y) atan2f(x, y)
#define hypot(x, y) hypotf(x, y)
#endif

#endif
