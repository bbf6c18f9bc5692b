"""`predict(model, record)`: test a saved model on a record that the model was not fitted to."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from ..effects import ids_of
from ..errors import InputError
from ..fitting import Fit
from ..fitting.fit import require_float64
from ..lazy import old_arguments
from ..loop import Loop
from ..records import AxisRecord, Record, VelocitySteps
from ..records.given import as_axis_record, as_record
from ..silent import silent
from .axis import predict_axis
from .model import SavedModel, load_model
from .result import Prediction
from .slider import predict_slider


@old_arguments(free="refit", held="zero_order_hold")
def predict(
    model: str | Path | Fit | Loop,
    record: Record | AxisRecord | str | Path,
    *,
    stiffness: float | str | None = None,
    steps: VelocitySteps | str | None = None,
    refit: str | Sequence[str] | None = None,
    zero_order_hold: bool | None = None,
    progress: Callable[[str], None] = silent,
) -> Prediction:
    """Predict another record with a model; test whether the error is consistent with noise.

    A slider's friction is simulated from the motion of its load point. An axis is compared by
    inverse dynamics (motor force from motion). If the axis's record has a reference and the gains
    of the controller, the simulated closed loop is compared, too (position and motor force from the
    reference and the disturbance).

    The residual of the prediction is compared with the noise of the record, and with the residual
    of the same model refitted to the record. The noise of a slider is white noise and correlated
    parts, estimated from the refit; that of an axis is the scatter of neighbouring rows. If the
    refit is better, or its parameters differ, by more than the errors of both fits explain (chance
    below 0.1 %), the parameters have changed. If the residual of the refit exceeds the noise
    (chance below 0.1 %), the model lacks an effect for this record, or the noise is correlated
    farther than assumed.

    Parameters
    ----------
    model : path of a fit.json or loop.json, or a `Fit` or `Loop`. Of a loop, the models before and
        after the search are compared.
    record : as read by `jaxfric.read` or, for the model of an axis, `jaxfric.read_axis`; or the
        path of a record.
    stiffness : of the machine that made this record (sliders), in friction per metre or text with a
        unit; by default the stiffness of the model.
    steps : velocity steps of this record (sliders), as in `jaxfric.fit`.
    refit : names of the parameters to fit to this record; by default ("f0",) for a slider, none for
        an axis. Times of steps found in the load point are always fitted within their error.
    zero_order_hold : for an axis, as in `jaxfric.close_axis_loop`.

    Returns
    -------
    Prediction : errors, the verdict in words, parameters fitted to the record, arrays for figures.

    Raises
    ------
    InputError : a model that did not converge or is damaged, of another kind of rig or in other
        units; an argument that would not be used; float64 is off.

    Limitations: parameters of an axis cannot be fitted; the record must start in steady sliding.
    """
    require_float64()
    saved = load_model(model)
    record = _record_for(saved, record)
    if isinstance(record, AxisRecord):
        unused = {"stiffness": stiffness, "steps": steps, "refit": refit}
        _refuse(saved.path, "an axis", unused)
        return predict_axis(saved, record, held=zero_order_hold, progress=progress)
    _refuse(saved.path, "a slider", {"zero_order_hold": zero_order_hold})
    names = ("f0",) if refit is None else ids_of(refit)
    return predict_slider(
        saved, record, stiffness=stiffness, steps=steps, free=names, progress=progress
    )


def _record_for(saved: SavedModel, record: Record | AxisRecord | str | Path) -> Record | AxisRecord:
    """Return the record, read if it is a path; it must be of the model's kind."""
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
