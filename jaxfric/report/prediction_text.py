"""A prediction in words and tables."""

import math

from ..prediction import Prediction
from ..units import prefixed
from .estimates import UNDETERMINED, signed
from .report import Report
from .tables import TextTable


def report(found: Prediction) -> Report:
    """The sentence, the notes and the tables that `jaxfric predict` prints."""
    notes = [f"  - {note}" for note in found.notes]
    told = (found.sentence, *notes[:2])
    return Report(told, [_errors(found), _parameters(found)], notes[2:], warnings=found.warnings)


def _errors(found: Prediction) -> TextTable:
    rows = []
    for c in found.comparisons:
        sigma = "" if c.in_sigma is None else f"{c.in_sigma:.2f}"
        error = f"{100 * c.relative_error:.3g} %"
        rows.append((c.model, c.method, error, prefixed(c.rms, c.unit, 3), sigma))
    of = "the recorded friction less its mean" if found.kind == "slider" else "what was recorded"
    note = f"relative error: |predicted - recorded|/|recorded|, of {of}. in sigma: rms over the"
    note += " noise of this record"
    heads = ("model", "compared", "relative error", "rms", "in sigma")
    what = ("what other parameters would explain", "beyond the noise in any fit", "noise")
    shares = zip(what, found.shares().values(), strict=True)
    told = "; ".join(f"{name} {100 * share:.0f} %" for name, share in shares)
    return TextTable("Prediction", heads, rows, f"{note}. Mean square of the first row: {told}")


def _parameters(found: Prediction) -> TextTable:
    rows = []
    for shift in found.shifts:
        cells = ("", UNDETERMINED, "")
        if math.isfinite(shift.in_sigma):
            cells = (f"{shift.here:.5g}", f"{shift.error:.2g}", signed(shift.in_sigma))
        rows.append((shift.name, f"{shift.model:.5g}", *cells))
    marked = tuple(k for k, shift in enumerate(found.shifts) if abs(shift.in_sigma) > 3)
    heads = ("parameter (SI)", "model", "fitted here", "± of the difference", "in sigma")
    note = "fitted here: what a fit of the same model to this record alone would give; not used"
    return TextTable("Have the parameters changed?", heads, rows, note, marked)
