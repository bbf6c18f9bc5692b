"""What a model assumes of a record: steady sliding at its start, and one normal stress."""

import json

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import jaxfric as jf
from jaxfric.findings import WarningCode, is_of
from jaxfric.loop.slider import repeated

A, B, L, K, V0 = 0.008, 0.012, 1e-5, 1.6e3, 1e-6


def sliding(heals: float, *, trend: float = 0.0, slow: float = 0.0, seed: int = 0, rate: int = 20):
    """A step from 10 to 30 um/s under the ageing law, by SciPy. It begins with friction above the
    level of sliding by B `heals`, as just after a hold; noise is white, and `slow` over 40 rows."""
    lnV = np.log(1e-5 / V0)

    def change(t, y, V):
        v = V0 * np.exp((y[0] - 0.6 - B * y[1]) / A)
        return [K * (V - v), np.exp(-y[1]) * V0 / L - v / L]

    t = np.arange(40 * rate) / rate
    first, second = t < 20, t >= 20
    f, y = np.empty(len(t)), [0.6 + A * lnV + B * (heals - lnV), heals - lnV]
    for rows, V in ((first, 1e-5), (second, 3e-5)):
        own = t[rows] - t[rows][0]
        made = solve_ivp(change, (0, 20), y, "LSODA", args=(V,), dense_output=True,
                         rtol=1e-9, atol=1e-11)  # fmt: skip
        f[rows], y = made.sol(own)[0], made.y[:, -1]
    u = 1e-5 * np.minimum(t, 20) + 3e-5 * np.maximum(t - 20, 0)
    rng = np.random.default_rng(seed)
    noise, drive = np.zeros(len(t)), rng.standard_normal(len(t))
    for k in range(1, len(t)):
        noise[k] = np.exp(-1 / 40) * noise[k - 1] + np.sqrt(1 - np.exp(-1 / 20)) * drive[k]
    f += 2e-4 * rng.standard_normal(len(t)) + slow * noise + trend * u
    return t, u, f


def fitted(t, u, f, begin=0.0, **more):
    record = jf.from_arrays(t, f, load_point_displacement=u, **more).window(begin)
    return jf.fit(record, law="ageing", stiffness=K)


def test_a_start_that_is_not_steady_is_named_with_a_later_one():
    rows = sliding(3.0)
    (told,) = (w for w in fitted(*rows).warnings if is_of(w, WarningCode.UNSTEADY))
    later = told.values["time"]
    assert 2 < later < 12 and f"{later:.4g} s later" in told
    again = fitted(*rows, begin=later)
    assert not any(is_of(w, WarningCode.UNSTEADY) for w in again.warnings)
    for name, value in (("A", A), ("B", B), ("L", L)):
        assert abs(again.parameters[name].value - value) < 3 * again.parameters[name].std


@pytest.mark.parametrize(
    "more",
    [{}, {"rate": 5}, {"trend": 250.0}, *({"slow": 4e-4, "seed": seed} for seed in (1, 2, 3))],
)
def test_a_steady_start_is_not_named(more):
    found = fitted(*sliding(0.0, **more))
    assert not any(is_of(w, WarningCode.UNSTEADY) for w in found.warnings)


def test_a_change_of_normal_stress_is_named_with_its_time(tmp_path):
    t, u, f = sliding(0.0)
    steady, changes = np.full(len(t), 5e6), 5e6 + 5e5 * np.clip(t - 30, 0, 1)
    ringing = steady * (1 + 0.002 * np.sin(t))
    same = fitted(t, u, f, normal_stress=ringing)
    assert not any(is_of(w, WarningCode.STRESS) for w in same.warnings)
    found = fitted(t, u, f, normal_stress=changes)
    (told,) = (w for w in found.warnings if is_of(w, WarningCode.STRESS))
    assert told.values["least"] == 5e6 and told.values["most"] == 5.5e6
    assert "from 5 to 5.5 MPa, at 30 s" in told and "jaxfric loop" in told
    assert told not in repeated(found.warnings)  # the loop has an effect for it
    (tmp_path / "fit.json").write_text(json.dumps(same.to_json()), encoding="utf-8")
    record = jf.from_arrays(t, f, load_point_displacement=u, normal_stress=changes)
    assert told in jf.predict(tmp_path / "fit.json", record).warnings
