"""How colours look to the colour-blind, and how far apart they are.

Simulation of Machado, Oliveira and Fernandes, IEEE Transactions on Visualization and Computer
Graphics 15 (2009) 1291, doi:10.1109/TVCG.2009.113, its matrices of full severity, on linear RGB.
Distances are those of CIE 1976 L*a*b* (D65): about 2 is just seen side by side.
"""

import itertools
from collections.abc import Sequence

import numpy as np
from matplotlib.colors import to_rgb

SIGHT = {
    "normal": np.eye(3),
    "protanopia": np.asarray(
        [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216],
         [-0.003882, -0.048116, 1.051998]]
    ),
    "deuteranopia": np.asarray(
        [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413],
         [-0.011820, 0.042940, 0.968881]]
    ),
    "tritanopia": np.asarray(
        [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602],
         [0.004733, 0.691367, 0.303900]]
    ),
}  # fmt: skip
"""What each kind of sight makes of linear RGB."""

_XYZ = np.asarray(
    [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750],
     [0.0193339, 0.1191920, 0.9503041]]
)  # fmt: skip


def lab(colour: str, sight: str = "normal") -> np.ndarray:
    """L*, a*, b* of a colour as it is seen."""
    rgb = np.asarray(to_rgb(colour))
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    seen = np.clip(SIGHT[sight] @ linear, 0.0, 1.0)
    xyz = (_XYZ @ seen) / _XYZ.sum(axis=1)
    f = np.where(xyz > (6 / 29) ** 3, np.cbrt(xyz), xyz / (3 * (6 / 29) ** 2) + 4 / 29)
    return np.asarray([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


def distances(colours: Sequence[str]) -> dict[tuple[str, str, str], float]:
    """Distance of every pair of colours in every kind of sight."""
    return {
        (sight, one, other): float(np.linalg.norm(lab(one, sight) - lab(other, sight)))
        for sight in SIGHT
        for one, other in itertools.combinations(colours, 2)
    }
