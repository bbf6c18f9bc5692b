"""Rivals and our loop side by side, scored by `fits.blind`; all from files.

What a row of the table tells, of records with one effect unless it says otherwise
    named on nothing   of records without an effect: those where something is named
    right              one name explains all that is named, and the true effect is in its group
    by width           how many would be right if the same numbers of effects were drawn by lot
    first right        right, where only the strongest term counts (of a loop: all its names)
    any right          right, where any single term counts
    wrong              something is named, and it is not `right`
    stands for         effects in the group of a name: median, and largest
    held out           rms of the report block over the noise's true one: median, 90th percentile
    ours lower         records whose report block our loop predicts with a smaller error
"""

import json
import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from fits.blind.plants import EFFECTS
from fits.blind.scored import CONFIRMED, Score, group_right, score
from fits.blind.shares import percentile

from .answers import RULES, Claim, as_loop
from .terms import KINDS

RIVALS = {"stlsq": "PySINDy, STLSQ", "frols": "PySINDy, FROLS", "operon": "pyoperon"}
HOW = {"lowest": "lowest error", "margin": "by 10 on held-out rows", "bic": "by 10 of BIC"}
OURS, ALONE = "`jaxfric loop`", "the base alone"


class Known(NamedTuple):
    """What is known of a record of a blind run."""

    name: str
    truth: dict
    loop: dict
    run: dict


class Marks(NamedTuple):
    """An answer scored three ways."""

    all: Score
    first: Score
    any: bool
    groups: list[int]


def records(folder: Path) -> tuple[list[Known], dict[str, int]]:
    """Records to compare on, and how many are left out and why.

    Left out: a loop that failed, which tells no base; an effect taken out of the loop's catalogue,
    which a rival's library has no counterpart of.
    """
    out, lost = [], {"loop failed": 0, "effect taken out": 0}
    for place in sorted((folder / "loops").iterdir()):
        run = _load(place / "run.json") or {}
        loop, truth = (
            _load(place / "loop.json"),
            _load(folder / "truth" / place.name / "truth.json"),
        )
        if run.get("without"):
            lost["effect taken out"] += 1
        elif loop is None or truth is None:
            lost["loop failed"] += 1
        else:
            out.append(Known(place.name, truth, loop, run))
    return out, lost


def _load(path: Path) -> dict | None:
    return json.loads(path.read_text(encoding="utf-8")) if path.exists() else None


def marks(known: Known, answer: Callable[[Sequence[Claim]], dict], claims) -> Marks:
    """An answer's scores; `answer` gives it as a loop, from all or some of the claims."""

    def judged(some: Sequence[Claim]) -> Score:
        return score(known.name, known.truth, answer(some), known.run)

    return Marks(
        judged(claims),
        judged(claims[:1]),
        any(_right(judged([claim])) for claim in claims),
        [len(group) for group in answer(claims)["alias_groups"]],
    )


def everyone(known: Sequence[Known], answers: dict[str, dict]) -> Iterator[tuple[str, list[Marks]]]:
    """Who, and the marks of all records."""
    yield OURS, [_ours(k) for k in known]
    for rival, title in RIVALS.items():
        for rule in RULES:
            some = [(k, answers[k.name][rival]) for k in known]
            yield f"{title}, {HOW[rule]}", [_rival(k, told, rule) for k, told in some]
    kind = commonest(known)
    yield f"always `{kind}`", [_constant(k, kind) for k in known]
    yield ALONE, [_constant(k, "base") for k in known]


def _ours(known: Known) -> Marks:
    confirmed = known.loop["verdict"] in CONFIRMED
    found = score(known.name, known.truth, known.loop, known.run)
    names = list(zip(known.loop["effects"], known.loop["alias_groups"], strict=True))
    names = names if confirmed else []
    right = any(group_right(known.truth["effects"], [n], [group]) for n, group in names)
    return Marks(found, found, right, [len(group) for _, group in names])


def _rival(known: Known, told: dict, rule: str) -> Marks:
    said = told["rules"][rule]
    claims = [Claim(term, tuple(kinds), weight) for term, kinds, weight in said["claims"]]

    def answer(some):
        return as_loop(known.loop, some, said["rms"], told["seconds"])

    return marks(known, answer, claims)


def _constant(known: Known, kind: str) -> Marks:
    """Whoever always answers the same; `base`: nothing."""
    rms = {block: known.loop["before"][f"{block}_rms"] for block in ("train", "select", "report")}
    claims = [Claim(kind, (kind,), 1.0)] if KINDS[kind] else []
    return marks(known, lambda some: as_loop(known.loop, some, rms, 0.0), claims)


def commonest(known: Sequence[Known]) -> str:
    """The kind that is right most often if it is always answered."""
    return max(KINDS, key=lambda kind: sum(_right(_constant(k, kind).all) for k in known))


def _right(s: Score) -> bool:
    return s.confirmed and s.sure_group


def summary(who: str, all_marks: Sequence[Marks], ours: Sequence[Marks]) -> dict[str, Any]:
    """A row of the table: counts as [k, n]. `ours` are our marks of the same records."""
    none = [m.all for m in all_marks if m.all.kind == "none"]
    one = [m for m in all_marks if m.all.kind in ("one", "lacking")]
    rhos = sorted({m.all.rho for m in one})
    groups = [float(n) for m in one for n in m.groups]
    errors = [m.all.heldout_report for m in one]
    ours_errors = [m.all.heldout_report for m in ours if m.all.kind in ("one", "lacking")]
    lots = [m.groups[0] / len(EFFECTS) for m in one if len(m.groups) == 1]
    seconds = [m.all.seconds for m in all_marks if m.all.seconds]
    return {
        "who": who,
        "named on nothing": [sum(s.confirmed for s in none), len(none)],
        "right": {
            f"{rho:g}": _count(_right(m.all) for m in one if m.all.rho == rho) for rho in rhos
        },
        "all right": _count(_right(m.all) for m in one),
        "by width": sum(lots),
        "first right": _count(_right(m.first) for m in one),
        "any right": _count(m.any for m in one),
        "wrong": _count(m.all.confirmed and not _right(m.all) for m in one),
        "stands for": [percentile(groups, 0.5), max(groups)] if groups else None,
        "held out": [percentile(errors, q) for q in (0.5, 0.9)] if errors else None,
        "ours lower": _count(o < e for o, e in zip(ours_errors, errors, strict=True)),
        "seconds": percentile(seconds, 0.5) if seconds else None,
    }


def outcome(who: str, m: Marks) -> dict[str, Any]:
    """One answer to one record, for JSON."""
    s = m.all
    return {
        "who": who,
        "name": s.name,
        "true": s.true,
        "rho": s.rho,
        "named": s.found if s.confirmed else [],
        "right": _right(s),
        "held_out": s.heldout_report,
    }


def _count(those) -> list[int]:
    found = [bool(each) for each in those]
    return [sum(found), len(found)]


def table(rows: Sequence[dict]) -> str:
    """The rows in Markdown."""
    rhos = list(rows[0]["right"])
    titles = ["", "named on nothing", *(f"right, rho {rho}" for rho in rhos), "all", "by width"]
    titles += ["first right", "any right", "wrong", "stands for", "held out", "ours lower"]
    lines = ["| " + " | ".join(titles) + " |", "|---" * len(titles) + "|"]
    for row in rows:
        first = [row["named on nothing"], *row["right"].values(), row["all right"]]
        last = [row[k] for k in ("first right", "any right", "wrong")]
        size, error = row["stands for"], row["held out"]
        cells = [
            row["who"],
            *map(_share, first),
            f"{row['by width']:.1f}",
            *map(_share, last),
            f"{size[0]:.0f}, {size[1]:.0f}" if size else "",
            ", ".join("inf" if e is None else f"{e:.3f}" for e in error or ()),
            _share(row["ours lower"]),
        ]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _share(count: Sequence[int]) -> str:
    return f"{count[0]}/{count[1]}"


def finite(value: Any) -> Any:
    """The same for JSON: null for what is not finite."""
    if isinstance(value, dict):
        return {k: finite(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [finite(v) for v in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
