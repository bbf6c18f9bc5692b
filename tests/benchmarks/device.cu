/* A thread for every trajectory: the loops of limit.c, which stands above this text, and Lorenz'
   equations by the same method of Dormand and Prince, in numbers of the type REAL. */

extern "C" __global__ void follow_all(int number, const double *stiffness, const double *law,
                                      double u, double theta, const double *ts, int n,
                                      double rtol, double *out, int *steps) {
    int i = blockIdx.x * blockDim.x + threadIdx.x;
    if (i >= number) return;
    double p[6];
    for (int j = 0; j < 6; j++) p[j] = law[j];
    p[0] = stiffness[i];
    steps[i] = follow(p, u, theta, ts, n, rtol, out + (long long)n * i);
}

extern "C" __global__ void follow_all_with_mass(int number, const double *stiffness,
                                                const double *law, const double *start,
                                                const double *ts, int n, double rtol,
                                                const double *a, const double *c,
                                                const double *dense, double gamma, double *out,
                                                int *steps) {
    int i = blockIdx.x * blockDim.x + threadIdx.x;
    if (i >= number) return;
    double p[8];
    for (int j = 0; j < 8; j++) p[j] = law[j];
    p[0] = stiffness[i];
    steps[i] = follow_with_mass(p, start, ts, n, rtol, a, c, dense, gamma, out + (long long)n * i);
}

static void lorenz_rate(REAL rho, const REAL *y, REAL *d) {
    d[0] = REAL(10) * (y[1] - y[0]);
    d[1] = y[0] * (rho - y[2]) - y[1];
    d[2] = y[0] * y[1] - REAL(8.0 / 3) * y[2];
}

/* From (1, 0, 0) to the time `end`, rho from 0 to 21; rtol 0: steps of `first`. */
extern "C" __global__ void lorenz_all(int number, REAL end, REAL first, REAL rtol, REAL *out) {
    int i = blockIdx.x * blockDim.x + threadIdx.x;
    if (i >= number) return;
    const REAL a[6][6] = {
        {REAL(1.0/5)}, {REAL(3.0/40), REAL(9.0/40)},
        {REAL(44.0/45), REAL(-56.0/15), REAL(32.0/9)},
        {REAL(19372.0/6561), REAL(-25360.0/2187), REAL(64448.0/6561), REAL(-212.0/729)},
        {REAL(9017.0/3168), REAL(-355.0/33), REAL(46732.0/5247), REAL(49.0/176),
         REAL(-5103.0/18656)},
        {REAL(35.0/384), 0, REAL(500.0/1113), REAL(125.0/192), REAL(-2187.0/6784),
         REAL(11.0/84)}};
    const REAL e[7] = {REAL(71.0/57600), 0, REAL(-71.0/16695), REAL(71.0/1920),
                       REAL(-17253.0/339200), REAL(22.0/525), REAL(-1.0/40)};
    REAL rho = REAL(21) * i / REAL(number > 1 ? number - 1 : 1), t = 0, h = first;
    REAL y[3] = {1, 0, 0}, z[3], k[7][3];
    lorenz_rate(rho, y, k[0]);
    for (int turn = 0; turn < 100000 && t < end; turn++) {
        h = fmin(h, end - t);
        REAL error = 0;
#pragma unroll
        for (int s = 1; s < 7; s++) {
#pragma unroll
            for (int j = 0; j < 3; j++) {
                REAL x = 0;
#pragma unroll
                for (int r = 0; r < s; r++) x += a[s - 1][r] * k[r][j];
                z[j] = y[j] + h * x;
            }
            lorenz_rate(rho, z, k[s]);
        }
        if (rtol > 0) {
#pragma unroll
            for (int j = 0; j < 3; j++) {
                REAL x = 0;
#pragma unroll
                for (int r = 0; r < 7; r++) x += e[r] * k[r][j];
                x *= h / (rtol * (1 + fmax(fabs(y[j]), fabs(z[j]))));
                error += x * x / 3;
            }
            error = sqrt(error);
        }
        if (error <= 1) {
            t = h < end - t ? t + h : end;
#pragma unroll
            for (int j = 0; j < 3; j++) { y[j] = z[j]; k[0][j] = k[6][j]; }
        }
        if (rtol > 0)
            h *= fmin(REAL(10), fmax(REAL(0.2), REAL(0.9) * pow(fmax(error, REAL(1e-10)),
                                                                REAL(-0.2))));
    }
    for (int j = 0; j < 3; j++) out[3LL * i + j] = y[j];
}
