"""Make the texts and files of results from result objects alone."""
