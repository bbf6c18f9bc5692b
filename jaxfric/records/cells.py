"""Cells of a line of text, and the numbers in them, as spreadsheets and recorders write them."""

import contextlib
import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass

DELIMITERS = ("\t", ";", ",", None)
"""Separator of the cells of a row; None: blanks."""

BLANK = {"", "nan", "na", "n/a", "#n/a", "null", "none", "-", "--", "---"}
"""Cells that hold nothing, in lower case."""

_DOUBLE = re.compile(r"(?<=[\d.])[dD](?=[-+]?\d)")
"""Fortran's exponent of a double: 1.0D+00."""
_BARE = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+))([-+]\d{2,3})")
"""Fortran's exponent beyond 99, which has no letter: 1.0-100."""
_EXPONENT = r"(?:[eEdD][-+]?\d+)?"


@dataclass(frozen=True)
class Writing:
    """Style in which a file writes its rows: the separator, and whether a comma is decimal."""

    delimiter: str | None
    decimal_comma: bool = False

    def cells(self, line: str) -> list[str]:
        """Cells without blanks and quotes around them; a quoted one may hold the delimiter."""
        line = line.strip(" \n") if self.delimiter == "\t" else line.strip()
        found = line.split(self.delimiter)
        if '"' in line and self.delimiter is not None:
            with contextlib.suppress(csv.Error, StopIteration):
                found = next(csv.reader([line], delimiter=self.delimiter, skipinitialspace=True))
        return [cell.strip().strip("\"'").strip() for cell in found]

    def number(self, cell: str) -> float | None:
        """The number of a cell; None where it is none."""
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
        """Rows with decimal points, and no delimiter at their ends, as NumPy reads them."""
        if self.decimal_comma:
            rows = [row.replace(",", ".") for row in rows]
        return (
            rows if self.delimiter is None else [row.rstrip(f" {self.delimiter}") for row in rows]
        )


def has_decimal_commas(rows: Sequence[str], delimiter: str | None) -> bool:
    """Whether more rows have cells written `0,61` than `0.61`."""
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
    """Digits after the decimal sign of a number as written, and whether it has an exponent."""
    mantissa, exponent = re.fullmatch(r"([^eEdD]*)(.*)", cell, re.DOTALL).groups()  # ty: ignore[missing-union-attribute]
    return len(re.sub(r"^[^.,]*[.,]?", "", mantissa)), len(exponent) > 1
