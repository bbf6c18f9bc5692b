"""Hunting of a slider with integral action about its target, against SciPy.

The reference solves every slip to the time at which the velocity is zero. A stuck slider does not
creep: its integral grows until the force exceeds static friction c0 + c2.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from jaxfric import check_gains, find_gains, law_from_parameters
from jaxfric.laws.source import stack
from jaxfric.report import gains as gains_report
from jaxfric.report.gains import report

STEEP = (10.0, 50.0, 5.0, 2e-3)
"""c0 [N], c1 [N s/m], c2 [N], c3 [m/s] of a law that falls much at low velocity."""
FALLS = (1.0, 2.0, 1.5, 0.02)
EVEN = (1.0, 2.0, 0.0, 0.02)
"""Kinetic friction that is not below static friction."""


def law(c0, c1, c2, c3, c4=2.0):
    text = f"c0={c0} N, c1={c1} N s/m, c2={c2} N, c3={c3} m/s, c4={c4}"
    return law_from_parameters("stribeck", text)


def found(of, mass=2.0, integral=800.0, **given):
    given = {"velocity": 0.1, "margin": {"decay": 0.0, "modulus": 0.0}, **given}
    return find_gains(of, mass=mass, integral_gain=integral, **given)


def checked(k_p, k_v, *of, **given):
    return check_gains(replace(found(*of, **given), kp=k_p, kv=k_v))


def by_scipy(k_p, k_v, k_i, curve, c4, mass, end):
    """Half the range of x in the last half, and the mean time between slips to the same side."""
    c0, c1, c2, c3 = curve
    static = c0 + c2
    t, x, total, stops = 0.0, -2 * static / k_p, 0.0, []
    while t < end:
        force = -k_p * x + k_i * total
        if abs(force) < static:
            wait = (np.sign(-x) * static * (1 + 1e-5) - force) / (-k_i * x)
            stops.append((t, x))
            t, total = t + wait, total - x * wait
        way = np.sign(-k_p * x + k_i * total)

        def slope(_, y, way=way):
            x, v, total = y
            friction = c0 + c1 * abs(v) + c2 * np.exp(-((abs(v) / c3) ** c4))
            return [v, (-k_p * x - k_v * v + k_i * total - way * friction) / mass, -x]

        def stopped(_, y, way=way):
            return way * y[1]

        stopped.terminal, stopped.direction = True, -1
        small = [1e-11 * static / k_p] * 3
        one = solve_ivp(
            slope, (t, t + end), [x, 0, total], "LSODA", events=stopped, rtol=1e-8, atol=small
        )
        t, x, total = one.t[-1], one.y[0, -1], one.y[2, -1]
    at, x = np.transpose([(t, x) for t, x in stops if t > end / 2])
    right = at[x > x.mean()]
    return np.ptp(x) / 2, np.diff(right).mean()


@pytest.mark.parametrize(
    ("k_p", "k_v", "k_i", "curve", "c4", "mass", "end"),
    [
        (400.0, 1.0, 800.0, FALLS, 2.0, 1.0, 60.0),
        (5e3, 100.0, 5e3, STEEP, 2.0, 2.0, 600.0),
        (5e3, 1e3, 5e4, STEEP, 1.0, 2.0, 200.0),
    ],
)
def test_amplitude_and_period_of_hunting(k_p, k_v, k_i, curve, c4, mass, end):
    """In the second and third case a slider sticks for 3 to 100 times k_p/k_i."""
    seen = checked(k_p, k_v, law(*curve, c4), mass, k_i).hunting
    amplitude, period = by_scipy(k_p, k_v, k_i, curve, c4, mass, end)
    assert seen.clear and seen.amplitude == pytest.approx(amplitude, rel=2e-2)
    assert seen.period == pytest.approx(period, rel=1e-2)
    assert seen.error == pytest.approx(seen.amplitude, rel=0.1)


def test_a_slider_that_sticks_off_its_target_is_not_clear():
    k_p, k_v, k_i, curve = 16930.0, 6500.0, 5e4, (1.0, 50.0, 14.0, 2e-3)
    told = checked(k_p, k_v, law(*curve, 1.0), 2.0, k_i)
    amplitude, period = by_scipy(k_p, k_v, k_i, curve, 1.0, 2.0, 6000.0)
    assert not told.hunting.clear and told.hunting.amplitude is None
    assert amplitude < told.hunting.error < 2 * amplitude
    assert period > told.hunting.duration / 2
    assert gains_report.content(told)["at_rest"]["hunting"]["clear"] is False
    assert any("not clear within" in line for line in report(told).lines)


def test_without_a_fall_of_friction_nothing_hunts():
    seen = checked(400.0, 1.0, law(*EVEN), mass=1.0).hunting
    assert seen.clear and seen.amplitude is None and seen.period is None
    assert seen.error < 1e-3 / 400 and seen.duration > 100


def test_a_linearly_unstable_controller_runs_away():
    """(k_v + 2) k_p < m k_i: Routh and Hurwitz."""
    seen = checked(400.0, 1.0, law(*EVEN), mass=1.0, integral=4e3).hunting
    assert gains_report.hunting_entry(seen)["grows"]


def test_masses_and_samples_of_the_law_are_simulated():
    """The answer is of the slider that hunts most; the requested velocity is no matter."""
    laws = stack([law(1.0, 2.0, drop, 0.02).law for drop in (0.5, 0.7, 0.9, 1.1, 1.3, 1.5)])
    told = checked(400.0, 1.0, replace(law(*FALLS), samples=laws), mass=[0.1, 0.5, 1.0])
    each = [checked(400.0, 1.0, law(*FALLS), mass=m, velocity=0.2).hunting for m in (0.1, 1.0)]
    assert told.hunting.amplitude == pytest.approx(max(one.amplitude for one in each), rel=1e-6)
    assert told.hunting.masses == (0.1, 1.0) and told.hunting.samples == (0, 1, 3, 5)
    words = "simulated at 0.1 kg and 1 kg, with 4 samples of the law"
    assert any(words in line for line in report(told).lines)


def test_checked_gains_say_whether_they_hunt():
    told = check_gains(found(law(*FALLS), mass=1.0, lower=(400.0, None)))
    assert told.hunting.amplitude is not None and told.dead_band is None
    assert any(line.startswith("at rest it hunts about") for line in report(told).lines)
    assert gains_report.content(told)["at_rest"]["hunting"]["period"] == told.hunting.period
