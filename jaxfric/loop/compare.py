"""Comparison of friction laws on one record.

Every law is fitted with one state variable and with two. The fits are ranked by

    BIC = -2 ln L + p ln n,

L is the maximum likelihood of the residual over the p parameters of the law and the parameters of
the noise. n is the effective number of rows, which is smaller than the number of rows if noise is
correlated. The noise is estimated for each law. The noise models of all laws have the same parts:
the parts found with the law of the lowest BIC. If correlated noise were taken for white noise, BIC
would count the same information many times, and BIC would always favour some law by hundreds. The
correlation length of the noise is at most a tenth of a velocity step, or ten rows if the step has
fewer than a hundred rows. So noise cannot replace a law.

With three velocity steps or more, each law is also fitted without about a third of the steps
(`loop.split`). Each law then predicts the steps that its fit left out.

Texts for users are made in `report.comparison`.

Sources: Schwarz 1978 (doi:10.1214/aos/1176344136) for BIC; Kass and Raftery 1995
(doi:10.1080/01621459.1995.10476572) for the meaning of differences of BIC.
"""

import dataclasses
import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np

from ..described import Described, Drawable, Tabular, said
from ..errors import InputError
from ..findings import WarningCode, is_of
from ..fitting import Fit, fit
from ..fitting.fit import few_rows, require_float64, steps_of
from ..fitting.marquardt import Descent, levenberg_marquardt
from ..fitting.noise import (
    Family,
    Noise,
    NoiseRows,
    estimate_noise,
    independent_rows,
    least_noise,
    noise_rows,
    profile_noise,
    recorded_steps,
    whitened,
)
from ..fitting.noise import Found as FoundNoise
from ..fitting.problem import Problem
from ..fitting.solve import known_at
from ..fitting.uncertainty import data_part
from ..laws.registry import fixed_states, known_law, rate_state_laws
from ..lazy import old_arguments
from ..records import Record, VelocitySteps
from ..records.given import as_record
from ..silent import silent
from .engine import longest_of_steps
from .split import Blocks, split
from .thresholds import ACCEPT, EXACT, HELD_OUT_FROM, PASSES, TRIALS


@dataclass(frozen=True, eq=False)
class LawScore:
    """The score of one law with a number of states. `bic` is None if the law could not be fitted.

    A fit that did not converge (`fit.converged`) may have the BIC of its last point. A second state
    that the record does not show can prevent convergence. The BIC of a fit that did not converge
    supports no claim; this BIC only shows whether fewer states suffice for the law.
    """

    fit: Fit
    """The fit of the whole record, as by `jaxfric.fit`."""
    parameters: int
    """Number of fitted parameters."""
    bic: float | None = None
    """-2 ln L + p ln n, see `loop.compare`; only differences mean something."""
    held_out: float | None = None
    """rms error in the held-out steps, in the record's unit."""
    held_out_deviance: float | None = None
    """-2 ln p of the held-out rows, up to a constant of the record."""

    @property
    def states(self) -> int:
        """Number of state variables."""
        return self.fit.model.states

    @property
    def name(self) -> str:
        """The law with its states: "slip", or "slip, 2 states"."""
        return self.fit.law if self.states == 1 else f"{self.fit.law}, {self.states} states"

    @property
    def settled(self) -> bool:
        """Whether the BIC of this score can be compared with that of other scores."""
        return self.bic is not None and self.fit.converged

    @property
    def determined(self) -> bool:
        """Whether the fit of the law converged and the record fixes the parameters."""
        return self.fit.converged and all(e.determined for e in self.fit.parameters.values())

    def over(self, other: "LawScore") -> float:
        """BIC of this score minus that of another score; infinite if either has no BIC."""
        return np.inf if self.bic is None or other.bic is None else self.bic - other.bic

    def predicts_better(self, other: "LawScore") -> bool:
        """Whether this law predicts the held-out steps decidedly better than another law does."""
        own, others = self.held_out_deviance, other.held_out_deviance
        return own is not None and others is not None and others - own > ACCEPT


@dataclass(frozen=True, eq=False, repr=False)
class LawComparison(Described, Drawable, Tabular):
    """Laws fitted to one record, in the order of the request."""

    record: Record
    steps: VelocitySteps
    scores: tuple[LawScore, ...]
    sigma: float
    """Standard deviation of the noise under the likeliest law, in the record's unit."""
    independent_rows: float
    """Effective number of independent rows under that noise."""
    held_out_steps: tuple[int, ...]
    """Held-out velocity steps, counted from 1; empty if none could be held out."""
    unasked: str
    """The reason if no step was held out, else ''."""
    own_warnings: tuple[str, ...] = ()

    @property
    def ranked(self) -> tuple[LawScore, ...]:
        """The scores of converged fits, best first."""
        return tuple(sorted((s for s in self.scores if s.settled), key=lambda s: s.bic or 0.0))

    def above(self, score: LawScore) -> float | None:
        """BIC of a score minus the lowest BIC; None for a fit that did not converge."""
        return score.over(self.ranked[0]) if score.settled else None

    def best_of(self, law: str) -> LawScore:
        """The score with the lowest BIC among the converged fits of a law."""
        return next(score for score in self.ranked if score.fit.law == law)

    @property
    def of_laws(self) -> tuple[LawScore, ...]:
        """One score per law, best law first, with as many states as the record supports.

        A further state of a law must lower BIC by more than `ACCEPT`.
        """
        simplest: dict[str, LawScore] = {}
        for score in self.ranked:
            law = score.fit.law
            now = simplest.setdefault(law, score)
            if score.over(self.best_of(law)) <= ACCEPT and score.states < now.states:
                simplest[law] = score
        return tuple(simplest.values())

    @property
    def rivals(self) -> tuple[LawScore, ...]:
        """Scores of other laws that remain possible. A law remains possible if its BIC is within
        `ACCEPT` of the lowest BIC, or if it predicts the held-out steps better. A law also remains
        possible if a fit with states that the law needs did not converge, and has a BIC within
        `ACCEPT` of the lowest BIC.
        """
        if not self.of_laws:
            return ()
        best, (first, *others) = self.ranked[0], self.of_laws
        near = [
            s
            for s in others
            if self.best_of(s.fit.law).over(best) <= ACCEPT or s.predicts_better(first)
        ]
        known = {s.fit.law for s in (first, *near)}
        stood = [s for s in self.scores if not s.settled and s.over(best) <= ACCEPT]
        return (*near, *(s for s in stood if s.fit.law not in known and not self.needless(s)))

    @property
    def supported(self) -> LawScore | None:
        """The law that the record supports; None if the record does not decide."""
        return None if self.rivals or len(self.of_laws) < 2 else self.of_laws[0]

    @property
    def untold(self) -> tuple[str, ...]:
        """The laws that the record cannot distinguish, best first."""
        return tuple(dict.fromkeys(s.fit.law for s in (self.of_laws[0], *self.rivals)))

    def needless(self, score: LawScore) -> bool:
        """Whether a score has undetermined parameters, while a converged fit of the same law with
        fewer states is about as good."""
        law = score.fit.law
        fewer = [s for s in self.ranked if s.fit.law == law and s.states < score.states]
        return not score.determined and any(s.over(score) <= ACCEPT for s in fewer)

    def drifts(self, score: LawScore) -> bool:
        """Whether the slip length L of a further state exceeds the displacement of the record."""
        way = float(np.ptp(self.record.moved()))
        lengths = [e.value for name, e in score.fit.parameters.items() if name[0] == "L"]
        return score.states > 1 and max(lengths, default=0.0) > way

    @property
    def sentence(self) -> str:
        """The result in one or two sentences."""
        return said("comparison.sentence", self)

    @property
    def next_step(self) -> str:
        """The recommended next step and its reason; '' if there is none."""
        return said("comparison.next_step", self)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings to read before using the result."""
        return said("comparison.warnings", self)

    def to_json(self) -> dict:
        """The content of `compare.json`; SI."""
        return said("comparison.to_json", self)


@old_arguments(rows="downsample_to")
def compare_laws(
    record: Record | str | Path,
    *,
    stiffness: float | str | None = None,
    laws: Sequence[str] | None = None,
    slip_trend: bool = False,
    steps: VelocitySteps | str | None = None,
    downsample_to: int | None = None,
    progress: Callable[[str], None] = silent,
) -> LawComparison:
    """Fit several friction laws to one record and report which law the record supports.

    Parameters
    ----------
    record : as read by `jaxfric.read`, or the path of a file that `read` needs no options for.
    laws : names of rate-and-state laws, by default all of them: "slip", "ageing" and your own.
    stiffness : of spring and specimen, as in `jaxfric.fit`; None: fitted with every law.
    slip_trend, steps, downsample_to : as in `jaxfric.fit`, the same for all laws.
    progress : callback for progress messages.

    Returns
    -------
    LawComparison : a score for every law with one and with two states, and a summary sentence.

    Raises
    ------
    InputError : as in `jaxfric.fit`; fewer than two laws; no fit converged.

    Not supported: more than two states; records with mass (inertia).
    """
    require_float64()
    models = _models(laws)
    record = as_record(record)
    progress("velocity steps")
    steps = steps_of(record, steps)
    record, warnings = few_rows(record, downsample_to, steps)

    def fitted(law: str, states: int) -> Fit:
        return fit(
            record,
            stiffness=stiffness,
            law=law,
            states=states,
            fit_stiffness=stiffness is None,
            slip_trend=slip_trend,
            steps=steps,
            progress=lambda text: progress(f"{_words(law, states)}: {text}"),
        )

    fits = [fitted(*model) for model in models]
    try:
        blocks, unasked = held_out_blocks(record, steps), ""
    except InputError as error:
        blocks, unasked = None, str(error)
    progress("noise of what each law leaves")
    rivals = _rivals(record, fits)
    ended = [one for one in likeliest(rivals, progress) if one.ended]
    if not ended:
        why = "no search for a likelihood ended" if rivals else fits[0].result
        raise InputError(
            f"{record.provenance.path}: no law could be fitted ({why}); are the steps right"
            " ('jaxfric inspect'), is the stiffness?"
        )
    best = max(ended, key=lambda one: one.noise.value)
    noise, independent = best.noise.noise, best.independent_rows
    scores = {id(one): LawScore(one, len(one.free)) for one in fits}
    for one in ended:
        errors = ()
        if blocks is not None:
            progress(f"steps held out: {one.words}")
            errors = one.held_out(noise, blocks)
        bic = one.bic(independent)
        scores[id(one.fit)] = LawScore(one.fit, len(one.fit.free), bic, *errors)
    held = () if blocks is None else np.unique(blocks.step[~blocks.train]).tolist()
    return LawComparison(
        record=record,
        steps=fits[0].steps,
        scores=tuple(scores.values()),
        sigma=float(noise.sigma) * float(best.problem.noise_scale),
        independent_rows=independent,
        held_out_steps=tuple(held),
        unasked=unasked,
        own_warnings=(*warnings, *_of_record(fits[0])),
    )


def _of_record(fit: Fit) -> tuple[str, ...]:
    """The warnings of a fit that hold for every law."""
    codes = WarningCode.UNSTEADY, WarningCode.STRESS
    return tuple(text for text in fit.warnings if any(is_of(text, code) for code in codes))


def _models(laws: Sequence[str] | None) -> list[tuple[str, int]]:
    """Laws with their numbers of states, one state first."""
    asked = tuple(dict.fromkeys(map(known_law, rate_state_laws() if laws is None else laws)))
    if len(asked) < 2:
        raise InputError(f"only the {asked[0] if asked else 'no'} law to compare; give two or more")
    return [
        (law, always or states)
        for states in (1, 2)
        for law in asked
        if (always := fixed_states(law)) is None or states == 1
    ]


def _words(law: str, states: int) -> str:
    return f"{law} law, {states} state{'s' if states > 1 else ''}"


def held_out_blocks(record: Record, steps: VelocitySteps) -> Blocks:
    """The held-out velocity steps of a record, as validation and test blocks.

    Raises `InputError` if there are too few steps or rows.
    """
    count = len(steps) - 1
    if count < HELD_OUT_FROM:
        there = f"{count} velocity step" + "s" * (count != 1)
        raise InputError(f"the record has {there}, and {HELD_OUT_FROM} are needed to hold some out")
    return split(record.relative_time, steps)


class Rival(NamedTuple):
    """A law with its parameters and its noise for the comparison."""

    fit: Fit
    problem: Problem
    """Its problem; all laws use the same rows and the same unit of noise."""
    longest: np.ndarray
    """Longest correlation length of the noise on each clock (k,)."""
    least: float
    """Lower bound of the white noise from quantisation [noise scales]."""
    z: np.ndarray
    """Unbounded parameters, then the shifts of step times (q,)."""
    noise: FoundNoise
    ended: bool
    """Whether the search for parameters and noise ended."""

    @property
    def words(self) -> str:
        """The law with its number of states, as text for progress messages."""
        return _words(self.fit.law, self.fit.model.states)

    @property
    def rows(self) -> float:
        """Number of used rows."""
        return float(np.sum(self.problem.weight))

    @property
    def independent_rows(self) -> float:
        """Effective number of independent rows under the noise."""
        return independent_rows(self.problem.clock, self.problem.weight, self.noise.noise)

    def bic(self, rows: float, more: int = 0) -> float:
        """BIC for a number of independent rows, with `more` parameters besides those of the law."""
        p = len(self.fit.free)
        deviance = np.sum(np.square(self.z[p:])) - 2 * self.noise.value
        return float(deviance + (p + more) * np.log(rows))

    @property
    def cost(self) -> float:
        """BIC that counts all rows as independent, and the parameters of law and noise."""
        return self.bic(self.rows, self.noise.family.parameters)

    def under(self, family: Family, starts: Sequence[np.ndarray]) -> "Rival":
        """The law with its likeliest parameters and the likeliest noise of a family, optimised in
        turn. `starts` are starting values of the noise, as in `Found.theta`.
        """

        def profiled(z: np.ndarray, starts: Sequence[np.ndarray]) -> FoundNoise:
            left = _left(self.problem, z, self.longest)
            return profile_noise(left, family, starts, least=self.least)

        best = self._replace(noise=profiled(self.z, starts), ended=False)
        for _ in range(PASSES):
            found = _descend(self.problem, best.z, best.noise.noise)
            noise = profiled(found.y, (*starts, best.noise.theta))
            best = best._replace(ended=found.converged)
            if noise.value < best.noise.value:
                break
            best = best._replace(z=found.y, noise=noise)
        return best

    def held_out(self, noise: Noise, blocks: Blocks) -> tuple[float, float]:
        """Prediction of the held-out steps: rms error, and -2 ln p of the held-out rows up to a
        constant of the record. The times of velocity steps are from the fit of the whole record,
        since step times do not depend on the law.
        """
        problem, p = self.problem, len(self.fit.free)
        held = np.array(problem.weight)
        held[: len(blocks.train)] *= ~blocks.train
        train = dataclasses.replace(problem, weight=jax.device_put(problem.weight - held))
        z = np.concatenate([_descend(train, self.z, noise).y[:p], self.z[p:]])
        error = data_part(problem, known_at(problem, z))[0] * held
        white = whitened(problem.clock, held, error[:, None], noise)
        rms = float(problem.noise_scale) * float(np.sqrt(np.sum(error**2) / held.sum()))
        return rms, float(np.sum(white**2))


def _left(problem: Problem, z: np.ndarray, longest: np.ndarray) -> NoiseRows:
    """The residual of a law at `z`, as the input of a noise estimate."""
    residual, _ = data_part(problem, known_at(problem, z))
    nothing = np.zeros((len(residual), 1))
    return noise_rows(problem.clock, problem.weight, residual, nothing, longest)


def _descend(problem: Problem, z: np.ndarray, noise: Noise) -> Descent:
    """Least squares of the residual, whitened by a fixed noise.

    It uses MINPACK: `fitting.solve` would compile the whitened problem of every law, and would use
    all its steps along states that the record does not determine.
    """
    weight = np.asarray(problem.weight)
    n = len(weight)

    def both(y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        known = known_at(problem, y)
        columns = np.column_stack([known.residual, known.jacobian])
        if not known.failed:
            columns[:n] = whitened(problem.clock, weight, columns[:n], noise)
        return columns[:, 0], columns[:, 1:]

    return levenberg_marquardt(both, z, ftol=EXACT, xtol=EXACT, most=TRIALS)


def _rivals(record: Record, fits: Sequence[Fit]) -> list[Rival]:
    """The fits whose simulation succeeded, each with the noise of its residual. They include fits
    that did not converge, as with a second state that the record lacks. All use the same rows: a
    row is excluded only if it is an outlier under every law."""
    solved = [(one, one.solved) for one in fits if one.solved is not None]
    solved = [(one, of) for one, of in solved if not of.solution.failed]
    if not solved:
        return []
    weight = functools.reduce(np.maximum, [np.asarray(of.problem.weight) for _, of in solved])
    first = solved[0][1].problem
    clock = np.asarray(first.clock)[: len(record)]
    longest = longest_of_steps(clock, len(fits[0].steps))
    least = least_noise(recorded_steps(record.friction)) / float(first.noise_scale)
    rivals = []
    for one, of in solved:
        problem = dataclasses.replace(of.problem.plain(), weight=jax.device_put(weight))
        z = np.asarray(of.solution.z)
        noise = estimate_noise(_left(problem, z, longest), least=least)
        rivals.append(Rival(one, problem, longest, least, z, noise, ended=False))
    return rivals


def likeliest(rivals: Sequence[Rival], progress: Callable[[str], None] = silent) -> list[Rival]:
    """Every law with its likeliest noise; the noise models of all laws have the same parts. Each
    law proposes a family of noise models. The chosen family is the one with which some law has the
    lowest `cost`.

    The noise search of one law may miss the best family of noise. A family of noise found for
    another law may then be likelier for both laws.
    """
    tried = []
    for family in dict.fromkeys(one.noise.family for one in rivals):
        starts = [one.noise.theta for one in rivals if one.noise.family == family]
        found = []
        for one in rivals:
            progress(f"likelihood of the {one.words}")
            found.append(one.under(family, starts))
        tried.append(found)
    return min(tried, key=lambda laws: min(one.cost for one in laws), default=[])
