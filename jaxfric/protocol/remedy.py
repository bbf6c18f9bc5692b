"""Find a change of a plan that distinguishes a pair of effects."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

from .design import Change, Design, Pair, Protocol


@dataclass(frozen=True, eq=False)
class Remedy:
    """A change of a plan, and the answer of the changed plan on a pair of effects."""

    change: Change
    pair: Pair
    enough: bool
    """Whether the pair is distinguished, also at the known sizes."""

    def to_json(self) -> dict[str, object]:
        """Return the change, and the changed plan's answer, as JSON values."""
        return self.change.planned() | {"enough": self.enough, "answer": self.pair.to_json()}


class Answer(NamedTuple):
    """The answer of a plan on a pair of effects; empty if no pair is given."""

    pair: Pair | None = None
    better: Remedy | None = None
    less: Change | None = None
    """A change that is reported instead of `better`, because it takes less time."""

    @property
    def change(self) -> Change | None:
        """The reported change of the plan."""
        return self.less if self.better is None else self.better.change

    def to_json(self, command: str) -> dict[str, object]:
        """Return the answer's part of protocol.json. `command` is the command line of the changed
        plan.
        """
        if self.pair is None:
            return {}
        line = {"command": command or None}
        change = None if self.better is None else self.better.to_json() | line
        less = None if self.less is None else self.less.planned() | line
        return {"asked": self.pair.to_json() | {"change": change, "shorter": less}}


def answer_of(plan: Protocol, ids: tuple[str, str], known: Mapping[str, float]) -> Answer:
    """Return the answer of a plan on two effects, of sizes `known` by name (SI)."""
    better = remedy(plan, ids, known)
    less = shorter(plan, ids, known) if better is None else None
    return Answer(plan.design.pair(*ids), better, less)


def remedy(plan: Protocol, ids: tuple[str, str], known: Mapping[str, float]) -> Remedy | None:
    """Return the cheapest change that distinguishes two effects, of sizes `known` by name (SI).

    Shorter changes are excluded (`Protocol.no_shorter`). An additional channel needs another
    instrument, so that changes without an additional channel come first, in order of duration. If
    no change distinguishes the effects, the change that comes nearest is returned. The result is
    None if the plan needs no change, or if no change helps.
    """
    possible = [(c, c.design) for c in plan.no_shorter() if c.design is not None]
    lacks = {c.key: _lack(design, ids, known) for c, design in possible}
    best, design = min(
        possible, key=lambda one: (lacks[one[0].key], _cost(plan, one[0])), default=(None, None)
    )
    if best is None or design is None or lacks[best.key] >= _lack(plan.design, ids, known):
        return None
    return Remedy(best, design.pair(*ids), lacks[best.key] == _NOTHING)


def shorter(plan: Protocol, ids: tuple[str, str], known: Mapping[str, float]) -> Change | None:
    """Return the change to half the slip per step if two effects remain distinguishable, or None.

    The changed plan distinguishes both effects at about the same sizes, and is as good for all
    other effects. The result is also None if the plan does not distinguish the two effects.
    """
    half = next((c for c in plan.changes if c.key == "slip_half"), None)
    if half is None or half.design is None:
        return None
    lacks = max(_lack(design, ids, known) for design in (plan.design, half.design))
    return half if lacks == _NOTHING and _as_good(half.design, plan.design, ids) else None


def _as_good(design: Design, plan: Design, ids: tuple[str, str]) -> bool:
    """Whether a design distinguishes two effects at about the same sizes as a plan, for the best
    and the least detectable shape, without making either similar to another effect."""
    if {p[:2] for p in design.likes(*ids)} - {p[:2] for p in plan.likes(*ids)}:
        return False
    own, other = design.pair(*ids).sizes, plan.pair(*ids).sizes
    worst = [{s.id: s.worst or 0.0 for s in d.smallest} for d in (design, plan)]
    return all(
        own[id] <= _ABOUT * other[id] and worst[0][id] <= _ABOUT * worst[1][id] for id in other
    )


_ABOUT = 1.25
_NOTHING = (0, 1.0)


def _lack(design: Design, ids: tuple[str, str], known: Mapping[str, float]) -> tuple[int, float]:
    """Rank how far a design is from distinguishing a pair, (0, 1) being enough.

    If it does, the second number is the required size over the known one; else it is the
    similarity of the effects. The first is largest if one of them is not detectable.
    """
    pair = design.pair(*ids)
    if not pair.apart:
        return (2, 0.0) if pair.cosine is None else (1, 1.0 if pair.needed else pair.cosine)
    times = [pair.sizes[s.id] / max(size, 1e-300) for s, size in design.too_small(pair, known)]
    return 0, max([1.0, *times])


def _cost(plan: Protocol, change: Change) -> tuple[bool, float]:
    """Rank the cost of a change: an added channel needs another instrument; then time."""
    return change.slip_noise is not None and plan.slip_noise is None, change.duration
