"""Split lines of text into cells, and read numbers as spreadsheets and recorders write them."""

import contextlib
import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass

DELIMITERS = ("\t", ";", ",", None)
"""Delimiters of the cells of a row; None: blanks."""

BLANK = {"", "nan", "na", "n/a", "#n/a", "null", "none", "-", "--", "---"}
"""Texts of empty cells, in lower case."""

_DOUBLE = re.compile(r"(?<=[\d.])[dD](?=[-+]?\d)")
"""Fortran's exponent of a double-precision number: 1.0D+00."""
_BARE = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+))([-+]\d{2,3})")
"""Fortran's exponent above 99, which has no letter: 1.0-100."""
_EXPONENT = r"(?:[eEdD][-+]?\d+)?"


@dataclass(frozen=True)
class Writing:
    """Style of a file's rows: the delimiter, and whether numbers have decimal commas."""

    delimiter: str | None
    decimal_comma: bool = False

    def cells(self, line: str) -> list[str]:
        """Split a line into cells without outer blanks and quotes; quoted cells keep delimiters."""
        line = line.strip(" \n") if self.delimiter == "\t" else line.strip()
        found = line.split(self.delimiter)
        if '"' in line and self.delimiter is not None:
            with contextlib.suppress(csv.Error, StopIteration):
                found = next(csv.reader([line], delimiter=self.delimiter, skipinitialspace=True))
        return [cell.strip().strip("\"'").strip() for cell in found]

    def number(self, cell: str) -> float | None:
        """Return the number of a cell, or None."""
        if self.decimal_comma:
            if "." in cell:
                return None
            cell = cell.replace(",", ".")
        try:
            return float(cell)
        except ValueError:
            pass
        bare = _BARE.fullmatch(cell)
        try:
            return float(f"{bare[1]}e{bare[2]}" if bare else _DOUBLE.sub("e", cell))
        except ValueError:
            return None

    def plain(self, rows: list[str]) -> list[str]:
        """Return the rows in NumPy's style: with decimal points, without a delimiter at the end."""
        if self.decimal_comma:
            rows = [row.replace(",", ".") for row in rows]
        return (
            rows if self.delimiter is None else [row.rstrip(f" {self.delimiter}") for row in rows]
        )


def has_decimal_commas(rows: Sequence[str], delimiter: str | None) -> bool:
    """Whether more rows have cells like `0,61` than like `0.61`."""
    if delimiter == "," or not any("," in row for row in rows):
        return False
    edge = r"\s" if delimiter is None else re.escape(delimiter)
    commas, points = (
        re.compile(rf'(?:^|{edge})\s*"?[-+]?\d*{sign}\d+{_EXPONENT}"?\s*(?=$|{edge})')
        for sign in (",", r"\.")
    )
    return sum(commas.search(row) is not None for row in rows) > sum(
        points.search(row) is not None for row in rows
    )


def decimals(cell: str) -> tuple[int, bool]:
    """Return the number of decimals of a written number, and whether it has an exponent."""
    mantissa, exponent = re.fullmatch(r"([^eEdD]*)(.*)", cell, re.DOTALL).groups()  # ty: ignore[missing-union-attribute]
    return len(re.sub(r"^[^.,]*[.,]?", "", mantissa)), len(exponent) > 1
