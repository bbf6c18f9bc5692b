"""Hypothesis strategies for files that went wrong: a small record, mutated."""

from command import record_cells
from hypothesis import strategies as st

_CELLS = "nan inf -inf 0 -0.0 1e308 -1e308 1e999 1e-320 1e30 -1 0x1F 1_000 1,5 -- ٣ ½ 1e # '0.6' −1"
_HEADERS = """
time|time [s]|time [ms]|time [1e-3 s]|time [m]|time []|time [s^s]|time [((((((((((((]|[s]|t_s
load_point_displacement [m]|load_point_displacement [nm]|load_point_velocity [um/s]|# time
friction [N]|friction [kN]|friction [%]|friction [1e300]|friction [degC]|friction [**]|mu
slip [um]|normal_stress [MPa]|disp (-0.1 um)|x [um|µ|1|1e5|nan
"""
_BYTES = b'\0\r,;\t#"\x1a\x0c\x80\xb5e-.['

CELLS = st.sampled_from([*_CELLS.split(), "", '"', " 20 "])
HEADERS = st.sampled_from([name for line in _HEADERS.splitlines() for name in line.split("|")])
BYTES = st.one_of(
    st.sampled_from([bytes([code]) for code in _BYTES]),
    st.sampled_from([b"\n\n", b"\xef\xbb\xbf", b"\xff\xfe", b"time [s]"]),
    st.just("µ∞😀\u2028\u202e".encode()),
)
PLACE = st.floats(0, 1, exclude_max=True)
EDITS = st.one_of(
    st.tuples(st.just("cell"), PLACE, PLACE, CELLS),
    st.tuples(st.just("column"), PLACE, PLACE, CELLS),
    st.tuples(st.just("times"), PLACE, PLACE, st.sampled_from([0.0, -1.0, 1e-9, 1e9, 1e290])),
    st.tuples(st.just("header"), PLACE, PLACE, HEADERS),
    st.tuples(st.just("swap columns"), PLACE, PLACE, st.none()),
    st.tuples(st.just("swap rows"), PLACE, PLACE, st.none()),
    st.tuples(st.just("repeat row"), PLACE, PLACE, st.integers(1, 40)),
    st.tuples(st.just("drop rows"), PLACE, PLACE, st.none()),
)
BYTE_EDITS = st.one_of(
    st.tuples(st.just("flip"), PLACE, PLACE, st.integers(0, 255)),
    st.tuples(st.just("insert"), PLACE, PLACE, BYTES),
    st.tuples(st.just("delete"), PLACE, PLACE, st.none()),
    st.tuples(st.just("truncate"), PLACE, PLACE, st.none()),
    st.tuples(st.just("replace all"), PLACE, PLACE, st.tuples(BYTES, BYTES)),
)


def edit_cells(cells: list[list[str]], edit: tuple) -> None:
    """Apply an edit of rows and columns; places are fractions of the size."""
    kind, a, b, value = edit
    width = len(cells[0])
    row, other = 1 + int(a * (len(cells) - 1)), 1 + int(b * (len(cells) - 1))
    column = int(b * width)
    if kind == "cell":
        cells[row][column] = value
    elif kind == "column":
        for line in cells[1:]:
            line[column] = value
    elif kind == "times":
        for line in cells[1:]:
            with_number = line[column].replace(".", "", 1).lstrip("-").isdecimal()
            line[column] = repr(float(line[column]) * value) if with_number else line[column]
    elif kind == "header":
        cells[0][column] = value
    elif kind == "swap columns":
        for line in cells:
            first = int(a * width)
            line[first], line[column] = line[column], line[first]
    elif kind == "swap rows":
        cells[row], cells[other] = cells[other], cells[row]
    elif kind == "repeat row":
        cells[row:row] = [list(cells[row]) for _ in range(value)]
    elif kind == "drop rows" and abs(other - row) < len(cells) - 2:
        del cells[min(row, other) : max(row, other)]


def edit_bytes(data: bytes, edit: tuple) -> bytes:
    """Apply an edit of bytes."""
    kind, a, b, value = edit
    i = int(a * len(data))
    if kind == "flip":
        return data[:i] + bytes([value]) + data[i + 1 :]
    if kind == "insert":
        return data[:i] + value + data[i:]
    if kind == "delete":
        return data[:i] + data[i + int(b * 60) :]
    if kind == "truncate":
        return data[:i]
    return data.replace(*value)


@st.composite
def mutated_files(draw: st.DrawFn) -> bytes:
    """A small record, edited up to three times by rows and columns and twice by bytes."""
    cells = record_cells()
    for edit in draw(st.lists(EDITS, max_size=3)):
        edit_cells(cells, edit)
    data = "\n".join(",".join(row) for row in cells).encode()
    for edit in draw(st.lists(BYTE_EDITS, max_size=2)):
        data = edit_bytes(data, edit)
    return data
