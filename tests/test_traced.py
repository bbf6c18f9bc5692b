"""What was traced is found again on disk, and only where nothing that it depends on has changed."""

import threading
import time
from concurrent.futures import ThreadPoolExecutor

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxfric import traced as module
from jaxfric.effects import effect_of, made
from jaxfric.laws import REGISTRY
from jaxfric.laws.registry import rate_state
from jaxfric.rig import QuasiStatic, Rig
from jaxfric.rig.friction import RateState, SlipEvolution
from jaxfric.stability.theorem import critical_stiffness
from jaxfric.traced import Traced, keep_traced


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "_folder", [])
    keep_traced(tmp_path / "traced")
    return tmp_path / "traced"


@pytest.fixture
def traces(monkeypatch):
    """How often something was traced to be kept."""
    seen, export = [], jax.export.export

    def counted(function, **more):
        seen.append(function)
        return export(function, **more)

    monkeypatch.setattr(module.jax.export, "export", counted)
    return seen


def law(states=1):
    return RateState(0.6, 0.01, jnp.full(states, 0.014), jnp.full(states, 1e-5), 1e-6)


def test_another_process_traces_nothing(folder, traces):
    """A second `Traced` has nothing in memory, as in another process."""
    first, second = Traced(critical_stiffness), Traced(critical_stiffness)
    known = (0.014 - 0.01) / 1e-5
    assert float(first(law())) == pytest.approx(known)
    assert float(first(law())) == pytest.approx(known)
    assert len(traces) == 1 and len(list(folder.iterdir())) == 1
    assert float(second(law())) == pytest.approx(known)
    assert len(traces) == 1


def test_other_shapes_types_and_words_are_traced_anew(folder, traces):
    one = Traced(critical_stiffness)
    one(law())
    one(law(2))
    assert len(traces) == 2
    single = jax.tree.map(lambda x: x.astype(np.float32), law())
    assert one(single).dtype == np.float32
    assert len(traces) == 3 and len(list(folder.iterdir())) == 3


def rates(law, V):
    return law.rate(V, law.steady_state(V) + 0.01, None), {"law": law, "word": "kept"}


rates.__module__ = "jaxfric.rig"  # as if it were of the package


def test_results_of_any_structure_come_back(folder, traces):
    for one in (Traced(rates), Traced(rates)):
        found, more = one(law(2), jnp.asarray(3e-6))
        expected, _ = rates(law(2), jnp.asarray(3e-6))
        assert found == pytest.approx(np.asarray(expected), rel=1e-12)
        assert more["word"] == "kept" and eqx.tree_equal(more["law"], law(2))
    assert len(traces) == 1


def least_squares(matrix, side):
    return jnp.linalg.lstsq(matrix, side)[0], jax.scipy.linalg.qr_multiply(matrix, side)


least_squares.__module__ = "jaxfric.fitting"


def test_a_factorisation_is_kept(folder, traces):
    matrix = jnp.asarray(np.random.default_rng(0).standard_normal((6, 3)))
    for one in (Traced(least_squares), Traced(least_squares)):
        found, _ = one(matrix, jnp.arange(6.0))
        expected = np.linalg.lstsq(matrix, np.arange(6.0))[0]
        assert found == pytest.approx(expected, rel=1e-12)
    assert len(traces) == 1 and len(list(folder.iterdir())) == 1


def test_a_changed_package_is_traced_anew(folder, traces, monkeypatch):
    Traced(critical_stiffness)(law())
    monkeypatch.setattr(module, "_versions", lambda: ("another text",))
    Traced(critical_stiffness)(law())
    assert len(traces) == 2 and len(list(folder.iterdir())) == 2


def test_the_digest_is_of_every_file():
    assert module._versions()[: len(module._LIBRARIES)] == tuple(
        module.version(name) for name in module._LIBRARIES
    )
    assert len(module._versions()[-1]) == 64


@pytest.mark.parametrize("damage", [b"", b"not a function", None])
def test_a_damaged_file_is_made_anew(folder, traces, damage):
    Traced(critical_stiffness)(law())
    (file,) = folder.iterdir()
    whole = file.read_bytes()
    file.write_bytes(whole[: len(whole) // 2] if damage is None else damage)
    assert float(Traced(critical_stiffness)(law())) == pytest.approx(400.0)
    assert len(traces) == 2 and len(file.read_bytes()) == len(whole)


class OwnLaw(eqx.Module):
    stiffness: jax.Array

    def __call__(self):
        return 2 * self.stiffness


def asked(x):
    return x()


asked.__module__ = "jaxfric.rig"


def test_code_of_your_own_is_never_kept(folder, traces):
    one = Traced(asked)
    assert float(one(OwnLaw(jnp.asarray(3.0)))) == 6.0
    assert not traces and not folder.exists()
    made_here = Traced(lambda x: x + 1)
    assert float(made_here(jnp.asarray(1.0))) == 2.0
    assert not traces and not folder.exists()


def test_a_law_of_your_own_is_never_kept(folder, traces, monkeypatch):
    """A law is an argument by its name alone."""
    assert REGISTRY in module._tables
    monkeypatch.setitem(REGISTRY, "own", OwnLaw)
    assert float(Traced(critical_stiffness)(law())) == pytest.approx(400.0)
    assert not traces and not folder.exists()


def test_a_law_under_another_name_is_another_function(folder, traces, monkeypatch):
    Traced(critical_stiffness)(law())
    monkeypatch.setitem(REGISTRY, "slip", REGISTRY["ageing"])
    Traced(critical_stiffness)(law())
    assert len(traces) == 2


@pytest.mark.parametrize("kept", [False, True])
def test_a_law_that_is_replaced_is_compiled_anew(kept, tmp_path, monkeypatch):
    """In one session, as a notebook does that runs a cell again."""

    class Faster(SlipEvolution):
        times: float = 2.0

        def rate(self, r, theta, B, L, V0):
            return self.times * super().rate(r, theta, B, L, V0)

    monkeypatch.setattr(module, "_folder", [tmp_path] if kept else [])
    p = {"f0": 0.6, "A": 0.01, "B": 0.014, "L": 1e-5, "V0": 1e-6}
    of_name = Traced(lambda name, L: critical_stiffness(rate_state(name, {**p, "L": L}, 1)))
    found = []
    for law in (SlipEvolution(), Faster(), Faster(3.0)):
        monkeypatch.setitem(REGISTRY, "own", law)
        found.append([float(f("own", jnp.asarray(1e-5))) for f in (of_name, of_name.nested)])
    np.testing.assert_allclose(found, np.array([[400.0], [800.0], [1200.0]]) * [1, 1])


def test_effects_of_the_catalogue_are_known_code():
    rig = Rig(QuasiStatic(2e3), law())
    for id in ("viscous", "thermal", "second_state", "servo_lag", "inertia"):
        assert module._of_known_code(made(effect_of(id), {}).embed(rig)), id
    assert module._of_known_code((effect_of("viscous"), {"a": (1, 2.0, None)}))
    assert not module._of_known_code((OwnLaw,))
    assert not module._of_known_code(lambda: 0)


def test_what_is_being_traced_itself_is_not_kept(folder, traces):
    one = Traced(critical_stiffness)
    slope = jax.grad(lambda A: one(eqx.tree_at(lambda law: law.A, law(), A)))(jnp.asarray(0.01))
    assert float(slope) == pytest.approx(-1e5)
    assert not traces


def test_without_a_folder_nothing_is_kept(monkeypatch, traces):
    monkeypatch.setattr(module, "_folder", [])
    assert float(Traced(critical_stiffness)(law())) == pytest.approx(400.0)
    assert not traces


def test_a_folder_that_cannot_be_written_does_no_harm(tmp_path, monkeypatch, traces):
    (tmp_path / "file").write_text("in the way")
    monkeypatch.setattr(module, "_folder", [])
    keep_traced(tmp_path / "file" / "traced")
    assert float(Traced(critical_stiffness)(law())) == pytest.approx(400.0)
    assert len(traces) == 1


def test_a_compiler_that_does_not_know_the_option_compiles_as_it_is(folder, monkeypatch):
    def knows(function, **more):
        return jit(function)

    def does_not(function, **more):
        if more.get("compiler_options"):
            raise ValueError("No such compile option")
        return jit(function)

    jit = jax.jit
    monkeypatch.setattr(module, "_quickly", module._quickly.__wrapped__)
    monkeypatch.setattr(module.jax, "jit", knows)
    assert module._quickly() == {"xla_cpu_use_fusion_emitters": False}
    monkeypatch.setattr(module.jax, "jit", does_not)
    assert module._quickly() is None
    assert float(Traced(critical_stiffness)(law())) == pytest.approx(400.0)


def test_a_function_of_functions_with_options_can_be_traced(monkeypatch):
    # options of the compiler are for what is compiled by itself: JAX refuses them further in
    monkeypatch.setattr(module, "_folder", [])
    one = Traced(critical_stiffness)
    assert float(jax.jit(lambda A: one(eqx.tree_at(lambda law: law.A, law(), A)))(0.01)) == (
        pytest.approx(400.0)
    )
    assert float(one(law())) == pytest.approx(400.0)


def test_a_thread_waits_for_what_another_compiles(folder, traces, monkeypatch):
    """Two that need the same at once: it is traced once, and both have it."""
    one, begun = Traced(critical_stiffness), threading.Barrier(2, timeout=20)
    found, sought = Traced._found, []

    def slowly(self, *given):
        sought.append(given)
        time.sleep(0.2)
        return found(self, *given)

    monkeypatch.setattr(Traced, "_found", slowly)

    def asked(_):
        begun.wait()
        return float(one(law()))

    with ThreadPoolExecutor(2) as pool:
        assert list(pool.map(asked, range(2))) == pytest.approx([0.004 / 1e-5] * 2)
    assert len(traces) == len(sought) == 1
