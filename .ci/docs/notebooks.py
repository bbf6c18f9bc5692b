"""Executed notebooks as pages: text, code, and what it printed and drew."""

import base64
import json
import re
from pathlib import Path

Page = tuple[str, dict[str, bytes]]


def pages(root: Path) -> dict[str, Page]:
    """Markdown and pictures of every tutorial, by the name of the page."""
    found = {}
    for path in sorted((root / "fits" / "tutorials").glob("*.ipynb")):
        name = f"fits/tutorials/{path.stem}.md"
        found[name] = page(json.loads(path.read_text(encoding="utf-8")), path.stem)
    return found


def page(notebook: dict, stem: str) -> Page:
    """One notebook."""
    parts: list[str] = []
    pictures: dict[str, bytes] = {}
    for cell in notebook["cells"]:
        text = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            parts.append(text)
            continue
        parts.append(f"```python\n{text}\n```")
        for output in cell["outputs"]:
            parts.append(shown(output, stem, pictures))
    note = f"*This page is the notebook `fits/tutorials/{stem}.ipynb`; open it in Jupyter.*"
    parts.insert(1, note)
    return "\n\n".join(part for part in parts if part), pictures


def shown(output: dict, stem: str, pictures: dict[str, bytes]) -> str:
    """An output of a cell: a picture, or text."""
    data = output.get("data", {})
    if "image/png" in data:
        name = f"{stem}_{len(pictures) + 1}.png"
        pictures[f"fits/tutorials/{name}"] = base64.b64decode("".join(data["image/png"]))
        return f"![figure {len(pictures)}]({name})"
    text = "".join(output.get("text", data.get("text/plain", "")))
    text = re.sub(r"\x1b\[[\d;]*m", "", text).rstrip()
    return f"```text\n{text}\n```" if text else ""
