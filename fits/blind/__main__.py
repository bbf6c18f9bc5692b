"""Run a blind study: `python -m fits.blind --out DIR [--share 0.1 | --slice ci] [--workers 2]`.

--noise measured, time and wide are studies of their own, each for a folder of its own.

Makes the records of `study` that are missing in DIR, closes the loop on each in processes of
their own, scores all that is in DIR and prints the numbers beside the targets. A run that was
stopped goes on where it was. A record that fails, dies or takes longer than --limit is noted
with its error and counted; the study goes on.

Files: DIR/records and DIR/truth (see `generate`), DIR/loops/NAME/loop.json of jaxfric and
run.json {condition, index, without, error, seconds}, and the results of `score`.
"""

import argparse
import importlib
import json
import multiprocessing
import os
import time
import traceback
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from multiprocessing.connection import Connection, wait
from pathlib import Path

from . import measured, score
from .cores import one_thread
from .generate import UnreachableError, make, write
from .study import ALIASED, STUDIES, Item, selected

_RECORDS_PER_PROCESS = 20  # compiled functions pile up in a process that sees many lengths


def name_of(item: Item, out: Path) -> str | None:
    """Name of an item's record, or None if it has not been made."""
    names = (request.name for request in item.tries)
    return next((n for n in names if (out / "truth" / n / "truth.json").exists()), None)


def is_done(item: Item, out: Path, *, retry: bool = False) -> bool:
    """Whether the loop was closed, or failed and is not to be tried again."""
    folder = out / "loops" / (name_of(item, out) or item.tries[0].name)
    if (folder / "loop.json").exists():
        return True
    return (folder / "run.json").exists() and not retry


def generated(item: Item, out: Path) -> str:
    """Name of the record, made now if it is missing. Raises `UnreachableError`."""
    if found := name_of(item, out):
        return found
    why = "no pair of effects can be told apart"
    for request in item.tries:
        try:
            blind = make(request)
        except UnreachableError as error:
            why = str(error)
            continue
        if abs(blind.truth["cosine"] or 0.0) <= ALIASED:
            return write(blind, out)
    raise UnreachableError(why)


def close(name: str, item: Item, out: Path) -> str:
    """Close the loop on a record, write loop.json; the verdict in a few words."""
    from jaxfric.effects import CATALOGUE
    from jaxfric.loop import close_loop
    from jaxfric.records import read

    declared = json.loads((out / "records" / name / "declared.json").read_text())
    record = read(out / "records" / name / "record.csv")
    without = tuple(id for id in item.without if id in CATALOGUE)
    loop = close_loop(
        record,
        stiffness=declared["stiffness [1/m]"],
        law=declared.get("law") or "slip",
        # as a user says that the stiffness is not quite known
        include=("stiffness",) if declared.get("stiffness known to [1]") else (),
        exclude=without,
    ).to_json()
    _write(out / "loops" / name / "loop.json", loop)
    return f"{loop['verdict']}: {'+'.join(loop['effects']) or '-'}"


def _write(path: Path, content: dict) -> None:
    """All of a file or nothing of it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix(".part")
    part.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    os.replace(part, path)


def _note(item: Item, out: Path, error: str | None, seconds: dict[str, float]) -> None:
    folder = out / "loops" / (name_of(item, out) or item.tries[0].name)
    content = {
        "condition": item.condition,
        "index": item.index,
        "without": list(item.without),
        "error": error,
        "seconds": seconds,
    }
    _write(folder / "run.json", content)


def treat(item: Item, out: Path) -> str:
    """One record from its seed to run.json; a line about it. Never raises."""
    begun, seconds, error = time.monotonic(), {}, None
    try:
        name = generated(item, out)
        seconds["generate"] = time.monotonic() - begun
        said = close(name, item, out)
    except Exception as failure:
        error = "".join(traceback.format_exception(failure)[-3:]).strip()
        said = f"FAILED {type(failure).__name__}: {failure}".splitlines()[0]
    seconds["all"] = time.monotonic() - begun
    _note(item, out, error, seconds)
    return f"{seconds['all']:6.1f} s  {item.label:18} {said}"


def _work(pipe: Connection, out: Path) -> None:
    """A process: items come in, lines go out."""
    one_thread()
    from jaxfric.cli.common import prepare_jax

    prepare_jax()
    try:
        while (item := pipe.recv()) is not None:
            pipe.send(treat(item, out))
    except (EOFError, KeyboardInterrupt):
        return


class _Worker:
    """A process and the item that it is at."""

    def __init__(self, out: Path):
        context = multiprocessing.get_context("spawn")
        self.pipe, theirs = context.Pipe()
        self.process = context.Process(target=_work, args=(theirs, out), daemon=True)
        self.process.start()
        theirs.close()
        self.item: Item | None = None
        self.since, self.taken = 0.0, 0

    def take(self, item: Item) -> None:
        self.item, self.since, self.taken = item, time.monotonic(), self.taken + 1
        with suppress(
            OSError
        ):  # a process that is dead already: its pipe ends, and `_said` sees it
            self.pipe.send(item)

    def stop(self) -> None:
        self.process.terminate()
        self.process.join()
        self.pipe.close()


def run(todo: Sequence[Item], out: Path, *, workers: int, limit: float) -> None:
    """Treat all items in processes of their own; a line for each."""
    waiting, begun, done = deque(todo), time.monotonic(), 0
    crew: list[_Worker] = []
    try:
        while waiting or crew:
            while waiting and len(crew) < workers:
                crew.append(_Worker(out))
                crew[-1].take(waiting.popleft())
            ready = wait([worker.pipe for worker in crew], timeout=1.0)
            for worker in list(crew):
                said = _said(worker, worker.pipe in ready, out, limit)
                if said is None:
                    continue
                done += 1
                spent = time.monotonic() - begun
                print(f"{done:4}/{len(todo)} {spent / 60:6.1f} min {said}", flush=True)
                alive = worker.process.is_alive() and worker.item is None
                if waiting and alive and worker.taken < _RECORDS_PER_PROCESS:
                    worker.take(waiting.popleft())
                else:
                    worker.stop()
                    crew.remove(worker)
    finally:
        for worker in crew:
            worker.stop()


def _said(worker: _Worker, ready: bool, out: Path, limit: float) -> str | None:
    """The line about a worker's item, or None while it is at it. A worker lost keeps its item."""
    item = worker.item
    assert item is not None
    spent = time.monotonic() - worker.since
    error = None
    if ready:
        try:
            said = worker.pipe.recv()
            worker.item = None
            return said
        except (EOFError, OSError):
            worker.process.join(5.0)
            error = f"the process died (exit code {worker.process.exitcode})"
    elif spent > limit:
        error = f"not done after {limit:g} s"
    if error is None:
        return None
    _note(item, out, error, {"all": spent})
    return f"{spent:6.1f} s  {item.label:18} FAILED {error}"


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="python -m fits.blind", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--share", type=float, help="of every condition, spread evenly")
    parser.add_argument(
        "--shift", type=int, default=0, help="another share of that size: 0 to 1/SHARE - 1"
    )
    parser.add_argument("--draw", type=int, default=0, help="the same study with other seeds")
    parser.add_argument("--slice", dest="part", help="ci: a dozen records")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--noise", choices=STUDIES, default="rows", help="which study")
    conditions = ", ".join(c.name for conditions in STUDIES.values() for c in conditions)
    parser.add_argument("--only", action="append", default=[], help=f"condition: {conditions}")
    parser.add_argument("--limit", type=float, default=900.0, help="seconds for a record")
    parser.add_argument("--retry", action="store_true", help="try again what failed")
    asked = parser.parse_args(arguments)
    if asked.share is not None and asked.part is not None:
        parser.error("--share and --slice exclude each other")
    if asked.workers < 1 or not asked.limit > 0:
        parser.error("--workers must be 1 or more and --limit positive")
    share = 1.0 if asked.share is None else asked.share
    try:
        only = tuple(asked.only)
        items = selected(
            share=share,
            shift=asked.shift,
            part=asked.part,
            only=only,
            study=asked.noise,
            draw=asked.draw,
        )
        if asked.noise == "measured":
            measured.folder()
    except (ValueError, FileNotFoundError) as error:
        parser.error(str(error))
    todo = [item for item in items if not is_done(item, asked.out, retry=asked.retry)]
    print(f"{len(items)} records, {len(items) - len(todo)} of them done before", flush=True)
    begun = time.monotonic()
    run(todo, asked.out, workers=asked.workers, limit=asked.limit)
    print(f"{time.monotonic() - begun:.0f} s for {len(todo)} records")
    print(score.publish(asked.out))


if __name__ == "__main__":
    # a new process finds `_work` by the name of its module, which must not be that of the script
    importlib.import_module("fits.blind.__main__").main()
