"""What a study varies: any part of a grid by itself is that part of the whole."""

import itertools
import math

import numpy as np
import pytest

from jaxfric import InputError
from jaxfric.study import Axis, Grid, Normal, Samples, Uniform, linspace, logspace, sampling, values
from jaxfric.study.grid import Tiling

ROOT = np.asarray([[0.3, 0.0], [0.1, 0.2]])
COLUMNS = (
    Uniform("a", 1.0, 3.0),
    Uniform("b", 1e-3, 1.0, log=True, kind="latin"),
    Uniform("c", -1.0, 1.0, kind="random"),
    Uniform("d", 0.0, 1.0),
    Normal(("e", "f"), np.asarray([2.0, -1.0]), ROOT, (True, False), ("1", "m"), ("", "")),
)


def whole(grid):
    return grid.members([slice(0, n) for n in grid.shape])


@pytest.mark.parametrize("chunk", [1, 2, 3, 7, 12, 60, 1000])
def test_blocks_cover_the_grid_once(chunk):
    grid = Grid((linspace("x", 0, 1, 5), logspace("y", 1, 10, 3)), Samples(4, COLUMNS[:2], seed=3))
    blocks = Tiling.of(grid.shape, chunk)
    seen = np.zeros(grid.shape, int)
    expected = {name: column.reshape(grid.shape) for name, column in whole(grid).items()}
    for number in range(len(blocks)):
        where = blocks.where(number)
        seen[where] += 1
        part = grid.members(where)
        for name, column in part.items():
            np.testing.assert_array_equal(column, expected[name][where].ravel())
        assert len(column) <= blocks.largest <= chunk
    assert np.all(seen == 1)
    assert len(blocks) <= 2 * math.ceil(grid.size / chunk) or chunk < 15


def test_product_is_that_of_meshgrid():
    grid = Grid((values("x", [3, 1, 2]), linspace("y", 0, 1, 4), logspace("z", 1, 100, 3)))
    found = whole(grid)
    expected = list(itertools.product([3, 1, 2], np.linspace(0, 1, 4), [1, 10, 100]))
    np.testing.assert_allclose(np.stack(list(found.values()), axis=1), expected, rtol=1e-15)
    assert grid.dims == {"x": 3, "y": 4, "z": 3} and grid.size == 36


def test_draws_depend_on_the_index_alone():
    samples = Samples(1000, COLUMNS, seed=5)
    every = samples.draw(0, 1000)
    for begin, end in ((0, 1), (37, 41), (512, 1000)):
        for name, column in samples.draw(begin, end).items():
            np.testing.assert_array_equal(column, every[name][begin:end])
    other = Samples(1000, COLUMNS, seed=6).draw(0, 1000)
    assert all(not np.array_equal(every[name], other[name]) for name in every)


def test_draws_have_their_distributions():
    number = 4096
    found = Samples(number, COLUMNS).draw(0, number)
    for name, low, high in (("a", 1, 3), ("c", -1, 1), ("d", 0, 1)):
        assert low <= found[name].min() and found[name].max() <= high
        assert abs(found[name].mean() - (low + high) / 2) < 0.03 * (high - low)
    cells = np.floor(np.log(found["b"] / 1e-3) / np.log(1e3) * number).astype(int)
    assert sorted(cells) == list(range(number))  # a Latin hypercube: each cell once
    quarters = np.histogram2d(found["a"], found["d"], bins=8, range=[(1, 3), (0, 1)])[0]
    assert np.all(quarters == number / 64)  # Sobol: as even as can be, in pairs too
    normal = np.stack([np.log(found["e"] / 2), found["f"] + 1])
    np.testing.assert_allclose(np.cov(normal), ROOT @ ROOT.T, atol=0.006)
    everything = np.corrcoef(np.stack(list(found.values())))
    assert np.all(np.abs(everything[:4, :4] - np.eye(4)) < 0.06)


@pytest.mark.parametrize("size", [1, 2, 3, 17, 256, 1000])
def test_permutation(size):
    found = sampling.permuted(np.arange(size), size, 1, 0)
    assert sorted(found) == list(range(size))
    if size > 16:
        assert not np.array_equal(found, np.arange(size))


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: linspace("x", 0, 1, 0), "axis 'x' is empty"),
        (lambda: values("x", []), "axis 'x' is empty"),
        (lambda: logspace("x", 0, 1, 3), "positive"),
        (lambda: Axis("x", np.asarray([1.0, np.nan])), "not a finite number"),
        (lambda: Grid(()), "varies nothing"),
        (lambda: Grid((values("x", [1]), values("x", [2]))), "twice"),
        (lambda: Uniform("x", 1.0, 1.0), "empty"),
        (lambda: Uniform("x", 0.0, 1.0, log=True), "above 0"),
        (lambda: Uniform("x", 0.0, 1.0, kind="halton"), "halton"),
        (lambda: Samples(2**31, COLUMNS), r"Sobol sequence has 1\.1e\+09 points"),
        (lambda: Samples(0, COLUMNS), "number of samples"),
        (lambda: Tiling.of((3,), 0), "chunk is 0"),
    ],
)
def test_refused(make, words):
    with pytest.raises(InputError, match=words):
        make()
