/* The path of the scene, run by the controller on the plant in closed loop.
 *
 *     ./run [--steps N] [--csv FILE]
 *
 * Prints how it went, and what the monitor saw at worst. Ends with 0 where all steps were solved, 1
 * where some were not, 2 for a command that is wrong, 3 where the plant stops. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "controller.h"
#include "monitor.h"
#include "plant.h"
#include "reference.h"

enum { STATUSES = SMPC_FAILED + 1, SECTIONS = SMPC_PLANT_SECTIONS, INPUTS = SMPC_INPUTS };

typedef struct options {
    long steps;
    FILE *csv;
} options;

typedef struct record {
    double ms[SMPC_RUN_STEPS]; /* processor time of the controller */
    long statuses[STATUSES], steps, samples;
    double squares, largest; /* of the tip's error, m */
} record;

static smpc_controller controller;
static smpc_monitor monitor;
static smpc_plant plant;
static record run;

static int usage(const char *complaint, const char *what)
{
    fprintf(stderr, "%s%s\nusage: run [--steps 1...%d] [--csv FILE]\n", complaint, what,
            SMPC_RUN_STEPS);
    return 2;
}

static int parse(int count, char **words, options *given)
{
    given->steps = SMPC_RUN_STEPS;
    given->csv = NULL;
    for (int i = 1; i < count; i += 2) {
        char *end = NULL;
        if (i + 1 >= count) return usage("not known, or without a value: ", words[i]);
        if (strcmp(words[i], "--steps") == 0) {
            given->steps = strtol(words[i + 1], &end, 10);
            if (*end || given->steps < 1 || given->steps > SMPC_RUN_STEPS)
                return usage("not that many steps: ", words[i + 1]);
        } else if (strcmp(words[i], "--csv") == 0 && !given->csv) {
            given->csv = fopen(words[i + 1], "w");
            if (!given->csv) return usage("cannot be written: ", words[i + 1]);
        } else
            return usage("not known: ", words[i]);
    }
    return 0;
}

/* --- trajectory ------------------------------------------------------------------------------- */

static void write_header(FILE *csv)
{
    if (!csv) return;
    fprintf(csv, "t [s]");
    for (int s = 1; s <= SECTIONS; s++) fprintf(csv, ",x_%d [m],y_%d [m],z_%d [m]", s, s, s);
    fprintf(csv, ",x_ref [m],y_ref [m],z_ref [m]");
    for (int j = 1; j <= INPUTS; j++) fprintf(csv, ",u_%d", j);
    fprintf(csv, ",status,step [ms]\n");
}

static void write_row(FILE *csv, double t, const double *tips, const double *asked,
                      const double *u, int status, double ms)
{
    if (!csv) return;
    fprintf(csv, "%.6f", t);
    for (int i = 0; i < 3 * SECTIONS; i++) fprintf(csv, ",%.12g", tips[i]);
    for (int i = 0; i < 3; i++) fprintf(csv, ",%.12g", asked[i]);
    for (int j = 0; j < INPUTS; j++) fprintf(csv, ",%.12g", u[j]);
    fprintf(csv, ",%d,%.4f\n", status, ms);
}

/* --- closed loop ------------------------------------------------------------------------------ */

/* The input for step k in the number type of the controller; u holds the one until now. */
static int control(long k, double *u)
{
    double seen[SMPC_NX];
    smpc_real x[SMPC_NX], before[INPUTS], next[INPUTS];
    smpc_plant_seen(&plant, u, seen);
    for (int i = 0; i < SMPC_NX; i++) x[i] = (smpc_real)seen[i];
    for (int j = 0; j < INPUTS; j++) before[j] = (smpc_real)u[j];
    smpc_set_reference(&controller, smpc_run_references + k * SMPC_RUN_AHEAD * SMPC_NR);

    const clock_t began = clock();
    const int status = smpc_step(&controller, x, before, next);
    run.ms[k] = 1e3 * (double)(clock() - began) / CLOCKS_PER_SEC;
    run.statuses[status]++;
    smpc_monitor_update(&monitor, &controller, x, next);
    for (int j = 0; j < INPUTS; j++) u[j] = next[j];
    return status;
}

static double squared_distance(const double *a, const double *b)
{
    double sum = 0;
    for (int i = 0; i < 3; i++) sum += (a[i] - b[i]) * (a[i] - b[i]);
    return sum;
}

/* The error of a sample. */
static void measure(long sample, const double *tips)
{
    const double *tip = tips + 3 * (SECTIONS - 1);
    const double square = squared_distance(tip, smpc_run_asked + 3 * sample);
    if (!smpc_run_counts[sample]) return;
    run.squares += square;
    run.samples++;
    if (square > run.largest) run.largest = square;
}

static int close_loop(const options *given)
{
    const double sample = (double)SMPC_STEP / SMPC_RUN_SAMPLES;
    double u[INPUTS], tips[3 * SECTIONS];
    memcpy(u, smpc_run_u, sizeof u);
    smpc_init(&controller);
    smpc_monitor_init(&monitor);
    smpc_plant_init(&plant, smpc_run_x);
    smpc_plant_tips(&plant, tips);
    measure(0, tips);
    write_header(given->csv);
    for (long k = 0; k < given->steps; k++) {
        const int status = control(k, u);
        for (long s = k * SMPC_RUN_SAMPLES + 1; s <= (k + 1) * SMPC_RUN_SAMPLES; s++) {
            if (smpc_plant_step(&plant, u, sample) != 0) {
                fprintf(stderr, "the plant stops at %.3f s\n", (double)(s - 1) * sample);
                return 3;
            }
            smpc_plant_tips(&plant, tips);
            measure(s, tips);
            write_row(given->csv, (double)s * sample, tips, smpc_run_asked + 3 * s, u, status,
                      run.ms[k]);
        }
        run.steps = k + 1;
    }
    return run.statuses[SMPC_SOLVED] == run.steps ? 0 : 1;
}

/* --- summary ---------------------------------------------------------------------------------- */

static int by_size(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* The smallest time that so large a share of the steps keeps. */
static double quantile(double share)
{
    long rank = (long)(share * (double)run.steps);
    if ((double)rank < share * (double)run.steps) rank++;
    return run.ms[rank > 0 ? rank - 1 : 0];
}

static void print_summary(void)
{
    const double rms = run.samples ? sqrt(run.squares / (double)run.samples) : 0;
    qsort(run.ms, (size_t)run.steps, sizeof *run.ms, by_size);
    printf("%ld steps:", run.steps);
    for (int status = 0; status < STATUSES; status++)
        if (run.statuses[status])
            printf(" %ld %s,", run.statuses[status], smpc_status_name(status));
    if (run.samples)
        printf(" tip error after %g s: %.6f mm RMS, %.6f mm at most,", (double)SMPC_RUN_SETTLE,
               1e3 * rms, 1e3 * sqrt(run.largest));
    else
        printf(" no tip error counts before %g s,", (double)SMPC_RUN_SETTLE);
    printf(" step: %.3f ms median, %.3f ms at 99.9 %%\n", quantile(0.5), quantile(0.999));
}

static void print_monitor(void)
{
    const smpc_observed *w = &monitor.worst;
    printf("at worst:");
    if (w->known & SMPC_KNOWS_TIP)
        printf(" tip %.2f mm from the edge of the reachable set,", 1e3 * (double)w->tip_margin);
    if (w->known & SMPC_KNOWS_REFERENCE)
        printf(" its reference %.2f mm,", 1e3 * (double)w->reference_margin);
    if (w->known & SMPC_KNOWS_PRESSURE)
        printf(" pressure %.2f %% of its range from a limit,", 1e2 * (double)w->pressure_room);
    if (w->known & SMPC_KNOWS_BACK_OFF)
        printf(" %.1f %% of the back-off used,", 1e2 * (double)w->back_off);
#if SMPC_TUBES
    printf(" Reynolds number %.0f,", (double)w->largest_reynolds);
#endif
    printf(" %d iterations of the quadratic program, %.2f on average\n", w->iterations,
           (double)monitor.mean_iterations);
#if defined(SMPC_DISTURBANCES) && SMPC_DISTURBANCES
    puts("the state is known here, and what the model lacks is not: the pilot estimates both (pilot.h)");
#endif
}

int main(int count, char **words)
{
    options given;
    int code = parse(count, words, &given);
    if (code == 0) {
        code = close_loop(&given);
        print_summary();
        print_monitor();
        if (given.csv && fclose(given.csv) != 0) code = usage("could not be written", "");
    }
    return code;
}
