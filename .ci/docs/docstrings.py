"""Docstrings of the package as Markdown: sections become bold words, their entries a list."""

import re
from typing import Any

import griffe

_SECTION = re.compile(r"^(\w[\w ]*)\n-{3,}\n", re.M)


def markdown(text: str) -> str:
    """A docstring as Markdown.

    A section is a word with a line of hyphens under it. Of its entries, `name : text` begins one,
    and lines that are indented below go on with it. Other lines of a section stay as they are.
    """
    head, *rest = _SECTION.split(text)
    parts = [head.rstrip()]
    for title, body in zip(rest[::2], rest[1::2], strict=True):
        section, _, after = body.partition("\n\n")
        parts.append(f"**{title}**\n\n{_entries(section)}")
        if after.strip():
            parts.append(after.rstrip())
    return "\n\n".join(part for part in parts if part)


def _entries(body: str) -> str:
    lines: list[str] = []
    for line in body.splitlines():
        entry = re.match(r"^([\w*,; ]+?) ?: (.*)", line)
        if entry:
            lines.append(f"- `{entry[1]}`: {entry[2]}")
        elif line.startswith(" ") and lines:
            lines[-1] += " " + line.strip()
        else:
            lines.append(line)
    return "\n".join(lines)


class Docstrings(griffe.Extension):
    """Rewrites every docstring once it is loaded."""

    def on_object(self, *, obj: griffe.Object, **_: Any) -> None:
        """Of a module, class, function or attribute."""
        if obj.docstring is not None:
            obj.docstring.value = markdown(obj.docstring.value)
