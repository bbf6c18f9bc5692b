"""Counts of how the package is built: `python tests/house.py [FOLDER]` prints them.

Lines; functions of more than 60 lines; functions of more than 7 parameters; parameters without an
annotation; uses of Any; class names that exist twice. Parameters of a verb are the options of the
command: neither they nor their lines are counted.
"""

import ast
import sys
from collections import Counter
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1] / "jaxfric"
LONGEST, MOST = 60, 7


class Counts(NamedTuple):
    """What `count` finds; places are 'file:line name'."""

    lines: int
    long: list[str]
    wide: list[str]
    unannotated: list[str]
    any: list[str]
    twice: list[str]


def count(sources: dict[str, str]) -> Counts:
    """Of the texts of some modules by their file."""
    found = Counts(sum(len(text.splitlines()) for text in sources.values()), [], [], [], [], [])
    names: dict[str, list[str]] = {}
    for file, text in sources.items():
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.ClassDef):
                names.setdefault(node.name, []).append(f"{file}:{node.lineno}")
            elif isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
                _count_function(node, file, found)
            elif _is_any(node):
                found.any.append(f"{file}:{node.lineno}")
    found.twice.extend(f"{n} {' '.join(p)}" for n, p in sorted(names.items()) if len(p) > 1)
    return found


def _count_function(node, file: str, found: Counts) -> None:
    place = f"{file}:{node.lineno} {node.name}"
    begin = node.body[0].lineno if _is_verb(node, file) else node.lineno
    if node.end_lineno - begin + 1 > LONGEST:
        found.long.append(f"{place} {node.end_lineno - begin + 1}")
    own = [a for a in parameters(node) if a.arg not in ("self", "cls")]
    if len(own) > MOST and not _is_verb(node, file):
        found.wide.append(f"{place} {len(own)}")
    found.unannotated.extend(f"{place} {a.arg}" for a in own if a.annotation is None)


def parameters(node) -> list:
    """All parameters of a function, those with a star too."""
    own = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
    return own + [a for a in (node.args.vararg, node.args.kwarg) if a is not None]


def _is_verb(node, file: str) -> bool:
    """Whether a function is a verb of the command: its parameters are the command's options."""
    return Path(file).parent.name == "cli" and node.name == Path(file).stem


def _is_any(node) -> bool:
    return isinstance(node, ast.Name) and node.id == "Any"


def read(folder: str = "") -> dict[str, str]:
    """Texts of the modules below a folder of the package."""
    files = sorted((ROOT / folder).rglob("*.py"))
    return {str(f.relative_to(ROOT)): f.read_text(encoding="utf-8") for f in files}


def main(folder: str = "", *, places: bool = False) -> None:
    """Print the counts, and the places where asked."""
    found = count(read(folder))
    for name, value in found._asdict().items():
        print(f"{name:12s} {value if isinstance(value, int) else len(value)}")
        if places and not isinstance(value, int):
            own = Counter(place.split(":")[0] for place in value)
            for place in value if len(value) < 60 else [f"{f} {n}" for f, n in own.items()]:
                print("    ", place)


if __name__ == "__main__":
    words = [w for w in sys.argv[1:] if w != "--places"]
    main(*words, places="--places" in sys.argv)
