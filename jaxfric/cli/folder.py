"""The folder that a command writes to: its name, what was there before, and what is left.

A folder that a command has written to holds a hidden file, `.jaxfric.json`, that says for every
verb which command wrote which files from which input. By it the next run knows what it replaces,
what of an earlier run would be stale, and whether a default name is taken by another input.
"""

import contextlib
import dataclasses
import hashlib
import json
import os
import re
import sys
from collections.abc import Callable, Generator, Mapping, Sequence
from pathlib import Path
from typing import TypedDict

from ..errors import InputError
from ..report.output import output_folder
from ..report.version import installed_version
from .call import Call, current_call
from .stamp import made_by, stamp

NOTES = ".jaxfric.json"
_SCHEMA = "jaxfric.folder/1"
# Options that say what is asked, which have no default to differ from, and how it is read or told.
_ASKED = (
    "from_",
    "parameters",
    "normal_force",
    "mass",
    "velocity",
    "velocities",
    "stiffness",
    "kp",
)
_OF_A_MACHINE = ("drive_gain", "rated_torque", "position_gain", "velocity_gain", "kv", "noise")
_READ_AND_TOLD = (
    "file",
    "more",
    "reduce",
    "column",
    "drop_bad",
    "rig",
    "flip_sign",
    "plot",
    "name",
    "out",
    "details",
    "json",
    "quiet",
    "scheduler",
)
_NOT_NAMED = {*_ASKED, *_OF_A_MACHINE, *_READ_AND_TOLD, "model", "record", "slip_per_step"}
# Choices whose value says enough by itself: `ageing`, `whitened`.
_ALONE = frozenset(("law", "weighting"))
_LONGEST_VALUE, _LONGEST_NAME = 24, 120


def folder_name(source: str, verb: str, given: dict[str, object]) -> str:
    """SOURCE-VERB, and the options that differ from their default: `run-fit-ageing-states2`."""
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
    """The name of a saved result: that of its folder, where the file is called as all are."""
    folder = file.parent.name
    return folder if folder and file.stem in ("fit", "loop", "posterior", "steady") else file.stem


def input_name(path: Path) -> str:
    """The name of an input: a file's without its ending, a folder's in whole, `0.096kg` too.

    Of a folder that is written "." its own name.
    """
    if path.name in ("", ".."):
        return path.resolve().name
    return path.name if path.is_dir() else path.stem


def choose_folder(
    out: Path | None, source: str, *inputs: Path, unnamed: Sequence[str] = ()
) -> "Folder":
    """The folder of this call: `out`, or its default name, checked before any work.

    `unnamed` are options that the default name leaves out, as `source` says them already.
    Raises `InputError` where it cannot be written, or where it holds the results of another record
    (or, under a default name, another input of any kind): these would be lost.
    """
    call = current_call()
    given = {name: value for name, value in call.given.items() if name not in unnamed}
    path = out if out is not None else Path(folder_name(source, call.verb, given))
    folder = Folder(path, call, tuple(inputs))
    with output_folder(path):
        pass
    folder.refuse_another_input(asked_for=out is not None)
    return folder


class _Run(TypedDict):
    """The last run of a verb, as a folder notes it."""

    version: str
    command: str
    inputs: list[dict[str, str]]
    files: list[str]


_NO_RUN: _Run = {"version": "", "command": "", "inputs": [], "files": []}


@dataclasses.dataclass
class Folder:
    """An output folder in use: first the results, then the figures, then what is said of it."""

    path: Path
    call: Call
    inputs: tuple[Path, ...]
    files: list[str] = dataclasses.field(default_factory=list)
    known: list[str] = dataclasses.field(default_factory=list)
    strange: list[str] = dataclasses.field(default_factory=list)
    earlier: str = ""
    code: int = 0
    """The exit code of the verb: 1 where a figure is missing."""

    def refuse_another_input(self, *, asked_for: bool = False) -> None:
        """A folder that this verb's results of another input are in is not written to.

        The same input may have moved, or changed where it is. In a folder that was `asked_for` only
        the first input counts, the record: who runs it again with another prior or other events
        means to replace.
        """
        before = _read_notes(self.path).get(self.call.verb, _NO_RUN)
        for old, new in zip(
            before["inputs"], self._inputs()[: 1 if asked_for else None], strict=False
        ):
            if old["path"] != new["path"] and old["sha256"] != new["sha256"]:
                where = os.path.normpath(self.path / old["path"])
                advice = f"name a fresh one with --out, or take {self.path} away first"
                if not asked_for:
                    advice = "give another folder with --out"
                raise InputError(
                    f"{self.path} holds the results of another input"
                    f"{'' if asked_for else ' of this name'}, {where}; {advice}"
                )

    @contextlib.contextmanager
    def results(self) -> Generator[Path]:
        """Write results: in the folder of the block, which is moved here when it is complete.

        What the same verb wrote here before is replaced, or taken away where it is not written
        now; the files of others stay.
        """
        notes = _read_notes(self.path)
        before = notes.get(self.call.verb, _NO_RUN)
        with output_folder(self.path) as work:
            yield work
            stamp(work)
            new = sorted(file.name for file in work.iterdir())
            self.known = [name for name in before["files"] if (self.path / name).is_file()]
            self._note(notes, work, new)
        self.files += new
        others = {name for verb in notes for name in notes[verb]["files"]}
        for name in set(self.known) - others:
            (self.path / name).unlink(missing_ok=True)
        if before is not _NO_RUN:
            same = before["command"] == self.call.command and before["inputs"] == self._inputs()
            self.earlier = "the same command" if same else f"'{before['command']}'"

    def save_json(self, name: str, table: Mapping[str, object]) -> str:
        """Write a table as the JSON file `name`, the only result; its text."""
        content = json_text(table)
        with self.results() as to:
            (to / name).write_text(content + "\n", encoding="utf-8")
        return content

    def draw(self, what: str, drawing: Callable[[Path], object]) -> list[str]:
        """Add `what`, a figure or page that may fail: then it is missing, and nothing else.

        `drawing` writes to the folder that it is given. Returns the names of the new files.
        """
        try:
            with output_folder(self.path) as work:
                drawing(work)
                stamp(work)
                new = sorted(file.name for file in work.iterdir())
                self._note(_read_notes(self.path), work, [*self.files, *new])
        except KeyboardInterrupt:
            print(
                f"jaxfric: interrupted at {what}; the numbers are in {self.path}/", file=sys.stderr
            )
            raise SystemExit(130) from None
        except Exception as error:
            if os.environ.get("JAXFRIC_DEBUG"):
                raise
            self.code = 1
            print(f"jaxfric: warning: {self._failure(what, error)}", file=sys.stderr)
            return []
        self.files += new
        return new

    def _failure(self, what: str, error: Exception) -> str:
        reason = " ".join(str(error).split())
        if isinstance(error, InputError):
            return f"{what} was not drawn: {reason}"
        return (
            f"{what} was not drawn ({type(error).__name__}: {reason}); all else is in"
            f" {self.path}/. Please report it; JAXFRIC_DEBUG=1 shows where"
        )

    @property
    def written(self) -> str:
        """The files that this run wrote, in words."""
        return f"written: {self.path}/{', '.join(self.files)}"

    @property
    def replaced(self) -> str:
        """The files that this run replaced, in words; '' for none."""
        where = f"replaced in {self.path}"
        if self.known:
            return f"{where}: {', '.join([*self.known, *self.strange])}, written by {self.earlier}"
        strange = ", ".join(self.strange)
        return f"{where}: {strange}, written by an unknown command" if strange else ""

    def close(self) -> int:
        """Say what was replaced; the exit code of the verb."""
        if self.replaced:
            print(f"jaxfric: {self.replaced}", file=sys.stderr)
        return self.code

    def _inputs(self) -> list[dict[str, str]]:
        return [{"path": self._from_here(i), "sha256": _digest(i)} for i in self.inputs]

    def _from_here(self, file: Path) -> str:
        try:
            return Path(os.path.relpath(file.resolve(), self.path.resolve())).as_posix()
        except ValueError:  # on another drive
            return file.resolve().as_posix()

    def _note(self, notes: dict[str, _Run], work: Path, files: list[str]) -> None:
        """Note in `work` what is to be in the folder, and remember which of it was there."""
        there = (file.name for file in work.iterdir() if (self.path / file.name).is_file())
        self.strange += sorted(set(there) - set(self.known) - set(self.files))
        for verb in set(notes) - {self.call.verb}:
            notes[verb]["files"] = [name for name in notes[verb]["files"] if name not in files]
        notes[self.call.verb] = {
            "version": installed_version(),
            "command": self.call.command,
            "inputs": self._inputs(),
            "files": files,
        }
        content = json.dumps({"schema": _SCHEMA, "runs": notes}, indent=1)
        (work / NOTES).write_text(content + "\n", encoding="utf-8")


def json_text(table: Mapping[str, object]) -> str:
    """A table as the text of a JSON file, with what made it; one that is not a number must be null
    in it."""
    origin = made_by()
    return json.dumps(
        {**table, **({"made_by": origin} if origin else {})}, indent=1, allow_nan=False
    )


def _digest(file: Path) -> str:
    """SHA-256 of a file, '' of a folder."""
    if not file.is_file():
        return ""
    with file.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _read_notes(folder: Path) -> dict[str, _Run]:
    """The notes in a folder, by verb; empty where they are damaged."""
    try:
        runs = json.loads((folder / NOTES).read_text(encoding="utf-8"))["runs"]
        return {verb: _checked(run) for verb, run in runs.items()}
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return {}


def _checked(run: _Run) -> _Run:
    """The notes of one verb; names of files have no folder in them."""
    return {
        "version": str(run.get("version", "")),
        "command": str(run["command"]),
        "inputs": [{key: str(i[key]) for key in ("path", "sha256")} for i in run["inputs"]],
        "files": [str(name) for name in run["files"] if Path(name).name == name],
    }
