"""Tests whether the residual depends on drive, slip, velocity or time since a step.

Noise may be correlated over short distances, with a bounded correlation length. Correlation of
neighbouring rows comes from the recorder and is not tested. The tests are likelihood ratios
(`evidence`) of hat functions along the record or since velocity steps, and of bumps of friction
over one variable (`location`). Each test asks whether the tested functions make the residual
likelier than noise alone.

The verdict also tests the sizes of the train error and of the held-out error. All p-values are
corrected together: for noise alone, the smallest corrected p-value is below any level p in at most
a share p of records.
"""

import math


def asked(tests: dict[str, float]) -> int:
    """Number of tests of one verdict: residual tests, and two tests of the size of an error."""
    return len(tests) + 2


def structure(chances: dict[str, float]) -> dict[str, float]:
    """p-values of likelihood ratios (`evidence.chances`) with Holm's correction. Small p-values
    mean structure.
    """
    return holm(chances, asked(chances))


def holm(raw: dict[str, float], asked: int) -> dict[str, float]:
    """Holm's correction of the given p-values, for `asked` tests in total."""
    corrected, least = {}, 0.0
    for i, name in enumerate(sorted(raw, key=lambda n: raw[n])):
        least = max(least, min(1.0, (asked - i) * raw[name]))
        corrected[name] = least
    return {name: corrected[name] for name in raw}


def merged(p: float, q: float) -> float:
    """Combined p-value of two dependent p-values: twice the geometric mean of the two.

    For two p-values p and q, the chance that the product p q is at most e^2 is at most x + e^2/x
    for any number x (Makarov 1981, doi:10.1137/1126086). The least bound for the product p q is 2
    e, at x = e. For more than two p-values see Vovk and Wang 2020 (doi:10.1093/biomet/asaa027).
    """
    return min(1.0, 2 * math.sqrt(p * q))


def chi_square_tail(x: float, degrees: float) -> float:
    """Probability that chi-square with `degrees` of freedom exceeds `x`."""
    if degrees < 1:
        return 1.0
    from scipy.special import gammaincc

    p = float(gammaincc(0.5 * degrees, 0.5 * max(x, 0.0)))
    return p if math.isfinite(p) else 1.0
