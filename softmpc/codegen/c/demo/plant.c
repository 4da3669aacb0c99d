#include "plant.h"

#include <math.h>
#include <string.h>

#include "plant_model.h"
#include "plant_stages.h"

enum { TRIALS = 200000, MOST_FAILURES = 40 };

static const double FIRST_STEP = 1e-3; /* s, where nothing is known about the motion */
static const double SAFETY = 0.9, SHRINK = 0.2, GROW = 4.0;

void smpc_plant_init(smpc_plant *p, const double *x0)
{
    memset(p, 0, sizeof *p);
    memcpy(p->x, x0, sizeof p->x);
}

const double *smpc_plant_state(const smpc_plant *p)
{
    return p->x;
}

void smpc_plant_tips(const smpc_plant *p, double *tips)
{
    smpc_plant_ends(p->x, tips);
}

void smpc_plant_seen(const smpc_plant *p, const double *u, double *x)
{
    for (int i = 0; i < SMPC_PLANT_SEEN; i++) {
        x[i] = 0.0;
        for (int j = 0; j < SMPC_PLANT_NX; j++)
            x[i] += smpc_plant_seen_by_x[i * SMPC_PLANT_NX + j] * p->x[j];
        for (int j = 0; j < SMPC_PLANT_INPUTS; j++)
            x[i] += smpc_plant_seen_by_u[i * SMPC_PLANT_INPUTS + j] * u[j];
    }
}

/* A new input is held from now on. */
static int hold(smpc_plant *p, const double *u)
{
    for (int i = 0; i < SMPC_PLANT_INPUTS; i++)
        if (!isfinite(u[i])) return -1;
    memcpy(p->u, u, sizeof p->u);
    memcpy(p->z, p->x + 2 * SMPC_PLANT_N, SMPC_PLANT_NZ * sizeof *p->z);
    p->held = 0.0;
    p->failures = 0;
    p->h = p->h_before = FIRST_STEP;
    p->holds = smpc_plant_begin(p) == 0;
    return p->holds ? 0 : -1;
}

/* Length of the next step after one of length h with that error (Hairer and Wanner, IV.8). */
static double next_length(const smpc_plant *p, double h, double error, int accepted)
{
    double power = 1.0 / (SMPC_PLANT_STAGES + SMPC_PLANT_ORDER);
    double factor = SAFETY * pow(1.0 / fmax(error, 1e-12), power);

    factor = fmin(fmax(factor, SHRINK), p->failures > 0 ? 1.0 : GROW);
    /* A step cut short at the end of an interval does not shorten what comes after it. */
    return accepted && factor >= 1.0 ? fmax(h * factor, p->h) : h * factor;
}

/* Tries one step of length h; returns whether it was taken. */
static int trial(smpc_plant *p, double h)
{
    int solved = smpc_plant_solve_stages(p, h);
    double error = solved ? smpc_plant_error(p, h) : 0.0;
    int accepted = solved && error <= 1.0;

    p->h = solved ? next_length(p, h, error, accepted) : h / 4;
    if (!accepted) {
        p->failures++;
        return 0;
    }
    smpc_plant_accept(p, h);
    p->failures = 0;
    p->h_before = h;
    return 1;
}

int smpc_plant_step(smpc_plant *p, const double *u, double seconds)
{
    double t = 0.0;

    if (!p->holds || memcmp(u, p->u, sizeof p->u) != 0)
        if (hold(p, u) != 0) return -1;
    for (int k = 0; k < TRIALS && t < seconds; k++) {
        double left = seconds - t, h = p->h;
        int last = left <= h * (1 + 1e-6);

        if (last)
            h = left;
        else if (left < 2 * h)
            h = left / 2; /* no sliver is left at the end */
        if (trial(p, h))
            t = last ? seconds : t + h;
        else if (p->failures >= MOST_FAILURES || !(p->h > 1e-12 * seconds))
            return -1;
    }
    return t < seconds ? -1 : 0;
}
