"""The same swarm in swarm_mj, in Basilisk and by SciPy: how far they agree and what they cost."""
