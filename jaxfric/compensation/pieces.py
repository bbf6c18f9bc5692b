"""The terms of a feedforward, each a number times a function of the motion, and omitted effects.

    u = M a + R(q, v) + s(v) G(q, v)

q, v, a are position, velocity and acceleration of the reference. A term has a plain text, a LaTeX
and a C form. This module makes the formula in plain text and in LaTeX; the module `code` makes the
C functions.
"""

import re
from collections.abc import Callable, Sequence
from typing import NamedTuple

from ..effects import AbstractEffect, effect_of
from ..errors import InputError, option
from ..rig.axis import AxisRig
from .identified import Identified

INERTIA, PLAIN, SIGN = "inertia", "plain", "sign"
"""Parts of the formula: M a, R and G."""
_SURE = 2.0
"""Least ratio of a compensated inertia to its standard error."""


class Factor(NamedTuple):
    """The function of the motion in a term; "{x}" stands for parameter x of the term's effect."""

    part: str
    """`INERTIA`, `PLAIN` or `SIGN`."""
    text: str = ""
    """In plain text; "" for 1."""
    latex: str = ""
    code: str = ""
    ripple: bool = False
    """Whether the term is a ripple or a weight, which the static map omits."""


_LOG = Factor(SIGN, "ln(1 + |v|/{v_c})", r"\ln(1 + |v|/{v_c})", "log(1.0 + fabs(v) / {v_c})")


def _wave(function: str) -> Factor:
    return Factor(
        PLAIN,
        f"{function}(2 pi q/{{wavelength}})",
        rf"\{function}(2\pi q/{{wavelength}})",
        f"{function}(6.283185307179586 * q / {{wavelength}})",
        ripple=True,
    )


_FACTORS = {
    "M": Factor(INERTIA, "a", "a", "a"),
    "F_v": Factor(PLAIN, "v", "v", "v"),
    "F_0": Factor(PLAIN),
    "F_c": Factor(SIGN),
    "direction_asymmetry.d": Factor(SIGN, "v", "v", "v"),
    "cubic.c": Factor(PLAIN, "v^3", "v^3", "v * v * v"),
    "stribeck.fs": Factor(
        SIGN,
        "exp(-(|v|/{vs})^{n})",
        r"e^{{-(|v|/{vs})^{{{n}}}}}",
        "exp(-pow(fabs(v) / {vs}, {n}))",
    ),
    "log_viscous.c": _LOG,
    "rate_and_state.A - B": _LOG,  # in steady motion the state is -B ln(1 + |v|/v_c)
    "gravity.a": Factor(PLAIN, "sin(q)", r"\sin q", "sin(q)", ripple=True),
    "gravity.b": Factor(PLAIN, "cos(q)", r"\cos q", "cos(q)", ripple=True),
    "position_dependence.k": Factor(PLAIN, "q", "q", "q"),
    "position_dependence.m": Factor(SIGN, "q", "q", "q"),
    "position_periodic.c": _wave("cos"),
    "position_periodic.s": _wave("sin"),
}
"""By effect and parameter, or by a difference of two parameters."""
_OF_RECORD = "it belongs to the recorder, not to the axis; the friction was fitted together with it"
_LEFT_OUT: dict[str, Callable[[Identified], str]] = {
    "time_drift": lambda about: (
        "it depends on the time of the record; the friction at its beginning is compensated. In the"
        f" record the offset drifted by {about.values['time_drift.r']:.3g}"
        f" {about.unit('time_drift.r')}, Coulomb friction by {about.values['time_drift.s']:.3g}"
        f" {about.unit('time_drift.s')}"
    ),
    "presliding": lambda _: (
        "in steady motion it adds nothing; the fade speed takes its recovery after a reversal into"
        " account"
    ),
    "servo_lag": lambda about: (
        f"the motor's force lags its command by {about.values['servo_lag.tau']:.3g} s; to"
        " compensate the lag, add this time times the rate of change of the feedforward. The fade"
        " speed takes the lag into account"
    ),
    "sensor_lag": lambda _: _OF_RECORD,
    "sensor_delay": lambda _: _OF_RECORD,
}


class Piece(NamedTuple):
    """One term: a coefficient times a factor, whose parameters are filled in (`Factor`)."""

    name: str
    value: float
    std: float
    """Standard error; 0 for a given value, nan for an undetermined one."""
    unit: str
    shapes: dict[str, float]
    """Parameters in the factor, by effect.parameter; C names have "_" for "."."""
    part: str
    text: str
    latex: str
    code: str
    ripple: bool


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
    left_out, inside = [], []
    pieces = [_piece(about, name) for name in ("M", "F_v", "F_0", "F_c") if name in about.values]
    if "M" not in about.values:
        left_out.append("inertia: runs at steady speeds do not determine it")
    elif not pieces[0].value > _SURE * pieces[0].std:
        left_out.append("inertia: the record does not determine it")
        del pieces[0]
    for id in about.effects:
        made = [_piece(about, name) for name in _FACTORS if name.startswith(f"{id}.")]
        if id in _LEFT_OUT:
            left_out.append(f"{id}: {_LEFT_OUT[id](about)}")
        elif made:
            pieces += made
            inside += [] if any(p.ripple for p in made) else [effect_of(id, AxisRig)]
        else:
            raise InputError(
                f"effect '{id}' of {about.source} has no formula for a feedforward; run the loop"
                f" without it ({option('exclude')})"
            )
    return Terms(tuple(pieces), tuple(inside), tuple(left_out))


def _piece(about: Identified, name: str) -> Piece:
    """A term with its error. A v_c is at least the width of the record's smoothed sign."""
    factor, (effect, dot, symbols) = _FACTORS[name], name.rpartition(".")
    first, *other = (f"{effect}{dot}{symbol}" for symbol in symbols.split(" - "))
    weights = {first: 1.0} | dict.fromkeys(other, -1.0)
    value = sum(weight * about.values[n] for n, weight in weights.items())
    inside = {s: about.values[f"{effect}.{s}"] for s in re.findall(r"{(\w+)}", factor.text)}
    if "v_c" in inside:
        inside["v_c"] = max(inside["v_c"], about.width)
    shapes = {f"{effect}.{s}": x for s, x in inside.items()}
    text = factor.text.format(**{s: f"{x:.5g}" for s, x in inside.items()})
    latex = factor.latex.format(**{s: latex_number(x) for s, x in inside.items()})
    code = factor.code.format(**{s: f"{effect}_{s}" for s in inside})
    told = value, about.std(weights), about.unit(first), shapes
    return Piece(name, *told, factor.part, text, latex, code, factor.ripple)


def uses_position(pieces: Sequence[Piece], *, ripple: bool = True) -> bool:
    """Whether a term depends on position; ripples and weight count only if `ripple`."""
    return any(re.search(r"\bq\b", p.code) for p in pieces if ripple or not p.ripple)


# ---- the formula -------------------------------------------------------------------------------


def plain_formula(pieces: Sequence[Piece], fade: float) -> str:
    """The formula in one line, SI: "u = 95.1 a + 203 v - 3.19 + s (20.4), s = tanh(v/0.01)"."""
    outside, level = _sums([(p, f"{abs(p.value):.5g} {p.text}".strip()) for p in pieces])
    return f"u({_arguments(pieces)}) = {outside} + s ({level}),  s = tanh(v/{fade:.5g})"


def latex_formula(pieces: Sequence[Piece], fade: float) -> str:
    """The formula as LaTeX, for an equation."""
    terms = [(p, rf"{latex_number(abs(p.value))}\,{p.latex}".removesuffix(r"\,")) for p in pieces]
    outside, level = _sums(terms)
    return (
        rf"u({_arguments(pieces)}) = {outside} + s\,({level}), \qquad"
        rf" s = \tanh(v/{latex_number(fade)})"
    )


def latex_number(value: float) -> str:
    """A number in LaTeX."""
    mantissa, _, power = f"{value:.5g}".partition("e")
    return rf"{mantissa}\cdot 10^{{{int(power)}}}" if power else mantissa


def _arguments(pieces: Sequence[Piece]) -> str:
    inertia = ["a"] if any(p.part == INERTIA for p in pieces) else []
    return ", ".join([*(["q"] if uses_position(pieces) else []), "v", *inertia])


def _sums(terms: Sequence[tuple[Piece, str]]) -> list[str]:
    """The sums of the terms outside the brackets of s, and within them."""
    sums = ["", ""]
    for piece, term in terms:
        sums[piece.part == SIGN] += f" {'-' if piece.value < 0 else '+'} {term}"
    return [("-" if x.startswith(" - ") else "") + x[3:] or "0" for x in sums]
