"""Is something left that follows the drive, the slip, the velocity or the time since a step?

Noise is correlated over short distances, in a memory that is bounded. Whether neighbouring rows are
alike is a question about the recorder and is not asked. What is asked are likelihood ratios
(`ratio`): whether hats along the record or since the steps, or bumps of friction over one variable
(`location`), make the residual likelier than noise alone does.

With the sizes of the train and of the held-out error, which a verdict also asks about, all answers
are corrected together: noise alone then fails one of them once in 1/p records.
"""

import math


def asked(tests: dict[str, float]) -> int:
    """Questions that one verdict asks of a residual: the tests, and the sizes of two errors."""
    return len(tests) + 2


def structure(chances: dict[str, float]) -> dict[str, float]:
    """p-values of likelihood ratios (`ratio.chances`), corrected after Holm: small ones mean
    structure."""
    return holm(chances, asked(chances))


def p_text(p: float) -> str:
    """A p-value in words: "p = 0.03", a tiny one as a bound."""
    if not math.isfinite(p):
        return "p unknown"
    return "p < 1e-12" if p < 1e-12 else f"p = {p:.2g}"


def holm(raw: dict[str, float], asked: int) -> dict[str, float]:
    """Holm's correction of several p-values, the least of so many that were asked for."""
    corrected, least = {}, 0.0
    for i, name in enumerate(sorted(raw, key=lambda n: raw[n])):
        least = max(least, min(1.0, (asked - i) * raw[name]))
        corrected[name] = least
    return {name: corrected[name] for name in raw}


def merged(p: float, q: float) -> float:
    """p-value of two that may depend on each other in any way: twice their geometric mean.

    The chance that p q <= e^2 is at most x + e^2/x for any x (Makarov 1981, doi:10.1137/1126086):
    2 e at best. For more than two see Vovk and Wang 2020 (doi:10.1093/biomet/asaa027).
    """
    return min(1.0, 2 * math.sqrt(p * q))


def chi_square_tail(x: float, degrees: int) -> float:
    """Probability that chi-square with `degrees` exceeds `x`."""
    if degrees < 1:
        return 1.0
    from scipy.special import gammaincc

    p = float(gammaincc(0.5 * degrees, 0.5 * max(x, 0.0)))
    return p if math.isfinite(p) else 1.0
