"""The terms that a rival may choose from, and what each of them may be called.

A term is a function of time along the record, made of the base's own motion. Its `kind` says which
effects it could be the sign of: `KINDS`. A kind is as wide as the physics allows and wider, so that
a rival is right wherever one reading of its term is.
"""

from typing import NamedTuple

import numpy as np

from .base import Base

KINDS: dict[str, tuple[str, ...]] = {
    # what the base has already: an offset, A, B, L
    "base": (),
    # a curve of friction over velocity: whatever changes levels from velocity to velocity
    "velocity": (
        "viscous",
        "stribeck",
        "evolution_cutoff",
        "damping",
        "ageing",
        "velocity_dependent_L",
        "gain",
        "thermal",
    ),
    # the velocity of a while ago
    "late": ("thermal", "viscous", "stribeck", "evolution_cutoff", "damping", "second_state"),
    # a transient that dies out along the slip after a step, or with the state
    "relaxation": (
        "second_state",
        "ageing",
        "velocity_dependent_L",
        "evolution_cutoff",
        "frictional_delay",
        "stiffness",
        "gain",
        "damping",
        "inertia",
        "servo_lag",
        "sensor_lag",
        "sensor_delay",
    ),
    # a transient that dies out in time after a step
    "waiting": (
        "second_state",
        "ageing",
        "thermal",
        "stiffness",
        "servo_lag",
        "sensor_lag",
        "sensor_delay",
    ),
    # a rate: of what comes late, or has to be moved
    "rate": (
        "servo_lag",
        "sensor_lag",
        "sensor_delay",
        "frictional_delay",
        "damping",
        "inertia",
        "stiffness",
        "gain",
        "velocity_dependent_L",
        "viscous",
    ),
    "slip": ("slip_trend", "run_in", "time_drift", "thermal"),
    "time": ("time_drift", "slip_trend", "run_in", "thermal"),
    "wave": ("position_periodic",),
    "stress": ("normal_stress",),
}
_PEAKS = 3


class Term(NamedTuple):
    """A column of the library."""

    name: str
    kind: str
    values: np.ndarray


class Along(NamedTuple):
    """What varies along a record, as a rival's variables. u = ln(V/V0)."""

    u: np.ndarray
    theta: np.ndarray
    omega: np.ndarray
    """theta less its steady value, -B u."""
    v: np.ndarray
    """V over the fastest command."""
    x: np.ndarray
    """Slip, over all of it."""
    t: np.ndarray
    """Time, over the duration."""
    since: np.ndarray
    """ln(1 + time since the step/1 s)."""
    path: np.ndarray
    """Path of the load point since the step, over 100 um."""
    pull: np.ndarray
    """ln(V/V_load): 0 once the spring has settled."""
    rate: np.ndarray
    """d friction/dt [1/s]."""
    du: np.ndarray
    """du/dt [1/s]."""
    stress: np.ndarray
    """Normal stress over the first one, less 1."""


def along(base: Base) -> Along:
    """The variables of a record."""
    _, A, B, L, K, V0 = base.parameters
    V = np.maximum(base.velocity, 1e-30)
    u, load = np.log(V / V0), base.velocities[base.step]
    since = base.time - base.times[base.step]
    omega, rate = base.state + B * u, K * (load - V)
    return Along(
        u,
        base.state,
        omega,
        V / base.velocities.max(),
        base.slip / base.slip[-1],
        base.time / base.time[-1],
        np.log1p(np.maximum(since, 0.0)),
        np.maximum(since, 0.0) * load / 1e-4,
        np.log(V / load),
        rate,
        (rate + V / L * omega) / A,
        base.stress - 1.0,
    )


def library(base: Base) -> list[Term]:
    """All terms of a record; those that do not change in its train block are left out."""
    a, V = along(base), np.maximum(base.velocity, 1e-30)
    load, since = base.velocities[base.step], base.time - base.times[base.step]
    before = base.velocities[np.maximum(base.step - 1, 0)]
    jump, path = np.log(load / before), np.maximum(since, 0.0) * load
    out = [Term(n, "base", c) for n, c in zip(_BASE, base.slopes.T, strict=True)]
    out += [Term("V", "velocity", V), Term("u^2", "velocity", a.u**2)]
    out += [Term(f"exp(-V/{s:g} um/s)", "velocity", np.exp(-V / (s * 1e-6))) for s in _SPEEDS]
    out += [Term(f"ln(1+V/{s:g} um/s)", "velocity", np.log1p(V / (s * 1e-6))) for s in _SPEEDS]
    out += [
        Term("omega", "relaxation", a.omega),
        Term("omega^2", "relaxation", a.omega**2),
        Term("omega u", "relaxation", a.omega * a.u),
        Term("ln(V/V_load)", "relaxation", a.pull),
    ]
    for s in (2.0, 5.0, 10.0, 30.0, 100.0):
        out.append(Term(f"step exp(-path/{s:g} um)", "relaxation", jump * np.exp(-path / s * 1e6)))
    for s in (0.03, 0.3, 3.0, 30.0):
        decay = np.exp(-np.maximum(since, 0.0) / s)
        out.append(Term(f"step exp(-time/{s:g} s)", "waiting", jump * decay))
        out.append(Term(f"V late by {s:g} s", "late", late(base.time, V, s)))
    out += [
        Term("dF/dt", "rate", a.rate),
        Term("du/dt", "rate", a.du),
        Term("dV/dt", "rate", V * a.du),
        Term("slip", "slip", a.x),
        *(Term(f"exp(-slip/{p:g} of all)", "slip", np.exp(-a.x / p)) for p in (0.03, 0.1, 0.3)),
        Term("time", "time", a.t),
        *waves(base),
        Term("stress", "stress", a.stress),
        Term("d stress/dt", "stress", np.gradient(a.stress, base.time)),
        Term("stress, lost along slip", "stress", lost(base)),
    ]
    train = base.rows("train")
    return [term for term in out if np.ptp(term.values[train]) > 0 or term.kind == "base"]


_BASE = ("1", "A", "B", "L")
_SPEEDS = (1.0, 10.0, 100.0)


def variables(base: Base) -> list[Term]:
    """What symbolic regression may build expressions of, each over its rms in the train block."""
    a, train = along(base), base.rows("train")
    speed = np.maximum(base.velocity, 1e-30)
    out = [Term(name, kind, getattr(a, name)) for name, kind in _VARIABLES.items()]
    out += [Term(f"late_{s}", "late", late(base.time, speed, float(s))) for s in (3, 30)]
    first = waves(base)[:2]
    out += [Term(n, "wave", w.values) for n, w in zip(("sine", "cosine"), first, strict=False)]
    if np.ptp(a.stress[train]) > 0:
        out += [Term("stress", "stress", a.stress), Term("lost", "stress", lost(base))]
    scaled = [(t, np.sqrt(np.mean(t.values[train] ** 2))) for t in out]
    return [t._replace(values=t.values / rms) for t, rms in scaled if rms > 0]


_VARIABLES = {
    "u": "velocity",
    "theta": "relaxation",
    "omega": "relaxation",
    "v": "velocity",
    "x": "slip",
    "t": "time",
    "since": "waiting",
    "path": "relaxation",
    "pull": "relaxation",
    "rate": "rate",
    "du": "rate",
}
"""Kind of a term in which a variable of `Along` stands."""


def late(time: np.ndarray, values: np.ndarray, tau: float) -> np.ndarray:
    """The values through a first-order lag of `tau` [s], in steady state at the first row."""
    out, keep = values.copy(), np.exp(-np.diff(time, prepend=time[0]) / tau)
    for i in range(1, len(time)):
        out[i] = keep[i] * out[i - 1] + (1 - keep[i]) * values[i]
    return out


def lost(base: Base) -> np.ndarray:
    """ln(normal stress), of which the state forgets what is older than L of slip."""
    L, y = base.parameters[3], np.log(base.stress)
    out, keep = np.zeros_like(y), np.exp(-np.diff(base.slip, prepend=base.slip[0]) / L)
    for i in range(1, len(y)):
        out[i] = keep[i] * (out[i - 1] + y[i] - y[i - 1])
    return out


def waves(base: Base) -> list[Term]:
    """Sine and cosine along slip at the highest peaks of the residual's periodogram (train)."""
    train = base.rows("train")
    x, y = base.slip[train], base.residual[train] - base.residual[train].mean()
    waves = np.arange(6.0, 200.0, 0.5) / np.ptp(base.slip)
    power = np.abs(np.exp(-2j * np.pi * np.outer(waves, x)) @ y)
    inner = (power[1:-1] >= power[:-2]) & (power[1:-1] >= power[2:])
    peaks = 1 + np.flatnonzero(inner)
    peaks = peaks[np.argsort(-power[peaks], kind="stable")][:_PEAKS]
    out = []
    for k in waves[peaks]:
        angle, text = 2 * np.pi * k * base.slip, f"(2 pi slip/{1e6 / k:.3g} um)"
        out.append(Term("sin" + text, "wave", np.sin(angle)))
        out.append(Term("cos" + text, "wave", np.cos(angle)))
    return out
