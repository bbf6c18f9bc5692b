"""Make the content of stability.json; `report.stability_text` uses parts of this module, too."""

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

UNITS = {"kp": "N/m", "kv": "N s/m", "ki": "N/(m s)", "velocity": "m/s", "mass": "kg"}
"""Linear units of the numbers in the JSON of a slider."""


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
        "solutions": [{"frequency": w, "stiffness": k} for w, k in solutions(study)],
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
    """Solutions w_n of equation (19) [rad/s], and the stiffness k_p at each w_n [N/m]."""
    found = study.theorem
    pairs = zip(found.frequencies.tolist(), found.stiffnesses.tolist(), strict=True)
    return sorted((w, k) for w, k in pairs if math.isfinite(w))


def intervals(study: Study) -> list[tuple[float, float, float, float]]:
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
