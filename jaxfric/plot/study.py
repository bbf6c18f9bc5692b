"""Figures of a study: maps over two parameters, and curves over one.

From the Dataset of a store alone: names, units, codes and their texts are in its attributes.
Outputs with further dimensions (motions in time) are not drawn.
"""

import itertools
import textwrap
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap, LogNorm, Normalize, TwoSlopeNorm
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter

from .stability import BLUE, STABLE, new_figure, plain_log, prefixed, save, tidy

_COLOURS = {
    "steady": STABLE,
    "stable": STABLE,
    "computed": STABLE,
    "limit_cycle": "#e3a27f",
    "unstable": "#e3a27f",
    "escape": "#8a3b12",
    "failed": "0.8",
    "error": "#8a3b12",
}
_MORE = ("#7a9cc6", "#8a5a9e", "#2a9d8f", "0.6", "#c9b458", "0.85")
_PANELS, _BINS, _MOST = 4, 16, 400_000
_SIGNED = ("decay", "damping", "modulus", "phase", "delay")


class _Side(NamedTuple):
    """A parameter as an axis of a figure: its values there, in a unit with a prefix."""

    name: str
    values: np.ndarray
    label: str
    log: bool


def draw_study(found: Any, folder: Path) -> list[str]:
    """Write a map of every output over the two longest dimensions, and all marginal curves.

    `found` is the Dataset of a store (`study.load`). Further dimensions are shown in up to four
    panels, or at the middle of what is left. Returns the names written.
    """
    coded = [n for n in found.data_vars if "flag_values" in found[n].attrs]
    dims = _dimensions(found)
    outputs = [n for n in found.data_vars if n != "done" and tuple(found[n].dims) == dims]
    outputs = [n for n in outputs if n != "outcome"] + ["outcome"]
    names = []
    for name in outputs:
        if name == "outcome" and not np.any(_part(found[name])):
            continue  # all were computed
        figure = _map(found, name, dims, name in coded)
        if figure is not None:
            names += save(figure, folder, f"map_{name}")
    shown = sorted((n for n in outputs if n != "outcome"), key=lambda n: n not in coded)
    return names + save(_marginals(found, shown, coded), folder, "marginals")


def _dimensions(found: Any) -> tuple[str, ...]:
    return tuple(found["outcome"].dims)


def _side(found: Any, name: str) -> _Side:
    about = found[name]
    values = np.asarray(about.values, float)
    unit = about.attrs.get("units", "1")
    size, text = (1.0, "") if unit == "1" else prefixed(float(np.abs(values).max()), unit)
    label = about.attrs.get("long_name", name)
    label = f"{label} {name}" if label != name else name
    label += f" [{text.replace('*', ' ')}]" if text else ""
    return _Side(name, size * values, label, about.attrs.get("spacing") == "log")


def _shown_at(found: Any, name: str, index: int) -> str:
    value, unit = float(found[name].values[index]), found[name].attrs.get("units", "1")
    if unit == "1":
        return f"{name} = {value:.3g}"
    size, text = prefixed(abs(value), unit)
    return f"{name} = {size * value:.3g} {text.replace('*', ' ')}"


def _map(found: Any, name: str, dims: tuple[str, ...], coded: bool) -> Figure | None:
    """Maps over the two longest dimensions of a grid, in panels over the next one."""
    grid = [d for d in dims if d != "sample" and found.sizes[d] > 1]
    if len(grid) < 2 or "sample" in dims:
        return None
    longest = sorted(grid, key=lambda d: -found.sizes[d])
    x, y = sorted(longest[:2], key=dims.index)
    rest = longest[2:]
    picked = {d: found.sizes[d] // 2 for d in dims if d not in (x, y)}
    panels: list[dict[str, int]] = [picked]
    if rest:
        some = np.linspace(0, found.sizes[rest[0]] - 1, min(_PANELS, found.sizes[rest[0]]))
        panels = [picked | {rest[0]: int(i + 0.5)} for i in some]
    values = [_part(found[name].isel(panel).transpose(y, x)) for panel in panels]
    columns = min(len(panels), 2)
    rows = -(-len(panels) // columns)
    width = 4.0 * columns + 1.9
    figure = new_figure(width, 3.2 * rows + 0.6)
    axes = np.ravel(np.asarray(figure.subplots(rows, columns, sharex=True, sharey=True)))
    sides = _side(found, x), _side(found, y)
    for axis, panel in zip(axes, panels, strict=False):
        held = [_shown_at(found, d, i) for d, i in panel.items() if found.sizes[d] > 1]
        _panel(axis, sides, ", ".join(held))
    for axis in axes[len(panels) :]:
        axis.set_visible(False)
    used = axes[: len(panels)]
    about = found[name].attrs
    if coded:
        _codes(figure, used, sides, values, about)
    else:
        _numbers(figure, used, sides, values, name, about)
    fixed = [_shown_at(found, d, 0) for d in dims if found.sizes[d] == 1]
    title = about.get("long_name", name) + (f"; {', '.join(fixed)}" if fixed else "")
    figure.suptitle(_capital(title), x=0.01, ha="left", fontsize=11.5)
    figure.supxlabel(sides[0].label, fontsize=10)
    figure.supylabel(sides[1].label, fontsize=10)
    return figure


def _panel(axis: Axes, sides: tuple[_Side, _Side], title: str) -> None:
    tidy(axis, title)
    axis.grid(False)
    for which, side in zip("xy", sides, strict=True):
        edges = _edges(side)
        axis.set(**{f"{which}lim": (edges[0], edges[-1])})
        if side.log:
            plain_log(axis, which)
            if edges[-1] < 200 * edges[0]:
                shown = FuncFormatter(lambda x, _: f"{x:g}" if f"{x:e}"[0] in "25" else "")
                getattr(axis, f"{which}axis").set_minor_formatter(shown)


def _edges(side: _Side) -> np.ndarray:
    """Borders between cells around the values."""
    x = np.log(side.values) if side.log else side.values
    between = 0.5 * (x[1:] + x[:-1])
    first, last = x[0] - (between[0] - x[0]), x[-1] + (x[-1] - between[-1])
    edges = np.concatenate([[first], between, [last]])
    return np.exp(edges) if side.log else edges


def _mesh(axis: Axes, sides: tuple[_Side, _Side], values, cmap, norm):
    x, y = (_edges(side) for side in sides)
    return axis.pcolormesh(x, y, values, cmap=cmap, norm=norm, rasterized=True)


def _codes(figure: Figure, axes, sides, values, about) -> None:
    names = about["flag_meanings"].split()
    colours = [_colour(i, name) for i, name in enumerate(names)]
    norm = BoundaryNorm(np.arange(-1.5, len(names)), len(names) + 1)
    cmap = ListedColormap(["white", *colours])
    for axis, part in zip(axes, values, strict=True):
        _mesh(axis, sides, part, cmap, norm)
    present = np.unique(np.concatenate([part.ravel() for part in values]))
    handles = [
        Patch(facecolor=colours[int(code)], label=names[int(code)].replace("_", " "))
        for code in present
        if 0 <= code < len(names)
    ]
    if -1 in present:
        handles.append(Patch(facecolor="white", edgecolor="0.6", label="not computed yet"))
    figure.legend(handles=handles, loc="outside right upper", frameon=False, fontsize=9)


def _colour(index: int, name: str) -> str:
    return _COLOURS.get(name, _MORE[index % len(_MORE)])


def _numbers(figure: Figure, axes, sides, values, name: str, about) -> None:
    every = np.concatenate([part.ravel() for part in values])
    finite = every[np.isfinite(every)]
    unit = about.get("units", "1")
    if finite.size == 0:
        for axis in axes:
            axis.text(0.5, 0.5, "no number here", transform=axis.transAxes, ha="center")
        return
    low, high = np.percentile(finite, [1, 99])
    size, text = (1.0, "") if unit == "1" else prefixed(float(max(abs(low), abs(high))), unit)
    low, high = size * low, size * high
    norm, cmap = _scale(low, high, name, size * finite)
    for axis, part in zip(axes, values, strict=True):
        shown = np.where(np.isfinite(part), size * part, np.nan)
        mesh = _mesh(axis, sides, shown, cmap, norm)
        axis.set_facecolor("0.87")
    bar = figure.colorbar(mesh, ax=list(axes), extend="both", shrink=0.9, pad=0.02)
    label = _symbol(name) + (f" [{text.replace('*', ' ')}]" if text else "")
    if not np.all(np.isfinite(every)):
        kinds = [("infinite", np.isinf(every)), ("no number", np.isnan(every))]
        label += "; grey: " + " or ".join(kind for kind, mask in kinds if mask.any())
    bar.set_label(label, fontsize=9.5)


def _scale(low: float, high: float, name: str, finite: np.ndarray):
    """Two colours about the limit of stability of a signed margin; else log or plain."""
    middle = 1.0 if name in ("stiffness", "gain") else 0.0
    if name in _SIGNED and low < middle < high:
        reach = max(high - middle, middle - low)
        return TwoSlopeNorm(middle, middle - reach, middle + reach), "RdBu"
    positive = finite[finite > 0]
    if positive.size == finite.size and high > 30 * low:
        if name in ("stiffness", "gain") and low < 1 < high:
            reach = max(np.log(high), -np.log(low))
            return LogNorm(np.exp(-reach), np.exp(reach)), "RdBu"
        return LogNorm(low, high), "viridis"
    return Normalize(low, high if high > low else low + 1e-12), "viridis"


def _symbol(name: str) -> str:
    return name.replace("_", " ") if len(name) > 4 else name


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def _marginals(found: Any, outputs: list[str], coded: list[str]) -> Figure:
    """Every output over every parameter: the median and the range of nine in ten, or shares."""
    members, columns = _thinned(found)
    parameters = list(columns)
    figure = new_figure(2.9 * len(parameters) + 1.6, 2.1 * len(outputs) + 0.8)
    axes = figure.subplots(len(outputs), len(parameters), sharex="col", squeeze=False)
    for row, name in enumerate(outputs):
        values = _part(found[name].isel(members)).ravel()
        for column, parameter in enumerate(parameters):
            side, at = columns[parameter]
            axis = axes[row, column]
            if name in coded:
                names = found[name].attrs["flag_meanings"].split()
                _shares(axis, side, at, values, names, legend=column == len(parameters) - 1)
            else:
                _band(axis, side, at, values, name, found[name].attrs.get("units", "1"))
            axis.spines[["top", "right"]].set_visible(False)
            if side.log:
                plain_log(axis, "x")
            if row == len(outputs) - 1:
                axis.set_xlabel(side.label.replace(" [", "\n["), fontsize=8.5)
            if column == 0:
                axis.set_ylabel(_y_label(found, name, coded, values), fontsize=8.5)
            else:
                axis.tick_params(labelleft=False)
                axis.sharey(axes[row, 0])
            axis.tick_params(labelsize=8)
    figure.suptitle(
        "Over all other parameters: median, and where nine in ten lie; shares of codes",
        x=0.01,
        ha="left",
        fontsize=10.5,
    )
    return figure


def _y_label(found: Any, name: str, coded: list[str], values: np.ndarray) -> str:
    title = "\n".join(textwrap.wrap(found[name].attrs.get("long_name", name), 20)[:2])
    if name in coded:
        return f"{title}\n[share]"
    text = _prefix(values, found[name].attrs.get("units", "1"))[1].replace("*", " ")
    return f"{title}\n[{text}]" if text else title


def _prefix(values: np.ndarray, unit: str) -> tuple[float, str]:
    finite = np.abs(values[np.isfinite(values)])
    if unit == "1" or finite.size == 0:
        return 1.0, ""
    return prefixed(float(np.percentile(finite, 95)), unit)


def _thinned(found: Any) -> tuple[dict[str, slice], dict[str, tuple[_Side, np.ndarray]]]:
    """Members to read, no more than some hundred thousand, and what each parameter is for them."""
    dims = _dimensions(found)
    steps = dict.fromkeys(dims, 1)
    sizes = {d: found.sizes[d] for d in dims}
    while np.prod([-(-sizes[d] // steps[d]) for d in dims], dtype=float) > _MOST:
        widest = max(dims, key=lambda d: sizes[d] / steps[d])
        steps[widest] += 1
    members = {d: slice(None, None, steps[d]) for d in dims}
    shape = tuple(-(-sizes[d] // steps[d]) for d in dims)
    columns = {}
    for name in itertools.chain(found.coords):
        about = found[name]
        if about.dims[0] not in dims or about.ndim != 1:
            continue
        side = _side(found, name)
        part = side.values[members[about.dims[0]]]
        if np.ptp(part) == 0:
            continue
        if name != about.dims[0]:  # a sampled column: in bins
            side, part = _binned(side, part)
        place = [-1 if d == about.dims[0] else 1 for d in dims]
        columns[name] = side, np.broadcast_to(part.reshape(place), shape).ravel()
    return members, columns


def _binned(side: _Side, values: np.ndarray) -> tuple[_Side, np.ndarray]:
    edges = np.unique(np.quantile(values, np.linspace(0, 1, _BINS + 1)))
    place = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)
    middle = 0.5 * (edges[1:] + edges[:-1])
    log = bool(values.min() > 0 and values.max() > 20 * values.min())
    return _Side(side.name, middle, side.label, log), middle[place]


def _band(axis: Axes, side: _Side, at, values, name: str, unit: str) -> None:
    size, _ = _prefix(values, unit)
    rows = []
    for x in np.unique(at):
        part = values[(at == x) & np.isfinite(values)]
        rows.append((x, *(np.percentile(part, [5, 50, 95]) if part.size else [np.nan] * 3)))
    x, low, middle, high = np.asarray(rows).T
    axis.fill_between(x, size * low, size * high, color=BLUE, alpha=0.18, lw=0)
    axis.plot(x, size * middle, color=BLUE, lw=1.4, marker="." if len(x) < 6 else None)
    positive = low[np.isfinite(low)]
    if positive.size and positive.min() > 0 and np.nanmax(high) > 50 * positive.min():
        axis.set_yscale("log")
    axis.grid(True, color="0.93")


def _shares(axis: Axes, side: _Side, at, values, names: list[str], *, legend: bool) -> None:
    x = np.unique(at)
    shares = np.asarray([[np.mean(values[at == v] == i) for v in x] for i in range(len(names))])
    colours = [_colour(i, name) for i, name in enumerate(names)]
    axis.stackplot(x, shares, colors=colours, lw=0)
    axis.set_ylim(0, 1)
    if legend:
        handles = [
            Patch(facecolor=colours[i], label=name.replace("_", " "))
            for i, name in enumerate(names)
            if shares[i].any()
        ]
        axis.legend(
            handles=handles,
            loc="center left",
            bbox_to_anchor=(1.01, 0.5),
            frameon=False,
            fontsize=8,
        )


def _part(values: Any) -> np.ndarray:
    return np.asarray(values.values)
