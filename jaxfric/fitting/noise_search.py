"""Finds the noise of a residual by restricted likelihood: white, with up to two correlated parts.

A `Family` says which parts there are and over which clock each forgets. Its likelihood is the
restricted one (REML): the residual of a fit has lost the directions of its parameters, and without
correcting for that a long memory is under-estimated. sigma is profiled out; the rest, in units of
the white part and as logarithms, is found by Newton's method with damping, whose derivatives are
differences between noises that are all whitened in one pass.

`estimate_noise` begins with white noise and adds a part where the likelihood rises by more than
the part's parameters are worth (BIC); `profile_noise` keeps the parts and finds their sizes anew.
A residual whose spectrum is far from worth a part is white without a search (`noise_spectrum`).
Which parts a very long record has is sought in some stretches of it, their sizes in more; sigma
and the likelihood are those of all of it.

Source: Harville 1977 (doi:10.1080/01621459.1977.10480998) for the restricted likelihood.
"""

import itertools
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from ..threads import side_by_side
from ..traced import traced
from .noise import (
    EXPONENTIAL,
    PARTS,
    Carried,
    Noise,
    Numbers,
    at_first_row,
    distances,
    filtered,
    limit_of_negative,
    moves_of,
)
from .noise_spectrum import gains_of_parts, spectrum
from .padding import counted_rows, padded_columns

LONGEST = 0.1
"""Longest memory of the noise of a fit, as a share of the record: what wanders for longer is seen
too seldom for its size to be known, and a likelihood makes it as large as it likes."""
_SHORTEST = 1e-6  # shortest gap that is searched, as a share of the record
_TOGETHER = 8
"""Noises that are whitened in one pass. Passes of more take as long for each, and every number of
them is compiled for."""
_DAMPINGS = 8
_NEWTON = 12
_STEP = 0.2
_SETTLED = 0.02
_SIZES = (-2.0, -0.5, 1.0, 2.5)  # of a new part, logarithms over what there is
_LARGEST = 9.0
_TOTALS, _RATIOS = (0.0, 3.0), (-1.0, 1.0)  # of two parts: logarithms over white, of one to other
_INNER = 3
_NEGATIVE = (-1.0, 1.0, 3.0, 5.0)
_MEMORIES = 6
_RESONATOR_SIZES = (-0.5, 2.0)
_SHAPES = (-1.0, 0.0, 0.75, 1.75)  # of ln(1 + beta)/2
_SHAPE_ENDS = (-2.0, 4.5)
_REFINED = 2
_BETWEEN = (0.0, 0.5, 1.0)
_SIZES_AROUND = (-1.5, 0.0, 1.5)
_MEMORIES_AROUND = (-0.7, 0.0, 0.7)
_ALONE = 64  # noises by which a residual alone is whitened in one pass
_BLOCK = 512
"""Rows that are whitened before their products are added: they are still in the cache then."""
_LIKELY = 12
"""Starts of a family, likeliest for the residual alone, whose restricted likelihood is asked."""
FAR_FROM = 0.5
"""Share of what a part is worth below which the spectrum's gain is far from it."""
_STRETCH = 1024
_SOUGHT, _SIZED = 8, 64
"""Stretches of `_STRETCH` rows of a record with more rows in which its parts are sought, and their
sizes."""


_Parts = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Shares (g, 2), rates (g, 2, k) and betas (g,) of noises."""


class Family(NamedTuple):
    """Parts of a noise by the clock that each forgets over; None: it has no such part."""

    first: int | None = None
    second: int | None = None
    negative: bool = False
    """Whether the first part has a negative variance."""
    resonates: bool = False
    """Whether the second part is a resonator."""

    @property
    def parameters(self) -> int:
        """Number of parameters beside sigma."""
        parts = (self.first is not None) + (self.second is not None)
        return 2 * parts + self.resonates


class Limits(NamedTuple):
    """Shortest and longest memory that is searched over each clock, (k,)."""

    shortest: np.ndarray
    longest: np.ndarray
    gaps: np.ndarray
    """Median distance between neighbouring rows in each clock."""


class NoiseRows(NamedTuple):
    """The input of a noise estimate. Column 0 is the residual, the others are the Jacobian's.

    Rows that are passed over and columns of zeros may be gone; `every` is the scale of all rows.
    """

    clock: Float[np.ndarray, "n k"]
    weight: Float[np.ndarray, " n"]
    columns: Float[np.ndarray, "n m"]
    scale: Float[np.ndarray, " *n"]
    limits: Limits
    rows: int
    every: Float[np.ndarray, " *n"]


class Found(NamedTuple):
    """The likeliest noise of a family."""

    noise: Noise
    family: Family
    theta: np.ndarray
    """For each part the logarithms of its variance over the white one and of its longest memory;
    then that of a resonator's natural frequency, ln(sqrt(1 + beta)/memory)."""
    value: float


class _Point(NamedTuple):
    """A noise of a family by its theta (as `Found.theta`), with its likelihood and sigma."""

    family: Family
    theta: np.ndarray
    value: float
    sigma: float


def estimate_noise(
    record: NoiseRows,
    *,
    either_sign: bool = False,
    least: float = 0.0,
    like: Found | None = None,
) -> Found:
    """Restricted maximum-likelihood noise of a residual with its Jacobian (`noise_rows`).

    With `either_sign` also negative correlation, of even sampling. `least` is the smallest standard
    deviation of the white part, as of a recorder's steps. Where the noise is `like` another one
    that is not white, it has the parts of that, and only their sizes are sought.
    """
    part, larger = stretches(record, _SOUGHT), stretches(record, _SIZED)
    if like is None or not like.family.parameters:
        best, sized = _with_parts(part, either_sign=either_sign), part is record
    else:
        best, sized = like, False
    if not sized:
        best = _best_of(larger, best.family, best.theta[None])
    if larger is not record:
        values, sigmas = _values(record, parts_at(best.family, best.theta[None], record.limits))
        value, sigma = float(values[0]), float(sigmas[0])
        noise = noise_at(record, best.family, best.theta, sigma, value)
        best = best._replace(noise=noise, value=value)
    return not_below(record, best, least)


def stretches(record: NoiseRows, number: int = _SOUGHT) -> NoiseRows:
    """Stretches of neighbouring rows, spread evenly over a long record; of a shorter one, itself.

    What is correlated over longer than a stretch is seen from stretch to stretch.
    """
    if record.rows <= number * _STRETCH:
        return record
    counted = np.array_split(np.flatnonzero(np.asarray(record.weight) > 0), number)
    middle = [(len(rows) - _STRETCH) // 2 for rows in counted]
    pairs = zip(counted, middle, strict=True)
    taken = np.concatenate([rows[begin : begin + _STRETCH] for rows, begin in pairs])
    scale = record.scale[taken] if record.scale.ndim else record.scale
    clock, weight, columns = (x[taken] for x in (record.clock, record.weight, record.columns))
    return NoiseRows(clock, weight, columns, scale, record.limits, len(taken), record.every)


def _with_parts(record: NoiseRows, *, either_sign: bool) -> Found:
    """The likeliest noise, part by part, of as many parts as are worth their parameters."""
    best = _white(record)
    for _ in range(0 if _seems_white(record, either_sign=either_sign) else 2):
        more = _with_another(record, best, either_sign=either_sign)
        if more is None:
            break
        gain = 2 * (more.value - best.value)
        if not gain > (more.family.parameters - best.family.parameters) * np.log(record.rows):
            break
        best = more
    return best


def _white(record: NoiseRows) -> Found:
    """White noise with its restricted likelihood."""
    value, sigma = restricted_white(record.weight, record.columns, record.scale)
    nothing = np.zeros(0)
    return Found(noise_at(record, Family(), nothing, sigma, value), Family(), nothing, value)


def _seems_white(record: NoiseRows, *, either_sign: bool) -> bool:
    """Whether no part comes near to being worth its parameters by the residual's spectrum."""
    scale = np.broadcast_to(record.scale, record.weight.shape)
    seen = spectrum(record.clock, record.weight, record.columns / scale[:, None])
    if seen is None:
        return False
    ends = record.limits.shortest, record.limits.longest
    once, twice = gains_of_parts(seen, *ends, either_sign=either_sign)
    worth = Family(first=0).parameters, Family(second=0, resonates=True).parameters
    each = FAR_FROM * np.log(record.rows)
    return bool(once < each * worth[0] and twice < each * worth[1])


def profile_noise(
    record: NoiseRows, family: Family, starts: Sequence[np.ndarray], *, least: float = 0.0
) -> Found:
    """The likeliest noise of one family, from some starts (as `Found.theta`); `least` as of
    `estimate_noise`."""
    return not_below(record, _best_of(record, family, np.stack(starts)), least)


def not_below(record: NoiseRows, found: Found, least: float) -> Found:
    """The noise with a white part of the standard deviation `least`, if it has a smaller one.

    What white noise gains the correlated parts lose, in proportion; where they have less than that
    the whole grows. The likelihood is that of the noise that comes out.
    """
    sigma, share = float(found.noise.sigma), np.asarray(found.noise.share)
    if sigma**2 * (1 - share.sum()) >= least**2:
        return found
    if share.sum() < 0:
        sigma = least / float(np.sqrt(1 - share.sum()))
    else:
        left = max(sigma**2 - least**2, 0.0)
        sigma = float(np.sqrt(least**2 + left))
        share = share / max(float(share.sum()), 1e-300) * left / sigma**2
    unit = found.noise._replace(sigma=np.ones(()), share=np.asarray(share))
    value = _restricted_at(record, unit, sigma)
    noise = unit._replace(sigma=np.asarray(sigma), log_likelihood=np.asarray(value))
    return found._replace(noise=noise, value=value)


def _restricted_at(record: NoiseRows, unit: Noise, sigma: float) -> float:
    """Restricted log-likelihood of a noise whose sigma is given.

    With the likeliest sigma, s, and n - p free rows it is less by (n - p)/2 (q - 1 - ln q),
    q = s^2/sigma^2.
    """
    share, rates, beta = (np.asarray(x)[None] for x in (unit.share, unit.rates, unit.beta))
    values, likeliest = _values(record, (share, rates, beta))
    used = np.linalg.norm(np.asarray(record.columns)[:, 1:], axis=0) > 0
    q = (float(likeliest[0]) / sigma) ** 2
    return float(values[0]) - 0.5 * (record.rows - used.sum()) * (q - 1 - np.log(q))


def longest_memory(clock: Float[Numbers, "n *k"]) -> np.ndarray:
    """Longest memory of a fit's noise over every clock: `LONGEST` times the record's span, (k,)."""
    return LONGEST * np.ptp(np.asarray(clock).reshape(len(clock), -1), axis=0)


def noises_around(family: Family, thetas: Sequence[np.ndarray], limits: Limits) -> _Parts:
    """White noise, and noises of a family around and between some `thetas`.

    Shares (g, 2), rates (g, 2, k) and betas (g,).
    """
    white = parts_at(Family(), np.zeros((1, 0)), limits)
    if not family.parameters:
        return white
    first, last = thetas[0], thetas[-1]
    low, high = _bounds(family, limits)
    found = []
    for part in _BETWEEN:
        centre = first + part * (last - first)
        sizes = itertools.product(*([_SIZES_AROUND] * (family.parameters // 2)))
        for size, memory in itertools.product(list(sizes), _MEMORIES_AROUND):
            more = [x for own in size for x in (own, memory)]
            found.append(centre + np.array([*more, *([0.0] * family.resonates)]))
    unique = np.unique(np.clip(np.stack(found), low, high).round(9), axis=0)
    more = parts_at(family, unique, limits)
    both = [np.concatenate(pair) for pair in zip(white, more, strict=True)]
    return both[0], both[1], both[2]


def limits_of(clock: Numbers, weight: Numbers, longest: ArrayLike | None = None) -> Limits:
    """Limits: half the median gap of weighted rows, and `longest`, by default half the record."""
    times = np.asarray(clock)
    times = times.reshape(len(times), -1)
    on = np.asarray(weight) > 0
    span = np.ptp(times, axis=0)
    apart = np.abs(np.diff(times, axis=0))[on[1:]]
    gaps = np.maximum(np.median(apart, axis=0), _SHORTEST * np.maximum(span, 1e-300))
    most = 0.5 * span if longest is None else np.broadcast_to(np.asarray(longest), span.shape)
    return Limits(0.5 * gaps, np.maximum(most, 0.5 * gaps), gaps)


def noise_rows(
    clock: Numbers,
    weight: Numbers,
    residual: Numbers,
    jacobian: Numbers,
    longest: ArrayLike | None = None,
    *,
    scale: Numbers | None = None,
) -> NoiseRows:
    """The input of a noise estimate: a residual (n,) with the Jacobian of its fit (n, p).

    `clock` is (n, k) or (n,), `weight` (n,) is 0 for rows to be passed over. Memories are searched
    from half the median gap of rows to `longest`, by default half the record, in each clock.
    """
    clock, weight, jacobian = (np.asarray(x) for x in (clock, weight, jacobian))
    clock = clock[:, None] if clock.ndim == 1 else clock
    every = np.ones(()) if scale is None else np.asarray(scale)
    moves = np.any(jacobian[weight > 0] != 0, axis=0)
    columns = np.column_stack([np.asarray(residual), padded_columns(jacobian[:, moves])])
    rows, limits = int(np.sum(weight > 0)), limits_of(clock, weight, longest)
    return NoiseRows(*counted_rows(clock, weight, columns, every), limits, rows, every)


def _with_another(record: NoiseRows, best: Found, *, either_sign: bool) -> Found | None:
    """The likeliest noise with one part more than `best`."""
    family, starts = best.family, {}
    limits, white = record.limits, not best.family.parameters
    # beside a part that is nearly all of the noise a few times the white one is nothing
    there = -np.log(max(float(1 - best.noise.share.sum()), np.exp(-_LARGEST)))
    for k in np.flatnonzero(limits.longest > limits.shortest).tolist():
        ends = np.log(limits.shortest[k]), np.log(limits.longest[k])
        memories = np.linspace(ends[0], ends[1], _MEMORIES)
        grid = [(there + v, m) for v, m in itertools.product(_SIZES, memories)]
        shapes = itertools.product(_RESONATOR_SIZES, memories, _SHAPES)
        shapes = [(there + v, m, s - m) for v, m, s in shapes]
        if white and either_sign:
            more = list(itertools.product(_NEGATIVE, memories))
            starts[Family(first=k, negative=True)] = _beside(best.theta, more)
        if family.first is None:
            starts[family._replace(first=k)] = _beside(best.theta, grid, before=True)
        elif family.second is None:
            starts[family._replace(second=k)] = _beside(best.theta, grid)
        if family.second is None:
            starts[family._replace(second=k, resonates=True)] = _beside(best.theta, shapes)
    found = sorted(_likeliest(record, starts), key=lambda one: one.family.parameters - one.value)
    found = found[:_REFINED]
    both = {one.family: _both_parts(one.family, limits) for one in found}
    found += _likeliest(record, {family: some for family, some in both.items() if len(some)})
    each = 0.5 * np.log(record.rows)

    def refined(one: _Point) -> Found:
        worth = best.value + each * (one.family.parameters - family.parameters)
        return _refined(record, one, worth)

    found = side_by_side(refined, found)
    return max(found, key=lambda one: one.value - 3 * one.family.parameters, default=None)


def _both_parts(family: Family, limits: Limits) -> np.ndarray:
    """Starts with two parts at once, (g, q), as a part beside one that has taken its share is not
    found. Empty for a family with one part."""
    if family.first is None or family.second is None or family.negative:
        return np.zeros((0, family.parameters))
    inner = [
        np.linspace(np.log(limits.shortest[k]), np.log(limits.longest[k]), _INNER + 2)[1:-1]
        for k in (family.first, family.second)
    ]
    shapes = _SHAPES[1:] if family.resonates else _SHAPES[:1]
    found = []
    for total, ratio in itertools.product(_TOTALS, _RATIOS):
        for one, two, shape in itertools.product(*inner, shapes):
            start = [total + 0.5 * ratio, one, total - 0.5 * ratio, two, shape - two]
            found.append(start[: family.parameters])
    return np.array(found)


def _beside(
    theta: np.ndarray, grid: Iterable[tuple[float, ...]], *, before: bool = False
) -> np.ndarray:
    """Starts (g, q) with one more part from `grid`, which goes before or after those of `theta`."""
    pairs = ((more, theta) if before else (theta, more) for more in grid)
    return np.array([[*a, *b] for a, b in pairs], float)


def _likeliest(record: NoiseRows, starts: Mapping[Family, np.ndarray]) -> list[_Point]:
    """The likeliest start of every family.

    The likelihood of the residual alone, as if nothing had been fitted, takes a fraction of the
    restricted one's time, and says which `_LIKELY` of a family that one is asked of.
    """
    if not starts:
        return []
    starts = {family: _inside(record, family, some) for family, some in starts.items()}
    alone = record._replace(columns=record.columns[:, :1])
    values, _ = _values(alone, _parts_of(record, starts))
    ends = np.cumsum([len(some) for some in starts.values()])[:-1]
    each = zip(starts.items(), np.split(values, ends), strict=True)
    likely = {family: some[np.argsort(-own)[:_LIKELY]] for (family, some), own in each}
    values, sigmas = _values(record, _parts_of(record, likely))
    found, place = [], 0
    for family, some in likely.items():
        own = values[place : place + len(some)]
        i = int(np.argmax(own))
        found.append(_Point(family, some[i], float(own[i]), float(sigmas[place + i])))
        place += len(some)
    return found


def _best_of(record: NoiseRows, family: Family, starts: np.ndarray) -> Found:
    """The likeliest noise of a family, sought from the likeliest of some starts."""
    starts = _inside(record, family, np.asarray(starts, float))
    values, sigmas = _values(record, parts_at(family, starts, record.limits))
    i = int(np.argmax(values))
    return _refined(record, _Point(family, starts[i], float(values[i]), float(sigmas[i])))


def _refined(record: NoiseRows, start: _Point, worth: float = -np.inf) -> Found:
    """The likeliest noise of a family that Newton's method finds from a start.

    It goes no further where not even the slope of the likelihood promises the value `worth`.
    """
    family, theta, value, sigma = start
    for _ in range(_NEWTON if family.parameters else 0):
        around, trials, promised = _newton(record, family, theta)
        if value + promised < worth:
            break
        trials = _inside(record, family, trials)
        values, sigmas = _values(record, parts_at(family, trials, record.limits))
        if not values.max() > value:  # a kink: a resonator of as few rows a swing as may be
            trials, values, sigmas = around
        i = int(np.argmax(values))
        if not values[i] > value:
            break
        settled = values[i] - value < _SETTLED
        theta, value, sigma = trials[i], float(values[i]), float(sigmas[i])
        if settled:
            break
    return Found(noise_at(record, family, theta, sigma, value), family, theta, value)


class _Known(NamedTuple):
    """Points theta at which likelihoods (`values`) and sigmas are known."""

    theta: np.ndarray
    values: np.ndarray
    sigmas: np.ndarray


def _newton(
    record: NoiseRows, family: Family, theta: np.ndarray
) -> tuple[_Known, np.ndarray, float]:
    """Points around theta with their likelihoods, Newton steps from it with many dampings, and the
    most that such a step would gain if the slope stayed what it is."""
    q = len(theta)
    low, high = _bounds(family, record.limits)
    centre = np.clip(theta, low + _STEP, np.maximum(high - _STEP, low + _STEP))
    pairs = [(i, j) for i in range(q) for j in range(i)]
    unit = _STEP * np.eye(q)
    points = [centre, *(centre + u for u in unit), *(centre - u for u in unit)]
    points += [centre + unit[i] + unit[j] for i, j in pairs]
    parts = parts_at(family, np.stack(points), record.limits)
    seen = _Known(np.stack(points), *_values(record, parts))
    values = seen.values
    plus, minus = values[1 : q + 1], values[q + 1 : 2 * q + 1]
    slope = (plus - minus) / (2 * _STEP)
    curve = np.diag((plus + minus - 2 * values[0]) / _STEP**2)
    for (i, j), both in zip(pairs, values[2 * q + 1 :], strict=True):
        curve[i, j] = curve[j, i] = (both - plus[i] - plus[j] + values[0]) / _STEP**2
    scale, vectors = np.linalg.eigh(-curve)
    damped = np.abs(scale) + np.geomspace(1e-3, 1e3, _DAMPINGS)[:, None]
    steps = np.clip((vectors.T @ slope / damped) @ vectors.T, -2.0, 2.0)
    return seen, centre + steps, float(np.max(steps @ slope))


def _bounds(family: Family, limits: Limits) -> tuple[np.ndarray, np.ndarray]:
    low, high = np.log(limits.shortest), np.log(limits.longest)
    ends = []
    for k in (family.first, family.second):
        if k is not None:
            ends += [(-_LARGEST, _LARGEST), (low[k], high[k])]
    if family.resonates:
        k = family.second
        ends.append((_SHAPE_ENDS[0] - high[k], _SHAPE_ENDS[1] - low[k]))
    both = np.array(ends, float).reshape(-1, 2)
    return both[:, 0], both[:, 1]


def _inside(record: NoiseRows, family: Family, theta: np.ndarray) -> np.ndarray:
    return np.clip(theta, *_bounds(family, record.limits))


def parts_at(family: Family, theta: np.ndarray, limits: Limits) -> _Parts:
    """Shares (g, 2), rates (g, 2, k) and betas (g,) at some `theta` (g, q)."""
    g, k = len(theta), len(limits.gaps)
    size, rates = np.zeros((g, PARTS)), np.ones((g, PARTS, k))
    beta, place = np.full(g, EXPONENTIAL), 0
    for part, clock in enumerate((family.first, family.second)):
        if clock is None:
            continue
        size[:, part] = np.exp(theta[:, place])
        memory = np.exp(theta[:, place + 1])
        place += 2
        if part == 0 and family.negative:
            most = limit_of_negative(np.exp(-limits.gaps[clock] / memory))
            size[:, 0] *= -most / (1 + size[:, 0])
        if part == 1 and family.resonates:
            # four rows a swing or more; of two memories the longer one is bounded
            fastest = (0.5 * np.pi * memory / limits.gaps[clock]) ** 2
            shape = np.clip(theta[:, place] + theta[:, place - 1], *_SHAPE_ENDS)
            beta = np.minimum(np.expm1(2 * shape), fastest)
            memory = memory * (1 - np.sqrt(np.maximum(-beta, 0.0)))
        rates[:, part] = np.eye(k)[clock] / memory[:, None]
    return size / (1 + size.sum(axis=1, keepdims=True)), rates, beta


def noise_at(
    record: NoiseRows, family: Family, theta: np.ndarray, sigma: float, value: float
) -> Noise:
    """The noise of a family at `theta`."""
    parts = parts_at(family, theta[None], record.limits)
    share, rates, beta = (x[0] for x in parts)
    return Noise(np.asarray(sigma), share, rates, beta, record.every, np.asarray(value))


def _parts_of(record: NoiseRows, starts: Mapping[Family, np.ndarray]) -> _Parts:
    """Shares, rates and betas of the starts of all families, one after the other."""
    each = [parts_at(family, some, record.limits) for family, some in starts.items()]
    share, rates, beta = (np.concatenate(some) for some in zip(*each, strict=True))
    return share, rates, beta


def _values(record: NoiseRows, parts: _Parts) -> tuple[np.ndarray, np.ndarray]:
    """Restricted log-likelihoods and sigmas (g,) of noises with some `parts` (as of `parts_at`)."""
    columns, count = record.columns.shape[1], len(parts[2])
    size = _ALONE if columns == 1 and count > _ALONE // 2 else _TOGETHER
    # a pass without resonators, or without a swing, takes less time (`noise.moves_of`)
    order = np.argsort((parts[2] > EXPONENTIAL) + 1.0 * (parts[2] > 0), kind="stable")

    def some(begin: int) -> tuple[np.ndarray, np.ndarray]:
        at = order[np.minimum(np.arange(begin, begin + size), count - 1)]  # few shapes are compiled
        own = (x[at] for x in parts)
        return restricted(record.clock, record.weight, record.columns, record.scale, *own)

    found = zip(*side_by_side(some, range(0, count, size)), strict=True)
    back = np.argsort(order)
    value, sigma = (np.concatenate(part)[:count][back] for part in found)
    return np.where(np.isfinite(value), value, -np.inf), sigma


@traced
def products(
    clock: Float[Numbers, "n *k"],
    weight: Float[Numbers, " n"],
    columns: Float[Numbers, "n m"],
    scale: Float[Numbers, " *n"],
    share: Float[Numbers, "g 2"],
    rates: Float[Numbers, "g 2 k"],
    beta: Float[Numbers, " g"],
) -> tuple[Float[Array, "g m m"], Float[Array, " g"]]:
    """Products of the columns whitened under every noise of sigma 1, and its log-determinants."""
    scale, used = jnp.broadcast_to(scale, weight.shape), weight > 0
    each = _BLOCK if len(weight) % _BLOCK == 0 else len(weight)
    rows = (distances(clock), used, columns / scale[:, None])
    blocks = jax.tree.map(lambda x: x.reshape(-1, each, *x.shape[1:]), rows)

    def add(
        carry: tuple[Carried, Array, Array], block: tuple[Array, Array, Array]
    ) -> tuple[tuple[Carried, Array, Array], None]:
        begun, gram, log_inverse = carry
        away, on, own = block
        under = jax.vmap(lambda *noise: filtered(on, own, *noise))
        begun, (white, more) = under(share, moves_of(away, rates, beta), begun)
        white = white * on[:, None]
        gram = gram + jnp.einsum("gni,gnj->gij", white, white)
        return (begun, gram, log_inverse + jnp.sum(more, axis=1)), None

    begun = jax.vmap(at_first_row, (None, 0, 0))(columns, share, beta)
    g, m = len(beta), columns.shape[1]
    (_, gram, log_inverse), _ = jax.lax.scan(
        add, (begun, jnp.zeros((g, m, m)), jnp.zeros(g)), blocks
    )
    return gram, 2 * jnp.sum(jnp.where(used, jnp.log(scale), 0.0)) - log_inverse


def restricted(
    clock: Float[Numbers, "n k"],
    weight: Float[Numbers, " n"],
    columns: Float[Numbers, "n m"],
    scale: Float[Numbers, " *n"],
    share: Float[Numbers, "g 2"],
    rates: Float[Numbers, "g 2 k"],
    beta: Float[Numbers, " g"],
) -> tuple[Float[np.ndarray, " g"], Float[np.ndarray, " g"]]:
    """Restricted log-likelihood and sigma of every noise; column 0 is the residual."""
    found = products(clock, weight, columns, scale, share, rates, beta)
    gram, log_determinant = (np.asarray(x) for x in found)
    return _profiled(gram, log_determinant, int(np.sum(np.asarray(weight) > 0)))


def restricted_white(
    weight: Float[Numbers, " n"], columns: Float[Numbers, "n m"], scale: Float[Numbers, " *n"]
) -> tuple[float, float]:
    """Restricted log-likelihood and sigma of white noise; column 0 is the residual."""
    on = np.asarray(weight) > 0
    scale = np.broadcast_to(np.asarray(scale), on.shape)[on]
    white = np.asarray(columns)[on] / scale[:, None]
    log_determinant = 2 * np.sum(np.log(scale))
    value, sigma = _profiled((white.T @ white)[None], log_determinant[None], len(scale))
    return float(value[0]), float(sigma[0])


def _profiled(
    gram: Float[np.ndarray, "g m m"], log_determinant: Float[np.ndarray, " g"], n: int
) -> tuple[Float[np.ndarray, " g"], Float[np.ndarray, " g"]]:
    """Restricted log-likelihood and sigma from the products of whitened columns of `n` rows."""
    design = gram[:, 1:, 1:]
    diagonal = np.diagonal(design, axis1=1, axis2=2)
    used = diagonal > 0  # columns of zeros are padding
    p = int(np.sum(used[0]))
    size = np.where(used, 1 / np.sqrt(np.where(used, diagonal, 1.0)), 1.0)
    ridge = np.where(used, 1e-12, 1.0)[:, :, None] * np.eye(len(design[0]))
    with np.errstate(divide="ignore", invalid="ignore"):  # of more columns than rows
        scaled = design * size[:, :, None] * size[:, None, :] + ridge
        projection = gram[:, 1:, 0] * size
        # what is left is no ratio of determinants: of columns nearly alike those are not known
        solved = np.linalg.solve(scaled, projection[..., None])[..., 0]
        left = np.maximum(gram[:, 0, 0] - np.sum(projection * solved, axis=1), 1e-300)
        variance = left / (n - p)
        log_det = np.linalg.slogdet(scaled)[1] - 2 * np.sum(np.log(size), axis=1)
        deviance = (n - p) * (np.log(variance) + 1) + log_det + log_determinant
        return -0.5 * deviance, np.sqrt(variance)
