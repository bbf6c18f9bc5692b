"""A feedforward as a formula: in plain text, and in LaTeX."""

from collections.abc import Callable, Sequence

from .pieces import INERTIA, PLAIN, SIGN, Piece, latex_number, uses_position

_FACTOR: dict[bool, Callable[[Piece], str]] = {
    False: lambda piece: piece.text,
    True: lambda piece: piece.latex,
}


def plain_formula(pieces: Sequence[Piece], fade: float) -> str:
    """The formula in one line, SI: "u = 95.1 a + 203 v - 3.19 + s (20.4), s = tanh(v/0.01)"."""
    return f"u({_arguments(pieces)}) = {_body(pieces, latex=False)},  s = tanh(v/{fade:.5g})"


def latex_formula(pieces: Sequence[Piece], fade: float) -> str:
    """The formula as LaTeX, for an equation."""
    return (
        rf"u({_arguments(pieces)}) = {_body(pieces, latex=True)}, \qquad"
        rf" s = \tanh(v/{latex_number(fade)})"
    )


def _arguments(pieces: Sequence[Piece]) -> str:
    names = ["q"] if uses_position(pieces) else []
    inertia = ["a"] if any(p.part == INERTIA for p in pieces) else []
    return ", ".join([*names, "v", *inertia])


def _body(pieces: Sequence[Piece], *, latex: bool) -> str:
    outside = [p for p in pieces if p.part in (INERTIA, PLAIN)]
    level = _sum([p for p in pieces if p.part == SIGN], latex)
    space = r"\," if latex else " "
    return f"{_sum(outside, latex)} + s{space}({level})"


def _sum(pieces: Sequence[Piece], latex: bool) -> str:
    text = ""
    for piece in pieces:
        size = abs(piece.value)
        number = latex_number(size) if latex else f"{size:.5g}"
        factor = _FACTOR[latex](piece)
        term = f"{number}{(chr(92) + ',' if latex else ' ') if factor else ''}{factor}"
        sign = "-" if piece.value < 0 else "+"
        text += f" {sign} {term}" if text else (f"-{term}" if piece.value < 0 else term)
    return text or "0"
