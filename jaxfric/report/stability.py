"""A stability study as text (the answer, a table by velocity, all theory results) and as JSON."""

import math
from collections.abc import Sequence

import numpy as np

from ..findings import listed
from ..plain import entries, plain
from ..rig.friction import AbstractStribeck, critical_velocity, worst_slope
from ..schemas import STABILITY
from ..stability.analysis import Study
from ..stability.delay_analysis import delay_numbers, delay_summary
from ..stability.margin_table import MARGINS
from ..units import prefixed
from .report import Report
from .tables import TextTable
from .words import amount, machine

UNITS = {"kp": "N/m", "kv": "N s/m", "ki": "N/(m s)", "velocity": "m/s", "mass": "kg"}
"""Linear units of the numbers in the JSON of a slider."""
_ROWS = 9
_Number = tuple[str, object, str]
"""Name, value and linear unit of a number."""


def report(study: Study, law: str) -> Report:
    """Say whether the gains stabilise the slider or which gains would, and the critical stiffness.

    A table by velocity and all results of linear theory follow.
    """
    lines = [law, f"machine: {machine(study, study.k_p, study.k_v, study.mass)}"]
    if study.late is not None:
        lines.append(f"poles and margins have a controller delay of {prefixed(study.late, 's')}")
    return Report(_headline(study), [*_over_velocity(study), _numbers(study)], lines)


def _headline(study: Study) -> list[str]:
    """The gains that were asked about, the conclusion of the theorem, and the damping that needs
    no stiffness, at the hardest velocity."""
    at, where, told = study.here, f"at {_where(study)}", []
    if study.k_p is not None and study.margins is not None:
        word = "STABLE" if bool(study.stable) else "UNSTABLE"
        modulus = float(study.margins.get("modulus", math.nan))
        margin = f" (modulus margin {modulus:.3g})" if math.isfinite(modulus) else ""
        rig = machine(study, study.k_p, study.k_v, study.mass)
        told.append(f"{rig}: {word} {where}{margin}")
    slope = float(at.steady_slope)
    sign = "velocity weakening " if slope < 0 else "velocity strengthening " if slope > 0 else ""
    known = _stable_by_delay(study) if study.delayed else _conclusion(study)
    told.append(f"{sign}{where}: {known}")
    needed = float(at.needed_damping)
    if needed > 0:
        told.append(f"damping alone: k_v >= {amount(study, needed, 'N s/m')}, {_without(study)}")
    return [*told, *_spread(study)][:3]


def _where(study: Study) -> str:
    hardest = ", the hardest velocity" if len(study.points.velocity) > 1 else ""
    return f"{amount(study, float(study.here.velocity), 'm/s', 6)}{hardest}"


def _stable_by_delay(study: Study) -> str:
    """Which k_p are stable under a delay law: all, the first interval, or none that was found."""
    k_v, k_f = (float(x) for x in delay_numbers(study)[1:3])
    if k_v >= abs(k_f):
        return "every k_p > 0 is stable"
    found = _intervals(study)
    if not found:
        return "no stable k_p was found"
    low, high = found[0][:2]
    more = ", and in further intervals of k_p" if len(found) > 1 else ""
    return f"stable for {amount(study, low, 'N/m')} < k_p < {amount(study, high, 'N/m')}{more}"


def _conclusion(study: Study) -> str:
    """What the theorem says of k_p."""
    k_cr = float(study.theorem.critical_stiffness)
    w_cr = float(study.theorem.critical_frequency)
    if 0 < k_cr < math.inf:
        at = f"k_cr = {amount(study, k_cr, 'N/m', 10)}, w_cr = {w_cr:.10g} rad/s"
        return f"{at}: stable for k_p above k_cr, {_without(study)}"
    if not bool(study.theorem.damped):
        return "no stiffness suffices: the instantaneous damping f_v + k_v is not positive"
    if k_cr == 0:
        late = "; the delay bounds k_p and k_v" if study.late is not None else ""
        return f"stable by damping for every positive stiffness{late}"
    return "no critical stiffness: the kernel does not satisfy the theorem"


def _without(study: Study) -> str:
    """What is not in the numbers of the theorem."""
    missing = ["margins"]
    missing += [] if study.late is None else ["delay"]
    missing += [] if study.k_i is None else ["integral action"]
    return f"without {' and '.join(missing)}"


def _spread(study: Study) -> list[str]:
    """The 95 % interval of k_cr, where the law has samples."""
    ends = study.critical_interval
    if ends is None or study.sampled is None:
        return []
    low, high = (amount(study, k, "N/m") if math.isfinite(k) else "infinity" for k in ends)
    return [
        f"k_cr lies from {low} to {high} with 95 % (of {len(study.sampled)} samples of the"
        " fit's covariance)"
    ]


def _numbers(study: Study) -> TextTable:
    """All numbers of linear theory at the hardest velocity."""
    at = study.here
    rows = [
        *_of_gains(study),
        ("steady friction", at.force, "N"),
        ("f_v, instantaneous slope", at.slope, "N s/m"),
        ("G(0) = int g dt, memory", at.memory, "N s/m"),
        ("steady slope f_v - G(0)", at.steady_slope, "N s/m"),
        ("slope with slip f_x (adds to k_p)", at.friction.trend, "N/m"),
        ("k_v that needs no stiffness", at.needed_damping, "N s/m"),
        *(_delay_law(study) if study.delayed else _theorem(study)),
    ]
    if isinstance(study.law, AbstractStribeck):
        rows.append(("hardest of all velocities V_cr (16)", critical_velocity(study.law), "m/s"))
        rows.append(("f_v at V_cr (17)", worst_slope(study.law), "N s/m"))
    note = "numbers such as (18) are equations of the documentation's page 'theory'"
    if study.late is not None:
        beyond = f"rough beyond {3 / study.late:.3g}/s"
        note += f"; poles by Pade's approximant of the delay: {beyond}"
    cells = [(name, _text(value), study.unit(unit).removesuffix("1")) for name, value, unit in rows]
    return TextTable(f"Linear theory at {_where(study)}", ("", "value", "unit"), cells, note)


def _of_gains(study: Study) -> list[_Number]:
    """Stability, margins and poles with given gains."""
    if study.poles is None or study.margins is None:
        return []
    margins = [
        (f"{name} margin", study.margins[name], about.unit)
        for name, about in MARGINS.items()
        if name in study.margins and not (name == "stiffness" and study.delayed)
    ]
    poles = sorted(np.asarray(study.poles), key=lambda s: (-s.real, s.imag))
    return [("stable", study.stable, ""), *margins, *(("pole", s, "1/s") for s in poles)]


def _text(value: object) -> str:
    one = np.asarray(value).item()
    if isinstance(one, bool):
        return "yes" if one else "no"
    if isinstance(one, complex):
        if not math.isfinite(one.real):
            return "at infinity"  # a massless slider has fewer poles
        return f"{one.real:.8g}" + (
            f" {one.imag:+.8g}i" if abs(one.imag) > 1e-12 * abs(one) else ""
        )
    return f"{one:.10g}"


def _theorem(study: Study) -> list[_Number]:
    """The conditions of the theorem of Rice and Ruina, the solutions of (19) and the result."""
    found = study.theorem
    rows: list[_Number] = [
        ("g integrable and piecewise continuous, G bounded for Re s >= 0", found.integrable, ""),
        ("f_v + k_v > 0", found.damped, ""),
        ("f_v + k_v < int g dt (18); else damping alone suffices", found.underdamped, ""),
        ("all solutions of (19) found", found.complete, ""),
    ]
    for w, k in _solutions(study):
        rows += [("solution w_n of (19)", w, "rad/s"), ("k(w_n)", k, "N/m")]
    rows.append(("critical stiffness k_cr (20)", found.critical_stiffness, "N/m"))
    return [*rows, ("critical frequency w_cr", found.critical_frequency, "rad/s")]


def _delay_law(study: Study) -> list[_Number]:
    """The numbers of (26)-(31), by which stability alternates with k_p."""
    known, (_, k_v, k_f, alpha) = delay_summary(study), delay_numbers(study)
    rows: list[_Number] = [
        ("k_f", k_f, "N s/m"),
        ("alpha", alpha, "s"),
        ("damping k_v + f_v", k_v, "N s/m"),
        ("a stable k_p exists", known.exists, ""),
    ]
    for low, high, *_ in _intervals(study):
        rows += [("stable from k_p", low, "N/m"), ("stable to k_p", high, "N/m")]
    return rows if study.k_p is None else [*rows, ("unstable roots", known.unstable, "")]


def _over_velocity(study: Study) -> list[TextTable]:
    """At some of several velocities, the ends and evenly between: what holds the slider there."""
    number, points, theorems = len(study.points.velocity), study.points, study.theorems
    if number < 2:
        return []
    columns = [("velocity", points.velocity, "m/s")]
    if not study.delayed:
        columns.append(("k_cr", theorems.critical_stiffness, "N/m"))
        columns.append(("w_cr", theorems.critical_frequency, "rad/s"))
    columns.append(("k_v for all k_p", points.needed_damping, "N s/m"))
    heads = tuple(f"{name} [{study.unit(unit)}]" for name, _, unit in columns)
    rows = np.unique(np.linspace(0, number - 1, min(number, _ROWS)).round().astype(int))
    table = np.stack([np.asarray(values)[rows] for _, values, _ in columns], axis=1)
    cells = [tuple(f"{x:.6g}" for x in row) for row in table]
    note = "k_cr inf: no stiffness suffices; 0: every k_p > 0 is stable"
    return [TextTable("By velocity", heads, cells, "" if study.delayed else note)]


def _solutions(study: Study) -> list[tuple[float, float]]:
    """Solutions w_n of equation (19) [rad/s], and the stiffness k_p at each w_n [N/m]."""
    found = study.theorem
    pairs = zip(found.frequencies.tolist(), found.stiffnesses.tolist(), strict=True)
    return sorted((w, k) for w, k in pairs if math.isfinite(w))


def _intervals(study: Study) -> list[tuple[float, float, float, float]]:
    """Ends of the first stable intervals of k_p [N/m], with the frequency at each end [rad/s]."""
    if not study.delayed:
        return []
    summary = delay_summary(study)
    found, known = summary.crossings, {0.0: 0.0}
    for k, w in (
        (found.plus_stiffness, found.plus_frequency),
        (found.minus_stiffness, found.minus_frequency),
    ):
        known |= dict(zip(k.tolist(), w.tolist(), strict=True))
    ends = zip(summary.lower.tolist(), summary.upper.tolist(), strict=True)
    inf = math.inf
    return [(a, b, known.get(a, inf), known.get(b, inf)) for a, b in ends if math.isfinite(a)]


# ---- JSON --------------------------------------------------------------------------------------


def content(study: Study, law: str, warnings: Sequence[str] = ()) -> dict:
    """The content of stability.json, schema `schemas.STABILITY`; SI, null for infinite numbers.

    `warnings` are lines of text that the user should read before using the law.
    """
    here, points, theorems = study.here, study.points, study.theorems
    poles, margins = study.poles, study.margins
    result = {
        "schema": STABILITY,
        "law": law,
        **entries(study, "mass", "stable", kp="k_p", kv="k_v", controller_delay="late"),
        "ki": study.k_i or 0.0,
        "units": {name: study.unit(unit) for name, unit in (UNITS | {"force": "N"}).items()},
        **entries(here, "velocity", "needed_damping"),
        "friction": {
            **entries(here, "slope", "memory", "steady_slope", steady="force"),
            "slip_slope": here.friction.trend,
        },
        "rice_ruina_criterion": _theorem_content(study),
        "poles": poles if poles is None else np.stack([poles.real, poles.imag], axis=-1),
        "margins": margins
        if margins is None
        else {
            name: {"value": margins[name], "unit": about.unit}
            for name, about in MARGINS.items()
            if name in margins
        },
        "velocities": {
            **entries(points, "velocity", "needed_damping"),
            **entries(theorems, "critical_stiffness", "critical_frequency"),
        },
    }
    if study.delayed:
        result["delay"] = _delay_content(study)
    if isinstance(study.law, AbstractStribeck):
        result["memoryless"] = {
            "critical_velocity": critical_velocity(study.law),
            "worst_slope": worst_slope(study.law),
        }
    return plain({**result, **listed(warnings)})


def _theorem_content(study: Study) -> dict:
    found = study.theorem
    k_cr, w_cr = found.critical_stiffness, found.critical_frequency
    return {
        **entries(found, "integrable", "damped", "underdamped", "complete", "holds"),
        "critical_stiffness": None if study.delayed else k_cr,
        "critical_stiffness_interval": study.critical_interval,
        "critical_frequency": None if study.delayed else w_cr,
        "solutions": [{"frequency": w, "stiffness": k} for w, k in _solutions(study)],
    }


def _delay_content(study: Study) -> dict:
    numbers = delay_numbers(study)
    known = delay_summary(study)
    return {
        "strength": numbers[2],
        "delay": numbers[3],
        "stable_stiffness_exists": known.exists,
        "stable_intervals": [
            {"lower": a, "upper": b, "frequencies": [v, w]} for a, b, v, w in _intervals(study)
        ],
        "unstable_roots": None if study.k_p is None else int(known.unstable),
    }
