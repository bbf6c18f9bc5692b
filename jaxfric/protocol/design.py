"""Results of `protocol.plan`: what a planned protocol can distinguish."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from ..described import Described, Drawable, Tabular
from ..loop.thresholds import ALIAS
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

    def groups(self) -> tuple[tuple[str, ...], ...]:
        """Return groups of effects linked by indistinguishable pairs, the largest group first."""
        group = {id: {id} for id in self.ids}
        for a, b, _ in self.pairs():
            joined = group[a] | group[b]
            for id in joined:
                group[id] = joined
        once = {min(map(self.ids.index, g)): g for g in group.values() if len(g) > 1}
        ordered = [tuple(sorted(once[k], key=self.ids.index)) for k in sorted(once)]
        return tuple(sorted(ordered, key=lambda g: -len(g)))

    def pair(self, a: str, b: str) -> Pair:
        """Return whether the plan distinguishes two of `ids`, or one of `ids` and `BASE`."""
        seen = {s.id: s.amplitude for s in self.smallest}
        effects = [id for id in (a, b) if id != BASE]
        known = {id: x for id in effects if (x := seen[id]) is not None}
        cosine = None
        if len(effects) == 2 and len(known) == 2:
            cosine = float(self.cosines[self.ids.index(a), self.ids.index(b)])
        apart = len(known) == len(effects) and (cosine is None or cosine <= ALIAS)
        left = math.sqrt(1 - (cosine or 0.0) ** 2) if apart else 1.0
        sizes = {id: size / left for id, size in known.items()} if apart else {}
        limits = {s.id: s.limit for s in self.smallest}
        if any(size > limits[id] for id, size in sizes.items()):
            return Pair((a, b), cosine, False, {}, sizes)
        return Pair((a, b), cosine, apart, sizes)

    def likes(self, *ids: str) -> tuple[tuple[str, str, float], ...]:
        """Return indistinguishable pairs of one of `ids` and an effect outside of `ids`."""
        return tuple(p for p in self.pairs() if len({p[0], p[1]} & set(ids)) == 1)

    def from_all(self, id: str) -> tuple[str, float | None]:
        """Among effects distinguishable from `id`, return the one that needs the largest amplitude
        of `id`, and that amplitude; None without such an effect."""
        seen = {s.id: s.amplitude for s in self.smallest}
        own, size = self.ids.index(id), seen[id]
        like = [c if k != own and c <= ALIAS else -1.0 for k, c in enumerate(self.cosines[own])]
        k = int(np.argmax(like))
        if size is None or like[k] < 0:
            return "", None
        return self.ids[k], size / math.sqrt(1 - like[k] ** 2)

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


@dataclass(frozen=True, eq=False)
class Change:
    """A change of the plan, and the `design` of the changed plan; None if the slider runs away. SI.

    Velocities, slip and noise of the channels are those of the changed plan; the noise of a missing
    channel is None.
    """

    key: str
    text: str
    duration: float
    design: Design | None
    velocities: tuple[float, ...] = ()
    slip_per_step: float = math.nan
    slip_noise: float | None = None
    encoder_noise: float | None = None

    def planned(self) -> dict[str, object]:
        """Return the changed plan as JSON values; null for a missing channel."""
        return {
            "change": self.key,
            "text": self.text,
            "duration": self.duration,
            "velocities": list(self.velocities),
            "slip_per_step": self.slip_per_step if self.velocities else None,
            "slip_noise": self.slip_noise,
            "load_point_noise": self.encoder_noise,
        }


@dataclass(frozen=True, eq=False, repr=False)
class Protocol(Described, Drawable, Tabular):
    """A planned sequence of velocity steps, and the effects that it can distinguish. SI."""

    velocities: tuple[float, ...]
    slip_per_step: float
    stiffness: float
    noise: float
    slip_noise: float | None
    rows: int
    friction_unit: str
    law: str
    parameters: Mapping[str, float]
    with_: tuple[str, ...]
    critical_stiffness: float
    ratio: float | None
    """K/K_cr; None if any stiffness is stable."""
    design: Design
    changes: tuple[Change, ...]
    """Changes of the plan, the cheapest first."""
    warnings: tuple[str, ...]
    seconds: float
    noise_from: str = ""

    @property
    def duration(self) -> float:
        """Return the duration of the whole sequence [s]."""
        return float(sum(self.slip_per_step / V for V in self.velocities))

    def separated(self, change: Change) -> tuple[tuple[str, str], ...]:
        """Return the pairs that only the changed plan distinguishes."""
        after = {(a, b) for a, b, _ in change.design.pairs()} if change.design else None
        pairs = [(a, b) for a, b, _ in self.design.pairs()]
        return () if after is None else tuple(pair for pair in pairs if pair not in after)

    def no_shorter(self) -> tuple[Change, ...]:
        """Return the changes that take no less time than the plan. In a shorter plan the best
        detectable lengths and times shrink, so that a shorter plan looks better than it is."""
        return tuple(c for c in self.changes if c.duration > 0.99 * self.duration)

    def recommended(self) -> Change | None:
        """Of the changes that are not shorter, return the first with the fewest indistinguishable
        pairs; None if no change has fewer such pairs than the plan."""
        possible = [c for c in self.no_shorter() if c.design is not None]
        best = min(possible, key=_remaining, default=None)
        if best is None or _remaining(best) >= len(self.design.pairs()):
            return None
        return best

    def to_json(self) -> dict:
        """Return the content of `protocol.json`, schema `schemas.PROTOCOL`; SI, null: unknown."""
        best = self.recommended()
        return {
            "schema": PROTOCOL,
            "velocities": list(self.velocities),
            "slip_per_step": self.slip_per_step,
            "duration": self.duration,
            "stiffness": self.stiffness,
            "critical_stiffness": self.critical_stiffness if self.ratio is not None else None,
            "stiffness_ratio": self.ratio,
            "noise": self.noise,
            "noise_from": self.noise_from,
            "slip_noise": self.slip_noise,
            "rows_per_step": self.rows,
            "friction_unit": self.friction_unit,
            "law": self.law,
            "parameters": dict(self.parameters),
            "with": list(self.with_),
            "threshold": ALIAS,
            "plan": _plain(self.design),
            "changes": [
                {
                    **c.planned(),
                    "separates": [list(pair) for pair in self.separated(c)],
                    "remaining": None if c.design is None else len(c.design.pairs()),
                    **({} if c.design is None else _plain(c.design)),
                }
                for c in self.changes
            ],
            "recommended": None if best is None else best.key,
            "warnings": list(self.warnings),
            "seconds": self.seconds,
        }


def _remaining(change: Change) -> int:
    assert change.design is not None
    return len(change.design.pairs())


def _plain(design: Design) -> dict:
    return {
        "effects": [
            {
                "id": s.id,
                "amplitude": list(s.names),
                "unit": s.unit,
                "smallest": s.amplitude,
                "shape": dict(s.shape),
                "smallest_at_worst_shape": s.worst,
                "would_need": s.needed,
            }
            for s in design.smallest
        ],
        "cosines": [[v if np.isfinite(v) else None for v in row] for row in design.cosines],
        "pairs": [{"effects": [a, b], "cosine": value} for a, b, value in design.pairs()],
        "groups": [list(group) for group in design.groups()],
        "unseen": list(design.unseen()),
    }
