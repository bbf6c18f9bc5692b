"""`jaxfric study`: compute results for very many sliders; a killed study can be continued."""

import json
import math
import os
import signal
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from ..errors import InputError
from . import options
from .call import current_call
from .common import prepare_jax, warn
from .folder import choose_folder, json_text
from .shown import show
from .told import doing, pause

if TYPE_CHECKING:
    from ..study.progress import Progress


@options.FLAT
@dataclass(frozen=True)
class StudyOptions:
    """Options for computing a study, or for drawing its store."""

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
        """The address of the scheduler; None without a scheduler."""
        if self.scheduler_file is None:
            return self.scheduler
        if self.scheduler is not None:
            raise InputError("--scheduler and --scheduler-file exclude each other; give one")
        file = self.scheduler_file
        try:
            return str(json.loads(file.read_text(encoding="utf-8"))["address"])
        except (OSError, ValueError, KeyError, TypeError) as error:
            why = getattr(error, "strerror", None) or "is not what a scheduler writes"
            raise InputError(
                f"--scheduler-file {file}: {why}; start a scheduler with: dask scheduler"
                f" --scheduler-file {file}"
            ) from None


def study(
    file: Annotated[Path | None, Parameter(help="The study: a TOML file.")] = None,
    /,
    *,
    how: StudyOptions = StudyOptions(),
    output: options.OutputOptions = options.OutputOptions(),
) -> int:
    """Run a parameter study: margins, end states, gains, fits or loops over axes and samples.

    Results are written to a Zarr store, chunk by chunk. Repeat the command to continue a study that
    was stopped or killed. A continued study verifies the checksum of each chunk, and computes
    damaged chunks again. If members fail with an error, the exit code is 1.
    """
    from ..study.store import require_packages

    require_packages()
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
    from ..report.study_text import content, report

    begun = time.monotonic()
    before = signal.signal(signal.SIGTERM, _terminated)
    teller = _Teller()
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
    except KeyboardInterrupt as end:
        message = f"jaxfric: stopped: {teller.state}; to go on: {current_call().command}"
        print(message, file=sys.stderr, flush=True)
        raise SystemExit(end.args[0] if end.args else 130) from None
    finally:
        signal.signal(signal.SIGTERM, before)
    told_of = report(found, time.monotonic() - begun, teller.members, destination)
    text = json_text(content(found, destination, teller.members))
    show(told_of, f"written: {destination}", text, output)
    if failed := sum(found.attrs["errors"].values()):
        warn([f"{failed} members failed; the next run computes them again"], "error")
    return int(failed > 0)


def _terminated(*_: object) -> None:
    """Interrupt for another process: a queue whose time is over, a machine that goes down."""
    raise KeyboardInterrupt(143)


def _ask(text: str) -> None:
    """Go on only where someone says so."""
    pause()
    if sys.stdin is not None and sys.stdin.isatty() and sys.stderr.isatty():
        print(f"jaxfric: {text}. Begin? [y/N] ", end="", file=sys.stderr, flush=True)
        if sys.stdin.readline().strip().lower() in ("y", "yes"):
            return
    raise InputError(f"{text}; begin it with --yes, or take fewer")


def _use_all_cores() -> None:
    """A device of JAX for every core, unless there is a say in it: loops do not share one."""
    import jax

    if "xla_force_host_platform_device_count" in os.environ.get("XLA_FLAGS", ""):
        return
    try:
        jax.config.update("jax_num_cpu_devices", _cores())
    except RuntimeError:  # JAX has its devices already
        return


def _cores() -> int:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class _Teller:
    """Tells how far a run is, and keeps it for who stops the run."""

    def __init__(self):
        self.members = 0
        self.state = "no new chunk is written yet"

    def note(self, text: str) -> None:
        """Print a message of the study; warnings are also printed with --quiet."""
        from ..findings import Warned  # only here: the command begins without NumPy

        if isinstance(text, Warned):
            warn([text])
        else:
            doing(text)

    def progress(self, now: "Progress") -> None:
        """Report that a chunk was written."""
        from ..units import duration

        self.members = now.members
        self.state = f"{now.written} of {now.blocks} chunks are written"
        rate = "" if math.isnan(now.rate) else f", {now.rate:.3g} members/s"
        left = "" if math.isnan(now.left) or not now.left else f", {duration(now.left)} left"
        doing(f"chunk {now.written} of {now.blocks}{rate}{left}")


def _draw(store: str, output: options.OutputOptions) -> int:
    from ..plot.study import draw_study
    from ..report.report import Report
    from ..study import load

    found = load(store)
    name = store.rstrip("/").rsplit("/", 1)[-1].removesuffix(".zarr")
    inputs = [] if "://" in store else [Path(store)]
    warn(found.attrs.get("warnings", ()))
    folder = choose_folder(replace(output, out=output.out or f"{name}-figures"), "", *inputs)
    folder.save({})
    names = folder.draw("figures", lambda to: draw_study(found, to))
    pictures = [name for name in names if name.endswith(".png")]
    written = f"written: {folder.path}/{', '.join(pictures)} (and .svg)" if names else ""
    folder.content = json_text({"store": store, "figures": folder.paths})
    return folder.finish(Report(), written)
