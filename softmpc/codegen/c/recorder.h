/* The flight recorder: what a controller was given and what it did, as bytes.
 *
 * docs/replay.md of softmpc says what each byte means, and `softmpc replay LOG` runs a log through
 * the controllers again. Bytes go to a function that the caller gives, in pieces, or into a ring
 * that keeps the latest records:
 *
 *     static smpc_recorder recorder;
 *     smpc_log_header(write, with);                   once, before all records
 *     smpc_recorder_init(&recorder, write, with);     where the controller begins or forgets all
 *     each step, after it:
 *         smpc_log_step(&recorder, &controller, u_before, x, u);      see log.h
 *     now and then:
 *         smpc_log_snapshot(&recorder, &controller);
 *
 * No memory is allocated, and the function that is given is the only thing that is called.
 */
#ifndef SMPC_RECORDER_H
#define SMPC_RECORDER_H

#include <stddef.h>
#include <stdint.h>

#include "sizes.h" /* SMPC_N, SMPC_NX, SMPC_INPUTS, SMPC_NR, SMPC_STEP, ... */
#include "real.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Takes bytes; a record comes in several pieces, its first 8 bytes always in one. */
typedef void (*smpc_sink)(void *with, const unsigned char *bytes, size_t count);

/* How a step went: an smpc_status, an smpc_qp, an smpc_source. */
typedef struct {
    int status, qp, source;
    int clipped;                 /* whether the last guard changed the input */
    unsigned iterations, active; /* rows of the quadratic program that are at their limits */
    smpc_real kkt, violation;
    float prepare_seconds, feedback_seconds; /* NaN without a clock */
} smpc_outcome;

/* What a controller takes from one step into the next, so that a replay can begin there. Of the
 * multipliers a log keeps the signs. */
typedef struct {
    unsigned age, failures;       /* of the plan in steps, and steps that failed in a row */
    const smpc_real *u;           /* the input given last (SMPC_INPUTS), or NULL */
    const smpc_real *plan;        /* scaled: inputs, unknowns of stages, states; or NULL */
    const smpc_real *expected;    /* the state that the plan expects now (SMPC_NX), scaled */
    const smpc_real *multipliers; /* of the last quadratic program, or NULL */
    uint32_t plan_count, multiplier_count;
    smpc_real violation;          /* of the plan */
} smpc_snapshot;

typedef struct {
    smpc_sink write;
    void *with;
    uint32_t number; /* of the next step */
    uint32_t crc;    /* of the record that is being written */
    int known;       /* whether the next two are those of the record before */
    smpc_real references[SMPC_N * SMPC_NR + 1];
    smpc_real u[SMPC_INPUTS];
    unsigned char which;                /* of the limits that the user has set */
    smpc_real limits[4 * SMPC_INPUTS];  /* low, high, fall, rise */
    double budget;
    uint32_t cap;
} smpc_recorder;

/* The first bytes of a log. */
void smpc_log_header(smpc_sink write, void *with);

/* Begins; the controller has just been made by smpc_init. */
void smpc_recorder_init(smpc_recorder *r, smpc_sink write, void *with);

/* The controller has forgotten everything, limits and clock too, by another smpc_init. */
void smpc_record_reset(smpc_recorder *r);

/* A step: references (SMPC_N x SMPC_NR), the input until then, the state, the input that came out. */
void smpc_record_step(
    smpc_recorder *r, const smpc_real *references, const smpc_real *u_before, const smpc_real *x,
    const smpc_real *u, const smpc_outcome *outcome);

/* Limits as given to smpc_set_limits, NULL among them. */
void smpc_record_limits(
    smpc_recorder *r, const smpc_real *low, const smpc_real *high, const smpc_real *fall,
    const smpc_real *rise);

/* The time that a step may take (s), and iterations of the quadratic program; 0: as built. */
void smpc_record_settings(smpc_recorder *r, double budget, uint32_t cap);

/* What the controller remembers after the last step. */
void smpc_record_snapshot(smpc_recorder *r, const smpc_snapshot *s);

/* A ring of the latest whole records. */
typedef struct {
    unsigned char *bytes;
    size_t size, first, used; /* of the oldest record, and of all whole ones */
    size_t done, whole;       /* of the record that is coming in */
    int dropped;              /* it is larger than the ring */
    uint32_t lost;            /* records */
} smpc_ring;

void smpc_ring_init(smpc_ring *ring, unsigned char *bytes, size_t size);

/* An smpc_sink; `with` is the ring. */
void smpc_ring_write(void *ring, const unsigned char *bytes, size_t count);

/* All records from the oldest on; write the header before them. */
void smpc_ring_dump(const smpc_ring *ring, smpc_sink write, void *with);

#ifdef __cplusplus
}
#endif
#endif
