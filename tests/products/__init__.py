"""Maps of a run, read back by other libraries."""
