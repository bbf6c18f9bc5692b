"""`close_run_loop(record, events=...)`: what does the model of a whole run lack?

The steps and holds of a run, one after the other as one motion (`runs.joined`): they share A, B, L
and the effects, every stretch between a change of normal stress, an unloading or a pause has a
level of its own. Held out are whole steps and holds.
"""

import dataclasses
import time
from collections.abc import Callable, Sequence

import jax
import numpy as np

from ..effects import CATALOGUE, AbstractEffect, effect_of, ids_of
from ..errors import InputError
from ..fitting import Fit, fit
from ..fitting.fit import few_rows
from ..fitting.padding import bucket
from ..fitting.problem import Problem, to_free
from ..fitting.result import tidy_unit
from ..laws.registry import refuse_unknown_law
from ..records import Record, VelocitySteps
from ..records.record import frozen
from ..runs.events import Event
from ..runs.joined import Joined, join
from ..runs.stiffness import MachineStiffness
from ..units import format_si
from .curves import CurveRig
from .driver import ScoredRows, offered, run
from .engine import Candidate, Engine
from .loop import SliderBench, problem_of, refuse_failed, with_channels
from .result import Loop, Score, TextTable
from .search import MOST, Search
from .slider_curves import slider_curves
from .split import split_units

_LATE = 0.8
"""Share of a phase after which its friction is taken as steady, to begin with."""


def close_run_loop(
    record: Record,
    events: Sequence[Event],
    *,
    stiffness: MachineStiffness,
    law: str = "slip",
    with_: str | Sequence[str] = (),
    without: str | Sequence[str] = (),
    own: Sequence[type[AbstractEffect]] = (),
    most: int = MOST,
    rows: int | None = None,
    progress: Callable[[str], None] = lambda text: None,
) -> Loop:
    """Fit one base model to all steps and holds of a run, then find the effects that it lacks.

    Parameters
    ----------
    record : the run, resets of its encoder taken out (`runs.fits.without_resets_of`).
    events : what happens in it (`runs.find_events`), where `fitted` tells the steps that count;
        holds between sliding at one velocity count too.
    stiffness : of the machine. That of a coefficient is scaled by the normal stress of every
        stretch over that of the first.
    law, with_, without, own, most, rows, progress : as in `close_loop`.

    Returns
    -------
    Loop. `level2`, `level3`, ... are the friction of later stretches less that of the first.

    Raises
    ------
    InputError : fewer than three steps and holds that count; or as in `close_loop`.

    Not tried: slip and encoder columns, whose effects are not offered; a normal stress that changes
    within a step.
    """
    begun = time.monotonic()
    refuse_unknown_law(law)
    asked = offered(CATALOGUE, own, ids_of(with_), ids_of(without), most, effect_of)
    joined, thinning = join(record, events), ()
    if rows is not None:
        joined, thinning = _thinned(joined, rows)
    asked = with_channels(joined.record, law, asked, stress=False)
    K = stiffness.at(joined.stretches[0].normal_stress)
    blocks = split_units(
        joined.phase,
        np.array([p.unit for p in joined.phases]),
        np.array([p.velocity for p in joined.phases]),
        record.provenance.path,
    )
    progress("base fit of all windows")
    levels = _levels(joined, blocks.train)
    aligned = frozen(joined.record.friction - levels[joined.stretch])
    base_fit = fit(
        dataclasses.replace(joined.record, friction=aligned),
        stiffness=K,
        law=law,
        steps=joined.steps(),
        progress=lambda text: progress(f"base fit of all windows: {text}"),
    )
    refuse_failed(joined.record, base_fit)
    steps = joined.steps(fine=True)
    more = len(joined.stretches) - 1
    problem, felt = problem_of(joined.record, base_fit, steps, blocks, asked.effects, levels=more)
    problem = _in_stretches(problem, joined)
    bench = RunBench(
        joined.record,
        base_fit,
        steps,
        blocks,
        problem,
        felt,
        asked.without,
        thinning,
        joined,
        levels,
    )
    return run(bench, asked, begun=begun, progress=progress)


@dataclasses.dataclass(frozen=True)
class RunBase:
    """The base model of a run as reports see it: its phases are those of the run."""

    fit: Fit
    steps: VelocitySteps

    @property
    def law(self) -> str:
        """The name of the law."""
        return self.fit.law

    def values(self) -> dict[str, float]:
        """Parameter values by name (SI), from the base fit of all windows."""
        return self.fit.values()


@dataclasses.dataclass(frozen=True, eq=False)
class RunBench(SliderBench):
    """The joined record of a run and the fit of its base."""

    joined: Joined
    levels: np.ndarray
    """Friction of every stretch less that of the first, to begin with."""

    def start(self, engine: Engine[Problem]) -> np.ndarray:
        """The base fit, the levels that it was aligned with, step times as found."""
        values = dict(self.base_fit.values())
        values.update({f"level{k + 2}": v for k, v in enumerate(self.levels[1:])})
        natural = [values[name] for name in engine.model.base.names()] + engine.model.nulls()
        return np.array(to_free(self.problem, jax.device_put(np.asarray(natural)[None])))[0]

    def curves(self, engine: Engine[Problem], final: Candidate) -> CurveRig:
        """Steady curves of the fit, over the velocities of all phases but holds."""
        return slider_curves(engine, final, self.joined.shown_steps().velocities)

    def rows(self, engine: Engine[Problem]) -> ScoredRows:
        """All rows, by phase."""
        used = np.ones(len(self.record), bool)
        return ScoredRows(used, engine.blocks.step, len(self.joined.phases))

    def shown(self) -> tuple[Record, RunBase]:
        """The rows that count, in the time of the run, and the base with its phases."""
        return self.joined.rows, RunBase(self.base_fit, self.joined.shown_steps())

    def details(
        self, engine: Engine[Problem], found: Search, after: Score, progress: Callable[[str], None]
    ) -> "RunDetails":
        """The stretches of the run and their levels."""
        return RunDetails(self.joined, after)


@dataclasses.dataclass(frozen=True, eq=False)
class RunDetails:
    """The stretches of a run: from when to when, under which stress, at which level."""

    joined: Joined
    after: Score

    def tables(self) -> list[TextTable]:
        """A row for every stretch."""
        rows = []
        for k, s in enumerate(self.joined.stretches):
            units = {p.unit for p in self.joined.phases if p.stretch == k and p.unit >= 0}
            stress = "" if s.normal_stress is None else format_si(s.normal_stress, "Pa", "MPa", 4)
            level = self.after.parameters.get(f"level{k + 1}")
            shown = "0" if level is None else f"{level.value:.4g} ± {level.std:.2g}"
            rows.append((f"{s.start:.6g} to {s.stop:.6g} s", str(len(units)), stress, shown))
        head = ("stretch", "steps and holds", "normal stress", "level")
        unit = tidy_unit(self.joined.record.friction_unit)
        of = "" if unit == "1" else f" [{unit}]"
        note = f"level{of}: friction less that of the first stretch, fitted with the rest"
        return [TextTable("The run's stretches", head, rows, note)]

    def to_json(self) -> dict:
        """The stretches, as an entry of `loop.json`."""
        return {"stretches": [s._asdict() for s in self.joined.stretches]}


def _levels(joined: Joined, train: np.ndarray) -> np.ndarray:
    """Friction of every stretch less that of the first, from the ends of the phases that train:
    a level for each and one dependence on ln V."""
    stretches, rows, values = len(joined.stretches), [], []
    time = joined.record.time
    for k, phase in enumerate(joined.phases):
        here = np.flatnonzero((joined.phase == k) & train)
        if phase.velocity == 0 or len(here) == 0:
            continue
        begin, end = time[here[[0, -1]]]
        late = here[time[here] >= begin + _LATE * (end - begin)]
        own = np.eye(stretches)[phase.stretch]
        rows.append([*own, np.log(phase.velocity)])
        values.append(float(np.median(joined.record.friction[late])))
    found = np.linalg.lstsq(np.array(rows), np.array(values), rcond=None)[0][:stretches]
    return found - found[0]


def _in_stretches(problem: Problem, joined: Joined) -> Problem:
    """The problem with the stretch of every row, and the normal stress of each."""
    pad = (0, len(problem.time) - len(joined.phase))
    stretch = np.pad(joined.stretch, pad, mode="edge") if len(joined.stretches) > 1 else None
    stress = joined.stress()
    return dataclasses.replace(
        problem,
        stretch=None if stretch is None else jax.device_put(stretch),
        normal_stress=None if stress is None else stress.padded(bucket(len(stress.knots), 4)),
    )


def _thinned(joined: Joined, rows: int) -> tuple[Joined, tuple[str, ...]]:
    """The joined run as means over neighbouring rows, none over two phases."""
    edges = np.flatnonzero(np.diff(joined.phase)) + 1
    time = joined.record.time
    cuts = np.append(0.0, 0.5 * (time[edges] + time[edges - 1]))
    bounds = VelocitySteps(cuts, np.ones(len(cuts)))
    few, said = few_rows(joined.record, rows, bounds)
    if few is joined.record:
        return joined, ()
    shown, _ = few_rows(joined.rows, rows, _in_run(joined, edges))
    if len(shown) != len(few):
        raise InputError(f"--rows {rows}: a phase of the run would be lost; ask for more rows")
    phase = np.searchsorted(cuts, few.time, side="right") - 1
    kept = np.unique(joined.phase)[phase]
    return dataclasses.replace(joined, record=few, rows=shown, phase=kept), said


def _in_run(joined: Joined, edges: np.ndarray) -> VelocitySteps:
    """Bounds between the phases in the time of the run."""
    time = joined.rows.relative_time
    cuts = np.append(0.0, 0.5 * (time[edges] + time[edges - 1]))
    return VelocitySteps(cuts, np.ones(len(cuts)))
