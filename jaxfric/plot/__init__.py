"""Figures, from result objects only."""
