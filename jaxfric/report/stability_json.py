"""A stability study as the content of stability.json, and what its text has in common with it."""

import math
from collections.abc import Sequence
from typing import SupportsFloat

import numpy as np

from ..rig.friction import AbstractStribeck, critical_velocity, worst_slope
from ..stability.analysis import Study
from ..stability.delay_analysis import delay_numbers, delay_summary
from ..stability.margin_table import MARGINS

SCHEMA = "jaxfric.stability/1"
INTERVALS = 4
"""Stable intervals of a delay law that are listed."""


def content(study: Study, law: str, warnings: Sequence[str] = ()) -> dict:
    """The content of stability.json, schema "jaxfric.stability/1"; SI, null for infinite.

    `warnings` are what must be known of the law before it is relied on, a line each.
    """
    here, points, theorems = study.here, study.points, study.theorems
    result = {
        "schema": SCHEMA,
        "law": law,
        "mass": study.mass,
        "kp": study.k_p,
        "kv": study.k_v,
        "velocity": float(here.velocity),
        "friction": {
            "steady": _finite(here.force),
            "slope": _finite(here.slope),
            "memory": _finite(here.memory),
            "steady_slope": _finite(here.steady_slope),
            "slip_slope": _finite(here.friction.trend),
        },
        "needed_damping": _finite(here.needed_damping),
        "theorem": _theorem_content(study),
        **_gains_content(study),
        "velocities": {
            "velocity": [_finite(V) for V in points.velocity],
            "critical_stiffness": [_finite(k) for k in theorems.critical_stiffness],
            "critical_frequency": [_finite(w) for w in theorems.critical_frequency],
            "needed_damping": [_finite(k) for k in points.needed_damping],
        },
    }
    if study.delayed:
        result["delay"] = _delay_content(study)
    if isinstance(study.law, AbstractStribeck):
        result["memoryless"] = {
            "critical_velocity": _finite(critical_velocity(study.law)),
            "worst_slope": _finite(worst_slope(study.law)),
        }
    return {**result, "warnings": list(warnings)}


def _theorem_content(study: Study) -> dict:
    found = study.theorem
    names = ("integrable", "damped", "underdamped", "complete", "holds")
    k_cr, w_cr = _finite(found.critical_stiffness), _finite(found.critical_frequency)
    return {
        **{name: bool(getattr(found, name)) for name in names},
        "critical_stiffness": None if study.delayed else k_cr,
        "critical_frequency": None if study.delayed else w_cr,
        "solutions": [{"frequency": w, "stiffness": k} for w, k in solutions(study)],
    }


def _gains_content(study: Study) -> dict:
    if study.poles is None or study.margins is None:
        return {"stable": None, "poles": None, "margins": None}
    return {
        "stable": bool(study.stable),
        "poles": [[_finite(s.real), _finite(s.imag)] for s in np.asarray(study.poles)],
        "margins": {
            name: {"value": _finite(study.margins[name]), "unit": about.unit}
            for name, about in MARGINS.items()
            if name in study.margins
        },
    }


def _delay_content(study: Study) -> dict:
    numbers = delay_numbers(study)
    known = delay_summary(study, number=INTERVALS)
    return {
        "strength": float(numbers[2]),
        "delay": float(numbers[3]),
        "stable_stiffness_exists": bool(known.exists),
        "stable_intervals": [
            {"lower": a, "upper": _finite(b), "frequencies": [_finite(v), _finite(w)]}
            for a, b, v, w in intervals(study)
        ],
        "unstable_roots": None if study.k_p is None else int(known.unstable),
    }


def _finite(value: SupportsFloat) -> float | None:
    number = float(value)
    return number if math.isfinite(number) else None


def solutions(study: Study) -> list[tuple[float, float]]:
    """Solutions w_n of (19) [rad/s] and the stiffness there [N/m]."""
    found = study.theorem
    pairs = zip(np.asarray(found.frequencies), np.asarray(found.stiffnesses), strict=True)
    return [(float(w), float(k)) for w, k in sorted(pairs) if math.isfinite(w)]


def intervals(study: Study) -> list[tuple[float, float, float, float]]:
    """Ends of the first stable intervals [N/m] and the frequencies there [rad/s]; 0 for k_p = 0."""
    if not study.delayed:
        return []
    summary = delay_summary(study, number=INTERVALS)
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
