"""Estimates the noise of a record: hum, outliers, correlated parts, rate and scale of each step.

Noise is estimated from the base's residual after projecting out smooth columns, because structure
along the record is not noise. A function that changes the noise model returns a new engine.

The noise floor (`Floor`) of a record is the noise after projecting out smooth columns along the
record. For every block, `Floor` also has the largest error that noise alone explains.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from ..fitting.noise import (
    FAR_FROM,
    ROUNDS,
    Found,
    Noise,
    find_glitches,
    find_hum,
    gain_of_pace,
    likeness_of_steps,
    noise_estimate,
    own_clock,
    pace_of,
    sandwich,
    scale_of_steps,
)
from ..fitting.noise import Found as FoundNoise
from ..fitting.padding import filled
from .engine import Engine, NoiseState
from .evaluate import Rows
from .refit import Candidate, noise_at, refit
from .screen import orthonormal
from .split import NAMES
from .thresholds import ASKED, HELD_OUT, SEEN, SIGNIFICANT, TRAIN_FLOOR


def seek_parts(engine: Engine, z: np.ndarray) -> Engine:
    """The engine with provisional parts of noise, if it has none: those of the residual of the base
    at `z`. Fits before `learn_noise` use these provisional parts of noise.
    """
    if engine.noise.family is not None:
        return engine
    rows = engine.evaluate(z, engine.free(()))
    if rows.failed:
        return engine
    found = noise_at(engine, rows)
    return engine.knowing(engine.noise._replace(family=found.family, noises=(found.theta,)))


def learn_noise(engine: Engine, base: Candidate) -> tuple[Engine, Candidate]:
    """The engine with the noise model from a fit of the base, and the fit under this noise.

    All later candidates have the same parts of noise; sizes, correlation lengths and periods of the
    parts are estimated for each candidate. Each velocity step gets a separate rate or scale of the
    noise if this lowers the BIC. Outliers are excluded from all blocks, and hum is subtracted from
    the record. If outliers or hum are found, the base is refitted and its noise estimated anew.
    """
    if engine.case.bounds.by_step:
        quiet = _without_hum(engine, base)
        if quiet is not engine:
            engine, base = quiet, refit(quiet, base.effects, base.z, exact=True)
    for _ in range(ROUNDS):
        learnt, rows = _learnt(engine, base)
        if learnt is engine:  # the base fails: no noise can be estimated
            return engine, base
        fewer = _without_glitches(learnt, rows)
        if fewer is learnt:
            break
        engine, base = _forgotten(fewer), refit(fewer, base.effects, base.z, exact=True)
    else:
        learnt, _ = _learnt(engine, base)
    return learnt, refit(learnt, base.effects, base.z, exact=True)


def _columns(engine: Engine, candidate: Candidate) -> tuple[Rows, np.ndarray]:
    """The rows of a fit; and a matrix of its residual, its Jacobian and the smooth columns."""
    rows = engine.evaluate(candidate.z, engine.free(candidate.effects))
    return rows, _side_by_side(engine, rows)


def _side_by_side(engine: Engine, rows: Rows) -> np.ndarray:
    return np.concatenate([rows.residual[:, None], rows.jacobian, engine.smooth], axis=1)


def _without_hum(engine: Engine, candidate: Candidate) -> Engine:
    """The engine of the record without the hum in a candidate's residual; the same engine if there
    is none."""
    rows, columns = _columns(engine, candidate)
    if rows.failed:
        return engine
    noise, n = engine.noise, engine.rows
    on = engine.blocks.train | engine.blocks.select | engine.blocks.report
    time, path = noise.clock[:n, 0], noise.clock[:n, 1]
    found, wave = find_hum(time, path, engine.blocks.step, on, columns[:n])
    if not found:
        return engine
    friction = np.array(noise.friction)
    friction[:n] += engine.unit * wave  # residual = predicted - recorded
    hum = (*noise.hum, *(one.scaled(engine.unit) for one in found))
    return engine.knowing(noise._replace(hum=hum, friction=friction, family=None, noises=()))


def _without_glitches(engine: Engine, rows: Rows) -> Engine:
    """The engine with outliers excluded from its blocks; the same engine if there are no new
    ones."""
    columns = _side_by_side(engine, rows)
    noise, blocks = engine.noise, engine.blocks
    counts = engine.padded(blocks.train | blocks.select | blocks.report)
    found = find_glitches(
        noise.clock,
        counts,
        columns * counts[:, None],
        noise.alone,
        filled(blocks.step, len(columns)),
        before=noise.glitches,
    )
    if found.rows == noise.glitches.rows:
        return engine
    engine = engine.knowing(noise._replace(glitches=found))
    keep = engine.passed_on()
    kept = blocks._replace(**{name: blocks.of(name) & keep for name in NAMES})
    return engine.knowing(engine.noise._replace(blocks=kept))


def _forgotten(engine: Engine) -> Engine:
    """The engine with equal scale and pace of all steps."""
    noise = engine.noise if engine.noise.pace is None else _paced(engine, None)
    return engine.knowing(noise._replace(scale=np.ones(len(noise.scale))))


def _paced(engine: Engine, pace: np.ndarray | None) -> NoiseState:
    """The noise whose last clock counts rows, in units of the `pace` of every step if given."""
    clock, rows = np.array(engine.noise.clock), np.asarray(engine.case.problem.clock)[:, -1]
    if pace is not None:
        rows = own_clock(pace, engine.blocks.step, rows[: engine.rows], len(clock))
    clock[:, -1] = rows
    return engine.noise._replace(clock=clock, pace=pace)


def _learnt(engine: Engine, base: Candidate) -> tuple[Engine, Rows]:
    """The engine with the parts of noise in the residual of a base fit (the same engine if the fit
    failed), and the rows of that fit."""
    rows, columns = _columns(engine, base)
    if rows.failed:
        return engine, rows
    train = columns * engine.weight[:, None]
    train = train[:, np.linalg.norm(train, axis=0) > 0]
    found = engine.noise_afresh(train[:, 0], train[:, 1:])
    # one scale for all steps: an outlier would raise the scale of its own step and hide
    engine = engine.knowing(engine.noise._replace(alone=found.noise))
    if engine.case.bounds.by_step:
        engine, found = _with_pace(engine, found, columns, train)
        engine, found = _with_scale(engine, found, columns, train)
    engine = engine.knowing(engine.noise._replace(family=found.family, noises=(found.theta,)))
    own = noise_at(engine, rows)
    return engine.knowing(engine.noise._replace(noises=(found.theta, own.theta))), rows


def _with_pace(
    engine: Engine, found: FoundNoise, columns: np.ndarray, train: np.ndarray
) -> tuple[Engine, FoundNoise]:
    """Engine and noise with the pace of each step, if that lowers the BIC.

    The pace is tried if the noise does not explain the correlation of neighbouring rows per step.
    The trial moves one part of the noise to the clock of the pace. Only if that lowers the BIC, the
    parts are sought anew.
    """
    step, on, worth = engine.blocks.step, engine.passed_on(), np.log(engine.weight.sum())
    likeness = likeness_of_steps(columns[: engine.rows][on], step[on])
    apart = np.abs(np.diff(engine.noise.clock[: engine.rows], axis=0, append=np.nan))
    explained = noise_estimate(found.noise, 1.0, engine.noise.longest).correlation(apart)
    steps = len(likeness) - 1
    if gain_of_pace(likeness, explained[on], step[on]) <= FAR_FROM * steps * worth:
        return engine, found
    paced = engine.knowing(_paced(engine, pace_of(likeness)))

    def pays(own: FoundNoise) -> bool:
        more = own.family.parameters - found.family.parameters + steps
        return 2 * (own.value - found.value) > more * worth

    last = paced.noise.clock.shape[1] - 1
    for family, theta in found.family.moved(found.theta, last):
        moved = paced.noise_of_family(train[:, 0], train[:, 1:], family, (theta,))
        if pays(moved):
            own = paced.noise_afresh(train[:, 0], train[:, 1:])
            if all(clock != last for _, clock in own.family.terms):  # likelier without the pace
                return engine, own
            return paced, own if pays(own) else moved
    return engine, found


def _with_scale(
    engine: Engine, found: FoundNoise, columns: np.ndarray, train: np.ndarray
) -> tuple[Engine, FoundNoise]:
    """Engine and noise with a scale of each step, if that lowers the BIC."""
    n, on = engine.rows, engine.passed_on()
    everything = engine.padded(on)
    white = engine.whiten(columns * everything[:, None], found.noise, everything)[:n]
    scale = np.ones(len(columns))
    scale[:n][on] = scale_of_steps(white[on], engine.blocks.step[on], engine.blocks.train[on])
    scaled = engine.knowing(engine.noise._replace(scale=scale))
    own = scaled.noise_of_family(train[:, 0], train[:, 1:], found.family, (found.theta,))
    more = len(np.unique(engine.blocks.step[engine.blocks.train])) - 1
    better = 2 * (own.value - found.value) > more * np.log(engine.weight.sum())
    return (scaled, own) if better else (engine, found)


class Floor(NamedTuple):
    """The noise of a record after projecting out smooth columns."""

    found: Found
    sigma: float
    """Standard deviation on the train block, in the unit of friction."""
    later: float
    """Standard deviation on the held-out rows: noise may differ between steps."""
    most: Mapping[str, float]
    """Largest rms of every block over sigma that noise alone explains."""

    def level(self, block: str) -> float:
        """Standard deviation of the noise on a block, in the unit of friction."""
        return self.sigma if block == "train" else self.later

    def missed(self, rms: float) -> float:
        """Part of the test block's rms error beyond that of noise, in the unit of friction."""
        return float(np.sqrt(max(rms**2 - (self.most["report"] * self.later) ** 2, 0.0)))

    def misfit(self, rms: float) -> float:
        """Factor on the errors of a model with this rms error of the test block: `Loop.misfit`."""
        return error_factor(rms / self.later, self.most["report"])


def error_factor(test_error: float, most: float) -> float:
    """Factor on the errors of a model, which noise alone gives: its test error in sigma if this
    exceeds `most`, the largest that noise explains, else 1. Errors of a fit with chi2/N = s^2 grow
    by s (Particle Data Group 2024, Review of Particle Physics, section 5.2.2).
    """
    return test_error if test_error > most else 1.0


def noise_floor(engine: Engine, current: Candidate, *, afresh: bool) -> Floor:
    """Noise after projecting out base, effects, and smooth bumps along the record and each step.

    If `afresh` is True, the parts of the noise are sought anew, because structure in the residual
    of the base may have looked like a part of noise.
    """
    rows = engine.evaluate(current.z, engine.free(current.effects))
    columns = np.concatenate([rows.jacobian, engine.smooth], axis=1)
    train = columns * engine.weight[:, None]
    used = np.linalg.norm(train, axis=0) > 0
    noise_of = engine.noise_afresh if afresh else engine.noise_of
    found = noise_of(rows.residual * engine.weight, train[:, used])
    noise = found.noise
    held = engine.blocks.select | engine.blocks.report
    size, clock = float(engine.problem.noise_scale), np.asarray(engine.problem.clock)
    # sigma is estimated from the train block and has a standard error
    chance = engine.rms_error(engine.blocks.train, noise)

    def most(block: np.ndarray) -> float:
        return max(HELD_OUT, largest_rms(float(np.hypot(engine.rms_error(block, noise), chance))))

    return Floor(
        found,
        size * level_of(clock, rows.residual, columns, engine.blocks.train, noise),
        size * level_of(clock, rows.residual, columns, held, noise),
        {
            "train": max(TRAIN_FLOOR, largest_rms(chance)),
            "select": most(engine.blocks.select),
            "report": most(engine.blocks.report),
        },
    )


def level_of(
    clock: np.ndarray, residual: np.ndarray, columns: np.ndarray, rows: np.ndarray, noise: Noise
) -> float:
    """rms of the noise on some rows (a mask): from the residual without the smooth columns,
    corrected for the noise that this projection removes."""
    mask = np.zeros(len(residual))
    mask[: len(rows)] = rows
    here = columns * mask[:, None]
    # outside the used rows the shift of a step is rounding, not a direction
    seen = np.linalg.norm(here, axis=0) > SEEN * np.linalg.norm(columns, axis=0)
    smooth = orthonormal(here[:, seen])
    left = residual * mask
    left = left - smooth @ (smooth.T @ left)
    alone = noise._replace(sigma=np.ones(()))
    taken = np.asarray(sandwich(clock, smooth, alone))
    whole = float(np.sum((mask * np.asarray(noise.scale)) ** 2))
    share = whole - float(np.trace(taken))
    return float(np.sqrt(left @ left / share * whole / mask.sum()))


def largest_rms(chance: float) -> float:
    """The ratio of rms to sigma that noise alone exceeds with probability `SIGNIFICANT`/`ASKED`
    (Bonferroni). `chance` is the relative standard error of the rms of noise.
    """
    from scipy.special import ndtri  # scipy.stats takes half a second to import

    return 1 - float(ndtri(SIGNIFICANT / ASKED)) * chance
