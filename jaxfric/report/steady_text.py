"""Report friction measured at steady speeds as text and as steady.json."""

from collections.abc import Mapping

import numpy as np

from ..findings import listed
from ..fitting.noise import step_words
from ..loop.steady.loop import (
    FEWEST,
    FEWEST_OF_EACH,
    STEADY_EFFECTS,
    Doubt,
    SteadyLoop,
    driving,
    shown_units,
    steady_findings,
    steady_gains,
)
from ..loop.steady.model import SteadyModel
from ..loop.steady.noise import SteadyNoise
from ..loop.thresholds import ACCEPT
from ..plain import entries, plain
from ..records.steady import SteadyCurve
from ..records.steady_load import Load
from ..schemas import STEADY
from ..units import measured
from .estimates import signed
from .fit_text import noise_lines
from .report import Report
from .tables import TextTable
from .words import capital, say


def report(loop: SteadyLoop, noise: SteadyNoise | None = None) -> Report:
    """Report the verdict, the gains that follow from it, the models, and the noise if requested."""
    notes = [f"  - {note}" for note in loop.curve.provenance.notes]
    notes += [] if noise is None else noise_text(noise, loop.curve)
    told = (f"{loop.verdict}: {loop.sentence}", f"gains: {sentence(loop)}")
    return Report(told, tables(loop), notes=notes)


def verdict(loop: SteadyLoop) -> str:
    """The verdict in words."""
    curve, counted = loop.curve, Doubt.COUNTED in loop.doubts
    parts = [slips(curve, counted)] if curve.stick_slip else []
    if not counted:
        parts += [f"{capital('; '.join(withheld(loop)))}."] if loop.doubts else []
        parts.append(_found(loop))
        parts += [] if curve.load is None else [_loaded(curve, curve.load)]
    return " ".join(parts)


def withheld(loop: SteadyLoop) -> tuple[str, ...]:
    """Say why the fit gives neither friction nor gains; empty if the fit gives both."""
    own = {Doubt.WANDERS: wanders(loop.curve), Doubt.COUNTED: say("steady.counted")}
    return tuple(own[one] if one in own else _drives(loop) for one in loop.doubts)


def wanders(curve: SteadyCurve) -> str:
    """Say that the force drifts within the runs."""
    placed = bool(curve.rows) and all(rows.position is not None for rows in curve.rows)
    record = "longer runs" if placed else "the position as well"
    return say("steady.wanders", worth=np.median(curve.effective), record=record)


def _drives(loop: SteadyLoop) -> str:
    """That the fitted friction would drive the axis."""
    unit, shown, one = shown_units(loop.curve)
    found = driving(loop.curve, loop.final)
    assert found is not None
    speed, force, std = found
    where = "" if speed is None else f" at {speed:.3g} {shown}"
    return say("steady.drives", where=where, force=measured(force / one, std / one), unit=unit)


def slips(curve: SteadyCurve, counted: bool) -> str:
    """Name the speeds at which runs stick-slip, and each run's share of time at rest.

    `counted` says whether the fit includes the runs that stick-slip.
    """
    unit = shown_units(curve)[1]
    slow = sorted(curve.stick_slip, key=lambda one: abs(one.speed))
    each = "; ".join(say("steady.rests", unit=unit, **one._asdict()) for one in slow)
    how = say("steady.counted" if counted else "steady.not_counted")
    return f"Stick-slip: {each}; {how}."


def _loaded(curve: SteadyCurve, load: Load) -> str:
    """What the force has along the travel, and that it is taken out."""
    unit, shown, one = shown_units(curve)
    size, std = load.size()
    if load.effect == "gravity":
        what = f"the sine of the angle, {measured(size / one, std / one)} {unit} at most"
    else:
        slope = measured(load.values[0] / one, std / one)
        what = f"the position, {slope} {unit}/{shown.removesuffix('/s')}"
    return say("steady.loaded", what=what)


def _found(loop: SteadyLoop) -> str:
    """The sentence of the fitted runs alone, with its values."""
    base, final = loop.base, loop.final
    unit, speed, size = shown_units(loop.curve)
    refused = [e for e in ("stribeck", "direction_asymmetry") if e not in final.effects]
    known = ", ".join(
        f"{name} = {measured(base.values[name] / size, base.std[name] / size)} {own}"
        for name, own in (("F_c", unit), ("F_v", f"{unit}/({speed})"), ("F_0", unit))
    )
    return say(
        f"steady.{loop.found}",
        untested=f"Whether friction lacks an effect ({', '.join(STEADY_EFFECTS)}) is not tested",
        known=known,
        before=f"{base.rms / size:.3g}",
        after=f"{final.rms / size:.3g}",
        unit=unit,
        fewest=FEWEST,
        of_each=FEWEST_OF_EACH,
        effects=" and ".join(loop.added),
        gain=base.bic - final.bic,
        accept=ACCEPT,
        lower=loop.lower,
        rest=f" Not supported: {', '.join(refused)}." if refused else "",
    )


def sentence(loop: SteadyLoop) -> str:
    """Sentences on the gains that the friction curve requires, in the displayed units."""
    speed = "rpm" if loop.curve.coordinate == "rotary" else "m/s"
    return steady_gains(loop).sentence(loop.curve.force_unit, speed)


def noise_text(noise: SteadyNoise, curve: SteadyCurve) -> list[str]:
    """Describe the noise of the runs, and the number of independent samples in their rows."""
    lines = ["; ".join(noise_lines(noise.estimate, "the runs")), *turn_text(noise)]
    ends = [f"{x.min():.0f} to {x.max():.0f}" for x in (noise.effective, curve.effective)]
    lines.append(say("steady.samples", all=ends[0], own=ends[1]))
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
            signed(m.bic - loop.base.bic),
            "taken" if m is loop.final else "base" if m is loop.base else "",
        )
        for m in loop.candidates
    ]
    head = ("effects", f"rms [{unit}]", f"held out [{unit}]", f"spread [{unit}]", "ΔBIC", "")
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
        TextTable("Models that were fitted", head, rows, say("note.steady")),
    ]


def _value(value: float | None, std: float | None, size: float) -> str:
    if value is None:
        return "–"
    return measured(value / size, 0.0 if std is None else std / size)


def to_json(loop: SteadyLoop, noise: SteadyNoise | None = None) -> dict:
    """The content of `steady.json`, schema `schemas.STEADY`; SI or % of the rated torque.

    `noise` is the noise of the runs; null if the noise is not known.
    """
    curve, gains, load = loop.curve, steady_gains(loop), loop.curve.load
    valid = gains.curve
    assert valid is not None  # `steady_gains` states it always

    def model(m: SteadyModel) -> dict:
        return {
            **entries(m, "effects", "rms", "spread", validation_rms="heldout"),
            "parameters": parameters(m.values, m.std),
            "delta_bic": m.bic - loop.base.bic,
        }

    def parameters(values: Mapping[str, float], std: Mapping[str, float]) -> dict:
        return {name: {"value": value, "std": std.get(name)} for name, value in values.items()}

    table = {
        "schema": STEADY,
        "curve": {
            **entries(curve, "force_unit", "coordinate", "speed", "force", "error", "outliers"),
            **entries(curve, runs="names", shared_error="shared", effective_samples="effective"),
            **entries(curve.provenance, "path", "notes"),
            "fitted": loop.used,
        },
        **entries(loop, "verdict", "sentence", "withheld"),
        "findings": [one.to_json(curve.speed) for one in steady_findings(loop)],
        "stick_slip": curve.stick_slip,
        "load": load
        and {
            **entries(load, "effect", "covariance", "centre"),
            "parameters": parameters(
                *(dict(zip(load.names, x, strict=True)) for x in (load.values, load.std))
            ),
        },
        "effects": loop.final.effects,
        "before": model(loop.base),
        "after": model(loop.final),
        "candidates": [model(m) for m in loop.candidates],
        "gains": {
            **entries(gains, "worst_velocity", "slope", "least_damping"),
            "claim": gains.claim.kind,
            **listed(gains.claim.reasons, "reasons", "reasons_coded"),
            "damping": gains.claim.damping if gains.claim.kind == "damped" else None,
            **entries(valid, "slowest", "fastest", "above", not_seen="unseen", slope_std="error"),
            "sentence": sentence(loop),
        },
        "noise": noise
        and {
            **entries(noise.estimate, "sigma"),
            **noise.estimate.to_json(),
            **entries(noise, "after_a_turn", effective_samples="effective"),
            "text": noise_text(noise, curve),
        },
    }
    return plain(table)
