/* A yaw joint, three parallel pitch joints and a roll joint, by their planar geometry: metres, radians.
 * The same words as benchmarks/planar_arm.py; the layout is that of benchmarks/compiled.py. */
#ifndef ARM_H
#define ARM_H

#include <math.h>

#define TWO_PI 6.283185307179586476925287
#define BLOCK 256 /* points worked on together: their temporaries stay in the first-level cache */
#define TOLERANCE 1e-9

typedef struct {
    double lateral, shoulder_r, shoulder_z;
    double length[3];
    double sign[4];   /* yaw and pitch joints */
    double offset[3]; /* pitch joints */
    double low[5], high[5];
} Arm;

static inline double wrapped(double angle) { return angle - TWO_PI * rint(angle * (1.0 / TWO_PI)); }

static inline double clamped(double cosine) { return fmin(1.0, fmax(-1.0, cosine)); }

#endif
