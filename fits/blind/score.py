"""Score closed loops against the truth: `python -m fits.blind.score DIR`.

Reads DIR/truth/NAME/truth.json, DIR/loops/NAME/loop.json and, for what was left out of the
catalogue and what failed, run.json; writes results.json, results.md and confusion.*. Imports
neither the generator nor jaxfric. How a record is scored, and what the words mean: `scored`;
numbers and their targets: `aims`; the same numbers, scored strictly: `strict`; where the loop
breaks on records of the study `wide`: `ranges`.
"""

import argparse
import json
import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from .aims import numbers
from .ranges import RANGES, by_range
from .scored import BASE, Score, score
from .shares import Number, percentile, wilson
from .strict import Strict, strict


def read(out: Path) -> list[Score]:
    """Scores of all records of which the loop was tried, by name."""
    scores = []
    for folder in sorted((out / "loops").iterdir()) if (out / "loops").exists() else ():
        truth = _load(out / "truth" / folder.name / "truth.json")
        loop, run = _load(folder / "loop.json"), _load(folder / "run.json")
        if truth is not None and (loop is not None or run is not None):
            scores.append(score(folder.name, truth, loop, run))
    return scores


def never_made(out: Path) -> list[str]:
    """Why records could not be generated: errors of runs without a truth."""
    runs = sorted((out / "loops").glob("*/run.json"))
    missing = [r for r in runs if not (out / "truth" / r.parent.name / "truth.json").exists()]
    return [str((_load(run) or {}).get("error")) for run in missing]


def _load(path: Path) -> dict | None:
    """Older files have `ageing` by the id that it had."""
    if not path.exists():
        return None
    return json.loads(path.read_text(encoding="utf-8").replace('"aging', '"ageing'))


def tables(scores: Sequence[Score]) -> dict[str, list[dict]]:
    """Aggregates by condition and by effect, and truth against found."""

    def grouped(key: Callable[[Score], tuple], names: tuple[str, ...], chosen) -> list[dict]:
        rows: dict[tuple, list[Score]] = {}
        for s in chosen:
            rows.setdefault(key(s), []).append(s)
        return [
            {**dict(zip(names, k, strict=True)), **_summary(rows[k])} for k in sorted(rows, key=str)
        ]

    shown = main_noise(scores)
    one = [s for s in scores if s.kind in ("one", "lacking") and s.noise == shown]
    strong = [s for s in one if s.rho >= 0.2]
    return {
        "by_condition": grouped(
            lambda s: (s.kind, s.rho, s.noise, s.plant),
            ("kind", "rho", "noise", "plant"),
            scores,
        ),
        "by_source": grouped(
            lambda s: (s.kind, s.rho, s.source),
            ("kind", "rho", "source"),
            [s for s in scores if s.source is not None],
        ),
        "by_range": by_range(scores),
        "by_effect": grouped(
            lambda s: ("+".join(s.true), s.kind), ("effect", "kind"), [s for s in strong if s.true]
        ),
        "confusion": [
            {"kind": k, "rho": rho, "noise": noise, "truth": true, "found": dict(counts)}
            for (k, rho, noise, true), counts in _confusion(scores).items()
        ],
    }


def main_noise(scores: Sequence[Score]) -> str:
    """The noise of most records of the study, white where there is any."""
    kinds = Counter(s.noise for s in scores)
    return "white" if kinds["white"] or not kinds else kinds.most_common(1)[0][0]


def _summary(rows: Sequence[Score]) -> dict:
    marks = {
        "exact": [s.exact for s in rows],
        "group_right": [s.group for s in rows],
        "confirmed": [s.confirmed for s in rows],
        "wrong_confirmed": [s.confirmed and not s.group for s in rows],
    }
    base = [s.covered[k] for s in rows for k in BASE if k in s.covered]
    shares = {k: [sum(m), len(m), *wilson(sum(m), len(m))] for k, m in marks.items()}
    return {
        "records": len(rows),
        "failed": sum(s.error is not None for s in rows),
        **shares,
        "heldout_median": percentile([s.heldout_true for s in rows], 0.5),
        "covered": [sum(base), len(base), *wilson(sum(base), len(base))],
    }


def _confusion(scores: Sequence[Score]) -> dict[tuple, Counter]:
    out: dict[tuple, Counter] = {}
    for s in scores:
        key = (s.kind, s.rho, s.noise, "+".join(sorted(s.true)) or "none")
        out.setdefault(key, Counter())[s.outcome] += 1
    return dict(sorted(out.items()))


# Output


def publish(out: Path) -> str:
    """Score what is in `out`; write results.json, results.md, confusion.*; the table of numbers."""
    scores, missing = read(out), never_made(out)
    found, parts = numbers(scores, missing=len(missing)), tables(scores)
    content = {
        "schema": "jaxfric.blind-results/1",
        "numbers": [{**asdict(n), "reached": n.reached} for n in found],
        "strict": [_both(each) for each in strict(scores)],
        **parts,
        "never_made": missing,
        "records": [{**asdict(s), "outcome": s.outcome} for s in scores],
    }
    text = json.dumps(_finite(content), indent=1, allow_nan=False)
    (out / "results.json").write_text(text + "\n", encoding="utf-8")
    (out / "results.md").write_text(page(scores, found, parts, missing), encoding="utf-8")
    draw(scores, out)
    return numbers_table(found)


def _both(each: Strict) -> dict:
    """A strict number, and the published one beside it."""
    published = each.published
    return {
        **asdict(each.number),
        "reached": each.number.reached,
        "published": published and {"value": published.value, "of": published.of},
    }


def _finite(value: Any) -> Any:
    """The same for JSON: null for what is not finite."""
    if isinstance(value, dict):
        return {k: _finite(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(v) for v in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def numbers_table(found: Sequence[Number]) -> str:
    """Numbers beside targets, in Markdown."""
    lines = ["| number | of | value | 95 % | target | reached |", "|---|---|---|---|---|---|"]
    return "\n".join([*lines, *(f"{_cells(n)} |" for n in found)])


def _cells(n: Number) -> str:
    """A number in a row of a table: what, of, value, interval, target, whether it is reached."""
    unit = _percent if n.share else _plain
    goal = f"{n.sense} {unit(n.target)}" if n.target is not None else ""
    goal = f"{unit(n.target)} .. {unit(n.most)}" if n.most is not None else goal
    mark = {None: "", True: "yes", False: "**no**"}[n.reached]
    mark = "no records" if n.value is None else mark
    span = "" if n.value is None else f"{unit(n.low)} .. {unit(n.high)}"
    return f"| {n.what} | {n.of} | {unit(n.value)} | {span} | {goal} | {mark}"


def strict_table(found: Sequence[Strict]) -> str:
    """Strict numbers, and the published ones where they differ, in Markdown."""
    lines = [
        "| number, strictly | of | value | 95 % | target | reached | published |",
        "|---|---|---|---|---|---|---|",
    ]
    for each in found:
        number, old, text = each.number, each.published, ""
        if old is not None and (old.of, old.value) != (number.of, number.value):
            text = f"{(_percent if old.share else _plain)(old.value)} ({old.of})"
        lines.append(f"{_cells(number)} | {text} |")
    return "\n".join(lines)


def _percent(x: float | None) -> str:
    return "" if x is None else f"{100 * x:.1f} %"


def _plain(x: float | None) -> str:
    return "" if x is None else f"{x:.3f}"


def page(scores, found: Sequence[Number], parts: dict[str, list[dict]], missing) -> str:
    """The results as a page."""
    kinds, failed = Counter(s.kind for s in scores), [s for s in scores if s.error is not None]
    made = ", ".join(f"{k} {n}" for k, n in sorted(kinds.items()))
    reached = [bool(n.reached) for n in found if n.reached is not None]
    lacking = sorted({e for s in scores if s.kind == "lacking" for e in s.true})
    lines = [
        "# Blind records: what the loop found in them",
        "",
        f"{len(scores)} synthetic records ({made});"
        f" {sum(reached)} of {len(reached)} targets reached, {len(failed)} records failed,"
        f" {len(missing)} could not be made. How a record is scored: `score.py`.",
        "",
        numbers_table(found),
        "",
        "Intervals of one record are not independent, so those of coverage are too narrow.",
        "",
        "## Strictly",
        "",
        "What differs from the numbers above: `strict.py`. Where nothing stands under `published`,"
        " both are the same or only this one is there.",
        "",
        strict_table(strict(scores)),
    ]
    if lacking:
        lines += [
            "",
            f"Kind `lacking`, above in the strict numbers alone: {', '.join(lacking)} or a pair"
            " with one of them is true, and the catalogue does not have it.",
        ]
    lines += ["", "## By condition", "", *_rows(parts["by_condition"])]
    if parts["by_source"]:
        lines += ["", "## By the record that the noise is of", "", *_rows(parts["by_source"])]
    if parts["by_range"]:
        lines += ["", "## By what a record asks", "", RANGES, "", *_rows(parts["by_range"])]
    about = f"{main_noise(scores)} noise"
    lines += ["", f"## By effect ({about}, rho >= 0.2)", "", *_rows(parts["by_effect"])]
    lines += ["", "## Truth and what was found", "", "![confusion](confusion.png)", ""]
    for row in parts["confusion"]:
        counts = ", ".join(f"{what} {n}" for what, n in Counter(row["found"]).most_common())
        asked = f" rho {row['rho']:g}," if row["rho"] else ""
        lines.append(f"- {row['kind']},{asked} {row['noise']}, **{row['truth']}**: {counts}")
    if failed or missing:
        lines += ["", "## Failures", ""]
        why = Counter((s.error or "").strip().splitlines()[-1] for s in failed) + Counter(missing)
        lines += [f"- {n} x {text}" for text, n in why.most_common()]
    return "\n".join(lines) + "\n"


def _rows(table: Sequence[dict]) -> list[str]:
    """A table of aggregates in Markdown."""
    if not table:
        return ["No records."]
    names = list(table[0])
    lines = ["| " + " | ".join(names).replace("_", " ") + " |", "|---" * len(names) + "|"]
    for row in table:
        cells = []
        for value in row.values():
            if isinstance(value, list):
                k, n, low, high = value
                cells.append(f"{k}/{n} ({100 * low:.0f}-{100 * high:.0f} %)" if n else "-")
            else:
                cells.append(f"{value:.3g}" if isinstance(value, float) else str(value))
        lines.append("| " + " | ".join(cells) + " |")
    return lines


def draw(scores: Sequence[Score], out: Path) -> None:
    """confusion.png and .svg: truth (rows) against what was confirmed (columns), `main_noise`."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    shown = [s for s in scores if s.noise == main_noise(scores)]
    shown = [s for s in shown if s.kind in ("none", "one", "lacking")]
    rows = ["none", *sorted({e for s in shown for e in s.true if len(s.true) == 1})]
    silent = ["no_missing_effect", "too_weak", "outside_catalogue", "failed"]
    named = sorted({s.outcome for s in shown} - set(silent))
    columns = [*(e for e in rows[1:] if e in named), *(e for e in named if e not in rows)]
    columns = [*(e for e in columns if "+" not in e), "several", *silent]
    rhos = sorted({s.rho for s in shown if len(s.true) == 1}) or [0.0]
    down = -(-len(rhos) // 2)
    figure = Figure(figsize=(15, 7 * down), layout="constrained")
    panels = figure.subplots(down, 2, squeeze=False).ravel()
    for ax in panels[len(rhos) :]:
        ax.set_axis_off()
    for ax, rho in zip(panels, rhos, strict=False):
        table = np.zeros((len(rows), len(columns)), dtype=int)
        for s in shown:
            if len(s.true) < 2 and (not s.true or s.rho == rho):
                what = "several" if "+" in s.outcome else s.outcome
                table[rows.index(s.true[0] if s.true else "none"), columns.index(what)] += 1
        part = table / np.maximum(table.sum(axis=1, keepdims=True), 1)
        ax.imshow(part, cmap="Blues", vmin=0, vmax=1, aspect="auto")
        for i, j in zip(*np.nonzero(table), strict=True):
            ink = "white" if part[i, j] > 0.5 else "black"
            ax.text(j, i, str(table[i, j]), ha="center", va="center", fontsize=7, color=ink)
        ax.set_xticks(range(len(columns)), columns, rotation=90, fontsize=7)
        ax.set_yticks(range(len(rows)), rows, fontsize=7)
        ax.axvline(len(columns) - len(silent) - 0.5, color="0.6", lw=0.8)
        ax.set_title(f"rho = {rho:g} (and no effect)", fontsize=9)
        ax.set_xlabel("confirmed, or the verdict", fontsize=8)
        ax.set_ylabel("truth", fontsize=8)
    with rc_context({"svg.hashsalt": "confusion"}):
        figure.savefig(out / "confusion.svg", metadata={"Date": None})
    figure.savefig(out / "confusion.png", dpi=110)


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="python -m fits.blind.score", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("out", type=Path, help="folder of the study")
    print(publish(parser.parse_args(arguments).out))


if __name__ == "__main__":
    main()
