"""Tables as LaTeX (booktabs)."""

from collections.abc import Sequence

DAGGER = r"$^{\dagger}$"


def latex_of(
    columns: str,
    heads: Sequence[Sequence[str]],
    rows: Sequence[Sequence[str]],
    notes: Sequence[str] = (),
    remark: str = "",
) -> str:
    """A table of LaTeX cells: column format, head lines, rows, and notes below the table.

    A `remark` becomes a comment in the LaTeX source.
    """
    wide = len(heads[0])
    lines = [
        rf"\begin{{tabular}}{{{columns}}}",
        r"\toprule",
        *map(_line, heads),
        r"\midrule",
        *map(_line, rows),
        r"\bottomrule",
        *(_line([rf"\multicolumn{{{wide}}}{{l}}{{\footnotesize {note}}}"]) for note in notes),
        r"\end{tabular}",
        rf"% \usepackage{{booktabs}}; {remark}",
    ]
    return "\n".join([*lines, ""])


def _line(cells: Sequence[str]) -> str:
    return " & ".join(cells) + r" \\"


def latex_cells(cells: Sequence[str] | None, count: int = 4) -> list[str]:
    """Put numbers in math mode, or "no fit" across all columns if no number is given."""
    if cells is None or not any(cells):
        return [rf"\multicolumn{{{count}}}{{c}}{{no fit}}"]
    return [f"${cell}$" if cell[:1] in set("-0123456789") else cell for cell in cells]


def plain(text: str) -> str:
    """Text with the special characters of LaTeX escaped."""
    own = {c: f"\\{c}" for c in "&%$#_{}"} | {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}"}
    own |= {"^": r"\textasciicircum{}", "Δ": r"$\Delta$", "σ": r"$\sigma$", "µ": r"$\mu$"}
    return "".join(own.get(c, c) for c in text)
