"""The friction of steady speeds: a curve of force against speed, and what Coulomb and viscous
friction lack there.

    F(v) = F_c sgn v + F_v v + F_0                                                        (base)
         + d |v|                             direction_asymmetry
         + fs exp(-(|v|/vs)^n) sgn v, fs > 0, n = 1 or 2     stribeck
         + c v^3                             cubic

Every run counts with the error of its mean. Runs also differ by more than that (a spread beyond
the errors of the means, tau): it is estimated with each candidate, as the noise of a loop is.
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
from ...stability.claims import Unseen, above_curve
from ..thresholds import ACCEPT
from .model import SteadyModel, fit_model

STEADY_EFFECTS = ("direction_asymmetry", "stribeck", "cubic")
_FEWEST = 8
_HINT = 2.0


@dataclass(frozen=True, eq=False, repr=False)
class SteadyLoop(Described, Drawable, Tabular):
    """The result of a loop on a steady curve."""

    curve: SteadyCurve
    base: SteadyModel
    final: SteadyModel
    candidates: tuple[SteadyModel, ...]
    verdict: str
    """One of "no_missing_effect", "effects" or "too_weak", as in `jaxfric.loop`."""
    sentence: str

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
    10 and runs held out (each with its neighbours in speed) are predicted better.

    Raises
    ------
    InputError : an unknown effect; fewer than 8 runs, fewer than 3 of one direction.
    """
    with_, without = ids_of(with_), ids_of(without)
    speed = np.asarray(curve.speed)
    forward, backward = int(np.sum(speed > 0)), int(np.sum(speed < 0))
    if len(speed) < _FEWEST or min(forward, backward) < 3:
        raise InputError(
            f"the curve has {forward} speeds forwards and {backward} backwards; {_FEWEST} in all"
            " and 3 of each direction are needed: one direction alone does not tell Coulomb"
            " friction from an offset of the force. Record more speeds, both ways"
        )
    unknown = sorted({*with_, *without} - set(STEADY_EFFECTS))
    if unknown:
        raise InputError(
            f"effect '{unknown[0]}' is none of a steady curve; there are: "
            + ", ".join(STEADY_EFFECTS)
        )
    base = fit_model(curve, with_)
    current, tried = base, [base]
    while True:
        missing = [e for e in STEADY_EFFECTS if e not in (*current.effects, *without)]
        models = [fit_model(curve, (*current.effects, e)) for e in missing]
        tried += models
        better = [m for m in models if _acceptable(current, m)]
        if not better:
            break
        current = min(better, key=lambda m: m.bic)
    best = max((current.bic - m.bic for m in tried if m is not current), default=0.0)
    verdict, text = _said(curve, base, current, best)
    ranked = tuple(sorted(tried, key=lambda m: m.bic))
    return SteadyLoop(curve, base, current, ranked, verdict, text)


def steady_gains(loop: SteadyLoop) -> AxisGains:
    """The least damping over the speeds at which runs are steady, and what may be said of it.

    Runs that moved unevenly count in the fit, but nothing is said of their speeds and slower ones.
    """
    curve, model = loop.curve, loop.final
    speed = np.abs(curve.speed)
    uneven = np.isin(curve.names, curve.uneven)
    seen = [_slowest_even(speed[side], uneven[side]) for side in (curve.speed > 0, curve.speed < 0)]
    slowest, fastest = max(seen), float(speed.max())
    unseen = []
    if uneven.any():
        names = ", ".join(curve.uneven)
        unseen.append(Unseen(f"{names} moved unevenly there", float(speed[uneven].max())))
    if curve.stuck:
        unseen.append(Unseen(f"no steady motion in {', '.join(curve.stuck)}", 0.0))
    above = above_curve(
        curve.speed, np.sign(curve.speed) * (curve.force - model.predicted), curve.error
    )
    return axis_gains(
        model.force,
        min(slowest, fastest),
        fastest,
        error=model.slope_error,
        above=above,
        unseen=tuple(unseen),
    )


def _slowest_even(speed: np.ndarray, uneven: np.ndarray) -> float:
    """The slowest run that is faster than all uneven ones; inf if there is none."""
    faster = speed[speed > np.max(speed[uneven], initial=0.0)]
    return float(np.min(faster, initial=np.inf))


def _acceptable(current: SteadyModel, model: SteadyModel) -> bool:
    physical = model.values.get("fs", 1.0) > 0
    return physical and current.bic - model.bic > ACCEPT and model.heldout < current.heldout


def _said(
    curve: SteadyCurve, base: SteadyModel, final: SteadyModel, best: float
) -> tuple[str, str]:
    unit, _, size = shown_units(curve)
    refused = [e for e in ("stribeck", "direction_asymmetry") if e not in final.effects]
    rest = f" Not supported: {', '.join(refused)}." if refused else ""
    added = [e for e in final.effects if e not in base.effects]
    before, after = base.rms / size, final.rms / size
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
    return (
        "no_missing_effect",
        f"These points show nothing that is missing: rms {before:.3g} {unit}.{rest}",
    )
