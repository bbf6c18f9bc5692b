"""Work on several threads: its order, its errors, and that it cannot wait for itself.

XLA computes on a pool of threads. A batch of LAPACK's calls is divided among them and waits there
for its parts; where all threads of the pool wait, none is left to compute. So nothing that may be
computed side by side has such a batch.
"""

import os
import re
import signal
import threading
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import pytest
from jax.extend.core import jaxprs_in_params

import jaxfric
from jaxfric import threads
from jaxfric.simulation.rodas import inverted
from jaxfric.threads import go_on, side_by_side

LAPACK = {"lu", "triangular_solve", "cholesky", "qr", "geqrf", "eigh", "svd"}
KNOWN = {
    "gains/implicit.py": "derivatives of least gains, which no thread computes beside another",
    "simulation/method_of_steps.py": "on one thread only, one after the other",
    "stability/linear.py": "the exponential of one matrix",
}


@pytest.mark.parametrize("cores", ["1", "2", "3"])
def test_results_come_in_the_order_of_what_was_asked(cores, monkeypatch):
    monkeypatch.setenv("NPROC", cores)
    seen = set()

    def one(a, b):
        seen.add(threading.get_ident())
        return a * b

    assert side_by_side(one, range(10, 20), range(10)) == [k * (k + 10) for k in range(10)]
    assert (seen == {threading.get_ident()}) == (cores == "1")
    assert side_by_side(one, [], []) == []


@pytest.mark.parametrize(("given", "threads_"), [("1", 1), ("3", 3), ("64", 8)])
def test_threads_are_as_many_as_cores_but_not_many(given, threads_, monkeypatch):
    monkeypatch.setenv("NPROC", given)
    assert threads.cores() == threads_


def test_two_are_at_work_at_once(monkeypatch):
    monkeypatch.setenv("NPROC", "2")
    both = threading.Barrier(2, timeout=20)
    assert sorted(side_by_side(lambda k: both.wait() * 0 + k, range(2))) == [0, 1]


def test_the_error_of_one_is_that_of_all(monkeypatch):
    monkeypatch.setenv("NPROC", "2")
    with pytest.raises(ZeroDivisionError):
        side_by_side(lambda k: 1 / k, [1, 0, 2])


def test_numbers_have_the_bits_that_they_have_here(monkeypatch):
    monkeypatch.setenv("NPROC", "2")
    for long in (True, False):
        with jax.enable_x64(long):
            bits = side_by_side(lambda k: str(jnp.arange(k).astype(float).dtype), [1, 2, 3])
        assert bits == [("float64" if long else "float32")] * 3


def test_what_is_asked_on_such_a_thread_is_done_there(monkeypatch):
    """Else two levels of two threads were four, each with memory of its own."""
    monkeypatch.setenv("NPROC", "2")

    def inner(k):
        return threading.get_ident()

    def outer(k):
        return {threading.get_ident(), *side_by_side(inner, range(4))}

    assert [len(ids) for ids in side_by_side(outer, range(4))] == [1, 1, 1, 1]
    assert side_by_side(inner, range(1)) == [threading.get_ident()]


@pytest.mark.parametrize("error", [ZeroDivisionError, KeyboardInterrupt])
def test_after_an_error_the_others_go_on_no_further(error, monkeypatch):
    """They end where they ask, and what was not begun is not begun."""
    monkeypatch.setenv("NPROC", "2")
    begun, steps = [], []

    def one(k):
        begun.append(k)
        if k == 0:
            raise error
        for _ in range(1000):
            go_on()
            steps.append(k)
            time.sleep(0.01)

    with pytest.raises(error):
        side_by_side(one, range(6))
    assert len(begun) <= 3 and len(steps) < 900
    go_on()  # here nothing is ended


def test_an_interrupt_of_the_one_who_waits_ends_them_too(monkeypatch):
    monkeypatch.setenv("NPROC", "2")
    at_work = threading.Event()

    def one(k):
        at_work.set()
        for _ in range(1000):
            go_on()
            time.sleep(0.01)

    def interrupt():
        at_work.wait(20)
        os.kill(os.getpid(), signal.SIGINT)

    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    begun = time.monotonic()
    try:
        threading.Thread(target=interrupt).start()
        with pytest.raises(KeyboardInterrupt):
            side_by_side(one, range(4))
    finally:
        signal.signal(signal.SIGINT, before)
    assert time.monotonic() - begun < 8  # of 20 s


def batches(jaxpr):
    """Names of LAPACK's operations on more than one matrix, within all of a program."""
    found = []
    for eqn in jaxpr.eqns:
        if eqn.primitive.name in LAPACK and any(v.aval.ndim > 2 for v in eqn.invars):
            found.append(eqn.primitive.name)
        for inner in jaxprs_in_params(eqn.params):
            found += batches(inner)
    return found


def test_no_batch_of_lapack_is_computed_side_by_side():
    assert batches(jax.make_jaxpr(jnp.linalg.inv)(jnp.ones((4, 9, 9))).jaxpr)  # it can be found
    for n in (2, 9):
        assert not batches(jax.make_jaxpr(jax.vmap(inverted))(jnp.ones((4, n, n))).jaxpr)


def test_where_lapack_is_called_from_compiled_code():
    """A new place must be one that is never batched, or never computed side by side."""
    package = Path(jaxfric.__file__).parent
    call = re.compile(
        r"\b(jnp\.linalg|jax\.scipy\.linalg|jax\.numpy\.linalg|lax\.linalg)\.(?!norm)"
    )
    found = {
        str(file.relative_to(package))
        for file in package.rglob("*.py")
        if call.search(file.read_text())
    }
    assert found and found <= set(KNOWN)
