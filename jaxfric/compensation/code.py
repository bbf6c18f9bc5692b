"""A feedforward as C99: one function for the friction map, one for the whole feedforward."""

import math
import re
import textwrap
from collections.abc import Sequence

from ..errors import InputError, option
from .fade import Fade
from .identified import Identified
from .pieces import INERTIA, SIGN, Piece, plain_formula, uses_position

_WIDTH = 88
_TAKEN = frozenset(
    """auto break case char const continue default do double else enum extern float for goto if
    inline int long register restrict return short signed sizeof static struct switch typedef
    union unsigned void volatile while""".split()  # noqa: SIM905
)


def c_code(
    about: Identified,
    pieces: Sequence[Piece],
    fade: Fade,
    notes: Sequence[str] = (),
    held: float = math.inf,
    *,
    name: str = "axis",
    made_by: Sequence[str] = (),
) -> str:
    """Return the source of NAME_compensation(v) and NAME_feedforward(v, a), for -std=c99.

    The source includes only math.h. If friction depends on position, the feedforward is
    NAME_feedforward(q, v, a), and NAME_compensation holds for the middle of the travel, without
    ripples and weight. Below the fade speed the compensation is less than the friction.

    Parameters
    ----------
    about, pieces : the axis and the terms of its feedforward.
    fade : the fade speed v_f of the sign, with its reason.
    notes : omitted effects and limits, for the head comment.
    held : the speed above which friction keeps its value.
    name : of the axis, a C identifier.
    made_by : lines on the origin of the code, for the head comment.

    Raises
    ------
    InputError : `name` is not a C identifier.
    """
    if not re.fullmatch(r"[A-Za-z_]\w*", name, re.ASCII) or name in _TAKEN:
        raise InputError(
            f"{option('name', name)} is not a C identifier; use letters, digits, _: axis_1"
        )
    inertia = any(p.part == INERTIA for p in pieces)
    arguments = ["double q"] if uses_position(pieces) else []
    arguments += ["double v"] + (["double a"] if inertia else [])
    static = [p for p in pieces if p.part != INERTIA and not p.ripple]
    head = [f"{name}: friction compensation from {about.source}", *_head(about, pieces, fade)]
    head += [*notes, *made_by]
    known = f"the record supports it from {about.supported_text}; elsewhere it is a guess"
    sign = ["    v = v > held ? held : v < -held ? -held : v;"] * math.isfinite(held)
    sign.append("    const double s = tanh(v / fade_speed);")
    lines = [
        *_comment(head),
        "#include <math.h>",
        "",
        *_constants(about, pieces, fade.speed, held),
        "",
        *_comment([f"compensation of friction at the velocity v, in {about.force_unit}", known]),
        f"double {name}_compensation(double v)",
        "{",
        *sign,
    ]
    if uses_position(pieces, ripple=False):
        lines.append("    const double q = middle_of_travel;")
    lines += [*_returned(_expression(static)), "}", ""]
    told = "with the inertia" if inertia else "without inertia, which is not known"
    lines += _comment([f"feedforward of the reference, in {about.force_unit}: {told}"])
    lines += [
        f"double {name}_feedforward({', '.join(arguments)})",
        "{",
        *sign,
        *_returned(_expression(pieces)),
        "}",
    ]
    return "\n".join(lines) + "\n"


def _head(about: Identified, pieces: Sequence[Piece], fade: Fade) -> list[str]:
    length = about.length
    units = f"v in {length}/s"
    if any(p.part == INERTIA for p in pieces):
        units += f", a in {length}/s^2"
    if uses_position(pieces):
        units = f"q in {length} (the position of the record, with its zero), {units}"
    return [
        f"u = {plain_formula(pieces, fade.speed).partition(' = ')[2]}",
        f"u in {about.force_unit}; {units}, all of the reference, not measured",
        f"the record supports it from {about.supported_text} in both directions; elsewhere it is"
        " a guess",
        about.below,
        f"the sign fades below v_f = {fade.speed:.4g} {length}/s: {fade.why}",
        "below v_f the compensation is less than the friction; feedforward.csv has both",
    ]


def _constants(about: Identified, pieces: Sequence[Piece], fade: float, held: float) -> list[str]:
    length = about.length
    rows = [("fade_speed", fade, f"{length}/s, below it the sign fades")]
    if math.isfinite(held):
        rows.append(("held", held, f"{length}/s, above it friction keeps its value there"))
    if uses_position(pieces, ripple=False):
        rows.append(("middle_of_travel", about.middle, length))
    shapes = {}
    for piece in pieces:
        error = f" +- {piece.std:.2g}" if piece.std == piece.std else ", not determined alone"
        rows.append((piece.name, piece.value, f"{piece.unit}{error}"))
        for name, value in piece.shapes.items():
            loose = ", not determined by the record" if name in about.loose else ""
            shapes[name] = name, value, f"{about.unit(name)}{loose}"
    return [
        f"static const double {_constant(name)} = {float(value)!r}; /* {text} */"
        for name, value, text in (*rows, *shapes.values())
    ]


def _constant(name: str) -> str:
    """The C name of a parameter or a coefficient."""
    return re.sub(r"\W+", "_", name)


def _expression(pieces: Sequence[Piece]) -> list[str]:
    """The terms of the sum, one a line."""

    def product(piece: Piece) -> str:
        return f"{_constant(piece.name)} * {piece.code}" if piece.code else _constant(piece.name)

    outside = [product(p) for p in pieces if p.part != SIGN]
    level = [product(p) for p in pieces if p.part == SIGN]
    return [*outside, f"s * ({' + '.join(level)})"]


def _returned(terms: Sequence[str]) -> list[str]:
    first, *rest = terms
    lines = [f"    return {first}", *(f"        + {term}" for term in rest)]
    lines[-1] += ";"
    return lines


def _comment(lines: Sequence[str]) -> list[str]:
    """Format lines as a C comment; escape what would end it or open another."""
    safe = [
        re.sub(r"\?(?=\?)", "? ", line.replace("*/", "* /").replace("/*", "/ *")) for line in lines
    ]
    folded = [
        text.encode("ascii", "backslashreplace").decode()
        for line in safe
        for text in textwrap.wrap(
            " ".join(line.split()), _WIDTH, subsequent_indent="  ", break_on_hyphens=False
        )
    ]
    lines = [f"/* {folded[0]}", *(f"   {line}" for line in folded[1:])]
    return [*lines[:-1], f"{lines[-1]} */"]
