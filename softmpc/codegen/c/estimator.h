/* An extended Kalman filter for strains, rates, drive and a disturbance, from readings that may be
 * late. Each counts for the time at which it was taken: the filter goes back to what it believed
 * just before, for up to SMPC_MEMORY ticks, and comes forward again through all it has heard since.
 *
 * Times are whole ticks of a millisecond. All of its memory is one smpc_estimator. Functions that
 * return int give 0, or one of smpc_trouble.
 */
#ifndef SMPC_ESTIMATOR_H
#define SMPC_ESTIMATOR_H

#include <stdint.h>

#include "estimator_sizes.h"
#include "real.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SMPC_SIZE(n) ((n) > 0 ? (n) : 1) /* an array needs an element */
#define SMPC_NEVER INT32_MIN
#define SMPC_LONGEST_GAP 1000 /* ticks between readings or inputs that it moves over */

/* Why there is no estimate; smpc_estimator_reset mends all of them. */
enum smpc_trouble {
    SMPC_NO_TROUBLE = 0,
    SMPC_STEP_UNSOLVED = 1,     /* the equations of a step of the arm have no solution */
    SMPC_NOT_POSITIVE = 2,      /* the covariance of readings is not positive definite */
    SMPC_ESTIMATE_INFINITE = 3, /* or NaN */
    SMPC_TIME_FORGOTTEN = 4,    /* the time is before all that is remembered */
    SMPC_GAP_TOO_LONG = 5,      /* above SMPC_LONGEST_GAP */
    SMPC_GIVEN_NOT_FINITE = 6   /* a state or an input that was given */
};

/* Why a reading does not count. */
enum smpc_reason {
    SMPC_NOT_FINITE = 0,
    SMPC_FROZEN = 1,     /* equal readings in a row, of a sensor with noise */
    SMPC_AFTER_JUMP = 2, /* no arm moves that fast */
    SMPC_TOO_LATE = 3,   /* taken before all that is remembered */
    SMPC_TWICE = 4,      /* of the same time */
    SMPC_TOO_FAR = 5,    /* from what was expected */
    SMPC_TOO_EARLY = 6,  /* of a time that is to come, farther than a step of the controller */
    SMPC_NO_ROOM = 7,    /* more readings than SMPC_SAMPLES are remembered */
    SMPC_NO_SENSOR = 8,  /* counted for the first sensor */
    SMPC_REASONS = 9
};

/* A reading of a sensor: values in SI, when they were taken. */
typedef struct {
    int32_t sensor;
    int32_t stamp;
    smpc_real value[SMPC_LARGEST_READING];
} smpc_sample;

/* An input and since when it acts. */
typedef struct {
    int32_t tick;
    smpc_real u[SMPC_INPUTS];
} smpc_input;

/* A step of the arm that was solved; the next one begins on its slope. */
typedef struct {
    int known;
    smpc_real causes[SMPC_CAUSES]; /* q, dq, pressures at the stages, force */
    smpc_real a[SMPC_UNKNOWNS];
    smpc_real slope[SMPC_UNKNOWNS * SMPC_CAUSES];
} smpc_stages;

/* Of each sensor: its last reading that counted, and how many in a row were too far. */
typedef struct {
    int32_t good[SMPC_SENSORS];
    int32_t beyond[SMPC_SENSORS];
} smpc_trust;

typedef struct {
    smpc_real s[SMPC_FILTERED]; /* state / scale, then the disturbance */
    smpc_real P[SMPC_FILTERED * SMPC_FILTERED];
    smpc_stages stages;
    smpc_trust trust;
} smpc_belief;

/* A time at which readings were taken or an input changed: what was believed before them. */
typedef struct {
    int32_t tick;
    smpc_real s[SMPC_FILTERED];
    smpc_real P[SMPC_FILTERED * (SMPC_FILTERED + 1) / 2]; /* its upper half, row after row */
    smpc_stages stages;
    smpc_trust trust;
    smpc_real nis[SMPC_SENSORS]; /* normalised squares of its innovations; below 0 where it has none */
    unsigned char rejected[SMPC_SENSORS];
    unsigned char contradicted; /* its readings were too far, as those before */
} smpc_knot;

/* What plausibility remembers of each sensor. */
typedef struct {
    smpc_real last[SMPC_READ], moved[SMPC_READ];
    int32_t moved_at[SMPC_SENSORS], away_since[SMPC_SENSORS]; /* SMPC_NEVER where it is not so */
    int32_t equal[SMPC_SENSORS];                              /* readings in a row; 0 before any */
} smpc_seen;

/* Readings of one time beside what was expected of them. */
typedef struct {
    int count;   /* of values */
    int sensors; /* of sensors that they are of */
    int sensor[SMPC_SENSORS], start[SMPC_SENSORS + 1];
    smpc_real e[SMPC_READ], R[SMPC_READ];
    smpc_real H[SMPC_READ * SMPC_FILTERED];
    int filled[SMPC_READ]; /* columns of a row of H that are not zero */
    unsigned short column[SMPC_READ][SMPC_FILTERED];
    smpc_real HP[SMPC_READ * SMPC_FILTERED];
    smpc_real gain[SMPC_READ * SMPC_FILTERED]; /* transposed */
    smpc_real S[SMPC_READ * SMPC_READ], factor[SMPC_READ * SMPC_READ];
    smpc_real nis[SMPC_SENSORS], far[SMPC_SENSORS]; /* far: 1 is the edge of what is likely */
    smpc_real tips[SMPC_TIPS], tips_slope[SMPC_TIPS * SMPC_STRAINS];
} smpc_look;

/* All of a step of some length that does not depend on the state. */
typedef struct {
    smpc_real length; /* s, of what follows */
    smpc_real of_rate[SMPC_FILTER_STAGES], kept; /* strains and rates at the stages, from rates before */
    smpc_real to_strain[SMPC_FILTER_STAGES][SMPC_FILTER_STAGES]; /* and from unknowns */
    smpc_real to_rate[SMPC_FILTER_STAGES][SMPC_FILTER_STAGES];
    smpc_real drive[SMPC_FILTER_STAGES][SMPC_SIZE(SMPC_DRIVE_NUMBERS)]; /* exponentials of blocks */
    smpc_real drive_rows[SMPC_SIZE(SMPC_DRIVE_ENTRIES)];
    smpc_real pressure_rows[SMPC_FILTER_STAGES][SMPC_SIZE(SMPC_PRESSURE_ENTRIES)];
    smpc_real block[3][SMPC_DRIVE_LARGEST * SMPC_DRIVE_LARGEST];
} smpc_lasting;

/* What a step works with. */
typedef struct {
    smpc_lasting of;
    smpc_real causes[SMPC_CAUSES], a[SMPC_UNKNOWNS];
    smpc_real z[SMPC_SIZE(SMPC_DRIVE)]; /* at the end */
    smpc_real by_a[SMPC_UNKNOWNS * SMPC_UNKNOWNS];
    smpc_real right[SMPC_UNKNOWNS * (1 + SMPC_CAUSES)]; /* values, then slopes in the causes */
    int pivot[SMPC_UNKNOWNS];
    smpc_real ends[2 * SMPC_STRAINS * SMPC_CAUSES];
    smpc_real A[2 * SMPC_STRAINS * SMPC_FILTERED]; /* slope of strains and rates */
    smpc_real A_turned[SMPC_FILTERED * 2 * SMPC_STRAINS];
    smpc_real AP[SMPC_FILTERED * SMPC_FILTERED];
} smpc_move;

typedef struct {
    smpc_knot knots[SMPC_KNOTS]; /* a ring */
    int first, count;
    smpc_belief after; /* of the last knot, with its readings */
    int after_known;
    smpc_belief now; /* the last estimate */
    int32_t now_tick;
    int now_known; /* whether there is one */
    int now_fresh; /* whether it follows from `after` */
    smpc_belief ahead;
    smpc_input applied[SMPC_APPLIED]; /* by their ticks */
    int applied_count;
    smpc_sample samples[SMPC_SAMPLES];
    int sample_count;
    smpc_seen seen;
    int32_t reasons[SMPC_SENSORS][SMPC_REASONS];
    int32_t contradicted; /* of knots that are forgotten */
    smpc_look look;
    smpc_move move;
} smpc_estimator;

/* Begin at a state (SMPC_NX) and an input (SMPC_INPUTS), SI, with no disturbance known. */
int smpc_estimator_reset(
    smpc_estimator *e, const smpc_real *x, const smpc_real *u, int32_t tick);

/* The input (SMPC_INPUTS, SI) from this time on. */
int smpc_estimator_applied(smpc_estimator *e, const smpc_real *u, int32_t tick);

/* Readings that have arrived until this tick. */
void smpc_estimator_receive(
    smpc_estimator *e, int32_t tick, const smpc_sample *samples, int count);

/* Work out e->now: what is known of this time, with all readings taken until then. */
int smpc_estimator_estimate(smpc_estimator *e, int32_t tick);

/* Work out e->ahead: the last estimate at a later time, under inputs from their ticks on. */
int smpc_estimator_ahead(
    smpc_estimator *e, int32_t tick, const smpc_input *inputs, int count);

/* State (SMPC_NX, SI) and disturbance (SMPC_DISTURBANCES, scaled) of e->now or e->ahead. */
void smpc_belief_state(const smpc_belief *of, smpc_real *x, smpc_real *d);

/* Standard deviation of the tip's place (m). */
smpc_real smpc_tip_spread(smpc_estimator *e, const smpc_belief *of);

/* The last tick at which readings were too far, some in a row; SMPC_NEVER where there is none. */
int32_t smpc_estimator_contradicted(const smpc_estimator *e);

/* Readings of a sensor that did not count for an smpc_reason. */
int32_t smpc_estimator_left_out(const smpc_estimator *e, int sensor, int reason);

/* For those who cannot read the struct: bytes of an estimator and of a sample; state, disturbance
 * and covariance (scaled, SMPC_FILTERED^2) of e->now or e->ahead; the tick of a sensor's last good
 * reading; of knot i (the oldest is 0) its tick, and for each sensor the normalised square of its
 * innovation, below 0 where it has none, and whether it was rejected: 0 where there is no such
 * knot. */
unsigned long smpc_estimator_memory(void);
unsigned long smpc_sample_memory(void);
void smpc_estimator_seen(
    const smpc_estimator *e, int ahead, smpc_real *x, smpc_real *d, smpc_real *P);
int32_t smpc_estimator_good(const smpc_estimator *e, int sensor);
int smpc_estimator_judged(
    const smpc_estimator *e, int i, int32_t *tick, smpc_real *nis, int *rejected);

/* "not finite", ...: never NULL. */
const char *smpc_reason_name(int reason);
const char *smpc_trouble_name(int trouble);

#ifdef __cplusplus
}
#endif
#endif
