"""Glitches against brute force: dense covariances, and rows planted where they are known."""

from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
import pytest
from matplotlib.figure import Figure

from jaxfric.fitting.noise import NO_GLITCHES, ROUNDS, Family, Glitches, find_glitches, noise_of
from jaxfric.fitting.noise import Found as FoundNoise
from jaxfric.fitting.noise.glitches import (
    beside_steps,
    glitch_words,
    in_sizes_of_steps,
    prediction_errors,
    standing_out,
)
from jaxfric.loop import learn
from jaxfric.loop.engine import Engine, NoiseState
from jaxfric.loop.evaluate import Rows
from jaxfric.loop.refit import Candidate
from jaxfric.loop.split import Blocks
from jaxfric.plot.noise import mark_glitches
from jaxfric.records import Provenance

N = 1200
TIME = np.arange(float(N))
SHARE, MEMORY, SIGMA = 0.6, 4.0, 2e-3
NOISE = noise_of(SIGMA, SHARE, MEMORY)
COLUMNS = np.stack([np.ones(N), TIME / N, np.sin(3 * TIME / N)], axis=1)
ONE = np.zeros(N, int)


def noise_like(seed, share=SHARE):
    """White noise and an AR(1) part, by the recursion of the definition."""
    rng = np.random.default_rng(seed)
    keep, slow, fast = np.exp(-1 / MEMORY), rng.standard_normal(N), rng.standard_normal(N)
    for i in range(1, N):
        slow[i] = keep * slow[i - 1] + np.sqrt(1 - keep**2) * slow[i]
    return SIGMA * (np.sqrt(share) * slow + np.sqrt(1 - share) * fast)


def glitches_of(residual, *, step=ONE, before=NO_GLITCHES):
    weight = np.ones(N)
    weight[list(before.rows)] = 0
    columns = np.column_stack([residual + COLUMNS @ [0.1, 0.2, -0.1], COLUMNS]) * weight[:, None]
    return find_glitches(TIME, weight, columns, NOISE, step, before=before, least=SIGMA)


# ---- prediction errors ------------------------------------------------------------------------


def test_prediction_errors_are_those_of_a_dense_covariance():
    """Each row less its conditional mean, by the covariance of all rows before it, or after it."""
    n, rng = 40, np.random.default_rng(0)
    time, scale = np.cumsum(rng.uniform(0.2, 2.0, n)), rng.uniform(0.5, 2.0, n)
    on = np.setdiff1d(np.arange(n), [3, 20, 21])
    rows = rng.standard_normal(n)
    apart = np.abs(time[:, None] - time)
    sizes = SIGMA**2 * scale[:, None] * scale
    covariance = sizes * (SHARE * np.exp(-apart / MEMORY) + (1 - SHARE) * np.eye(n))
    weight = np.isin(np.arange(n), on).astype(float)
    noise = NOISE._replace(scale=jnp.asarray(scale))
    # a column that only one row has, and which is passed over, explains nothing
    columns = np.column_stack([rows, np.arange(n) == 3]) * [1.0, 1.0]
    ahead, back = prediction_errors(time, weight, columns * weight[:, None] + 0.0, noise)
    for found, order in ((ahead, on), (back, on[::-1])):
        assert np.all(found[weight == 0] == 0)
        for k, i in enumerate(order):
            seen = order[:k]
            gain = np.linalg.solve(covariance[np.ix_(seen, seen)], covariance[seen, i])
            error = rows[i] - gain @ rows[seen]
            deviation = np.sqrt(covariance[i, i] - gain @ covariance[seen, i])
            assert found[i] == pytest.approx(error / deviation, rel=1e-6)


def test_what_a_model_may_explain_is_no_glitch():
    """A residual that its columns make is none, whatever its size; a row of their leverage has an
    error of unit variance all the same."""
    columns = np.column_stack([COLUMNS @ [3.0, -2.0, 1.0], COLUMNS])
    for error in prediction_errors(TIME, np.ones(N), columns, NOISE):
        np.testing.assert_allclose(error, 0, atol=1e-6)
    spike = np.column_stack([COLUMNS, np.arange(N) == 77])[:, [0, 1, 3]]
    ones = [
        prediction_errors(TIME, np.ones(N), np.column_stack([noise_like(k), spike]), NOISE)[0]
        for k in range(3)
    ]
    assert np.std(np.concatenate(ones)) == pytest.approx(1.0, abs=0.05)


# ---- which rows -------------------------------------------------------------------------------

PLANTED = {
    "one": {500: 9},
    "one below": {500: -9},
    "several": {100: 9, 400: -12, 401: 30, 900: 300},
    "two neighbours": {700: 10, 701: 10},
    "three neighbours": {300: -12, 301: -12, 302: -12},
}


@pytest.mark.parametrize("planted", PLANTED.values(), ids=PLANTED)
def test_planted_rows_are_found_and_no_others(planted):
    residual = noise_like(1)
    for row, size in planted.items():
        residual[row] += size * SIGMA
    found = glitches_of(residual)
    assert found.rows == tuple(sorted(planted))
    assert 4 < found.beyond < 7 and found.tails == 0


def test_without_glitches_nothing_is_found():
    for seed in range(5):
        assert glitches_of(noise_like(10 + seed)) is NO_GLITCHES


def lasting(rows, size=15.0, at=600):
    """A plateau over some rows."""
    out = np.zeros(N)
    out[at : at + rows] = size * SIGMA
    return out


def peak(size=20.0, at=600, over=8.0):
    """Friction after a velocity step that nobody knows of: it rises at once and relaxes."""
    after = TIME - at
    return np.where(after >= 0, size * SIGMA * np.exp(-np.maximum(after, 0) / over), 0)


EVENTS = {
    "a step": lasting(N),
    "a large step": lasting(N, 200.0),
    "a step back": lasting(300),
    "four rows": lasting(4),
    "six rows": lasting(6, 25.0),
    "a peak": peak(),
    "a peak with two flanks": 15 * SIGMA * np.exp(-np.abs(TIME - 600) / 2.5),
    "a higher one": 30 * SIGMA * np.exp(-np.abs(TIME - 600) / 2.5),
    "a large peak": peak(100.0),
    "a slow swing": 30 * SIGMA * np.sin(TIME / 40),
}


@pytest.mark.parametrize("event", EVENTS.values(), ids=EVENTS)
def test_what_friction_does_is_no_glitch(event):
    for seed in range(3):
        assert glitches_of(noise_like(20 + seed) + event).rows == ()


def test_rows_beside_a_velocity_step_are_spared():
    residual, step = noise_like(2), np.repeat([0, 1], [600, 600])
    residual[[590, 598, 603, 630]] += 20 * SIGMA
    assert glitches_of(residual).rows == (590, 598, 603, 630)
    assert glitches_of(residual, step=step).rows == (590, 630)


@pytest.mark.parametrize(
    ("lengths", "near"),
    [
        ([200, 200], range(197, 210)),
        ([200, 60], range(197, 206)),
        ([20, 200], range(17, 25)),
        ([2, 200], range(7)),
        ([200, 2], range(197, 202)),
        ([300], range(0)),
    ],
)
def test_how_near_is_beside_a_step(lengths, near):
    step = np.repeat(np.arange(len(lengths)), lengths)
    assert np.flatnonzero(beside_steps(step)).tolist() == list(near)


LOUD = np.repeat([1.0, 6.0, 0.3], [500, 40, N - 540])
"""The scale of the noise of three velocity steps."""


def test_noise_of_every_step_has_its_own_size():
    """Rows of a loud step are no glitches, whatever they are beside those of the others, and those
    that stand out of a quiet one are."""
    step, quiet = np.repeat(np.arange(3), [500, 40, N - 540]), [700, 701, 1000]
    for seed in range(5):
        residual = LOUD * noise_like(30 + seed)
        assert glitches_of(residual, step=step).rows == ()
        residual[quiet] += 4 * SIGMA
        assert glitches_of(residual, step=step).rows == tuple(quiet)
    assert glitches_of(residual).rows == ()


def test_the_size_of_a_step_is_its_median():
    """In units of a normal error's: scipy.stats.norm.ppf(0.75). Few rows are as those of all."""
    step = np.repeat([0, 1, 2], [4000, 4000, 1])
    ahead, back = np.repeat([1.0, -3.0, 50.0], [4000, 4000, 1]), np.ones(8001)
    back[4000:8000] = 3.0
    one, other = in_sizes_of_steps(ahead, back, step)
    np.testing.assert_allclose(one[:8000], np.repeat([1, -1], 4000) * 0.6745, rtol=0.01)
    np.testing.assert_allclose(other[:8000], 0.6745, rtol=0.01)
    # the median of 50 and 1 for one row, of all rows (1 and 3 as often) for twenty
    size = np.sqrt((25.5**2 + 20 * np.median(np.abs(np.r_[ahead, back])) ** 2) / 21)
    assert one[-1] == pytest.approx(50 * 0.6745 / size, rel=1e-3)


@pytest.mark.parametrize(
    ("freedom", "least", "most"), [(np.inf, 4.2, 7.0), (10.0, 6.0, 20.0), (3.0, 30.0, 400.0)]
)
def test_heavy_tails_raise_the_limit(freedom, least, most):
    """Next to nothing of noise alone is passed over, by whatever law; most rows that a normal law
    would have are within it. Both errors of a row are the same where noise is white."""
    found, limits = 0, []
    for seed in range(30):
        errors = np.random.default_rng(seed).standard_t(min(freedom, 1e9), 2000)
        rows, limit = standing_out(errors, errors, np.zeros(2000, bool))
        found += int(rows.sum())
        limits.append(limit)
    assert found <= 3
    assert least < np.median(limits) < most
    normal = 4.94  # of a hundredth in 3 * 2000 rows, two-sided: scipy.stats.norm.isf(0.005/6000)
    assert freedom < np.inf or np.median(limits) == pytest.approx(normal, abs=0.5)


def test_too_many_are_what_the_noise_is_like():
    residual = noise_like(3)
    rows = np.arange(20, N, 75)  # 16 of 1200
    residual[rows] += 40 * SIGMA
    found = glitches_of(residual)
    assert (found.rows, found.tails) == ((), 16) and found.beyond > 4
    residual[rows[:5]] -= 40 * SIGMA
    found = glitches_of(residual)
    assert found.rows == tuple(rows[5:])
    # those of the first time count
    residual[rows[:5]] += 40 * SIGMA
    assert glitches_of(residual, before=found) is found


@pytest.mark.parametrize("rows", [np.zeros(N), np.full(N, np.nan), np.round(noise_like(4), 1)])
def test_rows_of_which_nothing_can_be_said(rows):
    assert glitches_of(rows).rows == ()


# ---- in words ---------------------------------------------------------------------------------

LINES = np.arange(8, 8 + N)


@pytest.mark.parametrize(
    ("glitches", "lines", "text"),
    [
        (Glitches((3,), 5.04), LINES, "1 row stands out of the noise by more than 5 standard"
         " deviations and is passed over: row 11"),
        (Glitches((3, 40), 5.04), LINES, "2 rows stand out of the noise by more than 5 standard"
         " deviations and are passed over: rows 11, 48"),
        (Glitches((3, 4, 5, 9), 12.0), LINES, "4 rows stand out of the noise by more than 12"
         " standard deviations and are passed over: rows 11, 12, 13 and 1 more"),
        (Glitches((3, 4), 5.0), None, "2 rows stand out of the noise by more than 5 standard"
         " deviations and are passed over: at 3 s, 4 s"),
        (Glitches((3,), 5.0), LINES[1:], "1 row stands out of the noise by more than 5 standard"
         " deviations and is passed over: at 3 s"),
        (Glitches((), 5.0, 30), LINES, "30 rows stand out of the noise by more than 5 standard"
         " deviations: so many are what the noise is like (heavy tails), and none is passed over"),
    ],
)  # fmt: skip
def test_what_is_said_of_glitches(glitches, lines, text):
    record = SimpleNamespace(relative_time=TIME, provenance=Provenance("a.csv", lines=lines))
    assert glitch_words(glitches, record) == (f"a.csv: {text}",)
    assert glitches.to_json()["count"] == len(glitches.rows)


def test_nothing_is_said_of_none():
    record = SimpleNamespace(relative_time=TIME, provenance=Provenance("a.csv"))
    assert glitch_words(NO_GLITCHES, record) == ()


@pytest.mark.parametrize(
    ("rows", "label"), [((3,), "1 row passed over"), ((3, 40), "2 rows passed over"), ((), None)]
)
def test_glitches_are_marked_in_a_figure(rows, label):
    """Over their place, at the upper edge."""
    axis = Figure().subplots()
    mark_glitches(axis, 2 * TIME, Glitches(rows, 5.0))
    assert [line.get_label() for line in axis.lines] == [label] * bool(rows)
    for line in axis.lines:
        assert np.ravel(line.get_xdata()).tolist() == [2.0 * k for k in rows]
        assert line.get_transform() == axis.get_xaxis_transform()
        assert np.all((np.ravel(line.get_ydata()) > 0.9) & (np.ravel(line.get_ydata()) < 1))


# ---- in the loop ------------------------------------------------------------------------------


class Straight(Engine):
    """An engine of a straight line, in units of the noise, which is known but for its size: nothing
    is simulated."""

    smooth = COLUMNS[:, 2:]

    def free(self, effects):
        return np.arange(2)

    def evaluate(self, z, index=None):
        del index
        none = np.zeros(0)
        left = COLUMNS[:, :2] @ z - self.noise.friction / SIGMA
        return Rows(left, COLUMNS[:, :2], none, none.reshape(0, 2))

    def noise_afresh(self, residual, columns):
        on = self.weight > 0
        fit = np.linalg.lstsq(columns[on], residual[on], rcond=None)[0]
        noise = NOISE._replace(sigma=jnp.asarray(np.std(residual[on] - columns[on] @ fit)))
        return FoundNoise(noise, Family(), np.zeros(0), 0.0)

    def noise_of(self, residual, columns, near=()):
        return self.noise_afresh(residual, columns)


def straight(friction, blocks):
    one = np.ones(1)
    state = NoiseState(blocks, friction, TIME[:, None], one, np.ones(N), NOISE)
    bounds = SimpleNamespace(by_step=False)
    return Straight(SimpleNamespace(bounds=bounds), state, None)


@pytest.fixture
def fits(monkeypatch):
    """Fits of a straight line, by least squares; how many were made."""
    made = []

    def refit(engine, effects, z, *, exact=False):
        made.append(exact)
        on = engine.weight > 0
        wanted = engine.noise.friction[on] / SIGMA
        z = np.linalg.lstsq(COLUMNS[on, :2], wanted, rcond=None)[0]
        whole = engine.evaluate(z).residual
        rms = {k: float(np.sqrt(np.mean(whole[engine.blocks.of(k)] ** 2))) for k in BLOCK_NAMES}
        return Candidate(effects, z, whole, NOISE, 0.0, rms, True, False)

    monkeypatch.setattr(learn, "refit", refit)
    return made


BLOCK_NAMES = ("train", "select", "report")
STEP = np.repeat(np.arange(6), 200)
BLOCKS = Blocks(STEP < 4, STEP == 4, STEP == 5, STEP, True)
LINE = COLUMNS[:, :2] @ [0.6, 0.05]


def test_a_loop_passes_over_glitches_of_all_blocks(fits):
    """Of those that train, and of those that are held out; the base is fitted without them."""
    rows = [120, 350, 351, 905, 1100]
    friction = LINE + noise_like(5)
    friction[rows] += SIGMA * np.array([200.0, 25.0, 25.0, -60.0, 300.0])
    engine = straight(friction, BLOCKS)
    start = learn.refit(engine, (), None)
    engine, found = learn.learn_noise(engine, start)
    assert engine.noise.glitches.rows == tuple(rows)
    for name in BLOCK_NAMES:
        own = np.setdiff1d(np.flatnonzero(BLOCKS.of(name)), rows)
        assert np.flatnonzero(engine.blocks.of(name)).tolist() == own.tolist()
        assert found.rms[name] == pytest.approx(1.0, rel=0.1)
    assert start.rms["report"] > 10
    on = engine.weight > 0
    assert not on[rows].any()
    best = np.linalg.lstsq(COLUMNS[on, :2], friction[on] / SIGMA, rcond=None)[0]
    np.testing.assert_allclose(found.z, best)
    assert len(fits) == 3  # the start, without the glitches, and under the learnt noise


def test_a_loop_without_glitches_is_as_it_was(fits):
    engine = straight(LINE + noise_like(6), BLOCKS)
    start = learn.refit(engine, (), None)
    engine, found = learn.learn_noise(engine, start)
    assert engine.blocks is BLOCKS and engine.noise.glitches is NO_GLITCHES
    assert len(fits) == 2  # the start, and under the learnt noise
    np.testing.assert_allclose(found.z, start.z)
    assert found.rms == start.rms


def test_glitches_are_looked_for_twice_at_most(fits, monkeypatch):
    monkeypatch.setattr(
        "jaxfric.loop.learn.find_glitches",
        lambda *_, before: Glitches((*before.rows, len(before.rows) + 50), 5.0),
    )
    engine = straight(LINE + noise_like(6), BLOCKS)
    engine, _ = learn.learn_noise(engine, learn.refit(engine, (), None))
    assert engine.noise.glitches.rows == (50, 51) and len(fits) == 2 + ROUNDS
