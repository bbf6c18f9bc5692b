"""Sums of squares about lines, against lines that are fitted in exact fractions."""

from fractions import Fraction

import numpy as np
import pytest

from jaxfric.records.lines import Sums

RNG = np.random.default_rng(3)


def exact(t, y, first, end):
    """Sum of squares about the line of some rows, in fractions."""
    x, r = ([Fraction(float(v)) for v in some[first:end]] for some in (t, y))
    n = len(x)
    mean, level = sum(x) / n, sum(r) / n
    xx = sum((a - mean) ** 2 for a in x)
    xy = sum((a - mean) * (b - level) for a, b in zip(x, r, strict=True))
    yy = sum((b - level) ** 2 for b in r)
    return float(yy - xy * xy / xx) if xx else float(yy)


def sampled(late):
    """600 rows in 60 s, the last 200 of them within `late` s."""
    return np.append(np.linspace(0, 60, 400), 60 + late * np.arange(1, 201) / 200)


@pytest.mark.parametrize("late", [30.0, 0.3, 0.05])
@pytest.mark.parametrize("noise", [2e-8, 2e-9])
@pytest.mark.parametrize("moved", [0.0, 2e-5])
def test_sums_of_squares_are_those_in_fractions(late, noise, moved):
    """Slow, then ten times as fast, at last by `moved` m within `late` s. To a hundredth: doubles
    alone would be off by more than all of it."""
    t = sampled(late)
    y = np.where(t < 20, 1e-6 * t, 2e-5 + 1e-5 * (t - 20)) + noise * RNG.standard_normal(600)
    y += moved * np.maximum(t - 60, 0) / late
    sums, nodes = Sums(t, y), np.array([0, 5, 150, 270, 399, 405, 500, 590, 600])
    first, end = np.triu_indices(len(nodes), 1)
    found = sums.squares(first, end, nodes)
    for i, j, squares in zip(nodes[first], nodes[end], found, strict=True):
        least = (j - i) * sums.floor**2
        assert abs(squares - exact(t, y, i, j)) <= 1e-2 * (exact(t, y, i, j) + least)
