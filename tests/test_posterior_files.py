"""A posterior from the command to its file, and from there to gains.

NUTS itself is in test_posterior.py, and on a record in a long test: here its draws are those of the
normal law, which compiles nothing.
"""

import builtins
import dataclasses
import json
import sys
import tomllib
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from command import STEPS, STIFFNESS, assert_refused, record_text, run, written
from scipy import stats
from scipy.signal import lfilter

import jaxfric
from jaxfric import InputError
from jaxfric.fitting.noise import noise_of
from jaxfric.fitting.solve import known_at
from jaxfric.plot.posterior import posterior_figure
from jaxfric.posterior import find_posterior, inference_data, write_netcdf
from jaxfric.posterior.inference_data import imported_arviz
from jaxfric.posterior.posterior import target_of
from jaxfric.posterior.sampler import Draws
from jaxfric.posterior.target import natural_of, point, target_of_problem
from jaxfric.report.posterior_text import posterior_lines
from jaxfric.saved import law_from_fit

h5py = pytest.importorskip("h5py")
try:
    arviz = imported_arviz()  # the workers of the tests do so at once
except InputError as missing:
    pytest.skip(str(missing), allow_module_level=True)

PRIORS = """[priors]
A = {normal = [0.010, 0.002]}
L = {lognormal = [20.0, 0.5], unit = "um"}
B = {uniform = [0, 0.05]}
"""
WIDE = tomllib.loads(PRIORS)["priors"]
FORCE = ("--normal-force", "500 N", "--mass", "2", "--velocity", "5 um/s", "--no-check")


def draws_of_the_normal_law(about, *, draws, chains, seed, progress, warmup=0):
    """A stand-in for NUTS."""
    u = np.random.default_rng(seed).standard_normal((chains, draws, len(about.y)))
    y = about.y + u @ about.root.T
    values = np.asarray(natural_of(about.target, jax.device_put(y.reshape(-1, len(about.y)))))
    density = -0.5 * np.sum(u**2, axis=-1)
    none, whole = np.zeros((chains, draws)), np.ones((chains, draws), int)
    values = values.reshape(chains, draws, -1)
    return Draws(values, y, density, none > 0, none + 0.9, whole, 3 * whole, none[:, 0] + 1)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The folder of one command, and what it said."""
    at = tmp_path_factory.mktemp("posterior")
    record, priors = written(at / "run.csv", record_text()), written(at / "priors.toml", PRIORS)
    with pytest.MonkeyPatch.context() as patch:
        module = sys.modules["jaxfric.posterior.posterior"]
        patch.setattr(module, "nuts", draws_of_the_normal_law)
        options = ("--prior", priors, "--draws", 400, "--chains", 3, "--out", at / "out")
        told = run("fit", record, *STIFFNESS, *STEPS, *options, "--details")
    return at, told


@pytest.fixture(scope="module")
def fitted(folder):
    at, _ = folder
    steps = STEPS[1]
    return jaxfric.fit(at / "run.csv", stiffness=STIFFNESS[1], steps=steps)


def test_the_command_writes_and_tells(folder):
    at, (code, out, err) = folder
    assert code == 0, err
    names = {f.name for f in (at / "out").iterdir()}
    assert {"fit.json", "posterior.nc", "posterior.png", "posterior.svg"} <= names
    assert not [name for name in names if name.endswith(".nc") and name != "posterior.nc"]
    for word in ("posterior", "lognormal(20, 0.5)", "flat", "R-hat", "3 chains of 400 draws"):
        assert word in out, word
    assert "A-B" in out and "held at the fit's estimate" in out


def test_the_file_is_inference_data_in_the_units_of_the_record(folder):
    at, _ = folder
    data = arviz.from_netcdf(at / "out" / "posterior.nc")
    found = data.posterior
    assert dict(found.sizes) == {"chain": 3, "draw": 400}
    assert set(found.data_vars) == {"f0", "A", "B", "L", "A_minus_B"}
    np.testing.assert_allclose(found["A_minus_B"], found["A"] - found["B"], atol=1e-15)
    assert found["L"].attrs["unit"] == "um" and found["A"].attrs["unit"] == "1"
    assert found["L"].attrs["prior"] == "lognormal(20, 0.5)"
    assert 1 < float(found["L"].mean()) < 100
    fit = json.loads((at / "out" / "fit.json").read_text())
    assert float(found["L"].mean()) == pytest.approx(1e6 * fit["parameters"]["L"]["value"], rel=0.1)
    assert found["L"].attrs["map"] == pytest.approx(found["L"].attrs["laplace_mean"], rel=0.05)
    assert float(found["A"].std()) == pytest.approx(found["A"].attrs["laplace_std"], rel=0.1)
    for name in ("lp", "diverging", "acceptance_rate", "tree_depth"):
        assert data.sample_stats[name].shape == (3, 400)
    assert len(data.observed_data["friction"]) == fit["record"]["rows"]
    assert data.constant_data["weight"].sum() == fit["record"]["rows"]
    about = found.attrs
    assert about["record"] == "run.csv" and about["law"] == "slip" and about["method"] == "NUTS"
    assert about["stiffness"] == pytest.approx(5e3) and about["converged"] == 1
    assert json.loads(about["noise"])["sigma"] == fit["noise"]["sigma"]
    assert arviz.rhat(found)["A"] < 1.01


def test_gains_take_its_draws_as_samples(folder, tmp_path, monkeypatch):
    at, _ = folder
    monkeypatch.setattr("jaxfric.cli.folder.Folder.draw", lambda *_: [])
    file = at / "out" / "posterior.nc"
    source = law_from_fit(file, normal_force=500.0, samples=50, seed=4)
    data = arviz.from_netcdf(file).posterior
    every = {n: 500 * np.ravel(data[n]) for n in ("A", "B", "f0")}
    every["L"] = 1e-6 * np.ravel(data["L"])
    samples = {n: np.ravel(getattr(source.samples, n)) for n in every}
    assert float(source.law.A) == samples["A"][0] == pytest.approx(500 * data["A"].attrs["map"])
    rows = [int(np.argmin(np.abs(every["A"] - a))) for a in samples["A"][1:]]
    assert len(set(rows)) == 50  # whole draws, each once
    for name, all_draws in every.items():
        np.testing.assert_allclose(samples[name][1:], all_draws[rows], rtol=1e-12)
    assert source.velocity == pytest.approx(2e-6) and source.seen == pytest.approx((2e-6, 1e-5))
    other = law_from_fit(file, normal_force=500.0, samples=50, seed=5)
    assert not np.array_equal(other.samples.A, source.samples.A)
    out = (
        "--out",
        tmp_path / "gains",
        "--samples",
        "5",
        "--margin",
        "stiffness=2",
        "--margin",
        "modulus=0",
    )
    code, text, err = run("gains", "--from", file, *FORCE, *out, "--details")
    assert code == 0, err
    assert "posterior (NUTS)" in text and "6 samples of the law" in text


def test_a_study_takes_its_draws_whole(folder, tmp_path, monkeypatch):
    """Each member has A, B and L of one draw; verbs that read JSON name the file as a posterior."""
    at, _ = folder
    monkeypatch.chdir(tmp_path)
    file = at / "out" / "posterior.nc"
    axes = f"""
    compute = ["margins"]
    outputs = ["k_cr"]
    [rig]
    V0 = "5 um/s"
    k_p = "1 MN/m"
    [samples]
    number = 64
    [axes]
    law = {{ from = "{file}", normal_force = "500 N" }}
    """
    code, _, err = run("study", written(Path("study.toml"), axes), "--out", "a.zarr")
    assert code == 0, err
    found, data = jaxfric.study.load("a.zarr"), arviz.from_netcdf(file).posterior
    every = {n: np.ravel(data[n]) * (1e-6 if n == "L" else 500) for n in ("A", "B", "L")}
    rows = [int(np.argmin(np.abs(every["A"] - a))) for a in found.A.values]
    assert len(set(rows)) > 50
    for name, column in every.items():
        np.testing.assert_allclose(found[name], column[rows], rtol=1e-12)
    np.testing.assert_allclose(found.k_cr, (found.B - found.A) / found.L, rtol=1e-9)
    assert_refused(run("predict", file, at / "run.csv"), "posterior.nc: a posterior", "not read")


def same_samples(one, other):
    for a, b in zip(jax.tree.leaves(one.samples), jax.tree.leaves(other.samples), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-12)


@pytest.mark.parametrize("drawn", [False, True])
def test_a_posterior_at_hand_gives_the_law_of_its_file(fitted, tmp_path, monkeypatch, drawn):
    monkeypatch.setattr(sys.modules["jaxfric.posterior.posterior"], "nuts", draws_of_the_normal_law)
    found = find_posterior(fitted, WIDE, draws=400 if drawn else None, seed=2)
    write_netcdf(found, tmp_path / "posterior.nc")
    for more in ({"seed": 3}, {"samples": 9}):
        here = law_from_fit(found, normal_force="500 N", **more)
        file = law_from_fit(tmp_path / "posterior.nc", normal_force=500.0, **more)
        same_samples(here, file)
        for name in ("velocity", "seen", "warnings"):
            assert getattr(here, name) == getattr(file, name)
    assert here.samples.A.shape == (10,) and float(here.law.A) == 500 * found.maximum()["A"]
    for kept in (1, 3):
        assert here.text.split()[kept] == file.text.split()[kept]


@pytest.mark.parametrize(("draws", "by"), [(None, "Laplace approximation"), (400, "NUTS")])
def test_the_line_of_a_posterior_is_that_of_its_draws(fitted, monkeypatch, draws, by):
    monkeypatch.setattr(sys.modules["jaxfric.posterior.posterior"], "nuts", draws_of_the_normal_law)
    found = find_posterior(fitted, WIDE, draws=draws)
    line = f"law, {by}: A-B = {found.to_pandas()['shown'].iloc[0]}, A = "
    assert line in found.summary()
    other = dataclasses.replace(found, converged=False)
    assert other.summary().splitlines()[1].endswith("; did not converge: it claims nothing")


@pytest.mark.parametrize(("end", "warns"), [(8.0, False), (0.0, True)])
def test_a_uniform_prior_that_ends_inside_asks_for_draws(fitted, monkeypatch, end, warns):
    """Draws are not of the normal law, so they have no such warning."""
    B = fitted.parameters["B"]
    priors = {"B": {"uniform": [0.0, B.value + end * B.std]}}
    found = find_posterior(fitted, priors)
    assert found.converged and len(found.warnings) == warns
    assert all("prior of B ends inside" in one for one in found.warnings)
    monkeypatch.setattr(sys.modules["jaxfric.posterior.posterior"], "nuts", draws_of_the_normal_law)
    assert not find_posterior(fitted, priors, draws=400).warnings


def test_gains_take_a_fit_and_a_posterior_at_hand(fitted, tmp_path):
    """Those of the files, by the same draws."""
    file = written(tmp_path / "fit.json", json.dumps(fitted.to_json()))
    found = find_posterior(fitted, WIDE)
    write_netcdf(found, tmp_path / "posterior.nc")
    task = {"velocity": "5 um/s", "mass": 2.0, "margin": "stiffness=2", "confidence": 0.9}
    for here, there in ((fitted, file), (found, tmp_path / "posterior.nc")):
        gains = jaxfric.find_gains(here, normal_force="500 N", **task)
        source = law_from_fit(there, normal_force=500.0)
        again = jaxfric.find_gains(source, **task)
        assert gains.kp == pytest.approx(again.kp, rel=1e-9) and gains.kp > 0
        assert gains.scenarios.laws.A.shape == (65,) and gains.warnings == again.warnings
        with pytest.raises(InputError, match=r"of .*run\.csv: .*coefficient.*normal_force=500"):
            jaxfric.find_gains(here, **task)
    with pytest.raises(InputError, match="'-1' is not positive"):
        law_from_fit(fitted, normal_force=-1)


def test_what_claims_nothing_at_hand_gives_no_gains(fitted):
    loose = dataclasses.replace(fitted, converged=False, result="still moving")
    with pytest.raises(InputError, match=r"Fit of .*run\.csv: this fit did not converge \(still"):
        jaxfric.find_gains(
            loose, normal_force=500, velocity=5e-6, mass=2.0, margin="stiffness=2, modulus=0"
        )
    found = dataclasses.replace(find_posterior(fitted, WIDE), converged=False, warnings=("why",))
    with pytest.raises(InputError, match=r"Posterior of run\.csv: .*claims nothing: .*why"):
        jaxfric.find_gains(
            found, normal_force=500, velocity=5e-6, mass=2.0, margin="stiffness=2, modulus=0"
        )


def test_a_slip_trend_among_the_draws_is_no_part_of_the_law(folder, tmp_path):
    at, _ = folder
    known = entry_of(at / "out" / "posterior.nc")["parameters"]
    trend = {"slip_trend.s": {"value": -3.0, "unit": "1/m", "determined": True}}
    entry = {"parameters": known | trend, "effects": ["slip_trend"]}
    copy = altered(at, tmp_path, entry=entry)
    with h5py.File(copy, "a") as file:
        draws = np.full(file["posterior"]["A"].shape, -3e-6)
        file["posterior"].create_dataset("slip_trend", data=draws).attrs["unit"] = "1/um"
    source = law_from_fit(copy, normal_force=500.0, samples=3)
    assert float(source.law.slip_trend) == 0 and not np.any(source.samples.slip_trend)
    assert "slip_trend is left out" in source.warnings[-1]
    assert source.warnings[-1].endswith("add 1.5e+03 N/m to k_p")


def entry_of(path):
    """The entry of a posterior that its law is read from."""
    with h5py.File(path) as file:
        return json.loads(file["posterior"].attrs["friction_law"])


def altered(at, to, entry=None, **attributes):
    """A copy of the posterior with other attributes, or in the entry of its law; None takes one
    away."""
    copy = to / "posterior.nc"
    copy.write_bytes((at / "out" / "posterior.nc").read_bytes())
    if entry is not None:
        kept = entry_of(copy) | entry
        attributes["friction_law"] = json.dumps({k: v for k, v in kept.items() if v is not None})
    with h5py.File(copy, "a") as file:
        for name, value in attributes.items():
            del file["posterior"].attrs[name]
            if value is not None:
                file["posterior"].attrs[name] = value
    return copy


@pytest.mark.parametrize(
    ("attributes", "words"),
    [
        (
            {"converged": 0, "entry": {"warnings": ["the chains disagree"]}},
            ["claims nothing", "disagree"],
        ),
        ({"converged": 0}, ["claims nothing", "no reason"]),
        ({"schema": "other/1"}, ["schema is 'other/1'"]),
        ({"schema": None}, ["no posterior of jaxfric"]),
        ({"entry": {"name": "slipp"}}, ["law 'slipp'"]),
        ({"friction_law": None}, ["damaged", "make it again with: jaxfric fit and a file of pr"]),
        ({"entry": {"friction_unit": None}}, ["friction_unit' is missing"]),
        ({"entry": {"warnings": "no list"}}, ["'warnings' is 'no list'"]),
    ],
)
def test_a_posterior_that_is_not_to_be_used_is_refused(folder, tmp_path, attributes, words):
    copy = altered(folder[0], tmp_path, **attributes)
    assert_refused(run("gains", "--from", copy, *FORCE), "posterior.nc", *words)


def test_a_file_that_is_no_posterior_is_refused(folder, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    nothing = written(Path("posterior.nc"), "text")
    assert_refused(run("gains", "--from", nothing, *FORCE), "posterior.nc", "damaged")
    assert_refused(run("gains", "--from", "none.nc", *FORCE), "none.nc", "no such file")
    copy = altered(folder[0], tmp_path)
    with h5py.File(copy, "a") as file:
        del file["posterior"]["L"]
    assert_refused(run("gains", "--from", copy, *FORCE), "L", "missing")
    copy = altered(folder[0], tmp_path)
    copy = copy.rename(tmp_path / "renamed.hdf")
    many = ("--samples", "1201")
    assert_refused(run("gains", "--from", copy, *FORCE, *many), "1200 draws")
    no_force = ("--mass", "2", "--velocity", "5 um/s")
    assert_refused(run("gains", "--from", copy, *no_force), "normal force")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--draws", "100"), ["--draws", "--prior"]),
        (("--seed", "1"), ["--seed", "--prior"]),
        (("--prior", "priors.toml", "--chains", "2"), ["--chains", "--draws 1000"]),
        (("--prior", "none.toml"), ["none.toml", "cannot be read"]),
        (("--prior", "priors.toml", "--draws", "0"), ["--draws is 0"]),
        (("--prior", "priors.toml", "--draws", "9", "--chains", "1"), ["--chains is 1"]),
        (("--prior", "outside.toml"), ["outside.toml", "outside the bounds"]),
    ],
)
def test_options_that_cannot_be_are_refused_before_anything_is_written(
    folder, tmp_path, monkeypatch, options, words
):
    monkeypatch.chdir(tmp_path)
    record = written(Path("run.csv"), record_text())
    written(Path("priors.toml"), PRIORS)
    written(Path("outside.toml"), "[priors]\nA = {uniform = [-0.02, -0.01]}")
    assert_refused(run("fit", record, *STIFFNESS, *STEPS, *options), *words)
    assert not list(tmp_path.glob("*/fit.json"))


def test_draws_that_are_not_relied_on_end_in_exit_code_1(folder, tmp_path, monkeypatch):
    at, _ = folder
    monkeypatch.setattr(sys.modules["jaxfric.posterior.posterior"], "nuts", draws_of_the_normal_law)
    options = ("--prior", at / "priors.toml", "--draws", "20", "--chains", "2")
    options += ("--out", tmp_path / "few")
    code, _, err = run("fit", at / "run.csv", *STIFFNESS, *STEPS, *options)
    assert code == 1
    assert "too few independent draws" in err and "claims nothing" in err
    assert_refused(run("gains", "--from", tmp_path / "few/posterior.nc", *FORCE), "claims nothing")


def test_flat_priors_have_the_fit_as_their_maximum(fitted):
    """Of white noise both minimise the same sum of squares, and their errors are the same."""
    assert not fitted.noise.parts
    found = find_posterior(fitted, {})
    assert found.converged and found.draws is None
    for name, one in found.approximation().items():
        if name == "A_minus_B":
            continue
        estimate = fitted.parameters[name]
        assert found.maximum()[name] == pytest.approx(estimate.value, abs=0.05 * estimate.std)
        assert one.std == pytest.approx(estimate.std, rel=0.05)
    table, about = found.to_pandas(), found.parameters
    assert table["std"].to_dict() == {name: one.std for name, one in about.items()}
    assert table.loc[["A_minus_B", "L"], "unit"].tolist() == [fitted.A_minus_B.unit, "m"]
    mean, _, std, unit = table.loc["L", "shown"].split()  # pandas shows one digit of metres
    assert float(mean) == pytest.approx(1e6 * about["L"].mean, abs=0.01) and unit == "µm"
    assert float(std) == pytest.approx(1e6 * about["L"].std, abs=0.01)
    assert table.columns[0] == "shown" and table.loc["A_minus_B", "shown"].startswith("−0.0037")
    data = inference_data(found)
    assert data.posterior.attrs["method"] == "Laplace" and "sample_stats" not in data


@pytest.fixture(scope="module")
def wandering(fitted):
    """A fit of the same record with noise whose memory is 3 s, ordinary."""
    random, memory = np.random.default_rng(7), np.exp(-1 / 3)
    noise = lfilter([2e-4], [1, -memory], random.standard_normal(2000))[-len(fitted.record) :]
    record = dataclasses.replace(fitted.record, friction=fitted.predicted + noise)
    found = jaxfric.fit(record, stiffness=STIFFNESS[1], steps=STEPS[1])
    assert found.noise.parts
    return found


def test_beside_a_posterior_stands_the_fit_of_its_weighting(wandering):
    """Whatever the prior, it is that of weighting="whitened", which finds its noise anew."""
    other = jaxfric.fit(
        wandering.record, stiffness=STIFFNESS[1], steps=STEPS[1], weighting="whitened"
    )
    found = find_posterior(wandering, WIDE | {"L": {"lognormal": [15.0, 0.01], "unit": "um"}})
    assert found.parameters["L"].mean == pytest.approx(15e-6, rel=0.02)
    for name, one in found.fitted().items():
        expected = other.A_minus_B if name == "A_minus_B" else other.parameters[name]
        assert one.determined
        assert one.value == pytest.approx(expected.value, abs=0.2 * expected.std), name
        assert one.std == pytest.approx(expected.std, rel=0.2), name
    table = found.to_pandas()
    assert table.attrs["fit"] == "whitened fit" and "  whitened fit" in found.summary()
    assert table["fit"].tolist() == [one.value for one in found.fitted().values()]
    labels = [text.get_text() for text in posterior_figure(found).legends[0].get_texts()]
    assert "whitened fit, no prior" in labels
    alone = find_posterior(other, WIDE)
    assert alone.whitened is None and alone.fit_name == "whitened fit"


def test_a_difference_of_weighting_is_not_laid_to_the_prior(wandering):
    found = find_posterior(wandering, WIDE)
    lines = " ".join(posterior_lines(found))
    assert "in the whitened fit too; the ordinary fit weighs all alike" in lines
    for errors, told in ((0.9, ()), (1.1, ("L",))):
        own = found.ordinary()
        L = own["L"]
        moved = own | {"L": L._replace(value=L.value - errors * L.std, std=0.5 * L.std)}
        other = dataclasses.replace(found, whitened=moved)
        assert other.reweighted() == told
        sentence = "weighted, not from a prior; weighting='whitened'"
        assert (sentence in " ".join(posterior_lines(other))) == bool(told)
    (last,) = [line for line in posterior_lines(other) if "not from a prior" in line]
    assert last.startswith(f"the ordinary fit has L = {1e6 * L.value:.1f}"[:-1]) and "µm" in last
    loose = own | {"L": moved["L"]._replace(determined=False)}
    assert dataclasses.replace(found, whitened=loose).reweighted() == ()


def test_a_strong_prior_is_the_posterior(fitted):
    """Of A: a width of a hundredth of the record's error leaves nothing else."""
    A = fitted.parameters["A"]
    mean = A.value + A.std
    found = find_posterior(fitted, {**WIDE, "A": {"normal": [mean, A.std / 100]}})
    about = found.approximation()["A"]
    assert about.mean == pytest.approx(mean, abs=0.02 * A.std)
    assert about.std == pytest.approx(A.std / 100, rel=0.02)


def test_the_log_posterior_of_coloured_noise_is_that_of_its_covariance(fitted):
    """r^T Sigma^-1 r with the matrix itself, and its gradient by differences."""
    share, memory, sigma = 0.4, 3.0, 1.3
    problem = fitted.solved.problem
    noise = noise_of(sigma, share, np.array([memory, np.inf, np.inf]))
    target = target_of_problem(problem, noise, target_of(fitted, {})[0].priors)
    rows = len(fitted.record)
    t = np.asarray(problem.time)[:rows]
    same = np.exp(-np.abs(t[:, None] - t) / memory)
    inverse = np.linalg.inv(sigma**2 * (share * same + (1 - share) * np.eye(rows)))

    def expected(z):
        r = known_at(problem.plain(), z).residual[:rows]
        return -0.5 * r @ inverse @ r

    z = np.asarray(fitted.solved.solution.z) + np.array([0.02, 0.05, -0.02, 0.04])
    at = point(target, jnp.asarray(z))
    assert float(at.log_density) == pytest.approx(expected(z), rel=1e-6)
    for i, e in enumerate(np.eye(4)):
        slope = (expected(z + 1e-3 * e) - expected(z - 1e-3 * e)) / 2e-3
        assert float(at.gradient[i]) == pytest.approx(slope, rel=2e-2, abs=1e-3)


def test_a_trial_that_fails_is_finite_and_worse_than_any(fitted):
    """L of a nanometre and a B of ten: no simulation gets through."""
    for noise in (noise_of(1.0), noise_of(1.0, 0.9, np.array([50.0, np.inf, np.inf]))):
        target = target_of_problem(fitted.solved.problem, noise, target_of(fitted, {})[0].priors)
        z = np.asarray(fitted.solved.solution.z)
        bad = np.array([z[0], z[1], 1e4, np.log(1e-9)])
        at = point(target, jnp.asarray(bad))
        assert np.isfinite(at.log_density) and float(at.log_density) < -1e7
        assert np.all(np.isfinite(at.gradient))


def test_what_neither_record_nor_prior_fixes_has_no_posterior(fitted, monkeypatch):
    module = sys.modules["jaxfric.posterior.posterior"]
    monkeypatch.setattr(module, "determined", lambda *_: [True, True, True, False])
    found = find_posterior(fitted, {})
    assert not found.converged and "determines L" in found.warnings[0] and not found.found
    assert find_posterior(fitted, WIDE).converged


def test_a_fit_without_its_numbers_has_no_posterior(fitted):
    with pytest.raises(InputError, match="has no posterior"):
        find_posterior(dataclasses.replace(fitted, converged=False, result="no"), {})
    with pytest.raises(InputError, match="read from a file"):
        find_posterior(dataclasses.replace(fitted, solved=None), {})


@pytest.fixture(scope="module")
def of_L(fitted):
    """A posterior of a prior of L alone, and its figure."""
    found = find_posterior(fitted, {"L": WIDE["L"]})
    return found, posterior_figure(found)


def test_the_figure_has_a_panel_for_every_pair(fitted, of_L):
    found, figure = of_L
    words = [text.get_text() for text in figure.axes[12].texts]
    assert words == ["prior: flat in ln A"] == [f"prior: {found.priors[1].text()}"]
    shown = [axis for axis in figure.axes if axis.axison]
    assert len(figure.axes) == 25 and len(shown) == 15
    assert figure.axes[20].get_xlabel() == "A − B" and figure.axes[24].get_xlabel() == "L [µm]"
    assert figure.axes[15].get_ylabel() == "B"
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels == ["fit, no prior", "Laplace approximation", "its 95 % ellipse", "prior"]
    x, density = figure.axes[12].lines[0].get_data()
    A = fitted.parameters["A"]
    np.testing.assert_allclose(density, stats.norm(A.value, A.std).pdf(x), rtol=1e-12)


@pytest.mark.long
def test_nuts_and_the_normal_law_agree_on_a_record(fitted):
    """Within 15 %: the likelihood of a clean step is near its quadratic form."""
    found = find_posterior(fitted, {}, draws=600, chains=2)
    assert found.converged, found.warnings
    about = found.approximation()
    for name, one in found.sampled().items():
        assert one.std == pytest.approx(about[name].std, rel=0.15), name


def test_points_of_a_pair_lie_about_its_ellipse(of_L) -> None:
    """Every second of 4096 draws of a Sobol sequence was half of one parameter's range."""
    found, figure = of_L
    draws = np.log(found.laplace.draws[:, list(found.names).index("A")])
    axes = np.array(figure.axes).reshape(len(found.names) + 1, -1)
    row = 1 + list(found.names).index("A")
    points = np.log(axes[row, 0].lines[0].get_ydata())
    assert abs(points.mean() - draws.mean()) < 0.1 * draws.std()
    assert points.std() == pytest.approx(draws.std(), rel=0.1)
    for k in range(row + 1, len(axes)):
        x = axes[k, row].lines[0].get_xdata()
        assert abs(np.log(x).mean() - draws.mean()) < 0.1 * draws.std()
    for k in range(1, len(axes)):
        x, y = axes[k, 0].lines[0].get_data()
        contour = axes[k, 0].lines[1].get_data()
        for some, edge in zip((x, y), contour, strict=True):
            middle, half = (edge.max() + edge.min()) / 2, (edge.max() - edge.min()) / 2
            assert abs(np.mean(some) - middle) < 0.05 * half
            assert np.std(some) == pytest.approx(half / np.sqrt(5.991), rel=0.1)


@pytest.mark.parametrize(("failures", "works"), [(0, True), (2, True), (3, False)])
def test_arviz_is_asked_again_where_another_process_writes_its_note(failures, works, monkeypatch):
    left, plain = [failures], builtins.__import__

    def racing(name, *args, **kwargs):
        if name == "arviz" and left[0]:
            left[0] -= 1
            raise FileNotFoundError("daily_warning.tmp -> daily_warning")
        return plain(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", racing)
    if works:
        assert imported_arviz() is arviz
    else:
        with pytest.raises(InputError, match=r"cannot be imported.*daily_warning"):
            imported_arviz()
