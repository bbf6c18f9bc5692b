"""Names of verbs and options of earlier versions still work, each with a note."""

import pytest
from command import assert_refused, run

from jaxfric.cli.app import app
from jaxfric.cli.renamed import OPTIONS, VALUES, VERBS, in_new_words


@pytest.mark.parametrize(
    ("old", "new", "note"),
    [
        ("record a.csv --rig axis", "inspect a.csv --rig axis", "'jaxfric inspect'"),
        ("steady runs/ --flip", "axis runs/ --flip-sign", "'--flip' is now '--flip-sign'"),
        (
            "compare a.csv --rows 90",
            "fit a.csv --downsample-to 90 --compare",
            "fit --compare'; '--",
        ),
        ("loop a.csv --with=gain --most 2", "loop a.csv --include=gain --max-effects 2", "--most"),
        (
            "axis a.csv --held --without cubic",
            "axis a.csv --zero-order-hold --exclude cubic",
            "hold",
        ),
        ("fit a.csv --weighting whitened", "fit a.csv --weighting gls", "'--weighting gls'"),
        ("fit a.csv --weighting=ordinary", "fit a.csv --weighting=ols", "'--weighting ols'"),
        ("predict m.json a.csv --free f0", "predict m.json a.csv --refit f0", "--refit"),
        (
            "protocol 1um/s --rows 9 --tell a,b",
            "protocol 1um/s --rows 9 --distinguish a,b",
            "--tell",
        ),
        (
            "feedforward m.json --fade 1mm/s",
            "feedforward m.json --fade-speed 1mm/s",
            "--fade-speed",
        ),
        ("fit whitened --law ageing", "fit whitened --law ageing", ""),
        ("--help", "--help", ""),
        ("", "", ""),
    ],
)
def test_the_names_of_earlier_versions(old: str, new: str, note: str) -> None:
    words, notes = in_new_words(old.split())
    assert words == new.split()
    assert [note in one for one in notes] == [True] * bool(note)


def test_every_new_name_is_there_and_no_old_one() -> None:
    names = {
        verb: {name for one in app[verb].assemble_argument_collection() for name in one.names}
        for verb in app
        if not verb.startswith("-")
    }
    every = set().union(*names.values())
    assert set(OPTIONS.values()) | set(VALUES) | {"--compare"} <= every
    assert (every - names["protocol"]).isdisjoint(OPTIONS)
    assert names["protocol"] & set(OPTIONS) == {"--rows"}
    assert not set(VERBS) & set(names) and {words[0] for words in VERBS.values()} <= set(names)


def test_a_note_is_one_line() -> None:
    outcome = run("record", "nowhere.csv", "--rows", "9")
    note, error = outcome.err.splitlines()
    renamed = "'jaxfric record' is now 'jaxfric inspect'; '--rows' is now '--downsample-to'"
    assert note == f"jaxfric: note: {renamed}"
    assert outcome.code == 2 and "--downsample-to" in error
    assert_refused(run("report", "."), "'jaxfric report' is no verb any more")
