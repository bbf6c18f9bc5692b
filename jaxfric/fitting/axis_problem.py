"""The least-squares problem of an axis record by inverse dynamics: motor force from motion.

The residual of every decimated row is (predicted - recorded force)/noise scale. `jaxfric.loop` fits
an axis through the interface `AbstractProblem`: one vector of unbounded variables, rows with
weights.
"""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..motion import MeasuredMotion
from ..rig.axis import AxisRig
from .abstract_problem import AbstractProblem, Sizes
from .axis_preparation import AbstractSampler, Prepared, shifted
from .encompassing import EncompassingModel
from .thresholds import FAILED_MISFIT, LAG_SHARE, MASS_SHARES, NEGLIGIBLE, SLOWEST, SPEEDS_CHECKED


class AxisProblem(AbstractProblem):
    """A prepared record and an `EncompassingModel` of axis effects."""

    time: Float[Array, " n"]
    friction: Float[Array, " n"]
    """Recorded motor force, named as in `jaxfric.fitting.Problem`."""
    weight: Float[Array, " n"]
    clock: Float[Array, "n 1"]
    """Coordinate in which noise may be correlated: time [s]."""
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
        """The axis with the parameters `z`, an array or a sequence of scalars."""
        values = self.coordinates.natural(list(z))
        n = len(self.model.base.names())
        rig = AxisRig(*values[:n], width=self.width, reach=self.reach)
        return self.model.embed(rig, values[n:])

    def possible(self, z: Float[Array, " p"] | np.ndarray) -> bool:
        """Whether friction dissipates at the recorded speeds: F_c >= 0, and F at any speed forwards
        is at least F at any speed backwards. Otherwise friction drives the axis in one direction,
        whatever the offset.

        Negative friction below the share `NEGLIGIBLE` of the force counts as zero.
        """
        rig, at = self.rig(jnp.asarray(z)), jnp.mean(self.motion.position)
        v = self.typical.velocity * jnp.geomspace(SLOWEST, 1.0, SPEEDS_CHECKED)
        forwards, backwards = (rig.steady_friction(at, way) for way in (v, -v))
        least = jnp.minimum((jnp.min(forwards) - jnp.max(backwards)) / 2, rig.coulomb)
        return bool(least >= -NEGLIGIBLE * self.sizes.force)

    def plain(self) -> "AxisProblem":
        """Return the problem itself: its residuals are in units of `noise_scale`, not whitened."""
        return self

    def heavier(self, factor: int) -> "AxisProblem":
        """Return the problem itself, because inverse dynamics takes no solver steps."""
        return self

    def late_steps(self) -> tuple[np.ndarray, np.ndarray]:
        """Return empty results, because an axis has no step times to fit."""
        return np.zeros(0), np.zeros(0)

    def begun(self, z: np.ndarray) -> np.ndarray:
        """Return `z` with a mass that is not negligible.

        The fit of a base model that lacks a spring or gravity drives the mass towards zero. Near
        zero mass the force does not depend on the logarithm of the mass, so a later fit could not
        recover the mass.
        """
        z, i = np.array(z), self.model.names().index("M")
        about = self.on_host()
        whole = about.sizes.force / max(float(np.max(np.abs(about.motion.acceleration))), 1e-300)
        least, first = (self.model.quantity("M").to_free(whole * share) for share in MASS_SHARES)
        z[i] = first if z[i] < least else z[i]
        return z

    def predict(self, z: Float[Array, " p"] | Sequence[Array]) -> Float[Array, " n"]:
        """Motor force at the decimated rows. A derivative by one parameter is cheaper if `z` is a
        sequence of scalars, because JAX then skips all other parameters.
        """
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
    """The least-squares problem of a prepared record with the given weights of rows (0 or 1)."""
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
                LAG_SHARE * np.ptp(np.asarray(motion.position)) / np.max(np.abs(v)),  # ty: ignore[unsupported-operator]
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
    """Derivatives of the predicted force by some amplitudes at every point `zs`, in noise units."""

    def one(z):
        def push(i):
            def by(amplitude):
                return problem.predict([*z[:i], amplitude, *z[i + 1 :]])

            return jax.jvp(by, (z[i],), (jnp.ones_like(z[i]),))[1] / problem.noise_scale

        return jnp.stack([push(i) for i in amplitudes])

    columns = jax.lax.map(one, zs, batch_size=8)
    return columns.reshape(-1, columns.shape[-1]).T
