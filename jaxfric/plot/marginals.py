"""Curves of a study: each output over each parameter, for all values of the other parameters."""

import textwrap
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from . import style
from .palette import BLUE
from .side import Side, code_colours, side_of
from .ticks import plain_log, whole_numbers

if TYPE_CHECKING:
    from xarray import Dataset

_BINS, _FEW_BINS, _IN_A_BIN = 16, 4, 8
"""Bins of a sampled parameter: no more, no fewer, and with so many samples in each if it can be."""
_MOST = 400_000
_WIDE, _HEIGHT = 17, 1.6
_MANY, _LEAST = 12, 0.05
"""Panels of which all are drawn; of more those that move: the median changes over the parameter by
so much of the range of its output, or a share of a code by so much."""
_ACROSS, _PANELS = 4, 24
"""Of those that move: panels side by side, and how many are drawn, so that each can be read."""
_ROUNDING = 1e-6
"""An output that varies by no more than this part of its size is constant."""


Columns: TypeAlias = dict[str, tuple[Side, np.ndarray]]
"""Parameters by name: each as an axis, and its value for every member."""
Pair: TypeAlias = tuple[str, str]
"""An output and the parameter that it is drawn over."""


class _Band(NamedTuple):
    """Median and range of nine in ten members at every value of a parameter."""

    x: np.ndarray
    low: np.ndarray
    middle: np.ndarray
    high: np.ndarray


def draw_marginals(found: "Dataset", outputs: Sequence[str], coded: Sequence[str]) -> Figure | None:
    """Draw each output over each parameter: the median and a range of 90 %, or shares.

    Outputs in `coded` are codes; their shares are drawn. All panels of an output share one scale.
    An output without any number has no panel. If there would be more than `_MANY` panels, only
    `_PANELS` are drawn: the pairs whose output changes most with the parameter. The title names all
    outputs and parameters that are left out. Returns None if no parameter varies, or no output has
    a number.
    """
    members, columns = _thinned(found)
    values = {name: np.asarray(found[name].isel(members).values).ravel() for name in outputs}
    empty = [n for n in outputs if n not in coded and not np.isfinite(values[n]).any()]
    every = [(output, name) for output in outputs if output not in empty for name in columns]
    if not every:
        return None
    shown = _moving(every, columns, values, coded) if len(every) > _MANY else []
    across = _ACROSS if shown else max(1, _ACROSS // len(columns)) * len(columns)
    shown = shown or every
    across = min(across, len(shown))
    rows = -(-len(shown) // across)
    figure = style.new_figure(style.DOUBLE, _HEIGHT * rows + 0.6)
    # the layout ignores the width of names below panels: names in the last column need room
    figure.set_layout_engine("constrained", rect=(0.0, 0.0, 0.97, 1.0))
    grid = figure.add_gridspec(rows, across)
    panels: dict[str, dict[str, Axes]] = {output: {} for output, _ in shown}
    left: list[Axes] = []
    for k, (output, name) in enumerate(shown):
        first = next(iter(panels[output].values()), None)
        axis = figure.add_subplot(grid[divmod(k, across)], sharey=first)
        panels[output][name] = axis
        if first is None or k % across == 0:
            left.append(axis)
        else:
            axis.tick_params(which="both", labelleft=False)
    legend = []
    for output, row in panels.items():
        about = found[output].attrs
        label, unit = "\n".join(textwrap.wrap(about.get("long_name", output), _WIDE)), "share"
        at = [(axis, columns[name][1]) for name, axis in row.items()]
        if "flag_meanings" in about:
            legend += _shares(at, values[output], about["flag_meanings"].split())
        else:
            _numbers(at, values[output])
            unit = about.get("units", "1")
        for name, axis in row.items():
            side, y = columns[name][0], (label, unit) if axis in left else ""
            if not side.log:
                whole_numbers(axis, "x", most=2)
            x = textwrap.fill(side.label[0], _WIDE), side.label[1]
            style.tidy(axis, x=x, y=y, log="x" if side.log else "")
    style.finish(figure, legend=legend)
    figure.suptitle(_title(found, empty, every, shown), x=0.01, ha="left", fontsize=style.LETTERS)
    return figure


def _moving(
    every: Sequence[Pair], columns: Columns, values: Mapping[str, np.ndarray], coded: Sequence[str]
) -> list[Pair]:
    """Those of the pairs in which an output moves, up to `_PANELS` of them: of every output the one
    in which it moves most, and then those that move most."""
    moves = {
        (output, name): _movement(columns[name][1], values[output], output in coded)
        for output, name in every
    }
    order = sorted((pair for pair in every if moves[pair] > _LEAST), key=lambda p: -moves[p])
    first = {output: (output, name) for output, name in reversed(order)}.values()
    kept = [*(p for p in order if p in first), *(p for p in order if p not in first)][:_PANELS]
    return [pair for pair in every if pair in kept]


def _movement(at: np.ndarray, values: np.ndarray, coded: bool) -> float:
    """By how much of its range the median of an output changes over a parameter, or a share."""
    if coded:
        shares = _share_of(at, values, np.unique(values))
        return float(np.ptp(shares, axis=1).max())
    known = values[np.isfinite(values)]
    spread = float(np.subtract(*np.percentile(known, [95, 5])))
    if not spread > _ROUNDING * np.abs(known).max():
        return 0.0
    middle = _band(at, values).middle
    return float(np.ptp(middle[np.isfinite(middle)])) / spread


def _share_of(at: np.ndarray, values: np.ndarray, codes: Sequence[int] | np.ndarray) -> np.ndarray:
    """Share of every code (rows) among the members at each value of a parameter (columns)."""
    return np.asarray([[np.mean(values[at == x] == code) for x in np.unique(at)] for code in codes])


def _title(
    found: "Dataset", empty: Sequence[str], every: Sequence[Pair], shown: Sequence[Pair]
) -> str:
    """Title: what is drawn, and what is not; lines no longer than the figure."""

    def names(some: Sequence[str]) -> str:
        return ", ".join(found[name].attrs.get("long_name", name) for name in some)

    drawn = list(dict.fromkeys(output for output, _ in shown))
    never = [o for o in dict.fromkeys(output for output, _ in every) if o not in drawn]
    over = []
    for name in dict.fromkeys(name for _, name in every):
        rest = [output for output in drawn if (output, name) not in shown]
        text = "all" if len(rest) == len(drawn) else ", ".join(rest)
        over += [f"{text} over {name}"] if rest else []
    lines = ["Over all other parameters: median, and where nine in ten lie; shares of codes"]
    lines += [f"No number anywhere: {names(empty)}"] if empty else []
    lines += [f"Left out, for nothing moves: {names(never)}"] if never else []
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


def _numbers(panels: Sequence[tuple[Axes, np.ndarray]], values: np.ndarray) -> None:
    """Bands of an output on one scale, each panel over a parameter."""
    ends = []
    for axis, at in panels:
        x, low, middle, high = _band(at, values)
        style.band(axis, x, low, high, None, BLUE, 0.18)
        few = np.isfinite(middle).sum() < 6
        axis.plot(x, middle, color=BLUE, lw=1.4, marker="." if few else None)
        ends += [low, high]
    first, least = panels[0][0], np.nanmin(np.concatenate(ends))
    if least > 0 and np.nanmax(np.concatenate(ends)) > 50 * least:
        plain_log(first, "y")  # all panels of an output share one axis
    else:
        whole_numbers(first, "y", least=0.01)


def _band(at: np.ndarray, values: np.ndarray) -> _Band:
    rows = []
    for x in np.unique(at):
        part = values[(at == x) & np.isfinite(values)]
        rows.append((x, *(np.percentile(part, [5, 50, 95]) if part.size else [np.nan] * 3)))
    return _Band(*np.asarray(rows).T)


def _shares(
    panels: Sequence[tuple[Axes, np.ndarray]], values: np.ndarray, names: list[str]
) -> list[Artist]:
    """Shares of codes, each panel over a parameter; the squares of those that occur."""
    colours = code_colours(names)
    for axis, at in panels:
        shares = _share_of(at, values, range(len(names)))
        axis.stackplot(np.unique(at), shares, colors=list(colours.values()), lw=0)
    panels[0][0].set_ylim(0, 1)
    named = enumerate(colours.items())
    return [style.square(colour, name) for k, (name, colour) in named if (values == k).any()]
