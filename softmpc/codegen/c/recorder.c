/* The flight recorder, see recorder.h. Numbers are written byte by byte, the lowest first, so that
 * logs of all machines are the same. */
#include "recorder.h"

#include <string.h>

#ifndef SMPC_SCENE
#define SMPC_SCENE ""
#endif
#ifndef SMPC_BUILD /* all that can make other bits of the same source */
#ifdef __VERSION__
#define SMPC_BUILD "C " __VERSION__
#else
#define SMPC_BUILD "C"
#endif
#endif

enum { HEADER = 1, RESET, STEP, SNAPSHOT, LIMITS, SETTINGS };
enum { FORMAT = 1, BY_C = 0, FRAME = 8, CRC = 4, MASK = (SMPC_N + 7) / 8 };
enum { INPUT_KEPT = 1, CLIPPED = 2 };                     /* flags of a step */
enum { HAS_PLAN = 1, HAS_ACTIVE = 2, HAS_INPUT = 4 };     /* of a snapshot */

/* ------------------------------------------------------------------ bytes */

/* CRC-32 as of zlib, four bits at a time: a small table is enough for a record a step. */
static uint32_t crc_of(uint32_t crc, const unsigned char *bytes, size_t count)
{
    static const uint32_t table[16] = {
        0x00000000u, 0x1db71064u, 0x3b6e20c8u, 0x26d930acu, 0x76dc4190u, 0x6b6b51f4u,
        0x4db26158u, 0x5005713cu, 0xedb88320u, 0xf00f9344u, 0xd6d6a3e8u, 0xcb61b38cu,
        0x9b64c2b0u, 0x86d3d2d4u, 0xa00ae278u, 0xbdbdf21cu,
    };
    for (size_t i = 0; i < count; i++) {
        crc ^= bytes[i];
        crc = (crc >> 4) ^ table[crc & 15u];
        crc = (crc >> 4) ^ table[crc & 15u];
    }
    return crc;
}

static void put(smpc_recorder *r, const unsigned char *bytes, size_t count)
{
    r->crc = crc_of(r->crc, bytes, count);
    r->write(r->with, bytes, count);
}

static void lowest_first(unsigned char *bytes, uint64_t value, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        bytes[i] = (unsigned char)(value >> (8 * i) & 0xffu);
    }
}

static void put_whole(smpc_recorder *r, uint64_t value, size_t count)
{
    unsigned char bytes[8];
    lowest_first(bytes, value, count);
    put(r, bytes, count);
}

static void put_double(smpc_recorder *r, double value)
{
    uint64_t bits;
    memcpy(&bits, &value, sizeof bits);
    put_whole(r, bits, 8);
}

static void put_float(smpc_recorder *r, float value)
{
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    put_whole(r, bits, 4);
}

static void put_reals(smpc_recorder *r, const smpc_real *values, size_t count)
{
    for (size_t i = 0; i < count; i++) {
#ifdef SMPC_FLOAT
        put_float(r, values[i]);
#else
        put_double(r, values[i]);
#endif
    }
}

static void put_text(smpc_recorder *r, const char *text)
{
    size_t count = strlen(text);
    count = count > 255 ? 255 : count;
    put_whole(r, count, 1);
    put(r, (const unsigned char *)text, count);
}

static size_t length_of(const char *text)
{
    size_t count = strlen(text);
    return 1 + (count > 255 ? 255 : count);
}

/* ------------------------------------------------------------------ records */

static void begin(smpc_recorder *r, int kind, size_t length)
{
    unsigned char frame[FRAME] = {'F', 'R', 0, 0, 0, 0, 0, 0};
    frame[2] = (unsigned char)kind;
    lowest_first(frame + 4, length, 4);
    r->crc = 0xffffffffu;
    put(r, frame, FRAME);
}

static void end(smpc_recorder *r)
{
    put_whole(r, r->crc ^ 0xffffffffu, CRC);
}

void smpc_log_header(smpc_sink write, void *with)
{
    static const unsigned char magic[8] = {0x89, 'S', 'M', 'P', 'C', '\r', '\n', 0x1a};
    static const char *const texts[5] = {
        SMPC_SCENE_HASH, SMPC_VERSION, SMPC_BUILD, SMPC_REFERENCES, SMPC_SCENE};
    smpc_recorder once;
    size_t length = 28;
    memset(&once, 0, sizeof once);
    once.write = write;
    once.with = with;
    write(with, magic, sizeof magic);
    for (int i = 0; i < 5; i++) {
        length += length_of(texts[i]);
    }
    begin(&once, HEADER, length);
    put_whole(&once, FORMAT, 2);
    put_whole(&once, sizeof(smpc_real), 1);
    put_whole(&once, BY_C, 1);
    put_whole(&once, SMPC_N, 4);
    put_whole(&once, SMPC_NX, 4);
    put_whole(&once, SMPC_INPUTS, 4);
    put_whole(&once, SMPC_NR, 4);
    put_double(&once, (double)SMPC_STEP);
    for (int i = 0; i < 5; i++) {
        put_text(&once, texts[i]);
    }
    end(&once);
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
    begin(r, RESET, 4);
    put_whole(r, r->number, 4);
    end(r);
    r->known = 0;
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
    put_whole(r, r->number, 4);
    put_whole(r, (uint64_t)outcome->status, 1);
    put_whole(r, (uint64_t)outcome->qp, 1);
    put_whole(r, (uint64_t)outcome->source, 1);
    put_whole(r, (uint64_t)((kept ? INPUT_KEPT : 0) | (outcome->clipped ? CLIPPED : 0)), 1);
    put_whole(r, at_most(outcome->iterations, 0xffffu), 2);
    put_whole(r, at_most(outcome->active, 0xffffu), 2);
    put_float(r, outcome->prepare_seconds);
    put_float(r, outcome->feedback_seconds);
    put_reals(r, &outcome->kkt, 1);
    put_reals(r, &outcome->violation, 1);
}

void smpc_record_step(
    smpc_recorder *r, const smpc_real *references, const smpc_real *u_before, const smpc_real *x,
    const smpc_real *u, const smpc_outcome *outcome)
{
    unsigned char mask[MASK];
    size_t rows = mask_of(r, references, mask);
    int kept = r->known && !memcmp(u_before, r->u, sizeof r->u);
    size_t reals = 2 + (kept ? 1u : 2u) * SMPC_INPUTS + SMPC_NX + rows * SMPC_NR;
    begin(r, STEP, 20 + reals * sizeof(smpc_real) + MASK);
    put_outcome(r, outcome, kept);
    if (!kept) {
        put_reals(r, u_before, SMPC_INPUTS);
    }
    put_reals(r, x, SMPC_NX);
    put_reals(r, u, SMPC_INPUTS);
    put(r, mask, MASK);
    for (int i = 0; i < SMPC_N; i++) {
        if (mask[i / 8] >> i % 8 & 1) {
            put_reals(r, references + i * SMPC_NR, SMPC_NR);
        }
    }
    end(r);
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
    begin(r, LIMITS, 4 + given * SMPC_INPUTS * sizeof(smpc_real));
    put_whole(r, r->which, 4);
    for (int i = 0; i < 4; i++) {
        if (r->which >> i & 1) {
            put_reals(r, r->limits + i * SMPC_INPUTS, SMPC_INPUTS);
        }
    }
    end(r);
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
    begin(r, SETTINGS, 12);
    put_double(r, r->budget);
    put_whole(r, r->cap, 4);
    end(r);
}

void smpc_record_settings(smpc_recorder *r, double budget, uint32_t cap)
{
    r->budget = budget;
    r->cap = cap;
    put_settings(r);
}

void smpc_record_snapshot(smpc_recorder *r, const smpc_snapshot *s)
{
    uint32_t plan = s->plan ? s->plan_count : 0, active = s->active ? s->active_count : 0;
    size_t inputs = s->u ? SMPC_INPUTS : 0;
    int flags = (s->plan ? HAS_PLAN : 0) | (s->active ? HAS_ACTIVE : 0) | (s->u ? HAS_INPUT : 0);
    begin(r, SNAPSHOT, 20 + (1 + inputs + plan) * sizeof(smpc_real) + active);
    put_whole(r, r->number, 4);
    put_whole(r, at_most(s->age, 0xffffu), 2);
    put_whole(r, at_most(s->failures, 0xffffu), 2);
    put_whole(r, (uint64_t)flags, 4);
    put_whole(r, plan, 4);
    put_whole(r, active, 4);
    put_reals(r, &s->violation, 1);
    put_reals(r, s->u, inputs);
    put_reals(r, s->plan, plan);
    for (uint32_t i = 0; i < active; i++) {
        put_whole(r, (unsigned char)s->active[i], 1);
    }
    end(r);
    r->known = 0; /* the next step is written in full, so that a reader can begin here */
    if (r->which) {
        put_limits(r);
    }
    if (r->budget > 0 || r->cap) {
        put_settings(r);
    }
}
