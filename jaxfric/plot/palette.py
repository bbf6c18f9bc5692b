"""Colours of all figures.

Readers with protanopia, deuteranopia or tritanopia can distinguish the colours of one figure, too.
`tests/test_colours.py` simulates how such readers see each pair of a figure (Machado et al. 2009,
doi:10.1109/TVCG.2009.113). Add each new colour in `tests/test_colours.py` to the group of its
figure.
"""

BLUE, ORANGE, GREY, BLACK = "#1f4e79", "#c8501e", "0.55", "0.15"
SKY, GOLD, MAGENTA, MINT, SLATE = "#56b4e9", "#e0ac00", "#d06ba8", "#8fd0b0", "0.42"
STABLE, UNSTABLE, MEETS, BAND = "#cfe0ee", "#efb195", "#5a9c92", "#ffe28a"
CYCLE, ESCAPE, OPEN = "#e3a27f", "#8a3b12", "0.7"
TRAIN, SELECT, REPORT = "0.96", BAND, "#a9cfe6"
MIDDLE, LIGHT, PALE = "#5d8bb3", "#a8c8e8", "0.88"
HELD = "#f2efe4"
LINES = (BLUE, SKY, GOLD, MAGENTA)
"""Colours of curves of one panel; ORANGE beside them is what is required or fitted."""
EIGHT = (BLUE, ORANGE, SKY, GOLD, MAGENTA, MINT, BLACK, SLATE)
"""Colours of as many kinds."""
CODES = (SKY, GOLD, BLUE, MAGENTA, MINT, SLATE)
"""Colours of codes of a study that have no colour of their own."""
