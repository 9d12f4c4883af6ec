// The same solve laid out for wide registers: blocks of poses as a structure of arrays, trigonometry in loops of its
// own (the vectorised mathematical library), no branch in the solver. One unknown u per leg: p = u + a, m = b + a b / u
// solve the first closure equation, and the second becomes F(u) = 0, whose steps are of third order.
// g++ -O3 -march=native -mprefer-vector-width=512 -ffast-math -fopenmp
#include <cmath>

constexpr int BLOCK = 128, STEPS = 5;
typedef double Lane[BLOCK] __attribute__((aligned(64)));

struct Robot {
    double k1, eta, k3, k4;
};

static void solve_leg(const Robot& robot, const Lane& x, const Lane& y, const Lane& z, double tol, Lane& first,
                      Lane& second, Lane& status, Lane& error2) {
    const double c = std::cos(robot.eta), sn = std::sin(robot.eta), k = 1 / (4 * robot.k1 * robot.k1);
    const double p2 = sn * sn / 4 + k * c * c, m2 = c * c / 4 + k * sn * sn;
#pragma omp simd
    for (int i = 0; i < BLOCK; i++) {
        double a = 2 * y[i] * sn, b = 2 * x[i] * c, h = x[i] * x[i] + y[i] * y[i] + z[i] * z[i] - 1;
        double linear = (2 * p2 - 0.5) * a, constant = h + (p2 - 0.5) * a * a + (m2 - 0.5) * b * b;
        double beta = (2 * m2 - 0.5) * a * b * b, gamma = m2 * a * a * b * b;
        double under = linear * linear - 4 * p2 * constant;
        double u = (std::sqrt(under > 0 ? under : 0) - linear) / (2 * p2);
        double low = std::fabs(b) > -a ? std::fabs(b) : -a;
        u = u > low ? u : low;
        for (int step = 0; step < STEPS; step++) {
            double v = 1 / u, gv = gamma * v;
            double value = (p2 * u + linear) * u + constant + (beta + gv) * v;
            double slope = 2 * p2 * u + linear - (beta + 2 * gv) * v * v;
            double curvature = 2 * p2 + (2 * beta + 6 * gv) * v * v * v;
            double inside = slope * slope - 2 * value * curvature;
            u -= 2 * value / (slope + std::sqrt(inside > 0 ? inside : 0));
            u = u > 1e-9 ? u : 1e-9;
        }
        double p = u + a, m = b + a * b / u;
        double f = (p - a) * m - b * p, g = p2 * p * p + m2 * m * m - (p * a + m * b) / 2 + h;
        double det = (m - b) * (2 * m2 * m - b / 2) - u * (2 * p2 * p - a / 2);
        double s = (p + m) / 2, t = (p - m) / 2, error = f * f + g * g;
        double code = (det < 0) & (s >= 0) & (t >= 0) ? 0 : 1;
        code = error <= tol * tol ? code : 2;
        first[i] = s;
        second[i] = t;
        error2[i] += error;
        status[i] = status[i] > code ? status[i] : code;
    }
}

static void solve_block(const Robot& robot, const double* poses, int count, double tol, double* joints, int* codes,
                        double* residual) {
    Lane q[6], sine[3], cosine[3], value[6], status, error2, x, y, z;
    for (int i = 0; i < BLOCK; i++)
        for (int j = 0; j < 6; j++) q[j][i] = poses[6 * (i < count ? i : 0) + j];
    for (int j = 0; j < 3; j++) {
#pragma omp simd
        for (int i = 0; i < BLOCK; i++) sine[j][i] = std::sin(q[3 + j][i]);
#pragma omp simd
        for (int i = 0; i < BLOCK; i++) cosine[j][i] = std::cos(q[3 + j][i]);
    }
    for (int i = 0; i < BLOCK; i++) status[i] = error2[i] = 0;
    for (int leg = 0; leg < 3; leg++) {
        const double azimuth = 2 * M_PI * leg / 3, c = std::cos(azimuth), s = std::sin(azimuth);
#pragma omp simd
        for (int i = 0; i < BLOCK; i++) {
            double sr = sine[0][i], sp = sine[1][i], sy = sine[2][i];
            double cr = cosine[0][i], cp = cosine[1][i], cy = cosine[2][i];
            double tangent = cy * c - sy * s, normal = cy * s + sy * c;  // cosine and sine of yaw + azimuth
            double px = q[0][i] + robot.k4 * cp * tangent - robot.k3 * c;
            double py = q[1][i] + robot.k4 * (cr * normal + sr * sp * tangent) - robot.k3 * s;
            x[i] = px * s - py * c;
            y[i] = px * c + py * s;
            z[i] = q[2][i] + robot.k4 * (sr * normal - cr * sp * tangent);
        }
        solve_leg(robot, x, y, z, tol, value[2 * leg], value[2 * leg + 1], status, error2);
    }
    for (int i = 0; i < count; i++) {
        for (int j = 0; j < 6; j++) joints[6 * i + j] = value[j][i];
        codes[i] = static_cast<int>(status[i]);
        residual[i] = std::sqrt(error2[i]);
    }
}

extern "C" void solve(const Robot* robot, const double* poses, long n, double tol, double* joints, int* status,
                      double* residual) {
#pragma omp parallel for schedule(static)
    for (long i = 0; i < n; i += BLOCK) {
        int count = n - i < BLOCK ? static_cast<int>(n - i) : BLOCK;
        solve_block(*robot, poses + 6 * i, count, tol, joints + 6 * i, status + i, residual + i);
    }
}
