"""A stability study as the content of stability.json, with functions that its text uses too."""

import math
from collections.abc import Sequence

import numpy as np

from ..plain import entries, plain
from ..rig.friction import AbstractStribeck, critical_velocity, worst_slope
from ..schemas import STABILITY
from ..stability.analysis import Study
from ..stability.delay_analysis import delay_numbers, delay_summary
from ..stability.margin_table import MARGINS


def content(study: Study, law: str, warnings: Sequence[str] = ()) -> dict:
    """The content of stability.json, schema `schemas.STABILITY`; SI, null for infinite numbers.

    `warnings` are lines to read before using the law.
    """
    here, points, theorems = study.here, study.points, study.theorems
    result = {
        "schema": STABILITY,
        "law": law,
        "mass": study.mass,
        "kp": study.k_p,
        "kv": study.k_v,
        "ki": study.k_i or 0.0,
        "units": {
            "kp": study.unit("N/m"),
            "kv": study.unit("N s/m"),
            "ki": study.unit("N/(m s)"),
            "velocity": study.unit("m/s"),
            "mass": study.unit("kg"),
            "force": study.unit("N"),
        },
        "controller_delay": study.late,
        "velocity": here.velocity,
        "friction": {
            "steady": here.force,
            **entries(here, "slope", "memory", "steady_slope"),
            "slip_slope": here.friction.trend,
        },
        "needed_damping": here.needed_damping,
        "theorem": _theorem_content(study),
        **_gains_content(study),
        "velocities": {
            "velocity": points.velocity,
            **entries(theorems, "critical_stiffness", "critical_frequency"),
            "needed_damping": points.needed_damping,
        },
    }
    if study.delayed:
        result["delay"] = _delay_content(study)
    if isinstance(study.law, AbstractStribeck):
        result["memoryless"] = {
            "critical_velocity": critical_velocity(study.law),
            "worst_slope": worst_slope(study.law),
        }
    return plain({**result, "warnings": warnings})


def _theorem_content(study: Study) -> dict:
    found = study.theorem
    k_cr, w_cr = found.critical_stiffness, found.critical_frequency
    return {
        **entries(found, "integrable", "damped", "underdamped", "complete", "holds"),
        "critical_stiffness": None if study.delayed else k_cr,
        "critical_stiffness_interval": study.critical_interval,
        "critical_frequency": None if study.delayed else w_cr,
        "solutions": [{"frequency": w, "stiffness": k} for w, k in solutions(study)],
    }


def _gains_content(study: Study) -> dict:
    if study.poles is None or study.margins is None:
        return {"stable": None, "poles": None, "margins": None}
    return {
        "stable": study.stable,
        "poles": [[s.real, s.imag] for s in np.asarray(study.poles)],
        "margins": {
            name: {"value": study.margins[name], "unit": about.unit}
            for name, about in MARGINS.items()
            if name in study.margins
        },
    }


def _delay_content(study: Study) -> dict:
    numbers = delay_numbers(study)
    known = delay_summary(study)
    return {
        "strength": numbers[2],
        "delay": numbers[3],
        "stable_stiffness_exists": known.exists,
        "stable_intervals": [
            {"lower": a, "upper": b, "frequencies": [v, w]} for a, b, v, w in intervals(study)
        ],
        "unstable_roots": None if study.k_p is None else int(known.unstable),
    }


def solutions(study: Study) -> list[tuple[float, float]]:
    """Solutions w_n of equation (19) [rad/s], and the stiffness at each [N/m]."""
    found = study.theorem
    pairs = zip(np.asarray(found.frequencies), np.asarray(found.stiffnesses), strict=True)
    return [(float(w), float(k)) for w, k in sorted(pairs) if math.isfinite(w)]


def intervals(study: Study) -> list[tuple[float, float, float, float]]:
    """Ends of the first stable intervals [N/m] and the frequencies there [rad/s]; 0 for k_p = 0."""
    if not study.delayed:
        return []
    summary = delay_summary(study)
    lower, upper, found = np.asarray(summary.lower), np.asarray(summary.upper), summary.crossings
    known = {0.0: 0.0}
    for branch in ("plus", "minus"):
        k = np.asarray(getattr(found, f"{branch}_stiffness"))
        w = np.asarray(getattr(found, f"{branch}_frequency"))
        known |= {float(a): float(b) for a, b in zip(k, w, strict=True)}
    rows = zip(lower, upper, strict=True)
    return [
        (float(a), float(b), known.get(float(a), math.inf), known.get(float(b), math.inf))
        for a, b in rows
        if math.isfinite(a)
    ]
