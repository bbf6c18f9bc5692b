"""Studies on a Dask cluster: the store is that of one machine, whatever becomes of the cluster."""

import importlib
import os
import signal
import sys
import threading
import time
import types
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
import study_functions as f
from command import run, written

pytest.importorskip("zarr")
pytest.importorskip("distributed")

import distributed

from jaxfric import InputError, study
from jaxfric.laws import REGISTRY
from jaxfric.members import run_study
from jaxfric.rig.friction import SlipEvolution
from jaxfric.stability.margin_table import MARGINS, Margin
from jaxfric.stability.margins import modulus
from jaxfric.study.cluster import _Pool

GOOD = 'outputs = ["k_cr", "stability"]\n' + f.MARGINS
ALONE = {"threads_per_worker": 1, "dashboard_address": None, "worker_dashboard_address": None}


@pytest.fixture(scope="module")
def cluster():
    """Two workers in processes of their own, one thread each."""
    folder = str(Path(__file__).parent)
    os.environ["PYTHONPATH"] = os.pathsep.join([folder, os.environ.get("PYTHONPATH", "")])
    with distributed.LocalCluster(n_workers=2, env=f.PAUSED, **ALONE) as made:
        yield made


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    path = tmp_path_factory.mktemp("undisturbed") / "a"
    f.run_slowly(path)
    return f.contents(path)


def test_the_store_is_that_of_one_machine(cluster, tmp_path, undisturbed):
    f.run_slowly(tmp_path / "a", scheduler=cluster.scheduler_address)
    assert f.contents(tmp_path / "a") == undisturbed


@pytest.mark.long
def test_processes_of_this_machine_give_the_same_store(tmp_path, undisturbed):
    f.run_slowly(tmp_path / "a", processes=2)
    assert f.contents(tmp_path / "a") == undisturbed


def test_the_command_on_a_cluster(cluster, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    written(Path("study.toml"), GOOD)
    here = run("study", "study.toml", "--out", "here.zarr")
    there = run(
        "study", "study.toml", "--out", "there.zarr", "--scheduler", cluster.scheduler_address
    )
    assert (here.code, there.code) == (0, 0), here.err + there.err
    a, b = study.load("here.zarr"), study.load("there.zarr")
    np.testing.assert_allclose(a.k_cr, b.k_cr, rtol=1e-12)
    np.testing.assert_array_equal(a.stability, b.stability)


def test_a_worker_with_other_code_is_refused(cluster, tmp_path, monkeypatch):
    """It would mix its numbers with those of the others."""
    monkeypatch.setattr("jaxfric.study.source.package_source", lambda: "0123456789ab")
    words = r"worker at tcp.* has other code than this machine: code of jaxfric 0123456789ab -> "
    with pytest.raises(InputError, match=words):
        f.run_slowly(tmp_path / "a", scheduler=cluster.scheduler_address)
    assert not np.any(study.load(tmp_path / "a").done)


@pytest.mark.parametrize("there", [None, "p['x'] + 2 * p['y']"])
def test_the_function_of_a_worker_is_that_of_the_client(cluster, tmp_path, monkeypatch, there):
    """A module that the worker has not, or has with another body."""
    text = "def value(p):\n    return {'value': BODY}\n"
    name = "lonely" if there is None else "twofold"
    (tmp_path / "here").mkdir()
    written(tmp_path / "here" / f"{name}.py", text.replace("BODY", "p['x'] + p['y']"))
    if there:
        (tmp_path / "there").mkdir()
        written(tmp_path / "there" / f"{name}.py", text.replace("BODY", there))
        with distributed.Client(cluster.scheduler_address) as client:
            client.run(lambda place: sys.path.insert(0, place), str(tmp_path / "there"))
    monkeypatch.syspath_prepend(str(tmp_path / "here"))
    function = importlib.import_module(name).value
    words = (
        "source of the function" if there else "has no package 'lonely'; install there what is here"
    )
    with pytest.raises(InputError, match=words.replace("is here", "is installed here")):
        study.run(
            function,
            f.grid(),
            tmp_path / "a",
            outputs=f.SLOWLY,
            kind="host",
            scheduler=cluster.scheduler_address,
        )


def test_workers_have_the_laws_and_margins_of_the_client(cluster, tmp_path, monkeypatch):
    """Those registered in this process, and replaced in it."""

    class Slowed(SlipEvolution):
        factor: float

        def rate(self, r, theta, B, L, V0):
            return self.factor * super().rate(r, theta, B, L, V0)

    twice = types.FunctionType((lambda of: 2 * modulus(of)).__code__, {"modulus": modulus}, "twice")
    twice.__module__ = "__main__"
    monkeypatch.setattr(sys.modules["__main__"], "twice", twice, raising=False)
    monkeypatch.setitem(MARGINS, "twice", Margin("1", 0.0, "twice", "__main__:twice"))
    text = f.MARGINS.replace('"slip"', '"slowed"').replace("chunk = 8", "chunk = 18")
    path = written(tmp_path / "study.toml", 'outputs = ["k_cr", "twice", "modulus"]\n' + text)
    for factor in (0.5, 0.25):
        monkeypatch.setitem(REGISTRY, "slowed", Slowed(factor))
        found = run_study(path, tmp_path / str(factor), scheduler=cluster.scheduler_address)
        undamped = found.sel(k_v=0.0)
        np.testing.assert_allclose(undamped.k_cr, factor * 1.5 / 5e-6, rtol=1e-9)
        np.testing.assert_allclose(found.twice, 2 * found.modulus, rtol=1e-12)


def test_a_client_that_waits_says_so():
    """Ever less often."""
    told = []
    workers = {"w": {"nthreads": 2}}
    client = SimpleNamespace(
        status="running", scheduler_info=lambda n_workers: {"workers": workers}
    )
    pool = _Pool(client, cast(Any, None), "tcp://x:1", told.append)
    pool.last -= 20.0
    pool._say_waiting()
    pool._say_waiting()
    workers.clear()
    pool.last -= 20.0
    pool._say_waiting()
    assert told == [
        "waiting for a chunk: 2 threads at tcp://x:1",
        "waiting for a chunk: 0 threads at tcp://x:1; start some with: dask worker tcp://x:1"
        " --nthreads 1",
    ]


def test_killed_workers_lose_nothing(cluster, tmp_path, undisturbed):
    """One for every eight blocks: by the clock, a busy machine would never begin another."""
    stop, written_once, killed = threading.Event(), [], []

    def kill():
        while not stop.wait(0.02):
            workers = list(cluster.workers.values())
            for worker in workers[: len(written_once) >= 8 * len(killed)]:
                if worker.process is not None and worker.process.pid:
                    os.kill(worker.process.pid, signal.SIGKILL)
                    killed.append(worker.process.pid)

    killer = threading.Thread(target=kill)
    killer.start()
    try:
        f.run_slowly(
            tmp_path / "a", scheduler=cluster.scheduler_address, progress=written_once.append
        )
    finally:
        stop.set()
        killer.join()
    assert len(killed) > 5
    assert len(written_once) == 84  # each block once
    assert f.contents(tmp_path / "a") == undisturbed


def test_a_lost_scheduler_leaves_a_store(tmp_path, undisturbed, monkeypatch):
    """The scheduler goes away in the middle; the study goes on without it."""
    monkeypatch.setenv("SLOWLY", f.PAUSED["SLOWLY"])
    made = distributed.LocalCluster(n_workers=1, processes=False, protocol="tcp://", **ALONE)
    path = tmp_path / "a"

    def close_after(count):
        while not (path / "done" / "c").exists() or len(os.listdir(path / "done" / "c")) < count:
            time.sleep(0.01)
        made.close()

    closer = threading.Thread(target=close_after, args=(10,))
    closer.start()
    with pytest.raises(study.Stopped, match=r"scheduler at tcp.* is lost; \d+ of 84 chunks"):
        f.run_slowly(path, scheduler=made.scheduler_address)
    closer.join()
    monkeypatch.undo()
    f.run_slowly(path)
    assert f.contents(path) == undisturbed


@pytest.mark.parametrize(
    ("status", "outcome"),
    [("finished", {"value": 1}), ("lost", None), ("cancelled", study.Stopped)],
)
def test_a_future_may_change_after_it_was_done(status, outcome):
    """A scheduler or worker that goes away between two questions: `exception` is None for all."""
    future = SimpleNamespace(
        status=status, exception=lambda timeout: None, result=lambda timeout: {"value": 1}
    )
    pool = _Pool(SimpleNamespace(status="running"), cast(Any, None), "tcp://x:1", print)
    if outcome is study.Stopped:
        with pytest.raises(study.Stopped, match="the scheduler at tcp://x:1 is lost"):
            pool._result(future)
    else:
        assert pool._result(future) == outcome


def test_no_scheduler(tmp_path, monkeypatch):
    monkeypatch.setattr("jaxfric.study.cluster._PATIENCE", 0.2)
    with pytest.raises(InputError, match="no Dask scheduler answers there"):
        f.run_slowly(tmp_path / "a", scheduler="tcp://127.0.0.1:9")
    assert not list(tmp_path.iterdir())
    with pytest.raises(ValueError, match="client"):
        distributed.get_client()  # what does not answer is no default for who goes on
