"""The answer of a closed loop in a few lines: what a terminal shows unless it is asked for more."""

import math
from typing import TYPE_CHECKING

from ..fitting import Estimate
from ..loop.result import Loop
from .loop_text import answer, headline, length_of, meaning, moved, shown_unit, test_errors
from .tables import TextTable, print_tables

if TYPE_CHECKING:
    from rich.console import Console

MOST_ROWS = 10
"""Parameters that a terminal shows: with headline, next commands and files a screen of 20 lines."""


def with_error(value: float, std: float) -> str:
    """A value with its standard error in units of its last digit, "−0.01101(1)" or "248(90)".

    The error has one digit, or two where the first is a 1; without an error four digits.
    """
    if not (math.isfinite(std) and std > 0):
        return f"{value:.4g}".replace("-", "−")
    exponent = math.floor(math.log10(std))
    if round(std / 10.0**exponent, 9) < 2:
        exponent -= 1
    digits = max(-exponent, 0)
    error = round(std * 10.0**digits) if exponent < 0 else round(std, -exponent)
    text = f"{value:.{digits}f}" if exponent < 0 else f"{round(value, -exponent):.0f}"
    return f"{text}({error:.0f})".replace("-", "−")


def lines(loop: Loop) -> list[str]:
    """What was found, the friction that the record has with it, and what that means or the first
    reason why it is not more."""
    if told := answer(loop):  # of an axis
        return told
    found = headline(loop)
    if loop.verdict == "effects" and not loop.families:
        found += ", confirmed"
    found = f"{found}. Test error {test_errors(loop, '.2f')} sigma"
    most = loop.most_held_out
    found += f" (noise alone gives up to {most:.2f})" if math.isfinite(most) else ""
    caution = [f"caution: {loop.reasons[0]}"] if loop.reasons else []
    means = [f"{id}: {meaning(loop, id)}" for id in loop.effects if meaning(loop, id)]
    return [f"{found}.", *_friction(loop), *(means if loop.verdict == "effects" else caution)]


def _friction(loop: Loop) -> list[str]:
    """a - b, a, b and D_c of the model that is left, with errors, in a line."""
    rate = loop.after.A_minus_B
    if rate is None:
        return []
    shown = {"a - b": rate} | {
        short: loop.after.parameters[name]
        for name, short in (("A", "a"), ("B", "b"), ("L", "D_c"))
        if name in loop.after.parameters
    }
    told = []
    for short, estimate in shown.items():
        unit, size = shown_unit(estimate, length_of(loop))
        if not (estimate.free and estimate.determined):
            told.append(f"{short} is not known")
            continue
        value = with_error(estimate.value / size, estimate.std / size)
        told.append(f"{short} = {value} {unit}".rstrip())
    return [f"{', '.join(told)}: {_sign(rate)}."]


def _sign(rate: Estimate) -> str:
    if rate.upper < 0:
        return "velocity weakening"
    if rate.lower > 0:
        return "velocity strengthening"
    return "whether velocity weakens friction is not known"


def parameters(loop: Loop) -> TextTable:
    """The table of parameters, each in one line: the first of a base, and all of the effects."""
    table = moved(loop)
    rows = sorted(range(len(table.rows)), key=lambda k: (k not in table.marked, k))[:MOST_ROWS]
    rows.sort()
    columns = [k for k, head in enumerate(table.head) if head != "meaning"]  # it takes lines
    shown = [tuple(table.rows[k][column] for column in columns) for k in rows]
    left = len(table.rows) - len(rows)
    note = f"{left} more with --details" if left else ""
    marked = tuple(k for k, row in enumerate(rows) if row in table.marked)
    return TextTable(table.title, tuple(table.head[k] for k in columns), shown, note, marked)


def print_brief(loop: Loop, console: "Console") -> None:
    """Print the lines and the parameters to a rich console."""
    for line in lines(loop):
        console.print(line, markup=False, soft_wrap=True)
    print_tables(console, [parameters(loop)])
