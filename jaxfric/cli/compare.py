"""`jaxfric compare`: which friction law does a record support?"""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from ..errors import InputError
from . import options
from .call import current_call
from .common import doing, effect_ids, prepare_jax, read_record, told
from .folder import choose_folder, json_text
from .plan_line import loop_line
from .shown import Showing, show

if TYPE_CHECKING:
    from ..report.fits_table import TabledFit


def compare(
    file: options.File,
    /,
    *,
    stiffness: Annotated[
        str | None,
        Parameter(
            allow_leading_hyphen=True,
            help="Stiffness with unit: 1.6e-3/um, or 2e6 N/m for a force.",
        ),
    ] = None,
    law: Annotated[
        list[str] | None,
        Parameter(negative=(), help="Laws to compare, 'slip,ageing'; by default all."),
    ] = None,
    fit_stiffness: Annotated[
        bool,
        Parameter(negative=(), help="Let every law find the stiffness instead."),
    ] = False,
    slip_trend: Annotated[
        bool, Parameter(negative=(), help="Fit a linear change of friction with slip as well.")
    ] = False,
    steps: options.Steps = None,
    rows: Annotated[
        int | None,
        Parameter(help="Fit means over neighbouring rows, about so many: quicker by as much."),
    ] = None,
    reduce: options.Reduce = None,
    column: options.Columns = None,
    drop_bad: options.DropBad = False,
    since: options.Since = None,
    until: options.Until = None,
    out: options.Out = None,
    details: options.Details = False,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> int:
    """Compare friction laws on one record: slip and ageing, with one state and with two.

    Each is fitted to the record of velocity steps; with three steps or more each is also fitted
    without some of them, which it then predicts. Says which law the record supports, and by how
    much, or that it cannot tell. Writes compare.json, compare.csv, compare.tex, compare.png and
    compare.svg to the output folder, by default ./NAME-compare/ with the options that differ from
    their default.
    """
    if fit_stiffness == (stiffness is not None):
        raise InputError(
            "give one of --stiffness 1.6e-3/um, that of machine and specimen, and --fit-stiffness"
        )
    doing(f"reading {file.name}")
    measured = read_record(file, column, drop_bad, since, until, reduce=reduce)
    prepare_jax()
    from ..loop.compare import compare_laws
    from ..plot.compared import draw_comparison
    from ..report.comparison import tabled

    folder = choose_folder(out, file.stem, file)
    with told() as progress:
        found = compare_laws(
            measured,
            stiffness=stiffness,
            laws=effect_ids(law, "--law") or None,
            slip_trend=slip_trend,
            steps=steps,
            rows=rows,
            progress=progress,
        )
        content, fits = json_text(found.to_json()), tabled(found)
        with folder.results() as to:
            (to / "compare.json").write_text(content + "\n", encoding="utf-8")
            _write(fits, to)
        progress("drawing the figure")
        names = ("compare.png", "compare.svg")
        folder.draw("the figure", lambda to: draw_comparison(found, *(to / n for n in names)))
    from ..views import report

    onwards = []
    if found.next_step:
        line = loop_line(current_call(), found.of_laws[0].fit.law)
        onwards = [f"next: {found.next_step} {line}".rstrip()]
    told_of = report(found)._replace(notes=())
    show(told_of, folder.written, content, Showing(json, details), next_steps=onwards)
    return folder.close()


def _write(fits: "list[TabledFit]", to: Path) -> None:
    from ..report.fits_table import csv_rows, latex_text
    from ..runs.table import csv_text

    (to / "compare.csv").write_text(csv_text(csv_rows(fits, "model")), encoding="utf-8")
    (to / "compare.tex").write_text(latex_text(fits, "law"), encoding="utf-8")
