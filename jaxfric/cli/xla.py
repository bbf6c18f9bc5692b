"""Make XLA compile each loop as one function, for the command, tests and benchmarks."""

import os

_WHOLE = "xla_backend_extra_options=xla_cpu_small_while_loop_byte_threshold"
_BYTES = 2**27
_BY_ITSELF = (0, 12)
"""First version of jaxlib that does not need the flag. XLA ends a process with an unknown flag."""


def whole_loops() -> bool:
    """Make XLA compile each loop as one function; return whether XLA will do so.

    The setting holds for this process and its children. By default XLA dispatches each loop
    iteration separately; the overhead exceeds the cost of a solver step or of a filter row. If XLA
    compiles loops of up to 128 MiB as one function, a simulation takes 0.3 of the default time. One
    simulation in a batch takes 0.55, a `jaxfric loop` 0.75 to 0.9 of the default time. The function
    sets `XLA_FLAGS` in the environment, so call it before JAX computes anything. The function does
    nothing if `XLA_FLAGS` already has an option on loop size. The function also does nothing from
    jaxlib 0.12 on, which compiles each loop as one function by default.
    """
    from importlib.metadata import version

    given = os.environ.get("XLA_FLAGS", "")
    if tuple(int(part) for part in version("jaxlib").split(".")[:2]) >= _BY_ITSELF:
        return True
    if _WHOLE.partition("=")[0] in given:
        return _WHOLE in given
    os.environ["XLA_FLAGS"] = f"{given} --{_WHOLE}={_BYTES}".strip()
    return True
