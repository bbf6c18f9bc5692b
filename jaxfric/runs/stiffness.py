"""The stiffness of a machine, at any normal stress.

A press is as stiff as it is, k [Pa/m] of shear stress; in friction that is K = k/normal stress. A
run at several normal stresses has one k and several K.
"""

from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..units import has_dimension, parse_quantity

_ALIKE = 1.02
"""Normal stresses within this factor are taken as one."""
_OFF, _FAR = 0.1, 3.0
"""A stiffness disagrees by more than this share and so many standard errors."""


def departure(given: float, found: float, error: float) -> str | None:
    """How far a stiffness that was given is from one that was found with a standard error, as in
    "31 % above"; None where the two agree."""
    if abs(given - found) <= max(_OFF * found, _FAR * error):
        return None
    share = 100 * (given / found - 1)
    return f"{abs(share):.0f} % {'above' if share > 0 else 'below'}"


@dataclass(frozen=True)
class MachineStiffness:
    """`value` [friction/m], or, with `of_stress`, [Pa/m] of shear stress at any normal stress."""

    value: float
    of_stress: bool = False

    @classmethod
    def parse(cls, text: str | float, friction_unit: str) -> "MachineStiffness":
        """From text with a unit: "1.6e-3/um", "2e6 N/m" for a force, or "0.16 MPa/um".

        Raises `InputError` for another unit, and what is not positive.
        """
        if isinstance(text, str) and has_dimension(text, "Pa/m"):
            found = cls(parse_quantity(text, "Pa/m", "--stiffness"), True)
        else:
            unit = "1/m" if friction_unit == "1" else "N/m"
            value = parse_quantity(text, unit, "--stiffness") if isinstance(text, str) else text
            found = cls(float(value))
        if not (np.isfinite(found.value) and found.value > 0):
            raise InputError(f"--stiffness: '{text}' is not positive")
        return found

    def at(self, normal_stress: float | None) -> float:
        """The stiffness [friction/m] under a normal stress [Pa].

        Raises `InputError` where that is not known, or not positive, and needed.
        """
        if not self.of_stress:
            return self.value
        if normal_stress is None or not normal_stress > 0:
            raise InputError(
                "--stiffness is a stress per length, and the record has no normal stress there; map"
                " one, as in --column 'normal_stress=NAME [MPa]', or give it as friction per length"
            )
        return self.value / normal_stress

    def doubt(self, stresses: list[float]) -> str | None:
        """A sentence where one stiffness in friction was taken at several normal stresses [Pa]."""
        if self.of_stress or not stresses or max(stresses) < _ALIKE * min(stresses):
            return None
        low, high = min(stresses) / 1e6, max(stresses) / 1e6
        per = self.value * 1e-6
        return (
            f"a stiffness of {per:.4g}/um was taken at normal stresses from {low:.4g} to"
            f" {high:.4g} MPa, but a press has one stiffness of stress: if this one holds at"
            f" {high:.4g} MPa that is {per * high:.4g} MPa/um, which --stiffness takes as well"
        )
