/* A pilot under random readings: good ones of an arm at rest, and of everything that is none.
 *
 * ./fuzz_pilot STEPS SEED   prints how often it was in each state, and exits with 1 where an input
 * was not finite, or outside the limits of torque or torque rate. nominal.h is the test's. */
#include "pilot.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "guard.h"
#include "nominal.h"

static smpc_pilot pilot;
static unsigned long long state;

static unsigned draw(unsigned below)
{
    state = state * 6364136223846793005ULL + 1442695040888963407ULL;
    return (unsigned)(state >> 33) % below;
}

static smpc_real odd(void)
{
    static const smpc_real numbers[] = {0,   1,          -1,  SMPC_HUGE, -SMPC_HUGE,
                                        4e5, 1 / SMPC_HUGE, 0.5, -1e12};
    const unsigned which = draw(12);
    if (which == 9) return (smpc_real)NAN;
    if (which > 9) return which == 10 ? (smpc_real)INFINITY : -(smpc_real)INFINITY;
    return numbers[which];
}

static int32_t odd_tick(int32_t tick)
{
    static const int32_t ticks[] = {INT32_MIN, INT32_MAX, 0, -1};
    return draw(2) ? ticks[draw(4)] : tick - 100 + (int32_t)draw(200);
}

static void spoil(smpc_real *numbers, int count)
{
    for (int i = 0; i < count; i++)
        if (!draw(3)) numbers[i] = odd();
}

static smpc_sample reading(int32_t tick, int bad)
{
    smpc_sample one;
    const int sensor = (int)draw(SMPC_SENSORS);
    memset(&one, 0, sizeof one);
    one.sensor = bad && !draw(4) ? (int32_t)draw(9) - 4 : sensor;
    one.stamp = bad && draw(2) ? odd_tick(tick) : tick - 5 * (int32_t)draw(6);
    for (int i = 0; i < SMPC_LARGEST_READING; i++)
        one.value[i] =
            nominal_reading[sensor][i] + nominal_noise[sensor] * ((int)draw(200) - 100) / 60;
    if (bad && draw(2)) spoil(one.value, SMPC_LARGEST_READING);
    return one;
}

static int usable(const smpc_controller *c, const smpc_real *before, const smpc_real *u)
{
    smpc_real nearest[SMPC_INPUTS];
    smpc_guarded(c, before, u, nearest);
    for (int i = 0; i < SMPC_INPUTS; i++)
        if (!(u[i] == nearest[i])) return 0;
    return 1;
}

int main(int argc, char **argv)
{
    const int steps = argc > 1 ? atoi(argv[1]) : 1000;
    int counts[4] = {0}, troubles[8] = {0}, wrong = 0;
    int32_t tick = 0;
    smpc_real u[SMPC_INPUTS], before[SMPC_INPUTS];
    static smpc_real references[SMPC_N * SMPC_NR], rest[SMPC_NX], holding[SMPC_INPUTS];
    state = argc > 2 ? strtoull(argv[2], NULL, 10) : 1;
    if (smpc_pilot_init(&pilot, nominal_x, nominal_u, tick)) return 2;
    memcpy(before, nominal_u, sizeof before);
    for (int k = 0; k < steps; k++) {
        smpc_sample samples[12];
        const int spell = k / 40 % 3, bad = spell && draw(3) < (unsigned)spell;
        const int count = (int)draw(13);
        for (int i = 0; i < count; i++) samples[i] = reading(tick, bad && draw(2));
        memcpy(references, nominal_references, sizeof references);
        memcpy(rest, nominal_x, sizeof rest);
        memcpy(holding, nominal_u, sizeof holding);
        if (bad && !draw(6)) spoil(references, SMPC_N * SMPC_NR);
        if (bad && !draw(6)) spoil(rest, SMPC_NX);
        if (bad && !draw(6)) spoil(holding, SMPC_INPUTS);
        counts[smpc_pilot_step(&pilot, tick, samples, count, references, rest, holding, u)]++;
        troubles[pilot.act.trouble]++;
        wrong += !usable(&pilot.controller, before, u);
        memcpy(before, u, sizeof before);
        if (!draw(5)) smpc_pilot_listen(&pilot, tick, samples, count);
        tick += SMPC_STEP_TICKS + (draw(20) ? 0 : (int32_t)draw(30) - 15);
        if (!draw(300)) tick += 3000;
        if (!draw(300)) tick -= 3000;
    }
    for (int i = 0; i < 4; i++) printf("  %s %d\n", smpc_state_name(i), counts[i]);
    for (int i = 0; i < 7; i++) printf("  trouble %s: %d\n", smpc_trouble_name(i), troubles[i]);
    printf("  wrong %d\n", wrong);
    return wrong > 0;
}
