"""Noise cut from measured records of rock, for blind records: `python -m fits.blind.measured`.

What is cut. `SOURCES` states the stretches of steady sliding, as rows of the files: no velocity
step within, away from the transient after one, at one sampling rate each. From the friction of a
stretch a local quadratic over 301 rows is taken (a Savitzky-Golay filter; at the ends, the
quadratic of the last 301 rows). What is left is the stretch's noise.

Ripple. Sepiolite's friction ripples along its slip (88.8 um): structure, not noise. At 0.2 um/s one
wave is 3300 rows, and the quadratic takes it out. At 2 um/s it is 330 rows, its second harmonic
160, and both pass. So a_k(x) sin(2 pi k x/lambda) + b_k(x) cos(2 pi k x/lambda), k = 1, 2, 3, are
fitted to what the quadratic leaves of each stretch, with their own local quadratic taken from
them too, and subtracted; a_k and b_k are polynomials of the slip x of degree 6, since the ripple
wanders. `line` shows that no line is left at that wavelength or its harmonics.

How it is put on a record. All noise of a record is of one source. Each of its velocities, that is
every velocity step and the beginning, gets another piece of it, drawn from the whole source
(pieces of the shorter sources overlap), with a random sign. Over its first `JOINT` rows it comes
up as what follows the piece before in the source dies away, their squared shares 1 together: a
recorder's noise does not jump when the command steps. Rows of the piece become rows of the
record, whatever time is between them: a press's recorder changes its sampling rate with the
velocity (p655: 10 Hz, 100 Hz, 1 kHz), and so does the generator's. Noise that keeps its time and
not its rows is the study `time`.
One factor brings the noise of the whole record to a standard deviation of 1, so that what
differs between pieces of a source (noise of a fast stretch is larger) still differs.

Imports nothing of jaxfric, and reads the files with readers of its own.
"""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.polynomial.legendre import legvander
from scipy.signal import savgol_filter

WINDOW, DEGREE = 301, 6
JOINT = 60
LAGS = (1, 2, 3, 5, 10, 30)


@dataclass(frozen=True)
class Source:
    """A file of measured friction, its steady stretches (rows from, to) and its ripple [um]."""

    file: str
    stretches: tuple[tuple[int, int], ...]
    ripple: float | None = None


SOURCES = {
    # 2.29 um/s at 10 Hz; 22.9 um/s at 100 Hz, from 90 um after the step
    "p655-step1": Source("p655_step1_allrows.csv", ((0, 700), (1240, 2242))),
    # under 75 MPa: 2.29 um/s at 10 and at 100 Hz, 22.9 um/s at 100 Hz and 1 kHz, 229 um/s at 1 kHz
    # from 90 um after the step. Left out: short events at rows 21192, 23400 and 27200, and what
    # p655_step1_allrows.csv has of the same run
    "p655-run": Source(
        "p655intact100l",
        (
            (12900, 14400),
            (15500, 17600),
            (22300, 23300),
            (23600, 27000),
            (28700, 29900),
            (30500, 33400),
            (34000, 38400),
        ),
    ),
    # 0.2 and 2 um/s at 7 Hz
    "sepiolite-1": Source(
        "velstep1_TR2_exp013_sepiolite.txt", ((0, 16300), (17500, 23790)), ripple=88.8
    ),
    "sepiolite-3": Source(
        "velstep3_TR2_exp013_sepiolite.txt", ((0, 9000), (9500, 16466)), ripple=88.8
    ),
    # 3 um/s at 10 Hz, 10 um/s at 100 Hz
    "basalt": Source("velstep4_BRAVA_expb819_basalt.txt", ((0, 690), (1300, 5849))),
}


def folder() -> Path:
    """Where the measured records lie. Raises FileNotFoundError with what to do."""
    named = os.environ.get("JAXFRIC_DATA")
    beside = Path(__file__).resolve().parents[2].parent / "shared" / "data"
    rock = (Path(named) if named else beside) / "rock"
    lost = [source.file for source in SOURCES.values() if not (rock / source.file).is_file()]
    if lost:
        raise FileNotFoundError(
            f"measured noise needs {', '.join(lost)} in {rock}; set JAXFRIC_DATA to the folder that"
            " holds rock/ (data/public.toml says where these records come from)"
        )
    return rock


def read(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Load-point displacement [um] and friction [1] of a file, row by row."""
    if path.suffix in (".csv", ".txt"):
        rows = path.read_text(encoding="utf-8").splitlines()
        table = np.loadtxt((row.replace(",", " ") for row in rows[1:]), usecols=(1, 2))
        return table[:, 0], table[:, 1]
    return _p655(path.read_bytes())


def _p655(data: bytes) -> tuple[np.ndarray, np.ndarray]:
    """The raw run p655, big-endian single precision after 36 + 32 x 84 bytes of header.

    Columns: sampling period, vertical displacement and load, horizontal displacement and load, in
    counts. Calibrations and zeroes are those of the run's reduction log. Shear over normal stress.
    """
    count, columns = np.frombuffer(data, ">i4", 2, offset=20)
    table = np.frombuffer(data, ">f4", count * columns, offset=36 + 32 * 84)
    _, moved, shear, _, normal = table.reshape(columns, count).astype(float)
    shear = 1.597778959e-3 * (shear - shear[1459])  # MPa, before the blocks slide
    normal = 3.31712805707e-3 * (normal - normal[64])  # MPa, before the load
    return 0.076472 * (moved - moved[1459]), shear / np.where(normal > 1.0, normal, np.nan)


@lru_cache
def stretches(name: str, *, ripple: bool = False) -> tuple[tuple[np.ndarray, np.ndarray], ...]:
    """Slip [um, from the first row] and noise of every steady stretch; `ripple` leaves it in."""
    source = SOURCES[name]
    displacement, friction = read(folder() / source.file)
    out = []
    for start, end in source.stretches:
        rows = np.arange(end - start)
        slip = np.polyval(np.polyfit(rows, displacement[start:end], 2), rows)
        slip, noise = slip - slip[0], left(friction[start:end])
        if source.ripple is not None and not ripple:
            noise = without_ripple(slip, noise, source.ripple)
        out.append((slip, noise))
    return tuple(out)


def left(rows: np.ndarray) -> np.ndarray:
    """What a local quadratic leaves of the rows (first axis)."""
    return rows - savgol_filter(rows, WINDOW, 2, axis=0)


def without_ripple(slip: np.ndarray, noise: np.ndarray, wavelength: float) -> np.ndarray:
    """Noise without three harmonics of a wavelength, whose amplitudes are polynomials of slip."""
    amplitudes = legvander(2 * slip / slip[-1] - 1, DEGREE)
    angle = 2 * np.pi * np.outer(slip / wavelength, (1, 2, 3))
    waves = np.concatenate([np.sin(angle), np.cos(angle)], axis=1)
    basis = left((waves[:, :, None] * amplitudes[:, None]).reshape(len(slip), -1))
    # at a slow velocity the quadratic leaves almost nothing of the waves: nothing to be taken out
    if basis.std() < 0.1:
        return noise
    return noise - basis @ np.linalg.lstsq(basis, noise, rcond=None)[0]


def line(slip: np.ndarray, noise: np.ndarray, wavelength: float) -> float:
    """Amplitude of a sine of that wavelength along slip, over the noise's standard deviation."""
    return float(2 * abs(np.mean(noise * np.exp(-2j * np.pi * slip / wavelength))) / noise.std())


def autocorrelation(noises: list[np.ndarray]) -> np.ndarray:
    """At `LAGS`, all rows of all stretches together (each with its scale)."""
    power = sum(float(r @ r) for r in noises)
    return np.array([sum(float(r[k:] @ r[:-k]) for r in noises) / power for k in LAGS])


def cut(
    name: str, counts: list[int], rng: np.random.Generator, gaps: Sequence[int] = ()
) -> np.ndarray:
    """Noise of a record whose velocities have `counts` rows: pieces of `name`, rms 1 in all.

    Before the velocities `gaps` the record has other rows: nothing goes on over them.
    """
    noises, longest = [noise for _, noise in stretches(name)], max(counts)
    begins = np.concatenate([[0], np.cumsum([max(len(r) - longest, 0) for r in noises])])
    # evenly through the source from a random start, so that pieces overlap no more than they must
    places = (rng.random() + np.arange(len(counts)) / len(counts)) % 1.0 * begins[-1]
    pieces, follows = [], np.zeros(0)
    drawn = zip(counts, rng.permutation(places), strict=True)
    for number, (count, place) in enumerate(drawn):
        k = int(np.searchsorted(begins, place, side="right")) - 1
        first = int(place - begins[k])
        source = rng.choice((-1.0, 1.0)) * noises[k][first:]
        pieces.append(joined(follows[:0] if number in gaps else follows, source[:count]))
        follows = source[count : count + JOINT]
    noise = np.concatenate(pieces)
    return noise / np.sqrt(np.mean(noise**2))


def joined(before: np.ndarray, piece: np.ndarray) -> np.ndarray:
    """The piece, over whose first rows `before` dies away; without it, the piece as it is."""
    rows = min(len(before), len(piece))
    share = (np.arange(rows) + 0.5) / max(rows, 1)
    out = piece.copy()
    out[:rows] = np.sqrt(1 - share) * before[:rows] + np.sqrt(share) * piece[:rows]
    return out


def main() -> None:
    """Noise of every source: rows, standard deviations, autocorrelation, kurtosis, ripple."""
    print("source, rows, standard deviation [1e-4] of each stretch; autocorrelation at rows", LAGS)
    for name, source in SOURCES.items():
        for ripple in (True, False) if source.ripple else (False,):
            parts = stretches(name, ripple=ripple)
            noises = [noise for _, noise in parts]
            deviations = " ".join(f"{1e4 * r.std():.2f}" for r in noises)
            shape = " ".join(f"{c:5.2f}" for c in autocorrelation(noises))
            kurtosis = np.mean([np.mean(r**4) / np.mean(r**2) ** 2 for r in noises])
            text = f"{name:12} {sum(map(len, noises)):6}  {deviations:36}  {shape}"
            text += f"  kurtosis {kurtosis:.1f}"
            if source.ripple is not None:
                peak = max(line(x, r, source.ripple / k) for x, r in parts for k in (1, 2, 3))
                text += f", line {peak:.2f}" + (" (with its ripple)" if ripple else "")
            print(text)


if __name__ == "__main__":
    main()
