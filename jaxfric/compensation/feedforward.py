"""`feedforward(model)`: compensation of the friction of a saved axis."""

from pathlib import Path

import numpy as np

from ..errors import option
from ..findings import WarningCode, warned
from ..lazy import old_arguments
from ..loop import Loop
from ..loop.steady.loop import SteadyLoop
from ..plain import entries
from ..stability.claims import SURE
from .curve import FrictionCurve
from .fade import WHOLE, Fade, FadeReason, Memory, fade_speed
from .identified import Identified, NothingToCompensate, identified
from .pieces import Terms, terms_of
from .result import Feedforward
from .units import drive_gain as parse_gain
from .units import positive

_ROWS, _FINE = 33, 801
_NEGLIGIBLE = 0.02
"""A negative Coulomb friction below this share of the friction counts as zero."""
_SLOWEST = 0.05
"""Lowest nonzero speed of the table, in fade speeds."""


@old_arguments(fade="fade_speed")
def feedforward(
    model: str | Path | Loop | SteadyLoop,
    *,
    acceleration: float | str | None = None,
    lag: float | str | None = None,
    fade_speed: float | str | None = None,
    drive_gain: str | None = None,
) -> Feedforward:
    """Compute the friction compensation of an axis or joint from the final model of its loop.

        u = M a + F_v v + F_0 + terms(q, v) + s(v) [F_c + level(q, v)],    s(v) = tanh(v/v_f)

    q, v, a are position, velocity and acceleration of the reference. The terms are those of the
    effects found: direction_asymmetry, cubic, stribeck, log_viscous, gravity, position_dependence,
    position_periodic, and rate_and_state in steady motion. The feedforward omits time_drift,
    presliding and the apparatus (servo_lag, sensor_lag, sensor_delay); `left_out` lists the omitted
    effects. Errors follow from the covariance of the fit. `jaxfric.compensation.fade` defines v_f.
    If friction falls with speed up to the highest supported speed, v in the terms is at most that
    speed.

    Parameters
    ----------
    model : a loop.json or steady.json of `jaxfric axis`, or a `Loop` or `SteadyLoop`.
    acceleration : of the reference at reversals [m/s^2 or rad/s^2], or text with a unit; default:
        the acceleration of the record, if the file contains it.
    lag : time [s] by which the axis reverses later than its reference; default: the motor's lag if
        the loop found a servo_lag.
    fade_speed : v_f [m/s or rad/s] instead of the derived one.
    drive_gain : force per signal of the drive, "35.15 N/V": the feedforward is then in V or A.

    Returns
    -------
    Feedforward : `formula`, `latex`, `c()`, `csv()`, `to_pandas()`, `plot()`, `friction(v)`,
        `compensation(v)`, the fade speed with its reasons, and the conditions for use with a
        measured velocity.

    Raises
    ------
    InputError : not a file of an axis, or a damaged one; an argument that is not a positive
        quantity; an effect without a formula.
    NothingToCompensate : the model did not converge, its friction would drive the axis, or its
        friction has a relative error of 1 or more.

    Play, a soft transmission and coupling between axes are not considered.
    """
    about = identified(model)
    if drive_gain is not None:
        about = about.at_the_drive(*parse_gain(drive_gain, about.force_unit))
    unit = about.length
    turning, late, given = (
        None if value is None else positive(value, unit, option(name))
        for name, value, unit in (
            ("acceleration", acceleration, f"{unit}/s^2"),
            ("lag", lag, "s"),
            ("fade-speed", fade_speed, f"{unit}/s"),
        )
    )
    terms = terms_of(about)
    curve = FrictionCurve(about, terms.effects, about.middle)
    level = _sound_level(curve)
    found = _derived(about, level, turning or about.acceleration, late or _servo_lag(about))
    if given is not None:
        said = f"given; derived from the model it would be {found.speed:.3g} {unit}/s"
        found = Fade((FadeReason("given", given, said),))
    return _result(terms, curve, found, level)


def _derived(
    about: Identified, level: float, acceleration: float | None, lag: float | None
) -> Fade:
    """Compute the fade speed from the model."""
    slowest, known, part = about.slowest_row, about.slower, 2
    if about.guessed:
        slowest, part = about.slowest, WHOLE
        known = f"the slowest that the record supports, as {', '.join(about.bends)}"
        known += " is not determined and slower friction is a guess"
    return fade_speed(
        slowest, level, memories=_memories(about), acceleration=acceleration, lag=lag,
        unit=about.length, known=known, part=part,
    )  # fmt: skip


def _result(terms: Terms, curve: FrictionCurve, fade: Fade, level: float) -> Feedforward:
    """Build the result: table, safe share of friction, and least damping."""
    about = curve.about
    mean = curve.mean(_supported(about))
    warnings = list(about.warnings)
    if (slope := float(mean.slope[-1])) < 0 and about.values["F_v"] < 0:
        curve = FrictionCurve(about, terms.effects, about.middle, held=about.fastest)
        above = about.fastest - float(mean.force[-1]) / slope
        own = entries(about, "fastest", "length")
        warnings.append(warned(WarningCode.FALLS, above=above, **own))
    low = _SLOWEST * min(fade.speed, about.slowest)
    marks = [s for s in (about.slowest, fade.speed) if low < s < about.fastest]
    speeds = np.unique([*np.geomspace(low, about.fastest, _ROWS), *marks])
    velocity = np.concatenate([-speeds[::-1], [0.0], speeds])
    table = curve.at(velocity, None)
    # the formula is untested outside the supported speeds
    table = table._replace(std=np.where(about.supports(velocity), table.std, np.nan))
    return Feedforward(
        about,
        terms.pieces,
        curve,
        fade,
        terms.left_out,
        velocity,
        table,
        curve.at(velocity, fade.speed).force,
        level,
        float(max(0.0, 1 - SURE * np.max(mean.std / mean.force))),
        _least_damping(curve, fade.speed, about.slowest, about.fastest),
        (*warnings, *_warnings(about)),
    )


def _supported(about: Identified) -> np.ndarray:
    """Speeds that the record supports."""
    return np.geomspace(about.slowest, max(about.fastest, about.slowest), _FINE)


def _sound_level(curve: FrictionCurve) -> float:
    """Return the friction that changes sign, at the lowest supported speed [F].

    Raise `NothingToCompensate` if the model's friction feeds energy into the motion, at a supported
    speed or at rest. Also raise it if the standard error is as large as the friction.
    """
    about = curve.about
    speed = _supported(about)
    found = curve.mean(speed)
    mean, level = found.force, float(curve.level(speed[:1])[0])
    worst = int(np.argmin(mean))
    coulomb = about.values["F_c"]
    sound = np.isfinite(mean).all() and mean[worst] > 0 and level > 0
    if not sound or coulomb < -_NEGLIGIBLE * level:
        raise NothingToCompensate(
            f"{about.source}: its friction would drive the axis ({mean[worst]:.3g}"
            f" {about.force_unit} against motion, at {float(speed[worst]):.3g} {about.length}/s;"
            f" its Coulomb friction is {coulomb:.3g} {about.force_unit}), so the model is wrong and"
            " must not be used for compensation"
        )
    share = np.where(np.isfinite(found.std), found.std, 0.0) / mean
    worst = int(np.argmax(share))
    if share[worst] >= 1.0:
        raise NothingToCompensate(
            f"{about.source}: the error of its friction is as large as the friction"
            f" ({mean[worst]:.3g} ± {found.std[worst]:.2g} {about.force_unit} at"
            f" {float(speed[worst]):.3g} {about.length}/s), so it must not be used for"
            " compensation; record more, or slower and faster speeds"
        )
    return level


def _servo_lag(about: Identified) -> float | None:
    lag = about.values.get("servo_lag.tau", 0.0)
    return lag if lag > 0 and "servo_lag.tau" not in about.loose else None


def _memories(about: Identified) -> list[Memory]:
    """Friction deficits after a reversal, of effects that the record determines."""
    p = about.values
    found = []
    if "presliding" in about.effects:
        found.append(Memory("presliding", "x_c", p["presliding.x_c"], 2 * p["presliding.a"]))
    if "rate_and_state" in about.effects:
        v_c = max(p["rate_and_state.v_c"], about.width)
        missing = abs(p["rate_and_state.B"]) * float(np.log1p(about.fastest / v_c))
        found.append(Memory("rate_and_state", "L", p["rate_and_state.L"], missing))
    return [one for one in found if f"{one.effect}.{one.symbol}" not in about.loose]


def _least_damping(curve: FrictionCurve, fade: float, slowest: float, fastest: float) -> float:
    """max over v of d(compensation - friction)/dv [F s/m]. With a larger k_v, perturbations of

        M v' = -k_v v - F(v) + compensation(v)

    decay about any steady velocity. The friction is the model's, with a sharp sign. Below the
    lowest supported speed `slowest`, a positive slope of friction is counted as 0.
    """
    v = np.geomspace(1e-3 * fade, max(fastest, 10 * fade), _FINE)
    more = []
    for side in (v, -v):
        own = curve.at(side, None).slope
        more.append(curve.at(side, fade).slope - np.where(v < slowest, np.minimum(own, 0.0), own))
    return float(max(np.max(more), 0.0))


def _warnings(about: Identified) -> tuple[str, ...]:
    """Warnings of undetermined parameters."""
    bends = about.bends
    loose = [name for name in about.loose if name not in bends]
    lines = []
    if bends:
        own = entries(about, "slowest", "width", "length")
        lines.append(warned(WarningCode.GUESS, parameters=bends, **own))
        if any(name.endswith(".v_c") and about.values[name] < about.width for name in bends):
            lines.append(warned(WarningCode.LEAST_WIDTH, **own))
    if loose:
        lines.append(warned(WarningCode.LOOSE_TERMS, parameters=loose))
    return tuple(lines)
