"""A closed loop as one page, loop.html: no network, no scripts, nothing outside the file."""

import base64
from collections.abc import Mapping, Sequence
from html import escape

from ..fitting.table import noise_text
from ..loop.family import listed
from ..loop.result import Loop
from .loop_text import (
    TextTable,
    apart,
    candidates,
    headline,
    numeric,
    splitting,
    tables,
)

FIGURES = {
    "residual": (
        "What the model leaves",
        "Record minus model before and after, in units of the noise: dots are rows, the line is"
        " their mean with its uncertainty. A line that stays at 0 within its band is noise alone;"
        " anything that repeats after {marks} is friction that the model lacks.",
    ),
    "noise": (
        "The noise of the record",
        "How alike rows are, by their distance: what the model leaves, and the noise that was found"
        " in it, with the band that such noise stays in. Short correlation comes from the"
        " recorder, the servo or the surfaces and is no missing friction; what lasts longer than"
        " the bound above the figure would be. Where the record leaves the band, the noise model is"
        " not quite that of the record, and errors are a little less sure.",
    ),
    "location": (
        "Where the structure sits",
        "Friction that the base model lacks, drawn against one variable at a time, without asking"
        " which effect it is. Shares are those of each variable alone and overlap; the largest"
        " tells where to look.",
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
        "The record is cut into blocks. Models are fitted on train; select decides between them;"
        " report is scored only at the end: the honest number.",
    ),
    (
        "ΔBIC",
        "How much better a model explains the record, after paying for its parameters and for the"
        " noise being correlated. Above 10 is strong evidence, below 2 is none.",
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
    ("outside_catalogue", "structure is left that no effect of the catalogue explains"),
    ("too_weak", "a hint of an effect, not enough to name it"),
)
_STYLE = """
:root { color-scheme: light; --ink: #1d2530; --soft: #5a6572; --line: #dfe4ea; --tint: #f5f7f9; }
* { box-sizing: border-box; }
body { margin: 0; background: #fff; color: var(--ink);
  font: 16px/1.55 system-ui, "Segoe UI", Roboto, "DejaVu Sans", sans-serif; }
main { max-width: 74rem; margin: 0 auto; padding: 2rem 1.25rem 4rem; }
header { border-left: .4rem solid var(--verdict); padding: .2rem 0 .2rem 1.1rem; }
h1 { font-size: 1.9rem; line-height: 1.2; margin: .1rem 0 .5rem; color: var(--verdict);
  overflow-wrap: anywhere; }
h2 { font-size: 1.25rem; margin: 2.6rem 0 .6rem; padding-top: .9rem;
  border-top: 1px solid var(--line); }
.of { color: var(--soft); margin: 0; overflow-wrap: anywhere; }
.sentence { font-size: 1.1rem; margin: 0; }
.cards { display: flex; flex-wrap: wrap; gap: .8rem; margin: 1.5rem 0 0; padding: 0;
  list-style: none; }
.cards li { flex: 1 1 12rem; background: var(--tint); border-radius: .4rem; padding: .7rem .9rem; }
.cards b { display: block; font-size: 1.35rem; font-variant-numeric: tabular-nums; }
.cards span { color: var(--soft); font-size: .88rem; }
.scroll { overflow-x: auto; margin: .8rem 0; }
table { border-collapse: collapse; font-size: .9rem; font-variant-numeric: tabular-nums; }
caption { text-align: left; font-weight: 600; padding-bottom: .3rem; }
th, td { padding: .28rem .6rem .28rem 0; border-bottom: 1px solid var(--line); text-align: left;
  white-space: nowrap; vertical-align: top; }
th { color: var(--soft); font-weight: 500; }
.n { text-align: right; }
tr.m td { font-weight: 600; background: #eef4fa; }
.note { color: var(--soft); font-size: .9rem; margin: .3rem 0 0; }
figure { margin: 1rem 0 0; }
figure img { width: 100%; height: auto; display: block; }
figcaption { margin-bottom: .6rem; }
.warn { background: #fff6e0; border-radius: .4rem; padding: .6rem .9rem .6rem 2rem;
  margin: 1.2rem 0 0; }
dt { font-weight: 600; margin-top: .6rem; } dd { margin: 0; overflow-wrap: anywhere; }
code { font: .9em ui-monospace, "DejaVu Sans Mono", monospace; overflow-wrap: anywhere; }
summary { cursor: pointer; color: var(--soft); }
@media print { main { max-width: none; padding: 0; } figure, table { break-inside: avoid; } }
"""


def page(loop: Loop, figures: Mapping[str, bytes], *, version: str, command: str) -> str:
    """The page, with those SVG `figures` of `FIGURES` that there are; `command` made it."""
    error, velocities, parameters, tests, _, *more = tables(loop)
    name = _shown(loop.record.provenance.path)
    parts = [
        _head(loop, name),
        _cards(loop),
        _warnings(loop),
        f"<h2>Before and after</h2>{_table(error)}{_paragraph(splitting(loop), 'note')}",
        _details(velocities.title, _table(velocities)),
        _figure(loop, "residual", figures),
        _figure(loop, "noise", figures),
        f"<h2>What the model is now</h2>{_added(loop)}{_table(parameters)}{_table(tests)}"
        + "".join(_table(table) for table in more),
        _figure(loop, "location", figures),
        _figure(loop, "aliasing", figures, _list(apart(loop))),
        _figure(loop, "candidates", figures),
        _details(
            "All models that were fitted", _table(candidates(loop, most=len(loop.candidates)))
        ),
        _meaning(loop),
        _provenance(loop, name, version, command),
    ]
    colour = _COLOURS.get(loop.verdict, "#1f4e79")
    title = _text(f"{headline(loop)}: {name}")
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{title}</title>\n<style>{_STYLE}:root {{ --verdict: {colour}; }}</style>\n"
        f"</head>\n<body>\n<main>\n{chr(10).join(parts)}\n</main>\n</body>\n</html>\n"
    )


def _text(text: str) -> str:
    return escape(text, quote=True)


def _shown(path: str) -> str:
    """A path with a question mark for what is no character."""
    text = path.encode("utf-8", errors="replace").decode("utf-8")
    return "".join(c if c.isprintable() else "?" for c in text)


def _paragraph(text: str, kind: str) -> str:
    return f'<p class="{kind}">{_text(text)}</p>'


def _list(items: Sequence[str], kind: str = "") -> str:
    inside = "".join(f"<li>{_text(item)}</li>" for item in items)
    return f'<ul class="{kind}">{inside}</ul>' if inside else ""


def _details(title: str, content: str) -> str:
    return f"<details><summary>{_text(title)}</summary>{content}</details>"


def _head(loop: Loop, name: str) -> str:
    law = loop.base_name
    declared = listed(loop.before.effects)
    asked = f"{name}: what does the {law}{' with ' + declared if declared else ''} lack?"
    return (
        f"<header>{_paragraph(asked, 'of')}<h1>{_text(headline(loop))}</h1>"
        f"{_paragraph(loop.sentence, 'sentence')}{_list(loop.reasons)}</header>"
    )


def _cards(loop: Loop) -> str:
    def pair(name: str) -> str:
        sigma = loop.sigma_of(loop.blocks.of(name))
        both = f"{loop.before.rms[name] / sigma:.2f} σ"
        return f"{both} → {loop.after.rms[name] / sigma:.2f} σ" if loop.effects else both

    cards = [
        (pair("report"), "error on the report block, seen only once"),
        (pair("train"), "error where the model was fitted"),
        (" + ".join(loop.effects) or "none", "effects added"),
        (noise_text(loop.after.noise), "noise of the record"),
    ]
    inside = "".join(f"<li><b>{_text(b)}</b><span>{_text(s)}</span></li>" for b, s in cards)
    return f'<ul class="cards">{inside}</ul>'


def _warnings(loop: Loop) -> str:
    return _list([f"Warning: {text}" for text in loop.warnings], "warn")


def _added(loop: Loop) -> str:
    """Room and equation of the effects that were added."""
    items = []
    for id in loop.effects:
        effect = loop.words.catalogue.get(id)
        items.append(f"{id} ({effect.room}): {effect.equation}" if effect else id)
    if not items:
        return _paragraph(
            "No effect was added: the parameters are those of the base model.", "note"
        )
    return _list(items)


def _table(table: TextTable) -> str:
    if not table.rows:
        return ""
    right = [numeric(table, k) for k in range(len(table.head))]

    def cells(tag: str, row: Sequence[str]) -> str:
        return "".join(
            f"<{tag}{' class=n' if n else ''}>{_text(cell)}</{tag}>"
            for cell, n in zip(row, right, strict=True)
        )

    body = "".join(
        f"<tr{' class=m' if k in table.marked else ''}>{cells('td', row)}</tr>"
        for k, row in enumerate(table.rows)
    )
    note = _paragraph(table.note, "note") if table.note else ""
    return (
        f'<div class="scroll"><table><caption>{_text(table.title)}</caption><thead><tr>'
        f"{cells('th', table.head)}</tr></thead><tbody>{body}</tbody></table></div>{note}"
    )


def _figure(loop: Loop, name: str, figures: Mapping[str, bytes], more: str = "") -> str:
    title, caption = (text.format(marks=loop.words.marks) for text in FIGURES[name])
    if name not in figures:
        return f"<h2>{_text(title)}</h2>{more}{_paragraph('This figure was not drawn.', 'note')}"
    data = base64.b64encode(figures[name]).decode("ascii")
    return (
        f"<h2>{_text(title)}</h2>{more}<figure><figcaption>{_text(caption)}</figcaption>"
        f'<img alt="{_text(title)}" src="data:image/svg+xml;base64,{data}"></figure>'
    )


def _meaning(loop: Loop) -> str:
    terms = "".join(f"<dt>{_text(a)}</dt><dd>{_text(b)}</dd>" for a, b in _MEANING)
    verdicts = "".join(
        f"<li>{'<b>' if name == loop.verdict else ''}<code>{name}</code>: {_text(text)}"
        f"{'</b>' if name == loop.verdict else ''}</li>"
        for name, text in _VERDICTS
    )
    return f"<h2>How to read this</h2><dl>{terms}<dt>Verdicts</dt></dl><ul>{verdicts}</ul>"


def _steps(loop: Loop) -> str:
    """Times and velocities of the steps, in words."""
    steps = loop.base_fit.steps
    if loop.length_unit == "m":
        return steps.text(loop.words.speed, 4)
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
    inside = "".join(f"<dt>{a}</dt><dd><code>{_text(_shown(b))}</code></dd>" for a, b in rows)
    return f"<h2>Where this comes from</h2><dl>{inside}</dl>" + _paragraph(
        "The same numbers, for programs, are in loop.json beside this page.", "note"
    )
