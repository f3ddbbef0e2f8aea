"""Pictures of a flight by MuJoCo: the body in sunlight, what was seen of it, the swarm and where it looks.

One drawing serves videos, stills, the environment and the live view. It has a model of its own, of mocap bodies only, so
that a recorded flight is drawn as well as a running simulation.
"""
