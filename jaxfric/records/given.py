"""Accept a record, or the path of a record, as an argument."""

from pathlib import Path

from ..errors import InputError
from .axis_record import AxisRecord
from .read import read
from .read_axis import read_axis
from .record import Record


def as_record(given: object) -> Record:
    """Return the record of a slider; read it if `given` is a path.

    Raises
    ------
    InputError : `given` is neither a record nor a path; a file that `read` refuses.
    """
    if isinstance(given, str | Path):
        return read(given)
    if isinstance(given, AxisRecord):
        raise InputError(
            "this is the record of an axis; it goes to close_axis_loop(record), and a slider's"
            " record comes from jaxfric.read"
        )
    if not isinstance(given, Record):
        raise InputError(_other(given, "jaxfric.read(path) or jaxfric.from_arrays(...)"))
    return given


def as_axis_record(given: object) -> AxisRecord:
    """Return the record of an axis; read it if `given` is a path.

    Raises
    ------
    InputError : `given` is neither a record nor a path; a file that `read_axis` refuses.
    """
    if isinstance(given, str | Path):
        return read_axis(given)
    if not isinstance(given, AxisRecord):
        makers = "jaxfric.read_axis(path) or jaxfric.records.axis_from_arrays(...)"
        raise InputError(_other(given, makers))
    return given


def _other(given: object, makers: str) -> str:
    return f"record is a {type(given).__name__}; give the path of a file, or a record of {makers}"
