"""Mutates copies of the package and tells which test notices each fault: an alarm's fire drill.

    python tests/drill.py                        # all faults of faults.toml
    python tests/drill.py verdict                # those with the word in their name or file
    python tests/drill.py --sample 40 --seed 1   # forty drawn at random

A fault exchanges one piece of a syntax tree, so layout, comments and docstrings are free to change.
One whose piece is no longer there is gone: it is counted, and may be given its new place or
deleted. Exit status 1 where a fault is missed.
"""

import argparse
import ast
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]


class Fault(NamedTuple):
    """A line of faults.toml."""

    file: str
    """Below `jaxfric/`."""
    name: str
    where: str
    """Function, class or constant, with dots; '#2' for the second place in it."""
    old: str
    new: str
    """An expression each, or statements."""
    guard: str
    """Arguments of pytest, the file without `tests/test_` and `.py`."""


def mutated(source: str, where: str, old: str, new: str) -> str | None:
    """A module with one piece exchanged; None where it has no such piece."""
    tree = ast.parse(source)
    name, _, number = where.partition("#")
    scope: ast.AST | None = tree
    for part in filter(None, name.split(".")):
        scope = next((n for n in ast.walk(scope) if part in _names(n)), None) if scope else None
    before, after = ast.parse(old).body, ast.parse(new).body
    if all(len(x) == 1 and isinstance(x[0], ast.Expr) for x in (before, after)):
        before, after = [before[0].value], [after[0].value]
    places = list(_places(ast.List([scope]), [_told(x) for x in before])) if scope else []
    if len(places) < int(number or 1):
        return None
    parent, field, k = places[int(number or 1) - 1]
    value = getattr(parent, field)
    if isinstance(value, list):
        value[k : k + len(before)] = after
    else:
        setattr(parent, field, after[0])
    return ast.unparse(tree)


def _names(node: ast.AST) -> list[str]:
    """Names that a definition or an assignment gives."""
    if isinstance(node, (ast.Assign, ast.AnnAssign)):
        targets = node.targets if isinstance(node, ast.Assign) else [node.target]
        return [n.id for t in targets for n in ast.walk(t) if isinstance(n, ast.Name)]
    defines = isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef))
    return [node.name] if defines else []


def _places(node: ast.AST, wanted: list[str]) -> Iterator[tuple[ast.AST, str, int]]:
    """Parent, field and index of every piece that is as wanted, in the order of the source."""
    for field, value in ast.iter_fields(node):
        children = value if isinstance(value, list) else [value]
        for k, child in enumerate(children):
            if [_told(x) for x in children[k : k + len(wanted)]] == wanted:
                yield node, field, k
            if isinstance(child, ast.AST):
                yield from _places(child, wanted)


def _told(node) -> str:
    """What a node is, whether it is read or assigned to."""
    return re.sub(r", ctx=\w+\(\)", "", ast.dump(node)) if isinstance(node, ast.AST) else ""


def failures(sources: dict[str, str], *arguments: str) -> list[str]:
    """Tests that fail in a copy of the package with these modules by file.

    Raises
    ------
    RuntimeError : no test ran.
    """
    with tempfile.TemporaryDirectory() as name:
        copy = Path(name)
        for folder in ("jaxfric", "tests"):
            shutil.copytree(ROOT / folder, copy / folder)
        shutil.copy(ROOT / "pyproject.toml", copy)
        for folder in ("fits", "data"):  # records and their generators, which stay as they are
            (copy / folder).symlink_to(ROOT / folder)
        kept = ROOT / ".pytest_cache" / "jax"  # what is compiled need not be compiled again
        if kept.is_dir():
            (copy / ".pytest_cache").mkdir()
            (copy / ".pytest_cache" / "jax").symlink_to(kept)
        for file, source in sources.items():
            (copy / "jaxfric" / file).write_text(source, encoding="utf-8")
        command = [sys.executable, "-m", "pytest", "-q", "-n", "0", *arguments]
        environment = {**os.environ, "PYTHONPATH": name}
        done = subprocess.run(command, cwd=copy, env=environment, capture_output=True, text=True)
    if done.returncode not in (0, 1, 2):
        raise RuntimeError(f"{' '.join(arguments)}: {(done.stdout + done.stderr)[-2000:]}")
    return re.findall(r"^(?:FAILED|ERROR) ([^\s\[]+)", done.stdout, re.MULTILINE)


def outcome(fault: Fault) -> str:
    """The test that notices a fault, 'gone', or 'missed'."""
    file = ROOT / "jaxfric" / fault.file
    source = mutated(file.read_text(encoding="utf-8"), *fault[2:5]) if file.is_file() else None
    if source is None:
        return "gone"
    name, *options = fault.guard.split()
    try:
        failed = failures({fault.file: source}, "-x", f"tests/test_{name}.py", *options)
    except RuntimeError as error:
        return f"missed: no test ran: {error}"
    return failed[0] if failed else "missed"


def read(file: Path = ROOT / "tests" / "faults.toml") -> list[Fault]:
    """The faults of a table."""
    table = tomllib.loads(file.read_text(encoding="utf-8"))
    return [Fault(f, name, *rest) for f, rows in table.items() for name, rest in rows.items()]


def drill(faults: list[Fault], jobs: int = 2) -> int:
    """Plant every fault, print what notices it, and count; whether one was missed."""
    found = {}
    with ThreadPoolExecutor(jobs) as pool:
        for fault, told in zip(faults, pool.map(outcome, faults), strict=True):
            found[fault] = told
            print(f"{fault.file}: {fault.name} | {told}", flush=True)
    noticed = {told for told in found.values() if told != "gone" and not told.startswith("missed")}
    files = {f.file: (ROOT / "jaxfric" / f.file) for f in faults if found[f] in noticed}
    as_it_is = {f: ast.unparse(ast.parse(p.read_text("utf-8"))) for f, p in files.items()}
    broken = failures(as_it_is, *sorted(noticed)) if noticed else []
    missed = [f for f, told in found.items() if told.startswith("missed") or told in broken]
    gone = sum(told == "gone" for told in found.values())
    planted = len(faults) - gone
    print(f"{planted - len(missed)} caught of {planted} planted, {gone} gone")
    for fault in missed:
        why = " (that test fails without the fault too)" if found[fault] in broken else ""
        print(f"missed: {fault.file}: {fault.name}{why}")
    return int(bool(missed))


def main(arguments: list[str]) -> int:
    """Drill the faults that the command line asks for."""
    parser = argparse.ArgumentParser(description="Do the tests notice faults of the package?")
    parser.add_argument("words", nargs="*", help="of the fault's name or file; all without")
    parser.add_argument("--sample", type=int, help="draw so many of them at random")
    parser.add_argument("--seed", type=int, default=0, help="of the draw")
    parser.add_argument("--jobs", type=int, default=2, help="faults at a time")
    given = parser.parse_args(arguments)
    words = given.words or [""]
    chosen = [f for f in read() if any(word in f"{f.name} {f.file}" for word in words)]
    if given.sample is not None and given.sample < len(chosen):
        chosen = random.Random(given.seed).sample(chosen, given.sample)
    return drill(chosen, given.jobs)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
