/* What the estimator is told, and how it goes back to the time of each reading. */
#include "estimator_parts.h"

#include <string.h>

#include "linear.h"

enum { nx = SMPC_FILTER_X, all = SMPC_FILTERED };

/* ---------------------------------------------------------------- what it is told */

int smpc_estimator_reset(smpc_estimator *e, const smpc_real *x, const smpc_real *u, int32_t tick)
{
    if (!smpc_all_finite(x, nx) || !smpc_all_finite(u, SMPC_INPUTS)) return SMPC_GIVEN_NOT_FINITE;
    memset(e, 0, sizeof *e);
    for (int i = 0; i < nx; i++) e->now.s[i] = x[i] / smpc_filter_x_scale[i];
    for (int i = 0; i < all; i++) e->now.P[i * all + i] = smpc_filter_spread[i];
    for (int i = 0; i < SMPC_SENSORS; i++) {
        e->now.trust.good[i] = tick;
        e->seen.moved_at[i] = e->seen.away_since[i] = SMPC_NEVER;
    }
    e->now_tick = tick;
    e->now_known = 1;
    smpc_add_knot(e, tick);
    e->applied[0].tick = tick > INT32_MIN ? tick - 1 : tick;
    memcpy(e->applied[0].u, u, sizeof e->applied[0].u);
    e->applied_count = 1;
    e->contradicted = SMPC_NEVER;
    return SMPC_NO_TROUBLE;
}

int smpc_estimator_applied(smpc_estimator *e, const smpc_real *u, int32_t tick)
{
    if (!smpc_all_finite(u, SMPC_INPUTS)) return SMPC_GIVEN_NOT_FINITE;
    smpc_forget_after(e, tick);
    if (e->now_tick > tick) e->now_fresh = 0;
    int place = 0;
    while (place < e->applied_count && e->applied[place].tick < tick) place++;
    if (place == e->applied_count || e->applied[place].tick != tick) {
        if (e->applied_count == SMPC_APPLIED) { /* the first makes room */
            if (place == 0) return SMPC_NO_TROUBLE;
            memmove(e->applied, e->applied + 1, sizeof *e->applied * (SMPC_APPLIED - 1));
            e->applied_count--;
            place--;
        }
        memmove(e->applied + place + 1, e->applied + place,
                sizeof *e->applied * (size_t)(e->applied_count - place));
        e->applied_count++;
    }
    e->applied[place].tick = tick;
    memcpy(e->applied[place].u, u, sizeof e->applied[place].u);
    return SMPC_NO_TROUBLE;
}

static int is_known(const smpc_estimator *e, int sensor, int32_t stamp)
{
    for (int i = 0; i < e->sample_count; i++)
        if (e->samples[i].sensor == sensor && e->samples[i].stamp == stamp) return 1;
    return 0;
}

/* Why a reading is not taken; below zero where it is. */
static int refused(smpc_estimator *e, int32_t tick, const smpc_sample *sample)
{
    if (sample->stamp > (int64_t)tick + SMPC_STEP_TICKS) return SMPC_TOO_EARLY;
    const int reason = smpc_implausible(&e->seen, sample);
    if (reason >= 0) return reason;
    if (sample->stamp < smpc_knot_at(e, 0)->tick) return SMPC_TOO_LATE;
    if (is_known(e, sample->sensor, sample->stamp)) return SMPC_TWICE;
    return e->sample_count == SMPC_SAMPLES ? SMPC_NO_ROOM : -1;
}

void smpc_estimator_receive(
    smpc_estimator *e, int32_t tick, const smpc_sample *samples, int count)
{
    if (!e->count) return; /* it was never reset */
    for (int i = 0; i < count; i++) {
        const smpc_sample *sample = &samples[i];
        if (sample->sensor < 0 || sample->sensor >= SMPC_SENSORS) {
            e->reasons[0][SMPC_NO_SENSOR]++;
            continue;
        }
        const int reason = refused(e, tick, sample);
        if (reason >= 0) {
            e->reasons[sample->sensor][reason]++;
            continue;
        }
        e->samples[e->sample_count++] = *sample;
        smpc_forget_after(e, sample->stamp);
        if (smpc_last_knot(e)->tick == sample->stamp) {
            smpc_unjudge(smpc_last_knot(e));
            e->after_known = e->now_fresh = 0;
        }
    }
}

/* ---------------------------------------------------------------- what it knows */

/* The input that holds from this time on. */
static const real *input_at(const smpc_estimator *e, int64_t tick)
{
    int found = 0;
    while (found + 1 < e->applied_count && e->applied[found + 1].tick <= tick) found++;
    return e->applied[found].u;
}

/* The first time of a reading or a new input after `now`, until `tick`; `tick` without any. */
static int32_t next_stop(const smpc_estimator *e, int32_t now, int32_t tick, int *found)
{
    int32_t stop = tick;
    *found = 0;
    for (int i = 0; i < e->sample_count + e->applied_count; i++) {
        const int32_t t = i < e->sample_count ? e->samples[i].stamp
                                              : e->applied[i - e->sample_count].tick;
        if (t <= now || t > stop) continue;
        stop = t;
        *found = 1;
    }
    return stop;
}

/* A sensor's reading of a knot's time and what became of it. */
static void judge(smpc_estimator *e, smpc_knot *k, int which)
{
    const int i = e->look.sensor[which];
    const real far = e->look.far[which];
    smpc_trust *trust = &e->after.trust;
    const int counts = far <= (real)SMPC_ABSURD;
    k->nis[i] = e->look.nis[which];
    k->rejected[i] = !counts;
    if (counts) trust->good[i] = k->tick;
    if (!(far > 1)) trust->beyond[i] = 0;
    else if (trust->beyond[i] < INT32_MAX) trust->beyond[i]++;
    if (trust->beyond[i] >= SMPC_DOUBTED) k->contradicted = 1;
    if ((int64_t)k->tick - trust->good[i] < SMPC_LOST) return;
    for (int j = 0; j < all; j++) e->after.P[j * all + j] += smpc_filter_spread[j];
}

/* Let the readings of the last knot's time count, all at once. */
static int take_readings(smpc_estimator *e)
{
    smpc_knot *k = smpc_last_knot(e);
    smpc_look *look = &e->look;
    const real *u = input_at(e, (int64_t)k->tick - 1); /* what was applied until then */
    smpc_recall(k, &e->after);
    look->count = look->sensors = 0;
    for (int sensor = 0; sensor < SMPC_SENSORS; sensor++)
        for (int i = 0; i < e->sample_count; i++)
            if (e->samples[i].sensor == sensor && e->samples[i].stamp == k->tick)
                smpc_look_at(look, &e->after, &e->samples[i], u);
    if (look->sensors) {
        const int trouble = smpc_weigh_readings(look, e->after.P);
        if (trouble) return trouble;
        smpc_update(&e->after, look);
        for (int i = 0; i < look->sensors; i++) judge(e, k, i);
    }
    e->after_known = 1;
    return SMPC_NO_TROUBLE;
}

/* e->now: the last knot's belief after its readings, moved on to a time. */
static int move_to(smpc_estimator *e, int32_t tick)
{
    const int32_t since = smpc_last_knot(e)->tick;
    if (!e->after_known) {
        e->now_fresh = 0;
        const int trouble = take_readings(e);
        if (trouble) return trouble;
    }
    if (e->now_fresh && e->now_tick == tick) return SMPC_NO_TROUBLE;
    e->now = e->after;
    e->now_tick = tick;
    e->now_fresh = 1;
    return smpc_advance(&e->now, &e->move, input_at(e, since), (int64_t)tick - since);
}

static int work_out(smpc_estimator *e, int32_t tick)
{
    if (!e->count) return SMPC_GIVEN_NOT_FINITE; /* it was never reset */
    if (tick < smpc_knot_at(e, 0)->tick) return SMPC_TIME_FORGOTTEN;
    smpc_forget_after(e, tick);
    if ((int64_t)tick - smpc_last_knot(e)->tick > SMPC_LONGEST_GAP) return SMPC_GAP_TOO_LONG;
    for (int more = 1; more;) {
        const int32_t stop = next_stop(e, smpc_last_knot(e)->tick, tick, &more);
        const int trouble = move_to(e, stop);
        if (trouble) return trouble;
        if (more) smpc_add_knot(e, stop);
    }
    smpc_prune(e, tick);
    return smpc_all_finite(e->now.s, all) && smpc_all_finite(e->now.P, all * all)
               ? SMPC_NO_TROUBLE
               : SMPC_ESTIMATE_INFINITE;
}

int smpc_estimator_estimate(smpc_estimator *e, int32_t tick)
{
    const int trouble = work_out(e, tick);
    e->now_known = !trouble;
    if (trouble) e->now_fresh = 0;
    return trouble;
}
