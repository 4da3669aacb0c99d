/* What a running controller is close to; see monitor.h. */
#include "monitor.h"

#include <string.h>

#include "linear.h"
#include "model_monitor.h"

#define TURN ((real)6.283185307179586)
#ifdef SMPC_FLOAT
#define ON_EDGE ((real)1e-6) /* of the radius: nearer is on the surface, as far as digits say */
#else
#define ON_EDGE ((real)1e-12)
#endif

enum { inputs = SMPC_INPUTS, pressures = SMPC_MONITOR_PRESSURES, drive = SMPC_MONITOR_DRIVE };

/* --- margin to the reachable set -------------------------------------------------------------- */

#if SMPC_REACH
enum { azimuths = SMPC_REACH_AZIMUTHS, nodes = SMPC_REACH_NODES };

/* A place in the frame of the table, and what the table says at its angles. */
typedef struct {
    real azimuth, polar, radius, beside;
    real low, high;    /* polar angles of the rims */
    real inner, outer; /* radii; those of the nearest rim beyond it */
} bearing;

static int is_finite(real value)
{
    return smpc_all_finite(&value, 1);
}

static real clipped(real value, real low, real high)
{
    return fmin(fmax(value, low), high);
}

static real between(real a, real b, real share)
{
    return (1 - share) * a + share * b;
}

static void locate(bearing *b, const real *place)
{
    real own[3] = {0, 0, 0};
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) own[j] += place[i] * smpc_reach_frame[3 * i + j];
    b->beside = SMPC_REACH_FLAT ? own[1] : 0;
    own[1] -= b->beside;
    const real across = hypot(own[0], own[1]);
    b->azimuth = atan2(own[1], own[0]);
    b->polar = atan2(across, own[2]);
    b->radius = hypot(across, own[2]);
}

/* The half-plane before an azimuth; the share of the way to the one after it. */
static int half_plane(real azimuth, real *share)
{
    int before = 0;
    *share = 0;
    if (SMPC_REACH_FLAT) return fabs(azimuth) > TURN / 4; /* one ahead, one behind */
    real on = fmod(azimuth - smpc_reach_azimuths[0], TURN);
    if (on < 0) on += TURN;
    while (before + 1 < azimuths && on >= smpc_reach_azimuths[before + 1] - smpc_reach_azimuths[0])
        before++;
    const real next = before + 1 < azimuths ? smpc_reach_azimuths[before + 1]
                                            : smpc_reach_azimuths[0] + TURN;
    const real start = smpc_reach_azimuths[before];
    *share = (on - (start - smpc_reach_azimuths[0])) / (next - start);
    return before;
}

/* Linear in azimuth, and in the polar angle between the rims. */
static void look_up(bearing *b)
{
    real share;
    const int before = half_plane(b->azimuth, &share), after = (before + 1) % azimuths;
    const real *rims[2] = {smpc_reach_rims + 2 * before, smpc_reach_rims + 2 * after};
    b->low = between(rims[0][0], rims[1][0], share);
    b->high = between(rims[0][1], rims[1][1], share);
    const real width = fmax(b->high - b->low, (real)1e-12);
    const real u = clipped((b->polar - b->low) / width, 0, 1);
    int j = 0;
    while (j + 2 < nodes && u >= smpc_reach_nodes[j + 1]) j++;
    const real t = (u - smpc_reach_nodes[j]) / (smpc_reach_nodes[j + 1] - smpc_reach_nodes[j]);
    const int one = before * nodes + j, two = after * nodes + j;
    b->outer = between(between(smpc_reach_outer[one], smpc_reach_outer[one + 1], t),
                       between(smpc_reach_outer[two], smpc_reach_outer[two + 1], t), share);
    b->inner = between(between(smpc_reach_inner[one], smpc_reach_inner[one + 1], t),
                       between(smpc_reach_inner[two], smpc_reach_inner[two + 1], t), share);
}

/* Distance from the nearest place of the set at the same azimuth. */
static real outside(const bearing *b)
{
    const real polar = clipped(b->polar, b->low, b->high);
    const real way = b->radius * cos(b->polar - polar);
    const real along = way - clipped(way, fmin(b->inner, b->outer), b->outer);
    const real off = hypot(along, b->radius * sin(b->polar - polar));
    return hypot(off, b->beside);
}

/* Distance from a rim that is `angle` away. */
static real to_rim(const bearing *b, real angle)
{
    return b->radius * sin(fmin(angle, TURN / 4));
}
#endif

int smpc_margin(const real *place, real *margin)
{
    *margin = 0;
#if SMPC_REACH
    bearing b;
    if (!smpc_all_finite(place, 3)) return 0;
    locate(&b, place);
    if (!is_finite(b.radius)) return 0;
    look_up(&b);
    const real off = outside(&b);
    if (!is_finite(off)) return 0;
    if (off >= ON_EDGE * b.radius && off > 0) {
        *margin = -off;
        return 1;
    }
    real left = fmin(b.outer - b.radius, b.radius - b.inner);
    if (SMPC_REACH_LOW_RIM) left = fmin(left, to_rim(&b, b.polar - b.low));
    if (SMPC_REACH_HIGH_RIM) left = fmin(left, to_rim(&b, b.high - b.polar));
    *margin = fmax(left, 0);
    return 1;
#else
    (void)place;
    return 0;
#endif
}

static void observe_tip(smpc_observed *o, const real *x)
{
#if SMPC_REACH
    real tip[3];
    smpc_tip_now(x, tip);
    if (smpc_margin(tip, &o->tip_margin)) o->known |= SMPC_KNOWS_TIP;
#else
    (void)o;
    (void)x;
#endif
}

static void observe_reference(smpc_observed *o, const smpc_controller *c)
{
#if SMPC_REACH && SMPC_TIP_REFERENCE >= 0
    const real *asked = (const real *)c->references + SMPC_TIP_REFERENCE;
    if (smpc_margin(asked, &o->reference_margin)) o->known |= SMPC_KNOWS_REFERENCE;
#else
    (void)o;
    (void)c;
#endif
}

/* --- drive ------------------------------------------------------------------------------------ */

static void observe_pressures(smpc_observed *o, const real *x, const real *u)
{
    const real low = SMPC_PRESSURE_MIN, high = SMPC_PRESSURE_MAX;
    real p[SMPC_MONITOR_PRESSURES] = {0}, least = high - low;
    smpc_add_product(smpc_monitor_C, pressures, drive, x + SMPC_NX - drive, p);
    smpc_add_product(smpc_monitor_D, pressures, inputs, u, p);
    if (!smpc_all_finite(p, pressures)) return;
    for (int i = 0; i < pressures; i++) least = fmin(least, fmin(p[i] - low, high - p[i]));
    o->pressure_room = least / (high - low);
    o->known |= SMPC_KNOWS_PRESSURE;
    if (!(SMPC_BACK_OFF > 0)) return;
    o->back_off = fmax(1 - o->pressure_room / SMPC_BACK_OFF, 0);
    o->known |= SMPC_KNOWS_BACK_OFF;
}

static void observe_flows(smpc_observed *o, const real *x)
{
#if SMPC_TUBES
    real found[SMPC_TUBES];
    smpc_reynolds(x + SMPC_NX - drive, found);
    if (!smpc_all_finite(found, SMPC_TUBES)) return;
    memcpy(o->reynolds, found, sizeof found);
    for (int i = 0; i < SMPC_TUBES; i++) o->largest_reynolds = fmax(o->largest_reynolds, found[i]);
    o->turbulent = o->largest_reynolds > SMPC_LAMINAR;
    o->known |= SMPC_KNOWS_REYNOLDS;
#else
    (void)o;
    (void)x;
#endif
}

/* --- since the beginning ---------------------------------------------------------------------- */

static void keep_smallest(int first, real value, real *kept)
{
    *kept = first ? value : fmin(*kept, value);
}

/* The worst of each: what is not known in `o` changes nothing. */
static void keep_worst(smpc_observed *w, const smpc_observed *o)
{
    const int first = o->known & ~w->known;
    if (o->known & SMPC_KNOWS_TIP)
        keep_smallest(first & SMPC_KNOWS_TIP, o->tip_margin, &w->tip_margin);
    if (o->known & SMPC_KNOWS_REFERENCE)
        keep_smallest(first & SMPC_KNOWS_REFERENCE, o->reference_margin, &w->reference_margin);
    if (o->known & SMPC_KNOWS_PRESSURE)
        keep_smallest(first & SMPC_KNOWS_PRESSURE, o->pressure_room, &w->pressure_room);
    w->back_off = fmax(w->back_off, o->back_off);
#if SMPC_TUBES
    w->largest_reynolds = fmax(w->largest_reynolds, o->largest_reynolds);
    for (int i = 0; i < SMPC_TUBES; i++) w->reynolds[i] = fmax(w->reynolds[i], o->reynolds[i]);
#endif
    w->turbulent |= o->turbulent;
    if (o->iterations > w->iterations) w->iterations = o->iterations;
    w->known |= o->known;
}

static void count(smpc_monitor *m, const smpc_report *r)
{
    m->steps++;
    if (r->status >= 0 && r->status <= SMPC_FAILED) m->statuses[r->status]++;
    m->since_solved = r->status == SMPC_SOLVED ? 0 : m->since_solved + 1;
    if (r->qp == SMPC_QP_NONE) return;
    m->programs++;
    m->iterations += (uint64_t)(r->iterations > 0 ? r->iterations : 0);
    m->mean_iterations = (real)((double)m->iterations / (double)m->programs);
}

unsigned long smpc_monitor_memory(void)
{
    return (unsigned long)sizeof(smpc_monitor);
}

void smpc_monitor_init(smpc_monitor *m)
{
    memset(m, 0, sizeof *m);
}

void smpc_monitor_update(smpc_monitor *m, const smpc_controller *c, const real *x, const real *u)
{
    smpc_observed o;
    memset(&o, 0, sizeof o);
    o.iterations = c->report.iterations;
    observe_reference(&o, c);
    if (smpc_all_finite(x, SMPC_NX)) {
        observe_tip(&o, x);
        observe_pressures(&o, x, u);
        observe_flows(&o, x);
    }
    count(m, &c->report);
    keep_worst(&m->worst, &o);
    m->last = o;
}
