"""The loop over a whole run: find the effects that the model of all steps and holds lacks.

The steps and holds of a run form one motion (`runs.joined`) with common A, B, L and effects. Each
stretch between changes of normal stress, unloadings or pauses has its own friction level. Whole
steps and holds are held out. If no effect is named, a second search holds out other steps and
holds.
"""

import dataclasses
from collections.abc import Callable, Sequence

import jax
import numpy as np

from ..errors import InputError, option
from ..findings import Warned, WarningCode
from ..fitting import Fit, fit
from ..fitting.fit import few_rows
from ..fitting.padding import bucket, filled
from ..fitting.problem import Problem
from ..records import Record, VelocitySteps
from ..records.record import frozen
from ..runs.events import Event
from ..runs.fits import HowFitted, fit_run
from ..runs.joined import Joined, join
from ..units import p_text
from .case import Offered
from .close import close
from .family import listed
from .residual_tests import merged
from .result import BaseModel, Loop, RunDetails
from .slider import refuse_failed, slider_subject, with_channels
from .split import Blocks, split_again, split_units
from .thresholds import ACCEPT, FITTED_ROWS, LATE, SIGNIFICANT, START_ROWS

_NAMED = ("effects", "ambiguous")


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
    """The loop over a run, as `asked_twice`; `how` holds the machine's stiffness and the law.

    Raises
    ------
    InputError : fewer than three usable steps and holds; or as in `jaxfric.fit`.
    """
    joined, thinning = _thinned(join(record, events), rows)
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
            shown=(joined.rows, BaseModel(how.law, joined.shown_steps(), base_fit.values())),
            thinning=thinning,
            details=lambda after: RunDetails(joined),
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
    """The result of a search. If the search names no effect, a second search holds out other steps
    and holds, the blocks of `again`. There is no second search if `again` returns None, because a
    run has too few steps and holds.

    A few steps may hold all information about an effect. If all steps with information about an
    effect are held out, the search supports no effect, or an effect that does not predict these
    steps. The result of the second search is returned if it names an effect, leaves no structure in
    the residual, and is significant even for two searches. If both searches find the same effects,
    the residuals of both searches together must also have no structure. If the second search fails
    or is interrupted, the result of the first search is returned.
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
        told = Warned(lost, WarningCode.SECOND_SEARCH, {"taken": False})
        return dataclasses.replace(found, warnings=(*found.warnings, told))
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
    told = Warned(said, WarningCode.SECOND_SEARCH, {"taken": True})
    return dataclasses.replace(second, warnings=(*second.warnings, told))


def _stands(second: Loop, first: Loop) -> bool:
    """Whether the result of a second search counts.

    Two searches need twice the evidence, as noise differs between steps. A real effect also
    improves the prediction of the held-out steps. If both searches have the same effects, the
    structure after both together must not be significant.
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
    """Combined p-value of the residual structure after two searches."""
    return merged(_least(first), _least(second))


def _least(loop: Loop) -> float:
    """Smallest p-value of the residual structure of a model."""
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
    """The base fit of all windows, with its level subtracted from every stretch."""
    progress("base fit of all windows")
    aligned = frozen(joined.record.friction - levels[joined.stretch])
    assert how.stiffness is not None
    return fit(
        dataclasses.replace(joined.record, friction=aligned),
        stiffness=how.stiffness.at(joined.stretches[0].normal_stress),
        law=how.law,
        slip_trend=how.slip_trend,
        steps=joined.steps(),
        start=start,
        progress=lambda text: progress(f"base fit of all windows: {text}"),
    )


def _start(
    record: Record, events: Sequence[Event], how: HowFitted, progress: Callable[[str], None]
) -> dict[str, float] | None:
    """Medians of A, B and L over fits of single steps with few rows; None if no step determines
    them. From other starts every slider may run away at the end of a hold."""
    found = []
    few = dataclasses.replace(how, rows=min(how.rows, START_ROWS))
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
    """Friction of every stretch minus that of the first, from the ends of the train phases, by
    least squares: one level per stretch and a common slope over ln V."""
    stretches, rows, values = len(joined.stretches), [], []
    time = joined.record.time
    for k, phase in enumerate(joined.phases):
        here = np.flatnonzero((joined.phase == k) & train)
        if phase.velocity == 0 or len(here) == 0:
            continue
        begin, end = time[here[[0, -1]]]
        late = here[time[here] >= begin + LATE * (end - begin)]
        own = np.eye(stretches)[phase.stretch]
        rows.append([*own, np.log(phase.velocity)])
        values.append(float(np.median(joined.record.friction[late])))
    found = np.linalg.lstsq(np.array(rows), np.array(values), rcond=None)[0][:stretches]
    return found - found[0]


def _in_stretches(problem: Problem, joined: Joined) -> Problem:
    """The problem with the stretch of every row, and the normal stress of each stretch."""
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
    """Number of rows of the run left out before every row (n,), at the interval of following rows.

    It advances the row clock, so that noise correlated over rows decays between two stretches.
    """
    time, stretch = joined.record.time, joined.stretch
    count = np.zeros(len(time))
    for k in np.flatnonzero(np.diff(stretch)) + 1:
        interval = np.median(np.diff(time[joined.phase == joined.phase[k]]))
        count[k:] += max((time[k] - time[k - 1]) / interval - 1, 0.0)
    return count


def _thinned(joined: Joined, rows: int | None) -> tuple[Joined, tuple[str, ...]]:
    """The joined run averaged as by `few_rows` to at most `FITTED_ROWS` rows, never over phases."""
    edges = np.flatnonzero(np.diff(joined.phase)) + 1
    cuts = _between(joined.record.time, edges)
    within = VelocitySteps(cuts, np.ones(len(cuts)))
    few, said = few_rows(joined.record, rows, within, most=FITTED_ROWS)
    if few is joined.record:
        return joined, ()
    in_run = VelocitySteps(_between(joined.rows.relative_time, edges), np.ones(len(cuts)))
    shown, _ = few_rows(joined.rows, rows or FITTED_ROWS, in_run)
    if len(shown) != len(few) and rows is None:
        return joined, ()
    if len(shown) != len(few):
        raise InputError(
            f"{option('downsample-to', rows)}: a phase of the run would be lost; ask for more rows"
        )
    phase = np.searchsorted(cuts, few.time, side="right") - 1
    kept = np.unique(joined.phase)[phase]
    return dataclasses.replace(joined, record=few, rows=shown, phase=kept), said


def _between(time: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """0, and the times halfway to the row before each row of `edges`."""
    return np.append(0.0, 0.5 * (time[edges] + time[edges - 1]))
