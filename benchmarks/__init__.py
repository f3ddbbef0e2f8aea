"""Side-by-side measurements, each re-runnable by one command."""
