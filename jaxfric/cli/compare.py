"""`jaxfric fit --compare`: which friction law does a record support?"""

from ..errors import InputError
from . import options
from .call import current_call
from .common import doing, effect_ids, prepare_jax, told
from .fits import Fitter
from .folder import choose_folder, json_text
from .plan_line import loop_line
from .shown import finish


def compare_record(fitter: Fitter, laws: list[str] | None, output: options.OutputOptions) -> int:
    """Compare laws on the first record; write and print the comparison; return the exit code."""
    file, stiffness, model = fitter.files[0], fitter.stiffnesses[0], fitter.model
    if model.fit_stiffness == (stiffness is not None):
        raise InputError(
            "give one of --stiffness 1.6e-3/um, that of machine and specimen, and --fit-stiffness"
        )
    doing(f"reading {file.name}")
    measured = fitter.read(file)
    prepare_jax()
    from ..loop.compare import compare_laws
    from ..plot.compared import comparison_figure
    from ..report.comparison import files_of
    from ..views import report

    folder = choose_folder(output.folder, file.stem, file)
    with told() as progress:
        found = compare_laws(
            measured,
            stiffness=stiffness,
            laws=effect_ids(laws, "--law") or None,
            slip_trend=model.slip_trend,
            steps=fitter.steps,
            rows=fitter.how.downsample_to,
            progress=progress,
        )
        content = json_text(found.to_json())
        folder.save(files_of(found) | {"compare.json": content + "\n"})
        progress("drawing the figure")
        folder.draw_figure("compare", lambda: comparison_figure(found))
    told_of = report(found)
    if told_of.next_steps:
        line = loop_line(current_call(), found.of_laws[0].fit.law)
        told_of = told_of._replace(next_steps=[told_of.next_steps[0]._replace(command=line)])
    return finish(told_of, folder, content, output)
