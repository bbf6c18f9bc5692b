"""The loop for a servo axis: rows of the record, shapes of effects, steady curves and results."""
