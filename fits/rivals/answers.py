"""From a rival's surviving terms to names, in the form that the blind study's scorer reads.

A rival ends with a formula for what the base leaves. Each of its terms is a claim: a set of effects
of which the term could be the sign (`terms.KINDS`, and what the record cannot tell from them).
`fewest` gives the fewest names that explain all claims. Everything is scored by `fits.blind`.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from fits.blind.scored import ALIKE

from .base import Base
from .terms import KINDS

RULES = ("lowest", "margin", "bic")
MARGIN = 10.0
_FELT = 0.05


class Claim(NamedTuple):
    """A term of a formula."""

    term: str
    kinds: tuple[str, ...]
    weight: float
    """rms of its part of the train block about its mean, over that of what the base leaves."""

    @property
    def effects(self) -> frozenset[str]:
        return frozenset(effect for kind in self.kinds for effect in KINDS[kind])


class Formula(NamedTuple):
    """One of the formulas that a rival offers; none of them: nothing is missing."""

    claims: tuple[Claim, ...]
    left: np.ndarray
    """What base and formula leave of all rows."""
    size: int
    """Fitted numbers: what it costs under a margin."""


def nothing(base: Base) -> Formula:
    return Formula((), base.residual, 0)


def chosen(base: Base, offers: Sequence[Formula], rule: str) -> Formula:
    """The formula that a rival ends with, by one of `RULES`.

    lowest : the one that predicts the select block best, and none if none predicts it better
    margin : the lowest n ln(mean square) + size ln n over the n rows of the select block, and
        none unless that falls by more than `MARGIN`
    bic : the same over train and select block, as a loop's BIC has it, for white noise
    """
    plain = nothing(base)

    def cost(formula: Formula) -> float:
        total, rows = 0.0, 0
        for block in ("train", "select") if rule == "bic" else ("select",):
            error, n = base.rms(formula.left, block), int(base.rows(block).sum())
            if not math.isfinite(error):
                return math.inf
            total, rows = total + n * math.log(error**2), rows + n
        return total + (formula.size * math.log(rows) if rule != "lowest" else 0.0)

    best = min([plain, *offers], key=cost)
    asked = 0.0 if rule == "lowest" else MARGIN
    return best if cost(plain) - cost(best) > asked else plain


def weight(base: Base, part: np.ndarray) -> float:
    """Of a term's part of the prediction, see `Claim`."""
    train = base.rows("train")
    return float(np.std(part[train])) / base.rms(base.residual, "train")


def spoken(formula: Formula) -> list[Claim]:
    """Claims that name something, the strongest first.

    Left out: what the base has already, and what is below a twentieth of what the base leaves.
    """
    said = [c for c in formula.claims if c.effects and c.weight > _FELT]
    return sorted(said, key=lambda c: -c.weight)


def widened(effects: frozenset[str], aliasing: dict) -> frozenset[str]:
    """The effects and all whose sensitivity in this record has a cosine above `ALIKE` to one's."""
    ids, out = aliasing["ids"], set(effects)
    for id, row in zip(ids, aliasing.get("cosines", ()), strict=False):
        if id in effects:
            out |= {other for other, c in zip(ids, row, strict=False) if c > ALIKE}
    return frozenset(out)


def fewest(claims: Sequence[frozenset[str]]) -> list[tuple[str, list[str]]]:
    """Names that explain all claims, each with all effects that could stand in its place.

    Greedy: the effect that explains most of what is unexplained comes first.
    """
    out, todo = [], list(claims)
    while todo:
        every = sorted(frozenset().union(*todo))
        best = max(every, key=lambda e: sum(e in claim for claim in todo))
        mine = [claim for claim in todo if best in claim]
        todo = [claim for claim in todo if best not in claim]
        out.append((best, sorted(frozenset.intersection(*mine))))
    return out


def as_loop(loop: dict, claims: Sequence[Claim], rms: dict[str, float], seconds: float) -> dict:
    """A rival's answer as the scorer reads a loop. Its A, B and L are the base's.

    `loop` is ours of the same record: the base, the noise and the aliases are taken from it.
    """
    names = fewest([widened(c.effects, loop["aliasing"]) for c in claims])
    found = [name for name, _ in names]
    unknown = {"value": None, "lower": None, "upper": None}
    parameters = dict(loop["before"]["parameters"])
    parameters |= {f"second_state.{k}": unknown for k in ("B2", "L2") if "second_state" in found}
    return {
        **{k: loop[k] for k in ("aliasing", "before", "blocks", "noise", "reference_velocity")},
        "verdict": "effects" if found else "no_missing_effect",
        "effects": found,
        "alias_groups": [group for _, group in names],
        "after": {"parameters": parameters, **{f"{k}_rms": v for k, v in rms.items()}},
        "seconds": seconds,
    }
