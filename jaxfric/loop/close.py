"""The steps of the loop: base fit, search, residual structure, verdict; for slider and axis.

`slider.slider_subject` makes a `Subject` for a record of velocity steps or for a run.
`axis.loop.axis_subject` makes a `Subject` for an axis. After its subject is made, a loop is the
same for sliders, runs and axes.
"""

import dataclasses
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Generic, Literal, NamedTuple

import numpy as np

from ..effects import RecordScales
from ..findings import Finding
from ..fitting import Estimate
from ..fitting.derived import along_length
from ..fitting.noise import Found as FoundNoise
from ..fitting.noise import noise_estimate, noise_words
from ..records import Record
from .case import Case, P
from .engine import Engine
from .family import CurveRig, curve_family
from .findings import effect_findings
from .learn import Floor, learn_noise, noise_floor
from .location import Bumps, locate
from .refit import Candidate, estimates, least_squares, minimum_at, refit
from .refusal import Move
from .residual_tests import structure
from .result import CandidateScore, Loop, LoopBase, LoopDetails, Score, ScreenedEffect
from .screen import screen
from .search import Search, near_fits, refit_safely, search
from .split import NAMES
from .thresholds import MANY
from .verdict import conclude


class Reported(NamedTuple):
    """Record and base model of a loop for reports, with the rows on which models are scored."""

    record: Record
    base: LoopBase
    warnings: tuple[str, ...]
    """Warnings about the record, its preparation and the fits."""
    used: np.ndarray
    """Mask of the used rows."""
    part: np.ndarray
    """Index of the velocity or stroke of every row."""
    parts: int
    """Number of velocities or strokes."""
    velocity: np.ndarray
    """Velocity of the load point or of the axis at every row [m/s or rad/s]."""


@dataclass(frozen=True, eq=False)
class Subject(Generic[P]):
    """A case with the functions that the loop and its results need for this kind of record.

    The functions of a subject are called with the engine after the noise estimate. This engine
    excludes outliers.
    """

    case: Case[P]
    start: np.ndarray
    """Parameters of the base, with all effects but the `fitted` ones at their null."""
    scales: RecordScales
    """Scales of the record, for starting values of shapes."""
    friction_unit: str
    kind: Literal["slider", "axis"]
    bumps: Callable[[Engine[P], Candidate], Sequence[Bumps]]
    """Bumps over the variables that missing friction may depend on."""
    curves: Callable[[Engine[P], Candidate], CurveRig]
    """The steady curves of a fit."""
    reported: Callable[[Engine[P], Search], Reported]
    """Record, base, warnings and scored rows of a search."""
    named: Callable[[Mapping[str, Estimate]], dict[str, Estimate]]
    """Parameters of a fit for reports: in the units of the rig, including given parameters."""
    details: Callable[[Engine[P], Search, Score, Floor, Callable[[str], None]], LoopDetails | None]
    """Further results for this kind of rig, from the score after, the noise floor, and a progress
    callback."""
    fitted: tuple[str, ...] = ()
    """Effects of the base that the base fit has too; `start` holds their parameters."""
    edge: float | None = None
    """K/K_cr of the base; None if there is no critical stiffness."""
    withheld: Finding | None = None
    """The reason for making no claim about missing effects; usually None."""
    normal_stress: float | None = None
    """As in `Loop`."""
    noise: FoundNoise | None = None
    """The noise of the base fit, if known."""


def close(subject: Subject[P], *, most: int, begun: float, progress: Callable[[str], None]) -> Loop:
    """Search effects, locate the remaining misfit, and conclude with a verdict. `begun` is the
    starting time of the loop (`time.monotonic`)."""
    start, scales = declared(subject), subject.scales
    found = search(
        Engine.of(subject.case, subject.noise), start, scales, most=most, progress=progress
    )
    engine, added = found.engine, found.final is not found.base
    if added and subject.kind == "slider":
        found = found._replace(base=least_squares(engine, found.base, start))
    progress("where the structure sits")
    floor = noise_floor(engine, found.final, afresh=added)
    rows = subject.reported(engine, found)

    def scored(candidate: Candidate, rivals: Sequence[Candidate] | None):
        bumps = subject.bumps(engine, candidate)
        location, chances = locate(engine, candidate, floor.found, bumps)
        tests = structure(chances)
        return location, tests, _score(subject, engine, rows, candidate, tests, rivals)

    models: list[tuple[Candidate, Sequence[Candidate] | None]] = [(found.final, near_fits(found))]
    if added:
        progress("what is left")
        models.insert(0, (found.base, None))
    done = engine.each(lambda model: scored(*model), models)
    location, _, before = done[0]
    _, tests, after = done[-1]
    told = conclude(
        found,
        floor,
        tests,
        edge=subject.edge,
        location=location,
        velocities=rows.base.steps.velocities,
        curve=curve_family(engine, found.final, subject.curves(engine, found.final)),
        moved=_moved(before, after),
        withheld=subject.withheld,
    )
    alone = dataclasses.replace(after.noise, sigma=floor.sigma)  # without smooth columns
    details = subject.details(engine, found, after, floor, progress)
    effects = effect_findings(engine, found, told.verdict, rows.used)
    return Loop(
        record=rows.record,
        base_fit=rows.base,
        kind=subject.kind,
        blocks=engine.blocks,
        verdict=told.verdict,
        sentence=told.sentence,
        reasons=told.reasons,
        effects=found.final.effects,
        alias_groups=told.alias_groups,
        separations=told.separations,
        candidates=candidate_scores(found),
        screened=tuple(ScreenedEffect(s.id, s.delta_bic) for r in found.screened[:1] for s in r),
        before=before,
        after=after,
        sigma=floor.sigma,
        location=location,
        alias_ids=found.ids,
        alias_cosines=found.cosines,
        warnings=(*noise_words(alone, rows.record), *rows.warnings),
        details=details,
        findings=(*effects, *(() if details is None else details.claims), *told.findings),
        velocity=rows.velocity,
        families=told.families,
        sigma_held_out=told.sigma_held_out,
        held_out_threshold=told.held_out_threshold,
        normal_stress=subject.normal_stress,
        seconds=time.monotonic() - begun,
    )


def declared(subject: Subject[P]) -> np.ndarray:
    """Starting parameters of the base with the declared effects, each effect at its best shape."""
    case, z = subject.case, subject.start
    if not case.choice.always:
        return z
    open_ = dataclasses.replace(case, choice=case.choice._replace(always=(), one_of=()))
    engine = Engine.of(open_, subject.noise)
    engine, current = learn_noise(engine, refit(engine, subject.fitted, z))
    if current.failed:
        return z
    for id in (one for one in case.choice.always if one not in subject.fitted):
        one = next(s for s in screen(engine, current, subject.scales) if s.id == id)
        current = refit_safely(engine, (*current.effects, id), one, current)
    return current.z


def _score(
    subject: Subject[P],
    engine: Engine[P],
    rows: Reported,
    candidate: Candidate,
    tests: dict[str, float],
    rivals: Sequence[Candidate] | None,
) -> Score:
    """Errors of a model, in total and for each velocity or stroke."""
    parameters, free, covariance = estimates(engine, candidate, subject.friction_unit, rivals)
    noise = engine.noise
    residual = np.where(rows.used, engine.unit * candidate.residual[: len(rows.used)], np.nan)
    residual[list(noise.glitches.rows)] = np.nan
    score = Score(
        effects=candidate.effects,
        rms={name: candidate.rms[name] for name in NAMES},
        per_step=tuple(_rms(residual[rows.part == k]) for k in range(rows.parts)),
        residual=residual,
        parameters=subject.named(parameters),
        free=free,
        covariance=covariance,
        noise=noise_estimate(
            candidate.noise,
            engine.unit,
            noise.longest,
            by_step=(() if noise.pace is None else noise.pace.tolist(), engine.scale_by_step()),
            glitches=noise.glitches,
            steps=engine.steps,
            hum=noise.hum,
        ).resolved(_apart(engine, rows.used)),
        tests=tests,
    )
    if rivals is None and subject.kind == "slider":
        return score  # by least squares: not at the least misfit under its noise
    along = along_length(score, lambda: minimum_at(engine, candidate))
    return dataclasses.replace(score, along=along)


def _moved(before: Score, after: Score) -> tuple[Move, ...]:
    """The headline parameters that move by more than `MANY` standard errors: A-B of a slider, mass
    and Coulomb friction of an axis."""
    pairs = [("A-B", before.A_minus_B, after.A_minus_B)]
    pairs += [(n, before.parameters.get(n), after.parameters.get(n)) for n in ("M", "F_c")]
    moves = [Move(name, a, b) for name, a, b in pairs if a is not None and b is not None]
    return tuple(move for move in moves if moves_far(move))


def moves_far(move: Move) -> bool:
    """Whether a parameter moves by more than `MANY` times its standard error before the move."""
    error = move.before.std
    return error > 0 and abs(move.after.value - move.before.value) > MANY * error


def _apart(engine: Engine, used: np.ndarray) -> np.ndarray:
    """10th percentile of the distance between neighbouring rows, on every clock."""
    clock = engine.noise.clock[: len(used)][used]
    return np.quantile(np.abs(np.diff(clock, axis=0)), 0.1, axis=0)


def _rms(residual: np.ndarray) -> float:
    known = residual[np.isfinite(residual)]
    return float(np.sqrt(np.mean(known**2))) if len(known) else float("nan")


def candidate_scores(found: Search) -> tuple[CandidateScore, ...]:
    """Scores of all tried candidates, best Delta BIC first."""
    engine, out = found.engine, []
    for c in found.tried:
        values = engine.values(c.z)
        free = {engine.names[i] for i in engine.free(c.effects) if i < len(engine.names)}
        out.append(
            CandidateScore(
                effects=c.effects,
                delta_bic=c.bic - found.base.bic,
                train_rms=c.rms["train"],
                validation_rms=c.rms["select"],
                parameters={name: value for name, value in values.items() if name in free},
                physical=c.physical,
                converged=not c.failed,
                accepted=c.effects in found.accepted,
                rejection=c.rejection,
            )
        )
    return tuple(sorted(out, key=lambda c: c.delta_bic))
