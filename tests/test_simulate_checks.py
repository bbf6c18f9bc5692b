"""What a simulation refuses: by name where it is known, by its result where it is traced."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxfric import (
    Inertial,
    InitialState,
    InputError,
    PiecewiseVelocity,
    QuasiStatic,
    RateState,
    Rig,
    critical_stiffness,
    fit_many,
    linearise,
    minimum_gains,
    simulate,
    simulate_delay,
)
from jaxfric.quantity import all_inside, refuse_outside
from jaxfric.rig.friction import HessSoom
from jaxfric.simulation.trajectory import RESULTS

MOTION = PiecewiseVelocity([0.0, 10.0], [1e-6, 1e-5])
TS = np.linspace(0.0, 40.0, 9)


def law(**changed):
    given = {"f0": 0.6, "A": 0.01, "B": [0.014], "L": [20e-6], "V0": 1e-6} | changed
    return RateState(**given)


def delay_law(delay=0.3):
    return HessSoom(c0=0.1, c1=1.0, c2=1.0, delay=delay)


def run(ts=TS, motion=MOTION, start=None, **policy):
    return simulate(Rig(QuasiStatic(1e3), law()), motion, jnp.asarray(ts), start=start, **policy)


def many():
    return Rig(QuasiStatic([1e3, 2e3]), law())


def run_delay(ts=TS, velocity=0.5):
    return simulate_delay(Rig(Inertial(1.0, 100.0), delay_law()), velocity, jnp.asarray(ts))


@pytest.mark.parametrize(
    ("ask", "says"),
    [
        (lambda: law(A=0.0), r"direct effect \(A\) is 0; it must be above 0"),
        (lambda: law(A=np.nan), "A"),
        (lambda: law(L=[-1e-6]), r"\(L\) is -1e-06"),
        (lambda: law(V0=0.0), "V0"),
        (lambda: law(f0=np.inf), r"\(f0\) is inf; it must be finite"),
        (lambda: law(B=[1.0, 2.0]), r"B has shape \(2,\) and L \(1,\)"),
        (lambda: law(B=1.0, L=1e-6), r"as in B=\[3.0\]"),
        (lambda: QuasiStatic(-1.0), r"stiffness \(K\) is -1"),
        (lambda: QuasiStatic(1.0, -2.0), r"\(k_v\) is -2; it must be 0 or more"),
        (lambda: Inertial(0.0, 1.0), r"mass \(m\) is 0"),
        (lambda: delay_law(delay=0.0), "alpha"),
        (lambda: PiecewiseVelocity([0.0, -1.0], [1.0, 2.0]), "times must ascend"),
        (lambda: PiecewiseVelocity([np.inf], [1.0]), "times must ascend"),
        (lambda: PiecewiseVelocity([0.0], [np.nan]), "velocity is not finite"),
        (lambda: run(TS[::-1]), r"ts\[1\] = 35 s comes after 40 s"),
        (lambda: run([0.0, np.nan, 2.0]), "ts holds a value that is not finite"),
        (lambda: run(TS - 1.0), "ts begins at -1 s, before the motion"),
        (lambda: run(motion=PiecewiseVelocity([0.0], [0.0])), "no steady sliding at 0 m/s"),
        (lambda: run(start=InitialState(elongation=np.inf)), "start.elongation"),
        (lambda: run(runaway=0.5), "runaway is 0.5"),
        (lambda: run(max_steps=0), "max_steps is 0"),
        (lambda: run(start=1e-6), r"start is 1e-06; give an InitialState"),
        (lambda: run(start=InitialState(state=[0.0, 0.0])), r"shape \(2,\).* has shape \(1,\)"),
        (lambda: run(start=InitialState(state=0.1)), r"shape \(\).* has shape \(1,\)"),
        (lambda: QuasiStatic("5e-3/um"), "'5e-3/um' is no number"),
        (lambda: PiecewiseVelocity([0.0], ["1 um/s"]), "is no number"),
        (
            lambda: simulate(Rig(law(), QuasiStatic(1.0)), MOTION, TS),
            "is a QuasiStatic, which is no",
        ),
        (lambda: critical_stiffness(delay_law()), "HessSoom, no rate-and-state law"),
        (lambda: fit_many("x.csv"), "give a list of records"),
        (lambda: run_delay(TS[::-1]), "ts must ascend"),
        (lambda: run_delay(velocity=0.0), "velocity is 0 m/s"),
        (lambda: run_delay(velocity=-1.0), "velocity is -1 m/s"),
        (lambda: simulate(many(), MOTION, TS), r"simulate: K has shape \(2,\).*jax.vmap"),
        (lambda: linearise(many(), 1e-6), r"linearise: K has shape \(2,\).*jax.vmap"),
        (lambda: linearise(Rig(QuasiStatic(1.0), law()), [1e-6, 2e-6]), r"velocity has shape"),
        (lambda: critical_stiffness(law(A=[0.01, 0.02])), r"A has shape \(2,\)"),
        (lambda: minimum_gains(law(), jnp.zeros(0), 1.0, {}), r"have shape \(0,\)"),
    ],
)
def test_what_is_known_is_refused_by_name(ask, says):
    with pytest.raises(InputError, match=says):
        ask()


def test_bounds_of_what_is_inside_a_module_are_seen():
    rig = Rig(QuasiStatic(1e3), law())
    refuse_outside(rig, "rig")
    assert bool(all_inside(rig))
    wrong = eqx.tree_at(lambda rig: rig.friction.L, rig, jnp.array([-1.0]))
    assert not bool(all_inside(wrong))
    with pytest.raises(InputError, match=r"rig: characteristic slip length \(L\) is -1"):
        refuse_outside(wrong, "rig")
    # the null of an effect on its bound is none: damping 0, a lag of 0
    assert bool(all_inside(Rig(Inertial(1.0, 1.0, 0.0), law())))


def test_times_of_single_precision_are_those_of_the_rig():
    found, exact = run(TS.astype(np.float32)), run()
    assert found.force.dtype == exact.force.dtype
    np.testing.assert_allclose(found.force, exact.force, rtol=1e-6)


def test_under_jit_and_vmap_the_result_says_so():
    cases = {
        "fine": (1e3, 0.01, TS),
        "K": (-1e3, 0.01, TS),
        "A": (1e3, 0.0, TS),
        "nan": (1e3, np.nan, TS),
        "descends": (1e3, 0.01, TS[::-1]),
        "early": (1e3, 0.01, TS - 1),
        "nan time": (1e3, 0.01, np.where(TS == 20, np.nan, TS)),
    }

    @jax.jit
    @jax.vmap
    def found(stiffness, A, ts):
        out = simulate(Rig(QuasiStatic(stiffness), law(A=A)), MOTION, ts, max_steps=256)
        return out.result, jnp.stack([out.force, out.velocity, out.slip]), out.end

    results, values, end = found(*(jnp.asarray(x) for x in zip(*cases.values(), strict=True)))
    impossible = np.asarray(results == RESULTS.impossible)
    assert dict(zip(cases, impossible, strict=True)) == {name: name != "fine" for name in cases}
    assert bool((results == RESULTS.successful)[0])
    assert np.isfinite(values).all() and end[0] == 40 and not np.any(end[1:])
    assert np.all(values[1:] == 0)


def test_an_impossible_delay_is_told_under_jit():
    @jax.jit
    def found(delay, velocity):
        rig = Rig(Inertial(1.0, 100.0), delay_law(delay))
        out = simulate_delay(rig, velocity, jnp.asarray(TS[:2]), intervals=40, pieces=2, rtol=1e-2)
        return out.result, out.velocity

    for delay, velocity in ((-0.3, 0.5), (0.3, -0.5), (0.3, np.nan)):
        result, values = found(delay, velocity)
        assert result == RESULTS.impossible and np.all(np.asarray(values) == 0)
    assert found(0.3, 0.5)[0] != RESULTS.impossible
