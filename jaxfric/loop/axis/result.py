"""The rows of an axis record that a loop works on, and its base model."""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from ...findings import Finding
from ...fitting import Estimate
from ...fitting.axis_fit import AxisFit
from ...fitting.axis_preparation import Preparation
from ...gains.axis_result import AxisGains, Shown, StiffOptimum
from ...records import Provenance, Sampling, VelocitySteps
from ...records.axis_record import AxisRecord
from ...rig.axis import LAW
from ..family import listed
from ..result import TextTable
from .driven import ONE_SPEED, UNKNOWN, Driven, at_one_speed, words_of_driven

_APART, _FACTOR = 4.0, 1.5
_MEASURED = ("M", "F_c", "F_v")
_PAGE = "of the documentation's page 'theory'"


@dataclass(frozen=True, eq=False)
class AxisRows:
    """Decimated rows of a record (n)."""

    time: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    path: np.ndarray
    used: np.ndarray
    stuck: np.ndarray
    segment: np.ndarray
    width: float

    def steps(self) -> VelocitySteps:
        """Begin and mean velocity of every motion segment."""
        count = int(self.segment.max()) + 1
        first = [int(np.argmax(self.segment == k)) for k in range(count)]
        mean = [float(np.mean(self.velocity[self.segment == k])) for k in range(count)]
        return VelocitySteps(self.time[first] - self.time[0], np.asarray(mean))

    def warnings(self, unit: str) -> tuple[str, ...]:
        """Warnings for the user about the preparation; `unit` is that of the position."""
        share, slowest = float(np.mean(self.stuck)), f"{2 * self.width:.2g} {unit}/s"
        if share > 0.5:
            return (f"{100 * share:.0f} % of the rows are slower than {slowest} and do not count",)
        return ()

    def as_record(self, record: AxisRecord, force: np.ndarray) -> "PreparedRecord":
        """The rows as a record for reports; `force` is that of the rows (n)."""
        return PreparedRecord(
            self.time - self.time[0],
            record.force_unit,
            record.provenance,
            {"load_point_displacement": "mm" if record.coordinate == "linear" else "rad"},
            np.asarray(force)[: len(self.time)],
        )


@dataclass(frozen=True, eq=False)
class PreparedRecord:
    """The decimated rows of an axis record, as a report sees a record."""

    relative_time: np.ndarray
    friction_unit: str
    provenance: Provenance
    units: dict[str, str] = field(default_factory=dict)
    friction: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """Recorded force at the rows, which the model predicts."""

    def __len__(self) -> int:
        return len(self.relative_time)

    def sampling(self) -> Sampling:
        """Rows, duration and intervals after decimation."""
        return Sampling.of(self.relative_time)


@dataclass(frozen=True, eq=False)
class AxisBase:
    """The base model of an axis."""

    steps: VelocitySteps
    width: float
    """Width of the smoothed sign of the velocity [m/s]."""
    preparation: Preparation

    @property
    def law(self) -> str:
        """The name of the base law, "coulomb_viscous"."""
        return LAW

    def values(self) -> dict[str, float]:
        """Constants of the base that are not fitted."""
        return {"width": self.width}


class Spring(NamedTuple):
    """The force of an axis that never slid: that of a spring, of presliding or of a flexure."""

    stiffness: float
    """[F/m or F/rad]"""
    std: float
    hysteresis: float
    """Share of the force's deviation that the position leaves."""


@dataclass(frozen=True, eq=False)
class AxisDetails:
    """The two fits of base and final model, over all rows that move."""

    fits: tuple[tuple[str, AxisFit], ...]
    """Pairs of "before" or "after" and a fit."""
    preparation: Preparation
    width: float
    """Width of the smoothed sign of the velocity [m/s]."""
    record: AxisRecord
    gains: AxisGains
    notes: tuple[str, ...] = ()
    """Sentences on what was chosen in the preparation, and why."""
    loop: Mapping[str, Estimate] = field(default_factory=dict)
    """Parameters that the loop ended with, to stand beside the fits of the same model."""
    reach: float = 0.0
    """Distance between two rows where the axis is slowest [m]; a slip length is no less."""
    acceleration: float | None = None
    """Median over the strokes of their largest acceleration [m/s^2]; None where it is not told."""
    covariance: np.ndarray | None = None
    """Covariance of the free parameters after the loop, of its own model alone (p, p): what other
    models that fit as well say of the same parameters is not in it, so that it holds for the
    friction, a sum of them. None where it is not told."""
    bears: float | None = None
    """Delay of the controller [s] from which the drive's own k_p and k_v do not hold the axis at
    its worst velocity; negative: not even at once; None where they or M are not known."""
    driven: tuple[Driven, ...] = ()
    """The speeds of each direction, and friction there."""
    withheld: str = ""
    """That the force is the answer of a controller, or the spring of an axis that never slid, in
    words; '' where it moves the axis."""
    spring: Spring | None = None
    """The spring that an axis is which never slid; None where it slides."""
    claims: tuple[Finding, ...] = ()
    """Friction in each direction and stability, with the rows that support them."""

    def tables(self) -> list[TextTable]:
        """Parameters and errors of the fits, side by side."""
        fits = [fit for _, fit in self.fits]
        names = list(dict.fromkeys(name for fit in fits for name in fit.values))
        rows: list[tuple[str, ...]] = []
        rows += [(name, *(_of(fit, name) for fit in fits), self._looped(name)) for name in names]
        unit = "m" if self.record.coordinate == "linear" else "rad"
        units = {"inverse dynamics": self.record.force_unit}
        errors = (f"{100 * fit.relative_error:.4g} %" for fit in fits)
        rows.append(("relative error", *errors, ""))
        sizes = (f"{fit.rms:.3g} {units.get(fit.method, unit)}" for fit in fits)
        rows.append(("rms", *sizes, ""))
        heads = [*(f"{when}: {fit.method}" for when, fit in self.fits), "the loop"]
        note = (
            "SI. Inverse dynamics: relative to the prepared motor force; output error: relative to"
            f" the position. Cutoff {self.preparation.cutoff:.3g} Hz, one row in"
            f" {self.preparation.decimation}; the sign of the velocity is smoothed over"
            f" {self.width:.2g} {unit}/s.{self._noted()} Rows are all but those at rest, and the"
            " force acts at once, as in published fits; the loop's values are of its train block,"
            f" with its noise.{self._differing()}"
        )
        both = "The two fits" if len({fit.method for fit in fits}) > 1 else "The fit"
        fitted = TextTable(f"{both}, over all rows", ("parameter", *heads), rows, note)
        return [fitted, self._gains(unit)]

    def _least(self, force: str, unit: str) -> list[tuple[str, str, str]]:
        """The least slope, the k_v that covers it and two of its errors, the other optimum."""
        gains, drive, damping = self.gains, self.record.drive, f"{force} s/{unit}"
        k_v = gains.claim.damping
        gain = k_v / drive.gain if drive is not None and drive.gain else None
        own = _drive(gain, "V" if drive is None else drive.signal, unit)
        return [
            ("worst velocity", f"{gains.worst_velocity:.4g} {unit}/s", ""),
            ("slope of friction there", f"{gains.slope:.4g} {damping}", ""),
            ("least k_v", f"{k_v:.4g} {damping}", own),
            *_stiff_rows(gains, force, unit),
        ]

    def short(self) -> str:
        """Whether the axis stick-slips, and what holds it."""
        return f"stick-slip: {self.gains.short(*self._units())}"

    def found(self) -> str:
        """What is known where one speed a direction leaves the parameters of friction open, or the
        force is feedback; '' elsewhere."""
        if self.withheld or not at_one_speed(self.driven):
            return self.withheld
        unit = "m" if self.record.coordinate == "linear" else "rad"
        said = words_of_driven(self.driven, self.record.force_unit, f"{unit}/s")
        return f"{said}; {listed(UNKNOWN)} are not known, as {ONE_SPEED}"

    def doubt(self) -> str:
        """Mass and friction that least squares over all rows has otherwise than the loop, by more
        than their errors and a factor of 1.5; '' where none."""
        fit = self.fits[-1][1] if self.fits else None
        told = [
            f"{name} is {_shown(own.value, own.std)} by the loop and"
            f" {_shown(fit.values[name], fit.std[name])} by least squares over all rows"
            for name, own in self.loop.items()
            if fit is not None and name in _MEASURED and _far_apart(fit, name, own)
        ]
        return f"{'; '.join(told)}: neither is a measurement" if told else ""

    def doubted(self) -> bool:
        """Whether a reason against its slope concerns all speeds."""
        curve = self.gains.curve
        return curve is not None and any(np.isinf(one.speed) for one in curve.unseen)

    def _said(self) -> str:
        return self.gains.sentence(*self._units())

    def _units(self) -> tuple[Shown, Shown]:
        """The units of damping and of velocity in sentences."""
        unit = "m" if self.record.coordinate == "linear" else "rad"
        return Shown(f"{self.record.force_unit} s/{unit}"), Shown(f"{unit}/s")

    def _looped(self, name: str) -> str:
        """The value that the loop ended with, as text."""
        found = self.loop.get(name)
        if found is None:
            return ""
        return _shown(found.value, found.std) if found.determined else "undetermined"

    def _differing(self) -> str:
        """A sentence on values in which the fits differ beyond their errors, or nothing."""
        last = self.fits[-1][0]
        names = [
            name
            for name, own in self.loop.items()
            if any(_apart(fit, name, own) for when, fit in self.fits if when == last)
        ]
        if not names:
            return ""
        return (
            f" They differ by more than their errors in {', '.join(names)}: the errors of one fit"
            " do not hold for the other, and the model is not the whole truth"
        )

    def _noted(self) -> str:
        return "".join(f" {note[0].upper()}{note[1:]}." for note in self.notes)

    def _gains(self, unit: str) -> TextTable:
        """Gains in force, and the least damping that friction asks for, in both units."""
        force, drive, gains = self.record.force_unit, self.record.drive, self.gains
        damping = f"{force} s/{unit}"
        rows = [("least k_v", "nothing is said", "")]
        if gains.claim.kind != "open":
            rows = self._least(force, unit)
        if drive is not None and drive.K_d is not None:
            rows.append(
                (
                    "k_v in force",
                    f"{drive.K_d:.4g} {damping}",
                    _drive(drive.velocity_gain, drive.signal, unit),
                )
            )
        if drive is not None and drive.K_p is not None:
            damped = _drive(drive.velocity_gain, drive.signal, unit)
            own = f"{drive.position_gain:.4g} 1/s times {damped}"
            rows.append(("k_p in force", f"{drive.K_p:.4g} {force}/{unit}", own))
        if self.bears is not None:
            held = f"{1e3 * self.bears:.3g} ms" if self.bears > 0 else "none: they do not hold it"
            rows.append(("delay they bear", held, ""))
        note = self._said()
        if gains.claim.kind != "open" and gains.stiff is None:
            note += f" By equation (13) {_PAGE}"
        elif gains.claim.kind != "open":
            note += (
                f" By equation (13), (18)-(20) and (25) {_PAGE}: linear, and of an ideal drive;"
                " lags and sampling ask for more. The critical k_p at the drive is in 1/s at its"
                " k_v"
            )
        head = ("", "in force", "at the drive")
        if not any(row[-1] for row in rows):  # a drive of which nothing is known
            head, rows = head[:-1], [row[:-1] for row in rows]
        return TextTable("Gains", head, rows, note)

    def to_json(self) -> dict:
        """The entry "axis" of `loop.json`: preparation, gains and fits; `drive` is in force."""
        drive, gains = self.record.drive, self.gains
        least = {
            "worst_velocity": gains.worst_velocity,
            "slope": gains.slope,
            "least_damping": gains.least_damping,
            "velocity_gain": gains.velocity_gain,
            "stiff": _stiff_json(gains.stiff),
        }
        if gains.claim.kind == "open":
            least = dict.fromkeys(least)
        return {
            "axis": {
                "coordinate": self.record.coordinate,
                "cutoff": self.preparation.cutoff,
                "decimation": self.preparation.decimation,
                "notes": list(self.notes),
                "width": self.width,
                "reach": self.reach,
                "acceleration": self.acceleration,
                "drive": None if drive is None else {"k_p": drive.K_p, "k_v": drive.K_d},
                "bears": self.bears,
                "driven": self.driven,
                "withheld": self.withheld,
                "spring": self.spring,
                "covariance": self.covariance,
                "gains": {
                    **least,
                    "claim": gains.claim.kind,
                    "slowest": None if gains.curve is None else gains.curve.slowest,
                    "fastest": None if gains.curve is None else gains.curve.fastest,
                    "sentence": self._said(),
                },
                "fits": [
                    {
                        "model": when,
                        "method": fit.method,
                        "values": fit.values,
                        "std": {k: v if np.isfinite(v) else None for k, v in fit.std.items()},
                        "undetermined": list(fit.loose),
                        "relative_error": fit.relative_error,
                        "rms": fit.rms,
                        "converged": fit.converged,
                    }
                    for when, fit in self.fits
                ],
            }
        }


def _stiff_rows(gains: AxisGains, force: str, unit: str) -> list[tuple[str, str, str]]:
    """The optimum of stiffness, where there is one."""
    stiff = gains.stiff
    if stiff is None:
        return []
    if not np.isfinite(stiff.critical_stiffness):
        return [("critical k_p without k_v", f"none at {stiff.worst_velocity:.4g} {unit}/s", "")]
    own = "" if stiff.position_gain is None else f"{stiff.position_gain:.4g} 1/s"
    return [
        ("critical k_p without k_v", f"{stiff.critical_stiffness:.4g} {force}/{unit}", own),
        ("its worst velocity", f"{stiff.worst_velocity:.4g} {unit}/s", ""),
        ("its frequency", f"{stiff.frequency:.4g} rad/s", ""),
    ]


def _stiff_json(stiff: StiffOptimum | None) -> dict | None:
    """The values, with null where one is not finite: no stiffness suffices."""
    if stiff is None:
        return None
    values = dataclasses.asdict(stiff)
    return {k: v if v is not None and np.isfinite(v) else None for k, v in values.items()}


def _drive(gain: float | None, signal: str, unit: str) -> str:
    return "" if gain is None else f"{gain:.4g} {signal} s/{unit}"


def _apart(fit: AxisFit, name: str, own: Estimate) -> bool:
    if name not in fit.values or name in fit.loose or not own.determined:
        return False
    error = float(np.hypot(fit.std[name], own.std))
    return abs(fit.values[name] - own.value) > _APART * error


def _far_apart(fit: AxisFit, name: str, own: Estimate) -> bool:
    """Whether two fits have a parameter otherwise by more than their errors and a factor."""
    values = sorted((abs(own.value), abs(fit.values.get(name, own.value))))
    return _apart(fit, name, own) and values[1] > _FACTOR * values[0]


def _of(fit: AxisFit, name: str) -> str:
    if name in fit.loose:
        return "undetermined"
    return _shown(fit.values.get(name), fit.std.get(name))


def _shown(value: float | None, std: float | None) -> str:
    if value is None or std is None:
        return ""
    if not (np.isfinite(std) and std > 0):
        return f"{value:.4g}"
    digits = max(0, int(np.floor(np.log10(abs(value) / std)) + 2)) if value else 2
    return f"{value:.{max(digits, 2)}g} ± {std:.2g}"
