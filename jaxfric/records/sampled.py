"""Records without a column of time, of a recorder whose rate is known."""

import dataclasses
import re
from collections.abc import Mapping
from typing import Any, Protocol, TypeVar

import numpy as np

from ..errors import InputError
from ..units import has_dimension, parse_quantity


class Columns(Protocol):
    """A dataclass of columns as a file has them."""

    @property
    def path(self) -> str: ...
    @property
    def names(self) -> tuple[str, ...]: ...
    @property
    def units(self) -> tuple[str | None, ...]: ...
    @property
    def columns(self) -> tuple[np.ndarray, ...]: ...
    @property
    def blank(self) -> np.ndarray | None: ...
    @property
    def notes(self) -> tuple[str, ...]: ...


_A = TypeVar("_A", bound=Columns)
NAME = "time"
HOW = "or state how often rows were taken: --column 'time=1 kHz'"
"""Advice where no column is one of times."""


def with_rate(table: _A, columns: Mapping[str, str]) -> tuple[_A, dict[str, str]]:
    """A table with times t_i = i/rate, and `columns`, where they state a rate for `time`.

    The rate is a frequency, "1 kHz", or the time from a row to the next, "1 ms"; a column of such
    a name goes before.

    Raises `InputError` for a rate that is neither, or not positive.
    """
    said = dict(columns)
    text = said.get("time", "").strip()
    if not re.match(r"[-+]?\.?\d", text) or text in table.names:
        return table, said
    interval = _interval(text, table.path)
    count = len(table.columns[0]) if table.columns else 0
    blank = table.blank
    if blank is not None:
        blank = np.pad(blank, ((0, 0), (0, 1)))
    said["time"] = f"#{len(table.names) + 1}"
    made: Any = table
    return dataclasses.replace(
        made,
        names=(*table.names, NAME),
        units=(*table.units, "s"),
        columns=(*table.columns, interval * np.arange(float(count))),
        blank=blank,
        notes=(*table.notes, f"no column of times: one row every {interval:.6g} s, as stated"),
    ), said


def _interval(text: str, path: str) -> float:
    """Seconds from a row to the next."""
    what = f"{path}, how often rows were taken"
    unit = text.lstrip("+-.0123456789eE ")
    is_rate = bool(unit) and has_dimension(unit, "Hz")
    value = parse_quantity(text, "Hz" if is_rate else "s", what)
    if not value > 0:
        raise InputError(f"{what}: '{text}' is not positive")
    return 1 / value if is_rate else value
