"""Estimates the noise of a residual by restricted likelihood: white, plus a few correlated parts.

Damped Newton steps within bounds find the parameters of a `Family`. The derivatives are finite
differences of the likelihood between noises that are evaluated in one pass (`likelihood`).

`estimate_noise` starts from white noise and adds a part, then exchanges a part for another, while
this lowers the BIC. `estimate_together` estimates one noise of many residuals. `profile_noise`
keeps the parts and estimates their sizes anew. In a very long record the search for parts uses a
few stretches of rows, and the estimate of their sizes more stretches. The standard deviation sigma
and the likelihood use all rows.
"""

import functools
import itertools
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import ArrayLike, Float

from ...threads import side_by_side
from ..padding import Numbers, counted_rows, padded_columns
from ..thresholds import FEW
from . import thresholds as const
from .families import Family, inside, noises_at
from .likelihood import restricted
from .model import Noise, Noises, white_of
from .parts import KINDS, Exponential, Limits, Resonator

Values = tuple[Float[np.ndarray, " g"], Float[np.ndarray, " g"]]
"""Restricted log-likelihoods and sigmas of noises."""


class NoiseRows(NamedTuple):
    """The input of a noise estimate. Column 0 is the residual, the other columns are the Jacobian.

    Skipped rows and zero columns may be left out; `every` is the scale of all rows.
    """

    clock: Float[np.ndarray, "n k"]
    weight: Float[np.ndarray, " n"]
    columns: Float[np.ndarray, "n m"]
    scale: Float[np.ndarray, " *n"]
    limits: Limits
    rows: int
    every: Float[np.ndarray, " *n"]
    others: "tuple[NoiseRows, ...]" = ()
    """Other residuals with the same noise, each with its own sigma (`estimate_together`)."""

    @property
    def worth(self) -> float:
        """Rise of ln L that justifies one more parameter (BIC): ln(rows)/2."""
        return 0.5 * float(np.log(self.rows))

    def merit(self, one: "Found") -> float:
        """ln L of a noise less its penalty by BIC: the noise of lowest BIC has the largest."""
        return one.value - self.worth * one.family.parameters

    def values(self, family: Family, theta: Float[np.ndarray, "g q"]) -> Values:
        """Restricted log-likelihoods of noises of a family, and the sigma of each."""
        return self.values_of_all({family: theta})[0]

    def values_of_all(self, thetas: Mapping[Family, Float[np.ndarray, "g q"]]) -> list[Values]:
        """Restricted log-likelihoods and sigmas, as `values`, for noises of many families."""
        return self.values_of([noises_at(f, theta, self.limits) for f, theta in thetas.items()])

    def values_of(self, every: Sequence[Noises]) -> list[Values]:
        """Restricted log-likelihoods and sigmas for sets of noises with different parts."""
        passes = [list(self._passes(noises)) for noises in every]
        found = iter(side_by_side(self._values, itertools.chain(*passes)))
        values = []
        for noises, own in zip(every, passes, strict=True):
            both = zip(*(next(found) for _ in own), strict=True)
            value, sigma = (np.concatenate(x)[: len(noises.white)] for x in both)
            values.append((np.where(np.isfinite(value), value, -np.inf), sigma))
        return values

    def _passes(self, noises: Noises) -> Iterator[Noises]:
        """The noises of every pass. Passes have one of two sizes and the last is padded, so that
        few shapes are compiled."""
        count = len(noises.white)
        size = const.TOGETHER if self.columns.shape[1] > 1 else const.ALONE
        for begin in range(0, count, size):
            at = np.minimum(np.arange(begin, begin + size), count - 1)
            yield jax.tree.map(lambda x, at=at: x[at], noises)

    def _values(self, noises: Noises) -> Values:
        value, sigma = restricted(self.clock, self.weight, self.columns, self.scale, noises)
        return value + sum(one._values(noises)[0] for one in self.others), sigma

    def found(self, family: Family, theta: np.ndarray, value: float, sigma: float) -> "Found":
        """The noise of a family at `theta`, with given likelihood and sigma."""
        noises = noises_at(family, theta[None], self.limits)
        parts = jax.tree.map(lambda x: x[0], noises.parts)
        noise = Noise(np.asarray(sigma), parts, self.every, np.asarray(value))
        return Found(noise, family, theta, float(value))


class Found(NamedTuple):
    """The likeliest noise of a family."""

    noise: Noise
    family: Family
    theta: np.ndarray
    """Parameters of the parts, concatenated (`parts`)."""
    value: float


# ---- the input


def longest_memory(clock: Float[Numbers, "n *k"]) -> np.ndarray:
    """Return the largest correlation length (k,) that the noise of a fit may have along each of k
    coordinates (time, path or row number): `LONGEST` times the length of the record.
    """
    return const.LONGEST * np.ptp(np.asarray(clock).reshape(len(clock), -1), axis=0)


def limits_of(clock: Numbers, weight: Numbers, longest: ArrayLike | None = None) -> Limits:
    """Limits of correlation lengths: half the median row gap, and `longest` or half the record; and
    the gap that `CLOSEST` of the rows stay below."""
    times = np.asarray(clock)
    times = times.reshape(len(times), -1)
    on = np.asarray(weight) > 0
    span = np.ptp(times, axis=0)
    apart = np.abs(np.diff(times, axis=0))[on[1:]]
    least = const.SHORTEST * np.maximum(span, 1e-300)
    gaps, half = np.maximum(np.quantile(apart, [const.CLOSEST, 0.5], axis=0), least)
    most = 0.5 * span if longest is None else np.broadcast_to(np.asarray(longest), span.shape)
    return Limits(0.5 * half, np.maximum(most, 0.5 * half), gaps)


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

    `clock` is (n, k) or (n,), `weight` (n,) is 0 for skipped rows. On each clock the search covers
    correlation lengths from half the median gap of rows to `longest`, by default half the record.
    """
    clock, weight, jacobian = (np.asarray(x) for x in (clock, weight, jacobian))
    clock = clock[:, None] if clock.ndim == 1 else clock
    every = np.ones(()) if scale is None else np.asarray(scale)
    moves = np.any(jacobian[weight > 0] != 0, axis=0)
    moved = padded_columns(jacobian[:, moves]) if moves.any() else np.zeros((len(weight), FEW))
    columns = np.column_stack([np.asarray(residual), moved])
    rows, limits = int(np.sum(weight > 0)), limits_of(clock, weight, longest)
    return NoiseRows(*counted_rows(clock, weight, columns, every), limits, rows, every)


def stretches(record: NoiseRows, number: int = const.SOUGHT) -> NoiseRows:
    """Stretches of neighbouring rows, spread evenly over a long record; a short record as it is.

    Correlation beyond the length of a stretch is visible between stretches.
    """
    if record.rows <= number * const.STRETCH:
        return record
    counted = np.array_split(np.flatnonzero(np.asarray(record.weight) > 0), number)
    middle = [(len(rows) - const.STRETCH) // 2 for rows in counted]
    pairs = zip(counted, middle, strict=True)
    taken = np.concatenate([rows[begin : begin + const.STRETCH] for rows, begin in pairs])
    scale = record.scale[taken] if record.scale.ndim else record.scale
    clock, weight, columns = (x[taken] for x in (record.clock, record.weight, record.columns))
    return NoiseRows(clock, weight, columns, scale, record.limits, len(taken), record.every)


# ---- the search


def estimate_noise(
    record: NoiseRows,
    *,
    either_sign: bool = False,
    least: float = 0.0,
    like: Found | None = None,
) -> Found:
    """Restricted maximum-likelihood noise of a residual with its Jacobian (`noise_rows`).

    If `either_sign` is True, negative correlation is allowed (even sampling). `least` is the
    smallest standard deviation of the white part, for example from quantisation. If a noise `like`
    is given and not white, the parts of `like` are kept, and only their sizes are estimated.
    """
    part, larger = stretches(record, const.SOUGHT), stretches(record, const.SIZED)
    if like is None or not like.family.parameters:
        best = _with_parts(part, either_sign=either_sign)
    else:
        best = like
    best = _best_of(larger, best.family, best.theta[None])
    return not_below(record, best, least) if larger is record else held_noise(record, best, least)


def estimate_together(records: Sequence[NoiseRows], own: Sequence[Found]) -> list[Found]:
    """Restricted maximum-likelihood noise of many residuals that share its parts; each residual has
    its own sigma.

    The log-likelihoods of the residuals are added, so many short residuals together determine a
    correlation length that none determines alone. The families of the shared noise are those of the
    residuals' `own` noises (`estimate_noise`). A residual whose own noise is clearly likelier (BIC)
    keeps it, and the noise of the rest is estimated again, without the residuals that differ most.
    """
    if len(records) < 2:
        return list(own)
    limits = Limits(*np.min([one.limits for one in records], axis=0))
    some = [one._replace(limits=limits) for one in records]
    joined = some[0]._replace(others=tuple(some[1:]))
    worth = 0.5 * np.log(sum(one.rows for one in some))
    families = dict.fromkeys(one.family for one in own)
    starts = [np.stack([one.theta for one in own if one.family == f]) for f in families]
    found = side_by_side(lambda f, theta: _best_of(joined, f, theta), families, starts)
    best = max(found, key=lambda one: one.value - worth * one.family.parameters)
    shared = [held_noise(one, best) for one in some]
    gains = [
        a.value - b.value - one.worth * max(a.family.parameters, 1)
        for one, a, b in zip(records, own, shared, strict=True)
    ]
    if not max(gains) > 0:
        return shared
    differ = [gain >= const.ALSO_DIFFERS * max(gains) for gain in gains]
    pairs = zip(records, own, differ, strict=True)
    rest = [(one, alone) for one, alone, differs in pairs if not differs]
    again = iter(estimate_together(*zip(*rest, strict=True)) if rest else ())
    return [a if differs else next(again) for a, differs in zip(own, differ, strict=True)]


def held_noise(record: NoiseRows, like: Found, least: float = 0.0) -> Found:
    """The noise `like`, with the likeliest sigma for another residual; `least` as in
    `estimate_noise`."""
    (value,), (sigma,) = record.values(like.family, like.theta[None])
    found = record.found(like.family, like.theta, value, sigma)
    return not_below(record, found, least)


def profile_noise(
    record: NoiseRows, family: Family, starts: Sequence[np.ndarray], *, least: float = 0.0
) -> Found:
    """The likeliest noise of one family, from some starts (as `Found.theta`); `least` as in
    `estimate_noise`."""
    return not_below(record, _best_of(record, family, np.stack(starts)), least)


def not_below(record: NoiseRows, found: Found, least: float) -> Found:
    """The noise with its white standard deviation raised to `least` if it is smaller.

    The correlated parts lose the added white variance in proportion. If correlated parts have less
    variance than is added, the total variance grows. The returned likelihood is that of the
    returned noise.
    """
    sigma, share = float(found.noise.sigma), 1 - float(found.noise.white)
    if sigma**2 * (1 - share) >= least**2:
        return found
    if share < 0:
        sigma, kept = least / float(np.sqrt(1 - share)), 1.0
    else:
        left = max(sigma**2 - least**2, 0.0)
        sigma = float(np.sqrt(least**2 + left))
        kept = left / sigma**2 / max(share, 1e-300)
    parts = tuple(part.with_share(np.asarray(part.share * kept)) for part in found.noise.parts)
    value = _restricted_at(record, parts, sigma)
    noise = Noise(np.asarray(sigma), parts, found.noise.scale, np.asarray(value))
    return found._replace(noise=noise, value=value)


def _restricted_at(record: NoiseRows, parts: tuple, sigma: float) -> float:
    """Restricted log-likelihood of a noise with given sigma.

    It is lower than at the likeliest sigma, s, by (n - p)/2 (q - 1 - ln q), q = s^2/sigma^2, with
    n - p degrees of freedom.
    """
    one = jax.tree.map(lambda x: np.asarray(x)[None], Noises(white_of(parts), parts))
    (value,), (likeliest,) = record.values_of([one])[0]
    used = np.linalg.norm(np.asarray(record.columns)[:, 1:], axis=0) > 0
    q = (float(likeliest) / sigma) ** 2
    return float(value) - 0.5 * (record.rows - used.sum()) * (q - 1 - np.log(q))


def _with_parts(record: NoiseRows, *, either_sign: bool) -> Found:
    """The likeliest noise within `CLOSE`. Parts are added, then exchanged, while the BIC falls: the
    part that is added first may be a compromise between two others.
    """
    best, tried = _best_of(record, Family(), np.zeros((1, 0))), set()
    added = functools.partial(_with_another, either_sign=either_sign)
    for starts, most in ((added, const.MOST_PARTS), (_exchanged, const.EXCHANGES)):
        for _ in range(most):
            more = _best_from(record, best, starts(record, best), tried)
            if not _pays(record, more, best):
                break
            best = more
    return best


def _with_another(record: NoiseRows, best: Found, *, either_sign: bool) -> dict[Family, np.ndarray]:
    """Starts of every family with one more part."""
    limits, family = record.limits, best.family
    # sizes are relative to white noise: scale them up if the noise is mostly correlated
    white = -float(np.log(np.clip(best.noise.white, np.exp(-const.LARGEST), 1.0)))
    kinds = [kind for kind in KINDS if not kind.even or (either_sign and not family.terms)]
    starts = {}
    for kind, clock in itertools.product(kinds, _clocks(limits)):
        shapes = kind.starts(_memories(limits, clock, const.MEMORIES))
        new = [(white + size, *own) for size in kind.sizes for own in shapes]
        more, theta = family.joined(kind.over(clock), best.theta, new)
        starts[more] = theta
    return starts


def _exchanged(record: NoiseRows, best: Found) -> dict[Family, np.ndarray]:
    """Starts of every family with another part in place of one part, which keep its variance."""
    limits, starts = record.limits, {}
    for k, (size, *_) in enumerate(best.family.split(best.theta)):
        rest, theta = best.family.without(k, best.theta)
        for kind, clock in itertools.product((Exponential, Resonator), _clocks(limits)):
            new = [(size, *own) for own in kind.starts(_memories(limits, clock, const.MEMORIES))]
            family, thetas = rest.joined(kind.over(clock), theta, new)
            if family.unordered != best.family.unordered:
                starts[family] = np.concatenate([starts.get(family, thetas[:0]), thetas])
    return starts


def _clocks(limits: Limits) -> list[int]:
    """The clocks on which a correlation length can be found."""
    return np.flatnonzero(limits.longest > limits.shortest).tolist()


def _best_from(
    record: NoiseRows, best: Found, starts: Mapping[Family, np.ndarray], tried: set[Family]
) -> Found:
    """The noise of lowest BIC among `best` and those refined from the likeliest `starts`. A family
    that is not in `tried` also starts with all its parts at once (`_all_parts`), and joins `tried`.
    """
    found = sorted(_likeliest(record, starts), key=lambda one: one.family.parameters - one.value)
    found = found[: const.REFINED]
    new = [one.family for one in found if one.family.unordered not in tried]
    tried.update(family.unordered for family in new)
    at_once = {family: _all_parts(family, record.limits) for family in new}
    found += _likeliest(record, {family: some for family, some in at_once.items() if len(some)})
    return _best_refined(record, best, found)


def _pays(record: NoiseRows, more: Found, best: Found) -> bool:
    """Whether the BIC of `more` is below that of `best`."""
    extra = more.family.parameters - best.family.parameters
    return more.value - best.value > max(extra * record.worth, const.CLOSE)


def _memories(limits: Limits, clock: int, number: int) -> list[float]:
    """Logarithms of correlation lengths on a clock, from the shortest to the longest."""
    ends = np.log(limits.shortest[clock]), np.log(limits.longest[clock])
    return np.linspace(*ends, number).tolist()


def _all_parts(family: Family, limits: Limits) -> np.ndarray:
    """Starts for all parts at once, (g, q): adding a part to one that has absorbed its variance
    does not find it. Empty for a family with one part."""
    number = len(family.terms)
    if number < 2:
        return np.zeros((0, family.parameters))
    inner = [
        kind.starts(_memories(limits, k, const.TOGETHER_MEMORIES + 2)[1:-1])
        for kind, k in family.terms
    ]
    ratios = const.TOGETHER_RATIO * np.linspace(-0.5, 0.5, number)
    return np.array(
        [
            [x for size, own in zip(sizes, shapes, strict=True) for x in (total + size, *own)]
            for total in const.TOGETHER_SIZES
            for sizes in itertools.permutations(ratios)
            for shapes in itertools.product(*inner)
        ]
    )


def _likeliest(record: NoiseRows, starts: Mapping[Family, np.ndarray]) -> list[Found]:
    """The likeliest start of every family.

    In a long record the likelihood of the residual alone (without the Jacobian) preselects `LIKELY`
    starts of a family. It takes a fraction of the time of the restricted likelihood.
    """
    starts = {family: inside(some, family, record.limits) for family, some in starts.items()}
    if record.rows > const.STRETCH:
        alone = record._replace(columns=record.columns[:, :1])
        found = zip(starts.items(), alone.values_of_all(starts), strict=True)
        starts = {f: some[np.argsort(-values)[: const.LIKELY]] for (f, some), (values, _) in found}
    found = zip(starts.items(), record.values_of_all(starts), strict=True)
    return [_best(record, family, some, *both) for (family, some), both in found]


def _best(
    record: NoiseRows, family: Family, theta: np.ndarray, values: np.ndarray, sigmas: np.ndarray
) -> Found:
    """The likeliest of some noises."""
    i = int(np.argmax(values))
    return record.found(family, theta[i], values[i], sigmas[i])


def _best_of(
    record: NoiseRows, family: Family, starts: np.ndarray, settled: float = const.SETTLED
) -> Found:
    """The likeliest noise of a family, refined from the likeliest of some starts."""
    starts = inside(np.asarray(starts, float), family, record.limits)
    best = _best(record, family, starts, *record.values(family, starts))
    return _refined(record, best, settled=settled)


def _refined(
    record: NoiseRows, best: Found, worth: float = -np.inf, settled: float = const.SETTLED
) -> Found:
    """The likeliest noise of a family by Newton's method from a start.

    It ends when a step gains less than `settled`, or early if even the slope of the likelihood
    cannot reach the value `worth`.
    """
    family = best.family
    for _ in range(const.NEWTON if family.parameters else 0):
        around, trials, promised = _newton(record, family, best.theta)
        if best.value + promised < worth:
            break
        found = _best(record, family, trials, *record.values(family, trials))
        found = max(found, around, key=lambda one: one.value)
        gain = found.value - best.value
        best = found if gain > 0 else best
        if not gain > settled:
            break
    return best


def _best_refined(record: NoiseRows, best: Found, found: Sequence[Found]) -> Found:
    """The noise of lowest BIC among `best` and some others, after their refinement.

    A noise is refined as long as its BIC can be lower than that of `best` and of the others. Noises
    with parts that the rows do not resolve are left out.
    """
    for start in sorted(found, key=record.merit, reverse=True):
        worth = record.merit(best) + record.worth * start.family.parameters
        one = _refined(record, start, worth, const.CLOSE)
        if record.merit(one) > record.merit(best) and one.family.resolved(one.theta, record.limits):
            best = one
    return best


def _newton(
    record: NoiseRows, family: Family, theta: np.ndarray
) -> tuple[Found, np.ndarray, float]:
    """The likeliest of the points around theta; Newton steps from theta with many dampings, cut at
    the bounds; and the largest gain of such a step at constant slope.

    A parameter at a bound that the likelihood would take beyond it stays there.
    """
    q, step = len(theta), const.STEP
    low, high = family.bounds(record.limits)
    centre = np.clip(theta, low + step, np.maximum(high - step, low + step))
    one, two = np.tril_indices(q, -1)
    unit = step * np.eye(q)
    points = centre + np.concatenate([np.zeros((1, q)), unit, -unit, unit[one] + unit[two]])
    values, sigmas = record.values(family, points)
    here, plus, minus, both = np.split(values, [1, q + 1, 2 * q + 1])
    curve = np.diag((plus + minus - 2 * here) / step**2)
    curve[one, two] = curve[two, one] = (both - plus[one] - plus[two] + here) / step**2
    slope = (plus - minus) / (2 * step) + curve @ (theta - centre)
    held = ((theta <= low) & (slope < 0)) | ((theta >= high) & (slope > 0))
    slope, curve = np.where(held, 0.0, slope), np.where(held[:, None] | held, 0.0, curve)
    scale, vectors = np.linalg.eigh(-curve)
    damped = np.abs(scale) + np.geomspace(1e-3, 1e3, const.DAMPINGS)[:, None]
    steps = np.clip((vectors.T @ slope / damped) @ vectors.T, -2.0, 2.0)
    around = _best(record, family, points, values, sigmas)
    return around, np.clip(theta + steps, low, high), float(np.max(steps @ slope))
