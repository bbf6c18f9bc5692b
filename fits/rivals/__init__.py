"""Rivals on blind records: what others' regressions make of what the loop's base fit leaves."""
