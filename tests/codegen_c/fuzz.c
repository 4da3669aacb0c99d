/* Random inputs for a generated controller, plausible ones and any others.
 *
 *     fuzz COUNT SEED [BUDGET]
 *
 * Each of COUNT steps must return, within BUDGET seconds of CPU time (0: any), with an input that is
 * finite and within its limits. Prints what was met; the exit code is 1 where something was wrong. */
#define _POSIX_C_SOURCE 199309L
#include "controller.h"
#include "data.h"
#include "scalar.h"

#include <float.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

enum { inputs = SMPC_INPUTS, nx = SMPC_NX, references = SMPC_N * SMPC_NR, statuses = 5, qps = 11 };
enum { plausible, stretched, extreme, special, mixed, kinds };

static smpc_controller controller;
static uint64_t state;
static real x[SMPC_NX], u_before[SMPC_INPUTS], u[SMPC_INPUTS];
static real given[SMPC_SIZE(SMPC_N * SMPC_NR)];
static double ticked;
static long steps, of_status[statuses], of_qp[qps], wrong, iterations, warm, limited;

/* --- random numbers ---------------------------------------------------------------------------- */

static uint64_t draw(void) /* xorshift64*, Marsaglia and Vigna */
{
    state ^= state >> 12;
    state ^= state << 25;
    state ^= state >> 27;
    return state * UINT64_C(2685821657736338717);
}

static double uniform(double low, double high)
{
    return low + (high - low) * (double)(draw() >> 11) / 9007199254740992.0;
}

static int chance(double share)
{
    return uniform(0, 1) < share;
}

static double power_of_ten(double low, double high)
{
    double found = 1, e = uniform(low, high);
    for (; e >= 1; e--) found *= 10;
    for (; e <= -1; e++) found /= 10;
    return found * (1 + 1.25 * e);
}

static real special_value(void)
{
    static const double values[] = {
        0, -0.0, 1, -1, DBL_MIN, DBL_MIN / 1e8, -DBL_MIN / 1e4, 1e-40, DBL_EPSILON, 1e6, -1e6, 1e16,
        1e30, -1e30, 1e38, -1e38, 1e154, -1e154, 1e300, -1e300, DBL_MAX, -DBL_MAX};
    static const double bad[] = {0, 1, -1};
    volatile double zero = 0;
    if (chance(0.2)) return (real)(bad[draw() % 3] / zero); /* NaN and infinities */
    return (real)values[draw() % (sizeof values / sizeof *values)];
}

static real number(int kind, double scale)
{
    if (kind == mixed) kind = (int)(draw() % mixed);
    switch (kind) {
    case plausible: return (real)(scale * uniform(-0.5, 1));
    case stretched: return (real)(scale * uniform(-1, 1) * power_of_ten(-3, 3));
    case extreme: return (real)(scale * uniform(-1, 1) * power_of_ten(-300, 290));
    default: return special_value();
    }
}

/* Half of the time plausible, and then finite; a share of each other kind. */
static int any_kind(void)
{
    return chance(0.5) ? plausible : (int)(draw() % kinds);
}

static void fill(real *to, const real *scale, double size, int count, double rare)
{
    const int kind = any_kind();
    for (int i = 0; i < count; i++)
        to[i] = number(chance(rare) ? mixed : kind, scale ? (double)scale[i] : size);
}

/* --- one step ---------------------------------------------------------------------------------- */

static double ticking(void *tick)
{
    return ticked += *(double *)tick;
}

static double now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static void complain(const char *what)
{
    if (wrong++ < 5) fprintf(stderr, "step %ld: %s\n", steps, what);
}

static int finite(const real *values, int count)
{
    for (int i = 0; i < count; i++)
        if (!(fabs(values[i]) <= SMPC_HUGE)) return 0;
    return 1;
}

static void check(int status)
{
    const smpc_controller *c = &controller;
    const smpc_report *r = smpc_last(c);
    if (!finite(u, inputs)) complain("the input is not finite");
    for (int i = 0; i < inputs; i++) {
        const real room = 4 * SMPC_EPSILON * (real)(fabs(c->u_before[i]) + fabs(u[i]));
        if (!(u[i] >= c->low[i] && u[i] <= c->high[i])) complain("the input is outside its limits");
        if (u[i] > c->low[i] && u[i] > c->u_before[i] + c->rise[i] + room)
            complain("the input rises too fast");
        if (u[i] < c->high[i] && u[i] < c->u_before[i] + c->fall[i] - room)
            complain("the input falls too fast");
    }
    if (status != r->status || status < 0 || status >= statuses) complain("unknown status");
    if (r->qp < 0 || r->qp >= qps || r->source < 0 || r->source > SMPC_HELD) complain("report");
    if (r->iterations < 0 || r->iterations > SMPC_QP_ITERATIONS) complain("iterations");
    if (status == SMPC_SOLVED && !(r->qp == SMPC_QP_OPTIMAL && finite(&r->cost, 1)))
        complain("solved without a solution");
    if (!strcmp(smpc_status_name(status), "unknown") || !strcmp(smpc_qp_name(r->qp), "unknown"))
        complain("a code without a name");
    of_status[status]++;
    of_qp[r->qp]++;
    iterations += r->iterations;
    warm += r->qp != SMPC_QP_NONE && !r->restarted;
    limited += r->active > 0;
}

static void narrow(void)
{
    real bounds[4][SMPC_INPUTS];
    const real *of[4];
    for (int b = 0; b < 4; b++) {
        const int kind = any_kind();
        for (int i = 0; i < inputs; i++)
            bounds[b][i] = number(kind, (b == 0 || b == 2 ? -1 : 1) * (double)smpc_u_scale[i]);
        of[b] = chance(0.5) ? bounds[b] : NULL;
    }
    smpc_set_limits(&controller, of[0], of[1], of[2], of[3]);
}

/* What a caller may do between steps. */
static void meddle(void)
{
    static double tick;
    if (chance(0.005)) smpc_init(&controller);
    if (chance(0.02)) narrow();
    if (chance(0.002)) smpc_set_cap(&controller, (unsigned)(draw() % 50));
    if (chance(0.05)) smpc_set_cap(&controller, 0);
    if (chance(0.05)) smpc_set_limits(&controller, NULL, NULL, NULL, NULL);
    if (chance(0.05)) {
        tick = chance(0.1) ? (double)special_value() : chance(0.5) ? 0 : power_of_ten(-6, 1);
        smpc_set_clock(&controller, ticking, &tick, chance(0.5) ? 1 : (double)special_value());
    }
    if (chance(0.05)) smpc_set_clock(&controller, NULL, NULL, 0);
}

/* New inputs: often near the last ones, so that plans are followed and programs start warm. */
static void choose(void)
{
    if (chance(0.3)) fill(x, smpc_x_scale, 0, nx, chance(0.1) ? 0.1 : 0);
    for (int i = 0; i < nx; i++)
        if (chance(0.3)) x[i] += (real)(uniform(-0.01, 0.01) * (double)smpc_x_scale[i]);
    if (chance(0.9))
        memcpy(u_before, u, sizeof u);
    else
        fill(u_before, smpc_u_scale, 0, inputs, chance(0.1) ? 0.1 : 0);
    if (chance(0.3)) {
        fill(given, NULL, chance(0.5) ? 0.3 : 1.0, references, chance(0.1) ? 0.01 : 0);
        smpc_set_reference(&controller, given);
    }
}

static int step(void)
{
    if (chance(0.5)) return smpc_step(&controller, x, u_before, u);
    if (chance(0.98)) smpc_prepare(&controller, u_before);
    if (chance(0.02)) smpc_prepare(&controller, u_before);
    return smpc_feedback(&controller, x, u);
}

/* --- all of them -------------------------------------------------------------------------------- */

static void report(double seconds, double longest, uint64_t seed)
{
    printf("%ld steps of seed %llu, %.1f s of CPU time\n", steps, (unsigned long long)seed, seconds);
    for (int i = 0; i < statuses; i++)
        printf("  %-18s %9ld\n", smpc_status_name(i), of_status[i]);
    for (int i = 0; i < qps; i++) printf("  QP %-15s %9ld\n", smpc_qp_name(i), of_qp[i]);
    printf("  %-18s %9ld\n  %-18s %9ld\n", "from a plan", warm, "limits active", limited);
    printf("  %-18s %9ld\n", "QP iterations", iterations);
    printf("  %-18s %9.3f ms of CPU time\n  %-18s %9ld\n", "longest step", 1e3 * longest, "wrong",
           wrong);
}

int main(int count, char **words)
{
    const long wanted = count > 1 ? atol(words[1]) : 1000;
    const uint64_t seed = count > 2 ? (uint64_t)atoll(words[2]) : 1;
    const double budget = count > 3 ? atof(words[3]) : 0, began = now();
    double longest = 0;
    state = seed * UINT64_C(0x9E3779B97F4A7C15) + 1;
    smpc_init(&controller);
    smpc_set_reference(&controller, given);
    for (steps = 0; steps < wanted; steps++) {
        meddle();
        choose();
        const double start = now();
        const int status = step();
        const double took = now() - start;
        if (took > longest) longest = took;
        if (budget > 0 && took > budget) complain("a step took too long");
        check(status);
    }
    report(now() - began, longest, seed);
    return wrong ? 1 : 0;
}
