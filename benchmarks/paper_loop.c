/* A yaw joint, three parallel pitch joints and a roll joint, by their planar geometry: metres, radians.
 * The same words as benchmarks/planar_arm.py; the layout is that of benchmarks/paper_loop.py. */

#include <math.h>

#define TWO_PI 6.283185307179586476925287
#define TOLERANCE 1e-9

typedef struct {
    double lateral, shoulder_r, shoulder_z;
    double length[3];
    double sign[4];   /* yaw and pitch joints */
    double offset[3]; /* pitch joints */
    double low[5], high[5];
} Arm;

/* The paper's own loop: every value of the first pitch joint in its limits, two ways to face, two elbows.
 * Scalar and without -ffast-math, as a careful programmer writes it down from the paper. */
static double into(double angle, double low, double high) {
    const double middle = 0.5 * (low + high);
    return middle + remainder(angle - middle, TWO_PI);
}

/* Solutions as rows of four joint angles; returns how many. ``q`` must hold 4 * grid rows. */
long paper_sweep(const Arm *arm, const double *position, double step, double *q) {
    const double *low = arm->low, *high = arm->high;
    const double l2 = arm->length[0], l3 = arm->length[1], l4 = arm->length[2], d = arm->lateral;
    const double x = position[0], y = position[1], z = position[2] - arm->shoulder_z;
    const double inside = x * x + y * y - d * d;
    const long first = (long)ceil(low[1] / step - 1e-6), last = (long)floor(high[1] / step + 1e-6);
    long found = 0;
    if (inside < 0.0) return 0;
    for (int front = 1; front >= -1; front -= 2) {
        const double r = front * sqrt(inside);
        const double q1 = into(atan2(y, x) - atan2(d, r), low[0], high[0]);
        if (q1 < low[0] - TOLERANCE || q1 > high[0] + TOLERANCE) continue;
        for (long i = first; i <= last; i++) {
            const double q2 = i * step;
            const double X = r - l2 * cos(q2), Z = z - l2 * sin(q2);
            const double c4 = (X * X + Z * Z - l3 * l3 - l4 * l4) / (2.0 * l3 * l4);
            if (fabs(c4) > 1.0) continue;
            for (int elbow = 1; elbow >= -1; elbow -= 2) {
                const double s4 = elbow * sqrt(1.0 - c4 * c4);
                const double q4 = atan2(s4, c4);
                const double q3 = into(atan2(Z, X) - atan2(l4 * s4, l3 + l4 * c4) - q2, low[2], high[2]);
                if (q3 < low[2] - TOLERANCE || q3 > high[2] + TOLERANCE) continue;
                if (q4 < low[3] - TOLERANCE || q4 > high[3] + TOLERANCE) continue;
                double *row = q + 4 * found++;
                row[0] = q1, row[1] = q2, row[2] = q3, row[3] = q4;
            }
        }
    }
    return found;
}

/* The least sum of absolute angles of ``count`` rows. */
double least_sum(const double *q, long count) {
    double least = INFINITY;
    for (long i = 0; i < count; i++)
        least = fmin(least, fabs(q[4 * i]) + fabs(q[4 * i + 1]) + fabs(q[4 * i + 2]) + fabs(q[4 * i + 3]));
    return least;
}
