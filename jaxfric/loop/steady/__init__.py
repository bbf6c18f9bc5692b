"""The loop of a curve of steady friction, one mean for every stroke."""
