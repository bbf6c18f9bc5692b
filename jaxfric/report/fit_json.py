"""A fit as the content of fit.json."""

from ..fitting.result import Estimate, Fit
from ..plain import plain
from ..saved.entry import ENTRY, law_entry
from ..schemas import FIT


def content(fit: Fit) -> dict:
    """The content of `fit.json`, schema `schemas.FIT`; SI, null for what is not known."""
    origin = fit.record.provenance
    kcr = fit.critical()
    velocity = fit.steps.velocity(fit.record.relative_time)
    noise = {"sigma": fit.noise.sigma, **fit.noise.to_json()}
    table = plain(
        {
            "schema": FIT,
            "record": {"path": origin.path, "sha256": origin.sha256, "rows": len(fit.record)},
            "law": fit.model.law,
            "states": fit.model.states,
            "friction_unit": fit.record.friction_unit,
            "A_minus_B": _told(fit.A_minus_B),
            "parameters": {name: _told(e) for name, e in fit.parameters.items()},
            "A_minus_B_with_trend": fit.with_trend,
            "free": fit.free,
            "covariance": fit.covariance,
            "correlation": fit.correlation,
            "steps": {"times": fit.steps.times, "velocities": fit.steps.velocities},
            "critical_stiffness": kcr.stiffness.value if fit.converged else None,
            "critical_stiffness_interval": (kcr.stiffness.lower, kcr.stiffness.upper),
            "stiffness_over_critical_interval": (kcr.ratio.lower, kcr.ratio.upper),
            "sum_of_squares": fit.sum_of_squares,
            "rms": fit.rms,
            "noise": noise if fit.converged else dict.fromkeys(noise),
            "weighting": fit.weighting,
            "converged": fit.converged,
            "iterations": fit.iterations,
            "result": fit.result,
            "warnings": fit.warnings,
        }
    )
    return table | {
        "findings": [one.to_json(velocity) for one in fit.findings],
        ENTRY: law_entry(table) if fit.converged else None,
    }


def estimated(estimate: Estimate) -> dict[str, object]:
    """An estimate; no error of what was given, or is not determined."""
    fields = ("value", "std", "lower", "upper", "unit", "free", "determined")
    found: dict[str, object] = {field: getattr(estimate, field) for field in fields}
    known = estimate.free and estimate.determined
    return found if known else found | dict.fromkeys(("std", "lower", "upper"))


def _told(estimate: Estimate) -> dict[str, object]:
    """The same, and what its interval is from."""
    return estimated(estimate) | {"interval": "profile" if estimate.profiled else "covariance"}
