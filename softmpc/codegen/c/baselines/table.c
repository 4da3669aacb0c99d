/* The inputs that hold the path at rest, from inverse statics, and proportional-integral feedback
 * of the tip: u = input + S (k e + k_i sum of e h), with the inverse S of the static sensitivity of
 * the tip to the inputs at the nearest place. */
#include "model.h"
#include "parts.h"

/* Where the references are, in the order of SMPC_REFERENCES. */
enum { INPUT = 0, TIP = SMPC_INPUTS };

void smpc_wanted(smpc_controller *c, const real *x, real *wanted)
{
    const real *told = c->references;
    const real *S = smpc_gains + smpc_nearest(told + TIP) * SMPC_INPUTS * 3;
    real tip[3], push[3];
    smpc_tip(x, tip);
    for (int i = 0; i < 3; i++) {
        const real error = told[TIP + i] - tip[i];
        c->integral[i] += (real)SMPC_STEP * error;
        push[i] = (real)SMPC_PROPORTIONAL * error + (real)SMPC_INTEGRAL * c->integral[i];
    }
    for (int i = 0; i < SMPC_INPUTS; i++)
        wanted[i] = told[INPUT + i] + S[3 * i] * push[0] + S[3 * i + 1] * push[1] +
                    S[3 * i + 2] * push[2];
}
