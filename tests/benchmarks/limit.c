/* What a compiled loop by hand takes for one slider: nothing allocated, nothing checked. */
#include <math.h>

/* Without mass, slip law: Dormand and Prince 5(4) with its interpolant; y = ln(V/V0), theta.
   p = K, A, B, L, V0, V_m. Friction less f0 at the times ts goes to out; returns steps tried. */
static void rate(const double *p, const double *y, double *d) {
    double V = p[4] * exp(y[0]);
    d[1] = -(V / p[3]) * (y[1] + p[2] * y[0]);
    d[0] = (p[0] * (p[5] - V) - d[1]) / p[1];
}
int follow(const double *p, double u, double theta, const double *ts, int n, double rtol,
           double *out) {
    static const double a[6][6] = {
        {1.0/5}, {3.0/40, 9.0/40}, {44.0/45, -56.0/15, 32.0/9},
        {19372.0/6561, -25360.0/2187, 64448.0/6561, -212.0/729},
        {9017.0/3168, -355.0/33, 46732.0/5247, 49.0/176, -5103.0/18656},
        {35.0/384, 0, 500.0/1113, 125.0/192, -2187.0/6784, 11.0/84}};
    static const double e[7] = {71.0/57600, 0, -71.0/16695, 71.0/1920, -17253.0/339200,
                                22.0/525, -1.0/40};
    static const double q[7] = {-12715105075.0/11282082432.0, 0, 87487479700.0/32700410799.0,
        -10690763975.0/1880347072.0, 701980252875.0/199316789632.0, -1453857185.0/822651844.0,
        69997945.0/29380423.0};
    double y[2] = {u, theta}, k[7][2], t = 0, h = 1e-3, z[2];
    int at = 0, steps = 0;
    rate(p, y, k[0]);
    while (at < n) {
        double error = 0;
        for (int s = 1; s < 7; s++) {
            for (int j = 0; j < 2; j++) {
                double x = 0;
                for (int r = 0; r < s; r++) x += a[s - 1][r] * k[r][j];
                z[j] = y[j] + h * x;
            }
            rate(p, z, k[s]);
        }
        for (int j = 0; j < 2; j++) {
            double x = 0, scale = j ? p[1] : 1;
            for (int r = 0; r < 7; r++) x += e[r] * k[r][j];
            x *= h / (rtol * (scale + fmax(fabs(y[j]), fabs(z[j]))));
            error += 0.5 * x * x;
        }
        error = sqrt(error);
        steps++;
        if (error <= 1) {
            for (; at < n && ts[at] <= t + h; at++) {
                double s = (ts[at] - t) / h, r = 1 - s, w[2];
                for (int j = 0; j < 2; j++) {
                    double change = z[j] - y[j], bend = h * k[0][j] - change, more = 0;
                    for (int i = 0; i < 7; i++) more += q[i] * k[i][j];
                    w[j] = y[j] + s * (change + r * (bend + s * (change - h * k[6][j] - bend
                           + r * h * more)));
                }
                out[at] = p[1] * w[0] + w[1];
            }
            t += h;
            for (int j = 0; j < 2; j++) { y[j] = z[j]; k[0][j] = k[6][j]; }
        }
        h *= fmin(10, fmax(0.2, 0.9 * pow(fmax(error, 1e-10), -0.2)));
    }
    return steps;
}

/* With mass, ageing law, regularised: a Rosenbrock method of eight stages whose coefficients are
   given (a, c lower triangular, nodes, d, dense 3 x 8, gamma). y = spring, theta, w = friction/A;
   p = K, A, B, L, V0, V_m, m, f0. */
static void rate3(const double *p, const double *y, double *f, double jac[3][3]) {
    double unit = 2 * p[4] * exp(-(p[7] + y[1]) / p[1]), s = sinh(y[2]), co = cosh(y[2]);
    double V = unit * s, left = exp(-y[1] / p[2]), rest = p[2] * p[4] / p[3];
    double heals = rest * (left - fabs(V) / p[4]), steady = asinh(exp(p[7] / p[1]) / 2);
    double drive = (p[1] * (steady - y[2]) + p[0] * y[0]) / p[6];
    f[0] = p[5] - V;
    f[1] = heals;
    f[2] = (drive / unit + s * heals / p[1]) / co;
    if (!jac) return;
    double sign = V < 0 ? -1 : 1, vt = -V / p[1], vw = unit * co;
    double ht = rest * (-left / p[2] - sign * vt / p[4]), hw = -rest * sign * vw / p[4];
    jac[0][0] = 0;
    jac[0][1] = -vt;
    jac[0][2] = -vw;
    jac[1][0] = 0;
    jac[1][1] = ht;
    jac[1][2] = hw;
    jac[2][0] = p[0] / (p[6] * unit * co);
    jac[2][1] = (drive / (unit * p[1]) + s * ht / p[1]) / co;
    jac[2][2] = (-p[1] / (p[6] * unit) + co * heals / p[1] + s * hw / p[1]) / co
                - f[2] * s / co;
}
int follow_with_mass(const double *p, const double *start, const double *ts, int n, double rtol,
                     const double *a, const double *c, const double *dense, double gamma,
                     double *out) {
    double y[3] = {start[0], start[1], start[2]}, k[8][3], t = 0, h = 1e-3;
    double size[3] = {p[1] / p[0], p[1], 1};
    int at = 0, steps = 0;
    while (at < n && steps < 1000000) {
        double f[3], jac[3][3], m[3][3], inv[3][3];
        rate3(p, y, f, jac);
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++) m[i][j] = (i == j) / (h * gamma) - jac[i][j];
        double det = 0;
        for (int i = 0; i < 3; i++) {
            int i1 = (i + 1) % 3, i2 = (i + 2) % 3;
            for (int j = 0; j < 3; j++) {
                int j1 = (j + 1) % 3, j2 = (j + 2) % 3;
                inv[j][i] = m[i1][j1] * m[i2][j2] - m[i1][j2] * m[i2][j1];
            }
        }
        for (int j = 0; j < 3; j++) det += m[0][j] * inv[j][0];
        double z[3];
        for (int s = 0; s < 8; s++) {
            double side[3];
            for (int j = 0; j < 3; j++) {
                z[j] = y[j];
                side[j] = 0;
                for (int r = 0; r < s; r++) {
                    z[j] += a[8 * s + r] * k[r][j];
                    side[j] += c[8 * s + r] * k[r][j] / h;
                }
            }
            if (s) rate3(p, z, f, 0);
            for (int j = 0; j < 3; j++) side[j] += f[j];
            for (int j = 0; j < 3; j++)
                k[s][j] = (inv[j][0] * side[0] + inv[j][1] * side[1] + inv[j][2] * side[2]) / det;
        }
        double error = 0;
        for (int j = 0; j < 3; j++) {
            z[j] += k[7][j];
            double x = k[7][j] / (rtol * (size[j] + fmax(fabs(y[j]), fabs(z[j]))));
            error += x * x / 3;
        }
        error = sqrt(error);
        steps++;
        if (error <= 1) {
            double in[3];
            for (int i = 0; i < 3; i++) {
                in[i] = 0;
                for (int s = 0; s < 8; s++) in[i] += dense[8 * i + s] * k[s][2];
            }
            for (; at < n && ts[at] <= t + h; at++) {
                double s = (ts[at] - t) / h;
                out[at] = p[1] * ((1 - s) * y[2] + s * (z[2] + (1 - s) * (in[0] + s * (in[1]
                          + s * in[2]))));
            }
            t += h;
            for (int j = 0; j < 3; j++) y[j] = z[j];
        }
        if (!(error < 1e300)) error = 1e10;
        h *= fmin(6, fmax(0.2, 0.9 * pow(fmax(error, 1e-10), -0.2)));
    }
    return steps;
}
