"""Gains, fits and loops of a study, by Python functions of one member's numbers.

Searches for gains, fits and loops have data-dependent control flow, so `vmap` cannot map them over
members. One member takes from 0.05 s (gains) to minutes (a loop). The results go to the same store
as other outputs, and a Dask cluster computes many members at once. `fit` and `loop` test what a
measurement would show. Both simulate the member's record, add noise that depends only on the
member, and fit the noisy record.
"""

import hashlib
import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..errors import InputError, did_you_mean
from ..motion import PiecewiseVelocity
from ..quantity import numbered_names
from ..records import Record, from_arrays
from ..rig import QuasiStatic, Rig
from ..rig.friction import AbstractRateState
from ..simulation import RESULTS, simulate
from ..stability.margin_table import MARGINS
from ..study import Output
from ..tables import Table, number, placed, positive, refuse_unknown, whole
from .parameters import needed, rate_state
from .spec import Spec, StudyPart

GAINS_CODES = {
    "found": "Gains were found that meet the requirement.",
    "none": "No gains within the limits meet the requirement.",
}
FIT_CODES = {
    "converged": "The fit converged and the record determines all parameters.",
    "undetermined": "The fit converged, but the record does not determine all parameters.",
    "not_converged": "The fit did not converge.",
    "ran_away": "The slider runs away or takes too many steps: there is no record.",
}
# Members of a block: fewer for slower computations.
_CHUNK_GAINS, _CHUNK_FITS, _CHUNK_LOOPS = 16, 4, 1
_GAINS = ("margin", "max_k_p", "max_k_v", "scale_k_p", "scale_k_v")
_RECORD = ("ratio", "noise", "rows", "distance", "seed")
_LOOP = (*_RECORD, "steps", "max_effects", "include", "exclude")
_OLD = {"most": "max_effects", "with": "include", "without": "exclude"}
"""Keys of earlier versions, and their names now."""


def _law(spec: Spec, where: str) -> str:
    """Return the name of the law, which these computations need.

    Raises
    ------
    InputError : the law comes from a file and has no name.
    """
    if not isinstance(spec.law, str):
        raise InputError(f"{where}: in a study this takes the slip or the ageing law")
    return spec.law


def make_gains(spec: Spec, table: Table, where: str) -> StudyPart:
    """Make the study part of `compute = ["gains"]` from the table [gains].

    Raises
    ------
    InputError : an unknown key, an invalid value. `make_fit` and `make_loop` raise this error, too.
    """
    from ..gains.requirement import Requirement

    refuse_unknown(table, _GAINS, where)
    law = _law(spec, where)
    margin = table.get("margin")
    if not isinstance(margin, dict) or not margin:
        raise InputError(f"{where}: margin is missing; say which, margin = {{ stiffness = 1.2 }}")
    for key, value in margin.items():
        if key not in MARGINS:
            raise InputError(f"{where}: no margin '{key}'{did_you_mean(key, MARGINS)}")
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise InputError(f"{where}: margin {key} is {value!r}; it is a number")
    with placed(where):
        Requirement.with_default(margin)
    units = {"k_p": "N/m", "k_v": "N*s/m"}
    limits = tuple(positive(table, f"max_{n}", u, where) for n, u in units.items())
    scales = tuple(positive(table, f"scale_{n}", u, where) for n, u in units.items())
    outputs = (
        Output("gains", long_name="whether there are gains", codes=GAINS_CODES),
        Output("least_k_p", "N/m", "position gain of least norm"),
        Output("least_k_v", "N*s/m", "velocity gain of least norm"),
        Output("norm", "1", "norm of the gains"),
    )
    function = LeastGains(law, spec.states, spec.fixed, margin, limits, scales)
    return StudyPart(function, outputs, kind="host", chunk=_CHUNK_GAINS, batch=1)


@dataclass(frozen=True, eq=False)
class LeastGains:
    """The smallest gains of one member (`jaxfric.find_gains`).

    If no gains suit a member, this is a valid result. An exception is stored as the member's error.
    """

    law: str
    states: int
    fixed: Mapping[str, float]
    margin: Mapping[str, float]
    upper: tuple[float | None, ...]
    scale: tuple[float | None, ...]

    def __call__(self, varied: Mapping[str, float]) -> dict[str, float]:
        """Outputs of a member."""
        from ..gains.gains import find_gains
        from ..gains.solve import NoGains

        p = {**self.fixed, **varied}
        try:
            found = find_gains(
                rate_state(self.law, p, self.states),
                velocity=np.asarray([p["V0"]]),
                mass=np.asarray([p["m"]]) if "m" in p else None,
                margin=self.margin,
                scale=(self.scale[0], self.scale[1]),
                upper=(self.upper[0], self.upper[1]),
            )
        except NoGains:
            return {"gains": 1, "least_k_p": np.inf, "least_k_v": np.inf, "norm": np.inf}
        return {"gains": 0, "least_k_p": found.kp, "least_k_v": found.kv, "norm": found.norm}


def make_fit(spec: Spec, table: Table, where: str) -> StudyPart:
    """Make the study part of `compute = ["fit"]` from the table [fit]."""
    refuse_unknown(table, _RECORD, where)
    maker = _record(spec, table, where)
    names = needed(spec.states)
    units = dict.fromkeys(names, "N") | {n: "m" for n in names if n[0] == "L"}
    outputs = [Output("fit", long_name="how the fit ended", codes=FIT_CODES)]
    outputs += [Output(f"fitted_{n}", units[n], f"{n} of the fit") for n in names]
    outputs += [Output(f"std_{n}", units[n], f"standard deviation of {n}") for n in names]
    outputs += [Output("rms", "N", "rms of the residual")]
    function = FitOfRecord(maker, tuple(names))
    return StudyPart(function, tuple(outputs), kind="host", chunk=_CHUNK_FITS, batch=1, mass=False)


def _record(spec: Spec, table: Table, where: str, steps: int = 1) -> "Recorder":
    ratio = table.get("ratio", 10.0)
    noise = number(table.get("noise", "0 N"), "N", f"{where} noise")
    if isinstance(ratio, bool) or not isinstance(ratio, int | float) or not ratio > 0 or ratio == 1:
        raise InputError(f"{where}: ratio is {ratio!r}; it is a positive number, not 1")
    if not noise >= 0:
        raise InputError(f"{where}: noise is {noise:g} N; it must not be negative")
    steps = whole(table, "steps", where) or steps
    if steps > 20:
        raise InputError(f"{where}: steps is {steps!r}; it is a whole number from 1 to 20")
    return Recorder(
        _law(spec, where),
        spec.states,
        spec.fixed,
        float(ratio),
        whole(table, "rows", where, 40) or 400,
        noise,
        positive(table, "distance", "m", where),
        whole(table, "seed", where, 0) or 0,
        steps,
    )


@dataclass(frozen=True, eq=False)
class Recorder:
    """The simulated record of one member: `steps` velocity steps, up and down by `ratio`, to V0."""

    law: str
    states: int
    fixed: Mapping[str, float]
    ratio: float
    rows: int
    noise: float
    distance: float | None
    seed: int
    steps: int

    def __call__(self, varied: Mapping[str, float]) -> tuple[Record, float, str] | None:
        """Return record, stiffness [N/m] and text of its steps; None if the simulation failed."""
        p = {**self.fixed, **varied}
        L = max(p[name] for name in numbered_names(self.states)[1::2])
        far = 15 * L if self.distance is None else self.distance
        V = [p["V0"] / self.ratio if i % 2 == 0 else p["V0"] for i in range(self.steps + 1)]
        times = np.concatenate([[0.0], np.cumsum([far / v for v in V])])
        per = self.rows // len(V)
        ts = np.concatenate(
            [np.linspace(a, b, per, endpoint=False) for a, b in itertools.pairwise(times)]
        )
        force, ok, possible = _simulated(
            rate_state(self.law, p, self.states),
            p["k_p"],
            jnp.asarray(times[:-1]),
            jnp.asarray(V),
            jnp.asarray(ts),
        )
        if not bool(possible):
            raise InputError(
                f"no record can be simulated: k_p is {p['k_p']:g} N/m, V0 {p['V0']:g} m/s; both"
                " must be positive and finite"
            )
        if not bool(ok):
            return None
        load = np.interp(ts, times, np.concatenate([[0.0], np.cumsum(np.full(len(V), far))]))
        noisy = np.asarray(force) + self.noise * self._noise(p, len(ts))
        record = from_arrays(ts, noisy, load_point_displacement=load, friction_unit="N")
        text = ", ".join(f"{t:.17g} s: {v:.17g} m/s" for t, v in zip(times, V, strict=False))
        return record, p["k_p"], text

    def _noise(self, p: Mapping[str, float], number: int) -> np.ndarray:
        """Return white noise of one member, seeded by its parameters."""
        text = repr((self.seed, sorted(p.items()))).encode()
        seed = int.from_bytes(hashlib.sha256(text).digest()[:8], "little")
        return np.random.default_rng(seed).standard_normal(number)


@eqx.filter_jit
def _simulated(
    law: AbstractRateState, stiffness: float, times: Array, velocities: Array, ts: Array
) -> tuple[Array, Array, Array]:
    """Simulate a massless slider; return friction, whether it succeeded, and was possible."""
    found = simulate(Rig(QuasiStatic(stiffness), law), PiecewiseVelocity(times, velocities), ts)
    result = found.result
    return found.force, result == RESULTS.successful, result != RESULTS.impossible


@dataclass(frozen=True, eq=False)
class FitOfRecord:
    """The fit of one member's record (`jaxfric.fit`)."""

    record: Recorder
    names: tuple[str, ...]

    def __call__(self, varied: Mapping[str, float]) -> dict[str, float]:
        """Outputs of a member."""
        from ..fitting import fit

        made = self.record(varied)
        columns = [f"{kind}_{n}" for kind in ("fitted", "std") for n in self.names]
        if made is None:
            return {"fit": 3, "rms": math.nan, **dict.fromkeys(columns, math.nan)}
        record, stiffness, steps = made
        law, states = self.record.law, self.record.states
        found = fit(record, stiffness=stiffness, law=law, states=states, steps=steps)
        known = [found.parameters[n] for n in self.names]
        code = 2 if not found.converged else 0 if all(e.determined for e in known) else 1
        values = [e.value for e in known] + [e.std for e in known]
        return {"fit": code, "rms": float(found.rms), **dict(zip(columns, values, strict=True))}


def make_loop(spec: Spec, table: Table, where: str) -> StudyPart:
    """Make the study part of `compute = ["loop"]` from the table [loop]."""
    from ..effects import CATALOGUE
    from ..loop import VERDICTS

    old = {key: new for key, new in _OLD.items() if key in table}
    table = {_OLD.get(key, key): value for key, value in table.items()}
    refuse_unknown(table, _LOOP, where)
    codes = {name: name.replace("_", " ") for name in VERDICTS}
    codes |= {"no_record": "The slider runs away or takes too many steps: there is no record."}
    ids = {"none": "No effect was added."} | {id: id.replace("_", " ") for id in CATALOGUE}
    outputs = (
        Output("verdict", long_name="verdict of the loop", codes=codes),
        Output("effects", "1", "number of effects that were added"),
        Output("first_effect", long_name="effect that was added first", codes=ids),
        Output("held_out_before", "1", "test error of the base, in sigma of the noise"),
        Output("held_out_after", "1", "test error with the effects, in sigma of the noise"),
    )
    most = whole(table, "max_effects", where) or 1
    if most > 3:
        raise InputError(f"{where}: max_effects is {most!r}; it is 1, 2 or 3")
    declared, excluded = (_effects(table, key, where) for key in ("include", "exclude"))
    recorder = _record(spec, table, where, steps=6)
    function = LoopOfRecord(recorder, tuple(codes), tuple(ids), most, declared, excluded)
    notes = tuple(f"{where}: the key '{key}' is now '{new}'" for key, new in old.items())
    return StudyPart(
        function,
        outputs,
        kind="host",
        chunk=_CHUNK_LOOPS,
        batch=1,
        warnings=notes,
        mass=False,
    )


def _effects(table: Table, key: str, where: str) -> tuple[str, ...]:
    """Return the effects that a table lists; none without the key."""
    found = table.get(key, [])
    if not isinstance(found, list) or not all(isinstance(x, str) for x in found):
        raise InputError(f"{where}: {key} is a list of effects, as in {key} = ['viscous']")
    return tuple(found)


@dataclass(frozen=True, eq=False)
class LoopOfRecord:
    """The verdict of the loop on one member's record (`jaxfric.close_loop`), with one state."""

    record: Recorder
    verdicts: tuple[str, ...]
    ids: tuple[str, ...]
    most: int
    declared: tuple[str, ...]
    excluded: tuple[str, ...]

    def __call__(self, varied: Mapping[str, float]) -> dict[str, float]:
        """Outputs of a member."""
        from ..loop import close_loop

        made = self.record(varied)
        if made is None:
            errors = {"held_out_before": math.nan, "held_out_after": math.nan}
            return {"verdict": len(self.verdicts) - 1, "effects": 0, "first_effect": 0, **errors}
        record, stiffness, steps = made
        found = close_loop(
            record,
            stiffness=stiffness,
            law=self.record.law,
            steps=steps,
            include=self.declared,
            exclude=self.excluded,
            max_effects=self.most,
        )
        return {
            "verdict": self.verdicts.index(found.verdict),
            "effects": len(found.effects),
            "first_effect": self.ids.index(found.effects[0]) if found.effects else 0,
            "held_out_before": found.test_error(found.before),
            "held_out_after": found.test_error(found.after),
        }
