/* The controller of a rig on a board, without its sensors: what is called, what it takes. Readings
 * never come, so the state is what the model says, until supervision takes that no longer. */
#include "pilot.h"

#include <math.h>

#include "semihosting.h"
#include "startup.h"

enum { STEPS = 20 };

static smpc_pilot controller;

static int all_finite(const smpc_real *u)
{
    for (int i = 0; i < SMPC_INPUTS; i++)
        if (!(fabs(u[i]) <= SMPC_HUGE)) return 0;
    return 1;
}

int main(void)
{
    static smpc_real references[SMPC_N * SMPC_NR + 1], rest[SMPC_NX];
    static smpc_real holding[SMPC_INPUTS], u[SMPC_INPUTS];
    unsigned long long sum = 0;
    unsigned long most = 0;
    int failed = smpc_pilot_init(&controller, rest, holding, 0);

    for (int32_t k = 1; k <= STEPS && !failed; k++) {
        const unsigned long began = smpc_cycles();
        unsigned long took;
        smpc_pilot_listen(&controller, k * SMPC_STEP_TICKS, 0, 0);
        smpc_pilot_step(&controller, k * SMPC_STEP_TICKS, 0, 0, references, rest, holding, u);
        took = (smpc_cycles() - began) & 0xFFFFFFUL;
        sum += took;
        if (took > most) most = took;
        failed = !all_finite(u);
    }
    smpc_say("steps", STEPS);
    smpc_say("controller_bytes", sizeof controller);
    smpc_say("stack_bytes", smpc_stack_used());
    smpc_say("pilot_ticks", sum);
    smpc_say("pilot_most_ticks", most);
    return failed;
}
