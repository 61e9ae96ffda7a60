/* uzuner's sweep with what is feasible found first: the ends of the feasible stretches have closed forms (a joint at a
 * limit, the outer links stretched), so that only solutions are ever computed. The limit that armctl is held against. */
#include <stdlib.h>

#include "arm.h"

static int ascending(const void *a, const void *b) {
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* Where joint ``third`` (else the last one) stands at v, as values of the first pitch joint; adds to ``ends``. */
static int ends_at(const Arm *arm, double r, double h, double v, int third, int elbow, double *ends, int count) {
    const double l2 = arm->length[0], l3 = arm->length[1], l4 = arm->length[2];
    const double a = third ? l2 : l3, b = third ? l3 : l4;
    const double rigid = hypot(a + b * cos(v), b * sin(v)), turn = atan2(b * sin(v), a + b * cos(v));
    const double inner = third ? rigid : l2, outer = third ? l4 : rigid, d2 = r * r + h * h;
    const double c = (d2 - inner * inner - outer * outer) / (2.0 * inner * outer);
    if (fabs(c) > 1.0) return count;
    const double bend = acos(c), beta = atan2(outer * sin(bend), inner + outer * cos(bend));
    for (int way = 1; way >= -1; way -= 2) {
        const double t2 = wrapped(atan2(h, r) - way * beta - (third ? turn : 0.0));
        const double t4 = third ? wrapped(way * bend + turn - v) : v;
        if (t2 > arm->low[1] && t2 < arm->high[1] && t4 * elbow >= 0.0) ends[count++] = t2;
    }
    return count;
}

static int feasible(const Arm *arm, double r, double h, double t2, int elbow) {
    const double l2 = arm->length[0], l3 = arm->length[1], l4 = arm->length[2];
    const double X = r - l2 * cos(t2), Z = h - l2 * sin(t2), c = (X * X + Z * Z - l3 * l3 - l4 * l4) / (2.0 * l3 * l4);
    if (fabs(c) > 1.0) return 0;
    const double t4 = elbow * acos(c), t3 = wrapped(atan2(Z, X) - atan2(l4 * sin(t4), l3 + l4 * c) - t2);
    return t3 >= arm->low[2] && t3 <= arm->high[2] && t4 >= arm->low[3] && t4 <= arm->high[3];
}

static void fill(const Arm *arm, double r, double h, int elbow, const double *grid, const double *c2, const double *s2,
                 long from, long to, double *restrict q2, double *restrict q3, double *restrict q4) {
    const double l2 = arm->length[0], l3 = arm->length[1], l4 = arm->length[2], way = elbow;
    const double middle = 0.5 * (arm->low[2] + arm->high[2]);
    for (long i = from; i < to; i++) {
        const double X = r - l2 * c2[i], Z = h - l2 * s2[i], d2 = X * X + Z * Z;
        const double bend = acos(clamped((d2 - l3 * l3 - l4 * l4) * (0.5 / (l3 * l4))));
        const double beta = acos(clamped((d2 + l3 * l3 - l4 * l4) * (0.5 / l3) / sqrt(d2)));
        q2[i - from] = grid[i];
        q3[i - from] = middle + wrapped(atan2(Z, X) - way * beta - grid[i] - middle);
        q4[i - from] = way * bend;
    }
}

/* ``grid`` (size) are the values of the first pitch joint, c2 and s2 their cosines and sines.
 * Writes five arrays of ``capacity`` one after the other; returns how many solutions there are. */
long interval_sweep(const Arm *arm, const double *position, const double *grid, const double *c2, const double *s2,
                    long size, double step, double *q, long capacity) {
    const double x = position[0], y = position[1], h = position[2] - arm->shoulder_z;
    const double inside = x * x + y * y - arm->lateral * arm->lateral;
    long found = 0;
    if (inside < 0.0) return 0;
    for (int front = 1; front >= -1; front -= 2) {
        const double r = front * sqrt(inside), yaw = wrapped(atan2(y, x) - atan2(arm->lateral, r));
        if (yaw < arm->low[0] - TOLERANCE || yaw > arm->high[0] + TOLERANCE) continue;
        for (int elbow = 1; elbow >= -1; elbow -= 2) {
            double ends[16] = {arm->low[1], arm->high[1]};
            int count = 2;
            for (int k = 0; k < 2; k++) count = ends_at(arm, r, h, k ? arm->high[2] : arm->low[2], 1, elbow, ends, count);
            for (int k = 0; k < 3; k++)
                count = ends_at(arm, r, h, k == 0 ? 0.0 : k == 1 ? arm->low[3] : arm->high[3], 0, elbow, ends, count);
            qsort(ends, (size_t)count, sizeof *ends, ascending);
            for (int k = 0; k + 1 < count; k++) {
                if (ends[k + 1] - ends[k] < 1e-12 || !feasible(arm, r, h, 0.5 * (ends[k] + ends[k + 1]), elbow)) continue;
                long from = (long)ceil((ends[k] - grid[0]) / step - 1e-7), to = (long)floor((ends[k + 1] - grid[0]) / step + 1e-7) + 1;
                from = from < 0 ? 0 : from, to = to > size ? size : to;
                if (to <= from) continue;
                fill(arm, r, h, elbow, grid, c2, s2, from, to, q + capacity + found, q + 2 * capacity + found, q + 3 * capacity + found);
                for (long i = found; i < found + to - from; i++) q[i] = yaw, q[4 * capacity + i] = 0.0;
                found += to - from;
            }
        }
    }
    return found;
}
