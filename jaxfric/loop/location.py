"""Locates the residual structure of a base model, without a catalogue of effects.

Bumps of friction over one variable pass through the linearised slider and are fitted together with
the base. The variables are slip, velocity, state, time, time or slip since the velocity step, and
wavelength. Friction differs along the variable whose bumps explain most of the structure. Each
variable is fitted alone, so the shares of structure that variables explain overlap. The `further`
shares add up: the best variable comes first, and each later variable has the share that it explains
beyond the earlier variables. Profiles of missing friction, and errors of profiles, exclude the part
that parameters of the base absorb. In the errors and in the p-values, structure that the bumps do
not explain counts as noise. The p-values include the uncertainty of the noise (`evidence`).
"""

import dataclasses
from collections.abc import Sequence
from math import nan
from typing import NamedTuple

import jax
import numpy as np

from ..fitting.noise import Found
from ..fitting.problem import Problem
from ..fitting.start import HOLD
from ..rig.friction.extended import ExtendedLaw
from .engine import ALONG, Engine
from .evidence import Question, chances
from .nonlinear import Response, linear_response, respond
from .refit import Candidate
from .residual_tests import chi_square_tail
from .result import LocationProfile
from .screen import orthonormal
from .thresholds import COARSE, FINE, MOSTLY, PRIOR, SEEN, SIGNIFICANT, WAVES


class Bumps(NamedTuple):
    """Bumps of friction over one variable, and the response to each bump in noise units."""

    variable: str
    unit: str
    centres: np.ndarray
    columns: np.ndarray

    @property
    def pairs(self) -> bool:
        """Whether each centre of a bump is a wavelength, with a sine and a cosine."""
        return self.columns.shape[1] == 2 * len(self.centres)

    def groups(self) -> list[np.ndarray]:
        """Groups of columns that are fitted together: all bumps, or a sine and its cosine."""
        return np.split(self.columns, len(self.centres), axis=1) if self.pairs else [self.columns]


class Asked(NamedTuple):
    """The part of a residual that the bumps of one variable explain."""

    profile: LocationProfile
    """The profile, without its p-value."""
    gain: float
    """Reduction of the sum of squares minus its degrees of freedom."""
    columns: tuple[int, ...]
    """The bumps that are tested together."""
    times: int
    """Number of such tests of which this is the most significant (for the Bonferroni factor)."""


def locate(
    engine: Engine, base: Candidate, found: Found, bumps: Sequence[Bumps]
) -> tuple[tuple[LocationProfile, ...], dict[str, float]]:
    """Profiles of missing friction over every variable, and p-values of all tests of the residual
    under noise alone. The variable that explains most comes first. The p-values are not corrected
    for the number of tests.

    `found` is the noise after projecting out smooth columns.
    """
    rows = engine.evaluate(base.z, engine.free(base.effects))
    train = engine.weight[:, None]
    white = engine.whiten(
        np.concatenate([rows.residual[:, None], rows.jacobian], axis=1) * train, found.noise
    )
    basis = orthonormal(white[:, 1:])
    left = white[:, 0] - basis @ (basis.T @ white[:, 0])
    whole = float(left @ left), float(engine.weight.sum()) - basis.shape[1]
    seen = engine.whiten(_beside(bumps) * train, found.noise)
    parts = _with_columns(bumps, seen - basis @ (basis.T @ seen))
    size = PRIOR * base.rms["train"]
    asked = [
        _ripples(own, left, whole) if own.pairs else _profile(own, left, whole, size)
        for own in parts
    ]
    questions = [
        Question("block_means", engine.smooth[:, :ALONG]),
        Question("step_locked", engine.smooth[:, ALONG:]),
    ]
    for one, own in zip(asked, bumps, strict=True):
        questions.append(Question(own.variable, own.columns[:, list(one.columns)], one.times))
    p = chances(engine, rows, found, questions)
    further = further_shares([own.groups() for own in parts], left, whole)
    both = sorted(zip(asked, further, strict=True), key=lambda pair: -pair[0].gain)
    location = (
        dataclasses.replace(one.profile, p_value=p[one.profile.variable], further=share)
        for one, share in both
    )
    return tuple(location), p


def _beside(bumps: Sequence[Bumps]) -> np.ndarray:
    """The columns of all variables in one matrix."""
    return np.concatenate([one.columns for one in bumps], axis=1)


def _with_columns(bumps: Sequence[Bumps], columns: np.ndarray) -> list[Bumps]:
    """The bumps with their columns replaced by those of one matrix of all variables."""
    ends = np.cumsum([one.columns.shape[1] for one in bumps])[:-1]
    both = zip(bumps, np.split(columns, ends, axis=1), strict=True)
    return [one._replace(columns=own) for one, own in both]


def further_shares(
    parts: Sequence[Sequence[np.ndarray]], left: np.ndarray, whole: tuple[float, float]
) -> list[float]:
    """Share of the structure that each variable explains beyond the variables before it.

    Forward selection takes first the variable that explains most structure, then the variable that
    explains most of the remaining structure, while this part is significant. Shares are at least 0
    and add up to at most 1; no variable explains the rest. All shares are nan without significant
    structure (`share_of`).

    Parameters
    ----------
    parts : for every variable its groups of columns in units of the noise; the best group counts.
    left : residual in the same units, of shape (rows,).
    whole : as in `share_of`.
    """
    if np.isnan(share_of(0.0, 0, whole)):
        return [nan] * len(parts)
    shares, open_ = [0.0] * len(parts), set(range(len(parts)))
    taken, rest = np.zeros((len(left), 0)), left
    while open_:
        found = {k: _best_group(parts[k], taken, rest) for k in open_}
        best = max(open_, key=lambda k: found[k][0] - found[k][1].shape[1])
        gain, basis = found[best]
        after = max((float(rest @ rest) - gain) / max(whole[1], 1.0), 1.0)
        chance = len(parts[best]) * chi_square_tail(gain / after, basis.shape[1])
        if chance > SIGNIFICANT:
            break
        share = share_of(gain, basis.shape[1], whole)
        shares[best] = min(share, max(1.0 - sum(shares), 0.0))
        taken, rest = np.concatenate([taken, basis], axis=1), rest - basis @ (basis.T @ rest)
        open_.remove(best)
    return shares


def _best_group(
    groups: Sequence[np.ndarray], taken: np.ndarray, rest: np.ndarray
) -> tuple[float, np.ndarray]:
    """The largest reduction of the sum of squares by a group beyond `taken`, and its basis."""
    best = 0.0, rest[:, None][:, :0]
    for columns in groups:
        new = columns - taken @ (taken.T @ columns)
        values, vectors = np.linalg.eigh(new.T @ new)
        # with the rank of `_profile` the first variable has the same share as alone
        used = values > SEEN * max(np.linalg.eigvalsh(columns.T @ columns)[-1], 1e-300)
        basis = new @ (vectors[:, used] / np.sqrt(values[used]))
        gain = float(np.sum((basis.T @ rest) ** 2))
        if gain > best[0]:
            best = gain, basis
    return best


def share_of(gain: float, degrees: int, whole: tuple[float, float]) -> float:
    """Share of the structure that columns with `degrees` of freedom explain, from their `gain`.

    `whole` is the sum of squares in units of the noise, and its degrees of freedom. The excess of
    the sum of squares over its degrees of freedom is structure. The result is nan if the structure
    is not significant.
    """
    squares, rows = whole
    if chi_square_tail(squares, int(rows)) > SIGNIFICANT:
        return float("nan")
    return float(np.clip((gain - degrees) / (squares - rows), 0.0, 1.0))


def friction_bumps(engine: Engine[Problem], base: Candidate) -> list[Bumps]:
    """Responses of the linearised slider to bumps of friction."""
    response = linear_response(
        engine.evaluator.simulated(base.z, engine.problem), jax.device_put(base.z)
    )
    bumps = _variables(engine, response)
    seen = respond(response, _beside(bumps))[0] / float(engine.problem.noise_scale)
    return _with_columns(bumps, seen)


def _profile(bumps: Bumps, left: np.ndarray, whole: tuple[float, float], size: float) -> Asked:
    """All bumps together; `size` is the prior standard deviation of missing friction."""
    own = bumps.columns
    gram, side = own.T @ own, own.T @ left
    values, vectors = np.linalg.eigh(gram)
    used = values > SEEN * max(values[-1], 1e-300)
    seen = vectors[:, used].T @ side
    gain, degrees = float(np.sum(seen**2 / values[used])), int(used.sum())
    # structure that these bumps do not explain counts as noise in their errors
    beyond = max((whole[0] - gain) / max(whole[1] - degrees, 1.0), 1.0)
    # the base absorbs some directions, so their size is unknown: the prior limits it
    scaled = np.maximum(values, 0.0) / beyond + 1 / size**2
    # the absorbed directions are removed, except from bumps that the base mostly absorbs
    taken = values / beyond < 1 / size**2
    mostly = np.sum(vectors[:, taken] ** 2, axis=1) > MOSTLY
    kept = np.where(taken, mostly[:, None], True) * vectors
    # residual = predicted - recorded: missing friction has the other sign
    amplitudes = -(kept / scaled) @ (vectors.T @ side) / beyond
    errors = np.sqrt(np.sum(kept**2 / scaled, axis=1))
    unseen = np.diag(gram) <= 1e-9 * max(np.max(np.diag(gram)), 1e-300)
    amplitudes, errors = np.where(unseen, np.nan, amplitudes), np.where(unseen, np.nan, errors)
    explained = share_of(gain, degrees, whole)
    profile = LocationProfile(*bumps[:3], amplitudes, errors, explained, nan)
    return Asked(profile, gain - degrees, tuple(range(own.shape[1])), 1)


def _ripples(bumps: Bumps, left: np.ndarray, whole: tuple[float, float]) -> Asked:
    """Fits a sine and a cosine for each wavelength alone: many together would follow anything."""
    amplitudes, errors, gains = np.zeros((3, len(bumps.centres)))
    for k, pair in enumerate(bumps.groups()):
        gram, side = pair.T @ pair, pair.T @ left
        inverse = np.linalg.pinv(gram, rcond=1e-9, hermitian=True)
        amplitudes[k] = np.linalg.norm(inverse @ side)
        errors[k] = np.sqrt(0.5 * np.trace(inverse))
        gains[k] = side @ inverse @ side
    best = float(np.max(gains))
    beyond = np.maximum((whole[0] - gains) / max(whole[1] - 2, 1.0), 1.0)
    errors *= np.sqrt(beyond)
    explained = share_of(best, 2, whole)
    profile = LocationProfile(*bumps[:3], amplitudes, errors, explained, nan)
    k = int(np.argmax(gains))
    return Asked(profile, best - 2, (2 * k, 2 * k + 1), len(bumps.centres))


def _variables(engine: Engine[Problem], response: Response) -> list[Bumps]:
    """The bumps of every variable; their columns are forces along the motion."""
    law = response.rig.friction
    assert isinstance(law, ExtendedLaw)
    time = np.concatenate([[float(response.start)], np.asarray(response.middle)])
    slip, V = np.asarray(response.slip), np.asarray(response.velocity)
    log_velocity = np.log(np.maximum(V, 1e-300) / float(law.base.V0))
    lag = np.asarray(response.state)[:, 0] + float(np.asarray(law.base.B)[0]) * log_velocity
    motion = engine.problem.motion
    jumps = np.asarray(motion.times)
    jumps = jumps[np.isfinite(jumps)]
    k = np.clip(np.searchsorted(jumps, time, side="right") - 1, 0, None)
    since = time - jumps[k]
    at_jump = np.interp(jumps, time, slip)
    slipped = np.maximum(slip - at_jump[k], 0.0)
    stepped = (k > 0).astype(float)[:, None]
    steps = _log_steps(np.abs(np.asarray(motion.velocities))[: len(jumps)])
    shortest = max(float(np.quantile(since[since > 0], 0.01)), 1e-9)
    lengths = np.geomspace(2e-2, 1.0, COARSE) * max(float(np.max(slipped)), 1e-12)
    total = max(float(np.ptp(slip)), 1e-12)
    waves = total / np.linspace(2, 60, WAVES)  # half a period apart over the record
    phases = 2 * np.pi * slip[:, None] / waves
    fourier = np.stack([np.sin(phases), np.cos(phases)], axis=2).reshape(len(slip), -1)
    recent = np.log(np.maximum(since, shortest))
    after = np.linspace(np.log(shortest), np.log(since.max()), COARSE)
    relaxing = np.exp(-slipped[:, None] / lengths) * steps[k][:, None]
    return [
        Bumps("slip", "m", *hats(slip, np.linspace(slip.min(), slip.max(), FINE))),
        Bumps("time", "s", *hats(time, np.linspace(time[0], time[-1], FINE))),
        Bumps("log_velocity", "1", *hats(log_velocity, _spread(log_velocity, COARSE))),
        Bumps("state", "F", *hats(lag, _spread(lag, COARSE))),
        Bumps("time_since_step", "s", np.exp(after), hats(recent, after)[1] * stepped),
        Bumps("slip_since_step", "m", lengths, relaxing),
        Bumps("periodic_in_slip", "m", waves, fourier),
    ]


def _log_steps(speeds: np.ndarray) -> np.ndarray:
    """Change of ln V at every step, 0 at the first; a hold counts as e^-3 of the slowest speed."""
    least = np.exp(-HOLD) * np.min(speeds[speeds > 0], initial=np.inf)
    return np.diff(np.log(np.maximum(speeds, least)), prepend=np.log(max(speeds[0], least)))


def _spread(x: np.ndarray, number: int) -> np.ndarray:
    low, high = np.quantile(x, [0.01, 0.99])
    return np.linspace(low, max(high, low + 1e-9), number)


def hats(x: np.ndarray, centres: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Centres, and a hat function of x (n,) for each centre. A hat is 1 at its centre and 0 at the
    neighbouring centres; the two outer hats continue with 1.
    """
    columns = [np.interp(x, centres, row) for row in np.eye(len(centres))]
    return centres, np.stack(columns, axis=1)
