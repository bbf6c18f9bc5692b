"""The functions whose derivatives are compared with differences, one entry each.

To add one, write a function of the logarithms of its parameters that gives scalars by name, and
its entry in `ENTRIES`. Parameters are logarithms so that one step of differences fits all.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxfric import (
    AgeingEvolution,
    GeneralStribeck,
    HessSoom,
    Inertial,
    LinearSlider,
    LogarithmicEffect,
    QuasiStatic,
    RateState,
    RegularisedEffect,
    Rig,
    SlipEvolution,
    critical_stiffness,
    linearise,
    minimum_gains,
)
from jaxfric.effects import CATALOGUE
from jaxfric.rig.friction.law import Conditions
from jaxfric.rig.friction.memoryless import critical_velocity, worst_slope
from jaxfric.stability import delay, polynomial
from jaxfric.stability.delay_roots import rightmost_roots
from jaxfric.stability.kernel import FunctionKernel, StateSpaceKernel
from jaxfric.stability.linear import LinearFriction
from jaxfric.stability.margins import margins
from jaxfric.stability.theorem import apply_theorem

Point = Float[Array, " n"]
Scalars = Mapping[str, Float[Array, ""]]


@dataclass(frozen=True)
class Entry:
    """A function of logarithms of parameters, and the points at which it is compared."""

    function: Callable[[Point], Scalars]
    points: tuple[Mapping[str, float], ...]
    """Parameters by name, in the order of the function's argument."""
    step: float = 1e-3
    """Step of differences, in the logarithms."""
    quick: bool = False
    """Whether it compiles in seconds; the tests of the others are left out unless asked for."""

    def logarithms(self) -> Float[np.ndarray, "points n"]:
        """The points as rows."""
        return np.log([list(point.values()) for point in self.points])


def _about(number: int = 3, seed: int = 11, **ranges: tuple[float, float]):
    """Points drawn evenly in the logarithms of ranges."""
    draw = np.random.default_rng(seed)
    return tuple(
        {name: float(np.exp(draw.uniform(*np.log(ends)))) for name, ends in ranges.items()}
        for _ in range(number)
    )


def _machine(k: Array, c: Array, mass: Array | None):
    if mass is None:
        return QuasiStatic(stiffness=k, damping=c)
    return Inertial(stiffness=k, mass=mass, damping=c)


def _of_slider(slider: LinearSlider) -> Scalars:
    """All margins and the theorem; what is not finite at a point is left out there."""
    found = dict(margins(slider))
    if slider.delay is None:
        known = apply_theorem(slider)
        found |= {"k_cr": known.critical_stiffness, "w_cr": known.critical_frequency}
    return found


def _one_state(*, massless: bool = False, late: bool = False):
    def function(q: Point):
        A, B, L, k, c, V, m, T = jnp.exp(q)
        law = RateState(f0=300.0, A=A, B=[B], L=[L], V0=1e-6)
        slider = linearise(Rig(_machine(k, c, None if massless else m), law), V)
        if late:
            slider = LinearSlider(slider.mass, k, c, slider.friction, T)
        return _of_slider(slider)

    return function


_ONE = {
    "A": (3.0, 5.0),
    "B": (5.5, 8.0),
    "L": (2e-6, 5e-6),
    "k": (4e5, 4e6),
    "c": (1e2, 3e4),
    "V": (1e-6, 1e-5),
    "m": (1.0, 3.0),
    "T": (1e-5, 1e-4),
}


def _two_states(*, massless: bool = False):
    def function(q: Point):
        A, B1, B2, L1, L2, k, c, V, m = jnp.exp(q)
        law = RateState(f0=300.0, A=A, B=jnp.stack([B1, B2]), L=jnp.stack([L1, L2]), V0=1e-6)
        return _of_slider(linearise(Rig(_machine(k, c, None if massless else m), law), V))

    return function


_TWO = {
    "A": (3.0, 5.0),
    "B1": (5.0, 7.0),
    "B2": (2.0, 5.0),
    "L1": (2e-6, 5e-6),
    "L2": (3e-5, 6e-5),
    "k": (7e5, 3e6),
    "c": (1e2, 1e5),
    "V": (1e-6, 1e-5),
    "m": (1.0, 3.0),
}


def _memoryless(q: Point):
    """Friction that falls with velocity and rises with slip: all roots are of second degree."""
    f_v, f_x, k, c, m = jnp.exp(q)
    none = jnp.zeros((0,))
    friction = LinearFriction(-f_v, StateSpaceKernel(jnp.zeros((0, 0)), none, none), f_x)
    found = margins(LinearSlider(m, k, c, friction))
    return {name: value for name, value in found.items() if name != "stiffness"}


def _table(*, jump: bool):
    """A kernel that is a function of time: smooth, or one that ends at once."""

    def function(q: Point):
        f_v, k, c, m, g1, r1, g2, r2 = jnp.exp(q)

        def g(t: Array):
            decay = g1 * jnp.exp(-r1 * t) + g2 * jnp.exp(-r2 * t)
            return jnp.where(t < 2.0, decay, 0.0) if jump else decay

        breaks = (2.0,) if jump else ()
        kernel = FunctionKernel(g, 30.0, panels=16, order=12, breaks=breaks)
        friction = LinearFriction(f_v, kernel, jnp.zeros_like(f_v))
        return _of_slider(LinearSlider(m, k, c, friction))

    return function


_TABLE = {
    "f_v": (0.3, 0.5),
    "k": (1.0, 20.0),
    "c": (0.1, 0.5),
    "m": (0.1, 2.0),
    "g1": (1.0, 3.0),
    "r1": (0.7, 1.5),
    "g2": (2.0, 5.0),
    "r2": (3.0, 6.0),
}


def _delay_law(q: Point):
    c0, c1, c2, alpha, m, k, c, V = jnp.exp(q)
    law = HessSoom(c0, c1, c2, alpha)
    found = dict(_of_slider(linearise(Rig(_machine(k, c, m), law), V)))
    return {name: value for name, value in found.items() if name not in ("k_cr", "w_cr")}


def _rightmost(q: Point):
    root = rightmost_roots(*jnp.exp(q), number=3)
    return {f"{part}{i}": getattr(root[i], part) for i in range(3) for part in ("real", "imag")}


def _delay_crossings(q: Point):
    found = delay.crossings(*jnp.exp(q), number=2)
    names = ("plus_frequency", "plus_stiffness", "minus_frequency", "minus_stiffness")
    return {f"{name}{i}": getattr(found, name)[i] for name in names for i in range(2)}


_DELAY = {"m": (0.5, 2.0), "k_v": (0.1, 0.3), "k_f": (0.4, 0.8), "alpha": (0.1, 0.5)}


def _roots(q: Point):
    """Roots of polynomials of degree 2, 3 and 5, those of one degree told apart by their size."""
    c, found = jnp.exp(q), {}
    for degree in (2, 3, 5):
        s = polynomial.roots(c[: degree + 1])
        order = jnp.argsort(jnp.abs(s) + 0.3 * s.imag / jnp.abs(s))
        for i in range(degree):
            one = s[order[i]]
            found |= {f"real{degree}{i}": one.real, f"size{degree}{i}": jnp.abs(one)}
    return found


def _extended(amplitudes: Mapping[str, str]):
    """One state and effects of the catalogue, each with the name of its amplitude."""

    def function(q: Point):
        A, B, L, k, c, V, m, *sizes = jnp.exp(q)
        rig = Rig(_machine(k, c, m), RateState(f0=300.0, A=A, B=[B], L=[L], V0=1e-6))
        for (id, name), size in zip(amplitudes.items(), sizes, strict=True):
            rig = CATALOGUE[id](**{name: size}).embed(rig)
        return _of_slider(linearise(rig, V))

    return function


def _linearised(q: Point):
    """f_v, G(i w) and trend of laws with one state, and of one without."""
    A, B, L, V, w, c2, c3, c4 = jnp.exp(q)
    found = {}
    for evolution in (SlipEvolution(), AgeingEvolution()):
        for direct in (LogarithmicEffect(), RegularisedEffect()):
            law = RateState(5.0, A, [B], [L], 1e-6, evolution=evolution, direct=direct)
            name = type(evolution).__name__[:3] + type(direct).__name__[:3]
            found |= _friction(name, linearise(Rig(QuasiStatic(1.0), law), V), w)
    law = GeneralStribeck(c0=2.0, c1=3.0, c2=c2, c3=c3, c4=c4)
    found |= _friction("Stribeck", linearise(Rig(QuasiStatic(1.0), law), V), w)
    return found | {"worst_slope": worst_slope(law), "critical_velocity": critical_velocity(law)}


def _friction(name: str, slider: LinearSlider, w: Array):
    G = slider.friction.kernel.transform(1j * w)
    return {f"{name} f_v": slider.friction.slope, f"{name} Re G": G.real, f"{name} Im G": G.imag}


def _inverted(q: Point):
    """The velocity at which friction and a dashpot balance a force, and back at once."""
    A, theta, V0, force, c = jnp.exp(q)
    at = Conditions(jnp.zeros(()), jnp.zeros(()))
    found = {}
    for direct in (LogarithmicEffect(), RegularisedEffect()):
        law = RateState(5.0, A, [1.0], [1.0], V0, direct=direct)
        for sign in (1, -1) if isinstance(direct, RegularisedEffect) else (1,):
            for damping in (None, c):
                V = law.velocity(sign * force, theta[None], at, damping=damping)
                name = f"{type(direct).__name__[:3]} {sign} {'damped' if damping is c else ''}"
                found[name] = V / V0
    return found


def _critical(q: Point):
    """Critical stiffness of a massless slider by the law, of one, two and three states."""
    A, *rest = jnp.exp(q)
    B, L = jnp.stack(rest[:3]), jnp.stack(rest[3:])
    law = [RateState(300.0, A, B[:n] * 3 / n, L[:n], 1e-6) for n in (1, 2, 3)]
    return {f"{n} states": critical_stiffness(one) for n, one in enumerate(law, start=1)}


def _least_gains(
    late: float | None = None, scale: tuple[float, float] = (1000.0, 1500.0), **margins: float
):
    """Least gains of a slip law with mass at two velocities; the controller answers `late` [s]."""

    def function(q: Point):
        A, B, L, m = jnp.exp(q)
        law = RateState(50.0, A, B[None], L[None], 2e-3)
        V = np.asarray([1e-3, 4e-3])
        found = minimum_gains(law, V, m, margins, scale=scale, delay=late)
        return {"k_p": found.k_p, "norm": found.norm}

    return Entry(
        function,
        _about(2, A=(0.8, 1.2), B=(2.5, 3.5), L=(8e-4, 1.2e-3), m=(2.0, 4.0)),
    )


_EFFECTS = {
    "second_state": "B2",
    "velocity_dependent_L": "n",
    "evolution_cutoff": "c",
    "viscous": "c",
    "slip_trend": "s",
    "thermal": "a_T",
}
ENTRIES: dict[str, Entry] = {
    "margins: no memory": Entry(
        _memoryless,
        _about(f_v=(0.3, 0.5), f_x=(0.2, 2.0), k=(1.0, 20.0), c=(0.6, 0.9), m=(0.1, 2.0)),
        quick=True,
    ),
    "margins: one state": Entry(_one_state(), _about(**_ONE)),
    "margins: one state, no mass": Entry(_one_state(massless=True), _about(**_ONE)),
    "margins: one state, late controller": Entry(_one_state(late=True), _about(1, **_ONE)),
    "margins: two states": Entry(_two_states(), _about(**_TWO)),
    "margins: two states, no mass": Entry(_two_states(massless=True), _about(**_TWO)),
    "margins: table": Entry(_table(jump=False), _about(2, **_TABLE)),
    "margins: table with a jump": Entry(_table(jump=True), _about(2, **_TABLE)),
    "margins: delay law": Entry(
        _delay_law,
        _about(
            c0=(0.05, 0.1),
            c1=(1.0, 2.0),
            c2=(0.5, 1.0),
            alpha=(0.1, 0.4),
            m=(0.5, 2.0),
            k=(20.0, 300.0),
            c=(0.1, 0.4),
            V=(0.5, 1.0),
        ),
    ),
    "margins: effects": Entry(
        _extended(_EFFECTS),
        _about(
            A=(3.0, 5.0),
            B=(5.5, 8.0),
            L=(2e-6, 5e-6),
            k=(4e5, 4e6),
            c=(1e2, 3e4),
            V=(1e-6, 1e-5),
            m=(1.0, 3.0),
            B2=(0.5, 2.0),
            n=(0.05, 0.2),
            cutoff=(1e3, 1e4),
            viscous=(1e2, 1e4),
            trend=(1e3, 1e4),
            a_T=(0.1, 1.0),
        ),
    ),
    "delay roots": Entry(
        _rightmost,
        _about(m=(0.5, 2.0), k_p=(20.0, 600.0), **{n: _DELAY[n] for n in ("k_v", "k_f", "alpha")}),
        quick=True,
    ),
    "delay crossings": Entry(_delay_crossings, _about(**_DELAY), quick=True),
    "roots": Entry(_roots, _about(**{f"c{i}": (0.3, 3.0) for i in range(6)})),
    "linearise": Entry(
        _linearised,
        _about(
            A=(0.5, 1.0),
            B=(1.0, 3.0),
            L=(1e-6, 1e-5),
            V=(1e-7, 1e-4),
            w=(0.1, 10.0),
            c2=(1.0, 3.0),
            c3=(1e-6, 1e-5),
            c4=(1.2, 2.5),
        ),
    ),
    "velocity of a force": Entry(
        _inverted,
        _about(A=(0.4, 1.0), theta=(0.5, 1.0), V0=(1e-6, 1e-5), force=(4.5, 8.0), c=(1e3, 1e6)),
    ),
    "gains: modulus": _least_gains(modulus=0.5),
    "gains: decay": _least_gains(decay=0.5),
    "gains: damping": _least_gains(damping=0.1),
    "gains: gain": _least_gains(gain=2.0),
    # where damping costs less, the least gains are those at which the margin jumps
    "gains: phase": _least_gains(phase=0.5, scale=(4000.0, 1500.0)),
    "gains: delay": _least_gains(modulus=0.5, delay=1e-3),
    "gains: late controller": _least_gains(1e-4, modulus=0.5),
    "critical stiffness of a law": Entry(
        _critical,
        _about(
            A=(3.0, 5.0),
            **{f"B{i}": (2.0, 4.0) for i in range(3)},
            **{f"L{i}": (2e-6 * 4**i, 4e-6 * 4**i) for i in range(3)},
        ),
        quick=True,
    ),
}
"""Every entry by its name."""
