"""The terms of a feedforward, each a number times a function of the motion, and omitted effects.

    u = M a + R(q, v) + s(v) G(q, v)

q, v, a are position, velocity and acceleration of the reference. A term has a plain text, a LaTeX
and a C form; `formula` and `code` format the numbers in these forms.
"""

import math
import re
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

from ..effects import AbstractEffect, effect_of
from ..effects.axis import (
    AxisPositionPeriodic,
    AxisSensorDelay,
    AxisSensorLag,
    AxisServoLag,
    AxisStribeck,
    AxisTimeDrift,
    Cubic,
    DirectionAsymmetry,
    Gravity,
    LogViscous,
    PositionDependence,
    Presliding,
    RateAndState,
)
from ..errors import InputError, option
from ..rig.axis import AxisRig
from .identified import Identified

INERTIA, PLAIN, SIGN = "inertia", "plain", "sign"
"""Parts of the formula: M a, R and G."""
_SURE = 2.0
"""Least ratio of a compensated inertia to its standard error."""


class Piece(NamedTuple):
    """One term: a coefficient times a factor; the factor 1 is ""."""

    name: str
    value: float
    std: float
    """Standard error; 0 for a given value, nan for an undetermined one."""
    unit: str
    part: str
    """`INERTIA`, `PLAIN` or `SIGN`."""
    text: str = ""
    latex: str = ""
    code: str = ""
    """The factor in C; its constants are `shapes`."""
    shapes: Mapping[str, float] = {}
    """Constants of the factor, by their name in C."""
    ripple: bool = False
    """Whether it is a ripple or a weight, which the static map omits."""


class Terms(NamedTuple):
    """Terms of a feedforward, effects in the friction curve, and omitted effects in words."""

    pieces: tuple[Piece, ...]
    effects: tuple[type[AbstractEffect], ...]
    left_out: tuple[str, ...]


def terms_of(about: Identified) -> Terms:
    """Return the terms that compensate an identified axis.

    Raises
    ------
    InputError : a friction effect without a formula.
    """
    pieces, left_out = _base(about)
    inside = []
    for id in about.effects:
        effect = effect_of(id, AxisRig)
        if id in _LEFT_OUT:
            left_out.append(f"{id}: {_LEFT_OUT[id](about)}")
        elif id in _MADE:
            made = _MADE[id](about)
            pieces += made
            inside += [] if any(p.ripple for p in made) else [effect]
        else:
            raise InputError(
                f"effect '{id}' of {about.source} has no formula for a feedforward; run the loop"
                f" without it ({option('exclude')})"
            )
    return Terms(tuple(pieces), tuple(inside), tuple(left_out))


def _base(about: Identified) -> tuple[list[Piece], list[str]]:
    pieces, left_out = [], []
    if "M" not in about.values:
        left_out.append("inertia: runs at steady speeds do not determine it")
    else:
        inertia = _piece(about, "M", INERTIA, "a", "a")
        if math.isfinite(inertia.std) and inertia.value > _SURE * inertia.std:
            pieces.append(inertia)
        else:
            left_out.append("inertia: the record does not determine it")
    pieces.append(_piece(about, "F_v", PLAIN, "v", "v"))
    pieces.append(_piece(about, "F_0", PLAIN))
    pieces.append(_piece(about, "F_c", SIGN))
    return pieces, left_out


def _piece(about: Identified, name: str, part: str, text: str = "", code: str = "") -> Piece:
    std = about.std({name: 1.0})
    return Piece(name, about.values[name], std, about.unit(name), part, text, text, code)


def _direction_asymmetry(about: Identified) -> list[Piece]:
    return [_piece(about, "direction_asymmetry.d", SIGN, "v", "v")]


def _cubic(about: Identified) -> list[Piece]:
    one = _piece(about, "cubic.c", PLAIN, "v^3")
    return [one._replace(code="v * v * v")]


def _stribeck(about: Identified) -> list[Piece]:
    vs, n = about.values["stribeck.vs"], about.values["stribeck.n"]
    one = _piece(about, "stribeck.fs", SIGN, f"exp(-(|v|/{_n(vs)})^{_n(n)})")
    return [
        one._replace(
            latex=rf"e^{{-(|v|/{latex_number(vs)})^{{{latex_number(n)}}}}}",
            code="exp(-pow(fabs(v) / stribeck_vs, stribeck_n))",
            shapes={"stribeck_vs": vs, "stribeck_n": n},
        )
    ]


def _log(about: Identified, piece: Piece, name: str) -> list[Piece]:
    """A term c ln(1 + |v|/v_c); v_c is at least the width of the record's sign."""
    v_c, constant = max(about.values[name], about.width), name.replace(".", "_")
    return [
        piece._replace(
            text=f"ln(1 + |v|/{_n(v_c)})",
            latex=rf"\ln(1 + |v|/{latex_number(v_c)})",
            code=f"log(1.0 + fabs(v) / {constant})",
            shapes={constant: v_c},
        )
    ]


def _log_viscous(about: Identified) -> list[Piece]:
    return _log(about, _piece(about, "log_viscous.c", SIGN), "log_viscous.v_c")


def _rate_and_state(about: Identified) -> list[Piece]:
    """In steady motion the state is -B ln(1 + |v|/v_c)."""
    A, B = "rate_and_state.A", "rate_and_state.B"
    less, std = about.values[A] - about.values[B], about.std({A: 1.0, B: -1.0})
    one = Piece("rate_and_state.A - B", less, std, about.unit(A), SIGN)
    return _log(about, one, "rate_and_state.v_c")


def _position_dependence(about: Identified) -> list[Piece]:
    pairs = (("k", PLAIN), ("m", SIGN))
    return [_piece(about, f"position_dependence.{name}", part, "q", "q") for name, part in pairs]


def _position_periodic(about: Identified) -> list[Piece]:
    wave = about.values["position_periodic.wavelength"]
    found = []
    for name, function in (("c", "cos"), ("s", "sin")):
        one = _piece(about, f"position_periodic.{name}", PLAIN, f"{function}(2 pi q/{_n(wave)})")
        found.append(
            one._replace(
                latex=rf"\{function}(2\pi q/{latex_number(wave)})",
                code=f"{function}(6.283185307179586 * q / position_periodic_wavelength)",
                shapes={"position_periodic_wavelength": wave},
                ripple=True,
            )
        )
    return found


def _gravity(about: Identified) -> list[Piece]:
    found = []
    for name, function in (("a", "sin"), ("b", "cos")):
        one = _piece(about, f"gravity.{name}", PLAIN, f"{function}(q)", f"{function}(q)")
        found.append(one._replace(latex=rf"\{function} q", ripple=True))
    return found


def _drift(about: Identified) -> str:
    unit = about.unit("time_drift.r")
    r, s = about.values["time_drift.r"], about.values["time_drift.s"]
    return (
        "it depends on the time of the record; the friction at its beginning is compensated."
        f" In the record the offset drifted by {r:.3g} {unit}, Coulomb friction by {s:.3g} {unit}"
    )


def _bristle(about: Identified) -> str:
    return (
        "in steady motion it adds nothing; the fade speed takes its recovery after a reversal into"
        " account"
    )


def _lag(about: Identified) -> str:
    tau = about.values["servo_lag.tau"]
    return (
        f"the motor's force lags its command by {tau:.3g} s; to compensate the lag, add {tau:.3g} s"
        " times the rate of change of the feedforward. The fade speed takes the lag into account"
    )


def _of_record(about: Identified) -> str:
    return "it belongs to the recorder, not to the axis; the friction was fitted together with it"


_MADE: dict[str, Callable[[Identified], Sequence[Piece]]] = {
    DirectionAsymmetry.id: _direction_asymmetry,
    Cubic.id: _cubic,
    AxisStribeck.id: _stribeck,
    LogViscous.id: _log_viscous,
    RateAndState.id: _rate_and_state,
    Gravity.id: _gravity,
    PositionDependence.id: _position_dependence,
    AxisPositionPeriodic.id: _position_periodic,
}
_LEFT_OUT: dict[str, Callable[[Identified], str]] = {
    AxisTimeDrift.id: _drift,
    Presliding.id: _bristle,
    AxisServoLag.id: _lag,
    AxisSensorLag.id: _of_record,
    AxisSensorDelay.id: _of_record,
}


def uses_position(pieces: Sequence[Piece], *, ripple: bool = True) -> bool:
    """Whether a term depends on position; ripples and weight count only if `ripple`."""
    return any(re.search(r"\bq\b", p.code) for p in pieces if ripple or not p.ripple)


def shape_text(about: Identified, name: str) -> str:
    """The unit of a factor's constant, by its C name, with a note if it is undetermined."""
    full = next((full for full in about.values if full.replace(".", "_") == name), None)
    unit = "1" if full is None else about.unit(full)
    return f"{unit}, not determined by the record" if full in about.loose else unit


def _n(value: float) -> str:
    return f"{value:.5g}"


def latex_number(value: float, digits: int = 5) -> str:
    """A number in LaTeX."""
    mantissa, _, power = f"{value:.{digits}g}".partition("e")
    return rf"{mantissa}\cdot 10^{{{int(power)}}}" if power else mantissa
