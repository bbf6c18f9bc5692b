"""The stiffness of a machine, at any normal stress.

A press has one stiffness k [Pa/m] of shear stress. In friction the stiffness is K = k/normal
stress, so that a run at several normal stresses has one k and several K.
"""

from dataclasses import dataclass

import numpy as np

from ..errors import InputError, option
from ..findings import WarningCode, warned
from ..units import has_dimension, parse_quantity
from .thresholds import STIFFNESS_FAR, STIFFNESS_OFF, STRESSES_ALIKE


def departure(given: float, found: float, error: float) -> float | None:
    """Return the deviation of a given stiffness from a measured one with a standard error, as a
    share of the measured one; None if both agree.
    """
    agree = abs(given - found) <= max(STIFFNESS_OFF * found, STIFFNESS_FAR * error)
    return None if agree else given / found - 1


def alike(one: float, other: float) -> bool:
    """Whether two positive normal stresses are equal within `STRESSES_ALIKE`."""
    return max(one, other) < STRESSES_ALIKE * min(one, other)


@dataclass(frozen=True)
class MachineStiffness:
    """Stiffness `value` [friction/m]; if `of_stress`, [Pa/m] at any normal stress."""

    value: float
    of_stress: bool = False

    @classmethod
    def parse(cls, text: str | float, friction_unit: str) -> "MachineStiffness":
        """Parse text with a unit: "1.6e-3/um" or "0.16 MPa/um", or "2e6 N/m" for a force.

        Raises `InputError` for another unit, and for a value that is not positive.
        """
        coefficient = friction_unit == "1"
        of_stress = coefficient and isinstance(text, str) and has_dimension(text, "Pa/m")
        unit = "Pa/m" if of_stress else "1/m" if coefficient else "N/m"
        value = parse_quantity(text, unit, option("stiffness")) if isinstance(text, str) else text
        found = cls(float(value), of_stress)
        if not (np.isfinite(found.value) and found.value > 0):
            raise InputError(f"{option('stiffness')}: '{text}' is not positive")
        return found

    def at(self, normal_stress: float | None) -> float:
        """Return the stiffness [friction/m] under a normal stress [Pa].

        Raises `InputError` if the normal stress is needed, but not known or not positive.
        """
        if not self.of_stress:
            return self.value
        if normal_stress is None or not normal_stress > 0:
            raise InputError(
                f"{option('stiffness')} is a stress per length, and the record has no normal"
                " stress there; map"
                f" one, as in {option('column', 'normal_stress=NAME [MPa]')}, or give it as"
                " friction per length"
            )
        return self.value / normal_stress

    def doubt(self, stresses: list[float]) -> str | None:
        """Return a warning if one stiffness in friction is used at several normal stresses [Pa]."""
        if self.of_stress or not stresses or alike(min(stresses), max(stresses)):
            return None
        K, low, high = self.value, min(stresses), max(stresses)
        return warned(WarningCode.PRESS, stiffness=K, low=low, high=high, needed=K * high)
