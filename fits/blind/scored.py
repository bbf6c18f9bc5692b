"""A record scored: what its loop found against its truth. Imports neither generator nor jaxfric.

What the words mean
    found         the effects that the loop added
    exact         found and true effects are the same set
    group right   as many found as true effects, and every true effect lies in the alias group
                  of a found one, each in that of another (an effect is in its own alias group)
    confirmed     the verdict is `effects` or `ambiguous`; otherwise the loop names nothing
    kind          none, one, two: that many true effects, all of them in the loop's catalogue;
                  outside: one was taken out of it; lacking: the catalogue never had it; law: the
                  law is not that of the base, and nobody said so
    failed        no loop.json: neither exact nor right, never confirmed, its error infinite
    held out      rms over select and report blocks, over the declared sigma (`true`) and over
                  that which the loop estimates (`own`)
    bias          |ln(A/truth)|, of B and L likewise, before and after

And strictly
    named         found and true effects are the same set, and that is confirmed
    sure group    the alias group of a found effect holds what the record cannot tell from it (a
                  cosine above 0.95); what a refit within 10 of BIC adds to it counts only where
                  the verdict is confirmed, which is where it is told
    report        rms over the report block alone, which is scored once, over the declared sigma

Where jaxfric's parameters are not the truth's: `expected`. A second state may come back in the
place of the first: (B, L) and (B2, L2) are then exchanged, if that is nearer, unless another
effect acts on the first state alone. For exp(-(V/Vs)^d) jaxfric holds d at 1: fs and Vs then have
no truth to cover.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import permutations
from typing import Any

CONFIRMED = ("effects", "ambiguous")
ALIKE = 0.95
NO_NAME = ("outside_catalogue", "ambiguous", "too_weak")
BASE = ("A", "B", "L")
_FIRST_STATE = {
    "ageing",
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
    sure_group: bool = False
    heldout_report: float = math.inf
    group_size: int = 0
    """Effects in the largest alias group of a found one."""
    clock: str = "row"
    """Of the noise: from row to row; "measured", cut from a record; "time", correlated in it;
    "wide": white, of the study of that name."""
    source: str | None = None
    wide: dict[str, Any] | None = None
    """Of the study `wide`: conditions of the record."""

    @property
    def noise(self) -> str:
        if self.clock != "row":
            return {"measured": "measured", "time": "in time", "wide": "wide"}[self.clock]
        return f"AR(1) {self.correlation:g}" if self.correlation else "white"

    @property
    def named(self) -> bool:
        """The true effects, and no other, are confirmed."""
        return self.confirmed and self.exact

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
    elif not truth.get("wide", {}).get("law_declared", True):
        kind = "law"
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
        "wide": conditions(truth),
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
        sure_group=group_right(true, found, loop["alias_groups"] if confirmed else alike(loop)),
        heldout_report=_or_infinite(loop["after"]["report_rms"]) / noise["sigma"],
        group_size=max((len(group) for group in loop["alias_groups"]), default=0),
        heldout_true=heldout / noise["sigma"],
        heldout_own=heldout / loop["noise"]["sigma"] if loop["noise"]["sigma"] else math.inf,
        exchanged=exchanged,
        bias_before={k: distance(before[k]["value"], truth["base"][k]) for k in BASE},
        bias_after={k: distance(after[k]["value"], wanted[k]) for k in BASE},
        covered={k: v for k, v in intervals.items() if v is not None},
        undetermined=[k for k, v in intervals.items() if v is None and k in after],
        seconds=loop["seconds"],
    )


def conditions(truth: dict) -> dict[str, Any] | None:
    """Those of a record of the study `wide`, by the names of `ranges`."""
    if (about := truth.get("wide")) is None:
        return None
    return {
        "K/K_cr": truth["stiffness_ratio"],
        "velocities": about["velocities"],
        "sigma": truth["noise"]["sigma"],
        "law": about["law"],
        "stiffness": "to 5 %" if about["stiffness_error"] else "exact",
        "load point": "in steps" if about["quantum [m]"] else "smooth",
        "sampling": truth["sampling"],
    }


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


def alike(loop: dict) -> list[list[str]]:
    """For every found effect: it, and those whose sensitivities have a cosine above `ALIKE`."""
    ids, cosines = loop["aliasing"]["ids"], loop["aliasing"].get("cosines", [])
    row = dict(zip(ids, cosines, strict=False))
    return [
        [
            one,
            *(id for id, c in zip(ids, row.get(one, ()), strict=False) if id != one and c > ALIKE),
        ]
        for one in loop["effects"]
    ]


def _or_infinite(value: float | None) -> float:
    return math.inf if value is None else value


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
    if error := truth.get("wide", {}).get("stiffness_error"):
        out["stiffness.kappa"] = error
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
