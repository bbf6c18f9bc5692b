"""Motions of many sliders after a step of the command: end states, and friction over time.

For massless sliders under the slip and ageing laws `members.ends` determines the end state during
the simulation. For other sliders `gains.settle` stores all steps of the solver, and takes about 20
times as long as `members.ends`.
"""

import functools
from collections.abc import Mapping
from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..errors import InputError
from ..findings import WarningCode, warned
from ..gains.ends import ENDS
from ..gains.settle import Policy, end_and_share, slowest_mode, stretched
from ..gains.thresholds import RUNAWAY
from ..motion import PiecewiseVelocity
from ..rig import QuasiStatic, Rig
from ..rig.friction import AbstractInvertibleLaw, LogarithmicEffect, RateState
from ..simulation import RESULTS, simulate, step_start
from ..simulation.start import regularised
from ..stability.margins import poles
from ..study import Axis, Output
from ..tables import Table, flag, positive, refuse_unknown, whole
from ..threads import at_once
from . import ends as streaming
from .parameters import parameter, rate_state, value_of
from .sliders import Parameters, Sliders, sliders_of, streamed
from .spec import Spec, StudyPart

# A motion over time stops if the slider is this much faster than commanded.
_LEFT = 1e4
TRACE = {
    "whole": "The motion was followed for its whole duration.",
    "escape": f"The slider became faster than {_LEFT:g} V0; the last values before hold.",
    "failed": "Too many steps were needed: raise max_steps.",
}
ENDINGS = (
    Output("end", long_name="end of the motion after a step", codes=streaming.CODES),
    Output("velocity_amplitude", "m/s", "half of the range of the velocity"),
    Output("slip_amplitude", "m", "slip amplitude: half of the range of slip less V0 t at the end"),
    Output("least_velocity", "m/s", "smallest velocity at the end"),
    Output("period", "s", "period of the limit cycle"),
    Output("period_spread", "s", "half of the range of the periods of its cycles"),
)
_ENDINGS = {output.name for output in ENDINGS}
_NUMBERS = tuple(output.name for output in ENDINGS if output.name != "end")
_IN_TIME = {"force", "velocity"}
_KEYS = ("ratio", "samples", "duration", "rtol", "max_steps", "inertia")
# Members of a block: they compute in about a second, and their traces fit into memory.
_CHUNK_WITH_TRACES, _CHUNK_SLOW = 16384, 1024
# Members that share a loop, also of the stiff solver: all wait for the slowest.
_BATCH, _BATCH_SLOW = 64, 24
# First limit of steps of the general solver, and number of members repeated at once.
_FEW_STEPS, _AGAIN = 1024, 12
# Steady friction in units of A above which the regularised and the logarithmic direct effect agree
# to rounding; number of samples that are searched for the smallest friction.
_FAR_FROM_REST, _SEEN = 20.0, 4096
# Decay times until a stable slider is at its end state; solver steps of an oscillating one.
_FOLDS, _CYCLING = 12.0, 700.0


def traces(samples: int) -> tuple[Output, ...]:
    """Return the outputs that hold the motion at a number `samples` of times."""
    part = Axis("part", np.arange(1, samples + 1) / samples, "1", "time over the duration")
    return (
        Output("trace", long_name="whether the whole motion was simulated", codes=TRACE),
        Output("duration", "s", "duration of the motion"),
        Output("force", "N", "friction", dims=(part,)),
        Output("velocity", "m/s", "velocity of the slider", dims=(part,)),
    )


@dataclass(frozen=True, eq=False)
class Motions:
    """Motions after a step of the commanded velocity by the factor `ratio`, to V0.

    wanted : names of outputs.
    inertia : whether the simulation includes mass.
    """

    sliders: Sliders
    wanted: tuple[str, ...]
    samples: int = 100
    duration: float | None = None
    """Simulated time [s]; None: twenty slip lengths at V0."""
    rtol: float = 1e-6
    max_steps: int = 16384
    inertia: bool = False

    def __call__(self, varied: Parameters) -> dict[str, Array]:
        """Return the outputs of an array of members."""
        p = self.sliders.parameters(varied)
        found: dict[str, Array] = {}
        if _ENDINGS & set(self.wanted):
            found |= self._general(p) if self.slow else jax.vmap(self._streamed)(p)
        if set(self.wanted) - _ENDINGS:
            found |= jax.vmap(self._trace)(p)
        return found

    @property
    def slow(self) -> bool:
        """Whether the motions need the general solver, which is slow."""
        return self.inertia or not streamed(self.sliders.law)

    def cost(self, varied: Parameters) -> Array:
        """Estimate the number of solver steps of a member, for sorting.

        A stable slider is simulated until its slowest mode has decayed. An unstable slider is
        simulated for about ten cycles. If motion over time is an output, a smaller k_p/k_cr needs
        more steps.
        """
        p = self.sliders.parameters(varied)
        if _ENDINGS & set(self.wanted):
            return jax.vmap(self._steps)(p)
        states = range(1, self.sliders.states + 1)
        B = sum((p["B" if i == 1 else f"B{i}"] for i in states), jnp.zeros_like(p["A"]))
        return (B - p["A"] - p["k_v"] * p["V0"]) / (p["L"] * p["k_p"])

    def _steps(self, p: Parameters) -> Array:
        s = poles(self.sliders.linear(p, mass=self.inertia))
        decay, turns = -jnp.max(s.real), jnp.max(jnp.abs(s.imag)) * 2.5
        # steps of the general solver may be longer than the decay time of a mode
        pace = turns if self.slow else jnp.maximum(turns, jnp.max(jnp.abs(s)) / 3)
        longest = _FOLDS / jnp.maximum(decay, 1e-300)
        cycling = _CYCLING * (5 if self.slow else 1)
        return jnp.where(decay > 0, jnp.minimum(longest * pace, 1e6), cycling)

    def _pace(self, p: Parameters) -> tuple[Array, Array]:
        """Return the slowest relevant mode and the slowest decay [1/s]."""
        s = poles(self.sliders.linear(p, mass=self.inertia))
        return slowest_mode(s), -jnp.max(s.real)

    def _massless(self, p: Parameters) -> tuple[Rig, RateState]:
        """Return the rig of one member and its law, with the logarithmic direct effect."""
        kind = self.sliders.law
        assert isinstance(kind, str)
        law = rate_state(kind, p, self.sliders.states, LogarithmicEffect())
        assert isinstance(law, RateState)
        return Rig(QuasiStatic(p["k_p"], p["k_v"]), law), law

    def _streamed(self, p: Parameters) -> dict[str, Array]:
        """Return the outputs of one member, with `members.ends`."""
        rig, law = self._massless(p)
        slowest, decay = self._pace(p)
        horizon = streaming.horizon_of(slowest, law.A, p["k_p"], p["V0"])
        found = streaming.end_of(
            rig,
            p["V0"],
            step_start(rig, p["V0"], p["ratio"]),
            horizon=stretched(horizon, decay),
            decay=decay,
            policy=self._policy,
        )
        return _coded(found._asdict(), found.code, p["V0"])

    @property
    def _policy(self) -> Policy:
        return Policy(10 * self.rtol, self.max_steps, RUNAWAY, partial=False)

    def _general(self, p: Parameters) -> dict[str, Array]:
        """Return the outputs with the general solver.

        It allocates and reads the largest number of steps of a motion, used or not, so that this
        limit is low at first. Members that need more are repeated, a few at a time that came
        equally far.
        """

        def followed(p: Parameters, steps: int) -> tuple[dict[str, Array], Array]:
            policy = replace(self._policy, max_steps=steps)
            return jax.vmap(functools.partial(self._ending, policy=policy))(p)

        if self.max_steps <= _FEW_STEPS:
            return followed(p, self.max_steps)[0]
        first, share = followed(p, _FEW_STEPS)
        lacks = first["end"] == streaming.FAILED
        few = at_once(_AGAIN)
        share = jnp.fmin(share, 2.0)  # also replaces nan
        order = jnp.argsort(jnp.where(lacks, share, jnp.inf))
        order = jnp.pad(order, (0, -len(lacks) % few), mode="edge")

        def again(state: tuple[Array, dict[str, Array]]) -> tuple[Array, dict[str, Array]]:
            begin, found = state
            those = jax.lax.dynamic_slice(order, (begin,), (few,))
            more, _ = followed({name: x[those] for name, x in p.items()}, self.max_steps)
            return begin + few, {name: x.at[those].set(more[name]) for name, x in found.items()}

        count = jnp.sum(lacks)
        return jax.lax.while_loop(lambda s: s[0] < count, again, (jnp.zeros_like(count), first))[1]

    def _ending(self, p: Parameters, policy: Policy) -> tuple[dict[str, Array], Array]:
        """Return the outputs of one member, and the simulated share of its time."""
        rig = self.sliders.rig(p, mass=self.inertia)
        slowest, decay = self._pace(p)
        scale = rig.friction.force_scale()
        horizon = streaming.horizon_of(slowest, scale, p["k_p"], p["V0"])
        rig = regularised(rig)
        end, share = end_and_share(
            rig,
            p["V0"],
            step_start(rig, p["V0"], p["ratio"]),
            horizon=horizon,
            decay=decay,
            policy=policy,
        )
        names = ("steady", "limit_cycle", "escape", "unresolved")
        masks = jnp.stack([end.code == getattr(ENDS, name) for name in names])
        code = jnp.argmax(masks, axis=0).astype(jnp.int8)
        # an unstable slider cannot slide steadily: its oscillation is still too small
        code = jnp.where((code == streaming.STEADY) & (decay < 0), streaming.FAILED, code)
        code = code.astype(jnp.int8)
        return _coded({name: getattr(end, name) for name in _NUMBERS}, code, p["V0"]), share

    def _trace(self, p: Parameters) -> dict[str, Array]:
        """Return friction and velocity of one member over time."""
        rig, law = self._massless(p)
        duration = 20.0 * jnp.max(law.L) / p["V0"]
        if self.duration is not None:
            duration = jnp.full_like(duration, self.duration)
        found = simulate(
            rig,
            PiecewiseVelocity(jnp.zeros_like(duration)[None], p["V0"][None]),
            duration * jnp.arange(self.samples + 1, dtype=duration.dtype) / self.samples,
            start=step_start(rig, p["V0"], p["ratio"]),
            rtol=self.rtol,
            max_steps=self.max_steps,
            runaway=_LEFT,
            stiff=False,
        )
        whole, left = found.result == RESULTS.successful, found.result == RESULTS.ran_away
        code = jnp.where(left, 1, jnp.where(whole, 0, 2)).astype(jnp.int8)
        lost = code == 2  # nothing is known after the last step
        return {
            "trace": code,
            "duration": duration,
            "force": jnp.where(lost, jnp.nan, found.force[1:]),
            "velocity": jnp.where(lost, jnp.nan, found.velocity[1:]),
        }


def _coded(found: Mapping[str, Array], code: Array, velocity: Array) -> dict[str, Array]:
    """Return outputs of `ENDINGS`.

    A steady slider moves at `velocity` [m/s], with amplitude 0. What is left of its oscillation
    depends on when the simulation stopped. Without a known end state the numbers are undefined.
    """
    steadily = {"velocity_amplitude": 0.0, "slip_amplitude": 0.0, "least_velocity": velocity}
    found = {**found} | {
        name: jnp.where(code == streaming.STEADY, x, found[name]) for name, x in steadily.items()
    }
    lost = code == streaming.FAILED
    return {name: jnp.where(lost, jnp.nan, found[name]) for name in _NUMBERS} | {"end": code}


def make_motions(spec: Spec, table: Table, where: str) -> StudyPart:
    """Make the study part of `compute = ["simulate"]` from the table [simulate].

    Raises
    ------
    InputError : an unknown key, an invalid value, a motion that is defined only with mass.
    """
    function = _function(spec, table, where)
    end = replace(ENDINGS[0], long_name=f"end of the motion after {_step(spec, function)}")
    outputs = (end, *ENDINGS[1:], *traces(function.samples))
    usual = tuple(o.name for o in (outputs if "samples" in table else ENDINGS))
    part = StudyPart(function, outputs, usual, mass=function.inertia)
    wanted = {output.name for output in part.kept(spec)}
    function = replace(function, wanted=tuple(wanted))
    traced, ended = bool(_IN_TIME & wanted), bool(_ENDINGS & wanted)
    if traced and function.slow:
        raise InputError(
            f"{spec.path.name}: force and velocity over time need a massless slider under the slip"
            " or ageing law; leave these outputs out"
        )
    part = replace(part, function=function, cost=function.cost if traced or ended else None)
    if ended and function.slow:
        return replace(part, chunk=_CHUNK_SLOW, batch=_BATCH_SLOW)
    if traced:
        part = replace(part, chunk=_CHUNK_WITH_TRACES)
    if traced or ended:
        part = replace(part, batch=_BATCH, warnings=_logarithmic(spec))
    return part


def _step(spec: Spec, function: Motions) -> str:
    """Describe the step of the command."""
    ratio = function.sliders.fixed.get("ratio")
    if "ratio" in spec.grid.names or ratio is None:
        return "a step from V0/ratio to V0"
    return f"a step from {f'V0/{ratio:g}' if ratio > 1 else f'{1 / ratio:g} V0'} to V0"


def _function(spec: Spec, table: Table, where: str) -> Motions:
    """Return the function of [simulate], without outputs yet."""
    refuse_unknown(table, _KEYS, where)
    sliders = sliders_of(spec)
    if "ratio" in table:
        place = f"{where} ratio"
        ratio = value_of(table["ratio"], parameter("ratio", place), place)
        sliders = replace(sliders, fixed={**sliders.fixed, "ratio": ratio})
    axis = next((axis.values for axis in spec.grid.axes if axis.name == "ratio"), ())
    if 1.0 in (sliders.fixed.get("ratio"), *axis):
        raise InputError(
            f"{where}: ratio is 1: without a step even an unstable slider stays in steady sliding;"
            " give another, as 1.01"
        )
    unique = isinstance(sliders.law, str | AbstractInvertibleLaw)
    inertia = flag(table, "inertia", where, usual=not unique)
    if table.get("inertia") and "m" not in (*spec.fixed, *spec.grid.names):
        raise InputError(f"{where}: inertia needs a mass, m = '2 kg' in [rig]")
    if not (inertia or unique):
        raise InputError(
            f"{where}: the law of the file has no velocity of its own at a given force; leave"
            " inertia = false out, so that its mass takes part"
        )
    rtol = table.get("rtol", 1e-6)
    if isinstance(rtol, bool) or not isinstance(rtol, float | int) or not 1e-10 <= rtol <= 1e-2:
        raise InputError(f"{where}: rtol is {rtol!r}; it is a number from 1e-10 to 1e-2")
    return Motions(
        sliders,
        (),
        whole(table, "samples", where) or Motions.samples,
        positive(table, "duration", "s", where),
        float(rtol),
        whole(table, "max_steps", where, 16) or Motions.max_steps,
        inertia,
    )


def _logarithmic(spec: Spec) -> tuple[str, ...]:
    """Warn if massless motions differ from those with the regularised direct effect."""
    if "f0" not in (*spec.fixed, *spec.grid.names):
        return ()  # 50 A
    least = _range_of(spec, "f0")[0] / _range_of(spec, "A")[1]
    if least > _FAR_FROM_REST:
        return ()
    return (warned(WarningCode.LOGARITHM, least=least),)


def _range_of(spec: Spec, name: str) -> tuple[float, float]:
    """Return the range of a parameter; for a drawn one, that of the first samples."""
    if name in spec.fixed:
        return spec.fixed[name], spec.fixed[name]
    values = [np.asarray(axis.values) for axis in spec.grid.axes if axis.name == name]
    samples = spec.grid.samples
    if samples is not None and not values:
        values = [samples.draw(0, min(samples.number, _SEEN))[name]]
    return float(np.min(values)), float(np.max(values))
