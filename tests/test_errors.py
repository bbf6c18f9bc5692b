"""What a message proposes: options in the command, arguments in Python."""

import ast
import re
from pathlib import Path

import jax
import pytest
from command import record_text

from jaxfric.errors import InputError, did_you_mean, either, option, words_of_the_command

ROOT = Path(__file__).parents[1] / "jaxfric"


@pytest.mark.parametrize(
    ("asked", "command", "python"),
    [
        (("drop-bad",), "--drop-bad", "drop_bad=True"),
        (("steps", "0 s: 2 um/s, 60 s: 20 um/s"), "--steps '0 s: 2 um/s, 60 s: 20 um/s'",
         'steps="0 s: 2 um/s, 60 s: 20 um/s"'),
        (("stiffness", "1.6e-3/um"), "--stiffness 1.6e-3/um", 'stiffness="1.6e-3/um"'),
        (("fit-stiffness",), "--fit-stiffness", "fit_stiffness=True"),
        (("column", "position=NAME [0.8 rad]"), "--column 'position=NAME [0.8 rad]'",
         'columns={"position": "NAME [0.8 rad]"}'),
        (("column", "disturbance=none"), "--column disturbance=none",
         'columns={"disturbance": "none"}'),
        (("column", "normal_stress=none", "friction=shear [0.2]"),
         "--column normal_stress=none --column 'friction=shear [0.2]'",
         'columns={"normal_stress": "none", "friction": "shear [0.2]"}'),
        (("column",), "--column", "columns"),
        (("include",), "--include", "include"),
        (("include", "slip_trend"), "--include slip_trend", 'include="slip_trend"'),
        (("samples", 0), "--samples 0", "samples=0"),
        (("flip-sign", "force"), "--flip-sign force", 'flip_sign="force"'),
        (("velocity-gain",), "--velocity-gain", "velocity_gain"),
        (("from",), "--from", "the start of record.window()"),
        (("to", "3 s"), "--to '3 s'", "the stop of record.window() (3 s)"),
    ],
)  # fmt: skip
def test_an_option_is_an_argument_in_python(asked: tuple, command: str, python: str) -> None:
    assert option(*asked) == python
    with words_of_the_command():
        assert option(*asked) == command
        assert either("read it", "read()") == "read it"
    assert option(*asked) == python
    assert either("read it", "read()") == "read()"


def test_no_message_but_of_the_command_writes_options_itself() -> None:
    """Texts in the package that name an option, without docstrings and lines of commands."""
    found = []
    for path in sorted(ROOT.rglob("*.py")):
        if path.parent.name in ("cli", "report", "plot", "words") or path.name == "errors.py":
            continue
        tree = ast.parse(path.read_text(encoding="utf-8"))
        alone = {id(n.value) for n in ast.walk(tree) if isinstance(n, ast.Expr)}
        either_of = [n for n in ast.walk(tree) if isinstance(n, ast.Call) and is_either(n)]
        alone |= {id(arg) for n in either_of for arg in n.args}
        for node in ast.walk(tree):
            text = node.value if isinstance(node, ast.Constant) else None
            if isinstance(text, str) and id(node) not in alone and re.search(r"--[a-z]{2}", text):
                found.append((f"{path.relative_to(ROOT)}:{node.lineno}", text))
    commands = ("jaxfric run", "jaxfric study", "dask worker", "--nthreads", " --out ")
    assert [(place, text) for place, text in found if not any(c in text for c in commands)] == []


def is_either(call: ast.Call) -> bool:
    return isinstance(call.func, ast.Name) and call.func.id == "either"


def test_the_name_that_was_meant() -> None:
    known = ["time", "load_point_displacement", "friction", "k_p"]
    end = "There are: time, load_point_displacement, friction, k_p"
    assert did_you_mean("frictoin", known) == f"; did you mean 'friction'? {end}"
    assert did_you_mean("Load-Point Displ", known, listed=False) == (
        "; did you mean 'load_point_displacement'?"
    )
    joints = ["a1 position", "a2 position", "c2 position"]
    assert did_you_mean("position", joints, listed=False) == "; did you mean 'a1 position'?"
    assert did_you_mean("KP", known, listed=False) == "; did you mean 'k_p'?"
    assert did_you_mean("%", known) == f"; t{end[1:]}"
    assert did_you_mean("voltage", known, listed=False) == "" == did_you_mean("x", [], listed=False)
    # as alike as 0.5 is not enough: 2 * 2 letters of 8
    assert did_you_mean("tixy", ["time"], listed=False) == ""


def test_what_a_notebook_writes_first(tmp_path: Path, monkeypatch) -> None:
    """A path for a record, an id for a list of ids, text for a quantity: they work or are told."""
    import jaxfric
    from jaxfric.effects import ids_of
    from jaxfric.records.given import as_axis_record, as_record

    assert ids_of("thermal") == ("thermal",) == ids_of(["thermal", "thermal"])
    assert ids_of("thermal, gain") == ("thermal", "gain") and ids_of("") == ids_of(()) == ()
    monkeypatch.chdir(tmp_path)
    Path("run.csv").write_text(record_text())
    assert len(as_record("run.csv")) == len(as_record(jaxfric.read("run.csv"))) == 91
    with pytest.raises(InputError, match=r"record is a dict; give the path of a file, or a record"):
        as_record({})
    with pytest.raises(InputError, match=r"record is a list.*read_axis\(path\)"):
        as_axis_record([1.0])
    with pytest.raises(InputError, match=r"no file|no such file"):
        jaxfric.close_axis_loop("none.csv")
    with pytest.raises(
        InputError, match=r"effect 'thermol' does not exist; did you mean 'thermal'"
    ):
        jaxfric.close_loop("run.csv", stiffness="5e-3/um", exclude="thermol")
    source = jaxfric.law_from_parameters("slip", "A=1 N, B=3 N, L=1 mm, V0=2 mm/s")
    with pytest.raises(InputError, match=r"velocity: 'kg' is not a unit of m/s"):
        jaxfric.find_gains(source, velocity="2 kg", mass="1..3 kg", margin="modulus=0.5")
    with pytest.raises(InputError, match=r"the law is a dict; give a Fit, a Posterior"):
        jaxfric.gain_schedule(
            {}, velocity=(1e-3, 2e-3), mass=None, margin={"modulus": 0, "stiffness": 1.5}
        )
    with pytest.raises(InputError, match=r"the law is a dict; give a Fit, a Posterior"):
        jaxfric.find_gains({}, velocity="2 mm/s", mass=None, margin="modulus=0.5")
    with pytest.raises(InputError, match=r"the law is a dict; give a Fit, a Posterior"):
        jaxfric.law_from_fit({})
    with pytest.raises(InputError, match=r"normal_force would not be used"):
        jaxfric.find_gains(source, normal_force=5.0, velocity=2e-3, mass=2.0, margin="modulus=0.5")
    for wrong in (source, {}):
        with pytest.raises(InputError, match=rf"a {type(wrong).__name__};.*law_from_fit\(it, n"):
            jaxfric.stability.analysis.study(wrong, [2e-3])
    with pytest.raises(InputError, match=r"the law is a LawSource;.*\)\.law"):
        jaxfric.linearise(jaxfric.Rig(jaxfric.Inertial(2.0, 3e3, 0.5), source), 2e-3)
    with pytest.raises(InputError, match=r"margin 'modulus' is not NAME=NUMBER"):
        jaxfric.find_gains(source, velocity="2 mm/s", mass="1..3 kg", margin="modulus")
    rig = jaxfric.Rig(jaxfric.Inertial(2.0, 3e3, 0.5), source.law)
    one, two = (jax.tree.leaves(jaxfric.linearise(rig, V)) for V in ("2 mm/s", 2e-3))
    assert len(one) > 3 and all((a == b).all() for a, b in zip(one, two, strict=True))
