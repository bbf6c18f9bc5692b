"""`jaxfric report`: one page over several results."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from ..errors import InputError
from . import options
from .call import current_call
from .common import doing, told, warn
from .folder import choose_folder, json_text


def report(
    folder: Annotated[Path, Parameter(help="A folder below which verbs wrote their results.")],
    /,
    *,
    output: options.OutputOptions = options.OutputOptions(),
) -> int:
    """Put all results below a folder on one page: what each is, its numbers, warnings, figures.

    Fits, comparisons of laws, runs, loops, gains, predictions, plans and studies are found by what
    their files say. Writes report.html, by default into the folder itself.
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: there is no such folder; name one with results below it")
    doing(f"looking for results below {folder}")
    from ..report.folder_html import page
    from ..report.found import find_results

    results, damaged = find_results(folder)
    if not results:
        why = f"; {damaged[0]}" if damaged else ""
        raise InputError(
            f"{folder}: no results below it (fit.json, run.json, loop.json, gains.json and others)"
            f"{why}; make one, as with jaxfric fit RECORD --stiffness 1.6e-3/um"
        )
    target = choose_folder(output.folder or folder, "")
    with told() as progress:
        progress(f"a page of {len(results)} results")
        text = page(folder, results, damaged, target.path, current_call().command)
        with target.results() as to:
            (to / "report.html").write_text(text, encoding="utf-8", errors="replace")
    if output.json:
        content = [
            {"file": str(one.file), "what": one.what, "sentence": one.sentence}
            | {"warnings": list(one.warnings), "numbers": [list(row) for row in one.numbers.rows]}
            for one in results
        ]
        print(json_text({"schema": "jaxfric.report/1", "results": content}))
    else:
        for one in results:
            print(f"{one.file}: {one.what}{one.mark}")
        print(f"written: {target.path / 'report.html'} (open it in a browser)")
    warn(damaged)
    return target.close()
