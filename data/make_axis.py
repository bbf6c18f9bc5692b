"""Write the synthetic record of a servo axis: `python data/make_axis.py`.

NumPy and SciPy only, as in `make.py`: it imports nothing of this package. A rotary table under two
nested loops, sampled every h. With torque T, angle q and speed v = dq/dt,

    J dv/dt = T - [C(|v|) sgn v + F_v v] - o,     C(|v|) = F_c + F_s exp(-(v/v_s)^2),

and at rest it stays while |T - o| <= F_c + F_s. At the instants t_k = k h, from the encoder's y,

    T_k = k_v [k_p (r_k - y_k) - (y_k - y_{k-2})/(2 h)],     held until t_{k+1}.

The file has time, encoder, reference and T_k as the drive reports it, with white noise. Every
stroke follows r = D (u - sin(2 pi u)/(2 pi)), u from 0 to 1, there and back, with a pause.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

ENCODER = 2 * np.pi / 2**18  # rad


@dataclass(frozen=True)
class Axis:
    """One file, in SI."""

    name: str = "axis"
    seed: int = 21
    J: float = 2.5e-3  # kg m^2
    F_c: float = 0.120  # N m
    F_v: float = 0.015  # N m s/rad
    o: float = 0.008  # N m
    F_s: float = 0.045  # N m
    v_s: float = 0.60  # rad/s
    k_p: float = 25.0  # 1/s
    k_v: float = 0.30  # N m s/rad
    interval: float = 2e-3  # s
    noise: float = 1.0e-3  # N m, standard deviation
    peaks: tuple[float, ...] = (4.0, 1.0, 8.0, 2.0, 0.5, 6.0, 3.0, 1.5)  # rad/s
    stroke: float = 0.8  # s
    pause: float = 0.05  # s


def main(folder: Path = Path(__file__).parent) -> None:
    write(Axis(), folder / f"{Axis.name}.csv")


def write(axis: Axis, path: Path) -> None:
    """Move the axis, add the noise and write the record."""
    time, reference = plan(axis)
    q, _, torque = motion(axis, reference)
    told = torque + axis.noise * np.random.default_rng(axis.seed).standard_normal(len(time))
    lines = [
        "# SYNTHETIC record, not a measurement; written by data/make_axis.py",
        f"# controller: torque = {axis.k_v:g} N m s/rad ({axis.k_p:g} 1/s (reference - position) -"
        " speed), held from row to row",
        "time [s],position [rad],reference_position [rad],motor_torque [N m]",
    ]
    columns = time, encoder(q), reference, told
    rows = zip(*(c.tolist() for c in columns), strict=True)
    lines += ["{:.3f},{:.6f},{:.6f},{:.4f}".format(*row) for row in rows]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def plan(axis: Axis) -> tuple[np.ndarray, np.ndarray]:
    """Times of the samples and the reference at them."""
    moving, resting = (round(span / axis.interval) for span in (axis.stroke, axis.pause))
    u = np.arange(moving) / moving
    shape = u - np.sin(2 * np.pi * u) / (2 * np.pi)
    parts = [np.zeros(resting)]
    for peak in axis.peaks:
        there = 0.5 * peak * axis.stroke
        parts += [there * shape, np.full(resting, there), there * (1 - shape), np.zeros(resting)]
    reference = np.concatenate(parts)
    return axis.interval * np.arange(len(reference)), reference


def encoder(q: float | np.ndarray):
    """The angle as the encoder counts it."""
    return ENCODER * np.round(np.asarray(q) / ENCODER)


def motion(axis: Axis, reference: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Angle, speed and torque at the samples."""
    y, counted = np.zeros(2), [0.0, 0.0]
    rows = []
    for r in reference:
        counted.append(float(encoder(y[0])))
        speed = (counted[-1] - counted[-3]) / (2 * axis.interval)
        torque = axis.k_v * (axis.k_p * (r - counted[-1]) - speed)
        rows.append((*y, torque))
        y = moved(axis, y, torque)
    q, v, torque = np.array(rows).T
    return q, v, torque


def moved(axis: Axis, y: np.ndarray, torque: float) -> np.ndarray:
    """Angle and speed one interval later, by phases of one sign of sliding, or rest."""
    t = 0.0
    while t < axis.interval * (1 - 1e-12):
        sign = np.sign(y[1])
        if sign == 0:
            push = torque - axis.o
            if abs(push) <= axis.F_c + axis.F_s:
                return y
            sign = np.sign(push)

        def rate(_, y, sign=sign):
            bound = axis.F_c + axis.F_s * np.exp(-((y[1] / axis.v_s) ** 2))
            return [y[1], (torque - bound * sign - axis.F_v * y[1] - axis.o) / axis.J]

        def halt(_, y, sign=sign):
            return sign * y[1]

        halt.terminal, halt.direction = True, -1
        done = solve_ivp(rate, (t, axis.interval), y, "DOP853", events=halt, rtol=1e-10, atol=1e-13)
        t, y = float(done.t[-1]), done.y[:, -1]
        if done.status == 1:
            y[1] = 0.0
    return y


if __name__ == "__main__":
    main()
