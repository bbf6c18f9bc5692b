"""The loop on a curve of steady force against speed: effects missing from Coulomb + viscous.

    F(v) = F_c sgn v + F_v v + F_0                                                        (base)
         + d |v|                             direction_asymmetry
         + fs exp(-(|v|/vs)^n) sgn v, fs > 0, n = 1 or 2     stribeck
         + c v^3                             cubic

Every run is weighted by the standard error of its mean force. Mean forces of runs also differ by a
spread tau beyond their standard errors. The spread tau is estimated with each candidate model, like
the noise of a loop. Runs that stick and slip have no steady friction. Runs that stick and slip are
reported, and fitted only if other runs are too few for a line in each direction.

`steady_findings` makes the claims; each claim lists the runs that support it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from ...described import Described, Drawable, Tabular, said
from ...effects import ids_of
from ...errors import InputError, option
from ...findings import Finding, Severity, Warned, deciding_rows, warned
from ...fitting.axis_problem import NEGLIGIBLE
from ...fitting.fit import require_float64
from ...fitting.noise.thresholds import CLEAR
from ...fitting.thresholds import LARGEST_ERROR
from ...gains.axis import axis_gains
from ...gains.axis_result import AxisGains
from ...gains.thresholds import SPEEDS
from ...lazy import old_arguments
from ...records.steady import SteadyCurve
from ...stability.claims import SURE, Unseen, above_curve
from ...stability.reasons import ClaimReason
from ..family import distinct
from ..findings import LoopCode, claims_of_friction
from ..thresholds import ACCEPT, FEWEST, FEWEST_OF_EACH, FEWEST_STROKES, TIE
from .model import SteadyModel, fit_model

STEADY_EFFECTS = ("direction_asymmetry", "stribeck", "cubic")


class Doubt(StrEnum):
    """Why a fit supports neither friction nor gains."""

    WANDERS = "force_changes_within_runs"
    DRIVES = "friction_would_drive"
    COUNTED = "stick_slip_counts"
    """Runs that stick and slip are fitted, because there are too few others."""


@dataclass(frozen=True, eq=False, repr=False)
class SteadyLoop(Described, Drawable, Tabular):
    """The result of a loop on a steady curve."""

    curve: SteadyCurve
    base: SteadyModel
    final: SteadyModel
    candidates: tuple[SteadyModel, ...]
    tested: bool
    """Whether there are enough runs to try effects."""
    used: np.ndarray
    """Mask of the runs that were fitted."""
    doubts: tuple[Doubt, ...] = ()

    @property
    def verdict(self) -> str:
        """One of "no_missing_effect", "effects", "too_weak" or "ambiguous", as in `jaxfric.loop`;
        "stick_slip": runs stick and slip, and no effect is named; "too_few": only enough runs for
        the base."""
        if Doubt.COUNTED in self.doubts:
            return "stick_slip"
        found = "ambiguous" if self.doubts else self.found
        stands = found in ("effects", "ambiguous") or not self.curve.stick_slip
        return found if stands else "stick_slip"

    @property
    def found(self) -> str:
        """The verdict from the fitted runs alone, without regard to stick-slip."""
        if self.curve.wanders:
            return "ambiguous"
        if not self.tested:
            return "too_few"
        if self.added:
            return "effects"
        if self.lower > TIE:
            return "too_weak"
        return "stick_slip" if self.curve.stick_slip else "no_missing_effect"

    @property
    def added(self) -> tuple[str, ...]:
        """The effects of the final model beyond those of the base."""
        return tuple(e for e in self.final.effects if e not in self.base.effects)

    @property
    def lower(self) -> float:
        """BIC of the final model minus the BIC of the best other model."""
        others = (self.final.bic - m.bic for m in self.candidates if m is not self.final)
        return max(others, default=0.0)

    @property
    def sentence(self) -> str:
        """The verdict as text."""
        return said("steady_text.verdict", self)

    @property
    def withheld(self) -> tuple[str, ...]:
        """The `doubts` about the fit as text."""
        return said("steady_text.withheld", self)


def shown_units(curve: SteadyCurve) -> tuple[str, str, float]:
    """Units of force and speed for display, and the force unit in SI units."""
    speed = "rad/s" if curve.coordinate == "rotary" else "m/s"
    if curve.force_unit != "%" and np.max(np.abs(curve.force)) < 0.1:
        return f"m{curve.force_unit}", speed, 1e-3
    return curve.force_unit, speed, 1.0


@old_arguments(with_="include", without="exclude")
def close_steady_loop(
    curve: SteadyCurve, *, include: str | Sequence[str] = (), exclude: str | Sequence[str] = ()
) -> SteadyLoop:
    """Fit the curve, then add effects of `STEADY_EFFECTS` one by one.

    The effects `include` belong to the base, the effects `exclude` are not tried. An accepted
    effect lowers BIC by more than 10 and predicts held-out runs better (each run is held out with
    its neighbours in speed). The friction of an accepted effect is dissipative, and the runs
    determine its parameters. With fewer than 8 runs, or fewer than 3 in one direction, only the
    base is fitted.

    Raises
    ------
    InputError : float64 is off; an unknown effect; fewer than 4 runs, one direction only, or
        fewer than 3 different speeds; friction against the sign of the motion.
    """
    require_float64()
    include, exclude = ids_of(include), ids_of(exclude)
    unknown = sorted({*include, *exclude} - set(STEADY_EFFECTS))
    if unknown:
        raise InputError(
            f"effect '{unknown[0]}' is none of a steady curve; there are: "
            + ", ".join(STEADY_EFFECTS)
        )
    used = _fitted(curve)
    speed = np.asarray(curve.speed)[used]
    base = fit_model(curve, include, used)
    _refuse_reversed(curve, base, used)
    counted = bool(np.any(curve.slipping() & used))
    few = len(speed) < FEWEST or min(np.sum(speed > 0), np.sum(speed < 0)) < FEWEST_OF_EACH
    few = few or counted
    current, tried = base, [base]
    while not (few or curve.wanders):
        missing = [e for e in STEADY_EFFECTS if e not in (*current.effects, *exclude)]
        models = [fit_model(curve, (*current.effects, e), used) for e in missing]
        tried += models
        better = [m for m in models if _acceptable(current, m, curve)]
        if not better:
            break
        current = min(better, key=lambda m: m.bic)
    known = ((Doubt.WANDERS, curve.wanders), (Doubt.DRIVES, driving(curve, current) is not None))
    doubts = tuple(one for one, there in known if there) or (Doubt.COUNTED,) * counted
    ranked = tuple(sorted(tried, key=lambda m: m.bic))
    return SteadyLoop(curve, base, current, ranked, not few, used, doubts)


def _fitted(curve: SteadyCurve) -> np.ndarray:
    """Mask of the fitted runs: those that do not stick and slip if they suffice, else all.

    Raises `InputError` if all together do not suffice.
    """
    steady = ~curve.slipping()
    for used in (steady, np.ones(len(curve), bool)):
        speed = np.asarray(curve.speed)[used]
        ways = [len(distinct(speed[speed * sign > 0])) for sign in (1, -1)]
        if len(speed) >= FEWEST_STROKES and min(ways) > 0 and sum(ways) > 2:
            return used
    forward, backward = int(np.sum(curve.speed > 0)), int(np.sum(curve.speed < 0))
    slips = f"{said('steady_text.slips', curve, False)} The" if curve.stick_slip else "the"
    raise InputError(
        f"{slips} curve has {forward} runs forwards and {backward} backwards; {FEWEST_STROKES} in"
        " all, at two speeds or more, and both directions are needed: one direction alone does not"
        " tell Coulomb friction from an offset of the force. Record more speeds, both ways"
    )


def _refuse_reversed(curve: SteadyCurve, base: SteadyModel, used: np.ndarray) -> None:
    """Raise `InputError` if force and motion have opposite signs: friction must dissipate."""
    speed = np.asarray(curve.speed)[used]
    force, std = base.friction(np.abs(speed))
    if np.mean(np.asarray(curve.force)[used] * speed) >= 0 or np.any(force > -CLEAR * std):
        return
    unit, shown, size = shown_units(curve)
    k = int(np.argmin(force))
    wanders = f" Or {said('steady_text.wanders', curve)}" if curve.wanders else ""
    raise InputError(
        f"{curve.provenance.path}: the runs have a friction of {force[k] / size:.3g} {unit} at"
        f" {abs(speed[k]):.3g} {shown}, so that friction would drive the axis: is the sign of the"
        f" force reversed ({option('flip-sign', 'force')})?{wanders}"
    )


def driving(
    curve: SteadyCurve, model: SteadyModel, sure: float = SURE
) -> tuple[float | None, float, float] | None:
    """Most negative friction of a model, if negative by more than `sure` standard errors. The
    result has the speed (None: Coulomb friction), the friction and its standard error. The result
    is None if friction dissipates.
    """
    size = np.abs(curve.speed)
    speed = np.geomspace(size.min(), size.max(), SPEEDS)
    force, std = model.friction(speed)
    force = np.append(force, model.values["F_c"])
    std = np.append(std, model.std["F_c"])
    most = NEGLIGIBLE * float(np.max(np.abs(curve.force)))
    wrong = np.flatnonzero((force < -most) & (force < -sure * std))
    if not len(wrong):
        return None
    k = int(wrong[np.argmin(force[wrong])])
    return float(speed[k]) if k < SPEEDS else None, float(force[k]), float(std[k])


def steady_gains(loop: SteadyLoop) -> AxisGains:
    """The smallest damping that suffices at all speeds of steady runs, and the stability claim.

    Runs that moved unevenly are fitted, but no claim is made at or below the speeds of such runs.
    """
    curve, model = loop.curve, loop.final
    speed = np.abs(curve.speed)
    uneven = np.isin(curve.names, curve.uneven)
    seen = [_slowest_even(speed[side], uneven[side]) for side in (curve.speed > 0, curve.speed < 0)]
    slowest, fastest = max(seen), float(speed.max())
    unseen = [Unseen(Warned(why), np.inf) for why in loop.withheld]
    slipping = curve.slipping()
    uneven_only = uneven & ~slipping
    for some, code in ((uneven_only, ClaimReason.UNEVEN), (slipping, ClaimReason.SLIPPING)):
        if some.any():
            names = np.asarray(curve.names)[some].tolist()
            unseen.append(Unseen(warned(code, runs=names), float(speed[some].max())))
    if curve.stuck:
        unseen.append(Unseen(warned(ClaimReason.STUCK, runs=curve.stuck), 0.0))
    if len(loop.candidates) == 1 and int(loop.used.sum()) < FEWEST:
        untold = warned(ClaimReason.FEW_RUNS, runs=int(loop.used.sum()))
        unseen.append(Unseen(untold, np.inf))
    if not slowest < fastest:
        unseen.append(Unseen(warned(ClaimReason.EVEN_APART), np.inf))
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
    """Speed of the slowest run that is faster than all uneven ones; inf if there is none."""
    faster = speed[speed > np.max(speed[uneven], initial=0.0)]
    return float(np.min(faster, initial=np.inf))


def _acceptable(current: SteadyModel, model: SteadyModel, curve: SteadyCurve) -> bool:
    """Whether a model is likelier, predicts better, is possible, and has determined parameters, as
    for the loop of a record (`gates.not_fixed`)."""
    better = current.bic - model.bic > ACCEPT and model.heldout < current.heldout
    limits = {"fs": 1.0, "vs": LARGEST_ERROR}
    fixed = all(model.std[k] < limits[k] * abs(model.values[k]) for k in limits if k in model.std)
    possible = model.values.get("fs", 1.0) > 0 and driving(curve, model, 0.0) is None
    return better and fixed and possible


def steady_findings(loop: SteadyLoop) -> tuple[Finding, ...]:
    """Claims on stick-slip, effects, friction by direction and stability; masks are over runs.

    If the fitted friction is withheld, only stick-slip is claimed, since the runs themselves show
    stick-slip.
    """
    curve, gains = loop.curve, steady_gains(loop)
    signed, names = np.asarray(curve.speed), np.asarray(curve.names)
    found = []
    for one in curve.stick_slip:
        values = {"speed": one.speed, "at_rest": one.at_rest}
        found.append(_claim(LoopCode.STICK_SLIP, values, names == one.run))
    if loop.doubts or gains.curve is None:
        return tuple(found)
    found += [_effect(loop, id) for id in loop.added]
    ends = gains.curve.slowest, gains.curve.fastest
    ways = [("forwards", 1.0, ends), ("backwards", -1.0, ends)]
    return (*found, *claims_of_friction(gains.claim.kind, ways, ends, signed, loop.used))


def _claim(code: LoopCode, values: dict, runs: np.ndarray) -> Finding:
    return Finding(code, Severity.CLAIM, values, runs)


def _effect(loop: SteadyLoop, id: str) -> Finding:
    """Finding of an effect: without its runs, the base refitted to the others is as good."""
    curve, final = loop.curve, loop.final
    speed = np.asarray(curve.speed)
    error = np.hypot(np.asarray(curve.error), final.spread)
    line = np.stack([np.sign(speed), speed, np.ones_like(speed)], axis=1)
    difference = (loop.base.force(speed) - final.force(speed)) / error
    runs = deciding_rows(difference, line / error[:, None], loop.used, ACCEPT)
    values = {"effect": id, "delta_bic": final.bic - loop.base.bic}
    return _claim(LoopCode.EFFECT, values, runs)
