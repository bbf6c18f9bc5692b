"""The noise of a result: its size, its correlated parts, and the limits of the search."""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from . import thresholds as const
from .glitches import NO_GLITCHES, Glitches, ToldRecord, glitch_words
from .hum import Hum
from .model import Noise
from .parts import Exponential, Resonator
from .quantisation import least_noise, step_words

CLOCKS = ("time", "path", "rows", "pace")
"""Clocks over which noise forgets: time [s], the path of the load point [m], rows of the record, or
rows in units of the memory that each velocity step shows."""
ROTARY_CLOCKS = ("time", "angle", "rows", "pace")
"""The clocks of an axis that turns: its path is an angle [rad]."""
_UNITS = {"time": "s", "path": "m", "angle": "rad", "rows": "rows", "pace": "memory of a step"}
EXPONENTIAL = -1.0
"""Value of beta of a part that is no resonator; no resonator has it."""


@dataclass(frozen=True)
class NoisePart:
    """A correlated part of a noise (see `noise`)."""

    share: float
    """Share of the variance; below 0 neighbouring rows differ by more than chance."""
    over: str
    """The clock over which this part forgets: one of `CLOCKS` or `ROTARY_CLOCKS`."""
    memory: float
    """Memory in [s], [m], [rad] or rows; for a resonator without a swing the longer of two."""
    beta: float = EXPONENTIAL
    """w^2 of a resonator (see `noise`); `EXPONENTIAL` where it is none."""

    @property
    def period(self) -> float:
        """Period of the swing, in the unit of `memory`; infinite where it does not swing."""
        return 2 * math.pi * self.memory / math.sqrt(self.beta) if self.beta > 0 else math.inf

    @property
    def swings(self) -> bool:
        """Whether a swing is seen before it is damped away."""
        return self.beta > const.SWING_SEEN**2

    def correlation(self, apart: np.ndarray) -> np.ndarray:
        """rho between rows that are `apart` (n,) on its clock."""
        one = np.ones(1)
        own = (
            Resonator(one, one, self.beta * one)
            if self.beta > EXPONENTIAL
            else Exponential(one, one)
        )
        d = np.abs(apart) / self.memory * own.longest()
        return np.real(sum(size * np.exp(-rate * d) for size, rate in own.exponentials()))

    def text(self) -> str:
        """The memory in words: "2.1 s", "3.4 µm of load-point motion", "3 rows"."""
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
    """Two digits, and no power of ten."""
    return f"{size:.2g}" if size < 100 else f"{float(f'{size:.2g}'):.0f}"


@dataclass(frozen=True)
class NoiseEstimate:
    """Noise of the residual: standard deviation (unit of friction) and its correlated parts, the
    larger first; the rest is white."""

    sigma: float
    parts: tuple[NoisePart, ...] = ()
    longest: tuple[float, ...] = ()
    """Longest memory that was searched over each of `clocks` that the record has."""
    pace: tuple[float, ...] = ()
    """Memory of each velocity step in rows, where noise forgets over that clock."""
    scale: tuple[float, ...] = ()
    """Relative noise of every velocity step where they differ; mean square 1 over train rows."""
    glitches: Glitches = NO_GLITCHES
    """Rows that stand out of the noise and are passed over."""
    steps: float = 0.0
    """Steps in which friction is recorded [unit of friction]; 0 where it is continuous."""
    clocks: tuple[str, ...] = CLOCKS
    """Names of the record's clocks: `CLOCKS` or `ROTARY_CLOCKS`."""
    hum: tuple[Hum, ...] = ()
    """Lines of one frequency in time that a loop took out of the record: no part of `sigma`."""

    @property
    def correlated_share(self) -> float:
        """Share of the variance that is correlated."""
        return sum(part.share for part in self.parts)

    @property
    def written(self) -> bool:
        """Whether the recorder's steps are most of the white part."""
        white = self.sigma**2 * (1 - self.correlated_share)
        return least_noise(self.steps) ** 2 > const.MOST_OF_WHITE * white

    def resolved(self, apart: np.ndarray) -> "NoiseEstimate":
        """The noise as rows that are `apart` (k,) from their neighbours on every clock, where they
        are close, show it: a part that is hardly alike over that is white."""
        parts = tuple(
            part
            for part in self.parts
            if abs(part.correlation(apart[self.clocks.index(part.over)])) >= const.ALIKE
        )
        return dataclasses.replace(self, parts=parts)

    @property
    def kind(self) -> str:
        """The noise in a word: "white", "correlated" or "alternating"."""
        if any(part.share < -const.WHITE for part in self.parts):
            return "alternating"
        return "correlated" if any(part.share >= const.WHITE for part in self.parts) else "white"

    def text(self) -> str:
        """The noise in words: "white", or "40 % of its variance correlated over 3 rows"."""
        if self.kind == "alternating":
            return "alternating: neighbouring rows differ by more than chance"
        if self.kind == "white":
            return "white"
        told = [self._in_rows(p) for p in self.parts if p.share >= const.WHITE]
        first, *more = [f"{100 * p.share:.0f} %" for p in told]
        words = f"{first} of its variance correlated over {told[0].text()}"
        rest = zip(more, told[1:], strict=True)
        return words + "".join(f", {share} over {part.text()}" for share, part in rest)

    def _in_rows(self, part: NoisePart) -> NoisePart:
        """A part that has the pace of each step, by the rows of the middle one."""
        if part.over != "pace" or not self.pace:
            return part
        middle = sorted(self.pace)[len(self.pace) // 2]
        return dataclasses.replace(part, memory=middle * part.memory)

    def bound(self) -> str:
        """The longest memory that was searched, in words; nothing where it is not known."""
        pairs = zip(self.clocks[:3], self.longest, strict=False)
        return " or ".join(NoisePart(1.0, over, most).text() for over, most in pairs)

    def correlation(self, apart: np.ndarray) -> np.ndarray:
        """Correlation (n,) of different rows that are `apart` (n, k) in the record's clocks."""
        total = np.zeros(len(apart))
        for part in self.parts:
            total += part.share * part.correlation(apart[:, self.clocks.index(part.over)])
        return total

    def to_json(self) -> dict:
        """The estimate as JSON values, null for what is infinite; memories in SI and in rows."""
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
            "longest": dict(zip(self.clocks[:3], self.longest, strict=False)),
            "pace": list(self.pace),
            "scale": list(self.scale),
            "glitches": self.glitches.to_json(),
            "recorded_steps": self.steps,
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
    """The estimate of a residual's noise in units of `scale`; `longest` memory searched over every
    clock, pace and scale `by_step` of velocity where they differ, `glitches` that are passed over,
    the `steps` of the recorder [unit of friction], names of the `clocks`, and the `hum` that was
    taken out."""
    parts = []
    for part in noise.parts:
        if part.share != 0:
            clock = int(np.argmax(part.rates))
            beta = float(part.beta) if isinstance(part, Resonator) else EXPONENTIAL
            memory = float(part.longest() / part.rates[clock])
            parts.append(NoisePart(float(part.share), clocks[clock], memory, beta))
    parts.sort(key=lambda part: -part.share)
    most = tuple(float(x) for x in np.ravel(longest))
    size = scale * float(noise.sigma)
    pace, scales = map(tuple, by_step)
    return NoiseEstimate(size, tuple(parts), most, pace, scales, glitches, steps, clocks, hum)


def noise_words(noise: NoiseEstimate, record: ToldRecord) -> tuple[str, ...]:
    """Sentences on a record's noise for the user: rows passed over, coarse recorder steps."""
    coarse = step_words(noise.steps, noise.sigma, record.provenance.path)
    return (*glitch_words(noise.glitches, record), *coarse)
