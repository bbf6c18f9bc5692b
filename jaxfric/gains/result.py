"""The result of a search for gains."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from ..coordinate import Coordinate, unit_of
from ..described import Described, Drawable, Tabular
from .frontier import Alone, Region
from .hunting import Hunting
from .requirement import Requirement
from .scenarios import Scenarios
from .thresholds import FEASIBLE, FRAGILE, SHORTEST_DELAY
from .verify import CheckReport


@dataclass(frozen=True)
class LocalOptimum:
    """A local optimum: "stiff" (k_p above critical) or "damped" (k_v almost suffices alone)."""

    name: str
    kp: float
    """k_p [N/m]."""
    kv: float
    """k_v [N s/m]."""
    norm: float
    margin: float
    """Least slack of any required margin in any scenario, relative to its requirement."""
    kkt_residual: float
    """Residual of the KKT equations."""
    active: tuple[dict, ...]
    """The scenarios in which the requirement is just met."""
    at_limit: bool
    """Whether a limit of the gains is active; the lower limit of k_p means k_p -> 0."""
    minimum: bool = True
    """False: not a local minimum of the norm, but the need of stiffness or damping alone."""


@dataclass(frozen=True)
class WorstCase:
    """Value of a margin at the recommended gains, in the scenario with the least margin."""

    value: float
    unit: str
    scenario: dict


@dataclass(frozen=True)
class Certificate:
    """Evidence of optimality: the KKT residual, and a dense grid without smaller gains."""

    kkt_residual: float
    grid_points: int
    smaller_found: int
    rounds: int
    """Number of rounds in which violated scenarios were added to the search."""


@dataclass(frozen=True, eq=False, repr=False)
class Gains(Described, Drawable, Tabular):
    """Minimum-norm PD gains, in SI; `kp` and `kv` are the recommended gains.

    Units in the docstrings of the fields are linear. For a rotation, the method `unit` gives the
    rotary unit.
    """

    kp: float
    kv: float
    norm: float
    optima: tuple[LocalOptimum, ...]
    """Local optima, smallest norm first, then stiffness or damping alone unless it is one."""
    margins: Mapping[str, WorstCase]
    scenarios: Scenarios
    requirement: Requirement
    region: Region
    confidence: float
    kept_samples: int
    """Samples of the law in which the requirement holds by construction."""
    certificate: Certificate
    law: str
    simulation: CheckReport | None = None
    warnings: tuple[str, ...] = field(default=())
    delay: float | None = None
    """Delay of the controller in every margin [s]; None: no delay."""
    alone: Alone | None = None
    """Whether stiffness alone or damping alone suffices, with and without margins."""
    largest: tuple[float, float] | None = None
    """If no gains are needed and the controller has a delay: the largest k_p with the least k_v,
    and the largest k_v with the least k_p, that meet the requirement. inf: all tried ones do."""
    sample_time: float | None = None
    """Sample time of the controller [s], if it defined `delay`."""
    rest_friction: float | None = None
    """Static friction F_s [N] (`rest.friction_at_rest`); None: unknown."""
    hunting: Hunting | None = None
    """Hunting about the target at rest, caused by integral action; None: not simulated."""
    accuracy: float | None = None
    """Required accuracy at rest [m], which implies k_p >= F_s/accuracy; None: any."""

    @property
    def coordinate(self) -> Coordinate:
        """Whether the numbers are linear (m and N) or rotary (rad and N m)."""
        return self.region.coordinate

    def unit(self, si_unit: str) -> str:
        """The linear or rotary unit of a quantity whose linear unit is `si_unit`."""
        return unit_of(si_unit, self.coordinate)

    @property
    def any_stiffness(self) -> bool:
        """Whether k_p is at its default lower limit, which means any positive stiffness."""
        return self.region.any_stiffness(self.kp)

    @property
    def smallest_kp(self) -> str:
        """Words for "any positive k_p"; with a controller delay "any" is limited to small k_p."""
        return "any k_p > 0" if self.delay is None else "any small k_p"

    @property
    def integral(self) -> float | None:
        """Integral gain k_i of the controller [N/(m s)]; None: no integral action."""
        return self.scenarios.integral

    @property
    def dead_band(self) -> float | None:
        """The distance F_s/k_p [m] from the target within which the slider stops anywhere. The dead
        band is None if friction at rest is unknown, if k_p means any stiffness, or with integral
        action."""
        if self.rest_friction is None or self.any_stiffness or self.integral is not None:
            return None
        return self.rest_friction / self.kp

    @property
    def is_spring(self) -> bool:
        """Whether the controller acts as spring and damper: no delay, no integral action."""
        return self.delay is None and self.integral is None

    @property
    def none_needed(self) -> bool:
        """Whether friction itself meets the requirement, so that no gains are needed."""
        return self.any_stiffness and self.kv == 0

    @property
    def unsafe(self) -> tuple[str, ...]:
        """Reasons in words against using these gains; empty if no reason is known.

        One possible reason is that a simulated motion escapes. Another possible reason is a delay
        margin below the delay of any real controller, if no controller delay was given.
        """
        why = []
        if self.simulation is not None and self.simulation.escaped:
            why.append(
                f"{self.simulation.escaped} of {self.simulation.checked} simulated starts escape"
            )
        borne = self.margins["delay"].value if "delay" in self.margins else np.inf
        if self.delay is None and self.scenarios.mass is not None and borne < SHORTEST_DELAY:
            why.append(
                f"their delay margin is {1e6 * borne:.2g} us, less than the delay of any controller"
                f" ({1e6 * SHORTEST_DELAY:.0f} us)"
            )
        return tuple(why)

    @property
    def fragile(self) -> bool:
        """Whether the modulus margin was switched off and is below 0.2. If so, a small error of the
        model or of the gains may make the loop unstable."""
        known = self.margins.get("modulus")
        off = "modulus" not in self.requirement.names
        return off and known is not None and known.value < FRAGILE


def norm_text(norm: float, digits: int = 5) -> str:
    """A norm as text; "0" if k_p means any stiffness."""
    return "0" if norm < FEASIBLE else f"{norm:.{digits}g}"
