"""Outputs appear whole or not at all."""

import os
from pathlib import Path

import pytest

from jaxfric.errors import InputError
from jaxfric.report.output import output_folder


def contents(folder: Path) -> dict[str, str]:
    return {path.name: path.read_text() for path in sorted(folder.iterdir())}


def test_files_are_moved_when_all_are_complete(tmp_path: Path) -> None:
    target = tmp_path / "deep" / "er"
    with output_folder(target) as folder:
        (folder / "a").write_text("one")
        (folder / "b").write_text("two")
        assert not (target / "a").exists()
    assert contents(target) == {"a": "one", "b": "two"}


def test_files_are_replaced_and_others_stay(tmp_path: Path) -> None:
    (tmp_path / "a").write_text("old")
    (tmp_path / "mine").write_text("kept")
    with output_folder(tmp_path) as folder:
        (folder / "a").write_text("new")
    assert contents(tmp_path) == {"a": "new", "mine": "kept"}


@pytest.mark.parametrize("kind", [ValueError, KeyboardInterrupt, SystemExit])
def test_a_failure_leaves_all_as_it_was(tmp_path: Path, kind: type[BaseException]) -> None:
    (tmp_path / "a").write_text("old")
    for target in (tmp_path, tmp_path / "deep" / "er"):
        with pytest.raises(kind), output_folder(target) as folder:
            (folder / "a").write_text("half")
            raise kind
    assert contents(tmp_path) == {"a": "old"}


def test_a_folder_that_stays_empty_is_taken_away(tmp_path: Path) -> None:
    with output_folder(tmp_path / "deep" / "er"):
        pass
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "mine").mkdir()
    with output_folder(tmp_path / "mine"):
        pass
    assert (tmp_path / "mine").is_dir()


@pytest.mark.parametrize("name", ["file", "file/below", "n" * 300, "nu\0ll", "/dev/null"])
def test_folders_refused(tmp_path: Path, name: str) -> None:
    (tmp_path / "file").write_text("mine")
    with pytest.raises(InputError, match=r"output folder .*out"), output_folder(tmp_path / name):
        raise AssertionError("not reached")
    assert contents(tmp_path) == {"file": "mine"}


@pytest.mark.skipif(os.geteuid() == 0, reason="permissions do not bind root")
def test_a_folder_without_permission(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(InputError, match="Permission denied"), output_folder(tmp_path / "new"):
        raise AssertionError("not reached")
    tmp_path.chmod(0o700)


def test_a_folder_where_a_file_is_to_go(tmp_path: Path) -> None:
    (tmp_path / "b").mkdir()
    with pytest.raises(InputError, match="b is a folder"), output_folder(tmp_path) as folder:
        (folder / "a").write_text("one")
        (folder / "b").write_text("two")
    assert [path.name for path in tmp_path.iterdir()] == ["b"]


@pytest.mark.parametrize("call", ["replace", "mkdir"])
def test_a_disk_that_fails(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, call: str) -> None:
    def fail(*arguments, **options):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, call, fail)
    with (
        pytest.raises(InputError, match=r"No space left on device.*out"),
        output_folder(tmp_path) as folder,
    ):
        (folder / "a").write_text("one")
    assert list(tmp_path.iterdir()) == []


def test_writing_that_fails(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot write"), output_folder(tmp_path / "x"):
        raise OSError(28, "No space left on device")
    assert list(tmp_path.iterdir()) == []
