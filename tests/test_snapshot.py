"""A snapshot differs, is missing, or is made anew."""

import pytest
from snapshots import compared, together


def test_a_text_that_differs_or_was_never_kept_fails(tmp_path):
    with pytest.raises(AssertionError, match="--update-snapshots"):
        compared("a", "one\n", tmp_path, anew=False)
    assert not list(tmp_path.iterdir())
    compared("a", "one\n", tmp_path, anew=True)
    compared("a", "one\n", tmp_path, anew=False)
    with pytest.raises(AssertionError, match=r"(?s)a\.txt.*-one.*\+two"):
        compared("a", "two\n", tmp_path, anew=False)
    compared("a", "two\n", tmp_path, anew=True)
    assert (tmp_path / "a.txt").read_text(encoding="utf-8") == "two\n"


def test_every_case_stands_under_its_name():
    assert together({"a": "one  \ntwo", "b": ""}) == "## a\none\ntwo\n## b\n"
