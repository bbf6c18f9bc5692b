"""`jaxfric fit` of several files: one table with a row for each; a failed file stops no other."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from ..errors import InputError
from .common import told, warn
from .folder import choose_folder, json_text
from .options import OutputOptions
from .shown import show

if TYPE_CHECKING:
    from ..fitting import Fit
    from ..records import Record
_MANY = 16
"""Number of files from which compiling a batched fit saves time."""
Said = Callable[[str], None]
Fitting = Callable[[int, "Record", Said], "Fit"]
"""Fits the record of a file, given its number (from 0) and a progress callback."""
Together = Callable[[list[int], list["Record"], Said], "list[Fit | str]"]
"""Fits many files in one batch; a failed one returns its reason in place of a fit."""
_Value = TypeVar("_Value")


def for_each(files: Sequence[Path], values: Sequence[_Value], option: str) -> Sequence[_Value]:
    """Return the value of an option for every file; a single value holds for all files."""
    if len(values) == 1:
        return [values[0]] * len(files)
    if len(values) == len(files):
        return values
    count = f"{len(files)} files" if len(files) > 1 else "one file"
    each = ", or once for each in their order" if len(files) > 1 else ""
    raise InputError(
        f"{option} has {len(values)} values ({', '.join(map(str, values))}) for {count}; give it"
        f" once{' for all' if each else ''}{each}"
    )


def fit_files(
    files: Sequence[Path],
    output: OutputOptions,
    reading: "Callable[[Path], Record]",
    fitting: Fitting,
    together: Together | None,
) -> int:
    """Fit every file, write and print the table; return the exit code, 1 if a file failed.

    `_MANY` or more files are fitted in one batch by `together`, unless `together` is None.

    Raises `InputError` before any fit if a file does not exist. Raises `InputError` without writing
    anything if no file can be fitted.
    """
    from ..report.fits_table import TabledFit, content_of_files, files_of, report_of_files

    for file in files:
        if not file.exists():
            raise InputError(f"{file}: there is no such file; none was fitted")

    source = f"{files[0].stem}-and-{len(files) - 1}-more"
    folder = choose_folder(output.folder, source, *files)
    with told() as progress:
        ends: dict[int, Fit | str] = {}
        read: dict[int, Record] = {}
        many = together is not None and len(files) >= _MANY
        for number, file in enumerate(files):
            of = f"file {number + 1} of {len(files)}, {file.name}"
            progress(f"{of}: reading")
            try:
                record = reading(file)
                if many:
                    read[number] = record
                else:
                    ends[number] = fitting(
                        number, record, lambda text, of=of: progress(f"{of}: {text}")
                    )
            except InputError as error:
                ends[number] = str(error)
        if together is not None and read:
            fits = together(list(read), list(read.values()), progress)
            ends |= dict(zip(read, fits, strict=True))
        found = [
            TabledFit(str(file), None, end) if isinstance(end, str) else TabledFit(str(file), end)
            for file, end in ((file, ends[number]) for number, file in enumerate(files))
        ]
        if all(one.fit is None for one in found):
            raise InputError(f"none of {len(files)} files can be fitted: {found[0].failed}")
        names = _names(files)
        content = json_text(content_of_files(found))
        from ..plot.fit import draw_fit

        named = zip(names, found, strict=True)
        fits = [(name, one.fit) for name, one in named if one.fit is not None]
        texts = {f"{name}.json": json_text(fit.to_json()) + "\n" for name, fit in fits}
        folder.save(files_of(found) | {"fits.json": content + "\n"} | texts)
        for name, fit in fits:
            progress(f"drawing {name}")
            draw = lambda to, fit=fit, name=name: draw_fit(fit, to / f"{name}.png")  # noqa: E731
            folder.draw(f"the figure of {name}", draw)
    show(report_of_files(found), folder.written, content, output)
    failed = [one for one in found if not one.known]
    code = folder.close()
    told_of = (
        one.result if one.result.startswith(one.name) else f"{one.name}: {one.result}"
        for one in failed
    )
    warn(told_of, "error")
    return 1 if failed else code


def _names(files: Sequence[Path]) -> list[str]:
    """Return a name for the results of each file; equal file names get a number."""
    names: list[str] = []
    for file in files:
        name, k = file.stem, 2
        while name in (*names, "table", "fits"):
            name, k = f"{file.stem}_{k}", k + 1
        names.append(name)
    return names
