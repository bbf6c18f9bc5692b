"""Score closed loops against the truth: `python -m fits.blind.score DIR`.

Reads DIR/truth/NAME/truth.json, DIR/loops/NAME/loop.json and, for what was left out of the
catalogue and what failed, run.json; imports neither the generator nor jaxfric.

What the words mean
    found         the effects that the loop added
    exact         found and true effects are the same set
    group right   as many found as true effects, and every true effect lies in the alias group
                  of a found one, each in that of another (an effect is in its own alias group)
    confirmed     the verdict is `effects` or `ambiguous`; otherwise the loop names nothing
    kind          none, one, two: that many true effects, all of them in the loop's catalogue;
                  outside: one was taken out of it; lacking: the catalogue never had it
    failed        no loop.json: neither exact nor right, never confirmed, its error infinite
    held out      rms over select and report blocks, over the declared sigma (`true`) and over
                  that which the loop estimates (`own`)
    bias          |ln(A/truth)|, of B and L likewise, before and after

Where jaxfric's parameters are not the truth's: `expected`. A second state may come back in the
place of the first: (B, L) and (B2, L2) are then exchanged, if that is nearer, unless another
effect acts on the first state alone. For exp(-(V/Vs)^d) jaxfric holds d at 1: fs and Vs then have
no truth to cover.

Noise cut from measured records or correlated in time has numbers of its own. Intervals beside
numbers: `shares`.
"""

import argparse
import json
import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from itertools import permutations
from pathlib import Path
from typing import Any

import numpy as np

from .shares import Number, bias_ratio, percentile, quantile, share, wilson

CONFIRMED = ("effects", "ambiguous")
NO_NAME = ("outside_catalogue", "ambiguous", "too_weak")
BASE = ("A", "B", "L")
_FIRST_STATE = {
    "aging",
    "velocity_dependent_L",
    "evolution_cutoff",
    "frictional_delay",
    "normal_stress",
}
_STATES = {"B": "second_state.B2", "L": "second_state.L2"}


@dataclass(frozen=True)
class Score:
    """One record. None: does not apply, or not known."""

    name: str
    condition: str | None
    kind: str
    true: list[str]
    rho: float
    correlation: float | None
    plant: str
    sampling: str
    error: str | None
    verdict: str | None = None
    found: list[str] = field(default_factory=list)
    exact: bool = False
    group: bool = False
    confirmed: bool = False
    heldout_true: float = math.inf
    heldout_own: float = math.inf
    exchanged: bool = False
    bias_before: dict[str, float] = field(default_factory=dict)
    bias_after: dict[str, float] = field(default_factory=dict)
    covered: dict[str, bool] = field(default_factory=dict)
    undetermined: list[str] = field(default_factory=list)
    seconds: float | None = None
    clock: str = "row"
    """Of the noise: from row to row; "measured", cut from a record; "time", correlated in it."""
    source: str | None = None

    @property
    def noise(self) -> str:
        if self.clock != "row":
            return {"measured": "measured", "time": "in time"}[self.clock]
        return f"AR(1) {self.correlation:g}" if self.correlation else "white"

    @property
    def outcome(self) -> str:
        """What a reader of the verdict is told: effects by name, or why none."""
        if self.error is not None:
            return "failed"
        return "+".join(sorted(self.found)) if self.confirmed else str(self.verdict)


def score(name: str, truth: dict, loop: dict | None, run: dict | None = None) -> Score:
    """One record from the contents of its files; `loop` is None where the loop failed."""
    true, noise, run = list(truth["effects"]), truth["noise"], run or {}
    without = set(run.get("without", ()))
    kind = ("none", "one", "two")[len(true)]
    if without & set(true):
        kind = "outside"
    elif loop is not None and not set(true) <= set(loop["aliasing"]["ids"]):
        kind = "lacking"
    told: dict[str, Any] = {
        "name": name,
        "condition": run.get("condition"),
        "kind": kind,
        "true": true,
        "rho": float(truth["rho"]["wanted"]),
        "correlation": noise["correlation"],
        "clock": noise.get("kind", "row"),
        "source": noise.get("source"),
        "plant": truth["plant"],
        "sampling": truth["sampling"],
    }
    if loop is None:
        return Score(**told, error=run.get("error") or "no loop.json")
    found, confirmed = list(loop["effects"]), loop["verdict"] in CONFIRMED
    after, before = loop["after"]["parameters"], loop["before"]["parameters"]
    wanted, exchanged = states_in_place(expected(truth, loop["reference_velocity"]), after, found)
    intervals = {k: covers(after.get(k), v) for k, v in wanted.items()}
    heldout = held_out(loop)
    return Score(
        **told,
        error=None,
        verdict=loop["verdict"],
        found=found,
        exact=set(found) == set(true),
        group=group_right(true, found, loop["alias_groups"]),
        confirmed=confirmed and bool(found),
        heldout_true=heldout / noise["sigma"],
        heldout_own=heldout / loop["noise"]["sigma"] if loop["noise"]["sigma"] else math.inf,
        exchanged=exchanged,
        bias_before={k: distance(before[k]["value"], truth["base"][k]) for k in BASE},
        bias_after={k: distance(after[k]["value"], wanted[k]) for k in BASE},
        covered={k: v for k, v in intervals.items() if v is not None},
        undetermined=[k for k, v in intervals.items() if v is None and k in after],
        seconds=loop["seconds"],
    )


def group_right(true: Sequence[str], found: Sequence[str], groups: Sequence[Sequence[str]]) -> bool:
    """Every true effect in the alias group of a found effect of its own, and none found besides.

    `groups` holds the alias group of every found effect, in their order.
    """
    if len(true) != len(found) or len(groups) != len(found):
        return False
    wide = [{one, *group} for one, group in zip(found, groups, strict=True)]
    return any(
        all(one in group for one, group in zip(true, order, strict=True))
        for order in permutations(wide)
    )


def expected(truth: dict, V_ref: float) -> dict[str, float]:
    """True parameters as jaxfric has them, by its names: those of the base, then of the effects.

    The truth's reference velocity V0 is the first commanded; jaxfric's is V_ref, found in the
    record: with L (V/V0)^n, L is that at V_ref, and the heat of a_T is that at V_ref. Vc is
    1/c; lambda is `wavelength`; m and k_v count from zero, the plant's own included.
    """
    base, effects = truth["base"], truth["parameters"]
    ratio = V_ref / base["V0"]
    out = {k: float(base[k]) for k in BASE}
    out["L"] *= ratio ** effects.get("velocity_dependent_L", {}).get("n", 0.0)
    for id, values in effects.items():
        if id == "stribeck":
            continue
        for name, value in values.items():
            out[f"{id}.{name}"] = value
    if "evolution_cutoff" in effects:
        out["evolution_cutoff.c"] = 1.0 / out.pop("evolution_cutoff.Vc")
    if "position_periodic" in effects:
        out["position_periodic.wavelength"] = out.pop("position_periodic.lambda")
    if "thermal" in effects:
        out["thermal.a_T"] *= ratio
    for id, name in (("damping", "k_v"), ("inertia", "m")):
        if id in effects:
            out[f"{id}.{name}"] += base[name]
    return out


def states_in_place(
    wanted: dict[str, float], after: dict[str, dict], found: Sequence[str]
) -> tuple[dict[str, float], bool]:
    """`wanted` with the two states exchanged if the fit is nearer to that; whether they are."""
    there = _STATES["B"] in wanted and "second_state" in found
    acting = {name.split(".")[0] for name in wanted} | set(found)
    if not there or acting & _FIRST_STATE:
        return wanted, False
    other = {**wanted, **{k: wanted[v] for k, v in _STATES.items()}}
    other |= {v: wanted[k] for k, v in _STATES.items()}
    names = [*_STATES, *_STATES.values()]

    def far(some: dict[str, float]) -> float:
        return sum(distance(after[k]["value"], some[k]) for k in names)

    return (other, True) if far(other) < far(wanted) else (wanted, False)


def distance(value: float | None, truth: float) -> float:
    """|ln(value/truth)|; infinite where it is not positive."""
    return abs(math.log(value / truth)) if value is not None and value > 0 else math.inf


def covers(estimate: dict | None, truth: float) -> bool | None:
    """Whether the 95 % interval holds the truth; None without an estimate or an interval."""
    if estimate is None or estimate["lower"] is None or estimate["upper"] is None:
        return None
    return estimate["lower"] <= truth <= estimate["upper"]


def held_out(loop: dict) -> float:
    """rms after over the rows of the select and report blocks; infinite if it is not known."""
    blocks = {k: loop["blocks"][k] for k in ("select", "report")}
    rms = {k: loop["after"][f"{k}_rms"] for k in blocks}
    if any(value is None for value in rms.values()):
        return math.inf
    return math.sqrt(sum(n * rms[k] ** 2 for k, n in blocks.items()) / sum(blocks.values()))


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
    return json.loads(path.read_text(encoding="utf-8")) if path.exists() else None


# Numbers


def numbers(scores: Sequence[Score], *, missing: int = 0) -> list[Number]:
    """The numbers to reach, and what belongs beside them. `missing` records were never made."""
    clocks = {s.clock for s in scores} or {"row"}
    out = _rows_noise(scores) if "row" in clocks else []
    out += [n for clock in ("measured", "time") if clock in clocks for n in _other(scores, clock)]
    out.append(share("failed or never made", [bool(s.error) for s in scores] + [True] * missing))
    seconds = [s.seconds for s in scores if s.seconds is not None]
    out.append(quantile("seconds for a record, in the study: median", seconds, 0.5))
    return [*out, quantile("seconds for a record, in the study: 90th", seconds, 0.9)]


def _other(scores: Sequence[Score], clock: str) -> list[Number]:
    """Under noise cut from measured records, which has targets, and noise correlated in time."""
    here = [s for s in scores if s.clock == clock]
    at, aim = f"{here[0].noise}, ", clock == "measured"

    def share_of(what: str, marks, sense: str, target: float, most: float | None = None) -> Number:
        return share(at + what, marks, sense, target, most=most) if aim else share(at + what, marks)

    out, none = [], [s for s in here if s.kind == "none"]
    for text, some in (
        ("no effect", none),
        ("no effect, plant without mass", [s for s in none if s.plant == "quasi-static"]),
    ):
        clean = [s.verdict == "no_missing_effect" for s in some]
        out += [
            share_of(f"{text}: `no_missing_effect`", clean, ">=", 0.9),
            share_of(f"{text}: an effect confirmed", [s.confirmed for s in some], "<=", 0.02),
        ]
    for rho in (0.2, 0.5, 1.0):
        one, text = [s for s in here if s.kind == "one" and s.rho == rho], f"rho {rho:g}: "
        if not one and not aim:
            continue
        right, sure = [s.group for s in one], [s.confirmed for s in one if s.group]
        wrong = [s.confirmed and not s.group for s in one]
        rows = (
            (text + "alias group right", right, 0.95),
            (text + "of these, confirmed", sure, 0.9),
        )
        if rho >= 0.5:
            out += [share_of(what, marks, ">=", target) for what, marks, target in rows]
        else:
            out += [share(at + what, marks) for what, marks, _ in rows]
        out += [
            share(at + text + "exact", [s.exact for s in one]),
            share(at + text + "a wrong group confirmed", wrong),
        ]
    outside = [not s.confirmed for s in here if s.kind == "outside"]
    if outside or aim:
        out.append(share_of("effect taken out: not confirmed", outside, ">=", 0.85))
    one = [s for s in here if s.kind == "one" and s.found]
    covered = [s.covered[k] for s in one for k in BASE if k in s.covered]
    known = [s.covered[k] for s in one if s.exact for k in BASE if k in s.covered]
    text = "95 % intervals of A, B, L cover, "
    out.append(share_of(text + "extended fits", covered, ">=", 0.92, 0.98))
    out.append(share(at + text + "those of the right effect", known))
    heldout = [s.heldout_true for s in here if s.kind == "one"]
    for q, text in ((0.5, "median"), (0.9, "90th percentile")):
        out.append(quantile(f"{at}one effect: held-out rms / true sigma, {text}", heldout, q))
    return out


def _rows_noise(scores: Sequence[Score]) -> list[Number]:
    """Under noise that is white or correlated from row to row."""

    def some(kind: str, correlation: float = 0.0, rhos: tuple[float, ...] = ()) -> list[Score]:
        return [
            s
            for s in scores
            if s.kind == kind and s.correlation == correlation and (not rhos or s.rho in rhos)
        ]

    out = []
    for correlation in (0.0, 0.7, 0.9):
        none = some("none", correlation)
        noise = none[0].noise if none else f"AR(1) {correlation:g}" if correlation else "white"
        named = [s.confirmed for s in none]
        out.append(share(f"no effect, {noise}: an effect confirmed", named, "<=", 0.05))
    for rho, right, exact in ((0.2, 0.9, 0.75), (0.5, 0.97, 0.9), (1.0, 0.99, 0.95)):
        one, at = some("one", 0.0, (rho,)), f"one effect, rho {rho:g}: "
        both = [s.group and s.confirmed for s in one]
        out += [
            share(at + "alias group right", [s.group for s in one], ">=", right),
            share(at + "alias group right and confirmed", both, ">=", right),
            share(at + "exact", [s.exact for s in one], ">=", exact),
        ]
    weak, seen = some("one", 0.0, (0.1,)), some("one", 0.0, (0.2, 0.5, 1.0))
    wrong = [s.confirmed and not s.group for s in weak]
    out.append(share("rho 0.1: a wrong group confirmed", wrong, "<=", 0.05))
    out += _fits(seen)
    two, outside = some("two"), some("outside")
    colour = some("one", 0.9)
    unnamed = [s.verdict in NO_NAME for s in outside]
    out += [
        share("two effects: group set right", [s.group for s in two], ">=", 0.85),
        share("two effects: right and confirmed", [s.group and s.confirmed for s in two]),
        share("two effects: exact", [s.exact for s in two]),
        share("effect taken out: outside, ambiguous or too weak", unnamed, ">=", 0.85),
        share("one effect under AR(1) 0.9, rho 0.5: confirmed", [s.confirmed for s in colour]),
        share("the same: alias group right", [s.group for s in colour]),
        share("the same: exact", [s.exact for s in colour]),
    ]
    return out


def _fits(seen: Sequence[Score]) -> list[Number]:
    """Held-out error, bias and coverage of records of one effect, rho 0.2 and more."""
    true, own = [s.heldout_true for s in seen], [s.heldout_own for s in seen]
    one = "one effect, rho >= 0.2: "
    out = [
        quantile(one + "held-out rms / true sigma, median", true, 0.5, 1.02),
        quantile(one + "held-out rms / true sigma, 90th percentile", true, 0.9, 1.06),
        quantile(one + "held-out rms / the loop's sigma, median", own, 0.5),
        quantile(one + "held-out rms / the loop's sigma, 90th percentile", own, 0.9),
    ]
    strong = [s for s in seen if s.rho >= 0.5 and s.error is None]
    for k in BASE:
        pairs = [(s.bias_before[k], s.bias_after[k]) for s in strong]
        out.append(bias_ratio(f"one effect, rho >= 0.5: bias of {k}, after / before", pairs, 1 / 3))
    extended = [s for s in seen if s.found]
    for text, chosen in (
        ("extended fits", extended),
        ("those of the right effect", [s for s in extended if s.exact]),
    ):
        base = [s.covered[k] for s in chosen for k in BASE if k in s.covered]
        out.append(share(f"{one}95 % intervals of A, B, L cover, {text}", base, ">=", 0.88))
    own = [v for s in extended if s.exact for k, v in s.covered.items() if k not in BASE]
    return [*out, share(one + "95 % intervals of the effect's parameters cover", own)]


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
        **parts,
        "never_made": missing,
        "records": [{**asdict(s), "outcome": s.outcome} for s in scores],
    }
    text = json.dumps(_finite(content), indent=1, allow_nan=False)
    (out / "results.json").write_text(text + "\n", encoding="utf-8")
    (out / "results.md").write_text(page(scores, found, parts, missing), encoding="utf-8")
    draw(scores, out)
    return numbers_table(found)


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
    for n in found:
        unit = _percent if n.share else _plain
        goal = f"{n.sense} {unit(n.target)}" if n.target is not None else ""
        goal = f"{unit(n.target)} .. {unit(n.most)}" if n.most is not None else goal
        mark = {None: "", True: "yes", False: "**no**"}[n.reached]
        mark = "no records" if n.value is None else mark
        span = "" if n.value is None else f"{unit(n.low)} .. {unit(n.high)}"
        value = "" if n.value is None else unit(n.value)
        lines.append(f"| {n.what} | {n.of} | {value} | {span} | {goal} | {mark} |")
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
    ]
    if lacking:
        lines += [
            "",
            f"Kind `lacking`, in no number above: {', '.join(lacking)} or a pair with one of them"
            " is true, and the catalogue does not have it.",
        ]
    lines += ["", "## By condition", "", *_rows(parts["by_condition"])]
    if parts["by_source"]:
        lines += ["", "## By the record that the noise is of", "", *_rows(parts["by_source"])]
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
    figure = Figure(figsize=(15, 14), layout="constrained")
    for ax, rho in zip(figure.subplots(2, 2).flat, (0.1, 0.2, 0.5, 1.0), strict=True):
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
