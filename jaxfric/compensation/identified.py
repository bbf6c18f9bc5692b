"""The identified friction of an axis, as input of a compensation.

A loop.json of `jaxfric axis` gives the model after the loop, its covariance and the range of its
record. A steady.json of `jaxfric axis` gives the final curve, with the covariance of the runs.
"""

import dataclasses
import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ..described import said
from ..effects import effect_of
from ..errors import InputError, option
from ..findings import Finding, read_findings
from ..loop import Loop
from ..loop.axis.driven import ONE_SPEED, Driven, at_one_speed
from ..loop.findings import LoopCode
from ..loop.steady.loop import SteadyLoop
from ..loop.steady.model import curve_covariance
from ..quantity import Quantity, quantities
from ..records.steady_load import Load
from ..rig.axis import LAW, AxisRig, BaseLaw
from ..saved.entry import verdict_words
from ..saved.files import (
    missing_key,
    own_warnings,
    read_saved,
    refuse_damage,
    table_damage,
    values_of,
)
from ..schemas import LOOP, STEADY
from .units import amplitude, unit_of

Content = Mapping
"""The content of a JSON file, or a part of it."""
_BASE = BaseLaw().names()
_OF_CURVE = {"d": "direction_asymmetry.d", "c": "cubic.c"}
_OF_CURVE |= {name: f"stribeck.{name}" for name in ("fs", "vs", "n")}

_ROWS = (
    "from which rows count: slower ones have no sure sign, as the fit smooths it over half of that"
    " speed"
)
_SUPPORTED = "the slowest that the record supports"


class NothingToCompensate(InputError):
    """The model cannot be used for compensation: not converged, or its friction is invalid."""


@dataclasses.dataclass(frozen=True, eq=False)
class Identified:
    """Friction of an axis with errors and range of validity. SI; forces in `force_unit`."""

    source: str
    force_unit: str
    coordinate: str
    """ "linear" or "rotary"."""
    values: Mapping[str, float]
    """By name: M, F_v, F_c, F_0 and effect.parameter."""
    free: tuple[str, ...]
    covariance: np.ndarray
    """Covariance of the `free` parameters (p, p)."""
    loose: tuple[str, ...]
    """Parameters that the record does not determine."""
    effects: tuple[str, ...]
    width: float
    """Width of the record's smoothed sign [m/s]; 0 for steady runs."""
    slowest_row: float
    """Lowest speed of rows that count in the fit [m/s]; few may be slower than `slowest`."""
    slowest: float
    """Lowest speed at which the record supports the curve [m/s]."""
    fastest: float
    """Highest speed at which the record supports the curve [m/s]."""
    slower: str
    """The meaning of `slowest_row`, in words."""
    acceleration: float | None = None
    """Median over the strokes of the largest acceleration [m/s^2]; None: unknown."""
    middle: float = 0.0
    """Middle of the travel [m], in the position of the record."""
    points: np.ndarray | None = None
    """Measured speed, force and its error (n, 3), if the file has them."""
    damping: float | None = None
    """The drive's own k_v in force [F s/m]; None: unknown."""
    claim: str = ""
    """The sentence on stability."""
    left: tuple[float, float] | None = None
    """Rms residual of the test block, and the noise [F], if the file has them."""
    warnings: tuple[str, ...] = ()
    claims: tuple[Finding, ...] = ()
    """Friction by direction, with the rows that support it, if the file has them."""

    @property
    def length(self) -> str:
        """The unit of the position, "m" or "rad"."""
        return "rad" if self.coordinate == "rotary" else "m"

    @property
    def bends(self) -> tuple[str, ...]:
        """Speed scales of the curve (v_c, vs) that the record does not determine."""
        return tuple(name for name in self.loose if name.endswith((".v_c", ".vs")))

    @property
    def guessed(self) -> bool:
        """Whether the curve is unreliable below `slowest`, although slower rows count."""
        return bool(self.bends) and self.slowest > self.slowest_row

    def supports(self, velocity: np.ndarray) -> np.ndarray:
        """Whether the record supports the curve at velocities (n)."""
        speed, near = np.abs(velocity), 1e-9 * self.fastest
        return (speed >= self.slowest - near) & (speed <= self.fastest + near)

    def quantity(self, name: str) -> Quantity:
        """Symbol, unit and bounds of a parameter."""
        effect, _, field = name.rpartition(".")
        if not effect:
            return BaseLaw().quantity(name)
        return quantities(effect_of(effect, AxisRig))[field]

    def unit(self, name: str) -> str:
        """The unit of a parameter."""
        return unit_of(self.quantity(name), self.force_unit, self.length)

    def std(self, weights: Mapping[str, float]) -> float:
        """Standard error of a weighted sum of parameters; nan if one is undetermined."""
        if any(name in self.loose for name, weight in weights.items() if weight):
            return math.nan
        w = np.asarray([weights.get(name, 0.0) for name in self.free])
        return float(np.sqrt(max(w @ self.covariance @ w, 0.0)))

    def at_the_drive(self, gain: float, signal: str) -> "Identified":
        """Convert forces to the drive's signal: F/gain, gain in force per `signal`."""
        part = np.asarray([1 / gain if self._is_force(name) else 1.0 for name in self.free])
        points = self.points
        return dataclasses.replace(
            self,
            force_unit=signal,
            values={n: v / gain if self._is_force(n) else v for n, v in self.values.items()},
            covariance=self.covariance * np.outer(part, part),
            damping=None if self.damping is None else self.damping / gain,
            left=None if self.left is None else (self.left[0] / gain, self.left[1] / gain),
            points=None if points is None else points * np.array([1.0, 1 / gain, 1 / gain]),
        )

    def _is_force(self, name: str) -> bool:
        return amplitude(self.quantity(name))


def identified(model: str | Path | Loop | SteadyLoop) -> Identified:
    """Read the friction of a loop.json, a steady.json, a `Loop` or a `SteadyLoop`.

    Raises
    ------
    InputError : no such file, a damaged one, or one that is not of an axis.
    NothingToCompensate : the model did not converge.
    """
    if isinstance(model, SteadyLoop):
        return _of_curve(said("steady_text.to_json", model), "this curve")
    if isinstance(model, Loop):
        return _of_axis(model.to_json(), "this loop")
    if not isinstance(model, str | Path):
        raise InputError(
            "a feedforward is made of a loop.json or steady.json (its path), a Loop of an axis or a"
            f" SteadyLoop; not of a {type(model).__name__}"
        )
    path = Path(model)
    if path.is_dir():
        found = [name for name in ("loop.json", "steady.json") if (path / name).is_file()]
        hint = f"; name the file in it, {path / found[0]}" if found else ""
        raise InputError(f"{path}: is a folder{hint or ' without a loop.json or steady.json'}")
    _, content = read_saved(path, LOOP, STEADY)
    return (_of_axis if content["schema"] == LOOP else _of_curve)(content, str(path))


def _of_axis(content: Content, source: str) -> Identified:
    """The model after the loop of an axis."""
    path = Path(source)
    keys = ("law", "friction_unit", "verdict", "steps", "effects", "after", "candidates")
    refuse_damage(path, LOOP, missing_key(content, keys))
    if content["law"] != LAW:
        raise InputError(
            f"{source}: it is of a slider, not of an axis or joint; give the loop.json or"
            " steady.json of 'jaxfric axis'"
        )
    after = content["after"]
    refuse_damage(path, LOOP, table_damage(after, _BASE, "after."))
    values = values_of(after)
    effects = tuple(dict.fromkeys(n.partition(".")[0] for n in values if "." in n))
    about = content.get("axis") or {}
    refuse_damage(path, LOOP, _wrong_size(about, content["steps"]))
    if about.get("covariance") is not None:
        problem = table_damage({**after, "covariance": about["covariance"]})
        refuse_damage(path, LOOP, problem and f"axis: {problem}")
    _refuse_unconverged(content, effects, source)
    if about.get("withheld"):
        raise NothingToCompensate(f"{source}: {about['withheld']}")
    _refuse_one_speed(about, source, content["friction_unit"])
    claims = _claims(content, source)
    gains = about.get("gains") or {}
    width = float(about.get("sign_width") or 0.0)
    speeds = np.abs([float(v) for _, v in content["steps"] if float(v)])
    slowest, fastest = gains.get("slowest"), gains.get("fastest")
    if slowest is None or fastest is None:
        slowest, fastest = float(speeds.min()), max(float(speeds.max()), *_centres(content))
    covariance, own = _covariance(about, after)
    return Identified(
        source,
        str(content["friction_unit"]),
        str(about.get("coordinate", "linear")),
        values,
        tuple(after["free"]),
        covariance,
        tuple(n for n, item in after["parameters"].items() if not item.get("determined", True)),
        effects,
        width,
        2 * width or float(slowest),
        float(slowest),
        float(fastest),
        _ROWS if width else _SUPPORTED,
        about.get("acceleration"),
        _middle(content),
        None,
        (about.get("drive") or {}).get("k_v"),
        str(gains.get("sentence") or ""),
        _left(content),
        (*own_warnings(content), *verdict_words(content), *own),
        claims,
    )


def _left(content: Content) -> tuple[float, float] | None:
    """Rms residual of the test block after a loop, and its noise [F]. The noise equals the residual
    if noise alone explains it."""
    noise = content.get("noise") or {}
    sigma = noise.get("sigma_held_out") or noise.get("sigma")
    found = content["after"].get("report_rms"), sigma
    rms, sigma = (float(x) if isinstance(x, int | float) else 0.0 for x in found)
    most = noise.get("held_out_threshold") or 1.0
    return (rms, rms if rms <= most * sigma else sigma) if rms > 0 and sigma > 0 else None


def _covariance(about: Content, after: Content) -> tuple[np.ndarray, list[str]]:
    """The covariance of the model; for an older file that of single parameters, with a warning."""
    size = len(after["free"])
    told, warnings = about.get("covariance"), []
    if told is None:
        told = after["covariance"]
        warnings = [
            "the file is of an older version: its errors include other models that fit as well, so"
            " the band of friction is too wide; run 'jaxfric axis' again"
        ]
    return np.asarray(told, float).reshape(size, size), warnings


def _wrong_size(about: object, steps: object) -> str | None:
    """The first fault in entries other than the parameters, in words, or None."""
    if not isinstance(about, dict):
        return "'axis' is no table"
    gains = about.get("gains") or {}
    if not isinstance(gains, dict):
        return "'axis.gains' is no table"
    drive = about.get("drive") or {}
    if not isinstance(drive, dict):
        return "'axis.drive' is no table"
    sizes = {f"axis.{key}": about.get(key) for key in ("sign_width", "acceleration")}
    sizes["axis.drive.k_v"] = drive.get("k_v")
    sizes |= {f"axis.gains.{key}": gains.get(key) for key in ("slowest", "fastest")}
    for key, size in sizes.items():
        if size is not None and not (isinstance(size, int | float) and 0 <= size < math.inf):
            return f"'{key}' is {size!r}"
    try:
        moving = [float(v) for _, v in steps if math.isfinite(v) and v]  # ty: ignore[not-iterable]
    except (TypeError, ValueError):
        return "'steps' is no list of times and velocities"
    return None if moving else "'steps' has no motion"


def _refuse_unconverged(content: Content, effects: tuple[str, ...], source: str) -> None:
    """Raise `NothingToCompensate` if no fit of the model converged in the search."""
    candidates = content["candidates"]
    sound = isinstance(candidates, list) and all(
        isinstance(c, dict) and isinstance(c.get("effects"), list) for c in candidates
    )
    refuse_damage(Path(source), LOOP, None if sound else "the candidates are no list of models")
    same = [c for c in candidates if set(c["effects"]) == set(effects)]
    if same and not any(c.get("converged", True) for c in same):
        raise NothingToCompensate(
            f"{source}: the fit of its model did not converge, so it must not be used for"
            " compensation; run 'jaxfric axis' again, with a cleaner record or fewer effects"
            f" ({option('exclude')})"
        )


def _refuse_one_speed(about: Content, source: str, force: str) -> None:
    """Raise `NothingToCompensate` for a record with only one speed in each direction."""
    known = about.get("driven") or []
    try:
        directions = [Driven(**one) for one in known]
        single = at_one_speed(directions)
        unit = "rad/s" if about.get("coordinate") == "rotary" else "m/s"
        told = said("axis_loop_text.words_of_driven", directions, force, unit) if single else ""
    except (TypeError, ValueError):
        refuse_damage(Path(source), LOOP, "axis.driven is no list of directions")
        return
    if single:
        raise NothingToCompensate(
            f"{source}: {ONE_SPEED}, so friction is known only there ({told}); record several"
            " speeds in both directions"
        )


def _claims(content: Content, source: str) -> tuple[Finding, ...]:
    """The friction that the file claims, by direction; empty for a file without findings.

    Raises `NothingToCompensate` if its rows do not support friction at any speed.
    """
    told = content.get("findings")
    if told is None:
        return ()
    try:
        rows = int(content["record"]["rows"])
        found = read_findings(told, LoopCode.FRICTION, rows=rows)
    except (TypeError, KeyError, ValueError):
        refuse_damage(Path(source), LOOP, "the findings are no list of claims with their rows")
        return ()
    if not found:
        gains = (content.get("axis") or {}).get("gains") or {}
        said = str(gains.get("sentence") or "").strip() or "nothing is said of its friction."
        raise NothingToCompensate(
            f"{source}: no rows support its friction, so it must not be used for compensation."
            f" {said}"
        )
    return found


def _profile(content: Content, variable: str) -> list[float]:
    maps = content.get("location_map") or []
    return [
        float(c) for m in maps if m["variable"] == variable for c in m["centres"] if c is not None
    ]


def _centres(content: Content) -> list[float]:
    return [abs(c) for c in _profile(content, "velocity")]


def _middle(content: Content) -> float:
    """The middle of the travel; 0 if the file does not contain it."""
    places = _profile(content, "position")
    return 0.5 * (min(places) + max(places)) if places else 0.0


def _of_curve(content: Content, source: str) -> Identified:
    """The final curve of a steady.json; the covariance is computed again from the runs."""
    path = Path(source)
    refuse_damage(path, STEADY, missing_key(content, ("curve", "effects", "after", "gains")))
    curve, after, gains = content["curve"], content["after"], content["gains"]
    keys = ("speed", "force", "error", "force_unit", "coordinate")
    problem = missing_key(curve, keys, "curve.")
    problem = problem or missing_key(after, ("parameters", "spread"), "after.")
    problem = problem or missing_key(gains, ("slowest", "fastest"), "gains.")
    refuse_damage(path, STEADY, problem)
    if content.get("withheld"):
        raise NothingToCompensate(f"{source}: {'; '.join(map(str, content['withheld']))}")
    try:
        points = np.stack([np.asarray(curve[k], float) for k in ("speed", "force", "error")], 1)
        values = values_of(after)
        spread, ends = float(after["spread"]), (float(gains["slowest"]), float(gains["fastest"]))
        used = np.asarray(curve.get("fitted", np.ones(len(points))), bool)
        shared, load = curve.get("shared_error"), content.get("load")
        shared = None if shared is None else np.asarray(shared, float).reshape(len(points), -1)
        load = None if load is None else _load(load)
        numbers = (*values.values(), *ends)
        if not (np.isfinite(points).all() and all(map(math.isfinite, numbers)) and used.any()):
            raise ValueError
    except (TypeError, ValueError, KeyError):
        problem = f"{path}: damaged: a number of the curve is missing or no number; make it again"
        raise InputError(f"{problem} with: jaxfric axis") from None
    effects, (speed, _, error) = tuple(content["effects"]), points[used].T
    within = None if shared is None else shared[used]
    names, covariance = curve_covariance(speed, error, spread, effects, values, within)
    found = Identified(
        source,
        str(curve["force_unit"]),
        str(curve["coordinate"]),
        {_OF_CURVE.get(name, name): value for name, value in values.items()},
        tuple(_OF_CURVE.get(name, name) for name in names),
        covariance,
        (),
        effects,
        0.0,
        ends[0],
        *ends,
        "the slowest run that moved evenly",
        points=points,
        claim=str(gains.get("sentence") or ""),
    )
    return found if load is None else _with_load(found, load)


def _load(content: Content) -> Load:
    """The load along the travel from a steady.json."""
    names = tuple(content["parameters"])
    values = [content["parameters"][name]["value"] for name in names]
    arrays = [np.asarray(x, float) for x in (values, content["covariance"], content["centre"])]
    if arrays[1].shape != (len(names), len(names)) or not all(np.isfinite(x).all() for x in arrays):
        raise ValueError
    return Load(str(content["effect"]), names, *arrays)


def _with_load(about: Identified, load: Load) -> Identified:
    """Add the load along the travel; its columns are no longer centred on their mean.

    If the effect has no term for friction that changes along the travel (a joint), friction is
    that of the middle.
    """
    told = ("a", "b") if load.effect == "gravity" else ("k", "m")
    size, p = len(about.free), len(load.names)
    whole = np.zeros((size + p, size + p))
    whole[:size, :size], whole[size:, size:] = about.covariance, load.covariance
    back = np.eye(size + p)
    values = dict(about.values)
    for k, name in enumerate(load.names):
        if name in told:
            base = "F_c" if name == "m" else "F_0"
            values[base] -= load.values[k] * load.centre[k % load.both_ways]
            back[about.free.index(base), size + k] = -load.centre[k % load.both_ways]
    values |= {f"{load.effect}.{name}": 0.0 for name in told}
    values |= {
        f"{load.effect}.{name}": float(value)
        for name, value in zip(load.names, load.values, strict=True)
        if name in told
    }
    kept = [*range(size), *(size + k for k, name in enumerate(load.names) if name in told)]
    free = (*about.free, *(f"{load.effect}.{name}" for name in load.names if name in told))
    points = np.array(about.points)
    if load.effect == "gravity":  # the static map omits the weight
        points[:, 1] -= load.values[: load.both_ways] @ load.centre
    return dataclasses.replace(
        about,
        points=points,
        values=values,
        free=free,
        covariance=(back @ whole @ back.T)[np.ix_(kept, kept)],
        effects=(*about.effects, load.effect),
        middle=float(load.centre[0]) if load.effect == "position_dependence" else 0.0,
        warnings=about.warnings
        if set(load.names) <= set(told)
        else (*about.warnings, "friction changes along the travel: its middle is compensated"),
    )
