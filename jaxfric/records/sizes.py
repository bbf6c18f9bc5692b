"""Refuse columns with impossible values, which indicate a wrong unit."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from ..errors import InputError, option


class Size(NamedTuple):
    """Limits in SI of the largest and smallest magnitude of a column.

    The lower limit is for the range of the values or, with `changes` False, for the largest
    magnitude. A value of 0 always passes; other checks refuse 0 if needed.
    """

    least: float
    most: float
    changes: bool = False


SIZES = {
    ("time", "s"): Size(1e-6, 1e10, True),
    ("load_point_displacement", "m"): Size(1e-9, 1e4, True),
    ("load_point_encoder", "m"): Size(0.0, 1e4, True),
    ("load_point_velocity", "m/s"): Size(1e-14, 1e4),
    ("slip", "m"): Size(0.0, 1e4, True),
    ("friction", "1"): Size(0.0, 1e2),
    ("friction", "N"): Size(0.0, 1e9),
    ("normal_stress", "Pa"): Size(1.0, 1e12),
    ("position", "m"): Size(1e-9, 1e4, True),
    ("position", "rad"): Size(1e-7, 1e9, True),
    ("reference_position", "m"): Size(0.0, 1e4, True),
    ("reference_position", "rad"): Size(0.0, 1e9, True),
    ("velocity", "m/s"): Size(1e-10, 1e4),
    ("velocity", "rad/s"): Size(1e-8, 1e6),
    ("motor_force", "N"): Size(1e-10, 1e9),
    ("motor_force", "N m"): Size(1e-10, 1e9),
}
"""Wide limits by role and unit: creep of 0.01 um in ten days, shear over 10 km, 1 Pa of stress."""


def refuse_sizes(
    columns: Mapping[str, np.ndarray],
    si_units: Mapping[str, str],
    written: Mapping[str, str],
    path: str,
    lines: np.ndarray,
) -> None:
    """Refuse a column with impossible values; a wrong unit is the likely cause.

    **Arguments:** `columns` in SI by role, and their `si_units`; `written`: units of the file;
    `lines`: line numbers of the rows. Time counts from the first row.

    Raises `InputError`, with the row of the largest value.
    """
    for role, values in columns.items():
        unit = si_units.get(role, "")
        if (role, unit) not in SIZES:
            continue
        size, unit = SIZES[role, unit], "" if unit == "1" else unit
        magnitude = np.abs(values - values[0] if role == "time" else values)
        worst = int(np.argmax(magnitude))
        reach = float(np.ptp(values) if size.changes else magnitude[worst])
        if magnitude[worst] > size.most:
            place = f"{values[worst]:.4g} {unit}".strip()
            found = f"{role} is {place} in row {lines[worst]}"
        elif 0 < reach < size.least:
            what = "changes by" if size.changes else "is at most"
            found = f"{role} {what} {reach:.4g} {unit} in all rows"
        else:
            continue
        hint = f"is its unit, [{written.get(role, unit)}], right? If not, write the right one"
        if role == "friction" and not unit:
            hint = "a coefficient is less than 100; if it is a force, write its unit"
        example = {"friction": "N", "time": "ms"}.get(role, "UNIT")
        raise InputError(
            f"{path}: {found}: {hint}, as in {option('column', f'{role}=NAME [{example}]')}"
        )
