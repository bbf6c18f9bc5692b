"""The friction of steady speeds: a curve of force against speed, and what Coulomb and viscous
friction lack there.

    F(v) = F_c sgn v + F_v v + F_0                                                        (base)
         + d |v|                             direction_asymmetry
         + fs exp(-(|v|/vs)^n) sgn v, fs > 0, n = 1 or 2     stribeck
         + c v^3                             cubic

Every run counts with the error of its mean. Runs also differ by more than that (a spread beyond
the errors of the means, tau): it is estimated with each candidate, as the noise of a loop is.
Runs that stick and slip have no steady friction: they are told, and count in the fit only where
the others are too few for a line each way.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...described import Described, Drawable, Tabular
from ...effects import ids_of
from ...errors import InputError
from ...gains.axis import axis_gains
from ...gains.axis_result import AxisGains
from ...records.steady import SteadyCurve
from ...records.steady_load import Load
from ...stability.claims import SURE, Unseen, above_curve
from ..curves import distinct
from ..thresholds import ACCEPT
from .model import SteadyModel, fit_model

STEADY_EFFECTS = ("direction_asymmetry", "stribeck", "cubic")
_FEWEST, _FEWEST_OF_EACH = 8, 3
"""Runs, and runs of each direction, from which effects are tried: the largest model has six
parameters and a spread."""
_FEWEST_OF_BASE = 4
"""Runs from which the base is fitted: three parameters and a spread."""
_HINT = 2.0
_REVERSED = 3.0
"""Standard errors below zero of a friction that asks whether the force has the other sign."""
_NEGLIGIBLE = 0.02
"""Share of the largest force below which negative friction is taken for zero, as of an axis."""
_GRID = 101
_COUNTED = (
    "runs that stick and slip count in the fit, as too few others are left, so that the fitted line"
    " is no friction of steady sliding"
)


@dataclass(frozen=True, eq=False, repr=False)
class SteadyLoop(Described, Drawable, Tabular):
    """The result of a loop on a steady curve."""

    curve: SteadyCurve
    base: SteadyModel
    final: SteadyModel
    candidates: tuple[SteadyModel, ...]
    verdict: str
    """One of "no_missing_effect", "effects", "too_weak" or "ambiguous", as in `jaxfric.loop`;
    "stick_slip": runs stick and slip, and no effect is named; "too_few": runs for the base alone.
    """
    sentence: str
    used: np.ndarray
    """Mask of the runs that were fitted."""
    withheld: tuple[str, ...] = ()
    """Why neither friction nor gains may be taken from the fit, in words; empty where they may."""

    def units(self) -> tuple[str, str, float]:
        """Units of force and speed to show, and the size of the force unit in SI."""
        return shown_units(self.curve)


def shown_units(curve: SteadyCurve) -> tuple[str, str, float]:
    """Units of force and speed to show, and what one of the force unit is in SI."""
    speed = "rad/s" if curve.coordinate == "rotary" else "m/s"
    if curve.force_unit != "%" and np.max(np.abs(curve.force)) < 0.1:
        return f"m{curve.force_unit}", speed, 1e-3
    return curve.force_unit, speed, 1.0


def close_steady_loop(
    curve: SteadyCurve, *, with_: str | Sequence[str] = (), without: str | Sequence[str] = ()
) -> SteadyLoop:
    """Fit the curve, then add effects of `STEADY_EFFECTS` one by one.

    `with_` belong to the base, `without` are not tried. One is taken where BIC falls by more than
    10, runs held out (each with its neighbours in speed) are predicted better, its friction takes
    energy, and the runs fix its parameters. Of fewer than 8 runs, or 3 of one direction, the base
    alone is fitted.

    Raises
    ------
    InputError : an unknown effect; fewer than 4 runs, one direction only, or fewer than 3 different
        speeds; friction against the sign of the motion.
    """
    with_, without = ids_of(with_), ids_of(without)
    unknown = sorted({*with_, *without} - set(STEADY_EFFECTS))
    if unknown:
        raise InputError(
            f"effect '{unknown[0]}' is none of a steady curve; there are: "
            + ", ".join(STEADY_EFFECTS)
        )
    used = _fitted(curve)
    speed = np.asarray(curve.speed)[used]
    base = fit_model(curve, with_, used)
    _refuse_reversed(curve, base, used)
    counted = bool(np.any(curve.slipping() & used))
    few = len(speed) < _FEWEST or min(np.sum(speed > 0), np.sum(speed < 0)) < _FEWEST_OF_EACH
    few = few or counted
    current, tried = base, [base]
    while not (few or curve.wanders):
        missing = [e for e in STEADY_EFFECTS if e not in (*current.effects, *without)]
        models = [fit_model(curve, (*current.effects, e), used) for e in missing]
        tried += models
        better = [m for m in models if _acceptable(current, m, curve)]
        if not better:
            break
        current = min(better, key=lambda m: m.bic)
    withheld = tuple(filter(None, (_wanders(curve), _drives(curve, current))))
    best = max((current.bic - m.bic for m in tried if m is not current), default=0.0)
    verdict, text = _said(curve, base, current, best, few=few)
    if curve.load is not None:
        text += f" {_loaded(curve, curve.load)}"
    if withheld:
        told = "; ".join(withheld)
        verdict, text = "ambiguous", f"{told[0].upper()}{told[1:]}. {text}"
    elif counted:
        verdict, text, withheld = "stick_slip", "", (_COUNTED,)
    if curve.stick_slip:
        text = f"{_slips(curve, counted=counted)} {text}".rstrip()
        verdict = verdict if verdict in ("effects", "ambiguous") else "stick_slip"
    ranked = tuple(sorted(tried, key=lambda m: m.bic))
    return SteadyLoop(curve, base, current, ranked, verdict, text, used, withheld)


def _fitted(curve: SteadyCurve) -> np.ndarray:
    """Mask of the runs that are fitted: all that do not stick and slip, if they suffice.

    Raises `InputError` where all together do not.
    """
    steady = ~curve.slipping()
    for used in (steady, np.ones(len(curve), bool)):
        speed = np.asarray(curve.speed)[used]
        ways = [len(distinct(speed[speed * sign > 0])) for sign in (1, -1)]
        if len(speed) >= _FEWEST_OF_BASE and min(ways) > 0 and sum(ways) > 2:
            return used
    forward, backward = int(np.sum(curve.speed > 0)), int(np.sum(curve.speed < 0))
    slips = f"{_slips(curve, counted=False)} The" if curve.stick_slip else "the"
    raise InputError(
        f"{slips} curve has {forward} runs forwards and {backward} backwards; {_FEWEST_OF_BASE} in"
        " all, at two speeds or more, and both directions are needed: one direction alone does not"
        " tell Coulomb friction from an offset of the force. Record more speeds, both ways"
    )


def _refuse_reversed(curve: SteadyCurve, base: SteadyModel, used: np.ndarray) -> None:
    """Raises `InputError` where force and motion differ in sign: friction takes energy."""
    speed = np.asarray(curve.speed)[used]
    force, std = base.friction(np.abs(speed))
    if np.mean(np.asarray(curve.force)[used] * speed) >= 0 or np.any(force > -_REVERSED * std):
        return
    unit, shown, size = shown_units(curve)
    k = int(np.argmin(force))
    raise InputError(
        f"{curve.provenance.path}: the runs have a friction of {force[k] / size:.3g} {unit} at"
        f" {abs(speed[k]):.3g} {shown}, so that friction would drive the axis: is the sign of the"
        " force reversed (--flip force)?" + (f" Or {_wanders(curve)}" if curve.wanders else "")
    )


def _wanders(curve: SteadyCurve) -> str:
    """That the force changes within the runs, in words; empty where it does not."""
    if not curve.wanders:
        return ""
    placed = bool(curve.rows) and all(rows.position is not None for rows in curve.rows)
    return (
        "the force changes along the runs as slowly as a weight or a spring changes it (a run is"
        f" worth {np.median(curve.effective):.0f} independent samples), so that friction is not"
        " told from such a load, nor how well the means are known. Record "
        + ("longer runs" if placed else "the position as well")
    )


def _drives(curve: SteadyCurve, model: SteadyModel, sure: float = SURE) -> str:
    """That the friction of a model would drive the axis, by more than `sure` standard errors, in
    words; empty where it takes energy."""
    size = np.abs(curve.speed)
    speed = np.geomspace(size.min(), size.max(), _GRID)
    force, std = model.friction(speed)
    force = np.append(force, model.values["F_c"])
    std = np.append(std, model.std["F_c"])
    most = _NEGLIGIBLE * float(np.max(np.abs(curve.force)))
    wrong = np.flatnonzero((force < -most) & (force < -sure * std))
    if not len(wrong):
        return ""
    unit, shown, one = shown_units(curve)
    k = wrong[np.argmin(force[wrong])]
    what = "the fitted friction" if k < _GRID else "the fitted Coulomb friction"
    where = f" at {speed[k]:.3g} {shown}" if k < _GRID else ""
    return (
        f"{what} is negative{where}, {force[k] / one:.3g} ± {std[k] / one:.2g} {unit}: it would"
        " drive the axis, so that the model is wrong"
    )


def _slips(curve: SteadyCurve, *, counted: bool) -> str:
    """The speeds at which runs stick and slip, how much of the time each is at rest, and whether
    they are `counted` in the fit."""
    speed = "rad/s" if curve.coordinate == "rotary" else "m/s"
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
    length = shown.removesuffix("/s")
    size, std = (x / one for x in load.size())
    if load.effect == "gravity":
        what = f"with the sine of the angle, {size:.4g} ± {std:.2g} {unit} at most"
    else:
        what = f"with the position, {load.values[0] / one:.4g} ± {std:.2g} {unit}/{length}"
    return (
        f"The force goes {what}, the same both ways, as a weight or a spring: it is taken out of"
        " the friction; F_0 holds it in the middle of the travel."
    )


def steady_gains(loop: SteadyLoop) -> AxisGains:
    """The least damping over the speeds at which runs are steady, and what may be said of it.

    Runs that moved unevenly count in the fit, but nothing is said of their speeds and slower ones.
    """
    curve, model = loop.curve, loop.final
    speed = np.abs(curve.speed)
    uneven = np.isin(curve.names, curve.uneven)
    seen = [_slowest_even(speed[side], uneven[side]) for side in (curve.speed > 0, curve.speed < 0)]
    slowest, fastest = max(seen), float(speed.max())
    unseen = [Unseen(why, np.inf) for why in loop.withheld]
    slipping = curve.slipping()
    for some, what in ((uneven & ~slipping, "moved unevenly there"), (slipping, "stick and slip")):
        if some.any():
            names = ", ".join(np.asarray(curve.names)[some])
            unseen.append(Unseen(f"{names} {what}", float(speed[some].max())))
    if curve.stuck:
        unseen.append(Unseen(f"no steady motion in {', '.join(curve.stuck)}", 0.0))
    if len(loop.candidates) == 1 and int(loop.used.sum()) < _FEWEST:
        unseen.append(
            Unseen(
                f"{loop.used.sum()} runs do not tell whether friction falls at some speed", np.inf
            )
        )
    if not slowest < fastest:
        unseen.append(Unseen("no two speeds of both directions moved evenly", np.inf))
        slowest = float(speed.min())
    here = loop.used
    above = above_curve(
        curve.speed[here],
        np.sign(curve.speed[here]) * (curve.force - model.force(curve.speed))[here],
        curve.error[here],
    )
    return axis_gains(
        model.force,
        slowest,
        fastest,
        error=model.slope_error,
        above=above,
        unseen=tuple(unseen),
    )


def _slowest_even(speed: np.ndarray, uneven: np.ndarray) -> float:
    """The slowest run that is faster than all uneven ones; inf if there is none."""
    faster = speed[speed > np.max(speed[uneven], initial=0.0)]
    return float(np.min(faster, initial=np.inf))


def _acceptable(current: SteadyModel, model: SteadyModel, curve: SteadyCurve) -> bool:
    """Whether a model is likelier, predicts better, is possible, and the runs fix its parameters:
    an amplitude better than itself, a velocity better than a factor of e."""
    better = current.bic - model.bic > ACCEPT and model.heldout < current.heldout
    fixed = all(model.std[k] < abs(model.values[k]) for k in ("fs", "vs") if k in model.values)
    return better and fixed and model.values.get("fs", 1.0) > 0 and not _drives(curve, model, 0.0)


def _said(
    curve: SteadyCurve, base: SteadyModel, final: SteadyModel, best: float, *, few: bool
) -> tuple[str, str]:
    unit, speed, size = shown_units(curve)
    before, after = base.rms / size, final.rms / size
    untested = f"Whether friction lacks an effect ({', '.join(STEADY_EFFECTS)}) is not tested"
    if curve.wanders:
        return "ambiguous", f"{untested}."
    if few:
        known = ", ".join(
            f"{name} = {base.values[name] / size:.4g} ± {base.std[name] / size:.2g} {own}"
            for name, own in (("F_c", unit), ("F_v", f"{unit}/({speed})"), ("F_0", unit))
        )
        return "too_few", (
            f"A line each way fits the runs: {known} (rms {before:.3g} {unit}). {untested}:"
            f" {_FEWEST} runs are needed, {_FEWEST_OF_EACH} of each direction."
        )
    refused = [e for e in ("stribeck", "direction_asymmetry") if e not in final.effects]
    rest = f" Not supported: {', '.join(refused)}." if refused else ""
    added = [e for e in final.effects if e not in base.effects]
    if added:
        return "effects", (
            f"The curve lacks {' and '.join(added)}: rms {before:.3g} -> {after:.3g} {unit}, BIC"
            f" {base.bic - final.bic:.0f} lower.{rest}"
        )
    if best > _HINT:
        return "too_weak", (
            f"Something may be missing, but no effect is supported by more than {ACCEPT:g} of BIC"
            f" (best {best:.1f})."
        )
    if curve.stick_slip:
        return "stick_slip", (
            f"The others fit Coulomb and viscous friction (rms {before:.3g} {unit}): where friction"
            f" falls with speed they do not show.{rest}"
        )
    return (
        "no_missing_effect",
        f"These points show nothing that is missing: rms {before:.3g} {unit}.{rest}",
    )
