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
from ..findings import WarningCode, warned
from ..loop import Loop
from ..loop.axis.driven import Driven, at_one_speed
from ..loop.findings import LoopCode
from ..loop.steady.loop import SteadyLoop
from ..loop.steady.model import curve_covariance
from ..quantity import Quantity, quantities
from ..records.steady_load import Load
from ..rig.axis import LAW, AxisRig, BaseLaw
from ..saved.entry import supported, verdict_words
from ..saved.files import own_warnings, read_saved, refuse_damage, table_damage, values_of
from ..schemas import LOOP, STEADY
from ..stability.reasons import ClaimReason
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
    claims: tuple[Content, ...] = ()
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
        """Whether the curve is unreliable below `slowest`, although the fit has slower rows."""
        return bool(self.bends) and self.slowest > self.slowest_row

    @property
    def supported_text(self) -> str:
        """The speed range in which the record supports the map."""
        return f"{self.slowest:.4g} to {self.fastest:.4g} {self.length}/s"

    @property
    def below(self) -> str:
        """Text on the friction map below the supported speeds."""
        speed = f"{self.length}/s"
        told = f"Below {self.slowest:.3g} {speed} the map extrapolates the fitted curve, a guess"
        told += " without errors"
        if self.slowest_row < self.slowest:
            told += f", although rows count in the fit from {self.slowest_row:.3g} {speed} on"
        return told

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
        content, source = said("steady_text.to_json", model), "this curve"
    elif isinstance(model, Loop):
        content, source = model.to_json(), "this loop"
    elif isinstance(model, str | Path):
        content, source = _content(Path(model)), str(Path(model))
    else:
        raise InputError(
            "a feedforward is made of a loop.json or steady.json (its path), a Loop of an axis or a"
            f" SteadyLoop; not of a {type(model).__name__}"
        )
    schema = content["schema"]
    try:
        return (_of_curve if schema == STEADY else _of_axis)(content, source)
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        if not isinstance(error, InputError):
            missing = isinstance(error, KeyError)
            refuse_damage(Path(source), schema, f"{error} is missing" if missing else str(error))
        raise


def _content(path: Path) -> Content:
    if path.is_dir():
        found = [name for name in ("loop.json", "steady.json") if (path / name).is_file()]
        hint = f"; name the file in it, {path / found[0]}" if found else ""
        raise InputError(f"{path}: is a folder{hint or ' without a loop.json or steady.json'}")
    return read_saved(path, LOOP, STEADY)[1]


def _size(table: Content, *path: str) -> float | None:
    """A number of at least 0 at a path of entries, or None if the file does not have it."""
    at: object = table
    for k, key in enumerate(path):
        if not isinstance(at, Mapping):
            raise TypeError(f"'{'.'.join(path[:k])}' is no table")
        at = at.get(key)
        if at is None:
            return None
    if not (isinstance(at, int | float) and 0 <= at < math.inf):
        raise TypeError(f"'{'.'.join(path)}' is {at!r}")
    return float(at)


def _of_axis(content: Content, source: str) -> Identified:
    """The model of an axis that its loop supports."""
    if content["law"] != LAW:
        raise InputError(
            f"{source}: it is of a slider, not of an axis or joint; give the loop.json or"
            " steady.json of 'jaxfric axis'"
        )
    when, about = supported(content), content.get("axis") or {}
    model = content[when]
    covariance, own = _covariance(about, model) if when == "after" else (model["covariance"], [])
    problem = table_damage({**model, "covariance": covariance}, _BASE, f"{when}.")
    refuse_damage(Path(source), LOOP, problem)
    values = values_of(model)
    effects = tuple(dict.fromkeys(n.partition(".")[0] for n in values if "." in n))
    slowest, fastest = (_size(content, "axis", "gains", x) for x in ("slowest", "fastest"))
    width, damping = _size(content, "axis", "sign_width"), _size(content, "axis", "drive", "k_v")
    acceleration = _size(content, "axis", "acceleration")
    speeds = [abs(float(v)) for _, v in content["steps"] if v]
    if not speeds:
        raise ValueError("'steps' has no motion")
    _refuse(content, about, effects, source)
    if slowest is None or fastest is None:
        centres = [abs(c) for c in _profile(content, "velocity")]
        slowest, fastest = min(speeds), max([*speeds, *centres])
    return Identified(
        source,
        str(content["friction_unit"]),
        str(about.get("coordinate", "linear")),
        values,
        tuple(model["free"]),
        np.asarray(covariance, float).reshape(len(model["free"]), -1),
        tuple(n for n, item in model["parameters"].items() if not item.get("determined", True)),
        effects,
        width or 0.0,
        2 * width if width else slowest,
        slowest,
        fastest,
        _ROWS if width else _SUPPORTED,
        acceleration,
        _middle(content),
        None,
        damping,
        _sentence(about),
        _left(content),
        (*own_warnings(content), *verdict_words(content), *own),
        _claims(content),
    )


def _sentence(about: Content) -> str:
    """What the file says of gains."""
    return str((about.get("gains") or {}).get("sentence") or "").strip()


def _left(content: Content) -> tuple[float, float] | None:
    """Rms residual of the test block after a loop, and its noise [F]. The noise equals the residual
    if noise alone explains it."""
    noise = content.get("noise") or {}
    sigma = noise.get("sigma_held_out") or noise.get("sigma")
    found = content[supported(content)].get("report_rms"), sigma
    rms, sigma = (float(x) if isinstance(x, int | float) else 0.0 for x in found)
    most = noise.get("held_out_threshold") or 1.0
    return (rms, rms if rms <= most * sigma else sigma) if rms > 0 and sigma > 0 else None


def _covariance(about: Content, after: Content) -> tuple[object, list[str]]:
    """The covariance of the model; for an older file that of single parameters, with a warning."""
    if about.get("covariance") is not None:
        return about["covariance"], []
    return after["covariance"], [warned(WarningCode.OLD_FILE)]


def _refuse(content: Content, about: Content, effects: tuple[str, ...], source: str) -> None:
    """Raise `NothingToCompensate` if no fit of the model converged in the search, if the loop
    withheld its friction, for a record with only one speed in each direction, and if the rows of
    the record do not support friction at any speed."""
    candidates = content["candidates"]
    if not isinstance(candidates, list):
        raise TypeError("the candidates are no list of models")
    same = [c for c in candidates if set(c["effects"]) == set(effects)]
    directions = [Driven(**one) for one in about.get("driven") or []]
    why = str(about.get("withheld") or "")
    if same and not any(c.get("converged", True) for c in same):
        why = "the fit of its model did not converge, so it must not be used for compensation; run"
        why += " 'jaxfric axis' again, with a cleaner record or fewer effects"
        why += f" ({option('exclude')})"
    elif not why and at_one_speed(directions):
        unit = "rad/s" if about.get("coordinate") == "rotary" else "m/s"
        told = said("axis_loop_text.words_of_driven", directions, content["friction_unit"], unit)
        why = f"{warned(ClaimReason.ONE_SPEED)}, so friction is known only there ({told});"
        why += " record several speeds in both directions"
    elif not why and content.get("findings") is not None and not _claims(content):
        why = "no rows support its friction, so it must not be used for compensation. "
        why += _sentence(about) or "nothing is said of its friction."
    if why:
        raise NothingToCompensate(f"{source}: {why}")


def _claims(content: Content) -> tuple[Content, ...]:
    """The friction that the file claims, by direction; empty for a file without findings."""
    return tuple(one for one in content.get("findings") or () if one["code"] == LoopCode.FRICTION)


def _profile(content: Content, variable: str) -> list[float]:
    maps = content.get("location_map") or []
    return [
        float(c) for m in maps if m["variable"] == variable for c in m["centres"] if c is not None
    ]


def _middle(content: Content) -> float:
    """The middle of the travel; 0 if the file does not contain it."""
    places = _profile(content, "position")
    return 0.5 * (min(places) + max(places)) if places else 0.0


def _of_curve(content: Content, source: str) -> Identified:
    """The final curve of a steady.json; the covariance is computed again from the runs."""
    if content.get("withheld"):
        raise NothingToCompensate(f"{source}: {'; '.join(map(str, content['withheld']))}")
    curve, after, gains = content["curve"], content["after"], content["gains"]
    points = np.stack([np.asarray(curve[k], float) for k in ("speed", "force", "error")], 1)
    values, spread = values_of(after), float(after["spread"])
    ends = float(gains["slowest"]), float(gains["fastest"])
    used = np.asarray(curve.get("fitted", np.ones(len(points))), bool)
    shared = curve.get("shared_error")
    shared = None if shared is None else np.asarray(shared, float).reshape(len(points), -1)
    load = None if content.get("load") is None else _load(content["load"])
    if not (np.isfinite(points).all() and np.isfinite([*values.values(), *ends]).all()):
        raise ValueError("a number of the curve is not finite")
    if not used.any():
        raise ValueError("no run was fitted")
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
        raise ValueError("the load along the travel has no finite covariance")
    return Load(str(content["effect"]), names, *arrays)


def _with_load(about: Identified, load: Load) -> Identified:
    """Add the load along the travel; its columns are no longer centred on their mean.

    If the effect has no term for friction that changes along the travel (a joint), friction is
    that of the middle.
    """
    told = ("a", "b") if load.effect == "gravity" else ("k", "m")
    kept = [k for k, name in enumerate(load.names) if name in told]
    values = {**about.values, **{f"{load.effect}.{name}": 0.0 for name in told}}
    shift = np.zeros((len(about.free), len(kept)))
    for column, k in enumerate(kept):
        base, centre = "F_c" if load.names[k] == "m" else "F_0", load.centre[k % load.both_ways]
        values[f"{load.effect}.{load.names[k]}"] = float(load.values[k])
        values[base] -= load.values[k] * centre
        shift[about.free.index(base), column] = -centre
    own = load.covariance[np.ix_(kept, kept)]
    both = shift @ own
    covariance = np.block([[about.covariance + both @ shift.T, both], [both.T, own]])
    points = np.array(about.points)
    if load.effect == "gravity":  # the static map omits the weight
        points[:, 1] -= load.values[: load.both_ways] @ load.centre
    return dataclasses.replace(
        about,
        points=points,
        values=values,
        free=(*about.free, *(f"{load.effect}.{load.names[k]}" for k in kept)),
        covariance=covariance,
        effects=(*about.effects, load.effect),
        middle=float(load.centre[0]) if load.effect == "position_dependence" else 0.0,
        warnings=about.warnings
        if set(load.names) <= set(told)
        else (*about.warnings, warned(WarningCode.MIDDLE)),
    )
