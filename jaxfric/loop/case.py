"""An immutable record of a slider, a run or an axis, prepared for the loop.

A `Case` holds the least-squares problem of a record. A `close.Subject` adds the functions that the
results of a loop need.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from ..effects import AbstractEffect
from ..errors import InputError, option
from ..fitting.abstract_problem import AbstractProblem
from ..fitting.encompassing import EncompassingModel
from .split import Blocks
from .thresholds import MOST

P = TypeVar("P", bound=AbstractProblem)


class Offered(NamedTuple):
    """Candidate effects of a loop, and effects of its base model."""

    effects: tuple[type[AbstractEffect], ...]
    """All effects of the encompassing model: candidates and effects of the base."""
    with_: tuple[str, ...]
    without: tuple[str, ...]
    most: int

    def seen_by(
        self, channels: Collection[str], refusal: Callable[[type[AbstractEffect]], str]
    ) -> "Offered":
        """The offered effects, without effects that need a channel which is not given.

        Raises
        ------
        InputError : with the text of `refusal`, if a requested effect needs a channel that is not
            given.
        """
        seen = tuple(e for e in self.effects if e.channel in (None, *channels))
        lost = [e for e in self.effects if e not in seen and e.id in self.with_]
        if lost:
            raise InputError(refusal(lost[0]))
        return self._replace(effects=seen)


def offered(
    known: Mapping[str, type[AbstractEffect]],
    own: Sequence[type[AbstractEffect]],
    with_: Sequence[str],
    without: Sequence[str],
    most: int,
    effect_of: Callable[[str], type[AbstractEffect]],
) -> Offered:
    """The effects that a loop may add: effects of a catalogue and effects of the user.

    Raises
    ------
    InputError : an unknown effect, or one in both `with_` and `without`; `most` out of range.
    """
    together = {**known, **{effect.id: effect for effect in own}}
    for id in (*with_, *without):
        if id not in together:
            effect_of(id)
    both = sorted(set(with_) & set(without))
    if both:
        raise InputError(
            f"effects: {', '.join(both)} cannot be both in the base ({option('include')}) and"
            f" left out ({option('exclude')})"
        )
    if not 0 <= most <= MOST:
        raise InputError(f"{option('max-effects')} is {most}; choose 0 to {MOST}")
    return Offered(tuple(together.values()), tuple(with_), tuple(without), most)


class Choice(NamedTuple):
    """Ids of the effects that a model in the loop may have."""

    always: tuple[str, ...] = ()
    """Effects of the base."""
    without: tuple[str, ...] = ()
    """Excluded effects."""
    one_of: tuple[frozenset[str], ...] = ()
    """Groups of which a record determines the sum only: a model has at most one effect of a group,
    unless the base has more."""


class NoiseBounds(NamedTuple):
    """Limits to the noise model of a record."""

    longest: np.ndarray | None = None
    """Longest correlation length on each clock of the problem; by default a tenth of the mean
    duration, path or number of rows of a velocity. Slower noise would absorb structure."""
    either_sign: bool = False
    """Whether neighbouring rows may also be anticorrelated."""
    by_step: bool = True
    """Whether the noise may differ between velocity steps: in scale, pace and hum."""


_ALL, _USUAL = Choice(), NoiseBounds()


class Column(NamedTuple):
    """One shape of one effect: shape parameters and amplitudes, by index in the vector z."""

    id: str
    shape: dict[int, float]
    amplitudes: tuple[int, ...]
    places: tuple[int, ...]
    """Indices of the amplitudes' columns in the matrix."""


class Sensitivities(NamedTuple):
    """Sensitivities of one effect at every shape, as columns of one matrix."""

    columns: list[Column]
    matrix: np.ndarray
    extra: np.ndarray
    """The columns of `matrix` in the extra rows."""


@dataclass(frozen=True, eq=False)
class Case(Generic[P]):
    """A least-squares problem that contains all effects, with the block of each row."""

    problem: P
    """Its model is an `EncompassingModel`."""
    blocks: Blocks
    shapes: Callable[..., list[Sensitivities]]
    """Function of engine, z, missing effects and scales: sensitivities at z of each effect whose
    shapes it can evaluate together."""
    shifted: np.ndarray
    """Indices of the shifts of step times that are parameters."""
    path: np.ndarray
    """Distance travelled at every row [m]. Smooth functions of it, or of the path since each step,
    do not count as noise."""
    choice: Choice = _ALL
    bounds: NoiseBounds = _USUAL

    @property
    def model(self) -> EncompassingModel:
        """The base with all effects."""
        assert isinstance(self.problem.model, EncompassingModel)
        return self.problem.model
