"""Constants of laws that are chosen, not derived, with the reason for each."""

BEYOND = 2.0
"""Factor beyond the velocities of a fit from which its law is an extrapolation."""
USUAL_F0 = 50.0
"""Steady friction in units of A where f0 is not given; rock and metal have 30 to 100."""
NARROWER = 0.05
"""Width of a law's smoothed sign over that of the record: sharp at the speeds that were fitted, yet
smooth enough to simulate through rest."""
NO_WIDTH = 1e-6
"""Width of the law's smoothed sign where that of the record is unknown [m/s]."""
