"""A case with its noise model: the immutable input of every candidate's fit.

Noise is estimated with every candidate model, because noise from a fit that lacks an effect would
absorb the effect. The parts of the noise are identified once, from the residual of the base after
projecting out smooth columns (`learn.learn_noise`). Sizes, correlation lengths and periods of the
noise parts are estimated for each candidate.

The smooth columns (`smooth_columns`) are smooth functions along a record.
"""

import dataclasses
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Generic, NamedTuple, Self, TypeVar

import equinox as eqx
import jax
import numpy as np

from ..effects import RecordScales, made
from ..effects.effect import AbstractEffect, beyond
from ..fitting.abstract_problem import AbstractProblem
from ..fitting.encompassing import EncompassingModel
from ..fitting.noise import (
    NO_GLITCHES,
    Family,
    Glitches,
    Hum,
    Limits,
    Noise,
    NoiseRows,
    Noises,
    estimate_noise,
    least_noise,
    limits_of,
    longest_memory,
    noise_of,
    noise_rows,
    noises_around,
    profile_noise,
    recorded_steps,
    rms_error,
    whitened,
)
from ..fitting.noise import Found as FoundNoise
from ..threads import one_by_one, side_by_side
from .case import Case
from .evaluate import Evaluator, Rows
from .split import Blocks
from .thresholds import ALONG, LEAST_MEMORY, SINCE

P = TypeVar("P", bound=AbstractProblem)

_PACKAGE = __name__.partition(".")[0] + "."


class NoiseState(NamedTuple):
    """The noise model of a record. Arrays over rows have the padding of the problem."""

    blocks: Blocks
    """Blocks without outliers."""
    friction: np.ndarray
    """Recorded friction (or motor force) without hum."""
    clock: np.ndarray
    """Clocks of the noise (N, k); the last one counts rows, or rows over the `pace` of a step."""
    longest: np.ndarray
    """Longest correlation length on every clock (k,), on the last one in rows."""
    scale: np.ndarray
    """Relative size of the noise of every row (N,)."""
    alone: Noise
    """The noise without smooth columns."""
    family: Family | None = None
    """Its parts; None before the first estimate."""
    noises: tuple[np.ndarray, ...] = ()
    """Starting values of the parts for the noise of a candidate."""
    pace: np.ndarray | None = None
    """Correlation length in rows in every step, if steps differ."""
    hum: tuple[Hum, ...] = ()
    glitches: Glitches = NO_GLITCHES


@dataclass(frozen=True, eq=False)
class Engine(Generic[P]):
    """Fits of one record, in which only train rows count."""

    case: Case[P]
    noise: NoiseState
    evaluator: Evaluator[P]
    """Evaluates the problem with `noise.friction`."""

    @classmethod
    def of(cls, case: Case[P], found: FoundNoise | None = None) -> Self:
        """The engine of a case whose noise is not yet estimated. Until then the noise has the parts
        of `found`, the noise of the base fit.
        """
        problem, blocks, bounds = case.problem, case.blocks, case.bounds
        rows = len(blocks.train)
        clock = np.asarray(problem.clock)
        longest = bounds.longest
        if longest is None:
            longest = longest_of_steps(clock[:rows], int(blocks.step.max()) + 1)
        white = noise_of(1.0, 0.0, np.ones(clock.shape[1]))
        friction, scale = np.asarray(problem.friction), np.ones(len(clock))
        state = NoiseState(blocks, friction, clock, longest, scale, white)
        if found is not None:
            state = state._replace(family=found.family, noises=(found.theta,))
        return cls(case, state, evaluator_of(case, friction))

    def knowing(self, noise: NoiseState) -> Self:
        """A copy with another noise model."""
        same = noise.friction is self.noise.friction
        evaluator = self.evaluator if same else evaluator_of(self.case, noise.friction)
        return dataclasses.replace(self, noise=noise, evaluator=evaluator)

    # Parameters.

    @property
    def model(self) -> EncompassingModel:
        """The base model with all effects."""
        return self.case.model

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters; shifts of step times, at the end of z, have no names."""
        return self.model.names()

    @cached_property
    def base(self) -> list[int]:
        """Indices of the base's parameters."""
        return list(range(len(self.model.base.names())))

    @cached_property
    def shifts(self) -> list[int]:
        """Indices of the shifts of step times that are parameters."""
        return [len(self.names) + int(k) for k in self.case.shifted]

    @property
    def always(self) -> tuple[str, ...]:
        """Ids of the effects that belong to the base."""
        return self.case.choice.always

    @property
    def offered(self) -> tuple[type[AbstractEffect], ...]:
        """The effects that the user has not excluded."""
        return tuple(e for e in self.model.effects if e.id not in self.case.choice.without)

    def addable(self, effects: tuple[str, ...]) -> tuple[type[AbstractEffect], ...]:
        """The offered effects that can be added to a candidate with `effects`."""
        present = (*self.always, *effects)
        absent = [e for e in self.offered if e.id not in present]
        return tuple(e for e in absent if self.apart((*effects, e.id)))

    def apart(self, effects: tuple[str, ...]) -> bool:
        """Whether no group of `Choice.one_of` has two of the effects, not counting the base."""
        groups = self.case.choice.one_of
        together = [group & {*self.always, *effects} for group in groups]
        return all(len(own) < 2 or own <= set(self.always) for own in together)

    def free(self, effects: tuple[str, ...]) -> np.ndarray:
        """Indices of the free parameters of a candidate, base and step times first."""
        columns = self.model.columns((*self.always, *effects))
        return np.asarray([*self.base, *self.shifts, *columns])

    def values(self, z: np.ndarray) -> dict[str, float]:
        """Natural values (SI) of all parameters by name."""
        natural = self.problem.coordinates.from_free(np.asarray(z))
        return dict(zip(self.names, natural.tolist(), strict=True))

    def law(self, id: str, z: np.ndarray) -> np.ndarray | None:
        """The parameters `z`, with the amplitudes of an effect that turn the base into another
        known law. The result is None if the effect turns the base into no known law.
        """
        (effect,) = (e for e in self.model.effects if e.id == id)
        if not effect.law:
            return None
        values = self.values(z) | {f"{id}.{name}": value for name, value in effect.law.items()}
        own = self.model.columns((id,))
        z, natural = np.array(z), np.asarray([values[name] for name in self.names])
        z[own] = self.problem.coordinates.to_free(natural)[own]
        return z

    def moderate(self, z: np.ndarray, start: np.ndarray) -> bool:
        """Whether no positive parameter of the base changes by more than a factor of ten.

        A first-order start that changes a parameter by more than a factor of ten is useless. The
        start is useless because the sensitivities of two effects are nearly parallel, and the
        amplitudes of the two effects diverge. An example is a second state with the slip length of
        the first state.
        """
        positive = [i for i in self.base if np.isfinite(self.model.quantity(self.names[i]).lower)]
        return bool(np.all(np.abs(start - z)[positive] < np.log(10)))

    def physical(self, effects: tuple[str, ...], z: np.ndarray) -> bool:
        """Whether the parameters of the given effects are physically possible."""
        return all(bool(effect.physical()) for effect in self._effects(effects, z))

    def beyond(
        self, effects: tuple[str, ...], z: np.ndarray, scales: RecordScales
    ) -> tuple[str, ...]:
        """Names of parameters of given effects that a record with given scales cannot resolve."""
        own = self._effects(effects, z)
        return tuple(f"{effect.id}.{name}" for effect in own for name in beyond(effect, scales))

    def _effects(self, effects: tuple[str, ...], z: np.ndarray) -> Iterator[AbstractEffect]:
        """The effects with parameters in NumPy, which avoids a compilation."""
        values = self.values(z)
        for effect in self.model.effects:
            if effect.id in effects:
                names = [self.names[i] for i in self.model.columns((effect.id,))]
                fields = {name.split(".")[1]: values[name] for name in names}
                yield jax.tree.map(np.asarray, made(effect, fields))

    # Rows, and residuals of a model.

    @property
    def blocks(self) -> Blocks:
        """Blocks without outliers."""
        return self.noise.blocks

    @property
    def rows(self) -> int:
        """Number of rows of the record."""
        return len(self.blocks.train)

    @cached_property
    def weight(self) -> np.ndarray:
        """1 for train rows, 0 for others and padding (N,)."""
        return self.padded(self.blocks.train)

    @cached_property
    def known(self) -> np.ndarray:
        """1 for train and validation rows (N,)."""
        return self.padded(self.blocks.train | self.blocks.select)

    def padded(self, rows: np.ndarray) -> np.ndarray:
        """Weights (N,) of all rows of the padded problem, from a mask of the record's rows."""
        return np.pad(rows.astype(float), (0, len(self.noise.clock) - len(rows)))

    @cached_property
    def problem(self) -> P:
        """The problem with the weight of the train rows, clocks and friction of the noise model."""
        found = jax.device_put((self.weight, self.noise.clock, self.noise.friction))
        where = lambda p: (p.weight, p.clock, p.friction)  # noqa: E731
        return eqx.tree_at(where, self.case.problem, found)

    @property
    def unit(self) -> float:
        """The unit of residuals, in the unit of friction."""
        return float(self.case.problem.noise_scale)

    @cached_property
    def smooth(self) -> np.ndarray:
        """Smooth columns along the record; changes along these columns do not count as noise."""
        return smooth_columns(self.case.path, self.blocks.step, len(self.weight))

    @cached_property
    def each(self) -> Callable[..., list]:
        """Maps over candidates, on all cores.

        If the user adds effects, candidates run serially: an effect of the user may call batched
        LAPACK, and two parallel calls of batched LAPACK deadlock.
        """
        return each_of(self.model)

    def evaluate(self, z: np.ndarray, index: np.ndarray | None = None) -> Rows:
        """Residual (noise units) and its Jacobian by the parameters `index` (default: all)."""
        index = np.arange(len(z)) if index is None else index
        n, problem = len(self.weight), self.problem
        residual, jacobian = self.evaluator(z, index)
        extra = np.concatenate(
            [np.tile(self.weight, len(problem.channels)), np.ones(len(problem.hold))]
        )
        return Rows(residual[:n], jacobian[:n], residual[n:] * extra, jacobian[n:] * extra[:, None])

    # Noise.

    @cached_property
    def steps(self) -> float:
        """Quantisation step of friction [unit of friction]; 0 if none is detected."""
        return recorded_steps(np.asarray(self.case.problem.friction)[: self.rows])

    @property
    def _least(self) -> float:
        return least_noise(self.steps) / self.unit

    def noise_of(
        self,
        residual: np.ndarray,
        columns: np.ndarray,
        near: tuple[np.ndarray, ...] = (),
    ) -> FoundNoise:
        """Noise of the train block, with the directions of `columns` projected out. If the parts of
        the noise are known, only the values of the parts are estimated, with `near` as additional
        starts.
        """
        if self.noise.family is None:
            return self.noise_afresh(residual, columns)
        starts = (*self.noise.noises, *near)
        return self.noise_of_family(residual, columns, self.noise.family, starts)

    def noise_afresh(self, residual: np.ndarray, columns: np.ndarray) -> FoundNoise:
        """The noise with the likeliest parts, even if the parts are already known."""
        rows = self._noise_rows(residual, columns)
        return estimate_noise(rows, either_sign=self.case.bounds.either_sign, least=self._least)

    def noise_of_family(
        self,
        residual: np.ndarray,
        columns: np.ndarray,
        family: Family,
        starts: tuple[np.ndarray, ...],
    ) -> FoundNoise:
        """The noise with the parts of a `family`, from starting values `starts`."""
        rows = self._noise_rows(residual, columns)
        return profile_noise(rows, family, starts, least=self._least)

    def _noise_rows(self, residual: np.ndarray, columns: np.ndarray) -> NoiseRows:
        noise = self.noise
        longest = self._longest()
        return noise_rows(noise.clock, self.weight, residual, columns, longest, scale=noise.scale)

    def _longest(self) -> np.ndarray:
        """Longest correlation length on every clock of the noise (k,)."""
        longest = np.array(self.noise.longest)
        if self.noise.pace is not None:
            longest[-1] /= np.max(self.noise.pace)
        return longest

    def limits(self) -> Limits:
        """Shortest and longest correlation length of the noise search on each clock."""
        return limits_of(self.noise.clock, self.weight, self._longest())

    def trial_noises(self) -> Noises:
        """Noises under which effects are screened."""
        assert self.noise.family is not None, "learn_noise comes first"
        return noises_around(self.noise.family, self.noise.noises, self.limits())

    def whiten(
        self, columns: np.ndarray, noise: Noise, weight: np.ndarray | None = None
    ) -> np.ndarray:
        """Columns whitened by the noise over the rows with `weight` (default: train rows). The
        result is 0 in other rows.
        """
        known = self.weight if weight is None else weight
        return whitened(self.noise.clock, known, columns, noise)

    def rms_error(self, used: np.ndarray, noise: Noise) -> float:
        """Relative error of the rms (`fitting.noise.rms_error`); `used` is a mask of the rows."""
        return rms_error(self.noise.clock, self.padded(used), noise)

    def passed_on(self) -> np.ndarray:
        """Mask of the rows of the record that are not outliers."""
        on = np.ones(self.rows, bool)
        on[list(self.noise.glitches.rows)] = False
        return on

    def scale_by_step(self) -> tuple[float, ...]:
        """Scale of the noise of each velocity step; empty if all are equal."""
        scale = self.noise.scale[: self.rows]
        if np.ptp(scale) == 0:
            return ()
        first = np.unique(self.blocks.step, return_index=True)[1]
        return tuple(scale[first].tolist())


def longest_of_steps(clock: np.ndarray, steps: int) -> np.ndarray:
    """Longest correlation length of the noise on every clock, (k,): a tenth of the mean length of a
    velocity step, but at least ten rows. `clock` (n, k) has one row for each row of the record.
    """
    rows = np.median(np.diff(clock, axis=0), axis=0)
    return np.maximum(LEAST_MEMORY * rows, longest_memory(clock) / steps)


def each_of(model: EncompassingModel) -> Callable[..., list]:
    """Map over candidates, as described in `Engine.each`."""
    own = [e for e in model.effects if not e.__module__.startswith(_PACKAGE)]
    return one_by_one if own else side_by_side


def evaluator_of(case: Case[P], friction: np.ndarray) -> Evaluator[P]:
    """The evaluator of a case whose record is `friction` (N,)."""
    problem = eqx.tree_at(lambda p: p.friction, case.problem, jax.device_put(friction))
    shifts = np.asarray([len(case.model.names()) + int(k) for k in case.shifted], int)
    return Evaluator(problem, shifts, each_of(case.model))


def smooth_columns(path: np.ndarray, step: np.ndarray, size: int) -> np.ndarray:
    """Hat functions of the path of the whole record, and of the path since a velocity step (all
    steps share a column). Every row has a `path` (n,) and a `step` (n,). The result has `size`
    rows, padded with 0.
    """
    share = (path - path[0]) / max(float(path[-1] - path[0]), 1e-300)
    columns = [_hat(share, k, ALONG) for k in range(ALONG)]
    since = np.zeros(len(path))
    for k in np.unique(step):
        rows = step == k
        x = path[rows] - path[rows][0]
        since[rows] = np.sqrt(x / max(float(x[-1]), 1e-300)) if k else 0.0
    columns += [_hat(since, k, SINCE) * (step > 0) for k in range(1, SINCE)]
    return np.pad(np.stack(columns, axis=1), ((0, size - len(path)), (0, 0)))


def _hat(x: np.ndarray, k: int, number: int) -> np.ndarray:
    return np.maximum(0.0, 1 - np.abs(x * (number - 1) - k))
