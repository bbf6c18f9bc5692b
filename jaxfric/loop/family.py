"""Steady friction curves of other shapes, if a record does not determine the shape of the curve.

A record measures steady friction f_ss(V) only at the recorded velocities V; between recorded
velocities only transients contain information. A curve with as many parameters as recorded
velocities fits any values of friction, and a curve of another shape may fit as well. If several
curves fit, a steady curve is certainly missing, but the record does not determine which curve.

`curve_family` fits curves of other shapes, to first order about the fit of the loop. Each other
curve replaces the steady curve that the loop added, together with the steady curve of the base (f0,
A and B of a slider). A curve of another shape that fits well changes friction along the motion only
little. So the response to a change of the curve is nearly linear, and linear least squares give all
other parameters. Each shape is one least-squares problem under the noise of the fit. The BIC of a
shape is computed with noise estimated for this shape, as for any candidate model. The other shapes
are polynomials in ln V, and broken lines in ln V with a value for every velocity.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from ..fitting.noise import independent_rows
from ..fitting.noise.thresholds import CLEAR, SAME_VELOCITY, TOLD
from .engine import Engine
from .evaluate import Rows
from .refit import Candidate, bic
from .thresholds import ACCEPT, GRID, OF_BASE, REACH


class OtherShape(NamedTuple):
    """A curve of another shape, fitted in place of the curve that the loop named."""

    shape: str
    """The shape as text."""
    worse: float
    """BIC with it minus that of the fit; negative if it fits better."""


class Decisive(NamedTuple):
    """A velocity at which curves that fit equally well differ."""

    velocity: float
    """The velocity [m/s], or [rad/s]."""
    errors: float
    """Range of the curves there over the standard error of the mean of one more step."""


class CurveFamily(NamedTuple):
    """The effects of a fit that are steady friction curves, and curves of other shapes."""

    effects: tuple[str, ...]
    """Ids of the effects of the fit that are steady curves."""
    velocities: int | None
    """Number of velocities in the train and validation blocks; None if velocity is continuous."""
    parameters: int
    """Number of parameters of the steady curve, including those of the base."""
    others: tuple[OtherShape, ...]
    """All other fitted shapes, best first."""
    decided_by: tuple[Decisive, ...]
    """Velocities at which the fitting shapes differ clearly; the clearest first."""
    unit: str = "m/s"

    @property
    def fitting(self) -> tuple[str, ...]:
        """Curves of other shapes that fit as well."""
        return tuple(o.shape for o in self.others if o.worse < ACCEPT)

    @property
    def interpolates(self) -> bool:
        """Whether the curve has as many parameters as there are recorded velocities."""
        return self.velocities is not None and self.velocities <= self.parameters

    @property
    def untold(self) -> bool:
        """Whether the record does not determine the shape of the curve."""
        return self.interpolates or bool(self.fitting)


def listed(names: Sequence[str], last: str = "and") -> str:
    """Names as a list in text: "a", "a and b", "a, b and c"."""
    if len(names) < 2:
        return "".join(names)
    return f"{', '.join(names[:-1])} {last} {names[-1]}"


Curve = Callable[[np.ndarray], np.ndarray]
"""Maps speeds (m,) to friction (m, k)."""
_DEGREES = {1: "a line in ln V", 2: "a quadratic in ln V", 3: "a cubic in ln V"}
_FREE = "a value for every velocity"


class CurveRig(NamedTuple):
    """The steady curves of a kind of rig, over positive speeds in m/s or rad/s."""

    effects: tuple[str, ...]
    """Effects of the fit that are steady curves."""
    declared: tuple[str, ...]
    """Effects of the base that are steady curves."""
    speeds: np.ndarray
    """Speeds of the motion segments in the train and validation blocks."""
    counted: bool
    """Whether the rig slides at these discrete speeds only."""
    replaced: tuple[str, ...]
    """Parameters of the base that `base` replaces."""
    base: Curve
    """The steady curves of the base."""
    lowest: int
    """Lowest power of ln V that the base lacks."""
    level: Callable[[np.ndarray, np.ndarray], np.ndarray]
    """Friction of steady sliding at parameters z and speeds (m,)."""
    send: Callable[[Curve], tuple[np.ndarray, np.ndarray]]
    """Columns of `base`, then of a curve: recorded friction, and the extra rows; noise units."""
    unit: str


def curve_family(engine: Engine, final: Candidate, rig: CurveRig) -> CurveFamily | None:
    """Curves of other shapes in place of the steady curves of a fit; None if the fit has none."""
    if not rig.effects or final.failed:
        return None
    speeds = distinct(rig.speeds)
    null = np.array(final.z)
    for id in rig.effects:
        null[engine.model.amplitudes(id)] = 0.0
    own = engine.model.columns((*rig.effects, *rig.declared))
    parameters = OF_BASE + len(own)

    def added(V: np.ndarray) -> np.ndarray:
        return rig.level(final.z, V) - rig.level(null, V)

    shapes = _shapes(rig, speeds)
    index = engine.free(final.effects)
    rows = engine.evaluate(final.z, index)
    gone = [*engine.model.columns(rig.effects), *(engine.names.index(n) for n in rig.replaced)]
    kept = [k for k, i in enumerate(index) if i not in gone]
    sent = rig.send(
        lambda V: np.concatenate([added(V)[:, None], *(c(V) for _, c in shapes)], axis=1)
    )
    first, begin = rig.base(speeds).shape[1], 0
    grid = _grid(speeds, counted=rig.counted)
    named, without, found = rig.level(final.z, grid), rig.level(null, grid), []
    for words, curve in shapes:
        shape = np.concatenate([rig.base(grid), curve(grid)], axis=1)
        width = shape.shape[1] - first
        at = [*range(first), *range(first + 1 + begin, first + 1 + begin + width)]
        begin += width
        left, weights = _refitted(engine, final, rows, kept, sent, first, at)
        count = len(index) - len(engine.model.columns(rig.effects)) + width
        worse = bic(engine, left, count)[0] - final.bic
        found.append((OtherShape(words, float(worse)), without + shape @ weights))
    error = step_error(engine, final)
    return CurveFamily(
        rig.effects,
        len(speeds) if rig.counted else None,
        parameters,
        *_sorted_out(grid, named, found, speeds, error),
        rig.unit,
    )


def _refitted(
    engine: Engine,
    final: Candidate,
    rows: Rows,
    kept: Sequence[int],
    sent: tuple[np.ndarray, np.ndarray],
    first: int,
    at: Sequence[int],
) -> tuple[Rows, np.ndarray]:
    """Rows of the fit without the added curve but with the columns `at` of `sent`, refitted with
    the parameters `kept`; and the coefficients of these columns."""
    columns, more = sent
    matrix = np.concatenate([columns[:, at], rows.jacobian[:, kept]], axis=1)
    extra = np.concatenate([more[:, at], rows.extra_jacobian[:, kept]], axis=1)
    residual, extra_residual = rows.residual - columns[:, first], rows.extra - more[:, first]
    both = np.concatenate([residual[:, None], matrix], axis=1)
    white = engine.whiten(both * engine.weight[:, None], final.noise)
    white = np.concatenate([white, np.concatenate([extra_residual[:, None], extra], axis=1)])
    size = np.linalg.norm(white[:, 1:], axis=0)
    size = np.where(size > 0, size, 1.0)
    found = np.linalg.lstsq(white[:, 1:] / size, -white[:, 0], rcond=1e-11)[0] / size
    left = rows._replace(residual=residual + matrix @ found, extra=extra_residual + extra @ found)
    return left, found[: len(at)]


def distinct(speeds: np.ndarray) -> np.ndarray:
    """Distinct speeds, ascending: speeds within `SAME_VELOCITY` are replaced by their mean."""
    groups: list[list[float]] = []
    for speed in np.sort(np.abs(speeds[speeds != 0])).tolist():
        if groups and groups[-1][0] >= SAME_VELOCITY * speed:
            groups[-1].append(speed)
        else:
            groups.append([speed])
    return np.asarray([float(np.mean(group)) for group in groups])


def _shapes(rig: CurveRig, speeds: np.ndarray) -> list[tuple[str, Curve]]:
    """Other shapes, each with its name. Transients contain information between velocities, so three
    velocities may determine a cubic."""
    centre = np.log(np.sqrt(speeds[0] * speeds[-1]))

    def powers(degree: int) -> Curve:
        used = range(rig.lowest, degree + 1)
        return lambda V: np.stack([(np.log(V) - centre) ** k for k in used], axis=1)

    found = [(words, powers(degree)) for degree, words in _DEGREES.items() if degree >= rig.lowest]
    if rig.counted and len(speeds) - OF_BASE > max(_DEGREES) + 1 - rig.lowest:
        corners = np.log(speeds[1:-1])
        found.append((_FREE, lambda V: np.maximum(np.log(V)[:, None] - corners, 0.0)))
    return found


def _grid(speeds: np.ndarray, *, counted: bool) -> np.ndarray:
    """Speeds at which curves are compared, rounded to two digits, from a tenth of the slowest to
    ten times the fastest; without those of the record."""
    grid = np.geomspace(speeds[0] / REACH, REACH * speeds[-1], GRID)
    grid = np.unique([float(f"{V:.1e}") for V in grid])
    if not counted:
        return grid
    apart = np.abs(np.log(grid[:, None] / speeds)).min(axis=1)
    return grid[apart > -np.log(SAME_VELOCITY)]


def _sorted_out(grid, named, found, speeds, error) -> tuple[tuple, tuple]:
    """The other shapes, best first, and the velocities that decide between them.

    A shape that nowhere differs clearly from the named one counts as the same curve.
    """
    found = [f for f in found if np.max(np.abs(f[1] - named)) > CLEAR * error]
    found = sorted(found, key=lambda f: f[0].worse)
    fitting = [level for other, level in found if other.worse < ACCEPT]
    levels = np.stack([named, *(fitting or [level for _, level in found])])
    return tuple(other for other, _ in found), deciding(grid, levels, speeds, error)


def deciding(
    grid: np.ndarray, levels: np.ndarray, speeds: np.ndarray, error: float
) -> tuple[Decisive, ...]:
    """At most three velocities at which curves differ most. Each gap between recorded speeds, and
    the range on either side of all recorded speeds, gives one velocity. At each of the returned
    velocities the curves differ by more than 3 standard errors.

    grid : speeds (m,). levels : friction of every curve there (c, m). speeds : recorded speeds,
    ascending. error : standard error of the mean of one more step.
    """
    apart = np.ptp(levels, axis=0) / error
    gap = np.searchsorted(speeds, grid)
    best = [max(np.flatnonzero(gap == k), key=lambda i: apart[i]) for k in np.unique(gap)]
    clear = sorted((i for i in best if apart[i] > CLEAR), key=lambda i: -apart[i])
    return tuple(Decisive(float(grid[i]), float(apart[i])) for i in clear[:TOLD])


def step_error(engine: Engine, final: Candidate) -> float:
    """Standard error of mean friction in a motion segment, in the unit of friction. The effective
    number of independent train rows is divided equally among the segments.
    """
    segments = len(np.unique(engine.blocks.step[engine.blocks.train]))
    rows = independent_rows(engine.noise.clock, engine.weight, final.noise)
    return engine.unit * float(final.noise.sigma) * float(np.sqrt(segments / rows))
