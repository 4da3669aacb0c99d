/* The times that the estimator can go back to: a ring of knots. */
#include "estimator_parts.h"

#include <string.h>

enum { all = SMPC_FILTERED };

smpc_knot *smpc_knot_at(smpc_estimator *e, int i)
{
    return &e->knots[(e->first + i) % SMPC_KNOTS];
}

smpc_knot *smpc_last_knot(smpc_estimator *e) { return smpc_knot_at(e, e->count - 1); }

void smpc_unjudge(smpc_knot *k)
{
    for (int i = 0; i < SMPC_SENSORS; i++) {
        k->nis[i] = -1;
        k->rejected[i] = 0;
    }
    k->contradicted = 0;
}

static void keep(smpc_knot *k, const smpc_belief *b)
{
    real *to = k->P;
    memcpy(k->s, b->s, sizeof k->s);
    k->stages = b->stages;
    k->trust = b->trust;
    for (int i = 0; i < all; i++, to += all - i + 1)
        memcpy(to, b->P + i * all + i, sizeof(real) * (size_t)(all - i));
}

void smpc_recall(const smpc_knot *k, smpc_belief *b)
{
    const real *from = k->P;
    memcpy(b->s, k->s, sizeof k->s);
    b->stages = k->stages;
    b->trust = k->trust;
    for (int i = 0; i < all; i++)
        for (int j = i; j < all; j++) b->P[i * all + j] = b->P[j * all + i] = *from++;
}

/* Forget the first knot, but for what it said of readings. */
static void settle_first(smpc_estimator *e)
{
    const smpc_knot *k = smpc_knot_at(e, 0);
    if (k->contradicted) e->contradicted = k->tick;
    for (int i = 0; i < SMPC_SENSORS; i++) e->reasons[i][SMPC_TOO_FAR] += k->rejected[i];
    e->first = (e->first + 1) % SMPC_KNOTS;
    e->count--;
}

static void settle_before(smpc_estimator *e, int32_t tick)
{
    while (e->count > 1 && smpc_knot_at(e, 1)->tick <= (int64_t)tick - SMPC_MEMORY)
        settle_first(e);
}

/* Forget what no reading can come before any more. */
void smpc_prune(smpc_estimator *e, int32_t tick)
{
    settle_before(e, tick);
    const int32_t first = smpc_knot_at(e, 0)->tick;
    for (int i = e->sample_count - 1; i >= 0; i--)
        if (e->samples[i].stamp < first) e->samples[i] = e->samples[--e->sample_count];
    int past = 0;
    while (past + 1 < e->applied_count && e->applied[past + 1].tick < first) past++;
    e->applied_count -= past;
    memmove(e->applied, e->applied + past, sizeof *e->applied * (size_t)e->applied_count);
}

/* Drop what was worked out for later times. */
void smpc_forget_after(smpc_estimator *e, int32_t tick)
{
    while (e->count > 1 && smpc_last_knot(e)->tick > tick) {
        e->count--;
        e->after_known = e->now_fresh = 0;
    }
}

void smpc_add_knot(smpc_estimator *e, int32_t tick)
{
    settle_before(e, tick);
    if (e->count == SMPC_KNOTS) settle_first(e);
    e->count++;
    keep(smpc_last_knot(e), &e->now);
    smpc_last_knot(e)->tick = tick;
    smpc_unjudge(smpc_last_knot(e));
    e->after_known = e->now_fresh = 0;
}
