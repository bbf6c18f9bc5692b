"""`jaxfric fit` of several files: one table with a row for each file, also if a fit fails."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, TypeVar

import jaxfric

from ..errors import InputError
from . import options
from .common import warn
from .folder import choose_folder, json_text
from .options import OutputOptions
from .told import doing

_MANY = 16
"""Number of files from which compiling a batched fit saves time."""
_WEIGHTINGS = {"ols": "ordinary", "gls": "whitened"}
"""Names of the choices of --weighting in Python and in files."""
_Value = TypeVar("_Value")


@options.FLAT
@dataclass(frozen=True)
class FitOptions(options.ModelOptions):
    """The model, and how it is fitted."""

    compare: bool = False
    """Compare friction laws: slip and ageing, with one and with two states. Choose others with
    --law 'slip,ageing'."""
    steps: options.Steps = None
    reference_velocity: Annotated[options.Text, options.MORE] = None
    """Reference velocity with unit, at which steady-state friction is f0."""
    start: Annotated[str | None, options.MORE] = None
    """Starting values, 'A=0.01, B=0.012, L=20 um'. Rarely needed."""
    weighting: Annotated[Literal["ols", "gls"], options.MORE] = "ols"
    """Ordinary least squares (ols), or generalised (gls): whitened by the noise model."""
    profile: Annotated[bool, options.MORE] = False
    """Intervals from the profile likelihood (slower)."""
    downsample_to: options.DownsampleTo = None

    def of_any(self) -> dict[str, Any]:
        """Return the options that a fit of one record and a fit of many records have."""
        given = {"steps": self.steps, "reference_velocity": self.reference_velocity}
        return self.model() | given

    @property
    def of_one(self) -> bool:
        """Whether the call has an option that the batched fit of many records does not support."""
        alone = (self.start, self.weighting, self.profile, self.downsample_to)
        return alone != (None, "ols", False, None)


class Fitter(NamedTuple):
    """Settings to read and fit several records, with a stiffness, mass and law for each file."""

    files: Sequence[Path]
    read: "Callable[[Path], jaxfric.Record]"
    stiffnesses: Sequence[str | None]
    masses: Sequence[str | None]
    laws: Sequence[str]
    how: FitOptions

    def one(
        self, number: int, record: "jaxfric.Record", say: Callable[[str], None]
    ) -> "jaxfric.Fit":
        """Fit the record of file `number`."""
        from ..fitting.typed import typed_parameters

        how = self.how
        return jaxfric.fit(
            record,
            stiffness=self.stiffnesses[number],
            mass=self.masses[number],
            law=self.laws[number],
            **how.of_any(),
            start=None if how.start is None else typed_parameters(how.start, record.friction_unit),
            weighting=_WEIGHTINGS[how.weighting],
            profile=how.profile,
            downsample_to=how.downsample_to,
            progress=say,
        )

    def together(self, records: "dict[int, jaxfric.Record]") -> "dict[int, jaxfric.Fit | str]":
        """Fit the records, by number of file, in one batch; for a failed fit return the reason."""
        from ..fitting.many import fit_what_can_be

        fits = fit_what_can_be(
            list(records.values()),
            [self.stiffnesses[k] for k in records],
            [self.masses[k] for k in records],
            [self.laws[k] for k in records],
            **self.how.of_any(),
            progress=doing,
        )
        return dict(zip(records, fits, strict=True))


def for_each(files: Sequence[Path], values: Sequence[_Value], option: str) -> Sequence[_Value]:
    """Return the value of an option for every file; a single value holds for all files."""
    if len(values) == 1:
        return [values[0]] * len(files)
    if len(values) == len(files):
        return values
    count = f"{len(files)} files" if len(files) > 1 else "one file"
    raise InputError(
        f"{option} has {len(values)} values ({', '.join(map(str, values))}) for {count}; give it"
        " once, or once for each file in their order"
    )


def fit_files(fitter: Fitter, output: OutputOptions) -> int:
    """Fit every file, write and print the table; return the exit code (1: a fit failed).

    `_MANY` or more files are fitted in one batch, if all options allow a batch.

    Raises `InputError` before any fit if a file does not exist. Raises `InputError` without writing
    anything if no file can be fitted.
    """
    from ..report.fits_table import TabledFit, content_of_files, files_of, report_of_files

    files = fitter.files
    for file in files:
        if not file.exists():
            raise InputError(f"{file}: there is no such file; none was fitted")

    folder = choose_folder(output, f"{files[0].stem}-and-{len(files) - 1}-more", *files)
    many = len(files) >= _MANY and not fitter.how.of_one
    ends: dict[int, jaxfric.Fit | str] = {}
    read: dict[int, jaxfric.Record] = {}
    for number, file in enumerate(files):
        of = f"file {number + 1} of {len(files)}, {file.name}"
        try:
            record = fitter.read(file)
            if many:
                read[number] = record
            else:
                say = lambda text, of=of: doing(f"{of}: {text}")  # noqa: E731
                ends[number] = fitter.one(number, record, say)
        except InputError as error:
            ends[number] = str(error)
    if read:
        ends |= fitter.together(read)
    found = [
        TabledFit(str(file), None, end) if isinstance(end, str) else TabledFit(str(file), end)
        for file, end in ((file, ends[number]) for number, file in enumerate(files))
    ]
    if all(one.fit is None for one in found):
        raise InputError(f"none of {len(files)} files can be fitted: {found[0].failed}")
    named = zip(_names(files), found, strict=True)
    fits = [(name, one.fit) for name, one in named if one.fit is not None]
    texts = {f"{name}.json": json_text(fit.to_json()) + "\n" for name, fit in fits}
    folder.save_json("fits.json", content_of_files(found), files_of(found) | texts)
    for name, fit in fits:
        folder.draw_figure(f"the figure of {name}", fit.plot, f"{name}.png")
    code = folder.finish(report_of_files(found))
    failed = [one for one in found if not one.known]
    names = ("" if one.result.startswith(one.name) else f"{one.name}: " for one in failed)
    warn((name + one.result for name, one in zip(names, failed, strict=True)), "error")
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
