"""Public measured records in tests: skipped, with a message, where they are not to be had."""

from pathlib import Path

import pytest

from jaxfric.records.public import data_folder, public_path


def public_record(name: str) -> Path:
    """Path of a public record on this machine; skips the test where there is none."""
    if data_folder() is None:
        pytest.skip(f"{name}: no public records here (JAXFRIC_DATA or ../shared/data)")
    return public_path(name)
