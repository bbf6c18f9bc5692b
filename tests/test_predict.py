"""A saved model on another record: errors by closed forms, and records made here with NumPy."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import reference
from command import STEPS, assert_refused, record_text, run, written
from scipy.integrate import odeint
from scipy.signal import lfilter

import jaxfric
from jaxfric.cli.folder import Folder
from jaxfric.errors import InputError
from jaxfric.prediction.model import load_model
from jaxfric.prediction.result import Comparison, Prediction, Shift
from jaxfric.protocol.base import base_of_file
from jaxfric.records import Drive, VelocitySteps, axis_from_arrays, from_arrays
from jaxfric.records.record import Provenance

M, F_V, F_C, F_0 = 20.0, 150.0, 12.0, -2.0
RATE = 1000.0
K_P, K_D = 60.0, 4000.0


@pytest.fixture(autouse=True)
def in_a_folder_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def prediction(rms: float, refit: float, sigma: float, **shifts: Shift) -> Prediction:
    errors = (Comparison("fit", "friction", rms, "N", 0.1, rms / sigma),)
    rows = np.zeros(3)
    return Prediction(
        "fit.json", Provenance(), "slider", "N", errors, {"f0": (0.0, 1.0)}, sigma, refit,
        tuple(shifts.values()), rows, rows, rows, None, (), (), 1.3, 0.0,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("rms", "refit", "sigma", "verdict", "words"),
    [
        (1.0, 1.0, 1.0, "noise", "consistent with noise"),
        (2.0, 1.0, 1.0, "parameters", ", the noise: its parameters have changed (M differ)"),
        (4.0, 2.0, 1.0, "parameters", "still above the noise"),
        (2.0, 2.0, 1.0, "model", "model is not better (2 N): the model lacks an effect here"),
    ],
)
def test_what_a_residual_is_due_to(rms, refit, sigma, verdict: str, words: str) -> None:
    shifts = {"M": Shift("M", 1.0, 2.0, 0.1), "f0": Shift("f0", 0.0, 1.0, 0.01)}
    found = prediction(rms, refit, sigma, **shifts)
    assert found.verdict == verdict and words in found.sentence
    assert found.sentence.startswith("Yes" if verdict == "noise" else "No")
    assert f" {rms:.3g} N, {rms:.2g} times the noise" in found.sentence
    shares = found.shares()
    assert sum(shares.values()) == pytest.approx(1.0)
    assert shares["parameters"] == pytest.approx(1 - (refit / rms) ** 2)
    assert shares["noise"] == pytest.approx((sigma / rms) ** 2)


# ---- an axis ---------------------------------------------------------------------------------


def axis_table(M: float) -> dict[str, Any]:
    values = {"M": M, "F_v": F_V, "F_c": F_C, "F_0": F_0}
    return {
        "parameters": {n: {"value": v, "std": 1e-3 * abs(v)} for n, v in values.items()},
        "free": list(values),
        "covariance": np.diag([(1e-3 * v) ** 2 for v in values.values()]).tolist(),
    }


def axis_model(path: str, mass: float = M, **changes: object) -> Path:
    """A loop.json of an axis without effects."""
    content = {
        "schema": "jaxfric.loop/2",
        "law": "coulomb_viscous",
        "friction_unit": "N",
        "verdict": "no_missing_effect",
        "steps": [[0.0, 0.3], [0.5, -0.3]],
        "effects": [],
        "before": axis_table(mass),
        "after": axis_table(mass),
        "axis": {
            "coordinate": "linear",
            "cutoff": 50.0,
            "sign_width": 1e-3,
            "fits": [],
            "held": False,
        },
    }
    return written(Path(path), json.dumps({**content, **changes}))


def two_sines(seconds: float = 4.0) -> tuple[np.ndarray, ...]:
    """Time, position, velocity, acceleration, motor force of two sines, without noise."""
    t = np.arange(0, seconds, 1 / RATE)
    pairs = ((0.05, 2 * np.pi), (0.01, 6 * np.pi))
    x = sum(a * np.sin(w * t + 0.3) for a, w in pairs)
    v = sum(a * w * np.cos(w * t + 0.3) for a, w in pairs)
    acceleration = sum(-a * w * w * np.sin(w * t + 0.3) for a, w in pairs)
    force = M * acceleration + F_V * v + F_C * np.tanh(v / 1e-3) + F_0
    return t, np.asarray(x), np.asarray(v), np.asarray(acceleration), np.asarray(force)


def moved(seconds: float = 4.0, noise: float = 0.05) -> tuple[np.ndarray, ...]:
    """Time, position, acceleration, motor force of two sines; white noise of the force."""
    t, x, _, acceleration, force = two_sines(seconds)
    return t, x, acceleration, force + np.random.default_rng(2).normal(0, noise, len(t))


def test_an_axis_by_inverse_dynamics() -> None:
    t, x, a, force = moved()
    record = axis_from_arrays(t, force, position=x)
    right = jaxfric.predict(axis_model("a.json"), record)
    assert right.verdict == "noise" and right.refitted == {}
    assert right.rms == pytest.approx(0.05 / np.sqrt(10), rel=0.2)  # of means of ten rows
    assert {c.method for c in right.comparisons} == {"inverse dynamics"}
    heavy = jaxfric.predict(axis_model("b.json", 1.1 * M), record)
    inside = np.isfinite(heavy.predicted)
    missed = 0.1 * M * a.reshape(-1, 10).mean(axis=1)[inside]
    assert heavy.rms == pytest.approx(np.sqrt(np.mean(missed**2) + right.rms**2), rel=0.01)
    assert heavy.verdict == "parameters" and "(M differ)" in heavy.sentence
    shift = heavy.shifts[0]
    assert (shift.name, shift.model) == ("M", pytest.approx(1.1 * M))
    assert shift.here == pytest.approx(M, rel=2e-3) and shift.in_sigma < -20
    relative = heavy.comparisons[0].relative_error
    rows = heavy.recorded[inside]
    assert relative == pytest.approx(heavy.rms / np.sqrt(np.mean(rows**2)))


def autoregressive(rho: float, rows: int, rng: np.random.Generator) -> np.ndarray:
    """White noise and AR(1) noise in equal parts, of variance 1; white noise for rho = 0."""
    slow = lfilter([np.sqrt(1 - rho**2)], [1, -rho], rng.standard_normal(rows + 400))[400:]
    return np.sqrt(0.5) * (slow + rng.standard_normal(rows))


def sigma_of_means(rho: float, number: int = 10) -> float:
    """Standard deviation of means of rows of `autoregressive` noise, from its autocorrelation."""
    apart = np.abs(np.subtract.outer(np.arange(number), np.arange(number)))
    return float(np.sqrt(np.mean(0.5 * rho**apart + 0.5 * (apart == 0))))


@pytest.mark.parametrize("rho", [0.0, 0.9, 0.95, 0.98])
def test_correlated_force_noise_is_no_missing_effect_of_an_axis(rho: float) -> None:
    """Sigma and, for white noise, its limit in closed form. Shifts are as large as their errors."""
    t, x, _, _, force = two_sines(8.0)
    exact = axis_table(M)
    for item in exact["parameters"].values():
        item["std"] = 0.0
    model = axis_model("a.json", after=exact, before=exact)
    z, sigmas, limits = [], [], []
    for seed in range(8):
        rng = np.random.default_rng([seed, int(100 * rho)])
        noisy = force + 0.5 * autoregressive(rho, len(t), rng)
        found = jaxfric.predict(model, axis_from_arrays(t, noisy, position=x))
        assert found.verdict == "noise", (seed, found.sentence)
        z += [shift.in_sigma for shift in found.shifts]
        sigmas.append(found.sigma)
        limits.append(found.largest)
    if rho == 0:  # rms and sigma have a relative error of sqrt(1/2n) each, for white noise
        rows = np.isfinite(found.predicted).sum()
        assert np.median(limits) == pytest.approx(1 + 3.143 / np.sqrt(rows), rel=5e-3)
    assert np.mean(sigmas) == pytest.approx(0.5 * sigma_of_means(rho), rel=0.1)
    assert 0.62 < np.sqrt(np.mean(np.square(z))) < 1.38  # three standard errors around 1
    assert found.notes[-1].code == "noise_of_the_record"


LACKED = {
    "stribeck": lambda x, v, force, t: 2 * np.exp(-((v / 0.1) ** 2)) * np.sign(v),
    "forwards": lambda x, v, force, t: 2 * np.exp(-((v / 0.1) ** 2)) * (v > 0),
    "ripple": lambda x, v, force, t: np.sin(2 * np.pi * x / 15e-3),
    "spring": lambda x, v, force, t: 60 * np.maximum(x, 0),
    "place": lambda x, v, force, t: 60 * np.maximum(x, 0) * np.sign(v),
    "delay": lambda x, v, force, t: -3e-3 * np.gradient(force, t),
    "warming": lambda x, v, force, t: -0.5 * t * np.sign(v),
}


@pytest.mark.parametrize("rho", [0.0, 0.9])
@pytest.mark.parametrize("lacked", LACKED)
def test_a_missing_effect_of_an_axis_is_no_noise(lacked: str, rho: float) -> None:
    t, x, v, _, force = two_sines()
    noise = 0.2 * autoregressive(rho, len(t), np.random.default_rng(4))
    force = force + LACKED[lacked](x, v, force, t) + noise
    found = jaxfric.predict(axis_model("a.json"), axis_from_arrays(t, force, position=x))
    assert found.verdict != "noise" and "the model lacks an effect" in found.sentence
    assert found.refit_rms > found.largest * found.sigma
    assert found.sigma < 1.5 * 0.2 * sigma_of_means(rho)


def driven(pulse: float) -> tuple[np.ndarray, ...]:
    """The same axis under two sampled loops with pulses of force: Euler's small steps."""
    h, fine = 1 / RATE, 200
    t = np.arange(0, 1.5, h)
    target = 0.05 * (1 - np.cos(2 * np.pi * t))
    added = np.where((t > 0.4) & (t < 0.7), pulse, 0.0)
    q, v, last, before = 0.0, 0.0, 0.0, 0.0
    seen, forces = [], []
    for goal, extra in zip(target, added, strict=True):
        force = K_D * (K_P * (goal - q) - (q - before) / (2 * h)) + extra
        seen.append(q)
        forces.append(force)
        before, last = last, q
        for _ in range(fine):
            v += h / fine * (force - F_V * v - F_C * np.tanh(v / 1e-3) - F_0) / M
            q += h / fine * v
    return t, target, np.asarray(seen), np.asarray(forces), added


def test_a_closed_loop_with_pulses() -> None:
    t, target, q, force, added = driven(40.0)
    drive = Drive(1.0, K_P, K_D, "N")
    common = {"position": q, "reference_position": target, "drive": drive}
    record = axis_from_arrays(t, force, disturbance_force=added, **common)
    model = axis_model("a.json", axis={"coordinate": "linear", "sign_width": 1e-3, "held": True})
    with_pulses = jaxfric.predict(model, record)
    assert "the recorded force contains the disturbance" in with_pulses.notes[1]
    errors = {c.method: c for c in with_pulses.comparisons}
    position = errors["closed loop: position"]
    assert position.rms < 2e-7 and position.unit == "m"
    assert errors["closed loop: motor force"].relative_error < 0.02
    assert with_pulses.position is not None and len(with_pulses.position[1]) == len(t)
    blind = jaxfric.predict(model, axis_from_arrays(t, force, **common))
    missed = {c.method: c for c in blind.comparisons}["closed loop: position"].rms
    assert missed > 20 * position.rms
    beside = axis_from_arrays(t, force - added, disturbance_force=added, **common)
    assert "is without the disturbance" in jaxfric.predict(model, beside).notes[1]


# ---- a slider --------------------------------------------------------------------------------


def slider_model(path: str = "fit.json", **changes: object) -> Path:
    values = {"f0": 0.5, "A": 0.0047, "B": 0.0084, "L": 23e-6, "K": 5e3, "V0": 2e-6}
    content = {
        "schema": "jaxfric.fit/2",
        "law": "slip",
        "states": 1,
        "friction_unit": "1",
        "converged": True,
        "parameters": {n: {"value": v, "std": 0.01 * v} for n, v in values.items()},
        "free": ["f0", "A", "B", "L"],
        "covariance": np.eye(4).tolist(),
        "steps": {"times": [0.0, 20.0], "velocities": [2e-6, 10e-6]},
    }
    return written(Path(path), json.dumps({**content, **changes}))


def test_a_slider_through_the_command(monkeypatch: pytest.MonkeyPatch) -> None:
    written(Path("run.csv"), record_text())
    code, out, err = run("predict", slider_model(), "run.csv", *STEPS, "--details")
    assert code == 0 and "warning" not in err
    assert "stiffness is the model's, " in out and "(--stiffness)" in out
    assert "of this record f0 was fitted" in out and "Have the parameters changed?" in out
    folder = Path(out.split("written: ")[1].split("/prediction.json")[0])
    assert folder.name.startswith("run-by-fit-predict")
    assert {f.name for f in folder.iterdir()} >= {"prediction.json", "prediction.png"}
    content = json.loads((folder / "prediction.json").read_text())
    assert content["schema"] == "jaxfric.prediction/1"
    fitted, stiffness, *_ = content["noted"]
    assert fitted == {"code": "parameters_fitted", "values": {"parameters": ["f0"]}}
    assert stiffness["code"] == "stiffness_of_the_model"
    assert len(content["noted"]) == len(content["notes"])
    model, here = content["refitted"]["f0"]["model"], content["refitted"]["f0"]["here"]
    assert model == 0.5 and here == pytest.approx(0.6, abs=1e-3)
    assert content["comparisons"][0]["rms"] == pytest.approx(2e-4, rel=0.3)
    monkeypatch.setattr(Folder, "draw", lambda *_: [])
    own = ("--stiffness", "5e-3/um", "--out", "own")
    assert "stiffness is the model's" not in run("predict", "fit.json", "run.csv", *STEPS, *own).out
    code, out, err = run("predict", "fit.json", "run.csv", *STEPS, "--refit", "", "--json")
    assert json.loads(out)["refitted"] == {}
    assert json.loads(out)["comparisons"][0]["rms"] == pytest.approx(0.1, rel=0.02)
    own = "A, L are not determined by this record: other values fit it as well"
    told = slider_model("told.json", warnings=[own])
    code, out, err = run("predict", told, "run.csv", *STEPS, "--json")
    assert code == 0 and err.count(f"jaxfric: warning: the fit warned: {own}\n") == 1
    assert json.loads(out)["warnings"] == [f"the fit warned: {own}"] and err.count(own) == 1
    slow = slider_model("slow.json", steps={"times": [0.0], "velocities": [1e-6, 1.1e-6]})
    code, out, err = run("predict", slow, "run.csv", *STEPS, "--json")
    told = json.loads(out)["warned"][-1]
    assert told["code"] == "other_velocities" and "(1 to 1.1 um/s)" in err
    assert [told["values"][k] for k in ("slowest", "fastest")] == pytest.approx([1e-6, 1.1e-6])


PRESS = 1e11
"""Stiffness of a press: 0.1 MPa/um."""


def at_normal_stress(
    sigma: float, velocities: tuple[float, ...], *, rises=(), alpha: float = 0.0
) -> jaxfric.Record:
    """Steps of 200 um each under the slip law, as SciPy has it, on a press, at `sigma` [Pa].

    The normal stress rises by `sigma`/5 within 10 s around the times of `rises` [s], and moves the
    state by -alpha d ln(sigma)/dt (Linker and Dieterich).
    """
    A, B, L, V0, way = 0.008, 0.012, 2e-5, 1e-6, 2e-4
    begin, state, columns = 0.0, np.zeros(2), []

    def stress(t):
        each = [np.tanh((t - rise) / 5.0) for rise in rises]
        level = sigma * (1 + 0.1 * sum(1 + x for x in each))
        return level, sigma * 0.1 * sum((1 - x**2) / 5.0 for x in each)

    for k, V in enumerate(velocities):

        def rate(y, t, V=V, begin=begin):
            own, (now, change) = V0 * np.exp(y[0]), stress(begin + t)
            theta = -(own / L) * (y[1] + B * y[0]) - alpha * change / now
            friction = 0.6 + A * y[0] + y[1]
            pull = (PRESS * (V - own) - friction * change) / now
            return [(pull - theta) / A, theta]

        at = np.linspace(0, way / V, 201)
        path = odeint(rate, state, at, rtol=1e-10, atol=1e-12, hmax=1.0)
        friction = 0.6 + A * path[:, 0] + path[:, 1]
        columns.append([begin + at[:-1], k * way + V * at[:-1], friction[:-1]])
        begin, state = begin + at[-1], path[-1]
    time, point, friction = np.concatenate(columns, axis=1)
    friction += 1e-4 * np.random.default_rng(0).standard_normal(len(time))
    gauge = stress(time)[0] * np.ones(len(time))
    columns = {"load_point_displacement": point, "normal_stress": gauge}
    return jaxfric.from_arrays(time, friction, **columns)


def test_k_of_a_press_holds_at_the_start_if_the_normal_stress_changes() -> None:
    """K delta = n f with n relative to the start, so K = k/sigma(0), not k over the mean."""
    record = at_normal_stress(10e6, (1e-6, 3e-6, 1e-6, 3e-6), rises=(70.0, 90.0, 110.0))
    loop = jaxfric.close_loop(record, stiffness="0.1 MPa/um", max_effects=0)
    assert loop.normal_stress == pytest.approx(10e6, rel=1e-3)
    assert loop.after.parameters["K"].value == pytest.approx(1e4, rel=1e-3)
    for name, true in {"A": 0.008, "B": 0.012, "L": 2e-5}.items():
        assert loop.after.parameters[name].value == pytest.approx(true, rel=0.02), name
    assert loop.after.rms["report"] == pytest.approx(1e-4, rel=0.1)


def heavy(velocities: tuple[float, ...], f0: float, seed: int, mass: float = 300.0):
    """A record of a slider with mass, which SciPy solves, and its steps; noise of 0.05 N."""
    motion = reference.Motion((0.0, 3.0, 4.0), velocities)
    law = reference.Law("slip", f0, 4.0, (6.0,), (20e-6,))
    t = np.arange(0, 8, 0.01)
    exact = reference.solve(law, motion, 2e6, t, mass=mass, rtol=1e-9)
    noise = np.random.default_rng(seed).normal(0, 0.05, len(t))
    record = from_arrays(t, exact.f + noise, load_point_displacement=exact.x_m, friction_unit="N")
    return record, VelocitySteps(np.asarray(motion.starts), np.asarray(velocities))


def test_a_slider_with_mass_is_predicted_with_its_mass() -> None:
    record, steps = heavy((20e-6, 1e-3, 20e-6), 300.0, 1)
    fit = jaxfric.fit(record, stiffness=2e6, mass=300.0, steps=steps)
    own = jaxfric.predict(fit, record, steps=steps)
    assert own.rms == pytest.approx(fit.rms, rel=1e-4) and own.verdict == "noise"
    other, steps = heavy((50e-6, 5e-4, 50e-6), 310.0, 2)
    found = jaxfric.predict(fit, other, steps=steps)
    assert found.verdict == "noise" and found.rms == pytest.approx(0.05, rel=0.05)
    source = jaxfric.law_from_fit(fit, samples=2)
    assert source.mass == 300.0
    Path("heavy.json").write_text(json.dumps(fit.to_json()))
    base = base_of_file(Path("heavy.json"))
    assert (
        "m" not in base.parameters and "the fit has 300 kg, which is not used" in base.warnings[-1]
    )
    at_20 = 310.0 + 2.0 * np.log(50 / 20)  # f0 is the friction at V0 of the fit, 20 um/s
    assert found.refitted["f0"][1] == pytest.approx(at_20, abs=0.02)
    assert all(abs(shift.in_sigma) < 3 for shift in found.shifts if shift.name != "f0")


def wandering(law: str, velocities: tuple[float, ...], f0: float, seed: int):
    """A record that SciPy solves, with white noise and noise of 1 s (AR(1)), 2e-4 each."""
    motion = reference.Motion((0.0, 12.0, 18.0), velocities)
    t, rng = np.arange(0, 50, 0.1), np.random.default_rng(seed)
    exact = reference.solve(
        reference.Law(law, f0, 0.008, (0.012,), (12e-6,)), motion, 3000.0, t, rtol=1e-9
    )
    slow, keep = np.zeros(len(t)), np.exp(-0.1)
    slow[0] = rng.standard_normal()
    for k in range(1, len(t)):
        slow[k] = keep * slow[k - 1] + np.sqrt(1 - keep**2) * rng.standard_normal()
    friction = exact.f + 2e-4 * (slow + rng.standard_normal(len(t)))
    record = from_arrays(t, friction, load_point_displacement=exact.x_m)
    return record, VelocitySteps(np.asarray(motion.starts), np.asarray(velocities))


FAST, SLOW = (2e-6, 20e-6, 2e-6), (3e-6, 30e-6, 3e-6)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_correlated_noise_is_no_missing_effect(seed: int) -> None:
    record, steps = wandering("ageing", FAST, 0.6, seed)
    fit = jaxfric.fit(record, stiffness=3000.0, law="ageing", steps=steps)
    other, steps = wandering("ageing", SLOW, 0.63, seed + 10)
    found = jaxfric.predict(fit, other, steps=steps)
    assert found.verdict == "noise" and found.sentence.startswith("Yes")
    assert found.sigma == pytest.approx(2e-4 * np.sqrt(2), rel=0.3)
    assert found.notes[-1].code == "noise_of_the_record"


@pytest.mark.parametrize(("law", "wrong"), [("ageing", "slip"), ("slip", "ageing")])
def test_another_law_is_a_missing_effect_under_correlated_noise(law: str, wrong: str) -> None:
    record, steps = wandering(law, FAST, 0.6, 4)
    fit = jaxfric.fit(record, stiffness=3000.0, law=wrong, steps=steps)
    other, steps = wandering(law, SLOW, 0.63, 14)
    found = jaxfric.predict(fit, other, steps=steps)
    assert found.verdict == "model" and found.refit_rms > 2 * found.largest * found.sigma


@pytest.mark.parametrize(("B", "L", "verdict"), [(7, 20, "noise"), (13, 8, "parameters")])
def test_a_badly_known_length_does_not_explain_another_rock(B, L, verdict: str) -> None:
    """A short noisy step knows L to 40 %; it predicts its own rock, and not another."""

    def made(velocities, starts, end, dt, noise, B, L, f0):
        motion, t = reference.Motion(starts, velocities), np.arange(0, end, dt)
        law = reference.Law("slip", f0, 0.008, (1e-3 * B,), (1e-6 * L,))
        exact = reference.solve(law, motion, 4000.0, t, rtol=1e-9)
        friction = exact.f + np.random.default_rng(5).normal(0, noise, len(t))
        steps = VelocitySteps(np.asarray(starts), np.asarray(velocities))
        return from_arrays(t, friction, load_point_displacement=exact.x_m), steps

    record, steps = made((1e-5, 1e-6), (0.0, 6.0), 31.0, 0.15, 1.5e-3, 7, 20, 0.69)
    fit = jaxfric.fit(record, stiffness=4000.0, steps=steps)
    assert fit.parameters["L"].determined and fit.parameters["L"].std > 0.2 * 20e-6
    other, steps = made((1e-6, 1e-5, 1e-6), (0.0, 30.0, 38.0), 98.0, 0.2, 3e-4, B, L, 0.62)
    found = jaxfric.predict(fit, other, steps=steps)
    assert found.verdict == verdict and found.rms > found.largest * found.sigma


# ---- what is refused -------------------------------------------------------------------------


@pytest.mark.parametrize("verb", ["fit", "loop"])
def test_a_stiffness_of_stress_needs_a_normal_stress(verb: str) -> None:
    written(Path("run.csv"), record_text())
    said = "the record has no normal stress there; map one, as in --column"
    assert_refused(run(verb, "run.csv", *STEPS, "--stiffness", "0.1 MPa/um"), said)


@pytest.mark.parametrize(
    ("changes", "record", "words"),
    [
        ({"converged": False, "result": "still moving"}, "run.csv", ["did not converge"]),
        ({"schema": "jaxfric.gains/1"}, "run.csv", ["jaxfric.gains/1", "jaxfric fit"]),
        ({"friction_unit": "N"}, "run.csv", ["as a force [N]", "as a coefficient"]),
        ({"parameters": {}}, "run.csv", ["parameter f0 is missing"]),
        ({}, "none.csv", ["none.csv"]),
    ],
)
def test_models_that_predict_nothing(changes: dict, record: str, words: list[str]) -> None:
    written(Path("run.csv"), record_text())
    assert_refused(run("predict", slider_model(**changes), record), *words)
    assert sorted(p.name for p in Path().iterdir()) == ["fit.json", "run.csv"]


def test_options_that_would_not_be_used() -> None:
    written(Path("run.csv"), record_text())
    assert_refused(
        run("predict", slider_model(), "run.csv", "--zero-order-hold"),
        "--zero-order-hold would not be used",
    )
    axis = axis_model("a.json")
    assert_refused(run("predict", axis, "run.csv", "--stiffness", "1/um"), "--stiffness", "an axis")


def test_models_of_another_kind() -> None:
    t, x, _, force = moved(2.0)
    linear = axis_from_arrays(t, force, position=x)
    rotary = axis_from_arrays(t, force, position=x, coordinate="rotary")
    with pytest.raises(InputError, match=r"linear axis.*rotary one"):
        jaxfric.predict(axis_model("a.json"), rotary)
    with pytest.raises(InputError, match=r"a model of a slider; read .* with jaxfric.read, not"):
        jaxfric.predict(slider_model(), linear)
    with pytest.raises(InputError, match="stiffness would not be used"):
        jaxfric.predict("a.json", linear, stiffness="1/um")
    with pytest.raises(InputError, match=r"a Fit or a Loop; not a int"):
        load_model(3)
