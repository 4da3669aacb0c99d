/* Recorded steps: see steps.h. */
#include "steps.h"

static smpc_controller controller;

static unsigned long since(unsigned long began)
{
    return (smpc_ticks() - began) & ((1UL << SMPC_TICK_BITS) - 1);
}

static void add(unsigned long ticks, unsigned long long *sum, unsigned long *most)
{
    *sum += ticks;
    if (ticks > *most) *most = ticks;
}

static void take(const double *from, smpc_real *to, int n)
{
    for (int i = 0; i < n; i++) to[i] = (smpc_real)from[i];
}

static void step(const double *given, double *answer, smpc_tally *tally)
{
    static smpc_real references[SMPC_N * SMPC_NR], u[SMPC_INPUTS], x[SMPC_NX];
    unsigned long began;
    int status;

    take(given, references, SMPC_N * SMPC_NR);
    take(given + SMPC_N * SMPC_NR, u, SMPC_INPUTS);
    take(given + SMPC_N * SMPC_NR + SMPC_INPUTS, x, SMPC_NX);
    smpc_set_reference(&controller, references);

    began = smpc_ticks();
    smpc_prepare(&controller, u);
    add(since(began), &tally->prepare, &tally->prepare_most);

    began = smpc_ticks();
    status = smpc_feedback(&controller, x, u);
    add(since(began), &tally->feedback, &tally->feedback_most);

    for (int i = 0; i < SMPC_INPUTS; i++) answer[i] = (double)u[i];
    answer[SMPC_INPUTS] = status;
    answer[SMPC_INPUTS + 1] = smpc_last(&controller)->qp;
    answer[SMPC_INPUTS + 2] = smpc_last(&controller)->iterations;
}

int smpc_run_steps(smpc_tally *tally)
{
    static double given[SMPC_STEP_NUMBERS], answer[SMPC_ANSWER_NUMBERS];
    static const smpc_tally nothing;
    long got;

    *tally = nothing;
    smpc_init(&controller);
    while ((got = smpc_read(given, sizeof given)) == (long)sizeof given) {
        step(given, answer, tally);
        if (smpc_write(answer, sizeof answer)) return -1;
        tally->steps++;
    }
    return got == 0 ? 0 : -1;
}
