"""Which rows of a record decide the gains: `python -m fits.which_rows [--out FOLDER]`.

The chain is record -> fit -> law -> gains, and JAX differentiates all of it at once:

    f (n rows) -> z*(f), least squares -> (A, B, L) -> (k_p, k_v), the smallest gains that hold

By the implicit function theorem at both optima; no fit is made again. The figure has the record
and, above it, by how much each gain changes when one row is higher by its noise. The derivatives
of a few rows are compared with fits that are made again.
"""

import argparse
import dataclasses
import json
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from jax import Array

import jaxfric
from jaxfric.fitting import minimise
from jaxfric.fitting.problem import Problem

HERE = Path(__file__).parent
RECORD = HERE.parents[1] / "data" / "velocity_step.csv"
STIFFNESS = "5e-3/um"
VELOCITIES = np.array([1e-6, 1e-5, 1e-4])
REQUIREMENT = {"modulus": 0.5}
MOVED = 1e-3
"""By how much a row is moved for a refit [friction]: the solver's error does not count there."""
COLOURS = {"k_p": "#c1440e", "k_v": "#1f5c99"}


def gains_of(problem: Problem, z: Array, friction: Array) -> Array:
    """(k_p [1/m], k_v [s/m]) of the law that fits the rows `friction` (n,); `z` is a start."""
    found = minimise(dataclasses.replace(problem, friction=friction), z, rtol=1e-6)
    law = problem.rig(found.value).friction
    best = jaxfric.minimum_gains(law, VELOCITIES, None, REQUIREMENT)
    return jnp.stack([best.k_p, best.k_v])


class Sensitivity(NamedTuple):
    """Gains, and their derivative by every row of the record."""

    fit: jaxfric.Fit
    gains: np.ndarray
    """(2,)."""
    rows: np.ndarray
    """(2, n) [gain per friction]."""
    worst: float
    """Largest difference to a refit with one row moved, relative to the largest derivative."""

    @property
    def errors(self) -> np.ndarray:
        """Standard errors of the gains if the noise is white: sigma |d gain/d f|."""
        return self.fit.noise.sigma * np.linalg.norm(self.rows, axis=1)


def sensitivity(record: Path) -> Sensitivity:
    """Fit the record and differentiate the gains by its rows."""
    fit = jaxfric.fit(record, stiffness=STIFFNESS)
    solved = fit.solved
    assert solved is not None
    problem, z = solved.problem, solved.solution.z

    def gains(friction: Array) -> Array:
        return gains_of(problem, z, friction)

    friction, n = problem.friction, len(fit.record)
    again = jax.jit(gains)
    rows = np.asarray(jax.jit(jax.jacrev(gains))(friction))[:, :n]
    worst = 0.0
    for row in (int(np.argmax(np.abs(rows[0]))), n // 4, n - 1):
        ends = [again(friction.at[row].add(side * MOVED)) for side in (1, -1)]
        off = np.asarray(ends[0] - ends[1]) / (2 * MOVED) - rows[:, row]
        worst = max(worst, float(np.max(np.abs(off) / np.max(np.abs(rows), axis=1))))
    return Sensitivity(fit, np.asarray(again(friction)), rows, worst)


def half(found: Sensitivity, gain: int) -> tuple[int, float, float]:
    """The fewest rows that make half the variance of a gain, and when the first and the last of
    them are, after the velocity step [s]."""
    share = np.square(found.rows[gain])
    order = np.argsort(share)[::-1]
    number = int(np.searchsorted(np.cumsum(share[order]), 0.5 * np.sum(share))) + 1
    when = found.fit.record.relative_time[order[:number]] - found.fit.steps.times[1]
    return number, float(np.min(when)), float(np.max(when))


def draw(found: Sensitivity, to: Path) -> None:
    """The record, and above it the sensitivity of both gains to every row."""
    fit = found.fit
    when = fit.record.relative_time - fit.steps.times[1]
    figure, (above, below) = plt.subplots(
        2, 1, sharex=True, figsize=(8, 5.5), height_ratios=(3, 2), layout="constrained"
    )
    for k, (name, colour) in enumerate(COLOURS.items()):
        relative = 1e6 * fit.noise.sigma * found.rows[k] / found.gains[k]
        above.plot(when, relative, color=colour, lw=1.4, label=f"${name[0]}_{name[2]}$")
    above.axhline(0, color="#888888", lw=0.7)
    above.set_ylabel("change of the gain\nby one row's noise [ppm]")
    above.set_title("Which rows decide the gains", loc="left")
    above.legend(frameon=False)
    below.plot(when, fit.record.friction, color="#9db4cc", lw=1.0, label="record")
    below.plot(when, fit.predicted, color="#222222", lw=1.2, label="fit")
    below.set_ylabel("friction coefficient")
    below.set_xlabel("time after the velocity step [s]")
    below.legend(frameon=False)
    figure.savefig(to / "which_rows.png", dpi=130)
    plt.close(figure)


def main() -> None:
    """Fit, differentiate, print and draw."""
    parser = argparse.ArgumentParser(prog="python -m fits.which_rows", description=__doc__)
    parser.add_argument("--out", type=Path, default=HERE)
    asked = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    found = sensitivity(RECORD)
    for k, (name, unit) in enumerate({"k_p": "1/m", "k_v": "s/m"}.items()):
        number, first, last = half(found, k)
        print(f"{name} = {found.gains[k]:.4g} +- {found.errors[k]:.1g} {unit} by the noise of")
        print(f"  {found.rows.shape[1]} rows; {number} rows make half of its variance,")
        print(f"  from {first:.3g} to {last:.3g} s after the velocity step")
    print(f"derivatives against refits with one row moved: {found.worst:.1g} of the largest")
    draw(found, asked.out)
    halves = {name: half(found, k) for k, name in enumerate(COLOURS)}
    content = {
        "gains": dict(zip(COLOURS, found.gains.tolist(), strict=True)),
        "errors": dict(zip(COLOURS, found.errors.tolist(), strict=True)),
        "half": halves,
        "against_refits": found.worst,
    }
    (asked.out / "which_rows.json").write_text(json.dumps(content, indent=1) + "\n")


if __name__ == "__main__":
    main()
