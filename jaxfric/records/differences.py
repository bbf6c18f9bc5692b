"""Noise level, resolution and runs of rows from differences of neighbours; travel from sums."""

import numpy as np


def noise_from_differences(f: np.ndarray) -> float:
    """Estimate the white-noise level robustly from second differences, which cancel slow signal."""
    second = f[2:] - 2 * f[1:-1] + f[:-2]
    level = 1.4826 * np.median(np.abs(second - np.median(second))) / np.sqrt(6.0)
    return float(max(level, 1e-5 * np.ptp(f), 1e-12 * np.max(np.abs(f)), 1e-300))


def smallest_step(values: np.ndarray) -> float:
    """Return the smallest step between recorded values, beyond rounding; 0 for a constant."""
    steps = np.diff(np.unique(values))
    return float(steps[steps > 1e-9 * np.ptp(values)].min()) if len(steps) else 0.0


def runs_of(mask: np.ndarray) -> np.ndarray:
    """Return first row and end (m, 2) of every run of rows in a mask (n,)."""
    padded = np.concatenate([[0], mask.astype(int), [0]])
    return np.flatnonzero(np.diff(padded)).reshape(-1, 2)


def travelled(time: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """Integrate a velocity over time by trapezoids, from 0."""
    steps = np.diff(time) * (velocity[1:] + velocity[:-1]) / 2
    return np.concatenate([[0.0], np.cumsum(steps)])
