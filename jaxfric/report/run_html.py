"""A whole run as one page, run.html: its events, steps, holds, stress steps, stick-slip, ramps."""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from ..runs import cycles as of_cycles
from ..runs import holds as of_holds
from ..runs import ramps as of_ramps
from ..runs import stress_steps as of_stress
from ..runs.findings import Findings
from ..runs.fits import RunFit, StepFit
from ..runs.holds import Hold
from ..runs.joint import told as told_of_all
from ..runs.stick_slip import is_stretch
from ..runs.table import BRACKETS, HEAD, MISFIT, Cell, ask_on, text_cells
from ..runs.table import headline as headline_of
from .page import (
    bullets,
    document,
    escaped,
    folded,
    html_table,
    installed_version,
    paragraph,
    picture,
    printable,
)
from .tables import TextTable

_COLOUR = "#1f4e79"
_KINDS = {
    "step": ("velocity step", "velocity steps"),
    "stress": ("change of normal stress", "changes of normal stress"),
    "hold": ("hold", "holds"),
    "reload": ("reload", "reloads"),
    "unload": ("unloading", "unloadings"),
    "stick_slip": ("stretch of stick-slip", "stretches of stick-slip"),
    "glitch": ("glitch of the recorder", "glitches of the recorder"),
}
"""One of a kind, and more."""
_FIGURES = {
    "events.png": (
        "What happened",
        "Friction, speed of the load point and normal stress (where there is one) by row, with the"
        " time above, and what was found in them: windows of steps that are fitted are shaded, and"
        " stretches of stick-slip. A decision that is wrong can be"
        " changed in events.toml, which --events takes.",
    ),
    "rates.png": (
        "A-B",
        "A-B of every step that determines it with its 95 % interval against velocity (geometric"
        " mean of before and after), displacement and normal stress: below 0 friction falls with"
        " velocity, and a spring that is soft enough stick-slips. Hollow: the fit misses a part of"
        " the step (*).",
    ),
    "holds.png": (
        "Holds",
        "How far friction rises above sliding after a hold, by the time of the hold.",
    ),
    "stress_steps.png": (
        "Steps of the normal stress",
        "Friction about every step of the normal stress, the fit, and what alpha 0 would do.",
    ),
    "stick_slip.png": (
        "Stick-slip",
        "How far the slider creeps while its spring is loaded from one slip to the next (the way of"
        " the load point that friction does not show), with the slip and the ageing law fitted to"
        " all velocities at once, and how far friction drops, by velocity.",
    ),
}
_MEANING = (
    (
        "A, B, L",
        "Direct effect, evolution effect and evolution length of rate-and-state friction (a, b"
        " and D_c). In brackets is one standard error, in units of the last digit; it allows for"
        " noise that is alike from row to row. A dash: the window does not determine it.",
    ),
    (
        "shared",
        "Whether all steps can have the same A, B and L, by likelihood: a small p says that they"
        " do not.",
    ),
    (
        "healing",
        "Peak of friction after a hold less that of sliding before it; a rate is by decade of hold"
        " time.",
    ),
    (
        "alpha",
        "Of a step of the normal stress sigma: the state of the contact falls by"
        " alpha d(ln sigma) at once (Linker and Dieterich 1992).",
    ),
    (
        "stick-slip",
        "While the slider sticks, friction rises with the load point at K; before the drop the"
        " slider creeps over some L, and the drop falls with velocity about as B - A does. Both"
        " laws are fitted to all velocities at once; what the teeth do not determine is left out.",
    ),
)


class Commands(NamedTuple):
    """The command that made a page, and that which asks on where fits miss a part of steps."""

    command: str
    asks_on: str = ""


def page(
    run: RunFit,
    holds: Sequence[Hold],
    others: Findings,
    *,
    warnings: Sequence[str],
    figures: Mapping[str, bytes],
    commands: Commands,
) -> str:
    """The page, with those PNG `figures` by file name that were drawn."""
    name = printable(run.record.provenance.path)
    headline = headline_of(run)
    if not run.steps:
        kinds = _counts(run)
        seen = [f"{_KINDS[k][1]}: {kinds[k]}" for k in ("hold", "stick_slip") if kinds[k]]
        headline = "; ".join(["No velocity step to fit", *seen])
    shared = told_of_all(run.steps)
    head = paragraph(f"{name}: a whole run", "of") + f"<h1>{escaped(headline)}</h1>"
    steps = TextTable(
        "Velocity steps",
        HEAD,
        [(*cells, *[""] * (len(HEAD) - len(cells))) for cells in map(text_cells, run.steps)],
        f"{BRACKETS}; {MISFIT}; all parameters in table.csv",
    )
    parts = [
        f"<header>{head}{paragraph(shared[0], 'sentence') if shared else ''}</header>",
        _cards(run),
        _next(run, commands.asks_on),
        bullets([f"Warning: {text}" for text in warnings], "warn"),
        _drawn("events.png", figures) + folded("All events", html_table(_events(run))),
        f"<h2>Steps</h2>{html_table(steps)}{bullets(shared)}" if run.steps else "",
        _drawn("rates.png", figures),
        _holds(run, holds, figures),
        _stress_steps(others, figures),
        _stick_slip(others, figures),
        _ramps(others),
        _pages(run.steps, figures),
        _meaning(),
        _origin(run, name, commands.command),
    ]
    return document(f"{headline}: {name}", _COLOUR, [part for part in parts if part])


def _next(run: RunFit, command: str) -> str:
    text = ask_on(run)
    code = f'<pre class="scroll"><code>{escaped(command)}</code></pre>'
    told = f"<p>Next, where the command of this page was given: {escaped(text)}</p>"
    return text and told + (code if command else "")


def _counts(run: RunFit) -> Counter[str]:
    """Events by kind; a velocity step beside teeth is no stretch of them."""
    return Counter(e.kind for e in run.events if e.kind != "stick_slip" or is_stretch(e))


def _cards(run: RunFit) -> str:
    kinds = _counts(run)
    cards = [(str(len(run.record)), "rows")]
    cards += [(str(n), words[n > 1]) for kind, words in _KINDS.items() if (n := kinds[kind])]
    inside = "".join(f"<li><b>{escaped(b)}</b><span>{escaped(s)}</span></li>" for b, s in cards)
    return f'<ul class="cards">{inside}</ul>'


def _drawn(file: str, figures: Mapping[str, bytes]) -> str:
    title, caption = _FIGURES[file]
    if file not in figures:
        return ""
    return f"<h2>{escaped(title)}</h2>{picture(figures[file], 'png', title, caption)}"


def _events(run: RunFit) -> TextTable:
    rows = [
        (
            f"{event.time:.6g}",
            event.kind.replace("_", "-"),
            f"{1e6 * event.before:.4g} -> {1e6 * event.after:.4g}",
            "" if event.normal_stress is None else f"{event.normal_stress / 1e6:.4g}",
            "fitted" if event.fitted else "",
            event.why,
        )
        for event in run.events
    ]
    head = ("time [s]", "what", "velocity [um/s]", "normal stress [MPa]", "", "why")
    return TextTable("Events", head, rows)


def _text_table(title: str, rows: Sequence[Mapping[str, Cell]]) -> TextTable:
    """Rows of a CSV file; what is not known is blank."""
    head = tuple(dict.fromkeys(name for row in rows for name in row))
    cells = [tuple(_cell(row.get(name)) for name in head) for row in rows]
    return TextTable(title, head, cells)


def _cell(value: Cell) -> str:
    if value is None:
        return ""
    return f"{value:.5g}" if isinstance(value, float) else str(value)


def _holds(run: RunFit, holds: Sequence[Hold], figures: Mapping[str, bytes]) -> str:
    others = of_holds.not_fitted(run.events, holds)
    if not holds and not others:
        return ""
    unit = run.record.friction_unit
    table = html_table(_text_table("Holds", of_holds.rows(holds, unit, others)))
    found = _drawn("holds.png", figures) or "<h2>Holds</h2>"
    return found + bullets(of_holds.told(holds, unit, others)) + folded("All holds", table)


def _stress_steps(others: Findings, figures: Mapping[str, bytes]) -> str:
    if not others.stress_steps:
        return ""
    title = _FIGURES["stress_steps.png"][0]
    table = html_table(_text_table(title, of_stress.rows(others.stress_steps)))
    found = _drawn("stress_steps.png", figures) or f"<h2>{escaped(title)}</h2>"
    return found + bullets(of_stress.told(others.stress_steps)) + folded("All of them", table)


def _stick_slip(others: Findings, figures: Mapping[str, bytes]) -> str:
    found = others.stick_slip
    if found is None:
        return ""
    title = _FIGURES["stick_slip.png"][0]
    laws = html_table(_text_table("Laws", of_cycles.law_rows(found))) if found.fits else ""
    table = html_table(_text_table(title, of_cycles.rows(found)))
    head = _drawn("stick_slip.png", figures) or f"<h2>{escaped(title)}</h2>"
    return head + bullets(of_cycles.told(found)) + folded("All stretches", table + laws)


def _ramps(others: Findings) -> str:
    if not others.ramps:
        return ""
    table = html_table(_text_table("Unloading and reloading", of_ramps.rows(others.ramps)))
    told = bullets(of_ramps.told(others.ramps))
    return f"<h2>Stiffness from unloading and reloading</h2>{told}{folded('All ramps', table)}"


def _pages(steps: Sequence[StepFit], figures: Mapping[str, bytes]) -> str:
    """Every step's figure, to be unfolded."""
    parts = []
    for step in steps:
        file = f"step_{step.number:02d}.png"
        if file in figures:
            title = f"Step {step.number}, at {step.event.time:.6g} s"
            caption = "Friction as recorded, and the fit; below, what the fit leaves."
            parts.append(folded(title, picture(figures[file], "png", title, caption)))
    return f"<h2>Every step</h2>{''.join(parts)}" if parts else ""


def _meaning() -> str:
    terms = "".join(f"<dt>{escaped(a)}</dt><dd>{escaped(b)}</dd>" for a, b in _MEANING)
    return f"<h2>How to read this</h2><dl>{terms}</dl>"


def _origin(run: RunFit, name: str, command: str) -> str:
    origin = run.record.provenance
    dropped = ", ".join(f"{n} {reason}" for reason, n in origin.dropped.items()) or "none"
    rows = [
        ("record", name),
        ("sha256", origin.sha256 or "not from a file"),
        ("rows", f"{len(run.record)} used of {origin.rows_read} (dropped: {dropped})"),
        ("made by", f"jaxfric {installed_version()}"),
        ("command", command),
    ]
    inside = "".join(f"<dt>{a}</dt><dd><code>{escaped(printable(b))}</code></dd>" for a, b in rows)
    return f"<h2>Where this comes from</h2><dl>{inside}</dl>" + paragraph(
        "The same numbers, for programs, are in run.json beside this page.", "note"
    )
