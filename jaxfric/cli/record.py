"""`jaxfric record`: what is understood of a record."""

from .common import Columns, DropBad, File, Out, Steps, read_record
from .folder import choose_folder


def record(
    file: File,
    /,
    *,
    column: Columns = None,
    drop_bad: DropBad = False,
    steps: Steps = None,
    out: Out = None,
) -> int:
    """Show what is understood of a record: columns, units, sampling, velocity steps; and draw it.

    The figure goes to the output folder, by default ./NAME-record/.
    """
    from ..plot.record import draw_record
    from ..records import VelocitySteps, record_steps
    from ..report.record_text import describe

    measured = read_record(file, column, drop_bad)
    found = record_steps(measured) if steps is None else VelocitySteps.parse(steps)
    found.refuse_end(measured.relative_time[-1])
    folder = choose_folder(out, file.stem, file)
    with folder.results():
        pass  # what is understood is told; only the figure is written
    folder.draw("the figure", lambda to: draw_record(measured, found, to / "record.png"))
    for line in describe(measured, found):
        print(line)
    if folder.files:
        print(f"figure: {folder.path / 'record.png'}")
    return folder.close()
