"""What neighbouring rows differ by: how large the noise of a column is."""

import numpy as np


def noise_from_differences(f: np.ndarray) -> float:
    """White-noise level from second differences: robust, and blind to slow signal."""
    second = f[2:] - 2 * f[1:-1] + f[:-2]
    level = 1.4826 * np.median(np.abs(second - np.median(second))) / np.sqrt(6.0)
    return float(max(level, 1e-5 * np.ptp(f), 1e-12 * np.max(np.abs(f)), 1e-300))
