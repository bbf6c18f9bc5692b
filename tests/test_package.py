"""The package from outside: quiet, quick, a known list of names, every one documented."""

import importlib
import importlib.util
import inspect
import operator
import os
import pkgutil
import subprocess
import sys
from importlib.metadata import version

import pytest

import jaxfric
from jaxfric import lazy
from jaxfric.cli import xla

NAMES = [
    "AgeingEvolution",
    "AxisRecord",
    "Dahl",
    "Estimate",
    "Feedforward",
    "FirstOrderDrive",
    "Fit",
    "GaussianStribeck",
    "GeneralStribeck",
    "HessSoom",
    "IdealDrive",
    "IdealSensor",
    "Inertial",
    "InitialState",
    "InputError",
    "LinearSlider",
    "LogarithmicEffect",
    "Loop",
    "PiecewiseVelocity",
    "Prediction",
    "QuasiStatic",
    "RESULTS",
    "RateState",
    "Record",
    "RegularisedEffect",
    "Rig",
    "SlipEvolution",
    "Trajectory",
    "VelocitySteps",
    "cache_compiled",
    "check_gains",
    "close_axis_loop",
    "close_loop",
    "close_steady_loop",
    "compare_laws",
    "critical_stiffness",
    "feedforward",
    "find_gains",
    "find_posterior",
    "find_steps",
    "fit",
    "fit_many",
    "from_arrays",
    "gain_schedule",
    "jump_start",
    "law_from_fit",
    "law_from_parameters",
    "law_from_table",
    "linearise",
    "minimum_gains",
    "predict",
    "read",
    "read_axis",
    "read_steady",
    "read_table",
    "rest_start",
    "rice_ruina_criterion",
    "simulate",
    "simulate_delay",
    "stability_margin",
    "step_start",
    "velocity_start",
]


def python(code):
    """What a process says that knows of no cache."""
    own = {name: x for name, x in os.environ.items() if name != "JAX_COMPILATION_CACHE_DIR"}
    command = [sys.executable, "-W", "error", "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=own)
    assert done.returncode == 0, done.stderr
    return done.stdout, done.stderr


def test_a_cache_of_what_is_compiled(tmp_path):
    code = f"""
import jax, jaxfric
folder = jaxfric.cache_compiled({str(tmp_path / "kept")!r})
jax.jit(lambda x: x + 2)(1.0)
print(len(list(folder.iterdir())) > 0, jax.config.jax_compilation_cache_dir == str(folder))
"""
    assert python(code) == ("True True\n", "")
    (tmp_path / "file").write_text("")
    with pytest.raises(jaxfric.InputError, match="cannot hold a cache"):
        jaxfric.cache_compiled(tmp_path / "file" / "below")


@pytest.mark.parametrize(
    ("given", "version", "asked", "set_"),
    [
        ("", "0.10.2", True, "--{}={}"),
        ("--xla_dump_to=/x", "0.8.0", True, "--xla_dump_to=/x --{}={}"),
        ("--xla_backend_extra_options=a=1", "0.10.2", False, "--xla_backend_extra_options=a=1"),
        ("--{}=5", "0.10.2", True, "--{}=5"),  # what the user said stands
        ("", "0.11.2", True, "--{}={}"),
        ("", "0.12.0.1", True, ""),  # which needs no flag
        ("", "1.0", True, ""),
    ],
)
def test_loops_are_asked_to_be_whole(given, version, asked, set_, monkeypatch):
    monkeypatch.setattr("importlib.metadata.version", lambda name: version)
    monkeypatch.setenv("XLA_FLAGS", given.format(xla._WHOLE))
    assert xla.whole_loops() == asked
    assert os.environ["XLA_FLAGS"] == set_.format(xla._WHOLE, 2**27)


def test_a_whole_loop_is_one_function():
    """Loops of more than the kilobyte that XLA has by default, in the compiled program."""
    code = """
import sys
from jaxfric.cli.xla import whole_loops
if sys.argv[1] == "whole":
    assert whole_loops()
import jax, jax.numpy as jnp
def turns(x):
    return jax.lax.fori_loop(0, 500, lambda i, y: jnp.sin(y) + x[i], x)
text = jax.jit(turns).lower(jnp.ones(1000)).compile().as_text()
print("small_call" in text)
"""
    seen = []
    for how in ("whole", "pieces"):
        command = [sys.executable, "-c", code, how]
        environment = {**os.environ, "XLA_FLAGS": ""}
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
        seen.append(done.stdout)
    by_itself = tuple(map(int, version("jaxlib").split(".")[:2])) >= (0, 12)
    assert seen == ["True\n", f"{by_itself}\n"]


def test_import_is_silent_and_loads_no_jax_and_a_folder_no_other():
    code = (
        "import sys, jaxfric; print('jax' in sys.modules, 'scipy' in sys.modules)\n"
        "jaxfric.plot, jaxfric.stability; print('numpy' in sys.modules)"
    )
    assert python(code) == ("False False\nFalse\n", "")


def test_public_names_are_the_list():
    """A new name is a promise: add it here on purpose."""
    assert sorted(jaxfric.__all__) == NAMES
    assert set(NAMES) <= set(dir(jaxfric))
    assert jaxfric.__version__


@pytest.mark.parametrize("name", NAMES)
def test_name_resolves_to_what_its_name_says(name):
    value = getattr(jaxfric, name)
    assert value.__name__ == name
    assert getattr(jaxfric, name) is value


def test_static_imports_are_the_lazy_ones():
    """What type checkers see is what the lazy table loads."""
    for package in (jaxfric, jaxfric.stability):
        static = {}
        for line in inspect.getsource(package).splitlines():
            if line.startswith("    from ."):
                home, name = line.split(" import ")
                name, alias = name.split(" as ")
                assert name == alias
                static[name] = home.removeprefix("    from .")
        modules = [name for name, home in static.items() if home == ""]
        assert modules == list(getattr(package, "_MODULES", ()))
        assert {n: home for n, home in static.items() if home} == package._HOMES


PACKAGES = [
    "axis", "compensation", "effects", "fitting", "gains", "laws", "loop", "members", "motion",
    "plot", "posterior", "prediction", "protocol", "records", "report", "rig", "runs", "saved",
    "simulation", "stability", "study", "units",
]  # fmt: skip


def test_use_is_silent_and_leaves_jax_as_it_was():
    """Folders are names after `import jaxfric` alone; every name is loaded, and no setting of JAX
    changes; `jaxfric.fit` is a function, whichever module is imported first."""
    code = f"""
import importlib, sys, jax
def anew(module):
    for name in [name for name in sys.modules if name.split('.')[0] == 'jaxfric']:
        del sys.modules[name]
    importlib.import_module(module)
    return sys.modules['jaxfric']
before, jaxfric = dict(jax.config.values), anew('jaxfric')
print([p for p in {PACKAGES} if getattr(jaxfric, p).__name__ != 'jaxfric.' + p])
print(set({PACKAGES}) - set(dir(jaxfric)))
print(jaxfric.gains.gain_schedule.__name__, jaxfric.stability.linear.to_control.__name__)
print(jaxfric.study.Grid.__name__)
[getattr(jaxfric, name) for name in jaxfric.__all__]
print(all(jax.config.values[k] == v for k, v in before.items()), jax.config.jax_enable_x64)
print(jax.config.jax_compilation_cache_dir)
for first in ('stability.theorem', 'fitting.fit', 'plot.fit'):
    jaxfric = anew('jaxfric.' + first)
    print(callable(jaxfric.fit), callable(jaxfric.rice_ruina_criterion))
"""
    out, err = python(code)
    names = ["[]", "set()", "gain_schedule to_control", "Grid"]
    assert (out.splitlines(), err) == ([*names, "True False", "None", *3 * ["True True"]], "")


def test_import_begins_no_backend():
    """So that the owner may still choose the devices; JAX refuses that once one is in use."""
    modules = [m.name for m in pkgutil.walk_packages(jaxfric.__path__, "jaxfric.")]
    code = f"""
import importlib, jax
for module in {[m for m in modules if not m.endswith("__main__")]}:
    importlib.import_module(module)
jax.config.update('jax_num_cpu_devices', 2)
print(len(jax.devices()))
"""
    assert python(code) == ("2\n", "")


@pytest.mark.parametrize("package", [jaxfric, jaxfric.stability])
def test_lazy_names_resolve(package):
    """To what has their name, and nothing is both a module of the package and a name in it."""
    for name, home in package._HOMES.items():
        assert getattr(package, name).__name__ == name
        assert importlib.import_module(f"{package.__name__}.{home}")
        assert importlib.util.find_spec(f"{package.__name__}.{name}") is None
    with pytest.raises(AttributeError, match=f"'{package.__name__}' has no attribute 'nothing'"):
        _ = package.nothing
    with pytest.raises(ValueError, match="a_module would be a module and a name"):
        lazy.loader("x", {"a_module": "y"}, ["a_module"])


def test_unknown_name():
    with pytest.raises(AttributeError, match=r"jaxfric.*no attribute 'ageing'"):
        _ = jaxfric.ageing


def modules():
    names = [m.name for m in pkgutil.walk_packages(jaxfric.__path__, "jaxfric.")]
    return [importlib.import_module(name) for name in names if not name.endswith("__main__")]


def unreadable(module):
    """Public functions of a module whose signature shows an address instead of a default."""
    found = []
    for name, value in vars(module).items():
        own = getattr(value, "__module__", None) == module.__name__
        if name.startswith("_") or not own or not inspect.isroutine(value):
            continue
        defaults = [p.default for p in inspect.signature(value).parameters.values()]
        found += [f"{module.__name__}.{name}" for d in defaults if " at 0x" in repr(d)]
    return found


def test_signatures_show_defaults_that_one_can_read():
    own = (m for m in modules() if m.__name__.split(".")[1] not in ("cli", "members"))
    assert [item for module in own for item in unreadable(module)] == []
    shown = str(inspect.signature(jaxfric.fit))
    assert "progress: collections.abc.Callable[[str], None] = silent" in shown


def test_a_default_that_is_an_address_is_seen():
    module = type(sys)("made_up", "A module.")
    exec("def f(x=object()): pass\ndef g(x=lambda t: None): pass\ndef h(x=1): pass", vars(module))
    assert unreadable(module) == ["made_up.f", "made_up.g"]


def undocumented(module):
    """Public functions and classes defined in a module, and public methods, without docstring."""
    missing = [] if module.__doc__ else [module.__name__]
    for name, value in vars(module).items():
        if name.startswith("_") or getattr(value, "__module__", None) != module.__name__:
            continue
        if not (inspect.isclass(value) or inspect.isroutine(value)):
            continue
        own = vars(value).get("__doc__") if inspect.isclass(value) else value.__doc__
        generated = (own or "").startswith(f"{name}(")  # what dataclasses write by themselves
        if not own or generated:
            missing.append(f"{module.__name__}.{name}")
    return missing


def test_everything_public_has_a_docstring():
    assert [item for module in modules() for item in undocumented(module)] == []


def test_a_missing_docstring_is_seen():
    module = type(sys)("made_up", "A module.")
    exec(
        "import dataclasses\n"
        "def told():\n    'Says so.'\n"
        "def silent(): pass\n"
        "def _private(): pass\n"
        "@dataclasses.dataclass\nclass Bare:\n    x: int\n",
        vars(module),
    )
    assert undocumented(module) == ["made_up.silent", "made_up.Bare"]


OLD = [
    ("", "Start", "InitialState"),
    ("", "margin", "stability_margin"),
    ("", "schedule", "gain_schedule"),
    ("", "theorem", "rice_ruina_criterion"),
    ("gains", "schedule", "gain_schedule"),
    ("simulation", "Start", "InitialState"),
    ("stability", "margin", "stability_margin"),
]


@pytest.mark.parametrize(("folder", "old", "now"), OLD)
def test_an_old_name_is_the_new_one_and_says_so(folder, old, now):
    package = importlib.import_module(f"jaxfric.{folder}".rstrip("."))
    with pytest.warns(DeprecationWarning, match=f"{old} is now .*{now}") as caught:
        assert getattr(package, old) is getattr(package, now)
    assert caught[0].filename == __file__
    assert old not in dir(package) and now in dir(package)


OLD_ARGUMENTS = {
    "close_loop": {
        "with_": "include",
        "without": "exclude",
        "most": "max_effects",
        "rows": "downsample_to",
    },
    "close_axis_loop": {
        "with_": "include",
        "without": "exclude",
        "most": "max_effects",
        "held": "zero_order_hold",
    },
    "close_steady_loop": {"with_": "include", "without": "exclude"},
    "protocol.plan": {"with_": "include", "without": "exclude"},
    "fit": {"rows": "downsample_to"},
    "compare_laws": {"rows": "downsample_to"},
    "predict": {"free": "refit", "held": "zero_order_hold"},
    "feedforward": {"fade": "fade_speed"},
    "read_axis": {"flip": "flip_sign"},
    "read_steady": {"flip": "flip_sign"},
}


@pytest.mark.parametrize(("path", "renamed"), OLD_ARGUMENTS.items())
def test_an_old_argument_becomes_the_new_one(path, renamed):
    """A call that goes no further than its new arguments: the old ones warn and arrive there."""
    function = operator.attrgetter(path)(jaxfric)
    names = inspect.signature(function).parameters
    assert set(renamed.values()) <= set(names) and not set(renamed) & set(names)
    taken = lazy.old_arguments(**renamed)(lambda **given: given)
    for old, new in renamed.items():
        with pytest.warns(DeprecationWarning, match=f"{old} of .* is now {new}") as caught:
            assert taken(**{old: 3}) == {new: 3}
        assert caught[0].filename == __file__
        with (
            pytest.warns(DeprecationWarning, match=f"{old} of {function.__name__}.* is now {new}"),
            pytest.raises(TypeError, match="nobody"),
        ):
            function(**{old: 3}, nobody=1)
        with pytest.raises(TypeError, match=f"got {new} and its old name {old}"):
            taken(**{old: 3, new: 3})


def test_an_axis_is_read_alike_with_an_old_argument(tmp_path):
    path = tmp_path / "a.csv"
    rows = [f"{k / 100},{(k - 20) ** 2},{k % 5 - 2}" for k in range(40)]
    path.write_text("\n".join(["time [s],position [mm],motor_force [N]", *rows]))
    with pytest.warns(DeprecationWarning, match="flip of read_axis.* is now flip_sign") as caught:
        old = jaxfric.read_axis(path, flip="force")
    assert caught[0].filename == __file__
    new, plain = jaxfric.read_axis(path, flip_sign="force"), jaxfric.read_axis(path)
    assert (old.motor_force == new.motor_force).all()
    assert (old.motor_force == -plain.motor_force).all()


def test_a_name_that_nobody_ever_had_is_none():
    for package in (jaxfric, jaxfric.gains, jaxfric.simulation):
        with pytest.raises(AttributeError, match="has no attribute 'theorems'"):
            package.theorems  # noqa: B018


def test_the_old_way_to_whole_loops_still_works(monkeypatch):
    with pytest.warns(DeprecationWarning, match=r"whole_loops is now jaxfric\.cli\.xla"):
        assert jaxfric.whole_loops is xla.whole_loops
