"""Functions that the tests of studies evaluate, here and in processes of their own."""

import hashlib
import os
import signal
import sys
import time
from pathlib import Path

import jax.numpy as jnp
import numpy as np

from jaxfric import study

MARGINS = """
compute = ["margins"]
chunk = 8
[rig]
law = "slip"
A = "4.5 N"
B = "6 N"
L = "5 um"
V0 = "10 um/s"
[axes]
k_p = { logspace = ["100 kN/m", "1 MN/m"], points = 6 }
k_v = { linspace = ["0 N*s/m", "100 kN*s/m"], points = 3 }
"""
"""A good study.toml, of 18 members in three chunks."""


def heed_interrupts():
    """Hand no ignored SIGINT down to a process: a job in the background has it so."""
    if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def waves(p):
    """Cheap, of JAX: a number, one that is infinite somewhere, a code, a row of three."""
    x, y = p["x"], p["y"]
    return {
        "sum": x + 2 * y,
        "ratio": x / y,
        "sign": jnp.where(x > y, 1, 0).astype(jnp.int8),
        "row": jnp.stack([x, y, x * y]),
    }


CODES = {"below": "x is not above y.", "above": "x is above y."}
THIRD = study.values("third", [0.0, 1.0, 2.0])
OUTPUTS = (
    study.Output("sum", "m", "a sum"),
    study.Output("ratio"),
    study.Output("sign", codes=CODES),
    study.Output("row", dims=(THIRD,)),
)


def grid(x: int = 7, y: int = 5, samples: int = 0) -> study.Grid:
    """Two axes, whose product holds 0/0 and 1/0, and perhaps samples of a third parameter."""
    columns = (study.Uniform("z", 0.0, 1.0),)
    axes = (study.linspace("x", 0.0, 3.0, x, unit="m"), study.linspace("y", 0.0, 2.0, y))
    return study.Grid(axes, study.Samples(samples, columns) if samples else None)


def slowly(p):
    """Any Python, that takes SLOWLY seconds each; it fails for one member."""
    time.sleep(float(os.environ.get("SLOWLY", "0")))
    if p["x"] == 2.0:
        raise ValueError("no")
    return {"value": np.float64(p["x"] ** 0.5 + p["y"])}


SLOWLY = (study.Output("value"),)
PAUSED = {"SLOWLY": "0.005"}
"""The environment in which 84 blocks take about one second."""


def run_slowly(out, number=28, **policy):
    """84 blocks of 2 members, or three times another number."""
    g = study.Grid((study.linspace("x", 0.0, 3.0, number), study.linspace("y", 0.0, 2.0, 6)))
    return study.run(slowly, g, out, outputs=SLOWLY, kind="host", chunk=2, **policy)


def contents(store: Path) -> dict[str, str]:
    """Checksums of all files of a store but its lock."""
    return {
        str(file.relative_to(store)): hashlib.sha256(file.read_bytes()).hexdigest()
        for file in sorted(store.rglob("*"))
        if file.is_file() and file.name != ".lock"
    }


if __name__ == "__main__":
    what, out = sys.argv[1:3]
    if what == "slowly":
        run_slowly(out, int(sys.argv[3]) if sys.argv[3:] else 28)
    else:
        study.run(waves, grid(101, 53), out, outputs=OUTPUTS, chunk=1000, batch=64)
