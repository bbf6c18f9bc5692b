"""The numbers to reach, as they were declared: shares and percentiles beside their targets."""

from collections.abc import Sequence

from .scored import BASE, NO_NAME, Score
from .shares import Number, bias_ratio, quantile, share


def numbers(scores: Sequence[Score], *, missing: int = 0) -> list[Number]:
    """The numbers to reach, and what belongs beside them. `missing` records were never made."""
    clocks = {s.clock for s in scores} or {"row"}
    out = _rows_noise(scores) if "row" in clocks else []
    out += [
        n
        for clock in ("measured", "time", "wide")
        if clock in clocks
        for n in _other(scores, clock)
    ]
    out.append(share("failed or never made", [bool(s.error) for s in scores] + [True] * missing))
    seconds = [s.seconds for s in scores if s.seconds is not None]
    out.append(quantile("seconds for a record, in the study: median", seconds, 0.5))
    return [*out, quantile("seconds for a record, in the study: 90th", seconds, 0.9)]


def _other(scores: Sequence[Score], clock: str) -> list[Number]:
    """Under noise cut from measured records, which has targets, in time, and of `wide`."""
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
