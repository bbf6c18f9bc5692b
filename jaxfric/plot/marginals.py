"""Curves of a study: every output over every parameter, whatever the others are."""

import textwrap
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from . import style
from .palette import BLUE
from .side import Side, code_colour, side_of
from .ticks import plain_log, whole_numbers

if TYPE_CHECKING:
    from xarray import Dataset

_BINS, _FEW_BINS, _IN_A_BIN = 16, 4, 8
"""Bins of a sampled parameter: no more, no fewer, and with so many samples in each if it can be."""
_MOST = 400_000
_WIDE, _HEIGHT = 24, 1.6
_MANY, _LEAST = 12, 0.05
"""Panels of which all are drawn; of more those that move: the median changes over the parameter by
so much of the range of its output, or a share of a code by so much."""
_ACROSS, _PANELS = 4, 24
"""Of those that move: panels side by side, and how many are drawn, so that each can be read."""
_ROUNDING = 1e-6
"""An output that varies by no more than this part of its size is constant."""


Columns: TypeAlias = dict[str, tuple[Side, np.ndarray]]
"""Parameters by name: each as an axis, and its value for every member."""


class _Band(NamedTuple):
    """Median and range of nine in ten members at every value of a parameter."""

    x: np.ndarray
    low: np.ndarray
    middle: np.ndarray
    high: np.ndarray


def draw_marginals(found: "Dataset", outputs: Sequence[str], coded: Sequence[str]) -> Figure | None:
    """Every output over every parameter: the median and the range of nine in ten, or shares.

    Outputs `coded` are codes, whose shares are drawn. All panels of an output share one scale. An
    output that has no number anywhere has no panel; the title names it. Of more than `_MANY` panels
    those that do not move are left out, and of those that move all but the `_PANELS` that move
    most; the title names what is left out. None where no parameter varies, or nothing has a number.
    """
    members, columns = _thinned(found)
    values = {name: np.asarray(found[name].isel(members).values).ravel() for name in outputs}
    empty = [n for n in outputs if n not in coded and not np.isfinite(values[n]).any()]
    shown = {n: columns for n in outputs if n not in empty}
    if not (shown and columns):
        return None
    cut = _moving(columns, {n: values[n] for n in shown}, coded) if _many(shown) else {}
    shown = cut or shown
    count = sum(map(len, shown.values()))
    several = _ACROSS if cut else max(1, _ACROSS // len(columns)) * len(columns)
    across = min(several, count)
    figure = style.new_figure(style.DOUBLE, _HEIGHT * -(-count // across) + 0.6)
    grid = figure.add_gridspec(-(-count // across), across)
    place, legend = 0, {}
    for name, some in shown.items():
        spots = [divmod(place + k, across) for k in range(len(some))]
        row = [figure.add_subplot(grid[spots[0]])]
        row += [figure.add_subplot(grid[spot], sharey=row[0]) for spot in spots[1:]]
        legend |= _row(row, some, values[name], found[name].attrs, name)
        for axis, (_, column) in zip(row[1:], spots[1:], strict=True):
            if column:
                axis.tick_params(which="both", labelleft=False)
            else:
                axis.set_ylabel(row[0].get_ylabel())
        place += len(some)
    style.finish(figure, legend=list(legend.values()))
    title = _title(found, empty, _still(cut, values, columns, empty) if cut else {})
    figure.suptitle(title, x=0.01, ha="left", fontsize=style.LETTERS)
    return figure


def _many(shown: Mapping[str, Columns]) -> bool:
    return sum(map(len, shown.values())) > _MANY


def _moving(
    columns: Columns, values: Mapping[str, np.ndarray], coded: Sequence[str]
) -> dict[str, Columns]:
    """The parameters over which each output moves, up to `_PANELS` of them: of every output the one
    over which it moves most, and then those that move most."""
    moves = {
        (output, name): _movement(at, values[output], output in coded)
        for output in values
        for name, (_, at) in columns.items()
    }
    order = sorted((pair for pair in moves if moves[pair] > _LEAST), key=lambda p: -moves[p])
    first = list({output: (output, name) for output, name in reversed(order)}.values())
    first.sort(key=order.index)
    kept = [*first, *(pair for pair in order if pair not in first)][:_PANELS]
    found = {o: {n: columns[n] for n in columns if (o, n) in kept} for o in values}
    return {output: some for output, some in found.items() if some}


def _movement(at: np.ndarray, values: np.ndarray, coded: bool) -> float:
    """By how much of its range the median of an output changes over a parameter, or a share."""
    if coded:
        places = np.unique(at)
        shares = [[np.mean(values[at == x] == c) for x in places] for c in np.unique(values)]
        return float(np.ptp(np.asarray(shares), axis=1).max())
    known = values[np.isfinite(values)]
    spread = float(np.subtract(*np.percentile(known, [95, 5])))
    if not spread > _ROUNDING * np.abs(known).max():
        return 0.0
    middle = _band(at, values).middle
    return float(np.ptp(middle[np.isfinite(middle)])) / spread


def _still(
    cut: Mapping[str, Columns],
    values: Mapping[str, np.ndarray],
    columns: Columns,
    empty: Sequence[str],
) -> dict[str, list[str]]:
    """Outputs that are not drawn over a parameter, by parameter; under "": those never drawn."""
    never = [name for name in values if name not in cut and name not in empty]
    still = {n: [output for output, some in cut.items() if n not in some] for n in columns}
    return {"": never} | {
        n: ["all"] if len(some) == len(cut) else some for n, some in still.items()
    }


def _row(
    row: Sequence[Axes], columns: Columns, values: np.ndarray, about: Mapping[str, str], name: str
) -> dict[str, Artist]:
    """The panels of an output, one over each parameter; what a legend explains of them."""
    label = "\n".join(textwrap.wrap(about.get("long_name", name), _WIDE))
    unit, legend = "share", {}
    if "flag_meanings" in about:
        legend = _codes(row, columns, values, about["flag_meanings"].split())
    else:
        unit = _numbers(row, columns, values, about.get("units", "1"))
    row[0].set_ylabel(f"{label}\n[{unit}]" if unit else label)
    for axis, (side, _) in zip(row, columns.values(), strict=True):
        axis.set_xlabel(side.label)
        if side.log:
            plain_log(axis, "x")
        else:
            whole_numbers(axis, "x", most=2)
    return legend


def _title(found: "Dataset", empty: Sequence[str], still: Mapping[str, Sequence[str]]) -> str:
    """Title: what is drawn, and what is not; lines no longer than the figure."""
    lines = ["Over all other parameters: median, and where nine in ten lie; shares of codes"]
    names = ", ".join(found[name].attrs.get("long_name", name) for name in empty)
    lines += [f"No number anywhere: {names}"] if names else []
    names = ", ".join(found[name].attrs.get("long_name", name) for name in still.get("", ()))
    lines += [f"Left out, for nothing moves: {names}"] if names else []
    over = [f"{', '.join(some)} over {name}" for name, some in still.items() if name and some]
    lines += [f"Left out, for little or nothing moves there: {'; '.join(over)}"] if over else []
    return "\n".join(textwrap.fill(line, style.letters(style.DOUBLE)) for line in lines)


def _thinned(found: "Dataset") -> tuple[dict[str, slice], dict[str, tuple[Side, np.ndarray]]]:
    """Members to read, no more than some hundred thousand, and what each parameter is for them."""
    dims = tuple(map(str, found["outcome"].dims))
    steps = dict.fromkeys(dims, 1)
    sizes = {d: found.sizes[d] for d in dims}
    while np.prod([-(-sizes[d] // steps[d]) for d in dims], dtype=float) > _MOST:
        widest = max(dims, key=lambda d: sizes[d] / steps[d])
        steps[widest] += 1
    members = {d: slice(None, None, steps[d]) for d in dims}
    shape = tuple(-(-sizes[d] // steps[d]) for d in dims)
    columns = {}
    for name in map(str, found.coords):
        about = found[name]
        dim = str(about.dims[0])
        if dim not in dims or about.ndim != 1:
            continue
        side = side_of(found, name)
        part = side.values[members[dim]]
        if np.ptp(part) == 0:
            continue
        if name != dim:  # a sampled column: in bins
            side, part = _binned(side, part)
        place = [-1 if d == dim else 1 for d in dims]
        columns[name] = side, np.broadcast_to(part.reshape(place), shape).ravel()
    return members, columns


def _binned(side: Side, values: np.ndarray) -> tuple[Side, np.ndarray]:
    bins = min(max(len(values) // _IN_A_BIN, _FEW_BINS), _BINS)
    edges = np.unique(np.quantile(values, np.linspace(0, 1, bins + 1)))
    place = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)
    middle = 0.5 * (edges[1:] + edges[:-1])
    log = bool(values.min() > 0 and values.max() > 20 * values.min())
    return Side(side.name, middle, side.label, log), middle[place]


def _numbers(row: Sequence[Axes], columns: Columns, values: np.ndarray, unit: str) -> str:
    """A row of bands on one scale; the unit in which they are drawn."""
    finite = np.abs(values[np.isfinite(values)])
    size, text = (1.0, "")
    if unit != "1":
        size, text = style.prefixed(float(np.percentile(finite, 95)), unit)
    bands = [_band(at, size * values) for _, at in columns.values()]
    for axis, band in zip(row, bands, strict=True):
        x, low, middle, high = band
        known = int(np.isfinite(middle).sum())
        axis.fill_between(x, low, high, color=BLUE, alpha=0.18, lw=0)
        axis.plot(x, middle, color=BLUE, lw=1.4, marker="." if known < 6 else None)
        axis.grid(True, color="0.93")
    low = np.concatenate([band.low for band in bands])
    high = np.concatenate([band.high for band in bands])
    if np.nanmin(low) > 0 and np.nanmax(high) > 50 * np.nanmin(low):
        plain_log(row[0], "y")  # all panels of the output share it
    else:
        whole_numbers(row[0], "y", least=0.01)
    return text.replace("*", " ")


def _band(at: np.ndarray, values: np.ndarray) -> _Band:
    rows = []
    for x in np.unique(at):
        part = values[(at == x) & np.isfinite(values)]
        rows.append((x, *(np.percentile(part, [5, 50, 95]) if part.size else [np.nan] * 3)))
    return _Band(*np.asarray(rows).T)


def _codes(
    row: Sequence[Axes], columns: Columns, values: np.ndarray, names: list[str]
) -> dict[str, Artist]:
    """A row of shares of codes; the squares of its legend, of those that occur."""
    colours = [code_colour(i, name) for i, name in enumerate(names)]
    for axis, (_, at) in zip(row, columns.values(), strict=True):
        x = np.unique(at)
        shares = [[np.mean(values[at == v] == i) for v in x] for i in range(len(names))]
        axis.stackplot(x, np.asarray(shares), colors=colours, lw=0)
    row[0].set_ylim(0, 1)
    seen = [i for i in range(len(names)) if (values == i).any()]
    words = {i: names[i].replace("_", " ") for i in seen}
    return {f"{words[i]}{colours[i]}": style.square(colours[i], words[i]) for i in seen}
