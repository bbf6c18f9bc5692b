"""`predict(model, record)`: what does a saved model say of a record that it has not seen?"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from ..effects import ids_of
from ..errors import InputError
from ..fitting import Fit
from ..loop import Loop
from ..records import AxisRecord, Record, VelocitySteps
from ..records.given import as_axis_record, as_record
from ..silent import silent
from .axis import predict_axis
from .model import SavedModel, load_model
from .result import Prediction
from .slider import predict_slider


def predict(
    model: str | Path | Fit | Loop,
    record: Record | AxisRecord | str | Path,
    *,
    stiffness: float | str | None = None,
    steps: VelocitySteps | str | None = None,
    free: str | Sequence[str] | None = None,
    held: bool | None = None,
    progress: Callable[[str], None] = silent,
) -> Prediction:
    """A model on another record: how large its error is, and whether the noise allows it.

    A slider's friction is simulated from the motion of its load point. An axis is compared by
    inverse dynamics (motor force from motion) and, where its record has a reference and the gains
    of the controller, by the simulated closed loop (position and motor force from the reference
    and the disturbance).

    The residual is held against two others: the scatter of neighbouring rows, which is the noise of
    this record, and what a fit of all parameters of the same model to this record would leave. A
    residual beyond the second says that the parameters have changed; one that a fit would not take
    away either says that the model lacks something here, or that noise is correlated.

    Parameters
    ----------
    model : a fit.json or loop.json, or a `Fit` or `Loop` at hand. Of a loop, the model before and
        the one after.
    record : as read by `jaxfric.read` or, for the model of an axis, `jaxfric.read_axis`; or its
        path.
    stiffness : of the machine that made this record (sliders), in friction per metre or text with a
        unit; by default that of the model.
    steps : of this record (sliders), as in `jaxfric.fit`.
    free : names of the parameters that are fitted to this record; ("f0",) of a slider, none of an
        axis. Times of steps found in the load point are always fitted within their error.
    held : of an axis, as in `jaxfric.close_axis_loop`.

    Returns
    -------
    Prediction : errors, the verdict in words, what of the record was fitted, arrays for figures.

    Raises
    ------
    InputError : a model that did not converge or is damaged, of another kind of rig or in other
        units; an argument that would not be used; float64 is off.

    Not tried: an axis of which parameters are fitted; a state at the start other than steady
    sliding.
    """
    saved = load_model(model)
    record = _record_for(saved, record)
    if isinstance(record, AxisRecord):
        unused = {"stiffness": stiffness, "steps": steps, "free": free}
        _refuse(saved.path, "an axis", unused)
        return predict_axis(saved, record, held=held, progress=progress)
    _refuse(saved.path, "a slider", {"held": held})
    names = ("f0",) if free is None else ids_of(free)
    return predict_slider(
        saved, record, stiffness=stiffness, steps=steps, free=names, progress=progress
    )


def _record_for(saved: SavedModel, record: Record | AxisRecord | str | Path) -> Record | AxisRecord:
    """The record, read where it is a path, of the kind that the model is of."""
    if isinstance(record, str | Path):
        record = as_axis_record(record) if saved.is_axis else as_record(record)
    if saved.is_axis != isinstance(record, AxisRecord):
        kinds = ("an axis", "read_axis") if saved.is_axis else ("a slider", "read")
        raise InputError(
            f"{saved.path} is a model of {kinds[0]}; read the record with jaxfric.{kinds[1]}, not"
            f" as {type(record).__name__}"
        )
    return record


def _refuse(path: Path, kind: str, unused: Mapping[str, object]) -> None:
    given = [name for name, value in unused.items() if value is not None]
    if given:
        raise InputError(
            f"{' and '.join(given)} would not be used: {path} is a model of {kind}; leave it out"
        )
