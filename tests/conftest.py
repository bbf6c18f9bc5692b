"""Fits and tight tolerances need 64-bit numbers; the package itself never sets this.

Compiled functions are kept in pytest's cache folder, or in JAXFRIC_TEST_CACHE: many tests compile
the same ones. JAX names them by all that they come from, so a change of code finds no old one.
"""

import gc
import os
import subprocess
import sys
import threading
from importlib.metadata import version
from pathlib import Path

import jax
import pytest
from snapshots import compared, together

from jaxfric.cli.xla import whole_loops

jax.config.update("jax_enable_x64", True)
_ALL = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") if hasattr(os, "sysconf") else 1e10
_LARGE = min(4e9, _ALL / 5)
_MORE = _LARGE / 2
"""What a worker may keep before it forgets, and then again [bytes]: a fifth of the memory."""
gc.disable()  # the heap of a worker is large: its collection took 6 % of the time
_BY_FUSION_ALWAYS = tuple(map(int, version("jaxlib").split(".")[:2])) >= (0, 12)
_QUICK_COMPILER = " ".join(
    (
        "--xla_backend_optimization_level=1",
        *(() if _BY_FUSION_ALWAYS else ("--xla_cpu_use_fusion_emitters=false",)),
        "--xla_cpu_parallel_codegen_split_count=1",
    )
)
"""Half of what the tests do is trace and compile; so it takes half the time, and rounds otherwise.
With XLA_FLAGS set, if only to nothing, they run what a user runs."""


def pytest_addoption(parser):
    parser.addoption("--update-snapshots", action="store_true", help="keep the texts of today")


def pytest_ignore_collect(collection_path, config):
    """Texts are kept anew by the tests that have some; the other files need not be read for it."""
    anew = config.getoption("--update-snapshots") and collection_path.suffix == ".py"
    return True if anew and "snapshot(" not in collection_path.read_text("utf-8") else None


def pytest_collection_modifyitems(config, items):
    if config.getoption("--update-snapshots"):
        items[:] = [item for item in items if "snapshot" in item.fixturenames]


@pytest.fixture
def snapshot(request):
    """`snapshot(name, cases)` fails where the texts by case are not tests/snapshots/NAME.txt."""
    anew = request.config.getoption("--update-snapshots")
    return lambda name, cases: compared(name, together(cases), anew=anew)


def pytest_configure(config):
    """Share compiled functions between tests, workers and runs, and compile them quickly.

    Workers are side by side: threads of XLA and of BLAS, which wait by spinning, would only take
    their time.
    """
    if "PYTEST_XDIST_WORKER" in os.environ or config.getoption("numprocesses", None):
        for threads in ("NPROC", "OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
            os.environ.setdefault(threads, "1")
    if "XLA_FLAGS" not in os.environ and _known(_QUICK_COMPILER, config):
        os.environ["XLA_FLAGS"] = _QUICK_COMPILER  # workers and commands of tests inherit it
        whole_loops()  # as the command: asked for later, it names all that is compiled anew
        os.environ["JAX_DISABLE_MOST_OPTIMIZATIONS"] = "true"
        jax.config.update("jax_disable_most_optimizations", True)
    _share_contexts()
    own = Path(config.rootpath) / ".pytest_cache" / "jax"
    folder = Path(os.environ.get("JAXFRIC_TEST_CACHE", own))
    os.environ["JAX_COMPILATION_CACHE_DIR"] = str(folder)  # the command leaves it then
    jax.config.update("jax_compilation_cache_dir", str(folder))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)


def _share_contexts() -> None:
    """Have JAX lower 256 functions in a context of MLIR instead of making one for each, which takes
    3 ms; every thread has its own. Where JAX has no such function nothing is done."""
    from jax._src.interpreters import mlir

    make, kept = getattr(mlir, "make_ir_context", None), threading.local()

    def context():
        kept.count = getattr(kept, "count", -1) + 1
        if kept.count % 256 == 0:
            kept.context = make()
        return kept.context

    if make is not None:
        mlir.make_ir_context = context


def pytest_unconfigure():
    gc.freeze()  # a worker that ends need not search all that it ever compiled for cycles


def _known(flags: str, config) -> bool:
    """Whether this XLA has the flags: it ends the process at one that it does not know."""
    key = f"jaxlib {version('jaxlib')}/{flags.replace(' ', '')}"
    kept = getattr(config, "cache", None)  # none under -p no:cacheprovider
    known = None if kept is None else kept.get(key, None)
    if known is None:
        ask = [sys.executable, "-c", "import jax; jax.numpy.zeros(1) + 1"]
        found = subprocess.run(ask, env={**os.environ, "XLA_FLAGS": flags}, capture_output=True)
        known = found.returncode == 0
        if kept is not None:
            kept.set(key, known)
    return known


@pytest.fixture(scope="module", autouse=True)
def compiled_with_care(request):
    """Tests of a module marked `computes` run longer than they compile: nothing is left out."""
    before = jax.config.read("jax_disable_most_optimizations")
    quick = before and request.node.get_closest_marker("computes") is None
    jax.config.update("jax_disable_most_optimizations", quick)
    yield
    jax.config.update("jax_disable_most_optimizations", before)


@pytest.fixture(scope="session")
def allowed() -> list[float]:
    """Memory that this process may have before it forgets [bytes]."""
    return [_LARGE]


@pytest.fixture(scope="module", autouse=True)
def forget_compiled(allowed):
    """A worker that keeps all that every file compiled grows to 5 GB and slows down.

    What is forgotten is not given back to the system, but used again: once it has grown, a worker
    forgets only where it grew further, not after each file, which took a second every time.
    """
    yield
    if _resident() > allowed[0]:
        jax.clear_caches()
        gc.collect()
        allowed[0] = max(_LARGE, _resident() + _MORE)


def _resident() -> float:
    """Memory of this process [bytes]; more than any where the system does not tell."""
    try:
        pages = int(Path("/proc/self/statm").read_text().split()[1])
    except (OSError, ValueError, IndexError):
        return float("inf")
    return pages * os.sysconf("SC_PAGE_SIZE")
