"""Write the synthetic velocity-step records of this folder: `python data/make.py`.

NumPy and SciPy only: it imports neither `jaxfric` nor its tests, so that a fit of these files
is a fit of somebody else's numbers. Everything is deterministic; the seeds stand in `RECIPES`.

A record is a slider without inertia, pulled through a spring of stiffness K by a load point of
piecewise constant velocity V_m. With the stretch d of the spring beyond its start and
Dieterich's contact ages Theta_i,

    dd/dt = V_m - V,   V = V0 exp[(K d - sum theta_i)/A],   theta_i = B_i ln(V0 Theta_i/L_i)
    dTheta_i/dt = 1 - z (ageing law)  or  -z ln z (slip law),   z = V Theta_i/L_i
    friction = f0 + K d + noise,      recorded load point = x_m + encoder noise

in SI units; the files have um, and friction as a coefficient or as a force in N.
"""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp
from scipy.special import xlogy

UM = 1e-6
ENCODER = 0.02 * UM  # standard deviation of the recorded displacements


@dataclass(frozen=True)
class Recipe:
    """One file. Lists of equal length: a velocity, a duration and a rate per segment."""

    name: str
    seed: int
    law: str  # "slip" or "ageing"
    f0: float
    A: float
    B: tuple[float, ...]
    L: tuple[float, ...]  # m
    K: float  # 1/m, or N/m where friction is a force
    velocities: tuple[float, ...]  # m/s
    distances: tuple[float, ...]  # m of load-point motion
    rows: tuple[int, ...]  # samples in each segment
    white: float  # standard deviation of the white noise of friction
    correlated: float = 0.0  # of the exponentially correlated noise
    correlation_time: float = 1.0  # s
    unit: str = "1"  # of friction: "1" or "N"
    normal_stress: float | None = None  # MPa: adds the columns slip and normal stress
    secret: bool = field(default=False)  # the header keeps the law and the truth to itself


RECIPES = (
    Recipe(
        name="velocity_step",
        seed=11,
        law="slip",
        f0=0.6,
        A=0.010,
        B=(0.014,),
        L=(20 * UM,),
        K=5e3,
        velocities=(1 * UM, 10 * UM),
        distances=(40 * UM, 200 * UM),
        rows=(400, 1600),
        white=3e-4,
    ),
    Recipe(
        name="velocity_steps",
        seed=12,
        law="slip",
        f0=0.62,
        A=0.008,
        B=(0.012,),
        L=(15 * UM,),
        K=4e3,
        velocities=tuple(v * UM for v in (1, 10, 1, 3, 10, 3, 1)),
        distances=(60 * UM, *[180 * UM] * 6),
        rows=(200, 600, 450, 500, 600, 500, 450),
        white=1.5e-4,
        correlated=1.5e-4,
        correlation_time=2.0,
        normal_stress=10.0,
    ),
    Recipe(
        name="ageing_steps",
        seed=13,
        law="ageing",
        f0=0.65,
        A=0.007,
        B=(0.011,),
        L=(8 * UM,),
        K=6e3,
        velocities=tuple(v * UM for v in (0.5, 5, 0.5, 1.5, 0.5)),
        distances=(40 * UM, *[120 * UM] * 4),
        rows=(200, 600, 600, 500, 500),
        white=2e-4,
    ),
    Recipe(
        name="force_step",
        seed=14,
        law="slip",
        f0=17.5,
        A=0.40,
        B=(0.60,),
        L=(5 * UM,),
        K=4e5,
        velocities=(10 * UM, 100 * UM),
        distances=(30 * UM, 120 * UM),
        rows=(150, 600),
        white=0.015,
        unit="N",
    ),
    Recipe(
        name="hidden_state",
        seed=15,
        law="slip",
        f0=0.58,
        A=0.009,
        B=(0.010, 0.004),
        L=(8 * UM, 60 * UM),
        K=9.4e2,
        velocities=tuple(v * UM for v in (1, 3, 10, 30, 10, 3, 1, 10, 1, 3, 30, 3, 1)),
        distances=(60 * UM, *[150 * UM] * 12),
        rows=(150, *[250] * 12),
        white=2e-4,
        secret=True,
    ),
    Recipe(
        name="undeclared",
        seed=16,
        law="slip",
        f0=0.6,
        A=0.009,
        B=(0.008, 0.012),
        L=(40 * UM, 3 * UM),
        K=5e3,
        velocities=tuple(v * UM for v in (1, 10, 1, 3, 10, 3, 1, 3, 10, 1, 10, 1)),
        distances=(150 * UM,) * 12,
        rows=(240,) * 12,
        white=3e-4,
        secret=True,
    ),
)


def main(folder: Path = Path(__file__).parent) -> None:
    for recipe in RECIPES:
        write(recipe, folder / f"{recipe.name}.csv")


def write(recipe: Recipe, path: Path) -> None:
    """Compute one record, add its noise and write it."""
    t, x_m, stretch = motion(recipe)
    rng = np.random.default_rng(recipe.seed)
    friction = recipe.f0 + recipe.K * stretch + friction_noise(recipe, t, rng)
    load_point = x_m + ENCODER * rng.standard_normal(len(t))
    columns = [("time [s]", t, "%.4f"), ("load_point_displacement [um]", load_point / UM, "%.3f")]
    columns.append((f"friction [{recipe.unit}]", friction, "%.6f"))
    if recipe.normal_stress is not None:
        slip = x_m - stretch + ENCODER * rng.standard_normal(len(t))
        stress = recipe.normal_stress * (1.0 + 4e-4 * rng.standard_normal(len(t)))
        columns += [("slip [um]", slip / UM, "%.3f"), ("normal_stress [MPa]", stress, "%.4f")]
    names, values, formats = zip(*columns, strict=True)
    lines = [f"# {line}" for line in header(recipe)] + [",".join(names)]
    row = ",".join(formats)
    lines += [row % each for each in zip(*(v.tolist() for v in values), strict=True)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def header(r: Recipe) -> list[str]:
    """What the file says of itself."""
    lines = ["SYNTHETIC record, not a measurement; written by data/make.py"]
    if r.secret:
        return lines
    numbers = {"f0": r.f0, "A": r.A, "B": r.B[0], "V0": r.velocities[0], "K": r.K, "L": r.L[0]}
    units = {"f0": r.unit, "A": r.unit, "B": r.unit, "V0": "m/s", "L": "m"}
    units["K"] = "1/m" if r.unit == "1" else "N/m"
    truth = ", ".join(f"{k} = {v:.6g} {units[k]}".removesuffix(" 1") for k, v in numbers.items())
    noise = f"noise of friction: white, standard deviation {r.white:g} {r.unit}".removesuffix(" 1")
    if r.correlated:
        noise += f"; and correlated over {r.correlation_time:g} s, {r.correlated:g}"
    return [
        *lines,
        f"law: {r.law}, one state, no inertia",
        f"truth: {truth}",
        noise,
        f"seed: {r.seed}",
    ]


def motion(r: Recipe) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, load-point displacement and stretch of the spring at the samples."""
    V0, B, L = r.velocities[0], np.array(r.B), np.array(r.L)
    y, t0, corner = np.concatenate([[0.0], L / V0]), 0.0, 0.0
    pieces = []
    for V_m, distance, rows in zip(r.velocities, r.distances, r.rows, strict=True):

        def rate(_, y, V_m=V_m):
            theta = B * np.log(V0 * y[1:] / L)
            V = V0 * np.exp((r.K * y[0] - theta.sum()) / r.A)
            z = V * y[1:] / L
            ages = 1.0 - z if r.law == "ageing" else -xlogy(z, z)
            return np.concatenate([[V_m - V], ages])

        span = distance / V_m
        ts = np.linspace(0.0, span, rows + 1)
        atol = 1e-12 * np.concatenate([[r.A / r.K], L / V0])
        done = solve_ivp(rate, (0.0, span), y, "DOP853", t_eval=ts, rtol=1e-11, atol=atol)
        if not done.success:
            raise RuntimeError(f"{r.name}: {done.message}")
        pieces.append((t0 + ts[:-1], corner + V_m * ts[:-1], done.y[0, :-1]))
        y, t0, corner = done.y[:, -1], t0 + span, corner + distance
    t, x_m, stretch = (np.concatenate(each) for each in zip(*pieces, strict=True))
    return t, x_m, stretch


def friction_noise(r: Recipe, t: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """White noise plus an Ornstein-Uhlenbeck process, exact at uneven sampling."""
    white, drive = r.white * rng.standard_normal(len(t)), rng.standard_normal(len(t))
    slow = np.zeros(len(t))
    slow[0] = r.correlated * drive[0]
    for i, a in enumerate(np.exp(-np.diff(t) / r.correlation_time), start=1):
        slow[i] = a * slow[i - 1] + r.correlated * np.sqrt(1.0 - a * a) * drive[i]
    return white + slow


if __name__ == "__main__":
    main()
