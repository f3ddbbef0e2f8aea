"""swarm_mj: CubeSat swarms that fly past small bodies and image their surface, in MuJoCo."""

__version__ = "0.1.0"
