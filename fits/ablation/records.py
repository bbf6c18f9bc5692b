"""The records that pieces are weighed on: drawn anew, by the generators of `fits.blind`."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fits.blind.__main__ import generated
from fits.blind.study import Item, selected

DRAW = 12
"""Draw of the blind studies: seeds that no development has seen."""
SHARES = {"rows": 0.064, "measured": 0.2, "wide": 0.13}
"""Shares of the studies: about 80, 62 and 20 records; those of `wide` take ten times as long."""
FEWER = 3
"""Pieces that need loops of their own are weighed on every third record."""


@dataclass(frozen=True)
class Record:
    """A blind record."""

    study: str
    item: Item
    place: int

    @property
    def for_all(self) -> bool:
        """Whether pieces of noise, fit and speed are taken out here, too."""
        return self.place % FEWER == 0


def blind() -> tuple[Record, ...]:
    """The records of the three studies, shuffled: a run that was stopped has some of all kinds."""
    every = [
        (study, item)
        for study, share in SHARES.items()
        for item in selected(share=share, study=study, draw=DRAW)
    ]
    order = np.random.default_rng(DRAW).permutation(len(every))
    return tuple(Record(*every[i], place=k) for k, i in enumerate(order))


def made(record: Record, out: Path) -> tuple[str, dict]:
    """Name and truth of a record, generated where it is missing."""
    name = generated(record.item, out)
    return name, json.loads((out / "truth" / name / "truth.json").read_text())
