"""`jaxfric study`: the same question of a great many sliders, in a store that survives a kill."""

import contextlib
import json
import math
import os
import signal
import sys
import time
from collections.abc import Callable, Generator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from ..errors import InputError
from ..schemas import STUDY_SUMMARY
from . import options
from .call import current_call
from .common import prepare_jax, told, warn
from .folder import choose_folder, json_text

if TYPE_CHECKING:
    from xarray import Dataset

    from ..study.progress import Progress

# Without a terminal progress is told once in so many seconds.
_EVERY = 10.0
# Texts of errors in the summary.
_SHOWN = 5
# What a message of a study that is a warning begins with.
_WARNING = "warning: "


@options.FLAT
@dataclass(frozen=True)
class StudyOptions:
    """Computation of a study, or drawing of its store."""

    function: str | None = None
    """Your own function of the parameters, FILE.py:NAME, in place of the key compute."""
    plot: str | None = None
    """Draw maps and marginal curves of a store, complete or not."""
    scheduler: str | None = None
    """Address of a Dask scheduler whose workers compute: tcp://HOST:8786."""
    scheduler_file: Annotated[Path | None, options.MORE] = None
    """File to which a Dask scheduler wrote its address."""
    yes: Annotated[bool, options.MORE] = False
    """Start a very large study without asking."""
    other_versions: Annotated[bool, options.MORE] = False
    """Continue a store that other versions of jaxfric or its packages began."""

    def address(self) -> str | None:
        """The address of the scheduler, where there is one."""
        if self.scheduler_file is None:
            return self.scheduler
        if self.scheduler is not None:
            raise InputError("--scheduler and --scheduler-file exclude each other; give one")
        return _address(self.scheduler_file)


def study(
    file: Annotated[Path | None, Parameter(help="The study: a TOML file.")] = None,
    /,
    *,
    how: StudyOptions = StudyOptions(),
    output: options.OutputOptions = options.OutputOptions(),
) -> int:
    """Run a parameter study: margins, end states, gains, fits or loops over axes and samples.

    Results go to a Zarr store, chunk by chunk. The same command continues a study that was stopped
    or killed. It verifies the checksum of each chunk, and computes damaged chunks again.
    """
    _require()
    if how.plot is not None:
        if file is not None or how.scheduler is not None or how.function is not None:
            raise InputError("--plot takes a store and no study; leave the study.toml out")
        return _draw(how.plot, output)
    if file is None:
        raise InputError("no study: give a TOML file, or a store to draw with --plot study.zarr")
    destination = output.out or f"{file.stem}.zarr"
    scheduler = how.address()
    _use_all_cores()
    prepare_jax(gpu=True)
    from ..members import run_study

    begun = time.monotonic()
    with told() as progress, _ended_by_sigterm():
        teller = _Teller(progress.say)
        try:
            found = run_study(
                file,
                destination,
                function=how.function,
                scheduler=scheduler,
                processes=_cores(),
                ask=None if how.yes else _ask,
                other_versions=how.other_versions,
                progress=teller.progress,
                tell=teller.note,
            )
        except KeyboardInterrupt as interrupt:
            message = f"jaxfric: stopped: {teller.state}; to go on: {current_call().command}"
            print(message, file=sys.stderr, flush=True)
            raise SystemExit(143 if isinstance(interrupt, _Terminated) else 130) from None
    if output.json:
        print(json_text(_content(found, destination, teller.members)))
        return 0
    for line in _summary(found, time.monotonic() - begun, teller.members):
        print(line)
    print(f"written: {destination} (draw it: jaxfric study --plot {destination})")
    return 0


class _Terminated(KeyboardInterrupt):
    """Asked to end by another process: a queue whose time is over, a machine that goes down."""


def _terminated(*_: object) -> None:
    raise _Terminated


@contextlib.contextmanager
def _ended_by_sigterm() -> Generator[None]:
    """Within the block SIGTERM raises `_Terminated`; in the main thread only."""
    before = signal.SIG_DFL
    with contextlib.suppress(ValueError):  # not in the main thread
        before = signal.signal(signal.SIGTERM, _terminated)
    try:
        yield
    finally:
        with contextlib.suppress(ValueError):
            signal.signal(signal.SIGTERM, before)


def _address(file: Path) -> str:
    """What a scheduler wrote with --scheduler-file."""
    try:
        return str(json.loads(file.read_text(encoding="utf-8"))["address"])
    except OSError as error:
        raise InputError(f"--scheduler-file {file}: {error.strerror}") from None
    except (ValueError, KeyError, TypeError):
        raise InputError(
            f"--scheduler-file {file}: is not what a scheduler writes; start one with: dask"
            f" scheduler --scheduler-file {file}"
        ) from None


def _ask(text: str) -> None:
    """Go on only where someone says so."""
    if sys.stdin is not None and sys.stdin.isatty() and sys.stderr.isatty():
        print(f"jaxfric: {text}. Begin? [y/N] ", end="", file=sys.stderr, flush=True)
        if sys.stdin.readline().strip().lower() in ("y", "yes"):
            return
    raise InputError(f"{text}; begin it with --yes, or take fewer")


def _require() -> None:
    from ..study.store import require_packages

    require_packages()


def _use_all_cores() -> None:
    """A device of JAX for every core, unless there is a say in it: loops do not share one."""
    import jax

    if "xla_force_host_platform_device_count" in os.environ.get("XLA_FLAGS", ""):
        return
    try:
        jax.config.update("jax_num_cpu_devices", _cores())
    except RuntimeError:  # devices are there already
        return


def _cores() -> int:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class _Teller:
    """Tells how far a run is: always on a terminal, seldom elsewhere."""

    def __init__(self, say: Callable[[str], None]):
        self.say, self.last, self.members = say, time.monotonic(), 0
        self.state = "no chunk is written yet"

    def note(self, text: str) -> None:
        if text.startswith(_WARNING):  # with --quiet too, and on a terminal not for a moment only
            warn([text.removeprefix(_WARNING)])
            return
        if "chunks are written" in text:
            self.state = text
        self.say(text)

    def progress(self, now: "Progress") -> None:
        self.members = now.members
        self.state = f"{now.written} of {now.blocks} chunks are written"
        whole = now.written == now.blocks
        if not (sys.stderr.isatty() or whole or time.monotonic() - self.last > _EVERY):
            return
        self.last = time.monotonic()
        rate = "" if math.isnan(now.rate) else f", {now.rate:.3g} members/s"
        left = "" if whole or math.isnan(now.left) else f", {_duration(now.left)} left"
        self.say(f"chunk {now.written} of {now.blocks}{rate}{left}")


def _duration(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.0f} s"
    if seconds < 5400:
        return f"{seconds / 60:.0f} min"
    return f"{seconds / 3600:.1f} h"


def _summary(found: "Dataset", seconds: float, members: int) -> list[str]:
    """What was computed, and how often each code occurs."""
    dims = found["outcome"].dims
    shape = " x ".join(f"{found.sizes[d]} {d}" for d in dims)
    done = f"{members} computed in {_duration(seconds)}" if members else "nothing left to compute"
    lines = [f"{found['outcome'].size} members ({shape}); {done}"]
    for name, counts in _codes(found).items():
        shares = [f"{count} {code.replace('_', ' ')}" for code, count in counts.items()]
        first = found[name].attrs["flag_meanings"].split()[0]
        if name != "outcome" or list(counts) != [first]:
            lines.append(f"{name}{_asked_of(found, name)}: {', '.join(shares)}")
            lines += _meaning(found, name, counts)
    texts = list(found.attrs["errors"].items())
    lines += [f"  {count} of them: {text}" for text, count in texts[:_SHOWN]]
    if len(texts) > _SHOWN:
        lines.append(f"  and {len(texts) - _SHOWN} other errors, in the attribute 'errors'")
    return lines


def _asked_of(found: "Dataset", name: str) -> str:
    """Of how motions end: after which step."""
    return f" ({found[name].attrs['long_name']})" if name == "end" else ""


def _meaning(found: "Dataset", name: str, counts: dict[str, int]) -> list[str]:
    """What the codes of how motions end mean, of those that occur and are not plain."""
    if name != "end":
        return []
    about = found[name].attrs
    texts = dict(zip(about["flag_meanings"].split(), about["flag_texts"], strict=True))
    return [f"  {code}: {texts[code]}" for code in ("escape", "failed") if code in counts]


def _codes(found: "Dataset") -> dict[str, dict[str, int]]:
    """How often each code occurs, by the variable that has it; "without": members without one."""
    import numpy as np

    every = {}
    for name in found.data_vars:
        about = found[name].attrs
        if "flag_meanings" not in about or found[name].ndim != found["outcome"].ndim:
            continue
        values, counts = np.unique(found[name].values, return_counts=True)
        names = about["flag_meanings"].split()
        every[str(name)] = {
            names[value] if value >= 0 else "without": int(count)
            for value, count in zip(values, counts, strict=True)
        }
    return every


def _content(found: "Dataset", store: str, members: int) -> dict[str, object]:
    """What was computed as JSON; numbers are in the store."""
    return {
        "schema": STUDY_SUMMARY,
        "store": store,
        "members": int(found["outcome"].size),
        "shape": {str(d): found.sizes[d] for d in found["outcome"].dims},
        "computed_now": members,
        "codes": _codes(found),
        "errors": dict(found.attrs["errors"]),
        "warnings": list(found.attrs.get("warnings", ())),
    }


def _draw(store: str, output: options.OutputOptions) -> int:
    from ..plot.study import draw_study
    from ..study import load

    found = load(store)
    name = store.rstrip("/").rsplit("/", 1)[-1].removesuffix(".zarr")
    inputs = [] if "://" in store else [Path(store)]
    warn(found.attrs.get("warnings", ()))
    folder = choose_folder(output.folder or Path(f"{name}-figures"), "", *inputs)
    with told() as progress:
        progress("drawing figures")
        with folder.results():
            pass
        names = folder.draw("figures", lambda to: draw_study(found, to))
    if output.json:
        print(json_text({"store": store, "figures": [str(folder.path / name) for name in names]}))
        return folder.close()
    if names:
        pictures = [name for name in names if name.endswith(".png")]
        print(f"written: {folder.path}/{', '.join(pictures)} (and .svg)")
    if any(name.startswith("map_share_of_") for name in names):
        print(
            "map_share_of_*: the share of the samples at each point of the grid with the first code"
        )
    if names and not any(name.startswith("map_") for name in names):
        print(
            "no map: these are over two grid axes or more; of samples over them, of shares of codes"
        )
    return folder.close()
