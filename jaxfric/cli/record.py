"""`jaxfric record`: what is understood of a record."""

from pathlib import Path

from .common import Columns, DropBad, File, Out, Steps, read_record


def record(
    file: File,
    /,
    *,
    column: Columns = None,
    drop_bad: DropBad = False,
    steps: Steps = None,
    out: Out = None,
) -> None:
    """Show what is understood of a record: columns, units, sampling, velocity steps; and draw it.

    The figure goes to the output folder, by default ./NAME-record/.
    """
    from ..plot.record import draw_record
    from ..records import VelocitySteps, record_steps
    from ..report.output import output_folder
    from ..report.record_text import describe

    measured = read_record(file, column, drop_bad)
    found = record_steps(measured) if steps is None else VelocitySteps.parse(steps)
    found.refuse_end(measured.relative_time[-1])
    destination = out or Path(f"{file.stem}-record")
    with output_folder(destination) as folder:
        draw_record(measured, found, folder / "record.png")
    for line in describe(measured, found):
        print(line)
    print(f"figure: {destination / 'record.png'}")
