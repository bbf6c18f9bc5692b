"""The verdict on a curve of steady speeds in words, and why no friction may be taken from it."""

import numpy as np

from ..loop.steady.loop import (
    FEWEST,
    FEWEST_OF_EACH,
    STEADY_EFFECTS,
    Doubt,
    SteadyLoop,
    driving,
    shown_units,
)
from ..loop.thresholds import ACCEPT
from ..records.steady import SteadyCurve
from ..records.steady_load import Load

_COUNTED = (
    "runs that stick and slip count in the fit, as too few others are left, so that the fitted line"
    " is no friction of steady sliding"
)


def sentence(loop: SteadyLoop) -> str:
    """The verdict in words."""
    curve, counted = loop.curve, Doubt.COUNTED in loop.doubts
    text = "" if counted else _said(loop)
    if curve.load is not None and not counted:
        text += f" {_loaded(curve, curve.load)}"
    if loop.doubts and not counted:
        told = "; ".join(withheld(loop))
        text = f"{told[0].upper()}{told[1:]}. {text}"
    if curve.stick_slip:
        text = f"{slips(curve, counted)} {text}".rstrip()
    return text


def withheld(loop: SteadyLoop) -> tuple[str, ...]:
    """Why neither friction nor gains may be taken from the fit; empty where they may."""
    words = {
        Doubt.WANDERS: lambda: wanders(loop.curve),
        Doubt.DRIVES: lambda: _drives(loop),
        Doubt.COUNTED: lambda: _COUNTED,
    }
    return tuple(words[one]() for one in loop.doubts)


def wanders(curve: SteadyCurve) -> str:
    """That the force changes within the runs."""
    placed = bool(curve.rows) and all(rows.position is not None for rows in curve.rows)
    return (
        "the force changes along the runs as slowly as a weight or a spring changes it (a run is"
        f" worth {np.median(curve.effective):.0f} independent samples), so that friction is not"
        " told from such a load, nor how well the means are known. Record "
        + ("longer runs" if placed else "the position as well")
    )


def _drives(loop: SteadyLoop) -> str:
    """That the fitted friction would drive the axis."""
    unit, shown, one = shown_units(loop.curve)
    found = driving(loop.curve, loop.final)
    assert found is not None
    speed, force, std = found
    what = "the fitted Coulomb friction" if speed is None else "the fitted friction"
    where = "" if speed is None else f" at {speed:.3g} {shown}"
    return (
        f"{what} is negative{where}, {force / one:.3g} ± {std / one:.2g} {unit}: it would"
        " drive the axis, so that the model is wrong"
    )


def slips(curve: SteadyCurve, counted: bool) -> str:
    """The speeds at which runs stick and slip, how much of the time each is at rest, and whether
    they are `counted` in the fit."""
    speed = shown_units(curve)[1]
    each = "; ".join(
        f"at {one.speed:.3g} {speed} the axis rests {100 * one.at_rest:.0f} % of the time"
        f" ({one.stops} stops) and moves at {one.moving_speed:.3g} {speed} between"
        for one in sorted(curve.stick_slip, key=lambda one: abs(one.speed))
    )
    how = _COUNTED if counted else "these runs have no steady friction and are not fitted"
    return f"Stick-slip: {each}; {how}."


def _loaded(curve: SteadyCurve, load: Load) -> str:
    """What the force has along the travel, and that it is taken out."""
    unit, shown, one = shown_units(curve)
    size, std = (x / one for x in load.size())
    if load.effect == "gravity":
        what = f"with the sine of the angle, {size:.4g} ± {std:.2g} {unit} at most"
    else:
        per = f"{unit}/{shown.removesuffix('/s')}"
        what = f"with the position, {load.values[0] / one:.4g} ± {std:.2g} {per}"
    return (
        f"The force goes {what}, the same both ways, as a weight or a spring: it is taken out of"
        " the friction; F_0 holds it in the middle of the travel."
    )


def _said(loop: SteadyLoop) -> str:
    base, final = loop.base, loop.final
    unit, speed, size = shown_units(loop.curve)
    before = f"{base.rms / size:.3g}"
    untested = f"Whether friction lacks an effect ({', '.join(STEADY_EFFECTS)}) is not tested"
    refused = [e for e in ("stribeck", "direction_asymmetry") if e not in final.effects]
    rest = f" Not supported: {', '.join(refused)}." if refused else ""
    match loop.found:
        case "ambiguous":
            return f"{untested}."
        case "too_few":
            known = ", ".join(
                f"{name} = {base.values[name] / size:.4g} ± {base.std[name] / size:.2g} {own}"
                for name, own in (("F_c", unit), ("F_v", f"{unit}/({speed})"), ("F_0", unit))
            )
            return (
                f"A line each way fits the runs: {known} (rms {before} {unit}). {untested}:"
                f" {FEWEST} runs are needed, {FEWEST_OF_EACH} of each direction."
            )
        case "effects":
            return (
                f"The curve lacks {' and '.join(loop.added)}: rms {before} ->"
                f" {final.rms / size:.3g} {unit}, BIC {base.bic - final.bic:.0f} lower.{rest}"
            )
        case "too_weak":
            return (
                f"Something may be missing, but no effect is supported by more than {ACCEPT:g} of"
                f" BIC (best {loop.lower:.1f})."
            )
        case "stick_slip":
            return (
                f"The others fit Coulomb and viscous friction (rms {before} {unit}): where friction"
                f" falls with speed they do not show.{rest}"
            )
        case _:
            return f"These points show nothing that is missing: rms {before} {unit}.{rest}"
