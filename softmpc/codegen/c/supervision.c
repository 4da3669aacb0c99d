/* The state machine of supervision, alone. */
#include "supervision.h"

#include <string.h>

void smpc_supervisor_reset(smpc_supervisor *s, int32_t tick)
{
    memset(s, 0, sizeof *s);
    s->entered = tick;
}

static int64_t since(int32_t tick, int32_t then) { return (int64_t)tick - then; }

static int go(smpc_supervisor *s, int32_t tick, int state, const smpc_condition *why, int too_long)
{
    smpc_transition *to = &s->log[s->changes++ % SMPC_LOG];
    to->tick = tick;
    to->before = s->state;
    to->after = state;
    to->cause = why ? why->cause : SMPC_ALL_WELL;
    to->detail = why ? why->detail : 0;
    to->too_long = too_long;
    s->state = state;
    s->entered = tick;
    s->is_good = 0;
    return state;
}

/* The first of those that allow the least; NULL without any. */
static const smpc_condition *worst_of(const smpc_condition *conditions, int count)
{
    const smpc_condition *worst = NULL;
    for (int i = 0; i < count; i++)
        if (!worst || conditions[i].state > worst->state) worst = &conditions[i];
    return worst;
}

/* Whether it may leave for a better state: a safe stop not for fall-back, which led there. */
static int may_leave(const smpc_supervisor *s, int allowed)
{
    if (allowed >= s->state) return 0;
    return s->state != SMPC_SAFE_STOP || (SMPC_RESUMES && allowed < SMPC_FALL_BACK);
}

int smpc_supervisor_update(
    smpc_supervisor *s, int32_t tick, const smpc_condition *conditions, int count)
{
    const smpc_condition *worst = worst_of(conditions, count);
    const int allowed = worst ? worst->state : SMPC_NORMAL;
    const int stays_long = since(tick, s->entered) >= SMPC_STOP_AFTER;
    if (s->state == SMPC_FALL_BACK && allowed >= SMPC_FALL_BACK && stays_long)
        return go(s, tick, SMPC_SAFE_STOP, worst, 1);
    if (allowed > s->state) return go(s, tick, allowed, worst, 0);
    if (!may_leave(s, allowed)) {
        s->is_good = 0;
        return s->state;
    }
    if (!s->is_good) s->good_since = tick;
    s->is_good = 1;
    if (since(tick, s->good_since) < SMPC_RECOVER_AFTER) return s->state;
    return go(s, tick, allowed, worst, 0);
}

uint32_t smpc_supervisor_changes(const smpc_supervisor *s) { return s->changes; }

const smpc_transition *smpc_supervisor_change(const smpc_supervisor *s, uint32_t i)
{
    return i < s->changes && s->changes - i <= SMPC_LOG ? &s->log[i % SMPC_LOG] : NULL;
}

const char *smpc_state_name(int state)
{
    static const char *const names[] = {"normal", "degraded", "fall back", "safe stop"};
    return state >= SMPC_NORMAL && state <= SMPC_SAFE_STOP ? names[state] : "unknown";
}

const char *smpc_cause_name(int cause)
{
    static const char *const names[] = {
        "all well",
        "the estimator failed",
        "no readings of the tips",
        "no readings of a sensor",
        "the tip's place is not known well enough",
        "readings contradict the estimate",
        "too many steps in a row failed",
        "a step failed",
    };
    return cause >= SMPC_ALL_WELL && cause <= SMPC_STEP_FAILED ? names[cause] : "unknown";
}
