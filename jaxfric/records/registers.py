"""Signed numbers of a drive's registers that were logged without their sign: 65535 for -1."""

from dataclasses import replace

import numpy as np

from .table import Table

_BITS = (16, 32)
_SHARE = 0.25
"""A signal stays below this share of what its register counts to, on either side of zero."""


def with_signs(table: Table) -> tuple[Table, dict[int, str]]:
    """The table with such columns as they were meant, and a note on each by its number.

    A column is one where all its cells are whole numbers from 0 on, some below a quarter of 2^16
    (or 2^32), some in its last quarter, and none between, and where taking 2^16 off the latter
    leaves less than half of its largest jump: not a time with a gap.
    """
    columns, notes = list(table.columns), {}
    for index, values in enumerate(columns):
        known = values[np.isfinite(values)]
        if not len(known) or known.min() < 0 or (known != np.round(known)).any():
            continue
        for bits in _BITS:
            top = 2.0**bits
            low, high = known < _SHARE * top, known >= (1 - _SHARE) * top
            if not (known.max() < top and low.any() and high.any() and (low | high).all()):
                continue
            if _largest_jump(known - top * high) < 0.5 * _largest_jump(known):
                columns[index] = np.where(values >= top / 2, values - top, values)
                notes[index] = (
                    f"column '{table.names[index]}' holds signed {bits}-bit numbers whose sign was"
                    f" lost: {top:.0f} is taken off {high.sum()} rows"
                )
    return (replace(table, columns=tuple(columns)) if notes else table), notes


def _largest_jump(values: np.ndarray) -> float:
    return float(np.abs(np.diff(values)).max())
