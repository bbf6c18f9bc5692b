"""Results of `protocol.plan`: what a planned protocol can distinguish."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from ..described import Described, Drawable, Tabular
from ..findings import listed
from ..loop.thresholds import ALIAS
from ..plain import entries, plain
from ..records import VelocitySteps
from ..schemas import PROTOCOL


@dataclass(frozen=True)
class Smallest:
    """The smallest size at which an effect is detected in 19 of 20 records, to first order. SI."""

    id: str
    names: tuple[str, ...]
    """Names of the effect's amplitudes; if several, `amplitude` is the root of the sum of
    squares."""
    unit: str
    amplitude: float | None
    """Amplitude at the best detectable shape; None if no possible amplitude is detectable."""
    shape: Mapping[str, float]
    """Shape parameters at which the effect is best detectable."""
    worst: float | None
    """Amplitude at the least detectable shape."""
    needed: float | None
    """The required amplitude, even if it is not physically possible; else equal to `amplitude`."""
    limit: float = math.inf
    """The largest plausible amplitude for friction similar to the base's friction."""


BASE = "base"
"""Name of the model without effects, as a member of a pair."""


@dataclass(frozen=True)
class Pair:
    """Whether a plan distinguishes two effects, or an effect and the base."""

    ids: tuple[str, str]
    cosine: float | None
    """|cosine| of the two effects; None if one of `ids` is the base, or is not detectable."""
    apart: bool
    sizes: Mapping[str, float]
    """If `apart`: the amplitude of each effect above which the other effect cannot imitate this
    effect. To first order a fit with the other leaves a^2 |s|^2 (1 - cosine^2) of the likelihood
    ratio."""
    needed: Mapping[str, float] = field(default_factory=dict)
    """The amplitudes as in `sizes`, if one exceeds its plausible limit, so that the effects are not
    `apart`."""

    def to_json(self) -> dict:
        """Return the answer as JSON values."""
        return {
            "effects": list(self.ids),
            "cosine": self.cosine,
            "told_apart": self.apart,
            "smallest": dict(self.sizes),
        }


@dataclass(frozen=True, eq=False)
class Design:
    """Sensitivities of one variant of a plan."""

    ids: tuple[str, ...]
    cosines: np.ndarray
    """|cosine| of two effects; nan if one of them is not detectable."""
    smallest: tuple[Smallest, ...]
    time: np.ndarray
    predicted: np.ndarray
    """Prediction of the base at these times, without noise."""

    def pairs(self) -> tuple[tuple[str, str, float], ...]:
        """Return indistinguishable pairs of effects with their cosine, the most similar first."""
        found = [
            (self.ids[j], self.ids[i], float(self.cosines[i, j]))
            for i in range(len(self.ids))
            for j in range(i)
            if self.cosines[i, j] > ALIAS
        ]
        return tuple(sorted(found, key=lambda pair: -pair[2]))

    def pair(self, a: str, b: str) -> Pair:
        """Return whether the plan distinguishes two effects in `ids`, or one effect and `BASE`."""
        of_id = {s.id: s for s in self.smallest}
        effects = [of_id[id] for id in (a, b) if id != BASE]
        known = {s.id: s.amplitude for s in effects if s.amplitude is not None}
        cosine = None
        if len(known) == 2:
            cosine = float(self.cosines[self.ids.index(a), self.ids.index(b)])
        if len(known) < len(effects) or (cosine or 0.0) > ALIAS:
            return Pair((a, b), cosine, False, {})
        left = math.sqrt(1 - (cosine or 0.0) ** 2)
        sizes = {id: size / left for id, size in known.items()}
        if any(sizes[s.id] > s.limit for s in effects):
            return Pair((a, b), cosine, False, {}, sizes)
        return Pair((a, b), cosine, True, sizes)

    def likes(self, *ids: str) -> tuple[tuple[str, str, float], ...]:
        """Return indistinguishable pairs of one effect in `ids` and one effect outside of `ids`."""
        return tuple(p for p in self.pairs() if len({p[0], p[1]} & set(ids)) == 1)

    def too_small(
        self, pair: Pair, known: Mapping[str, float]
    ) -> tuple[tuple[Smallest, float], ...]:
        """Return effects of a distinguished pair whose size in `known` (by name) is below the
        required size, with the required size. SI."""
        out = []
        for s in self.smallest:
            found = [known.get(f"{s.id}.{name}") for name in s.names]
            size = math.hypot(*(value for value in found if value is not None))
            if s.id in pair.sizes and None not in found and size < pair.sizes[s.id]:
                out.append((s, size))
        return tuple(out)

    def unseen(self) -> tuple[str, ...]:
        """Return the effects that are not detectable at any size."""
        return tuple(s.id for s in self.smallest if s.amplitude is None)

    def to_json(self) -> dict[str, object]:
        """Return the effects, and the pairs that the plan cannot distinguish, as JSON values."""
        effects = [
            {
                "id": s.id,
                "amplitude": s.names,
                "unit": s.unit,
                "smallest": s.amplitude,
                "shape": s.shape,
                "smallest_at_worst_shape": s.worst,
                "would_need": s.needed,
            }
            for s in self.smallest
        ]
        pairs = [{"effects": [a, b], "cosine": value} for a, b, value in self.pairs()]
        return plain(
            {"effects": effects, "cosines": self.cosines, "pairs": pairs, "unseen": self.unseen()}
        )


@dataclass(frozen=True, eq=False)
class Change:
    """A plan with one change, or the plan itself. SI."""

    key: str
    text: str
    velocities: tuple[float, ...]
    slip_per_step: float
    slip_noise: float | None = None
    """Noise of a slip channel [m]; None without this channel."""
    shapes_of: float | None = None
    """Slip per step [m] that sets the lengths and times of effects, if it is another one."""
    design: Design | None = None
    """None if the slider runs away."""

    @property
    def durations(self) -> np.ndarray:
        """Return the time at each velocity [s]."""
        return self.slip_per_step / np.asarray(self.velocities)

    @property
    def duration(self) -> float:
        """Return the duration of the whole sequence [s]."""
        return float(self.durations.sum())

    def steps(self) -> VelocitySteps:
        """Return the commanded motion."""
        starts = np.concatenate([[0.0], np.cumsum(self.durations[:-1])])
        return VelocitySteps(starts, np.asarray(self.velocities))

    def planned(self) -> dict[str, object]:
        """Return the changed plan as JSON values; the noise is null without a slip channel."""
        return {
            "change": self.key,
            "text": self.text,
            "duration": self.duration,
            "velocities": list(self.velocities),
            "slip_per_step": self.slip_per_step,
            "slip_noise": self.slip_noise,
        }


@dataclass(frozen=True, eq=False)
class Planned:
    """A planned sequence of velocity steps, its machine, its recorder and the base model. SI."""

    velocities: Sequence[float]
    """Commanded velocities [m/s], each for `slip_per_step` of load-point motion."""
    slip_per_step: float
    stiffness: float
    """Stiffness of the machine [F/m]."""
    noise: float
    """Standard deviation of a sample, for white noise [F]."""
    parameters: Mapping[str, float]
    """Parameters of the base: f0, A, B, L (B2, L2, ...), and V0 if not the first velocity.
    Parameters of the base's effects are named "viscous.c"; by default such parameters are at their
    null."""
    law: str = "slip"
    friction_unit: str = "1"
    rows: int = 250
    """Number of samples at each velocity, evenly spaced in time."""
    slip_noise: float | None = None
    """Standard deviation of a slip channel [m]; None without a slip channel."""
    noise_from: str = ""
    """Origin of the noise, in words: a file, an option."""


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Protocol(Described, Drawable, Tabular, Planned):
    """A planned sequence of velocity steps, and the effects that it can distinguish. SI."""

    with_: tuple[str, ...]
    critical_stiffness: float
    ratio: float | None
    """K/K_cr; None if any stiffness is stable."""
    design: Design
    changes: tuple[Change, ...]
    """Changes of the plan, the cheapest first."""
    warnings: tuple[str, ...]
    seconds: float

    @property
    def duration(self) -> float:
        """Return the duration of the whole sequence [s]."""
        return float(sum(self.slip_per_step / V for V in self.velocities))

    def separated(self, change: Change) -> tuple[tuple[str, str], ...]:
        """Return the pairs that only the changed plan distinguishes."""
        if change.design is None:
            return ()
        after = {pair[:2] for pair in change.design.pairs()}
        return tuple((a, b) for a, b, _ in self.design.pairs() if (a, b) not in after)

    def no_shorter(self) -> tuple[Change, ...]:
        """Return the changes that take no less time than the plan. In a shorter plan the best
        detectable lengths and times shrink, so that a shorter plan looks better than it is."""
        return tuple(c for c in self.changes if c.duration > 0.99 * self.duration)

    def recommended(self) -> Change | None:
        """Of the changes that are not shorter, return the first with the fewest indistinguishable
        pairs; None if no change has fewer such pairs than the plan."""
        left = {c: len(c.design.pairs()) for c in self.no_shorter() if c.design is not None}
        best = min(left, key=left.__getitem__, default=None)
        return best if best is not None and left[best] < len(self.design.pairs()) else None

    def to_json(self) -> dict:
        """Return the content of `protocol.json`, schema `schemas.PROTOCOL`; SI, null: unknown."""
        best = self.recommended()
        known = ("velocities", "slip_per_step", "duration", "stiffness", "noise", "noise_from")
        known += ("slip_noise", "friction_unit", "law", "parameters", "seconds")
        return {
            "schema": PROTOCOL,
            **plain(entries(self, *known)),
            **listed(self.warnings),
            "critical_stiffness": self.critical_stiffness if self.ratio is not None else None,
            "stiffness_ratio": self.ratio,
            "rows_per_step": self.rows,
            "with": list(self.with_),
            "threshold": ALIAS,
            "plan": self.design.to_json(),
            "changes": [
                {
                    **c.planned(),
                    "separates": [list(pair) for pair in self.separated(c)],
                    "remaining": None if c.design is None else len(c.design.pairs()),
                    **({} if c.design is None else c.design.to_json()),
                }
                for c in self.changes
            ],
            "recommended": None if best is None else best.key,
        }
