"""Margins and end states of many sliders: functions of arrays of parameters, for a study.

`Sliders` is called with every varied parameter as an array of one length and gives every output
as one. Margins are those of `stability.margins`, the same function mapped. Simulations of massless
sliders go through `simulation.ensemble`, all at once; those with mass through
`gains.settle.end_state`, mapped, which takes some thousand times as long a member.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..gains.ends import ENDS, RUNAWAY
from ..gains.settle import Policy, end_state, slowest_mode, stretched
from ..rig import Inertial, QuasiStatic, Rig
from ..rig.friction import AbstractLaw, LogarithmicEffect
from ..simulation import ensemble, step_start
from ..simulation.start import regularised
from ..stability.linear import LinearSlider, linearise
from ..stability.margins import UNITS, is_stable, margins, poles
from ..stability.theorem import apply_theorem
from ..study import Axis, Output
from . import ends as streaming
from .parameters import rate_state

STABILITY = {
    "stable": "Steady sliding is asymptotically stable.",
    "unstable": "Steady sliding is unstable.",
    "no_steady_state": "The friction law has no steady state at this velocity.",
}
TRACE = {
    "whole": "The motion was followed for its whole duration.",
    "escape": "The slider ran away; the last values before hold.",
    "failed": "Too many steps were needed: raise max_steps.",
}
_TEXTS = {
    "stiffness": "stiffness margin, k_p over the critical stiffness",
    "decay": "decay rate of the slowest pole",
    "damping": "smallest damping ratio of a pole",
    "modulus": "modulus margin",
    "gain": "gain margin",
    "phase": "phase margin",
    "delay": "delay margin",
}
MARGINS = (
    Output("stability", long_name="linear stability", codes=STABILITY),
    *(Output(name, unit, _TEXTS[name]) for name, unit in UNITS.items()),
    Output("k_cr", "N/m", "critical stiffness"),
    Output("w_cr", "rad/s", "critical frequency"),
)
ENDINGS = (
    Output("end", long_name="end of the motion after a step", codes=streaming.CODES),
    Output("velocity_amplitude", "m/s", "half of the range of the velocity"),
    Output("slip_amplitude", "m", "half of the range of slip about steady motion"),
    Output("least_velocity", "m/s", "smallest velocity at the end"),
    Output("period", "s", "period of the limit cycle"),
    Output("period_spread", "s", "half of the range of the periods of its cycles"),
)
_NUMBERS = tuple(output.name for output in ENDINGS if output.name != "end")
# Until a stable slider is at its end; steps of one that cycles.
_FOLDS, _CYCLING = 12.0, 700.0


def traces(samples: int) -> tuple[Output, ...]:
    """Outputs of the motion in time, at `samples` times."""
    part = Axis("part", np.arange(1, samples + 1) / samples, "1", "time over the duration")
    return (
        Output("trace", long_name="how far the motion was followed", codes=TRACE),
        Output("duration", "s", "duration of the motion"),
        Output("force", "N", "friction", dims=(part,)),
        Output("velocity", "m/s", "velocity of the slider", dims=(part,)),
    )


@dataclass(frozen=True, eq=False)
class Sliders:
    """Margins and motions after a step of the command by `ratio`, to V0.

    law : "slip" or "ageing", whose parameters are among those given; or a law of another kind.
    fixed : parameters that do not vary, SI.
    wanted : names of outputs.
    inertia : whether mass takes part in simulations; it always does in margins.
    """

    law: str | AbstractLaw
    states: int
    fixed: Mapping[str, float]
    wanted: tuple[str, ...]
    samples: int = 100
    duration: float | None = None
    """[s]; None: twenty slip lengths at V0."""
    rtol: float = 1e-6
    max_steps: int = 4096
    inertia: bool = False
    runaway: float = field(default=RUNAWAY)

    def __call__(self, varied: Mapping[str, Array]) -> dict[str, Array]:
        """Outputs of an array of members."""
        p = self._parameters(varied)
        found: dict[str, Array] = {}
        names = set(self.wanted)
        if names & {output.name for output in MARGINS}:
            found |= jax.vmap(self._margins)(p)
        if names & {output.name for output in ENDINGS}:
            found |= jax.vmap(self._with_mass)(p) if self._slow else self._endings(p)
        if names & {"trace", "force", "velocity", "duration"}:
            found |= self._traces(p)
        return {name: found[name] for name in self.wanted}

    @property
    def _slow(self) -> bool:
        return self.inertia or not isinstance(self.law, str)

    def cost(self, varied: Mapping[str, Array]) -> Array:
        """About the number of steps that a member will take, to sort by.

        To its end: of a stable one, as long as its slowest mode lasts; of an unstable one, as many
        as ten cycles have. Of a motion in time: more, the smaller k_p over k_cr.
        """
        p = self._parameters(varied)
        if set(self.wanted) & {output.name for output in ENDINGS}:
            return jax.vmap(self._steps)(p)
        B = sum(p["B" if i == 1 else f"B{i}"] for i in range(1, self.states + 1))
        return (B - p["A"] - p["k_v"] * p["V0"]) / (p["L"] * p["k_p"])

    def _steps(self, p: Mapping[str, Array]) -> Array:
        s = poles(self._slider(p, mass=self.inertia))
        decay = -jnp.max(s.real)
        pace = jnp.maximum(jnp.max(jnp.abs(s.imag)) * 2.5, jnp.max(jnp.abs(s)) / 3)
        longest = _FOLDS / jnp.maximum(decay, 1e-300)
        return jnp.where(decay > 0, jnp.minimum(longest * pace, 1e6), _CYCLING)

    def _parameters(self, varied: Mapping[str, Array]) -> dict[str, Array]:
        like = next(iter(varied.values()))
        fixed = {name: jnp.full_like(like, value) for name, value in self.fixed.items()}
        return {**fixed, **varied}

    def _law(self, p: Mapping[str, Array]) -> AbstractLaw:
        if not isinstance(self.law, str):
            return self.law
        return rate_state(self.law, p, self.states)

    def _slider(self, p: Mapping[str, Array], *, mass: bool) -> LinearSlider:
        return linearise(self._rig(p, mass=mass), p["V0"])

    def _rig(self, p: Mapping[str, Array], *, mass: bool) -> Rig:
        if mass and "m" in p:
            return Rig(Inertial(p["m"], p["k_p"], p["k_v"]), self._law(p))
        return Rig(QuasiStatic(p["k_p"], p["k_v"]), self._law(p))

    def _margins(self, p: Mapping[str, Array]) -> dict[str, Array]:
        slider = self._slider(p, mass=True)
        theorem = apply_theorem(slider)
        known = _finite(slider)
        stable = jnp.where(is_stable(slider), 0, 1)
        found = margins(slider) | {
            "k_cr": theorem.critical_stiffness,
            "w_cr": theorem.critical_frequency,
        }
        found = {name: jnp.where(known, x, jnp.nan) for name, x in found.items()}
        return {**found, "stability": jnp.where(known, stable, 2).astype(jnp.int8)}

    def _pace(self, p: Mapping[str, Array]) -> tuple[Array, Array]:
        """Slowest mode that matters and slowest decay [1/s]."""
        s = poles(self._slider(p, mass=self.inertia))
        return slowest_mode(s), -jnp.max(s.real)

    def _lanes(self, p: Mapping[str, Array]) -> tuple[ensemble.Lanes, ensemble.LanePoint]:
        assert isinstance(self.law, str)
        law = rate_state(self.law, p, self.states, LogarithmicEffect())
        of = ensemble.lanes(law, p["k_p"], p["k_v"], p["V0"])
        return of, ensemble.stepped(of, p["ratio"])

    def _endings(self, p: Mapping[str, Array]) -> dict[str, Array]:
        of, start = self._lanes(p)
        slowest, decay = jax.vmap(self._pace)(p)
        horizon = streaming.horizon_of(slowest, of.law.A, of.stiffness, of.velocity)
        horizon = stretched(horizon, decay)
        steady = of.law.A - jnp.sum(of.law.B, axis=1)
        lead = jnp.abs(steady * jnp.log(p["ratio"]) / (of.stiffness * of.velocity))
        found = streaming.ends(
            of,
            start,
            lead,
            horizon,
            decay,
            rtol=10 * self.rtol,
            max_steps=self.max_steps,
            runaway=self.runaway,
        )
        return _coded(found._asdict(), found.code)

    def _with_mass(self, p: Mapping[str, Array]) -> dict[str, Array]:
        rig = self._rig(p, mass=self.inertia)
        slowest, decay = self._pace(p)
        scale = rig.friction.force_scale()
        horizon = streaming.horizon_of(slowest, scale, p["k_p"], p["V0"])
        policy = Policy(10 * self.rtol, self.max_steps, self.runaway)
        rig = regularised(rig)
        start = step_start(rig, p["V0"], p["ratio"])
        end = end_state(rig, p["V0"], start, horizon=horizon, decay=decay, policy=policy)
        names = ("steady", "limit_cycle", "escape", "unresolved")
        masks = jnp.stack([end.code == getattr(ENDS, name) for name in names])
        code = jnp.argmax(masks, axis=0).astype(jnp.int8)
        # no unstable slider slides steadily: its oscillation is still too small to be seen
        code = jnp.where((code == streaming.STEADY) & (decay < 0), streaming.FAILED, code)
        code = code.astype(jnp.int8)
        return _coded({name: getattr(end, name) for name in _NUMBERS}, code)

    def _traces(self, p: Mapping[str, Array]) -> dict[str, Array]:
        of, start = self._lanes(p)
        duration = 20.0 * jnp.max(of.law.L, axis=1) / of.velocity
        if self.duration is not None:
            duration = jnp.full_like(duration, self.duration)
        phase = jnp.arange(1, self.samples + 1, dtype=duration.dtype) / self.samples
        found = ensemble.response(
            of,
            start,
            phase[:, None] * duration,
            rtol=self.rtol,
            max_steps=self.max_steps,
            runaway=min(self.runaway, 1e4),
        )
        code = jnp.where(found.escaped, 1, jnp.where(found.reached, 0, 2)).astype(jnp.int8)
        lost = (code == 2)[:, None]  # nothing is known after the last step
        return {
            "trace": code,
            "duration": duration,
            "force": jnp.where(lost, jnp.nan, found.force.T),
            "velocity": jnp.where(lost, jnp.nan, found.velocity.T),
        }


def _finite(slider: LinearSlider) -> Array:
    """Whether friction has a linearisation here."""
    finite = jnp.ones((), bool)
    for leaf in jax.tree.leaves(slider.friction):
        finite = finite & jnp.all(jnp.isfinite(leaf))
    return finite


def _coded(found: Mapping[str, Any], code: Array) -> dict[str, Array]:
    """Outputs of `ENDINGS`; a member whose end was not seen has no numbers."""
    lost = code == streaming.FAILED
    names = [name for name in found if name in _NUMBERS]
    return {name: jnp.where(lost, jnp.nan, found[name]) for name in names} | {"end": code}
