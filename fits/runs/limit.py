"""How many hidden effects could be named: `python -m fits.runs.limit [--seeds 1000 1030]`.

The runs of `fits.runs.effects`, and a loop that knows all but the sizes: the shape s of what is
hidden, to first order, those of A, B, L and the levels, and the covariance C of the noise. Against
the noise s has the size d, d^2 = s^T (C^-1 - C^-1 J (J^T C^-1 J)^-1 J^T C^-1) s with J the other
shapes. 2 ln L rises by the square of a normal number of mean d and variance 1; the effect is taken
where that is more than 10 + p ln n, n the independent rows and p its parameters, as the loop asks.

C has what the noise of a friction record can be told to have: a white part, and one that is
forgotten within a tenth of a velocity, both as likely as can be for 60 pieces of the source. (The
pieces have no part that is slower than 300 rows, since a local quadratic was taken from them, and
so an effect that is slow would stand out of them without limit. No record promises that.)

Told for all rows, and for the rows that the loop fits: the others are held out, for a test of what
is named. `effects.json` says how many the loop named, `limit.json` has the chances.
"""

import argparse
import json
import os
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
from scipy.linalg import cho_factor, cho_solve, toeplitz
from scipy.stats import norm

from fits.blind import measured
from fits.blind.draws import SIGMA
from fits.blind.plants import Protocol
from fits.runs.effects import EFFECTS, NOISES, Planted, group, phase_of, planted
from jaxfric.loop.split import split_units
from jaxfric.loop.thresholds import ACCEPT

HERE = Path(__file__).parent
PARAMETERS = dict(zip(EFFECTS, (2, 1, 2, 1, 1), strict=False))
_ROWS, _PIECES = 200, 60
# up to a tenth of the rows of a velocity: of 14 two are holds, with fewer rows
_MEMORIES = np.geomspace(1.0, 0.1 * 12 / 14 * _ROWS, 14)
_SHARES = np.linspace(0.05, 0.98, 20)


def covariance(rows: int, share: float, memory: float) -> np.ndarray:
    """Of noise of variance 1, a `share` of which is forgotten over `memory` rows."""
    falls = share * np.exp(-np.arange(rows) / memory)
    falls[0] = 1.0
    return toeplitz(falls)


def likeliest(source: str) -> tuple[float, float]:
    """Share and memory of the noise of a source, each of its pieces of a size of its own."""
    if source == "white":
        return 0.0, 1.0
    rng = np.random.default_rng(1)
    pieces = np.stack([measured.cut(source, [_ROWS], rng) for _ in range(_PIECES)], axis=1)
    found = []
    for memory in _MEMORIES:
        for share in _SHARES:
            root = np.linalg.cholesky(covariance(_ROWS, share, memory))
            squares = np.mean(np.linalg.solve(root, pieces) ** 2, axis=0)
            value = -0.5 * _ROWS * np.log(squares).sum() - _PIECES * np.log(np.diag(root)).sum()
            found.append((value, share, memory))
    return max(found)[1:]


def size(run: Planted, noise: tuple[float, float], used: np.ndarray) -> float:
    """d^2 of what is hidden in the rows `used`."""
    assert run.refit is not None
    hidden = (run.path.record - run.refit.clean) / SIGMA
    shapes = np.column_stack([hidden, run.refit.basis])[used]
    phase, products = phase_of(run.plant)[used], np.zeros((shapes.shape[1],) * 2)
    for one in np.unique(phase):
        here = shapes[phase == one]
        products += here.T @ cho_solve(cho_factor(covariance(len(here), *noise)), here)
    felt = np.linalg.norm(shapes[:, 1:], axis=0) > 0
    others = products[1:, 1:][np.ix_(felt, felt)]
    beside = products[0, 1:][felt]
    return float(max(products[0, 0] - beside @ np.linalg.lstsq(others, beside)[0], 0.0))


def fitted_rows(run: Planted) -> np.ndarray:
    """The rows (bool) of a run that the loop fits."""
    protocol: Protocol = run.plant.protocol
    unit, number = [], -1
    for k in range(len(protocol.velocities)):
        begins = k not in (0, *run.firsts)
        reload = k > 0 and protocol.velocities[k - 1] == 0
        number += begins and not reload
        unit.append(number if begins else -1)
    speeds = np.abs(np.array(protocol.velocities))
    return split_units(run.plant.t, phase_of(run.plant), np.array(unit), speeds, "a run").train


def chance(task: tuple[str, int, tuple[float, float]]) -> dict:
    """Chances that an effect is taken: from all rows, and from those that are fitted."""
    effect, seed, noise = task
    run, _ = planted(effect, seed)
    out = {"effect": effect, "seed": seed, "noise": NOISES[seed % len(NOISES)]}
    share, memory = noise
    for name, used in (("all", np.ones(len(run.plant.t), bool)), ("fitted", fitted_rows(run))):
        independent = used.sum() / (1 + 2 * share * memory)
        asked = ACCEPT + PARAMETERS[effect] * np.log(independent)
        d = np.sqrt(size(run, noise, used))
        out[name] = round(float(norm.cdf(d - np.sqrt(asked))), 4)
    return out


def told(rows: list[dict], done: dict) -> str:
    """A line for each noise: sums of the chances, and how many the loop named."""
    lines = ["noise        runs  from all rows  from the fitted  named by the loop"]
    for noise in (*NOISES, ""):
        own = [row for row in rows if row["noise"] == noise or not noise]
        named = [group(done[_key(row)]) for row in own if _key(row) in done]
        most, fitted = (sum(row[name] for row in own) for name in ("all", "fitted"))
        lines.append(
            f"{noise or 'together':12} {len(own):4d} {most:14.1f} {fitted:16.1f}"
            f" {sum(named):11d} of {len(named)}"
        )
    return "\n".join(lines)


def _key(row: dict) -> tuple[str, int]:
    return row["effect"], row["seed"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", nargs=2, type=int, default=(1000, 1030), metavar=("FROM", "TO"))
    parser.add_argument("--cores", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--out", type=Path, default=HERE / "limit.json")
    given = parser.parse_args()
    noises = {source: likeliest(source) for source in NOISES}
    for source, (share, memory) in noises.items():
        print(f"{source}: {100 * share:.0f} % of the variance is forgotten over {memory:.1f} rows")
    seeds = range(*given.seeds)
    tasks = [(e, s, noises[NOISES[s % len(NOISES)]]) for e in PARAMETERS for s in seeds]
    with ProcessPoolExecutor(given.cores) as pool:
        rows = list(pool.map(chance, tasks))
    given.out.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    kept = json.loads((HERE / "effects.json").read_text(encoding="utf-8"))
    print(told(rows, {_key(row): row for row in kept}))


if __name__ == "__main__":
    main()
