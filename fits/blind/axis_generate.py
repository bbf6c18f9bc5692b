"""Write records of a servo axis with a hidden effect: `python -m fits.blind.axis_generate ...`.

A record is drawn from its seed (and from what is asked of it), never from the clock:
    base        M log-uniform in [60, 140] kg, Fv log-uniform in [120, 350] N s/m (`coulomb`: 0),
                Fc uniform in [12, 32] N, offset uniform in [-5, 5] N
    drive       kv gtau/M log-uniform in [75, 115] 1/s, kp 1.3 to 2 times that, gtau 25 to 45 N/V
    reference   12 to 20 s at 1 kHz, in S-curves: two pairs of long moves and two of middling ones
                at 20 to 250 mm/s, two pairs of slow ones (1.5 to 10 mm/s), a cluster of six small
                reversals (0.1 to 1.5 mm), in random order with pauses of 0.25 to 0.7 s between
                them; travel at most 0.25 m
    encoder     quantum log-uniform in [0.1, 1] um, Gaussian error 0.1 to 0.4 of it before it
                rounds; the controller sees what is recorded, so the force answers to it
    noise       white at 1 kHz, on the recorded force only; its level (`NOISES`) is the standard
                deviation that the preparation leaves of it: 0.5, 1 or 2 N

The preparation is the usual one: position through a zero-phase Butterworth filter (fourth order,
100 Hz), central differences, then force and regressors decimated by 10 with zero phase. The
base fit is F = M a + Fv v + Fc sgn v + offset by least squares on the rows that move: faster
than 0.2 mm/s from the row before to the row after (sgn v = 0 where it is slower). A force that
is held for a period acts half a period later on average: to this fit the record of the plainest
axis is 0.5 ms early, and a small sensor delay may lower its residual.

How large the effect is: rho is the rms of what the effect adds to the residual of that fit, over
the noise's level. The axis is run with the effect and without, with a perfect encoder and no
noise, each run is fitted, and the two residuals are subtracted on the rows that move in both: what
sampling, filter and sticking leave of the base itself (some 0.6 N) cancels. The strength is scaled
until rho is within 2 % of what is asked. Of two effects each is scaled alone. A draw that cannot
reach rho with physical strengths is drawn again; the truth counts how often, and why. A bristle of
2 to 50 um leaves 0.4 to 2 N whatever the noise: rho 1 can be had of it at every level, but
neither 0.5 at low noise nor 2 at high noise.

`viscous` asks for the base plant and `coulomb` for one with Fv = 0: nothing is missing there,
and the list of effects in the truth is without them.

Files: OUT/records/NAME/record.csv and declared.json (the controller's gains), and
OUT/truth/NAME.json. NAME tells nothing of the effect.
"""

import argparse
import functools
import json
import math
import zlib
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.ndimage import minimum_filter1d
from scipy.signal import butter, decimate, filtfilt

from .axis_plants import (
    EFFECTS,
    PERIOD,
    Base,
    Controller,
    Encoder,
    RunawayError,
    Trajectory,
    simulate,
)

UM = 1e-6
MM = 1e-3
NOISES = {"low": 0.5, "medium": 1.0, "high": 2.0}  # N, after the preparation
PLANTS = ("viscous", "coulomb")
TRAVEL = 0.25  # m
REST = 0.2 * MM  # m/s
_DECIMATION = 10
_ATTEMPTS = 30
_TOLERANCE = 0.02


class UnreachableError(RuntimeError):
    """No physical strength of the effect leaves as much structure as is asked."""


@dataclass(frozen=True)
class Request:
    """What is asked of a record. `effects` holds ids, `viscous` or `coulomb`; empty: no effect."""

    seed: int
    effects: tuple[str, ...] = ()
    rho: float = 0.5
    noise: str = "medium"

    def __post_init__(self):
        known = (*PLANTS, *EFFECTS)
        for name in self.effects:
            if name not in known:
                raise ValueError(f"effect '{name}' does not exist; there are: {known}")
        if self.noise not in NOISES:
            raise ValueError(f"noise '{self.noise}' does not exist; there are: {tuple(NOISES)}")
        if len(self.effects) != len(set(self.effects)) or len(self.missing) > 2:
            raise ValueError("ask for no effect, one, or two different ones")
        if set(PLANTS) <= set(self.effects):
            raise ValueError("a plant is viscous or coulomb")
        if self.plant == "coulomb" and "direction_asymmetry" in self.missing:
            raise ValueError("without viscous friction an asymmetry is an offset, and not missing")
        if not (math.isfinite(self.rho) and self.rho > 0):
            raise ValueError(f"rho is {self.rho}; it must be positive")

    @property
    def missing(self) -> tuple[str, ...]:
        """The effects that the base lacks."""
        return tuple(name for name in self.effects if name not in PLANTS)

    @property
    def plant(self) -> str:
        return "coulomb" if "coulomb" in self.effects else "viscous"

    def entropy(self, *more: int) -> np.random.Generator:
        """Random numbers of this request. rho has no part in them: only strengths differ."""
        text = "|".join(("axis", self.plant, "+".join(self.missing), self.noise))
        return np.random.default_rng([self.seed, zlib.crc32(text.encode()), *more])

    @property
    def name(self) -> str:
        return f"{self.seed:06d}-{zlib.crc32(repr(self).encode()):08x}"


@dataclass(frozen=True)
class Move:
    """A trapezoid of velocity through a box filter: an S-curve. SI."""

    start: float
    distance: float  # signed
    speed: float
    rise: float  # the trapezoid's time to the speed
    jerk: float  # width of the box

    @property
    def span(self) -> float:
        return abs(self.distance) / self.speed + self.rise + self.jerk

    def at(self, t: np.ndarray) -> np.ndarray:
        """Displacement at the times t, from eight jumps of the jerk."""
        fall = abs(self.distance) / self.speed
        ends = ((0.0, 1), (self.jerk, -1), (self.rise, -1), (self.rise + self.jerk, 1))
        cubes = sum(
            sign * side * np.clip(t - self.start - shift - begin, 0.0, None) ** 3
            for shift, side in ((0.0, 1), (fall, -1))
            for begin, sign in ends
        )
        size = self.speed / (6.0 * self.rise * self.jerk) * cubes
        size = np.where(t >= self.start + self.span, abs(self.distance), size)
        return math.copysign(1.0, self.distance) * size


@dataclass(frozen=True)
class Draw:
    """An axis without its effects, and its reference."""

    base: Base
    controller: Controller
    encoder: Encoder
    reference: np.ndarray
    moves: tuple[Move, ...]

    @property
    def fastest(self) -> float:
        return max(move.speed for move in self.moves)

    @property
    def duration(self) -> float:
        return PERIOD * len(self.reference)

    def run(self, effects: dict, *, perfect: bool = True) -> Trajectory:
        encoder = None if perfect else self.encoder
        return simulate(self.base, self.controller, self.reference, effects, encoder=encoder)


@dataclass(frozen=True)
class Recipe:
    """How an effect is drawn.

    shape(rng, draw) : what is fixed before the strength is sought
    name : the parameter that is the strength; it vanishes with the effect
    start(draw) : strength to begin with
    limits(draw, shape) : the largest physical strength of either sign; None: one sign only
    least : the smallest physical strength
    """

    shape: Callable[[np.random.Generator, Draw], dict[str, float]]
    name: str
    start: Callable[[Draw], float]
    limits: Callable[[Draw, dict[str, float]], tuple[float, float | None]]
    least: float = 0.0

    def parameters(self, strength: float, shape: dict[str, float]) -> dict[str, float]:
        if "B/A" in shape:
            rest = {name: value for name, value in shape.items() if name != "B/A"}
            return {"A": strength, "B": strength * shape["B/A"], **rest}
        if "dFc/dFv" in shape:
            return {"dFc": strength * shape["dFc/dFv"], "dFv": strength}
        return {self.name: strength, **shape}


def _log(rng: np.random.Generator, low: float, high: float) -> float:
    return float(math.exp(rng.uniform(math.log(low), math.log(high))))


def _none(rng: np.random.Generator, draw: Draw) -> dict[str, float]:
    return {}


def _stribeck_limit(draw: Draw, shape: dict[str, float]) -> float:
    """Below Fc, and of a slope that the drive holds."""
    return min(draw.base.Fc, 0.4 * shape["vs"] * draw.controller.kv * draw.controller.gtau)


def _state_limit(draw: Draw, shape: dict[str, float]) -> float:
    """Friction stays positive where the axis slows down suddenly, of a slope that is held."""
    most = draw.base.Fc / (shape["B/A"] * math.log1p(draw.fastest / shape["v_c"]))
    slope = 0.4 * shape["v_c"] * draw.controller.kv * draw.controller.gtau
    return min(most, slope / (shape["B/A"] - 1.0))


RECIPES: dict[str, Recipe] = {
    "cubic": Recipe(
        _none,
        "c",
        lambda w: 2.0 / w.fastest**3,
        lambda w, _: (30.0 / w.fastest**3, 0.8 * w.base.Fv / (3 * w.fastest**2) or None),
    ),
    "stribeck": Recipe(
        lambda rng, w: {"vs": _log(rng, 2 * MM, 20 * MM)},
        "fs",
        lambda w: 1.0,
        lambda w, shape: (_stribeck_limit(w, shape), None),
    ),
    "direction_asymmetry": Recipe(
        lambda rng, w: {"dFc/dFv": float(rng.uniform(0.2, 0.8))},
        "dFv",
        lambda w: 0.1,
        lambda w, _: (1.2, 0.8),
    ),
    "position_periodic": Recipe(
        lambda rng, w: {
            "lambda": _log(rng, 2 * MM, 20 * MM),
            "phase": float(rng.uniform(0, 2 * math.pi)),
        },
        "a",
        lambda w: 1.0,
        lambda w, _: (0.5 * w.base.Fc, None),
    ),
    "position_dependence": Recipe(
        lambda rng, w: {"centre": 0.5 * TRAVEL},
        "p",
        lambda w: 10.0,
        lambda w, _: (1.4 * w.base.Fc / TRAVEL, 1.4 * w.base.Fc / TRAVEL),
    ),
    "presliding": Recipe(
        lambda rng, w: {"xi": float(rng.uniform(0.0, 0.5))},
        "length",
        lambda w: 15 * UM,
        lambda w, _: (50 * UM, None),
        least=2 * UM,
    ),
    "rate_and_state": Recipe(
        lambda rng, w: {
            "B/A": float(rng.uniform(1.3, 2.2)),
            "L": _log(rng, 0.1 * MM, 1 * MM),
            "v_c": _log(rng, 0.5 * MM, 3 * MM),
        },
        "A",
        lambda w: 1.0,
        lambda w, shape: (_state_limit(w, shape), None),
    ),
    "time_drift": Recipe(
        _none,
        "r",
        lambda w: 1.0 / w.duration,
        lambda w, _: (20.0 / w.duration, 20.0 / w.duration),
    ),
    "sensor_lag": Recipe(_none, "tau", lambda w: MM, lambda w, _: (0.03, None)),
    "sensor_delay": Recipe(_none, "d", lambda w: MM, lambda w, _: (0.03, None)),
}
"""By id. `sigma1` of the bristle is 2 xi (Fc M/length)^(1/2)."""


def draw_plant(rng: np.random.Generator, request: Request) -> Draw:
    """The axis of a request without its effects."""
    Fv = _log(rng, 120, 350)
    base = Base(
        M=_log(rng, 60, 140),
        Fv=Fv if request.plant == "viscous" else 0.0,
        Fc=float(rng.uniform(12, 32)),
        offset=float(rng.uniform(-5, 5)),
    )
    rate, gtau = _log(rng, 75, 115), float(rng.uniform(25, 45))
    controller = Controller(float(rng.uniform(1.3, 2.0)) * rate, rate * base.M / gtau, gtau)
    start, moves, duration = draw_moves(rng)
    reference = follow(start, moves, duration)
    quantum, part = _log(rng, 0.1, 1.0) * UM, float(rng.uniform(0.1, 0.4))
    error = part * quantum * rng.standard_normal(len(reference))
    return Draw(base, controller, Encoder(error, quantum), reference, moves)


def s_curve(start: float, distance: float, speed: float, acceleration: float, jerk: float) -> Move:
    """A move at most as fast as `speed`, slower where the distance is too short for it."""
    size = abs(distance)
    ramps = 0.5 * acceleration * (math.hypot(jerk, 2.0 * math.sqrt(size / acceleration)) - jerk)
    speed = min(speed, ramps, 0.5 * size / jerk)
    return Move(start, distance, speed, max(speed / acceleration, jerk), jerk)


def draw_moves(rng: np.random.Generator) -> tuple[float, tuple[Move, ...], float]:
    """Where the reference begins [m], its moves, and how long it lasts [s]: 12 to 20 s."""
    while True:
        start, moves = float(rng.uniform(0.0, TRAVEL)), []
        t, place, places = float(rng.uniform(0.3, 0.6)), start, [start]
        kinds = ["long", "long", "middling", "middling", "slow", "slow", "cluster"]
        for kind in rng.permutation(kinds):
            for distance, speed, acceleration, jerk in _GROUPS[kind](rng, place):
                moves.append(s_curve(t, distance, speed, acceleration, jerk))
                t, place = t + moves[-1].span, place + distance
                places.append(place)
            t += float(rng.uniform(0.25, 0.7))
        if 12.0 <= t <= 20.0 and min(places) > -1e-9 and max(places) < TRAVEL + 1e-9:
            return start, tuple(moves), t


def _pair(rng: np.random.Generator, place: float, reach, speeds, accelerations, jerks):
    """There and most of the way back, at different speeds, towards the side with more room."""
    side = 1.0 if place < 0.5 * TRAVEL else -1.0
    room = TRAVEL - place if side > 0 else place
    there = side * min(_log(rng, *reach), room)
    back = -there * float(rng.uniform(0.75, 1.0))
    how = _log(rng, *accelerations), float(rng.uniform(*jerks))
    return [(there, _log(rng, *speeds), *how), (back, _log(rng, *speeds), *how)]


def _slow(rng: np.random.Generator, place: float):
    """Half a second to a second each way at one speed."""
    speed, side = _log(rng, 1.5 * MM, 10 * MM), 1.0 if place < 0.5 * TRAVEL else -1.0
    there = side * speed * float(rng.uniform(0.5, 1.0))
    return [(part, speed, 0.3, 0.02) for part in (there, -there)]


def _cluster(rng: np.random.Generator, place: float):
    """Six small moves, each against the one before."""
    side = 1.0 if place < 0.5 * TRAVEL else -1.0
    sizes = [_log(rng, 0.1 * MM, 1.5 * MM) for _ in range(6)]
    return [
        (side * (-1) ** i * size, _log(rng, 3 * MM, 20 * MM), 0.3, 0.01)
        for i, size in enumerate(sizes)
    ]


_GROUPS: dict[str, Callable] = {
    "long": lambda rng, place: _pair(
        rng, place, (0.13, 0.24), (0.08, 0.25), (0.5, 1.5), (0.02, 0.08)
    ),
    "middling": lambda rng, place: _pair(
        rng, place, (0.01, 0.05), (0.02, 0.12), (0.4, 1.5), (0.02, 0.06)
    ),
    "slow": _slow,
    "cluster": _cluster,
}
"""Distance [m, signed], speed, acceleration and jerk time of the moves of a group."""


def follow(start: float, moves: Sequence[Move], duration: float) -> np.ndarray:
    """The reference [m], one value a period."""
    t = PERIOD * np.arange(round(duration / PERIOD))
    return start + sum((move.at(t) for move in moves), np.zeros(len(t)))


@dataclass(frozen=True)
class Fitted:
    """The base fit of inverse dynamics, on decimated rows."""

    values: tuple[float, ...]  # M, Fv, Fc, offset
    residual: np.ndarray  # N, of every row
    moving: np.ndarray  # the rows that were fitted


def fit_base(position: np.ndarray, force: np.ndarray) -> Fitted:
    """M, Fv, Fc and offset from position [m] and force [N] at 1 kHz, with the usual preparation."""
    low_pass: Any = butter(4, 2.0 * 100.0 * PERIOD)  # SciPy's annotation joins all its forms
    v = np.gradient(filtfilt(low_pass[0], low_pass[1], position), PERIOD)
    moving = np.abs(v) > REST
    columns = [np.gradient(v, PERIOD), v, np.sign(v) * moving, np.ones(len(v)), force]
    moving = minimum_filter1d(moving.astype(np.int8), 2 * _DECIMATION + 1) > 0
    *regressors, target = (_thin(column) for column in columns)
    matrix, rows = np.stack(regressors, axis=1), moving[::_DECIMATION]
    values = np.linalg.lstsq(matrix[rows], target[rows], rcond=None)[0]
    return Fitted(tuple(values.tolist()), target - matrix @ values, rows)


def _thin(column: np.ndarray) -> np.ndarray:
    return decimate(column, _DECIMATION, zero_phase=True)


@functools.cache
def noise_gain() -> float:
    """Standard deviation that the preparation leaves of white noise of 1 N."""
    count, middle = 4000, 2000  # the response dies out within some hundred samples
    phases = range(middle, middle + _DECIMATION)  # all lags are seen by one of them
    response = [_thin(np.eye(1, count, place)[0]) for place in phases]
    return float(np.linalg.norm(response))


class Gauge:
    """What effects add to the residual of the base fit, in N."""

    def __init__(self, draw: Draw):
        self.draw = draw
        self.clean = self._fit({})

    def _fit(self, effects: dict) -> Fitted:
        path = self.draw.run(effects)
        return fit_base(path.q, path.record)

    def __call__(self, effects: dict) -> np.ndarray:
        """One value a row; zero where the axis rests with the effects or without."""
        fit = self._fit(effects)
        both = fit.moving & self.clean.moving
        return np.where(both, fit.residual - self.clean.residual, 0.0) / math.sqrt(np.mean(both))

    def level(self, effects: dict) -> float:
        return math.sqrt(float(np.mean(self(effects) ** 2)))


def scale(
    effect: str, draw: Draw, gauge: Gauge, wanted: float, rng: np.random.Generator
) -> tuple[dict[str, float], float]:
    """Parameters of `effect` that leave the structure `wanted` [N]; what they leave.

    Raises `UnreachableError` beyond the largest physical strength.
    """
    recipe = RECIPES[effect]
    shape = recipe.shape(rng, draw)
    up, down = recipe.limits(draw, shape)
    sign = -1.0 if rng.random() < 0.5 and down is not None else 1.0
    limit = up if sign > 0 or down is None else down
    found: dict[float, dict[str, float]] = {}

    def level(strength: float) -> float:
        found[strength] = _finished(draw, recipe.parameters(sign * strength, shape))
        return gauge.level({effect: found[strength]})

    strength, reached = _secant(level, min(recipe.start(draw), limit), recipe.least, limit, wanted)
    return found[strength], reached


def _finished(draw: Draw, parameters: dict[str, float]) -> dict[str, float]:
    if "xi" not in parameters:
        return parameters
    length = parameters["length"]
    sigma1 = 2.0 * parameters["xi"] * math.sqrt(draw.base.Fc * draw.base.M / length)
    return {"length": length, "sigma1": sigma1}


def _secant(level, size: float, least: float, limit: float, wanted: float) -> tuple[float, float]:
    """Strength whose level is `wanted`, and that level, by secants in the logarithms of both."""
    power, before, now = 1.0, None, math.nan
    for _ in range(12):
        now = level(size)
        if abs(now / wanted - 1.0) < _TOLERANCE:
            return size, now
        if size >= limit and now < wanted:
            raise UnreachableError(f"largest strength {size:.3g} leaves {now:.3g} N")
        if size <= least and now > wanted:
            raise UnreachableError(f"smallest strength {size:.3g} leaves {now:.3g} N")
        if before is not None and before[0] != size:
            steep = math.log(now / before[1]) / math.log(size / before[0])
            power = min(max(steep, 0.3), 4.0)
        before = (size, now)
        size = min(size * min(max((wanted / now) ** (1.0 / power), 0.02), 30.0), limit)
        size = max(size, least)
    raise UnreachableError(f"no strength found; the last, {size:.3g}, leaves {now:.3g} N")


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
    last: Exception | None = None
    for attempt in range(_ATTEMPTS):
        try:
            return _attempt(request, request.entropy(attempt), redraws)
        except (RunawayError, UnreachableError) as error:
            redraws[type(error).__name__] += 1
            last = error
    raise UnreachableError(
        f"{'+'.join(request.effects) or 'no effect'} at rho = {request.rho:g}, {request.noise}"
        f" noise, seed {request.seed}: none of {_ATTEMPTS} draws reaches it ({dict(redraws)};"
        f" the last: {last})"
    )


def _attempt(request: Request, rng: np.random.Generator, redraws: Counter[str]) -> Blind:
    draw, sigma = draw_plant(rng, request), NOISES[request.noise]
    gauge = Gauge(draw)
    effects, each = {}, {}
    for effect in request.missing:
        effects[effect], left = scale(effect, draw, gauge, request.rho * sigma, rng)
        each[effect] = left / sigma
    path = draw.run(effects, perfect=False)
    columns = _columns(request, draw, path)
    fit = fit_base(path.measured, columns["motor_force [N]"])
    left = float(np.sqrt(np.mean(fit.residual[fit.moving] ** 2)))
    truth = {
        "schema": "jaxfric.blind-axis/1",
        "seed": request.seed,
        "effects": list(request.missing),
        "parameters": effects,
        "plant": request.plant,
        "rho": {
            "wanted": request.rho if effects else 0.0,
            "each": each,
            "all": gauge.level(effects) / sigma if effects else 0.0,
        },
        "cosine": _cosine(gauge, effects) if len(effects) == 2 else None,
        "base": asdict(draw.base),
        "base_fit": dict(zip(("M", "Fv", "Fc", "offset"), fit.values, strict=True)),
        "noise": {
            "level": request.noise,
            "sigma [N]": sigma,
            "sigma at 1 kHz [N]": sigma / noise_gain(),
            "residual of the base fit [N]": left,
        },
        "encoder": {
            "quantum [m]": draw.encoder.quantum,
            "error [m]": float(draw.encoder.error.std()),
        },
        "stuck": float(np.mean(path.stuck)),
        "moves": [asdict(move) for move in draw.moves],
        "redraws": dict(redraws),
    }
    gains = draw.controller
    declared = {
        "kp [1/s]": gains.kp,
        "kv [V s/m]": gains.kv,
        "gtau [N/V]": gains.gtau,
        "period [s]": PERIOD,
    }
    return Blind(request, columns, declared, truth)


def _cosine(gauge: Gauge, effects: dict) -> float:
    """Between what two effects add to the residual of the base fit."""
    one, two = (gauge({name: values}) for name, values in effects.items())
    return float(one @ two) / float(np.linalg.norm(one) * np.linalg.norm(two))


def _columns(request: Request, draw: Draw, path: Trajectory) -> dict[str, np.ndarray]:
    rng, sigma = request.entropy(0, 1), NOISES[request.noise] / noise_gain()
    return {
        "time [s]": path.t,
        "position [um]": path.measured / UM,
        "reference_position [um]": draw.reference / UM,
        "motor_force [N]": path.record + sigma * rng.standard_normal(len(path.t)),
    }


_FORMATS = {"[s]": "%.3f", "[um]": "%.4f", "[N]": "%.4f"}


def write(blind: Blind, out: Path) -> str:
    """Write a record, what is declared of it and its truth; return its name."""
    name = blind.request.name
    seen, hidden = out / "records" / name, out / "truth"
    seen.mkdir(parents=True, exist_ok=True)
    hidden.mkdir(parents=True, exist_ok=True)
    row = ",".join(_FORMATS[column.split()[-1]] for column in blind.columns)
    lines = [
        "# SYNTHETIC record, not a measurement; written by fits/blind/axis_generate.py",
        ",".join(blind.columns),
        *(row % values for values in zip(*blind.columns.values(), strict=True)),
    ]
    (seen / "record.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    for path, content in (
        (seen / "declared.json", blind.declared),
        (hidden / f"{name}.json", blind.truth),
    ):
        path.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    return name


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="python -m fits.blind.axis_generate", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("--effect", default="none", help="an id, two as in cubic+stribeck, or none")
    parser.add_argument("--rho", type=float, default=0.5)
    parser.add_argument("--count", type=int, default=1, help="records, with consecutive seeds")
    parser.add_argument("--seed", type=int, default=0, help="of the first")
    parser.add_argument("--noise", choices=NOISES, default="medium")
    parser.add_argument("--out", type=Path, required=True)
    asked = parser.parse_args(arguments)
    effects = () if asked.effect == "none" else tuple(asked.effect.split("+"))
    try:
        for seed in range(asked.seed, asked.seed + asked.count):
            blind = make(Request(seed, effects, asked.rho, asked.noise))
            print(write(blind, asked.out), f"redrawn {sum(blind.truth['redraws'].values())} times")
    except (ValueError, UnreachableError) as error:
        parser.error(str(error))


if __name__ == "__main__":
    main()
