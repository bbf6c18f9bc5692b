"""The result of a fit."""

import functools
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import jax.numpy as jnp
import numpy as np

from ..described import Described, Drawable, Gridded, Tabular, said
from ..findings import Finding
from ..motion import PiecewiseVelocity
from ..records import Record, VelocitySteps
from ..rig import Rig
from ..stability.claims import Claim, held_with_trend, no_claim, one_sign, rate_state_claim
from ..stability.reasons import ClaimReason
from ..units import factor
from .derived import (
    Critical,
    Inertia,
    Interval,
    along_length,
    amplitudes,
    critical_of,
    critical_stiffness_at,
    inertia_of,
    rate_dependence,
    weights,
)
from .derived import critical_stiffness_of as critical_stiffness_of
from .derived import difference as difference
from .estimate import Estimate as Estimate
from .findings import stability_finding
from .noise import NoiseEstimate
from .problem import Model, quantity_of
from .solved import Solved
from .trend import Trended, with_slip_trend
from .uncertainty import minimum_of

DIFFERENCE = "A_minus_B"
"""The name of A less all B, in files and tables of data."""


@dataclass(frozen=True, eq=False, repr=False)
class Fit(Described, Drawable, Gridded, Tabular):
    """A fitted record. Parameters are in SI, friction quantities in the record's unit (1 or N)."""

    record: Record
    steps: VelocitySteps
    model: Model
    parameters: Mapping[str, Estimate]
    free: tuple[str, ...]
    """Names of the free parameters, in the order of `covariance` and `correlation`."""
    covariance: np.ndarray
    """Covariance of the free parameters (SI)."""
    correlation: np.ndarray
    predicted: np.ndarray
    """Fitted friction at the rows of the record."""
    sum_of_squares: float
    """Sum of squared residuals over the used rows (outliers excluded)."""
    rms: float
    """Root mean square of the residual over the same rows."""
    noise: NoiseEstimate
    converged: bool
    result: str
    iterations: int
    weighting: str
    warnings: tuple[str, ...]
    hum: np.ndarray | float = 0.0
    """Hum at the rows of the record [unit of friction], subtracted before the fit."""
    solved: Solved | None = field(default=None, repr=False)
    """The least-squares problem and its solution, for further computations."""

    @property
    def residual(self) -> np.ndarray:
        """Recorded minus fitted friction, without hum."""
        return self.record.friction - self.hum - self.predicted

    @property
    def law(self) -> str:
        """The name of the law: "slip", "ageing" or another of `jaxfric.laws`."""
        return self.model.law

    def values(self) -> dict[str, float]:
        """Parameter values by name (SI)."""
        return {name: estimate.value for name, estimate in self.parameters.items()}

    def rig(self) -> Rig:
        """The fitted rig."""
        values = self.values()
        vector = jnp.asarray([values[name] for name in self.model.names()])
        return self.model.rig(vector, jnp.asarray(values["V0"]), jnp.asarray(values["K"]))

    def motion(self) -> PiecewiseVelocity:
        """The commanded motion of the fit; time from the record's first row."""
        return PiecewiseVelocity(self.steps.times, self.steps.velocities)

    def critical_stiffness(self) -> float:
        """Critical stiffness of the fitted law without damping [friction/m]: without mass, or with
        the mass of the fit at the fastest speed of the record."""
        return critical_stiffness_at(self.model, self.values(), self._inertia)

    @property
    def critical_speed(self) -> float | None:
        """Speed [m/s] of the critical stiffness of a fit with mass, the fastest of the record; None
        without mass, where the critical stiffness does not depend on the speed."""
        return float(np.max(np.abs(self.steps.velocities))) if "m" in self.parameters else None

    @property
    def _inertia(self) -> Inertia | None:
        return inertia_of(self.values(), self.critical_speed or 0.0)

    @property
    def A_minus_B(self) -> Estimate:
        """A minus all B (a - b), the rate dependence of steady friction, with its standard error,
        in the unit of friction. A negative A - B is velocity weakening. The error includes other
        slip lengths that fit nearly as well.
        """
        found = rate_dependence(self, float(np.ptp(self.record.friction)), self._along)
        return found if self.converged else replace(found, determined=False)

    def critical(self) -> Critical:
        """The critical stiffness and the ratio K/K_cr, with 95 % intervals from 4096 samples of the
        covariance."""
        return self._critical

    @functools.cached_property
    def _critical(self) -> Critical:
        """Sampled once, because tables, files and pages use it."""
        used = [n for n in self.parameters if n.rstrip("0123456789") in ("A", "B", "L")]
        known = self.converged and all(self.parameters[n].determined for n in used)
        # values of a fit that did not converge may be impossible for the law
        value = self.critical_stiffness() if self.converged else np.nan
        return critical_of(self, self.model, value, known=known, inertia=self._inertia)

    @functools.cached_property
    def trended(self) -> Trended | None:
        """The free parameters if a slip trend were fitted too, to first order. The result is None
        if the fit already has a slip trend or did not converge.
        """
        if self.solved is None or not self.converged or self.model.slip_trend:
            return None
        return with_slip_trend(self.solved, self.steps.displacement(self.record.relative_time))

    @property
    def with_trend(self) -> tuple[float, float] | None:
        """A minus all B and its standard error in the fit with a slip trend (`trended`)."""
        if self.trended is None:
            return None
        weight = np.append(0.0, weights(self))
        error = np.sqrt(max(weight @ self.trended.covariance @ weight, 0.0))
        return difference(self)[0] + float(weight @ self.trended.change), float(error)

    @functools.cached_property
    def _along(self) -> Interval | None:
        """The interval of A - B along other slip lengths; computed once."""
        solved = self.solved
        if solved is None or not self.converged:
            return None
        return along_length(self, lambda: minimum_of(solved.problem, solved.solution))

    def stability(self) -> Claim:
        """The stability claim from A and all B (and L, for a critical stiffness). The claim is made
        only if a fitted slip trend would not change the claim.
        """
        return held_with_trend(self.claim(), self.with_trend)

    @functools.cached_property
    def findings(self) -> tuple[Finding, ...]:
        """Claims of the fit, each with the rows of the record that support it."""
        return stability_finding(
            self.stability(), self, self.A_minus_B, self.solved, len(self.record)
        )

    def claim(self) -> Claim:
        """The stability claim of the fitted model itself, without regard to a missing trend."""
        if not self.converged:
            return no_claim(ClaimReason.NOT_CONVERGED)
        lengths = [n for n in self.parameters if n.rstrip("0123456789") == "L"]
        _, error = difference(self)
        names = amplitudes(self)
        A, *B = (self.parameters[n].value for n in sorted(names))
        known = all(self.parameters[n].determined for n in names)
        claim = rate_state_claim(A, B, error, determined=known)
        if claim.kind != "open" and not one_sign(self._along):
            return no_claim(ClaimReason.OTHER_LENGTH)
        if claim.kind == "critical" and not all(self.parameters[n].determined for n in lengths):
            return no_claim(ClaimReason.UNDETERMINED, parameter="L")
        return claim

    def to_json(self) -> dict:
        """The content of `fit.json`, schema `schemas.FIT`; SI, null for unknown values."""
        return said("fit_json.content", self)


def unit_of(name: str, friction_unit: str) -> str:
    """SI unit of a parameter where friction is in `friction_unit`."""
    return tidy_unit(quantity_of(name).unit_for(friction_unit))


def tidy_unit(unit: str) -> str:
    """A unit as people write it: "1/m" stays, "1 s/m" becomes "s/m"."""
    return unit.removeprefix("1 ") if unit.startswith("1 ") else unit


def display_unit(name: str, fit: Fit) -> tuple[str, float]:
    """The unit in which a parameter or `A_minus_B` is shown, and the size of this unit in SI.

    Lengths and velocities have the unit of the record.
    """
    friction = fit.record.friction_unit
    length = fit.record.units.get("load_point_displacement", "um")
    length = "um" if length.startswith("micro") else length
    about = quantity_of("A" if name == DIFFERENCE else name)
    si = about.unit_for(friction)
    shown = {"m": length, "F/m": f"{friction}/{length}", "m/s": f"{length}/s"}
    unit = shown.get(about.unit, si)
    return unit, 1.0 if unit == si else factor(unit, si, name)
