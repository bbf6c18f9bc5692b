"""Sums of squares about lines, against lines that are fitted in exact fractions."""

import itertools
from fractions import Fraction

import numpy as np
import pytest

from jaxfric.records.lines import Sums
from jaxfric.records.segments import _local_variance, _partition

RNG = np.random.default_rng(3)


def exact(t, y):
    """The sum of squares about the line of the rows from a first to an end, in fractions."""
    x, r = (np.array([Fraction(float(v)) for v in some]) for some in (t, y))
    sums = [np.cumsum(np.append(Fraction(0), one)) for one in (x, r, x * x, x * r, r * r)]

    def squares(first, end):
        n, (sx, sy, xx, xy, yy) = int(end - first), (one[end] - one[first] for one in sums)
        xx, xy, yy = xx - sx * sx / n, xy - sx * sy / n, yy - sy * sy / n
        return float(yy - xy * xy / xx) if xx else float(yy)

    return squares


def sampled(late):
    """600 rows in 60 s, the last 200 of them within `late` s."""
    return np.append(np.linspace(0, 60, 400), 60 + late * np.arange(1, 201) / 200)


@pytest.mark.parametrize("late", [30.0, 0.3, 0.05])
@pytest.mark.parametrize("noise", [2e-8, 2e-9])
@pytest.mark.parametrize("moved", [0.0, 2e-5])
def test_sums_of_squares_are_those_in_fractions(late, noise, moved, monkeypatch):
    """Slow, then ten times as fast, at last by `moved` m within `late` s. To a hundredth: doubles
    alone would be off by more than all of it."""
    t = sampled(late)
    y = np.where(t < 20, 1e-6 * t, 2e-5 + 1e-5 * (t - 20)) + noise * RNG.standard_normal(600)
    y += moved * np.maximum(t - 60, 0) / late
    sums, nodes = Sums(t, y), np.array([0, 5, 150, 270, 399, 405, 500, 590, 600])
    monkeypatch.setattr("jaxfric.records.lines._AT_ONCE", 3)
    first, end = np.triu_indices(len(nodes), 1)
    found, about = sums.squares(nodes).T, exact(t, y)
    assert np.isposinf(found[np.tril_indices(len(nodes))]).all()
    for i, j, squares in zip(nodes[first], nodes[end], found[first, end], strict=True):
        least, true = (j - i) * sums.floor**2, about(i, j)
        assert abs(squares - true) <= 1e-2 * (true + least)


def cheapest(t, y, nodes, least, penalty):
    """The lines between nodes of least cost, by trying all."""
    inner = list(nodes[1:-1])
    best = (np.inf, None)
    for chosen in itertools.chain.from_iterable(
        itertools.combinations(inner, k) for k in range(len(inner) + 1)
    ):
        rows = [nodes[0], *chosen, nodes[-1]]
        if min(np.diff(rows)) < least:
            continue
        cost = sum(penalty[nodes == i][0] for i in rows[:-1])
        for i, j in itertools.pairwise(rows):
            line = np.polyfit(t[i:j], y[i:j], 1)
            cost += np.sum((y[i:j] - np.polyval(line, t[i:j])) ** 2)
        best = min(best, (cost, rows))
    return best[1]


@pytest.mark.parametrize("least", [10, 12])
@pytest.mark.parametrize("seed", range(4))
def test_lines_between_nodes_are_those_of_least_cost(least, seed, monkeypatch):
    """Against all choices: the short fast piece has 10 rows, 2 nodes apart."""
    monkeypatch.setattr("jaxfric.records.segments._local_variance", lambda *_: np.full(13, 0.01))
    rng = np.random.default_rng(seed)
    t = np.arange(60.0)
    y = np.where(t < 30, 0.1 * t, np.where(t < 40, 3 + 2 * (t - 30), 23.0))
    y += 0.1 * rng.standard_normal(60)
    nodes, sums = np.arange(0, 61, 5), Sums(t, y)
    squares = sums.squares(nodes)
    penalty = (15 + 3 * np.log(60)) * np.full(13, 0.01)
    found = _partition(squares, nodes, least, sums.floor)
    assert found.tolist() == cheapest(t, y, nodes, least, penalty)


def test_the_scatter_at_a_node_is_that_of_windows_of_enough_rows():
    """White noise of 0.1, known to a fifth; of windows with too few rows nothing is taken."""
    rng = np.random.default_rng(0)
    t = np.arange(400.0)
    sums = Sums(t, 0.3 * t + np.where(t < 200, 0.1, 1e-4) * rng.standard_normal(400))
    nodes = np.append(np.arange(0, 200, 4), np.arange(200, 401))  # 32 rows, later 8
    some = _local_variance(sums.squares(nodes), nodes, 20, sums.floor)
    assert np.sqrt(some) == pytest.approx(0.1, rel=0.2)
    every = _local_variance(sums.squares(nodes), nodes, 5, sums.floor)
    assert np.sqrt(every[-100:]) == pytest.approx(1e-4, rel=0.5)
