"""The numbers of a study scored strictly, each beside what the published definition gives.

What differs
    named       the true effects, no other, under a verdict that confirms them; published: *exact*,
                whatever the verdict
    right group a confirmed one; where nothing is confirmed, a group may not have grown by refits
                within 10 of BIC
    inertia     counts; published: a kind of its own, outside all numbers, of a loop that did not
                look for it
    held out    the report block alone; published: with the select block, by which models are chosen
    covered     also at rho 0.1, and of every fit; published: rho 0.2 and more, of extended fits
    no effect   for plants without and with mass apart, and `no_missing_effect` beside no false name
    taken out   `outside_catalogue` or `too_weak`; published: or `ambiguous`, which names effects
"""

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from .scored import BASE, NO_NAME, Score
from .shares import Number, quantile, share

SILENT = ("outside_catalogue", "too_weak")
AIMS = {("white", 0.2): (0.9, 0.75), ("white", 0.5): (0.97, 0.9), ("white", 1.0): (0.99, 0.95)}
"""Targets of right groups and of names, by noise and rho."""


@dataclass(frozen=True)
class Strict:
    """A number scored strictly, and by the published definition where there is one."""

    number: Number
    published: Number | None


def strict(scores: Sequence[Score]) -> list[Strict]:
    """Numbers of every noise that the study has, white first."""
    noises = sorted(Counter(s.noise for s in scores), key=lambda n: (n != "white", n))
    return [each for n in noises for each in _of([s for s in scores if s.noise == n], n)]


def _of(here: Sequence[Score], noise: str) -> Iterable[Strict]:
    """Those of one kind of noise."""
    yield from _nulls([s for s in here if s.kind == "none"], noise)
    one = [s for s in here if len(s.true) == 1 and s.kind in ("one", "lacking")]
    for rho in sorted({s.rho for s in one}):
        right, named = AIMS.get((noise, rho), (None, None))
        some, at = [s for s in one if s.rho == rho], f"{noise}, one effect, rho {rho:g}: "
        yield _marks(at + "right group, confirmed", some, _right, lambda s: s.group, right)
        yield _marks(at + "right group", some, lambda s: s.sure_group, lambda s: s.group, right)
        yield _marks(at + "named", some, lambda s: s.named, lambda s: s.exact, named)
        yield _marks(at + "a wrong name confirmed", some, _wrong, _wrong_group)
        sizes = [float(s.group_size) for s in some if s.confirmed]
        what = at + "effects in an alias group that is confirmed, 90th percentile"
        yield Strict(quantile(what, sizes, 0.9), None)
        yield from _held_out(at, some)
        yield from _covered(at, some)
    if law := [s for s in here if s.kind == "law"]:
        at = f"{noise}, ageing law, not declared: "
        yield _marks(at + "right group, confirmed", law, _right, lambda s: s.group)
        yield _marks(at + "named", law, lambda s: s.named, lambda s: s.exact)
        yield _marks(at + "a wrong name confirmed", law, _wrong, _wrong_group)
    for kind, text in (("two", "two effects"), ("outside", "effect taken out")):
        some = [s for s in here if s.kind == kind or (kind == "two" and len(s.true) == 2)]
        if some and kind == "two":
            yield _marks(
                f"{noise}, {text}: right group, confirmed", some, _right, lambda s: s.group
            )
            yield _marks(f"{noise}, {text}: named", some, lambda s: s.named, lambda s: s.exact)
        elif some:
            yield _marks(
                f"{noise}, {text}: outside or too weak",
                some,
                lambda s: s.verdict in SILENT,
                lambda s: s.verdict in NO_NAME,
                0.85,
            )


def _right(s: Score) -> bool:
    return s.sure_group and s.confirmed


def _wrong(s: Score) -> bool:
    return s.confirmed and not s.sure_group


def _wrong_group(s: Score) -> bool:
    return s.confirmed and not s.group


def _marks(
    what: str,
    some: Sequence[Score],
    strictly: Callable[[Score], bool],
    published: Callable[[Score], bool],
    target: float | None = None,
) -> Strict:
    """Shares of all records, and of those that the published definition counts."""
    sense = "" if target is None else ">="
    known = [s for s in some if s.kind != "lacking"]
    return Strict(
        share(what, [strictly(s) for s in some], sense, target),
        share(what, [published(s) for s in known]),
    )


def _nulls(none: Sequence[Score], noise: str) -> Iterable[Strict]:
    """No effect, plants without and with mass apart; the published numbers have both."""
    everyone = share("", [s.confirmed for s in none])
    for plant, text in (("quasi-static", "without mass"), ("inertial", "with mass")):
        some, at = [s for s in none if s.plant == plant], f"{noise}, no effect, {text}: "
        if some:
            clean = [s.verdict == "no_missing_effect" for s in some]
            false = share(at + "a name confirmed", [s.confirmed for s in some], "<=", 0.05)
            yield Strict(false, everyone)
            yield Strict(share(at + "`no_missing_effect`", clean), None)


def _held_out(at: str, some: Sequence[Score]) -> Iterable[Strict]:
    """rms over sigma of the report block; published: select and report block together."""
    known = [s for s in some if s.kind != "lacking"]
    for q, text, target in ((0.5, "median", 1.02), (0.9, "90th percentile", 1.06)):
        what = f"{at}held-out rms / true sigma, {text}"
        number = quantile(what, [s.heldout_report for s in some], q, target)
        yield Strict(number, quantile(what, [s.heldout_true for s in known], q))


def _covered(at: str, some: Sequence[Score]) -> Iterable[Strict]:
    """95 % intervals of A, B, L of all fits; published: of those that were extended."""

    def marks(fits: Sequence[Score]) -> list[bool]:
        return [s.covered[k] for s in fits for k in BASE if k in s.covered]

    what = at + "95 % intervals of A, B, L cover"
    extended = [s for s in some if s.found and s.kind != "lacking" and s.rho >= 0.2]
    published = share(what, marks(extended)) if extended else None
    yield Strict(share(what, marks(some), ">=", 0.88), published)
