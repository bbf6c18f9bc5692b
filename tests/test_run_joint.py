"""What steps share, and what changes among them: against SciPy and closed forms."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import curve_fit
from scipy.stats import chi2, t

from jaxfric.fitting.result import difference
from jaxfric.fitting.trend import Trended
from jaxfric.runs.joint import Dependence, dependences, has_trend, rate_of, share, told

TRUE = np.array([0.008, 0.012, 15e-6])
FREE = ("f0", "A", "B", "L")


def step(number, values, covariance, after=1e-5, position=0.0, stress=None, determined=True):
    """A step whose fit has values of A, B, L and a covariance of them; f0 is its own."""
    full = np.zeros((4, 4))
    full[0, 0], full[1:, 1:] = 1e-8, covariance
    estimates = {
        name: SimpleNamespace(value=v, std=s, determined=determined, free=True, unit="m")
        for name, v, s in zip("ABL", values, np.sqrt(np.diag(covariance)), strict=True)
    }
    estimates["f0"] = SimpleNamespace(value=0.6, std=1e-4, determined=True, free=True, unit="1")
    fit = SimpleNamespace(free=FREE, parameters=estimates, covariance=full, converged=True)
    fit.residual, fit.rms = np.zeros(40), 1e-4
    noise = 1e-4 * np.random.default_rng(0).standard_normal(40)
    fit.record = SimpleNamespace(relative_time=np.arange(40.0), friction=noise)
    value, std = difference(fit)
    fit.A_minus_B = SimpleNamespace(value=value, std=std, determined=determined)
    fit.with_trend = fit.trended = None
    fit.noise = SimpleNamespace(sigma=1e-4, glitches=SimpleNamespace(rows=()))
    fit.steps, fit.model = SimpleNamespace(times=[0.0, 9.0]), SimpleNamespace(slip_trend=False)
    event = SimpleNamespace(before=after / 10, after=after, normal_stress=stress)
    return SimpleNamespace(number=number, fit=fit, event=event, position=position, failed="")


def steps(rng, count, *, size=1.0, drift=0.0, along="after"):
    """Steps about the truth by errors of 2 % with a correlation of A and B of 0.9."""
    out = []
    for k in range(count):
        errors = size * 0.02 * TRUE * rng.uniform(0.5, 2.0, 3)
        rho = np.array([[1, 0.9, 0.2], [0.9, 1, 0.3], [0.2, 0.3, 1]])
        covariance = rho * np.outer(errors, errors)
        x = k / max(count - 1, 1)
        values = rng.multivariate_normal(TRUE, covariance)
        values[0] += drift * x
        place = {"after": 10.0 ** (-6 + 2 * x), "position": 1e-2 * x, "stress": 5e7 * (1 + x)}
        more = {"position": 0.0, "stress": 5e7} | {along: place[along]}
        out.append(step(k + 1, values, covariance, **more))
    return out


def test_shared_values_are_the_weighted_mean():
    """Of two steps with diagonal covariances: each by the inverse of its variance. The test rejects
    that they share A, so that the errors are enlarged by the factor of Birge."""
    a = step(1, [0.008, 0.012, 1e-5], np.diag([1e-8, 4e-8, 1e-14]))
    b = step(2, [0.009, 0.012, 1e-5], np.diag([4e-8, 4e-8, 1e-14]))
    found = share([a, b])
    assert found.values["A"] == pytest.approx((0.008 * 4 + 0.009) / 5)
    birge = np.sqrt(0.001**2 / 5e-8 / 3)
    assert found.p < 0.01 and found.errors["A"] == pytest.approx(birge / np.sqrt(1.25e8))
    assert found.values["L"] == pytest.approx(1e-5)
    assert found.errors["L"] == pytest.approx(birge * 1e-7 / np.sqrt(2))
    assert found.chi_square == pytest.approx(0.001**2 / (1e-8 + 4e-8))
    assert found.freedom == 3 and found.p == pytest.approx(chi2.sf(found.chi_square, 3))


@pytest.mark.parametrize(
    ("apart", "said", "enlarged"),
    [
        (2.0, "may have the same parameters (likelihood-ratio test: p = 0.26)", False),
        (3.6, "may have the same parameters (likelihood-ratio test: p = 0.0047; ", True),
        (4.3, "do not share their parameters", True),
    ],
)
def test_noise_that_each_step_estimates_alone_rejects_no_common_values(apart, said, enlarged):
    """Two steps that differ by some errors in A; p is that of chi-square with 3 degrees."""
    values = (0.008, 0.008 + apart * np.sqrt(2e-8))
    C = np.diag([1e-8, 4e-8, 1e-14])
    made = [step(k, [A, 0.012, 1e-5], C) for k, A in enumerate(values, 1)]
    line = told(made)[0]
    assert said in line and ("errors enlarged" in line) == enlarged
    assert share(made).p == pytest.approx(chi2.sf(apart**2, 3))


def test_the_error_of_a_rejected_mean_is_that_of_steps_which_scatter():
    """Steps whose A scatters by 20 errors: the mean of 300 sets scatters by its own error, which
    their covariances give 20 times too small."""
    rng, found = np.random.default_rng(12), []
    for _ in range(300):
        made = [rng.multivariate_normal(TRUE, np.diag([4e-6, 4e-6, 1e-14])) for _ in range(12)]
        C = np.diag([1e-8, 1e-8, 1e-14])
        found.append(share([step(k, values, C) for k, values in enumerate(made, 1)]))
    scatter = np.std([one.values["A"] for one in found])
    assert scatter == pytest.approx(2e-3 / np.sqrt(12), rel=0.15)
    assert np.mean([one.errors["A"] for one in found]) == pytest.approx(scatter, rel=0.3)


def test_separate_by_chance_as_often_as_it_says():
    """Of 400 sets of six steps that share all, 5 % say at p = .05 that they do not."""
    rng = np.random.default_rng(3)
    p = np.array([share(steps(rng, 6)).p for _ in range(400)])
    assert 0.025 < np.mean(p < 0.05) < 0.085
    assert 0.42 < np.mean(p < 0.5) < 0.58


@pytest.mark.parametrize("along", ["after", "position", "stress"])
def test_a_dependence_is_seen_where_it_is(along):
    rng = np.random.default_rng(4)
    found = dependences(steps(rng, 12, drift=0.003, along=along))
    names = {"after": "velocity", "position": "displacement", "stress": "normal stress"}
    best = min(found, key=lambda d: d.p)
    assert best.along == names[along] and best.quantity in ("A", "A-B") and best.p < 1e-4
    width = {"after": 2.0, "position": 10.0, "stress": 5.0}[along]
    of_A = next(d for d in found if d.quantity == "A")
    assert of_A.slope * width == pytest.approx(0.003, abs=4 * of_A.error * width)


def test_a_line_against_scipy():
    """Where errors are honest the slope and its error are those of a weighted fit."""
    rng = np.random.default_rng(8)
    made = steps(rng, 30, drift=0.001)
    for one in made:  # they scatter by more than they say
        one.fit.parameters["A"].std *= 0.4
    of_A = next(d for d in dependences(made) if (d.quantity, d.along) == ("A", "velocity"))
    x = np.log10([s.event.after for s in made])
    y, error = np.array([(s.fit.parameters["A"].value, s.fit.parameters["A"].std) for s in made]).T
    (slope, _), C = curve_fit(lambda x, a, b: a * x + b, x, y, sigma=error, absolute_sigma=True)
    chi = np.sum(((y - slope * x - _) / error) ** 2) / 28
    assert of_A.slope == pytest.approx(slope, rel=1e-6)
    assert of_A.error == pytest.approx(np.sqrt(C[0, 0] * max(chi, 1)), rel=1e-5)
    assert chi > 2
    three = len(dependences(made))
    assert of_A.p == pytest.approx(min(1, three * 2 * t.sf(abs(slope) / of_A.error, 28)), rel=1e-4)


def test_no_dependence_is_named_by_chance():
    """All questions together: at most about 5 % of 300 sets without any."""
    rng = np.random.default_rng(5)
    named = [any(d.p < 0.05 for d in dependences(steps(rng, 8))) for _ in range(300)]
    assert np.mean(named) < 0.08


@pytest.mark.parametrize("bias", [0.0, 0.003])
def test_a_trend_over_slip_is_no_dependence_of_a_less_b(bias):
    """A-B is biased by hardening that differs along the run; with a trend it is not, but its error
    is twice as large. Without bias the estimates without a trend are used."""
    rng = np.random.default_rng(11)
    made = steps(rng, 10, drift=bias, along="stress")
    for k, one in enumerate(made):
        value = one.fit.parameters["A"].value - one.fit.parameters["B"].value
        error = np.sqrt(np.array([1, -1]) @ one.fit.covariance[1:3, 1:3] @ [1, -1])
        shift = np.sqrt(3) * error * rng.standard_normal()
        one.fit.with_trend = (value - bias * k / 9 + shift, 2 * error)
        change = np.array([0.0, 0.0, shift - bias * k / 9, 0.0, 0.0])
        spread = np.diag([1e6, 0.0, 0.0, 0.0, 0.0])  # the steps show no common trend
        spread[1:, 1:] = 4 * one.fit.covariance
        one.fit.trended = Trended(change, spread)
    line = next(d for d in dependences(made) if (d.quantity, d.along) == ("A-B", "normal stress"))
    assert line.p > 0.05
    assert ("trend with slip" in " ".join(told(made))) is bool(bias)
    x, y = np.linspace(5, 10, 10), np.array([difference(one.fit) for one in made])
    (slope, _), _ = curve_fit(lambda x, a, b: a * x + b, x, y[:, 0], sigma=y[:, 1])
    assert (line.slope == pytest.approx(slope, rel=1e-6)) is not bool(bias)
    assert line.slip_trend is bool(bias)
    text = " ".join(told(made))
    words = "; without it A-B against normal stress: significant, slope +0.0"
    assert (words in text) is bool(bias)
    y = np.array([rate_of(one.fit, trend=has_trend(made)) for one in made])  # what the figure draws
    (slope, _), _ = curve_fit(lambda x, a, b: a * x + b, x, y[:, 0], sigma=y[:, 1])
    assert line.slope == pytest.approx(slope, abs=1e-4 * line.error)


def linear(rng, trend, *, count=8, apart=0.0):
    """Steps of a linear model, y = J (A, B, ln L) + s x + white noise; J is fixed but for the sign
    of A - B, which x resembles. Returns the steps, and the least squares of all rows together with
    a common trend: its values, their errors, and its sum of squares."""
    n, sigma, truth = 60, 2e-4, np.array([*TRUE[:2], np.log(TRUE[2]), trend])
    made, stacked, rows = [], [], []
    for k in range(count):
        u = np.linspace(-1, 1, n)
        way = (-1) ** k
        columns = [way * u + 0.3 * np.exp(-9 * u**2), -way * u + 0.2 * u**2, 1e-2 * np.sin(3 * u)]
        both = np.column_stack([*columns, 60e-6 * u])
        own = truth + np.array([apart * (k % 2), 0, 0, 0])
        y = both @ own + sigma * rng.standard_normal(n)
        spreads = [sigma**2 * np.linalg.inv(J.T @ J) for J in (both[:, :3], both)]
        (A, B, ln_L), after = (np.linalg.lstsq(J, y)[0] for J in (both[:, :3], both))
        scale = np.array([1, 1, np.exp(ln_L)])
        one = step(
            k + 1, [A, B, scale[2]], spreads[0] * np.outer(scale, scale), after=10 ** (k - 9.0)
        )
        change, spread = np.zeros(5), np.zeros((5, 5))
        at, units = np.array([2, 3, 4, 0]), np.append(scale, 1.0)
        change[at] = units * (after - [A, B, ln_L, 0])
        spread[np.ix_(at, at)] = spreads[1] * np.outer(units, units)
        one.fit.trended = Trended(change, spread)
        weight = np.array([0, 0, 1, -1, 0])
        moved, error = weight @ change, np.sqrt(weight @ spread @ weight)
        one.fit.with_trend = (A - B + moved, error)
        made.append(one)
        stacked.append(both)
        rows.append(y)
    J, y = np.vstack(stacked), np.concatenate(rows)
    values, left, *_ = np.linalg.lstsq(J, y)
    errors = sigma * np.sqrt(np.diag(np.linalg.inv(J.T @ J)))
    alone = sum(np.linalg.lstsq(one, y)[1][0] for one, y in zip(stacked, rows, strict=True))
    return made, values, errors, (left[0] - alone) / sigma**2


def test_a_common_trend_is_that_of_all_rows_together():
    """Least squares of all rows with one A, B, ln L and slip trend; Q is what they leave more than
    separate values and trends do."""
    made, values, errors, rise = linear(np.random.default_rng(1), 1.5)
    found = share(made, "common")
    assert found.values["slip_trend"] == pytest.approx(values[3], rel=1e-6)
    assert found.errors["slip_trend"] == pytest.approx(errors[3], rel=1e-6)
    assert found.values["A"] == pytest.approx(values[0], rel=1e-6)
    assert np.log(found.values["L"]) == pytest.approx(values[2], rel=1e-6)
    assert found.chi_square == pytest.approx(rise, rel=1e-6) and found.freedom == 4 * 7


def test_a_common_trend_is_no_difference_of_the_steps():
    """Steps with one A, B and L on friction with one trend, which no step alone shows."""
    rng, denied, shown = np.random.default_rng(2), 0, 0
    for _ in range(50):
        made, *_ = linear(rng, 3.0)
        differ, trend, found = share(made, "none").p < 0.001, has_trend(made), share(made)
        assert found.p > 0.001 and found.slip_trend == ("common" if trend else "none")
        text = " ".join(told(made))
        assert ("slip_trend 0.00" in text) == trend
        assert ("without it the steps do not share" in text) == (trend and differ)
        denied, shown = denied + differ, shown + trend
    assert shown >= 48 and denied >= 40


def test_noise_is_seldom_a_trend_of_all_steps():
    rng = np.random.default_rng(3)
    assert np.mean([has_trend(linear(rng, 0.0)[0]) for _ in range(200)]) < 0.03


def test_steps_that_differ_with_and_without_a_trend_are_told_to():
    """Steps up and down with two values of A: a common trend resembles that, and is no answer."""
    made, *_ = linear(np.random.default_rng(4), 0.0, apart=1e-3)
    assert not has_trend(made)
    assert "nor do they with a slip trend in every step (p" in told(made)[0]


def test_what_is_not_determined_has_no_say():
    rng = np.random.default_rng(6)
    made = steps(rng, 5)
    wild = step(6, [0.5, 0.5, 1.0], np.diag([1e-8, 1e-8, 1e-8]), determined=False)
    assert share([*made, wild]).steps == (1, 2, 3, 4, 5)
    assert share(made[:1]) is None and told(made[:1]) == []
    assert dependences(made[:3]) == []


@pytest.mark.parametrize(
    ("drift", "words"),
    [
        (
            0.0,
            ["the 8 steps may have the same", "A 0.00", "A-B against velocity: not sig"],
        ),
        (0.01, ["do not share", "A against velocity: significant, slope +0.0", "per decade of v"]),
    ],
)
def test_what_is_told(drift, words):
    text = " ".join(told(steps(np.random.default_rng(7), 8, drift=drift)))
    assert all(word in text for word in words), text
    assert ("A against velocity" in text) == (drift > 0)


def test_a_slope_is_told_with_what_its_error_and_its_p_are():
    """Seven errors are no seven sigma of five steps, and less so among all questions."""
    made = steps(np.random.default_rng(4), 5, drift=0.003)
    found = next(d for d in dependences(made) if d.p < 0.05)
    ratio = abs(found.slope) / found.error
    alone = 2 * t.sf(ratio, 3)
    assert found.freedom == 3 and found.questions == 3
    assert found.p == pytest.approx(3 * alone)
    words = f"t = {ratio:.2g}, 3 d.o.f., p = {alone:.2g}"
    assert f"{words}; p = {found.p:.2g} after Bonferroni correction for 3 tests" in found.told()


def test_steps_that_differ_on_no_line_are_told_to_differ():
    """A changes to and fro, by fifty errors."""
    made = steps(np.random.default_rng(9), 8, size=0.05)
    for one in made:
        one.fit.parameters["A"].value += 1e-3 * (-1) ** (one.number // 2)
    first, second = told(made)
    assert first.startswith("the steps do not share their parameters")
    assert second.startswith("A-B against velocity: not significant")


@pytest.mark.parametrize(
    ("slope", "error", "words"),
    [
        (-8.6e-4, 1.3e-4, "velocity: significant, slope -0.00086(13) per decade of"),
        (8.6e-4, 3.1e-4, "not significant, slope +0.00086(31) per"),
        (8.6e-4, 5.1e-4, ": not significant, slope +0.00086(51) per"),
    ],
)
def test_of_velocity_a_line_is_told_shown_or_not(slope, error, words):
    """Eight steps of one error, their velocities over two decades: the slope is known by hand, and
    so is its error. Displacement changes too, and does not silence it."""
    x = np.linspace(-1.0, 1.0, 8)
    size = error * np.sqrt(np.sum(x**2))
    made = []
    for k, at in enumerate(x):
        covariance = np.diag([size**2 / 2, size**2 / 2, 1e-14])
        values = TRUE + np.array([slope * at, 0.0, 0.0])
        place = {"after": 10.0 ** (at - 5), "position": 1e-3 * (k % 3)}
        made.append(step(k + 1, values, covariance, **place))
    (line,) = [text for text in told(made) if text.startswith("A-B against velocity: ")]
    assert words in line
    p = min(1.0, 6 * 2 * t.sf(abs(slope) / error, 6))
    assert f"{p:.2g} after Bonferroni correction for 6 tests" in line


def test_steps_up_and_down_lie_on_one_line_of_velocity():
    """Steady friction f = a u + b u^2 of u = log10 V: what a step measures is its change over that
    of u, a + b (u1 + u2), whatever its way, so the slope by decade of the mean is 2 b."""
    a, b = -0.004, 5e-4
    made = []
    ends = [(-6, -5), (-5, -4), (-4, -6), (-6, -4.5), (-4.5, -5), (-5, -6)]
    for k, (u, w) in enumerate(ends, 1):
        slope = ((a * w + b * w**2) - (a * u + b * u**2)) / (w - u)
        values = TRUE + np.array([TRUE[1] - TRUE[0] + slope, 0.0, 0.0])
        made.append(step(k, values, np.diag([1e-10, 1e-10, 1e-14]), after=10.0**w))
        made[-1].event.before = 10.0**u
    (found,) = [d for d in dependences(made) if (d.quantity, d.along) == ("A-B", "velocity")]
    assert found.slope == pytest.approx(2 * b, rel=1e-9)


def test_a_dependence_rests_on_no_fit_that_does_not_describe_its_step():
    """Eight steps, one of which is missed: it has no say."""
    made = steps(np.random.default_rng(7), 8)
    assert {d.freedom for d in dependences(made)} == {6}
    made[7].fit.residual[20:25] = -5e-4
    assert {d.freedom for d in dependences(made)} == {5}


def test_a_step_has_a_say_on_a_b_where_it_determines_that_alone():
    made = steps(np.random.default_rng(7), 5)
    made[1].fit.parameters["L"].determined = False
    found = {d.quantity: d.freedom for d in dependences(made)}
    assert found == {"A": 3, "A-B": 3, "ln L": 2}
    made[2].fit.A_minus_B.determined = False
    assert {d.quantity: d.freedom for d in dependences(made)}["A-B"] == 2


def test_why_a_line_with_velocity_is_not_asked():
    made = steps(np.random.default_rng(7), 5)
    assert "not tested, which needs 4 steps without a star" in told(made[:3])[-1]
    alike = steps(np.random.default_rng(7), 5, along="position")
    assert any(text.startswith("A-B against velocity: not tested") for text in told(alike))


def test_no_p_value_is_printed_as_zero() -> None:
    """A steep slope has a p-value that underflows; the text gives an upper bound."""
    found = Dependence("A-B", "velocity", "decade", 1.0, 1e-9, 0.0, 60, 3)
    assert found.told().count("p < 1e-12") == 2 and "p = 0" not in found.told()
