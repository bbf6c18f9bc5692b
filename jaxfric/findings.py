"""Statements of results as data: a code, values, and the rows of the record that they rest on.

What is claimed holds for the speeds and directions of its rows. Without those rows it is not
claimed: a record from which they are taken out does not have the finding.
"""

import typing
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

import numpy as np


class Severity(StrEnum):
    """How a finding is meant."""

    CLAIM = "claim"
    """The rows support it."""
    OPEN = "open"
    """The rows are explained by it, and as well by something else."""
    CAUTION = "caution"
    """Something speaks against more."""
    WITHHELD = "withheld"
    """Because of it nothing is claimed."""


class WarningCode(StrEnum):
    """Codes of warnings that code asks for; their words may be any."""

    MISFIT = "misfit"
    """A fit leaves far more than the scatter of neighbouring rows."""
    DRIFT = "drift_before_the_step"
    """Friction drifts before a velocity step as the model does not."""
    WANDERS = "residual_wanders"
    """The residual wanders over the whole record."""
    CONTRADICTED = "steps_contradict_the_motion"
    """The velocity that is stated for a step is not that of the recorded load point."""
    FLATTENED = "means_flatten_the_peaks"
    """Means over rows flatten the peaks; values: rows, times the noise."""


class Warned(str):
    """A warning in words, with its code, and with values where several are told in one."""

    code: WarningCode | None
    values: tuple[float, ...]

    def __new__(
        cls, text: str, code: WarningCode | None = None, values: tuple[float, ...] = ()
    ) -> "Warned":
        """The text with a code; None: one that is not asked for."""
        made = super().__new__(cls, text)
        made.code, made.values = code, values
        return made


def is_of(warning: str, code: WarningCode) -> bool:
    """Whether a warning has a code."""
    return isinstance(warning, Warned) and warning.code is code


@dataclass(frozen=True, eq=False)
class Finding:
    """One statement of a result. Values are in SI."""

    code: StrEnum
    severity: Severity
    values: Mapping[str, object]
    rows: np.ndarray
    """Mask of the rows of the record that it rests on (n)."""

    def to_json(self, velocity: np.ndarray) -> dict[str, object]:
        """Code, severity and values; rows as ranges [first, last + 1], and the directions and
        speeds that they cover, by the `velocity` of every row (n)."""
        return {
            "code": self.code.value,
            "severity": self.severity.value,
            "values": self.values,
            "rows": ranges(self.rows),
            "support": support(self.rows, velocity),
        }


def read_findings(told: object, code: StrEnum, *, rows: int) -> tuple[Finding, ...]:
    """The findings of a code in a list as `Finding.to_json` makes it; `rows` of the record.

    Raises `ValueError` where the list is damaged.
    """
    found = []
    try:
        for one in typing.cast("list[dict]", told):
            if one["code"] == code.value:
                mask = np.zeros(rows, bool)
                for start, stop in one["rows"]:
                    mask[start:stop] = True
                found.append(Finding(code, Severity(one["severity"]), dict(one["values"]), mask))
    except (TypeError, KeyError, AttributeError) as error:
        raise ValueError(str(error)) from None
    return tuple(found)


class Support(NamedTuple):
    """Rows of one direction: how many, and between which speeds [m/s or rad/s]."""

    direction: str
    """"forwards", "backwards" or "at rest"."""
    rows: int
    slowest: float
    fastest: float


_PART = 20
"""A twentieth of the rows that are left is taken away at a time."""
_DIRECTIONS = (("forwards", 1), ("backwards", -1), ("at rest", 0))


def support(rows: np.ndarray, velocity: np.ndarray) -> tuple[Support, ...]:
    """What a mask of rows covers, by direction; `velocity` is signed, of every row (n)."""
    found = []
    for direction, sign in _DIRECTIONS:
        speed = np.abs(velocity[rows & (np.sign(velocity) == sign)])
        if len(speed):
            found.append(Support(direction, len(speed), float(speed.min()), float(speed.max())))
    return tuple(found)


def deciding_rows(
    difference: np.ndarray, jacobian: np.ndarray, used: np.ndarray, least: float
) -> np.ndarray:
    """Mask of few rows without which two models are not told from each other.

    difference : d, of their predictions [sigma] (n). jacobian : J, of the model without the claim
    by its parameters [sigma] (n, p). used : rows that count (n). least : the fall of the misfit
    that a claim needs.

    Without some rows that model is fitted anew, and takes up what it can of d in the others: what
    decides is left, min_b sum (d - J b)^2. Rows with most of it are taken away, a twentieth at a
    time, until no more is left than `least`.
    """
    kept = used & np.isfinite(difference)
    while kept.any():
        shift, *_ = np.linalg.lstsq(jacobian[kept], difference[kept], rcond=None)
        square = (difference - jacobian @ shift) ** 2
        if square[kept].sum() <= least:
            break
        rows = np.flatnonzero(kept)
        most = max(1, len(rows) // _PART)
        kept[rows[np.argsort(square[rows])[-most:]]] = False
    return used & ~kept


def ranges(rows: np.ndarray) -> list[list[int]]:
    """A mask as pairs of its first rows and the rows after its last ones."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], rows.astype(int), [0]])))
    return edges.reshape(-1, 2).tolist()
