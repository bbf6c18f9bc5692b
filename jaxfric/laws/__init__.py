"""Laws of friction from files."""
