"""Estimate the noise level of a column from differences of neighbouring rows."""

import numpy as np


def noise_from_differences(f: np.ndarray) -> float:
    """Estimate the white-noise level robustly from second differences, which cancel slow signal."""
    second = f[2:] - 2 * f[1:-1] + f[:-2]
    level = 1.4826 * np.median(np.abs(second - np.median(second))) / np.sqrt(6.0)
    return float(max(level, 1e-5 * np.ptp(f), 1e-12 * np.max(np.abs(f)), 1e-300))
