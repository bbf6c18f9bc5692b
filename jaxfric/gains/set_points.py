"""Gains along a velocity profile: a chain of set points whose basins intersect.

Section I.A of the 1994 note: set points with intersecting basins of attraction extend an analysis
of steady sliding to motion that never sticks. The basin of a set point is the range of velocities
from which the simulated slider settles at the set point (`verify.jump_sizes`). The chain of set
points is complete if every step from one set point to the next, up and down, is inside a basin.
"""

import itertools
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import ArrayLike

from ..coordinate import Coordinate
from ..described import Described, Tabular
from ..errors import InputError
from ..findings import WarningCode, warned
from ..laws import LawSource
from ..laws.registry import Law
from ..saved.law import Result, law_source
from ..silent import silent
from .gains import find_gains
from .requirement import DEFAULT, Requirement
from .scenarios import Scenarios
from .thresholds import MOST_SET_POINTS
from .verify import jump_sizes


@dataclass(frozen=True)
class SetPoint:
    """One set point: gains, and the velocity jumps after which the slider settles, in SI."""

    velocity: float
    kp: float
    kv: float
    up: float
    """The slider settles from velocity/r for every r up to this."""
    down: float
    """The slider settles from velocity r for every r up to this."""
    up_lost: str
    """How the first larger jump up ends: "limit_cycle", "escape" or "unresolved"; "steady" if all
    settle. `up` is then the largest r tried: 10, or 4 times the larger step to a neighbour."""
    down_lost: str
    """The same for jumps down."""


@dataclass(frozen=True, repr=False)
class Schedule(Described, Tabular):
    """A chain of set points from the slowest to the fastest."""

    points: tuple[SetPoint, ...]
    covered: bool | None
    """Whether every step of the chain is inside the basin at its end, up and down; None if
    unresolved simulations leave this open (a warning counts the steps)."""
    gap: tuple[float, float] | None
    """The first two velocities between which the chain breaks [m/s]."""
    warnings: tuple[str, ...] = ()
    """Warnings of the law, one for velocities beyond its record, and one for unresolved steps."""
    coordinate: Coordinate = "linear"
    """Whether the numbers are linear (m and N) or rotary (rad and N m)."""

    def gains(self, velocity: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """Gains (k_p, k_v) for a velocity, from the set point nearest in log velocity."""
        V = np.asarray(velocity, float)
        place = np.log([point.velocity for point in self.points])
        nearest = np.argmin(np.abs(np.log(V)[..., None] - place), axis=-1)
        kp = np.asarray([point.kp for point in self.points])
        kv = np.asarray([point.kv for point in self.points])
        return kp[nearest], kv[nearest]


def gain_schedule(
    law: LawSource | Law | Result,
    *,
    velocity: tuple[float, float],
    mass: ArrayLike | None,
    margin: Mapping[str, float] | Requirement | str = DEFAULT,
    ratio: float = 3.0,
    finest: float = 1.2,
    progress: Callable[[str], None] | None = None,
) -> Schedule:
    """Compute minimum-norm gains at set points between two velocities [m/s]; check the chain.

    Neighbouring set points are at first a factor `ratio` apart in velocity. The gains of each set
    point have the required margins up to half-way (in log velocity) to the neighbouring set points,
    in every sample of the law and for every mass. The gains of the first and the last set point
    have them only inside the range. If a step to a neighbour is outside the basin, a set point is
    inserted between the two. No set point is inserted if two set points would then differ by less
    than a factor `finest`, or because a simulation is unresolved. Simulations use the law's
    estimate and the largest mass.

    `law` is as in `find_gains`; for a friction coefficient pass `law_from_fit(fit,
    normal_force=500)`.

    Raises
    ------
    InputError : an empty range; ratio not above `finest`, finest not above 1; no gains (as
        `find_gains`).
    """
    low, high = (float(v) for v in velocity)
    if not 0 < low < high:
        raise InputError(f"gain_schedule: velocities {low:g} to {high:g} m/s are not a range")
    if not ratio > finest > 1:
        raise InputError(f"gain_schedule: needs ratio > finest > 1, not {ratio:g} and {finest:g}")
    law = law_source(law, None)
    mass = law.mass if mass is None else mass
    tell = progress or silent
    count = max(2, 1 + math.ceil(math.log(high / low) / math.log(ratio)))
    places = np.geomspace(low, high, count).tolist()
    known: dict[tuple[float, float, float], SetPoint] = {}
    while True:
        points = []
        for i, V in enumerate(places):
            three = places[max(i - 1, 0)], V, places[min(i + 1, len(places) - 1)]
            if three not in known:
                tell(f"set point {V:.3g} m/s")
                known[three] = _set_point(law, three, mass, margin)
            points.append(known[three])
        chained = [_chained(slow, fast) for slow, fast in itertools.pairwise(points)]
        broken = [i for i, inside in enumerate(chained) if inside is False]
        fine = [i for i in broken if places[i + 1] / places[i] < finest**2]
        if not broken or fine or len(places) + len(broken) > MOST_SET_POINTS:
            gap = None if not broken else (places[broken[0]], places[broken[0] + 1])
            warnings = (*law.warnings, *law.unseen([low, high]))
            unknown = chained.count(None)
            if unknown:
                count = {"unresolved": unknown, "steps": len(chained)}
                warnings += (warned(WarningCode.UNRESOLVED_STEPS, **count),)
            covered = False if broken else None if unknown else True
            return Schedule(tuple(points), covered, gap, warnings, law.coordinate or "linear")
        for i in reversed(broken):
            places.insert(i + 1, math.sqrt(places[i] * places[i + 1]))


def _chained(slow: SetPoint, fast: SetPoint) -> bool | None:
    """Whether both steps are inside the basins; None if unresolved simulations leave it open."""
    step = fast.velocity / slow.velocity
    sides = ((fast.up, fast.up_lost), (slow.down, slow.down_lost))
    lost = {end for size, end in sides if size < step}
    return None if lost == {"unresolved"} else not lost


def _set_point(
    law: LawSource,
    three: tuple[float, float, float],
    mass: ArrayLike | None,
    margin: Mapping[str, float] | Requirement | str,
) -> SetPoint:
    """The middle one of `three` neighbours; at an end of the chain it is its own neighbour."""
    slower, V, faster = three
    low, high = math.sqrt(slower * V), math.sqrt(V * faster)
    around = np.asarray([low, math.sqrt(low * V), V, math.sqrt(V * high), high])
    found = find_gains(law, velocity=around, mass=mass, margin=margin)
    heaviest = None if mass is None else np.atleast_1d(np.max(np.asarray(mass)))
    here = Scenarios.at(law.samples, np.asarray([V]), heaviest, np.asarray([0]))
    gains = np.asarray([found.kp, found.kv])
    largest = max(10.0, 4 * max(V / slower, faster / V))
    sizes = jump_sizes(here, gains, largest=largest)
    up, down = float(sizes.up[0]), float(sizes.down[0])
    return SetPoint(V, found.kp, found.kv, up, down, sizes.up_lost[0], sizes.down_lost[0])
