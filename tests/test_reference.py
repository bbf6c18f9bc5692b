"""The reference solutions against each other and against closed forms.

Everything else in the tests leans on `tests/reference.py`, so this file asks of it what the
project asks of its own code: the same motion in other variables, closed forms, the linear
theory, and a planted error that the comparison must see.
"""

import dataclasses

import numpy as np
import pytest
from reference import Law, Motion, Solution, solve
from scipy.integrate import simpson
from scipy.linalg import expm

UM = 1e-6
PLAIN = {kind: Law(kind, f0=0.6, A=0.010, B=(0.014,), L=(10 * UM,)) for kind in ("slip", "ageing")}
STEPS = Motion((0.0, 10.0, 20.0, 60.0), (1 * UM, 10 * UM, 2 * UM, 5 * UM))
HOLD = Motion((0.0, 10.0, 110.0), (1 * UM, 0.0, 1 * UM))
STEP = Motion((0.0, 5.0), (1 * UM, 10 * UM))
REVERSAL = Motion((0.0, 10.0, 160.0), (1 * UM, -1 * UM, 2 * UM))


def two_states(kind: str) -> Law:
    return Law(kind, f0=0.6, A=0.010, B=(0.010, 0.004), L=(10 * UM, 60 * UM), trend=30.0)


def regularised(kind: str) -> Law:
    return dataclasses.replace(PLAIN[kind], regularised=True)


def distance(a: Solution, b: Solution, law: Law, V0: float) -> float:
    """Largest difference of any output, each over its natural size (A, V0, A, min L)."""
    pairs = [(a.f, b.f, law.A), (a.spring, b.spring, law.A), (a.theta, b.theta, law.A)]
    pairs += [(a.V / V0, b.V / V0, np.abs(b.V / V0).max()), (a.x, b.x, min(law.L))]
    return max(float(np.abs(p - q).max()) / size for p, q, size in pairs)


# name -> law of a kind, motion, stiffness, mass, damping, and other ways to compute the same
CASES = {
    "steps": (PLAIN.get, STEPS, 2e3, 0.0, 0.0, {"speed": "logarithm"}, {"memory": "contact"}),
    "two states, trend": (
        *(two_states, STEPS, 2e3, 0.0, 0.0),
        {"speed": "logarithm", "memory": "contact"},
        {"speed": "logarithm"},
    ),
    "hold": (
        *(PLAIN.get, HOLD, 2e3, 0.0, 0.0),
        {"speed": "logarithm"},
        {"speed": "logarithm", "memory": "contact"},
    ),
    "reversal": (regularised, REVERSAL, 2e4, 0.0, 0.0, {"memory": "contact"}, {"rtol": 3e-13}),
    "inertial": (
        *(PLAIN.get, STEP, 2e3, 100.0, 1000.0),
        {"speed": "velocity", "memory": "contact"},
    ),
}


@pytest.mark.parametrize("kind", ["slip", "ageing"])
@pytest.mark.parametrize("name", CASES)
def test_formulations_agree(name, kind):
    make, motion, stiffness, mass, damping, *others = CASES[name]
    law = make(kind)
    ts = np.linspace(0.0, motion.starts[-1] + (8.0 if mass else 40.0), 301)
    reference = solve(law, motion, stiffness, ts, mass=mass, damping=damping)
    for other in others:
        again = solve(law, motion, stiffness, ts, mass=mass, damping=damping, **other)
        # Reversal: while it sticks nothing damps the error of F, and F/A is 60.
        assert distance(again, reference, law, motion.velocities[0]) < (
            2e-7 if name == "reversal" else 1e-9
        )


def test_distance_sees_a_planted_error():
    law = PLAIN["slip"]
    wrong = dataclasses.replace(law, L=(law.L[0] * (1 + 1e-7),))
    ts = np.linspace(0.0, 60.0, 200)
    a, b = (solve(each, STEPS, 2e3, ts) for each in (law, wrong))
    assert distance(a, b, law, UM) > 1e-9


def test_integrators_agree():
    ts = np.linspace(0.0, 30.0, 100)
    a = solve(PLAIN["slip"], STEPS, 2e3, ts)
    b = solve(PLAIN["slip"], STEPS, 2e3, ts, method="Radau", rtol=1e-11)
    assert distance(a, b, PLAIN["slip"], UM) < 1e-8


@pytest.mark.parametrize("kind", ["slip", "ageing"])
def test_steady_levels(kind):
    law = two_states(kind)
    motion = Motion((0.0, 20.0), (1 * UM, 7 * UM))
    s = solve(law, motion, 4e3, [10.0, 400.0])
    rate = motion.velocities[1] / (1.0 + law.trend / 4e3)  # the spring stretches with the trend
    drop = (law.A - sum(law.B)) * np.log(rate / UM)
    start = motion.velocities[0] / (1.0 + law.trend / 4e3)
    early = (law.A - sum(law.B)) * np.log(start / UM)
    assert s.V[1] == pytest.approx(rate, rel=1e-9)
    assert s.f[1] == pytest.approx(0.6 + drop + 30.0 * s.x[1], abs=1e-10)
    assert s.f[0] == pytest.approx(0.6 + early + 30.0 * s.x[0], abs=1e-4)  # still relaxing


@pytest.mark.parametrize("kind", ["slip", "ageing"])
def test_imposed_velocity(kind):
    """K -> infinity: the closed-form response of theta, approached as 1/K."""
    law, r = PLAIN[kind], 10.0
    B, L = law.B[0], law.L[0]
    ts = 1.0 + np.linspace(0.5, 4.0, 15)
    errors = []
    for stiffness in (1e6, 1e7):
        s = solve(law, Motion((0.0, 1.0), (UM, r * UM)), stiffness, ts, method="Radau", rtol=1e-11)
        slip = r * UM * (ts - 1.0)
        if kind == "slip":
            exact = -B * np.log(r) * (1.0 - np.exp(-slip / L))
        else:  # dTheta/dt = 1 - V Theta/L, theta = B ln(V0 Theta/L)
            exact = B * np.log(1.0 / r + (1.0 - 1.0 / r) * np.exp(-slip / L))
        errors.append(np.abs(s.theta[0] - exact).max())
        np.testing.assert_allclose(s.V, r * UM, rtol=3e3 / stiffness)
    assert errors[1] < 1e-5
    assert errors[0] / errors[1] == pytest.approx(10.0, rel=0.05)


def linear_response(law: Law, K: float, V0: float, eps: float, ts: np.ndarray, m=0.0, k_v=0.0):
    """Linearised u(t) about the steady state at V0 (1 + eps) after a step there from V0.

    Deviations of spring force, V (with mass) and theta obey z' = J z; the laws share J.
    """
    A, B, L = law.A, law.B[0], law.L[0]
    V1 = V0 * (1.0 + eps)
    if m > 0.0:
        c = k_v + A / V1
        J = np.array([[0.0, -K, 0.0], [1.0 / m, -c / m, -1.0 / m], [0.0, -B / L, -V1 / L]])
        z0 = np.array([(B - A) * eps, -V0 * eps, B * eps])
        return np.linalg.eigvals(J), np.array([(expm(J * t) @ z0)[1] / V1 for t in ts])
    a = V1 / A  # V deviation = (F - theta) V1/A
    J = np.array([[-K * a, K * a], [-a * B / L, a * B / L - V1 / L]])
    z0 = np.array([(B - A) * eps, B * eps])
    z = np.array([expm(J * t) @ z0 for t in ts])
    return np.linalg.eigvals(J), (z[:, 0] - z[:, 1]) / A


@pytest.mark.parametrize("kind", ["slip", "ageing"])
@pytest.mark.parametrize("factor", [0.98, 1.02])
def test_small_step_without_mass(kind, factor):
    law, V0, eps = PLAIN[kind], UM, 1e-6
    K = factor * (law.B[0] - law.A) / law.L[0]
    ts = np.linspace(0.0, 200.0, 101)
    s = solve(law, Motion((0.0, 1.0), (V0, V0 * (1 + eps))), K, 1.0 + ts)
    roots, u = linear_response(law, K, V0, eps, ts)
    assert np.sign(roots.real.max()) == np.sign(1.0 - factor)
    assert np.log(s.V / (V0 * (1 + eps))) == pytest.approx(u, abs=2e-5 * np.abs(u).max())


@pytest.mark.parametrize("kind", ["slip", "ageing"])
@pytest.mark.parametrize("factor", [0.9, 1.1])
def test_small_step_with_mass_and_dashpot(kind, factor):
    """The golden sample of the linear theory: k_cr = 2014.976 N/m, w_cr = 2.8263 rad/s."""
    m, k_v, A, B, L, V0, eps = 2.0, 0.5, 1.0, 3.0, 1e-3, 2e-3, 1e-7
    c = A + k_v * V0
    k_cr = (B - c) / L * (m * V0**2 / (c * L) + 1.0)
    assert k_cr == pytest.approx(2014.976023976024, rel=1e-14)
    law = Law(kind, 10.0, A, (B,), (L,))
    ts = np.linspace(0.0, 8.0, 81)
    motion = Motion((0.0, 0.5), (V0, V0 * (1 + eps)))
    s = solve(law, motion, factor * k_cr, 0.5 + ts, mass=m, damping=k_v, speed="velocity")
    roots, u = linear_response(law, factor * k_cr, V0, eps, ts, m, k_v)
    assert np.sign(roots.real.max()) == np.sign(1.0 - factor)
    assert s.V / (V0 * (1 + eps)) - 1.0 == pytest.approx(u, abs=1e-5 * np.abs(u).max())
    marginal, _ = linear_response(law, k_cr, V0, 0.0, ts[:1], m, k_v)
    assert marginal[np.argmax(marginal.imag)] == pytest.approx(2.826307129101859j, abs=1e-9)


def test_newtons_law_holds_in_the_mean():
    """m (V - V0) is the impulse of all forces, by quadrature of the outputs alone."""
    law, mass, damping = PLAIN["slip"], 500.0, 2000.0
    ts = np.linspace(10.0, 16.0, 6001)
    motion = Motion((0.0, 10.0), (1 * UM, 10 * UM))
    s = solve(law, motion, 2e3, ts, mass=mass, damping=damping, rtol=1e-10)
    force = s.spring + damping * (10 * UM - s.V) - s.f
    assert simpson(force, x=ts) == pytest.approx(mass * (s.V[-1] - s.V[0]), rel=1e-5)
    spring = law.f0 + 2e3 * (s.x_m - s.x)
    assert s.spring == pytest.approx(spring, abs=1e-12)
    assert np.ptp(s.spring - s.f) > 0.05 * law.A  # inertia matters in this case


def test_inertia_vanishes_with_mass():
    law, motion = PLAIN["slip"], Motion((0.0, 10.0), (1 * UM, 10 * UM))
    ts = np.linspace(0.0, 20.0, 101)
    still = solve(law, motion, 2e3, ts)
    errors = [
        np.abs(solve(law, motion, 2e3, ts, mass=m, rtol=1e-9).f - still.f).max() for m in (0.1, 1.0)
    ]
    assert errors[1] / errors[0] == pytest.approx(10.0, rel=0.1)


@pytest.mark.parametrize("kind", ["slip", "ageing"])
def test_regularised_law(kind):
    ts = np.linspace(0.0, 30.0, 101)
    plain, same = (solve(law, STEPS, 2e3, ts) for law in (PLAIN[kind], regularised(kind)))
    assert distance(plain, same, PLAIN[kind], UM) < 1e-9  # forward sliding: exp(-2 f0/A) apart
    back = solve(regularised(kind), REVERSAL, 2e4, [159.9, 260.0])
    law = PLAIN[kind]
    level = law.f0 + (law.A - law.B[0]) * np.log(2.0)
    np.testing.assert_allclose(back.V, [-UM, 2 * UM], rtol=2e-3)
    assert back.f == pytest.approx([-law.f0, level], abs=2e-5)


def test_finite_step_overshoots_and_runs_away():
    """Far above k_cr a tenfold step still overshoots fifteenfold; softer, it diverges.

    K_cr = 500/m here. The peaks were found in three formulations and by two integrators.
    """
    law = Law("slip", 0.6, 0.010, (0.015,), (10 * UM,))
    motion = Motion((0.0, 1.0), (1 * UM, 10 * UM))
    ts = np.linspace(2.5, 4.0, 3001)
    assert solve(law, motion, 1.5e3, ts).V.max() == pytest.approx(150.09 * UM, rel=1e-4)
    assert solve(law, motion, 1.2e3, ts).V.max() == pytest.approx(975.7 * UM, rel=1e-3)
    with pytest.raises(RuntimeError, match="stopped"):
        solve(law, motion, 0.8e3, [0.0, 40.0])


@pytest.mark.parametrize(
    "options",
    [
        {"speed": "velocity"},
        {"damping": 1.0},
        {"mass": 1.0, "speed": "force"},
        {"mass": 1.0, "speed": "friction"},
    ],
)
def test_what_would_not_be_used_is_refused(options):
    with pytest.raises(ValueError):
        solve(PLAIN["slip"], STEPS, 2e3, [0.0, 1.0], **options)
