"""A closed loop as tables of text, for the terminal and for the page."""

import math

import numpy as np

from ..effects import STEADY_CURVES, parameters
from ..effects.friction import Thermal
from ..findings import Severity, support
from ..fitting import Estimate
from ..loop.family import listed
from ..loop.result import CandidateScore, Loop, shift_of
from ..loop.split import NAMES
from ..loop.thresholds import ACCEPT, SIGNIFICANT
from ..units import format_si, p_text, prefix, read_as
from .estimates import cells, length_of, shown_unit, signed
from .fit_text import DIFFERENCE, noise_text, shown_name
from .location_text import variable_words
from .tables import TextTable
from .verdict_text import words_of, words_of_refusal
from .words import say

_STEADY = (*STEADY_CURVES, Thermal.id)
"""Effects that change the steady friction of a slider at V0."""


def errors(loop: Loop) -> TextTable:
    """Table of the rms residual of each data block, in the unit of friction and in noise sigma."""
    size, unit = readable(loop)
    within = f" [{unit}]" if unit else ""
    rows = []
    for name in NAMES:
        both = [loop.before.rms[name], loop.after.rms[name]]
        of = loop.blocks.of(name)
        cells = [f"{size * v:.4g}" for v in both] + [f"{v / loop.sigma_of(of):.3f}" for v in both]
        rows.append((say(f"block.{name}"), str(int(of.sum())), *cells))
    most, sigma = loop.held_out_threshold, ", in rows held out ".join(sigma_texts(loop))
    note = say("note.errors", sigma=sigma, noise=noise_text(loop.after.noise))
    note += say("note.most", most=most) if math.isfinite(most) else ""
    head = ("block", "rows", f"rms before{within}", f"rms after{within}", "before [σ]", "after [σ]")
    return TextTable("Error before and after", head, rows, note, (2,))


def moved(loop: Loop) -> TextTable:
    """Table of the parameters before and after adding effects, with intervals and shifts."""
    both = [
        ({} if model.A_minus_B is None else {DIFFERENCE: model.A_minus_B}) | dict(model.parameters)
        for model in (loop.before, loop.after)
    ]
    rows = [_moved(loop, name, both[0].get(name), after) for name, after in both[1].items()]
    marked = tuple(k for k, row in enumerate(rows) if "." in row[0])
    head = ("name", "meaning", "before", "after ± std", "95 % interval", "shift [std]", "unit")
    note = say("note.moved", train=loop.blocks.train.sum(), rows=len(loop.blocks.train))
    return TextTable("Parameters", head, rows, note, marked)


def _moved(loop: Loop, name: str, before: Estimate | None, after: Estimate) -> tuple[str, ...]:
    unit, size = shown_unit(after, length_of(loop.record))
    value, std, interval = cells(after, size)
    old = "–" if before is None else cells(before, size)[0]
    moved = None if before is None else shift_of(before, after)
    shift = "" if moved is None else signed(moved)
    if std:
        value = f"{value} ± {std}"
    return shown_name(name), _meaning(loop, name), old, value, interval, shift, unit


def _meaning(loop: Loop, name: str) -> str:
    """Meaning of a parameter; empty for an effect that is not of the catalogue."""
    if name == DIFFERENCE:
        second = any(n in loop.after.parameters for n in ("second_state.B2", "B2"))
        return f"{'all states together; ' if second else ''}below 0: weakening"
    if "." not in name:
        try:
            text = loop.words.quantity(name).text
            if name == "f0" and (own := [id for id in _effects(loop) if id in _STEADY]):
                text += f" without {listed(own)}"
            return "moment of inertia" if (name, loop.length_unit) == ("M", "rad") else text
        except KeyError:
            return "reference velocity" if name == "V0" else ""
    effect, field = name.split(".", 1)
    known = parameters(loop.words.catalogue[effect]) if effect in loop.words.catalogue else {}
    return known[field].text if field in known else ""


def _effects(loop: Loop) -> list[str]:
    """Effects of the final model, declared ones too."""
    return list(dict.fromkeys(n.split(".")[0] for n in loop.after.parameters if "." in n))


def significance(loop: Loop) -> TextTable:
    """Table of the p-values of the residual tests, before and after adding effects."""
    rows = []
    for name, before in loop.before.tests.items():
        both = (p_text(p) for p in (before, loop.after.tests.get(name, math.nan)))
        rows.append(
            (variable_words(name), *(p.removeprefix("p ").removeprefix("= ") for p in both))
        )
    note = say("note.significance", least=SIGNIFICANT)
    head = ("does structure remain in the residual?", "p before", "p after")
    return TextTable("Tests for structure", head, rows, note)


def candidates(loop: Loop) -> TextTable:
    """Table: the fitted models, best first."""
    found = loop.ranked()
    rows = [
        (
            " + ".join(c.effects) or "base",
            signed(c.delta_bic) if math.isfinite(c.delta_bic) else "failed",
            _finite(c.train_rms / loop.sigma),
            _finite(c.validation_rms / loop.sigma_of(loop.blocks.select)),
            _role(loop, c),
        )
        for c in found
    ]
    head = ("effects", "ΔBIC", "train [σ]", "select [σ]", "")
    marked = tuple(k for k, c in enumerate(found) if loop.role(c) == "model")
    note = say("note.candidates", accept=ACCEPT)
    return TextTable("Models that were fitted", head, rows, note, marked)


def _role(loop: Loop, candidate: CandidateScore) -> str:
    """Role of a model in the search and, where a rule refused it, why."""
    role, why = loop.role(candidate), candidate.rejection
    if role == "tried" and why is not None:
        return f"not accepted: {words_of_refusal(why)}"
    return say(f"role.{role}")


def rests_on(loop: Loop) -> TextTable:
    """Table of the claims, each with its supporting rows by direction and speed."""
    rows = []
    for one in loop.findings:
        if one.severity not in (Severity.CLAIM, Severity.OPEN):
            continue
        for k, part in enumerate(support(one.rows, loop.velocity)):
            ends = (_speed(loop, speed) for speed in (part.slowest, part.fastest))
            told = words_of(one) if not k else ""
            rows.append((told, f"{part.rows}", part.direction, " to ".join(dict.fromkeys(ends))))
    head = ("statement", "rows", "direction", "speeds")
    note = say("note.rests_on", accept=ACCEPT)
    return TextTable("What each statement rests on", head, rows, note)


# ---- words and numbers ---------------------------------------------------------------------------


def base_name(loop: Loop) -> str:
    """The base model in words."""
    return loop.words.base.format(law=loop.base_fit.law)


def readable(loop: Loop) -> tuple[float, str]:
    """Return a factor and a unit in which the noise of friction is a readable number."""
    level, unit = 10 * loop.sigma, loop.record.friction_unit
    if unit == "1":
        return (1e6, "10⁻⁶") if level < 1e-4 else (1e3, "10⁻³") if level < 0.1 else (1.0, "")
    size, shown = prefix(level, unit)
    return 1 / size, shown


def sigma_texts(loop: Loop) -> tuple[str, ...]:
    """Write the noise `sigma` as text, and the noise of the held-out rows if that differs."""
    held = loop.sigma_of(loop.blocks.select | loop.blocks.report)
    return tuple(dict.fromkeys(in_words(loop, size) for size in (loop.sigma, held)))


def in_words(loop: Loop, friction: float) -> str:
    """Write an amount of friction as text, such as "0.301 × 10⁻³" or "1.2 mN"."""
    size, unit = readable(loop)
    times = " × " if unit.startswith("10") else " "
    return f"{size * friction:.3g}{times}{unit}".rstrip()


def _speed(loop: Loop, velocity: float) -> str:
    """A velocity in the record's unit of length."""
    return read_as(format_si(velocity, f"{loop.length_unit}/s", f"{length_of(loop.record)}/s", 4))


def _finite(value: float) -> str:
    return f"{value:.3f}" if np.isfinite(value) else "failed"
