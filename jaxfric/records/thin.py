"""Downsample a record by block averaging: means over k neighbouring rows.

The time of a fit is proportional to the number of rows, and recorders often write more rows than a
fit needs. In means over k rows white noise falls by sqrt(k); noise that is correlated over more
than k rows does not change. A fit estimates both kinds of noise from the means, so that the errors
of its parameters stay correct. No mean spans a velocity step; the last rows before a step, fewer
than k, are dropped. The first row is kept, because times count from the first row. Averaging
flattens a peak by 1/24 of its second difference; `blur` compares this flattening with the noise of
the means.
"""

from dataclasses import replace
from itertools import pairwise

import numpy as np

from ..errors import InputError, option
from .record import Record, frozen
from .rows import MIN_ROWS
from .steps import VelocitySteps

LEAST_ROWS = 100


def refuse_few_means(rows: int) -> None:
    """Raise `InputError` if fewer than 100 rows are asked for."""
    if rows < LEAST_ROWS:
        raise InputError(f"{option('downsample-to')} is {rows}; {LEAST_ROWS} or more are needed")


def thinned(record: Record, rows: int, steps: VelocitySteps) -> Record:
    """Return the record reduced to about `rows` block means, none of which spans a step.

    A record with at most `rows` rows is returned unchanged. The provenance gets a note. Raises
    `InputError` for `rows` below 100, and if fewer than 20 rows would remain.
    """
    refuse_few_means(rows)
    size = int(np.ceil(len(record) / rows))
    if size == 1:
        return record
    # a step lies between rows: the blocks after it begin at the first row after the step
    edges = np.searchsorted(record.relative_time, steps.times[1:], side="left")
    edges = np.concatenate([[1], edges, [len(record)]])
    starts = [np.arange(a, b - size + 1, size) for a, b in pairwise(edges)]
    first = np.concatenate(starts)
    if len(first) < MIN_ROWS:
        raise InputError(
            f"{option('downsample-to', rows)}: only {len(first)} means would remain; choose more"
            " rows"
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
    """Return the largest flattening of peaks in a record of means, divided by the `noise`."""
    second = np.abs(np.diff(record.friction, 2))
    return float(np.quantile(second, 1 - 3 / max(len(second), 6))) / 24 / noise
