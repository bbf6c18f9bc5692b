"""Processes side by side: each computes with one thread."""

import os


def one_thread() -> None:
    """To be called before JAX is used. Threads of XLA wait for each other by spinning: a loop takes
    as long with two as with one, and half of what two cores do is waiting."""
    os.environ.setdefault("NPROC", "1")
