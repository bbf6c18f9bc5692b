"""The search: base, screen, joint refits, forward, backward, verdict.

1. Base fit and its noise. 2. Screen all effects to first order. 3. Refit the most promising
jointly. 4. Accept the best if BIC falls by more than 10, the select block does not get worse and
its parameters are possible. 5. Again, up to three effects; then drop what is no longer needed.
6. The verdict is confirmed only if what is left is as small as the noise, on rows that the fit did
not see too.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, field

import jax.numpy as jnp
import numpy as np

from ..effects import RecordScales
from ..fitting.noise import whiten
from .engine import Candidate, Engine
from .screen import Screened, aliases, screen
from .tests import structure

VERDICTS = ("no_missing_effect", "effects", "ambiguous", "outside_catalogue", "too_weak")
_ACCEPT = 10.0
_WEAK = 2.0
_REFITS = 4
_MOST = 3
_ALIAS = 0.95
_WORSE = 1.02
_HELD_OUT = 1.06
_TRAIN = 1.04
_SIGNIFICANT = 0.01


@dataclass(frozen=True)
class Search:
    """What was tried and what is concluded."""

    verdict: str
    base: Candidate
    final: Candidate
    tried: tuple[Candidate, ...]
    screened: tuple[tuple[Screened, ...], ...]
    """One list for every round."""
    ids: tuple[str, ...]
    cosines: np.ndarray
    alias_groups: tuple[tuple[str, ...], ...]
    sigma: float
    """Standard deviation of the noise in units of the record, all structure taken out."""
    tests: dict[str, dict[str, float]] = field(default_factory=dict)
    reasons: tuple[str, ...] = ()
    seconds: float = 0.0


def search(
    engine: Engine,
    z: np.ndarray,
    scales: RecordScales,
    slip: np.ndarray,
    *,
    most: int = _MOST,
    progress: Callable[[str], None] = lambda text: None,
) -> Search:
    """Find what the base model lacks. `z` are the superset's parameters at the base fit."""
    begun = time.monotonic()
    progress("base fit")
    base = current = engine.refit((), z)
    tried: list[Candidate] = [base]
    rounds: list[tuple[Screened, ...]] = []
    while len(current.effects) < most:
        progress(f"screening {len(engine.model.effects) - len(current.effects)} effects")
        found = screen(engine, current, scales)
        rounds.append(tuple(found))
        better = _refits(engine, current, found, tried, progress)
        if better is None:
            break
        current = better
    current = _without_needless(engine, current, tried)
    progress("what can be told apart")
    ids, cosines = aliases(engine, current, scales)
    sigma = _noise_floor(engine, current, scales, slip)
    tests = {
        "before": _tests(engine, base, slip),
        "after": _tests(engine, current, slip),
    }
    groups, rivals = _groups(current, ids, cosines, tried)
    verdict, reasons = _verdict(base, current, tried, sigma, tests["after"], rivals)
    return Search(
        verdict,
        base,
        current,
        tuple(tried),
        tuple(rounds),
        tuple(ids),
        cosines,
        groups,
        sigma,
        tests,
        tuple(reasons),
        time.monotonic() - begun,
    )


def _refits(engine, current: Candidate, found, tried, progress) -> Candidate | None:
    """The best acceptable joint refit of the most promising effects, or None."""
    accepted: list[Candidate] = []
    for one in found[:_REFITS]:
        if one.delta_bic < 0 and accepted:
            break
        effects = (*current.effects, one.id)
        progress("refitting with " + ", ".join(effects))
        candidate = engine.refit(effects, one.z)
        if candidate.failed:  # the first-order start ran away: from the base instead
            start = np.array(current.z)
            shapes = engine.model.columns((one.id,))
            start[shapes] = one.z[shapes]
            start[engine.model.amplitudes(one.id)] *= 0.1
            candidate = engine.refit(effects, start)
        tried.append(candidate)
        if _acceptable(current, candidate):
            accepted.append(candidate)
    return min(accepted, key=lambda c: c.bic) if accepted else None


def _acceptable(current: Candidate, candidate: Candidate) -> bool:
    return (
        not candidate.failed
        and candidate.physical
        and current.bic - candidate.bic > _ACCEPT
        and candidate.rms["select"] <= _WORSE * current.rms["select"]
    )


def _without_needless(engine: Engine, current: Candidate, tried: list[Candidate]) -> Candidate:
    """Drop effects whose absence BIC prefers."""
    dropped = True
    while dropped and len(current.effects) > 1:
        dropped = False
        for id in current.effects:
            rest = tuple(e for e in current.effects if e != id)
            start = np.array(current.z)
            start[engine.model.amplitudes(id)] = 0.0
            without = engine.refit(rest, start)
            tried.append(without)
            if not without.failed and without.bic < current.bic:
                current, dropped = without, True
                break
    return current


def _noise_floor(engine: Engine, current: Candidate, scales: RecordScales, slip) -> float:
    """Noise with everything smooth taken out: base, effects, and bumps along the record."""
    residual, jacobian = engine.evaluate(current.z)
    n = len(residual)
    extra = np.zeros((n, 0))
    rows = engine.rows
    bumps = _bumps(slip, engine.blocks.step)
    extra = np.zeros((n, bumps.shape[1]))
    extra[:rows] = bumps
    columns = np.concatenate([jacobian[:, engine.free(current.effects)], extra], axis=1)
    weighted = columns * np.asarray(engine.problem.weight)[:, None]
    used = np.linalg.norm(weighted, axis=0) > 0
    found = engine.noise(residual, columns[:, used])
    return float(found.sigma) * float(engine.problem.noise_scale)


def _bumps(slip: np.ndarray, step: np.ndarray, *, number: int = 24) -> np.ndarray:
    """Hats along the slip of the whole record, and along the slip since each step (shared)."""
    share = (slip - slip[0]) / max(float(slip[-1] - slip[0]), 1e-300)
    columns = [_hat(share, k, number) for k in range(number)]
    since = np.zeros(len(slip))
    for k in np.unique(step):
        rows = step == k
        x = slip[rows] - slip[rows][0]
        since[rows] = np.sqrt(x / max(float(x[-1]), 1e-300)) if k else 0.0
    columns += [_hat(since, k, 8) * (step > 0) for k in range(1, 8)]
    return np.stack(columns, axis=1)


def _hat(x: np.ndarray, k: int, number: int) -> np.ndarray:
    return np.maximum(0.0, 1 - np.abs(x * (number - 1) - k))


def _tests(engine: Engine, candidate: Candidate, slip: np.ndarray) -> dict[str, float]:
    problem, n = engine.problem, engine.rows
    column = np.zeros((problem.time.shape[0], 1))
    column[:n, 0] = candidate.residual
    white = whiten(problem.time, problem.weight, jnp.asarray(column), candidate.noise)
    rows = engine.blocks.train
    innovations = np.asarray(white)[:n, 0][rows]
    return structure(innovations, engine.blocks.step[rows], slip[rows])


def _groups(current: Candidate, ids, cosines, tried) -> tuple[tuple[tuple[str, ...], ...], list]:
    """For every effect found, those that it cannot be told from; and rivals that fit as well."""
    groups, rivals = [], []
    for id in current.effects:
        i = ids.index(id)
        like = tuple(b for j, b in enumerate(ids) if j != i and cosines[i, j] > _ALIAS)
        groups.append((id, *like))
        for other in like:
            swapped = {other if e == id else e for e in current.effects}
            rivals += [
                c
                for c in tried
                if set(c.effects) == swapped
                and c.physical
                and not c.failed
                and c.bic - current.bic < _ACCEPT
            ]
    return tuple(groups), rivals


def _verdict(base, current, tried, sigma, tests, rivals) -> tuple[str, list[str]]:
    reasons = []
    held_out = max(current.rms["select"], current.rms["report"]) / sigma
    train = current.rms["train"] / sigma
    left = [f"{name} p = {p:.2g}" for name, p in tests.items() if p < _SIGNIFICANT]
    if left:
        reasons.append("structure is left in the residual: " + ", ".join(left))
    if held_out > _HELD_OUT:
        reasons.append(f"held-out error is {held_out:.3f} times the noise")
    if train > _TRAIN:
        reasons.append(f"train error is {train:.3f} times the noise")
    clean = not reasons
    if not current.effects:
        gains = [base.bic - c.bic for c in tried if c.effects]
        if clean:
            return "no_missing_effect", reasons
        if gains and max(gains) > _WEAK:
            return "too_weak", reasons
        return "outside_catalogue", reasons
    if not clean:
        return "outside_catalogue", reasons
    if rivals:
        return "ambiguous", reasons
    return "effects", reasons
