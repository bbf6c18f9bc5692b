"""What an axis brings to the loop: its rows, shapes, curves and words."""
