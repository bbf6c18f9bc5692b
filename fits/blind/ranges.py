"""Where the loop breaks: records of the study `wide`, by each of their conditions in turn."""

from collections.abc import Callable, Sequence
from typing import Any

from .scored import BASE, Score
from .shares import wilson

EDGES = {"K/K_cr": (1.5, 2.0, 3.0, 8.0, 20.0), "velocities": (4, 7, 12, 20, 31)}
"""Bands: from an edge, up to the next."""
ORDER = (*EDGES, "sigma", "law", "stiffness", "load point", "sampling")
RANGES = (
    "`right` is a right group that is confirmed, among records of one effect (rho 0.2 to 1);"
    " `wrong` is a confirmed name in none, `clean` is `no_missing_effect`, among those without;"
    " `covered` is of A, B and L in all. Strictly counted (`strict.py`)."
)


def by_range(scores: Sequence[Score]) -> list[dict[str, Any]]:
    """A row for every band of every condition."""
    known = [s for s in scores if s.wide is not None and s.kind != "law"]
    return [
        {"condition": name, "band": band, **_row([s for s in known if band_of(s, name) == band])}
        for name in ORDER
        for band in _bands(name, known)
    ]


def band_of(s: Score, name: str) -> str:
    """The band of a record in a condition."""
    assert s.wide is not None
    value = s.wide[name]
    if name not in EDGES:
        return f"{value:g}" if isinstance(value, float) else str(value)
    edges = EDGES[name]
    k = sum(value >= edge for edge in edges[1:-1])
    last = edges[k + 1] - 1 if isinstance(edges[k + 1], int) else edges[k + 1]
    return f"{edges[k]:g} to {last:g}"


def _bands(name: str, scores: Sequence[Score]) -> list[str]:
    """Bands that records are in, from small values to large."""
    assert all(s.wide is not None for s in scores)
    ordered = sorted(scores, key=lambda s: (s.wide or {})[name])
    return list(dict.fromkeys(band_of(s, name) for s in ordered))


def _row(some: Sequence[Score]) -> dict[str, Any]:
    one, none = [s for s in some if s.true], [s for s in some if not s.true]

    def share(of: Sequence[Score], mark: Callable[[Score], bool]) -> list[float]:
        hits = sum(mark(s) for s in of)
        return [hits, len(of), *wilson(hits, len(of))]

    covered = [s.covered[k] for s in some for k in BASE if k in s.covered]
    return {
        "records": len(some),
        "failed": sum(s.error is not None for s in some),
        "right": share(one, lambda s: s.confirmed and s.sure_group),
        "wrong in one": share(one, lambda s: s.confirmed and not s.sure_group),
        "wrong in none": share(none, lambda s: s.confirmed),
        "clean": share(none, lambda s: s.verdict == "no_missing_effect"),
        "covered": [sum(covered), len(covered), *wilson(sum(covered), len(covered))],
    }
