"""Several results on one page, report.html: no network, no scripts; figures are within it."""

import os
from collections.abc import Sequence
from pathlib import Path
from urllib.parse import quote

from .found import FoundResult
from .page import bullets, document, escaped, html_table, paragraph, picture, printable
from .version import installed_version

_COLOUR = "#1f4e79"
_NARROW = """<style>
figure { overflow-x: auto; } figure img { min-width: 34rem; } caption { display: none; }
nav li, h2 { overflow-wrap: anywhere; } h2 small { color: var(--soft); font-weight: 400; }
td:not(.n) { white-space: normal; overflow-wrap: break-word; }
</style>"""


def page(
    folder: Path, results: Sequence[FoundResult], damaged: Sequence[str], at: Path, command: str
) -> str:
    """The page of results below a folder; `at` is the folder that the page is in, `command` made
    it."""
    count = len(results)
    head = f"{count} result{'s' * (count != 1)} in {printable(folder.resolve().name)}"
    names = _names(folder, results)
    items = [
        f'<li><a href="#r{k}">{escaped(name)}</a>: {escaped(one.what)}{one.mark}</li>'
        for k, (name, one) in enumerate(zip(names, results, strict=True), 1)
    ]
    parts = [
        _NARROW,
        f"<header><h1>{escaped(head)}</h1></header>",
        bullets([f"Warning: {text}" for text in damaged], "warn"),
        f"<nav><ul>{''.join(items)}</ul></nav>",
        *(
            _section(k, name, one, at)
            for k, (name, one) in enumerate(zip(names, results, strict=True), 1)
        ),
        "<h2>Where this comes from</h2>",
        paragraph(f"jaxfric {installed_version()}", "note"),
        f"<p><code>{escaped(printable(command))}</code></p>",
    ]
    return document(head, _COLOUR, [part for part in parts if part])


def _names(folder: Path, results: Sequence[FoundResult]) -> list[str]:
    """What each result is called: its folder, or its file where that is not its only result."""
    inside = [one.file.relative_to(folder) for one in results]
    folders = [path.parent for path in inside]
    return [
        printable(
            str(path.parent if path.parent.name and folders.count(path.parent) == 1 else path)
        )
        for path in inside
    ]


def _section(number: int, title: str, one: FoundResult, at: Path) -> str:
    what = one.what[:1].upper() + one.what[1:]
    name = printable(one.file.name)
    links = [_link(one.file, name, at)] if one.file.is_file() else [escaped(name)]
    if one.page is not None:
        links.append(_link(one.page, f"its page, {one.page.name}", at))
    parts = [
        f'<h2 id="r{number}">{escaped(title)} <small>{escaped(what)}</small></h2>',
        paragraph(one.sentence, "sentence") if one.sentence else "",
        html_table(one.numbers),
        bullets([f"Warning: {text}" for text in one.warnings], "warn"),
        *(picture(f.read_bytes(), "png", f.stem, f.stem.replace("_", " ")) for f in one.figures),
        f'<p class="note">{" · ".join(links)}</p>',
    ]
    return "".join(parts)


def _link(file: Path, text: str, at: Path) -> str:
    """A link from the page to a file; by its whole path where they are on different drives."""
    target, here = file.resolve(), at.resolve()
    try:
        way = quote(Path(os.path.relpath(target, here)).as_posix())
    except ValueError:
        way = target.as_uri()
    return f'<a href="{escaped(way)}">{escaped(text)}</a>'
