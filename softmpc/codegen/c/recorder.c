/* The flight recorder, see recorder.h. */
#include "recorder.h"
#include "problem.h" /* SMPC_PROBLEM_HASH, SMPC_SCENE */
#include "recorder_bytes.h"
#include "scalar.h"

#include <string.h>

/* All that can make other bits: hash of the sources, compiler, processor, precision. */
#ifndef SMPC_BUILD
#ifndef __VERSION__
#define __VERSION__ "unknown compiler"
#endif
#if defined __x86_64__
#define MACHINE "x86_64"
#elif defined __aarch64__
#define MACHINE "aarch64"
#elif defined __arm__
#define MACHINE "arm"
#else
#define MACHINE "other machine"
#endif
#ifdef SMPC_FLOAT
#define PRECISION "float"
#else
#define PRECISION "double"
#endif
#define SMPC_BUILD "C " SMPC_SCENE_HASH ", " MACHINE ", " PRECISION ", " __VERSION__
#endif

enum { HEADER = 1, RESET, STEP, SNAPSHOT, LIMITS, SETTINGS };
enum { FORMAT = 1, BY_C = 0, MASK = (SMPC_N + 7) / 8 };
enum { INPUT_KEPT = 1, CLIPPED = 2 };                     /* flags of a step */
enum { HAS_PLAN = 1, HAS_ACTIVE = 2, HAS_INPUT = 4 };     /* of a snapshot */

static size_t length_of(const char *text)
{
    size_t count = strlen(text);
    return 1 + (count > 255 ? 255 : count);
}

void smpc_log_header(smpc_sink write, void *with)
{
    static const unsigned char magic[8] = {0x89, 'S', 'M', 'P', 'C', '\r', '\n', 0x1a};
    static const char *const texts[5] = {
        SMPC_PROBLEM_HASH, SMPC_VERSION, SMPC_BUILD, SMPC_REFERENCES, SMPC_SCENE};
    smpc_recorder once;
    size_t length = 28;
    memset(&once, 0, sizeof once);
    once.write = write;
    once.with = with;
    write(with, magic, sizeof magic);
    for (int i = 0; i < 5; i++) {
        length += length_of(texts[i]);
    }
    smpc_begin(&once, HEADER, length);
    smpc_put_whole(&once, FORMAT, 2);
    smpc_put_whole(&once, sizeof(smpc_real), 1);
    smpc_put_whole(&once, BY_C, 1);
    smpc_put_whole(&once, SMPC_N, 4);
    smpc_put_whole(&once, SMPC_NX, 4);
    smpc_put_whole(&once, SMPC_INPUTS, 4);
    smpc_put_whole(&once, SMPC_NR, 4);
    smpc_put_double(&once, (double)SMPC_STEP);
    for (int i = 0; i < 5; i++) {
        smpc_put_text(&once, texts[i]);
    }
    smpc_end(&once);
}

void smpc_recorder_init(smpc_recorder *r, smpc_sink write, void *with)
{
    memset(r, 0, sizeof *r);
    r->write = write;
    r->with = with;
    smpc_record_reset(r);
}

void smpc_record_reset(smpc_recorder *r)
{
    smpc_begin(r, RESET, 4);
    smpc_put_whole(r, r->number, 4);
    smpc_end(r);
    r->known = 0;
    r->which = 0;
    r->budget = 0;
    r->cap = 0;
}

/* Whether row i of the references is what the step before leads one to expect. */
static int expected(const smpc_recorder *r, const smpc_real *references, int i)
{
    int from = i + 1 < SMPC_N ? i + 1 : i;
    return r->known
        && !memcmp(references + i * SMPC_NR, r->references + from * SMPC_NR,
                   SMPC_NR * sizeof(smpc_real));
}

static size_t mask_of(const smpc_recorder *r, const smpc_real *references, unsigned char *mask)
{
    size_t rows = 0;
    memset(mask, 0, MASK);
    for (int i = 0; i < SMPC_N; i++) {
        if (!expected(r, references, i)) {
            mask[i / 8] = (unsigned char)(mask[i / 8] | 1u << i % 8);
            rows++;
        }
    }
    return rows;
}

static uint64_t at_most(unsigned value, unsigned most)
{
    return value < most ? value : most;
}

static void put_outcome(smpc_recorder *r, const smpc_outcome *outcome, int kept)
{
    smpc_put_whole(r, r->number, 4);
    smpc_put_whole(r, (uint64_t)outcome->status, 1);
    smpc_put_whole(r, (uint64_t)outcome->qp, 1);
    smpc_put_whole(r, (uint64_t)outcome->source, 1);
    smpc_put_whole(r, (uint64_t)((kept ? INPUT_KEPT : 0) | (outcome->clipped ? CLIPPED : 0)), 1);
    smpc_put_whole(r, at_most(outcome->iterations, 0xffffu), 2);
    smpc_put_whole(r, at_most(outcome->active, 0xffffu), 2);
    smpc_put_float(r, outcome->prepare_seconds);
    smpc_put_float(r, outcome->feedback_seconds);
    smpc_put_reals(r, &outcome->kkt, 1);
    smpc_put_reals(r, &outcome->violation, 1);
}

void smpc_record_step(
    smpc_recorder *r, const smpc_real *references, const smpc_real *u_before, const smpc_real *x,
    const smpc_real *u, const smpc_outcome *outcome)
{
    unsigned char mask[MASK];
    size_t rows = mask_of(r, references, mask);
    int kept = r->known && !memcmp(u_before, r->u, sizeof r->u);
    size_t reals = 2 + (kept ? 1u : 2u) * SMPC_INPUTS + SMPC_NX + rows * SMPC_NR;
    smpc_begin(r, STEP, 20 + reals * sizeof(smpc_real) + MASK);
    put_outcome(r, outcome, kept);
    if (!kept) {
        smpc_put_reals(r, u_before, SMPC_INPUTS);
    }
    smpc_put_reals(r, x, SMPC_NX);
    smpc_put_reals(r, u, SMPC_INPUTS);
    smpc_put(r, mask, MASK);
    for (int i = 0; i < SMPC_N; i++) {
        if (mask[i / 8] >> i % 8 & 1) {
            smpc_put_reals(r, references + i * SMPC_NR, SMPC_NR);
        }
    }
    smpc_end(r);
    memcpy(r->references, references, SMPC_N * SMPC_NR * sizeof(smpc_real));
    memcpy(r->u, u, sizeof r->u);
    r->known = 1;
    r->number++;
}

static void put_limits(smpc_recorder *r)
{
    size_t given = 0;
    for (int i = 0; i < 4; i++) {
        given += r->which >> i & 1u;
    }
    smpc_begin(r, LIMITS, 4 + given * SMPC_INPUTS * sizeof(smpc_real));
    smpc_put_whole(r, r->which, 4);
    for (int i = 0; i < 4; i++) {
        if (r->which >> i & 1) {
            smpc_put_reals(r, r->limits + i * SMPC_INPUTS, SMPC_INPUTS);
        }
    }
    smpc_end(r);
}

void smpc_record_limits(
    smpc_recorder *r, const smpc_real *low, const smpc_real *high, const smpc_real *fall,
    const smpc_real *rise)
{
    const smpc_real *const given[4] = {low, high, fall, rise};
    r->which = 0;
    for (int i = 0; i < 4; i++) {
        if (given[i]) {
            r->which = (unsigned char)(r->which | 1u << i);
            memcpy(r->limits + i * SMPC_INPUTS, given[i], SMPC_INPUTS * sizeof(smpc_real));
        }
    }
    put_limits(r);
}

static void put_settings(smpc_recorder *r)
{
    smpc_begin(r, SETTINGS, 12);
    smpc_put_double(r, r->budget);
    smpc_put_whole(r, r->cap, 4);
    smpc_end(r);
}

void smpc_record_settings(smpc_recorder *r, double budget, uint32_t cap)
{
    r->budget = budget;
    r->cap = cap;
    put_settings(r);
}

/* Signs of multipliers, those of nothing active being zero: what a warm start begins with. */
static void put_signs(smpc_recorder *r, const smpc_real *multipliers, uint32_t count)
{
    smpc_real most = 0;
    for (uint32_t i = 0; i < count; i++) {
        most = fabs(multipliers[i]) > most ? (smpc_real)fabs(multipliers[i]) : most;
    }
    for (uint32_t i = 0; i < count; i++) {
        const smpc_real least = (smpc_real)1e-9 * most, value = multipliers[i];
        smpc_put_whole(r, value > least ? 1 : value < -least ? 0xff : 0, 1);
    }
}

void smpc_record_snapshot(smpc_recorder *r, const smpc_snapshot *s)
{
    uint32_t plan = s->plan ? s->plan_count : 0;
    uint32_t active = s->multipliers ? s->multiplier_count : 0;
    size_t inputs = s->u ? SMPC_INPUTS : 0, states = s->plan ? SMPC_NX : 0;
    int flags = (s->plan ? HAS_PLAN : 0) | (active ? HAS_ACTIVE : 0) | (s->u ? HAS_INPUT : 0);
    smpc_begin(r, SNAPSHOT, 20 + (1 + inputs + plan + states) * sizeof(smpc_real) + active);
    smpc_put_whole(r, r->number, 4);
    smpc_put_whole(r, at_most(s->age, 0xffffu), 2);
    smpc_put_whole(r, at_most(s->failures, 0xffffu), 2);
    smpc_put_whole(r, (uint64_t)flags, 4);
    smpc_put_whole(r, plan, 4);
    smpc_put_whole(r, active, 4);
    smpc_put_reals(r, &s->violation, 1);
    smpc_put_reals(r, s->u, inputs);
    smpc_put_reals(r, s->plan, plan);
    smpc_put_reals(r, s->expected, states);
    put_signs(r, s->multipliers, active);
    smpc_end(r);
    r->known = 0; /* the next step is written in full, so that a reader can begin here */
    if (r->which) {
        put_limits(r);
    }
    if (r->budget > 0 || r->cap) {
        put_settings(r);
    }
}
