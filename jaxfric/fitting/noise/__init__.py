"""The noise of a record: its model, its estimate, and disturbances that are not row noise.

- `parts`, `model`: white noise and a sum of parts, each correlated over its own clock (time, path
  or rows).
- `filter`, `covariance`, `likelihood`: a Kalman filter, the errors of parameters under a noise, and
  the restricted likelihoods of noises.
- `families`: which parts a noise has, and the vector of their parameters; `search` finds the parts
  of a residual.
- `by_step`: scale of the noise, and its correlation length in rows ("pace"), in every velocity
  step.
- `hum`, `glitches`, `quantisation` find spectral lines of constant frequency, outliers, and
  rounding steps of a recorder.
- `estimate`: the noise of a result, as JSON and as text.
"""

# ruff: noqa: F401

from .by_step import gain_of_pace, likeness_of_steps, own_clock, pace_of, scale_of_steps
from .covariance import rms_error, sandwich
from .estimate import CLOCKS, ROTARY_CLOCKS, NoiseEstimate, NoisePart, noise_estimate, noise_words
from .families import Family, noises_around, noises_at
from .filter import (
    Whitening,
    coloured,
    independent_rows,
    innovations,
    innovations_of,
    taken_out,
    whiten,
    whitened,
    whitening,
)
from .glitches import NO_GLITCHES, Glitches, find_glitches
from .hum import Hum, find_hum
from .likelihood import gram_of, products, restricted
from .model import Noise, Noises, noise_of
from .parts import Exponential, Limits, Resonator, limit_of_negative
from .quantisation import least_noise, recorded_steps, step_words
from .search import (
    Found,
    NoiseRows,
    estimate_noise,
    estimate_together,
    held_noise,
    limits_of,
    longest_memory,
    noise_rows,
    not_below,
    profile_noise,
    stretches,
)
from .thresholds import FAR_FROM, LONGEST, ROUNDS
