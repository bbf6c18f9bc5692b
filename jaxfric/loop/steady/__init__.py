"""The loop on a curve of steady friction over speed, with one mean friction per run."""
