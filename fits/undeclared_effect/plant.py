"""The true slider under PD gains: `python plant.py BEFORE/gains.json AFTER/gains.json`.

NumPy, SciPy and Matplotlib only, none of jaxfric: this is the machine that the gains are for. It
moves on the surface of `data/undeclared.csv` under a normal force N, and its friction has the
second state that the record does not tell of. With e = x_m - x, where x_m moves at V,

    m dv/dt = k_p e + k_v (V - v) - N [A u + theta_1 + theta_2],   u = ln(v/V0)
    dtheta_i/dt = -(v/L_i) (theta_i + B_i u),                      de/dt = V - v

(the f0 part of e is left out: it does not change). Until t = 0 it slides steadily at 10 um/s; then
the command drops to 1 um/s. Writes plant.json and the figure plant.png.
"""

import json
import sys
from pathlib import Path

import matplotlib

matplotlib.use("agg")
import matplotlib.pyplot as plt
import numpy as np
from scipy.integrate import solve_ivp

UM = 1e-6
A, B, L, V0 = 0.009, np.array([0.008, 0.012]), np.array([40, 3]) * UM, 1 * UM
N, MASS = 500.0, 2.0  # N, kg
BEFORE, VELOCITY, DURATION = 10 * UM, 1 * UM, 600.0  # m/s, m/s, s


def simulate(k_p: float, k_v: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times [s], velocity of the slider [m/s], how far it is behind steady motion [m]."""

    def rate(_, y):
        e, u, theta = y[0], y[1], y[2:]
        v = V0 * np.exp(u)
        force = k_p * e + k_v * (VELOCITY - v) - N * (A * u + theta.sum())
        return [VELOCITY - v, force / (MASS * v), *(-(v / L) * (theta + B * u))]

    u = np.log(BEFORE / V0)
    start = [N * (A - B.sum()) * u / k_p, u, *(-B * u)]
    rest = N * (A - B.sum()) * np.log(VELOCITY / V0) / k_p
    ts = np.linspace(0.0, DURATION, 12001)
    atol = [1e-12, 1e-8, 1e-10, 1e-10]
    done = solve_ivp(rate, (0, DURATION), start, "Radau", t_eval=ts, rtol=1e-7, atol=atol)
    if not done.success:
        raise RuntimeError(done.message)
    return done.t, V0 * np.exp(done.y[1]), done.y[0] - rest


def describe(t: np.ndarray, v: np.ndarray, e: np.ndarray) -> dict:
    """How the motion ends: the last third of it."""
    late = t > t[-1] * 2 / 3
    slowest, fastest = v[late].min(), v[late].max()
    steady = fastest / slowest < 1.01
    return {
        "end": "steady" if steady else "stick-slip",
        "slowest": float(slowest),
        "fastest": float(fastest),
        "range_behind": float(np.ptp(e[late])),
    }


def main(files: list[str]) -> None:
    figure, axes = plt.subplots(2, 2, figsize=(8.4, 4.8), sharex=True, sharey="row")
    report = {}
    for (top, bottom), file, when in zip(axes.T, files, ("before", "after"), strict=True):
        gains = json.loads(Path(file).read_text(encoding="utf-8"))
        t, v, e = simulate(gains["kp"], gains["kv"])
        report[when] = {"kp": gains["kp"], "kv": gains["kv"], **describe(t, v, e)}
        top.semilogy(t, v / UM, lw=0.9)
        top.axhline(VELOCITY / UM, color="0.5", lw=0.7, ls="--")
        bottom.plot(t, e / UM, lw=0.9)
        law = {"before": "gains of the base law", "after": "gains of the law after the loop"}[when]
        pair = f"$k_p$ = {gains['kp'] / 1e3:.0f} kN/m, $k_v$ = {gains['kv'] / 1e3:.0f} kN s/m"
        top.set_title(f"{law}\n{pair}\n{report[when]['end']}", fontsize=9)
        bottom.set_xlabel("time [s]")
        print(when, report[when])
    axes[0, 0].set_ylabel("slider velocity [µm/s]")
    axes[1, 0].set_ylabel("behind steady motion [µm]")
    figure.tight_layout()
    figure.savefig("plant.png", dpi=130)
    Path("plant.json").write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
