"""Which friction law does one record support? Several laws fitted to it, and asked the same.

Every law is fitted with one state and with two. What is compared is

    BIC = -2 ln L + p ln n,

L the likelihood of what a law leaves, its p parameters and the noise being the likeliest for it,
and n the number of independent rows. The noise is found anew for each law, but has the same parts
for all: of those found for one law or another, the parts under which some law has the best account
of the record. With white noise assumed, rows that are correlated count many times and any law wins
by hundreds. Its memory is bounded by a tenth of a velocity step, so that it cannot take the place
of a law.

Where there are three velocity steps or more each law is also fitted without about a third of them
(`loop.split`), and predicts these.

Sources: Schwarz 1978 (doi:10.1214/aos/1176344136) for BIC; Kass and Raftery 1995
(doi:10.1080/01621459.1995.10476572) for what a difference of it means.
"""

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np

from ..errors import InputError
from ..fitting import Fit, fit
from ..fitting.fit import few_rows, require_float64, steps_of
from ..fitting.marquardt import Descent, levenberg_marquardt
from ..fitting.noise import (
    Family,
    NoiseRows,
    estimate_noise,
    least_noise,
    noise_rows,
    profile_noise,
    recorded_steps,
    whitened,
)
from ..fitting.noise import (
    Found as FoundNoise,
)
from ..fitting.problem import FAILED_MISFIT, Problem
from ..fitting.solve import known_at
from ..laws.registry import fixed_states, known_law, rate_state_laws
from ..records import Record, VelocitySteps
from ..records.given import as_record
from ..silent import silent
from .law_comparison import LawComparison, LawScore
from .split import Blocks, split

_FEWEST = 3
"""Velocity steps from which on some can be held out."""
_STATES = (1, 2)
_NOISE_SHARE, _SHORTEST = 0.1, 10.0
_PASSES, _TRIALS = 2, 60
_TOLERANCE = 1e-6


def compare_laws(
    record: Record | str | Path,
    *,
    stiffness: float | str | None = None,
    laws: Sequence[str] | None = None,
    slip_trend: bool = False,
    steps: VelocitySteps | str | None = None,
    rows: int | None = None,
    progress: Callable[[str], None] = silent,
) -> LawComparison:
    """Fit several friction laws to one record and say which of them it supports.

    Parameters
    ----------
    record : as read by `jaxfric.read`, or the path of one that needs no more words.
    laws : names of rate-and-state laws, by default all of them: "slip", "ageing" and your own.
    stiffness : of spring and specimen, as of `jaxfric.fit`; None: every law finds its own.
    slip_trend, steps, rows : as of `jaxfric.fit`, the same for all laws.
    progress : told what is being done.

    Returns
    -------
    LawComparison : a score for every law with one and with two states, and the sentence.

    Raises
    ------
    InputError : as `jaxfric.fit`; fewer than two laws; no fit converged.

    Not tried: more than two states; records with mass (inertia).
    """
    require_float64()
    names = _names(laws)
    record = as_record(record)
    progress("velocity steps")
    steps = steps_of(record, steps)
    record, warnings = (record, ()) if rows is None else few_rows(record, rows, steps)
    fits = []
    for law, states in names:
        words = _words(law, states)
        say = lambda text, words=words: progress(f"{words}: {text}")  # noqa: E731
        one = fit(
            record,
            stiffness=stiffness,
            law=law,
            states=states,
            fit_stiffness=stiffness is None,
            slip_trend=slip_trend,
            steps=steps,
            progress=say,
        )
        fits.append(one)
    if not any(_followed(one) for one in fits):
        raise InputError(
            f"{record.provenance.path}: no law could be fitted ({fits[0].result}); are the steps"
            " right ('jaxfric record'), is the stiffness?"
        )
    blocks, unasked = _blocks(record, steps)
    return _compared(record, fits, blocks, unasked, warnings, progress)


def _names(laws: Sequence[str] | None) -> list[tuple[str, int]]:
    """Laws with their numbers of states, one state first."""
    asked = tuple(dict.fromkeys(map(known_law, rate_state_laws() if laws is None else laws)))
    pairs = [
        (law, always or states)
        for states in _STATES
        for law in asked
        if (always := fixed_states(law)) is None or states == _STATES[0]
    ]
    if len(pairs) < 2:
        raise InputError(f"only the {asked[0] if asked else 'no'} law to compare; give two or more")
    return pairs


def _words(law: str, states: int) -> str:
    return f"{law} law, {states} state{'s' if states > 1 else ''}"


def _blocks(record: Record, steps: VelocitySteps) -> tuple[Blocks | None, str]:
    """What is held out; or None, and why nothing is."""
    count = len(steps) - 1
    if count < _FEWEST:
        there = f"{count} velocity step" + "s" * (count != 1)
        return None, f"the record has {there}, and {_FEWEST} are needed to hold some out"
    try:
        return split(record.relative_time, steps), ""
    except InputError as error:
        return None, str(error)


def _followed(one: Fit) -> bool:
    """Whether the record follows a fit at all: one that was still moving may be followed further.

    That of a second state of which there is none in the record often is.
    """
    return one.solved is not None and one.solved.solution.cost < FAILED_MISFIT**2


class _Rival(NamedTuple):
    """A fit of a law, and its parameters in the unbounded form."""

    fit: Fit
    problem: Problem
    z: np.ndarray


def _compared(
    record: Record,
    fits: Sequence[Fit],
    blocks: Blocks | None,
    unasked: str,
    warnings: tuple[str, ...],
    progress: Callable[[str], None],
) -> LawComparison:
    rivals = _rivals(record, fits)
    ruler = _Ruler(record, rivals[0], len(fits[0].steps))
    progress("noise of what each law leaves")
    alone = [estimate_noise(ruler.noise_rows(one, one.z), least=ruler.least) for one in rivals]
    found = _likeliest(rivals, ruler, alone, progress)
    settled = [k for k, (_, _, ended) in enumerate(found) if ended]
    if not settled:
        raise InputError(f"{record.provenance.path}: no law could be fitted to its end")
    noise = found[max(settled, key=lambda k: found[k][1].value)][1]
    independent = ruler.independent_rows(noise)
    scores = {}
    for k in settled:
        one, (z, own, _) = rivals[k], found[k]
        error = deviance = None
        if blocks is not None:
            progress(f"steps held out: {_words(one.fit.law, one.fit.model.states)}")
            error, deviance = ruler.held_out(one, z, noise, blocks)
        p = len(one.problem.model.names())
        bic = float(np.sum(np.square(z[p:]))) - 2 * own.value + p * np.log(independent)
        scores[id(one.fit)] = LawScore(one.fit, p, float(bic), error, deviance)
    return LawComparison(
        record=record,
        steps=fits[0].steps,
        scores=tuple(scores.get(id(f), LawScore(f, len(f.free))) for f in fits),
        sigma=float(noise.noise.sigma) * ruler.scale,
        independent_rows=independent,
        held_out_steps=() if blocks is None else _numbers(blocks),
        unasked=unasked,
        own_warnings=warnings,
    )


_Likeliest = tuple[np.ndarray, FoundNoise, bool]
"""Of a law: parameters, noise, and whether the search for them ended."""


def _likeliest(
    rivals: Sequence[_Rival],
    ruler: "_Ruler",
    alone: Sequence[FoundNoise],
    progress: Callable[[str], None],
) -> list[_Likeliest]:
    """Every law with the noise that makes it likeliest, of the same parts for all: of the parts
    that were found for one law or another those under which some law has the best account.

    What a search finds for one law alone may be no more than near the likeliest: parts that it
    passed over, and found for another law, may make both likelier.
    """
    best: list[_Likeliest] = []
    least = np.inf
    for family in dict.fromkeys(f.family for f in alone):
        starts = tuple(f.theta for f in alone if f.family == family)
        found = []
        for one in rivals:
            progress(f"likelihood of the {_words(one.fit.law, one.fit.model.states)}")
            found.append(ruler.likeliest(one, family, starts))
        cost = min(ruler.cost(one, *of[:2]) for one, of in zip(rivals, found, strict=True))
        if cost < least:
            best, least = found, cost
    return best


def _numbers(blocks: Blocks) -> tuple[int, ...]:
    """The velocity steps that are held out, counted from 1."""
    held = blocks.step[blocks.select | blocks.report]
    return tuple(int(k) for k in np.unique(held))


def _rivals(record: Record, fits: Sequence[Fit]) -> list[_Rival]:
    """Fits that can be compared, all over the same rows: without those that stand out under every
    law."""
    followed = [one for one in fits if _followed(one)]
    glitches = set.intersection(*(set(one.noise.glitches.rows) for one in followed))
    rivals = []
    for one in followed:
        assert one.solved is not None
        problem = one.solved.problem.plain()
        weight = np.zeros(len(problem.time))
        weight[: len(record)] = 1.0
        weight[sorted(glitches)] = 0.0
        problem = dataclasses.replace(problem, weight=jax.device_put(weight))
        rivals.append(_Rival(one, problem, np.asarray(one.solved.solution.z)))
    return rivals


class _Ruler:
    """What all laws are measured by: the same rows, the same clocks, the same bounds of noise."""

    def __init__(self, record: Record, first: _Rival, velocities: int):
        problem = first.problem
        self.count = len(record)
        self.clock, self.weight = np.asarray(problem.clock), np.asarray(problem.weight)
        self.rows, self.scale = float(self.weight.sum()), float(problem.noise_scale)
        clock = self.clock[: self.count]
        per_velocity = np.ptp(clock, axis=0) / velocities
        shortest = _SHORTEST * np.median(np.diff(clock, axis=0), axis=0)
        self.longest = np.maximum(shortest, _NOISE_SHARE * per_velocity)
        self.least = least_noise(recorded_steps(record.friction)) / self.scale

    def noise_rows(self, rival: _Rival, z: np.ndarray) -> NoiseRows:
        """What a law leaves at `z`, as the input of a noise estimate."""
        left = np.asarray(known_at(rival.problem, z).residual)[: len(self.weight)]
        return noise_rows(self.clock, self.weight, left, np.zeros((len(left), 1)), self.longest)

    def likeliest(
        self, rival: _Rival, family: Family, starts: tuple[np.ndarray, ...]
    ) -> tuple[np.ndarray, FoundNoise, bool]:
        """The parameters and the noise of a family that make the record likeliest; and whether the
        search for them ended."""
        z, ended = rival.z, False
        noise = profile_noise(self.noise_rows(rival, z), family, starts, least=self.least)
        for _ in range(_PASSES):
            near = (*starts, noise.theta)
            found = self._descend(rival.problem, z, noise)
            again = profile_noise(self.noise_rows(rival, found.y), family, near, least=self.least)
            ended = found.converged
            if again.value < noise.value:
                break
            z, noise = found.y, again
        return z, noise, ended

    def cost(self, rival: _Rival, z: np.ndarray, noise: FoundNoise) -> float:
        """BIC of a law where the parameters of the noise count too."""
        p = len(rival.problem.model.names())
        free = p + noise.family.parameters
        return float(np.sum(np.square(z[p:]))) - 2 * noise.value + free * float(np.log(self.rows))

    def independent_rows(self, noise: FoundNoise) -> float:
        """Number of independent rows that the record is worth under a noise."""
        white = whitened(self.clock, self.weight, np.ones((len(self.weight), 1)), noise.noise)
        return float(np.clip(np.sum(white**2) * float(noise.noise.sigma) ** 2, 2.0, self.rows))

    def held_out(
        self, rival: _Rival, z: np.ndarray, noise: FoundNoise, blocks: Blocks
    ) -> tuple[float, float]:
        """How a law predicts the steps that it is not fitted to: root mean square of the error, and
        -2 ln p of these rows but for a constant of the record. Times of steps are those of the
        whole record: they are no matter of the law."""
        held = np.zeros(len(self.weight))
        held[: self.count] = blocks.select | blocks.report
        held *= self.weight
        train = self.weight - held
        problem = dataclasses.replace(rival.problem, weight=jax.device_put(train))
        p = len(problem.model.names())
        found = np.concatenate([self._descend(problem, z, noise).y[:p], z[p:]])
        error = np.asarray(known_at(rival.problem, found).residual)[: len(held)] * held
        white = whitened(self.clock, held, error[:, None], noise.noise)
        return self.scale * float(np.sqrt(np.sum(error**2) / held.sum())), float(np.sum(white**2))

    def _descend(self, problem: Problem, z: np.ndarray, noise: FoundNoise) -> Descent:
        """Least squares of what is whitened by a noise that is held."""
        n, weight = len(self.weight), np.asarray(problem.weight)

        def both(y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            known = known_at(problem, y)
            columns = np.column_stack([known.residual, known.jacobian])
            if not np.any(np.abs(columns[:n, 0]) >= FAILED_MISFIT):
                white = whitened(self.clock, weight, columns[:n], noise.noise)
                columns = np.concatenate([white, columns[n:]])
            return columns[:, 0], columns[:, 1:]

        return levenberg_marquardt(
            both, np.array(z), ftol=_TOLERANCE, xtol=_TOLERANCE, most=_TRIALS
        )
