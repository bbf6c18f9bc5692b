"""The loop itself: base fit, search, what is left, verdict; the same for a slider and an axis.

An `AbstractBench` is a record made ready for it. It brings the least-squares problem and its
engine, where a fit of the base starts, over which variables what is left is drawn, the steady
curves, and its own warnings; nothing here knows what moved.
"""

import abc
import dataclasses
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import NamedTuple, Self

import numpy as np

from ..effects import AbstractEffect, RecordScales
from ..errors import InputError
from ..findings import Finding
from ..fitting.noise import noise_estimate, noise_words
from ..fitting.result import Estimate
from .curves import CurveRig, curve_family
from .engine import Candidate, Engine
from .estimates import estimates
from .findings import effect_findings
from .location import Bumps, locate
from .refusal import Move
from .result import (
    CandidateScore,
    Loop,
    LoopBase,
    LoopDetails,
    LoopRecord,
    Score,
    ScreenedEffect,
)
from .rivals import all_rivals
from .screen import screen
from .search import MOST, Search, refit_safely, search
from .split import NAMES
from .taken import moves_far
from .verdict import conclude, noise_floor, questions
from .where import where_it_sits
from .words import LoopWords


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


class ScoredRows(NamedTuple):
    """Rows over which the errors of a model are reported, by velocity or by stroke."""

    used: np.ndarray
    """Mask of the rows that count."""
    part: np.ndarray
    """Index of the velocity or stroke of every row."""
    parts: int
    """Number of velocities or strokes."""
    velocity: np.ndarray
    """Velocity of the load point or of the axis at every row [m/s or rad/s]."""


class AbstractBench(abc.ABC):
    """A record made ready for the loop."""

    @abc.abstractmethod
    def engine(self, with_: tuple[str, ...] | None) -> Engine:
        """The engine for a base that has the effects `with_`; None: one to start that base from."""

    @abc.abstractmethod
    def start(self, engine: Engine) -> np.ndarray:
        """Parameters of the base, the effects at their null."""

    @abc.abstractmethod
    def starts(self, engine: Engine, z: np.ndarray) -> Sequence[np.ndarray]:
        """Points to fit the base from: `z`, and others that may lead to another minimum."""

    @abc.abstractmethod
    def scales(self) -> RecordScales:
        """Sizes of the record, for starting values of shapes."""

    @abc.abstractmethod
    def path(self) -> np.ndarray:
        """Distance travelled at every row [m]."""

    @abc.abstractmethod
    def passing_over(self, engine: Engine) -> Self:
        """A copy of this bench without the rows that the engine found to be glitches."""

    @abc.abstractmethod
    def bumps(self, engine: Engine, candidate: Candidate) -> Sequence[Bumps]:
        """Bumps over the variables on which missing friction may depend."""

    @abc.abstractmethod
    def curves(self, engine: Engine, final: Candidate) -> CurveRig:
        """The steady curves of a fit."""

    @abc.abstractmethod
    def rows(self, engine: Engine) -> ScoredRows:
        """The rows over which errors are reported."""

    @abc.abstractmethod
    def named(self, parameters: Mapping[str, Estimate]) -> dict[str, Estimate]:
        """Parameters of a fit as they are reported: in the units of the rig, and with those that
        are not fitted."""

    @abc.abstractmethod
    def friction_unit(self) -> str:
        """Unit of what is recorded."""

    @abc.abstractmethod
    def edge(self) -> float | None:
        """K/K_cr of the base; None where there is no critical stiffness."""

    @abc.abstractmethod
    def withheld(self, engine: Engine, found: Search) -> Finding | None:
        """Why nothing at all may be said of what is missing; None as a rule."""

    @abc.abstractmethod
    def warnings(self, engine: Engine, found: Search) -> tuple[str, ...]:
        """Warnings for the user about the record, its preparation and the fits."""

    @abc.abstractmethod
    def words(self) -> LoopWords:
        """The words that reports and figures use."""

    @abc.abstractmethod
    def shown(self) -> tuple[LoopRecord, LoopBase]:
        """Record and base as reports see them."""

    @abc.abstractmethod
    def details(
        self,
        engine: Engine,
        found: Search,
        after: Score,
        missed: float,
        progress: Callable[[str], None],
    ) -> LoopDetails | None:
        """Further results of this kind of rig; None where it has none. `missed`: root mean square
        of what the model leaves of the report block beyond its noise, in the unit of friction."""


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
            f"effects: {', '.join(both)} cannot be both in the base (--with) and left out"
            " (--without)"
        )
    if not 0 <= most <= MOST:
        raise InputError(f"most is {most}; choose 0 to {MOST}")
    return Offered(tuple(together.values()), tuple(with_), tuple(without), most)


def run(
    bench: AbstractBench, asked: Offered, *, begun: float, progress: Callable[[str], None]
) -> Loop:
    """Search, location and verdict; `begun` is when the loop began (`time.monotonic`)."""
    engine = bench.engine(None)
    z = declared(engine, bench.start(engine), bench.scales(), asked.with_)
    engine = bench.engine(asked.with_)
    starts = bench.starts(engine, z)
    found = search(engine, starts, bench.scales(), most=asked.most, progress=progress)
    bench = bench.passing_over(engine)
    progress("where the structure sits")
    floor = noise_floor(engine, found.final)

    def scored(candidate: Candidate, rivals: Sequence[Candidate]):
        left = locate(engine, candidate, floor.found, bench.bumps(engine, candidate))
        tests = questions(engine, candidate, bench.path(), left, floor.found.noise)
        return left.location, tests, _score(bench, engine, candidate, tests, rivals)

    models: list[tuple[Candidate, Sequence[Candidate]]] = [(found.base, ())]
    if found.final is not found.base:
        progress("what is left")
        models.append((found.final, all_rivals(found)))
    done = engine.each(lambda model: scored(*model), models)
    location, _, before = done[0]
    _, tests, after = done[-1]
    curve = curve_family(engine, found.final, bench.curves(engine, found.final))
    record, base_fit = bench.shown()
    where = where_it_sits(location, base_fit.steps.velocities)
    told = conclude(
        engine,
        found,
        floor,
        tests,
        edge=bench.edge(),
        located=where,
        curve=curve,
        moved=_moved(before, after),
        withheld=bench.withheld(engine, found),
    )
    alone = dataclasses.replace(after.noise, sigma=floor.sigma)  # everything smooth taken out
    missed = np.sqrt(max(after.rms["report"] ** 2 - (floor.most["report"] * floor.later) ** 2, 0.0))
    rows, details = bench.rows(engine), bench.details(engine, found, after, missed, progress)
    effects = effect_findings(engine, found, told.verdict, rows.used)
    return Loop(
        record=record,
        base_fit=base_fit,
        words=bench.words(),
        blocks=engine.blocks,
        verdict=told.verdict,
        sentence=told.sentence,
        reasons=told.reasons,
        effects=found.final.effects,
        alias_groups=told.alias_groups,
        separations=told.separations,
        candidates=candidate_scores(engine, found),
        screened=tuple(ScreenedEffect(s.id, s.delta_bic) for r in found.screened[:1] for s in r),
        before=before,
        after=after,
        sigma=floor.sigma,
        location=location,
        alias_ids=found.ids,
        alias_cosines=found.cosines,
        warnings=(*noise_words(alone, record), *bench.warnings(engine, found)),
        details=details,
        findings=(*effects, *(() if details is None else details.claims), *told.findings),
        velocity=rows.velocity,
        families=told.families,
        sigma_held_out=told.sigma_held_out,
        most_held_out=told.most_held_out,
        seconds=time.monotonic() - begun,
    )


def declared(
    engine: Engine, z: np.ndarray, scales: RecordScales, with_: tuple[str, ...]
) -> np.ndarray:
    """Parameters of the base with its declared effects, each started from its best shape."""
    if not with_:
        return z
    current = engine.learn_noise(engine.refit((), z))
    if current.failed:
        return z
    for id in with_:
        one = next(s for s in screen(engine, current, scales) if s.id == id)
        current = refit_safely(engine, (*current.effects, id), one, current)
    return current.z


def _score(
    bench: AbstractBench,
    engine: Engine,
    candidate: Candidate,
    tests: dict[str, float],
    rivals: Sequence[Candidate],
) -> Score:
    """Errors of a model, in all and for each velocity or stroke."""
    parameters, free, covariance = estimates(engine, candidate, bench.friction_unit(), rivals)
    rows = bench.rows(engine)
    scale = float(engine.problem.noise_scale)
    residual = np.where(rows.used, scale * candidate.residual[: len(rows.used)], np.nan)
    residual[list(engine.glitches.rows)] = np.nan
    return Score(
        effects=candidate.effects,
        rms={name: candidate.rms[name] for name in NAMES},
        per_step=tuple(_rms(residual[rows.part == k]) for k in range(rows.parts)),
        residual=residual,
        parameters=bench.named(parameters),
        free=free,
        covariance=covariance,
        noise=noise_estimate(
            candidate.noise,
            scale,
            engine.longest,
            by_step=(() if engine.pace is None else engine.pace.tolist(), engine.scale_by_step()),
            glitches=engine.glitches,
            steps=engine.steps,
            hum=engine.hum,
        ).resolved(_apart(engine, rows.used)),
        tests=tests,
    )


def _moved(before: Score, after: Score) -> tuple[Move, ...]:
    """The headline parameters that move by many of their errors: A-B of a slider, mass and Coulomb
    friction of an axis."""
    moves = []
    first, last = before.A_minus_B, after.A_minus_B
    if first is not None and last is not None:
        moves.append(Move("A-B", first, last))
    for name in ("M", "F_c"):
        if name in before.parameters and name in after.parameters:
            moves.append(Move(name, before.parameters[name], after.parameters[name]))
    return tuple(move for move in moves if moves_far(*move))


def _apart(engine: Engine, used: np.ndarray) -> np.ndarray:
    """How far neighbouring rows are apart on every clock, those in ten that are closest."""
    clock = np.asarray(engine.problem.clock)[: len(used)][used]
    return np.quantile(np.abs(np.diff(clock, axis=0)), 0.1, axis=0)


def _rms(residual: np.ndarray) -> float:
    known = residual[np.isfinite(residual)]
    return float(np.sqrt(np.mean(known**2))) if len(known) else float("nan")


def candidate_scores(engine: Engine, found: Search) -> tuple[CandidateScore, ...]:
    """Scores of all candidates that were tried, best Delta BIC first."""
    out = []
    for c in found.tried:
        values = engine.values(c.z)
        free = {engine.names[i] for i in engine.free(c.effects) if i < len(engine.names)}
        out.append(
            CandidateScore(
                effects=c.effects,
                delta_bic=found.base.bic - c.bic,
                train_rms=c.rms["train"],
                heldout_rms=c.rms["select"],
                parameters={name: value for name, value in values.items() if name in free},
                physical=c.physical,
                converged=not c.failed,
                accepted=c.effects in found.accepted,
                refused=c.refused,
            )
        )
    return tuple(sorted(out, key=lambda c: -c.delta_bic))
