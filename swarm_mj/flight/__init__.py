"""A scenario flown: planned, simulated, observed."""
