/* Position, pitch and roll: two ways to face, the tool pointing out or in, two elbows: eight branches a pose, in blocks.
 * The roll is the roll joint's own angle. Limits are kept; ``found`` says which branches lie inside them. */
#include "arm.h"

static inline double into(double angle, double low, double high) {
    const double middle = 0.5 * (low + high);
    return middle + wrapped(angle - middle);
}

/* positions (count, 3), pitch (count), roll (count) -> q (count, 8, 5), found (count, 8) */
void pose_batch(const Arm *arm, const double *positions, const double *pitch, const double *roll, long count,
                double *q, unsigned char *found, double nan) {
    const double l2 = arm->length[0], l3 = arm->length[1], l4 = arm->length[2];
    const double *low = arm->low, *high = arm->high, *sign = arm->sign, *offset = arm->offset;
    double rho[BLOCK], z[BLOCK], azimuth[BLOCK], cp[BLOCK], sp[BLOCK], bend[BLOCK], beta[BLOCK], psi[BLOCK], ok[BLOCK];
    double angle[4][BLOCK];
    int good[BLOCK];
    for (long at = 0; at < count; at += BLOCK) {
        const int n = count - at < BLOCK ? (int)(count - at) : BLOCK;
        const double *p = positions + 3 * at;
        for (int i = 0; i < n; i++) {
            const double x = p[3 * i], y = p[3 * i + 1];
            rho[i] = sqrt(x * x + y * y), azimuth[i] = atan2(y, x), z[i] = p[3 * i + 2] - arm->shoulder_z;
        }
        for (int i = 0; i < n; i++) cp[i] = l4 * cos(pitch[at + i]); /* apart, or they become one scalar sincos */
        for (int i = 0; i < n; i++) sp[i] = l4 * sin(pitch[at + i]);
        for (int branch = 0; branch < 8; branch += 2) {
            const double face = branch < 4 ? 1.0 : -1.0, tool = branch & 2 ? -1.0 : 1.0;
            for (int i = 0; i < n; i++) {
                const double r = face * rho[i] - arm->shoulder_r - tool * cp[i], h = z[i] - sp[i], d2 = r * r + h * h;
                const double c = (d2 - l2 * l2 - l3 * l3) / (2.0 * l2 * l3);
                ok[i] = 1.0 + TOLERANCE - fabs(c), bend[i] = acos(clamped(c)), psi[i] = atan2(h, r);
                beta[i] = acos(clamped((d2 + l2 * l2 - l3 * l3) / (2.0 * l2 * sqrt(d2))));
                angle[0][i] = into(sign[0] * (azimuth[i] + (face < 0.0 ? 0.5 * TWO_PI : 0.0)), low[0], high[0]);
            }
            for (int elbow = 0; elbow < 2; elbow++) {
                const double way = elbow ? -1.0 : 1.0;
                for (int i = 0; i < n; i++) {
                    const double heading = tool > 0.0 ? pitch[at + i] : 0.5 * TWO_PI - pitch[at + i];
                    const double t2 = psi[i] + way * beta[i], t3 = -way * bend[i];
                    angle[1][i] = into(sign[1] * (t2 - offset[0]), low[1], high[1]);
                    angle[2][i] = into(sign[2] * (t3 - offset[1]), low[2], high[2]);
                    angle[3][i] = into(sign[3] * (heading - t2 - t3 - offset[2]), low[3], high[3]);
                    int inside = (ok[i] >= 0.0) & (roll[at + i] >= low[4] - TOLERANCE) & (roll[at + i] <= high[4] + TOLERANCE);
                    for (int k = 0; k < 4; k++)
                        inside &= (angle[k][i] >= low[k] - TOLERANCE) & (angle[k][i] <= high[k] + TOLERANCE);
                    good[i] = inside;
                }
                for (int i = 0; i < n; i++) {
                    double *row = q + 5 * (8 * (at + i) + branch + elbow);
                    found[8 * (at + i) + branch + elbow] = (unsigned char)good[i];
                    for (int k = 0; k < 4; k++) row[k] = good[i] ? angle[k][i] : nan;
                    row[4] = good[i] ? roll[at + i] : nan;
                }
            }
        }
    }
}
