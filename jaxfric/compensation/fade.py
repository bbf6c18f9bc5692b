"""The fade speed, below which a compensation of friction should fade.

Axis friction jumps by twice its level when the velocity changes sign. A feedforward that jumps with
the reference is too early: the axis reverses later than its reference, and friction recovers over a
distance. Until feedforward and friction agree, the compensation pushes the axis with up to twice
the friction level. So the part of the feedforward that changes sign with the velocity v is
multiplied by a factor s:

    s(v) = tanh(v/v_f),    v_f = max(v_1, v_2, v_3)

    v_1 = v_slow/2           v_slow: the slowest motion in the fit, at which s = 0.96
    v_2 = sqrt(2 alpha x)    x: distance after a reversal over which friction recovers
    v_3 = alpha t            t: time by which the axis reverses later than the reference

v_slow is the lowest speed of rows that count in the fit, or of steady runs. The record may support
the friction only from a higher speed on, if few rows are slower. Between v_slow and the lowest
supported speed the fitted curve is an extrapolation. If the curve contains an undetermined speed
scale, the extrapolation is unreliable and must fade, without reducing the supported friction. For a
curve with an undetermined speed scale, v_1 is a quarter of the lowest supported speed, at which s =
0.999.

alpha is the acceleration of the reference at the reversal. The reference has the speed sqrt(2 alpha
x) a distance x after the reversal, and the speed alpha t a time t after the reversal.

x is the distance within which friction is far from its steady value. The deficit D right after a
reversal decays as exp(-x/l). A bristle that carries the part a of the level G has D = 2 a and l =
x_c. Rate-and-state friction after sliding at V has D = B ln(1 + V/v_c) and l = L. A bristle that
carries the whole level (Dahl's, a = G) has the deficit 2 G/e at x = l. The deficit 2 G/e defines x
in all cases:

    x = l (1 + ln(D/(2 G))),  0 if D < 2 G/e

Play and a soft transmission make the load reverse later than the motor. The record does not show
play or a soft transmission; include them in the time t.

Source: compensation by a model of friction, and its effect at velocity reversals:
Armstrong-Helouvry, Dupont and Canudas de Wit (1994, doi:10.1016/0005-1098(94)90209-7) and Olsson,
Astrom, Canudas de Wit, Gafvert and Lischinsky (1998, doi:10.1016/S0947-3580(98)70113-X); presliding
over a distance: Canudas de Wit, Olsson, Astrom and Lischinsky (1995, doi:10.1109/9.376053). Servo
drives fade linearly over a speed set by the user (VSTFR of Beckhoff's AX2000). The rule v_f =
max(v_1, v_2, v_3) for the fade speed is a choice of jaxfric.
"""

import math
from collections.abc import Sequence
from typing import Final, Literal, NamedTuple

WHOLE: Final = 4
"""v/v_f above which the fade is negligible: s = 0.999."""
_PART = {2: "half", WHOLE: "a quarter"}


class Memory(NamedTuple):
    """Friction deficit after a reversal, and the distance over which it decays."""

    effect: str
    symbol: str
    """Symbol of the length."""
    length: float
    """l [m or rad]."""
    missing: float
    """D [F]."""


class FadeReason(NamedTuple):
    """One reason for a compensation to fade below a speed."""

    name: str
    """ "rows", "memory", "lag" or "given"."""
    speed: float
    """[m/s or rad/s]; nan if it needs an unknown acceleration."""
    text: str


class Fade(NamedTuple):
    """The reasons for a compensation to fade below a speed, of which the largest speed counts."""

    reasons: tuple[FadeReason, ...]

    @property
    def speed(self) -> float:
        """v_f of s(v) = tanh(v/v_f) [m/s or rad/s]."""
        return self._deciding().speed

    @property
    def decided_by(self) -> str:
        """The name of the reason with the largest speed."""
        return self._deciding().name

    @property
    def why(self) -> str:
        """The reason with the largest speed, in words."""
        return self._deciding().text

    def _deciding(self) -> FadeReason:
        known = [one for one in self.reasons if not math.isnan(one.speed)]
        return max(known, key=lambda one: one.speed)


def return_distance(memory: Memory, level: float) -> float:
    """x = l (1 + ln(D/(2 G))) [m or rad], 0 for an initial deficit below 2 G/e.

    level : G, the friction that changes sign [F].
    """
    share = memory.missing / (2 * level)
    return max(memory.length * (1 + math.log(share)), 0.0) if share > 0 else 0.0


def fade_speed(
    slowest: float,
    level: float,
    *,
    memories: Sequence[Memory] = (),
    acceleration: float | None = None,
    lag: float | None = None,
    unit: str = "m",
    known: str = "the slowest motion that is known",
    part: Literal[2, 4] = 2,
) -> Fade:
    """Compute the fade speed by the equations of this module, and the reasons for it.

    Parameters
    ----------
    slowest : v_slow, the slowest known motion [m/s or rad/s].
    level : G, the friction that changes sign [F].
    memories : friction deficits after a reversal.
    acceleration : alpha, of the reference at reversals [m/s^2 or rad/s^2]; None: unknown, and
        reasons that need it have no speed.
    lag : t, by which the axis reverses later than the reference [s].
    unit : of the position, for the texts.
    known : meaning of `slowest`, for the texts.
    part : v_slow/v_1.

    Play and a soft transmission are not considered.
    """
    reasons = [
        FadeReason(
            "rows",
            slowest / part,
            f"{_PART[part]} of {slowest:.3g} {unit}/s, {known};"
            f" {100 * math.tanh(part):.3g} % of friction are compensated there",
        )
    ]
    alpha = math.nan if acceleration is None else acceleration
    rest = f"speed of the reference then, at {alpha:.3g} {unit}/s^2"
    if math.isnan(alpha):
        rest = f"needs the acceleration of the reference at reversals, in {unit}/s^2"
    for one in memories:
        x = return_distance(one, level)
        if x == 0:  # the deficit is negligible at once
            continue
        told = f"after a reversal friction recovers over {x:.3g} {unit} ({one.effect},"
        told += f" {one.symbol} = {one.length:.3g} {unit}); "
        reasons.append(FadeReason("memory", math.sqrt(2 * alpha * x), told + rest))
    if lag:
        told = f"the axis reverses {lag:.3g} s after its reference; "
        reasons.append(FadeReason("lag", alpha * lag, told + rest))
    return Fade(tuple(reasons))
