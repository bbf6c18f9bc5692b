"""README and the written pages of the documentation, and the blocks of code in them."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / ".ci" / "docs" / "pages").glob("*.md"))]


def blocks_of(page: Path, language: str) -> list[str]:
    """The lines of all blocks of a language; of Python the blocks themselves."""
    blocks = re.findall(rf"```{language}\n(.*?)```", page.read_text(encoding="utf-8"), re.S)
    return blocks if language == "python" else [x for block in blocks for x in block.splitlines()]


def row_of(page: Path, first: str, column: int = 0) -> list[str]:
    """The cells of the one row of a page's tables that has this text in a column."""
    rows = [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in page.read_text(encoding="utf-8").splitlines()
        if line.startswith("|")
    ]
    (row,) = (row for row in rows if len(row) > column and row[column] == first)
    return row[column + 1 :]
