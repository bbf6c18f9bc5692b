"""Poles of sliders with mass and one state, and rightmost roots of the delay law: others beside
ours.

The same sliders for all, about half of them stable; each peer as its manual has it, in a loop over
sliders where it takes one at a time. Errors are the largest of the rightmost root over its
magnitude, against 30 digits (mpmath).
"""

import time
from types import ModuleType

import jax
import jax.numpy as jnp
import numpy as np
from delay import sliders
from peers_table import Table, timed

from jaxfric.stability.delay_roots import rightmost_roots
from jaxfric.stability.kernel import StateSpaceKernel
from jaxfric.stability.linear import LinearFriction, LinearSlider
from jaxfric.stability.margins import poles

LOW = np.log([1e-1, 1e-1, 1e-5, 1e-5, 0.1, 1e-2, 1.0])
HIGH = np.log([10.0, 10.0, 1e-2, 1e-2, 10.0, 10.0, 1e5])
COMPARED = 200


def rightmost(found) -> complex:
    """The root of the largest real part, that above the real axis of a pair."""
    found = np.asarray(found)
    root = complex(found[np.argmax(found.real)])
    return complex(root.real, abs(root.imag))


def wrong(found, truth) -> float:
    return float(max(abs(a - b) / abs(b) for a, b in zip(found, truth, strict=True)))


def roots() -> None:
    try:
        import mpmath
    except ImportError:
        print("mpmath is not installed: no reference for roots")
        return
    _poles(mpmath)
    _delay(mpmath)


def _poles(mpmath: ModuleType) -> None:
    rows = np.exp(np.random.default_rng(0).uniform(LOW, HIGH, (1 << 14, 7)))

    def ours(p):
        A, B, L, V, m, k_v, k_p = p
        kernel = StateSpaceKernel(jnp.reshape(-V / L, (1, 1)), jnp.ones(1), jnp.stack([B / L]))
        return poles(LinearSlider(m, k_p, k_v, LinearFriction(A / V, kernel, jnp.zeros_like(A))))

    run = jax.jit(jax.vmap(ours))
    every = np.asarray(run(rows))
    few = rows[:COMPARED]
    # (m s^2 + k_v s + k_p)(L s + V) + s (A/V)(L s + V) - s B: friction A/V - (B/V)/(1 + L s/V)
    polynomials = [
        [m * L, m * V + (k_v + A / V) * L, k_p * L + (k_v + A / V) * V - B, k_p * V]
        for A, B, L, V, m, k_v, k_p in few
    ]
    with mpmath.workdps(30):
        exact = [
            rightmost([complex(x) for x in mpmath.polyroots(p, maxsteps=500, extraprec=200)])
            for p in polynomials
        ]
    table = Table("Poles of a slider with mass and one state, each", "error")
    each = timed(lambda: jax.block_until_ready(run(rows))) / len(rows)
    table.ours("batch of 16384", each, wrong([rightmost(x) for x in every[:COMPARED]], exact))

    def by_numpy():
        return [rightmost(np.roots(p)) for p in polynomials]

    table.peer(
        "NumPy, roots", timed(by_numpy) / COMPARED, wrong(by_numpy(), exact), "batch of 16384"
    )
    try:
        import control
    except ImportError:
        print("  python-control is not installed")
        return

    def by_control():
        found = []
        for A, B, L, V, m, k_v, k_p in few:
            friction = control.tf([A / V * L, A - B], [L, V])
            slider = control.feedback(control.tf([1], [m, 0]), friction)
            loop = control.feedback(control.tf([k_v, k_p], [1, 0]) * slider, 1)
            found.append(rightmost(control.minreal(loop, verbose=False).poles()))
        return found

    spent = timed(by_control) / COMPARED
    table.peer("python-control, poles", spent, wrong(by_control(), exact), "batch of 16384")


def _delay(mpmath: ModuleType) -> None:
    cases = sliders(20000)
    run = jax.jit(jax.vmap(rightmost_roots))
    found = np.asarray(run(*cases))[:COMPARED, 0]
    few = cases[:, :COMPARED].T

    def equation(s, m, k_p, k_v, k_f, alpha):
        return m * s**2 + k_v * s + k_p - k_f * s * mpmath.exp(-alpha * s)

    with mpmath.workdps(30):
        exact = [
            complex(mpmath.findroot(lambda s, p=p: equation(s, *map(mpmath.mpf, p)), complex(root)))
            for p, root in zip(few, found, strict=True)
        ]
    table = Table("Rightmost root of the delay law, each", "error")
    each = timed(lambda: jax.block_until_ready(run(*cases))) / cases.shape[1]
    table.ours("batch of 20000", each, wrong(found, exact))
    try:
        import tdscontrol
    except ImportError:
        print("  tdscontrol is not installed")
        return
    spent, errors, spurious, left, right = 0.0, [], 0, 0, 0
    for p, root in zip(few, exact, strict=True):
        m, k_p, k_v, k_f, alpha = p
        now = np.array([[0.0, 1.0], [-k_p / m, -k_v / m]], order="F")
        past = np.array([[0.0, 0.0], [0.0, k_f / m]], order="F")
        system = tdscontrol.tds([now, past], [0.0, float(alpha)])
        begun = time.perf_counter()
        some = np.array(tdscontrol.roots(system, float(root.real - 0.5 / alpha)))
        spent += time.perf_counter() - begun
        real = [s for s in some if _is_root(equation, s, p)]
        spurious += len(some) - len(real)
        one = rightmost(real) if real else complex(-np.inf)
        left += one.real < root.real - 1e-6 * abs(root)
        right += one.real > root.real + 1e-6 * abs(root)
        error = abs(one - complex(root.real, abs(root.imag))) / abs(root)
        errors += [error] if error < 1e-6 else []
    table.peer("tdscontrol, roots", spent / COMPARED, max(errors), "batch of 20000")
    print(
        f"  (building its objects is not timed; {spurious} of its values solve nothing and are left"
        f" out. Of {COMPARED} sliders it has a root right of ours in {right}, and none that far"
        f" right in {left}; its error is over the others)"
    )


def _is_root(equation, s: complex, p) -> bool:
    """Whether a Newton step from s stays near."""
    m, k_p, k_v, k_f, alpha = p
    late = np.exp(-alpha * s)
    value = m * s**2 + k_v * s + k_p - k_f * s * late
    slope = 2 * m * s + k_v - k_f * late + k_f * alpha * s * late
    return bool(abs(value / slope) < 1e-4 * abs(s))
