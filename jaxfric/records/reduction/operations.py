"""Operations of a reduction: functions of arrays (n,) that do not change their input.

The arithmetic is that of xlook (github.com/PennStateRockandSedimentMechanics/xlook, `array.c` and
`special.c`), so that a script gives the same numbers as in xlook. Results differ from xlook only in
the last rows of a smoothed interval, where xlook removes the wrong row.
"""

import numpy as np

from ...errors import InputError

_AT_ONCE = 1_000_000  # largest number of values in windows that are processed at once


def without_jump(values: np.ndarray, first: int, last: int, *, flat: bool) -> np.ndarray:
    """Shift all rows from `last` on so that row `last` gets the value of row `first`, to remove an
    encoder reset; with `flat` the rows between `first` and `last` get this value too.
    """
    out = values.copy()
    out[last:] -= values[last] - values[first]
    if flat:
        out[first:last] = values[first]
    return out


def elastically_corrected(
    displacement: np.ndarray, stress: np.ndarray, stiffness: float
) -> np.ndarray:
    """Subtract the elastic stretch of the frame from a displacement: x - (tau - tau_0)/k.

    `stiffness` k has the unit of stress divided by the unit of displacement.
    """
    if stiffness == 0:
        raise InputError("the stiffness is 0")
    return displacement - (stress - stress[:1]) / stiffness


def shear_strain(displacement: np.ndarray, thickness: np.ndarray) -> np.ndarray:
    """Return gamma_i = x_0/h_0 + sum of dx_j/mean(h_j, h_j-1): slip over current thickness."""
    middle = 0.5 * (thickness[1:] + thickness[:-1])
    begin = displacement[:1] / thickness[:1]
    return np.concatenate([begin, begin + np.cumsum(np.diff(displacement) / middle)])


def edge_strain(strain: np.ndarray, stress: np.ndarray, size: float) -> np.ndarray:
    """Subtract the deformation of a layer's edges from volume strain: e - (tau - tau_0) `size`."""
    return strain - (stress - stress[:1]) * size


def thinned(length: float, thickness: float, displacement: np.ndarray) -> np.ndarray:
    """Return the thickness of a layer that shear thins: dh = -h dx/(2 L), from `thickness` on."""
    shares = 1 - _thinning(displacement, length)
    return thickness * np.concatenate([np.ones(1), np.cumprod(shares)])


def with_thinning(length: float, displacement: np.ndarray, thickness: np.ndarray) -> np.ndarray:
    """Return the previous row's thickness plus the geometric thinning by shear, sum h dx/(2 L)."""
    gained = np.cumsum(_thinning(displacement, length) * thickness[:-1])
    return np.concatenate([thickness[:1], thickness[:-1] + gained])


def _thinning(displacement: np.ndarray, length: float) -> np.ndarray:
    """Return the relative thinning dx/(2 L) from row to row."""
    if length == 0:
        raise InputError("the length of the block is 0")
    return np.diff(displacement) / (2 * length)


def _half(window: int, count: int) -> int:
    """Return half of a window, rounded down; refuse a window longer than `count` rows."""
    half = window // 2
    if not 0 < 2 * half + 1 <= count:
        raise InputError(f"a window of {window} rows does not fit into {count}")
    return half


def running_slope(x: np.ndarray, y: np.ndarray, window: int) -> np.ndarray:
    """Return dy/dx by least squares over `window` rows (odd) centred at each row.

    Rows near the start get the slope of the first full window. As in xlook, rows near the end get
    the slope of the window before the last. The slope is NaN where x is constant.
    """
    half = _half(window, len(x))
    wide = 2 * half + 1
    if wide == 1:
        return np.full(len(x), np.nan)
    views = [np.lib.stride_tricks.sliding_window_view(v, wide) for v in (x, y)]
    inner, some = np.empty(len(views[0])), max(1, _AT_ONCE // wide)
    for begin in range(0, len(inner), some):
        part = slice(begin, begin + some)
        xs, ys = (v[part] - v[part].mean(axis=1, keepdims=True) for v in views)
        with np.errstate(all="ignore"):
            inner[part] = np.sum(xs * ys, axis=1) / np.sum(xs * xs, axis=1)
    last = inner[-2] if len(inner) > 1 else inner[-1]
    return np.concatenate([np.full(half, inner[0]), inner, np.full(half, last)])


def running_mean(values: np.ndarray, window: int) -> np.ndarray:
    """Return the mean over `window` rows (odd) centred at each row; the first and last values are
    repeated beyond the ends."""
    half = _half(window, len(values))
    wide = np.pad(values, half, mode="edge")
    return np.convolve(wide, np.full(2 * half + 1, 1 / (2 * half + 1)), mode="valid")


def running_median(values: np.ndarray, window: int) -> np.ndarray:
    """Return the median over `window` rows (odd); rows near the ends keep their values."""
    half = _half(window, len(values))
    out = values.copy()
    windows = np.lib.stride_tricks.sliding_window_view(values, 2 * half + 1)
    out[half : len(values) - half] = np.median(windows, axis=1)
    return out


def derivative(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return dy/dx of the parabola through each row and its neighbours; ends copy the next row."""
    if len(x) < 3:
        raise InputError("it needs three rows or more")
    before, after = np.diff(x)[:-1], np.diff(x)[1:]
    with np.errstate(all="ignore"):
        weight = np.abs(after) * before**2 + np.abs(before) * after**2
        inner = (before**2 * y[2:] - after**2 * y[:-2] - (before**2 - after**2) * y[1:-1]) / weight
    return np.concatenate([inner[:1], inner, inner[-1:]])


def rising(values: np.ndarray, *, falling: bool = False) -> np.ndarray:
    """Return a mask of the rows whose value exceeds all previously kept ones; row 0 is kept."""
    signed = -values if falling else values
    highest = np.maximum.accumulate(np.concatenate([[-np.inf], signed[:-1]]))
    kept = signed > highest
    kept[0] = True
    return kept
