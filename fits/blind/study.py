"""The declared studies: which records are made, with which seeds. Fixed before the first run.

Every condition has seeds of its own (`Condition.first` and up, less than 1000 apart).

`rows`, noise from row to row, ten conditions:
    null-white, null-ar1-0.7, null-ar1-0.9    no effect, 100 each
    one-rho0.1, -rho0.2, -rho0.5, -rho1       each effect of the generator x 10, white noise
    one-ar1-0.9                               each effect x 3 at rho 0.5, AR(1) noise of 0.9
    two                                       40 pairs of effects, each at rho 1
    outside                                   each effect x 3 at rho 1, left out of the catalogue
`measured`, noise cut from five measured records in turn (see `measured.py`), five conditions:
    null-measured                             no effect, 60
    measured-rho0.2, -rho0.5, -rho1           each effect x 5, one under the noise of each record
    outside-measured                          each effect x 3 at rho 1, left out of the catalogue
`time`, noise correlated in time, two conditions:
    null-time                                 no effect, 60
    one-time                                  each effect x 3 at rho 0.5
`wide`, records that ask more than the loop assumes (see `wide.py`), five conditions:
    null-wide                                 no effect, 60
    wide-rho0.2, -rho0.5, -rho1               each effect x 2
    law-wide                                  no effect, the ageing law, and nobody says so: 10

A study can be drawn again (`selected(draw=1)`): the same conditions with seeds that are 100,000
higher for each draw, so that what a loop was developed on need not be what it is measured on.

Plants alternate between without mass and with, samplings between uniform and thinned. The delay
plant has no version with mass. A pair of effects whose structures have a cosine beyond 0.95
in the record that is made of them is replaced by the next pair, also fixed here.

In a tenth of `rows`, plants of records without an effect are all alike (even shifts: with mass); in
the other studies they alternate within a tenth, too.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from .generate import MEASURED, PLANTS, SAMPLINGS, Request
from .measured import SOURCES
from .plants import EFFECTS

BASE_SEED = 410_000
ALIASED = 0.95
_MASSLESS = "frictional_delay"
_PAIRS_TRIED = 6
_PLACES = 100  # of conditions, in a draw: their seeds are 1000 apart


@dataclass(frozen=True)
class Condition:
    """Records of one kind. `place` sets the seeds: BASE_SEED + 1000 place, and up."""

    name: str
    place: int
    effects: int  # in a record: 0, 1 or 2
    count: int  # of records; of one effect: for each of the effects
    rho: float = 1.0
    noise: str = "white"  # "measured": that of each source in turn
    without: bool = False  # the true effect is taken out of the catalogue
    turn: int = 0  # the effect that comes first: a tenth of 5 records an effect has half of them
    mixed: bool = False  # plants and sources alternate within a tenth, too

    @property
    def first(self) -> int:
        return BASE_SEED + 1000 * self.place


CONDITIONS = (
    Condition("null-white", 0, 0, 100),
    Condition("null-ar1-0.7", 1, 0, 100, noise="ar1-0.7"),
    Condition("null-ar1-0.9", 2, 0, 100, noise="ar1-0.9"),
    Condition("one-rho0.1", 3, 1, 10, rho=0.1),
    Condition("one-rho0.2", 4, 1, 10, rho=0.2),
    Condition("one-rho0.5", 5, 1, 10, rho=0.5),
    Condition("one-rho1", 6, 1, 10, rho=1.0),
    Condition("one-ar1-0.9", 7, 1, 3, rho=0.5, noise="ar1-0.9"),
    Condition("two", 8, 2, 40, rho=1.0),
    Condition("outside", 9, 1, 3, rho=1.0, without=True),
)

STUDIES = {
    "rows": CONDITIONS,
    "measured": (
        Condition("null-measured", 20, 0, 60, noise="measured", mixed=True),
        Condition("measured-rho0.2", 21, 1, 5, rho=0.2, noise="measured", mixed=True),
        Condition("measured-rho0.5", 22, 1, 5, rho=0.5, noise="measured", mixed=True, turn=1),
        Condition("measured-rho1", 23, 1, 5, rho=1.0, noise="measured", mixed=True),
        Condition(
            "outside-measured", 24, 1, 3, rho=1.0, noise="measured", without=True, mixed=True
        ),
    ),
    "wide": (
        Condition("null-wide", 40, 0, 60, noise="wide", mixed=True),
        Condition("wide-rho0.2", 41, 1, 2, rho=0.2, noise="wide", mixed=True),
        Condition("wide-rho0.5", 42, 1, 2, rho=0.5, noise="wide", mixed=True, turn=1),
        Condition("wide-rho1", 43, 1, 2, rho=1.0, noise="wide", mixed=True, turn=2),
        Condition("law-wide", 44, 0, 10, noise="wide-law"),
    ),
    "time": (
        Condition("null-time", 30, 0, 60, noise="time", mixed=True),
        Condition("one-time", 31, 1, 3, rho=0.5, noise="time", mixed=True),
    ),
}

_SLICE = (
    ("null-white", None, 0),
    ("null-white", None, 1),
    ("null-ar1-0.9", None, 2),
    ("one-rho0.1", "viscous", 3),
    ("one-rho0.5", "slip_trend", 0),
    ("one-rho0.5", "sensor_lag", 1),
    ("one-rho1", "second_state", 0),
    ("one-rho1", "position_periodic", 1),
    ("one-rho1", "stiffness", 2),
    ("one-rho1", "thermal", 3),
    ("two", None, 0),
    ("outside", "run_in", 0),
    ("null-measured", None, 0),
    ("null-measured", None, 1),
    ("null-measured", None, 2),
    ("measured-rho0.2", "viscous", 1),
    ("measured-rho0.2", "run_in", 2),
    ("measured-rho0.5", "slip_trend", 0),
    ("measured-rho0.5", "sensor_lag", 1),
    ("measured-rho1", "second_state", 2),
    ("measured-rho1", "position_periodic", 3),
    ("measured-rho1", "stiffness", 4),
    ("measured-rho1", "thermal", 0),
    ("outside-measured", "run_in", 0),
    ("null-time", None, 0),
    ("null-time", None, 1),
    ("one-time", "servo_lag", 0),
    ("one-time", "second_state", 1),
    ("null-wide", None, 0),
    ("wide-rho0.5", "slip_trend", 0),
    ("wide-rho1", "second_state", 1),
    ("law-wide", None, 0),
)
"""Condition, effect and replicate of the slice for continuous integration."""


@dataclass(frozen=True)
class Item:
    """A record of the study. The first of `tries` that can be had is it."""

    condition: str
    index: int
    tries: tuple[Request, ...]
    without: tuple[str, ...] = ()

    @property
    def label(self) -> str:
        return f"{self.condition}/{self.index}"


def items(condition: Condition) -> tuple[Item, ...]:
    """All records of a condition; those of one effect, effect by effect.

    Replicates are rotated from effect to effect, so that every tenth record is another replicate,
    and with it another plant and sampling.
    """
    if condition.effects == 1:
        names = [*EFFECTS][condition.turn :] + [*EFFECTS][: condition.turn]
        chosen = tuple(
            ((effect,), (j + e) % condition.count)
            for e, effect in enumerate(names)
            for j in range(condition.count)
        )
        return tuple(_item(condition, i, (effects,), k) for i, (effects, k) in enumerate(chosen))
    tries = _pairs if condition.effects == 2 else lambda seed: ((),)
    every = range(condition.count)
    shown = [i + i // 10 if condition.mixed else i for i in every]
    return tuple(_item(condition, i, tries(condition.first + i), shown[i]) for i in every)


def _noise(condition: Condition, index: int, replicate: int) -> str:
    """What is asked of the generator. Each effect's replicates have a source of their own."""
    if condition.noise != "measured":
        return condition.noise
    turn = index // condition.count if condition.effects else index // 10
    sources = list(SOURCES)
    return MEASURED + sources[(2 * replicate + turn + turn // 10) % len(sources)]


def _item(condition: Condition, index: int, tries, replicate: int) -> Item:
    requests, noise = [], _noise(condition, index, replicate)
    for effects in tries:
        still = _MASSLESS in effects
        plant = PLANTS[0] if still else PLANTS[replicate % 2]
        sampling = SAMPLINGS[replicate // 2 % 2]
        seed = condition.first + index
        requests.append(Request(seed, effects, condition.rho, noise, plant, sampling))
    return Item(condition.name, index, tuple(requests), tries[0] if condition.without else ())


def _pairs(seed: int) -> tuple[tuple[str, ...], ...]:
    """Pairs of different effects to try, in order."""
    rng, names, out = np.random.default_rng(seed), list(EFFECTS), []
    while len(out) < _PAIRS_TRIED:
        i, j = sorted(rng.choice(len(names), 2, replace=False).tolist())
        pair = (names[i], names[j])
        if set(pair) != {_MASSLESS, "inertia"} and pair not in out:
            out.append(pair)
    return tuple(out)


def selected(
    *,
    share: float = 1.0,
    shift: int = 0,
    part: str | None = None,
    only: tuple[str, ...] = (),
    study: str = "rows",
    draw: int = 0,
) -> tuple[Item, ...]:
    """Records of a study: all, a share spread evenly over every condition, or a named slice.

    Shares of 1/n with shifts from 0 to n - 1 have no record in common, nor have two draws. Raises
    ValueError for a share out of (0, 1], a draw below 0, or a condition or slice that does not
    exist.
    """
    if draw < 0:
        raise ValueError(f"the draw is {draw}; it must be 0 or more")
    if not 0 < share <= 1:
        raise ValueError(f"the share is {share:g}; it must be above 0 and at most 1")
    known = {condition.name: condition for condition in STUDIES[study]}
    for name in only:
        if name not in known:
            raise ValueError(f"condition '{name}' does not exist; there are: {', '.join(known)}")
    if part not in (None, "ci"):
        raise ValueError(f"slice '{part}' does not exist; there is: ci")
    wanted = [
        replace(condition, place=condition.place + _PLACES * draw)
        for condition in STUDIES[study]
        if not only or condition.name in only
    ]
    if part == "ci":
        return tuple(i for c in wanted for i in _sliced(c))
    return tuple(i for c in wanted for i in _every(items(c), share, shift))


def _every(all_items: tuple[Item, ...], share: float, shift: int) -> Iterator[Item]:
    """Every (1/share)-th, `shift` records earlier."""
    for place, item in enumerate(all_items, start=shift):
        # a little more than the product: 0.1 * 10 must not fall short of 1
        if math.floor((place + 1) * share + 1e-9) > math.floor(place * share + 1e-9):
            yield item


def _sliced(condition: Condition) -> Iterator[Item]:
    for item in items(condition):
        for name, effect, replicate in _SLICE:
            place = item.index % condition.count
            found = effect is None or item.tries[0].effects == (effect,)
            if name == condition.name and found and place == replicate:
                yield item
