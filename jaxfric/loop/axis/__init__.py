"""The axis as a rig of the loop: its rows, shapes, curves and results."""
