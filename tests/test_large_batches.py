"""Batches of 16,385 members and more, against the same members 1,000 at a time.

jax 0.10.2 is wrong on the CPU in some rows of batches of 16,385 to 65,535, where a product with a
matrix has few columns (jax issue 39103); pyproject.toml excludes it.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxfric import RateState, VelocitySteps, minimum_gains
from jaxfric.fitting.problem import Model, ProblemSizes, make_problem
from jaxfric.members.computations import COMPUTATIONS
from jaxfric.members.make import make

CHUNK, LEAST = 1_000, 16_385
MORE = (20_000, 40_000)

SLIDERS = """
[axes]
k_p = { sobol = ["800 kN/m", "4 MN/m"], log = true }
V0 = { sobol = ["1 um/s", "10 um/s"], log = true }
A = { sobol = ["4 N", "5 N"] }
B = { sobol = ["4 N", "6 N"] }
L = { sobol = ["3 um", "8 um"] }
"""
SECOND_STATE = """
B2 = { sobol = ["1 N", "2 N"] }
L2 = { sobol = ["20 um", "40 um"] }
"""
NUMBER = "\n[samples]\nnumber = 65536\n"
MOTION = '[rig]\nlaw = "slip"\n[simulate]\nratio = 3\nmax_steps = 64\n'
STUDIES = {
    "margins": 'compute = ["margins"]\n[rig]\nlaw = "slip"\n',
    "ends": 'compute = ["simulate"]\n' + MOTION,
    "motions": 'compute = ["simulate"]\noutputs = ["force", "trace"]\n' + MOTION + "samples = 3\n",
}
# With what compiles for longer: mass, two states, and the solver that serves all laws.
LONG_STUDIES = {
    "margins": 'compute = ["margins"]\n[rig]\nlaw = "ageing"\nm = "2 kg"\nk_v = "1 kN*s/m"\n',
    "ends": STUDIES["ends"].replace("slip", "ageing"),
    "motions": STUDIES["motions"].replace("slip", "ageing"),
    "ends with mass": STUDIES["ends"]
    .replace("64", "32\ninertia = true")
    .replace("[simulate]", 'm = "2 kg"\n[simulate]'),
}


def assert_same_in_chunks(function, members):
    """`function` of all rows of the arrays of `members` at once and 1,000 at a time."""
    compiled = jax.jit(function)
    whole = jax.tree.leaves(compiled(members))
    number = len(jax.tree.leaves(members)[0])
    for begin in range(0, number, CHUNK):
        rows = np.minimum(np.arange(begin, begin + CHUNK), number - 1)
        some = jax.tree.leaves(compiled(jax.tree.map(lambda x, rows=rows: x[rows], members)))
        for found, known in zip(whole, some, strict=True):
            np.testing.assert_allclose(found[rows], known, rtol=1e-9)


def assert_same_study(path, text, number):
    path.write_text(text)
    of, made = make(path)
    assert_same_in_chunks(made.function, of.grid.samples.draw(0, number))


@pytest.mark.parametrize("number", (LEAST, *MORE))
def test_products_with_a_matrix(number):
    rng = np.random.default_rng(number)
    for columns in (3, 5, 6, 7):
        matrix = jnp.asarray(rng.standard_normal((columns, columns)))
        rows = rng.standard_normal((number, columns))
        found = jax.jit(jax.vmap(lambda row, M=matrix: jnp.sum((M @ row) ** 2)))(rows)
        known = np.sum((rows @ np.asarray(matrix).T) ** 2, axis=1)
        np.testing.assert_allclose(found, known, rtol=1e-12, err_msg=str(columns))


@pytest.mark.parametrize("name", STUDIES)
def test_studies(name, tmp_path):
    assert_same_study(tmp_path / "study.toml", STUDIES[name] + SLIDERS + NUMBER, LEAST)


@pytest.mark.long
@pytest.mark.parametrize("number", (LEAST, *MORE))
@pytest.mark.parametrize("name", LONG_STUDIES)
def test_more_studies(name, number, tmp_path):
    text = LONG_STUDIES[name] + SLIDERS + SECOND_STATE + NUMBER
    assert_same_study(tmp_path / "study.toml", text, number)


def test_each_computation_of_arrays_is_among_the_studies():
    """Those that stand alone are Python, member by member."""
    mapped = {name for name, computation in COMPUTATIONS.items() if not computation.alone}
    assert mapped == {text.split('"')[1] for text in STUDIES.values()}


@pytest.mark.long
@pytest.mark.parametrize("number", (LEAST, *MORE))
@pytest.mark.parametrize("stiffness", (3e3, 3e7))
def test_residuals(number, stiffness):
    """Of a record with one step; the stiff spring is simulated by the stiff method."""
    steps = VelocitySteps(np.array([0.0, 5.0]), np.array([1e-6, 3e-6]))
    sizes = ProblemSizes(V0=1e-6, stiffness=stiffness, noise=1e-3, force=1e-2)
    time = np.linspace(0.0, 30.0, 40)
    problem = make_problem(time, 0.6 + 0 * time, steps, sizes, Model())
    assert problem.stiff == (stiffness > 1e6)
    start = problem.coordinates.to_free(jnp.array([0.6, 0.01, 0.012, 1e-5]))
    rows = start + 0.1 * np.random.default_rng(0).standard_normal((number, 4))
    assert_same_in_chunks(jax.vmap(problem.residual), rows)


@pytest.mark.long
def test_gains():
    number, rng = LEAST, np.random.default_rng(0)
    A = rng.uniform(3.0, 5.0, number)
    B, L = A * rng.uniform(1.5, 3.0, number), rng.uniform(1e-5, 1e-4, number)

    def gains(law):
        A, B, L = law
        found = minimum_gains(
            RateState(300.0, A, B[None], L[None], 1e-6), 1e-5, 2.0, {"modulus": 0.5}
        )
        return found.k_p, found.k_v

    assert_same_in_chunks(jax.vmap(gains), (A, B, L))
