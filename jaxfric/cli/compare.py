"""`jaxfric fit --compare`: which friction law does a record support?"""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import InputError
from . import options
from .call import current_call
from .common import doing, effect_ids, prepare_jax, told
from .folder import choose_folder, json_text
from .plan_line import loop_line
from .shown import show

if TYPE_CHECKING:
    from ..records import Record
    from ..report.fits_table import TabledFit


def compare_record(
    file: Path,
    read: "Callable[[Path], Record]",
    stiffness: str | None,
    laws: list[str] | None,
    model: options.ModelOptions,
    steps: str | None,
    rows: int | None,
    output: options.OutputOptions,
) -> int:
    """Compare laws on a record, write and print the comparison, and return the exit code."""
    if model.fit_stiffness == (stiffness is not None):
        raise InputError(
            "give one of --stiffness 1.6e-3/um, that of machine and specimen, and --fit-stiffness"
        )
    doing(f"reading {file.name}")
    measured = read(file)
    prepare_jax()
    from ..loop.compare import compare_laws
    from ..plot.compared import draw_comparison
    from ..report.comparison import tabled

    folder = choose_folder(output.folder, file.stem, file)
    with told() as progress:
        found = compare_laws(
            measured,
            stiffness=stiffness,
            laws=effect_ids(laws, "--law") or None,
            slip_trend=model.slip_trend,
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
    show(told_of, folder.written, content, output, next_steps=onwards)
    return folder.close()


def _write(fits: "list[TabledFit]", to: Path) -> None:
    from ..report.fits_table import csv_rows, latex_text
    from ..runs.table import csv_text

    (to / "compare.csv").write_text(csv_text(csv_rows(fits, "model")), encoding="utf-8")
    (to / "compare.tex").write_text(latex_text(fits, "law"), encoding="utf-8")
