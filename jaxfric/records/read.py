"""Read a record of a slider from a file."""

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ..errors import InputError, option
from ..units import has_dimension
from .columns import Found, Use, spelt, understand
from .formats import read_table
from .record import Record, build
from .reduction import reduced
from .roles import SLIDER
from .sizes import SIZES
from .table import Table


def read(
    path: str | Path,
    *,
    columns: Mapping[str, str] | None = None,
    drop_bad: bool = False,
    reduce: str | Path | None = None,
) -> Record:
    """Read a record of time, load-point motion and friction, and convert the record to SI.

    **Arguments:**

    - `path`: delimited text with a header such as
      `time [s],load_point_displacement [um],friction [1],normal_stress [MPa]`, in any order. Usual
      headers of laboratories (`Time(s)`, `Displ(microns)`), decimal commas and clock times are
      understood. The file may also be an xlook file, binary or text, or a MATLAB file, whose
      vectors have names but no units. Without a friction column, friction is computed from shear
      and normal stress; both stresses may be recorded as forces.
    - `columns`: names of columns for roles that the header does not identify, such as
      `{"friction": "mu_corrected"}`. `NAME [unit]` sets the unit, which may have a factor:
      `{"load_point_displacement": "Vert_Disp [0.0764 um]"}`. `#3` is the third column, also in a
      file without a header. `{"time": "1 kHz"}` or "1 ms" gives the sampling rate or interval,
      `{"load_point_velocity": "10 um/s"}` a constant speed of the load point.
    - `drop_bad`: leave out incomplete rows instead of refusing the file.
    - `reduce`: a reduction script that converts what the press recorded to columns with units: an
      xlook command file, or TOML (`jaxfric.records.reduction.toml_script`). `provenance.reduction`
      lists what each step of the script did.

    **Returns:** a `Record`; its `provenance` lists assumptions and omitted rows.

    Raises `InputError` for a file that cannot be read as a record; the message gives the row
    and the column, and what to do.
    """
    table = read_table(path) if reduce is None else reduced(path, reduce)
    return to_record(table, columns=columns, drop_bad=drop_bad)


def to_record(
    table: Table, *, columns: Mapping[str, str] | None = None, drop_bad: bool = False
) -> Record:
    """Make a record from a table; arguments and errors as for `read`."""
    found = understand(table, columns, SLIDER, _stresses)
    values = found.values
    units = {role: use.unit for role, use in found.uses.items()}
    friction_unit = "1"
    if "shear_stress" in values:
        stress, of_forces = values.pop("shear_stress"), found.uses["normal_stress"].si_unit == "N"
        normal = values["normal_stress"]
        values["friction"] = _quotient(table, found.uses, stress, normal, found.rows.lines)
        units["friction"] = "1"
        if of_forces:  # forces give no stress without the area
            del values["normal_stress"], units["normal_stress"]
    else:
        friction_unit = found.uses["friction"].si_unit
    return build(values, friction_unit, units, found.origin, found.rows, drop_bad)


def _stresses(table: Table, found: Found, named: set[str]) -> list[str]:
    """Keep either friction or two stresses in `found`; return a note if friction is computed.

    Raises `InputError` for a shear stress without a normal stress, and for friction as an angle.
    """
    unit = spelt(found["friction"][1]) if "friction" in found else ""
    is_stress = has_dimension(unit, "Pa")
    is_force = _is_force(found, "friction") and _is_force(found, "normal_stress")
    if (is_stress or is_force) and "normal_stress" in found and "shear_stress" not in found:
        found["shear_stress"] = found.pop("friction")
    if "shear_stress" in found and "friction" in found:
        found.pop("friction" if "shear_stress" in named - {"friction"} else "shear_stress")
    if "friction" in found:
        _refuse_friction(table, *found["friction"], is_stress)
    if "shear_stress" not in found:
        _refuse_force(table, found, "normal_stress")
        return []
    shear = table.names[found["shear_stress"][0]]
    forced = _is_force(found, "shear_stress")
    if "normal_stress" not in found:
        raise InputError(
            f"{table.path} has a shear stress, '{shear}', and neither friction nor a normal stress;"
            f" it has: {table.describe()}; map one, as in"
            f" {option('column', 'normal_stress=NAME [MPa]')}; {_share_of(shear)}"
            + (f", or {option('column', f'friction={shear} [kN]')} of a force" if forced else "")
        )
    note = f"friction is '{shear}' over '{table.names[found['normal_stress'][0]]}'"
    if forced and _is_force(found, "normal_stress"):
        return [f"{note}, both forces; the normal stress is not known"]
    _refuse_force(table, found, "shear_stress")
    _refuse_force(table, found, "normal_stress")
    return [note]


def _is_force(found: Found, role: str) -> bool:
    return role in found and has_dimension(spelt(found[role][1]), "N")


def _refuse_force(table: Table, found: Found, role: str) -> None:
    """Refuse a force in place of a stress if only one of shear and normal is a force."""
    if not _is_force(found, role):
        return
    index, unit = found[role]
    name = table.names[index]
    unwanted = role == "normal_stress"
    spare = f"; or leave it out: {option('column', f'{role}=none')}" if unwanted else ""
    raise InputError(
        f"{table.path}, column '{name}' ({role}) is a force [{unit}] and not a stress; give the"
        f" stress of 1 {unit}, as in {option('column', f'{role}={name} [0.4 MPa]')} for kN over"
        " 2500 mm^2."
        " If shear and normal are both forces, map both: friction is their quotient" + spare
    )


def _share_of(name: str) -> str:
    """Return advice for a shear stress without a recorded normal stress."""
    return (
        "if the normal stress was constant and not recorded, divide by it, as in"
        f" {option('column', f'friction={name} [0.2]')} for MPa under 5 MPa"
    )


def _refuse_friction(table: Table, index: int, unit: str | None, is_stress: bool) -> None:
    """Refuse a friction column with the unit of an angle or a stress."""
    what = f"{table.path}, column '{table.names[index]}' (friction)"
    if re.search(r"(?i)deg|rad|°", unit or ""):
        raise InputError(f"{what} is an angle [{unit}]; friction is its tangent: write that")
    if is_stress:
        raise InputError(
            f"{what} is a stress [{unit}]; friction is a coefficient or a force [N], or shear over"
            f" normal stress: map the latter, as in {option('column', 'normal_stress=NAME [MPa]')};"
            f" {_share_of('NAME')}"
        )


def _quotient(
    table: Table, uses: Mapping[str, Use], shear: np.ndarray, normal: np.ndarray, lines: np.ndarray
) -> np.ndarray:
    """Return friction as shear over normal stress, or force.

    Raises `InputError` if the normal stress is not positive, and if it is so small that friction is
    impossible.
    """
    of_forces = uses["normal_stress"].si_unit == "N"
    what, unit, size = ("force", "kN", 1e3) if of_forces else ("stress", "MPa", 1e6)
    wrong = np.isfinite(normal) & ~(normal > 0)
    if wrong.any():
        first = int(np.flatnonzero(wrong)[0])
        turned = f", or turn its sign: {option('column', f'normal_stress=NAME [-1 {unit}]')}"
        raise InputError(
            f"{table.path}: friction is shear {what} over normal {what}, and the normal {what} is"
            f" {normal[first] / size:.6g} {unit} in row {lines[first]} ({wrong.sum()} rows); cut"
            f" the rows without load out{turned if wrong.all() else ''}"
        )
    found = shear / normal
    worst = int(np.argmax(np.nan_to_num(np.abs(found))))
    if abs(found[worst]) > SIZES["friction", "1"].most:
        over, under = (table.names[uses[r].column] for r in ("shear_stress", "normal_stress"))
        raise InputError(
            f"{table.path}: friction is '{over}' over '{under}', {found[worst]:.3g} in row"
            f" {lines[worst]}, where '{under}' is {normal[worst] / size:.3g} {unit}: is that the"
            f" normal {what}, and its unit right? Where it was constant and not recorded:"
            f" {option('column', 'normal_stress=none', f'friction={over} [0.2]')}"
            " for MPa under 5 MPa"
        )
    return found
