"""Names of columns: their unit, and the role that a name gives a column in a record."""

import re
from collections.abc import Iterable, Sequence

from ..units import has_dimension

ROLES = {
    "time": "s",
    "load_point_displacement": "m",
    "load_point_velocity": "m/s",
    "load_point_encoder": "m",
    "friction": "1",
    "slip": "m",
    "normal_stress": "Pa",
}
"""The roles and the SI unit of each. Friction may also be a force, in N."""
COLUMN_ROLES = {**ROLES, "shear_stress": "Pa"}
"""Those that a column of a file may have: shear stress over normal stress is friction."""
NO_COLUMN = "none"
"""Stands for the column of a role that no column is to have."""

_SYNONYMS = {
    "time": "time t elapsedtime testtime timestamp exptime runtime seconds datetime dateandtime"
    " dateandtimeofday timeofday clock clocktime zeit",
    "load_point_displacement": "loadpointdisplacement loadpointdisp loadpointdispl lpdisplacement"
    " lpdisp lpd loadpointposition motorposition motordisplacement ramdisplacement ramdisp"
    " pistondisplacement sheardisplacement sheardisp displacement displ disp",
    "load_point_velocity": "loadpointvelocity loadpointvel lpvelocity lpvel vlp loadingvelocity"
    " loadingrate drivevelocity motorvelocity commandedvelocity velocity vel v",
    "load_point_encoder": "loadpointencoder lpencoder encoder encoderdisplacement encoderposition"
    " motorencoder ramencoder measuredloadpoint measuredposition",
    "friction": "friction frictioncoefficient coefficientoffriction frictioncoeff"
    " coefffriction cof mu μ frictionforce shearforce tangentialforce",
    "slip": "slip slipdisplacement faultslip shearslip sliderdisplacement sliderposition",
    "normal_stress": "normalstress effectivenormalstress effnormalstress effectivestress"
    " normstress norstress sigman sign σn",
    "shear_stress": "shearstress shearstressonfault shearstr shrstress tau τ",
}
_RANKS = {
    name: (role, rank)
    for role, names in _SYNONYMS.items()
    for rank, name in enumerate(names.split())
}
_SUFFIXES = {"s": "s", "sec": "s", "ms": "ms", "us": "us", "min": "min", "n": "N", "kn": "kN"}
_SUFFIXES |= {"um": "um", "micron": "um", "microns": "um", "mm": "mm", "nm": "nm", "m": "m"}
_SUFFIXES |= {"pa": "Pa", "kpa": "kPa", "mpa": "MPa", "gpa": "GPa", "1": "1"}
_SUFFIXES |= {
    f"{m}{per}s": f"{m}/s" for m in ("m", "mm", "um", "nm") for per in ("_", "_per_", "p")
}


def split_name_unit(cell: str) -> tuple[str, str | None]:
    """Name and unit of a header cell: `time [s]`, `Time(s)`, `time_s`; None without a unit.

    A suffix counts as a unit only after a name that has a role, so that `x_m` stays a name.
    """
    cell = cell.strip().strip("\"'").strip()
    match = re.fullmatch(r"(.*?)\s*[\[({]\s*([^\])}]*?)\s*[\])}]", cell)
    if match and match.group(1).strip():
        return match.group(1).strip(), match.group(2)
    for parts in (3, 2, 1):
        pieces = re.split(r"[_\s,]+", cell)
        suffix = "_".join(pieces[-parts:]).replace("µ", "u").replace("μ", "u")
        name = cell[: len(cell) - len(suffix)].rstrip("_ ,")
        if len(pieces) > parts and suffix.lower() in _SUFFIXES and role_of(name):
            return name, _SUFFIXES[suffix.lower()]
    return cell, None


def key(name: str) -> str:
    """A name without case, blanks and signs, to compare by."""
    return re.sub(r"[\W_]+", "", name.lower()).replace("µ", "μ")


def role_of(name: str) -> tuple[str, int] | None:
    """Role of a column's name and its rank (0: the role's own name); None: no role."""
    return _RANKS.get(key(name))


def numbered(text: str, count: int) -> int | None:
    """Index of a column that is named by its number, `#1` to `#count`."""
    match = re.fullmatch(r"#(\d+)", text.strip())
    return int(match[1]) - 1 if match and 0 < int(match[1]) <= count else None


def fitting(indices: list[int], units: Sequence[str | None], wanted: Iterable[str]) -> list[int]:
    """Those of equally named columns whose unit is of a dimension that is wanted; else all."""
    good = [
        i for i in indices if units[i] and any(has_dimension(units[i] or "", w) for w in wanted)
    ]
    return good if len(indices) > 1 and good else indices
