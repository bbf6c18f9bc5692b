"""The loop on a curve of steady friction, with one mean per run."""
