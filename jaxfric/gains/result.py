"""The result of a search for gains."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from ..coordinate import Coordinate, unit_of
from ..described import Described, Drawable, Tabular
from .frontier import Alone, Region
from .hunting import Hunting
from .requirement import FRAGILE, Requirement
from .scenarios import Scenarios
from .verify import CheckReport

SHORTEST_DELAY = 5e-5
"""Delay that any controller has [s]: that of one that samples at 30 kHz."""
NOTHING = 1e-7
"""Norm, or decay [1/s], of a k_p that stands for any k_p > 0."""


@dataclass(frozen=True)
class LocalOptimum:
    """A local optimum: "stiff" (k_p above critical) or "damped" (k_v nearly enough alone)."""

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
    """Whether a limit of the gains is active; for k_p its lower limit stands for k_p -> 0."""
    minimum: bool = True
    """False: no local minimum of the norm, but what stiffness or damping alone would need."""


@dataclass(frozen=True)
class WorstCase:
    """A margin at the recommended gains in the scenario where it is least."""

    value: float
    unit: str
    scenario: dict


@dataclass(frozen=True)
class Certificate:
    """Why the optimum is believed: KKT residual, and a dense grid that finds nothing smaller."""

    kkt_residual: float
    grid_points: int
    smaller_found: int
    rounds: int
    """Times that violated scenarios were added to those that the search carries."""


@dataclass(frozen=True, eq=False, repr=False)
class Gains(Described, Drawable, Tabular):
    """Minimum-norm PD gains, in SI; `kp` and `kv` are the recommended ones.

    Units are written for a line below; on a rotation they are those of `unit`.
    """

    kp: float
    kv: float
    norm: float
    optima: tuple[LocalOptimum, ...]
    """Local optima, the smallest norm first; then stiffness or damping alone, if that is none."""
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
    """Delay of the controller in every margin [s]; None: it has none."""
    alone: Alone | None = None
    """What stiffness alone and damping alone would do, with the margins and without."""
    largest: tuple[float, float] | None = None
    """Where no gains at all would do, with a late controller: the k_p with the least k_v, and the
    k_v with the least k_p, up to which the requirement is met. inf: up to all that were tried."""
    sample_time: float | None = None
    """That of the controller [s], where `delay` was told by it."""
    rest_friction: float | None = None
    """Static friction F_s [N] (`rest.friction_at_rest`); None where it is not known."""
    hunting: Hunting | None = None
    """Whether integral action makes it hunt about its target at rest; None: not simulated."""
    accuracy: float | None = None
    """How near its target the slider must stop [m], so that k_p >= F_s/accuracy; None: any."""

    @property
    def coordinate(self) -> Coordinate:
        """Whether the numbers are of a line, in m and N, or of a rotation, in rad and N m."""
        return self.region.coordinate

    def unit(self, si_unit: str) -> str:
        """The unit here of a quantity that has `si_unit` on a line."""
        return unit_of(si_unit, self.coordinate)

    @property
    def any_stiffness(self) -> bool:
        """Whether k_p is at its default lower limit, which stands for any positive stiffness."""
        return self.region.any_stiffness(self.kp)

    @property
    def smallest_kp(self) -> str:
        """Words for k_p at its lower limit: with a late controller a large k_p is unstable."""
        return "any k_p > 0" if self.delay is None else "any small k_p"

    @property
    def integral(self) -> float | None:
        """Integral gain k_i of the controller [N/(m s)]; None: it has none."""
        return self.scenarios.integral

    @property
    def dead_band(self) -> float | None:
        """F_s/k_p [m]: the slider stops anywhere within it of the target. None where friction at
        rest is not known, k_p stands for any, or integral action leaves no band."""
        if self.rest_friction is None or self.any_stiffness or self.integral is not None:
            return None
        return self.rest_friction / self.kp

    @property
    def is_spring(self) -> bool:
        """Whether the controller is one of spring and damper: neither late nor with integral."""
        return self.delay is None and self.integral is None

    @property
    def none_needed(self) -> bool:
        """Whether friction itself meets the requirement, so that the least gains are none."""
        return self.any_stiffness and self.kv == 0

    @property
    def unsafe(self) -> tuple[str, ...]:
        """Why nobody should use these gains, in words; empty where nothing is known against them.

        A simulated start escapes; or no delay of the controller was stated, and they bear less than
        any controller has.
        """
        why = []
        if self.simulation is not None and self.simulation.escaped:
            why.append(
                f"{self.simulation.escaped} of {self.simulation.checked} simulated starts escape"
            )
        borne = self.margins["delay"].value if "delay" in self.margins else np.inf
        if self.delay is None and self.scenarios.mass is not None and borne < SHORTEST_DELAY:
            why.append(
                f"they bear a delay of {1e6 * borne:.2g} us in the controller, less than any has"
                f" ({1e6 * SHORTEST_DELAY:.0f} us)"
            )
        return tuple(why)

    @property
    def fragile(self) -> bool:
        """Whether modulus was switched off and is below 0.2: a small error of the model, or of the
        gains, makes the loop unstable."""
        known = self.margins.get("modulus")
        off = "modulus" not in self.requirement.names
        return off and known is not None and known.value < FRAGILE


def norm_text(norm: float, digits: int = 5) -> str:
    """A norm; that of the least k_p that is tried, which stands for any, is none."""
    return "0" if norm < NOTHING else f"{norm:.{digits}g}"
