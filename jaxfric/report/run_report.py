"""The report of a run: its velocity steps in a table, what they share, and what else was found."""

from collections import Counter
from collections.abc import Sequence

from ..runs import holds as of_holds
from ..runs.findings import Findings
from ..runs.fits import RunFit
from ..runs.holds import Hold
from ..runs.joint import told as told_of_all
from ..runs.table import BRACKETS, HEAD, MISFIT, headline, text_cells
from .report import Report
from .tables import TextTable

_NO_STEP = "no velocity step is fitted; events.toml says what was found and why"


def report(run: RunFit, holds: Sequence[Hold] = (), others: Findings | None = None) -> Report:
    """How many steps were fitted, what they share, the table of the steps; then what was found
    besides them. Warnings are those of the steps."""
    kinds = Counter(event.kind for event in run.events)
    number = len(run.events)
    words = ", ".join(f"{count} {kind}" for kind, count in kinds.most_common())
    events = f"{len(run.record)} rows, {number} event{'' if number == 1 else 's'}: {words}"
    rest = of_holds.not_fitted(run.events, holds)
    told = [
        *told_of_all(run.steps),
        *of_holds.told(holds, run.record.friction_unit, rest),
        *([] if others is None else others.told()),
    ]
    cells = [text_cells(step) for step in run.steps]
    cells = [(*c, *[""] * (len(HEAD) - len(c))) for c in cells]
    table = TextTable("Velocity steps", HEAD, cells, f"{BRACKETS}; -: not determined; {MISFIT}")
    warnings = [
        f"step {step.number}: {text}"
        for step in run.steps
        for text in (step.fit.warnings if step.fit is not None else (step.failed,))
    ]
    first = [events, headline(run) if run.steps else _NO_STEP]
    return Report([*first, *told[:1]], [table], notes=told[1:], warnings=warnings)
