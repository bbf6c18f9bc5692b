"""Curves of a study: every output over every parameter, whatever the others are."""

import textwrap
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from .palette import BLUE
from .side import Side, code_colour, side_of
from .stability import new_figure, prefixed
from .ticks import plain_log

if TYPE_CHECKING:
    from xarray import Dataset

_BINS, _MOST = 16, 400_000
_WIDE, _LETTERS = 22, 11
_MANY, _LEAST = 12, 0.05
"""Panels of which all are drawn; of more those that move: the median changes over the parameter by
so much of the range of its row, or a share of a code by so much."""


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

    Outputs `coded` are codes, whose shares are drawn. All panels of a row share one scale. An
    output that has no number anywhere has no row; the title names it. Of more than `_MANY` panels
    those that do not move are left out, and outputs and parameters of which none moves are named.
    None where no parameter varies, or nothing has a number.
    """
    members, columns = _thinned(found)
    values = {name: np.asarray(found[name].isel(members).values).ravel() for name in outputs}
    empty = [n for n in outputs if n not in coded and not np.isfinite(values[n]).any()]
    shown = {n: columns for n in outputs if n not in empty}
    if not (shown and columns):
        return None
    moving = {n: _moving(columns, values[n], n in coded) for n in shown}
    moving = {n: some for n, some in moving.items() if some}
    cut = len(shown) * len(columns) > _MANY and bool(moving)
    still = []
    if cut:
        seen = {name for some in moving.values() for name in some}
        still = [n for n in shown if n not in moving] + [n for n in columns if n not in seen]
        shown = moving
    across = max(map(len, shown.values()))
    height = (2.6 if cut else 2.1) * len(shown) + 0.8
    figure = new_figure(2.9 * across + 1.6, height)
    shared = False if cut else "col"
    axes = figure.subplots(len(shown), across, sharex=shared, sharey="row", squeeze=False)
    for k, (row, name) in enumerate(zip(axes, shown, strict=True)):
        some = list(row[: len(shown[name])])
        _row(some, shown[name], values[name], found[name].attrs, name)
        if cut or k == len(shown) - 1:
            _below(some, shown[name])
        for axis in row[len(some) :]:
            axis.set_axis_off()
    title = _title(found, empty, still, round(_LETTERS * figure.get_figwidth()))
    figure.suptitle(title, x=0.01, ha="left", fontsize=10.5)
    return figure


def _moving(columns: Columns, values: np.ndarray, coded: bool) -> Columns:
    """The parameters over which an output moves."""
    found, spread = {}, np.inf
    if not coded:
        known = values[np.isfinite(values)]
        spread = float(np.subtract(*np.percentile(known, [95, 5])))
    for name, (side, at) in columns.items():
        if coded:
            places = np.unique(at)
            shares = [[np.mean(values[at == x] == c) for x in places] for c in np.unique(values)]
            moves = np.ptp(np.asarray(shares), axis=1).max() > _LEAST
        else:
            middle = _band(at, values).middle
            some = np.isfinite(middle)
            moves = bool(np.any(some != some[0])) or np.ptp(middle[some]) > _LEAST * spread
        if moves:
            found[name] = side, at
    return found


def _row(
    row: Sequence[Axes], columns: Columns, values: np.ndarray, about: Mapping[str, str], name: str
) -> None:
    """The panels of an output, one over each parameter."""
    label = "\n".join(textwrap.wrap(about.get("long_name", name), _WIDE))
    if "flag_meanings" in about:
        unit = "share"
        _codes(row, columns, values, about["flag_meanings"].split())
    else:
        unit = _numbers(row, columns, values, about.get("units", "1"))
    row[0].set_ylabel(f"{label}\n[{unit}]" if unit else label, fontsize=8.5)
    for axis in row:
        axis.spines[["top", "right"]].set_visible(False)
        axis.tick_params(which="both", labelsize=8)


def _below(row: Sequence[Axes], columns: Columns) -> None:
    """Name the parameters under their panels."""
    for axis, (side, _) in zip(row, columns.values(), strict=True):
        axis.set_xlabel(side.label.replace(" [", "\n["), fontsize=8.5)
        if side.log:
            plain_log(axis, "x")


def _title(found: "Dataset", empty: Sequence[str], still: Sequence[str], width: int) -> str:
    """Title: what is drawn, and what is not; lines of no more than `width` letters."""
    lines = ["Over all other parameters: median, and where nine in ten lie; shares of codes"]
    names = ", ".join(found[name].attrs.get("long_name", name) for name in empty)
    lines += [f"No number anywhere: {names}"] if names else []
    names = ", ".join(found[name].attrs.get("long_name", name) for name in still)
    lines += [f"Left out, for nothing moves there: {names}"] if names else []
    return "\n".join(textwrap.fill(line, width) for line in lines)


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
    edges = np.unique(np.quantile(values, np.linspace(0, 1, _BINS + 1)))
    place = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)
    middle = 0.5 * (edges[1:] + edges[:-1])
    log = bool(values.min() > 0 and values.max() > 20 * values.min())
    return Side(side.name, middle, side.label, log), middle[place]


def _numbers(row: Sequence[Axes], columns: Columns, values: np.ndarray, unit: str) -> str:
    """A row of bands on one scale; the unit in which they are drawn."""
    finite = np.abs(values[np.isfinite(values)])
    size, text = (1.0, "")
    if unit != "1":
        size, text = prefixed(float(np.percentile(finite, 95)), unit)
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
        plain_log(row[0], "y")  # all panels of the row share it
    return text.replace("*", " ")


def _band(at: np.ndarray, values: np.ndarray) -> _Band:
    rows = []
    for x in np.unique(at):
        part = values[(at == x) & np.isfinite(values)]
        rows.append((x, *(np.percentile(part, [5, 50, 95]) if part.size else [np.nan] * 3)))
    return _Band(*np.asarray(rows).T)


def _codes(row: Sequence[Axes], columns: Columns, values: np.ndarray, names: list[str]) -> None:
    """A row of shares of codes, explained at its right."""
    colours = [code_colour(i, name) for i, name in enumerate(names)]
    for axis, (_, at) in zip(row, columns.values(), strict=True):
        x = np.unique(at)
        shares = [[np.mean(values[at == v] == i) for v in x] for i in range(len(names))]
        axis.stackplot(x, np.asarray(shares), colors=colours, lw=0)
    row[0].set_ylim(0, 1)
    handles = [
        Patch(facecolor=colours[i], label=name.replace("_", " "))
        for i, name in enumerate(names)
        if (values == i).any()
    ]
    row[-1].legend(
        handles=handles, loc="center left", bbox_to_anchor=(1.01, 0.5), frameon=False, fontsize=8
    )
