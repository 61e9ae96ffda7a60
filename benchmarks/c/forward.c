/* Forward kinematics and geometric Jacobian of uzuner's build over many poses: plane geometry, in blocks.
 *
 * With s = q1 + q2 + q3 the tool's elevation:  approach a = Rz(q0) (cos s, 0, sin s),  up u = Rz(q0) (-sin s, 0, cos s),
 * normal of the arm's plane n = Rz(q0) (0, -1, 0);  x = u cos q4 + n sin q4,  y = n cos q4 - u sin q4,  z = a. */
#include "arm.h"

typedef struct {
    double c[4][BLOCK], s[4][BLOCK]; /* of q0, q1, q1+q2, q1+q2+q3 */
} Headings;

static void headings(const double *q, int n, Headings *h) {
    double t[4][BLOCK];
    for (int i = 0; i < n; i++) {
        t[0][i] = q[5 * i];
        t[1][i] = q[5 * i + 1];
        t[2][i] = t[1][i] + q[5 * i + 2];
        t[3][i] = t[2][i] + q[5 * i + 3];
    }
    for (int k = 0; k < 4; k++) { /* apart: cosine and sine in one loop become one scalar sincos */
        for (int i = 0; i < n; i++) h->c[k][i] = cos(t[k][i]);
        for (int i = 0; i < n; i++) h->s[k][i] = sin(t[k][i]);
    }
}

/* q (count, 5) -> T (count, 4, 4) */
void forward_batch(const Arm *arm, const double *q, long count, double *T) {
    const double l2 = arm->length[0], l3 = arm->length[1], l4 = arm->length[2], d = arm->lateral;
    Headings h;
    for (long at = 0; at < count; at += BLOCK) {
        const int n = count - at < BLOCK ? (int)(count - at) : BLOCK;
        const double *rows = q + 5 * at;
        double *out = T + 16 * at, c5[BLOCK], s5[BLOCK];
        headings(rows, n, &h);
        for (int i = 0; i < n; i++) c5[i] = cos(rows[5 * i + 4]);
        for (int i = 0; i < n; i++) s5[i] = sin(rows[5 * i + 4]);
        for (int i = 0; i < n; i++) {
            const double c1 = h.c[0][i], s1 = h.s[0][i], c = h.c[3][i], s = h.s[3][i];
            const double r = l2 * h.c[1][i] + l3 * h.c[2][i] + l4 * c;
            double *m = out + 16 * i;
            m[0] = s5[i] * s1 - c5[i] * s * c1, m[1] = c5[i] * s1 + s5[i] * s * c1, m[2] = c * c1, m[3] = r * c1 - d * s1;
            m[4] = -c5[i] * s * s1 - s5[i] * c1, m[5] = s5[i] * s * s1 - c5[i] * c1, m[6] = c * s1, m[7] = r * s1 + d * c1;
            m[8] = c5[i] * c, m[9] = -s5[i] * c, m[10] = s;
            m[11] = arm->shoulder_z + l2 * h.s[1][i] + l3 * h.s[2][i] + l4 * s;
            m[12] = m[13] = m[14] = 0.0, m[15] = 1.0;
        }
    }
}

/* q (count, 5) -> J (count, 6, 5), linear over angular */
void jacobian_batch(const Arm *arm, const double *q, long count, double *J) {
    const double *l = arm->length, d = arm->lateral;
    Headings h;
    for (long at = 0; at < count; at += BLOCK) {
        const int n = count - at < BLOCK ? (int)(count - at) : BLOCK;
        double *out = J + 30 * at;
        headings(q + 5 * at, n, &h);
        for (int i = 0; i < n; i++) {
            const double c1 = h.c[0][i], s1 = h.s[0][i], c = h.c[3][i], s = h.s[3][i];
            const double r4 = l[2] * c, z4 = l[2] * s, r3 = r4 + l[1] * h.c[2][i], z3 = z4 + l[1] * h.s[2][i];
            const double r2 = r3 + l[0] * h.c[1][i], z2 = z3 + l[0] * h.s[1][i];
            double *m = out + 30 * i;
            m[0] = -r2 * s1 - d * c1, m[1] = -z2 * c1, m[2] = -z3 * c1, m[3] = -z4 * c1, m[4] = 0.0;
            m[5] = r2 * c1 - d * s1, m[6] = -z2 * s1, m[7] = -z3 * s1, m[8] = -z4 * s1, m[9] = 0.0;
            m[10] = 0.0, m[11] = r2, m[12] = r3, m[13] = r4, m[14] = 0.0;
            m[15] = 0.0, m[16] = s1, m[17] = s1, m[18] = s1, m[19] = c * c1;
            m[20] = 0.0, m[21] = -c1, m[22] = -c1, m[23] = -c1, m[24] = c * s1;
            m[25] = 1.0, m[26] = 0.0, m[27] = 0.0, m[28] = 0.0, m[29] = s;
        }
    }
}
