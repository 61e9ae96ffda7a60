/* The least sum of absolute angles over the continuum, for uzuner's limits and links: each pitch joint at its lower
 * limit, its upper limit or zero, two elbows each, on both ways to face: 36 candidates a point, in blocks. */
#include "arm.h"

typedef struct {
    double yaw[BLOCK], r[BLOCK], h[BLOCK], d2[BLOCK], d[BLOCK], heading[BLOCK];
    double least[BLOCK], q[4][BLOCK];
} Work;

static inline void consider(const Arm *arm, Work *w, int i, double ok, double t2, double t3, double t4) {
    const double *low = arm->low, *high = arm->high;
    t2 = wrapped(t2), t3 = wrapped(t3), t4 = wrapped(t4);
    const int inside = (ok > 0.0) & (t2 >= low[1] - TOLERANCE) & (t2 <= high[1] + TOLERANCE)
                     & (t3 >= low[2] - TOLERANCE) & (t3 <= high[2] + TOLERANCE)
                     & (t4 >= low[3] - TOLERANCE) & (t4 <= high[3] + TOLERANCE);
    const double sum = inside ? fabs(w->yaw[i]) + fabs(t2) + fabs(t3) + fabs(t4) : 1e9;
    const int better = sum < w->least[i];
    w->least[i] = better ? sum : w->least[i];
    w->q[0][i] = better ? w->yaw[i] : w->q[0][i];
    w->q[1][i] = better ? t2 : w->q[1][i];
    w->q[2][i] = better ? t3 : w->q[2][i];
    w->q[3][i] = better ? t4 : w->q[3][i];
}

static void first_pitch_at(const Arm *arm, Work *w, int n, double v) {
    const double l2 = arm->length[0], l3 = arm->length[1], l4 = arm->length[2];
    const double cv = l2 * cos(v), sv = l2 * sin(v);
    for (int i = 0; i < n; i++) {
        const double X = w->r[i] - cv, Z = w->h[i] - sv, d2 = X * X + Z * Z;
        const double c = (d2 - l3 * l3 - l4 * l4) / (2.0 * l3 * l4);
        const double ok = 1.0 + 1e-12 - fabs(c), bend = acos(clamped(c));
        const double beta = acos(clamped((d2 + l3 * l3 - l4 * l4) / (2.0 * l3 * sqrt(d2))));
        const double psi = atan2(Z, X) - v;
        consider(arm, w, i, ok, v, psi - beta, bend);
        consider(arm, w, i, ok, v, psi + beta, -bend);
    }
}

/* One of the two outer joints at v: two links of the three become one of length ``rigid``, turned by ``turn``. */
static void outer_pitch_at(const Arm *arm, Work *w, int n, double v, int third) {
    const double l2 = arm->length[0], l3 = arm->length[1], l4 = arm->length[2];
    const double a = third ? l2 : l3, b = third ? l3 : l4;
    const double rigid = hypot(a + b * cos(v), b * sin(v)), turn = atan2(b * sin(v), a + b * cos(v));
    const double inner = third ? rigid : l2, outer = third ? l4 : rigid;
    for (int i = 0; i < n; i++) {
        const double c = (w->d2[i] - inner * inner - outer * outer) / (2.0 * inner * outer);
        const double ok = 1.0 + 1e-12 - fabs(c), bend = acos(clamped(c));
        const double beta = acos(clamped((w->d2[i] + inner * inner - outer * outer) / (2.0 * inner * w->d[i])));
        const double t2 = w->heading[i];
        if (third) {
            consider(arm, w, i, ok, t2 - beta - turn, v, bend + turn - v);
            consider(arm, w, i, ok, t2 + beta - turn, v, turn - v - bend);
        } else {
            consider(arm, w, i, ok, t2 - beta, bend - turn, v);
            consider(arm, w, i, ok, t2 + beta, -bend - turn, v);
        }
    }
}

/* positions (count, 3) -> q (count, 5), NaN where none; the roll joint at zero */
void least_rotation_batch(const Arm *arm, const double *positions, long count, double *q, double nan) {
    Work w;
    for (long at = 0; at < count; at += BLOCK) {
        const int n = count - at < BLOCK ? (int)(count - at) : BLOCK;
        const double *p = positions + 3 * at;
        for (int i = 0; i < n; i++) w.least[i] = 1e6;
        for (int front = 1; front >= -1; front -= 2) {
            for (int i = 0; i < n; i++) {
                const double x = p[3 * i], y = p[3 * i + 1], inside = x * x + y * y - arm->lateral * arm->lateral;
                const double r = front * sqrt(fmax(inside, 0.0)), h = p[3 * i + 2] - arm->shoulder_z;
                const double yaw = wrapped(atan2(y, x) - atan2(arm->lateral, r));
                const int ok = (inside >= 0.0) & (yaw >= arm->low[0] - TOLERANCE) & (yaw <= arm->high[0] + TOLERANCE);
                w.yaw[i] = ok ? yaw : 1e7; /* a sum that is never the least */
                w.r[i] = r, w.h[i] = h, w.d2[i] = r * r + h * h, w.d[i] = sqrt(w.d2[i]), w.heading[i] = atan2(h, r);
            }
            for (int k = 0; k < 3; k++) first_pitch_at(arm, &w, n, k == 0 ? 0.0 : k == 1 ? arm->low[1] : arm->high[1]);
            for (int joint = 2; joint <= 3; joint++)
                for (int k = 0; k < 3; k++)
                    outer_pitch_at(arm, &w, n, k == 0 ? 0.0 : k == 1 ? arm->low[joint] : arm->high[joint], joint == 2);
        }
        for (int i = 0; i < n; i++) {
            for (int k = 0; k < 4; k++) q[5 * (at + i) + k] = w.least[i] < 1e5 ? w.q[k][i] : nan;
            q[5 * (at + i) + 4] = w.least[i] < 1e5 ? 0.0 : nan;
        }
    }
}
