"""Minimum-norm gains by brute force with NumPy and SciPy alone, from (25)."""

import numpy as np
from scipy.optimize import minimize_scalar


def critical(kv, A, B, L, V, m):
    """k_cr of (25), 0 where damping suffices."""
    X = A + kv * V
    excess = np.maximum(B - X, 0.0)
    return excess / L * (m * V**2 / (X * L) + 1)


def random_case(rng):
    """A, B, L, V, m and scales of the norm that make either basin win in about half the cases."""
    A = 10 ** rng.uniform(-1, 1)
    B = A * (1 + 10 ** rng.uniform(-1, 1))
    L, V, m = 10 ** rng.uniform(-4, -2), 10 ** rng.uniform(-3, -1), 10 ** rng.uniform(-1, 1)
    p = dict(A=A, B=B, L=L, V=V, m=m)
    scale = (critical(0.0, **p) * 10 ** rng.uniform(-0.7, 0.7), (B - A) / V)
    return p, scale


def local_minima(p, scale, *, factor=1.0):
    """All local minima (norm, kv, kp) of the norm along kp = factor k_cr(kv), smallest first."""
    damped = (p["B"] - p["A"]) / p["V"]

    def square(kv):
        return (factor * critical(kv, **p) / scale[0]) ** 2 + (kv / scale[1]) ** 2

    grid = np.concatenate(
        [
            [0.0, damped],
            np.geomspace(1e-9, 1, 4001) * damped,
            np.linspace(0, 1, 4001) * damped,
            damped * (1 - np.geomspace(1e-10, 0.5, 2001)),
        ]
    )
    grid = np.unique(grid)
    y = square(grid)
    found = []
    for j in range(len(grid)):
        lower = j == 0 or y[j] <= y[j - 1]
        if lower and (j == len(grid) - 1 or y[j] < y[j + 1]):
            ends = grid[max(j - 1, 0)], grid[min(j + 1, len(grid) - 1)]
            tight = dict(xatol=1e-13 * damped)
            fine = minimize_scalar(square, bounds=ends, method="bounded", options=tight)
            kv = fine.x if fine.fun < y[j] else grid[j]
            found.append((float(np.sqrt(square(kv))), kv, factor * critical(kv, **p)))
    return sorted(found)


def modulus_scan(kp, kv, A, B, L, V, m, *, points=4000):
    """min |1 + L(i w)| by a scan of frequencies; arrays of one shape, negative where unstable."""
    kp, kv, A, B, L, V, m = np.broadcast_arrays(*map(np.asarray, (kp, kv, A, B, L, V, m)))
    rate = V / L
    paces = np.stack([rate, np.sqrt(kp / m), kp / (kv + A / V), (kv + A / V) / m])
    low, high = 1e-2 * paces.min(axis=0), 1e2 * paces.max(axis=0)
    x = np.linspace(0, 1, points)
    s = 1j * low[..., None] * (high / low)[..., None] ** x
    kp, kv, A, B, L, V, m, rate = (y[..., None] for y in (kp, kv, A, B, L, V, m, rate))
    loop = (kv * s + kp) / (m * s**2 + s * (A / V - B / L / (s + rate)))
    least = np.min(np.abs(1 + loop), axis=-1)
    stable = kp[..., 0] > critical(
        kv[..., 0], A[..., 0], B[..., 0], L[..., 0], V[..., 0], m[..., 0]
    )
    return np.where(stable, np.minimum(least, 1.0), -least)


def brute_force(kp, kv, laws, masses, stiffness):
    """Least norm-free feasibility over a grid: for each k_v the largest k_p that (25) asks for.

    `laws` are columns (A, B, L, V); returns stiffness * max k_cr for each k_v, in chunks.
    """
    A, B, L, V = (column[:, None] for column in laws)
    needed = np.empty(kv.size)
    for i, damping in enumerate(kv):
        needed[i] = stiffness * np.max(critical(damping, A, B, L, V, masses[None, :]))
    return needed
