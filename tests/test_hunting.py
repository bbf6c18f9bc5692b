"""Hunting of a slider with integral action about its target, against SciPy's Radau.

1 + 2 |V| + c2 exp(-(V/0.02)^2) N: where c2 is 0 kinetic friction is not below static friction.
"""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from jaxfric import check_gains, find_gains, law_from_parameters
from jaxfric.gains.hunting import hunting
from jaxfric.report import gains_json
from jaxfric.report.gains_text import report

M, K_P, K_V, K_I, DROP = 1.0, 400.0, 1.0, 800.0, 1.5


def law(drop):
    text = f"c0=1 N, c1=2 N s/m, c2={drop} N, c3=20 mm/s"
    return law_from_parameters("gaussian-stribeck", text)


def by_scipy(drop, offset, end, width=1e-7):
    def slope(t, y):
        x, v, integral = y
        friction = (1 + 2 * abs(v) + drop * np.exp(-((v / 0.02) ** 2))) * np.tanh(v / width)
        return [v, (K_P * (offset - x) - K_V * v + K_I * integral - friction) / M, offset - x]

    t = np.linspace(0, end, 8001)
    small = [1e-11, 1e-10, 1e-11]
    found = solve_ivp(slope, (0, end), [0, 0, 0], "Radau", t, rtol=1e-7, atol=small)
    half = t >= end / 2
    x = found.y[0][half]
    y, t = x - 0.5 * (x.min() + x.max()), t[half]
    up = t[np.flatnonzero((y[:-1] < 0) & (y[1:] >= 0))]
    return np.ptp(x) / 2, (up[-1] - up[0]) / (len(up) - 1)


def test_amplitude_and_period_of_hunting():
    found = hunting(law(DROP).law, M, (K_P, K_V, K_I), 1 + DROP, 0.1)
    amplitude, period = by_scipy(DROP, 2 * (1 + DROP) / K_P, 30.0)
    assert found.amplitude == pytest.approx(amplitude, rel=1e-2)
    assert found.period == pytest.approx(period, rel=1e-2)


def test_without_a_fall_of_friction_nothing_hunts():
    found = hunting(law(0).law, M, (K_P, K_V, K_I), 1.0, 0.1)
    assert found.amplitude is None and found.period is None and found.duration > 100


def test_a_linearly_unstable_controller_runs_away():
    """(k_v + 2) k_p < m k_i: Routh and Hurwitz."""
    found = hunting(law(0).law, M, (K_P, K_V, 4e3), 1.0, 0.1)
    assert gains_json.hunting_entry(found)["grows"]


def test_checked_gains_say_whether_they_hunt():
    margin = {"decay": 0.0, "modulus": 0.0}
    given = {"lower": (K_P, None), "integral_gain": K_I}
    found = find_gains(law(DROP), velocity=0.1, mass=M, margin=margin, **given)
    told = check_gains(found)
    assert told.hunting.amplitude is not None and told.dead_band is None
    assert any(line.startswith("at rest it hunts about") for line in report(told).lines)
    assert gains_json.content(told)["at_rest"]["hunting"]["period"] == told.hunting.period
