"""The commands of `swarm-mj`, one module each, with `add(commands)`; heavy modules are imported by those that run."""
