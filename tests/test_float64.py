"""Every entry that fits, searches or computes gains refuses 32-bit numbers before it computes."""

from pathlib import Path
from typing import cast

import jax
import numpy as np
import pytest

import jaxfric as jf
from jaxfric.fitting.stiffness import MachineStiffness
from jaxfric.protocol import Planned, plan
from jaxfric.records.steady import SteadyCurve
from jaxfric.runs import find_events
from jaxfric.runs.fits import HowFitted, fit_run

ROOT = Path(__file__).parents[1]
STEP, AXIS = ROOT / "data" / "velocity_step.csv", ROOT / "data" / "axis.csv"
SLIP = {"f0": 0.6, "A": 0.01, "B": 0.015, "L": 2e-5, "V0": 1e-6}


def law():
    return jf.law_from_parameters("slip", "A=1 N, B=3 N, L=1 mm, V0=1 mm/s")


def curve():
    speed = np.repeat([-0.4, -0.2, -0.1, -0.05, 0.05, 0.1, 0.2, 0.4], 2)
    one, names = np.ones(len(speed)), tuple(map(str, range(len(speed))))
    force = np.sign(speed) + speed
    return SteadyCurve(speed, force, one, one, one, 0.01 * one, 0 * one, names)


def run():
    record, how = jf.read(STEP), HowFitted(MachineStiffness(5e3))
    return fit_run(record, find_events(record, stiffness=how.stiffness).events, how)


ENTRIES = {
    "fit": lambda: jf.fit(STEP, stiffness=5e3),
    "fit_many": lambda: jf.fit_many([STEP], stiffness=5e3),
    "run": run,
    "compare_laws": lambda: jf.compare_laws(STEP, stiffness=5e3),
    "close_loop": lambda: jf.close_loop(STEP, stiffness=5e3),
    "close_axis_loop": lambda: jf.close_axis_loop(AXIS),
    "close_steady_loop": lambda: jf.close_steady_loop(curve()),
    "predict": lambda: jf.predict(ROOT / "fits/emps/loop/loop.json", jf.read_axis(AXIS)),
    "find_posterior": lambda: jf.find_posterior(cast(jf.Fit, None)),
    "plan": lambda: plan(Planned([1e-6, 1e-5, 1e-6], 1e-4, 5e3, 1e-3, SLIP)),
    "find_gains": lambda: jf.find_gains(law(), velocity="1 mm/s", mass=None),
    "gain_schedule": lambda: jf.gain_schedule(law(), velocity=(1e-3, 1e-2), mass=None),
    "minimum_gains": lambda: jf.minimum_gains(law().law, 1e-3, None, {"stiffness": 1.5}),
}


@pytest.mark.parametrize("entry", ENTRIES)
def test_32_bit_numbers_are_refused(entry):
    with jax.enable_x64(False), pytest.raises(jf.InputError, match="64-bit numbers"):
        ENTRIES[entry]()
