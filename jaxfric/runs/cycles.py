"""What the stick-slip of a run tells: A-B, A, B, L and K from how friction rises and drops.

In every stretch of saw teeth at one velocity the drop, the time between drops and the loading rate
are measured (`stick_slip`); the mean rises of all stretches are fitted at once under the slip and
the ageing law (`rise_fit`). The drop falls with velocity about as B - A does by its logarithm, the
slope of a rise is K, and the bend before the tip is the creep over L before a slip. Which law it is
is told where one leaves much less than the other.

Nothing is claimed where a law does not describe the rises, and where mass counts while the slider
creeps: T V of the order of L, T being the period with which the slider swings.

Not tried against a known truth: T V above a tenth of L, springs of more than half of the critical
stiffness, fewer than 60 rows a tooth, and normal stresses that differ between stretches.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..fitting.uncertainty import QUANTILE
from ..records import Record
from ..silent import silent
from ..units import measured
from .events import Event
from .holds import LAWS
from .rise_fit import RiseFit, fit_rises
from .stick_slip import Rises, find_rises
from .stiffness import MachineStiffness, departure
from .table import Cell, short
from .weighted import WeightedLine, weighted_line

_STRONG = 12.0
"""A law is preferred by so much of chi-square, in units of what the better one leaves a degree of
freedom."""
_ROUGH = 0.02
"""A fit that leaves more than this share of a drop does not describe the rises."""
_MASS = 0.3
"""Mass counts where the slider moves this share of L while it swings once."""
_HELD = 0.9
"""K L/(B - A) above which a spring is stiff enough, or nearly, for the slider not to slip."""
_AVERAGED = 0.02
"""A drop is said to be larger where rows are running means from this share of it on."""
_SMOOTHED = "rows that are running means look so, too; those of the recorder itself would tell"
_NAMES = ("A", "B", "A-B", "L", "K")


@dataclass(frozen=True, eq=False)
class StickSlip:
    """The stretches of stick-slip of a run, and their `fits` by law; `law` is the one that is
    preferred (None: neither). Of what `doubts` names, by law, nothing is claimed."""

    stretches: tuple[Rises, ...]
    fits: Mapping[str, RiseFit]
    law: str | None
    doubts: Mapping[str, str]
    unit: str = "1"
    """That of friction, "1" or "N"."""

    @property
    def used(self) -> list[Rises]:
        """The stretches that were fitted."""
        return [one for one in self.stretches if not one.why]

    @property
    def units(self) -> dict[str, tuple[str, float]]:
        """What A, B, A-B, L and K are told in, and how many of it are one SI unit."""
        force = self.unit == "N"
        amplitude = ("N", 1.0) if force else ("", 1.0)
        own = {name: amplitude for name in _NAMES}
        return own | {"L": ("um", 1e6), "K": ("N/um" if force else "1/um", 1e-6)}

    def claimed(self, law: str) -> dict[str, tuple[float, float]]:
        """Values and standard errors that the rises determine under a law (SI), by name."""
        if law not in self.fits or self.doubts.get(law):
            return {}
        fit = self.fits[law]
        both = {name: (fit.values[name], fit.errors[name]) for name in _NAMES}
        known = {n: (v, e) for n, (v, e) in both.items() if QUANTILE * e < abs(v)}
        if "A" not in known:  # it may be anything: so may B
            known.pop("B", None)
        return known


def fit_stick_slip(
    record: Record,
    events: Sequence[Event],
    *,
    progress: Callable[[str], None] = silent,
) -> StickSlip | None:
    """What the stick-slip of a run tells; None for a run that has none."""
    stretches = find_rises(record, events)
    if not stretches:
        return None
    good = [one for one in stretches if not one.why]
    fits: dict[str, RiseFit] = {}
    for law in LAWS if good else ():
        progress(f"the teeth of stick-slip, {law} law")
        fits[law] = fit_rises(good, law)
    fastest = max((one.velocity for one in good), default=0.0)
    doubts = {law: why for law, fit in fits.items() if (why := doubt_of(fit, fastest))}
    return StickSlip(stretches, fits, preferred(fits, doubts), doubts, record.friction_unit)


def doubt_of(fit: RiseFit, fastest: float) -> str:
    """Why nothing of a fit is claimed, `fastest` [m/s] being the largest velocity; else ''."""
    if not fit.converged or not np.isfinite([*fit.values.values(), *fit.errors.values()]).all():
        return "the fit did not converge"
    if fit.misfit > _ROUGH:
        return f"it leaves {100 * fit.misfit:.2g} % of a drop: it does not describe the rises"
    if fit.values["softness"] > _HELD:
        return f"K would be {fit.values['softness']:.2g} of what holds a slider steady: {_SMOOTHED}"
    way = fit.period * fastest
    if way > _MASS * fit.values["L"]:
        return (
            f"a drop would last {0.5 * fit.period:.2g} s, in which the load point moves"
            f" {0.5e6 * way:.3g} um, and L would be {1e6 * fit.values['L']:.3g} um: mass counts"
            f" while the slider creeps, or it slips slowly; {_SMOOTHED}"
        )
    return ""


def preferred(fits: Mapping[str, RiseFit], doubts: Mapping[str, str]) -> str | None:
    """The law that leaves so much less that it is told, or None."""
    known = {law: fit for law, fit in fits.items() if law not in doubts}
    if not known or not all(fit.converged for fit in fits.values()):
        return None  # what a fit left that did not end is not what its law leaves
    best = min(known, key=lambda law: known[law].chi2)
    others = [fit.chi2 for law, fit in fits.items() if law != best]
    unit = max(1.0, known[best].chi2 / known[best].freedom)
    return best if all(chi2 - known[best].chi2 > _STRONG * unit for chi2 in others) else None


def drop_by_velocity(found: StickSlip) -> WeightedLine | None:
    """The drop by log10 of velocity [m/s], a weighted line; None for fewer than three stretches,
    and velocities within a factor of two."""
    good = found.used
    x = np.log10([one.velocity for one in good])
    if len(good) < 3 or np.ptp(x) < np.log10(2):
        return None
    y = np.array([one.drops.mean() for one in good])
    return weighted_line(x, y, np.array([_error(one.drops) for one in good]))


def _error(values: np.ndarray) -> float:
    """Standard error of a mean."""
    return float(np.std(values, ddof=1) / np.sqrt(len(values)))


def disagreement(
    found: StickSlip | None, given: MachineStiffness | None, stress: float | None
) -> str | None:
    """A sentence where the stiffness that was given is not that of the teeth, else None.

    Where no stiffness is claimed, one is told that is softer than friction rises: a spring that is
    loaded at K cannot give more. `stress` is a normal stress [Pa] for teeth that have none.
    """
    if found is None or given is None or not found.fits:
        return None
    fit = found.fits[found.law or next(iter(found.fits))]
    at = fit.stress or stress
    if given.of_stress and not (at and at > 0):
        return None
    value = given.at(at)
    own = found.claimed(found.law).get("K") if found.law else None
    K, error = _loading(found, at) if own is None else own
    words = departure(value, K, error)
    if words is None or (own is None and value > K):
        return None
    unit, scale = found.units["K"]
    return (
        f"--stiffness is {words} that with which friction rises while the slider sticks,"
        f" {measured(scale * K, scale * error)} {unit}"
    )


def _loading(found: StickSlip, stress: float | None) -> tuple[float, float]:
    """How fast friction rises at least [1/m] under a normal stress, and the error of that."""
    loads = []
    for one in found.used:
        own = one.normal_stress
        share = own / stress if own and stress else 1.0
        loads.append((share * float(one.loading.mean()), share * _error(one.loading)))
    return max(loads)


def rows(found: StickSlip | None) -> list[dict[str, Cell]]:
    """A row for every stretch of stick-slip, units in the names; means and standard deviations over
    its teeth."""
    out: list[dict[str, Cell]] = []
    if found is None:
        return out
    for number, one in enumerate(found.stretches, 1):
        stress = one.normal_stress
        row: dict[str, Cell] = {
            "stretch": number,
            "from [s]": round(one.start, 4),
            "to [s]": round(one.stop, 4),
            "velocity [um/s]": short(1e6 * one.velocity),
            "normal_stress [MPa]": None if stress is None else round(stress / 1e6, 4),
            "teeth": one.count,
        }
        if not one.why:
            unit, scale = found.units["K"]
            for name, values in (
                ("drop [N]" if found.unit == "N" else "drop", one.drops),
                ("period [s]", one.periods),
                (f"loading [{unit}]", scale * one.loading),
            ):
                row[name] = short(float(values.mean()))
                row[f"scatter of {name}"] = short(float(np.std(values, ddof=1)), 4)
            if one.resolved:
                row["drop lasts [s]"] = short(one.fall, 4)
        row["result"] = one.why or "used"
        out.append(row)
    return out


def law_rows(found: StickSlip | None) -> list[dict[str, Cell]]:
    """A row for every law, units in the names; what the teeth do not determine is None."""
    out: list[dict[str, Cell]] = []
    if found is None:
        return out
    for law, fit in found.fits.items():
        row: dict[str, Cell] = {"law": law, "preferred": found.law == law}
        known = found.claimed(law)
        for name, (unit, scale) in found.units.items():
            label = f"{name} [{unit}]" if unit else name
            value, error = known.get(name, (None, None))
            row[label] = None if value is None else short(scale * value)
            row[f"std {label}"] = None if error is None else short(scale * error, 4)
        stress = fit.stress
        row["K at normal_stress [MPa]"] = None if stress is None else round(stress / 1e6, 4)
        row |= {"misfit of a drop": short(fit.misfit, 4), "chi-square": short(fit.chi2, 5)}
        out.append(row | {"freedom": fit.freedom, "result": found.doubts.get(law, "converged")})
    return out


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None


def to_json(found: StickSlip | None) -> dict[str, object] | None:
    """The stick-slip of a run as JSON values, SI; None where there is none."""
    if found is None:
        return None
    return {
        "law": found.law,
        "stretches": [
            {
                "start": one.start,
                "stop": one.stop,
                "velocity": one.velocity,
                "normal_stress": one.normal_stress,
                "drops": one.drops.tolist(),
                "periods": one.periods.tolist(),
                "swing": one.swing if one.resolved else None,
                "why": one.why,
            }
            for one in found.stretches
        ],
        "fits": {
            law: {
                "values": {name: _finite(value) for name, value in fit.values.items()},
                "errors": {name: _finite(error) for name, error in fit.errors.items()},
                "period": _finite(fit.period),
                "stress": fit.stress,
                "misfit": _finite(fit.misfit),
                "chi_square": _finite(fit.chi2),
                "freedom": fit.freedom,
                "claimed": sorted(found.claimed(law)),
                "doubt": found.doubts.get(law, ""),
            }
            for law, fit in found.fits.items()
        },
    }


def told(found: StickSlip | None) -> list[str]:
    """Lines on the stick-slip of a run."""
    if found is None:
        return []
    lines, force = [], " N" if found.unit == "N" else ""
    for one in found.stretches:
        line = f"stick-slip at {1e6 * one.velocity:.4g} um/s from {one.start:.6g} s: "
        if one.why:
            lines.append(f"{line}not used, {one.why}")
            continue
        drop, error = float(one.drops.mean()), _error(one.drops)
        every = measured(float(one.periods.mean()), _error(one.periods))
        line += f"{one.count} teeth, drop {measured(drop, error)}{force} every {every} s"
        if one.resolved:
            line += (
                f"; a drop lasts {one.fall:.2g} s: inertial, where that is half of a free swing of"
                f" {one.swing:.2g} s"
            )
        if one.averaged > max(error, _AVERAGED * drop):
            line += (
                f"; if rows are running means over as long, a drop is {drop + one.averaged:.3g}"
                f"{force}"
            )
        lines.append(line)
    if line := drop_by_velocity(found):
        way = "falls" if line.slope < 0 else "rises"
        by = f"{way} by {measured(abs(line.slope), line.error)}"
        if abs(line.slope) < QUANTILE * line.error:
            by = f"changes by less than {abs(line.slope) + QUANTILE * line.error:.2g}"
        lines.append(f"the drop {by}{force} per decade of velocity")
    laws = [found.law] if found.law else list(found.fits)
    lines += [_told_of(found, law) for law in laws]
    if len(laws) > 1 and any(found.claimed(law) for law in laws):
        lines.append("the teeth cannot tell the slip law from the ageing law")
    return lines


def _told_of(found: StickSlip, law: str) -> str:
    """What the teeth tell under one law."""
    head = f"by its teeth, {law} law"
    if found.law:
        head += " (it fits better)"
    if why := found.doubts.get(law):
        return f"{head}: nothing is claimed, {why}"
    known, fit = found.claimed(law), found.fits[law]
    parts = []
    for name, (unit, scale) in found.units.items():
        if name in known:
            value, error = known[name]
            parts.append(f"{name} {measured(scale * value, scale * error)} {unit}".rstrip())
        else:
            parts.append(f"{name} not determined")
    at = "" if fit.stress is None else f" at {fit.stress / 1e6:.4g} MPa"
    return f"{head}: {', '.join(parts)}{at}"
