"""Loops that XLA compiles as one piece, for the command, tests and benchmarks."""

import os

_WHOLE = "xla_backend_extra_options=xla_cpu_small_while_loop_byte_threshold"
_BYTES = 2**27
_FIRST, _BY_ITSELF = (0, 8), (0, 12)
"""Versions of jaxlib: the first that has the flag, XLA ends a process that gives it an unknown one;
and the first that needs none."""


def whole_loops() -> bool:
    """Have XLA compile a loop as one piece, in this process and those that it begins, as the
    command does; whether it will.

    By default XLA looks up what to compute next in every turn of a loop, which takes longer than a
    step of a solver or a row of a filter. Loops over up to 128 MiB of memory are made one function:
    a simulation takes 0.3 of the time, one of a batch 0.55, a loop 0.75 to 0.9. Set by `XLA_FLAGS`
    in the environment, so before anything is computed with JAX. Nothing where that has such an
    option already, for jaxlib before 0.8, and from 0.12 on, which does so by itself.
    """
    from importlib.metadata import version

    given = os.environ.get("XLA_FLAGS", "")
    known = tuple(int(part) for part in version("jaxlib").split(".")[:2])
    if known >= _BY_ITSELF:
        return True
    if _WHOLE.partition("=")[0] in given or known < _FIRST:
        return _WHOLE in given
    os.environ["XLA_FLAGS"] = f"{given} --{_WHOLE}={_BYTES}".strip()
    return True
