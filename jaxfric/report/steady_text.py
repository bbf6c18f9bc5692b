"""Report friction measured at steady speeds as text and as steady.json."""

from collections.abc import Iterable

import numpy as np

from ..fitting.noise import step_words
from ..gains.axis_result import AxisGains, Shown
from ..loop.steady.loop import SteadyLoop, shown_units, steady_findings, steady_gains
from ..loop.steady.model import SteadyModel
from ..loop.steady.noise import SteadyNoise
from ..plain import entries, plain
from ..records.steady import SteadyCurve
from ..records.steady_load import Load
from ..schemas import STEADY
from ..units import measured
from .fit_text import noise_lines
from .report import Report
from .tables import TextTable


def report(loop: SteadyLoop, noise: SteadyNoise | None = None) -> Report:
    """Report the verdict, the gains that follow from it, the models, and the noise if requested."""
    notes = [f"  - {note}" for note in loop.curve.provenance.notes]
    notes += [] if noise is None else noise_text(noise, loop.curve)
    told = (f"{loop.verdict}: {loop.sentence}", f"gains: {sentence(loop)}")
    return Report(told, tables(loop), notes=notes)


def sentence(loop: SteadyLoop) -> str:
    """Sentences on the gains that the friction curve requires, in the displayed units."""
    force, _, size = shown_units(loop.curve)
    rotary = loop.curve.coordinate == "rotary"
    speed = Shown("rpm", np.pi / 30) if rotary else Shown("m/s")
    unit = f"{force} s/rad" if rotary else f"{force} s/m"
    return steady_gains(loop).sentence(Shown(unit, size), speed)


def noise_text(noise: SteadyNoise, curve: SteadyCurve) -> list[str]:
    """Describe the noise of the runs, and the number of independent samples in their rows."""
    lines = ["; ".join(noise_lines(noise.estimate, "the runs")), *turn_text(noise)]
    low, middle, high = np.quantile(noise.effective / curve.effective, [0.0, 0.5, 1.0])
    ends = [f"{x.min():.0f} to {x.max():.0f}" for x in (noise.effective, curve.effective)]
    lines.append(
        f"independent samples of a run: {ends[0]} by the noise of all runs, {ends[1]} by its own"
        " rows; the errors of the means use the second number. The ratio of the two is"
        f" {middle:.2f} in the median, {low:.2f} to {high:.2f} over the runs"
    )
    steps = step_words(noise.estimate.steps, noise.estimate.sigma, curve.provenance.path)
    return [*lines, *steps]


def turn_text(noise: SteadyNoise) -> list[str]:
    """Describe the correlation of rows one turn apart; empty if the correlation is not known."""
    if noise.after_a_turn is None:
        return []
    share = 100 * max(noise.after_a_turn, 0.0)
    return [f"{share:.0f} % of the variance of a run is there again one turn later"]


def tables(loop: SteadyLoop) -> list[TextTable]:
    """Tables: parameters of base and final model; all fitted models."""
    unit, speed, size = shown_units(loop.curve)
    rows = [
        (
            " + ".join(m.effects) or "base",
            f"{m.rms / size:.4g}",
            f"{m.heldout / size:.4g}" if np.isfinite(m.heldout) else "–",
            f"{m.spread / size:.3g}",
            f"{m.bic - loop.base.bic:+.1f}".replace("-", "−"),
            "taken" if m is loop.final else "base" if m is loop.base else "",
        )
        for m in loop.candidates
    ]
    head = ("effects", f"rms [{unit}]", f"held out [{unit}]", f"spread [{unit}]", "ΔBIC", "")
    note = (
        "held out: error of predicting each run from a fit without this run and its neighbours in"
        " speed. spread: differences between runs beyond the errors of their means"
    )
    per = f"{unit}/({speed})"
    units = {"vs": speed, "n": "", "F_v": per, "d": per, "c": f"{per}^3"}
    shown = []
    for name in dict.fromkeys([*loop.base.values, *loop.final.values]):
        own = 1.0 if name in ("vs", "n") else size
        both = (_value(m.values.get(name), m.std.get(name), own) for m in (loop.base, loop.final))
        shown.append((name, *both, units.get(name, unit)))
    if (load := loop.curve.load) is not None:
        per = "" if load.effect == "gravity" else f"/{speed.removesuffix('/s')}"
        for name, value, std in zip(load.names, load.values, load.std, strict=True):
            text = _value(value, std, size)
            shown.append((f"{load.effect}.{name}", text, text, f"{unit}{per}"))
    return [
        TextTable("Parameters", ("name", "before", "after", "unit"), shown),
        TextTable("Models that were fitted", head, rows, note),
    ]


def _value(value: float | None, std: float | None, size: float) -> str:
    if value is None:
        return "–"
    return measured(value / size, 0.0 if std is None else std / size)


def to_json(loop: SteadyLoop, noise: SteadyNoise | None = None) -> dict:
    """The content of `steady.json`, schema `schemas.STEADY`; SI or % of the rated torque.

    `noise` is the noise of the runs; null if the noise is not known.
    """
    curve, gains = loop.curve, steady_gains(loop)

    def model(m: SteadyModel) -> dict:
        return {
            "effects": m.effects,
            "parameters": _parameters(m.values, m.values.values(), map(m.std.get, m.values)),
            "rms": m.rms,
            "validation_rms": m.heldout,
            "spread": m.spread,
            "delta_bic": m.bic - loop.base.bic,
        }

    table = {
        "schema": STEADY,
        "curve": {
            "path": curve.provenance.path,
            "runs": curve.names,
            **entries(curve, "force_unit", "coordinate", "speed", "force", "error"),
            "fitted": loop.used,
            "shared_error": curve.shared,
            "effective_samples": curve.effective,
            "outliers": curve.outliers,
            "notes": curve.provenance.notes,
        },
        **entries(loop, "verdict", "sentence", "withheld"),
        "findings": [one.to_json(curve.speed) for one in steady_findings(loop)],
        "stick_slip": curve.stick_slip,
        "load": None if curve.load is None else _load_json(curve.load),
        "effects": loop.final.effects,
        "before": model(loop.base),
        "after": model(loop.final),
        "candidates": [model(m) for m in loop.candidates],
        "gains": {
            **entries(gains, "worst_velocity", "slope", "least_damping"),
            **claim_json(gains),
            "sentence": sentence(loop),
        },
        "noise": None if noise is None else _noise_json(noise, curve),
    }
    return plain(table)


def _parameters(
    names: Iterable[str], values: Iterable[float], std: Iterable[float | None]
) -> dict[str, object]:
    rows = zip(names, values, std, strict=True)
    return {name: {"value": value, "std": error} for name, value, error in rows}


def _load_json(load: Load) -> dict:
    """What the force has along the travel."""
    return {
        "effect": load.effect,
        "parameters": _parameters(load.names, load.values, load.std),
        **entries(load, "covariance", "centre"),
    }


def _noise_json(noise: SteadyNoise, curve: SteadyCurve) -> dict:
    """The noise as JSON values, as in other loops; its sigma is of all rows."""
    return {
        "sigma": noise.estimate.sigma,
        **noise.estimate.to_json(),
        "effective_samples": noise.effective,
        "after_a_turn": noise.after_a_turn,
        "text": noise_text(noise, curve),
    }


def claim_json(gains: AxisGains) -> dict:
    """The claim on stability, with reasons; nan or None for undetermined values."""
    claim, curve = gains.claim, gains.curve
    told: dict[str, object] = {"claim": claim.kind, "reasons": list(claim.reasons)}
    if curve is None:
        return told
    return {
        **told,
        "damping": claim.damping if claim.kind == "damped" else None,
        "slope_std": curve.error,
        **entries(curve, "slowest", "fastest", "above"),
        "not_seen": curve.unseen,
    }
