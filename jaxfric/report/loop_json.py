"""A closed loop as the content of loop.json."""

import numpy as np

from ..findings import listed
from ..loop.axis.result import AxisDetails
from ..loop.family import CurveFamily
from ..loop.refusal import SOURCES
from ..loop.result import Loop, Score
from ..loop.split import NAMES
from ..plain import entries, plain
from ..saved.entry import ENTRY, law_entry
from ..schemas import LOOP
from .axis_loop_text import stability
from .fit_json import estimated
from .loop_next import next_steps
from .words import change_words


def content(loop: Loop) -> dict:
    """The content of `loop.json`, schema `schemas.LOOP`; SI, null for unknown numbers."""
    origin, values, steps = loop.record.provenance, loop.base_fit.values(), loop.base_fit.steps
    table = {
        "schema": LOOP,
        "record": {
            **origin.to_json(len(loop.record)),
            **({} if loop.kind == "axis" else {"normal_stress": loop.normal_stress}),
        },
        "friction_unit": loop.record.friction_unit,
        "law": loop.base_fit.law,
        "stiffness": values.get("K"),
        "reference_velocity": values.get("V0"),
        "steps": np.stack([steps.times, steps.velocities], axis=1),
        **entries(loop, "verdict", "sentence", "reasons"),
        "findings": [one.to_json(loop.velocity, loop.record.time) for one in loop.findings],
        **entries(loop, "effects", "alias_groups", "candidates", "screened"),
        **entries(loop, separated_by="separations", location_map="location"),
        "separations": {id: change_words(one) for id, one in loop.separations.items()},
        "families": [family(one) for one in loop.families],
        "rules": {fault.value: source for fault, source in SOURCES.items()},
        "supported": "before" if loop.supported is loop.before else "after",
        "before": _score(loop, loop.before),
        "after": _score(loop, loop.after),
        "shifts_in_sigma": loop.shifts(),
        "noise": {
            **entries(loop, "sigma", "sigma_held_out", "held_out_threshold"),
            **loop.after.noise.to_json(),
        },
        "tests": {
            name: {"before": p, "after": loop.after.tests[name]}
            for name, p in loop.before.tests.items()
        },
        "aliasing": entries(loop, ids="alias_ids", cosines="alias_cosines"),
        "blocks": {
            "by_step": loop.blocks.by_step,
            **{name: int(loop.blocks.of(name).sum()) for name in NAMES},
        },
        **({} if loop.details is None else loop.details.to_json()),
        "next_steps": [entries(step, "code", "text", "command") for step in next_steps(loop)],
        **listed(loop.warnings),
        **entries(loop, "seconds"),
    }
    told = plain(table)
    return told | {ENTRY: law_entry(told)}


def _score(loop: Loop, score: Score) -> dict[str, object]:
    """Errors, parameters and their covariance; no interval of what is not determined."""
    of, step = loop.blocks.of, loop.blocks.step
    rate = score.A_minus_B
    return {
        **{f"{name}_rms": rms for name, rms in score.rms.items()},
        "in_sigma": {name: v / loop.sigma_of(of(name)) for name, v in score.rms.items()},
        "per_step_in_sigma": [v / loop.sigma_of(step == k) for k, v in enumerate(score.per_step)],
        **({} if rate is None else {"A_minus_B": estimated(rate)}),
        "parameters": {name: estimated(e) for name, e in score.parameters.items()},
        **entries(score, "free", "covariance"),
    }


def family(curve: CurveFamily) -> dict[str, object]:
    """The entry of a family of steady-state curves; SI."""
    return {
        "family": "steady_curve",
        **entries(curve, "effects", "velocities", "parameters"),
        "others": [entries(other, "shape", worse_by="worse") for other in curve.others],
        **entries(curve, "fitting", "decided_by"),
    }


def axis(details: AxisDetails) -> dict[str, object]:
    """The JSON entry "axis": preparation, gains and fits; `drive` is given in force."""
    drive, gains = details.record.drive, details.gains
    least = entries(gains, "worst_velocity", "slope", "least_damping", "velocity_gain", "stiff")
    if gains.claim.kind == "open":
        least = dict.fromkeys(least)
    return {
        "axis": {
            "coordinate": details.record.coordinate,
            **entries(details.preparation, "cutoff", "decimation"),
            **entries(details, "notes", "acceleration", "longest_delay", "driven", "withheld"),
            **entries(
                details, "spring", "covariance", sign_width="width", least_slip_length="reach"
            ),
            "drive": drive and entries(drive, k_p="K_p", k_v="K_d"),
            "gains": {
                **least,
                "claim": gains.claim.kind,
                **listed(gains.claim.reasons, "reasons", "reasons_coded"),
                **{end: getattr(gains.curve, end, None) for end in ("slowest", "fastest")},
                "sentence": stability(details),
            },
            "fits": [
                {
                    "model": when,
                    **entries(fit, "method", "values", "std", undetermined="loose"),
                    **entries(fit, "relative_error", "rms", "converged"),
                }
                for when, fit in details.fits
            ],
        }
    }
