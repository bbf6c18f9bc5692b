"""What the loops of sliders and of axes share around the search: its start and its outcome."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..errors import InputError
from ..fitting.noise_estimate import noise_estimate, noise_words
from .engine import Candidate, Engine
from .estimates import candidate_scores
from .family import listed
from .result import LocationProfile, Loop, Score, ScreenedEffect
from .screen import screen
from .search import Search, refit_safely
from .split import NAMES
from .structure import p_text
from .thresholds import SIGNIFICANT
from .verdict import Conclusion


def refuse_both(with_: Sequence[str], without: Sequence[str]) -> None:
    """Raises `InputError` for an effect that is both in the base and left out."""
    both = sorted(set(with_) & set(without))
    if both:
        raise InputError(
            f"effects: {', '.join(both)} cannot be both in the base (--with) and left out"
            " (--without)"
        )


def declared(engine: Engine, z: np.ndarray, scales, with_: tuple[str, ...]) -> np.ndarray:
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


def score_of(
    engine: Engine,
    candidate: Candidate,
    estimated: tuple[dict, tuple[str, ...], np.ndarray],
    residual: np.ndarray,
    tests: dict,
    *,
    step: np.ndarray,
    count: int,
) -> Score:
    """Errors of a model, in all and for each of `count` velocities or strokes.

    `estimated` are its parameters, the names of the free ones, and their covariance; `residual`
    is nan in rows that do not count, `step` the part of each row.
    """
    scale = float(engine.problem.noise_scale)
    parameters, free, covariance = estimated
    residual = np.array(residual)
    residual[list(engine.glitches.rows)] = np.nan
    return Score(
        effects=candidate.effects,
        rms={name: candidate.rms[name] for name in NAMES},
        per_step=tuple(_rms(residual[step == k]) for k in range(count)),
        residual=residual,
        parameters=parameters,
        free=free,
        covariance=covariance,
        noise=noise_estimate(
            candidate.noise,
            scale,
            engine.longest,
            pace=() if engine.pace is None else engine.pace.tolist(),
            scales=engine.scale_by_step(),
            glitches=engine.glitches,
            steps=engine.steps,
        ),
        tests=tests,
    )


def _rms(residual: np.ndarray) -> float:
    known = residual[np.isfinite(residual)]
    return float(np.sqrt(np.mean(known**2))) if len(known) else float("nan")


def loop_of(
    engine: Engine,
    found: Search,
    told: Conclusion,
    before: Score,
    after: Score,
    location: tuple[LocationProfile, ...],
    *,
    record: Any,
    base_fit: Any,
    sigma: float,
    warnings: tuple[str, ...],
    seconds: float,
    details: Any = None,
) -> Loop:
    """The result of a search and of what was concluded from it."""
    alone = dataclasses.replace(after.noise, sigma=sigma)  # everything smooth taken out
    return Loop(
        record=record,
        base_fit=base_fit,
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
        sigma=sigma,
        location=location,
        alias_ids=found.ids,
        alias_cosines=found.cosines,
        warnings=(*noise_words(alone, record), *warnings),
        details=details,
        families=told.families,
        sigma_held_out=told.sigma_held_out,
        seconds=seconds,
    )


_NEARLY = 0.9
_EITHER = 2
_LEAST_SHOWN = 0.005
_VARIABLES = {
    "log_velocity": "velocity",
    "relaxation_length": "the slip since a step",
    "wavelength": "one ripple along the slip",
    "since_reversal": "the distance since a stop",
    "time_since_step": "the time since a step",
    "state": "the state",
}


def where_it_sits(location: tuple[LocationProfile, ...]) -> str:
    """The most telling variables in words; nothing where that is no more than chance."""
    best = next((p for p in location if p.p_value <= SIGNIFICANT), None)
    if best is None:
        return ""
    if not np.isfinite(best.explained):
        name = _VARIABLES.get(best.variable, best.variable)
        return f"What the base model leaves follows {name} best ({p_text(best.p_value)})."
    names = [
        _VARIABLES.get(p.variable, p.variable)
        for p in location
        if p.explained >= _NEARLY * best.explained and p.p_value <= SIGNIFICANT
    ]
    left = f"{share_text(best.explained)} of what the base model leaves."
    if len(names) == 1:
        return f"Friction that follows {names[0]} would explain {left}"
    alone = "either alone" if len(names) == _EITHER else "each alone"
    return f"Friction that follows {listed(names, 'or')}, {alone}, would explain about {left}"


def share_text(share: float) -> str:
    """A share in percent; what rounds to 0 is not nothing."""
    return f"{100 * share:.0f} %" if share >= _LEAST_SHOWN else "less than 1 %"
