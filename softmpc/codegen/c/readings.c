/* Readings: what can be said of one without a model, what was expected of it, how much it counts.
 *
 * A jump tells a wrong reading from a wrong model: the arm moves, however wrong the estimate is,
 * and a camera that was hit is there at once. What follows a jump is left out until readings jump
 * again, or for some time. One that is absurdly far from what is expected is left out. One that is
 * only too far counts as if it were at the edge of what is likely: its gain is as much smaller. */
#include "estimator_parts.h"

#include <string.h>

#include "model_sensors.h"
#include "linear.h"

enum { all = SMPC_FILTERED, n = SMPC_STRAINS };
enum { IMPLAUSIBLE_NOT = -1 };

static int start_of(int sensor) { return smpc_filter_read_start[sensor]; }

static int size_of(int sensor)
{
    return smpc_filter_read_start[sensor + 1] - smpc_filter_read_start[sensor];
}

/* ---------------------------------------------------------------- plausible */

/* See whether a sensor's readings have jumped away, or back. */
static void follow(smpc_seen *seen, const smpc_sample *sample)
{
    const int i = sample->sensor, size = size_of(i);
    real *moved = seen->moved + start_of(i), largest = 0;
    const int32_t before = seen->moved_at[i], away = seen->away_since[i];
    if (before != SMPC_NEVER && sample->stamp <= before) return;
    for (int k = 0; k < size; k++) {
        const real change = (real)fabs(sample->value[k] - moved[k]);
        if (change > largest) largest = change;
        moved[k] = sample->value[k];
    }
    seen->moved_at[i] = sample->stamp;
    if (before != SMPC_NEVER) {
        const real ticks = (real)((int64_t)sample->stamp - before);
        if (largest > smpc_filter_fastest[i] * ticks + smpc_filter_margin[i]) {
            seen->away_since[i] = away == SMPC_NEVER ? sample->stamp : SMPC_NEVER;
            return;
        }
    }
    if (away != SMPC_NEVER && (int64_t)sample->stamp - away >= SMPC_AWAY)
        seen->away_since[i] = SMPC_NEVER;
}

/* Why a reading cannot be used; below zero where it can. */
int smpc_implausible(smpc_seen *seen, const smpc_sample *sample)
{
    const int i = sample->sensor, size = size_of(i);
    const size_t bytes = sizeof(real) * (size_t)size;
    real *last = seen->last + start_of(i), square = 0;
    for (int k = 0; k < size; k++) square += sample->value[k] * sample->value[k];
    if (!(square <= SMPC_HUGE)) return SMPC_NOT_FINITE;
    const int same = seen->equal[i] && !memcmp(last, sample->value, bytes);
    if (!same) seen->equal[i] = 1;
    else if (seen->equal[i] < INT32_MAX) seen->equal[i]++;
    memcpy(last, sample->value, bytes);
    if (smpc_filter_noisy[i] && seen->equal[i] >= SMPC_FROZEN_AFTER) return SMPC_FROZEN;
    if (seen->equal[i] == 1) follow(seen, sample);
    return seen->away_since[i] == SMPC_NEVER ? IMPLAUSIBLE_NOT : SMPC_AFTER_JUMP;
}

/* ---------------------------------------------------------------- expected */

static void set_row(smpc_look *look, int row, int column, real value)
{
    look->H[row * all + column] = value;
    look->column[row][look->filled[row]++] = (unsigned short)column;
}

/* A value that is linear in the state; what is expected of it. */
static real linear_row(smpc_look *look, int row, int source, const real *at, const real *u)
{
    const smpc_sparse *H = &smpc_filter_read_by_s, *D = &smpc_filter_read_by_u;
    real y = 0;
    for (int p = H->start[source]; p < H->start[source + 1]; p++) {
        set_row(look, row, H->column[p], H->value[p]);
        y += H->value[p] * at[H->column[p]];
    }
    for (int p = D->start[source]; p < D->start[source + 1]; p++)
        y += D->value[p] * u[D->column[p]];
    return y;
}

/* A coordinate of a tip; what linearising leaves counts as noise. */
static real tip_row(smpc_look *look, int row, int tip, const real *P, real bent)
{
    for (int j = 0; j < n; j++) set_row(look, row, j, look->tips_slope[tip * n + j]);
    real spread = 0;
    for (int j = 0; bent > 0 && j < n; j++)
        for (int k = 0; k < n; k++)
            spread += look->H[row * all + j] * P[j * all + k] * look->H[row * all + k];
    look->R[row] += bent * spread;
    return look->tips[tip];
}

/* A reading beside what was expected of it, after those that are in the look already. */
void smpc_look_at(smpc_look *look, const smpc_belief *b, const smpc_sample *sample, const real *u)
{
    const int i = sample->sensor, first = start_of(i);
    const real bent = smpc_linearising_leaves(b->P);
    look->sensor[look->sensors] = i;
    look->start[look->sensors++] = look->count;
    if (smpc_filter_read_tip[first] >= 0) smpc_tips(b->s, look->tips, look->tips_slope);
    for (int k = 0; k < size_of(i); k++) {
        const int row = look->count++, tip = smpc_filter_read_tip[first + k];
        memset(look->H + row * all, 0, sizeof(real) * all);
        look->filled[row] = 0;
        look->R[row] = smpc_filter_variances[first + k];
        const real y = tip >= 0 ? tip_row(look, row, tip, b->P, bent)
                                : linear_row(look, row, first + k, b->s, u);
        look->e[row] = sample->value[k] - y;
    }
    look->start[look->sensors] = look->count;
}

/* ---------------------------------------------------------------- weighed */

/* Normalised square of one sensor's values, whatever the others are. */
static real own_square(smpc_look *look, int which)
{
    const int first = look->start[which], size = look->start[which + 1] - first;
    real x[SMPC_LARGEST_READING], square = 0;
    for (int i = 0; i < size; i++) {
        x[i] = look->e[first + i];
        for (int j = 0; j < size; j++)
            look->factor[i * size + j] = look->S[(first + i) * look->count + first + j];
    }
    if (smpc_cholesky(look->factor, size)) return SMPC_HUGE;
    smpc_forward(look->factor, size, x);
    for (int i = 0; i < size; i++) square += x[i] * x[i];
    return square;
}

/* Move the rows of one sensor to a place further up. */
static void move_up(smpc_look *look, int from, int to)
{
    const int size = look->start[from + 1] - look->start[from], target = look->start[to];
    for (int k = 0; k < size; k++) {
        const int source = look->start[from] + k, row = target + k;
        look->e[row] = look->e[source];
        look->R[row] = look->R[source];
        look->filled[row] = look->filled[source];
        memmove(look->column[row], look->column[source], sizeof look->column[row]);
        memmove(look->H + row * all, look->H + source * all, sizeof(real) * all);
    }
    look->start[to + 1] = target + size;
}

/* What is to be made of readings before covariance P: far (of all sensors in the order in which
 * they were looked at), and gains of those that are left. Returns a trouble. */
int smpc_weigh_readings(smpc_look *look, const real *P)
{
    int trouble = smpc_expect(look, P), kept = 0, end = 0, of[SMPC_SENSORS];
    if (trouble) return trouble;
    for (int i = 0; i < look->sensors; i++) {
        look->nis[i] = own_square(look, i);
        look->far[i] = (real)sqrt(look->nis[i] / smpc_filter_gates[look->sensor[i]]);
    }
    for (int i = 0; i < look->sensors; i++) {
        if (!(look->far[i] <= (real)SMPC_ABSURD)) continue;
        if (kept != i) move_up(look, i, kept);
        of[kept++] = i;
        end = look->start[kept];
    }
    const int same = end == look->count;
    look->count = end;
    if (!kept) return SMPC_NO_TROUBLE;
    if (!same && (trouble = smpc_expect(look, P))) return trouble;
    for (int i = 0; i < kept; i++)
        for (int row = look->start[i]; look->far[of[i]] > 1 && row < look->start[i + 1]; row++)
            for (int j = 0; j < all; j++) look->gain[row * all + j] /= look->far[of[i]];
    return SMPC_NO_TROUBLE;
}
