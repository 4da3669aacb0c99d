/* What the estimator knows, beside its estimate. */
#include "estimator_parts.h"

#include <string.h>

#include "model_sensors.h"

enum { nx = SMPC_FILTER_X, all = SMPC_FILTERED, n = SMPC_STRAINS };

/* ---------------------------------------------------------------- ahead */

/* The latest of these inputs that acts at a time, where none in `u` is later. */
static void hold(const smpc_input *inputs, int count, int32_t now, const smpc_input **u)
{
    for (int i = 0; i < count; i++)
        if (inputs[i].tick <= now && (!*u || inputs[i].tick >= (*u)->tick)) *u = &inputs[i];
}

/* The first tick of inputs after `now` and before `stop`. */
static int32_t first_of(const smpc_input *inputs, int count, int32_t now, int32_t stop)
{
    for (int i = 0; i < count; i++)
        if (inputs[i].tick > now && inputs[i].tick < stop) stop = inputs[i].tick;
    return stop;
}

int smpc_estimator_ahead(
    smpc_estimator *e, int32_t tick, const smpc_input *inputs, int count)
{
    int32_t now = e->now_tick;
    if (!e->now_known) return SMPC_ESTIMATE_INFINITE;
    e->ahead = e->now;
    while (now < tick) {
        const smpc_input *u = NULL;
        hold(e->applied, e->applied_count, now, &u);
        hold(inputs, count, now, &u);
        if (!u) u = e->applied;
        int32_t stop = first_of(e->applied, e->applied_count, now, tick);
        stop = first_of(inputs, count, now, stop);
        const int trouble = smpc_advance(&e->ahead, &e->move, u->u, (int64_t)stop - now);
        if (trouble) return trouble;
        now = stop;
    }
    return SMPC_NO_TROUBLE;
}

/* ---------------------------------------------------------------- in numbers */

void smpc_belief_state(const smpc_belief *of, smpc_real *x, smpc_real *d)
{
    for (int i = 0; i < nx; i++) x[i] = of->s[i] * smpc_filter_x_scale[i];
    memcpy(d, of->s + nx, sizeof(real) * (all - nx));
}

smpc_real smpc_tip_spread(smpc_estimator *e, const smpc_belief *of)
{
    real sum = 0;
    smpc_tips(of->s, e->look.tips, e->look.tips_slope);
    for (int tip = SMPC_TIPS - 3; tip < SMPC_TIPS; tip++) {
        const real *slope = e->look.tips_slope + tip * n;
        for (int i = 0; i < n; i++)
            for (int j = 0; j < n; j++) sum += slope[i] * of->P[i * all + j] * slope[j];
    }
    return sum > 0 ? (real)sqrt(sum) : 0;
}

int32_t smpc_estimator_contradicted(const smpc_estimator *e)
{
    int32_t found = e->contradicted;
    for (int i = 0; i < e->count; i++) {
        const smpc_knot *k = &e->knots[(e->first + i) % SMPC_KNOTS];
        if (k->contradicted) found = k->tick;
    }
    return found;
}

int32_t smpc_estimator_left_out(const smpc_estimator *e, int sensor, int reason)
{
    int32_t found = e->reasons[sensor][reason];
    for (int i = 0; reason == SMPC_TOO_FAR && i < e->count; i++)
        found += e->knots[(e->first + i) % SMPC_KNOTS].rejected[sensor];
    return found;
}

unsigned long smpc_estimator_memory(void)
{
    return (unsigned long)sizeof(smpc_estimator);
}

unsigned long smpc_sample_memory(void)
{
    return (unsigned long)sizeof(smpc_sample);
}

void smpc_estimator_seen(
    const smpc_estimator *e, int ahead, smpc_real *x, smpc_real *d, smpc_real *P)
{
    const smpc_belief *of = ahead ? &e->ahead : &e->now;
    smpc_belief_state(of, x, d);
    memcpy(P, of->P, sizeof of->P);
}

int32_t smpc_estimator_good(const smpc_estimator *e, int sensor)
{
    return e->now.trust.good[sensor];
}

int smpc_estimator_judged(
    const smpc_estimator *e, int i, int32_t *tick, smpc_real *nis, int *rejected)
{
    if (i < 0 || i >= e->count) return 0;
    const smpc_knot *k = &e->knots[(e->first + i) % SMPC_KNOTS];
    *tick = k->tick;
    memcpy(nis, k->nis, sizeof k->nis);
    for (int sensor = 0; sensor < SMPC_SENSORS; sensor++) rejected[sensor] = k->rejected[sensor];
    return 1;
}

/* ---------------------------------------------------------------- in words */

const char *smpc_reason_name(int reason)
{
    static const char *const names[SMPC_REASONS] = {
        "not finite", "frozen", "after a jump", "too late", "twice", "too far", "too early",
        "no room", "no such sensor",
    };
    return reason >= 0 && reason < SMPC_REASONS ? names[reason] : "unknown";
}

const char *smpc_trouble_name(int trouble)
{
    static const char *const names[] = {
        "none",
        "the stages of a step have no solution",
        "the covariance of an innovation is not positive definite",
        "the estimate is not finite",
        "the time is forgotten",
        "too long without readings and inputs",
        "what was given is not finite",
    };
    return trouble >= 0 && trouble <= SMPC_GIVEN_NOT_FINITE ? names[trouble] : "unknown";
}
