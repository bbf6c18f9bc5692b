"""State the verdict on a steady friction curve, and the reasons for giving no friction."""

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
from ..units import measured
from .words import capital, say


def sentence(loop: SteadyLoop) -> str:
    """The verdict in words."""
    curve, counted = loop.curve, Doubt.COUNTED in loop.doubts
    parts = [slips(curve, counted)] if curve.stick_slip else []
    if not counted:
        parts += [f"{capital('; '.join(withheld(loop)))}."] if loop.doubts else []
        parts.append(_said(loop))
        parts += [] if curve.load is None else [_loaded(curve, curve.load)]
    return " ".join(parts)


def withheld(loop: SteadyLoop) -> tuple[str, ...]:
    """Say why the fit gives neither friction nor gains; '' if the fit gives both."""
    own = {Doubt.WANDERS: wanders(loop.curve), Doubt.COUNTED: say("steady.counted")}
    return tuple(own[one] if one in own else _drives(loop) for one in loop.doubts)


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
    where = "" if speed is None else say("steady.at", speed=speed, unit=shown)
    value = measured(force / one, std / one)
    return say("steady.drives", where=where, force=f"{value} {unit}")


def slips(curve: SteadyCurve, counted: bool) -> str:
    """Name the speeds at which runs stick-slip, and each run's share of time at rest.

    `counted` says whether the fit includes the runs that stick-slip.
    """
    unit = shown_units(curve)[1]
    each = "; ".join(
        say("steady.slips_one", unit=unit, share=100 * one.at_rest, **one._asdict())
        for one in sorted(curve.stick_slip, key=lambda one: abs(one.speed))
    )
    how = say("steady.counted" if counted else "steady.not_fitted")
    return say("steady.slips", each=each, how=how)


def _loaded(curve: SteadyCurve, load: Load) -> str:
    """What the force has along the travel, and that it is taken out."""
    unit, shown, one = shown_units(curve)
    size, std = load.size()
    if load.effect != "gravity":
        size, unit = load.values[0], f"{unit}/{shown.removesuffix('/s')}"
    known = f"{measured(size / one, std / one)} {unit}"
    return say("steady.loaded", what=say(f"steady.{load.effect}", size=known))


def _said(loop: SteadyLoop) -> str:
    base, final = loop.base, loop.final
    unit, speed, size = shown_units(loop.curve)
    refused = [e for e in ("stribeck", "direction_asymmetry") if e not in final.effects]
    known = ", ".join(
        f"{name} = {measured(base.values[name] / size, base.std[name] / size)} {own}"
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
