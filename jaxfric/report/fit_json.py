"""A fit as the content of fit.json."""

from ..findings import listed
from ..fitting.result import Estimate, Fit
from ..plain import entries, plain
from ..saved.entry import ENTRY, law_entry
from ..schemas import FIT


def content(fit: Fit) -> dict:
    """The content of `fit.json`, schema `schemas.FIT`; SI, null for unknown numbers."""
    origin = fit.record.provenance
    kcr = fit.critical()
    velocity = fit.steps.velocity(fit.record.relative_time)
    noise = {"sigma": fit.noise.sigma, **fit.noise.to_json()}
    table = plain(
        {
            "schema": FIT,
            "record": {
                **origin.to_json(len(fit.record)),
                "normal_stress": fit.record.mean_normal_stress,
            },
            **entries(fit.model, "law", "states"),
            "friction_unit": fit.record.friction_unit,
            "A_minus_B": _told(fit.A_minus_B),
            "parameters": {name: _told(e) for name, e in fit.parameters.items()},
            "A_minus_B_with_trend": fit.with_trend,
            **entries(fit, "free", "covariance", "correlation"),
            "steps": entries(fit.steps, "times", "velocities"),
            "critical_stiffness": kcr.stiffness.value if fit.converged else None,
            "critical_stiffness_unit": kcr.stiffness.unit,
            **({"critical_stiffness_velocity": fit.critical_speed} if fit.critical_speed else {}),
            "critical_stiffness_interval": (kcr.stiffness.lower, kcr.stiffness.upper),
            "stiffness_over_critical_interval": (kcr.ratio.lower, kcr.ratio.upper),
            **entries(fit, "sum_of_squares", "rms"),
            "noise": noise if fit.converged else dict.fromkeys(noise),
            **entries(fit, "weighting", "converged", "iterations", "result"),
            **listed(fit.warnings),
            "findings": [one.to_json(velocity, fit.record.time) for one in fit.findings],
        }
    )
    return table | {ENTRY: law_entry(table) if fit.converged else None}


def estimated(estimate: Estimate) -> dict[str, object]:
    """An estimate as JSON; a given or undetermined parameter has no error."""
    found = entries(estimate, "value", "std", "lower", "upper", "unit", "free", "determined")
    known = estimate.free and estimate.determined
    return found if known else found | dict.fromkeys(("std", "lower", "upper"))


def _told(estimate: Estimate) -> dict[str, object]:
    """The same, and what its interval is from."""
    return estimated(estimate) | {"interval": "profile" if estimate.profiled else "covariance"}
