"""Restore the sign of register values that a drive logged as unsigned: 65535 for -1."""

from dataclasses import replace

import numpy as np

from .table import Table

_BITS = (16, 32)
_SHARE = 0.25
"""Magnitudes of a signal are below this share of its register's range."""


def with_signs(table: Table) -> tuple[Table, dict[int, str]]:
    """Return the table with unsigned columns corrected, and a note for each column's number.

    All cells of an unsigned column are integers from 0 to 2^16 (or 2^32): some in the first quarter
    of this range, some in the last quarter, none between. Subtracting 2^16 from the cells in the
    last quarter must reduce the column's largest jump to less than half. The condition on the jump
    excludes a column of times with a gap.
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
