"""The least-squares problem of an axis record by inverse dynamics: motor force from motion.

Residual of every decimated row: (predicted - recorded force)/noise scale. It has the face that
`jaxfric.loop` fits: parameters in one vector of unbounded variables, rows with weights.
"""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..motion import MeasuredMotion
from ..rig.axis import AxisRig
from .abstract_problem import FAILED_MISFIT, AbstractProblem, Sizes
from .axis_preparation import AbstractSampler, Prepared, shifted
from .encompassing import EncompassingModel

SLOWEST = 0.02
"""Quantile of the speeds of the rows that count which is the slowest speed that a record tells of,
and share of the largest one below which no friction is asked for."""
_SPEEDS = 12
NEGLIGIBLE = 0.02
"""Share of a force below which a friction that drives, or a difference, is taken for zero; of the
way forth below which that back is none."""
_LAG = 1e-2
_SHARES = (1e-3, 0.1)
"""Shares of the force that a mass takes at its largest acceleration: it is lost below the first,
and begun with the second."""


class AxisProblem(AbstractProblem):
    """A prepared record and an `EncompassingModel` of axis effects."""

    time: Float[Array, " n"]
    friction: Float[Array, " n"]
    """Recorded motor force; the name is that of `jaxfric.fitting.Problem`."""
    weight: Float[Array, " n"]
    clock: Float[Array, "n 1"]
    """Clocks over which noise may be correlated: time [s]."""
    motion: MeasuredMotion
    sampler: AbstractSampler
    interval: Float[Array, ""]
    noise_scale: Float[Array, ""]
    width: Float[Array, ""]
    reach: Float[Array, ""]
    typical: Sizes
    hold: Float[Array, "0"]
    channels: tuple[()]
    model: EncompassingModel = eqx.field(static=True)  # ty: ignore[incompatible-mutable-override]

    @property
    def sizes(self) -> Sizes:
        """Typical sizes of the record."""
        return self.typical

    def rig(self, z: Float[Array, " p"] | Sequence[Array]) -> AxisRig:
        """The axis with the parameters `z`, an array or one by one."""
        values = self.coordinates.natural(list(z))
        n = len(self.model.base.names())
        rig = AxisRig(*values[:n], width=self.width, reach=self.reach)
        return self.model.embed(rig, values[n:])

    def possible(self, z: Float[Array, " p"] | np.ndarray) -> bool:
        """Whether friction takes energy, as far as the record moves: F_c and (F(v) - F(-v))/2.

        Less than a fiftieth of the force below zero is taken for zero.
        """
        rig, at = self.rig(jnp.asarray(z)), jnp.mean(self.motion.position)
        v = self.typical.velocity * jnp.geomspace(SLOWEST, 1.0, _SPEEDS)
        least = jnp.minimum(jnp.min(rig.turning_friction(at, v)), rig.coulomb)
        return bool(least >= -NEGLIGIBLE * self.sizes.force)

    def plain(self) -> "AxisProblem":
        """Itself: its residuals are in units of `noise_scale`, as correlated as they are."""
        return self

    def heavier(self, factor: int) -> "AxisProblem":
        """Itself: inverse dynamics takes no steps."""
        return self

    def late_steps(self) -> tuple[np.ndarray, np.ndarray]:
        """None: an axis follows a reference, without steps of its own."""
        return np.zeros(0), np.zeros(0)

    def begun(self, z: np.ndarray) -> np.ndarray:
        """`z`, with a mass that counts.

        A base that lacks a spring or a weight wants a mass below zero and loses the one it has;
        force no longer depends on its logarithm then, and no effect would bring it back.
        """
        z, i = np.array(z), self.model.names().index("M")
        about = self.on_host()
        whole = about.sizes.force / max(float(np.max(np.abs(about.motion.acceleration))), 1e-300)
        least, first = (self.model.quantity("M").to_free(whole * share) for share in _SHARES)
        z[i] = first if z[i] < least else z[i]
        return z

    def predict(self, z: Float[Array, " p"] | Sequence[Array]) -> Float[Array, " n"]:
        """Motor force at the decimated rows. A derivative by one of the parameters is cheaper where
        they come one by one: it leaves out what the others do."""
        rig = self.rig(z)
        force = shifted(
            rig.force(self.motion), self.interval, lag=rig.lag, lead=rig.delay, late=rig.late
        )
        return self.sampler(force)

    def residual(self, z: Float[Array, " p"]) -> Float[Array, " n"]:
        """(predicted - recorded)/noise_scale; 0 without weight."""
        residual = (self.predict(z) - self.friction) / self.noise_scale
        return jnp.where(jnp.isfinite(residual), residual, FAILED_MISFIT) * self.weight


def make_problem(
    prepared: Prepared,
    weight: np.ndarray,
    model: EncompassingModel,
    *,
    width: float,
    noise_scale: float,
) -> AxisProblem:
    """A problem whose rows have the given weights (0 or 1)."""
    motion, used = prepared.motion, weight > 0
    v = np.asarray(prepared.means(motion.velocity))[used]
    sizes = Sizes(
        *(
            jnp.asarray(max(float(x), 1e-300))
            for x in (
                np.sqrt(np.mean(prepared.force[used] ** 2)),
                np.max(np.abs(v)),
                np.ptp(np.asarray(motion.position)),
                prepared.time[prepared.rows - 1],
                _LAG * np.ptp(np.asarray(motion.position)) / np.max(np.abs(v)),  # ty: ignore[unsupported-operator]
            )
        )
    )
    slowest = float(np.quantile(np.abs(v), SLOWEST))
    return AxisProblem(
        time=jnp.asarray(prepared.time),
        friction=jnp.asarray(prepared.force),
        weight=jnp.asarray(weight),
        clock=jnp.asarray(prepared.time)[:, None],
        motion=motion,
        sampler=prepared.forces,
        interval=jnp.asarray(prepared.step),
        noise_scale=jnp.asarray(noise_scale),
        width=jnp.asarray(width),
        reach=jnp.asarray(slowest * float(prepared.time[1] - prepared.time[0])),
        typical=sizes,
        hold=jnp.zeros(0),
        channels=(),
        model=model,
    )


@eqx.filter_jit
def shape_columns(
    problem: AxisProblem, zs: Float[Array, "c p"], amplitudes: tuple[int, ...]
) -> Float[Array, "n k"]:
    """Derivatives of the prediction by some amplitudes, at every row of `zs`, in noise units."""

    def one(z):
        def push(i):
            def by(amplitude):
                return problem.predict([*z[:i], amplitude, *z[i + 1 :]])

            return jax.jvp(by, (z[i],), (jnp.ones_like(z[i]),))[1] / problem.noise_scale

        return jnp.stack([push(i) for i in amplitudes])

    columns = jax.lax.map(one, zs, batch_size=8)
    return columns.reshape(-1, columns.shape[-1]).T
