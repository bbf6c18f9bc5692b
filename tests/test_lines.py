"""Sums of squares about lines, against lines that are fitted in exact fractions."""

from fractions import Fraction

import numpy as np
import pytest

from jaxfric.records.lines import Sums

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
    found, about = sums.squares(nodes), exact(t, y)
    assert np.isposinf(found[np.tril_indices(len(nodes))]).all()
    for i, j, squares in zip(nodes[first], nodes[end], found[first, end], strict=True):
        least, true = (j - i) * sums.floor**2, about(i, j)
        assert abs(squares - true) <= 1e-2 * (true + least)
