"""The command with every sentence of the package replaced by the place where it stands.

`coded` is a module's tree whose texts of two words and more are codes ("«loop.verdict:88:21»"), no
two alike; what a text is compared with, split at or searched for is a text elsewhere, with another
code. So logic that depends on words comes out otherwise. As a script it runs commands and writes
what they come to:

    python coded.py (plain | coded) CALLS.json RESULTS.json
"""

import ast
import importlib.abc
import importlib.machinery
import json
import re
import sys
from collections.abc import Iterator
from pathlib import Path

PACKAGE = "jaxfric"
OPEN, CLOSE = "«", "»"
_WORDS = re.compile(r"[A-Za-z]{2}[,:;.?!)]* [(]?[A-Za-z]{2}| [a-z]{3,}[ ,.:]|[a-z]{3,} $")
"""Two words side by side; in a part of a text beside values, one that stands by itself."""
DATA = ("plot", "records.roles")
"""Rooms and modules whose texts are no sentences: options of matplotlib, names of columns."""
_SHAPES = ("Array", "Bool", "Complex", "Float", "Inexact", "Int", "Num", "PRNGKeyArray", "Shaped")


def coded(tree: ast.Module, name: str) -> ast.Module:
    """The tree of a module, each sentence in it replaced."""
    return ast.fix_missing_locations(_Coder(name).visit(tree))


class _Coder(ast.NodeTransformer):
    def __init__(self, name: str):
        self.name = name

    def visit_Constant(self, node: ast.Constant) -> ast.Constant:
        text = node.value
        if not isinstance(text, str) or not _WORDS.search(text):
            return node
        code = f"{OPEN}{self.name}:{node.lineno}:{node.col_offset}{CLOSE}"
        return ast.copy_location(ast.Constant(code), node)

    def visit_Expr(self, node: ast.Expr) -> ast.Expr:
        return node if isinstance(node.value, ast.Constant) else self.generic_visit(node)

    def visit_AnnAssign(self, node: ast.AnnAssign) -> ast.AnnAssign:
        kept = node.annotation  # a type as a text, which a named tuple evaluates
        self.generic_visit(node)
        node.annotation = kept if isinstance(kept, ast.Constant) else node.annotation
        return node

    def visit_FormattedValue(self, node: ast.FormattedValue) -> ast.FormattedValue:
        node.value = self.visit(node.value)  # what formats it is no text
        return node

    def visit_Subscript(self, node: ast.Subscript) -> ast.expr:
        of = node.value.attr if isinstance(node.value, ast.Attribute) else node.value
        name = of if isinstance(of, str) else getattr(of, "id", "")
        return node if name in (*_SHAPES, "Literal") else self.generic_visit(node)

    def visit_Call(self, node: ast.Call) -> ast.expr:
        of = node.func.value if isinstance(node.func, ast.Attribute) else None
        return node if isinstance(of, ast.Name) and of.id == "re" else self.generic_visit(node)


class Finder(importlib.abc.MetaPathFinder):
    """Finds the modules of the package as they are, and has them made of coded trees."""

    def find_spec(self, name, path, target=None):
        """As the usual finder."""
        package, _, module = name.partition(".")
        if package != PACKAGE or any(f"{module}.".startswith(f"{of}.") for of in DATA):
            return None
        spec = importlib.machinery.PathFinder.find_spec(name, path, target)
        if spec is not None and isinstance(spec.loader, importlib.machinery.SourceFileLoader):
            spec.loader = _Loader(name, spec.loader.path)
        return spec


class _Loader(importlib.machinery.SourceFileLoader):
    def get_code(self, fullname):
        path = self.get_filename(fullname)
        tree = ast.parse(self.get_data(path))
        return compile(coded(tree, fullname.partition(".")[2]), path, "exec")

    def exec_module(self, module):
        """Run a coded module; the templates of words.toml are codes, too."""
        super().exec_module(module)
        if module.__name__ == f"{PACKAGE}.report.words":
            for name in ("TEMPLATES", "WARNINGS", "REASONS", "VARIABLE", "CHANGES"):
                table = getattr(module, name)
                told = {code for code, text in table.items() if _WORDS.search(text)}
                table.update({code: f"{OPEN}{name}:{code}{CLOSE}" for code in told})


def differences(plain: object, other: object, where: str = "") -> Iterator[str]:
    """Places where two JSON values differ, but for texts: where the other has a code as text the
    plain one has a text."""
    if isinstance(other, str) and OPEN in other:
        if not isinstance(plain, str):
            yield f"{where}: {plain!r} is no text"
    elif isinstance(plain, dict) and isinstance(other, dict):
        if plain.keys() != other.keys():
            yield f"{where}: {sorted(plain.keys() ^ other.keys())}"
        for key in plain.keys() & other.keys() - {"seconds"}:
            yield from differences(plain[key], other[key], f"{where}.{key}")
    elif isinstance(plain, list) and isinstance(other, list) and len(plain) == len(other):
        for k, (one, two) in enumerate(zip(plain, other, strict=True)):
            yield from differences(one, two, f"{where}[{k}]")
    elif plain != other:
        yield f"{where}: {plain!r:.60} is {other!r:.60}"


def main(how: str, calls: str, results: str) -> None:
    """Run the calls of a file, `how` "plain" or "coded"."""
    asked = json.loads(Path(calls).read_text())
    if how == "coded":
        sys.meta_path.insert(0, Finder())
    import jax

    jax.config.update("jax_enable_x64", True)
    from command import run

    import jaxfric.cli.folder

    jaxfric.cli.folder.Folder.draw = lambda *_: []  # no figures
    found = {}
    for name, call in asked.items():
        t = __import__("time").process_time()
        code, out, err = run(*call)
        print(
            name, code, round(__import__("time").process_time() - t, 1), file=sys.stderr, flush=True
        )
        found[name] = {"code": code, "json": json.loads(out) if out.strip() else None, "err": err}
        Path(results).write_text(json.dumps(found))


if __name__ == "__main__":
    main(*sys.argv[1:])
