"""Fits of candidates: an encompassing model, any choice of its effects, noise profiled anew.

A candidate is the base and some effects, all their parameters free together. The sizes, memories
and periods of its noise are estimated with it, never taken from another one: noise estimated from
a fit that lacks an effect swallows the effect. Which parts the noise has is found once, from what
the base leaves when everything smooth is taken out (`Engine.learn_noise`).
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Generic, NamedTuple, Protocol, TypeVar

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float

from ..effects import AbstractHeavyEffect, RecordScales, made
from ..effects.effect import AbstractEffect, beyond
from ..fitting.abstract_problem import FAILED_MISFIT, AbstractProblem
from ..fitting.encompassing import EncompassingModel
from ..fitting.marquardt import levenberg_marquardt
from ..fitting.noise import (
    FAR_FROM,
    NO_GLITCHES,
    ROUNDS,
    Family,
    Hum,
    Limits,
    Noise,
    NoiseRows,
    Noises,
    estimate_noise,
    find_glitches,
    find_hum,
    gain_of_pace,
    innovations_of,
    least_noise,
    likeness_of_steps,
    limits_of,
    neighbours,
    noise_of,
    noise_rows,
    noises_around,
    own_clock,
    pace_of,
    profile_noise,
    recorded_steps,
    rms_error,
    scale_of_steps,
    whitened,
)
from ..fitting.noise import (
    Found as FoundNoise,
)
from ..fitting.padding import filled
from ..threads import cores, go_on, one_by_one, side_by_side
from ..traced import traced
from .lately import Lately
from .pace import Stopwatch
from .refusal import Refusal
from .shared import SharedShifts
from .smooth import smooth_columns
from .split import NAMES, Blocks

P = TypeVar("P", bound=AbstractProblem)

_PASSES = 2
_EXACT = 1e-6
_ROUGH = 1e-4
_TRIALS = 60
_NOISE_SHARE = 0.1
_SHORTEST_LIMIT = 10.0
_AT_ONCE, _OF_LONG, _LONG = 24, 16, 8192
"""Directions of one pass, and of a record with more rows than that, where those that only fill it
up cost as much as others."""
_HEAVY = 2
_PACKAGE = __name__.partition(".")[0] + "."


class Candidate(NamedTuple):
    """A joint fit of the base and some effects."""

    effects: tuple[str, ...]
    z: np.ndarray
    residual: np.ndarray
    """Predicted minus recorded over the problem's noise scale, all rows of the record."""
    noise: Noise
    bic: float
    """BIC of the train block, plus the deviance of the select block that this fit predicts."""
    rms: dict[str, float]
    """Root mean square of the residual by block, in the unit of the record."""
    physical: bool
    failed: bool
    refused: Refusal | None = None
    """Why a search did not take it; None where it could have."""


class Rows(NamedTuple):
    """Residual and Jacobian at some parameters.

    Friction has all rows of the record and its padding, whatever their block. The extra rows have
    unit variance: other channels in the train block, shifts of step times.
    """

    residual: np.ndarray
    jacobian: np.ndarray
    extra: np.ndarray
    extra_jacobian: np.ndarray

    @property
    def failed(self) -> bool:
        """Whether the simulation failed at these parameters, or its derivatives did."""
        reached = bool(np.all(np.abs(self.residual) < FAILED_MISFIT))
        return not (reached and bool(np.all(np.isfinite(self.jacobian))))


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


class Shapes(Protocol):
    """A function that computes the `Sensitivities` of a kind of problem."""

    def __call__(
        self,
        engine: "Engine",
        z: np.ndarray,
        missing: Sequence[type[AbstractEffect]],
        scales: RecordScales,
    ) -> Sensitivities:
        """Sensitivities of those `missing` effects all of whose shapes it can try at once."""
        ...


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


_EVERYTHING, _USUAL = Choice(), NoiseBounds()


class Engine(Generic[P]):
    """Fits candidates of one record; only train rows count.

    The model of `problem` is an `EncompassingModel`. `shifted` are the indices of its shifts of
    step times that are parameters. `path` is that of the load point or axis at every row: what is
    smooth along it, and along the path since each step, is no noise.
    """

    def __init__(
        self,
        problem: P,
        blocks: Blocks,
        shifted: np.ndarray,
        choice: Choice = _EVERYTHING,
        *,
        shapes: Shapes,
        path: np.ndarray | None = None,
        bounds: NoiseBounds = _USUAL,
    ):
        assert isinstance(problem.model, EncompassingModel)
        self.model: EncompassingModel = problem.model
        self.always, self.one_of, self.shapes = choice.always, choice.one_of, shapes
        self.stopwatch = Stopwatch()
        self.either_sign = bounds.either_sign
        self.offered = tuple(e for e in self.model.effects if e.id not in choice.without)
        self.rows = len(blocks.train)
        clock = np.asarray(problem.clock)[: self.rows]
        shortest = _SHORTEST_LIMIT * np.median(np.diff(clock, axis=0), axis=0)
        per_velocity = np.ptp(clock, axis=0) / (int(blocks.step.max()) + 1)
        limit = np.maximum(shortest, _NOISE_SHARE * per_velocity)
        self.longest = limit if bounds.longest is None else bounds.longest
        if bounds.by_step:  # a last clock, which `learn_noise` may set going
            still = jax.device_put(np.pad(problem.clock, ((0, 0), (0, 1))))
            problem = eqx.tree_at(lambda p: p.clock, problem, still)
            self.longest = np.append(self.longest, 0.0)
        own = [e for e in self.model.effects if not e.__module__.startswith(_PACKAGE)]
        # a user's effect may call LAPACK for many matrices at once, and two such calls side by side
        # wait for each other without end (`fitting.noise.search`)
        self.at_once = 1 if own else cores()
        self.each: Callable[..., list] = one_by_one if own else side_by_side
        self.by_step, self.pace = bounds.by_step, None
        self.problem = problem
        self.glitches = NO_GLITCHES
        self.hum: tuple[Hum, ...] = ()
        self.steps = recorded_steps(np.asarray(problem.friction)[: self.rows])
        self.least = least_noise(self.steps) / float(problem.noise_scale)
        self._weigh(blocks)
        self.white = white_noise(problem.clock.shape[1])
        self.everywhere, self._lately = problem.plain(), Lately()
        self._apart: set[bytes] = set()
        path = np.arange(self.rows) if path is None else path
        self.smooth = smooth_columns(path, blocks.step, len(self.weight))
        self.family: Family | None = None
        self.noises: tuple[np.ndarray, ...] = ()
        self.noise_alone = self.white
        self.scale = np.ones(len(self.weight))
        self.names = self.model.names()
        self.base = list(range(len(self.model.base.names())))
        self.shifts = [len(self.names) + int(k) for k in shifted]
        begins, trails = (np.asarray(of)[shifted] for of in problem.late_steps())
        time, channels = np.asarray(problem.time), 1 + len(problem.channels)
        self._shared = SharedShifts(self.shifts, begins, trails, time, channels)
        heavy = [e.id for e in self.model.effects if issubclass(e, AbstractHeavyEffect)]
        self._heavy = {id: self.model.columns((id,)) for id in heavy}

    def addable(self, effects: tuple[str, ...]) -> tuple:
        """The effects that are offered and can be added to a candidate with `effects`."""
        present = (*self.always, *effects)
        absent = [e for e in self.offered if e.id not in present]
        return tuple(e for e in absent if self.apart((*effects, e.id)))

    def apart(self, effects: tuple[str, ...]) -> bool:
        """Whether no two effects are of one group of `one_of`, but for those of the base."""
        together = [group & {*self.always, *effects} for group in self.one_of]
        return all(len(own) < 2 or own <= set(self.always) for own in together)

    def _weigh(self, blocks: Blocks) -> None:
        """Let the rows of the blocks count, and no others."""
        weight = np.zeros(self.problem.time.shape[0])
        weight[: self.rows] = blocks.train
        known = weight.copy()
        known[: self.rows] += blocks.select
        self.blocks, self.weight, self.known = blocks, weight, known
        self.problem = eqx.tree_at(lambda p: p.weight, self.problem, jax.device_put(weight))

    def at(self, z: np.ndarray, problem: P) -> P:
        """`problem`, one of the engine's, as it is simulated at `z`: lighter where it can be.

        That is another compilation, but most candidates lack the effects that are heavy.
        """
        lighter = tuple(id for id, own in self._heavy.items() if not np.any(np.asarray(z)[own]))
        if len(lighter) < len(self._heavy):
            problem = problem.heavier(_HEAVY)
        return problem.with_model(self.model._replace(lighter=lighter)) if lighter else problem

    def free(self, effects: tuple[str, ...]) -> np.ndarray:
        """Indices of the free parameters of a candidate, base and step times first."""
        columns = self.model.columns((*self.always, *effects))
        return np.asarray([*self.base, *self.shifts, *columns])

    def evaluate(self, z: np.ndarray, index: np.ndarray | None = None) -> "Rows":
        """Residual (noise units) and its Jacobian by the parameters of `index` (default all)."""
        index = np.arange(len(z)) if index is None else index
        n = self.problem.time.shape[0]
        residual, jacobian = self._linearised(z, index)
        extra = np.concatenate(
            [np.tile(self.weight, len(self.problem.channels)), np.ones(len(self.problem.hold))]
        )
        return Rows(residual[:n], jacobian[:n], residual[n:] * extra, jacobian[n:] * extra[:, None])

    def _linearised(self, z: np.ndarray, index: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        known = self._lately.of(z, index)
        if known is None:
            go_on()
            with self.stopwatch():
                known = self._found(self.at(z, self.everywhere), z, index)
            self._lately.keep(z, index, *known)
        return known

    def _found(self, problem: P, z: np.ndarray, index: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Residual and Jacobian; shifts of step times share directions where that saves a part."""
        few = self._shared.directions(index, len(z))
        if _parts(problem, few) < _parts(problem, index) and index.tobytes() not in self._apart:
            residual, along = _in_parts(problem, z, few, self.each)
            jacobian = self._shared.jacobian(along, index, len(z))
            if jacobian is not None:
                return residual, jacobian
            self._apart.add(index.tobytes())
        return _in_parts(problem, z, np.eye(len(z))[index], self.each)

    def noise(self, residual: np.ndarray, columns: np.ndarray) -> Noise:
        """Noise of the train block, the directions of `columns` taken out."""
        return self._noise(residual, columns).noise

    def noise_afresh(self, residual: np.ndarray, columns: np.ndarray) -> FoundNoise:
        """The noise as by `noise`, with whatever parts are likeliest."""
        return self._anew(residual, columns)

    def noise_of_family(
        self, residual: np.ndarray, columns: np.ndarray, found: FoundNoise
    ) -> FoundNoise:
        """The noise as by `noise`, with the parts of `found`, searched from its values."""
        rows = self._noise_rows(residual, columns)
        starts = (found.theta,)
        return profile_noise(rows, found.family, starts, least=self.least)

    def limits(self) -> Limits:
        """Shortest and longest memory that is searched over each clock."""
        return limits_of(self.problem.clock, self.weight, self.longest)

    def _noise(
        self, residual: np.ndarray, columns: np.ndarray, near: tuple[np.ndarray, ...] = ()
    ) -> FoundNoise:
        """The noise as by `noise`, searched also from the values `near`."""
        if self.family is not None:
            rows = self._noise_rows(residual, columns)
            family, noises = self.family, (*self.noises, *near)
            return profile_noise(rows, family, noises, least=self.least)
        found = self._anew(residual, columns)
        self.family, self.noises = found.family, (found.theta,)
        return found

    def _anew(self, residual: np.ndarray, columns: np.ndarray) -> FoundNoise:
        rows = self._noise_rows(residual, columns)
        return estimate_noise(rows, either_sign=self.either_sign, least=self.least)

    def _noise_rows(self, residual: np.ndarray, columns: np.ndarray) -> NoiseRows:
        clock, weight = self.problem.clock, self.problem.weight
        return noise_rows(clock, weight, residual, columns, self.longest, scale=self.scale)

    def seek_parts(self, z: np.ndarray) -> None:
        """Which parts the noise has until it is learnt: those that the residual of the base shows
        at `z`."""
        rows = self.evaluate(z, self.free(()))
        if not rows.failed:
            self._noise(rows.residual * self.weight, rows.jacobian * self.weight[:, None])

    def learn_noise(self, candidate: Candidate) -> Candidate:
        """The candidate with the noise that is found when everything smooth is taken out.

        Until then it has the parts that the first residual showed. All later ones have the parts
        found here, their sizes, memories and periods found anew. A pace and a scale for every
        velocity step are taken where the likelihood rises by what they cost. Glitches are passed
        over from here on, in all blocks, and hum is taken out of the record: then the candidate is
        fitted and its noise found anew.
        """
        if self.by_step and self._take_hum_out(candidate):
            candidate = self.refit(candidate.effects, candidate.z, exact=True)
        found, rows = self._learned(candidate)
        for _ in range(ROUNDS):
            if rows.failed or not self._pass_over(rows):
                break
            found = self.refit(found.effects, found.z, exact=True)
            self._forget()
            found, rows = self._learned(found)
        return found

    def _take_hum_out(self, candidate: Candidate) -> bool:
        """Take the hum that a candidate leaves out of the record; whether there is any."""
        rows = self.evaluate(candidate.z, self.free(candidate.effects))
        if rows.failed:
            return False
        columns = np.concatenate([rows.residual[:, None], rows.jacobian, self.smooth], axis=1)
        clock, scale = np.asarray(self.problem.clock), float(self.problem.noise_scale)
        on = self.blocks.train | self.blocks.select | self.blocks.report
        time, path = clock[: self.rows, 0], clock[: self.rows, 1]
        found, wave = find_hum(time, path, self.blocks.step, on, columns[: self.rows])
        if not found:
            return False
        self.hum += tuple(one.scaled(scale) for one in found)
        friction = np.array(self.problem.friction)
        friction[: self.rows] += scale * wave  # the residual is predicted less recorded
        both, friction = (self.problem, self.everywhere), jax.device_put(friction)
        where = lambda pair: tuple(p.friction for p in pair)  # noqa: E731
        self.problem, self.everywhere = eqx.tree_at(where, both, (friction, friction))
        self._lately = Lately()
        self.family, self.noises = None, ()
        return True

    def _pass_over(self, rows: "Rows") -> bool:
        """Leave rows out of the blocks that stand out of the noise; whether there are any."""
        columns = np.concatenate([rows.residual[:, None], rows.jacobian, self.smooth], axis=1)
        counts, before = np.zeros(len(columns)), self.glitches
        counts[: self.rows] = self.blocks.train | self.blocks.select | self.blocks.report
        step = filled(self.blocks.step, len(columns))
        self.glitches = find_glitches(
            self.problem.clock,
            counts,
            columns * counts[:, None],
            self.noise_alone,
            step,
            before=before,
        )
        if self.glitches.rows == before.rows:
            return False
        keep = self.passed_on()
        block = {name: self.blocks.of(name) & keep for name in NAMES}
        self._weigh(self.blocks._replace(**block))
        return True

    def _forget(self) -> None:
        """Scale and pace of the steps, which `_learned` finds anew."""
        self.scale = np.ones(len(self.weight))
        if self.pace is not None:
            clock = np.array(self.problem.clock)
            clock[:, -1] = 0.0
            self.problem = eqx.tree_at(lambda p: p.clock, self.problem, jax.device_put(clock))
            self.longest, self.pace = np.append(self.longest[:-1], 0.0), None

    def _learned(self, candidate: Candidate) -> tuple[Candidate, "Rows"]:
        """`learn_noise` once; and the rows that it is learned from."""
        rows = self.evaluate(candidate.z, self.free(candidate.effects))
        if rows.failed:
            return candidate, rows
        columns = np.concatenate([rows.residual[:, None], rows.jacobian, self.smooth], axis=1)
        train = columns * self.weight[:, None]
        train = train[:, np.linalg.norm(train, axis=0) > 0]
        found = self._anew(train[:, 0], train[:, 1:])
        self.noise_alone = found.noise  # a glitch would hide in a scale of its step
        if self.by_step:
            found = self._with_pace(found, columns, train)
            found = self._with_scale(found, columns, train)
        self.family, self.noises = found.family, (found.theta,)
        own = rows.jacobian * self.weight[:, None]
        self.noises += (self._noise(rows.residual * self.weight, own).theta,)
        return self.candidate(candidate.effects, candidate.z, rows), rows

    def _with_pace(self, found: FoundNoise, columns: np.ndarray, train: np.ndarray) -> FoundNoise:
        """The noise with a clock whose pace is that of each step, if that is likelier.

        It is not sought where neighbouring rows are alike in all steps as the noise has it.
        """
        before, step = (self.problem, self.longest), self.blocks.step
        on, worth = self.passed_on(), np.log(self.weight.sum())
        likeness = likeness_of_steps(columns[: self.rows][on], step[on])
        explained = np.asarray(neighbours(self.problem.clock, found.noise))[: self.rows]
        steps = len(likeness) - 1
        if gain_of_pace(likeness, explained[on], step[on]) <= FAR_FROM * steps * worth:
            return found
        pace = pace_of(likeness)
        clock = np.array(self.problem.clock)
        clock[:, -1] = own_clock(pace, step, clock[: self.rows, -2], len(clock))
        self.problem = eqx.tree_at(lambda p: p.clock, self.problem, jax.device_put(clock))
        self.longest = np.append(self.longest[:-1], self.longest[-2] / np.max(pace))
        paced = self._anew(train[:, 0], train[:, 1:])
        more = paced.family.parameters - found.family.parameters + steps
        if 2 * (paced.value - found.value) > more * worth:
            self.pace = pace
            return paced
        self.problem, self.longest = before
        return found

    def _with_scale(self, found: FoundNoise, columns: np.ndarray, train: np.ndarray) -> FoundNoise:
        """The noise with a scale of each step, if that is likelier."""
        on, everything = self.passed_on(), np.zeros(len(columns))
        everything[: self.rows] = on
        white = self.whiten(columns * everything[:, None], found.noise, everything)[: self.rows]
        own = scale_of_steps(white[on], self.blocks.step[on], self.blocks.train[on])
        self.scale[: self.rows][on] = own
        self.family, self.noises = found.family, (found.theta,)
        scaled = self._noise(train[:, 0], train[:, 1:])
        more = len(np.unique(self.blocks.step[self.blocks.train])) - 1
        if 2 * (scaled.value - found.value) > more * np.log(self.weight.sum()):
            return scaled
        self.scale = np.ones(len(columns))
        return found

    def passed_on(self) -> np.ndarray:
        """Mask of the rows of the record that are no glitches."""
        on = np.ones(self.rows, bool)
        on[list(self.glitches.rows)] = False
        return on

    def scale_by_step(self) -> tuple[float, ...]:
        """Scale of the noise of each velocity step; nothing where they have one."""
        if np.ptp(self.scale[: self.rows]) == 0:
            return ()
        first = np.unique(self.blocks.step, return_index=True)[1]
        return tuple(self.scale[first].tolist())

    def trial_noises(self) -> Noises:
        """Noises to screen under."""
        assert self.family is not None, "learn_noise comes first"
        return noises_around(self.family, self.noises, self.limits())

    def bic(
        self, rows: "Rows", parameters: int, near: tuple[np.ndarray, ...] = ()
    ) -> tuple[float, Noise]:
        """-2 ln L + p ln n_eff at the most likely noise; n_eff counts the independent rows.

        The select block counts as predicted: what only fits the train block pays there. The noise
        is searched also from the values `near`.
        """
        residual = rows.residual * self.weight
        found = self._noise(residual, np.zeros((len(residual), 1)), near).noise
        ones = np.ones((len(residual), 1))
        white = self.whiten(ones, found)
        effective = float(np.sum(white**2) * found.sigma**2)
        effective = min(max(effective, 2.0), float(self.weight.sum()))
        more = float(np.sum(np.square(rows.extra))) + self._predictive(rows.residual, found)
        return more - 2 * float(found.log_likelihood) + parameters * np.log(effective), found

    def _predictive(self, residual: np.ndarray, noise: Noise) -> float:
        """-2 ln p of the select block given the train block, at the noise of the train block."""
        problem, total = self.problem, 0.0
        for weight, sign in ((self.known, 1.0), (self.weight, -1.0)):
            white, size = innovations_of(problem.clock, weight, residual, noise)
            white, rows = white / float(noise.sigma), weight.sum()
            size += 2 * rows * np.log(float(noise.sigma))
            total += sign * float(np.sum(white**2) + size)
        return total

    def whiten(
        self, columns: np.ndarray, noise: Noise, weight: np.ndarray | None = None
    ) -> np.ndarray:
        """Columns (rows of a weight, by default train; others 0) in units of the noise, and
        uncorrelated."""
        known = self.weight if weight is None else weight
        return whitened(self.problem.clock, known, columns, noise)

    def rms_error(self, used: np.ndarray, noise: Noise) -> float:
        """Relative error of the rms (`fitting.noise.rms_error`); `used` is a mask of the rows."""
        padded = np.zeros(self.problem.time.shape[0])
        padded[: self.rows] = used
        return rms_error(self.problem.clock, padded, noise)

    def refit(self, effects: tuple[str, ...], z: np.ndarray, *, exact: bool = False) -> Candidate:
        """The joint fit of base and effects from the start `z`, all their parameters free.

        To 0.1 of BIC or so, which decides between candidates; `exact`: to what a parameter's
        error is worth. Most candidates are wrong, and wander along valleys.
        """
        tolerance = _EXACT if exact else _ROUGH
        index, z = self.free(effects), self.problem.begun(z)
        rows, near = self.evaluate(z, index), ()
        for _ in range(_PASSES):
            if rows.failed:
                break
            train = self.weight[:, None]
            found = self._noise(rows.residual * self.weight, rows.jacobian * train, near)
            near = (found.theta,)
            z = self._descend(z, index, found.noise, tolerance)
            rows = self.evaluate(z, index)
        return self.candidate(effects, z, rows, near)

    def _descend(
        self, z: np.ndarray, index: np.ndarray, noise: Noise, tolerance: float
    ) -> np.ndarray:
        """Levenberg-Marquardt (MINPACK) in the parameters of `index`; the others stay.

        Driven from here, it needs no more compiled than the Jacobian that screening needs too.
        """
        z = np.array(z)

        def both(y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            z[index] = y
            rows = self.evaluate(z, index)
            columns = np.concatenate([rows.residual[:, None], rows.jacobian], axis=1)
            if not rows.failed:
                columns = self.whiten(columns * self.weight[:, None], noise)
            more = np.concatenate([rows.extra[:, None], rows.extra_jacobian], axis=1)
            columns = np.concatenate([columns, more])
            return columns[:, 0], columns[:, 1:]

        found = levenberg_marquardt(both, z[index], ftol=tolerance, xtol=_EXACT, most=_TRIALS)
        z[index] = found.y
        return z

    def candidate(
        self,
        effects: tuple[str, ...],
        z: np.ndarray,
        rows: "Rows",
        near: tuple[np.ndarray, ...] = (),
    ) -> Candidate:
        """The scores of a fit; its noise is searched also from the values `near`."""
        count = len(self.free(effects))
        bic, found = (np.inf, self.white) if rows.failed else self.bic(rows, count, near)
        whole = rows.residual[: self.rows]
        scale = float(self.problem.noise_scale)
        rms = {
            name: scale * float(np.sqrt(np.mean(whole[self.blocks.of(name)] ** 2)))
            for name in NAMES
        }
        physical = self.physical(effects, z) and self.problem.possible(z)
        return Candidate(effects, z, whole, found, bic, rms, physical, rows.failed)

    def values(self, z: np.ndarray) -> dict[str, float]:
        """Natural values (SI) of all parameters by name."""
        natural = self.problem.coordinates.from_free(np.asarray(z))
        return dict(zip(self.names, natural.tolist(), strict=True))

    def law(self, id: str, z: np.ndarray) -> np.ndarray | None:
        """`z` with the amplitudes of an effect by which the base is another law; None where the
        effect makes no law of it."""
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

        A first-order start that does so is none: two sensitivities are nearly one there, as that
        of a second state whose length is that of the first, and their amplitudes run away.
        """
        positive = [i for i in self.base if np.isfinite(self.model.quantity(self.names[i]).lower)]
        return bool(np.all(np.abs(start - z)[positive] < np.log(10)))

    def physical(self, effects: tuple[str, ...], z: np.ndarray) -> bool:
        """Whether the parameters of some effects are physically possible."""
        return all(bool(effect.physical()) for effect in self._effects(effects, z))

    def beyond(
        self, effects: tuple[str, ...], z: np.ndarray, scales: RecordScales
    ) -> tuple[str, ...]:
        """Names of parameters of some effects that are beyond what a record of such sizes shows."""
        own = self._effects(effects, z)
        return tuple(f"{effect.id}.{name}" for effect in own for name in beyond(effect, scales))

    def _effects(self, effects: tuple[str, ...], z: np.ndarray) -> Iterator[AbstractEffect]:
        """The effects with their parameters, of NumPy so that nothing is compiled."""
        values = self.values(z)
        for effect in self.model.effects:
            if effect.id in effects:
                names = [self.names[i] for i in self.model.columns((effect.id,))]
                fields = {name.split(".")[1]: values[name] for name in names}
                yield jax.tree.map(np.asarray, made(effect, fields))


def _at_once(problem: AbstractProblem) -> int:
    return _AT_ONCE if len(problem.time) <= _LONG else _OF_LONG


def _parts(problem: AbstractProblem, directions: np.ndarray) -> int:
    """In how many parts a Jacobian along so many directions is computed."""
    return max(-(-len(directions) // _at_once(problem)), 1)


def _in_parts(
    problem: AbstractProblem,
    z: np.ndarray,
    directions: np.ndarray,
    each: Callable[..., list],
) -> tuple[np.ndarray, np.ndarray]:
    """`_evaluate` along a few directions at a time: it is compiled for one number of them."""
    number = _at_once(problem)
    begins = range(0, _parts(problem, directions) * number, number)

    def part(begin: int) -> tuple[np.ndarray, np.ndarray]:
        own = directions[begin : begin + number]
        padded = np.pad(own, ((0, number - len(own)), (0, 0)))
        residual, jacobian = _evaluate(problem, *jax.device_put((z, padded)))
        return np.asarray(residual), np.asarray(jacobian)[:, : len(own)]

    parts = each(part, begins)
    return parts[-1][0], np.concatenate([jacobian for _, jacobian in parts], axis=1)


def compiled(engine: Engine, z: np.ndarray) -> bool:
    """Whether the Jacobian at `z` needs no more compiling."""
    directions = np.zeros((_at_once(engine.problem), len(z)))
    return _evaluate.ready(engine.at(z, engine.everywhere), *jax.device_put((z, directions)))


@traced
def _evaluate(problem: AbstractProblem, z: Float[Array, " q"], directions: Float[Array, "m q"]):
    """Residual and its derivatives along some directions."""

    def push(tangent: Array) -> tuple[Array, Array]:
        return jax.jvp(problem.residual, (z,), (tangent,))

    return jax.vmap(push, out_axes=(None, -1))(directions)


when_evaluated = _evaluate.when_traced
"""As `Traced.when_traced`, of the function by which an engine evaluates."""


def white_noise(clocks: int) -> Noise:
    """White noise of sigma 1, for a problem with so many clocks."""
    return noise_of(1.0, 0.0, np.ones(clocks))


def columns_of(
    engine: Engine, id: str, shapes: Sequence[Mapping[str, float]], place: int
) -> list[Column]:
    """The columns of all shapes of an effect, one after the other from `place`."""
    amplitudes = tuple(engine.model.amplitudes(id))
    found, own = [], [engine.names.index(f"{id}.{n}") for n in shapes[0]]
    for shape in shapes:
        at = tuple(range(place, place + len(amplitudes)))
        place += len(amplitudes)
        free = {
            i: float(engine.model.quantity(engine.names[i]).to_free(value))
            for i, value in zip(own, shape.values(), strict=True)
        }
        found.append(Column(id, free, amplitudes, at))
    return found
