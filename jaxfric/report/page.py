"""One page of HTML: no network, no scripts, nothing outside the file."""

import base64
from collections.abc import Sequence
from html import escape

from .tables import TextTable, numeric
from .version import installed_version as installed_version

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
div.scroll { background:
  linear-gradient(to right, #fff 50%, #fff0) 0 / 2rem 100% no-repeat local,
  linear-gradient(to left, #fff 50%, #fff0) 100% / 2rem 100% no-repeat local,
  linear-gradient(to right, #1d253055, #1d253000) 0 / .7rem 100% no-repeat scroll,
  linear-gradient(to left, #1d253055, #1d253000) 100% / .7rem 100% no-repeat scroll; }
table { border-collapse: collapse; font-size: .9rem; font-variant-numeric: tabular-nums; }
caption { text-align: left; font-weight: 600; padding-bottom: .3rem; }
th, td { padding: .28rem .6rem .28rem 0; border-bottom: 1px solid var(--line); text-align: left;
  white-space: nowrap; vertical-align: top; }
th { color: var(--soft); font-weight: 500; }
.n { text-align: right; }
tr.m td { font-weight: 600; background: #eef4fa; }
.note { color: var(--soft); font-size: .9rem; margin: .3rem 0 0; }
figure { margin: 1rem 0 0; }
figure img { width: 100%; max-width: 100%; height: auto; display: block; }
pre { background: var(--tint); border-radius: .4rem; padding: .5rem .7rem; margin: .3rem 0 .6rem; }
pre code { white-space: pre-wrap; }
figcaption { margin-bottom: .6rem; }
.warn { background: #fff6e0; border-radius: .4rem; padding: .6rem .9rem .6rem 2rem;
  margin: 1.2rem 0 0; }
dt { font-weight: 600; margin-top: .6rem; } dd { margin: 0; overflow-wrap: anywhere; }
code { font-size: .9em; font-family: ui-monospace, "DejaVu Sans Mono", monospace;
  overflow-wrap: anywhere; }
summary { cursor: pointer; color: var(--soft); }
@media (max-width: 40rem) {
  main { padding: 1rem .8rem 3rem; } h1 { font-size: 1.45rem; }
  figure img { width: 40rem; max-width: none; }
  figcaption::after { content: " (wider than the window: move it sideways)"; }
  th, .w { white-space: normal; } .w { min-width: 7rem; }
}
@media print { main { max-width: none; padding: 0; } figure, table { break-inside: avoid; } }
"""
_WORDY = 16
"""Letters above which a cell of words may break."""


def document(title: str, colour: str, parts: Sequence[str]) -> str:
    """The page, of parts that are HTML; `colour` is that of its head."""
    style = f"{_STYLE}:root {{ --verdict: {colour}; }}"
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escaped(title)}</title>\n<style>{style}</style>\n"
        f"</head>\n<body>\n<main>\n{chr(10).join(parts)}\n</main>\n</body>\n</html>\n"
    )


def escaped(text: str) -> str:
    """Text as HTML shows it."""
    return escape(text, quote=True)


def printable(path: str) -> str:
    """A path with a question mark for what is no character."""
    text = path.encode("utf-8", errors="replace").decode("utf-8")
    return "".join(c if c.isprintable() else "?" for c in text)


def paragraph(text: str, kind: str) -> str:
    """A paragraph of text; `kind` is its class."""
    return f'<p class="{kind}">{escaped(text)}</p>'


def bullets(items: Sequence[str], kind: str = "") -> str:
    """A list of texts; nothing for none."""
    inside = "".join(f"<li>{escaped(item)}</li>" for item in items)
    return f'<ul class="{kind}">{inside}</ul>' if inside else ""


def folded(title: str, content: str) -> str:
    """HTML that is shown where its title is clicked."""
    return f"<details><summary>{escaped(title)}</summary>{content}</details>"


def html_table(table: TextTable) -> str:
    """A table, numbers at the right, its remark below; nothing for one without rows."""
    if not table.rows:
        return ""
    kinds = [_column(table, k) for k in range(len(table.head))]

    def cells(tag: str, row: Sequence[str]) -> str:
        return "".join(
            f"<{tag}{kind}>{escaped(cell)}</{tag}>" for cell, kind in zip(row, kinds, strict=True)
        )

    body = "".join(
        f"<tr{' class=m' if k in table.marked else ''}>{cells('td', row)}</tr>"
        for k, row in enumerate(table.rows)
    )
    note = paragraph(table.note, "note") if table.note else ""
    return (
        f'<div class="scroll"><table><caption>{escaped(table.title)}</caption><thead><tr>'
        f"{cells('th', table.head)}</tr></thead><tbody>{body}</tbody></table></div>{note}"
    )


def _column(table: TextTable, k: int) -> str:
    """The class of a column: n of numbers, w of words that may break in a narrow window."""
    if numeric(table, k):
        return " class=n"
    return " class=w" if max(len(row[k]) for row in table.rows) > _WORDY else ""


def picture(data: bytes, kind: str, title: str, caption: str) -> str:
    """A figure within the page; `kind` is "png" or "svg+xml"."""
    text = base64.b64encode(data).decode("ascii")
    return (
        f"<figure><figcaption>{escaped(caption)}</figcaption>"
        f'<div class="scroll"><img alt="{escaped(title)}" src="data:image/{kind};base64,{text}">'
        "</div></figure>"
    )
