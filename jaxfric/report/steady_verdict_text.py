"""The verdict on a friction curve of steady speeds, and the reasons for giving no friction."""

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
from .words import say


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
    """Why the fit gives neither friction nor gains; '' if it gives them."""
    words = {
        Doubt.WANDERS: lambda: wanders(loop.curve),
        Doubt.DRIVES: lambda: _drives(loop),
        Doubt.COUNTED: lambda: say("steady.counted"),
    }
    return tuple(words[one]() for one in loop.doubts)


def wanders(curve: SteadyCurve) -> str:
    """Say that the force drifts within the runs."""
    placed = bool(curve.rows) and all(rows.position is not None for rows in curve.rows)
    more = say("steady.longer_runs" if placed else "steady.position")
    return say("steady.wanders", samples=np.median(curve.effective), more=more)


def _drives(loop: SteadyLoop) -> str:
    """That the fitted friction would drive the axis."""
    unit, shown, one = shown_units(loop.curve)
    found = driving(loop.curve, loop.final)
    assert found is not None
    speed, force, std = found
    what = say("steady.coulomb" if speed is None else "steady.friction")
    where = "" if speed is None else say("steady.at", speed=speed, unit=shown)
    size = {"force": force / one, "std": std / one, "unit": unit}
    return say("steady.drives", what=what, where=where, **size)


def slips(curve: SteadyCurve, counted: bool) -> str:
    """The speeds at which runs stick-slip, and the share of time at rest in each.

    `counted` says whether the fit includes these runs.
    """
    speed = shown_units(curve)[1]
    each = "; ".join(
        say(
            "steady.slips_one",
            speed=one.speed,
            unit=speed,
            share=100 * one.at_rest,
            stops=one.stops,
            moving=one.moving_speed,
        )
        for one in sorted(curve.stick_slip, key=lambda one: abs(one.speed))
    )
    return say(
        "steady.slips", each=each, how=say("steady.counted" if counted else "steady.not_fitted")
    )


def _loaded(curve: SteadyCurve, load: Load) -> str:
    """What the force has along the travel, and that it is taken out."""
    unit, shown, one = shown_units(curve)
    size, std = (x / one for x in load.size())
    if load.effect == "gravity":
        what = say("steady.gravity", size=size, std=std, unit=unit)
    else:
        per = f"{unit}/{shown.removesuffix('/s')}"
        what = say("steady.spring", size=load.values[0] / one, std=std, unit=per)
    return say("steady.loaded", what=what)


def _said(loop: SteadyLoop) -> str:
    base, final = loop.base, loop.final
    unit, speed, size = shown_units(loop.curve)
    refused = [e for e in ("stribeck", "direction_asymmetry") if e not in final.effects]
    known = ", ".join(
        f"{name} = {base.values[name] / size:.4g} ± {base.std[name] / size:.2g} {own}"
        for name, own in (("F_c", unit), ("F_v", f"{unit}/({speed})"), ("F_0", unit))
    )
    return say(
        f"steady.{loop.found}",
        untested=say("steady.untested", effects=", ".join(STEADY_EFFECTS)),
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
        rest=say("steady.not_supported", effects=", ".join(refused)) if refused else "",
    )
