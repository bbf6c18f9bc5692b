"""How near the terms are to what effects leave: `python -m fits.rivals.near BLIND_DIR --out DIR`.

The effect of a record is simulated once more without noise, by the generator. From what it adds
to friction, and from every term, the base's own sensitivities are projected out. Printed for each
record of one effect: the cosine of the nearest term, that of each kind's nearest term, and kinds
that are as near as four fifths of the best and do not have the effect (`terms.KINDS`): none.
"""

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from fits.blind.generate import Request, draw_plant
from fits.blind.plants import simulate
from fits.blind.study import STUDIES, items

from .base import Base, stored
from .compare import records
from .terms import KINDS, library

ALMOST = 0.8


def requests() -> dict[str, Request]:
    """All that any study asks of the generator, by the name of the record."""
    every = (i for conditions in STUDIES.values() for c in conditions for i in items(c))
    return {request.name: request for item in every for request in item.tries}


def left_by(request: Request, truth: dict) -> np.ndarray:
    """What the effects of a record add to friction, without noise."""
    for attempt in range(sum(truth["redraws"].values()) + 1):
        draw = draw_plant(request.entropy(attempt), request)
        if draw.base.f0 == truth["base"]["f0"]:
            runs = [
                simulate(draw.base, draw.protocol, effects, draw.t, stress=draw.stress)
                for effects in (truth["parameters"], {})
            ]
            return runs[0].record - runs[1].record
    raise ValueError(f"no draw of {request.name} is its truth")


def cosines(base: Base, structure: np.ndarray) -> dict[str, tuple[float, str]]:
    """For every kind: the cosine of its nearest term, and that term; the nearest kind first."""
    basis, out = np.linalg.qr(base.slopes)[0], {}
    structure = structure - basis @ (basis.T @ structure)
    for term in library(base):
        column = term.values - basis @ (basis.T @ term.values)
        size = np.linalg.norm(column) * np.linalg.norm(structure)
        if term.kind != "base" and size > 0:
            found = float(abs(column @ structure) / size)
            out[term.kind] = max(out.get(term.kind, (0.0, "")), (found, term.name))
    return dict(sorted(out.items(), key=lambda each: -each[1][0]))


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="python -m fits.rivals.near", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("folder", type=Path, help="what python -m fits.blind --out has written")
    parser.add_argument("--out", type=Path, required=True, help="that of python -m fits.rivals")
    asked = parser.parse_args(arguments)
    if not (asked.folder / "loops").is_dir():
        parser.error(f"{asked.folder} has no loops/; write it with: python -m fits.blind --out ...")
    from jaxfric.cli.common import prepare_jax

    prepare_jax()
    best, known = [], requests()
    for record in records(asked.folder)[0]:
        if len(record.truth["effects"]) != 1:
            continue
        effect = record.truth["effects"][0]
        base = stored(asked.folder, asked.out, record.name)
        found = cosines(base, left_by(known[record.name], record.truth))
        top = next(iter(found.values()))
        near = [k for k, (c, _) in found.items() if c >= ALMOST * top[0]]
        lacking = [k for k in near if effect not in KINDS[k]]
        kinds = ", ".join(f"{k} {c:.2f}" for k, (c, _) in found.items())
        print(f"{effect:20} {top[0]:.2f} {top[1]:24} lacking: {lacking or '-'}  {kinds}")
        best.append(top[0])
    told = json.dumps([round(float(q), 2) for q in np.quantile(best, (0, 0.25, 0.5, 1))])
    print(f"{len(best)} records: least, lower quartile, median, largest {told}")


if __name__ == "__main__":
    main()
