"""The tree keeps its shape: floors, no import cycles, classes abstract or final.

Read from the source by AST, so imports inside functions count and nothing is executed.
"""

import ast
import functools
import graphlib
import itertools
from collections import defaultdict
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1] / "jaxfric"

# A module imports from lower floors, or within its own folder. New modules of the top level are
# listed here; `jaxfric` itself (its lazy names) and `cli` may see everything.
FLOORS = {
    "errors": 0,
    "lazy": 0,
    "described": 0,
    "silent": 0,
    "cache": 1,
    "coordinate": 1,
    "threads": 0,
    "traced": 0,
    "quantity": 0,
    "units": 0,
    "pairs": 1,
    "findings": 0,
    "plain": 0,
    "tables": 1,
    "schemas": 0,
    "motion": 1,
    "rig": 1,
    "simulation": 2,
    "stability": 2,
    "records": 2,
    "effects": 2,
    "laws": 3,
    "saved": 3,
    "gains": 3,
    "fitting": 3,
    "loop": 4,
    "compensation": 4,
    "posterior": 4,
    "prediction": 4,
    "protocol": 4,
    "runs": 4,
    "study": 5,
    "axis": 5,
    "plot": 5,
    "report": 5,
    "members": 6,
    "views": 6,
    "": 7,
    "cli": 8,
    "__main__": 9,
}
# One floor, but one is built from the other (never the other way).
WITHIN_A_FLOOR = {
    ("findings", "described"),
    ("findings", "plain"),
    ("quantity", "errors"),
    ("units", "errors"),
    ("traced", "threads"),
    ("rig", "motion"),
    ("gains", "laws"),
    ("saved", "laws"),
    ("gains", "saved"),
    ("fitting", "laws"),
    ("loop", "runs"),
    ("compensation", "loop"),
    ("prediction", "loop"),
    ("protocol", "loop"),
    ("plot", "report"),
}


def read_package():
    """Source of every module by its dotted name below the package ('' is the package)."""
    sources = {}
    for path in ROOT.rglob("*.py"):
        parts = path.relative_to(ROOT).with_suffix("").parts
        name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
        sources[name] = (path.read_text(encoding="utf-8"), parts[-1] == "__init__")
    return sources


SOURCES = read_package()


@functools.cache
def nodes(source):
    """Everything in a text; the package is parsed once for all tests."""
    return tuple(ast.walk(ast.parse(source)))


def imports(name, source, is_package, known):
    """Modules of the package that a module imports, anywhere in its source."""
    package = name.split(".") if name else []
    if not is_package:
        package = package[:-1]
    found = set()
    for node in nodes(source):
        if isinstance(node, ast.ImportFrom):
            if node.level:
                base = package[: len(package) - (node.level - 1)]
                base = base + (node.module.split(".") if node.module else [])
            elif node.module and node.module.split(".")[0] == "jaxfric":
                base = node.module.split(".")[1:]
            else:
                continue
            for alias in node.names:
                whole = ".".join([*base, alias.name])
                found.add(whole if whole in known else ".".join(base))
        elif isinstance(node, ast.Import):
            for alias in node.names:
                if alias.name.split(".")[0] == "jaxfric":
                    found.add(".".join(alias.name.split(".")[1:]))
    # A package's __init__ runs before its modules do; that is no import of theirs.
    return found - {name}


def floor_faults(sources):
    faults = []
    for name, (source, is_package) in sources.items():
        top = name.split(".")[0]
        if top not in FLOORS:
            faults.append(f"jaxfric/{top} has no floor: list it in FLOORS of {Path(__file__).name}")
            continue
        for other in imports(name, source, is_package, sources):
            target = other.split(".")[0]
            if target == top or (top, target) in WITHIN_A_FLOOR:
                continue
            if target not in FLOORS:
                faults.append(f"{name} imports {target}, which has no floor: list it in FLOORS")
            elif FLOORS[target] >= FLOORS[top]:
                faults.append(
                    f"{name} (floor {FLOORS[top]}) imports {other} (floor {FLOORS[target]}): "
                    "only lower floors, or its own folder"
                )
    return faults


def cycle(sources):
    """Modules that import each other in a ring, or None. An __init__ counts as its folder."""
    graph = {
        name: imports(name, source, is_package, sources)
        for name, (source, is_package) in sources.items()
        if name  # the lazy names of the package itself
    }
    try:
        graphlib.TopologicalSorter(graph).prepare()
    except graphlib.CycleError as error:
        return error.args[1]
    return None


def classes(sources):
    """Class name -> (base names, own abstract names) of every class in the package."""
    table = {}
    for source, _ in sources.values():
        for node in nodes(source):
            if isinstance(node, ast.ClassDef):
                bases = [_base_name(base) for base in node.bases]
                table[node.name] = (bases, any(_is_abstract(item) for item in node.body))
    return table


def _base_name(base):
    """`eqx.Module` is Module; other dotted names belong to other packages and stay dotted."""
    if isinstance(base, ast.Subscript):  # Generic[T] and the like
        base = base.value
    text = ast.unparse(base)
    return "Module" if text.endswith(".Module") else text


def _is_abstract(item):
    if isinstance(item, ast.FunctionDef):
        return any("abstractmethod" in ast.unparse(d) for d in item.decorator_list)
    if isinstance(item, ast.AnnAssign):
        text = ast.unparse(item.annotation)
        return "AbstractVar" in text or "AbstractClassVar" in text
    return False


def class_faults(sources):
    """Modules (eqx) must be abstract, and say so in their name, or final."""
    table = classes(sources)
    children = defaultdict(list)
    for name, (bases, _) in table.items():
        for base in bases:
            children[base].append(name)

    def is_module(name):
        bases = table.get(name, ((), False))[0]
        return "Module" in bases or any(is_module(base) for base in bases)

    faults = []
    for name, (_, abstract) in table.items():
        if not is_module(name):
            continue
        named = name.lstrip("_").startswith("Abstract")
        if abstract and not named:
            faults.append(f"{name} has abstract members: call it Abstract{name}")
        if not named and children[name]:
            faults.append(f"{name} is concrete, and {children[name]} inherit from it")
    return faults


def override_faults(sources):
    """No method that a base class of the package implements is written again below it."""
    methods = {}
    for source, _ in sources.values():
        for node in nodes(source):
            if isinstance(node, ast.ClassDef):
                methods[node.name] = {
                    item.name: _is_abstract(item)
                    for item in node.body
                    if isinstance(item, ast.FunctionDef) and not item.name.startswith("__")
                }
    table = classes(sources)

    def inherited(name):
        for base in table.get(name, ((), False))[0]:
            yield from ((base, m) for m, abstract in methods.get(base, {}).items() if not abstract)
            yield from inherited(base)

    return [
        f"{name}.{method} overrides {base}.{method}"
        for name in table
        for base, method in inherited(name)
        if method in methods[name]
    ]


# ---- the package --------------------------------------------------------------------------


def test_the_package_was_read():
    assert {"", "motion", "rig.drive", "rig.friction.law", "simulation.ode"} <= set(SOURCES)
    assert "rig.friction.law" in imports("rig.rig", *SOURCES["rig.rig"], SOURCES)


def test_floors():
    assert floor_faults(SOURCES) == []


def drawn():
    """Names of the tree that contributing.md draws, a list a line, from the ground floor up."""
    text = (ROOT.parent / ".ci" / "docs" / "pages" / "contributing.md").read_text(encoding="utf-8")
    tree = text.split("    jaxfric/\n")[1].split("\n\n")[0]
    return [line[6:41].replace("/", " ").split() for line in tree.splitlines()]


def test_the_documentation_draws_the_tree():
    """Every module of the top level, once, and none above what is built from it."""
    floors = [[FLOORS[name] for name in line] for line in drawn()]
    names = [name for line in drawn() for name in line]
    assert sorted(names) == sorted(name for name in FLOORS if name not in ("", "__main__"))
    assert all(max(a) <= min(b) for a, b in itertools.pairwise(floors))


def test_no_module_imports_itself_by_a_detour():
    assert cycle(SOURCES) is None


def test_modules_are_abstract_or_final():
    assert class_faults(SOURCES) == []
    assert "AbstractLaw" in classes(SOURCES) and "RateState" in classes(SOURCES)


def test_no_two_classes_have_one_name():
    """One word, one meaning; and the checks above know a class by its name."""
    names = [n.name for s, _ in SOURCES.values() for n in nodes(s) if isinstance(n, ast.ClassDef)]
    assert [name for name in set(names) if names.count(name) > 1] == []


def test_nothing_overrides():
    assert override_faults(SOURCES) == []


# ---- a planted violation is caught --------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "source", "words"),
    [
        ("motion", "from .simulation import simulate", "motion (floor 1) imports simulation"),
        ("rig.drive", "from ..rig.rig import Rig\nfrom ..fitting.fit import fit", "fitting.fit"),
        ("rig.x", "def f():\n    from ... import jaxfric\n    import jaxfric.cli", "cli"),
        ("records.x", "def f():\n    from ..simulation import simulate", "records.x (floor 2)"),
        ("motion", "from jaxfric.rig import Rig", "motion (floor 1) imports rig"),
        ("motion", "from . import rig", "motion (floor 1) imports rig"),
        ("errors", "import jaxfric", "imports  (floor 7)"),
        ("wobble.x", "", "jaxfric/wobble has no floor: list it in FLOORS"),
        ("cli", "from .wobble import x", "list it in FLOORS"),
    ],
)
def test_planted_import_is_caught(name, source, words):
    faults = floor_faults({**SOURCES, name: (source, False)})
    assert any(words in fault for fault in faults), faults


def test_allowed_imports_are_not_caught():
    source = "from ..motion import X\nfrom ..errors import Y\nfrom .law import Z\nimport numpy"
    assert floor_faults({"rig.new": (source, False)}) == []


def test_planted_cycle_is_caught():
    sources = {
        "rig.a": ("def f():\n    from .b import x", False),
        "rig.b": ("from .a import y", False),
    }
    assert set(cycle(sources)) == {"rig.a", "rig.b"}
    assert cycle({**sources, "rig.b": ("", False)}) is None


@pytest.mark.parametrize(
    ("source", "words"),
    [
        ("class A(eqx.Module): pass\nclass B(A): pass", "A is concrete"),
        ("class A(eqx.Module):\n    x: eqx.AbstractVar[int]", "call it AbstractA"),
        ("class A(Module):\n    @abc.abstractmethod\n    def f(self): ...", "call it AbstractA"),
        ("class AbstractA(Module): pass\nclass B(AbstractA): pass\nclass C(B): pass", "B is con"),
    ],
)
def test_planted_class_is_caught(source, words):
    faults = class_faults({"rig.x": (source, False)})
    assert len(faults) == 1 and words in faults[0]


def test_good_classes_are_not_caught():
    source = (
        "class AbstractA(eqx.Module):\n    @abc.abstractmethod\n    def f(self): ...\n"
        "class B(AbstractA):\n    def f(self): ...\n"
        "class Plain: pass\nclass Child(Plain): pass"
    )
    assert class_faults({"x": (source, False)}) == override_faults({"x": (source, False)}) == []


def test_planted_override_is_caught():
    source = (
        "class AbstractA(Module):\n    def f(self): ...\nclass B(AbstractA):\n    def f(self): ..."
    )
    assert override_faults({"x": (source, False)}) == ["B.f overrides AbstractA.f"]
