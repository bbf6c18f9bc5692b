"""What the loop's own base fit leaves of a record, and the states that a rival may use.

The base is not fitted again: its parameters and steps are those that `loop.json` tells, found on
the train block alone. `jaxfric.simulate` predicts all rows from them.
"""

import json
from pathlib import Path
from typing import NamedTuple

import numpy as np

_ROWS = 512  # records are padded to multiples of it, so that few lengths are compiled
_SMALL = 1e-3
_RTOL = 1e-7
_AGREE = 0.1


class UnlikeLoopError(RuntimeError):
    """The base does not leave what its loop left."""


class Base(NamedTuple):
    """The base along a record. All arrays have its rows; SI, time from the first row."""

    time: np.ndarray
    friction: np.ndarray
    predicted: np.ndarray
    velocity: np.ndarray
    """Of the slider."""
    slip: np.ndarray
    state: np.ndarray
    """theta."""
    slopes: np.ndarray
    """Of the prediction by f0, ln A, ln B, ln L; shape (n, 4)."""
    step: np.ndarray
    """Index of the velocity of each row."""
    block: np.ndarray
    """0 train, 1 select, 2 report."""
    stress: np.ndarray
    """Recorded normal stress over the first one; 1 where there is none."""
    times: np.ndarray
    """Of the velocities, m of them; and these."""
    velocities: np.ndarray
    parameters: np.ndarray
    """f0, A, B, L, K, V0."""

    @property
    def residual(self) -> np.ndarray:
        return self.friction - self.predicted

    def rows(self, name: str) -> np.ndarray:
        """Mask of a block: train, select or report."""
        return self.block == ("train", "select", "report").index(name)

    def rms(self, left: np.ndarray, name: str) -> float:
        """rms of what is left of the rows of a block."""
        return float(np.sqrt(np.mean(left[self.rows(name)] ** 2)))


def base_of(record: Path, loop: dict) -> Base:
    """The base of a loop's record.

    Raises `UnlikeLoopError` where it leaves more or less than the loop says: the loop also moves
    the times of steps within their error, which its file does not tell.
    """
    from jaxfric.loop.split import split
    from jaxfric.records import read
    from jaxfric.records.steps import VelocitySteps

    told, at = loop["before"]["train_rms"], loop["before"]["parameters"]
    values = [at[k]["value"] for k in ("f0", "A", "B", "L", "K", "V0")]
    if told is None or None in values:
        raise UnlikeLoopError("its loop tells no base")
    known = read(record)
    times, velocities = np.array(loop["steps"]).T
    blocks = split(known.relative_time, VelocitySteps(times, velocities))
    p, fixed = np.array(values[:4]), np.array(values[4:])
    stress = _stress(known)

    def run(size: np.ndarray):
        values = np.append(p[:1] + size[:1], p[1:] * np.exp(size[1:]))
        return _simulate(known.relative_time, times, velocities, [*values, *fixed], stress)

    here, columns = run(np.zeros(4)), []
    for h in _SMALL * np.eye(4):
        columns.append((run(h)[0] - run(-h)[0]) / (2 * _SMALL))
    base = Base(
        known.relative_time,
        known.friction,
        *here,
        np.stack(columns, axis=1),
        blocks.step,
        blocks.select + 2 * blocks.report,
        np.ones(len(known)) if stress is None else known.normal_stress / known.normal_stress[0],
        times,
        velocities,
        np.append(p, fixed),
    )
    if abs(base.rms(base.residual, "train") / told - 1) > _AGREE:
        found = base.rms(base.residual, "train")
        raise UnlikeLoopError(
            f"the base leaves {found:.4g} in the train block, its loop {told:.4g}"
        )
    return base


def _stress(record):
    from jaxfric.rig.normal_stress import recorded_stress

    if record.normal_stress is None:
        return None
    found = recorded_stress(record.relative_time, record.normal_stress)
    return found.padded(len(found.knots) + -len(found.knots) % _ROWS)


def _simulate(time, times, velocities, values, stress) -> tuple[np.ndarray, ...]:
    """Friction, velocity, slip and state of the base at the rows."""
    import equinox as eqx
    import jax.numpy as jnp

    from jaxfric import PiecewiseVelocity, QuasiStatic, RateState, Rig, simulate

    f0, A, B, L, K, V0 = (jnp.asarray(float(v)) for v in values)
    law = RateState(f0=f0, A=A, B=B[None], L=L[None], V0=V0)
    rig = Rig(QuasiStatic(K), law, normal_stress=stress)
    ts = np.pad(time, (0, -len(time) % _ROWS), mode="edge")
    global _compiled
    if _compiled is None:
        _compiled = eqx.filter_jit(lambda *a: simulate(*a, rtol=_RTOL))
    out = _compiled(rig, PiecewiseVelocity(times, velocities), jnp.asarray(ts))
    n = len(time)
    found = out.recorded, out.velocity, out.slip, out.state[:, 0]
    return tuple(np.asarray(each)[:n] for each in found)


_compiled = None


def stored(folder: Path, out: Path, name: str) -> Base:
    """The base of a record of a blind run, from `out` where it has been computed before."""
    path = out / "base" / f"{name}.npz"
    if not path.exists():
        loop = json.loads((folder / "loops" / name / "loop.json").read_text(encoding="utf-8"))
        base = base_of(folder / "records" / name / "record.csv", loop)
        path.parent.mkdir(parents=True, exist_ok=True)
        np.savez(path, **base._asdict())
    with np.load(path) as found:
        return Base(**found)
