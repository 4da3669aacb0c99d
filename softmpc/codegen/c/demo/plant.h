/* The arm that the demonstration controls: a simulation of the scene's plant, always in double.
 *
 * Its steps are those of Radau IIA with three stages (order 5, L-stable). Their length follows from
 * the tolerance SMPC_PLANT_TOLERANCE, the error of a step in metres at the tip. All numbers are SI.
 *
 *     static smpc_plant plant;
 *     smpc_plant_init(&plant, x0);
 *     smpc_plant_step(&plant, u, 0.025);
 */
#ifndef SMPC_PLANT_H
#define SMPC_PLANT_H

#include "plant_data.h" /* sizes and constant arrays of this scene */

#ifdef __cplusplus
extern "C" {
#endif

typedef struct smpc_plant {
    double x[SMPC_PLANT_NX]; /* strains, their rates, states of the drive */

    /* The input that is held, since when (s), and the drive's states then. */
    double u[SMPC_PLANT_INPUTS], held, z[SMPC_PLANT_NZ + 1];
    int holds; /* whether there is one */

    /* The last step and the next one. */
    double y[SMPC_PLANT_SIZE], stages[SMPC_PLANT_STAGES * SMPC_PLANT_SIZE];
    double h, h_before; /* lengths (s) */
    int failures;       /* steps refused in a row */

    /* What a step works with. */
    double w[SMPC_PLANT_STAGES * SMPC_PLANT_NW];
    double by_y[SMPC_PLANT_SIZE * SMPC_PLANT_SIZE];
    double by_first[SMPC_PLANT_SIZE * SMPC_PLANT_SIZE];
    double by_second[SMPC_PLANT_SIZE * SMPC_PLANT_SIZE];
    double newton[SMPC_PLANT_UNKNOWNS * SMPC_PLANT_UNKNOWNS];
    double found[SMPC_PLANT_UNKNOWNS], change[SMPC_PLANT_UNKNOWNS];
    int pivot[SMPC_PLANT_UNKNOWNS];
} smpc_plant;

/* Starts at the state x0 (SMPC_PLANT_NX). */
void smpc_plant_init(smpc_plant *p, const double *x0);

/* Moves on for some seconds under the input u (SMPC_PLANT_INPUTS), which is held. Returns 0, or -1
 * where u is not finite or no step can be found; the state is the last one reached then. */
int smpc_plant_step(smpc_plant *p, const double *u, double seconds);

/* The state x (SMPC_PLANT_NX): strains, rates, drive. */
const double *smpc_plant_state(const smpc_plant *p);

/* Places of the ends of the sections, base to tip, 3 numbers each (m). */
void smpc_plant_tips(const smpc_plant *p, double *tips);

/* The state of the controller's model (SMPC_PLANT_SEEN numbers) for the plant's, the input u
 * acting. */
void smpc_plant_seen(const smpc_plant *p, const double *u, double *x);

#ifdef __cplusplus
}
#endif
#endif
