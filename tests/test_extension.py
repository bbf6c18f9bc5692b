"""A margin and a computation of a study, each added by a module of its own and one entry."""

import importlib
import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import jax.numpy as jnp
import numpy as np
import pytest
from command import run, written

pytest.importorskip("zarr")
pytest.importorskip("xarray")

import jaxfric as jf
from jaxfric import study
from jaxfric.laws import REGISTRY
from jaxfric.members import run_study
from jaxfric.members.computations import COMPUTATIONS
from jaxfric.members.spec import Computation
from jaxfric.rig.friction import AbstractEvolution
from jaxfric.stability.margin_table import MARGINS

PARAMETERS = "A=1 N, B=3 N, L=1 mm, V0=2 mm/s"
RIG = """
[rig]
law = "slip"
A = "1 N"
B = "3 N"
L = "1 mm"
m = "2 kg"
V0 = "2 mm/s"
[axes]
k_p = { values = ["1 kN/m", "3 kN/m"] }
"""

HALVINGS = '''
"""How often a second the slowest mode halves."""

import jax.numpy as jnp

from jaxfric.stability.margin_table import MARGINS, Margin


def halvings(of):
    return -jnp.max(of.poles.real) / jnp.log(2.0)


MARGINS["halvings"] = Margin(
    "1/s", 0.0, "halvings of the slowest mode", "own_margin:halvings", 40.0, needs_poles=True
)
'''

FALL = '''
"""How much steady friction falls from V0 to twice V0, or to a factor in the study's table."""

import jax

from jaxfric.members.computations import COMPUTATIONS
from jaxfric.members.sliders import sliders_of
from jaxfric.members.spec import Computation, StudyPart
from jaxfric.tables import refuse_unknown
from jaxfric.stability.analysis import steady_point
from jaxfric.study import Output


def make_fall(spec, table, where):
    refuse_unknown(table, ("factor",), where)
    sliders = sliders_of(spec)

    def member(p):
        law = sliders.law_of(p)
        ends = [steady_point(law, f * p["V0"]).force for f in (1.0, table.get("factor", 2.0))]
        return {"fall": ends[0] - ends[1]}

    def function(varied):
        return jax.vmap(member)(sliders.parameters(varied))

    return StudyPart(function, (Output("fall", "N", "fall of steady friction"),))


COMPUTATIONS["fall"] = Computation(make_fall, needs=("V0",))
'''

Add = Callable[[str, str], ModuleType]


@pytest.fixture
def add(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Add]:
    """Import a module written beside the test, whose entries are gone after it."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setenv(
        "PYTHONPATH", os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
    )
    before = [(table, dict(table)) for table in (MARGINS, COMPUTATIONS)]

    def imported(name: str, text: str) -> ModuleType:
        written(tmp_path / f"{name}.py", text)
        return importlib.import_module(name)

    yield imported
    for name in ("own_margin", "own_computation"):
        sys.modules.pop(name, None)
    for table, entries in before:
        table.clear()
        table.update(entries)


def slowest_halving(k_p: float, k_v: float = 0.0) -> float:
    """By NumPy, from the equation of motion: m V' = -k_p x - k_v V - df, slip law."""
    A, B, L, V, m = 1.0, 3.0, 1e-3, 2e-3, 2.0
    # df = A/V dV + dtheta, dtheta' = -(V/L)(dtheta + B/V dV)
    matrix = [
        [0.0, 1.0, 0.0],
        [-k_p / m, -(k_v + A / V) / m, -1.0 / m],
        [0.0, -B / L, -V / L],
    ]
    return -np.linalg.eigvals(np.asarray(matrix)).real.max() / np.log(2.0)


KNOWN = {
    "stiffness": ("1", 1.0, np.inf),
    "decay": ("1/s", 0.0, np.inf),
    "damping": ("1", 0.0, 1.0),
    "modulus": ("1", 0.0, 1.0),
    "gain": ("1", 1.0, np.inf),
    "phase": ("rad", 0.0, np.pi),
    "delay": ("s", 0.0, np.inf),
}
"""Unit, limit of stability and largest value of every margin."""


def test_units_limits_and_ranges_of_margins() -> None:
    assert {n: (m.unit, m.limit, m.highest) for n, m in MARGINS.items()} == KNOWN
    assert [name for name, one in MARGINS.items() if one.zero] == ["decay"]


def test_a_margin_is_one_entry(add: Add, tmp_path: Path) -> None:
    """`margin`, `jaxfric stability`, `gains` and `study` have it, and no other file is touched."""
    add("own_margin", HALVINGS)
    law = jf.law_from_parameters("slip", PARAMETERS).law
    slider = jf.linearise(jf.Rig(jf.Inertial(2.0, 3e3, 0.0), law), 2e-3)
    assert float(jf.stability_margin("halvings", slider)) == pytest.approx(
        slowest_halving(3e3), rel=1e-6
    )
    where = ["--law", "slip", "--parameters", PARAMETERS, "--mass", "2", "--velocity", "2 mm/s"]
    outcome = run("stability", *where, "--kp", "3000 N/m", "--json")
    assert outcome.code == 0, outcome.err
    found = json.loads(outcome.out)["margins"]["halvings"]
    assert found["unit"] == "1/s" and found["value"] == pytest.approx(slowest_halving(3e3), 1e-6)
    gains = jf.find_gains(law, velocity=[2e-3], mass=[2.0], margin={"modulus": 0, "halvings": 1.5})
    assert slowest_halving(gains.kp, gains.kv) == pytest.approx(1.5, rel=1e-5)
    assert gains.margins["halvings"].value == pytest.approx(1.5, rel=1e-5)
    refused = run("gains", *where, "--margin", "halvings=41")
    assert refused.code == 2 and "between 0 and 40 (unit 1/s)" in refused.err
    text = 'compute = ["margins"]\noutputs = ["halvings"]\n' + RIG
    outcome = run("study", written(tmp_path / "s.toml", text))
    assert outcome.code == 0, outcome.err
    kept = study.load("s.zarr")
    assert kept.halvings.attrs["units"] == "1/s" and "slowest mode" in kept.halvings.long_name
    expected = [slowest_halving(k) for k in (1e3, 3e3)]
    np.testing.assert_allclose(kept.halvings, expected, rtol=1e-6)
    code = "import own_margin; from jaxfric.cli.app import _run; _run(['gains', '--help-all'])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "halvings (1/s)" in " ".join(done.stdout.replace("│", " ").split())


def test_a_computation_is_one_entry(add: Add, tmp_path: Path) -> None:
    """With a table of its own in study.toml, beside others and by itself."""
    add("own_computation", FALL)
    rig = RIG.replace('V0 = "2 mm/s"', "").replace("k_p = {", "V0 = {").replace("kN/m", "mm/s")
    text = 'compute = ["fall"]\n' + rig + "[fall]\nfactor = 4.0\n"
    outcome = run("study", written(tmp_path / "s.toml", text))
    assert outcome.code == 0, outcome.err
    kept = study.load("s.zarr")
    # f_ss = f0 + (A - B) ln(V/V_ref), but for rest: exp(-100) here
    np.testing.assert_allclose(kept.fall, 2 * np.log(4.0), rtol=1e-9)
    assert kept.fall.attrs["units"] == "N" and kept.fall.dims == ("V0",)
    wrong = text.replace("factor", "faktor")
    outcome = run("study", written(tmp_path / "t.toml", wrong))
    assert outcome.code == 2 and "t.toml [fall]: no key 'faktor'" in outcome.err
    both = 'compute = ["fall", "margins"]\noutputs = ["decay", "fall"]\n' + RIG
    outcome = run("study", written(tmp_path / "b.toml", both))
    assert outcome.code == 0, outcome.err
    kept = study.load("b.zarr")
    np.testing.assert_allclose(kept.fall, 2 * np.log(2.0), rtol=1e-9)
    expected = [np.log(2.0) * slowest_halving(k) for k in (1e3, 3e3)]
    np.testing.assert_allclose(kept.decay, expected, rtol=1e-6)


class HalfRate(AbstractEvolution):
    """As the slip law, over twice the distance."""

    def rate(self, r, theta, B, L, V0):
        return -0.5 * r * V0 / L * (theta + B * jnp.log(r))

    def steady_state(self, r, B, V0):
        return -B * jnp.log(r)


class QuarterRate(HalfRate):
    """As the slip law, over four times the distance."""

    def rate(self, r, theta, B, L, V0):
        return -0.25 * r * V0 / L * (theta + B * jnp.log(r))


def test_a_store_is_that_of_the_entries_it_uses(
    add: Add, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Numbers of an entry that was replaced are not handed out as those of the new one."""
    monkeypatch.setitem(REGISTRY, "half", HalfRate())
    margin, fall = add("own_margin", HALVINGS), add("own_computation", FALL)
    names = 'compute = ["fall", "margins"]\noutputs = ["halvings", "fall"]\n'
    text = written(tmp_path / "s.toml", names + RIG.replace('"slip"', '"half"'))
    run_study(text, "s.zarr")
    margin.tripled = lambda of: 3 * margin.halvings(of)
    for table, name, entry, words in (
        (REGISTRY, "half", QuarterRate(), "law half"),
        (
            MARGINS,
            "halvings",
            replace(MARGINS["halvings"], function="own_margin:tripled"),
            "margin",
        ),
        (COMPUTATIONS, "fall", Computation(lambda *given: fall.make_fall(*given)), "compute fall"),
    ):
        with monkeypatch.context() as here:
            here.setitem(table, name, entry)
            with pytest.raises(jf.InputError, match=f"another study, which differs in {words}"):
                run_study(text, "s.zarr")
    monkeypatch.setitem(REGISTRY, "unused", QuarterRate())
    assert run_study(text, "s.zarr").sizes["k_p"] == 2
