"""A simulated motion, or a batch of motions, in one line, a report, a figure and tables."""

import numpy as np

from ..errors import InputError
from ..quantity import is_known
from ..report.report import Report
from ..simulation.trajectory import RESULTS, Trajectory, result_words
from .view import Arrays, Frame, Variable, View

_UNITS = {"force": "F", "recorded": "F", "velocity": "m/s", "slip": "m"}
_TEXTS = {
    "force": "friction force on the slider",
    "recorded": "the force as the sensor records it",
    "velocity": "velocity of the slider",
    "slip": "displacement of the slider since the start",
    "state": "state variables of the friction law",
}


def _batch(found: Trajectory) -> tuple[int, ...]:
    return np.shape(found.end)


def line(found: Trajectory) -> str:
    """Number of sample times, last time, and how the motion ended; only the shape while traced."""
    times = np.shape(found.force)[-1]
    batch = f"batch of {' x '.join(map(str, _batch(found)))}, " if _batch(found) else ""
    if not is_known(found.end):
        return f"Trajectory({batch}{times} times; being traced)"
    words = np.atleast_1d(np.asarray(result_words(found.result), dtype=object)).ravel()
    names, counts = np.unique(words.astype(str), return_counts=True)
    shown = [n if len(words) == 1 else f"{c} {n}" for n, c in zip(names, counts, strict=True)]
    until = f" to {float(np.max(np.asarray(found.end))):.6g} s"
    return f"Trajectory({batch}{times} times{until}; {', '.join(shown)})"


def report(found: Trajectory) -> Report:
    """The values that the motion reached, and the reason if the motion ended early."""
    if not is_known(found.end):
        return Report()
    lines = [
        f"{_TEXTS[name]} [{_UNITS[name]}]: {np.min(values):.6g} to {np.max(values):.6g}"
        for name in _UNITS
        for values in [np.asarray(getattr(found, name))]
    ]
    steps = np.asarray(found.num_steps)
    lines.append(f"steps of the solver: {np.max(steps)}{' at most' if steps.ndim else ''}")
    early = [] if _batch(found) or found.result == RESULTS.successful else [RESULTS[found.result]]
    return Report(lines, warnings=[" ".join(text.split()) for text in early])


def arrays(found: Trajectory) -> Arrays:
    """All values over time; each axis of a batch is a further dimension."""
    batch = tuple("member" if k == 0 else f"member_{k}" for k in range(len(_batch(found))))
    variables = {
        name: Variable((*batch, "time"), np.asarray(getattr(found, name)), unit, _TEXTS[name])
        for name, unit in _UNITS.items()
    }
    state = np.asarray(found.state)
    variables["state"] = Variable((*batch, "time", "number"), state, "F", _TEXTS["state"])
    words = np.asarray(result_words(found.result), dtype=str)
    variables["result"] = Variable(batch, words, "", "how the simulation ended")
    variables["end"] = Variable(batch, np.asarray(found.end), "s", "time that it reached")
    time = np.asarray(found.time)
    if time.ndim > 1 and np.all(time == time.reshape(-1, time.shape[-1])[0]):
        time = time.reshape(-1, time.shape[-1])[0]
    if time.ndim > 1:
        variables["sample_time"] = Variable((*batch, "time"), time, "s", "sample times")
        return Arrays(variables, {})
    return Arrays(variables, {"time": Variable(("time",), time, "s", "sample times")})


def frame(found: Trajectory) -> Frame:
    """One row for each sample time; raises `InputError` for a batch."""
    if _batch(found):
        raise InputError(
            f"a batch of {_batch(found)} trajectories is no single table: to_xarray() has all of"
            " it, and jax.tree.map(lambda x: x[0], trajectory) is one of it"
        )
    state = np.asarray(found.state)
    columns = {
        "time [s]": np.asarray(found.time),
        **{f"{name} [{u}]": np.asarray(getattr(found, name)) for name, u in _UNITS.items()},
        **{f"state {k + 1} [F]": state[:, k] for k in range(state.shape[1])},
    }
    ended = {"result": str(result_words(found.result)), "end": float(found.end)}
    return Frame(columns, "time [s]", ended)


def figure(found: Trajectory):
    """Friction, velocity and slip over time."""
    from ..plot.trajectory import trajectory_figure

    return trajectory_figure(found)


VIEW = View(line, report, figure, frame, arrays)
