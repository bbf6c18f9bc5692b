"""Texts and files of results, from result objects only."""
