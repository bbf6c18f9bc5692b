"""The friction law of a file that another verb wrote, whatever rig it is of."""

from pathlib import Path

from .axis_loop import is_of_axis, law_from_axis_loop
from .loop_source import law_from_loop
from .posterior_file import is_posterior, law_from_posterior
from .saved import FIT, LOOP, read_saved
from .source import LawSource, law_from_fit


def law_from_file(
    path: str | Path, *, normal_force: float | None = None, samples: int = 64, seed: int = 0
) -> LawSource:
    """The law of a fit.json, of a posterior.nc, or of the loop.json of a slider or of a servo axis,
    with samples.

    Raises
    ------
    InputError : as `law_from_fit`, `law_from_posterior`, `law_from_loop` and `law_from_axis_loop`.
    """
    if is_posterior(Path(path)):
        return law_from_posterior(path, normal_force=normal_force, samples=samples, seed=seed)
    content = read_saved(Path(path), FIT, LOOP)
    if content["schema"] == FIT:
        return law_from_fit(path, normal_force=normal_force, samples=samples, seed=seed)
    load = law_from_axis_loop if is_of_axis(content) else law_from_loop
    return load(path, normal_force=normal_force, samples=samples, seed=seed)
