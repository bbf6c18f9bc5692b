"""`jaxfric stability` and `jaxfric simulate`: what they print and write, and every figure."""

import dataclasses
import json
import re
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from command import Outcome, assert_refused, run, written
from matplotlib.image import imread
from scipy.integrate import solve_ivp

import jaxfric
from jaxfric.gains.cycle_map import CycleMap
from jaxfric.gains.ends import ENDS, EndState
from jaxfric.gains.margins import slacks
from jaxfric.gains.requirement import Requirement
from jaxfric.gains.result import Certificate, Gains, LocalOptimum, WorstCase
from jaxfric.gains.scenarios import Scenarios
from jaxfric.gains.solve import make_region
from jaxfric.gains.verify import CheckReport
from jaxfric.laws.source import law_from_parameters, stack
from jaxfric.plot.gain_map import (
    _deciding,
    _least_slack,
    _map_axes,
    _of,
    draw_gain_map,
)
from jaxfric.plot.gains import end_map_figure, gains_figure
from jaxfric.plot.style import new_figure, save
from jaxfric.report.gains import report as report_of
from jaxfric.units import prefixed

SLIP = ("--law", "slip", "--parameters", "A=1 N, B=3 N, L=1 mm, V0=2 mm/s")
# k_f = 2 c1 c2 V/(1 + c2 V^2)^2 - c0 is 0.5 N s/m at 0.5 m/s: the golden delay sample
DELAY = ("--law", "delay", "--parameters", "c0=0.14 N*s/m, c1=1 N, c2=1 s^2/m^2, alpha=0.3 s")
DELAY += ("--velocity", "0.5 m/s", "--mass", "1 kg", "--kv", "0.2 N*s/m")
GAUSS = ("--law", "gaussian-stribeck")
GAUSS += ("--parameters", "c0=1 N, c1=0.4 N*s/m, c2=2 N, c3=50 mm/s")


@pytest.fixture(autouse=True)
def in_a_folder_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def assert_figures(folder: Path, names: list[str]) -> None:
    """Every figure is there as PNG and SVG, and shows something."""
    for name in names:
        pixels = imread(folder / f"{name}.png")[..., :3]
        assert min(pixels.shape[:2]) > 300, name
        marked = np.mean(np.any(pixels < 0.9, axis=2))
        columns = np.mean(np.any(np.any(pixels < 0.6, axis=2), axis=0))
        assert marked > 0.01 and columns > 0.5, f"{name} is blank: {marked:.3f}, {columns:.2f}"
        assert (folder / f"{name}.svg").read_text().lstrip().startswith("<?xml")


def test_a_blank_figure_is_noticed() -> None:
    from matplotlib.figure import Figure

    for kind in ("png", "svg"):
        Figure(figsize=(6, 5)).savefig(f"empty.{kind}")
    with pytest.raises(AssertionError, match="blank"):
        assert_figures(Path(), ["empty"])


def report(folder: str = "slip-stability") -> dict:
    def refuse(word: str):
        raise AssertionError(f"{word} is not JSON")

    content = json.loads(Path(folder, "stability.json").read_text(), parse_constant=refuse)
    assert content["schema"] == "jaxfric.stability/2"
    return content


def test_the_golden_slider() -> None:
    gains = ("--mass", "2 kg", "--kv", "0.5 N*s/m", "--kp", "3 kN/m")
    code, out, err = run("stability", *SLIP, "--velocity", "2 mm/s", *gains, "--details")
    assert code == 0 and err == ""
    for words in ("f_v + k_v < int g dt (18)", "k_cr = 2.014976024 kN/m", "STABLE", "phase"):
        assert words in out
    assert "equations of the documentation's page 'theory'" in out
    content = report()
    found = content["rice_ruina_criterion"]
    assert found["holds"] and len(found["solutions"]) == 1
    assert found["critical_stiffness"] == pytest.approx(2014.976023976024, rel=1e-9)
    assert found["critical_frequency"] == pytest.approx(2.826307129101859, rel=1e-9)
    assert content["friction"]["slope"] == pytest.approx(500, rel=1e-12)
    assert content["friction"]["steady_slope"] == pytest.approx(-1000, rel=1e-12)
    assert content["needed_damping"] == pytest.approx(1000, rel=1e-12)
    # (2 s^2 + 500.5 s + 3000)(s + 2) - 3000 s, as A/V0 = 500, B/L = 3000, V0/L = 2
    roots = np.roots(np.polysub(np.polymul([2, 500.5, 3000], [1, 2]), [3000, 0]))
    poles = np.asarray(content["poles"])
    assert np.sort_complex(poles[:, 0] + 1j * poles[:, 1]) == pytest.approx(
        np.sort_complex(roots), rel=1e-9
    )
    margins = {name: item["value"] for name, item in content["margins"].items()}
    assert list(margins) == ["stiffness", "decay", "damping", "modulus", "gain", "phase", "delay"]
    assert margins["decay"] == pytest.approx(-roots.real.max(), rel=1e-9)
    assert margins["stiffness"] == pytest.approx(3000 / 2014.976023976024, rel=1e-9)
    assert_figures(Path("slip-stability"), ["friction", "gain_map", "velocity", "root_locus"])


@pytest.mark.long
def test_a_range_of_velocities_without_mass() -> None:
    outcome = run("stability", *SLIP, "--velocity", "0.1..10 mm/s", "--out", "here")
    code, out, _ = outcome
    assert code == 0 and "hardest velocity" in out
    content = report("here")
    V = np.asarray(content["velocities"]["velocity"])
    assert len(V) == 25
    # (24)-(25) without mass: k_cr = (B - A)/L at every velocity; k_v V >= B - A needs no stiffness
    assert content["velocities"]["critical_stiffness"] == pytest.approx(np.full(25, 2e3), rel=1e-9)
    assert content["velocities"]["needed_damping"] == pytest.approx(2 / V, rel=1e-9)
    assert content["velocities"]["critical_frequency"] == pytest.approx(
        V / 1e-3 * np.sqrt(2), rel=1e-9
    )
    assert content["poles"] is None and content["margins"] is None


@pytest.mark.long
def test_a_delay_has_no_critical_stiffness() -> None:
    code, out, _ = run("stability", *DELAY, "--kp", "100 N/m")
    assert code == 0 and "stable for 16.7 N/m < k_p < 283.9 N/m" in out
    content = report("delay-stability")
    assert content["rice_ruina_criterion"]["critical_stiffness"] is None
    intervals = content["delay"]["stable_intervals"]
    golden = [(16.703372151, 283.888781436), (626.816131852, 1428.372359707)]
    golden += [(2114.227060538, 3450.154106963), (4478.936158210, 6349.234023205)]
    assert np.asarray([(i["lower"], i["upper"]) for i in intervals]) == pytest.approx(
        np.asarray(golden), rel=1e-9
    )
    for ends in intervals:  # (19) at the frequencies: k_v = k_f cos(alpha w)
        assert 0.5 * np.cos(0.3 * np.asarray(ends["frequencies"])) == pytest.approx(0.2, rel=1e-6)
    assert content["poles"][0] == pytest.approx([-0.374663328, 9.949331], rel=1e-6)
    assert content["delay"]["unstable_roots"] == 0 and content["stable"]
    assert_figures(Path("delay-stability"), ["friction", "delay_chart", "root_locus"])


@pytest.mark.long
def test_laws_without_memory() -> None:
    gains = ("--mass", "2", "--kp", "100 N/m", "--kv", "40 N*s/m")
    code, out, _ = run("stability", *GAUSS, "--velocity", "1..200 mm/s", *gains, "--json")
    assert code == 0
    content = json.loads(out)
    assert content == report("gaussian-stribeck-stability")
    assert content["memoryless"]["critical_velocity"] == pytest.approx(0.03535533905932738)
    assert content["memoryless"]["worst_slope"] == pytest.approx(-33.91055539840)
    assert content["stable"] and content["margins"]["stiffness"]["value"] is None
    names = ["friction", "gain_map", "velocity", "root_locus"]
    assert_figures(Path("gaussian-stribeck-stability"), names)
    dahl = ("--law", "dahl", "--parameters", "f_c=2 N, sigma=1e5 N/m", "--velocity", "1 mm/s")
    code, out, _ = run("stability", *dahl, "--kp", "100 N/m", "--kv", "1 N*s/m")
    assert code == 0 and "STABLE" in out and "stable by damping" in out


def table(folder: str) -> np.ndarray:
    """time [s], load point [m], friction [N], slip [m], velocity [m/s]."""
    lines = Path(folder, "trajectory.csv").read_text().splitlines()
    rows = [line for line in lines if not line.startswith("#")]
    header = "time [s],load_point_displacement [um],friction [N],slip [um],slider_velocity [um/s]"
    assert rows[0] == header
    return np.loadtxt(rows[1:], delimiter=",").T * [[1], [1e-6], [1], [1e-6], [1e-6]]


@pytest.mark.long
def test_asimulated_record_is_read_and_fitted() -> None:
    steps = ("--steps", "0 s: 1 mm/s, 4 s: 5 mm/s", "--duration", "8 s")
    code, out, err = run("simulate", *SLIP, *steps, "--stiffness", "20 kN/m", "--out", "simulation")
    assert code == 0 and err == "" and "simulated: 8 s of 8 s" in out
    assert_figures(Path("simulation"), ["motion", "phase_plane"])
    _, load, friction, slip, _ = table("simulation")
    # a slider without mass: the spring carries friction; steady friction by (5), f0 = 50 A
    assert friction[0] == pytest.approx(50 + 2 * np.log(2), rel=1e-9)
    assert friction == pytest.approx(friction[0] + 2e4 * (load - slip), abs=1e-6)
    record = jaxfric.read("simulation/trajectory.csv")
    assert record.friction_unit == "N" and len(record) > 2000
    assert record.load_point_displacement is not None
    assert len(jaxfric.find_steps(record.time, record.load_point_displacement)) == 2
    # 91 rows with noise, the shape that other tests of the command have compiled already
    lines = Path("simulation/trajectory.csv").read_text().splitlines()
    first = 1 + next(k for k, line in enumerate(lines) if not line.startswith("#"))
    head, rows = lines[:first], [line.split(",") for line in lines[first:]]
    random = np.random.default_rng(3)
    for row in rows:
        row[2] = f"{float(row[2]) + random.normal(0, 2e-3):.6f}"
    kept = [rows[k] for k in np.linspace(0, len(rows) - 1, 91).round().astype(int)]
    written(Path("few.csv"), "\n".join([*head, *(",".join(row) for row in kept)]))
    options = ("--stiffness", "20 kN/m", "--steps", "0 s: 1 mm/s, 4 s: 5 mm/s", "--json")
    code, out, _ = run("fit", "few.csv", *options)
    assert code == 0
    fitted = {name: p["value"] for name, p in json.loads(out)["parameters"].items()}
    for name, truth in (("A", 1.0), ("B", 3.0), ("L", 1e-3)):
        assert fitted[name] == pytest.approx(truth, rel=0.05)


@pytest.mark.long
def test_ends_are_told_apart() -> None:
    at = (*SLIP, "--velocity", "2 mm/s", "--mass", "2 kg", "--duration", "24 s")
    code, out, _ = run("simulate", *at, "--kp", "1500 N/m", "--out", "soft")
    assert "(half the range of slip about steady sliding)" in out
    assert re.search(r"slip amplitude [\d.]+ mm .* to [\d.]+ mm/s", out)  # as --velocity has it
    assert code == 0 and "end: oscillation" in out and "period" in out
    assert_figures(Path("soft"), ["motion", "phase_plane"])
    period = float(out.split("period ")[1].split(" s")[0])
    time, _, friction, _, velocity = table("soft")
    slips = time[1:][(velocity[:-1] < 20e-3) & (velocity[1:] >= 20e-3)]
    assert period == pytest.approx(slips[-1] - slips[-2], rel=0.02)
    assert velocity.max() > 50e-3 and np.ptp(friction) > 5
    code, out, _ = run("simulate", *at, "--kp", "3 kN/m", "--at-rest", "--out", "stiff")
    assert code == 0 and "end: steady" in out and "at rest" in out
    assert abs(table("stiff")[4][-1] - 2e-3) < 1e-5


def test_the_course_is_told_by_values() -> None:
    """For programs: how it began and ended by name, with the numbers that the sentence has."""
    at = (*SLIP, "--velocity", "2 mm/s", "--mass", "2 kg", "--kp", "1500 N/m", "--jump", "20 um")
    told = json.loads(run("simulate", *at, "--duration", "26 s", "--json", "--out", "s").out)
    course = told["course"]
    assert (course["start"], course["result"]) == ("jump", "successful")
    assert course["end"] == "limit_cycle"
    assert course["jump"] == 2e-5 and course["simulated"] == course["asked"] == 26.0
    least, most = course["cycle"]["least_velocity"], course["cycle"]["largest_velocity"]
    assert told["velocity"][0] <= least < 2e-3 < 20 * 2e-3 < most <= told["velocity"][1]
    lines = Path("s/trajectory.csv").read_text().splitlines()
    assert f"period {course['cycle']['period']:.5g} s" in next(x for x in lines if "end: " in x)
    again = json.loads(run("simulate", *at, "--duration", "1 ms", "--json", "--out", "t").out)
    assert again["course"]["end"] == "unresolved" and again["course"]["cycle"] is None


def test_steps_tell_the_largest_velocity() -> None:
    """A massless slider above critical stiffness slips at 35 m/s and comes back, as in SciPy."""
    A, B, kL = 4.5, 5.123459052294493, 251188.6431509582 * 3e-6

    def rate(_, y):
        state = -np.exp(y[0]) * (y[1] + B * y[0])
        return [(kL * (1 - np.exp(y[0])) - state) / A, state]

    u = -np.log(10.0)
    exact = solve_ivp(rate, (0, 40), [u, -B * u], "LSODA", rtol=1e-10, atol=1e-12).y[0]
    law = ("--law", "slip", "--parameters", f"A={A} N, B={B} N, L=3 um, V0=1 um/s")
    steps = ("--steps", "0 s: 0.1 um/s, 5 s: 1 um/s")
    code, out, _ = run("simulate", *law, "--kp", f"{kL / 3e-6} N/m", *steps, "--out", "o")
    assert code == 0 and out.startswith("simulated: ")
    fastest = float(re.search(r"velocity [\d.]+ to ([\d.e+]+) um/s", out)[1])
    assert fastest == pytest.approx(np.exp(exact.max()), rel=0.02)


@pytest.mark.long
def test_a_delay_grows_at_the_rate_of_its_root() -> None:
    code, out, _ = run("simulate", *DELAY, "--kp", "400 N/m", "--duration", "6 s")
    assert code == 0 and "oscillation" in out
    time, _, _, _, velocity = table("delay-simulate-duration6s")
    deviation = velocity - 0.5
    inner = (deviation[1:-1] > deviation[:-2]) & (deviation[1:-1] >= deviation[2:])
    peaks = np.flatnonzero(inner & (time[1:-1] > 2)) + 1
    growth = np.polyfit(time[peaks], np.log(deviation[peaks]), 1)[0]
    assert growth == pytest.approx(0.132331407, rel=0.03)
    assert_figures(Path("delay-simulate-duration6s"), ["motion", "phase_plane"])


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((*SLIP, "--velocity", "2 mm/s", "--mass", "-2 kg"), ["--mass", "not positive"]),
        ((*SLIP, "--velocity", "2 mm/s", "--mass", "1..2 kg"), ["--mass", "more than one"]),
        ((*SLIP, "--velocity", "9..1 mm/s"), ["--velocity", "empty"]),
        ((*SLIP,), ["--velocity is missing"]),
        ((*SLIP, "--velocity", "2 furlong/parsec"), ["--velocity"]),
        ((*SLIP, "--velocity", "2 mm/s", "--kp", "0 N/m"), ["--kp", "not positive"]),
        ((*SLIP, "--velocity", "2 mm/s", "--kp", "3 N/mn"), ["--kp", "not a known unit"]),
        ((*SLIP, "--velocity", "2 mm/s", "--kv", "-1 N*s/m"), ["--kv", "negative"]),
        (("--velocity", "2 mm/s"), ["no friction law", "--from"]),
        ((*SLIP[:3], "A=1 N, L=1 mm, V0=1 mm/s", "--velocity", "1 mm/s"), ["B is missing"]),
        (("--law", "slipp", *SLIP[2:], "--velocity", "1 mm/s"), ["'slipp'", "gaussian-stribeck"]),
        ((*DELAY[:4], "--velocity", "1 mm/s"), ["delay law", "--mass"]),
        (
            (
                *DELAY[:3],
                "c0=1 N*s/m, c1=1 N, c2=1e200 s^2/m^2, alpha=1 s",
                *("--mass", "1", "--velocity", "1e200 m/s"),
            ),
            ["no steady state", "1e+200"],
        ),
    ],
)
def test_bad_input_of_stability(arguments: tuple[str, ...], words: list[str]) -> None:
    assert_refused(run("stability", *arguments), *words)
    assert not list(Path().iterdir())


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((*SLIP, "--kp", "1 N/m"), ["--velocity", "--steps"]),
        ((*SLIP, "--velocity", "1 mm/s"), ["--kp is missing"]),
        ((*SLIP, "--velocity", "1, 2 mm/s", "--kp", "1 N/m"), ["more than one"]),
        ((*SLIP, "--steps", "0 s: 1", "--kp", "1 N/m"), ["no unit"]),
        ((*SLIP, "--velocity", "1 mm/s", "--kp", "-1 N/m"), ["--kp", "not positive"]),
        ((*GAUSS, "--velocity", "1 mm/s", "--kp", "1 N/m"), ["GaussianStribeck", "--mass"]),
        ((*DELAY, "--kp", "1 N/m", "--at-rest"), ["delay law", "rest"]),
        ((*SLIP, "--velocity", "1 mm/s", "--kp", "1 N/m", "--duration", "0 s"), ["--duration"]),
        (
            (*SLIP, "--velocity", "1 mm/s", "--kp", "1 N/m", "--at-rest", "--jump", "1 um"),
            ["--jump", "exclude"],
        ),
    ],
)
def test_bad_input_of_simulate(arguments: tuple[str, ...], words: list[str]) -> None:
    assert_refused(run("simulate", *arguments), *words)
    assert not list(Path().iterdir())


def test_a_folder_that_cannot_be() -> None:
    written(Path("file"), "text")
    for verb, more in (("stability", ()), ("simulate", ("--kp", "1 N/m"))):
        outcome: Outcome = run(verb, *SLIP, "--velocity", "1 mm/s", *more, "--out", "file")
        assert_refused(outcome, "is a file", "--out")


def golden_gains() -> Gains:
    """Gains of the golden slider made by hand: on the boundary k_p = 1.5 k_cr and at k_p -> 0."""
    source = law_from_parameters("slip", SLIP[3])
    scenarios = Scenarios.product(source.samples, [1e-3, 2e-3, 4e-3], [2.0])
    requirement = Requirement({"stiffness": 1.5})
    region = make_region(scenarios, (None, None), (None, None), (None, None))
    basins = []
    for name, kp, kv in (("stiff", 3100.0, 0.0), ("damped", 1e-3, 2000.0)):
        norm = float(region.norm([kp, kv]))
        basins.append(LocalOptimum(name, kp, kv, norm, 0.0, 0.0, (), False))
    worst = {"stiffness": WorstCase(1.5, "1", scenarios.describe(0))}
    certificate = Certificate(0.0, 0, 0, 1)
    numbers = (3100.0, 0.0, basins[0].norm, tuple(basins), worst)
    return Gains(*numbers, scenarios, requirement, region, 1.0, 1, certificate, source.text)


def test_the_figure_of_gains() -> None:
    save(gains_figure(golden_gains()), Path(), "gains")
    assert_figures(Path(), ["gains"])
    text = Path("gains.svg").read_text()
    for words in ("meets the requirement in every scenario", "recommended", "k_cr(k_v)"):
        assert words in text


def test_the_optimum_is_no_second_mark_below_the_recommended_gains() -> None:
    figure, result = new_figure(6, 5), golden_gains()
    axis = figure.subplots()
    draw_gain_map(axis, result)
    marked = {line.get_marker(): line.get_label() for line in axis.lines}
    assert marked["*"].startswith("recommended, optimum: stiff")
    assert marked["D"].startswith("optimum: damped")


def test_the_figure_has_the_words_of_the_report_and_names_gains_that_are_nothing() -> None:
    least = LocalOptimum("stiff", 1e-9, 0.0, 1e-9, 0.0, 0.0, (), True)
    assert _of(least) == "optimum: stiff (norm 0)"
    checked = CheckReport(10, 9, 0, 0, 1, None, None, ())
    result = dataclasses.replace(golden_gains(), simulation=checked)
    first, *rest = report_of(result).headline
    figure = gains_figure(result)
    assert figure.get_suptitle()[:60] == first[:60]
    told = [text.get_text().replace("\n", " ") for text in figure.legends[0].get_texts()]
    assert told[-len(rest) :] == rest


def test_the_map_of_a_late_controller_shows_gains_of_its_size() -> None:
    """Without delay damping alone would do, at 1000 N s/m; 5 ms late no more than about m/T is
    stable: of a mass alone, T w < 1 rad at w = k_v/m."""
    result = golden_gains()
    late = Scenarios.product(result.scenarios.laws, [1e-3, 2e-3, 4e-3], [0.05], 5e-3)
    slow = dataclasses.replace(result, scenarios=late, delay=5e-3, optima=result.optima[:1])
    k_v = _map_axes(slow, None, 2000.0)[1][-1]
    assert 0 < k_v < 500
    assert _map_axes(result, lambda v: 2000 + 0 * v, 2000.0)[1][-1] == 2600


def test_a_map_shows_the_least_slack_of_all_scenarios() -> None:
    result = golden_gains()
    laws = stack(
        [
            law_from_parameters("slip", f"A=1 N, B={B} N, L=1 mm, V0=2 mm/s").law
            for B in (2.5, 3.0, 2.8)
        ]
    )
    scenarios = Scenarios.product(laws, [1e-3, 2e-3, 4e-3, 8e-3], [1.0, 2.0])
    many = dataclasses.replace(result, scenarios=scenarios)
    k_p, k_v = np.linspace(1, 6000, 121), np.linspace(0, 2500, 121)
    gains = np.stack(np.meshgrid(k_p, k_v), axis=-1).reshape(-1, 2)
    some = np.arange(5, len(gains), 197)
    brute = slacks(many.requirement, scenarios, many.region.unit, gains[some]).min(axis=1)
    few = scenarios.take(_deciding(many, k_p, k_v))
    assert len(few) < len(scenarios)
    found = _least_slack(many, few, k_p, k_v).ravel()
    np.testing.assert_allclose(found[some], brute, rtol=1e-9)


def test_the_figure_of_ends() -> None:
    k_p, k_v = np.linspace(500, 6000, 12), np.linspace(0, 1300, 9)
    soft = jnp.asarray(k_p[None] + 2 * k_v[:, None] < 2000)
    pick = jax.vmap(jax.vmap(lambda soft: ENDS.where(soft, ENDS.limit_cycle, ENDS.steady)))
    ends = EndState(pick(soft), *(jnp.zeros(soft.shape) for _ in range(6)))
    found = CycleMap(k_p, k_v, ends, 1)
    save(end_map_figure(golden_gains(), found), Path(), "end_map")
    assert_figures(Path(), ["end_map"])
    text = Path("end_map.svg").read_text()
    assert "limit cycle" in text and "escape" not in text


def test_the_first_line_of_a_delay_law_is_its_first_interval(tmp_path):
    """pi/(2 alpha) and 3 pi/(2 alpha) are the frequencies of its ends, m w^2 + k_f w of a slider
    without damping: both by hand."""
    law = ("--law", "delay", "--parameters", "c0=0.1 N*s/m, c1=1 N, c2=1 s^2/m^2, alpha=0.3 s")
    out = run("stability", *law, "--mass", 1, "--velocity", "0.5 m/s", "--out", tmp_path / "o").out
    w = np.array([0.5, 1.5]) * np.pi / 0.3
    low, high = w**2 + 0.54 * w * np.array([1, -1])
    assert (
        f"stable for {prefixed(low, 'N/m')} < k_p < {prefixed(high, 'N/m')}" in out.splitlines()[0]
    )
