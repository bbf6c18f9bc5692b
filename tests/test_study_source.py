"""A store knows the function that made it: its body, what it refers to, and the versions below."""

import functools
import json
import subprocess
import sys
import types

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from command import written

pytest.importorskip("zarr")
pytest.importorskip("xarray")

from jaxfric import InputError, study
from jaxfric.study.source import fingerprint, package_source

GRID = study.Grid((study.linspace("x", 0.0, 3.0, 4),))

BASE = """
import numpy as np
import jax.numpy as jnp
FACTOR = 2.0
TABLE = np.arange(3.0)
def helper(x, power=1):
    return x**power
class Law:
    rate = 1.0
    table = {"gain": np.ones(2), "range": (1.0, 2.0)}
    def force(self, x):
        return helper(x) * FACTOR
def outer(c):
    def f(p):
        "What it does."
        return {"value": Law().force(p["x"]) + c + TABLE[1]}  # a remark
    return f
made = outer(OUTER)
"""


def made(text=BASE, outer=1.0):
    """The function of a source text, in a module of its own."""
    module = types.ModuleType("own")
    exec(compile(text.replace("OUTER", repr(outer)), "own.py", "exec"), vars(module))
    return module.made


CHANGES = {
    "body": ('p["x"]) + c', 'p["x"]) - c'),
    "constant": ("TABLE[1]", "TABLE[2]"),
    "name": ("Law().force(p", "Law().force(2 * p"),
    "global": ("FACTOR = 2.0", "FACTOR = 3.0"),
    "array": ("arange(3.0)", "arange(4.0)"),
    "helper": ("x**power", "x**power + 1"),
    "default": ("power=1", "power=2"),
    "method": ("* FACTOR", "/ FACTOR"),
    "class": ("rate = 1.0", "rate = 2.0"),
    "array of a class": ("np.ones(2)", "np.zeros(2)"),
    "tuple of a class": ("(1.0, 2.0)", "(1.0, 3.0)"),
    "function of a library": ("helper(x) * F", "jnp.sin(x) * F"),
}


@pytest.mark.parametrize("change", CHANGES)
def test_what_changes_a_number_changes_the_fingerprint(change):
    old, new = CHANGES[change]
    assert old in BASE
    assert fingerprint(made(BASE.replace(old, new))) != fingerprint(made())


def test_a_closure_counts_and_a_comment_does_not():
    assert fingerprint(made(outer=2.0)) != fingerprint(made())
    assert fingerprint(made(BASE.replace("a remark", "another"))) == fingerprint(made())


def scaled(p, factor=1.0):
    return {"value": factor * p["x"]}


def test_wrapped_functions():
    partial = functools.partial(scaled, factor=2.0)
    assert fingerprint(partial) != fingerprint(functools.partial(scaled, factor=3.0))
    assert fingerprint(jax.jit(made())) == fingerprint(jax.jit(made()))
    other = BASE.replace("+ c", "- c")
    assert fingerprint(jax.jit(made())) != fingerprint(jax.jit(made(other)))
    assert fingerprint(jnp.asarray([1.0, 2.0])) != fingerprint(jnp.asarray([1.0, 3.0]))


@pytest.mark.parametrize("wrap", [lambda f: f, functools.partial])
def test_a_function_that_travels_keeps_its_fingerprint(wrap):
    """By value, as that of a script or a notebook does."""
    cloudpickle = pytest.importorskip("cloudpickle")
    function = wrap(made())
    assert fingerprint(cloudpickle.loads(cloudpickle.dumps(function))) == fingerprint(function)


def test_what_a_module_holds_now_counts_if_it_is_read(tmp_path, monkeypatch):
    """Not its text alone, which says what it held first."""
    (tmp_path / "config").mkdir()
    written(tmp_path / "config" / "__init__.py", "unread = 1.0\n")
    written(tmp_path / "config" / "table.py", "import numpy as np\nK = np.ones(2)\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    text = "import config.table\ndef made(p):\n    return {'value': config.table.K[0] * p['x']}\n"
    function = made(text)
    import config.table  # ty: ignore[unresolved-import]

    before = fingerprint(function)
    config.unread = 2.0
    assert fingerprint(function) == before
    config.table.K = np.zeros(2)
    assert fingerprint(function) != before


def test_an_installed_package_counts_by_its_version_and_files(tmp_path):
    """One that `versions` does not list, as the user's own."""
    folder, about = tmp_path / "site-packages", "own_pkg-1.0.dist-info"
    (folder / about).mkdir(parents=True)
    written(folder / "own_pkg.py", "def value(p):\n    return {'value': p['x']}\n")
    code = "import sys; sys.path.insert(0, sys.argv[1]); import own_pkg; from jaxfric.study.source"
    code += " import fingerprint; print(fingerprint(own_pkg.value))"
    found = []
    for release, checksum in (("1.0", "aa"), ("1.0", "aa"), ("1.1", "aa"), ("1.1", "bb")):
        written(folder / about / "METADATA", f"Name: own_pkg\nVersion: {release}\n")
        written(folder / about / "RECORD", f"own_pkg.py,sha256={checksum},9\n")
        called = [sys.executable, "-c", code, str(folder)]
        found.append(subprocess.run(called, capture_output=True, text=True, check=True).stdout)
    assert found[0] == found[1] and len(set(found)) == 3


def test_another_process_finds_the_same(tmp_path):
    """Sets of words have another order in every process."""
    text = BASE.replace("FACTOR = 2.0", 'FACTOR = 2.0; WORDS = {"a", "b", "c", "d"}')
    text = text.replace("+ TABLE[1]", '+ ("a" in WORDS) + (p["x"] in {"u", "v", "w"})')
    (tmp_path / "own.py").write_text(text.replace("OUTER", "1.0"))
    code = "import own; from jaxfric.study.source import fingerprint; print(fingerprint(own.made))"
    here = str(tmp_path)
    found = {
        subprocess.run(
            [sys.executable, "-c", code], cwd=here, capture_output=True, text=True, check=True
        ).stdout
        for _ in range(2)
    }
    assert len(found) == 1 and len(found.pop().strip()) == 16


def test_a_store_is_that_of_its_function(tmp_path):
    """The old numbers of a function of the same name are not handed out as the new ones."""
    for path, description in ((tmp_path / "a", None), (tmp_path / "b", {"mine": 1})):
        study.run(made(), GRID, path, description=description)
        again = study.run(made(), GRID, path, description=description)
        assert again["value"].shape == (4,)
        for other in (made(BASE.replace("+ c", "- c")), made(outer=2.0)):
            with pytest.raises(InputError, match="which differs in source of the function;"):
                study.run(other, GRID, path, description=description)


def test_a_store_is_that_of_its_versions(tmp_path):
    path = tmp_path / "a"
    study.run(made(), GRID, path)
    table = path / "zarr.json"
    content = json.loads(table.read_text())
    content["attributes"]["versions"]["scipy"] = "1.2.3"
    table.write_text(json.dumps(content))
    with pytest.raises(InputError, match=r"begun with other versions: scipy 1\.2\.3 -> .*another"):
        study.run(made(), GRID, path)
    told = []
    found = study.run(made(), GRID, path, other_versions=True, tell=told.append)
    assert np.isfinite(found["value"]).all() and any("scipy 1.2.3" in line for line in told)
    assert found.attrs["versions"]["code of jaxfric"] == package_source()
