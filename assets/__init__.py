"""Data files of swarm_mj: shape model, shape harmonics and MJCF parts."""
