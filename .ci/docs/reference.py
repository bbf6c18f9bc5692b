"""The reference of all public names, read from the sources without importing them.

Public are the names of `jaxfric`, those that the packages below hand on from their `__init__`, and
what the listed modules define without a leading underscore.
"""

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]

PAGES: dict[str, tuple[str, tuple[str, ...]]] = {
    "records": ("Records", ("records", "records.reduction")),
    "rig": ("Rig, friction and motion", ("motion", "rig", "rig.friction")),
    "simulation": ("Simulation", ("simulation",)),
    "stability": (
        "Stability",
        (
            "stability",
            "stability.linear",
            "stability.theorem",
            "stability.margins",
            "stability.delay",
            "stability.analysis",
            "stability.delay_analysis",
        ),
    ),
    "effects": ("Effects", ("effects",)),
    "laws": ("Laws by name", ("laws", "saved")),
    "fitting": ("Fits, posterior, prediction", ("fitting", "posterior", "prediction")),
    "gains": ("Gains and feedforward", ("gains", "compensation", "compensation.fade")),
    "loop": ("Loop and protocol", ("loop", "axis", "protocol")),
    "runs": ("Whole runs", ("runs",)),
    "study": ("Studies", ("study", "members")),
    "plot": (
        "Figures",
        (
            "plot.record",
            "plot.raw",
            "plot.axis_record",
            "plot.fit",
            "plot.posterior",
            "plot.prediction",
            "plot.run",
            "plot.loop",
            "plot.noise",
            "plot.steady",
            "plot.gains",
            "plot.feedforward",
            "plot.stability",
            "plot.cycle",
            "plot.study",
        ),
    ),
    "basics": (
        "Findings, errors, units, quantities, cache",
        ("findings", "errors", "cache", "units", "quantity"),
    ),
}
"""Pages of the reference: title, and the modules whose names each has."""


class Name(NamedTuple):
    """A public name: what it is called, and where it is defined."""

    name: str
    home: str

    @property
    def path(self) -> str:
        """The full path of its definition."""
        return f"{self.home}.{self.name}"


def source(module: str) -> Path:
    """The file of a module of the package."""
    path = ROOT.joinpath(*module.split("."))
    return path / "__init__.py" if path.is_dir() else path.with_suffix(".py")


def imported(module: str) -> Iterator[Name]:
    """Names that a module imports from others of the package, with the module it names for each."""
    package = module.split(".")
    if source(module).name != "__init__.py":
        package = package[:-1]
    for node in ast.walk(tree(module)):
        if isinstance(node, ast.ImportFrom) and node.level and node.module not in (None, "lazy"):
            home = ".".join([*package[: len(package) - node.level + 1], node.module])
            yield from (Name(a.name, home) for a in node.names if not a.name.startswith("_"))


def handed_on(module: str) -> list[Name]:
    """The same names, each where it is defined."""
    return [defined(one) for one in imported(module)]


def defined(one: Name) -> Name:
    """Where a name is defined: in the module it comes from, or where that imports it from."""
    for other in imported(one.home):
        if other.name == one.name:
            return defined(other)
    return one


@cache
def tree(module: str) -> ast.Module:
    """The syntax of a module."""
    return ast.parse(source(module).read_text(encoding="utf-8"))


def own(module: str) -> Iterator[Name]:
    """Classes and functions that a module defines itself."""
    for node in tree(module).body:
        kinds = (ast.ClassDef, ast.FunctionDef)
        if isinstance(node, kinds) and not node.name.startswith("_"):
            yield Name(node.name, module)


def names_of(part: str) -> list[Name]:
    """The public names of a part of the package, in alphabetical order."""
    module = f"jaxfric.{part}"
    hands_on = part == "axis" or source(module).name == "__init__.py"
    found = handed_on(module) if hands_on else own(module)
    return sorted(set(found), key=lambda one: one.name.lower())


def public() -> list[Name]:
    """The names of `jaxfric` itself."""
    found = [one for one in handed_on("jaxfric") if is_object(one)]
    return sorted(set(found), key=lambda one: one.name.lower())


def is_object(one: Name) -> bool:
    """Whether a name is an object of a module, not a module or a package."""
    return not (source(one.path).exists())


def pages() -> dict[str, str]:
    """The Markdown of all pages by the name of their file."""
    shown: set[str] = set()
    found = {}
    for page, (title, parts) in PAGES.items():
        blocks = [f"# {title}\n"]
        for part in parts:
            names = [one for one in names_of(part) if is_object(one) and one.path not in shown]
            shown |= {one.path for one in names}
            if names:
                blocks.append(f"## jaxfric.{part}\n")
                blocks += [f"::: {one.path}\n" for one in names]
        found[f"reference/{page}.md"] = "\n".join(blocks)
    lost = [one.path for one in public() if one.path not in shown]
    if lost:
        raise ValueError(f"public names without a page of the reference: {', '.join(lost)}")
    return {"reference/index.md": index(), **found}


def index() -> str:
    """The table of the names of `jaxfric`, each with the first sentence of its docstring."""
    rows = [f"| [`jaxfric.{one.name}`][{one.path}] | {first_line(one)} |" for one in public()]
    return "\n".join(
        [
            "# Reference\n",
            "The names that `import jaxfric` gives. The pages beside this one have those of its",
            "parts; [the command](command.md) has every verb and option.\n",
            "| name | what it is |",
            "|---|---|",
            *rows,
            "",
        ]
    )


def first_line(one: Name) -> str:
    """The first sentence of the docstring of a name; '' for a constant."""
    for node in tree(one.home).body:
        kinds = (ast.ClassDef, ast.FunctionDef)
        if isinstance(node, kinds) and node.name == one.name:
            text = ast.get_docstring(node) or ""
            return " ".join(text.split("\n\n")[0].split()).replace("|", "\\|")
    return ""
