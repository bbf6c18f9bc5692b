"""How long do others take for the same work, at which error?

    python tests/benchmarks/peers.py [--only motion fits roots] [--diabayes SOURCE]

A line for ours, then one for each peer with how many times as long it takes. Errors are against
references of a tolerance of 1e-12 (motions, fits) or of 30 digits (roots). One thread, everything
compiled and warm, medians of five. diabayes gets an environment of its own, made in a temporary
folder, since it asks for an older JAX; peers that are not installed are named and left out.
"""

import argparse
import os

os.environ.setdefault("NPROC", "1")  # read when JAX starts

import jax
from peers_fits import fits
from peers_motion import motion
from peers_roots import roots

from jaxfric.cli.xla import whole_loops

PARTS = {"motion": motion, "roots": roots}


def main() -> None:
    whole_loops()  # as the command does, for every peer that is written in JAX
    jax.config.update("jax_enable_x64", True)
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", nargs="+", choices=["motion", "fits", "roots"])
    parser.add_argument("--diabayes", default="git+https://github.com/martijnende/diabayes")
    options = parser.parse_args()
    for name in options.only or ["motion", "fits", "roots"]:
        if name == "fits":
            fits(options.diabayes)
        else:
            PARTS[name]()


if __name__ == "__main__":
    main()
