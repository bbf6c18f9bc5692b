"""pyoperon: symbolic regression of what the base leaves, by genetic programming.

It fits the constants of every expression, and offers its Pareto front of error and length. Trained
on the train block. A formula's terms are what it adds up; the kinds of a term are those of all
variables in it.
"""

import ast
from collections.abc import Iterator

import numpy as np

from .answers import Claim, Formula, weight
from .base import Base
from .terms import Term, variables

SYMBOLS = "add,sub,mul,div,constant,variable,exp,log,sin,cos,tanh"
POPULATION, EVALUATIONS, LENGTH, SEED = 500, 100_000, 25, 1
_BASES_OWN = {"u", "theta", "omega"}
_TAKEN_UP = 0.95
_FUNCTIONS = {name: getattr(np, name) for name in ("exp", "log", "sin", "cos", "tanh")}


def operon(base: Base) -> list[Formula]:
    """Formulas of the Pareto front."""
    from pyoperon.sklearn import SymbolicRegressor

    known, train = variables(base), base.rows("train")
    columns = np.stack([term.values for term in known], axis=1)
    scale = base.rms(base.residual, "train")
    found = SymbolicRegressor(
        allowed_symbols=SYMBOLS,
        objectives=["mse", "length"],
        population_size=POPULATION,
        max_evaluations=EVALUATIONS,
        max_length=LENGTH,
        optimizer_iterations=5,
        n_threads=1,
        random_state=SEED,
    ).fit(columns[train], base.residual[train] / scale)
    texts = [found.get_model_string(one["tree"], 12) for one in found.pareto_front_]
    offers = [formula(base, known, text, scale) for text in texts]
    return [offer for offer in offers if np.all(np.isfinite(offer.left))]


def formula(base: Base, known: list[Term], text: str, scale: float) -> Formula:
    """The formula of an expression in X1, X2, ... of what the base leaves over `scale`."""
    names = {f"X{i + 1}": term for i, term in enumerate(known)}
    values = {**_FUNCTIONS, **{name: term.values for name, term in names.items()}}
    tree, claims = ast.parse(text.strip(), mode="eval").body, []
    with np.errstate(all="ignore"):
        whole = _value(tree, values) * np.ones_like(base.time)
        for factor, part in addends(tree):
            used = [names[n] for n in variables_in(part) if n in names]
            if not used:
                continue
            column = _value(part, values) * _value(factor, values) * scale
            own = {term.name for term in used} <= _BASES_OWN and taken_up(base, column)
            kinds = ("base",) if own else tuple(sorted({term.kind for term in used}))
            claims.append(Claim(ast.unparse(part), kinds, weight(base, column)))
    fitted = sum(isinstance(node, ast.Constant) for node in ast.walk(tree))
    return Formula(tuple(claims), base.residual - scale * whole, fitted)


def addends(tree: ast.expr) -> Iterator[tuple[ast.expr, ast.expr]]:
    """What an expression adds up or subtracts, as constant factor and rest.

    Constants multiply out; signs, which no weight needs, are left out.
    """
    if isinstance(tree, ast.UnaryOp):
        yield from addends(tree.operand)
    elif isinstance(tree, ast.BinOp) and isinstance(tree.op, ast.Add | ast.Sub):
        yield from addends(tree.left)
        yield from addends(tree.right)
    elif isinstance(tree, ast.BinOp) and not variables_in(tree.right):
        one = ast.Constant(1.0)
        yield from _times(ast.BinOp(one, tree.op, tree.right), tree.left)
    elif isinstance(tree, ast.BinOp) and isinstance(tree.op, ast.Mult):
        if variables_in(tree.left):
            yield ast.Constant(1.0), tree
        else:
            yield from _times(tree.left, tree.right)
    else:
        yield ast.Constant(1.0), tree


def _times(factor: ast.expr, tree: ast.expr) -> Iterator[tuple[ast.expr, ast.expr]]:
    for other, part in addends(tree):
        yield ast.BinOp(factor, ast.Mult(), other), part


def variables_in(tree: ast.expr) -> list[str]:
    """Names of the variables of an expression, in order, each once."""
    found = [node.id for node in ast.walk(tree) if isinstance(node, ast.Name)]
    return [name for name in dict.fromkeys(found) if name not in _FUNCTIONS]


def taken_up(base: Base, column: np.ndarray) -> bool:
    """Whether other parameters of the base, or another offset, would do nearly the same."""
    basis = np.column_stack([base.slopes, np.ones(len(column))])
    left = column - basis @ np.linalg.lstsq(basis, column, rcond=None)[0]
    return bool(np.var(left) <= (1 - _TAKEN_UP) * np.var(column))


def _value(tree: ast.expr, values: dict):
    code = compile(ast.fix_missing_locations(ast.Expression(tree)), "<formula>", "eval")
    return eval(code, {"__builtins__": {}}, values)
