"""A prediction as tables."""

import math

from ..prediction import Prediction
from .tables import TextTable


def tables(found: Prediction) -> list[TextTable]:
    """Errors of every model under each comparison, and the parameters that a refit would give."""
    return [_errors(found), *_parameters(found)]


def _errors(found: Prediction) -> TextTable:
    rows = [
        (
            c.model,
            c.method,
            f"{100 * c.relative_error:.3g} %",
            _sized(c.rms, c.unit),
            "" if c.in_sigma is None else f"{c.in_sigma:.2f}",
        )
        for c in found.comparisons
    ]
    of = "the recorded friction less its mean" if found.kind == "slider" else "what was recorded"
    note = f"relative error: |predicted - recorded|/|recorded|, of {of}. in sigma: rms over the"
    note += " scatter of neighbouring rows of this record"
    if found.kind == "axis":
        note += ". As published: all rows but those at rest, decimated, the force acting at once"
    heads = ("model", "compared", "relative error", "rms", "in sigma")
    shares = [
        (what, f"{100 * share:.0f} %")
        for what, share in zip(
            ("what other parameters would explain", "beyond the noise in any fit", "noise"),
            found.shares().values(),
            strict=True,
        )
    ]
    told = "; ".join(f"{what} {share}" for what, share in shares)
    return TextTable("Prediction", heads, rows, f"{note}. Mean square of the first row: {told}")


def _sized(value: float, unit: str) -> str:
    """The value with its unit, and a prefix where the unit is one that takes it."""
    if unit in ("1", "%"):
        return f"{value:.3g} {unit.removeprefix('1')}".strip()
    factor, shown = next(
        (f, p)
        for f, p in ((1.0, ""), (1e3, "m"), (1e6, "µ"), (1e9, "n"))
        if f * value >= 1 or f == 1e9
    )
    return f"{factor * value:.3g} {shown}{unit}"


def _parameters(found: Prediction) -> list[TextTable]:
    if not found.shifts:
        return []
    rows = []
    for shift in found.shifts:
        known = math.isfinite(shift.in_sigma)
        rows.append(
            (
                shift.name,
                f"{shift.model:.5g}",
                f"{shift.here:.5g}" if known else "",
                f"{shift.error:.2g}" if known else "undetermined",
                f"{shift.in_sigma:+.1f}".replace("-", "−") if known else "",
            )
        )
    marked = tuple(k for k, shift in enumerate(found.shifts) if abs(shift.in_sigma) > 3)
    heads = ("parameter (SI)", "model", "fitted here", "± of the difference", "in sigma")
    note = "fitted here: what a fit of the same model to this record alone would give; not used"
    return [TextTable("Have the parameters changed?", heads, rows, note, marked)]
