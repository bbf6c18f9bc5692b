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
    """Compare laws on a record, write and print the comparison; return the exit code."""
    if model.fit_stiffness == (stiffness is not None):
        raise InputError(
            "give one of --stiffness 1.6e-3/um, that of machine and specimen, and --fit-stiffness"
        )
    doing(f"reading {file.name}")
    measured = read(file)
    prepare_jax()
    from ..loop.compare import compare_laws
    from ..plot.compared import draw_comparison
    from ..report.comparison import files_of

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
        content = json_text(found.to_json())
        folder.save(files_of(found) | {"compare.json": content + "\n"})
        progress("drawing the figure")
        names = ("compare.png", "compare.svg")
        folder.draw("the figure", lambda to: draw_comparison(found, *(to / n for n in names)))
    from ..report.report import NextStep
    from ..views import report

    told_of = report(found)
    if told_of.next_steps:
        line = loop_line(current_call(), found.of_laws[0].fit.law)
        told_of = told_of._replace(next_steps=[NextStep(found.next_step, line)])
    show(told_of, folder.written, content, output)
    return folder.close()
