"""What is computed on a GPU and what on the processor; that there is a GPU is only said here."""

import os
import subprocess
import sys
from types import SimpleNamespace

import distributed
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxfric import traced
from jaxfric.cli import study as verb
from jaxfric.simulation.blocks import in_blocks
from jaxfric.study import cluster, local
from jaxfric.threads import at_once


@pytest.fixture
def gpu(monkeypatch):
    monkeypatch.setattr(jax, "default_backend", lambda: "gpu")


def platforms(call: str, given: str | None) -> str:
    environment = {k: x for k, x in os.environ.items() if k != "JAX_PLATFORMS"}
    environment |= {} if given is None else {"JAX_PLATFORMS": given}
    code = f"from jaxfric.cli.common import prepare_jax; {call}; import jax"
    command = [sys.executable, "-c", f"{code}; print(jax.config.jax_platforms)"]
    return subprocess.run(
        command, env=environment, capture_output=True, text=True, check=True
    ).stdout.strip()


@pytest.mark.parametrize(
    ("call", "given", "found"),
    [
        ("prepare_jax()", None, "cpu"),
        ("import jax; prepare_jax()", None, "cpu"),  # loaded before, and nothing computed
        ("prepare_jax()", "cuda", "cuda"),  # what the user said stands
        ("prepare_jax(gpu=True)", None, "None"),
    ],
)
def test_a_record_is_computed_on_the_processor(call, given, found):
    assert platforms(call, given) == found


def test_what_is_loaded_from_the_cache_is_loaded_in_silence(tmp_path):
    """XLA takes preferences of some processors for features, and says at length that they lack."""
    code = (
        "from jaxfric.cli.common import prepare_jax; prepare_jax(); import jax\n"
        "twice = jax.jit(lambda x: x[::-1] * 2)\n"
        "for _ in range(2): jax.clear_caches(); print(twice(jax.numpy.ones(9)))"
    )
    environment = {k: x for k, x in os.environ.items() if k != "TF_CPP_MIN_LOG_LEVEL"}
    environment |= {"JAX_COMPILATION_CACHE_DIR": str(tmp_path), "XDG_CACHE_HOME": str(tmp_path)}
    for setting in ("MIN_COMPILE_TIME_SECS", "MIN_ENTRY_SIZE_BYTES"):
        environment[f"JAX_PERSISTENT_CACHE_{setting}"] = "0"
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.count("2.") == 18 and done.stderr == "" and any(tmp_path.iterdir())


def test_a_study_takes_what_there_is(tmp_path, monkeypatch):
    class Asked(Exception):
        pass

    def asked(*, gpu=False):
        raise Asked(gpu)

    monkeypatch.setattr(verb, "prepare_jax", asked)
    with pytest.raises(Asked, match="True"):
        verb.study(tmp_path / "study.toml")


@pytest.mark.parametrize(("given", "found"), [(None, "cpu"), ("cuda", "cuda")])
def test_processes_do_not_share_a_gpu(given, found, monkeypatch):
    class Begun(Exception):
        pass

    def begun(*, env, **_):
        raise Begun(env["JAX_PLATFORMS"])

    monkeypatch.delenv("JAX_PLATFORMS", raising=False)
    if given is not None:
        monkeypatch.setenv("JAX_PLATFORMS", given)
    monkeypatch.setattr(distributed, "LocalCluster", begun)
    with pytest.raises(Begun, match=found), cluster.local_processes(2):
        pass


def test_the_processor_takes_as_many_as_its_cache_holds():
    assert at_once(24) == 24


@pytest.mark.parametrize(
    ("members", "batch", "found"),
    [(65536, 512, 65536), (10**6, 512, 65536), (10**6, 64, 65536), (1024, 24, 24)],
)
def test_a_gpu_takes_a_block_at_once(members, batch, found, gpu, monkeypatch):
    """But few that share a loop, as those with mass, are for the processor."""
    real = jax.devices("cpu")[:1]
    monkeypatch.setattr(
        jax, "devices", lambda kind="": real if kind else [SimpleNamespace(platform="gpu")]
    )
    task = SimpleNamespace(batch=batch, blocks=SimpleNamespace(largest=members))
    assert local._batch(task) == found


def test_rows_of_a_record_are_the_same_on_a_gpu(gpu):
    x = jnp.arange(700.0)
    assert np.array_equal(in_blocks(jnp.sin, x), jnp.sin(x))
    wide = str(jax.make_jaxpr(lambda x: in_blocks(jnp.sin, x))(x))
    assert "700" in wide and "256" not in wide


def test_what_is_traced_is_for_the_device_that_computes(gpu, monkeypatch):
    monkeypatch.setattr(jax.export, "default_export_platform", lambda: "cuda")
    found = [traced._settings()[0]]
    for device in (jax.devices("cpu")[0], "cpu", SimpleNamespace(platform="gpu")):
        monkeypatch.setattr(type(jax.config), "jax_default_device", device, raising=False)
        found.append(traced._settings()[0])
    assert found == ["cuda", "cpu", "cpu", "cuda"]
