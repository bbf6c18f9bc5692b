"""Read a record from a file."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..units import scale
from .columns import assign
from .content import filled_rows
from .record import EMPTY_ROWS, Provenance, Record, build
from .sampled import with_rate
from .table import Table, read_table


def read(
    path: str | Path, *, columns: Mapping[str, str] | None = None, drop_bad: bool = False
) -> Record:
    """Read a record of time, load-point motion and friction, and turn it into SI.

    **Arguments:**

    - `path`: delimited text with a header such as
      `time [s],load_point_displacement [um],friction [1],normal_stress [MPa]`, in any order;
      headers as laboratories write them (`Time(s)`, `Displ(microns)`) are understood, and so are
      decimal commas and clock times; or a file of xlook's, binary or text. Where there is a shear
      stress and a normal stress but no friction, friction is their quotient.
    - `columns`: names of columns for roles that the header does not give away, such as
      `{"friction": "mu_corrected"}`; `NAME [unit]` sets the unit, which may carry a factor:
      `{"load_point_displacement": "Vert_Disp [0.0764 um]"}`. `#3` is the third column, also of a
      file without a header; `{"time": "1 kHz"}` or "1 ms" says how often rows were taken.
    - `drop_bad`: leave out rows that are not whole instead of refusing the file.

    **Returns:** a `Record`; its `provenance` says what was assumed and left out.

    Raises `InputError` for a file that cannot be read as a record; the message gives the row
    and the column, and what to do.
    """
    return to_record(read_table(path), columns=columns, drop_bad=drop_bad)


def to_record(
    table: Table, *, columns: Mapping[str, str] | None = None, drop_bad: bool = False
) -> Record:
    """A table as a record; arguments and errors as for `read`."""
    table, columns = with_rate(table, columns or {})
    assigned, notes = assign(table, columns)
    rows = filled_rows(table.blank, (use.index for use in assigned.values()), len(table))
    values = {
        role: scale(table.columns[use.index][rows], use.size) for role, use in assigned.items()
    }
    units = {role: use.unit for role, use in assigned.items()}
    friction_unit = "1"
    if "shear_stress" in values:
        stress = values.pop("shear_stress")
        values["friction"] = _quotient(table, stress, values["normal_stress"], table.lines[rows])
        units["friction"] = "1"
    else:
        friction_unit = assigned["friction"].si_unit
    empty = len(table) - (rows.stop - rows.start)
    origin = Provenance(
        table.path,
        table.sha256,
        rows_read=empty,
        dropped={EMPTY_ROWS: empty} if empty else {},
        notes=(*table.notes, *notes),
    )
    return build(
        values,
        friction_unit,
        units,
        origin,
        table.lines[rows],
        table.malformed[rows],
        drop_bad,
    )


def _quotient(table: Table, shear: np.ndarray, normal: np.ndarray, lines: np.ndarray) -> np.ndarray:
    """Friction where shear and normal stress were recorded.

    Raises `InputError` where the normal stress is not positive, or recorded as negative in all.
    """
    wrong = np.isfinite(normal) & ~(normal > 0)
    if wrong.any():
        first = int(np.flatnonzero(wrong)[0])
        raise InputError(
            f"{table.path}: friction is shear stress over normal stress, and the normal stress is"
            f" {normal[first] / 1e6:.6g} MPa in row {lines[first]} ({wrong.sum()} rows); cut the"
            " rows without load out"
            + (", or turn its sign: --column 'normal_stress=NAME [-1 MPa]'" if wrong.all() else "")
        )
    return shear / normal
