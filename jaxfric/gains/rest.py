"""Friction at rest, and the position error of a controller without integral action.

At rest the force k_p (x_ref - x) must exceed the static friction F_s to move the slider. At rest
the slider stops anywhere within a distance F_s/k_p of the target. A position accuracy a requires
k_p >= F_s/a.
"""

import equinox as eqx
import jax
import numpy as np

from ..rig.friction import AbstractLaw
from ..stability.analysis import steady_points
from ..stability.kernel import kernel_total
from .scenarios import Scenarios
from .thresholds import SLOWER, SPEEDS


def friction_at_rest(scenarios: Scenarios) -> float | None:
    """F_s [force], the largest over all samples of the law; None if no force is known.

    If friction has no memory, F_s is the largest steady friction at speeds up to the lowest speed
    of the scenarios. With memory, F_s is the steady friction at the lowest speed. Static friction
    can exceed this F_s, by an amount that depends on the time at rest.
    """
    if not isinstance(scenarios.law(0), AbstractLaw):
        return None  # a delay law is undefined at rest
    slowest = float(np.min(scenarios.velocity))
    total = np.asarray(jax.vmap(kernel_total)(scenarios.friction.kernel))
    speeds = slowest * (np.ones(1) if np.any(total) else np.geomspace(SLOWER, 1.0, SPEEDS))
    points = eqx.filter_vmap(lambda law: steady_points(law, speeds))(scenarios.laws)
    largest = float(np.max(np.asarray(points.force)))
    return largest if np.isfinite(largest) and largest > 0 else None
