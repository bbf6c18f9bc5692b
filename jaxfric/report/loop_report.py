"""The report of a closed loop: what is missing, the friction with it, what that means."""

import math

from ..loop.result import Loop
from .estimates import friction_line
from .loop_text import (
    answer,
    apart,
    headline,
    length_of,
    lines,
    meaning,
    moved,
    splitting,
    tables,
    test_errors,
)
from .report import Report


def report(loop: Loop) -> Report:
    """The answer, all tables, and what can be told apart."""
    parameters = moved(loop)
    rest = [table for table in tables(loop) if table.title != parameters.title]
    told = [*lines(loop), splitting(loop)]
    return Report(first_lines(loop), [parameters, *rest], told, apart(loop), loop.warnings)


def first_lines(loop: Loop) -> list[str]:
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
    rate = loop.after.A_minus_B
    friction = [] if rate is None else [friction_line(rate, loop.after.parameters, length_of(loop))]
    return [f"{found}.", *friction, *(means if loop.verdict == "effects" else caution)]
