"""The loop over runs with one hidden effect: `python -m fits.runs.effects [--seeds 0 6]`.

A run has two stretches with an unloading between them, each of a first velocity, four steps and a
hold (twelve events; `--stretches 5 --steps 8` makes fifty): the plants of `fits.blind` (SciPy),
their friction cut off by the unloading and lifted by another level after it, with noise of its own.
The events are found as `jaxfric run` finds them, the loop is `jaxfric loop --run`. Effects are
those that one step leaves as each other's aliases, at rho of .5: what a refit of A, B, L and a
level for every stretch leaves of the noise-free record is half of the noise. Counted is: the effect
that is named is the true one (exact), or the true one is told as one that the run cannot tell from
it (group), and no effect is named where there is none. Results are kept by record, so a run of this
that was broken off goes on.
"""

import argparse
import json
import os
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import NamedTuple

import numpy as np

from fits.blind import measured
from fits.blind.draws import LEVELS, SIGMA, UM, Draw, log_uniform
from fits.blind.generate import Refit, UnreachableError, scale
from fits.blind.plants import (
    RUNAWAY,
    Base,
    Parameters,
    Protocol,
    RunawayError,
    Trajectory,
    simulate,
)
from fits.blind.scored import CONFIRMED

HERE = Path(__file__).parent
EFFECTS = ("second_state", "slip_trend", "thermal", "ageing", "velocity_dependent_L", "")
NOISES = ("white", "p655-run", "sepiolite-1", "basalt")
RHO = 0.5
_SLIP, _ROWS, _HOLD_ROWS = 150 * UM, 200, 80


class Size(NamedTuple):
    """Stretches of a run, and the steps of each (which has a hold and its reload besides)."""

    stretches: int = 2
    steps: int = 4

    @property
    def events(self) -> int:
        return self.stretches * (self.steps + 2)


TWELVE = Size()


def draw(rng: np.random.Generator, size: Size) -> tuple[Draw, list[int]]:
    """The plant, its protocol and samples, and the first phase of every later stretch."""
    A, L = log_uniform(rng, 0.004, 0.02), log_uniform(rng, 4 * UM, 15 * UM)
    B = A * (log_uniform(rng, 0.6, 0.9) if rng.random() < 0.2 else log_uniform(rng, 1.15, 2.2))
    ratio = log_uniform(rng, 4, 8)
    base = Base(float(rng.uniform(0.5, 0.75)), A, B, L, ratio * max(B - A, 0.2 * B) / L)
    rung, velocities, durations, firsts = int(rng.integers(3)), [], [], []
    for stretch in range(size.stretches):
        if stretch:
            firsts.append(len(velocities))
        velocities.append(LEVELS[rung])
        durations.append(1.5 * _SLIP / LEVELS[rung])
        hold = int(rng.integers(1, size.steps + 1))
        for step in range(1, size.steps + 1):
            moves = [r for r in (rung - 2, rung - 1, rung + 1, rung + 2) if 0 <= r < len(LEVELS)]
            rung = int(rng.choice(moves))
            velocities.append(LEVELS[rung])
            durations.append(_SLIP / LEVELS[rung])
            if step == hold:
                velocities += [0.0, LEVELS[rung]]
                durations += [log_uniform(rng, 30, 1000), _SLIP / LEVELS[rung]]
    protocol = Protocol(tuple(velocities), tuple(durations))
    t = []
    for begin, lasts, v in zip(protocol.starts, durations, velocities, strict=True):
        rows = _ROWS if v else _HOLD_ROWS
        t.append(begin + (np.arange(rows) + 0.5) * lasts / rows)
    t = np.concatenate(t)
    return Draw(base, ratio, protocol, t - t[0], None), firsts


class Planted(NamedTuple):
    """A run without noise: its plant, the first phase of every later stretch, the refit of its
    base (where an effect is hidden), that effect, how much of it the refit leaves, its motion."""

    plant: Draw
    firsts: list[int]
    refit: Refit | None
    hidden: Parameters
    rho: float
    path: Trajectory


def planted(effect: str, seed: int, size: Size = TWELVE) -> tuple[Planted, np.random.Generator]:
    """A run without noise, and what draws its noise."""
    for attempt in range(40):
        rng = np.random.default_rng([seed, EFFECTS.index(effect), attempt, 20])
        try:
            plant, firsts = draw(rng, size)
            hidden, rho, refit = {}, 0.0, None
            if effect:
                refit = Refit(plant, np.searchsorted(firsts, phase_of(plant), side="right"))
                parameters, rho = scale(effect, plant, refit, RHO, rng)
                hidden = {effect: parameters}
            _refuse_runaway(plant, hidden)
            path = simulate(plant.base, plant.protocol, hidden, plant.t)
        except (RunawayError, UnreachableError):
            continue
        return Planted(plant, firsts, refit, hidden, rho, path), rng
    raise UnreachableError(f"{effect}, seed {seed}: no draw reaches rho")


def make(effect: str, seed: int, size: Size = TWELVE) -> dict:
    """Columns of a run in SI, its stiffness and the truth."""
    run, rng = planted(effect, seed, size)
    return _unloaded(run.path, run.plant, run.firsts, seed, rng) | {
        "truth": run.hidden,
        "rho": run.rho,
        "A": run.plant.base.A,
        "B": run.plant.base.B,
        "L": run.plant.base.L,
    }


def phase_of(plant: Draw) -> np.ndarray:
    """Of every row, which of the commanded velocities it has."""
    return np.searchsorted(plant.protocol.starts, plant.t, side="right") - 1


def _refuse_runaway(plant: Draw, hidden: Parameters) -> None:
    """A slider that slips away between two rows, as after a long hold, shows it to 20 times as
    many: near to it the velocity is about L over the time that is left."""
    dense = np.interp(np.arange(20 * len(plant.t)) / 20, np.arange(len(plant.t)), plant.t)
    path = simulate(plant.base, plant.protocol, hidden, dense)
    if path.u.max() > np.log(plant.fastest / plant.protocol.velocities[0]) + RUNAWAY:
        raise RunawayError("the slider runs away between two rows")


def _unloaded(path, plant: Draw, firsts: list[int], seed: int, rng: np.random.Generator) -> dict:
    """The rows with noise, an unloading and another level before every later stretch."""
    phase = phase_of(plant)
    noise, kind = SIGMA * rng.standard_normal(len(plant.t)), NOISES[seed % len(NOISES)]
    if kind != "white":
        noise = SIGMA * measured.cut(kind, np.bincount(phase).tolist(), rng, gaps=firsts)
    x = np.array([plant.protocol.displacement(np.array([t]))[0] for t in plant.t])
    parts, late, level = [], 0.0, 0.0
    for stretch in range(len(firsts) + 1):
        begin = 0 if stretch == 0 else firsts[stretch - 1]
        end = firsts[stretch] if stretch < len(firsts) else len(plant.protocol.velocities)
        rows = (phase >= begin) & (phase < end)
        if stretch:
            v = plant.protocol.velocities[begin]
            back = 0.3 * plant.base.f0 / plant.base.K
            share = (np.arange(120) + 0.5) / 60
            way = np.where(share < 1, share, 2 - share) * back
            before = parts[-1]
            parts.append(
                (
                    before[0][-1] + 0.5 / 60 * back / v + share * back / v,
                    before[1][-1] - way,
                    before[2][-1] - plant.base.K * way + SIGMA * rng.standard_normal(120),
                )
            )
            late += 2 * back / v
            level += float(rng.normal(0, 0.004))
        parts.append((plant.t[rows] + late, x[rows], path.record[rows] + noise[rows] + level))
    t, position, friction = (np.concatenate(each) for each in zip(*parts, strict=True))
    position = position + 0.02 * UM * rng.standard_normal(len(t))
    return {"t": t, "x": position, "f": friction, "K": plant.base.K, "noise": kind}


def study(task: tuple[str, int, Size]) -> dict:
    """One run through the loop."""
    effect, seed, size = task
    import jax

    jax.config.update("jax_enable_x64", True)
    import jaxfric as jf
    from jaxfric.cache import cache_compiled
    from jaxfric.cli.xla import whole_loops
    from jaxfric.fitting.stiffness import MachineStiffness
    from jaxfric.loop import close_loop
    from jaxfric.runs.fits import decided_events

    whole_loops()  # as the command does
    cache_compiled()
    run = make(effect, seed, size)
    record = jf.from_arrays(run["t"], run["f"], load_point_displacement=run["x"])
    stiffness, begun = MachineStiffness(run["K"]), time.monotonic()
    out = {"effect": effect, "seed": seed, "events": size.events}
    out |= {"noise": run["noise"], "rho": run["rho"]}
    out["truth"] = run["truth"].get(effect, {})
    try:
        record, events = decided_events(record, None, stiffness)
        loop = close_loop(record, stiffness=run["K"], events=events)
    except Exception as error:
        return out | {"error": f"{type(error).__name__}: {error}"}
    units = {p.unit for p in loop.details.joined.phases if p.unit >= 0}
    covered = {}
    for name in ("A", "B", "L"):
        p = loop.after.parameters[name]
        covered[name] = bool(p.lower <= run[name] <= p.upper)
    return out | {
        "verdict": loop.verdict,
        "found": list(loop.effects),
        "groups": [list(group) for group in loop.alias_groups],
        "units": len(units),
        "covered": covered,
        "heldout": loop.test_error(loop.after),
        "seconds": time.monotonic() - begun,
    }


def exact(row: dict) -> bool:
    """Whether the effect that is named is the true one, or none is where there is none."""
    if not row["effect"]:
        return row.get("verdict") == "no_missing_effect"
    return row.get("found") == [row["effect"]] and row["verdict"] in CONFIRMED


def group(row: dict) -> bool:
    """Whether one effect is named, and the true one is it or told as not to be told from it."""
    if not row["effect"]:
        return exact(row)
    named = row.get("verdict") in CONFIRMED and len(row["found"]) == 1
    return named and row["effect"] in row["groups"][0]


def told(rows: list[dict]) -> str:
    """The table: an effect a line."""
    lines = ["effect                 runs  exact  group  verdicts"]
    for effect in EFFECTS:
        own = [row for row in rows if row["effect"] == effect]
        if own:
            wrong = [row for row in own if not exact(row)]
            what = "; ".join(f"{row['seed']}: {_short(row)}" for row in wrong)
            lines.append(
                f"{effect or 'none':22} {len(own):4d} {sum(map(exact, own)):6d}"
                f" {sum(map(group, own)):6d}  {what}"
            )
    return "\n".join(lines)


def _short(row: dict) -> str:
    return row.get("error") or " ".join([row["verdict"], "+".join(row["found"])]).strip()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", nargs=2, type=int, default=(0, 6), metavar=("FROM", "TO"))
    parser.add_argument("--stretches", type=int, default=TWELVE.stretches)
    parser.add_argument("--steps", type=int, default=TWELVE.steps, help="of a stretch")
    parser.add_argument("--effects", nargs="*", default=list(EFFECTS))
    parser.add_argument("--cores", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--out", type=Path, default=HERE / "effects.json")
    given = parser.parse_args()
    rows = json.loads(given.out.read_text(encoding="utf-8")) if given.out.exists() else []
    size = Size(given.stretches, given.steps)
    done = {(row["effect"], row["seed"]) for row in rows if row["events"] == size.events}
    tasks = [(e, s, size) for s in range(*given.seeds) for e in given.effects if (e, s) not in done]
    os.environ.setdefault("NPROC", "1")
    with ProcessPoolExecutor(given.cores) as pool:
        for row in pool.map(study, tasks):
            rows.append(row)
            rows.sort(key=lambda r: (EFFECTS.index(r["effect"]), r["seed"]))
            given.out.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
            print(row["effect"] or "none", row["seed"], _short(row), flush=True)
    print(told(rows))


if __name__ == "__main__":
    main()
