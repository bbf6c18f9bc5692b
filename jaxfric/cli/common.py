"""Helpers that several verbs share: reading a record or a law, preparing JAX, telling."""

import contextlib
import os
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal, NamedTuple, TypeVar

from ..errors import InputError
from ..pairs import read_pairs
from .told import doing as doing
from .told import told as told

if TYPE_CHECKING:
    from rich.console import Console

    from ..coordinate import Coordinate
    from ..laws.source import LawSource
    from ..records import AxisRecord, Record
    from ..stability.analysis import Law


def read_record(
    file: Path,
    columns: list[str] | None,
    drop_bad: bool,
    since: str | None = None,
    until: str | None = None,
    *,
    reduce: Path | None = None,
) -> "Record":
    """The record, with columns given as ROLE=NAME texts, reduced by a script, and cut to the window
    of `Since`, `Until`."""
    from ..records import read

    roles = read_pairs(columns or (), "--column", "--column friction=mu", form="ROLE=NAME")
    record = read(file, columns=roles or None, drop_bad=drop_bad, reduce=reduce)
    warn(record.provenance.doubts)
    return windowed(record, since, until)


AnyRecord = TypeVar("AnyRecord", "Record", "AxisRecord")


def windowed(record: AnyRecord, since: str | None, until: str | None) -> AnyRecord:
    """The rows of a record (of a slider or an axis) that `Since` and `Until` ask for."""
    return record if since is None and until is None else record.window(since, until)  # ty: ignore[invalid-explicit-return]


class AxisColumns(NamedTuple):
    """How the columns of an axis, or of its steady runs, are read: arguments of their readers."""

    columns: dict[str, str] | None
    drive_gain: str | None
    rated_torque: str | None
    flip: str | Literal[False]
    drop_bad: bool

    @staticmethod
    def of(
        columns: list[str] | None,
        drive_gain: str | None,
        rated_torque: str | None,
        flip: Sequence[str] | None,
        drop_bad: bool,
    ) -> "AxisColumns":
        """The columns from the options: ROLE=NAME texts, and the signs that `Flip` turns."""
        return AxisColumns(axis_roles(columns), drive_gain, rated_torque, flipped(flip), drop_bad)


def axis_roles(columns: list[str] | None) -> dict[str, str] | None:
    """Columns of an axis, given as ROLE=NAME texts."""
    example = "--column motor_force=F"
    return read_pairs(columns or (), "--column", example, form="ROLE=NAME") or None


def refuse_unused(by: str, options: Mapping[str, object], instead: str = "") -> None:
    """Refuse options that something has no use for."""
    wrong = [option for option, given in options.items() if given]
    if wrong:
        raise InputError(
            f"{' and '.join(wrong)} would not be used with {by}; leave it out{instead}"
        )


def flipped(flip: Sequence[str] | None) -> str | Literal[False]:
    """The sign that `Flip` asks to turn, "both", or False for none."""
    if flip is None:
        return False
    return flip[0] if len(set(flip)) == 1 else "both"


def prepare_jax(*, gpu: bool = False) -> None:
    """64-bit numbers, loops compiled whole, and a compilation cache in the user's cache folder if
    there can be one.

    On the processor, but for who sets JAX_PLATFORMS: a record asks for many small things in turn,
    which take a GPU ten times as long. With `gpu` JAX takes one where there is one.
    """
    doing("loading JAX")
    _keep_freed_memory()
    if not gpu:
        os.environ.setdefault("JAX_PLATFORMS", "cpu")
    # XLA takes preferences of some processors for features that these lack, and says so of all that
    # it loads from the cache (jax issue 38445); what goes wrong is an exception. "1" is JAX's own
    # default, which a process begun from Python inherits
    if os.environ.get("TF_CPP_MIN_LOG_LEVEL", "1") == "1":
        os.environ["TF_CPP_MIN_LOG_LEVEL"] = "3"
    import jax

    if not gpu and jax.config.jax_platforms is None:  # ty: ignore[missing-attribute]
        jax.config.update("jax_platforms", os.environ["JAX_PLATFORMS"])

    from ..cache import cache_compiled, whole_loops

    whole_loops()
    jax.config.update("jax_enable_x64", True)
    if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
        with contextlib.suppress(InputError):
            cache_compiled()


def _keep_freed_memory() -> None:
    """Have glibc keep memory that is freed, instead of giving it back and asking for it anew.

    XLA allocates the arrays of a call again in every call; the kernel clears each of their pages
    each time, which is a quarter of the time of a loop. Elsewhere nothing is done.
    """
    import ctypes

    with contextlib.suppress(AttributeError, OSError, TypeError):  # another C library or system
        mallopt = ctypes.CDLL(None).mallopt
        # of malloc.h: M_TRIM_THRESHOLD and M_TOP_PAD in bytes, M_MMAP_MAX in mappings
        for option, value in ((-1, 2**31 - 1), (-2, 2**26), (-4, 0)):
            mallopt(option, value)


def warn(lines: Iterable[str], kind: str = "warning") -> None:
    """Print each line as a warning, or another kind of remark, on stderr."""
    for line in lines:
        print(f"jaxfric: {kind}: {line}", file=sys.stderr)


def stdout_console(width: int = 120) -> "Console":
    """A console of rich for tables on stdout, so wide, or as COLUMNS says if that is more, where
    stdout is no terminal."""
    from rich.console import Console

    told = os.environ.get("COLUMNS", "")
    width = max(width, int(told)) if told.isdecimal() else width
    return Console(width=None if sys.stdout.isatty() else width, highlight=False)


def read_law(
    fit: Path | None,
    law: str | None,
    parameters: str | None,
    normal_force: str | None,
    *,
    samples: int = 0,
    seed: int = 0,
    memory: str | None = None,
) -> "LawSource":
    """The law that the options name, as a `LawSource`."""
    from ..laws.source import law_from_parameters
    from ..saved.law import law_from_fit

    if fit is not None:
        if law is not None or parameters is not None:
            raise InputError("--from and --law with --parameters exclude each other; give one")
        source = law_from_fit(
            fit, normal_force=normal_force, samples=samples, seed=seed, memory=memory
        )
        warn(source.warnings)
        return source
    if memory is not None:
        raise InputError("--memory goes with --from and a table of friction against speed")
    if law is None or parameters is None:
        raise InputError(
            "no friction law: give a fit with --from fit.json, or --law slip with --parameters"
            " 'A=1 N, B=3 N, L=1 mm, V0=2 mm/s'"
        )
    if normal_force is not None:
        raise InputError("--normal-force goes with --from; give --parameters in newtons")
    return law_from_parameters(law, parameters)


def read_samples(fit: Path | None, normal_force: str | None, number: int = 256) -> "Law | None":
    """So many samples of the law that `read_law` has read from a file; None without a file, and of
    a fit that leaves parameters undetermined, which its law has warned of."""
    from ..laws.source import without_first
    from ..saved.law import law_from_fit

    if fit is None:
        return None
    try:
        return without_first(law_from_fit(fit, normal_force=normal_force, samples=number).samples)
    except InputError:
        return None


def optional_quantity(text: str | None, unit: str, option: str) -> float | None:
    """A quantity [`unit`] or None."""
    from ..units import parse_quantity

    return None if text is None else parse_quantity(text, unit, option)


class OfMotion:
    """Options whose units are of a line, or of a rotation: all of them, and the law, must agree.

    **Arguments:** the options with the SI unit of each on a line, and the law's coordinate.

    Raises `InputError` where they disagree.
    """

    def __init__(
        self, options: Mapping[str, tuple[str | None, str]], law: "Coordinate | None" = None
    ):
        from ..coordinate import agreed

        self._options = options
        self.coordinate = agreed(options, law)

    def unit(self, option: str) -> str:
        """The SI unit of an option."""
        from ..coordinate import unit_of

        return unit_of(self._options[option][1], self.coordinate)

    def read(self, option: str) -> float | None:
        """The quantity in SI, or None."""
        return optional_quantity(self._options[option][0], self.unit(option), option)

    def positive(self, option: str) -> float | None:
        """A quantity above 0, or None."""
        value = self.read(option)
        if value is not None and not value > 0:
            raise InputError(f"{option}: '{self._options[option][0]}' is not positive")
        return value

    def damping(self, option: str) -> float:
        """A damping, 0 where none is given."""
        value = self.read(option)
        if value is not None and value < 0:
            text = self._options[option][0]
            raise InputError(f"{option}: '{text}' is negative; damping is 0 or more")
        return value or 0.0

    def values(self, option: str, *, count: int = 25) -> list[float]:
        """One or several positive values (`parse_values`)."""
        from ..units import parse_values

        text, _ = self._options[option]
        assert text is not None
        return parse_values(text, self.unit(option), option, count=count)

    def masses(self) -> list[float] | None:
        """Masses of --mass; a number alone is in kg, or kg m^2. None where none is given."""
        from ..units import parse_values

        text, _ = self._options["--mass"]
        if text is None:
            return None
        with contextlib.suppress(ValueError):
            float(text)
            text = f"{text} {self.unit('--mass')}"
        return parse_values(text, self.unit("--mass"), "--mass", count=5)

    def mass(self) -> float | None:
        """One mass, or None."""
        masses = self.masses()
        if masses is not None and len(masses) > 1:
            text = self._options["--mass"][0]
            raise InputError(f"--mass: '{text}' is more than one mass; give one, as in '2 kg'")
        return None if masses is None else masses[0]


def effect_ids(texts: list[str] | None, option: str) -> tuple[str, ...]:
    """Ids of an option that may be repeated and hold commas, each once."""
    found = [id.strip() for text in texts or [] for id in text.split(",")]
    if texts and not all(found):
        raise InputError(
            f"{option} '{','.join(texts)}' has an empty id; write {option} viscous,gain"
        )
    return tuple(dict.fromkeys(found))
