"""Functions that several verbs use: quantities of options, setup of JAX, warnings."""

import contextlib
import os
import sys
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

from ..errors import InputError
from .told import doing as doing
from .told import told as told

if TYPE_CHECKING:
    from rich.console import Console

    from ..coordinate import Coordinate


def refuse_unused(by: str, options: Mapping[str, object], instead: str = "") -> None:
    """Raise `InputError` for options that would have no effect; `by` names the reason."""
    wrong = [option for option, given in options.items() if given]
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
    from ..units import parse_quantity

    return None if text is None else parse_quantity(text, unit, option)


class OfMotion:
    """Options in units of linear motion or of rotation; all options and the law must agree.

    **Arguments:** the options, each with its SI unit in linear motion, and the law's coordinate.

    Raises `InputError` if the options and the law disagree.
    """

    def __init__(
        self, options: Mapping[str, tuple[str | None, str]], law: "Coordinate | None" = None
    ):
        from ..coordinate import agreed

        self._options = options
        self.coordinate = agreed(options, law)

    def unit(self, option: str) -> str:
        """Return the SI unit of an option."""
        from ..coordinate import unit_of

        return unit_of(self._options[option][1], self.coordinate)

    def read(self, option: str) -> float | None:
        """Return the quantity in SI, or None."""
        return optional_quantity(self._options[option][0], self.unit(option), option)

    def positive(self, option: str) -> float | None:
        """Return a positive quantity, or None; refuse 0 and negative ones."""
        value = self.read(option)
        if value is not None and not value > 0:
            raise InputError(f"{option}: '{self._options[option][0]}' is not positive")
        return value

    def damping(self, option: str) -> float:
        """Return a damping of at least 0; 0 if none is given."""
        value = self.read(option)
        if value is not None and value < 0:
            text = self._options[option][0]
            raise InputError(f"{option}: '{text}' is negative; damping is 0 or more")
        return value or 0.0

    def values(self, option: str, *, count: int = 25) -> list[float]:
        """Return one or several positive values (`parse_values`)."""
        from ..units import parse_values

        text, _ = self._options[option]
        assert text is not None
        return parse_values(text, self.unit(option), option, count=count)

    def masses(self) -> list[float] | None:
        """Return the masses of --mass, or None. A number without a unit is in kg, or kg m^2."""
        from ..units import parse_values

        text, _ = self._options["--mass"]
        if text is None:
            return None
        with contextlib.suppress(ValueError):
            float(text)
            text = f"{text} {self.unit('--mass')}"
        return parse_values(text, self.unit("--mass"), "--mass", count=5)

    def mass(self) -> float | None:
        """Return one mass, or None; refuse several."""
        masses = self.masses()
        if masses is not None and len(masses) > 1:
            text = self._options["--mass"][0]
            raise InputError(f"--mass: '{text}' is more than one mass; give one, as in '2 kg'")
        return None if masses is None else masses[0]


def effect_ids(texts: list[str] | None, option: str) -> tuple[str, ...]:
    """Return distinct effect ids of a repeated option, or of ids joined by commas."""
    found = [id.strip() for text in texts or [] for id in text.split(",")]
    if texts and not all(found):
        raise InputError(
            f"{option} '{','.join(texts)}' has an empty id; write {option} viscous,gain"
        )
    return tuple(dict.fromkeys(found))
