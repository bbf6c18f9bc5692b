"""Texts on the valid speed range of a feedforward's map, and on its use outside this range."""

from ..errors import option
from .fade import WHOLE, Fade
from .identified import Identified


def supported_text(about: Identified) -> str:
    """The speed range in which the record supports the map."""
    return f"{about.slowest:.4g} to {about.fastest:.4g} {about.length}/s"


def low_speeds(about: Identified, fade: Fade) -> str:
    """Describe the map below the supported speeds."""
    speed = f"{about.length}/s"
    low = f"{about.slowest:.3g} {speed}"
    if about.slowest_row >= about.slowest:
        text = f"Below {low} the map extrapolates the fitted curve, a guess without errors"
    else:
        text = (
            f"Rows count in the fit from {about.slowest_row:.3g} {speed} on, but the record"
            f" supports the map only from {low} on: between the two the map is an extrapolation of"
            " the fitted curve, a guess without errors"
        )
    if fade.decided_by == "given":
        return text
    part = about.slowest / WHOLE
    if fade.speed < 0.999 * part:
        slower = option("fade-speed", f"{part:.3g} {speed}")
        return f"{text}, down to v_f. To compensate less there, give {slower}"
    text += ", which fades with its sign"
    return (
        text
        if fade.decided_by != "rows"
        else f"{text}. A lower {option('fade-speed')} compensates more there"
    )


def own_damping(about: Identified, least: float) -> str:
    """Whether the drive's own k_v is above the `least` [F s/m]."""
    if about.damping is None:
        return "that of the drive in force, which the file does not contain"
    own = f"the drive's own, {about.damping:.4g} {about.force_unit} s/{about.length}"
    return f"{own}, is above it" if about.damping > least else f"{own}, is not: raise it, or v_f"
