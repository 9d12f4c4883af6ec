// Inverse kinematics of the Triple Scissor Extender as an engineer writes it: one pose after the other, scalar
// sines and cosines, Newton's method on the two closure equations of each leg, the analytic Jacobian.
// g++ -O3 -march=native -ffast-math -fopenmp
#include <cmath>

enum Status { CONVERGED = 0, OTHER_MODE = 1, MAX_STEPS = 2 };

struct Robot {
    double k1, eta, k3, k4;  // l0, slide angle, slide radius, platform radius, in units of L
};

// One leg with its apex at (x, y, z) in the leg's frame. p = s_A + s_B, m = s_A - s_B.
static int solve_leg(const Robot& robot, double x, double y, double z, double tol, double* s, double* error2) {
    double c = std::cos(robot.eta), sn = std::sin(robot.eta), k = 1 / (4 * robot.k1 * robot.k1);
    double a = 2 * y * sn, b = 2 * x * c;
    double p2 = sn * sn / 4 + k * c * c, m2 = c * c / 4 + k * sn * sn;
    double h = x * x + y * y + z * z - 1;
    // start: both slides as on the plane of symmetry
    double under = a * a / 4 - 4 * p2 * h;
    double p = (a / 2 + std::sqrt(under > 0 ? under : 0)) / (2 * p2);
    double m = p > a ? b * p / (p - a) : b;
    double f = 0, g = 0, det = 0;
    for (int step = 0;; step++) {
        f = (p - a) * m - b * p;
        g = p2 * p * p + m2 * m * m - (p * a + m * b) / 2 + h;
        double fp = m - b, fm = p - a, gp = 2 * p2 * p - a / 2, gm = 2 * m2 * m - b / 2;
        det = fp * gm - fm * gp;
        if (step == 8 || (step >= 1 && f * f + g * g < tol * tol)) break;
        p -= (f * gm - g * fm) / det;
        m -= (g * fp - f * gp) / det;
    }
    s[0] = (p + m) / 2;
    s[1] = (p - m) / 2;
    *error2 += f * f + g * g;
    if (!(f * f + g * g <= tol * tol)) return MAX_STEPS;
    return det < 0 && p > a && s[0] >= 0 && s[1] >= 0 ? CONVERGED : OTHER_MODE;
}

extern "C" void solve(const Robot* robot, const double* poses, long n, double tol, double* joints, int* status,
                      double* residual) {
#pragma omp parallel for schedule(static)
    for (long i = 0; i < n; i++) {
        const double* q = poses + 6 * i;
        double sr = std::sin(q[3]), cr = std::cos(q[3]), sp = std::sin(q[4]), cp = std::cos(q[4]);
        double sy = std::sin(q[5]), cy = std::cos(q[5]);
        double nx = cp * cy, ny = cr * sy + sr * sp * cy, nz = sr * sy - cr * sp * cy;
        double tx = -cp * sy, ty = cr * cy - sr * sp * sy, tz = sr * cy + cr * sp * sy;
        int worst = CONVERGED;
        double error2 = 0;
        for (int leg = 0; leg < 3; leg++) {
            double azimuth = 2 * M_PI * leg / 3, c = std::cos(azimuth), s = std::sin(azimuth);
            double x = q[0] + robot->k4 * (nx * c + tx * s) - robot->k3 * c;
            double y = q[1] + robot->k4 * (ny * c + ty * s) - robot->k3 * s;
            double z = q[2] + robot->k4 * (nz * c + tz * s);
            int code = solve_leg(*robot, x * s - y * c, x * c + y * s, z, tol, joints + 6 * i + 2 * leg, &error2);
            worst = code > worst ? code : worst;
        }
        status[i] = worst;
        residual[i] = std::sqrt(error2);
    }
}
