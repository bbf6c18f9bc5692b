"""The speed below which a compensation of friction should fade.

Friction of an axis jumps by twice its level where the velocity changes sign. A feedforward that
jumps too jumps at another moment than friction, as the axis turns later than its reference and
friction comes back over a distance; until both agree the compensation pushes the axis with up to
twice the level of friction. So the part of the feedforward that has the sign of the velocity v is
multiplied by

    s(v) = tanh(v/v_f),    v_f = max(v_1, v_2, v_3)

    v_1 = v_slow/2           v_slow: the slowest motion that is known. s(v_slow) = 0.96
    v_2 = sqrt(2 alpha x)    x: friction has come back after the axis has moved so far
    v_3 = alpha t            t: the axis turns so much later than the reference

v_slow is the speed from which rows count in the fit; of steady speeds, the slowest run. Few rows
may be slower than the speed from which the record supports the friction: between the two it is the
fitted curve continued. Where a speed at which that curve bends is not determined, nothing holds the
continuation. It fades then as far as leaves the supported friction whole: v_1 is a quarter of the
slowest speed that the record supports, at which s = 0.999.

alpha is the acceleration of the reference where it turns: a distance x after that its speed is
sqrt(2 alpha x), a time t after it alpha t.

x is the distance within which friction is far from its steady value. What is missing right after a
reversal, D, decays as exp(-x/l): D = 2 a and l = x_c of a bristle that carries the part a of the
level G, D = B ln(1 + V/v_c) and l = L of rate-and-state friction that comes from the speed V. A
bristle that carries all (Dahl's, a = G) is at x = l still 2 G/e away from its steady value, and for
any other the same is called far:

    x = l (1 + ln(D/(2 G))),  0 where D < 2 G/e

Between v_1 and what this record does not tell nothing is derived: play and a soft transmission turn
the load later than the motor, and are for t to state.

Source: compensation by a model of friction, and what it does where the velocity changes sign:
Armstrong-Helouvry, Dupont and Canudas de Wit (1994, doi:10.1016/0005-1098(94)90209-7) and Olsson,
Astrom, Canudas de Wit, Gafvert and Lischinsky (1998, doi:10.1016/S0947-3580(98)70113-X); presliding
over a distance: Canudas de Wit, Olsson, Astrom and Lischinsky (1995, doi:10.1109/9.376053). Servo
drives fade by a straight line over a speed that the user states (VSTFR of Beckhoff's AX2000). The
rule above is this project's own.
"""

import math
from collections.abc import Sequence
from typing import Final, Literal, NamedTuple

WHOLE: Final = 4
"""v/v_f from which the fade leaves friction whole: s = 0.999."""
_PART = {2: "half", WHOLE: "a quarter"}


class Known(NamedTuple):
    """What the slowest motion v_slow is."""

    why: str
    """In words."""
    part: Literal[2, 4] = 2
    """v_slow/v_1."""


SLOWEST = Known("the slowest motion that is known")


class Memory(NamedTuple):
    """What friction lacks after a reversal, and how far it takes to come back."""

    effect: str
    symbol: str
    """That of the length."""
    length: float
    """l [m or rad]."""
    missing: float
    """D [F]."""


class FadeReason(NamedTuple):
    """One reason for a compensation to fade below a speed."""

    name: str
    """ "rows", "memory", "lag" or "given"."""
    speed: float
    """[m/s or rad/s]; nan where it needs what is not known."""
    text: str


class Fade(NamedTuple):
    """The speed below which a compensation fades, with all that was weighed."""

    speed: float
    """v_f of s(v) = tanh(v/v_f) [m/s or rad/s]."""
    reasons: tuple[FadeReason, ...]

    @property
    def decided_by(self) -> str:
        """The name of the reason that asks for the largest speed."""
        return self._deciding().name

    @property
    def why(self) -> str:
        """The reason that asks for the largest speed, in words."""
        return self._deciding().text

    def _deciding(self) -> FadeReason:
        known = [one for one in self.reasons if not math.isnan(one.speed)]
        return max(known, key=lambda one: one.speed)


def return_distance(memory: Memory, level: float) -> float:
    """x = l (1 + ln(D/(2 G))) [m or rad], 0 where friction lacks less than 2 G/e at once.

    level : G [F], that of the friction which changes sign.
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
    known: Known = SLOWEST,
) -> Fade:
    """The fade speed of the module's equations, and what asks for it.

    Parameters
    ----------
    slowest : v_slow, the slowest motion that is known [m/s or rad/s].
    level : G, the friction that changes sign [F].
    memories : what friction lacks after a reversal.
    acceleration : alpha, of the reference where it turns [m/s^2 or rad/s^2]; None: not known, and
        then what needs it is told without a speed.
    lag : t, by which the axis turns later than the reference [s].
    unit : of the position, for the texts.
    known : what `slowest` is, and how much of it v_1 is.

    Not tried: play, a soft transmission.
    """
    reasons = [
        FadeReason(
            "rows",
            slowest / known.part,
            f"{_PART[known.part]} of {slowest:.3g} {unit}/s, {known.why};"
            f" {100 * math.tanh(known.part):.3g} % of friction are compensated there",
        )
    ]
    alpha = math.nan if acceleration is None else acceleration
    rest = f"the reference has that speed then, at {alpha:.3g} {unit}/s^2"
    if math.isnan(alpha):
        rest = f"needs the acceleration of the reference where it turns, in {unit}/s^2"
    for one in memories:
        x = return_distance(one, level)
        if x == 0:
            told = f"after a reversal friction lacks {one.missing:.3g} of 2 x {level:.3g}"
            told += f" ({one.effect}), too little to wait for"
            reasons.append(FadeReason("memory", 0.0, told))
            continue
        told = f"after a reversal friction comes back over {x:.3g} {unit} ({one.effect},"
        told += f" {one.symbol} = {one.length:.3g} {unit}); "
        reasons.append(FadeReason("memory", math.sqrt(2 * alpha * x), told + rest))
    if lag:
        told = f"the axis turns {lag:.3g} s after its reference; "
        reasons.append(FadeReason("lag", alpha * lag, told + rest))
    speeds = [one.speed for one in reasons if not math.isnan(one.speed)]
    return Fade(max(speeds), tuple(reasons))
