"""How well a record knows its noise, and what that means for a test of what is left.

The sizes and memories of a noise are estimated from the record that is tested. They have errors,
from the curvature of the restricted likelihood, and a test that takes them for known is too sharp:
slow noise of which a record sees thirty lengths of its memory is known to a quarter of its
variance. So k squares are compared with F of k and nu degrees of freedom, not with chi-square:
nu = 2/var(ln m), m the mean square that the noise gives them.

Sources: Satterthwaite 1946 (doi:10.2307/3002019) for degrees of freedom from a variance; Fai and
Cornelius 1996 (doi:10.1080/00949659608811740) for those of a test's denominator in a model with
several variances.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from .noise import Noise, variances, whiten_transposed
from .noise_search import Found, Record, independent_errors
from .whitened import padded_columns

_LARGEST = 2.0
"""Of the standard error of a logarithm: what is not known at all is known to about a decade."""
_WIDE = 64


class KnownNoise(NamedTuple):
    """A noise, and its independent errors."""

    noise: Noise
    errors: tuple[tuple[Noise, Noise], ...]
    """The noise one standard error away, both ways, for every error."""
    free: int
    """Rows, less the parameters taken out."""

    def denominator_degrees(self, clock, weight, tests: Sequence[np.ndarray]) -> list[float]:
        """nu for each of some tests, of whitened columns (n, k) of length 1 that are orthogonal."""
        ends = np.cumsum([columns.shape[1] for columns in tests])[:-1]
        white = np.concatenate(list(tests), axis=1)
        variance = np.full(len(tests), 2.0 / max(self.free, 1))
        parts = np.split(white, range(_WIDE, white.shape[1], _WIDE), axis=1)
        padded = [padded_columns(part, size=_WIDE) for part in parts]
        plain = [whiten_transposed(clock, weight, part, self.noise) for part in padded]
        for pair in self.errors:
            sizes = []
            for noise in pair:
                found = [np.asarray(variances(clock, part, noise)) for part in plain]
                each = np.concatenate(found)[: white.shape[1]]
                sizes.append([float(np.sum(own)) for own in np.split(each, ends)])
            variance += np.square(0.5 * np.log(np.divide(*sizes)))
        return (2 / variance).tolist()


def known_noise(record: Record, found: Found) -> KnownNoise:
    """The errors of a noise that was found in a record: see `independent_errors`."""
    taken = int(np.sum(np.linalg.norm(np.asarray(record.columns)[:, 1:], axis=0) > 0))
    pairs = independent_errors(record, found, _LARGEST)
    return KnownNoise(found.noise, tuple(pairs), record.rows - taken)
