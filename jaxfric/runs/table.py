"""The steps of a run as a table: for a terminal, as CSV, and with xlook's names."""

import csv
import io
from collections.abc import Mapping, Sequence

from ..errors import option
from ..fitting import Estimate, Fit
from ..fitting.drift import is_contradicted
from ..fitting.misfit import COLUMN, excess
from ..units import measured
from .fits import RunFit, StepFit
from .warned import MISSED, missed_warning

_SCALES = {"L": 1e6, "K": 1e-6, "slip_trend": 1e-3}
"""Factors from SI to micrometres, for a slip trend to millimetres."""
_UNITS = {"L": "um", "K": "1/um", "slip_trend": "1/mm"}

BRACKETS = "in brackets: one standard error, in units of the last digit"
"""Note on the numbers that `measured` writes."""
STAR = (
    f"misses a part of its record by more than {MISSED:g} times the noise, or has a trend that the"
    " rows before the step do not have"
)
"""Fault of a fit with a star in the table."""
MISFIT = f"{COLUMN}; *: the fit {STAR}, so A, B and L need not be those of the step"
"""Note on the column `misfit`."""

Cell = float | int | str | bool | None


def rows(run: RunFit) -> list[dict[str, Cell]]:
    """Return a row for every step: its velocities, and every parameter with its standard error.

    Names include units. Undetermined values are None, as are all values of a step without a fit;
    the column `result` gives the reason.
    """
    return [_row(step) for step in run.steps]


def _row(step: StepFit) -> dict[str, Cell]:
    event, fit = step.event, step.fit
    row: dict[str, Cell] = {
        "step": step.number,
        "time [s]": round(event.time, 4),
        "load_point_displacement [um]": round(1e6 * step.position, 3),
        "normal_stress [MPa]": rounded(event.normal_stress, 1e-6),
        "velocity before [um/s]": short(event.before, scale=1e6),
        "velocity after [um/s]": short(event.after, scale=1e6),
    }
    if fit is None:
        return row | {"result": step.failed}
    told = "; ".join((*missed_warning(fit), *fit.warnings))
    return row | fit_cells(fit) | {"warnings": told}


def fit_cells(fit: Fit) -> dict[str, Cell]:
    """Return the cells of a fit: parameters with standard errors, A-B, misfit and warnings.

    Names include units; undetermined values are None.
    """
    row: dict[str, Cell] = {"law": fit.law}
    force = fit.record.friction_unit != "1"
    label, own = f"A-B{' [N]' if force else ''}", fit.A_minus_B
    row |= with_std(label, *_known(own))
    if own.determined and fit.with_trend:
        row |= with_std(f"{label} with slip trend", *fit.with_trend)
    for name, estimate in fit.parameters.items():
        if name == "V0":
            continue
        kind = name.rstrip("0123456789")
        unit = _unit(kind, force)
        label = f"{name} [{unit}]" if unit else name
        known = _known(estimate) if fit.converged else (None, None)
        cells = with_std(label, *known, _SCALES.get(kind, 1.0))
        row |= cells if estimate.free else {label: cells[label]}
    row |= {"rms": short(fit.rms, 4), "noise": short(fit.noise.sigma, 4), "rows": len(fit.record)}
    row["misfit"] = short(excess(fit), 4)
    return row | {"result": fit.result, "warnings": "; ".join(fit.warnings)}


def claimed(fit: Fit) -> dict[str, object]:
    """Return a fit as JSON without undetermined numbers, and without any number if the fit did not
    converge. `Fit.to_json` keeps all numbers. Other commands read the law from a separate file."""
    content = fit.to_json()
    del content["friction_law"]
    for estimate in (content["A_minus_B"], *content["parameters"].values()):
        if estimate["free"] and not (fit.converged and estimate["determined"]):
            estimate["value"] = None
    if not fit.critical().stiffness.determined:
        content["critical_stiffness"] = None
    if not fit.converged:
        content |= dict.fromkeys(("covariance", "correlation", "sum_of_squares", "rms"))
    return content


def _unit(kind: str, force: bool) -> str:
    unit = _UNITS.get(kind, "")
    if not force:
        return unit
    return unit.replace("1/", "N/") if unit.startswith("1/") else unit or "N"


def short(value: float | None, digits: int = 7, scale: float = 1.0) -> float | None:
    """Round `scale` times a value to `digits` significant digits; None stays."""
    return None if value is None else float(f"{scale * value:.{digits}g}")


def with_std(
    label: str, value: float | None, std: float | None, scale: float = 1.0, digits: int = 7
) -> dict[str, Cell]:
    """Return the cells of a value, with `digits`, and of its standard error, both times `scale`."""
    return {label: short(value, digits, scale), f"std {label}": short(std, 4, scale)}


def rounded(value: float | None, scale: float = 1.0, digits: int = 4) -> float | None:
    """Round `scale` times a value to `digits` decimals; None stays."""
    return None if value is None else round(scale * value, digits)


def amount(difference: float) -> str:
    """Format a difference of BIC."""
    return f"{difference:.0f}" if difference >= 10 else f"{difference:.1f}"


def csv_text(table: Sequence[Mapping[str, Cell]]) -> str:
    """Return rows as CSV; columns are in the order in which the rows first name them."""
    columns = list(dict.fromkeys(name for row in table for name in row))
    out = io.StringIO()
    writer = csv.DictWriter(out, columns, restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows(table)
    return out.getvalue()


def xlook_rows(run: RunFit) -> list[dict[str, Cell]]:
    """Return rows with the column names of xlook's fits; Dc in um, lin_term in 1/um, wc 0.

    wc is xlook's weight control, and these fits do not weight rows. Undetermined values are None,
    shown as blank cells, as in `rows`.
    """
    out: list[dict[str, Cell]] = []
    for step in run.steps:
        row: dict[str, Cell] = {"step": step.number}
        if step.fit is not None and step.fit.converged:
            p = step.fit.parameters
            row |= {"mu_o": _known(p["f0"])[0]} | _pair("a", p["A"])
            for number in (n[1:] for n in p if n[0] == "B"):
                name = number or "1"
                row |= _pair(f"b{name}", p[f"B{number}"]) | _pair(f"Dc{name}", p[f"L{number}"], 1e6)
            row |= with_std("a-b", *_known(step.fit.A_minus_B))
            trend = p.get("slip_trend")
            row |= {"lin_term": 0.0 if trend is None else _known(trend, 1e-6)[0], "wc": 0}
        out.append({k: short(v) if isinstance(v, float) else v for k, v in row.items()})
    return out


def _known(estimate: Estimate, scale: float = 1.0) -> tuple[float | None, float | None]:
    """Return a value and its standard error in another unit; None if not determined."""
    if not estimate.determined:
        return None, None
    return scale * estimate.value, scale * estimate.std


def _pair(name: str, estimate: Estimate, scale: float = 1.0) -> dict[str, Cell]:
    """Return the cells of a parameter and its error."""
    return dict(zip((name, f"std {name}"), _known(estimate, scale), strict=True))


def misses(step: StepFit) -> bool:
    """Whether the parameters of a step's fit may be wrong: the fit misses a part of its record, or
    its slip trend contradicts the rows before the step."""
    fit = step.fit
    if fit is None or not fit.converged:
        return False
    return bool(missed_warning(fit)) or is_contradicted(fit)


def headline(run: RunFit) -> str:
    """Return a line on the number of fitted steps, and of fits with a star (`misses`)."""
    fitted = [step for step in run.steps if step.fit is not None and step.fit.converged]
    words = f"{len(fitted)} of {len(run.steps)} velocity steps fitted"
    if not (missed := sum(map(misses, fitted))):
        return words
    fits = f"{missed} fit does" if missed == 1 else f"{missed} fits do"
    return f"{words}; {fits} not describe the step (*)"


def ask_on(run: RunFit) -> str:
    """Return advice for steps whose fits miss a part of the record; '' without such steps.

    For fits without a slip trend the advice is to fit a trend, because a trend is often mistaken
    for evolution. For fits with a slip trend the advice is to search for another effect.
    """
    fits = {step.number: step.fit for step in run.steps if step.fit and misses(step)}
    if not fits:
        return ""
    which = f"step {', '.join(map(str, fits))} (*)"
    if any(fit.model.slip_trend for fit in fits.values()):
        wrong = [str(n) for n, fit in fits.items() if is_contradicted(fit)]
        not_so = f"the rows before step {', '.join(wrong)} do not have the slip trend of the fit; "
        return not_so * bool(wrong) + f"find out which effect the model of {which} lacks"
    return (
        f"fit again with a slip trend or a second state ({option('states', '2')}): {which} may"
        " mistake either for evolution. The rows before a step show whether a slip trend is right"
    )


def parameter_cells(fit: Fit) -> tuple[str, str, str, str]:
    """Return A-B, A, B and L [um] with errors, for several states in turn; a dash if undetermined,
    blank if the fit did not converge."""
    if not fit.converged:
        return ("", "", "", "")
    p = fit.parameters
    numbers = [n[1:] for n in p if n[0] == "B"]
    B, L = (", ".join(estimate_cell(p[x + n]) for n in numbers) for x in "BL")
    return estimate_cell(fit.A_minus_B), estimate_cell(p["A"]), B, L


def estimate_cell(estimate: Estimate, scale: float = 1.0) -> str:
    """Format a parameter times `scale`, or a length in um, with its error; a dash: undetermined."""
    scale = 1e6 if estimate.unit == "m" else scale
    return measured(scale * estimate.value, scale * estimate.std) if estimate.determined else "-"


HEAD = (
    *("step", "time [s]", "V [um/s]", "normal stress [MPa]"),
    *("A-B (a-b)", "A (a)", "B (b)", "L (D_c) [um]", "misfit"),
)
"""Column headers of `text_cells`."""


def text_cells(step: StepFit) -> tuple[str, ...]:
    """Return a step in the columns of `HEAD`; without a fit the column A-B gives the reason."""
    event, fit = step.event, step.fit
    change = f"{1e6 * event.before:.3g} -> {1e6 * event.after:.3g}"
    when = (str(step.number), f"{event.time:.6g}", change, stress_cell(step))
    if fit is None or not fit.converged:
        return (*when, step.failed or f"did not converge: {fit.result if fit else ''}", *[""] * 4)
    return (*when, *parameter_cells(fit), f"{excess(fit):.2g}{'*' if misses(step) else ' '}")


def stress_cell(step: StepFit) -> str:
    """Format the normal stress of a step [MPa]; blank if not known."""
    stress = step.event.normal_stress
    return "" if stress is None else f"{stress / 1e6:.4g}"
