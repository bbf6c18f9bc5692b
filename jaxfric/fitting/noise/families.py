"""A family of noises: which parts a noise has, on which clocks, and the vector of their parameters.

The parameters of a family are those of its parts (`parts`), concatenated: logarithms of size,
correlation length and shape.
"""

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from . import thresholds as const
from .model import Noises, white_of
from .parts import Exponential, Limits, Term


class Family(NamedTuple):
    """The parts of a noise and their clocks; a family without parts is white noise."""

    terms: tuple[Term, ...] = ()

    @property
    def parameters(self) -> int:
        """Number of parameters of the family, without sigma."""
        return sum(kind.parameters for kind, _ in self.terms)

    @property
    def unordered(self) -> "Family":
        """The family with its parts in one order: families that differ in order only are equal."""
        return Family(tuple(sorted(self.terms, key=str)))

    def joined(
        self, term: Term, theta: np.ndarray, new: Sequence[Sequence[float]]
    ) -> tuple["Family", np.ndarray]:
        """The family with one more part, and the parameters (g, q) of the new family. The
        parameters join `theta` of this family and `new` (g, p) of the added part. Parts with few
        parameters come first, so few orders of parts are compiled.
        """
        at = sum(kind.parameters < term.kind.parameters for kind, _ in self.terms)
        terms = self.terms[:at], self.terms[at:]
        place = Family(terms[0]).parameters
        both = np.array([[*theta[:place], *own, *theta[place:]] for own in new])
        return Family((*terms[0], term, *terms[1])), both

    def without(self, k: int, theta: np.ndarray) -> tuple["Family", np.ndarray]:
        """The family without its part `k`, and the parameters of the new family."""
        rest = [own for i, own in enumerate(self.split(theta)) if i != k]
        terms = tuple(term for i, term in enumerate(self.terms) if i != k)
        return Family(terms), np.concatenate([np.zeros(0), *rest])

    def moved(self, theta: np.ndarray, clock: int) -> list[tuple["Family", np.ndarray]]:
        """The families with one part moved to another `clock`, where it starts at a correlation
        length of 1; from white noise, the family with an exponential over this clock.
        """
        if not self.terms:
            return [(Family((Exponential.over(clock),)), np.zeros(Exponential.parameters))]
        found = []
        for k, (kind, _) in enumerate(self.terms):
            terms, own = list(self.terms), self.split(np.array(theta))
            terms[k] = kind.over(clock)
            own[k][1] = 0.0
            found.append((Family(tuple(terms)), np.concatenate(own)))
        return found

    def split(self, theta: Float[np.ndarray, "*g q"]) -> list[Float[np.ndarray, "*g p"]]:
        """The parameters of every part of the family."""
        ends = np.cumsum([term.kind.parameters for term in self.terms])[:-1]
        return np.split(theta, ends, axis=-1) if self.terms else []

    def resolved(self, theta: np.ndarray, limits: Limits) -> bool:
        """Whether the rows resolve all parts of a noise with parameters `theta`."""
        pairs = zip(self.terms, self.split(theta), strict=True)
        return all(kind.resolved(own, limits, clock) for (kind, clock), own in pairs)

    def bounds(self, limits: Limits) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper bounds of the family's parameters, (q,) each."""
        ends = [
            end
            for kind, k in self.terms
            for end in kind.bounds(np.log(limits.shortest[k]), np.log(limits.longest[k]))
        ]
        low, high = np.array(ends, float).reshape(-1, 2).T
        return low, high


def noises_at(family: Family, theta: Float[np.ndarray, "g q"], limits: Limits) -> Noises:
    """The noises of a family with parameters `theta`."""
    pairs = zip(family.terms, family.split(theta), strict=True)
    parts = [kind.at(own, limits, clock) for (kind, clock), own in pairs]
    whole = 1 + sum((part.share for part in parts), np.zeros(len(theta)))
    return Noises(1 / whole, tuple(part.with_share(part.share / whole) for part in parts))


def noises_around(
    family: Family,
    thetas: Sequence[np.ndarray],
    limits: Limits,
    *,
    sizes: Sequence[float] = const.SIZES_AROUND,
    memories: Sequence[float] = const.MEMORIES_AROUND,
    alike: bool = False,
    white: bool = True,
) -> Noises:
    """Noises of a family around and between some parameters `thetas`; `white` adds white noise.

    `sizes` and `memories` are offsets of ln(size) and ln(correlation length) from points between
    the first and last theta. Offsets of correlation lengths are equal for all parts. If `alike` is
    True, offsets of sizes are equal for all parts too.
    """
    first, last, number = thetas[0], thetas[-1], len(family.terms)
    each = zip(*[sizes] * number, strict=True) if alike else itertools.product(sizes, repeat=number)
    shifts = [
        [x for size, (kind, _) in pairs for x in (size, memory, *[memory] * (kind.parameters - 2))]
        for pairs in (list(zip(own, family.terms, strict=True)) for own in each)
        for memory in memories
    ]
    centres = [first + part * (last - first) for part in const.BETWEEN]
    theta = np.array([c + s for c in centres for s in np.array(shifts, float)] or [first])
    theta = np.unique(inside(theta, family, limits).round(9), axis=0)
    if not (white and number):
        return noises_at(family, theta, limits)
    noises = noises_at(family, np.concatenate([theta[:1], theta]), limits)
    correlated = np.arange(len(theta) + 1) > 0
    parts = tuple(part.with_share(part.share * correlated) for part in noises.parts)
    return Noises(white_of(parts), parts)


def inside(theta: np.ndarray, family: Family, limits: Limits) -> np.ndarray:
    """The parameters moved to the nearest values within the bounds of the family."""
    return np.clip(theta, *family.bounds(limits))
