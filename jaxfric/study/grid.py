"""Parameters that a study varies, as a product of axes and as sampled columns.

    Grid(axes=(logspace("k_p", 1e4, 1e6, 60, unit="N/m"), values("V0", [1e-6, 1e-5])),
         samples=Samples(1024, (Uniform("A", 3.0, 6.0), Uniform("B", 4.0, 10.0))))

has the dimensions (sample, k_p, V0). Any value follows from its index alone, so that the whole grid
is never held in memory.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError
from . import sampling

SAMPLE = "sample"
"""The dimension that all sampled columns share."""
MOST_SOBOL = 2**30
KINDS = ("sobol", "latin", "random")


@dataclass(frozen=True, eq=False)
class Axis:
    """One dimension of a grid: its values in any order, their unit and meaning."""

    name: str
    values: np.ndarray
    unit: str = "1"
    long_name: str = ""
    log: bool = False
    """Evenly spaced in the logarithm; used only by figures."""

    def __post_init__(self):
        found = np.asarray(self.values, float).reshape(-1)
        if found.size == 0:
            raise InputError(f"axis '{self.name}' is empty; give it a value or more")
        if not np.all(np.isfinite(found)):
            raise InputError(f"axis '{self.name}' has a value that is not a finite number")
        object.__setattr__(self, "values", found)


def linspace(
    name: str, low: float, high: float, number: int, *, unit: str = "1", long_name: str = ""
) -> Axis:
    """Return an axis of `number` values from `low` to `high`, evenly spaced."""
    return Axis(name, np.linspace(low, high, max(number, 0)), unit, long_name)


def logspace(
    name: str, low: float, high: float, number: int, *, unit: str = "1", long_name: str = ""
) -> Axis:
    """Return an axis of `number` positive values from `low` to `high`, evenly spaced in the
    logarithm."""
    if not (low > 0 and high > 0):
        raise InputError(f"axis '{name}': logspace needs positive ends, not {low:g} and {high:g}")
    return Axis(name, np.geomspace(low, high, max(number, 0)), unit, long_name, log=True)


def values(name: str, numbers: ArrayLike, *, unit: str = "1", long_name: str = "") -> Axis:
    """Return an axis of the given values."""
    return Axis(name, np.asarray(numbers, float), unit, long_name)


@dataclass(frozen=True)
class Uniform:
    """A parameter sampled between `low` and `high`, evenly or evenly in its logarithm."""

    name: str
    low: float
    high: float
    unit: str = "1"
    long_name: str = ""
    log: bool = False
    kind: str = "sobol"

    def __post_init__(self):
        if self.kind not in KINDS:
            raise InputError(f"axis '{self.name}': no way to sample '{self.kind}'; one of {KINDS}")
        if not self.low < self.high:
            raise InputError(f"axis '{self.name}' is empty: from {self.low:g} to {self.high:g}")
        if self.log and not self.low > 0:
            raise InputError(f"axis '{self.name}': a logarithmic range begins above 0")


@dataclass(frozen=True, eq=False)
class Normal:
    """Several parameters drawn from one normal distribution, such as that of a fit's errors.

    x = mean + root z, where root root' is the covariance. A parameter in `log` is lognormal, x =
    mean exp(root z). For such a parameter `mean` is the median, and root root' the covariance of
    the logarithm.
    """

    names: tuple[str, ...]
    mean: np.ndarray
    root: np.ndarray
    log: tuple[bool, ...]
    units: tuple[str, ...]
    long_names: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Tabled:
    """Several parameters taken together from one row of a table, such as posterior draws.

    Each member has a row chosen at random, so a row may serve several members.
    """

    names: tuple[str, ...]
    table: np.ndarray
    """Values (n, p)."""
    units: tuple[str, ...]
    long_names: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Samples:
    """A number of sampled members, each with a value of every sampled parameter."""

    number: int
    columns: tuple[Uniform | Normal | Tabled, ...]
    seed: int = 0

    def __post_init__(self):
        if self.number < 1:
            raise InputError(f"the number of samples is {self.number}; give 1 or more")
        quasi = [c.name for c in self.columns if isinstance(c, Uniform) and c.kind == "sobol"]
        if quasi and self.number > MOST_SOBOL:
            raise InputError(
                f"axis '{quasi[0]}': a Sobol sequence has {MOST_SOBOL:.2g} points, not"
                f" {self.number:.3g}; take latin or random"
            )

    def described(self) -> list[tuple[str, str, str]]:
        """Name, unit and meaning of every sampled parameter, in order."""
        found = []
        for column in self.columns:
            if isinstance(column, Uniform):
                found.append((column.name, column.unit, column.long_name))
            else:
                found += list(zip(column.names, column.units, column.long_names, strict=True))
        return found

    def draw(self, begin: int, end: int) -> dict[str, np.ndarray]:
        """Return the sampled values of the members from `begin` to `end` - 1."""
        index = np.arange(begin, end)
        quasi = [c for c in self.columns if isinstance(c, Uniform) and c.kind == "sobol"]
        points = iter(())
        if quasi:
            points = iter(sampling.sobol(begin, end - begin, len(quasi), self.seed).T)
        found: dict[str, np.ndarray] = {}
        for place, column in enumerate(self.columns):
            if isinstance(column, Normal):
                found |= self._normal(column, index, 100 * (place + 1))
                continue
            if isinstance(column, Tabled):
                u = sampling.uniform(index, self.seed, 100 * (place + 1))
                row = (u * len(column.table)).astype(int)
                found |= dict(zip(column.names, column.table[row].T, strict=True))
                continue
            if column.kind == "sobol":
                u = next(points)
            elif column.kind == "latin":
                u = sampling.latin(index, self.number, self.seed, place)
            else:
                u = sampling.uniform(index, self.seed, place)
            found[column.name] = _spread(column, u)
        return found

    def _normal(self, of: Normal, index: np.ndarray, place: int) -> dict[str, np.ndarray]:
        z = [sampling.normal(index, self.seed, place + i) for i in range(of.root.shape[1])]
        moved = of.root @ np.stack(z) if z else np.zeros((len(of.names), len(index)))
        return {
            name: of.mean[i] * np.exp(moved[i]) if of.log[i] else of.mean[i] + moved[i]
            for i, name in enumerate(of.names)
        }


def _spread(column: Uniform, u: np.ndarray) -> np.ndarray:
    if column.log:
        return column.low * np.exp(u * math.log(column.high / column.low))
    return column.low + u * (column.high - column.low)


@dataclass(frozen=True, eq=False)
class Grid:
    """The product of all axes; the sampled members form an additional first dimension."""

    axes: tuple[Axis, ...] = ()
    samples: Samples | None = None
    names: tuple[str, ...] = field(init=False)
    """Every varied parameter."""

    def __post_init__(self):
        sampled = [] if self.samples is None else [name for name, _, _ in self.samples.described()]
        names = (*sampled, *(axis.name for axis in self.axes))
        if not names:
            raise InputError("the study varies nothing; give it an axis")
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise InputError(f"axis '{twice[0]}' is given twice")
        object.__setattr__(self, "names", names)

    @property
    def dims(self) -> dict[str, int]:
        """Length of every dimension, in order."""
        first = {} if self.samples is None else {SAMPLE: self.samples.number}
        return first | {axis.name: len(axis.values) for axis in self.axes}

    @property
    def shape(self) -> tuple[int, ...]:
        """Lengths of the dimensions."""
        return tuple(self.dims.values())

    @property
    def size(self) -> int:
        """Number of members."""
        return math.prod(self.shape)

    def members(self, where: Sequence[slice]) -> dict[str, np.ndarray]:
        """Return the parameters of a block, in the order of the flattened block."""
        lengths = [part.stop - part.start for part in where]
        found: dict[str, np.ndarray] = {}
        for i, (dim, part) in enumerate(zip(self.dims, where, strict=True)):
            if dim == SAMPLE and self.samples is not None:
                columns = self.samples.draw(part.start, part.stop)
            else:
                axis = next(a for a in self.axes if a.name == dim)
                columns = {dim: axis.values[part]}
            for name, column in columns.items():
                spread = column.reshape([-1 if j == i else 1 for j in range(len(lengths))])
                found[name] = np.broadcast_to(spread, lengths).reshape(-1)
        return {name: found[name] for name in self.names}


@dataclass(frozen=True)
class Tiling:
    """A grid cut into blocks of at most `chunk` members; blocks contain trailing axes in full."""

    shape: tuple[int, ...]
    block: tuple[int, ...]

    @staticmethod
    def of(shape: Sequence[int], chunk: int) -> "Tiling":
        """Cut a grid of the given shape into blocks that are as even as possible.

        Raises
        ------
        InputError : `chunk` below 1.
        """
        if chunk < 1:
            raise InputError(f"chunk is {chunk}; give 1 member or more")
        block = [1] * len(shape)
        room = chunk
        for i in reversed(range(len(shape))):
            pieces = math.ceil(shape[i] / max(room, 1))
            block[i] = math.ceil(shape[i] / pieces)
            room //= block[i]
            if pieces > 1:
                break
        return Tiling(tuple(shape), tuple(block))

    @property
    def counts(self) -> tuple[int, ...]:
        """Number of blocks along each dimension."""
        return tuple(math.ceil(n / b) for n, b in zip(self.shape, self.block, strict=True))

    @property
    def largest(self) -> int:
        """Number of members of the largest block."""
        return math.prod(self.block)

    def __len__(self) -> int:
        return math.prod(self.counts)

    def index(self, number: int) -> tuple[int, ...]:
        """Return the index of a block along each dimension."""
        return tuple(int(i) for i in np.unravel_index(number, self.counts))

    def where(self, number: int) -> tuple[slice, ...]:
        """Return the slices of the grid that form a block."""
        return tuple(
            slice(i * b, min((i + 1) * b, n))
            for i, b, n in zip(self.index(number), self.block, self.shape, strict=True)
        )
