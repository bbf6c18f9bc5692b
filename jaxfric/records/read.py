"""Read a record from a file."""

from collections.abc import Mapping
from pathlib import Path

from ..units import scale
from .columns import assign
from .record import Provenance, Record, build
from .table import Table, read_table


def read(
    path: str | Path, *, columns: Mapping[str, str] | None = None, drop_bad: bool = False
) -> Record:
    """Read a record of time, load-point motion and friction, and turn it into SI.

    **Arguments:**

    - `path`: delimited text with a header such as
      `time [s],load_point_displacement [um],friction [1],normal_stress [MPa]`, in any order;
      headers as laboratories write them (`Time(s)`, `Displ(microns)`) are understood; or a
      file in xlook's binary format.
    - `columns`: names of columns for roles that the header does not give away, such as
      `{"friction": "mu_corrected"}`; `NAME [unit]` sets the unit, which may carry a factor:
      `{"load_point_displacement": "Vert_Disp [0.0764 um]"}`.
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
    assigned, notes = assign(table, columns or {})
    values = {role: scale(table.columns[use.index], use.size) for role, use in assigned.items()}
    origin = Provenance(table.path, table.sha256, notes=(*table.notes, *notes))
    units = {role: use.unit for role, use in assigned.items()}
    return build(
        values,
        assigned["friction"].si_unit,
        units,
        origin,
        table.lines,
        table.malformed,
        drop_bad,
    )
