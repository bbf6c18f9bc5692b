"""Which law heals: `python -m fits.runs.healing [--seeds 3100 3200] [--cores 1]`.

How often is the right evolution law, slip or ageing, named from slide-hold-slide, where the laws
differ by five sigma? Records are made with SciPy (`generate`, nothing of jaxfric) and given to what
`jaxfric run` does: events, both laws fitted to all holds at once, and the law that they prefer.

How a record is drawn (from its seed alone)
    law         slip and ageing by turns; A, B, L, f0 and K as `generate` draws them
    motion      steady sliding, then one to four holds of 10 to 1000 s (log-uniform), each followed
                by sliding, all at one velocity of 1, 3, 10 or 30 um/s, over 20 to 40 L a time
    recorder    200 rows to a stretch of sliding, 80 to a hold; position: white noise of 0.02 um
    noise       white, or cut from measured records (`fits.blind.measured`), by turns

The signal. The record without noise is refitted by the other law (least squares, A, B, L and f0
free, K known, from several starts); d is what that leaves. A filter that is matched to d sees it at
    d.d / std(d.n)
over many cuts of the noise n. For white noise that is |d|/sigma, the root of twice the ln L by
which the laws differ in the mean. The noise is scaled so that this is 5. Where that takes a sigma
below 1e-6 (the other law does the same) or above 2e-3 (a plain difference) the record is drawn
again; so is a slider that runs away.

What can be expected. With white noise and all else known ln L differs by 12.5 with a standard
deviation of 5: it names the right law by a limit of 3 in 97.1 % of records, by one of 5 in 93.3 %,
and has the right sign in 99.4 %. Results are kept by record, so a run of this that was broken off
goes on.
"""

import argparse
import json
import os
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import norm

from fits.blind import measured

from .generate import LADDER, UM, Leg, Press, RunawayError, _leg, draw_press, log_uniform

HERE = Path(__file__).parent
LAWS = ("slip", "ageing")
NOISES = ("white", "p655-run", "sepiolite-1", "basalt")
SIGNAL = 5.0
LIMITS = (3.0, 5.0, 0.0)
"""Of ln L, from which on a law counts as named: that of `jaxfric.runs.holds`, odds of 150, none."""
_SIGMAS = (1e-6, 2e-3)
_ROWS, _HOLD_ROWS, _CUTS = 200, 80, 400
_STARTS = ((1, 1, 1), (1, 1, 0.3), (1, 1, 3), (1, 2, 1), (1.5, 0.5, 1))
"""Factors of the true A, B and L from which a refit sets out, until two of them end alike."""


class UnreachableError(RuntimeError):
    """No draw of a seed has the signal with a noise within the limits."""


@dataclass(frozen=True)
class Plan:
    """A slider, its stretches of sliding and holding by turns, and the rows of each."""

    press: Press
    velocity: float
    lasts: tuple[float, ...]

    def rows(self, stretch: int) -> int:
        return _HOLD_ROWS if stretch % 2 else _ROWS

    @property
    def counts(self) -> list[int]:
        return [self.rows(stretch) for stretch in range(len(self.lasts))]

    def columns(self) -> tuple[np.ndarray, np.ndarray]:
        """Time [s] and displacement [m] of the load point, row by row."""
        t, x, now, where = [], [], 0.0, 0.0
        for stretch, lasts in enumerate(self.lasts):
            v, count = 0.0 if stretch % 2 else self.velocity, self.rows(stretch)
            own = (np.arange(count) + 0.5) * lasts / count
            t.append(now + own)
            x.append(where + v * own)
            now, where = now + lasts, where + v * lasts
        return np.concatenate(t), np.concatenate(x)


def draw(rng: np.random.Generator, law: str) -> Plan:
    """A slider and its holds."""
    press, v = draw_press(rng, law), float(rng.choice(LADDER[1:5]))
    lasts = [min(rng.uniform(20, 40) * press.L, 400 * UM) / v]
    for _ in range(int(rng.integers(1, 5))):
        lasts += [log_uniform(rng, 10, 1000), lasts[0]]
    return Plan(press, v, tuple(lasts))


def friction(plan: Plan, press: Press) -> np.ndarray:
    """Friction of a plan under a press, from steady sliding on. Raises `RunawayError`."""
    u = np.log(plan.velocity / press.V0)
    tau, theta = (press.f0 + (press.A - press.B) * u) * press.sigma, -press.B * u
    out = []
    for stretch, lasts in enumerate(plan.lasts):
        count = plan.rows(stretch)
        t = (np.arange(count) + 0.5) * lasts / count
        leg = Leg(lasts, 0.0 if stretch % 2 else plan.velocity, press.sigma)
        tau, theta, own = _leg(press, leg, tau, theta, press.sigma, t)
        out.append(own)
    return np.concatenate(out)


def refit(plan: Plan, clean: np.ndarray, law: str):
    """What a law leaves of a record without noise, A, B, L and f0 being free; and its press."""

    def press(x: np.ndarray) -> Press:
        A, B, L = np.exp(x)
        return replace(plan.press, law=law, A=float(A), B=float(B), L=float(L))

    def left(x: np.ndarray) -> np.ndarray:
        try:
            d = clean - friction(plan, press(x))
        except RunawayError:
            return np.full(len(clean), 1.0)
        return d - d.mean()

    true = np.log([plan.press.A, plan.press.B, plan.press.L])
    ends, x, costs = (true - 4, true + 4), true, []
    for factors in _STARTS:
        start = true + np.log(factors)
        found = least_squares(
            lambda x: 1e4 * left(x), start, bounds=ends, diff_step=1e-4, max_nfev=60
        )
        if found.cost <= min(costs, default=np.inf):
            x = found.x
        costs.append(found.cost)
        if np.sum(np.array(costs) < 1.01 * min(costs)) > 1:
            break
    return left(x), press(x)


def sigma_of(d: np.ndarray, noises: np.ndarray | None, signal: float = SIGNAL) -> float:
    """The scale of the noise at which a filter matched to d sees it at a signal.

    `noises` are cuts of the noise (a row each, rms 1); None: it is white.
    """
    if noises is None:
        return float(np.linalg.norm(d) / signal)
    return float(d @ d / np.std(noises @ d) / signal)


def signal_of(d: np.ndarray, noises: np.ndarray | None, sigma: float) -> float:
    """The signal at which a filter matched to d sees it in noise of a scale."""
    return sigma_of(d, noises, 1.0) / sigma


def make(seed: int) -> dict:
    """Columns of a record in SI, its stiffness, and its truth."""
    law, kind = LAWS[seed % 2], NOISES[seed // 2 % len(NOISES)]
    other = LAWS[1 - seed % 2]
    for attempt in range(100):
        rng = np.random.default_rng([seed, 5, attempt])
        plan = draw(rng, law)
        try:
            clean = friction(plan, plan.press)
            d, _ = refit(plan, clean, other)
        except RunawayError:
            continue
        noises = None
        if kind != "white":
            noises = np.stack([measured.cut(kind, plan.counts, rng) for _ in range(_CUTS)])
        sigma = sigma_of(d, noises)
        if not _SIGMAS[0] <= sigma <= _SIGMAS[1]:
            continue
        n = measured.cut(kind, plan.counts, rng) if kind != "white" else rng.standard_normal(len(d))
        t, x = plan.columns()
        x = x + 0.02 * UM * rng.standard_normal(len(x))
        return {
            "t": t, "x": x, "f": clean + sigma * n, "plan": plan,
            "law": law, "noise": kind, "sigma": sigma, "attempt": attempt,
        }  # fmt: skip
    raise UnreachableError(f"seed {seed}: no draw has the signal")


def study(seed: int) -> dict:
    """One record through what `jaxfric run` does with holds."""
    import jax

    jax.config.update("jax_enable_x64", True)
    import jaxfric as jf
    from jaxfric.cache import cache_compiled
    from jaxfric.fitting.stiffness import MachineStiffness
    from jaxfric.runs.fits import HowFitted, decided_events
    from jaxfric.runs.holds import fit_holds, preferred

    cache_compiled()
    begun = time.monotonic()
    made = make(seed)
    plan = made["plan"]
    press = plan.press
    out = {
        "seed": seed, "law": made["law"], "noise": made["noise"], "sigma": made["sigma"],
        "velocity": plan.velocity,
        "holds": list(plan.lasts[1::2]), "A": press.A, "B": press.B, "L": press.L, "K": press.K,
        "drawn again": made["attempt"], "made in": time.monotonic() - begun,
    }  # fmt: skip
    begun = time.monotonic()
    record = jf.from_arrays(made["t"], made["f"], load_point_displacement=made["x"])
    stiffness = MachineStiffness(press.K)
    try:
        record, events = decided_events(record, None, stiffness)
        holds = fit_holds(record, events, HowFitted(stiffness))
    except Exception as error:
        return out | {"error": f"{type(error).__name__}: {error}"}
    law, total = preferred(holds)
    sign = 1.0 if made["law"] == "slip" else -1.0
    each = [
        {
            "time": hold.time,
            "lasts": hold.lasts,
            "group": hold.group,
            "fits": {name: _fit(fit) for name, fit in hold.fits.items()},
        }
        for hold in holds
    ]
    return out | {
        "named": law,
        "ln L": sign * total,
        "each": each,
        "fitted in": time.monotonic() - begun,
    }


def _fit(fit) -> dict:
    parameters = {name: float(fit.parameters[name].value) for name in ("A", "B", "L")}
    return parameters | {"rms": float(fit.rms)}


def outcome(row: dict, limit: float = LIMITS[0]) -> str:
    """Right, wrong or undecided, with a law being named from a limit of ln L on."""
    total = row.get("ln L", 0.0)
    if abs(total) < limit or total == 0:
        return "undecided"
    return "right" if total > 0 else "wrong"


def summary(rows: list[dict]) -> dict:
    """Counts of all records, by law and by noise."""
    groups = {"all": rows}
    groups |= {law: [r for r in rows if r["law"] == law] for law in LAWS}
    groups |= {noise: [r for r in rows if r["noise"] == noise] for noise in NOISES}
    out = {}
    for name, own in groups.items():
        if not own:
            continue
        counts = {"records": len(own)}
        for limit in LIMITS:
            found = [outcome(row, limit) for row in own]
            counts[f"{limit:g}"] = [found.count(w) for w in ("right", "wrong", "undecided")]
        values = [row["ln L"] for row in own if "ln L" in row]
        counts["mean ln L"] = round(float(np.mean(values)), 2) if values else None
        counts["std ln L"] = round(float(np.std(values)), 2) if values else None
        out[name] = counts
    return out


def theory(limit: float, signal: float = SIGNAL) -> tuple[float, float]:
    """Shares of records whose law is named rightly and wrongly, in white noise and all else known:
    ln L differs by signal^2/2, with a standard deviation of signal."""
    mean = signal**2 / 2
    return float(norm.sf(limit, mean, signal)), float(norm.cdf(-limit, mean, signal))


def told(rows: list[dict]) -> str:
    """The table: right, wrong and undecided by the limit of ln L."""
    head = "".join(f"{f'limit {limit:g}':>13}" for limit in LIMITS)
    lines = [f"{'':12}{'records':>8}{head}   ln L: mean  std"]
    for name, counts in summary(rows).items():
        found = "".join(f"{'/'.join(map(str, counts[f'{limit:g}'])):>13}" for limit in LIMITS)
        lines.append(
            f"{name:12}{counts['records']:>8}{found}   {counts['mean ln L']!s:>10}"
            f"{counts['std ln L']!s:>5}"
        )
    shares = [f"limit {limit:g}: {100 * theory(limit)[0]:.1f} %" for limit in LIMITS]
    lines.append(f"right in theory, ln L being 12.5 with a deviation of 5: {', '.join(shares)}")
    lines.append("counts are right/wrong/undecided")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", nargs=2, type=int, default=(3100, 3200), metavar=("FROM", "TO"))
    parser.add_argument("--cores", type=int, default=1)
    parser.add_argument("--out", type=Path, default=HERE / "healing.json")
    given = parser.parse_args()
    rows = json.loads(given.out.read_text(encoding="utf-8")) if given.out.exists() else []
    done = {row["seed"] for row in rows}
    os.environ.setdefault("NPROC", "1")
    with ProcessPoolExecutor(given.cores) as pool:
        for row in pool.map(study, [s for s in range(*given.seeds) if s not in done]):
            rows.append(row)
            rows.sort(key=lambda r: r["seed"])
            given.out.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
            found = row.get("error") or f"{outcome(row)}, ln L {row['ln L']:.1f}"
            print(row["seed"], row["law"], row["noise"], found, flush=True)
    print(told(rows))


if __name__ == "__main__":
    main()
