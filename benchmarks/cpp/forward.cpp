// Forward kinematics of the Triple Scissor Extender as an engineer writes it: one joint vector after the other,
// Newton's method on the pose from home, the analytic 6 x 6 Jacobian by the twist, elimination with row pivots.
// g++ -O3 -march=native -ffast-math -fopenmp
#include <cmath>
#include <utility>

struct Robot {
    double k1, eta, k3, k4;  // l0, slide angle, slide radius, platform radius, in units of L
};

// Solve a 6 x 6 system in place; false where a pivot vanishes.
static bool eliminate(double a[6][6], double b[6]) {
    for (int i = 0; i < 6; i++) {
        int best = i;
        for (int j = i + 1; j < 6; j++)
            if (std::fabs(a[j][i]) > std::fabs(a[best][i])) best = j;
        if (a[best][i] == 0) return false;
        if (best != i) {
            for (int k = i; k < 6; k++) std::swap(a[i][k], a[best][k]);
            std::swap(b[i], b[best]);
        }
        for (int j = i + 1; j < 6; j++) {
            double f = a[j][i] / a[i][i];
            for (int k = i; k < 6; k++) a[j][k] -= f * a[i][k];
            b[j] -= f * b[i];
        }
    }
    for (int i = 5; i >= 0; i--) {
        for (int k = i + 1; k < 6; k++) b[i] -= a[i][k] * b[k];
        b[i] /= a[i][i];
    }
    return true;
}

// R exp([w]), by Rodrigues' formula.
static void turn(double r[3][3], const double w[3]) {
    double angle2 = w[0] * w[0] + w[1] * w[1] + w[2] * w[2], angle = std::sqrt(angle2);
    double s = angle > 1e-4 ? std::sin(angle) / angle : 1 - angle2 / 6;
    double c = angle > 1e-4 ? (1 - std::cos(angle)) / angle2 : 0.5 - angle2 / 24;
    double e[3][3];
    const double k[3][3] = {{0, -w[2], w[1]}, {w[2], 0, -w[0]}, {-w[1], w[0], 0}};
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) e[i][j] = (i == j) * (1 - c * angle2) + s * k[i][j] + c * w[i] * w[j];
    double out[3][3];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) out[i][j] = e[i][0] * r[0][j] + e[i][1] * r[1][j] + e[i][2] * r[2][j];
    for (int i = 0; i < 9; i++) (&r[0][0])[i] = (&out[0][0])[i];
}

// home is (x, y, z) without a turn; poses are x, y, z and the rotation matrix row by row
extern "C" void solve(const Robot* robot, const double* home, const double* joints, long n, double tol, double* poses,
                      int* status) {
    double c = std::cos(robot->eta), sn = std::sin(robot->eta), k = 1 / (4 * robot->k1 * robot->k1);
    double ca[3], sa[3];
    for (int leg = 0; leg < 3; leg++) ca[leg] = std::cos(2 * M_PI * leg / 3), sa[leg] = std::sin(2 * M_PI * leg / 3);
#pragma omp parallel for schedule(static)
    for (long i = 0; i < n; i++) {
        double p[3] = {home[0], home[1], home[2]}, r[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
        status[i] = 2;
        for (int step = 0; step < 50; step++) {
            double a[6][6], b[6], error2 = 0;
            for (int leg = 0; leg < 3; leg++) {
                double first = joints[6 * i + 2 * leg], second = joints[6 * i + 2 * leg + 1];
                double corner[3], apex[3], middle[3], base[3];
                for (int j = 0; j < 3; j++) corner[j] = robot->k4 * (r[j][0] * ca[leg] + r[j][1] * sa[leg]);
                for (int j = 0; j < 3; j++) apex[j] = p[j] + corner[j];
                // slides along +-tangent cos(eta) + outward sin(eta), from outward * k3
                double out = robot->k3 + (first + second) / 2 * sn, side = (first - second) / 2 * c;
                middle[0] = ca[leg] * out + sa[leg] * side, middle[1] = sa[leg] * out - ca[leg] * side, middle[2] = 0;
                double along = (first + second) * c, outward = (first - second) * sn;
                base[0] = sa[leg] * along + ca[leg] * outward, base[1] = -ca[leg] * along + sa[leg] * outward, base[2] = 0;
                double f = 0, g = -1, grad_f[3], grad_g[3];
                for (int j = 0; j < 3; j++) {
                    double axis = apex[j] - middle[j];
                    f += axis * base[j];
                    g += axis * axis + k * base[j] * base[j];
                    grad_f[j] = base[j], grad_g[j] = 2 * axis;
                }
                b[2 * leg] = -f, b[2 * leg + 1] = -g, error2 += f * f + g * g;
                for (int row = 0; row < 2; row++) {
                    const double* d = row ? grad_g : grad_f;
                    double* to = a[2 * leg + row];
                    to[0] = d[0], to[1] = d[1], to[2] = d[2];
                    to[3] = corner[1] * d[2] - corner[2] * d[1];
                    to[4] = corner[2] * d[0] - corner[0] * d[2];
                    to[5] = corner[0] * d[1] - corner[1] * d[0];
                }
            }
            if (error2 < tol * tol) {
                status[i] = 0;
                break;
            }
            if (!eliminate(a, b)) break;
            for (int j = 0; j < 3; j++) p[j] += b[j];
            turn(r, b + 3);
        }
        for (int j = 0; j < 3; j++) poses[12 * i + j] = p[j];
        for (int j = 0; j < 9; j++) poses[12 * i + 3 + j] = (&r[0][0])[j];
    }
}
