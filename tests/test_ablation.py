"""The study of what each piece of the loop is worth: its patches, its score, its memory."""

import json

import pytest

from fits.ablation.memory import Memory
from fits.ablation.pieces import PIECES
from fits.ablation.table import level, published


@pytest.mark.parametrize("name", PIECES)
def test_a_piece_is_taken_out_and_put_back(name):
    """What a patch replaces is there; afterwards it is what it was."""
    patches = PIECES[name].patches()
    before = [getattr(where, what) for where, what, _ in patches]
    with PIECES[name].taken_out():
        assert all(getattr(where, what) is other for where, what, other in patches)
        assert any(one is not other for one, (_, _, other) in zip(before, patches, strict=True))
    assert all(
        getattr(where, what) is was for (where, what, _), was in zip(patches, before, strict=True)
    )


def test_what_is_kept_is_put_back():
    from jaxfric.loop import search

    refit = search.refit
    with Memory().kept():
        assert search.refit is not refit
    assert search.refit is refit


def row(kind="one", verdict="effects", *, group=True, exact=True, error=None):
    confirmed = verdict in ("effects", "ambiguous")
    covered, found = {"A": True, "B": group, "L": True}, ["a"] if confirmed else []
    return {
        "kind": kind, "group": group, "exact": exact, "confirmed": confirmed, "error": error,
        "verdict": verdict, "found": found, "covered": covered, "seconds": 3.0, "fits": 1,
    }  # fmt: skip


@pytest.mark.parametrize(
    ("found", "score"),
    [
        (row(), 4),
        (row(exact=False), 0),  # sure of one that the record does not tell from it
        (row(verdict="ambiguous", exact=False), 3),
        (row(verdict="ambiguous", exact=False, group=False), 1),
        (row(verdict="too_weak"), 2),  # the effect is there, and nothing is named
        (row("none", "no_missing_effect"), 4),
        (row("none"), 0),
        (row("none", "ambiguous"), 1),
        (row("outside", "outside_catalogue"), 4),
        (row("outside"), 0),
        (row(error="boom"), 0),
    ],
)
def test_how_right_a_verdict_is(found, score):
    assert level(found) == score


def test_the_table_counts_pairs_of_one_record(tmp_path):
    """Of three one gets better, one worse, one keeps its level."""
    pairs = [
        (row(exact=False, group=False), row()),
        (row(), row(verdict="too_weak")),
        (row("none", "no_missing_effect"), row("none", "too_weak")),
    ]
    (tmp_path / "found").mkdir()
    for k, (whole, without) in enumerate(pairs):
        content = {"rows": {"whole": whole, "tie by order": without}}
        (tmp_path / "found" / f"{k}.json").write_text(json.dumps(content))
    (line,) = (text for text in published(tmp_path).splitlines() if "tie by order" in text)
    cells = [cell.strip() for cell in line.strip("|").split("|")]
    assert cells[:5] == ["tie by order", "3", "1", "1", "2"]
    assert cells[5:7] == ["100.0 %", "88.9 %"]
