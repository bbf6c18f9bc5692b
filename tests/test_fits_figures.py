"""Numbers quoted in the READMEs of `fits/` are those of the JSON that lies beside them.

A number counts as right if the value, rounded to the digits that are quoted, is it.
"""

import csv
import importlib
import json
import math
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from pages import row_of

FITS = Path(__file__).resolve().parents[1] / "fits"
NUMBER = r"(-?\d*\.?\d+(?:e-?\d+)?)"


def page(name):
    """The text of a README, without bold marks and line breaks within sentences."""
    return (FITS / name / "README.md").read_text(encoding="utf-8").replace("**", "")


def content(path):
    return json.loads((FITS / path).read_text(encoding="utf-8"))


def agrees(quoted, value):
    """Whether the value, rounded to the digits of `quoted`, is it."""
    mantissa, _, power = quoted.partition("e")
    digits = len(mantissa.partition(".")[2])
    return abs(float(quoted) - value) <= 0.5000001 * 10.0 ** (int(power or 0) - digits)


def stale(text, pattern, *values):
    """What of a sentence is not so, in words; the sentence must be there once.

    `pattern` has # for every number and spaces for any space.
    """
    parts = [re.escape(part) for part in pattern.split("#")]
    found = re.findall(NUMBER.join(parts).replace(r"\ ", r"\s+"), text)
    if len(found) != 1:
        return [f"'{pattern}' stands there {len(found)} times"]
    quoted = found[0] if isinstance(found[0], tuple) else found
    assert len(quoted) == len(values)
    pairs = zip(quoted, values, strict=True)
    return [f"'{pattern}': {q}, is {v:.6g}" for q, v in pairs if not agrees(q, v)]


def stale_cell(cell, *values):
    """What of the numbers of a cell is not so; it has as many as there are values."""
    quoted = re.findall(NUMBER, cell)
    assert len(quoted) == len(values), cell
    pairs = zip(quoted, values, strict=True)
    return [f"'{cell}': {q}, is {v:.6g}" for q, v in pairs if not agrees(q, v)]


@pytest.mark.parametrize(
    ("name", "unit"),
    [("p655", "1e-3"), ("basalt_step4", "1e-3"), ("sepiolite_step1", "1e-3"), ("emps", "N")],
)
def test_errors_of_a_loop_before_and_after(name, unit):
    loop, text = content(f"{name}/loop/loop.json"), page(name)
    scale = 1e3 if unit == "1e-3" else 1.0
    sigma = re.search(rf"rms in {unit} \(in sigma = {NUMBER}", text)
    assert sigma and agrees(sigma[1], loop["noise"]["sigma"])
    before, after = loop["before"], loop["after"]
    for block, called in (("train", "train"), ("select", "validation"), ("report", "test")):
        (row,) = re.findall(rf"^\| {called}\b[^|]*\|(.*)\|$", text, re.M)
        known = [
            x
            for fit in (before, after)
            for x in (scale * fit[f"{block}_rms"], fit["in_sigma"][block])
        ]
        assert not stale(row, "# (#) | # (#)", *known)
    assert f"`{loop['verdict']}`" in text
    (head,) = re.findall(r"after: \+ ([\w, ]+) \|", text)
    assert head.split(", ") == loop["effects"]


@pytest.mark.parametrize("name", ["p655", "basalt_step4", "sepiolite_step1", "emps"])
def test_test_errors(name):
    loop = content(f"{name}/loop/loop.json")
    both = [loop[fit]["in_sigma"]["report"] for fit in ("before", "after")]
    assert not stale(page(name), "test error falls from # to # sigma", *both)


@pytest.mark.parametrize("name", ["undeclared_effect", "basalt_step4", "sepiolite_step1", "emps"])
def test_intervals_of_a_loop_hold_their_values(name):
    """Of both models: the one before is that of least squares, where no likelihood has its peak."""
    loop = content(f"{name}/loop/loop.json")
    for fit in (loop["before"], loop["after"]):
        told = [*fit["parameters"].values(), *filter(None, [fit.get("A_minus_B")])]
        for one in told:
            assert one["lower"] is None or one["lower"] < one["value"] < one["upper"], one


def test_records_of_results_lie_beside_the_project():
    """A result holds the path of its record as given: one of the machine that made it is no use."""
    results = {path: json.loads(path.read_text(encoding="utf-8")) for path in FITS.rglob("*.json")}
    records = [one.get("record") for one in results.values() if isinstance(one, dict)]
    paths = [one["path"] for one in records if isinstance(one, dict) and "path" in one]
    assert len(paths) > 5 and not [path for path in paths if Path(path).is_absolute()]


def test_torques_of_screw_drives():
    for name, rows in (
        ("screwdrive1", {"Coulomb and viscous friction, directions apart": "before",
                         "+ stribeck, n = 1": "after"}),
        ("screwdrive2", {"Coulomb and viscous friction, directions apart": "after"}),
    ):  # fmt: skip
        found = content(f"{name}/loop/steady.json")
        for row, fit in rows.items():
            values = [1e3 * found[fit][k] for k in ("rms", "validation_rms")]
            assert not stale(page(name), f"| {row} | # | # |", *values)
    bic = content("screwdrive1/loop/steady.json")["after"]["delta_bic"]
    assert not stale(page("screwdrive1"), "| + stribeck, n = 1 | 0.0329 | 0.052 | # |", -abs(bic))


def test_noise_of_screw_drives():
    for name, order in (("screwdrive1", ("angle", "time")), ("screwdrive2", ("angle", "angle"))):
        found, readme = content(f"{name}/loop/steady.json"), FITS / name / "README.md"
        noise, turn = found["noise"], 2 * math.pi
        one, two = noise["parts"]
        assert (one["over"], two["over"]) == order
        own, model = found["curve"]["effective_samples"], noise["effective_samples"]
        ratio = np.divide(model, own)
        told = [np.median(ratio), ratio.min(), ratio.max()]
        rows = [("variance that repeats one turn later", [100 * noise["after_a_turn"]])]
        if name == "screwdrive1":
            assert one["period"] is None and two["period"] is None
            sizes = [100 * one["share"], one["memory"] / turn]
            sizes += [100 * two["share"], two["memory"]]
            rows += [
                ("independent samples of a run, from its rows", [min(own), max(own)]),
                ("the same, from the noise model", [min(model), max(model)]),
                ("ratio of the two, median and range", told),
            ]
        else:
            sizes = [100 * two["share"], two["period"] / turn]
            sizes += [100 * one["share"], one["memory"] / turn]
            rows += [
                ("independent samples of a run, from the noise model", [min(model), max(model)]),
                ("ratio to those from its rows, median and range", told),
            ]
        for row, values in (*rows, ("noise model", sizes)):
            assert not stale_cell(row_of(readme, row)[0], *values), row


def test_gains_of_an_undeclared_effect():
    """The pair of gains before and after the loop, on its page and on that of the study."""
    found = [content(f"undeclared_effect/gains_{when}/gains.json") for when in ("before", "after")]
    pairs = [[1e-3 * gains["kp"], 1e-3 * gains["kv"]] for gains in found]
    cells = row_of(
        FITS / "undeclared_effect" / "README.md", "gains found: k_p [kN/m], k_v [kN s/m]"
    )
    assert not [
        x for cell, pair in zip(cells, pairs, strict=False) for x in stale_cell(cell, *pair)
    ]
    pattern = "(# kN/m, # kN s/m) lies in the orange there, the one that settles (# kN/m)"
    assert not stale(page("study"), pattern, *pairs[0], pairs[1][0])


def test_which_rows_decide_the_gains():
    found, text = content("which_rows/which_rows.json"), page("which_rows")
    gains, errors, half = (list(found[key].values()) for key in ("gains", "errors", "half"))
    assert not stale(text, "| gain | # 1/m | # s/m |", *gains)
    assert not stale(text, "white noise of the rows | # 1/m | # s/m |", *errors)
    assert not stale(text, "half of its variance | # | # |", *(rows for rows, *_ in half))
    assert not stale(text, "the largest difference is # of", found["against_refits"])


BLIND = FITS / "blind" / "README.md"
STUDIES = ("results.json", "measured_noise/results.json", "measured_draw_2/results.json")
RHOS = (0.2, 0.5, 1.0)


@pytest.mark.parametrize("file", STUDIES)
def test_shares_of_the_blind_study(file):
    """Each column of the table, counted from the records themselves."""
    results = content(f"blind/{file}")
    records, column = results["records"], STUDIES.index(file)
    numbers = {n["what"]: n for n in results["numbers"]}
    none = [r for r in records if r["kind"] == "none"]
    # under generated noise, records of AR(1) noise are a condition of their own
    white = records if column else [r for r in records if not r["correlation"]]
    one = [[r for r in white if r["kind"] == "one" and r["rho"] == rho] for rho in RHOS]
    before = "measured, " if column else ""
    some = before if column else "one effect, rho >= 0.2: "
    error = "measured, one effect: " if column else some
    (out,) = (n for n in numbers.values() if "effect taken out" in n["what"])

    def value(what):
        return numbers[what]["value"]

    assert [sum(r["outcome"] == "failed" for r in records)] == [0]
    for row, values in (
        ("records", [len(records)]),
        ("nothing missing: an effect confirmed", [sum(r["confirmed"] for r in none), len(none)]),
        (
            "nothing missing: `no_missing_effect`",
            [sum(r["verdict"] == "no_missing_effect" for r in none), len(none)],
        ),
        *(
            (f"right group, rho {rho:g}", [sum(r["group"] for r in each), len(each)])
            for rho, each in zip(RHOS, one, strict=True)
        ),
        (
            "of these confirmed, by rho",
            [sum(r["group"] and r["confirmed"] for r in each) for each in one],
        ),
        ("exactly the effect, by rho", [sum(r["exact"] for r in each) for each in one]),
        (
            "a wrong group confirmed, by rho",
            [sum(r["confirmed"] and not r["group"] for r in each) for each in one],
        ),
        (
            "effect taken out of the catalogue: not confirmed",
            [int(n) for n in out["of"].split("/")],
        ),
        (
            "95 % intervals of A, B, L that cover",
            [100 * value(f"{some}95 % intervals of A, B, L cover, extended fits")],
        ),
        (
            "the same, of fits with the right effect",
            [100 * value(f"{some}95 % intervals of A, B, L cover, those of the right effect")],
        ),
        (
            "test error in sigma, median and 90th percentile",
            [
                value(f"{error}held-out rms / true sigma, {q}")
                for q in ("median", "90th percentile")
            ],
        ),
    ):
        assert not stale_cell(row_of(BLIND, row)[column], *values), row


def test_targets_of_the_blind_study():
    results, text = content("blind/results.json"), page("blind")
    numbers = {n["what"]: n for n in results["numbers"]}
    aims = [n for n in numbers.values() if n["reached"] is not None]
    bias = "one effect, rho >= 0.5: bias of {}, after / before"
    for pattern, values in (
        ("reaches # of # targets", [sum(n["reached"] for n in aims), len(aims)]),
        (
            "leaves #, # and # % of the bias of A, B and L",
            [100 * numbers[bias.format(k)]["value"] for k in "ABL"],
        ),
    ):
        assert not stale(text, pattern, *values)
    second = content("blind/measured_draw_2/results.json")["numbers"]
    missed = [n["what"] for n in second if n["reached"] is False]
    assert len(missed) == 2 and "taken out" in missed[0] and "intervals" in missed[1]


def test_what_the_stored_scores_tell_strictly():
    records, text = content("blind/results.json")["records"], page("blind")
    white = [r for r in records if r["kind"] in ("one", "lacking") and not r["correlation"]]
    by_rho = [[r for r in white if r["rho"] == rho] for rho in (0.1, *RHOS)]
    assert [len(some) for some in by_rho] == [20] * 4
    sure = [sum(r["group"] and r["confirmed"] for r in some) for some in by_rho]
    named = [sum(r["exact"] and r["confirmed"] for r in some) for some in by_rho]
    wrong = [sum(r["confirmed"] and not r["group"] for r in some) for some in by_rho]
    covered = [
        [r["covered"][k] for r in some for k in "ABL" if k in r["covered"]] for some in by_rho
    ]
    shares = [100 * sum(marks) / len(marks) for marks in covered]
    (each,) = set(wrong)
    for pattern, values in (
        ("right group confirmed in #, #, # and # of 20 at rho 0.1, 0.2, 0.5 and 1.", sure),
        ("named exactly in #, #, # and #;", named),
        ("a wrong name is confirmed in # of 20 at each rho", [each]),
        ("Intervals of all these fits cover #, #, # and # %", shares),
    ):
        assert not stale(text, pattern, *values)
    assert {r["plant"] for r in records if r["kind"] == "none"} == {"inertial"}
    # scores as they are now say more: with them the study can be counted strictly in full
    assert not any("sure_group" in r or "heldout_report" in r for r in records)


def test_growth_of_times():
    results, text = content("benchmark/growth.json"), page("benchmark")
    million, batch = results["fit of a million rows"], results["seconds"]["batch"][-1]
    for pattern, values in (
        ("A fit grows with its rows to the power #:", [results["exponents"]["rows"]]),
        ("a million rows take # s and # GiB.", [million["seconds"], million["peak_GiB"]]),
        ("Members of a batch take # us each", [1e6 * batch[1] / batch[0]]),
        ("rows to the power # from 2873 rows on", [results["exponents"]["loop rows"]]),
        ("where it takes # s on one thread", [dict(results["seconds"]["loop rows"])[2873]]),
    ):
        assert not stale(text, pattern, *values)
    shown = (FITS.parent / ".ci/docs/pages/benchmarks.md").read_text(encoding="utf-8")
    for pattern, values in (
        ("a fit grows with its rows to the power #,", [results["exponents"]["rows"]]),
        ("a million rows take # s.", [million["seconds"]]),
        ("members of a batch take # us each", [1e6 * batch[1] / batch[0]]),
        ("A loop grows with its rows to the power #.", [results["exponents"]["loop rows"]]),
    ):
        assert not stale(shown, pattern, *values)


def test_the_table_of_a_whole_run():
    """Each number of the README's table is that of table.csv, its error in brackets too."""
    table = list(csv.DictReader((FITS / "p655_run/run/table.csv").open()))
    lines = re.findall(r"^\| (\d) \|(.*)\|$", page("p655_run"), re.M)
    assert [number for number, _ in lines] == [row["step"] for row in table]
    for (_, line), row in zip(lines, table, strict=True):
        cells = [cell.strip() for cell in line.split("|")]
        for cell, name in zip(cells[2:], ("A", "B", "A-B", "L [um]"), strict=True):
            if not row[name]:
                assert cell == "not determined"
                continue
            value, error = re.fullmatch(rf"{NUMBER}\(([\d.]+)\)", cell).groups()
            assert agrees(value, float(row[name]))
            places = len(value.partition(".")[2])
            shown = float(error) if "." in error else float(error) * 10.0**-places
            unit = 10.0**-places if "." not in error else 10.0 ** -len(error.partition(".")[2])
            assert abs(shown - float(row[f"std {name}"])) <= 0.5000001 * unit


RUNS = FITS / "runs" / "README.md"


def test_shares_of_the_runs():
    """Summaries of `fits.runs`; the least that is asked of them stands here too."""
    found = content("runs/results.json")["summary"]
    steps, named = found["recall of steps"], found["precision of steps"]
    right, inside = found["kinds right"], found["truth in the 95 % interval"]
    for row, values in (
        ("velocity steps found", [*steps, named[1] - named[0]]),
        ("events of the right kind", [*right, found["events that are nothing"]]),
        ("fits that converged", found["fits"][:2]),
        ("intervals with the true A, B, L", [x for n in "ABL" for x in inside[n]]),
        ("intervals with the true A-B", inside["A-B"]),
        (
            "common A, B, L rejected at p < .05, where they are common",
            found["shared, called separate at p < .05"],
        ),
    ):
        assert not stale_cell(row_of(RUNS, row, 1)[0], *values), row
    assert steps[0] >= 0.98 * steps[1] and named[0] >= 0.98 * named[1]
    assert right[0] >= 0.95 * right[1]
    assert all(0.92 <= held / of <= 0.98 for held, of in inside.values())


def test_shares_of_runs_whose_steps_share_all():
    """Two hundred shorter runs, and how often they are called separate."""
    kept, text = content("runs/shared.json"), page("runs")
    found, inside = kept["summary"], kept["summary"]["truth in the 95 % interval"]
    separate, steps = found["shared, called separate at p < .05"], found["recall of steps"]
    ps = [run["p shared"] for run in kept["runs"]]
    for row, values in (
        (
            "velocity steps found and fitted",
            [*steps, found["precision of steps"][1] - steps[0]],
        ),
        ("intervals with the true A, B, L in shared runs", [x for n in "ABL" for x in inside[n]]),
        ("intervals with the true A-B in shared runs", inside["A-B"]),
        ("common A, B, L rejected at p < .05 in shared runs", separate),
    ):
        assert not stale_cell(row_of(RUNS, row, 1)[0], *values), row
    assert not stale(text, "median in `shared.json` is #.", round(float(np.median(ps)), 2))
    assert separate == [sum(p < 0.05 for p in ps), 200] and separate[0] <= 0.06 * 200


def test_shares_of_the_axes():
    results = content("blind/axis_results.json")
    levels, records = results["numbers"].values(), results["records"]

    def total(what):
        return [sum(level[what][k] for level in levels) for k in (0, 1)]

    asked = [r for r in records if r["asked"] not in ("viscous", "coulomb")]
    errors = [r["heldout_after"] for r in asked]
    right = total("right group")
    for row, values in (
        ("records", [len(records)]),
        ("nothing missing: an effect confirmed", total("nothing named")),
        (
            "nothing missing: `no_missing_effect`",
            [
                sum(r["verdict"] == "no_missing_effect" for r in records if r not in asked),
                len(records) - len(asked),
            ],
        ),
        ("right group, rho 1", right),
        ("of these confirmed, by rho", [total("confirmed")[0]]),
        ("exactly the effect, by rho", [total("exact")[0]]),
        (
            "test error in sigma, median and 90th percentile",
            [np.median(errors), np.quantile(errors, 0.9)],
        ),
    ):
        assert not stale_cell(row_of(BLIND, row)[3], *values), row
    assert int(row_of(BLIND, "a wrong group confirmed, by rho")[3]) == right[1] - right[0]


def test_rivals():
    sys.path.append(str(FITS.parent))
    compare = importlib.import_module("fits.rivals.compare")
    results, text = content("rivals/results.json"), page("rivals")
    assert compare.table(results["rows"]) in text
    rows = {row["who"]: row for row in results["rows"]}
    lowest, margin, bic = (
        {name: rows[f"{title}, {compare.HOW[rule]}"] for name, title in compare.RIVALS.items()}
        for rule in ("lowest", "margin", "bic")
    )
    ours = rows[compare.OURS]
    (constant,) = (row for row in rows.values() if row["who"].startswith("always"))
    rivals = [*lowest.values(), *margin.values(), *bic.values()]

    def right(row):
        return row["all right"][0]

    best = max((row for row in rivals if row["named on nothing"][0] == 0), key=right)
    for pattern, values in (
        ("(# with an effect, # without)", [ours["all right"][1], ours["named on nothing"][1]]),
        (
            "names the missing effect in # of # records and is wrong in #.",
            [*ours["all right"], ours["wrong"][0]],
        ),
        (
            "The best rival names the missing effect in # and is wrong in #.",
            [right(best), best["wrong"][0]],
        ),
        (
            "the answer `relaxation` for every record is right in # of # records.",
            constant["all right"],
        ),
        (
            "time: # s a record in the median, against # s (STLSQ), # s (FROLS) and # s (pyoperon)",
            [row["seconds"] for row in (ours, *lowest.values())],
        ),
    ):
        assert not stale(text, pattern, *values)
    assert right(best) == max(map(right, rivals))
    assert ours["named on nothing"][0] == margin["operon"]["named on nothing"][0] == 0
    assert {tuple(bic[k]["named on nothing"]) for k in ("stlsq", "frols")} == {(8, 8)}
    assert constant["who"] == "always `relaxation`"
    alone = rows[compare.ALONE]["held out"]
    assert all(row["held out"][0] < alone[0] for row in rivals)


def test_a_stale_digit_is_seen():
    assert agrees("1.035", 1.0354) and not agrees("1.035", 1.0356)
    assert agrees("2e-9", 2.4e-9) and not agrees("2e-9", 2.6e-9)
    assert agrees(".064", 0.0641) and not agrees("19", 18)
    text = "the error falls\nfrom 1.35 to 1.03 sigma. 3 of 4 are right"
    said = "the error falls from # to # sigma"
    assert not stale(text, said, 1.352, 1.031) and not stale(text, "# of 4 are", 3)
    assert stale(text, said, 1.36, 1.031) == [f"'{said}': 1.35, is 1.36"]
    assert stale(text, "the error rises to #", 1.0) == [
        "'the error rises to #' stands there 0 times"
    ]


def test_no_figure_keeps_a_path_of_the_machine_that_made_it():
    """The command in a PNG names records from this repository, not from a root."""
    made = re.compile(rb"made by jaxfric [\x20-\x7e]* /\w")
    assert made.search(b"made by jaxfric 0.1.0: jaxfric axis /data/a.mat --out loop")
    kept = [file.name for file in FITS.rglob("*.png") if made.search(file.read_bytes())]
    assert kept == []
