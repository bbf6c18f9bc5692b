"""The report of a closed loop: the missing effect, the friction with it, and what this means."""

import math

from ..loop.result import Loop
from .estimates import friction_line
from .loop_next import next_steps, run_to_make
from .loop_text import (
    answer,
    apart,
    by_velocity,
    candidates,
    errors,
    headline,
    length_of,
    lines,
    meaning,
    moved,
    rests_on,
    significance,
    splitting,
    test_errors,
)
from .report import Report

_MOST_CANDIDATES = 10
_MOST_STEPS = 40
"""Velocities or segments that a terminal shows."""


def report(loop: Loop, *, file: str = "loop.json", whole: bool = False) -> Report:
    """The answer, all tables, and the effects that the record can distinguish.

    With `whole` all rows of the tables are shown, otherwise long tables are cut. `file` is the path
    of the loop's JSON file in the next commands.
    """
    steps, most = (None, len(loop.candidates)) if whole else (_MOST_STEPS, _MOST_CANDIDATES)
    tables = [
        moved(loop),
        significance(loop),
        errors(loop),
        by_velocity(loop, most=steps),
        candidates(loop, most=most),
        *([] if loop.details is None else loop.details.tables()),
        rests_on(loop),
    ]
    return Report(
        first_lines(loop),
        [table for table in tables if table.rows],
        [*lines(loop), splitting(loop)],
        apart(loop),
        loop.warnings,
        next_steps=next_steps(loop, file),
    )


def first_lines(loop: Loop) -> list[str]:
    """The verdict, the friction parameters of the final model, and their meaning.

    If the verdict is limited, the first reason replaces the meaning.
    """
    if told := answer(loop):  # only an axis has an answer
        return told
    found = headline(loop)
    if loop.verdict == "effects" and not loop.families:
        found += ", confirmed"
    found = f"{found}. Test error {test_errors(loop, '.2f')} sigma"
    most = loop.held_out_threshold
    found += f" (noise alone gives up to {most:.2f})" if math.isfinite(most) else ""
    caution = [f"caution: {loop.reasons[0]}"] if loop.reasons else []
    if loop.verdict == "ambiguous" and loop.effects and not caution:
        caution = [run_to_make(loop) or loop.sentence]
    means = [f"{id}: {meaning(loop, id)}" for id in loop.effects if meaning(loop, id)]
    model = loop.supported
    rate, of = model.A_minus_B, ""
    if model is not loop.after:
        of = "base model, as the effects added predict the test rows worse: "
    friction = [] if rate is None else [of + friction_line(rate, model.parameters, length_of(loop))]
    return [f"{found}.", *friction, *(means if loop.verdict == "effects" else caution)]
