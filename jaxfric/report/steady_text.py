"""The friction of steady speeds as text and as steady.json."""

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
from .fit_text import noise_lines
from .report import Report
from .tables import TextTable


def report(loop: SteadyLoop, noise: SteadyNoise | None = None) -> Report:
    """The verdict, the gains it implies, the models, and the noise if requested."""
    told = (f"{loop.verdict}: {loop.sentence}", f"gains: {sentence(loop)}")
    models, *rest = tables(loop)
    notes = [f"  - {note}" for note in loop.curve.provenance.notes]
    lines = [] if noise is None else noise_text(noise, loop.curve)
    return Report(told, [*rest, models], notes=[*notes, *lines])


def sentence(loop: SteadyLoop) -> str:
    """Sentences on the gains that the friction curve requires, in the displayed units."""
    force, _, size = shown_units(loop.curve)
    rotary = loop.curve.coordinate == "rotary"
    speed = Shown("rpm", np.pi / 30) if rotary else Shown("m/s")
    unit = f"{force} s/rad" if rotary else f"{force} s/m"
    return steady_gains(loop).sentence(Shown(unit, size), speed)


def noise_text(noise: SteadyNoise, curve: SteadyCurve) -> list[str]:
    """Lines on the noise of the runs, and on the independent samples that their rows are worth."""
    what, *rest = noise_lines(noise.estimate, "the runs")
    lines = ["; ".join([what, *rest])]
    lines += turn_text(noise)
    low, middle, high = np.quantile(noise.effective / curve.effective, [0.0, 0.5, 1.0])
    lines.append(
        f"independent samples of a run: {_range(noise.effective)} by the noise of all runs,"
        f" {_range(curve.effective)} by its own rows; the errors of the means use the"
        f" second number. The ratio of the two is {middle:.2f} in the median, {low:.2f} to"
        f" {high:.2f} over the runs"
    )
    lines += step_words(noise.estimate.steps, noise.estimate.sigma, curve.provenance.path)
    return lines


def turn_text(noise: SteadyNoise) -> list[str]:
    """A line on the correlation of rows one turn apart; '' if that is not known."""
    if noise.after_a_turn is None:
        return []
    share = 100 * max(noise.after_a_turn, 0.0)
    return [f"{share:.0f} % of the variance of a run is there again one turn later"]


def _range(samples: np.ndarray) -> str:
    return f"{np.min(samples):.0f} to {np.max(samples):.0f}"


def tables(loop: SteadyLoop) -> list[TextTable]:
    """Tables of the fitted models, and of the parameters of base and final model."""
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
    models = [TextTable("Models that were fitted", head, rows, note)]
    names = list(dict.fromkeys([*loop.base.values, *loop.final.values]))
    shown = [
        (
            name,
            _value(loop.base, name, size),
            _value(loop.final, name, size),
            _unit(name, unit, speed),
        )
        for name in names
    ]
    if (load := loop.curve.load) is not None:
        per = "" if load.effect == "gravity" else f"/{speed.removesuffix('/s')}"
        for name, value, std in zip(load.names, load.values, load.std, strict=True):
            text = f"{value / size:.4g} ± {std / size:.2g}"
            shown.append((f"{load.effect}.{name}", text, text, f"{unit}{per}"))
    return [TextTable("Parameters", ("name", "before", "after", "unit"), shown), *models]


def _value(model: SteadyModel, name: str, size: float) -> str:
    if name not in model.values:
        return "–"
    value, std = model.values[name], model.std.get(name)
    size = 1.0 if name in ("vs", "n") else size
    return f"{value / size:.4g}" + ("" if std is None else f" ± {std / size:.2g}")


def _unit(name: str, force: str, speed: str) -> str:
    return {"vs": speed, "n": "", "F_v": f"{force}/({speed})", "d": f"{force}/({speed})"}.get(
        name, f"{force}/({speed})^3" if name == "c" else force
    )


def to_json(loop: SteadyLoop, noise: SteadyNoise | None = None) -> dict:
    """The content of `steady.json`, schema `schemas.STEADY`; SI or % of the rated torque.

    `noise` is that of the runs; null if it is not known.
    """
    curve, gains = loop.curve, steady_gains(loop)

    def model(m: SteadyModel) -> dict:
        return {
            "effects": m.effects,
            "parameters": {k: {"value": v, "std": m.std.get(k)} for k, v in m.values.items()},
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


def _load_json(load: Load) -> dict:
    """What the force has along the travel."""
    rows = zip(load.names, load.values, load.std, strict=True)
    return {
        "effect": load.effect,
        "parameters": {name: {"value": value, "std": std} for name, value, std in rows},
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
    if curve is None:
        return {"claim": claim.kind, "reasons": list(claim.reasons)}
    return {
        "claim": claim.kind,
        "reasons": list(claim.reasons),
        "damping": claim.damping if claim.kind == "damped" else None,
        "slope_std": curve.error,
        **entries(curve, "slowest", "fastest", "above"),
        "not_seen": curve.unseen,
    }
