"""The pieces of the loop, each with a patch that takes it out.

A patch replaces a name of a module or a class for the time of one loop; nothing in the product
knows of it. A piece whose patch finds nothing to replace raises, so that no row of the table says
'changes nothing' of a piece that is gone.
"""

import contextlib
import importlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from jaxfric.fitting import solve
from jaxfric.fitting.noise import Resonator
from jaxfric.fitting.noise import search as noise_search
from jaxfric.loop import (
    close,
    engine,
    evaluate,
    gates,
    learn,
    refit,
    residual_tests,
    search,
    slider,
    verdict,
)

Engine, Evaluator = engine.Engine, evaluate.Evaluator

Patch = tuple[Any, str, Any]
"""Where, which name, and what takes its place."""


@dataclass(frozen=True)
class Piece:
    """A piece of the loop that can be taken out."""

    group: str
    """gates, noise, fit or speed"""
    patches: Callable[[], Sequence[Patch]]
    of_fits: bool = False
    """Whether it changes what a fit is: then none that was made with it may be taken."""

    @contextlib.contextmanager
    def taken_out(self) -> Iterator[None]:
        """The loop without this piece."""
        before = []
        try:
            for where, name, other in self.patches():
                before.append((where, name, getattr(where, name)))
                setattr(where, name, other)
            yield
        finally:
            for where, name, was in reversed(before):
                setattr(where, name, was)


def _gate(*patches: Patch) -> Piece:
    return Piece("gates", lambda: patches)


def _no_gate(gate: Callable[..., Any]) -> Piece:
    """The search without one of its `gates`."""

    def without(some):
        return tuple(one for one in some if one is not gate)

    original = search.refusal_of

    def refusal_of(trial, asked=None):
        return original(trial, without(gates.GATES if asked is None else asked))

    return _gate((search, "refusal_of", refusal_of))


def _without_question(name: str) -> Piece:
    """One question of the residual fewer: neither asked nor counted by Holm's correction."""
    original = residual_tests.holm

    def holm(raw, asked):
        kept = {key: p for key, p in raw.items() if key != name}
        return original(kept, asked - (len(raw) - len(kept)))

    return _gate((residual_tests, "holm", holm))


def _no_block_error(blocks: Sequence[str]) -> Piece:
    original = verdict.left_over

    def left_over(tests, errors, of, least):
        return original(tests, [e for e in errors if e[0] not in blocks], of, least)

    return _gate((verdict, "left_over", left_over))


def _noise(*patches: Patch) -> Piece:
    return Piece("noise", lambda: patches, of_fits=True)


def _without_kind(gone: type) -> Piece:
    """A search for parts of noise that does not know one kind of them."""
    return _noise((noise_search, "KINDS", tuple(k for k in noise_search.KINDS if k is not gone)))


def _held_noise() -> Piece:
    """Noise of the base for all candidates: its parts stay as they were learnt, but for sigma."""

    def profile(record, family, starts, *, least=0.0):
        theta = np.asarray(starts[0], float)
        values, sigmas = record.values(family, theta[None])
        found = record.found(family, theta, float(values[0]), float(sigmas[0]))
        return noise_search.not_below(record, found, least)

    return _noise((engine, "profile_noise", profile))


def _one_noise_to_screen_under() -> Piece:
    """The noise of the base alone, in place of a grid around it and white noise."""

    def trial_noises(found):
        family, noises = found.noise.family, found.noise.noises
        only = {"sizes": (0.0,), "memories": (0.0,), "white": False}
        return noise_search.noises_around(family, noises[-1:], found.limits(), **only)

    return _noise((Engine, "trial_noises", trial_noises))


def _fit(*patches: Patch) -> Piece:
    return Piece("fit", lambda: patches, of_fits=True)


def _first_start_only() -> Piece:
    original = solve._in_turn

    def in_turn(problem, starts, most):
        return original(problem, starts, 1)

    return _fit((solve, "_in_turn", in_turn))


def _speed(*patches: Patch) -> Piece:
    return Piece("speed", lambda: patches, of_fits=True)


_fitting = importlib.import_module("jaxfric.fitting.fit")  # the package has a function `fit`


def _none(*_args, **_kwargs):
    return None


_QUESTIONS = (
    "block_means",
    "step_locked",
    "slip",
    "time",
    "log_velocity",
    "state",
    "time_since_step",
    "slip_since_step",
    "periodic_in_slip",
)


def _kept(learnt, found, *_args):
    return learnt, found


PIECES: dict[str, Piece] = {
    "gate: possible": _no_gate(gates.possible),
    "gate: evidence": _no_gate(gates.evidence),
    "gate: fixed": _no_gate(gates.fixed),
    "gate: takes nothing": _no_gate(gates.takes_nothing),
    "tie by order": _gate((search, "TIE", 1e-9)),
    "needless": _gate((search, "_without_needless", lambda now: now)),
    "swap": _gate((search, "_swapped", lambda now, *_: now)),
    "needless and swap": _gate(
        (search, "_without_needless", lambda now: now), (search, "_swapped", lambda now, *_: now)
    ),
    "other law as a start": _gate((Engine, "law", _none)),
    "parts of an effect as starts": _gate((search, "PARTS", ())),
    "refits: two, not four": _gate((search, "REFITS", 2)),
    "select block in BIC": _noise((refit, "predictive", lambda *_: 0.0)),
    "rivals": _gate((verdict, "_rivals", lambda found: [])),
    "unfitted aliases": _gate((verdict, "_unfitted", lambda found: [])),
    "headline moves": _gate((close, "_moved", lambda before, after: ())),
    "curve families": _gate((close, "curve_family", _none)),
    "errors between models": _gate((close, "near_fits", lambda found: [])),
    "errors between steps": _gate(
        (refit, "between_steps", lambda _, jacobian, *__: np.zeros(jacobian.shape[1]))
    ),
    "error of the train block": _no_block_error(("train",)),
    "errors held out": _no_block_error(("select", "report")),
    "error floors (1.04, 1.06)": _gate((learn, "TRAIN_FLOOR", 1.0), (learn, "HELD_OUT", 1.0)),
    "edge rule (K/K_cr)": _gate((verdict, "EDGE", 0.0)),
    **{f"question: {name}": _without_question(name) for name in _QUESTIONS},
    "second part": _noise((noise_search.const, "MOST_PARTS", 1)),
    "resonator": _without_kind(Resonator),
    "scale by step": _noise((learn, "_with_scale", _kept)),
    "pace by step": _noise((learn, "_with_pace", _kept)),
    "scale and pace": _noise((learn, "_with_scale", _kept), (learn, "_with_pace", _kept)),
    "quantisation": _noise((engine, "recorded_steps", lambda friction: 0.0)),
    "outliers": _noise((learn, "_without_glitches", lambda learnt, rows: learnt)),
    "hum": _noise((learn, "_without_hum", lambda learnt, base: learnt)),
    "profile at every candidate": _held_noise(),
    "many noises to screen under": _one_noise_to_screen_under(),
    "first-order starts that are moderate": _fit((Engine, "moderate", lambda *_: True)),
    "refined times of steps": _fit((slider, "FELT", np.inf)),
    "fair hold": _fit((_fitting, "fair_hold", lambda problem, *_: np.ones(len(problem.hold)))),
    "dashpots": _fit((solve, "DASHPOTS", ())),
    "further starts": _first_start_only(),
    "kept linearisations": _speed((evaluate, "KEPT", 0)),
    "shared shifts": _speed((evaluate.SharedShifts, "jacobian", _none)),
    "heavy and light effects": _speed((Evaluator, "simulated", lambda self, z, problem: problem)),
}
"""By name. Not here: the gate `converged`, whose candidates have no BIC, and negative correlation,
which an axis alone has."""
