"""A report as HTML: for a notebook, and as one page with its figures.

An HTML page of this module needs no network, no scripts and no other file.
"""

import base64
import mimetypes
import tomllib
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import NamedTuple

from ..records.record import Provenance
from .record import rows_used
from .report import Report
from .tables import TextTable, numeric
from .version import installed_version

_OPEN = 2
"""Tables that are shown; those below are folded."""
_WORDY = 16
"""Letters above which a cell of words may break."""
_NOTEBOOK = (
    ".jaxfric caption{text-align:left;font-weight:600;caption-side:top}"
    ".jaxfric th,.jaxfric td{text-align:left;padding:.15em .7em .15em 0}"
    ".jaxfric .n{text-align:right}.jaxfric .lines{white-space:pre-wrap;margin:.4em 0}"
    ".jaxfric .m td{font-weight:600}.jaxfric .note{opacity:.7;font-size:.9em}"
    ".jaxfric .scroll{overflow-x:auto}.jaxfric .warn{border-left:3px solid #c8501e}"
)


class Figure(NamedTuple):
    """A figure of a page: its file and its caption."""

    file: str
    title: str
    caption: str
    lines: Sequence[str] = ()
    """What it shows, in sentences."""
    folded: bool = False


class Page(NamedTuple):
    """Parts of an HTML page besides the report, in the order in which the page shows them."""

    about: str
    """The question, above the headline."""
    meanings: Sequence[tuple[str, str, str]] = ()
    """Of each finding: its name, what it means, and its equation."""
    where: str = ""
    """The folder that the commands of the next steps are for."""
    figures: Sequence[Figure] = ()
    terms: Sequence[tuple[str, str]] = ()
    """Words of the page, and what they mean."""
    origin: Sequence[tuple[str, str]] = ()
    """Where the result is from."""
    colour: str = "#1f4e79"


def words_of_page(name: str) -> dict:
    """Captions, terms and other words of a page, from pages.toml."""
    text = Path(__file__).with_name("pages.toml").read_text(encoding="utf-8")
    return tomllib.loads(text)[name]


def html_of(title: str, report: Report) -> str:
    """A report as HTML for a notebook."""
    parts = [f"<p><b>{escape(title)}</b></p>", _lines(report.headline), _lines(report.lines)]
    parts += [_tables(report), _steps(report), _warnings(report)]
    return f'<div class="jaxfric"><style>{_NOTEBOOK}</style>{"".join(parts)}</div>'


def page_of(report: Report, page: Page, pictures: Mapping[str, bytes], json: str) -> str:
    """A report as a whole page.

    `pictures` are the figures that could be drawn, by file. `json` names the JSON file that holds
    the numbers of the report.
    """
    first, *rest = report.headline
    head = f"{_text('p', page.about, 'of')}{_text('h1', first)}{_lines(rest, 'sentence')}"
    meanings = "".join(
        f"<li>{_text('b', name)}: {escape(words)} {_text('code', equation)}</li>"
        for name, words, equation in page.meanings
    )
    steps, where = _steps(report), _text("p", page.where, "note")
    note = f"The same numbers, for programs, are in {json} beside this page."
    parts = [
        _tag("header", f"{head}{_lines(report.lines)}"),
        f"<h2>What it means</h2><ul>{meanings}</ul>" if meanings else "",
        f"<h2>What to do next</h2>{steps}{where}" if steps else "",
        _warnings(report),
        *(_figure(figure, pictures) for figure in page.figures),
        f"<h2>Numbers</h2>{_tables(report)}",
        f"<h2>How to read this</h2>{_list(page.terms)}",
        f"<h2>Where this comes from</h2>{_list(page.origin)}{_text('p', note, 'note')}",
    ]
    style = Path(__file__).with_name("page.css").read_text(encoding="utf-8")
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(first)} | {escape(page.about)}</title>\n"
        f"<style>{style}:root {{ --verdict: {page.colour}; }}</style>\n"
        f"</head>\n<body>\n<main>\n{chr(10).join(filter(None, parts))}\n</main>\n</body>\n</html>\n"
    )


def origin_of(
    origin: Provenance, rows: int, command: str, more: Mapping[str, str], seconds: str = ""
) -> list[tuple[str, str]]:
    """Describe the origin of a result: record, its `rows`, `more` facts, version and command."""
    return [
        ("record", printable(origin.path)),
        ("sha256", origin.sha256 or "not from a file"),
        ("rows", rows_used(origin, rows)),
        *more.items(),
        ("made by", f"jaxfric {installed_version()}{seconds}"),
        ("command", printable(command)),
    ]


# ---- parts ---------------------------------------------------------------------------------


def printable(path: str) -> str:
    """Return a path as text, with a question mark for each byte that is not a character."""
    text = path.encode("utf-8", errors="replace").decode("utf-8")
    return "".join(c if c.isprintable() else "?" for c in text)


def _tag(name: str, inside: str, kind: str = "") -> str:
    """An element of a class; nothing if there is nothing inside."""
    opened = f'{name} class="{kind}"' if kind else name
    return f"<{opened}>{inside}</{name}>" if inside else ""


def _text(name: str, text: str, kind: str = "") -> str:
    """An element of text; nothing if there is none."""
    return _tag(name, escape(text), kind)


def _bullets(items: Sequence[str], kind: str = "") -> str:
    """A list of texts; nothing if there are none."""
    return _tag("ul", "".join(_text("li", item) for item in items), kind)


def _folded(title: str, content: str) -> str:
    """HTML that appears after a click on its title."""
    return f"<details>{_text('summary', title)}{content}</details>"


def _table(table: TextTable) -> str:
    """A table with numbers aligned right and its remark below."""
    kinds = [_column(table, k) for k in range(len(table.head))]

    def cells(tag: str, row: Sequence[str]) -> str:
        return "".join(
            f"<{tag}{kind}>{escape(cell)}</{tag}>" for cell, kind in zip(row, kinds, strict=True)
        )

    body = "".join(
        f"<tr{' class=m' if k in table.marked else ''}>{cells('td', row)}</tr>"
        for k, row in enumerate(table.rows)
    )
    return (
        f'<div class="scroll"><table>{_text("caption", table.title)}<thead><tr>'
        f"{cells('th', table.head)}</tr></thead><tbody>{body}</tbody></table></div>"
        f"{_text('p', table.note, 'note')}"
    )


def _column(table: TextTable, k: int) -> str:
    """The class of a column: n of numbers, w of words that may break in a narrow window."""
    if numeric(table, k):
        return " class=n"
    return " class=w" if max(len(row[k]) for row in table.rows) > _WORDY else ""


def _tables(report: Report) -> str:
    """The tables, with the notes below those that are open."""
    tables = [table for table in report.tables if table.rows]
    shown = "".join(map(_table, tables[:_OPEN]))
    rest = "".join(_folded(table.title, _table(table)) for table in tables[_OPEN:])
    return f"{shown}{_lines(report.notes)}{rest}"


def _lines(lines: Sequence[str], kind: str = "") -> str:
    """Lines below each other, as indented as they are."""
    return _text("div", "\n".join(lines), f"lines {kind}".strip())


def _warnings(report: Report) -> str:
    return _bullets([f"warning: {text}" for text in report.warnings], "warn")


def _steps(report: Report) -> str:
    """What to do next, each with its command."""
    steps = ""
    for step in report.next_steps:
        text = f"Also: {step.text}" if step.also else step.text
        code = _tag("pre", _text("code", step.command), "scroll")
        steps += f"<li>{escape(text)}{code}</li>"
    return _tag("ul", steps)


def _figure(figure: Figure, pictures: Mapping[str, bytes]) -> str:
    """A figure below its title, or folded."""
    drawn = _text("p", "This figure was not drawn.", "note")
    if data := pictures.get(figure.file):
        text = base64.b64encode(data).decode("ascii")
        kind, _ = mimetypes.guess_type(figure.file)
        drawn = (
            f"<figure>{_text('figcaption', figure.caption)}"
            f'<div class="scroll"><img alt="{escape(figure.title)}"'
            f' src="data:{kind};base64,{text}"></div></figure>'
        )
    content = _bullets(figure.lines) + drawn
    if figure.folded:
        return _folded(figure.title, content)
    return f"{_text('h2', figure.title)}{content}"


def _list(terms: Sequence[tuple[str, str]]) -> str:
    return f"<dl>{''.join(_text('dt', a) + _text('dd', b) for a, b in terms)}</dl>"
