"""Parts of the search for gains where the frontier is a formula: no slider.

Gains are in natural units, of size 1. A requirement is made of functions of (u, v) that must be at
least 0; the reference is the least norm on a fine grid, or SciPy's.
"""

from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import minimize

from jaxfric.gains import frontier
from jaxfric.gains import solve as solve_module
from jaxfric.gains.frontier import GainTask, Region, alone, largest_alone, lowest
from jaxfric.gains.frontier import minima as on_frontier
from jaxfric.gains.solve import Optimum, _dense, optimum, solve
from jaxfric.stability.linear import Setting

ONES = np.ones(2)
FREE = Region(ONES, ONES, np.asarray([1e-9, 0.0]), np.full(2, np.inf))
V = np.linspace(0, 4, 400_001)


def one_dip(v):
    return 1.5 * jnp.exp(-v)


def two_dips(v):
    dips = 1.2 * jnp.exp(-(((v - 0.5) / 0.2) ** 2)) + 1.6 * jnp.exp(-(((v - 1.2) / 0.15) ** 2))
    return 2.0 - dips


def begins(v):
    """Nothing holds below a damping of 0.7."""
    return np.where(v < 0.7, np.inf, 1.0 + 0.0 * v)


def minima(needed, region=FREE):
    """All local minima (norm, u, v) along the frontier, by a fine grid."""
    u = needed(V)
    norm = np.hypot(u / region.scale[0], V / region.scale[1])
    before, after = np.append(np.inf, norm[:-1]), np.append(norm[1:], np.inf)
    at = np.flatnonzero(np.isfinite(norm) & (norm <= before) & (norm < after))
    return sorted((float(norm[i]), float(u[i]), float(V[i])) for i in at)


class Scenario:
    """A set of some scenarios, all alike."""

    velocity = np.ones(1)
    mass = delay = integral = None
    setting = Setting(None)

    def __init__(self, number=1):
        self.friction = Friction(np.zeros(number))

    def __len__(self):
        return len(self.friction.slope)

    def take(self, index):
        return Scenario(len(index))

    def join(self, other):
        return Scenario(len(self) + len(other))


class Friction(eqx.Module):
    """What a scenario has in place of friction."""

    slope: np.ndarray
    kernel: None = None


class Needed(eqx.Module):
    """The requirement that functions of (u, v) are at least 0."""

    functions: tuple[Callable, ...] = eqx.field(static=True)

    def __init__(self, *functions):
        self.functions = functions

    def constraints(self, slider, unit):
        gains = slider.stiffness, slider.damping
        return jnp.stack([function(*gains) for function in self.functions])


def above(needed):
    """The requirement that u is at least needed(v)."""
    return Needed(lambda u, v: u - needed(v))


@pytest.fixture(autouse=True)
def by_formula(monkeypatch):
    def slacks(requirement, scenarios, unit, gains):
        u, v = np.atleast_2d(gains).T
        if isinstance(requirement, Needed):
            least = np.min([f(u, v) for f in requirement.functions], axis=0)
        else:
            least = u - requirement(v)
        return np.repeat(np.asarray(least)[:, None], len(scenarios), axis=1)

    monkeypatch.setattr(frontier, "slacks", slacks)


def problem(requirement, region=FREE, number=1):
    return GainTask(requirement, Scenario(number), region)


# ---- the frontier ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("needed", "v", "u"),
    [(one_dip, 0.3, 1.5 * np.exp(-0.3)), (begins, 0.69, np.inf), (begins, 0.71, 1.0),
     (lambda v: 0.0 * v, 0.5, 0.0), (lambda v: 5e3 + 0.0 * v, 0.5, np.inf)],
)  # fmt: skip
def test_the_lowest_gain_that_is_accepted(needed, v, u):
    axis = np.geomspace(1e-6, 1e3, 40)
    (found,) = lowest(problem(needed), axis, np.asarray([v]))
    assert found == pytest.approx(u, rel=1e-6, abs=1e-6)
    assert found >= u


@pytest.mark.parametrize("scale", [(1.0, 1.0), (1.0, 0.4), (0.5, 3.0)])
@pytest.mark.parametrize("needed", [one_dip, two_dips, begins])
def test_every_local_minimum_of_the_norm_is_an_optimum(needed, scale):
    region = FREE._replace(scale=np.asarray(scale))
    truth = minima(needed, region)
    found = sorted(on_frontier(problem(needed, region)), key=region.norm)
    assert len(found) == len(truth) >= 1 + (needed is two_dips and scale == (1.0, 1.0))
    for one, (norm, _, v) in zip(found, truth, strict=True):
        assert norm * (1 - 1e-9) <= region.norm(one) <= norm * 1.05  # among the points of its grid
        assert one[1] == pytest.approx(v, abs=0.1)
        assert one[0] >= needed(one[1]) * (1 - 1e-12)


def test_held_by_one_of_the_two_alone():
    stiff, damped = alone(problem(one_dip))
    assert tuple(stiff) == (pytest.approx(1.5, rel=1e-6), 0.0)
    assert tuple(damped) == (1e-9, pytest.approx(np.log(1.5e9), rel=1e-6))
    (only,) = alone(problem(lambda v: 1.0 - (v > 3.0), FREE._replace(upper=np.full(2, 2.0))))
    assert tuple(only) == (pytest.approx(1.0, rel=1e-6), 0.0)


@pytest.mark.parametrize(
    ("slack", "k_p", "k_v"),
    [
        (lambda u, v: 5.0 - u - 2.0 * v, 5.0, 2.5),
        (lambda u, v: 5.0 - u + 0.0 * v, 5.0, np.inf),
        (lambda u, v: np.where((u > 3) & (u < 9), -1.0, 1.0) + 0 * v, 3.0, np.inf),  # not the 2nd
        (lambda u, v: u + v - 0.1, 0.0, 0.0),  # the least gains do not do
    ],
)
def test_up_to_which_gains_a_requirement_is_met(monkeypatch, slack, k_p, k_v):
    monkeypatch.setattr(
        frontier, "slacks", lambda need, scenarios, unit, gains: slack(*gains.T)[:, None]
    )
    for found, true in zip(largest_alone(problem(None)), (k_p, k_v), strict=True):
        assert found == true or 0.98 * true < found <= true


# ---- the optimum near a start ------------------------------------------------------------------


@pytest.mark.parametrize(
    ("functions", "upper", "gains", "at_limit"),
    [
        ((lambda u, v: u - v - 2,), np.inf, (2, 0), True),
        ((lambda u, v: u - 1 + 0 * v, lambda u, v: v - 3 + 0 * u), np.inf, (1, 3), False),
        ((lambda u, v: u - v - 1, lambda u, v: 3 - v + 0 * u), np.inf, (1, 0), True),
        ((lambda u, v: u + 2 * v - 5,), np.inf, (1, 2), False),
        ((lambda u, v: u + 2 * v - 5,), 1.5, (2, 1.5), True),
        ((lambda u, v: u + 2 * v - 5, lambda u, v: u - v - 0.5), np.inf, (2, 1.5), False),
    ],
)
def test_lines_push_inwards_only(functions, upper, gains, at_limit):
    region = FREE._replace(upper=np.asarray([np.inf, upper]))
    found = optimum(problem(Needed(*functions), region), np.array([5.0, 1.4]))
    np.testing.assert_allclose(found.gains, gains, rtol=1e-9, atol=1e-9)
    assert found.residual < 1e-9 and found.active == (0,) and found.at_limit == at_limit


CURVES = (lambda u, v: u + 0.5 * v**2 - 1.5, lambda u, v: v + 0.2 * u**2 - 1.2)


def test_an_optimum_where_two_constraints_meet():
    """The least norm is where they meet, (1, 1); a third is far away."""
    needed = Needed(*CURVES, lambda u, v: 9.0 + 0 * u * v)
    start = np.array([1.6, 1.3])
    found = optimum(problem(needed, number=3), start)
    np.testing.assert_allclose(found.gains, (1.0, 1.0), rtol=1e-9)
    # (1, 1) = l (1, 1) + m (0.4, 1): l = 1, m = 0
    assert found.residual < 1e-9 and len(found.active) == 1 and not found.at_limit
    tilted = FREE._replace(scale=np.asarray([1.0, 0.8]))
    truth = minimize(
        lambda x: np.sum((x / tilted.scale) ** 2), (1.6, 1.3), method="trust-constr",
        constraints=[{"type": "ineq", "fun": lambda x, c=c: c(*x)} for c in CURVES],
        options={"gtol": 1e-10, "xtol": 1e-12},
    )  # fmt: skip
    found = optimum(problem(needed, tilted), start)
    np.testing.assert_allclose(found.gains, truth.x, atol=1e-5)
    assert found.residual < 1e-9


@pytest.mark.parametrize("scale", [(1.0, 1.0), (1.0, 0.4)])
def test_an_optimum_is_the_least_norm(scale):
    region = FREE._replace(scale=np.asarray(scale))
    (norm, u, v), *_ = minima(one_dip, region)
    start = np.array([1.2 * one_dip(1.1 * v), 1.1 * v])
    found = optimum(problem(above(one_dip), region), start)
    assert found.norm == pytest.approx(norm, rel=1e-8) and found.residual < 1e-6
    np.testing.assert_allclose(found.gains, (u, v), rtol=1e-4)
    assert found.active == (0,) and not found.at_limit
    higher = region._replace(lower=np.asarray([1e-9, 1.5 * v]))
    found = optimum(problem(above(one_dip), higher), np.array([1.0, 1.5 * v]))
    np.testing.assert_allclose(found.gains, (one_dip(1.5 * v), 1.5 * v), rtol=1e-6)
    assert found.at_limit


def test_an_optimum_without_a_slope(monkeypatch):
    """The margin jumps where it is met: the least norm is still found, if only to a grid."""

    steps = Needed(lambda u, v: jnp.sign(u - one_dip(v)))
    start = np.array([1.2 * one_dip(1.1), 1.1])
    assert optimum(problem(steps), start) is None
    monkeypatch.setattr(solve_module, "optimum", lambda *_: None)
    found = solve(problem(one_dip))
    assert found.optima[0].norm == pytest.approx(minima(one_dip)[0][0], rel=1e-6)
    assert found.optima[0].residual == 1.0 and found.certificate.smaller_found == 0


# ---- the certificate -------------------------------------------------------------------------


def optimum_at(v, needed=one_dip):
    gains = np.asarray([needed(v), v])
    return Optimum(gains, float(np.hypot(*gains)), 0.0, (0,), False)


@pytest.mark.parametrize(
    ("factor", "lower", "found"),
    [
        (1.0, 0.0, False),
        (1.3, 0.0, True),
        (0.7, 0.0, True),
        (1.3, 1.29, False),  # what is smaller lies below the limit of damping
    ],
)
def test_a_dense_grid_finds_what_is_smaller(factor, lower, found):
    _, _, v = minima(one_dip)[0]
    told, region = optimum_at(factor * v), FREE._replace(lower=np.asarray([1e-9, lower * v]))
    asked = problem(one_dip, region)
    tried, smaller = _dense(asked, asked, [told])
    assert tried > 100
    assert (len(smaller) > 0) == found
    if found:
        assert np.all(np.hypot(*smaller.T) < told.norm) and np.all(smaller[:, 1] >= lower * v)
        assert np.all(smaller[:, 0] >= one_dip(smaller[:, 1]))


def solved(monkeypatch, stuck):
    """A solution where the first start is none; `stuck`: whatever starts, the same comes out."""

    def ends(asked, start):
        if stuck or start[1] == 2.0:
            return optimum_at(2.0)
        return optimum(problem(above(asked.requirement)), start)

    monkeypatch.setattr(solve_module, "optimum", ends)
    monkeypatch.setattr(solve_module, "minima", lambda *_: [optimum_at(2.0).gains])
    monkeypatch.setattr(solve_module, "alone", lambda *_: [])
    return solve(problem(one_dip))


def test_what_the_certificate_finds_is_a_new_start(monkeypatch):
    found = solved(monkeypatch, stuck=False)
    assert found.certificate.rounds > 1 and found.certificate.smaller_found == 0
    assert found.optima[0].norm == pytest.approx(minima(one_dip)[0][0], rel=1e-8)


def test_a_certificate_that_fails_says_so(monkeypatch):
    found = solved(monkeypatch, stuck=True)
    assert found.certificate.smaller_found > 0 and found.optima[0].norm == optimum_at(2.0).norm
