"""Choose and write the output folder of a command, and replace files of earlier runs.

Every output folder holds a hidden file, `.jaxfric.json`. For every verb, `.jaxfric.json` lists the
command, the input files and the written files. From this list the next run finds the files to
replace and the stale files of an earlier run. The list also shows whether the folder belongs to
another input.
"""

import dataclasses
import hashlib
import io
import json
import os
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import InputError
from ..report.output import output_folder
from ..report.version import installed_version
from ..schemas import FOLDER
from .call import Call, current_call, made_by
from .common import warn
from .shown import OutputOptions, show
from .told import doing, pause

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ..posterior import Posterior
    from ..report.report import Report

NOTES = ".jaxfric.json"
_NOT_NAMED = {
    # inputs without a default
    *("from_", "parameters", "normal_force", "mass", "velocity", "velocities", "stiffness", "kp"),
    # data of a machine
    *("drive_gain", "rated_torque", "position_gain", "velocity_gain", "kv", "noise"),
    # options of reading
    *("file", "more", "reduce", "column", "drop_bad", "rig", "flip_sign", "model", "record"),
    # options of printing, and others that do not change a result
    *("out", "details", "json", "quiet", "plot", "name", "scheduler", "slip_per_step"),
}
"""Options that the name of a folder leaves out."""
# Choices whose value needs no option name in front: `ageing`, `whitened`.
_ALONE = frozenset(("law", "weighting"))
_LONGEST_VALUE, _LONGEST_NAME = 24, 120


def folder_name(source: str, verb: str, given: dict[str, object]) -> str:
    """Return SOURCE-VERB with the options that differ from the default: `run-fit-ageing`."""
    tags = [_tag(name, value) for name, value in given.items() if name not in _NOT_NAMED]
    name = "-".join([*filter(None, (source, verb)), *tags])
    if len(name) <= _LONGEST_NAME:
        return name
    return f"{name[: _LONGEST_NAME - 9]}-{_short_digest(name)}"


def _tag(name: str, value: object) -> str:
    word = name.strip("_").replace("_", "-")
    if value is True:
        return word
    if value is False:
        return f"no-{word}"
    text = f"{value:g}" if isinstance(value, float) else str(value)
    if isinstance(value, list | tuple):  # each may hold commas
        words = (piece.strip() for text in value for piece in str(text).split(","))
        text = "+".join(dict.fromkeys(words))
    safe = re.sub(r"[^A-Za-z0-9.+_-]+", "_", text.replace(" ", "").replace("=", "")).strip("_")
    if not safe or len(safe) > _LONGEST_VALUE:
        safe = _short_digest(text)
    if name in _ALONE:
        return safe
    return f"{word}{'' if safe[0].isdigit() else '-'}{safe}"


def _short_digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:8]


def source_name(file: Path) -> str:
    """Return the name of a saved result; for a standard file name return the folder's name."""
    folder = file.parent.name
    return folder if folder and file.stem in ("fit", "loop", "posterior", "steady") else file.stem


def input_name(path: Path) -> str:
    """Return the name of an input: of a file without suffix, of a folder in full (`0.096kg`).

    For the folder "." the function returns the folder's real name.
    """
    if path.name in ("", ".."):
        return path.resolve().name
    return path.name if path.is_dir() else path.stem


def choose_folder(
    output: OutputOptions, source: str, *inputs: Path | None, unnamed: Sequence[str] = ()
) -> "Folder":
    """Return the output folder of this call, --out or its default name, checked before any work.

    An input may be None: it was not given. The default name leaves out the options `unnamed`,
    because `source` already contains them.
    Raises `InputError` if the folder cannot be written, or if a run would overwrite results of
    another record in the folder. In a folder with the default name all inputs must be the same as
    before, not only the record.
    """
    call = current_call()
    given = {name: value for name, value in call.given.items() if name not in unnamed}
    path = Path(folder_name(source, call.verb, given) if output.out is None else output.out)
    folder = Folder(path, call, tuple(file for file in inputs if file is not None), output)
    with output_folder(path):
        pass
    folder.refuse_another_input(asked_for=output.out is not None)
    return folder


@dataclasses.dataclass
class Folder:
    """An output folder during a run; a verb writes results, then figures, then calls `close`."""

    path: Path
    call: Call
    inputs: tuple[Path, ...]
    output: OutputOptions
    files: list[str] = dataclasses.field(default_factory=list)
    earlier: list[str] = dataclasses.field(default_factory=list)
    """Files that were here before this run, and that it replaced or removed."""
    made_by: str = "an unknown command"
    """The command that wrote the `earlier` files."""
    code: int = 0
    """The exit code of the verb: 1 if a figure is missing, 141 if nobody reads the output."""
    content: str = ""
    """The JSON text that --json prints."""

    def refuse_another_input(self, *, asked_for: bool = False) -> None:
        """Raise `InputError` if the folder holds results of this verb for another input.

        An input is the same if its path or its content is the same. If the folder was given by
        --out (`asked_for`), only the first input is compared, which is the record. A second run
        with another prior or other events may replace the results.
        """
        before = _read_notes(self.path).get(self.call.verb, {}).get("inputs", [])
        for old, new in zip(before, self._inputs()[: 1 if asked_for else None], strict=False):
            if old["path"] != new["path"] and old["sha256"] != new["sha256"]:
                where = os.path.normpath(self.path / old["path"])
                raise InputError(
                    f"{self.path} holds the results of another input, {where}; give another folder"
                    " with --out"
                )

    def save(self, texts: Mapping[str, str], draws: "Posterior | None" = None) -> None:
        """Write texts to files by name, and draws to posterior.nc: the first files of a run.

        The files replace the files of the same verb's last run. Files of the last run that the new
        run does not write again are deleted. Files of other verbs stay.
        """

        def write(to: Path) -> None:
            for name, text in texts.items():
                (to / name).write_text(text, encoding="utf-8", errors="backslashreplace")
            if draws is not None:
                from ..posterior import write_netcdf

                write_netcdf(draws, to / "posterior.nc")

        runs = _read_notes(self.path)
        if (last := runs.pop(self.call.verb, None)) is not None:
            self.earlier = [name for name in last["files"] if (self.path / name).is_file()]
            self.made_by = f"'{last['command']}'"
        self._add(write)
        of_others = {name for run in runs.values() for name in run["files"]}
        for name in {*self.earlier} - {*self.files} - of_others:
            (self.path / name).unlink(missing_ok=True)

    def save_json(
        self,
        name: str,
        table: Mapping[str, object],
        others: Mapping[str, str] | None = None,
        draws: "Posterior | None" = None,
    ) -> None:
        """Write a table as the JSON file `name`, `others` and draws; --json prints this table."""
        self.content = json_text(table)
        self.save({**(others or {}), name: self.content + "\n"}, draws)

    def draw(self, what: str, drawing: Callable[[Path], object]) -> list[str]:
        """Add `what`, a figure or page; a failure of drawing leaves all other files intact.

        `drawing` is a function that writes into the folder that it is given. The method returns the
        names of the new files.
        """
        doing("drawing figures")
        try:
            return self._add(drawing)
        except KeyboardInterrupt:
            print(
                f"jaxfric: interrupted at {what}; the numbers are in {self.path}/", file=sys.stderr
            )
            raise SystemExit(130) from None
        except Exception as error:
            if os.environ.get("JAXFRIC_DEBUG"):
                raise
            self.code = 1
            reason = " ".join(str(error).split())
            if not isinstance(error, InputError):
                reason = f"{type(error).__name__}: {reason}"
            end = f"all else is in {self.path}/. JAXFRIC_DEBUG=1 shows where"
            warn([f"{what} was not drawn ({reason}); {end}"])
            return []

    def draw_figure(self, what: str, make: Callable[[], "Figure"], *files: str) -> None:
        """Add a figure as `files`, by default WHAT.png and WHAT.svg; see `draw`."""
        from ..plot.style import write

        names = files or (f"{what}.png", f"{what}.svg")
        self.draw(what, lambda to: write(make(), *(to / name for name in names)))

    def draw_page(self, name: str, kind: str, page: Callable[[dict[str, bytes]], str]) -> None:
        """Add a page that shows all figures of this run with the suffix `kind`."""

        def write(to: Path) -> None:
            files = [file for file in self.files if file.endswith(kind)]
            pictures = {file: (self.path / file).read_bytes() for file in files}
            (to / name).write_text(page(pictures), encoding="utf-8")

        self.draw(name, write)

    @property
    def paths(self) -> list[str]:
        """Paths of the files written by this run."""
        return [str(self.path / name) for name in self.files]

    @property
    def written(self) -> str:
        """Text line that lists the files written by this run."""
        return f"written: {self.path}/{', '.join(self.files)}"

    @property
    def replaced(self) -> str:
        """Text line that lists the replaced files; '' if no file was replaced."""
        if not self.earlier:
            return ""
        return f"replaced in {self.path}: {', '.join(self.earlier)}, written by {self.made_by}"

    def finish(self, report: "Report", written: str | None = None) -> int:
        """Print the report and the written files; return the exit code of the verb."""
        show(report, self.written if written is None else written, self.content, self.output)
        return self.close()

    def answer(self, report: "Report") -> None:
        """Print the report before the figures; after them call `end`. A user who stops the figures
        has the numbers. A reader of the output who stops after a few lines has the figures."""
        try:
            show(report, "", self.content, self.output)
            sys.stdout.flush()
        except (BrokenPipeError, SystemExit):  # rich exits on a broken pipe
            self.code, sys.stdout = 141, io.StringIO()

    def end(self, written: str | None = None) -> int:
        """Print the written files after `answer`; return the exit code of the verb."""
        pause()
        if not self.output.json:
            print(f"\n{self.written if written is None else written}")
        return self.close()

    def close(self) -> int:
        """Print the replaced files and return the exit code of the verb."""
        if self.replaced:
            print(f"jaxfric: {self.replaced}", file=sys.stderr)
        return self.code

    def _inputs(self) -> list[dict[str, str]]:
        """Return path and SHA-256 of each input; '' for a folder."""
        return [
            {
                "path": self._from_here(file),
                "sha256": hashlib.sha256(file.read_bytes()).hexdigest() if file.is_file() else "",
            }
            for file in self.inputs
        ]

    def _from_here(self, file: Path) -> str:
        try:
            return Path(os.path.relpath(file.resolve(), self.path.resolve())).as_posix()
        except ValueError:  # on another drive
            return file.resolve().as_posix()

    def _add(self, write: Callable[[Path], object]) -> list[str]:
        """Add the files that `write` makes in a folder, and note them; return their names.

        No file is added or replaced unless `write` makes all of them.
        """
        with output_folder(self.path) as work:
            write(work)
            new = sorted(file.name for file in work.iterdir())
            there = {name for name in new if (self.path / name).is_file()}
            self.earlier += sorted(there - {*self.earlier, *self.files})
            notes = _read_notes(self.path)
            for run in notes.values():
                run["files"] = [name for name in run["files"] if name not in new]
            notes[self.call.verb] = {
                "version": installed_version(),
                "command": self.call.command,
                "inputs": self._inputs(),
                "files": [*self.files, *new],
            }
            content = json.dumps({"schema": FOLDER, "runs": notes}, indent=1)
            (work / NOTES).write_text(content + "\n", encoding="utf-8")
        self.files += new
        return new


def json_text(table: Mapping[str, object]) -> str:
    """Return a table as JSON text with version and command. NaN raises `ValueError`: use None."""
    origin = made_by()
    return json.dumps(
        {**table, **({"made_by": origin} if origin else {})}, indent=1, allow_nan=False
    )


def _read_notes(folder: Path) -> dict[str, dict[str, Any]]:
    """Return the last run of every verb in a folder: command, inputs, and files of the folder.

    The table is empty if the notes are missing or damaged.
    """
    try:
        runs = json.loads((folder / NOTES).read_text(encoding="utf-8"))["runs"]
        return {
            verb: {
                "version": str(run.get("version", "")),
                "command": str(run["command"]),
                "inputs": [{key: str(i[key]) for key in ("path", "sha256")} for i in run["inputs"]],
                "files": [str(name) for name in run["files"] if Path(name).name == name],
            }
            for verb, run in runs.items()
        }
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return {}
