"""From which starts a fit descends, and how often it asks for a residual: tables.

A descent ends within a thousandth of a standard error of the parameters."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxfric.fitting.solve import solve
from jaxfric.fitting.thresholds import FAILED_MISFIT

ROWS = 50
MODEL = np.column_stack([np.ones(ROWS), np.linspace(-1, 1, ROWS)])
REST = np.where(np.arange(ROWS) % 2, 1.0, -1.0)
REST = REST - MODEL @ np.linalg.lstsq(MODEL, REST, rcond=None)[0]
REST /= np.sqrt(np.mean(REST**2))
EDGE = 100.0


ASKED: list[tuple[float, ...]] = []
"""Points at which a residual was asked for, and whether there was a dashpot."""


class Basins(eqx.Module):
    """A problem with basins around centres (c, 0), in each of which the best fit leaves a mean
    square; from beyond `EDGE` in the second variable the motion runs away, but for a dashpot."""

    centres: jax.Array
    left: jax.Array
    damping: jax.Array | None = None
    weight: jax.Array = eqx.field(default_factory=lambda: jnp.ones(ROWS))

    def damped(self, strength):
        return Basins(self.centres, self.left, jnp.asarray(strength))

    def residual(self, z):
        damped = self.damping is not None
        jax.debug.callback(lambda z: ASKED.append((*z.tolist(), damped)), z)
        near = jnp.argmin(jnp.abs(z[0] - self.centres))
        centre = jnp.stack([self.centres[near], 0.0])
        seen = MODEL @ (z - centre) + jnp.sqrt(self.left[near]) * REST
        return seen if damped else jnp.where(z[1] > EDGE, FAILED_MISFIT, seen)


def basins(left):
    ASKED.clear()
    return Basins(jnp.asarray(list(left)), jnp.asarray(list(left.values())))


def solved(problem, starts, **how):
    found = solve(problem, starts, **how)
    jax.effects_barrier()
    return found


def plain():
    """Points that were asked for, without a dashpot."""
    return [point[:2] for point in ASKED if not point[2]]


def test_where_the_first_comes_down_to_the_noise_no_other_is_asked():
    problem = basins({0.0: 1.05, 50.0: 0.2})
    found = solved(problem, np.array([[1.0, 2.0], [51.0, 0.0]]))
    np.testing.assert_allclose(found.z, [0, 0], atol=1e-3)
    assert all(point[0] < 25 for point in plain())
    assert len(set(plain())) == len(plain()) == found.trials


def test_a_start_is_asked_for_once():
    problem = basins({0.0: 4.0, 50.0: 0.5})
    found = solved(problem, np.array([[1.0, 2.0], [51.0, 0.0]]))
    assert plain().count((1.0, 2.0)) == 1
    assert found.cost == pytest.approx(0.5 * ROWS)
    np.testing.assert_allclose(found.residual, np.sqrt(0.5) * REST, atol=1e-3)


def test_after_the_first_two_those_of_least_misfit_have_their_turn():
    """Of four starts three descend: the first two, whatever their misfit, then the nearest. The
    basin of the second is the best; that of the last is not tried."""
    problem = basins({0.0: 4.0, 50.0: 3.0, 100.0: 2.0, 150.0: 1.2})
    starts = np.array([[9.0, 9.0], [155.0, 0.0], [104.0, 0.0], [53.0, 0.0]])
    said = []
    found = solved(problem, starts, progress=said.append)
    np.testing.assert_allclose(found.z, [150, 0], atol=1e-3)
    tried = [round(point[0] / 50) for point in set(plain())]
    assert tried.count(1) > tried.count(2) == 1
    assert [text.split(" over")[0] for text in said] == [
        f"descent {k} of at most 3" for k in (1, 2, 3)
    ]
    assert "the first" in said[0] and "the one before" in said[1]


def test_a_first_that_runs_away_waits_for_its_turn():
    problem = basins({0.0: 4.0, 50.0: 1.0})
    found = solved(problem, np.array([[0.0, 2 * EDGE], [52.0, 0.0]]))
    np.testing.assert_allclose(found.z, [50, 0], atol=1e-3)
    assert not any(point[2] for point in ASKED)  # no dashpot was needed


@pytest.mark.parametrize("number", [1, 2])
def test_where_all_run_away_a_dashpot_leads_back(number):
    problem = basins({0.0: 1.0})
    found = solved(problem, np.array([[0.0, 2 * EDGE], [1.0, 3 * EDGE]])[:number])
    np.testing.assert_allclose(found.z, [0, 0], atol=1e-3)
    assert found.converged and found.cost == pytest.approx(ROWS)
    assert any(point[2] for point in ASKED)
