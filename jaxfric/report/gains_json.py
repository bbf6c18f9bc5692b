"""Gains as the content of gains.json."""

import numpy as np

from ..findings import listed
from ..gains.hunting import Hunting
from ..gains.result import Gains
from ..plain import entries, plain
from ..schemas import GAINS
from .stability_json import UNITS

_KINDS = ("stiffness", "damping")


def content(gains: Gains) -> dict:
    """The content of `gains.json`, schema `schemas.GAINS`; SI, null for infinite numbers."""
    region, scenarios, unsafe = gains.region, gains.scenarios, list(gains.unsafe)
    result = {
        "schema": GAINS,
        **entries(gains, "law", "kp", "kv", "norm", "fragile", "optima", controller_delay="delay"),
        "recommended": not unsafe,
        "not_recommended": unsafe,
        "ki": gains.integral or 0.0,
        "units": {name: gains.unit(unit) for name, unit in UNITS.items()},
        "scales": _pair(region.scale),
        "limits": _pair(np.stack([region.lower, region.upper], axis=1)),
        "required": dict(zip(gains.requirement.names, gains.requirement.values, strict=True)),
        "at_rest": {
            **entries(gains, "dead_band", "accuracy", friction="rest_friction"),
            "hunting": gains.hunting and hunting_entry(gains.hunting),
            "units": {"friction": gains.unit("N"), "dead_band": gains.unit("m")},
        },
        "single_gain": _alone(gains),
        "largest": gains.largest and _pair(gains.largest),
        "margins": {
            name: entries(worst, "value", "unit", worst_scenario="scenario")
            for name, worst in gains.margins.items()
        },
        "scenarios": {
            "n": len(scenarios),
            "velocities": _range(scenarios.velocity),
            "masses": None if scenarios.mass is None else _range(scenarios.mass),
            "samples": int(np.unique(scenarios.sample).size),
            **entries(gains, "confidence", "kept_samples"),
        },
        **entries(gains, "certificate", "simulation"),
        **listed(gains.warnings),
    }
    return plain(result)


def hunting_entry(found: Hunting) -> dict:
    """The JSON entry `hunting`: growth, or amplitude and period, null if no hunting is seen."""
    grows = found.amplitude is not None and not np.isfinite(found.amplitude)
    return plain({**found._asdict(), "grows": grows})


def _alone(gains: Gains) -> dict | None:
    if (known := gains.alone) is None:
        return None
    rows = zip(_KINDS, known.meets, known.tried, known.edge or (np.inf, np.inf), strict=True)
    return {
        name: {"meets": meets, "tried": tried, "without_margins": edge}
        for name, meets, tried, edge in rows
    }


def _pair(values: np.ndarray | tuple[float, float]) -> dict:
    return dict(zip(("kp", "kv"), values, strict=True))


def _range(values: np.ndarray) -> list[float]:
    return [float(np.min(values)), float(np.max(values))]
