"""Write result files so that no file is ever half-written.

Files are written to a hidden folder inside the destination, and renamed when all of them are
complete. A failure before the renaming leaves the destination folder unchanged.
"""

import contextlib
import os
import shutil
import tempfile
from collections.abc import Generator
from pathlib import Path

from ..errors import InputError, option


@contextlib.contextmanager
def output_folder(destination: str | Path) -> Generator[Path]:
    """A temporary folder whose files are moved into `destination` if the block succeeds.

    Files of the same name are replaced; all other files stay. A new destination folder is removed
    if it stays empty. Raises `InputError` if the destination is a file or cannot be written.
    """
    target = Path(destination)
    made = _make(target)
    work: Path | None = None
    try:
        work = Path(tempfile.mkdtemp(prefix=".jaxfric-", dir=target))
        yield work
        _move(work, target)
    except OSError as error:
        raise _refusal(target, error) from None
    finally:
        if work is not None:
            shutil.rmtree(work, ignore_errors=True)
        for folder in made:
            with contextlib.suppress(OSError):
                folder.rmdir()  # fails if the folder holds files


def _make(target: Path) -> list[Path]:
    """Create the folder and its parents; those that were made, innermost first."""
    try:
        missing = [p for p in (target, *target.parents) if not p.exists()]
        target.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        raise InputError(
            f"output folder {target} is a file; give another with {option('out')}"
        ) from None
    except (OSError, ValueError) as error:
        raise _refusal(target, error) from None
    return missing


def _move(work: Path, target: Path) -> None:
    """Rename all files of `work` into `target`, or none where a folder has the name of one."""
    files = sorted(work.iterdir())
    for file in files:
        if (target / file.name).is_dir():
            raise InputError(f"{target / file.name} is a folder, where a file is to be written")
    for file in files:
        os.replace(file, target / file.name)


def _refusal(target: Path, error: Exception) -> InputError:
    reason = getattr(error, "strerror", None) or str(error)
    return InputError(
        f"cannot write to output folder {target}: {reason}; give another with {option('out')}"
    )
