"""The same flights in swarm_mj, Orekit, brahe, SPICE and Basilisk: how far they agree."""
