"""d(gains)/d(record): which rows of a record decide the gains."""
