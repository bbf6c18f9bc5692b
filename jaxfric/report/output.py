"""Writing results so that nothing is ever half-written.

Files are written into a hidden folder beside their destination and renamed into it when all
of them are complete; a failure on the way leaves the destination as it was.
"""

import contextlib
import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

from ..errors import InputError


@contextlib.contextmanager
def output_folder(destination: str | Path) -> Iterator[Path]:
    """A temporary folder whose files are moved into `destination` if the block succeeds.

    Files of the same name are replaced, others stay. Raises `InputError` where the destination
    is a file or cannot be written.
    """
    target = Path(destination)
    if target.exists() and not target.is_dir():
        raise InputError(f"output folder {target} is a file; give another with --out")
    made = _make(target)
    work: Path | None = None
    try:
        work = Path(tempfile.mkdtemp(prefix=".jaxfric-", dir=target))
        yield work
        for file in sorted(work.iterdir()):
            os.replace(file, target / file.name)
        made = []
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise InputError(
            f"cannot write to output folder {target}: {reason}; give another with --out"
        ) from None
    finally:
        if work is not None:
            shutil.rmtree(work, ignore_errors=True)
        for folder in made:
            with contextlib.suppress(OSError):
                folder.rmdir()


def _make(target: Path) -> list[Path]:
    """Create the folder and its parents; those that were made, innermost first."""
    missing = [p for p in (target, *target.parents) if not p.exists()]
    try:
        target.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise InputError(
            f"cannot make output folder {target}: {reason}; give another with --out"
        ) from None
    return missing
