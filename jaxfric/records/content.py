"""What a reader of a format hands over."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Content:
    """Columns with names and units as written, before any meaning is given to them."""

    names: tuple[str, ...]
    units: tuple[str | None, ...]
    columns: tuple[np.ndarray, ...]
    lines: np.ndarray
    malformed: np.ndarray
    notes: tuple[str, ...] = ()
