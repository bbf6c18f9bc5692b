"""Functions that several verbs use: quantities of options, setup of JAX, warnings."""

import contextlib
import os
import sys
from collections.abc import Iterable
from typing import TYPE_CHECKING

from ..coordinate import Coordinate, agreed, unit_of
from ..errors import InputError
from ..units import parse_quantity, parse_values
from .call import current_call, option_of
from .told import doing

if TYPE_CHECKING:
    from rich.console import Console


def refuse_unused(by: str, *names: str, instead: str = "") -> None:
    """Raise `InputError` if the call gives options that have no effect; `by` names the reason.

    `names` are the names of the options in Python.
    """
    wrong = [option_of(name) for name in names if name in current_call().given]
    if wrong:
        raise InputError(
            f"{' and '.join(wrong)} would not be used with {by}; leave it out{instead}"
        )


def prepare_jax(*, gpu: bool = False) -> None:
    """Set JAX to 64 bits, whole compiled loops, and a compilation cache in the user's cache folder.

    JAX then runs on the CPU, unless JAX_PLATFORMS is set. A record needs many small computations
    one after the other, which take ten times as long on a GPU. With `gpu` JAX uses a GPU if one
    exists.
    """
    doing("loading JAX")
    _keep_freed_memory()
    if not gpu:
        os.environ.setdefault("JAX_PLATFORMS", "cpu")
    # XLA mistakes preferences of some CPUs for missing features, and logs an error for everything
    # that it loads from the cache (jax issue 38445). Real failures still raise. "1" is JAX's own
    # default, which a child process of Python inherits
    if os.environ.get("TF_CPP_MIN_LOG_LEVEL", "1") == "1":
        os.environ["TF_CPP_MIN_LOG_LEVEL"] = "3"
    import jax

    if not gpu and jax.config.jax_platforms is None:  # ty: ignore[missing-attribute]
        jax.config.update("jax_platforms", os.environ["JAX_PLATFORMS"])

    from ..cache import cache_compiled
    from .xla import whole_loops

    whole_loops()
    jax.config.update("jax_enable_x64", True)
    if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
        with contextlib.suppress(InputError):
            cache_compiled()


def _keep_freed_memory() -> None:
    """Have glibc keep freed memory instead of returning it to the system.

    XLA allocates its arrays anew in every call, and the kernel then clears every page, which is a
    quarter of the time of a loop. Without glibc nothing is changed.
    """
    import ctypes

    with contextlib.suppress(AttributeError, OSError, TypeError):  # another C library or system
        mallopt = ctypes.CDLL(None).mallopt
        # of malloc.h: M_TRIM_THRESHOLD and M_TOP_PAD in bytes, M_MMAP_MAX in mappings
        for option, value in ((-1, 2**31 - 1), (-2, 2**26), (-4, 0)):
            mallopt(option, value)


def warn(lines: Iterable[str], kind: str = "warning") -> None:
    """Print each line on stderr as a warning, or as another `kind` of message."""
    for line in lines:
        print(f"jaxfric: {kind}: {line}", file=sys.stderr)


def stdout_console(width: int = 120) -> "Console":
    """Return a rich console for stdout.

    If stdout is no terminal, the console is `width` columns wide, or as wide as COLUMNS if COLUMNS
    is larger.
    """
    from rich.console import Console

    told = os.environ.get("COLUMNS", "")
    width = max(width, int(told)) if told.isdecimal() else width
    return Console(width=None if sys.stdout.isatty() else width, highlight=False)


def optional_quantity(text: str | None, unit: str, option: str) -> float | None:
    """Read a quantity from a text and return it in `unit`; return None for None."""
    return None if text is None else parse_quantity(text, unit, option)


_UNITS = {
    "velocity": "m/s",
    "mass": "kg",
    "kp": "N/m",
    "kv": "N*s/m",
    "ki": "N/(m*s)",
    "integral": "N/(m*s)",
    "accuracy": "m",
    "jump": "m",
    "duration": "s",
}
"""SI units, in linear motion, of options by the last word of their names: max_kp is in N/m."""


class OfMotion:
    """Options in units of linear motion or of rotation; all options and the law must agree.

    **Arguments:** the law's coordinate, then the texts of options by name. `options` is a group of
    options; options without a unit of motion are ignored.

    Raises `InputError` if the options and the law disagree.
    """

    def __init__(self, law: Coordinate | None, options: object = None, **texts: str | None):
        self._options = {
            f"--{name.replace('_', '-')}": (text, _UNITS[unit])
            for name, text in {**texts, **(vars(options) if options else {})}.items()
            if (unit := name.rpartition("_")[2]) in _UNITS
        }
        self.coordinate = agreed(self._options, law)

    def unit(self, option: str) -> str:
        """Return the SI unit of an option."""
        return unit_of(self._options[option][1], self.coordinate)

    def read(self, option: str) -> float | None:
        """Return the quantity in SI, or None."""
        return optional_quantity(self._options[option][0], self.unit(option), option)

    def damping(self, option: str) -> float:
        """Return a damping of at least 0; 0 if none is given."""
        value = self.read(option)
        if value is not None and value < 0:
            text = self._options[option][0]
            raise InputError(f"{option}: '{text}' is negative; damping is 0 or more")
        return value or 0.0

    def values(self, option: str) -> list[float]:
        """Return one or several positive values (`parse_values`); none without the option.

        A mass without a unit is in kg, or kg m^2.
        """
        text, unit = self._options[option][0], self.unit(option)
        if text is None:
            return []
        if option == "--mass":
            with contextlib.suppress(ValueError):
                float(text)
                text = f"{text} {unit}"
        return parse_values(text, unit, option, count=5 if option == "--mass" else 25)

    def one(self, option: str) -> float | None:
        """Return one positive value, or None; refuse several."""
        values = self.values(option)
        if len(values) > 1:
            text = self._options[option][0]
            raise InputError(f"{option}: '{text}' is more than one value; give one")
        return values[0] if values else None


def effect_ids(texts: list[str] | None, option: str) -> tuple[str, ...]:
    """Return distinct effect ids of a repeated option, or of ids joined by commas."""
    found = [id.strip() for text in texts or [] for id in text.split(",")]
    if texts and not all(found):
        raise InputError(
            f"{option} '{','.join(texts)}' has an empty id; write {option} viscous,gain"
        )
    return tuple(dict.fromkeys(found))
