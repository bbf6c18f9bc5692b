"""The table: what every piece changes, record by record, beside the whole loop."""

import json
from pathlib import Path
from statistics import median

from fits.blind.scored import BASE

WHOLE = "whole"


LEVELS = ("sure of a wrong name", "a wrong name", "no name", "right among others", "right")
"""What a verdict comes to, the worst first."""


def level(row: dict) -> int:
    """Place in `LEVELS`. Right: `effects` with exactly what is missing; nothing named where nothing
    is missing, or nothing of the catalogue. Right among others: `ambiguous`, with what is missing
    or with what the record does not tell from it. A loop that fails is sure of a wrong name."""
    if row["error"] is not None:
        return 0
    wrong = 0 if row["verdict"] == "effects" else 1
    if row["kind"] not in ("one", "two"):
        return wrong if row["confirmed"] else 4
    if not row["confirmed"]:
        return 2
    if row["verdict"] == "effects":
        return 4 if row["exact"] else 0
    return 3 if row["group"] else wrong


def published(out: Path) -> str:
    """The table of all that is in DIR, as Markdown; also written to DIR/table.md."""
    records = [json.loads(path.read_text()) for path in sorted((out / "found").glob("*.json"))]
    whole = [r["rows"][WHOLE] for r in records]
    lines = [
        f"{len(records)} records, whole loop: {_levels(whole)};"
        f" A, B, L covered {_coverage(whole)}; median {median(r['seconds'] for r in whole):.1f} s",
        "",
        "| piece taken out | records | better | worse | changed | coverage | was | time |",
        "|---|---|---|---|---|---|---|---|",
    ]
    pieces = dict.fromkeys(piece for r in records for piece in r["rows"] if piece != WHOLE)
    for piece in pieces:
        both = [(r["rows"][WHOLE], r["rows"][piece]) for r in records if piece in r["rows"]]
        better = sum(level(b) > level(a) for a, b in both)
        worse = sum(level(b) < level(a) for a, b in both)
        changed = sum((a["verdict"], a["found"]) != (b["verdict"], b["found"]) for a, b in both)
        own = [b["fits"] == 0 for _, b in both]
        ratio = "" if not all(own) or any(b["seconds"] < 2 for _, b in both) else _ratio(both)
        lines.append(
            f"| {piece} | {len(both)} | {better} | {worse} | {changed} |"
            f" {_coverage([b for _, b in both])} | {_coverage([a for a, _ in both])} | {ratio} |"
        )
    text = "\n".join(lines) + "\n"
    (out / "table.md").write_text(text, encoding="utf-8")
    return text


def _ratio(both) -> str:
    return f"{median(b['seconds'] / a['seconds'] for a, b in both):.2f}"


def _levels(rows: list[dict]) -> str:
    found = [level(row) for row in rows]
    return ", ".join(f"{found.count(k)} {LEVELS[k]}" for k in range(len(LEVELS) - 1, -1, -1))


def _coverage(rows: list[dict]) -> str:
    known = [r["covered"][name] for r in rows for name in BASE if name in r["covered"]]
    return f"{100 * sum(known) / len(known):.1f} %" if known else ""
