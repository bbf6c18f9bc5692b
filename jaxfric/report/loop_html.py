"""A closed loop as one page, loop.html: no network, no scripts, nothing outside the file."""

from collections.abc import Mapping
from math import isfinite

from ..loop.family import listed
from ..loop.result import Loop
from ..units import read_as
from .fit_text import noise_text
from .location_text import shares_told
from .loop_next import meanings, next_steps
from .loop_text import (
    answer,
    apart,
    base_name,
    by_velocity,
    candidates,
    headline,
    rests_on,
    splitting,
    tables,
)
from .page import bullets, document, escaped, folded, html_table, paragraph, picture, printable

FIGURES = {
    "residual": (
        "Record and model",
        "The record with the model through it, and below record minus model before and after, in"
        " units of the noise: dots are rows, the line is their mean with its uncertainty. A line"
        " that stays at 0 within its band is noise alone; anything that repeats after {marks} is"
        " friction that the model lacks.",
    ),
    "noise": (
        "The noise of the record",
        "How alike rows are, by their distance: what the model leaves, and the noise that was found"
        " in it, with the band that such noise stays in. Short correlation is taken for noise and"
        " no missing friction; what lasts longer than the bound above the figure would be. Where"
        " the record leaves the band, the noise model is not quite that of the record, and errors"
        " are a little less sure.",
    ),
    "location": (
        "Where the structure sits",
        "Which variable carries the friction that the base model lacks, without asking which effect"
        " it is. The variable that takes most away comes first; the others have what they explain"
        " beyond it.",
    ),
    "profiles": (
        "Missing friction over each variable",
        "Friction that the base model lacks, drawn against one variable at a time. Shares here are"
        " those of each variable alone, and overlap.",
    ),
    "aliasing": (
        "What this record can tell apart",
        "Two effects with a number near 1 change this record in the same way, so no fit of it can"
        " say which of them acts; framed pairs need another experiment.",
    ),
    "candidates": (
        "How the candidates scored",
        "Every model that was fitted and, below, every single effect to first order: a longer bar"
        " to the right is a better explanation, and the dots beside show the error on rows that"
        " were not fitted.",
    ),
}
_COLOURS = {
    "no_missing_effect": "#2f6b3c",
    "effects": "#1f4e79",
    "ambiguous": "#8a5a00",
    "outside_catalogue": "#a33b12",
    "too_weak": "#5a5a5a",
}
_MEANING = (
    (
        "σ (sigma)",
        "The noise of one row of the record, found with everything smooth taken out; rows that are"
        " held out have their own. An error of 1.00 σ cannot be made smaller by any model, but for"
        " chance.",
    ),
    (
        "train, select, report",
        "The record is cut into blocks. Models are fitted on train; how well they predict select"
        " counts in their BIC; report is scored only at the end: the honest number.",
    ),
    (
        "ΔBIC",
        "BIC of a model less that of the base. Below 0 it explains the record better, after it paid"
        " for its parameters and for correlated noise. Below −10 the evidence is strong, above −2"
        " there is none.",
    ),
    (
        "shift [std]",
        "How far a parameter moved when the effects were added, in standard deviations: a large"
        " one means that the simpler model reported a wrong value with too small an error.",
    ),
    (
        "cosine",
        "How alike the traces of two effects are in this record, from 0 (nothing in common) to 1"
        " (the same), once everything the fitted model can absorb is taken out.",
    ),
    (
        "p",
        "How often noise alone would show as much structure. Below 0.01 there is something left."
        " It is asked by likelihood, the size and memory of the noise found anew with and without"
        " the structure. The table corrects for all that is asked; the figure of where structure"
        " sits takes each variable by itself.",
    ),
)
_VERDICTS = (
    ("no_missing_effect", "the base model explains the record to its noise"),
    ("effects", "effects are named, and with them only noise is left, on rows not fitted too"),
    ("ambiguous", "one of several effects or curves is missing, and this record cannot say which"),
    (
        "outside_catalogue",
        "structure is left that no effect which this record fixes explains",
    ),
    ("too_weak", "a hint of an effect, not enough to name it"),
)


def page(loop: Loop, figures: Mapping[str, bytes], *, version: str, command: str) -> str:
    """The page, with those SVG `figures` of `FIGURES` that there are; `command` made it."""
    error, _, parameters, tests, _, *more = tables(loop)
    blocks = html_table(error) + paragraph(splitting(loop), "note") + html_table(by_velocity(loop))
    name = printable(loop.record.provenance.path)
    parts = [
        _head(loop, name),
        _means(loop),
        _cards(loop),
        _warnings(loop),
        _figure(loop, "residual", figures),
        folded("Errors by block and by " + loop.words.part, blocks),
        f"<h2>What the model is now</h2>{_added(loop)}{html_table(parameters)}{html_table(tests)}"
        + "".join(html_table(table) for table in more),
        _rests_on(loop),
        _figure(
            loop,
            "location",
            figures,
            bullets(shares_told(loop.location, loop.base_fit.steps.velocities)),
        ),
        folded(FIGURES["profiles"][0], _drawing(loop, "profiles", figures)),
        _figure(loop, "noise", figures),
        _figure(loop, "aliasing", figures, bullets(apart(loop))),
        _figure(loop, "candidates", figures),
        folded(
            "All models that were fitted", html_table(candidates(loop, most=len(loop.candidates)))
        ),
        _meaning(loop),
        _provenance(loop, name, version, command),
    ]
    colour = _COLOURS.get(loop.verdict, "#1f4e79")
    return document(f"{headline(loop)}: {name}", colour, parts)


def _head(loop: Loop, name: str) -> str:
    law = base_name(loop)
    declared = listed(loop.before.effects)
    asked = f"{name}: what does the {law}{' with ' + declared if declared else ''} lack?"
    return (
        f"<header>{paragraph(asked, 'of')}<h1>{escaped(headline(loop))}</h1>"
        f"{paragraph(loop.sentence, 'sentence')}{bullets(loop.reasons)}{bullets(answer(loop))}"
        "</header>"
    )


def _means(loop: Loop) -> str:
    """What each effect means, and what to do next."""
    told = "".join(
        f"<li><b>{escaped(name)}</b>: {escaped(words)}"
        + (f" <code>{escaped(equation)}</code>" if equation else "")
        + "</li>"
        for name, words, equation in meanings(loop)
    )
    meant = f"<h2>What it means</h2><ul>{told}</ul>" if told else ""
    steps = ""
    for step in next_steps(loop):
        text = f"Also: {step.text}" if step.also else step.text
        code = f'<pre class="scroll"><code>{escaped(step.command)}</code></pre>'
        steps += f"<li>{escaped(text)}{code if step.command else ''}</li>"
    note = paragraph("Commands are for the folder in which this page lies.", "note")
    return f"{meant}<h2>What to do next</h2><ul>{steps}</ul>{note}"


def _cards(loop: Loop) -> str:
    """The one pair of errors, of the report block, the effects and the noise."""
    error = f"{loop.test_error(loop.before):.2f} σ"
    if loop.effects:
        error += f" → {loop.test_error(loop.after):.2f} σ"
    most = loop.most_held_out
    chance = f", by chance up to {most:.2f}" if isfinite(most) else ""
    short, noise = loop.after.noise.kind, noise_text(loop.after.noise)
    cards = [
        (
            error,
            f"test error, of the report block alone; noise alone gives 1 σ{chance}",
        ),
        (" + ".join(loop.effects) or "none", "effects added"),
        (short, "noise of the record" + (f": {noise}" if noise != short else "")),
    ]
    inside = "".join(f"<li><b>{escaped(b)}</b><span>{escaped(s)}</span></li>" for b, s in cards)
    return f'<ul class="cards">{inside}</ul>'


def _warnings(loop: Loop) -> str:
    return bullets([f"Warning: {text}" for text in loop.warnings], "warn")


def _added(loop: Loop) -> str:
    """A remark where no effect was added."""
    if loop.effects:
        return ""
    return paragraph("No effect was added: the parameters are those of the base model.", "note")


def _rests_on(loop: Loop) -> str:
    """The rows of each claim, folded; nothing where nothing is claimed."""
    table = rests_on(loop)
    return folded(table.title, html_table(table)) if table.rows else ""


def _figure(loop: Loop, name: str, figures: Mapping[str, bytes], more: str = "") -> str:
    return f"<h2>{escaped(FIGURES[name][0])}</h2>{more}{_drawing(loop, name, figures)}"


def _drawing(loop: Loop, name: str, figures: Mapping[str, bytes]) -> str:
    title, caption = (text.format(marks=loop.words.marks) for text in FIGURES[name])
    if name not in figures:
        return paragraph("This figure was not drawn.", "note")
    return picture(figures[name], "svg+xml", title, caption)


def _meaning(loop: Loop) -> str:
    terms = "".join(f"<dt>{escaped(a)}</dt><dd>{escaped(b)}</dd>" for a, b in _MEANING)
    verdicts = "".join(
        f"<li>{'<b>' if name == loop.verdict else ''}<code>{name}</code>: {escaped(text)}"
        f"{'</b>' if name == loop.verdict else ''}</li>"
        for name, text in _VERDICTS
    )
    return f"<h2>How to read this</h2><dl>{terms}<dt>Verdicts</dt></dl><ul>{verdicts}</ul>"


def _steps(loop: Loop) -> str:
    """Times and velocities of the steps, in words."""
    steps = loop.base_fit.steps
    if loop.length_unit == "m":
        return read_as(steps.text(loop.words.speed, 4))
    both = zip(steps.times, steps.velocities, strict=True)
    return ", ".join(f"{t:.4g} s: {v:.4g} {loop.length_unit}/s" for t, v in both)


def _provenance(loop: Loop, name: str, version: str, command: str) -> str:
    origin = loop.record.provenance
    dropped = ", ".join(f"{n} {reason}" for reason, n in origin.dropped.items()) or "none"
    unit = loop.record.friction_unit
    unit = "coefficient" if unit == "1" else f"force in {unit}"
    rows = [
        ("record", name),
        ("sha256", origin.sha256 or "not from a file"),
        ("rows", f"{len(loop.record)} used of {origin.rows_read} (dropped: {dropped})"),
        ("sampling", str(loop.record.sampling())),
        ("friction", unit),
        (f"{loop.words.part}s", _steps(loop)),
        ("made by", f"jaxfric {version} in {loop.seconds:.1f} s"),
        ("command", command),
    ]
    inside = "".join(f"<dt>{a}</dt><dd><code>{escaped(printable(b))}</code></dd>" for a, b in rows)
    return f"<h2>Where this comes from</h2><dl>{inside}</dl>" + paragraph(
        "The same numbers, for programs, are in loop.json beside this page.", "note"
    )
