"""Fewer rows, honestly: means over equal numbers of neighbouring rows.

A fit costs time in proportion to its rows, and a recorder often writes far more than friction
needs. The mean over k rows keeps what they say: white noise falls by sqrt(k), noise that is
correlated over more than k rows stays as it is, and both are estimated anew from the means, so that
errors stay right. No mean reaches over a velocity step; rows that fill no group before the next
step (fewer than k) are left out. The first row is kept as it is, for times count from it. What a
mean loses is curvature: a peak is flattened by a 24th of its second difference, and `blur` says how
that compares with the noise that is left.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from ..errors import InputError
from ..findings import Warned, WarningCode
from .record import Record, frozen
from .rows import MIN_ROWS
from .steps import VelocitySteps

LEAST_ROWS = 100
_FLATTENED = (
    "means over {} rows flatten the peaks after the steps by {} times the noise that is left: A"
    " comes out too small; ask for more --downsample-to"
)


def refuse_few_means(rows: int) -> None:
    """Raises `InputError` for fewer than 100 rows to be left."""
    if rows < LEAST_ROWS:
        raise InputError(f"--downsample-to is {rows}; {LEAST_ROWS} or more are needed")


def thinned(record: Record, rows: int, steps: VelocitySteps) -> Record:
    """The record as at most about `rows` means over equal numbers of rows, none over a step.

    Returns the record itself where it has no more rows than that. Its provenance says what was
    done. Raises `InputError` for fewer than 100 rows, and where less than 20 would be left.
    """
    refuse_few_means(rows)
    size = int(np.ceil(len(record) / rows))
    if size == 1:
        return record
    # a step lies between rows: the groups after it begin at the first row that has seen it
    edges = np.searchsorted(record.relative_time, steps.times[1:], side="left")
    edges = np.concatenate([[1], edges, [len(record)]])
    starts = [np.arange(a, b - size + 1, size) for a, b in pairwise(edges)]
    first = np.concatenate(starts)
    if len(first) < MIN_ROWS:
        raise InputError(
            f"--downsample-to {rows}: only {len(first)} means would be left; ask for more rows"
        )
    index = first[:, None] + np.arange(size)
    means = {
        role: frozen(np.concatenate([values[:1], values[index].mean(axis=1)]))
        for role, values in record.columns.items()
    }
    note = f"means over {size} rows each: {len(first) + 1} of {len(record)} rows"
    origin = replace(record.provenance, notes=(*record.provenance.notes, note), lines=None)
    return replace(record, **means, provenance=origin)


def blur(record: Record, noise: float) -> float:
    """Largest flattening of the peaks of a record of means, in units of its `noise`."""
    second = np.abs(np.diff(record.friction, 2))
    return float(np.quantile(second, 1 - 3 / max(len(second), 6))) / 24 / noise


def blur_warning(rows: int, lost: float) -> Warned:
    """What means over `rows` rows cost that flatten the peaks by `lost` times the noise."""
    return Warned(_FLATTENED.format(rows, f"{lost:.2g}"), WarningCode.FLATTENED, (rows, lost))


def blur_warning_of(warnings: Sequence[str]) -> tuple[str, ...]:
    """Those of `warnings` that are of `blur_warning`, in one sentence; of none nothing."""
    found = [
        w.values for w in warnings if isinstance(w, Warned) and w.code is WarningCode.FLATTENED
    ]
    if not found:
        return ()
    said = []
    for values, form in zip(zip(*found, strict=True), (".0f", ".2g"), strict=True):
        ends = (format(end, form) for end in (min(values), max(values)))
        said.append(" to ".join(dict.fromkeys(ends)))
    return (Warned(_FLATTENED.format(*said), WarningCode.FLATTENED),)
