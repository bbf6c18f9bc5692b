"""How fast, and how surely, many records are fitted at once."""
