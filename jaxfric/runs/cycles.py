"""A-B, A, B, L and K from the stick-slip of a run: from the rises and drops of friction.

In every interval of saw teeth at one velocity the drop, the period and the loading rate are
measured (`stick_slip`). The mean rises of all intervals are fitted together under the slip and the
ageing law (`rise_fit`). B - A follows from the decrease of the drop with ln V, K from the slope of
a rise, and L from the creep before the tip of a rise. A law is preferred if its misfit is much
smaller than that of the other law.

No parameters are reported if the law does not describe the rises, or if inertia matters during
creep. Inertia matters if T V is of the order of L, for a slider with the period T of free
oscillation and a load point with the velocity V.

Results are not validated in four cases: a period T of free oscillation above L/(10 V), a stiffness
above half of the critical stiffness, fewer than 60 rows for each tooth, and normal stresses that
differ between intervals.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from ..findings import WarningCode, reasoned, warned
from ..fitting.stiffness import MachineStiffness, departure
from ..fitting.thresholds import ENDS, LARGEST_ERROR
from ..plain import entries, plain
from ..records import Record
from ..silent import silent
from ..units import measured
from .events import Event
from .holds import LAWS
from .reasons import RunReason
from .rise_fit import RiseFit, fit_rises
from .stick_slip import Rises, find_rises
from .table import Cell, rounded, short, with_std
from .weighted import WeightedLine, line_over_decades

_STRONG = 12.0
"""Least difference of chi-square that prefers a law, over the reduced chi-square of the better."""
_ROUGH = 0.02
"""Largest rms misfit, over the drop, of a fit that describes the rises."""
_MASS = 0.3
"""Inertia matters if the load point moves by this share of L in one period of oscillation."""
_HELD = 0.9
"""K L/(B - A) above which the spring is stiff enough, or nearly, to prevent stick-slip."""
_AVERAGED = 0.02
"""Least share of a drop by which running means must lower it for a note."""
_NAMES = ("A", "B", "A-B", "L", "K")


@dataclass(frozen=True, eq=False)
class StickSlip:
    """The intervals of stick-slip of a run, and their `fits` by law; `law` is the preferred law
    (None: no preference). `doubts` gives, by law, the reason why the law's parameters are not
    reported."""

    stretches: tuple[Rises, ...]
    fits: Mapping[str, RiseFit]
    law: str | None
    doubts: Mapping[str, str]
    unit: str = "1"
    """Unit of friction, "1" or "N"."""

    @property
    def used(self) -> list[Rises]:
        """The intervals that were fitted."""
        return [one for one in self.stretches if not one.why]

    @property
    def units(self) -> dict[str, tuple[str, float]]:
        """Printed units of A, B, A-B, L and K, and how many printed units make one SI unit."""
        force = self.unit == "N"
        amplitude = ("N", 1.0) if force else ("", 1.0)
        own = {name: amplitude for name in _NAMES}
        return own | {"L": ("um", 1e6), "K": ("N/um" if force else "1/um", 1e-6)}

    def claimed(self, law: str) -> dict[str, tuple[float, float]]:
        """Return values and errors (SI), by name, of the parameters that a law determines: their
        95 % interval is shorter than a decade."""
        if law not in self.fits or self.doubts.get(law):
            return {}
        fit = self.fits[law]
        both = {name: (fit.values[name], fit.errors[name]) for name in _NAMES}
        known = {n: (v, e) for n, (v, e) in both.items() if e < LARGEST_ERROR * abs(v)}
        if "A" not in known:  # without A, A-B does not determine B
            known.pop("B", None)
        return known


def fit_stick_slip(
    record: Record,
    events: Sequence[Event],
    *,
    progress: Callable[[str], None] = silent,
) -> StickSlip | None:
    """Fit the stick-slip of a run; None for a run without stick-slip."""
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
    """Return the reason why a fit reports no parameters, or ''; `fastest` [m/s] is the largest
    velocity."""
    if not fit.converged or not np.isfinite([*fit.values.values(), *fit.errors.values()]).all():
        return warned(RunReason.FAILED)
    if fit.misfit > _ROUGH:
        return warned(RunReason.MISFIT, misfit=fit.misfit)
    if fit.values["softness"] > _HELD:
        return warned(RunReason.STIFF, share=fit.values["softness"])
    half, L = 0.5 * fit.period, fit.values["L"]
    if 2 * half * fastest > _MASS * L:
        return warned(RunReason.INERTIA, lasts=half, moved=half * fastest, L=L)
    return ""


def preferred(fits: Mapping[str, RiseFit], doubts: Mapping[str, str]) -> str | None:
    """Return the law with a much smaller chi-square, or None."""
    known = {law: fit for law, fit in fits.items() if law not in doubts}
    if not known or not all(fit.converged for fit in fits.values()):
        return None  # the misfit of a fit that did not converge is not that of its law
    best = min(known, key=lambda law: known[law].chi2)
    others = [fit.chi2 for law, fit in fits.items() if law != best]
    unit = max(1.0, known[best].chi2 / known[best].freedom)
    return best if all(chi2 - known[best].chi2 > _STRONG * unit for chi2 in others) else None


def drop_by_velocity(found: StickSlip) -> WeightedLine | None:
    """Return the weighted line of the drop over log10 of velocity [m/s]; None for fewer than three
    intervals, or velocities within a factor of two."""
    known = [(one.velocity, *one.drop) for one in found.used]
    return line_over_decades(*np.array(known).T) if known else None


def disagreement(found: StickSlip | None, given: MachineStiffness | None) -> str | None:
    """Return a sentence if the given stiffness differs from that of the saw teeth, else None."""
    if found is None or given is None or found.law is None:
        return None
    own, stress = found.claimed(found.law).get("K"), found.fits[found.law].stress
    if own is None or (given.of_stress and stress is None):
        return None
    share = departure(given.at(stress), *own)
    if share is None:
        return None
    unit, scale = found.units["K"]
    K, error = own
    slope = f"{measured(scale * K, scale * error)} {unit}"
    return warned(WarningCode.TEETH, share=share, found=slope)


def rows(found: StickSlip) -> list[dict[str, Cell]]:
    """Return a row for every interval of stick-slip, with units in the names: means and standard
    deviations over the teeth of the interval."""
    out: list[dict[str, Cell]] = []
    for number, one in enumerate(found.stretches, 1):
        row: dict[str, Cell] = {
            "stretch": number,
            "from [s]": round(one.start, 4),
            "to [s]": round(one.stop, 4),
            "velocity [um/s]": short(one.velocity, scale=1e6),
            "normal_stress [MPa]": rounded(one.normal_stress, 1e-6),
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


def law_rows(found: StickSlip) -> list[dict[str, Cell]]:
    """Return a row for every law, with units in the names; undetermined values are None."""
    out: list[dict[str, Cell]] = []
    for law, fit in found.fits.items():
        row: dict[str, Cell] = {"law": law, "preferred": found.law == law}
        known = found.claimed(law)
        for name, (unit, scale) in found.units.items():
            label = f"{name} [{unit}]" if unit else name
            row |= with_std(label, *known.get(name, (None, None)), scale)
        row["K at normal_stress [MPa]"] = rounded(fit.stress, 1e-6)
        row |= {"misfit of a drop": short(fit.misfit, 4), "chi-square": short(fit.chi2, 5)}
        out.append(row | {"freedom": fit.freedom, "result": found.doubts.get(law, "converged")})
    return out


def to_json(found: StickSlip) -> dict[str, object]:
    """Return the stick-slip of a run as JSON values, SI."""
    own = ("start", "stop", "velocity", "normal_stress", "drops", "periods")
    stretches = [
        entries(one, *own) | {"swing": one.swing if one.resolved else None} | reasoned(one.why)
        for one in found.stretches
    ]
    return plain(
        {
            "law": found.law,
            "stretches": stretches,
            "fits": {
                law: entries(fit, "values", "errors", "period", "stress", "misfit", "freedom")
                | {
                    "chi_square": fit.chi2,
                    "claimed": sorted(found.claimed(law)),
                    **reasoned(found.doubts.get(law, ""), "doubt"),
                }
                for law, fit in found.fits.items()
            },
        }
    )


def told(found: StickSlip) -> list[str]:
    """Return lines on the stick-slip of a run."""
    lines, force = [], " N" if found.unit == "N" else ""
    for one in found.stretches:
        line = f"stick-slip at {1e6 * one.velocity:.4g} um/s from {one.start:.6g} s: "
        if one.why:
            lines.append(f"{line}not used, {one.why}")
            continue
        drop, error = one.drop
        spread = float(np.std(one.periods, ddof=1) / np.sqrt(one.count))
        every = measured(float(one.periods.mean()), spread)
        line += f"{one.count} teeth, drop {measured(drop, error)}{force} every {every} s"
        if one.resolved:
            line += (
                f"; a drop lasts {one.fall:.2g} s: inertial if the period of free oscillation is"
                f" {one.swing:.2g} s"
            )
        if one.averaged > max(error, _AVERAGED * drop):
            line += (
                f"; if rows are running means over this time, the drop is {drop + one.averaged:.3g}"
                f"{force}"
            )
        lines.append(line)
    if line := drop_by_velocity(found):
        way = "falls" if line.slope < 0 else "rises"
        by = f"{way} by {measured(abs(line.slope), line.error)}"
        half = float(stdtrit(len(found.used) - 2, ENDS[1] / 100)) * line.error  # as in `joint`
        if abs(line.slope) < half:
            by = f"changes by less than {abs(line.slope) + half:.2g}"
        lines.append(f"the drop {by}{force} per decade of velocity")
    laws = [found.law] if found.law else list(found.fits)
    lines += [_told_of(found, law) for law in laws]
    if len(laws) > 1 and any(found.claimed(law) for law in laws):
        lines.append("the teeth cannot distinguish the slip law from the ageing law")
    return lines


def _told_of(found: StickSlip, law: str) -> str:
    """Return a line on the parameters under one law."""
    head = f"from its teeth, {law} law"
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
