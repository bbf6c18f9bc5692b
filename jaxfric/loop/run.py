"""The loop over a whole run: what does the model of all its steps and holds lack?

The steps and holds of a run, one after the other as one motion (`runs.joined`): they share A, B, L
and the effects, every stretch between a change of normal stress, an unloading or a pause has a
level of its own. Held out are whole steps and holds; others, where nothing is named at first.
"""

import dataclasses
from collections.abc import Callable, Sequence

import jax
import numpy as np

from ..errors import InputError
from ..fitting import Fit, fit
from ..fitting.fit import few_rows
from ..fitting.padding import bucket, filled
from ..fitting.problem import Problem
from ..records import Record, VelocitySteps
from ..records.record import frozen
from ..runs.events import Event
from ..runs.fits import HowFitted, fit_run
from ..runs.joined import Joined, join
from .case import Offered
from .close import close
from .family import listed
from .residual_tests import merged, p_text
from .result import Loop, RunBase, RunDetails
from .slider import refuse_failed, slider_subject, with_channels
from .split import Blocks, split_again, split_units
from .thresholds import ACCEPT, SIGNIFICANT

_NAMED = ("effects", "ambiguous")
_LATE = 0.8
"""Share of a phase after which its friction is taken as steady, to begin with."""
_START_ROWS = 1000
"""Most rows of a step that is fitted only to begin with."""


def run_loop(
    record: Record,
    events: Sequence[Event],
    how: HowFitted,
    rows: int | None,
    asked: Offered,
    *,
    begun: float,
    progress: Callable[[str], None],
) -> Loop:
    """The loop over a run (`asked_twice`); `how` has the machine's stiffness and the law.

    Raises
    ------
    InputError : fewer than three steps and holds that count; or as in `jaxfric.fit`.
    """
    joined, thinning = join(record, events), ()
    if rows is not None:
        joined, thinning = _thinned(joined, rows)
    asked = with_channels(joined.record, how.law, asked, stress=False)
    units = _units(joined)
    blocks = split_units(*units, record.provenance.path)
    levels = _levels(joined, blocks.train)
    base_fit = _base_fit(joined, levels, how, _start(record, events, how, progress), progress)
    refuse_failed(joined.record, base_fit)

    def search(blocks: Blocks) -> Loop:
        subject = slider_subject(
            joined.record,
            base_fit,
            joined.steps(fine=True),
            blocks,
            asked,
            changed=lambda problem: _in_stretches(problem, joined),
            levels={f"level{k + 2}": float(v) for k, v in enumerate(levels[1:])},
            shown=(joined.rows, RunBase(base_fit, joined.shown_steps())),
            thinning=thinning,
            details=lambda after: RunDetails(joined, after),
        )
        return close(subject, most=asked.most, begun=begun, progress=progress)

    def again() -> Blocks | None:
        return split_again(*units, blocks) if asked.most else None

    return asked_twice(search, blocks, again, progress=progress)


def asked_twice(
    search: Callable[[Blocks], Loop],
    blocks: Blocks,
    again: Callable[[], Blocks | None],
    *,
    progress: Callable[[str], None],
) -> Loop:
    """What a search finds; where it supports no name, once more with other steps and holds held out
    (`again`; None: there are too few).

    What decides may be in a few steps. Where those are held out no effect is supported, or one that
    does not predict them. The second search counts where it names an effect, leaves no structure,
    and stands the chance of two. Of the same effects what the first search left counts with it.
    Where it fails or is interrupted, the first is what was found.
    """
    found = search(blocks)
    other = None if found.verdict in _NAMED else again()
    if other is None:
        return found
    progress(
        "no name is supported: once more, with other steps and holds held out (interrupted, the"
        " first search stands)"
    )
    try:
        second = search(other)
    except (Exception, KeyboardInterrupt) as end:
        how = "was interrupted"
        if isinstance(end, Exception):
            how = f"ended in an error ({type(end).__name__}: {end})"
        lost = f"a second search, with other steps and holds held out, {how}: this is the first"
        return dataclasses.replace(found, warnings=(*found.warnings, lost))
    if not _stands(second, found):
        return dataclasses.replace(found, seconds=second.seconds)
    first = "no effect is named"
    if found.effects:
        first = f"a model with {listed(found.effects)} is not confirmed ({found.reasons[0]})"
    said = (
        f"with the last steps and holds held out {first}; here those train, and others are held out"
    )
    if set(second.effects) == set(found.effects):
        chance = p_text(_together(found, second))
        said += f"; noise alone leaves as much in both together: {chance}"
    return dataclasses.replace(second, warnings=(*second.warnings, said))


def _stands(second: Loop, first: Loop) -> bool:
    """Whether what a second search names counts.

    Asked twice, it takes twice the evidence, in noise that differs from step to step. What is there
    in the steps that decide is there in those that are held out as well. Structure that the same
    effects left at first is left, but where it is no more than chance with what they leave now.
    """
    if second.verdict not in _NAMED:
        return False
    if set(second.effects) == set(first.effects):
        alone = len(first.reasons) == 1 and _least(first) < SIGNIFICANT
        if not alone or _together(first, second) < SIGNIFICANT:
            return False
    better = second.test_error(second.after) < second.test_error(second.before)
    return better and (second.gain() or 0.0) > 2 * ACCEPT


def _together(first: Loop, second: Loop) -> float:
    """p-value of the structure that the models of two searches leave."""
    return merged(_least(first), _least(second))


def _least(loop: Loop) -> float:
    """p-value of the structure that a model leaves."""
    return min(loop.after.tests.values(), default=1.0)


def _units(joined: Joined) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Time and phase of every row, unit and velocity of every phase."""
    phases = joined.phases
    unit, velocity = (np.array(x) for x in ([p.unit for p in phases], [p.velocity for p in phases]))
    return joined.record.time, joined.phase, unit, velocity


def _base_fit(
    joined: Joined,
    levels: np.ndarray,
    how: HowFitted,
    start: dict[str, float] | None,
    progress: Callable[[str], None],
) -> Fit:
    """The base of all windows, every stretch lowered by its level."""
    progress("base fit of all windows")
    aligned = frozen(joined.record.friction - levels[joined.stretch])
    assert how.stiffness is not None
    return fit(
        dataclasses.replace(joined.record, friction=aligned),
        stiffness=how.stiffness.at(joined.stretches[0].normal_stress),
        law=how.law,
        steps=joined.steps(),
        start=start,
        progress=lambda text: progress(f"base fit of all windows: {text}"),
    )


def _start(
    record: Record, events: Sequence[Event], how: HowFitted, progress: Callable[[str], None]
) -> dict[str, float] | None:
    """Medians of A, B and L over the steps, each fitted alone to few rows: a search that begins
    elsewhere may find that every slider runs away at the end of a hold. None where no step tells
    them."""
    found = []
    few = dataclasses.replace(how, rows=min(how.rows, _START_ROWS))
    for step in fit_run(record, events, few, progress=progress).steps:
        if step.fit is None or not step.fit.converged:
            continue
        own = [step.fit.parameters[name] for name in "ABL"]
        if all(p.determined for p in own):
            found.append([p.value for p in own])
    if not found:
        return None
    return dict(zip("ABL", np.exp(np.median(np.log(found), axis=0)).tolist(), strict=True))


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
    size = len(problem.time)
    stretch = filled(joined.stretch, size) if len(joined.stretches) > 1 else None
    stress = joined.stress()
    clock = np.array(problem.clock)
    clock[:, 2] += filled(_left_out(joined), size)
    return dataclasses.replace(
        problem,
        clock=jax.device_put(clock),
        stretch=None if stretch is None else jax.device_put(stretch),
        normal_stress=None if stress is None else stress.padded(bucket(len(stress.knots), 4)),
    )


def _left_out(joined: Joined) -> np.ndarray:
    """Rows left out of the run before every row (n,), at the pace of those that follow.

    Between two stretches noise that is forgotten over rows is forgotten, too.
    """
    time, stretch = joined.record.time, joined.stretch
    count = np.zeros(len(time))
    for k in np.flatnonzero(np.diff(stretch)) + 1:
        interval = np.median(np.diff(time[joined.phase == joined.phase[k]]))
        count[k:] += max((time[k] - time[k - 1]) / interval - 1, 0.0)
    return count


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
        raise InputError(
            f"--downsample-to {rows}: a phase of the run would be lost; ask for more rows"
        )
    phase = np.searchsorted(cuts, few.time, side="right") - 1
    kept = np.unique(joined.phase)[phase]
    return dataclasses.replace(joined, record=few, rows=shown, phase=kept), said


def _in_run(joined: Joined, edges: np.ndarray) -> VelocitySteps:
    """Bounds between the phases in the time of the run."""
    time = joined.rows.relative_time
    cuts = np.append(0.0, 0.5 * (time[edges] + time[edges - 1]))
    return VelocitySteps(cuts, np.ones(len(cuts)))
