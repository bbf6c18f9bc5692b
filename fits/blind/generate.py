"""Write records with a hidden effect: `python -m fits.blind.generate --effect second_state ...`.

A record is drawn from its seed (and from what is asked of it), never from the clock:
    base        f0 uniform in [0.5, 0.75]; A log-uniform in [0.004, 0.02]; L log-uniform in
                [4, 15] um; B/A log-uniform in [1.15, 2.2], or in one case of five in [0.6, 0.9]
                (velocity strengthening, where there is no critical stiffness)
    stiffness   K = ratio max(B - A, 0.2 B)/L, ratio log-uniform in [3, 8]: K/K_cr for B > 1.25 A,
                and above it elsewhere; that of a true stiffness other than K is 3 or more too
    protocol    12 velocities out of 1, 3, 10, 30, 100 um/s, each present, no step beyond a factor
                of 10; 150 um of load-point motion each; V0, the first, is 1, 3 or 10 um/s
    sampling    225 to 275 samples a velocity, at a constant rate ("uniform") or finer after the
                step ("thinned"); the step falls between two samples
    plant       without mass, or with a mass and a dashpot that move friction by less than
                a twentieth of the noise (`inertial`)
    noise       standard deviation 3e-4; white or AR(1) from sample to sample; or correlated in
                time ("time": Ornstein-Uhlenbeck, its time log-uniform in [0.05, 2] s, exact at
                the record's uneven rows); or cut from a measured record ("measured-...", see
                `measured`); or "wide", where all of the above is drawn otherwise (see `wide`):
                `sampling` is not asked for there. Displacements have 0.02 um, the normal stress
                5e-5 of itself

How large the effect is: rho is the rms, over the noise's standard deviation, of what a refit of
the base (f0, A, B, L free; K as declared; the recorded normal stress known) leaves of the
noise-free record. The amplitude is scaled until rho is within 5 % of what is asked: first
with the refit replaced by a projection on the base's sensitivities, then with the refit. Of
two effects each is scaled alone. A draw that runs away or cannot reach rho with physical
parameters is drawn again; `truth.json` counts how often, and why.

Files: OUT/records/NAME/record.csv and declared.json (stiffness, noise, commanded velocities),
and OUT/truth/NAME/truth.json. NAME tells nothing of the effect.
"""

import argparse
import json
import math
import zlib
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from . import measured, wide
from .draws import (
    LEAST_RATIO,
    RECIPES,
    SIGMA,
    UM,
    Draw,
    Recipe,
    draw_protocol,
    draw_times,
    log_uniform,
)
from .plants import EFFECTS, Base, RunawayError, Stress, simulate, simulate_base

CORRELATIONS = {"white": 0.0, "ar1-0.7": 0.7, "ar1-0.9": 0.9}
MEASURED = "measured-"
NOISES = (*CORRELATIONS, "time", *wide.NOISES, *(MEASURED + source for source in measured.SOURCES))
PLANTS = ("quasi-static", "inertial")
SAMPLINGS = ("uniform", "thinned")
CHANNELS = ("slip", "normal_stress", "load_point")
_ENCODER, _GAUGE, _STRESS = 0.02 * UM, 5e-5, 10.0  # m, of the stress, MPa
_ATTEMPTS, _ATTEMPTS_ALIKE = 60, 10


class UnreachableError(RuntimeError):
    """No physical amplitude of the effect leaves as much structure as is asked."""


@dataclass(frozen=True)
class Request:
    """What is asked of a record. `effects` holds ids; empty: no effect."""

    seed: int
    effects: tuple[str, ...] = ()
    rho: float = 0.5
    noise: str = "white"
    plant: str = "quasi-static"
    sampling: str = "uniform"
    channels: tuple[str, ...] = ()

    def __post_init__(self):
        for known, asked, what in (
            (tuple(EFFECTS), self.effects, "effect"),
            (CHANNELS, self.channels, "channel"),
            (NOISES, (self.noise,), "noise"),
            (PLANTS, (self.plant,), "plant"),
            (SAMPLINGS, (self.sampling,), "sampling"),
        ):
            for name in asked:
                if name not in known:
                    raise ValueError(f"{what} '{name}' does not exist; there are: {known}")
        if len(self.effects) != len(set(self.effects)) or len(self.effects) > 2:
            raise ValueError("ask for no effect, one, or two different ones")
        if not (math.isfinite(self.rho) and self.rho > 0):
            raise ValueError(f"rho is {self.rho}; it must be positive")
        if "frictional_delay" in self.effects and {self.plant, *self.effects} & {
            "inertial",
            "inertia",
        }:
            raise ValueError("frictional_delay needs a plant without mass: its solver is explicit")

    @property
    def wide(self) -> bool:
        """Whether plant, sampling and all conditions are those of `wide`."""
        return self.noise in wide.NOISES

    def entropy(self, *more: int) -> np.random.Generator:
        """Random numbers of this request. rho has no part in them: only amplitudes differ."""
        text = "|".join(("+".join(self.effects), self.noise, self.plant, self.sampling))
        return np.random.default_rng([self.seed, _number(text), *more])

    @property
    def name(self) -> str:
        key = repr(self)
        return f"{self.seed:06d}-{_number(key):08x}"


def _number(text: str) -> int:
    """Of a stream or a name; `ageing` was `aging` when the first records were drawn."""
    return zlib.crc32(text.replace("ageing", "aging").encode())


def draw_plant(rng: np.random.Generator, request: Request) -> Draw:
    """The plant of a request without its effects."""
    A, L = log_uniform(rng, 0.004, 0.02), log_uniform(rng, 4 * UM, 15 * UM)
    B = A * (log_uniform(rng, 0.6, 0.9) if rng.random() < 0.2 else log_uniform(rng, 1.15, 2.2))
    ratio = log_uniform(rng, LEAST_RATIO, 8)
    base = Base(float(rng.uniform(0.5, 0.75)), A, B, L, ratio * max(B - A, 0.2 * B) / L)
    protocol = draw_protocol(rng)
    t = draw_times(rng, protocol, request.sampling)
    # a hunting servo: slow against the sampling; larger where more structure is asked, so that
    # alpha stays near the laboratory's 0.1 to 0.4
    size, weight = log_uniform(rng, 0.003, 0.008), rng.dirichlet((4.0, 4.0, 4.0))
    phases = rng.uniform(0, 2 * math.pi, 3)
    periods = [log_uniform(rng, 15, 80) for _ in range(3)]
    stress = None
    if "normal_stress" in request.effects or "normal_stress" in request.channels:
        size = size * math.sqrt(2) * (request.rho if request.effects else 1.0)
        stress = Stress(
            tuple((size * weight).tolist()),
            tuple(2 * math.pi / p for p in periods),
            tuple(phases.tolist()),
        )
    draw = Draw(base, ratio, protocol, t, stress)
    if request.plant == "inertial" or "inertia" in request.effects:
        draw = _with_mass(draw)
    return draw


def draw_wide(rng: np.random.Generator, request: Request, attempt: int = 0) -> Draw:
    """The plant of a request of the study `wide`: ten attempts share their conditions."""
    given = wide.draw_conditions(
        request.entropy(attempt // _ATTEMPTS_ALIKE, 2), request.noise, request.effects
    )
    hunts = "normal_stress" in (*request.effects, *request.channels)
    hunting = (request.rho if request.effects else 1.0) if hunts else 0.0
    draw = wide.draw_plant(rng, given, hunting=hunting)
    return _with_mass(draw) if request.plant == "inertial" or "inertia" in request.effects else draw


def _with_mass(draw: Draw) -> Draw:
    """A mass and a dashpot that stay below a twentieth of the noise."""
    still = simulate(draw.base, draw.protocol, {}, draw.t, stress=draw.stress).record
    m, k_v = draw.base.K * (0.05 * draw.crossing) ** 2, 0.01 * draw.base.A / draw.fastest
    for _ in range(8):
        base = replace(draw.base, m=m, k_v=k_v)
        moved = simulate(base, draw.protocol, {}, draw.t, stress=draw.stress).record
        if np.std(moved - still) < 0.05 * draw.sigma:
            return replace(draw, base=base)
        m, k_v = m / 4, k_v / 2
    raise RunawayError("no mass is small enough")


class Refit:
    """The base fitted to a noise-free record: f0, ln A, ln B, ln L free, K declared.

    Where the stiffness is declared as uncertain, ln K is free, too. `stretch` counts from 0 for
    every row: each stretch has an f0 of its own.
    """

    def __init__(self, draw: Draw, stretch: np.ndarray | None = None):
        self.draw = draw
        of = np.zeros(len(draw.t), int) if stretch is None else stretch
        self.levels = np.eye(of.max() + 1)[of]
        self.levels /= np.linalg.norm(self.levels, axis=0)
        self.base = replace(draw.base, m=0.0, k_v=0.0)
        self.free = 4 if draw.stiffness_error else 3
        self.clean = self.predict(np.zeros(self.free))
        steps = 1e-3 * np.eye(self.free)
        columns = [(self.predict(h) - self.predict(-h)) / 2e-3 for h in steps]
        self.basis = np.linalg.qr(np.column_stack([*columns, self.levels]))[0]

    def predict(self, x: np.ndarray) -> np.ndarray:
        """Friction of the base with A, B, L (and K) times exp(x)."""
        base, w = self._scaled(x), self.draw
        return simulate_base(base, w.protocol, w.t, stress=w.stress)

    def _scaled(self, x: np.ndarray) -> Base:
        names = ("A", "B", "L", "K")[: self.free]
        values = zip(names, np.exp(x).tolist(), strict=True)
        return replace(self.base, **{k: getattr(self.base, k) * v for k, v in values})

    def project(self, record: np.ndarray) -> np.ndarray:
        """Structure that the base's sensitivities leave, over sigma."""
        structure = record - self.clean
        return (structure - self.basis @ (self.basis.T @ structure)) / self.draw.sigma

    def __call__(self, record: np.ndarray) -> tuple[float, Base]:
        """rho, and the base that the refit ends with."""

        draw = self.draw

        def residual(x):
            try:
                left = record - self.predict(x)
            except RunawayError:
                return np.full(len(record), 1e3)
            return (left - self.levels @ (self.levels.T @ left)) / draw.sigma

        def slopes(x):
            here = residual(x)
            return np.stack(
                [(residual(x + h) - here) / 1e-4 for h in 1e-4 * np.eye(self.free)], axis=1
            )

        jac: Any = slopes  # SciPy's annotation of `jac` knows names only
        fit = least_squares(
            residual, np.zeros(self.free), jac=jac, xtol=1e-7, ftol=1e-7, max_nfev=40
        )
        f0 = self.base.f0 + float(np.mean(record - self.predict(fit.x)))
        rho = math.sqrt(2 * fit.cost / len(record))
        return rho, replace(self._scaled(fit.x), f0=f0)


def scale(
    effect: str,
    draw: Draw,
    refit: Refit,
    rho: float,
    rng: np.random.Generator,
    recipes: Mapping[str, Recipe] = RECIPES,
) -> tuple[dict[str, float], float]:
    """Parameters of `effect` that leave the structure `rho`; what they leave in a refit.

    Raises `UnreachableError` beyond the largest physical amplitude.
    """
    recipe = recipes[effect]
    shape, sign = recipe.shape(rng, draw), -1.0 if recipe.signed and rng.random() < 0.5 else 1.0
    amplitude, limit = recipe.start(draw), recipe.limit(draw)

    def record(size: float) -> np.ndarray:
        effects = {effect: recipe.parameters(sign * size, shape)}
        return simulate(draw.base, draw.protocol, effects, draw.t, stress=draw.stress).record

    def linear(size: float) -> float:
        return math.sqrt(float(np.mean(refit.project(record(size)) ** 2)))

    def full(size: float) -> float:
        return refit(record(size))[0]

    amplitude, _ = _secant(linear, min(amplitude, limit), limit, rho, 0.05)
    amplitude, reached = _secant(full, amplitude, limit, rho, 0.02)
    return recipe.parameters(sign * amplitude, shape), reached


def _secant(level, size: float, limit: float, wanted: float, tolerance: float):
    """Size whose level is `wanted`, and that level, by secants in the logarithms of both."""
    power, before, at_limit, now = 1.0, None, False, math.nan
    for _ in range(20):
        try:
            now = level(size)
        except RunawayError:
            if before is None:
                size /= 5
                continue
            raise
        if abs(now / wanted - 1) < tolerance:
            return size, now
        if at_limit and now < wanted:
            raise UnreachableError(f"largest amplitude {size:.3g} leaves {now:.3g}")
        if before is not None and before[0] != size:
            steep = math.log(now / before[1]) / math.log(size / before[0])
            power = min(max(steep, 0.5), 3.0)
        before = (size, now)
        factor = (wanted / now) ** (1 / power)
        size = min(size * min(max(factor, 0.01), 30.0), limit)
        at_limit = size >= limit
    raise UnreachableError(f"no amplitude found; the last, {size:.3g}, leaves {now:.3g}")


@dataclass(frozen=True)
class Blind:
    """A record and its truth."""

    request: Request
    columns: dict[str, np.ndarray]  # by the names of the file, in its units
    declared: dict
    truth: dict


def make(request: Request) -> Blind:
    """The record of a request, the same for the same request.

    Raises `UnreachableError` if no draw can be had.
    """
    redraws: Counter[str] = Counter()
    for attempt in range(_ATTEMPTS):
        try:
            return _attempt(request, attempt, redraws)
        except (RunawayError, UnreachableError) as error:
            redraws[type(error).__name__] += 1
            last = error
    raise UnreachableError(
        f"{'+'.join(request.effects) or 'no effect'} at rho = {request.rho:g}, seed {request.seed}:"
        f" none of {_ATTEMPTS} draws reaches it ({dict(redraws)}; the last: {last})"
    )


def _attempt(request: Request, attempt: int, redraws: Counter[str]) -> Blind:
    rng = request.entropy(attempt)
    draw = draw_wide(rng, request, attempt) if request.wide else draw_plant(rng, request)
    refit, recipes = Refit(draw), wide.WIDE if request.wide else RECIPES
    effects, each = {}, {}
    for effect in request.effects:
        effects[effect], each[effect] = scale(effect, draw, refit, request.rho, rng, recipes)
    if draw.ratio * math.exp(effects.get("stiffness", {}).get("kappa", 0.0)) < draw.least_ratio:
        raise UnreachableError("the true stiffness is too near the critical one")
    path = simulate(draw.base, draw.protocol, effects, draw.t, stress=draw.stress)
    unknown = request.noise == "wide-law"
    if unknown:  # the law that a user would declare who knows nothing of it
        refit = Refit(replace(draw, base=replace(draw.base, q=0.0)))
    rho, biased = refit(path.record)
    columns, about = _columns(request, draw, path)
    truth = {
        "schema": "jaxfric.blind/1",
        "seed": request.seed,
        "effects": ["ageing"] if unknown else list(request.effects),
        "parameters": {"ageing": {"q": 1.0}} if unknown else effects,
        "rho": {"wanted": request.rho if effects else 0.0, "each": each, "all": rho},
        "cosine": _cosine(draw, refit, effects) if len(effects) == 2 else None,
        "base": {**asdict(draw.base), "V0": draw.protocol.velocities[0]},
        "base_refit": {k: v for k, v in asdict(biased).items() if k in ("f0", "A", "B", "L")},
        "stiffness_ratio": draw.ratio,
        "critical_stiffness": (draw.base.B - draw.base.A) / draw.base.L,
        "plant": "inertial" if draw.base.m > 0 else "quasi-static",
        "sampling": draw.sampling if request.wide else request.sampling,
        "noise": {"sigma": draw.sigma, **about},
        "redraws": dict(redraws),
    }
    if request.wide:
        truth["wide"] = _about(request, draw)
    declared = {
        "stiffness [1/m]": draw.base.K * math.exp(-draw.stiffness_error),
        "noise [1]": draw.sigma,
        "starts [s]": draw.protocol.starts.tolist(),
        "velocities [m/s]": list(draw.protocol.velocities),
    }
    if request.wide:
        declared["stiffness known to [1]"] = wide.STIFFNESS if draw.stiffness_error else 0.0
        declared["law"] = None if unknown else truth["wide"]["law"]
    return Blind(request, columns, declared, truth)


def _about(request: Request, draw: Draw) -> dict:
    """Conditions of a record of the study `wide`, for the truth."""
    return {
        "law": "ageing" if draw.base.q else "slip",
        "law_declared": request.noise != "wide-law",
        "velocities": len(draw.protocol.velocities),
        "stiffness_error": draw.stiffness_error,
        "quantum [m]": draw.quantum,
        "rows": len(draw.t),
    }


def _cosine(draw: Draw, refit: Refit, effects) -> float:
    """Between the structures of two effects after the base is projected out."""
    parts = [
        refit.project(simulate(draw.base, draw.protocol, {k: v}, draw.t, stress=draw.stress).record)
        for k, v in effects.items()
    ]
    norms = [float(np.linalg.norm(part)) for part in parts]
    return float(parts[0] @ parts[1]) / (norms[0] * norms[1])


def noise(rng: np.random.Generator, count: int, correlation: float) -> np.ndarray:
    """AR(1) from sample to sample, of standard deviation SIGMA at every one; 0: white."""
    drive = SIGMA * rng.standard_normal(count)
    out = drive.copy()
    for i in range(1, count if correlation else 0):
        out[i] = correlation * out[i - 1] + math.sqrt(1 - correlation**2) * drive[i]
    return out


def noise_in_time(rng: np.random.Generator, t: np.ndarray, memory: float) -> np.ndarray:
    """Ornstein-Uhlenbeck at the times `t`: covariance SIGMA^2 exp(-|t - t'|/memory)."""
    keep = np.exp(-np.diff(t, prepend=-np.inf) / memory)
    drive = SIGMA * np.sqrt(1 - keep**2) * rng.standard_normal(len(t))
    out = drive.copy()
    for i in range(1, len(t)):
        out[i] += keep[i] * out[i - 1]
    return out


def noise_of(request: Request, draw: Draw, rng: np.random.Generator) -> tuple[np.ndarray, dict]:
    """The friction's noise, and what the truth says of it."""
    if request.wide:
        white = draw.sigma * rng.standard_normal(len(draw.t))
        return white, {"correlation": 0.0, "kind": "wide"}
    if request.noise in CORRELATIONS:
        correlation = CORRELATIONS[request.noise]
        return noise(rng, len(draw.t), correlation), {"correlation": correlation}
    if request.noise == "time":
        memory = log_uniform(rng, 0.05, 2.0)
        about = {"correlation": None, "kind": "time", "memory [s]": memory}
        return noise_in_time(rng, draw.t, memory), about
    source = request.noise.removeprefix(MEASURED)
    edges = [*np.searchsorted(draw.t, draw.protocol.starts), len(draw.t)]
    cut = measured.cut(source, [int(b - a) for a, b in pairwise(edges)], rng)
    return SIGMA * cut, {"correlation": None, "kind": "measured", "source": source}


def _columns(request: Request, draw: Draw, path) -> tuple[dict[str, np.ndarray], dict]:
    """The recorded channels, and what there is to say of the noise.

    The load point is the commanded one; its encoder an extra.
    """
    rng, count = request.entropy(0, 1), len(draw.t)
    noises, about = noise_of(request, draw, rng)
    friction = path.record + noises
    blur = _ENCODER * rng.standard_normal((3, count))
    gauge = 1.0 + _GAUGE * (draw.sigma / SIGMA) * rng.standard_normal(count)
    moved = draw.protocol.displacement(draw.t) + blur[0]
    if draw.quantum:
        moved = draw.quantum * np.round(moved / draw.quantum)
    columns = {
        "time [s]": draw.t,
        "load_point_displacement [um]": moved / UM,
        "friction [1]": friction,
    }
    if "slip" in request.channels:
        columns["slip [um]"] = (path.slip + blur[1]) / UM
    if draw.stress is not None:
        columns["normal_stress [MPa]"] = _STRESS * path.stress * gauge
    if "load_point" in request.channels:
        columns["load_point_encoder [um]"] = (path.load_point + blur[2]) / UM
    return columns, about


_FORMATS = {"[s]": "%.7f", "[um]": "%.4f", "[1]": "%.7f", "[MPa]": "%.5f"}


def write(blind: Blind, out: Path) -> str:
    """Write a record, what is declared of it and its truth; return its name."""
    name = blind.request.name
    seen, hidden = out / "records" / name, out / "truth" / name
    seen.mkdir(parents=True, exist_ok=True)
    hidden.mkdir(parents=True, exist_ok=True)
    row = ",".join(_FORMATS[column.split()[-1]] for column in blind.columns)
    lines = [
        "# SYNTHETIC record, not a measurement; written by fits/blind/generate.py",
        ",".join(blind.columns),
        *(row % values for values in zip(*blind.columns.values(), strict=True)),
    ]
    (seen / "record.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    for path, content in (
        (seen / "declared.json", blind.declared),
        (hidden / "truth.json", blind.truth),
    ):
        path.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    return name


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="python -m fits.blind.generate", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("--effect", default="none", help="an id, two as in viscous+gain, or none")
    parser.add_argument("--rho", type=float, default=0.5)
    parser.add_argument("--count", type=int, default=1, help="records, with consecutive seeds")
    parser.add_argument("--seed", type=int, default=0, help="of the first")
    parser.add_argument("--noise", choices=NOISES, default="white")
    parser.add_argument("--plant", choices=PLANTS, default="quasi-static")
    parser.add_argument("--sampling", choices=SAMPLINGS, default="uniform")
    parser.add_argument("--channels", default="", help=f"of {','.join(CHANNELS)}")
    parser.add_argument("--out", type=Path, required=True)
    asked = parser.parse_args(arguments)
    effects = () if asked.effect == "none" else tuple(asked.effect.split("+"))
    channels = tuple(filter(None, asked.channels.split(",")))
    try:
        for seed in range(asked.seed, asked.seed + asked.count):
            request = Request(
                seed, effects, asked.rho, asked.noise, asked.plant, asked.sampling, channels
            )
            blind = make(request)
            print(write(blind, asked.out), f"redrawn {sum(blind.truth['redraws'].values())} times")
    except (ValueError, UnreachableError, FileNotFoundError) as error:
        parser.error(str(error))


if __name__ == "__main__":
    main()
