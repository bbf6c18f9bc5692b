"""A record made ready for the loop: what a slider, a run or an axis brings, and nothing that moves.

A case is what is fitted; a `subject.Subject` is a case with what results ask of a kind of record.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from ..effects import AbstractEffect
from ..errors import InputError
from ..fitting.abstract_problem import AbstractProblem
from ..fitting.encompassing import EncompassingModel
from .split import Blocks

P = TypeVar("P", bound=AbstractProblem)

MOST = 8
"""Largest number of effects that a search adds: evidence ends it before, as a rule."""


class Offered(NamedTuple):
    """The effects that a loop may add, and those that its base has from the start."""

    effects: tuple[type[AbstractEffect], ...]
    """The effects of the encompassing model: those that may be added, and those of the base."""
    with_: tuple[str, ...]
    without: tuple[str, ...]
    most: int

    def seen_by(
        self, channels: Collection[str], refusal: Callable[[type[AbstractEffect]], str]
    ) -> "Offered":
        """The offer without the effects that need a channel which is none of these.

        Raises
        ------
        InputError : with the words of `refusal`, where one that is asked for needs such a channel.
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
    """The offer of a loop: effects of a catalogue and the user's own, with what was asked.

    Raises
    ------
    InputError : an unknown effect, or one both with and without; `most` out of its range.
    """
    together = {**known, **{effect.id: effect for effect in own}}
    for id in (*with_, *without):
        if id not in together:
            effect_of(id)
    both = sorted(set(with_) & set(without))
    if both:
        raise InputError(
            f"effects: {', '.join(both)} cannot be both in the base (--include) and left out"
            " (--exclude)"
        )
    if not 0 <= most <= MOST:
        raise InputError(f"most is {most}; choose 0 to {MOST}")
    return Offered(tuple(together.values()), tuple(with_), tuple(without), most)


class Choice(NamedTuple):
    """Ids of the effects that a model may have."""

    always: tuple[str, ...] = ()
    """Effects of the base."""
    without: tuple[str, ...] = ()
    """Effects that are not offered."""
    one_of: tuple[frozenset[str], ...] = ()
    """Groups of which a record determines what they do together: no two of one group are in one
    model, unless they belong to the base."""


class NoiseBounds(NamedTuple):
    """Limits to the noise of a record."""

    longest: np.ndarray | None = None
    """Memory over each clock of the problem; by default a tenth of the mean duration, path or
    number of rows of a velocity: a slower noise would explain structure away."""
    either_sign: bool = False
    """Whether neighbouring rows may also be correlated negatively."""
    by_step: bool = True
    """Whether noise may differ from step to step: in scale, in pace, and in its hum."""


_ALL, _USUAL = Choice(), NoiseBounds()


class Column(NamedTuple):
    """One shape of one effect: shape parameters by index in z, and indices of its amplitudes."""

    id: str
    shape: dict[int, float]
    amplitudes: tuple[int, ...]
    places: tuple[int, ...]
    """Indices of the amplitudes' columns in the matrix."""


class Sensitivities(NamedTuple):
    """Sensitivities of effects at every one of their shapes; places count from 0."""

    columns: tuple[Column, ...]
    matrix: np.ndarray
    extra: np.ndarray
    """The columns of `matrix` in the extra rows."""


@dataclass(frozen=True, eq=False)
class Case(Generic[P]):
    """What is fitted: a least-squares problem with all effects in it, and how its rows are used."""

    problem: P
    """Its model is an `EncompassingModel`."""
    blocks: Blocks
    shapes: Callable[..., Sensitivities]
    """A function of engine, z, missing effects and scales: the sensitivities at z of those effects
    all of whose shapes it can try at once."""
    shifted: np.ndarray
    """Indices of its shifts of step times that are parameters."""
    path: np.ndarray
    """Distance travelled at every row [m]: what is smooth along it, and along the path since each
    step, is no noise."""
    choice: Choice = _ALL
    bounds: NoiseBounds = _USUAL

    @property
    def model(self) -> EncompassingModel:
        """The base with all effects."""
        assert isinstance(self.problem.model, EncompassingModel)
        return self.problem.model
