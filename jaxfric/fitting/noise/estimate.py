"""The noise of a result: size, correlated parts, and the limits of the noise search."""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from . import thresholds as const
from .glitches import NO_GLITCHES, Glitches, ToldRecord, glitch_words
from .hum import Hum
from .model import Noise
from .parts import AbstractPart, Exponential, Resonator
from .quantisation import least_noise, step_words

CLOCKS = ("time", "path", "rows")
"""Coordinates in which noise may be correlated: time [s], load-point path [m], row number. If steps
have a pace, rows count in units of the correlation length of their velocity step."""
ROTARY_CLOCKS = ("time", "angle", "rows")
"""The clocks of a rotary axis, whose path is an angle [rad]."""
_UNITS = {"time": "s", "path": "m", "angle": "rad", "rows": "rows", "pace": "memory of a step"}
EXPONENTIAL = -1.0
"""beta of an exponential part; a resonator never has this value."""


@dataclass(frozen=True)
class NoisePart:
    """One correlated part of a noise (see `noise`)."""

    share: float
    """Share of the variance; negative if neighbouring rows are anticorrelated."""
    over: str
    """The clock over which this part is correlated: one of `CLOCKS` or `ROTARY_CLOCKS`, or "pace":
    rows in units of the correlation length of their velocity step."""
    memory: float
    """Correlation length in [s], [m], [rad] or rows (`parts`)."""
    beta: float = EXPONENTIAL
    """w^2 of a resonator (see `noise`), or `EXPONENTIAL`."""

    @property
    def period(self) -> float:
        """Period of an oscillating part, in the unit of `memory`; else infinite."""
        if self.beta <= 0:
            return math.inf
        return 2 * math.pi * self.memory / float(self._of_rate_1.memory()[0] * self.beta**0.5)

    @property
    def swings(self) -> bool:
        """Whether an oscillation is visible before it is damped."""
        return self.beta > const.SWING_SEEN**2

    def correlation(self, apart: np.ndarray) -> np.ndarray:
        """Correlation of rows at the distances `apart` (n,) on the clock of this part."""
        own = self._of_rate_1
        d = np.abs(apart) / self.memory * own.memory()
        return np.real(sum(size * np.exp(-rate * d) for size, rate in own.exponentials()))

    @property
    def _of_rate_1(self) -> AbstractPart:
        one = np.ones(1)
        if self.beta == EXPONENTIAL:
            return Exponential(one, one)
        return Resonator(one, one, self.beta * one)

    def text(self) -> str:
        """The correlation length as text: "2.1 s", "3.4 µm of load-point motion", "3 rows"."""
        words = self._size(self.memory)
        return words + (f", swinging every {self._size(self.period)}" if self.swings else "")

    def _size(self, size: float) -> str:
        if self.over == "rows":
            return f"{_plain(size)} rows"
        if self.over == "pace":
            return f"{_plain(size)} rows of the middle velocity, each its own"
        if self.over == "angle":
            turns = f"{size / (2 * math.pi):.3g}"
            return f"{turns} turn" if turns == "1" else f"{turns} turns"
        if self.over == "path":
            micrometres = float(f"{size * 1e6:.3g}")
            length = f"{micrometres:g} µm" if micrometres < 1000 else f"{size * 1e3:.3g} mm"
            return f"{length} of load-point motion"
        return f"{size:.3g} s"


def _plain(size: float) -> str:
    """A number with two digits, without an exponent."""
    return f"{size:.2g}" if size < 100 else f"{float(f'{size:.2g}'):.0f}"


@dataclass(frozen=True)
class NoiseEstimate:
    """Noise of the residual: standard deviation of a row (unit of friction), and correlated parts.

    The part with the larger variance comes first. The rest of the variance is white noise.
    """

    sigma: float
    parts: tuple[NoisePart, ...] = ()
    longest: tuple[float, ...] = ()
    """Upper limit of the correlation length in the search, for each of the record's `clocks`."""
    pace: tuple[float, ...] = ()
    """Correlation length of each velocity step in rows, if the noise uses this clock."""
    scale: tuple[float, ...] = ()
    """Relative noise of every velocity step if they differ; mean square 1 over train rows."""
    glitches: Glitches = NO_GLITCHES
    """Outliers, excluded from the fit."""
    steps: float = 0.0
    """Quantisation step of friction [unit of friction]; 0 if friction is continuous."""
    clocks: tuple[str, ...] = CLOCKS
    """Names of the record's clocks: `CLOCKS` or `ROTARY_CLOCKS`."""
    hum: tuple[Hum, ...] = ()
    """Lines of constant frequency that were subtracted from the record; not part of `sigma`."""

    @property
    def correlated_share(self) -> float:
        """Share of the noise variance that is correlated between rows."""
        return sum(part.share for part in self.parts)

    @property
    def written(self) -> bool:
        """Whether quantisation explains most of the white part of the noise."""
        white = self.sigma**2 * (1 - self.correlated_share)
        return 2 * least_noise(self.steps) ** 2 > white

    def column(self, part: NoisePart) -> int:
        """The column of the clock of a part among the record's clocks."""
        return self.clocks.index("rows" if part.over == "pace" else part.over)

    def resolved(self, apart: np.ndarray) -> "NoiseEstimate":
        """The noise as far as the sampling resolves it. `apart` (k,) is the distance of close rows
        on every clock. A noise part with little correlation over the distance `apart` counts as
        white.
        """
        parts = tuple(
            part
            for part in self.parts
            if abs(part.correlation(apart[self.column(part)])) >= const.ALIKE
        )
        return dataclasses.replace(self, parts=parts)

    def text(self) -> str:
        """All parts of the noise: "white", or "40 % of its variance correlated over 3 rows"."""
        told = [
            f"{100 * abs(part.share):.3g} %{' of its variance' * (k == 0)}"
            f" {'anti' * (part.share < 0)}correlated over {self._in_rows(part).text()}"
            for k, part in enumerate(self.parts)
        ]
        return ", ".join(told) or "white"

    def _in_rows(self, part: NoisePart) -> NoisePart:
        """The part; a correlation length on the clock "pace" becomes rows of the median step."""
        if part.over != "pace" or not self.pace:
            return part
        middle = sorted(self.pace)[len(self.pace) // 2]
        return dataclasses.replace(part, memory=middle * part.memory)

    def bound(self) -> str:
        """The longest correlation length of the noise search, as text; empty if unknown."""
        pairs = zip(self.clocks, self.longest, strict=False)
        return " or ".join(NoisePart(1.0, over, most).text() for over, most in pairs)

    def correlation(self, apart: np.ndarray) -> np.ndarray:
        """Correlation (n,) of two rows at distances `apart` (n, k) on the record's clocks."""
        total = np.zeros(len(apart))
        for part in self.parts:
            total += part.share * part.correlation(apart[:, self.column(part)])
        return total

    def to_json(self) -> dict:
        """The noise as JSON values, null for infinite values; correlation lengths in SI or rows."""
        return {
            "correlated_share": self.correlated_share if math.isfinite(self.sigma) else None,
            "parts": [
                {
                    "share": part.share,
                    "over": part.over,
                    "memory": part.memory,
                    "unit": _UNITS[part.over],
                    "period": part.period if part.swings else None,
                }
                for part in self.parts
            ],
            "max_correlation": dict(zip(self.clocks, self.longest, strict=False)),
            "rate": list(self.pace),
            "gain": list(self.scale),
            "outliers": self.glitches.to_json(),
            "quantisation_step": self.steps,
            "hum": [line.to_json() for line in self.hum],
        }


def noise_estimate(
    noise: Noise,
    scale: float,
    longest: np.ndarray,
    *,
    by_step: tuple[Sequence[float], Sequence[float]] = ((), ()),
    glitches: Glitches = NO_GLITCHES,
    steps: float = 0.0,
    clocks: tuple[str, ...] = CLOCKS,
    hum: tuple[Hum, ...] = (),
) -> NoiseEstimate:
    """The `NoiseEstimate` of a `noise` in units of `scale`.

    `longest` is the longest correlation length of the noise search on every clock. `by_step` holds
    pace and scale of every velocity step, if steps differ. Other arguments are fields of
    `NoiseEstimate`.
    """
    parts = []
    for part in noise.parts:
        if part.share != 0:
            clock = int(np.argmax(part.rates))
            beta = float(part.beta) if isinstance(part, Resonator) else EXPONENTIAL
            memory = float(part.memory() / part.rates[clock])
            over = "pace" if clocks[clock] == "rows" and by_step[0] else clocks[clock]
            parts.append(NoisePart(float(part.share), over, memory, beta))
    parts.sort(key=lambda part: -part.share)
    most = tuple(float(x) for x in np.ravel(longest))
    size = scale * float(noise.sigma)
    pace, scales = map(tuple, by_step)
    return NoiseEstimate(size, tuple(parts), most, pace, scales, glitches, steps, clocks, hum)


def noise_words(noise: NoiseEstimate, record: ToldRecord) -> tuple[str, ...]:
    """Warnings about a record's noise: excluded outliers, coarse quantisation."""
    coarse = step_words(noise.steps, noise.sigma, record.provenance.path)
    return (*glitch_words(noise.glitches, record), *coarse)
